"""Laws that hold the pole and the cart, which the chapter's law leaves out.

One is section 2's method on all four states; the other keeps section 3's feedback linearization
of the angle and lets an outer loop on the cart shape the acceleration that is asked of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import GainError
from grosmc_mj.ground.fields import checked
from grosmc_mj.theory.control.controller import Controller, Design, named_gains
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.theory.control.design import linear_lqr, state_grosmc
from grosmc_mj.theory.control.kinds.kind import OF_EQUATIONS, LawKind
from grosmc_mj.theory.control.law import Law
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.lqr import lqr
from grosmc_mj.theory.control.references import setpoint
from grosmc_mj.theory.control.surface import integrate
from grosmc_mj.theory.control.switching import SwitchingTerm
from grosmc_mj.theory.control.task import AS_PRINTED, FeedbackParameters, Task, state_task
from grosmc_mj.theory.control.uncertainty.states import StateUncertainty
from grosmc_mj.theory.plants import CART_PENDULUM, AnalyticPlant, OperatingPoint
from grosmc_mj.theory.plants.cart_pendulum import CartPendulumParameters

_ANGLE = ErrorCoordinates(CART_PENDULUM, setpoint)

# Q (4, 4) and R of the index (4). The pole's rate costs most: with a stiff cart the sliding
# dynamics themselves are unstable for a longer pole, whatever the switching gain
# (``sliding_dynamics``).
WEIGHTS = (np.diag([1.0, 1.0, 1.0, 100.0]), 1.0)
# Largest angle that the outer loop asks for [rad].
LEAN = 0.35
# Uncertainty that the holding laws withstand: the chapter's case 1, and 0.05 N on the cart.
UNCERTAINTY = StateUncertainty(mass=4.0, length=4.0, force=0.05)


def holding_lqr(
    plant: AnalyticPlant,
    model: tuple[Array, Array] | None = None,
) -> Controller:
    """LQR of all four states, eqs. (5)-(6).

    Args:
        plant: The nominal plant: a pole on a cart.
        model: (A, B) of it, for instance from MuJoCo; in symbols by default.
    """
    law = linear_lqr(state_task(plant, *WEIGHTS, model=model))
    source = "eqs. (5)-(6) with four states"
    return replace(law, name="cart-lqr", design=replace(law.designed, source=source))


def holding_ism(
    plant: AnalyticPlant,
    model: tuple[Array, Array] | None = None,
    uncertainty: StateUncertainty = UNCERTAINTY,
    G: ArrayLike | None = None,
) -> Controller:
    """Integral sliding mode on the four-state LQR: section 2's surface (8) and law (12).

    Args:
        plant: The nominal plant: a pole on a cart.
        model: (A, B) of it, for instance from MuJoCo; in symbols by default.
        uncertainty: The family of plants that the law shall withstand.
        G: Projection of the surface, (1, 4); B+ by default, which does not amplify
            unmatched uncertainty.

    Raises:
        GainError: If a member of the family turns the input round or makes the sliding dynamics
            unstable, when no switching gain helps.
    """
    law = state_grosmc(state_task(plant, *WEIGHTS, model=model), uncertainty, G)
    source = "eqs. (8)+(12) with four states"
    return replace(law, name="cart-ism", design=replace(law.designed, source=source))


@dataclass(frozen=True, eq=False)
class ShapedParameters(FeedbackParameters):
    """Numbers of the shaped law.

    Attributes:
        limit: Largest acceleration that the cart's loop asks for [rad/s^2].
        longer: Largest L (M + m) of the family less the nominal one [kg m].
        first_moment: Largest m L less the nominal one [kg m].
        weight: Largest g m less the nominal one [N].
        force: Largest force on the cart [N].
        eta: Reaching rate [rad/s^2].
        switching: The switching law.
    """

    limit: float
    longer: float
    first_moment: float
    weight: float
    force: float
    eta: float
    switching: Any


def holding_pfl(
    plant: AnalyticPlant,
    uncertainty: StateUncertainty = UNCERTAINTY,
) -> Controller:
    """Partial feedback linearization of the angle, with an outer loop that brings the cart back.

    With theta'' = w by eq. (23) the cart follows p'' = l w - g theta next to upright, l = 4L/3,
    whatever the masses: an LQR of these four states gives K, and

        w = -k_theta theta - k_rate theta' - limit tanh((k_p p + k_speed p')/limit).

    limit = k_theta * 0.35 rad, so the cart's loop never asks for more lean than that; with
    k_rate^2 >= 4 k_theta the angle follows without overshoot, and |theta| stays within the larger
    of its start and 0.35 rad from rest, for every pole of the family. The surface is
    s = theta' - theta'(0) - integral of w.

    Args:
        plant: The nominal plant.
        uncertainty: The family of plants that the law shall withstand.

    Raises:
        GainError: If the gains would let the angle overshoot, or a member of the family makes the
            cart's loop unstable, when no switching gain helps.
    """
    p = plant.parameters
    family = [member.parameters for _, member in uncertainty.members(plant)]
    optimum = lqr(*_cart_behind_angle(p), *WEIGHTS)
    _require_no_overshoot(optimum.K)
    _require_stable_cart(optimum.K, family)

    heaviest = max(family, key=lambda member: member.m * member.L)
    switching = AS_PRINTED.switching
    parameters = ShapedParameters(
        plant=p,
        reference=OperatingPoint.origin(plant),
        K=optimum.K,
        limit=float(optimum.K[0, 1] * LEAN),
        longer=heaviest.L * (heaviest.M + heaviest.m) - p.L * (p.M + p.m),
        first_moment=heaviest.m * heaviest.L - p.m * p.L,
        weight=p.g * (heaviest.m - p.m),
        force=uncertainty.force,
        eta=uncertainty.reaching_rate,
        switching=switching.numbers,
    )
    design = Design(
        state_task(plant, *WEIGHTS).error,
        optimum,
        source="eqs. (23)+(31)+(37) with an outer loop on the cart",
        gains=named_gains(K=optimum.K),
        declared=f"m up to x{uncertainty.mass:g}, L up to x{uncertainty.length:g}, forces up to "
        f"{uncertainty.force:g} N on the cart",
        sliding_unit="rad/s",
        linearizing=True,
        switching=switching.name,
        switched_law=shaped_regulator,
    )
    return Controller(
        name="cart-pfl",
        law=shaped_regulator(switching.reach),
        parameters=parameters,
        memory=switching.new_memory(1, 1),
        design=design,
    )


class CartKind(LawKind):
    """A law that holds pole and cart, with weights and an uncertainty of its own."""

    where = OF_EQUATIONS
    system = CART_PENDULUM.name
    weights: ClassVar[Mapping[str, LawNumber]] = {}
    own_weights = WEIGHTS


@checked()
class CartLqr(CartKind):
    """LQR of all four states, eqs. (5)-(6)."""

    key = "cart-lqr"
    linearizing = False

    def design(self, task: Task) -> Controller:
        """Return the law for the task of all four states."""
        plant: Any = task.plant
        model: Any = task.model
        return holding_lqr(plant, model)


@checked()
class CartIsm(CartKind):
    """Integral sliding mode on the four-state LQR."""

    key = "cart-ism"
    linearizing = False
    switches = True

    def design(self, task: Task) -> Controller:
        """Return the law for the task of all four states."""
        plant: Any = task.plant
        model: Any = task.model
        return holding_ism(plant, model)


@checked()
class CartPfl(CartKind):
    """Feedback linearization of the angle with an outer loop on the cart."""

    key = "cart-pfl"
    switches = True

    def design(self, task: Task) -> Controller:
        """Return the law for the task of all four states."""
        plant: Any = task.plant
        return holding_pfl(plant)


def _cart_behind_angle(p: CartPendulumParameters) -> tuple[Array, Array]:
    """A (4, 4) and B (4, 1) of cart and pole next to upright, whose input is theta''."""
    A = np.zeros((4, 4))
    A[0, 2] = A[1, 3] = 1.0
    A[2, 1] = -p.g
    B = np.array([[0.0], [0.0], [4 * p.L / 3], [1.0]])
    return A, B


def _require_no_overshoot(K: Array) -> None:
    """Refuse gains (1, 4) under which the angle oscillates."""
    k_theta = K[0, 1]
    k_rate = K[0, 3]
    if k_rate**2 < 4 * k_theta:
        raise GainError(f"k_rate = {k_rate:g} and k_theta = {k_theta:g} let the angle overshoot")


def _require_stable_cart(K: Array, family: Sequence[CartPendulumParameters]) -> None:
    """Refuse gains (1, 4) under which the cart runs away for a pole of the family."""
    for member in family:
        A, B = _cart_behind_angle(member)
        pole = np.linalg.eigvals(A - B @ K).real.max()
        if pole >= 0:
            raise GainError(
                f"cart_pendulum with L = {member.L:g} m: the cart's loop has a pole at {pole:g} "
                "1/s, and no switching gain helps: weigh the cart less"
            )


@cache
def shaped_regulator(reach: SwitchingTerm) -> Law:
    """The law of ``holding_pfl``, compiled once for a switching term; its z0 is theta'(0).

    The input that a member of the family needs follows in closed form from its equation, with no
    circle: (4/3 L (M + m)/cos theta - m L cos theta) w - (M + m) g tan theta + m L theta'^2
    sin theta. What it differs by from the nominal one, times E, is the switching rate rho.
    """
    # A compiled function takes other functions from the names around it. Those are of the angle
    # itself: no reference is followed.
    nonlinearity = _ANGLE.linearization.nonlinearity
    matrix = _ANGLE.linearization.decoupling_matrix
    linearizable = CART_PENDULUM.linearizable
    reach = jitable(reach)

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        if not linearizable(x):
            memory.undefined = 1.0
            u[0] = 0.0
            return
        if not memory.begun:
            memory.z0[0] = x[3]

        to_cart = p.limit * math.tanh((p.K[0, 0] * x[0] + p.K[0, 2] * x[2]) / p.limit)
        w = -p.K[0, 1] * x[1] - p.K[0, 3] * x[3] - to_cart

        integrate(t, memory)
        memory.rate[0] = w
        memory.s[0] = x[3] - memory.z0[0] - memory.integral[0]

        E = matrix(x, p.plant)[0]
        rho = E * force_needed(abs(w), x, E, p)
        reach(memory.s, 0.0, rho, memory, p.switching, memory.phi)
        memory.v[0] = w + memory.phi[0]
        u[0] = (memory.v[0] - nonlinearity(x, p.plant)[0]) / E

    return law


@jitable
def force_needed(
    w: float,
    x: Any,
    E: float,
    p: Any,
) -> float:
    """Largest difference of the input [N] between a member of the family and the nominal plant."""
    c = math.cos(x[1])
    s = abs(math.sin(x[1]))
    inertia = 4.0 / 3.0 * p.longer - p.first_moment * c * c
    share = (w * inertia + p.weight * s) / c + p.first_moment * x[3] * x[3] * s
    return share + p.force + p.eta * (1.0 / E + inertia / c)

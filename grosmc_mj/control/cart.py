"""Laws that hold the pole and the cart: what the chapter's law leaves out.

One is section 2's method on all four states; the other keeps section 3's feedback linearization
of the angle and lets an outer loop on the cart shape what is asked of it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control import laws
from grosmc_mj.control.controller import Controller, Design
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.design import surface_numbers
from grosmc_mj.control.lqr import LqrDesign, lqr
from grosmc_mj.control.memory import Memory
from grosmc_mj.control.references import Setpoint, setpoint
from grosmc_mj.control.surface import accumulated
from grosmc_mj.control.switching import Reach
from grosmc_mj.control.task import AS_PRINTED, BoundedParameters, FeedbackParameters
from grosmc_mj.errors import GainError
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import CART_PENDULUM, AnalyticPlant, System

_ANGLE = ErrorCoordinates(CART_PENDULUM, setpoint)

# The pole's rate costs most: with a stiff cart the sliding dynamics themselves are unstable for a
# longer pole, whatever the switching gain (``sliding_dynamics``).
WEIGHTS = (np.diag([1.0, 1.0, 1.0, 100.0]), 1.0)
# Largest angle that the outer loop asks for [rad].
LEAN = 0.35

# Q (4, 4) and R of the index (4).
Weights = tuple[Array, float]


@cache
def state_of(system: System) -> StateCoordinates:
    """The whole state of a pole on a cart, made once, as a law is compiled once for it."""
    return StateCoordinates(system)


@dataclass(frozen=True)
class HoldingUncertainty:
    """What the holding laws are asked to withstand.

    Attributes:
        mass: Largest mass of the pole over its nominal one.
        length: Largest length over the nominal one.
        force: Largest force on the cart, in the unit of the input.
        reaching_rate: Rate at which the true plant shall keep |s| falling, in the unit of s per
            second.
        push: Largest force along the rail at the pole's centre of mass [N].
    """

    mass: float = 4.0
    length: float = 4.0
    force: float = 0.05
    reaching_rate: float = 0.2
    push: float = 0.0

    def __post_init__(self) -> None:
        if not (1 <= self.mass < math.inf and 1 <= self.length < math.inf):
            raise GainError(
                f"mass x{self.mass:g} and length x{self.length:g} must be 1 or more, and finite"
            )
        forces = (self.force, self.push)
        if not (all(0 <= each < math.inf for each in forces) and 0 < self.reaching_rate < math.inf):
            raise GainError(
                f"force {self.force:g} and push {self.push:g} must not be negative, reaching rate "
                f"{self.reaching_rate:g} positive, and all finite"
            )

    def scales(self) -> list[tuple[float, float]]:
        """Mass and length of the family's corners and their means, over the nominal ones."""
        masses, lengths = ((1.0, math.sqrt(most), most) for most in (self.mass, self.length))
        return list(itertools.product(masses, lengths))

    def family(self, nominal: Any) -> list[Any]:
        """Their parameters, from the nominal plant's."""
        return [nominal.scaled(mass, length) for mass, length in self.scales()]


def linear_model(plant: AnalyticPlant) -> tuple[Array, Array]:
    """(A, B) of the upright pendulum in symbols: A (4, 4) and B (4, 1)."""
    return plant.jacobian(np.zeros(4), np.zeros(1))


def holding_lqr(
    plant: AnalyticPlant,
    model: tuple[Array, Array] | None = None,
    weights: Weights | None = None,
) -> Controller:
    """LQR of all four states, eqs. (5)-(6).

    Args:
        plant: The nominal plant: a pole on a cart.
        model: (A, B) of it, for instance from MuJoCo; in symbols by default.
        weights: Q and R of the index; ``WEIGHTS`` by default.
    """
    optimum = lqr(*(model or linear_model(plant)), *(weights or WEIGHTS))
    error = state_of(plant.system)
    return Controller(
        name="cart-lqr",
        law=laws.state_feedback(error),
        parameters=FeedbackParameters(plant.parameters, Setpoint(), optimum.K),
        memory=_one_input,
        design=Design(error, optimum, "eqs. (5)-(6) with four states", _gains(optimum)),
    )


def _one_input() -> Memory:
    return Memory(v=np.zeros(1))


def _gains(optimum: LqrDesign) -> dict[str, float]:
    return {f"K{j + 1}": float(value) for j, value in enumerate(optimum.K[0])}


def holding_ism(
    plant: AnalyticPlant,
    model: tuple[Array, Array] | None = None,
    uncertainty: HoldingUncertainty = HoldingUncertainty(),
    G: ArrayLike | None = None,
    weights: Weights | None = None,
) -> Controller:
    """Integral sliding mode on the four-state LQR: section 2's surface (8) and law (12).

    On the linear models of the family, with A_t and B_t of a member,

        gamma0 = force + push sup |G d_t| / |G B_t|,   eta = reaching_rate / min r,
        gamma1 = sup |G (A_t - B_t K - A + B K)| / |G B_t|,   r = G B_t / G B,

    where d_t is what 1 N on the pole does to x'.

    Args:
        plant: The nominal plant: a pole on a cart.
        model: (A, B) of it, for instance from MuJoCo; in symbols by default.
        uncertainty: What the law shall withstand.
        G: Projection of the surface, (1, 4); B+ by default, which does not amplify what is
            unmatched.
        weights: Q and R of the index; ``WEIGHTS`` by default.

    Raises:
        GainError: If a member of the family turns the input round or makes the sliding dynamics
            unstable, when no switching gain helps.
    """
    optimum = lqr(*(model or linear_model(plant)), *(weights or WEIGHTS))
    error = state_of(plant.system)
    numbers = surface_numbers(optimum, G)
    matrix, GB = numbers["G"], float(numbers["GB"][0, 0])
    share, gamma1, least = 0.0, 0.0, math.inf
    for mass, length in uncertainty.scales():
        member = replace(plant, parameters=plant.parameters.scaled(mass, length))
        A_t, B_t = linear_model(member)
        r = float((matrix @ B_t)[0, 0]) / GB
        where = f"{plant.system.name} with the pole's mass x{mass:g} and length x{length:g}"
        if not r > 0:
            raise GainError(f"{where}: G B is {r:g} of the nominal one: choose another G")
        pole = np.linalg.eigvals(sliding_dynamics(optimum, matrix, A_t, B_t)).real.max()
        if pole >= 0:
            raise GainError(
                f"{where}: the sliding dynamics have a pole at {pole:g} 1/s, and no switching gain "
                "helps: weigh the pole's rate more, or choose another G"
            )
        difference = A_t - B_t @ optimum.K - optimum.closed_loop
        gamma1 = max(gamma1, float(np.linalg.norm(matrix @ difference)) / abs(r * GB))
        share = max(share, abs(float((matrix @ _pushed(member))[0])) / abs(r * GB))
        least = min(least, r)
    gamma0 = uncertainty.force + uncertainty.push * share
    parameters = BoundedParameters(
        plant=plant.parameters,
        reference=Setpoint(),
        K=optimum.K,
        **numbers,
        eta=uncertainty.reaching_rate / least,
        gamma0=gamma0,
        gamma1=gamma1,
    )
    switching = AS_PRINTED.switching
    design = Design(
        error,
        optimum,
        source="eqs. (8)+(12) with four states",
        gains={
            **_gains(optimum),
            "eta": parameters.eta,
            "gamma0": gamma0,
            "gamma1": gamma1,
        },
        declared=f"m up to x{uncertainty.mass:g}, L up to x{uncertainty.length:g}, "
        f"{_forces(uncertainty, plant.system)}; input gain down to {least:.3g} of the nominal one",
        sliding_unit=_sliding_unit(plant.system, GB),
        switching=switching.name,
        with_reach=partial(laws.grosmc_linear, error),
    )
    return Controller(
        name="cart-ism",
        law=laws.grosmc_linear(error, switching.reach(1)),
        parameters=parameters,
        memory=switching.new_memory(1, 4),
        design=design,
    )


def _pushed(plant: AnalyticPlant) -> Array:
    """x' of the upright pole under 1 N along the rail at its centre of mass, (4,)."""
    system = plant.system
    wrench = np.zeros((len(system.bodies), 6))
    wrench[system.bodies.index(system.uncertain_body), 0] = 1.0
    return plant.derivative(np.zeros(4), wrench=wrench)


def _forces(uncertainty: HoldingUncertainty, system: System) -> str:
    """The declared forces in words."""
    unit = "" if system.input.unit == "1" else f" {system.input.unit}"
    cart = f"forces up to {uncertainty.force:g}{unit} on the cart"
    return cart + (f", {uncertainty.push:g} N on the pole" if uncertainty.push else "")


def _sliding_unit(system: System, GB: float) -> str:
    """Unit of s: that of the input times time, if G B is 1."""
    if not math.isclose(GB, 1):
        return "1"
    return "s" if system.input.unit == "1" else f"{system.input.unit} s"


def sliding_dynamics(optimum: LqrDesign, G: Array, A_t: Array, B_t: Array) -> Array:
    """The matrix of x' on s = 0 of a linear plant (A_t, B_t), (n, n).

    s' = G (x' - (A - B K) x) = 0 gives the equivalent input, and with X = B_t (G B_t)^-1 G

        x' = [(I - X) A_t + X (A - B K)] x.

    It is A - B K, eq. (11), where A_t - A and B_t - B are matched.
    """
    X = B_t @ np.linalg.solve(G @ B_t, G)
    return (np.eye(len(A_t)) - X) @ A_t + X @ optimum.closed_loop


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
    uncertainty: HoldingUncertainty = HoldingUncertainty(),
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
        uncertainty: What the law shall withstand.

    Raises:
        GainError: If the gains would let the angle overshoot, or a member of the family makes the
            cart's loop unstable, when no switching gain helps.
    """
    p = plant.parameters
    A, B = np.zeros((4, 4)), np.array([[0.0], [0.0], [4 * p.L / 3], [1.0]])
    A[0, 2] = A[1, 3] = 1.0
    A[2, 1] = -p.g
    optimum = lqr(A, B, *WEIGHTS)
    K = optimum.K[0]
    if K[3] ** 2 < 4 * K[1]:
        raise GainError(f"k_rate = {K[3]:g} and k_theta = {K[1]:g} let the angle overshoot")
    family = uncertainty.family(p)
    for member in family:
        B_t = np.array([[0.0], [0.0], [4 * member.L / 3], [1.0]])
        pole = np.linalg.eigvals(A - B_t @ optimum.K).real.max()
        if pole >= 0:
            raise GainError(
                f"cart_pendulum with L = {member.L:g} m: the cart's loop has a pole at {pole:g} "
                "1/s, and no switching gain helps: weigh the cart less"
            )
    most = max(family, key=lambda member: member.m * member.L)
    switching = AS_PRINTED.switching
    parameters = ShapedParameters(
        plant=p,
        reference=Setpoint(),
        K=optimum.K,
        limit=float(K[1] * LEAN),
        longer=most.L * (most.M + most.m) - p.L * (p.M + p.m),
        first_moment=most.m * most.L - p.m * p.L,
        weight=p.g * (most.m - p.m),
        force=uncertainty.force,
        eta=uncertainty.reaching_rate,
        switching=switching,
    )
    design = Design(
        state_of(CART_PENDULUM),
        optimum,
        source="eqs. (23)+(31)+(37) with an outer loop on the cart",
        gains=_gains(optimum),
        declared=f"m up to x{uncertainty.mass:g}, L up to x{uncertainty.length:g}, forces up to "
        f"{uncertainty.force:g} N on the cart",
        sliding_unit="rad/s",
        linearizing=True,
        switching=switching.name,
        with_reach=shaped_regulator,
    )
    return Controller(
        name="cart-pfl",
        law=shaped_regulator(switching.reach(1)),
        parameters=parameters,
        memory=switching.new_memory(1, 1),
        design=design,
    )


@cache
def shaped_regulator(reach: Reach) -> laws.Law:
    """The law of ``holding_pfl``; its memory's z0 is theta'(0).

    The input that a member of the family needs follows in closed form from its equation, with no
    circle: (4/3 L (M + m)/cos theta - m L cos theta) w - (M + m) g tan theta + m L theta'^2
    sin theta. What it differs by from the nominal one, times E, is the switching rate rho.
    """
    nonlinearity, matrix = _ANGLE.nonlinearity, _ANGLE.decoupling_matrix
    linearizable, accumulate = CART_PENDULUM.linearizable, accumulated(1)

    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        if not linearizable(x):
            memory.undefined = 1.0
            return 0.0
        if t == 0.0:
            memory.z0[0] = x[3]
        brought = p.limit * math.tanh((p.K[0, 0] * x[0] + p.K[0, 2] * x[2]) / p.limit)
        w = -p.K[0, 1] * x[1] - p.K[0, 3] * x[3] - brought
        accumulate(t, (w,), memory)
        s = x[3] - memory.z0[0] - memory.integral[0]
        memory.s[0] = s
        E = matrix(x, p)[0]
        rho = E * force_needed(abs(w), x, E, p)
        v = w + reach((s,), 0.0, rho, memory, p.switching)[0]
        memory.v[0] = v
        return (v - nonlinearity(t, x, p)[0]) / E

    return law


@jitable
def force_needed(w: float, x: Any, E: float, p: Any) -> float:
    """Largest difference of the input [N] between a member of the family and the nominal plant."""
    c, s = math.cos(x[1]), abs(math.sin(x[1]))
    heavier = 4.0 / 3.0 * p.longer - p.first_moment * c * c
    share = (w * heavier + p.weight * s) / c + p.first_moment * x[3] * x[3] * s
    return share + p.force + p.eta * (1.0 / E + heavier / c)

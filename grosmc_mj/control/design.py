"""Controllers for a nominal plant: from weights and a declared uncertainty to a law's numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control import laws
from grosmc_mj.control.controller import Controller, Design, named_gains
from grosmc_mj.control.coordinates.base import OutputCoordinates
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.lqr import LqrDesign, priced
from grosmc_mj.control.memory import memory_of
from grosmc_mj.control.surface import surface_matrix, surface_rates
from grosmc_mj.control.task import AS_PRINTED, GrosmcParameters, Limit, Realization, Task
from grosmc_mj.control.uncertainty import StateUncertainty, Uncertainty
from grosmc_mj.errors import ArgumentError, GainError
from grosmc_mj.fields import Is, Name, Positive, Range, checked_call

# Of the room that an actuator's limits leave, for the nominal input; the rest is the switching
# term's. With 0.8 dm_control's cart-pole falls from 30 degrees.
SHARE = 0.9
CERTAIN = StateUncertainty()


@checked_call
def linear_lqr(task: Task) -> Controller:
    """LQR (5) on the plant's linearization."""
    optimum = task.optimum(linearizing=False)
    return _feedback("lqr", task, optimum, "eqs. (5)-(6)")


@checked_call
def linearized_lqr(task: Task, name: Name = "fl-lqr") -> Controller:
    """Feedback linearization with LQR only, eqs. (23)+(28) and (44)+(49)."""
    optimum, source = task.optimum(linearizing=True), "eqs. (23)+(28), (44)+(49)"
    return _feedback(name, task, optimum, source, linearizing=True)


@checked_call
def computed_torque_pd(
    task: Task,
    frequency: Annotated[float, Range(0, 1e150, "rad/s", above=True)],
    damping: Annotated[float, Range(0, 1e150, above=True)] = 1.0,
) -> Controller:
    """Feedback linearization with the same two poles for every output: v = -w^2 e - 2 D w e'.

    What it is compared with is its own nominal trajectory, not an optimum; J* is what that costs.

    Args:
        task: What is designed for; every output must have relative degree two.
        frequency: w [rad/s].
        damping: D; critical by default.

    Raises:
        ArgumentError: If a number is not positive.
        GainError: If an output has another relative degree.
    """
    chains, inputs = task.outputs.linearization, task.error.inputs
    if set(chains.relative_degree) != {2}:
        raise GainError(
            f"computed-torque PD: the relative degrees {chains.relative_degree} must all be 2"
        )
    K = np.kron(np.eye(inputs), [[frequency**2, 2 * damping * frequency]])
    optimum = priced(chains.A, chains.B, task.Q, task.R, K)
    source = "eqs. (23), (44) with v = -Kp e - Kd e'"
    return _feedback(
        "pd", task, optimum, source,
        linearizing=True, follows_optimum=False,
    )  # fmt: skip


@checked_call
def linear_grosmc(task: Task, uncertainty: Uncertainty, G: ArrayLike | None = None) -> Controller:
    """GROSMC of section 2, eqs. (8)+(12), with gains from the declared uncertainty.

    Args:
        task: What is designed for.
        uncertainty: What the law shall withstand.
        G: Projection of the surface, (m, n); B+ by default.

    Raises:
        GainError: If G B is singular or no gain can hold the declared family.
    """
    return _sliding(task, uncertainty, G, "eqs. (8)+(12)")


@checked_call
def regulating_grosmc(
    task: Task, uncertainty: Uncertainty, G: ArrayLike | None = None
) -> Controller:
    """GROSMC of section 3, eqs. (31)+(37), with gains from the declared uncertainty.

    Args:
        task: What is designed for, with equations in symbols.
        uncertainty: What the law shall withstand.
        G: Projection of the surface, (m, n); B+ by default.

    Raises:
        GainError: If G B is singular or no gain can hold the declared family.
    """
    if not isinstance(task.error, ErrorCoordinates):
        raise ArgumentError(
            f"{task.plant.system.name} has no equations in symbols, which this design needs: "
            "take tracking_grosmc, linearized_lqr or computed_torque_pd"
        )
    return _sliding(task, uncertainty, G, "eqs. (31)+(37)", linearizing=True, regulating=True)


@checked_call
def tracking_grosmc(
    task: Task, k: Positive, epsilon: Positive, G: ArrayLike | None = None
) -> Controller:
    """GROSMC of section 4, eqs. (51)+(55), with its gains given.

    Args:
        task: What is designed for.
        k: Proportional reaching gain [1/s].
        epsilon: Switching gain, in the unit of s per second.
        G: Projection of the surface, (m, n); B+ by default.

    Raises:
        ArgumentError: If a gain is not positive.
        GainError: If G B is singular.
    """
    gains = {"k": k, "epsilon": epsilon}
    return _sliding(task, gains, G, "eqs. (51)+(55)", linearizing=True)


@checked_call
def state_grosmc(
    task: Task,
    uncertainty: StateUncertainty = CERTAIN,
    G: ArrayLike | None = None,
    limit: Limit | None = None,
) -> Controller:
    """GROSMC of section 2 on all states: the surface (8) and the law (12).

    Args:
        task: What is designed for.
        uncertainty: What the law shall withstand.
        G: Projection of the surface, (m, n); B+ by default, which does not amplify what is
            unmatched.
        limit: Largest nominal input about the operating point; by default 0.9 of the room that
            the actuator's limits leave there.

    Raises:
        GainError: If a member of the family turns the input round or makes the sliding dynamics
            unstable, when no switching gain helps, or the limits leave no room.
    """
    (low, high), u_e = task.plant.input_limits, task.reference.u
    room = SHARE * float(np.min([high - u_e, u_e - low]))
    if limit is None and not room > 0:
        raise GainError(f"the actuator's limits leave a room of {room:g} about the operating point")
    source = f"eqs. (8)+(12) with all {task.error.size} states"
    return _sliding(task, uncertainty, G, source, limit=room if limit is None else limit)


@checked_call
def realized(
    controller: Annotated[Controller, Is(Controller, "a controller, such as tracking_grosmc's")],
    realization: Realization,
) -> Controller:
    """A sliding mode controller with this switching law, and with its surface at a period.

    A controller that does not switch is returned as it is.
    """
    design, p, switching = controller.design, controller.parameters, realization.switching
    if realization == AS_PRINTED or design is None or design.switched_law is None:
        return controller
    period, n = None, 1
    # A shaped law has no matrix S that a period would enter.
    if isinstance(p, GrosmcParameters):
        period, n = realization.control_period, p.G.shape[1]
        S, GB_held = surface_rates(p.G, design.lqr, period)
        p = replace(p, S=S, GB_held=GB_held)
    return Controller(
        controller.name,
        design.switched_law(switching.reach),
        replace(p, switching=switching.numbers),
        switching.new_memory(design.error.inputs, n),
        replace(design, switching=switching.name, control_period=period),
    )


def _feedback(
    name: str,
    task: Task,
    optimum: LqrDesign,
    source: str,
    *,
    linearizing: bool = False,
    follows_optimum: bool = True,
) -> Controller:
    """A controller without switching, judged against this optimum."""
    design = Design(
        task.error, optimum, source, _feedback_gains(optimum),
        linearizing=linearizing, follows_optimum=follows_optimum,
    )  # fmt: skip
    law, (m, n) = laws.optimal_feedback(task.error, linearizing=linearizing), optimum.K.shape
    return Controller(name, law, task.feedback(optimum.K), memory_of(m, z=np.zeros(n)), design)


def _feedback_gains(optimum: LqrDesign) -> dict[str, float]:
    """K as it is shown, without the rounding of what is zero."""
    K = optimum.K
    return named_gains(K=np.where(np.abs(K) > 1e-12 * np.abs(K).max(), K, 0.0))


def _sliding(
    task: Task,
    gains: Mapping[str, float] | Uncertainty | StateUncertainty,
    G: ArrayLike | None,
    source: str,
    *,
    linearizing: bool = False,
    regulating: bool = False,
    limit: float = np.inf,
) -> Controller:
    """GROSMC with the switching law and the surface as printed.

    Args:
        task: What it is designed for.
        gains: Its switching gains, or what they are to be computed from.
        G: Projection of the surface, (m, n); B+ by default.
        source: Equations of the chapter.
        linearizing: Whether it goes through feedback linearization.
        regulating: Whether its switching gain follows E(x).
        limit: Largest nominal input.
    """
    optimum, printed = task.optimum(linearizing=linearizing), AS_PRINTED.switching
    G = surface_matrix(G, optimum.B)
    GB, (m, n) = G @ optimum.B, G.shape
    p = GrosmcParameters(
        **vars(task.feedback(optimum.K)),
        G=G, S=G @ optimum.closed_loop,
        GB=GB, GB_inverse=np.linalg.inv(GB), GB_held=GB, size_of_GB=float(np.linalg.norm(GB)),
        switching=printed.numbers,
    )  # fmt: skip
    law = partial(laws.grosmc, task.error, linearizing, regulating)
    design = Design(
        task.error,
        optimum,
        source=source,
        sliding_unit=_sliding_unit(task.error, G, GB),
        linearizing=linearizing,
        switching=printed.name,
        switched_law=law,
    )
    declared = ""
    if not isinstance(gains, Mapping):
        (eta, gamma0, gamma1, _), declared = gains.gains(design, p, task.plant)
        gains = {"eta": eta, "gamma0": gamma0, "gamma1": gamma1}
    if np.isfinite(limit):
        gains = {**gains, "limit": limit}
    design = replace(design, gains=_feedback_gains(optimum) | dict(gains), declared=declared)
    memory = printed.new_memory(m, n)
    return Controller("grosmc", law(printed.reach), replace(p, **gains), memory, design)


def _sliding_unit(error: Any, G: Array, GB: Array) -> str:
    """Unit of s: with G B = 1 that of the input times time, else that of the error's rate."""
    if isinstance(error, OutputCoordinates):
        rows = list(error.linearization.last_rows)
        # With G in the last rows only and G B = 1 both are the rate's.
        if np.allclose(GB, G[:, rows]):
            return error.units[rows[0]]
    if not np.allclose(GB, np.eye(len(GB)), rtol=1e-9, atol=1e-9):
        return "1"
    unit = error.system.input.unit
    return "s" if unit == "1" else f"{unit} s"

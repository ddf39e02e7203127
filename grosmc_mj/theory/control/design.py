"""Controllers for a nominal plant: from weights and a declared uncertainty to a law's numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, GainError
from grosmc_mj.ground.fields import Is, Name, checked_call
from grosmc_mj.theory.control import laws
from grosmc_mj.theory.control.controller import Controller, Design, named_gains
from grosmc_mj.theory.control.coordinates.base import Coordinates, OutputCoordinates
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.lqr import LqrDesign, design_of_gain
from grosmc_mj.theory.control.memory import FeedbackMemory, memory_of
from grosmc_mj.theory.control.surface import surface_matrix, surface_rates
from grosmc_mj.theory.control.task import AS_PRINTED, GrosmcParameters, Limit, Realization, Task
from grosmc_mj.theory.control.uncertainty.family import PlantFamily
from grosmc_mj.theory.control.uncertainty.outputs import Uncertainty
from grosmc_mj.theory.control.uncertainty.states import StateUncertainty

# Share of the room that an actuator's limits leave which the nominal input may take; the switching
# term has the remainder. With 0.8 dm_control's cart-pole falls from 30 degrees.
NOMINAL_INPUT_SHARE = 0.9
# No uncertainty beside the default reaching rate.
NO_UNCERTAINTY = StateUncertainty()

ReachingGain = Annotated[
    float,
    LawNumber(
        low=0,
        above=True,
        unit="1/s",
        meaning="proportional reaching gain k",
        search=(0.3, 300),
    ),
]
SwitchingGain = Annotated[
    float,
    LawNumber(
        low=0,
        above=True,
        meaning="switching gain epsilon, in the unit of s per second",
        search=(1e-2, 1e4),
    ),
]
PdFrequency = Annotated[
    float,
    LawNumber(
        low=0,
        high=1e150,
        unit="rad/s",
        above=True,
        meaning="frequency w of both poles",
        search=(0.3, 300),
    ),
]
Damping = Annotated[
    float,
    LawNumber(low=0, high=1e150, above=True, meaning="damping D of both poles", search=(0.3, 3)),
]


@checked_call
def linear_lqr(task: Task) -> Controller:
    """LQR (5) on the plant's linearization."""
    optimum = task.optimum(linearizing=False)
    return state_feedback("lqr", task, optimum, "eqs. (5)-(6)")


@checked_call
def linearized_lqr(task: Task, name: Name = "fl-lqr") -> Controller:
    """Feedback linearization with LQR only, eqs. (23)+(28) and (44)+(49)."""
    optimum = task.optimum(linearizing=True)
    return state_feedback(name, task, optimum, "eqs. (23)+(28), (44)+(49)", linearizing=True)


@checked_call
def computed_torque_pd(
    task: Task,
    frequency: PdFrequency,
    damping: Damping = 1.0,
) -> Controller:
    """Feedback linearization with the same two poles for every output: v = -w^2 e - 2 D w e'.

    Its runs are compared with its own nominal trajectory, not with an optimum; J* is the cost of
    that trajectory.

    Args:
        task: The task; every output must have relative degree two.
        frequency: w [rad/s].
        damping: D; critical by default.

    Raises:
        ArgumentError: If a number is not positive.
        GainError: If an output has another relative degree.
    """
    chains = task.outputs.linearization
    if set(chains.relative_degree) != {2}:
        raise GainError(
            f"computed-torque PD: the relative degrees {chains.relative_degree} must all be 2"
        )

    gains_of_output = [[frequency**2, 2 * damping * frequency]]
    K = np.kron(np.eye(task.error.inputs), gains_of_output)
    nominal = design_of_gain(chains.A, chains.B, task.Q, task.R, K)
    return state_feedback(
        "pd",
        task,
        nominal,
        "eqs. (23), (44) with v = -Kp e - Kd e'",
        linearizing=True,
        follows_optimum=False,
    )


@checked_call
def linear_grosmc(task: Task, uncertainty: Uncertainty, G: ArrayLike | None = None) -> Controller:
    """GROSMC of section 2, eqs. (8)+(12), with gains from the declared uncertainty.

    Args:
        task: The task.
        uncertainty: Uncertainty that the law shall withstand.
        G: Projection of the surface, (m, n); B+ by default.

    Raises:
        GainError: If G B is singular or no gain can hold the declared family.
        ModelError: If the plant has no parameter that the uncertainty scales.
    """
    return _sliding(task, uncertainty, G, "eqs. (8)+(12)")


@checked_call
def regulating_grosmc(
    task: Task, uncertainty: Uncertainty, G: ArrayLike | None = None
) -> Controller:
    """GROSMC of section 3, eqs. (31)+(37), with gains from the declared uncertainty.

    Args:
        task: The task, with equations in symbols.
        uncertainty: Uncertainty that the law shall withstand.
        G: Projection of the surface, (m, n); B+ by default.

    Raises:
        ArgumentError: If the plant has no equations in symbols.
        GainError: If G B is singular or no gain can hold the declared family.
        ModelError: If the plant has no parameter that the uncertainty scales.
    """
    if not isinstance(task.error, ErrorCoordinates):
        raise ArgumentError(
            f"{task.plant.system.name} has no equations in symbols, which this design needs: "
            "take tracking_grosmc, linearized_lqr or computed_torque_pd"
        )
    return _sliding(task, uncertainty, G, "eqs. (31)+(37)", linearizing=True, regulating=True)


@checked_call
def tracking_grosmc(
    task: Task, k: ReachingGain, epsilon: SwitchingGain, G: ArrayLike | None = None
) -> Controller:
    """GROSMC of section 4, eqs. (51)+(55), with given gains.

    Args:
        task: The task.
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
    uncertainty: StateUncertainty = NO_UNCERTAINTY,
    G: ArrayLike | None = None,
    limit: Limit | None = None,
) -> Controller:
    """GROSMC of section 2 on all states: the surface (8) and the law (12).

    Args:
        task: The task.
        uncertainty: Uncertainty that the law shall withstand.
        G: Projection of the surface, (m, n); B+ by default, which does not amplify unmatched
            disturbances.
        limit: Largest nominal input about the operating point; by default 0.9 of the room that
            the actuator's limits leave there.

    Raises:
        GainError: If a member of the family turns the input round or makes the sliding dynamics
            unstable, when no switching gain helps, or the limits leave no room.
        ModelError: If the plant has no parameter or body that the uncertainty scales.
    """
    if limit is None:
        limit = _room_of_actuators(task)
    source = f"eqs. (8)+(12) with all {task.error.size} states"
    return _sliding(task, uncertainty, G, source, limit=limit)


def _room_of_actuators(task: Task) -> float:
    """Largest nominal input about the operating point that the actuator's limits leave.

    Raises:
        GainError: If they leave none.
    """
    low, high = task.input_limits
    u_e = task.reference.u
    least = float(np.min([high - u_e, u_e - low]))
    room = NOMINAL_INPUT_SHARE * least
    if not room > 0:
        raise GainError(f"the actuator's limits leave a room of {room:g} about the operating point")
    return room


@checked_call
def realized(
    controller: Annotated[Controller, Is(Controller, "a controller, such as tracking_grosmc's")],
    realization: Realization,
) -> Controller:
    """Sliding mode controller with the switching law and the surface of a realization.

    A controller that does not switch is returned as it is.

    Args:
        controller: The controller, with the law as printed.
        realization: Switching law, and control period of the surface.
    """
    design = controller.design
    if realization == AS_PRINTED or design is None or design.switched_law is None:
        return controller

    p = controller.parameters
    if isinstance(p, GrosmcParameters):
        period = realization.control_period
        n = p.G.shape[1]
        S, GB_held = surface_rates(p.G, design.lqr, period)
        p = replace(p, S=S, GB_held=GB_held)
    else:
        # A shaped law has one sliding variable and no matrix S that a period would enter.
        period = None
        n = 1

    switching = realization.switching
    return Controller(
        controller.name,
        design.switched_law(switching.reach),
        replace(p, switching=switching.numbers),
        switching.new_memory(design.error.inputs, n),
        replace(design, switching=switching.name, control_period=period),
    )


def state_feedback(
    name: str,
    task: Task,
    optimum: LqrDesign,
    source: str,
    *,
    linearizing: bool = False,
    follows_optimum: bool = True,
) -> Controller:
    """Linear feedback u = -K z, or v = -K z, with the gain of a design.

    Args:
        name: Name of the law.
        task: The task.
        optimum: Design with the gain, whose nominal trajectory its runs are compared with.
        source: Source of the law in the literature.
        linearizing: Whether through feedback linearization.
        follows_optimum: Whether that trajectory is optimal for the weights.
    """
    design = Design(
        task.error,
        optimum,
        source,
        _feedback_gains(optimum),
        linearizing=linearizing,
        follows_optimum=follows_optimum,
        weighed=task.weighed,
    )
    law = laws.optimal_feedback(task.error, linearizing=linearizing)
    m, n = optimum.K.shape
    memory = memory_of(FeedbackMemory, m=m, n=n)
    return Controller(name, law, task.feedback(optimum.K), memory, design)


def _feedback_gains(optimum: LqrDesign) -> dict[str, float]:
    """Entries of K by their names, with 0 for those that are only rounding."""
    K = optimum.K
    sizes = np.abs(K)
    rounding = 1e-12 * sizes.max()
    return named_gains(K=np.where(sizes > rounding, K, 0.0))


def _sliding(
    task: Task,
    gains: Mapping[str, float] | PlantFamily,
    G: ArrayLike | None,
    source: str,
    *,
    linearizing: bool = False,
    regulating: bool = False,
    limit: float = np.inf,
) -> Controller:
    """GROSMC with the switching law and the surface as printed.

    Args:
        task: The task.
        gains: Its switching gains, or the uncertainty that they are computed from.
        G: Projection of the surface, (m, n); B+ by default.
        source: Equations of the chapter.
        linearizing: Whether it goes through feedback linearization.
        regulating: Whether its switching gain follows E(x).
        limit: Largest nominal input.
    """
    optimum = task.optimum(linearizing=linearizing)
    printed = AS_PRINTED.switching
    p = _surface_numbers(task, optimum, surface_matrix(G, optimum.B))
    law = partial(laws.grosmc, task.error, linearizing, regulating)
    m, n = p.G.shape
    controller = Controller(
        "grosmc",
        law(printed.reach),
        p,
        printed.new_memory(m, n),
        Design(
            task.error,
            optimum,
            source=source,
            sliding_unit=_sliding_unit(task.error, p.G, p.GB),
            linearizing=linearizing,
            switching=printed.name,
            switched_law=law,
        ),
    )

    numbers: dict[str, float] = {}
    declared = ""
    if isinstance(gains, Mapping):
        numbers.update(gains)
    else:
        switching_gains, declared = gains.gains(controller, task.plant)
        numbers["eta"] = switching_gains.eta
        numbers["gamma0"] = switching_gains.gamma0
        numbers["gamma1"] = switching_gains.gamma1
    if np.isfinite(limit):
        numbers["limit"] = limit

    shown = _feedback_gains(optimum) | numbers
    design = replace(controller.designed, gains=shown, declared=declared)
    return replace(controller, parameters=replace(p, **numbers), design=design)


def _surface_numbers(task: Task, optimum: LqrDesign, G: Array) -> GrosmcParameters:
    """Numbers of GROSMC with the surface as printed, before there are switching gains."""
    feedback = task.feedback(optimum.K)
    S, GB = surface_rates(G, optimum, None)
    return GrosmcParameters(
        plant=feedback.plant,
        reference=feedback.reference,
        K=feedback.K,
        G=G,
        S=S,
        GB=GB,
        GB_inverse=np.linalg.inv(GB),
        GB_held=GB,
        size_of_GB=float(np.linalg.norm(GB)),
        switching=AS_PRINTED.switching.numbers,
    )


def _sliding_unit(error: Coordinates, G: Array, GB: Array) -> str:
    """Unit of s: that of the last entries of z, or with G B = 1 that of the input times time.

    It is "1" if s has no unit that could be named.
    """
    if isinstance(error, OutputCoordinates):
        rows = list(error.linearization.last_rows)
        # With G in the last rows only and G B = 1 both are the rate's.
        if np.allclose(GB, G[:, rows]):
            return error.units[rows[0]]
    identity = np.eye(len(GB))
    if not np.allclose(GB, identity, rtol=1e-9, atol=1e-9):
        return "1"

    unit = error.system.input.unit
    return "s" if unit == "1" else f"{unit} s"

"""Controllers for a nominal plant: from weights and a declared uncertainty to a law's numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arguments import real, require
from grosmc_mj.control import laws
from grosmc_mj.control.controller import Controller, Design, named_gains
from grosmc_mj.control.gains import Uncertainty, switching_gains
from grosmc_mj.control.lqr import LqrDesign, priced
from grosmc_mj.control.memory import memory_of
from grosmc_mj.control.surface import drift_of_surface, held_gain, surface_matrix
from grosmc_mj.control.switching import SwitchingTerm
from grosmc_mj.control.task import (
    AS_PRINTED,
    BoundedParameters,
    FeedbackParameters,
    LinearParameters,
    Realization,
    StateTask,
    SurfaceParameters,
    Task,
    TrackingParameters,
    require_task,
)
from grosmc_mj.errors import GainError, shown


def linear_lqr(task: Task | StateTask) -> Controller:
    """LQR (5) on the plant's linearization."""
    require_task(task, of_states=True)
    optimum = task.linearization_optimum()
    law = laws.optimal_feedback(task.error, linearizing=False)
    return _controller("lqr", law, task, task.feedback(optimum.K), optimum, "eqs. (5)-(6)")


def linearized_lqr(task: Task, name: str = "fl-lqr") -> Controller:
    """Feedback linearization with LQR only, eqs. (23)+(28) and (44)+(49)."""
    require_task(task)
    require("name", name, str, "a text")
    optimum = task.chain_optimum()
    law = laws.optimal_feedback(task.error, linearizing=True)
    source = "eqs. (23)+(28), (44)+(49)"
    return _controller(name, law, task, task.feedback(optimum.K), optimum, source, linearizing=True)


def computed_torque_pd(task: Task, frequency: float, damping: float = 1.0) -> Controller:
    """Feedback linearization with the same two poles for every output: v = -w^2 e - 2 D w e'.

    What it is compared with is its own nominal trajectory, not an optimum; J* is what that costs.

    Args:
        task: What is designed for; every output must have relative degree two.
        frequency: w [rad/s].
        damping: D; critical by default.

    Raises:
        GainError: If a number is not positive or an output has another relative degree.
    """
    require_task(task)
    chains, finite = task.error.linearization, (0 < real(x) < 1e150 for x in (frequency, damping))
    if set(chains.relative_degree) != {2} or not all(finite):
        raise GainError(
            f"computed-torque PD with frequency {shown(frequency)} rad/s and damping "
            f"{shown(damping)}: both must be positive, and the relative degrees "
            f"{chains.relative_degree} all 2"
        )
    row = np.array([[frequency**2, 2 * damping * frequency]])
    optimum = priced(chains.A, chains.B, task.Q, task.R, np.kron(np.eye(task.error.inputs), row))
    law = laws.optimal_feedback(task.error, linearizing=True)
    source = "eqs. (23), (44) with v = -Kp e - Kd e'"
    made = _controller("pd", law, task, task.feedback(optimum.K), optimum, source, linearizing=True)
    return replace(made, design=replace(made.designed, follows_optimum=False))


def linear_grosmc(task: Task, uncertainty: Uncertainty, G: ArrayLike | None = None) -> Controller:
    """GROSMC of section 2, eqs. (8)+(12), with gains from the declared uncertainty.

    Args:
        task: What is designed for.
        uncertainty: What the law shall withstand.
        G: Projection of the surface, (m, n); B+ by default.

    Raises:
        GainError: If G B is singular or no gain can hold the declared family.
    """
    require_task(task)
    require("uncertainty", uncertainty, Uncertainty, "an Uncertainty")
    optimum = task.linearization_optimum()
    with_reach = partial(laws.grosmc, task.error, laws.gains_of_linear_plant, False)
    bounded, declared = _bounded(task, optimum, uncertainty, G, linearizing=False)
    parameters = LinearParameters(**vars(bounded), GB_held=bounded.GB)
    return _of_outputs(with_reach, task, parameters, optimum, "eqs. (8)+(12)", declared)


def regulating_grosmc(
    task: Task, uncertainty: Uncertainty, G: ArrayLike | None = None
) -> Controller:
    """GROSMC of section 3, eqs. (31)+(37), with gains from the declared uncertainty.

    Args:
        task: What is designed for.
        uncertainty: What the law shall withstand.
        G: Projection of the surface, (m, n); B+ by default.

    Raises:
        GainError: If G B is singular or no gain can hold the declared family.
    """
    require_task(task)
    require("uncertainty", uncertainty, Uncertainty, "an Uncertainty")
    optimum, error = task.chain_optimum(), task.symbolic
    with_reach = partial(laws.grosmc, error, laws.gains_of_regulator(error), True)
    parameters, declared = _bounded(task, optimum, uncertainty, G, linearizing=True)
    source = "eqs. (31)+(37)"
    return _of_outputs(with_reach, task, parameters, optimum, source, declared, linearizing=True)


def tracking_grosmc(task: Task, k: float, epsilon: float, G: ArrayLike | None = None) -> Controller:
    """GROSMC of section 4, eqs. (51)+(55), with its gains given.

    Args:
        task: What is designed for.
        k: Proportional reaching gain [1/s].
        epsilon: Switching gain, in the unit of s per second.
        G: Projection of the surface, (m, n); B+ by default.

    Raises:
        GainError: If G B is singular or a gain is not positive.
    """
    require_task(task)
    if not all(0 < real(gain) < math.inf for gain in (k, epsilon)):
        raise GainError(
            f"k = {shown(k)} and epsilon = {shown(epsilon)} must be finite and positive"
        )
    optimum = task.chain_optimum()
    with_reach = partial(laws.grosmc, task.error, laws.gains_of_tracker, True)
    surface = _surface(task, optimum, G)
    parameters = TrackingParameters(**surface, k=float(k), epsilon=float(epsilon))
    source = "eqs. (51)+(55)"
    return _of_outputs(with_reach, task, parameters, optimum, source, linearizing=True)


def realized(controller: Controller, realization: Realization) -> Controller:
    """A design, which is made as printed, sampled in this way; without switching it stays as it is.

    Nothing that a design computes depends on its switching law or its control period.
    """
    design = controller.design
    if realization == AS_PRINTED or design is None or design.with_reach is None:
        return controller
    p, switching, period = controller.parameters, realization.switching, None
    changes: dict[str, Any] = {"switching": switching}
    # A shaped law has no matrix S that a period would enter.
    if isinstance(p, SurfaceParameters):
        period = realization.control_period
        changes["S"] = drift_of_surface(p.G, design.lqr, period)
    if isinstance(p, LinearParameters):
        changes["GB_held"] = held_gain(p.G, design.lqr, period)
    m, n = len(design.lqr.K), len(controller.memory().z0)  # pyright: ignore
    return replace(
        controller,
        law=design.with_reach(switching.reach),
        parameters=replace(p, **changes),
        memory=switching.new_memory(m, n),
        design=replace(design, switching=switching.name, control_period=period),
    )


def sliding(
    with_reach: Callable[[SwitchingTerm], laws.Law],
    task: Task | StateTask,
    parameters: SurfaceParameters,
    optimum: LqrDesign,
    source: str,
    declared: str = "",
    *,
    linearizing: bool = False,
    sliding_unit: str = "",
) -> Controller:
    """A sliding mode controller, sampled as the task says.

    Args:
        with_reach: Makes its law for a switching law.
        task: What it is designed for.
        parameters: Its numbers.
        optimum: What it is to follow.
        source: Equations of the chapter.
        declared: What its gains were computed from, in words.
        linearizing: Whether it goes through feedback linearization.
        sliding_unit: Unit of s.
    """
    law = with_reach(AS_PRINTED.switching.reach)
    made = _controller(
        "grosmc",
        law,
        task,
        parameters,
        optimum,
        source,
        declared,
        linearizing=linearizing,
        sliding_unit=sliding_unit,
        with_reach=with_reach,
    )
    return realized(made, task.realization)


def _of_outputs(
    with_reach: Callable[[SwitchingTerm], laws.Law],
    task: Task,
    parameters: SurfaceParameters,
    *a: Any,
    **kinds: bool,
) -> Controller:
    """A sliding mode controller of outputs, see ``sliding``."""
    unit = _sliding_unit(task, parameters)
    return sliding(with_reach, task, parameters, *a, **kinds, sliding_unit=unit)


def surface_numbers(optimum: LqrDesign, G: ArrayLike | None = None) -> dict[str, Any]:
    """The fields of ``SurfaceParameters`` beyond those of the feedback, as printed.

    Args:
        optimum: What the surface follows.
        G: Projection, (m, n); B+ by default.

    Raises:
        GainError: If G B is singular.
    """
    matrix = surface_matrix(G, optimum.B)
    GB = matrix @ optimum.B
    return {
        "G": matrix,
        "S": drift_of_surface(matrix, optimum, AS_PRINTED.control_period),
        "GB": GB,
        "GB_inverse": np.linalg.inv(GB),
        "size_of_GB": float(np.linalg.norm(GB)),
        "switching": AS_PRINTED.switching,
    }


def _surface(task: Task, optimum: LqrDesign, G: ArrayLike | None) -> dict[str, Any]:
    """Numbers of feedback and surface."""
    feedback = vars(task.feedback(optimum.K))
    return {**feedback, **surface_numbers(optimum, G)}


def _bounded(
    task: Task,
    optimum: LqrDesign,
    uncertainty: Uncertainty,
    G: ArrayLike | None,
    *,
    linearizing: bool,
) -> tuple[BoundedParameters, str]:
    """Surface and gains of the laws (12) and (37), and what they were computed from."""
    surface = _surface(task, optimum, G)
    gains = switching_gains(
        task.symbolic,
        task.feedback(optimum.K),
        optimum.K,
        uncertainty,
        linearizing=linearizing,
        G=surface["G"],
    )
    parameters = BoundedParameters(
        **surface, eta=gains.eta, gamma0=gains.gamma0, gamma1=gains.gamma1
    )
    return parameters, uncertainty.describe(gains.gain_ratio)


def _controller(
    name: str,
    law: laws.Law,
    task: Task | StateTask,
    parameters: FeedbackParameters,
    optimum: LqrDesign,
    source: str,
    declared: str = "",
    *,
    linearizing: bool = False,
    sliding_unit: str = "",
    with_reach: Callable[[SwitchingTerm], laws.Law] | None = None,
) -> Controller:
    """A controller with the gains that are worth showing."""
    shown = ("eta", "gamma0", "gamma1", "k", "epsilon")
    gains = {name: getattr(parameters, name) for name in shown if hasattr(parameters, name)}
    if math.isfinite(limit := getattr(parameters, "limit", math.inf)):
        gains["limit"] = limit
    m, n = optimum.K.shape
    # Rounding of what is zero is not worth showing.
    K = np.where(np.abs(optimum.K) > 1e-12 * np.abs(optimum.K).max(), optimum.K, 0.0)
    switching = AS_PRINTED.switching
    memory = switching.new_memory(m, n) if with_reach else memory_of(m, z=np.zeros(n))
    design = Design(
        task.error,
        optimum,
        source=source,
        gains=named_gains(K=K) | gains,
        declared=declared,
        sliding_unit=sliding_unit,
        linearizing=linearizing,
        switching=switching.name if with_reach else "",
        with_reach=with_reach,
    )
    return Controller(name, law, parameters, memory, design)


def _sliding_unit(task: Task, parameters: SurfaceParameters) -> str:
    """Unit of s: with G B = 1 that of the input times time, else that of the error's rate."""
    rows = list(task.error.linearization.last_rows)
    # With G in the last rows only and G B = 1 both are the rate's.
    if np.allclose(parameters.GB, parameters.G[:, rows]):
        return task.error.units[rows[0]]
    if np.allclose(parameters.GB, np.eye(len(parameters.GB))):
        return f"{task.plant.system.input.unit} s"
    return "1"

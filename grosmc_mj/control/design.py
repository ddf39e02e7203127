"""Controllers for a nominal plant: from weights and a declared uncertainty to a law's numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arguments import real, reals, require
from grosmc_mj.arrays import Array
from grosmc_mj.control import laws
from grosmc_mj.control.controller import Controller, Design
from grosmc_mj.control.coordinates.base import OutputCoordinates
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.gains import Uncertainty, switching_gains
from grosmc_mj.control.lqr import LqrDesign, lqr, priced
from grosmc_mj.control.memory import Memory
from grosmc_mj.control.surface import drift_of_surface, surface_matrix
from grosmc_mj.control.switching import Reach, Sign, Switching
from grosmc_mj.errors import ArgumentError, GainError, shown
from grosmc_mj.plants import AnalyticPlant


@dataclass(frozen=True, eq=False)
class FeedbackParameters:
    """Numbers of the laws without switching.

    Attributes:
        plant: The nominal plant's parameters.
        reference: The reference's parameters.
        K: Feedback gain, (m, n).
    """

    plant: Any
    reference: Any
    K: Array


@dataclass(frozen=True, eq=False)
class SurfaceParameters(FeedbackParameters):
    """Numbers of the integral surface, eqs. (8), (31) and (51).

    Attributes:
        G: Projection, (m, n).
        S: What G z drifts by on the optimal trajectory [1/s], (m, n): ``drift_of_surface``.
        GB: G B, (m, m).
        GB_inverse: Its inverse, (m, m).
        size_of_GB: Its norm.
        switching: The switching law.
    """

    G: Array
    S: Array
    GB: Array
    GB_inverse: Array
    size_of_GB: float
    switching: Switching


@dataclass(frozen=True, eq=False)
class BoundedParameters(SurfaceParameters):
    """Numbers of the laws (12) and (37).

    Attributes:
        eta: Reaching gain.
        gamma0: Constant part of the uncertainty's bound.
        gamma1: Its slope over the norm of the state.
    """

    eta: float
    gamma0: float
    gamma1: float


@dataclass(frozen=True, eq=False)
class TrackingParameters(SurfaceParameters):
    """Numbers of the law (55).

    Attributes:
        k: Proportional reaching gain [1/s].
        epsilon: Switching gain.
    """

    k: float
    epsilon: float


@dataclass(frozen=True)
class Realization:
    """How a sliding mode law is realized by a sampled controller.

    Attributes:
        switching: Its switching law.
        control_period: Sampling time of the discrete-time surface [s]; None for the printed
            surface, which any sampling time goes with.
    """

    switching: Switching = field(default_factory=Sign)
    control_period: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.switching, Switching):
            raise ArgumentError(
                f"switching = {shown(self.switching)} must be a switching law, such as "
                "find_switching('implicit')"
            )
        period = self.control_period
        if period is not None and not 0 < real(period) < math.inf:
            raise ArgumentError(f"control period {shown(period)} s must be finite and positive")


AS_PRINTED = Realization()
# A rate that rounding could be, in the unit of z per second.
_AT_REST = 1e-9


@dataclass(frozen=True, eq=False)
class Task:
    """A nominal plant, what of it is regulated, and the index that weighs it.

    Attributes:
        plant: The plant that the law believes in.
        error: The error coordinates z, n of them.
        reference: Parameters of the reference that ``error`` measures from.
        Q: Weight of z, positive semidefinite, (n, n).
        R: Weight of the input, or of v after linearization; positive definite, (m, m) or a
            number.
        realization: How a sliding mode law is sampled.
    """

    plant: AnalyticPlant
    error: OutputCoordinates
    reference: Any
    Q: ArrayLike
    R: ArrayLike
    realization: Realization = AS_PRINTED

    def __post_init__(self) -> None:
        require_analytic("plant", self.plant)
        require("error", self.error, OutputCoordinates, "error coordinates of the plant")
        require("realization", self.realization, Realization, "a Realization")
        # The relative degrees of outputs and reference must agree before anything is made of them.
        degrees = self.error.linearization.relative_degree
        for name, given, size in (
            ("Q", self.Q, self.error.size),
            ("R", self.R, self.error.inputs),
        ):
            weight = reals(given)
            number = weight.ndim == 0 and (name == "R" or size == 1)
            if not np.all(np.isfinite(weight)) or not (number or weight.shape == (size, size)):
                raise GainError(
                    f"{name} = {shown(given)} must be a matrix of {size} x {size} finite numbers"
                )
        try:
            values = self.error.reference(0.0, self.reference)
        except (ArithmeticError, ValueError) as error:
            raise ArgumentError(f"the reference has no value at t = 0: {error}") from None
        except (AttributeError, TypeError) as error:
            raise ArgumentError(
                f"{type(self.reference).__name__} does not fit the reference: {error}"
            ) from None
        count = sum(degrees) + len(degrees)
        if reals(values).shape != (count,) or not np.all(np.isfinite(reals(values))):
            raise ArgumentError(
                f"the reference gives {shown(values)} at t = 0, must give {count} finite "
                f"values: each output with derivatives up to {degrees}"
            )

    @property
    def symbolic(self) -> ErrorCoordinates:
        """The error coordinates, if they are those of equations in symbols.

        Raises:
            ArgumentError: If they are not.
        """
        if not isinstance(self.error, ErrorCoordinates):
            raise ArgumentError(
                f"{self.plant.system.name} has no equations in symbols, which this design needs: "
                "take tracking_grosmc, linearized_lqr or computed_torque_pd"
            )
        return self.error

    def linearization_optimum(self) -> LqrDesign:
        """LQR on the Jacobian linearization about zero error; exact for the linear servo.

        Raises:
            GainError: If zero error is no equilibrium without input, or the weights do not fit.
        """
        error = self.symbolic
        p = self.feedback(np.zeros((error.inputs, error.size)))
        at_rest = error.place(0.0, np.zeros(error.size), p)
        alpha = error.dynamics(0.0, at_rest, p)[0]
        if np.abs(alpha).max() > _AT_REST:
            raise GainError(
                f"{self.plant.system.name}: zero error is no equilibrium without input, z' = "
                f"{alpha.tolist()} there: linearize by feedback instead"
            )
        return lqr(*error.jacobian(p), self.Q, self.R)

    def chain_optimum(self) -> LqrDesign:
        """LQR on z_i^(r_i) = v_i, the Brunovsky form of eqs. (24) and (45).

        Raises:
            GainError: If the weights do not fit.
        """
        chains = self.error.linearization
        return lqr(chains.A, chains.B, self.Q, self.R)

    def feedback(self, K: Array) -> FeedbackParameters:
        """Numbers of a law with this gain, (m, n)."""
        return FeedbackParameters(self.plant.parameters, self.reference, K)


def require_task(task: Task) -> None:
    """Refuse what is no task.

    Raises:
        ArgumentError: If it is something else.
    """
    require("task", task, Task, "a Task(plant, error, reference, Q, R)")


def require_analytic(what: str, plant: Any) -> None:
    """Refuse a plant without equations that a law could be designed from.

    Raises:
        ArgumentError: If it is something else, in MuJoCo with what to give.
    """
    twin = getattr(plant, "analytic", None)
    if not isinstance(plant, AnalyticPlant) and callable(twin):
        raise ArgumentError(f"{what} is a {type(plant).__name__}: give its .analytic()")
    require(
        what, plant, AnalyticPlant, "an analytic plant, such as MujocoPlant.load(...).analytic()"
    )


def linear_lqr(task: Task) -> Controller:
    """LQR (5) on the plant's linearization."""
    optimum = task.linearization_optimum()
    law = laws.state_feedback(task.error)
    return _controller("lqr", law, task, task.feedback(optimum.K), optimum, "eqs. (5)-(6)")


def linearized_lqr(task: Task, name: str = "fl-lqr") -> Controller:
    """Feedback linearization with LQR only, eqs. (23)+(28) and (44)+(49)."""
    require_task(task)
    require("name", name, str, "a text")
    optimum = task.chain_optimum()
    law, source = laws.linearizing_feedback(task.error), "eqs. (23)+(28), (44)+(49)"
    return _controller(name, law, task, task.feedback(optimum.K), optimum, source, linearizing=True)


def computed_torque_pd(task: Task, frequency: float, damping: float) -> Controller:
    """Feedback linearization with the same two poles for every output: v = -w^2 e - 2 D w e'.

    What it is compared with is its own nominal trajectory, not an optimum; J* is what that costs.

    Args:
        task: What is designed for; every output must have relative degree two.
        frequency: w [rad/s].
        damping: D.

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
    law = laws.linearizing_feedback(task.error)
    source = "eqs. (23), (44) with v = -Kp e - Kd e'"
    return _controller("pd", law, task, task.feedback(optimum.K), optimum, source, linearizing=True)


def linear_grosmc(task: Task, uncertainty: Uncertainty, G: ArrayLike | None = None) -> Controller:
    """GROSMC of section 2, eqs. (8)+(12), with gains from the declared uncertainty.

    Args:
        task: What is designed for.
        uncertainty: What the law shall withstand.
        G: Projection of the surface, (m, n); B+ by default.

    Raises:
        GainError: If G B is singular or no gain can hold the declared family.
    """
    optimum, with_reach = task.linearization_optimum(), partial(laws.grosmc_linear, task.error)
    parameters, declared = _bounded(task, optimum, uncertainty, G, linearizing=False)
    return _sliding(with_reach, task, parameters, optimum, "eqs. (8)+(12)", declared)


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
    optimum, with_reach = task.chain_optimum(), partial(laws.grosmc_regulator, task.symbolic)
    parameters, declared = _bounded(task, optimum, uncertainty, G, linearizing=True)
    source = "eqs. (31)+(37)"
    return _sliding(with_reach, task, parameters, optimum, source, declared, linearizing=True)


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
    optimum, with_reach = task.chain_optimum(), partial(laws.grosmc_tracker, task.error)
    surface = _surface(task, optimum, G)
    parameters = TrackingParameters(**surface, k=float(k), epsilon=float(epsilon))
    source = "eqs. (51)+(55)"
    return _sliding(with_reach, task, parameters, optimum, source, linearizing=True)


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
    memory, m = controller.memory(), len(design.lqr.K)
    return replace(
        controller,
        law=design.with_reach(switching.reach(m)),
        parameters=replace(p, **changes),
        memory=switching.new_memory(m, len(memory.z0)),  # pyright: ignore
        design=replace(design, switching=switching.name, control_period=period),
    )


def _sliding(
    with_reach: Callable[[Reach], laws.Law],
    task: Task,
    parameters: SurfaceParameters,
    optimum: LqrDesign,
    source: str,
    declared: str = "",
    *,
    linearizing: bool = False,
) -> Controller:
    """A sliding mode controller, sampled as the task says."""
    law = with_reach(AS_PRINTED.switching.reach(task.error.inputs))
    made = _controller(
        "grosmc",
        law,
        task,
        parameters,
        optimum,
        source,
        declared,
        linearizing=linearizing,
        with_reach=with_reach,
    )
    return realized(made, task.realization)


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
    task: Task,
    parameters: FeedbackParameters,
    optimum: LqrDesign,
    source: str,
    declared: str = "",
    *,
    linearizing: bool = False,
    with_reach: Callable[[Reach], laws.Law] | None = None,
) -> Controller:
    """A controller with the gains that are worth showing."""
    switched = isinstance(parameters, SurfaceParameters)
    shown = ("eta", "gamma0", "gamma1", "k", "epsilon")
    gains = {name: getattr(parameters, name) for name in shown if hasattr(parameters, name)}
    m, n = optimum.K.shape
    # Rounding of what is zero is not worth showing.
    K = np.where(np.abs(optimum.K) > 1e-12 * np.abs(optimum.K).max(), optimum.K, 0.0)
    first = {f"K{j + 1}": float(K[0, j]) for j in range(n)}
    every = {f"K{i + 1}{j + 1}": float(K[i, j]) for i in range(m) for j in range(n)}
    switching = AS_PRINTED.switching
    memory = switching.new_memory(m, n) if switched else partial(_without_surface, m)
    design = Design(
        task.error,
        optimum,
        source=source,
        gains={**(first if m == 1 else every), **gains},
        declared=declared,
        sliding_unit=_sliding_unit(task, parameters) if switched else "",
        linearizing=linearizing,
        switching=switching.name if switched else "",
        with_reach=with_reach,
    )
    return Controller(name, law, parameters, memory, design)


def _without_surface(m: int) -> Memory:
    """Memory of a law of m inputs without a surface."""
    return Memory(v=np.zeros(m))


def _sliding_unit(task: Task, parameters: SurfaceParameters) -> str:
    """Unit of s: with G B = 1 that of the input times time, else that of the error's rate."""
    rows = list(task.error.linearization.last_rows)
    # With G in the last rows only and G B = 1 both are the rate's.
    if np.allclose(parameters.GB, parameters.G[:, rows]):
        return task.error.units[rows[0]]
    if np.allclose(parameters.GB, np.eye(len(parameters.GB))):
        return f"{task.plant.system.input.unit} s"
    return "1"

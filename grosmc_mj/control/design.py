"""Controllers for a nominal plant: from weights and a declared uncertainty to a law's numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control import laws
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.error_coordinates import ErrorCoordinates
from grosmc_mj.control.gains import Uncertainty, switching_gains
from grosmc_mj.control.lqr import LqrDesign, lqr
from grosmc_mj.control.memory import Memory, SurfaceMemory
from grosmc_mj.control.surface import surface_matrix
from grosmc_mj.errors import GainError
from grosmc_mj.plants import AnalyticPlant


@dataclass(frozen=True, eq=False)
class FeedbackParameters:
    """Numbers of the laws without switching.

    Attributes:
        plant: The nominal plant's parameters.
        reference: The reference's parameters.
        K: Feedback gain, (2,).
    """

    plant: Any
    reference: Any
    K: Array


@dataclass(frozen=True, eq=False)
class SurfaceParameters(FeedbackParameters):
    """Numbers of the integral surface, eqs. (8), (31) and (51).

    Attributes:
        G: Projection, (2,).
        GA_c: G (A - B K), (2,).
        GB: G B.
    """

    G: Array
    GA_c: Array
    GB: float


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


@dataclass(frozen=True, eq=False)
class Task:
    """A nominal plant, what of it is regulated, and the index that weighs it.

    Attributes:
        plant: The plant that the law believes in.
        error: The error coordinates z, two of them.
        reference: Parameters of the reference that ``error`` measures from.
        Q: Weight of z, positive semidefinite, (2, 2).
        R: Weight of the input, or of v after linearization; positive.
    """

    plant: AnalyticPlant
    error: ErrorCoordinates
    reference: Any
    Q: ArrayLike
    R: ArrayLike

    def linearization_optimum(self) -> LqrDesign:
        """LQR on the Jacobian linearization about zero error; exact for the linear servo."""
        return lqr(*self.error.jacobian(self.feedback(np.zeros(2))), self.Q, self.R)

    def chain_optimum(self) -> LqrDesign:
        """LQR on z1'' = v, the Brunovsky form of eqs. (24) and (45)."""
        return lqr([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], self.Q, self.R)

    def feedback(self, K: Array) -> FeedbackParameters:
        """Numbers of a law with this gain, (2,)."""
        return FeedbackParameters(self.plant.parameters, self.reference, K)


def linear_lqr(task: Task) -> Controller:
    """LQR (5) on the plant's linearization."""
    optimum = task.linearization_optimum()
    law = laws.state_feedback(task.error)
    return _controller("lqr", law, task, task.feedback(optimum.K[0]), optimum, "eqs. (5)-(6)")


def linearized_lqr(task: Task, name: str = "fl-lqr") -> Controller:
    """Feedback linearization with LQR only, eqs. (23)+(28) and (44)+(49)."""
    optimum = task.chain_optimum()
    law, source = laws.linearizing_feedback(task.error), "eqs. (23)+(28), (44)+(49)"
    parameters = task.feedback(optimum.K[0])
    return _controller(name, law, task, parameters, optimum, source, linearizing=True)


def linear_grosmc(task: Task, uncertainty: Uncertainty, G: ArrayLike | None = None) -> Controller:
    """GROSMC of section 2, eqs. (8)+(12), with gains from the declared uncertainty.

    Args:
        task: What is designed for.
        uncertainty: What the law shall withstand.
        G: Projection of the surface, (1, 2); B+ by default.

    Raises:
        GainError: If G B is singular or no gain can hold the declared family.
    """
    optimum, law = task.linearization_optimum(), laws.grosmc_linear(task.error)
    parameters, declared = _bounded(task, optimum, uncertainty, G, linearizing=False)
    return _controller("grosmc", law, task, parameters, optimum, "eqs. (8)+(12)", declared)


def regulating_grosmc(
    task: Task, uncertainty: Uncertainty, G: ArrayLike | None = None
) -> Controller:
    """GROSMC of section 3, eqs. (31)+(37), with gains from the declared uncertainty.

    Args:
        task: What is designed for.
        uncertainty: What the law shall withstand.
        G: Projection of the surface, (1, 2); B+ by default.

    Raises:
        GainError: If G B is singular or no gain can hold the declared family.
    """
    optimum, law = task.chain_optimum(), laws.grosmc_regulator(task.error)
    parameters, declared = _bounded(task, optimum, uncertainty, G, linearizing=True)
    source = "eqs. (31)+(37)"
    return _controller("grosmc", law, task, parameters, optimum, source, declared, linearizing=True)


def tracking_grosmc(task: Task, k: float, epsilon: float, G: ArrayLike | None = None) -> Controller:
    """GROSMC of section 4, eqs. (51)+(55), with its gains given.

    Args:
        task: What is designed for.
        k: Proportional reaching gain [1/s].
        epsilon: Switching gain, in the unit of s per second.
        G: Projection of the surface, (1, 2); B+ by default.

    Raises:
        GainError: If G B is singular or a gain is not positive.
    """
    if not (k > 0 and epsilon > 0):
        raise GainError(f"k = {k:g} and epsilon = {epsilon:g} must be positive")
    optimum, law = task.chain_optimum(), laws.grosmc_tracker(task.error)
    surface = _surface(task, optimum, G)
    parameters = TrackingParameters(**surface, k=float(k), epsilon=float(epsilon))
    source = "eqs. (51)+(55)"
    return _controller("grosmc", law, task, parameters, optimum, source, linearizing=True)


def _surface(task: Task, optimum: LqrDesign, G: ArrayLike | None) -> dict[str, Any]:
    """Numbers of the surface that follows an optimum."""
    matrix = surface_matrix(G, optimum.B)
    return {
        **vars(task.feedback(optimum.K[0])),
        "G": matrix[0],
        "GA_c": (matrix @ optimum.closed_loop)[0],
        "GB": float((matrix @ optimum.B)[0, 0]),
    }


def _bounded(
    task: Task,
    optimum: LqrDesign,
    uncertainty: Uncertainty,
    G: ArrayLike | None,
    *,
    linearizing: bool,
) -> tuple[BoundedParameters, str]:
    """Surface and gains of the laws (12) and (37), and what they were computed from."""
    K = optimum.K[0]
    gains = switching_gains(task.error, task.feedback(K), K, uncertainty, linearizing=linearizing)
    parameters = BoundedParameters(
        **_surface(task, optimum, G), eta=gains.eta, gamma0=gains.gamma0, gamma1=gains.gamma1
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
) -> Controller:
    """A controller with the gains that are worth showing."""
    switched = isinstance(parameters, SurfaceParameters)
    shown = ("eta", "gamma0", "gamma1", "k", "epsilon")
    gains = {name: getattr(parameters, name) for name in shown if hasattr(parameters, name)}
    return Controller(
        name=name,
        law=law,
        parameters=parameters,
        memory=SurfaceMemory if switched else Memory,
        error=task.error,
        lqr=optimum,
        source=source,
        gains={"K1": float(optimum.K[0, 0]), "K2": float(optimum.K[0, 1]), **gains},
        declared=declared,
        sliding_unit=_sliding_unit(task, parameters) if switched else "",
        linearizing=linearizing,
    )


def _sliding_unit(task: Task, parameters: SurfaceParameters) -> str:
    """Unit of s: with G B = 1 that of the input times time, else that of the error's rate."""
    # With B = [0, 1] both are the rate's.
    if math.isclose(parameters.GB, parameters.G[1]):
        return task.plant.system.velocities[task.plant.system.output].unit
    if math.isclose(parameters.GB, 1):
        return f"{task.plant.system.input.unit} s"
    return "1"

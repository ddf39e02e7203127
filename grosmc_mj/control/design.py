"""Controllers for a nominal plant: from weights and a declared uncertainty to a law's numbers."""

from __future__ import annotations

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


def integrator_chain() -> tuple[Array, Array]:
    """(A, B) of z1'' = v, the Brunovsky form of eqs. (24) and (45)."""
    return np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])


def linear_lqr(
    plant: AnalyticPlant, error: ErrorCoordinates, reference: Any, Q: ArrayLike, R: ArrayLike
) -> Controller:
    """LQR (5) on the plant's Jacobian linearization; exact for the linear servo."""
    design = _jacobian_lqr(plant, error, reference, Q, R)
    parameters = FeedbackParameters(plant.parameters, reference, design.K[0])
    source = "eqs. (5)-(6)"
    return _controller("lqr", laws.state_feedback(error), parameters, error, design, source)


def linearized_lqr(
    plant: AnalyticPlant,
    error: ErrorCoordinates,
    reference: Any,
    Q: ArrayLike,
    R: ArrayLike,
    name: str = "fl-lqr",
) -> Controller:
    """Feedback linearization with LQR only, eqs. (23)+(28) and (44)+(49)."""
    design = lqr(*integrator_chain(), Q, R)
    parameters = FeedbackParameters(plant.parameters, reference, design.K[0])
    source = "eqs. (23)+(28), (44)+(49)"
    return _controller(name, laws.linearizing_feedback(error), parameters, error, design, source)


def linear_grosmc(
    plant: AnalyticPlant,
    error: ErrorCoordinates,
    reference: Any,
    Q: ArrayLike,
    R: ArrayLike,
    uncertainty: Uncertainty,
    G: ArrayLike | None = None,
) -> Controller:
    """GROSMC of section 2, eqs. (8)+(12), with gains from the declared uncertainty.

    Raises:
        GainError: If G B is singular or no gain can hold the declared family.
    """
    design = _jacobian_lqr(plant, error, reference, Q, R)
    parameters = _bounded(plant, error, reference, design, uncertainty, G, linearizing=False)
    return _controller(
        "grosmc", laws.grosmc_linear(error), parameters, error, design, "eqs. (8)+(12)"
    )


def regulating_grosmc(
    plant: AnalyticPlant,
    error: ErrorCoordinates,
    reference: Any,
    Q: ArrayLike,
    R: ArrayLike,
    uncertainty: Uncertainty,
    G: ArrayLike | None = None,
) -> Controller:
    """GROSMC of section 3, eqs. (31)+(37), with gains from the declared uncertainty.

    Raises:
        GainError: If G B is singular or no gain can hold the declared family.
    """
    design = lqr(*integrator_chain(), Q, R)
    parameters = _bounded(plant, error, reference, design, uncertainty, G, linearizing=True)
    return _controller(
        "grosmc", laws.grosmc_regulator(error), parameters, error, design, "eqs. (31)+(37)"
    )


def tracking_grosmc(
    plant: AnalyticPlant,
    error: ErrorCoordinates,
    reference: Any,
    Q: ArrayLike,
    R: ArrayLike,
    k: float,
    epsilon: float,
    G: ArrayLike | None = None,
) -> Controller:
    """GROSMC of section 4, eqs. (51)+(55), with the gains k and epsilon given.

    Raises:
        GainError: If G B is singular or a gain is not positive.
    """
    if not (k > 0 and epsilon > 0):
        raise GainError(f"k = {k:g} and epsilon = {epsilon:g} must be positive")
    design = lqr(*integrator_chain(), Q, R)
    surface = _surface(plant, reference, design, G)
    parameters = TrackingParameters(**surface, k=float(k), epsilon=float(epsilon))
    return _controller(
        "grosmc", laws.grosmc_tracker(error), parameters, error, design, "eqs. (51)+(55)"
    )


def _jacobian_lqr(
    plant: AnalyticPlant, error: ErrorCoordinates, reference: Any, Q: ArrayLike, R: ArrayLike
) -> LqrDesign:
    """LQR on the linearization of the error dynamics about zero error."""
    numbers = FeedbackParameters(plant.parameters, reference, np.zeros(2))
    return lqr(*error.jacobian(numbers), Q, R)


def _surface(
    plant: AnalyticPlant, reference: Any, design: LqrDesign, G: ArrayLike | None
) -> dict[str, Any]:
    """Numbers of the surface that follows a design."""
    matrix = surface_matrix(G, design.B)
    return {
        "plant": plant.parameters,
        "reference": reference,
        "K": design.K[0],
        "G": matrix[0],
        "GA_c": (matrix @ design.closed_loop)[0],
        "GB": float((matrix @ design.B)[0, 0]),
    }


def _bounded(
    plant: AnalyticPlant,
    error: ErrorCoordinates,
    reference: Any,
    design: LqrDesign,
    uncertainty: Uncertainty,
    G: ArrayLike | None,
    *,
    linearizing: bool,
) -> BoundedParameters:
    """Surface and gains of the laws (12) and (37)."""
    surface = _surface(plant, reference, design, G)
    numbers = FeedbackParameters(plant.parameters, reference, design.K[0])
    gains = switching_gains(error, numbers, design.K[0], uncertainty, linearizing=linearizing)
    # eta is a rate of s; eqs. (12) and (37) divide it by G B as they do the rest.
    return BoundedParameters(**surface, eta=gains.eta, gamma0=gains.gamma0, gamma1=gains.gamma1)


def _controller(
    name: str,
    law: laws.Law,
    parameters: FeedbackParameters,
    error: ErrorCoordinates,
    design: LqrDesign,
    source: str,
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
        error=error,
        lqr=design,
        source=source,
        gains={"K1": float(design.K[0, 0]), "K2": float(design.K[0, 1]), **gains},
    )

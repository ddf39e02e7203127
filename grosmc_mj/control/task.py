"""What a law is designed for, how it is sampled, and the numbers that come of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arguments import real, reals, require
from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.base import OutputCoordinates
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.lqr import LqrDesign, lqr
from grosmc_mj.control.switching import Sign, Switching
from grosmc_mj.errors import ArgumentError, GainError, shown
from grosmc_mj.plants import AnalyticPlant, OperatingPoint, Plant, System


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
    """Numbers of the law (37), and of (12) but for its limit.

    Attributes:
        eta: Reaching gain.
        gamma0: Constant part of the uncertainty's bound.
        gamma1: Its slope over the norm of the state.
    """

    eta: float
    gamma0: float
    gamma1: float


@dataclass(frozen=True, eq=False)
class LinearParameters(BoundedParameters):
    """Numbers of the law (12).

    Attributes:
        GB_held: What a unit of input that is cut off takes from s per second, (m, m): G B as
            printed, that of a held input on the discrete-time surface.
        limit: Largest nominal input, in the unit of the input; infinite as printed.
    """

    GB_held: Array
    limit: float = math.inf


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
        self.error.require_regular(self.feedback(np.zeros((0, 0))))
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

    def optimum(self, *, linearizing: bool) -> LqrDesign:
        """The nominal optimum of laws with feedback linearization, or of those without.

        Raises:
            GainError: As ``chain_optimum`` or ``linearization_optimum``.
        """
        return self.chain_optimum() if linearizing else self.linearization_optimum()

    def feedback(self, K: Array) -> FeedbackParameters:
        """Numbers of a law with this gain, (m, n)."""
        return FeedbackParameters(self.plant.parameters, self.reference, K)


@dataclass(frozen=True, eq=False)
class StateTask:
    """A nominal plant whose whole state is held at an operating point, and the index of that.

    Attributes:
        plant: The plant that the law believes in, as equations or in MuJoCo.
        Q: Weight of x - x_e, positive semidefinite, (n, n).
        R: Weight of u - u_e, positive definite, (m, m) or a number.
        reference: The operating point; the origin by default.
        model: (A, B) there; the plant's own linearization by default.
        realization: How a sliding mode law is sampled.
    """

    plant: Plant
    Q: ArrayLike
    R: ArrayLike
    reference: OperatingPoint | None = None
    model: tuple[Array, Array] | None = None
    realization: Realization = AS_PRINTED

    def __post_init__(self) -> None:
        require("plant", self.plant, Plant, "a plant, such as MujocoPlant.load(...)")
        require("realization", self.realization, Realization, "a Realization")
        kinds = (OperatingPoint, type(None))
        require("reference", self.reference, kinds, "an OperatingPoint, as equilibrium gives it")
        self.plant.operating_point(self.point.x, self.point.u)
        pair = isinstance(self.model, tuple) and len(self.model) == 2
        if self.model is not None and not pair:
            raise ArgumentError(f"model = {shown(self.model)} must be a pair (A, B)")

    @property
    def point(self) -> OperatingPoint:
        """The operating point."""
        return self.reference or OperatingPoint.origin(self.plant)

    @cached_property
    def error(self) -> StateCoordinates:
        """z = x - x_e."""
        return _state_coordinates(self.plant.system)

    def linearization_optimum(self) -> LqrDesign:
        """LQR on the plant's linearization about the operating point.

        Raises:
            ArgumentError: If the plant does not rest there.
            GainError: If the weights do not fit, or the input cannot stabilize it there.
        """
        model = self.model or self.plant.linearization(self.point.x, self.point.u)
        return lqr(*model, self.Q, self.R)

    def feedback(self, K: Array) -> FeedbackParameters:
        """Numbers of a law with this gain, (m, n)."""
        return FeedbackParameters(self.plant.parameters or NoNumbers(), self.point, K)


@dataclass(frozen=True)
class NoNumbers:
    """Of what has no numbers that a law reads: MuJoCo or formulas have them."""


@cache
def _state_coordinates(system: System) -> StateCoordinates:
    """The coordinates of a system's state, made once, as a law is compiled once for them."""
    return StateCoordinates(system)


def require_task(task: Task | StateTask, *, of_states: bool = False) -> None:
    """Refuse what is no task.

    Args:
        task: What a law is designed for.
        of_states: Whether a task of the whole state will do too.

    Raises:
        ArgumentError: If it is something else.
    """
    kinds = (Task, StateTask) if of_states else Task
    require("task", task, kinds, "a Task(plant, error, reference, Q, R)")


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

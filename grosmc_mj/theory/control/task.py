"""Task of a law (plant, outputs, weights), its realization, and the numbers of the laws."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import PlainValidator

from grosmc_mj.ground.arguments import reals
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GainError, value_text
from grosmc_mj.ground.fields import Is, Range, Reals, checked, checked_call
from grosmc_mj.ground.refusals import refusal
from grosmc_mj.theory.control.coordinates.base import (
    Coordinates,
    OutputCoordinates,
    regulated_outputs,
)
from grosmc_mj.theory.control.coordinates.state import StateCoordinates
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.lqr import LqrDesign, lqr_of_states
from grosmc_mj.theory.control.switching import Switching, SwitchingNumbers, find_switching
from grosmc_mj.theory.plants import AnalyticPlant, OperatingPoint, Plant
from grosmc_mj.theory.plants.owner_units import INPUT


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


@dataclass(frozen=True, eq=False, kw_only=True)
class GrosmcParameters(FeedbackParameters):
    """Numbers of GROSMC: of the surfaces (8), (31), (51) and the laws (12), (37), (55).

    A law has either ``eta``, ``gamma0`` and ``gamma1``, computed from a declared uncertainty, or
    ``k`` and ``epsilon``; the others are 0.

    Attributes:
        G: Projection, (m, n).
        S: Rate of G z on the optimal trajectory over z [1/s], (m, n): ``surface_rates``.
        GB: G B, (m, m).
        GB_inverse: Its inverse, (m, m).
        GB_held: Rate of s that a unit of input makes, (m, m): G B as printed, G B_d / T on the
            discrete-time surface. By this the surface makes up for an input that is cut off.
        size_of_GB: Norm of G B.
        switching: Numbers of the switching law.
        eta: Reaching gain, in the unit of s per second.
        gamma0: Constant part of the uncertainty's bound, in the unit of the input.
        gamma1: Its slope over the norm of the error state.
        k: Proportional reaching gain [1/s].
        epsilon: Switching gain, in the unit of s per second.
        limit: Largest nominal input of the law (12), in the unit of the input; infinite as printed.
    """

    G: Array
    S: Array
    GB: Array
    GB_inverse: Array
    GB_held: Array
    size_of_GB: float
    switching: SwitchingNumbers
    eta: float = 0.0
    gamma0: float = 0.0
    gamma1: float = 0.0
    k: float = 0.0
    epsilon: float = 0.0
    limit: float = math.inf


@dataclass(frozen=True)
class NoNumbers:
    """Parameters of a plant or reference without numbers that a law reads."""


def _matrix(value: Any) -> Array:
    """Array of finite numbers."""
    entries = reals(value)
    if not np.all(np.isfinite(entries)):
        raise refusal("a matrix of finite numbers")
    return entries


Matrix = Annotated[ArrayLike, PlainValidator(_matrix)]
# A plant with equations that a law could be designed from.
Analytic = Annotated[
    AnalyticPlant, Is(AnalyticPlant, "an analytic plant, such as MujocoPlant.load(...).analytic()")
]
# Largest |u| that the actuators give, in the unit of the input; infinite for none.
Limit = Annotated[
    float,
    LawNumber(low=0, above=True, infinite=True, unit=INPUT, meaning="largest input |u|"),
]


@checked()
class Realization:
    """Realization of a sliding mode law on a sampled controller.

    Attributes:
        switching: Its switching law.
        control_period: Sampling time of the discrete-time surface [s]; None for the printed
            surface, which fits every sampling time.
    """

    switching: Annotated[
        Switching, Is(Switching, "a switching law, such as find_switching('implicit')")
    ] = find_switching("sign")
    control_period: Annotated[float, Range(0, unit="s", above=True)] | None = None


AS_PRINTED = Realization()


@checked(eq=False)
class Task:
    """A nominal plant, the error coordinates that are regulated, and the weights of the index.

    Attributes:
        plant: The nominal plant; as equations if outputs are regulated.
        error: The error coordinates z, n of them: of outputs, or of the whole state.
        reference: Parameters of the reference of ``error``.
        Q: Weight of z, positive semidefinite, (n, n).
        R: Weight of the input, or of v after linearization; positive definite, (m, m) or a
            number.
        model: (A, B) of z' = A z + B u about zero error; the plant's own linearization by default.
        limits: Least and largest of each input that the law may ask for, in the units of the
            inputs, (2, m); the plant's own by default.
        weighed: False if nobody has chosen Q and R: no distance from their optimum and no cost is
            told of the runs.
    """

    plant: Annotated[Plant, Is(Plant, "a plant, such as MujocoPlant.load(...)")]
    error: Annotated[
        OutputCoordinates | StateCoordinates, Is(Coordinates, "error coordinates of the plant")
    ]
    reference: Any
    Q: Matrix
    R: Matrix
    model: tuple[Matrix, Matrix] | None = None
    limits: Annotated[ArrayLike, Reals((2, None), infinite=True)] | None = None
    weighed: bool = True

    def __post_init__(self) -> None:
        self.error.require_task(self.plant, self._numbers_without_gain())
        _require_weight("Q", self.Q, self.error.size)
        _require_weight("R", self.R, self.error.inputs)

    @property
    def input_limits(self) -> Array:
        """Least and largest of each input that the law may ask for, (2, m)."""
        if self.limits is None:
            return self.plant.input_limits
        return np.asarray(self.limits, float)

    @property
    def outputs(self) -> OutputCoordinates:
        """The error coordinates of a task that regulates outputs.

        Raises:
            ArgumentError: If it regulates the whole state.
        """
        return regulated_outputs(self.error, self.plant.system.name)

    def optimum(self, *, linearizing: bool = False) -> LqrDesign:
        """Nominal optimum of the laws: an LQR design.

        With feedback linearization it is LQR on z_i^(r_i) = v_i, the Brunovsky form of eqs. (24)
        and (45). Without, it is LQR on the linearization about zero error, exact for the linear
        servo.

        Args:
            linearizing: Whether the laws use feedback linearization.

        Raises:
            ArgumentError: If the plant does not rest there.
            GainError: If the weights do not fit or, on the linearization, zero error is no
                equilibrium without input.
        """
        if linearizing:
            chains = self.outputs.linearization
            return lqr_of_states(chains.A, chains.B, self.Q, self.R, names=self.error.names)

        model = self.model
        if not model:
            model = self.error.linear_model(self.plant, self._numbers_without_gain())
        A, B = model
        return lqr_of_states(A, B, self.Q, self.R, names=self.error.names)

    def feedback(self, K: Array) -> FeedbackParameters:
        """Numbers of a law with this gain, (m, n)."""
        return FeedbackParameters(self.plant.parameters or NoNumbers(), self.reference, K)

    def _numbers_without_gain(self) -> FeedbackParameters:
        """Numbers that the error coordinates read before there is a gain."""
        return self.feedback(np.zeros((0, 0)))


def _require_weight(name: str, weight: ArrayLike, size: int) -> None:
    """Refuse a weight that is neither a number nor a matrix of this size."""
    if np.shape(weight) not in ((), (size, size)):
        raise GainError(f"{name} = {value_text(weight)} must be a {size} x {size} matrix")


# One object for each system: laws are compiled once for each object of error coordinates.
_state_coordinates = cache(StateCoordinates)


@checked_call
def state_task(
    plant: Annotated[Plant, Is(Plant, "a plant, such as MujocoPlant.load(...)")],
    Q: Matrix,
    R: Matrix,
    reference: Annotated[
        OperatingPoint | None,
        Is((OperatingPoint, type(None)), "an OperatingPoint, as equilibrium gives it"),
    ] = None,
    model: tuple[Matrix, Matrix] | None = None,
) -> Task:
    """Task of holding the whole state of a nominal plant at an operating point.

    Args:
        plant: The nominal plant, as equations or in MuJoCo.
        Q: Weight of x - x_e, positive semidefinite, (n, n).
        R: Weight of u - u_e, positive definite, (m, m) or a number.
        reference: The operating point; the origin by default.
        model: (A, B) there; the plant's own linearization by default.
    """
    point = reference or OperatingPoint.origin(plant)
    return Task(plant, _state_coordinates(plant.system), point, Q, R, model)

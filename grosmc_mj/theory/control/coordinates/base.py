"""Error coordinates z of a law, and how the inputs move them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arguments import reals
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ArgumentError, PremiseError, value_text
from grosmc_mj.ground.fields import Is
from grosmc_mj.ground.units import rate_unit
from grosmc_mj.theory.control.coordinates.design_model import DesignModel
from grosmc_mj.theory.control.lqr import LqrDesign
from grosmc_mj.theory.control.references import ReferenceFunction
from grosmc_mj.theory.plants import AnalyticPlant, Plant, System

# Jitable (t, x, p, z): write the error state z (n,) of x, by the nominal ``p.plant``.
StateMap = Callable[[float, Any, Any, Any], None]
# Jitable (t, x, v, memory, p, u) or (t, x, u, memory, p, v): write the last, both (m,).
InputMap = Callable[[float, Any, Any, Any, Any, Any], None]


@dataclass(frozen=True, eq=False)
class Chains:
    """z_i^(r_i) = v_i: the Brunovsky form z' = A z + B v of eqs. (24) and (45).

    Attributes:
        relative_degree: r_1 ... r_m, the number of times that each output is differentiated until
            an input appears.
    """

    relative_degree: tuple[int, ...]

    @property
    def last_rows(self) -> tuple[int, ...]:
        """Rows of z' in which the inputs appear."""
        return tuple((np.cumsum(self.relative_degree) - 1).tolist())

    @property
    def first_rows(self) -> tuple[int, ...]:
        """Entries of z that are outputs."""
        ends = np.cumsum(self.relative_degree)
        return tuple((ends - np.array(self.relative_degree)).tolist())

    @property
    def A(self) -> Array:
        """State matrix, (sum r, sum r)."""
        matrix = np.eye(sum(self.relative_degree), k=1)
        matrix[list(self.last_rows)] = 0.0
        return matrix

    @property
    def B(self) -> Array:
        """Input matrix, (sum r, m)."""
        identity = np.eye(sum(self.relative_degree))
        return identity[:, list(self.last_rows)]


@dataclass(frozen=True, eq=False)
class Coordinates(ABC):
    """Error coordinates z (n,) of a law, and the map from its v (m,) to the input.

    Jitable functions are cached properties: a law is compiled for each function anew.

    Attributes:
        system: The plant's signals and names.
    """

    system: System

    @property
    def inputs(self) -> int:
        """m, the number of inputs."""
        return len(self.system.inputs)

    @property
    @abstractmethod
    def size(self) -> int:
        """n, the number of entries of z."""

    @property
    @abstractmethod
    def units(self) -> tuple[str, ...]:
        """Unit of each entry of z."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Name of each entry of z, by which Q and gains are told."""

    def input_names(self, *, linearizing: bool) -> tuple[str, ...]:
        """Name of each entry of a law's v, by which R and gains are told.

        Args:
            linearizing: Whether v goes through feedback linearization, eqs. (23) and (44).
        """
        return tuple(signal.name for signal in self.system.inputs)

    @property
    @abstractmethod
    def output_rows(self) -> tuple[int, ...]:
        """Entries of z that a run is judged by."""

    # Each function is made once for the coordinates: a law is compiled again for each new one.
    @cached_property
    @abstractmethod
    def state(self) -> StateMap:
        """Jitable (t, x, p, z): write z of the state x."""

    @abstractmethod
    def input_maps(self, *, linearizing: bool) -> tuple[InputMap, InputMap]:
        """(t, x, v, memory, p, u), the input of a law's v, and its inverse (t, x, u, memory, p, v).

        Args:
            linearizing: Whether v goes through feedback linearization, eqs. (23) and (44).
        """

    @abstractmethod
    def require_task(self, plant: Plant, p: Any) -> None:
        """Refuse a plant or a reference for which no law on these coordinates can be designed.

        Args:
            plant: The nominal plant.
            p: The law's parameters, with ``plant`` and ``reference``.

        Raises:
            GrosmcError: With the reason.
        """

    @abstractmethod
    def linear_model(self, plant: Plant, p: Any) -> tuple[Array, Array]:
        """(A, B) of z' = A z + B v about zero error, without feedback linearization.

        Args:
            plant: The nominal plant.
            p: The law's parameters, with ``plant`` and ``reference``.

        Returns:
            A (size, size) and B (size, m).

        Raises:
            GrosmcError: If zero error is no equilibrium, or there is no such model.
        """

    def error_state(self, t: float, x: ArrayLike, p: Any) -> Array:
        """z of one state x, (n,)."""
        z = np.zeros(self.size)
        self.state(t, x, p, z)
        return z

    @abstractmethod
    def design_model(self, optimum: LqrDesign, p: Any) -> DesignModel:
        """The plant as a law on these coordinates knows it.

        Args:
            optimum: The law's optimum.
            p: The law's parameters, with ``plant`` and ``reference``.
        """

    @abstractmethod
    def rest(self, p: Any) -> Array:
        """State of zero error at t = 0, (n,)."""

    @abstractmethod
    def error_dynamics(
        self,
        t: Sequence[float],
        x: Array,
        p: Any,
        plant: Plant,
        w: Array | None = None,
        u: Array | None = None,
    ) -> tuple[Array, Array]:
        """(drift, gain) of z' = drift + gain v on a true plant: eq. (24).

        z is computed from x by the nominal ``p.plant``; x moves as the true plant does.

        Args:
            t: Times [s], (N,).
            x: States, (N, n).
            p: The law's parameters, with ``plant`` and ``reference``.
            plant: The true plant.
            w: Wrenches on it, (N, 6 * bodies); None for none.
            u: Inputs on which friction, limits and contacts depend, (N, m); None for none.
                Equations do not use them.

        Returns:
            drift (N, size) and gain (N, size, m); of a law of outputs v is the input u.
        """

    @abstractmethod
    def from_rates(self, x: Array, p: Any, rates: Array) -> Array:
        """Part of z' by what is added to the rates of the states.

        Args:
            x: States, (N, n).
            p: The law's parameters, with ``plant``.
            rates: Added rates, (N, n).

        Returns:
            (N, size).
        """

    def along(self, time: ArrayLike, x: ArrayLike, p: Any) -> Array:
        """z at every sample of a trajectory: time (N,), x (N, n); returns (N, size)."""
        reference = self.reference_along(time, p.reference)
        return self.beside(reference, x, p)

    @abstractmethod
    def beside(self, reference: Array, x: ArrayLike, p: Any) -> Array:
        """z at states x (N, n) for reference values (N, size) there; returns (N, size)."""

    @abstractmethod
    def reference_along(self, time: ArrayLike, parameters: Any) -> Array:
        """Reference values of z at the instants (N,), (N, size)."""


@jitable
def _copy(t: float, x: Any, values: Any, memory: Any, p: Any, result: Any) -> None:
    """u = v, or v = u: input maps of a law of a linear model."""
    for i in range(len(result)):
        result[i] = values[i]


@dataclass(frozen=True, eq=False)
class OutputCoordinates(Coordinates):
    """z = sign * (T(x) - [y_r, y_r', ...]), each output with its derivatives below r_i.

    Attributes:
        reference: y_r(t) and its derivatives, from ``p.reference``.
        sign: +1 for y - y_r, -1 for y_r - y.
        outputs: y in symbols, as many as inputs; the system's own by default.
    """

    reference: ReferenceFunction
    sign: Literal[1, -1] = 1
    outputs: tuple[Any, ...] | None = None

    def __post_init__(self) -> None:
        Is(System, "a System, such as plant.system").require("system", self.system)
        if not callable(self.reference):
            raise ArgumentError(
                f"reference = {value_text(self.reference)} must be a function (t, p) -> y_r and "
                "its derivatives, such as setpoints(2)"
            )
        if type(self.sign) is not int or abs(self.sign) != 1:
            raise ArgumentError(f"sign = {value_text(self.sign)} must be 1 or -1")

    @cached_property
    @abstractmethod
    def linearization(self) -> Chains:
        """The chains that the feedback makes of the plant.

        Raises:
            PremiseError: If the outputs have no vector relative degree.
        """

    @property
    @abstractmethod
    def output_units(self) -> tuple[str, ...]:
        """Unit of each output, m of them."""

    def input_names(self, *, linearizing: bool) -> tuple[str, ...]:
        """Names of the inputs or, as v_i = z_i^(r_i) after linearization, of the outputs."""
        if linearizing:
            return tuple(self.names[row] for row in self.output_rows)
        return super().input_names(linearizing=linearizing)

    @cached_property
    @abstractmethod
    def feedback(self) -> InputMap:
        """Jitable (t, x, v, memory, p, u): the u that makes z_i^(r_i) = v_i, eqs. (23), (44).

        Where there is none, it sets ``memory.undefined`` and writes zeros.
        """

    @cached_property
    @abstractmethod
    def virtual_input(self) -> InputMap:
        """Jitable (t, x, u, memory, p, v): ``feedback``'s inverse, v of an input."""

    def input_maps(self, *, linearizing: bool) -> tuple[InputMap, InputMap]:
        """Input of v, and its inverse; without feedback linearization v is the input itself."""
        if linearizing:
            return self.feedback, self.virtual_input
        return _copy, _copy

    @abstractmethod
    def dynamics_along(
        self,
        t: Sequence[float],
        x: Array,
        p: Any,
    ) -> tuple[Array, Array]:
        """(alpha, E) of z_i^(r_i) = alpha_i + (E u)_i, by the law's model.

        Args:
            t: Times [s], (N,).
            x: States, (N, n).
            p: The law's parameters, with ``plant`` and ``reference``.

        Returns:
            alpha (N, m) and E (N, m, m).
        """

    def dynamics(self, t: float, x: Any, p: Any) -> tuple[Array, Array]:
        """alpha (m,) and E (m, m) of ``dynamics_along`` at one instant and state."""
        states = np.asarray(x, float)[None]
        alpha, E = self.dynamics_along([t], states, p)
        return alpha[0], E[0]

    @abstractmethod
    def outputs_along(self, x: ArrayLike, plant: Any) -> Array:
        """T(x) at every state of a trajectory, (N, n); returns (N, size)."""

    @abstractmethod
    def place(
        self,
        t: float,
        z: ArrayLike,
        p: Any,
        near: ArrayLike | None = None,
    ) -> Array:
        """State with this error, with all other coordinates at rest, (n,).

        Args:
            t: Time [s].
            z: Error state, (size,).
            p: The law's parameters, with ``plant`` and ``reference``.
            near: State from which the search starts, (n,); the coordinates' guess by default.

        Raises:
            PremiseError: If there is none near the guess.
        """

    def rest(self, p: Any) -> Array:
        """State of zero error at t = 0, with all other coordinates at rest, (n,)."""
        return self.place(0.0, np.zeros(self.size), p)

    def require_task(self, plant: Plant, p: Any) -> None:
        """Refuse a plant without equations, and a reference that does not fit the outputs.

        Args:
            plant: The nominal plant.
            p: The law's parameters, with ``plant`` and ``reference``.

        Raises:
            ArgumentError: If the reference has no finite values at t = 0.
            PremiseError: If it has other derivatives than the outputs need.
        """
        Is(AnalyticPlant, "an analytic plant, such as plant.analytic()").require("plant", plant)
        degrees = self.linearization.relative_degree
        derivatives = getattr(self.reference, "degrees", degrees)
        if derivatives != degrees:
            raise PremiseError(
                f"{self.system.name}: the outputs have relative degrees {degrees}, the reference "
                f"has derivatives for {derivatives}"
            )

        try:
            values = reals(self.reference(0.0, p.reference))
        except (ArithmeticError, ValueError, AttributeError, TypeError) as error:
            raise ArgumentError(f"the reference has no value at t = 0: {error}") from None
        count = sum(degrees) + len(degrees)
        if values.shape != (count,) or not np.all(np.isfinite(values)):
            raise ArgumentError(
                f"the reference gives {value_text(values)} at t = 0, must give finite values of "
                f"each output with derivatives up to {degrees}"
            )

    @property
    def size(self) -> int:
        """Number of entries of z."""
        return sum(self.linearization.relative_degree)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each entry of z."""
        units: list[str] = []
        degrees = self.linearization.relative_degree
        for unit, degree in zip(self.output_units, degrees, strict=True):
            for _ in range(degree):
                units.append(unit)
                unit = rate_unit(unit)
        return tuple(units)

    @property
    def output_rows(self) -> tuple[int, ...]:
        """Entries of z that are errors of outputs; all other entries are their derivatives."""
        return self.linearization.first_rows

    @property
    def _highest(self) -> tuple[int, ...]:
        """Indices of the reference's derivatives of order r_i."""
        values = np.array(self.linearization.relative_degree) + 1
        return tuple((np.cumsum(values) - 1).tolist())

    @property
    def lower(self) -> tuple[int, ...]:
        """Indices of the reference's values of order below r_i, which z is measured from."""
        indices = np.arange(self.size + self.inputs)
        return tuple(np.delete(indices, self._highest).tolist())

    def unmatched(self, z: Array, drift: Array) -> Array:
        """Part of z' in the rows without an input that is beyond the chains of eq. (24).

        Args:
            z: Error state, (..., size).
            drift: Drift of z' there, (..., size).

        Returns:
            (..., size - m).
        """
        chains = self.linearization
        beyond = drift - np.einsum("ij,...j->...i", chains.A, z)
        return np.delete(beyond, chains.last_rows, axis=-1)

    def beside(self, reference: Array, x: ArrayLike, p: Any) -> Array:
        """z at states x (N, n) for reference values (N, size) there; returns (N, size)."""
        return self.sign * (self.outputs_along(x, p.plant) - reference)

    def reference_along(self, time: ArrayLike, parameters: Any) -> Array:
        """y_r and its derivatives below r_i at the instants (N,): (N, size)."""
        return self._reference_rows(time, parameters)[:, self.lower]

    def raised_along(self, t: ArrayLike, p: Any) -> Array:
        """Derivatives of the values of ``reference_along`` at the instants (N,): (N, size)."""
        derivatives = np.array(self.lower) + 1
        return self._reference_rows(t, p.reference)[:, derivatives]

    def _reference_rows(self, time: ArrayLike, parameters: Any) -> Array:
        """All values of the reference at the instants, a row for each.

        Raises:
            ArgumentError: If it or a derivative is not defined at one of them.
        """
        times = np.asarray(time, float)
        if not getattr(self.reference, "moves", True):
            values = np.array(self.reference(0.0, parameters))
            return np.tile(values, (len(times), 1))

        rows = []
        for t in times.tolist():
            try:
                rows.append(self.reference(t, parameters))
            except (ArithmeticError, ValueError) as error:
                raise ArgumentError(
                    f"the reference has no value or no derivative at t = {t:.6g} s ({error}): "
                    "give one that has them during the whole run"
                ) from error
        return np.array(rows)

    def placed(self, t: float, z: ArrayLike, p: Any) -> Array:
        """T(x) of every state with this error z, (size,); returns (size,)."""
        reference = self.reference_along([t], p.reference)[0]
        return reference + self.sign * np.asarray(z, float)


def regulated_outputs(error: Coordinates, owner: str) -> OutputCoordinates:
    """Return the error coordinates of a law or task that regulates outputs.

    Args:
        error: Error coordinates.
        owner: Name of the law or system, for the message.

    Raises:
        ArgumentError: If it regulates the whole state.
    """
    if not isinstance(error, OutputCoordinates):
        raise ArgumentError(f"{owner} has no outputs that it regulates")
    return error

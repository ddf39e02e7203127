"""The error state that a law regulates, and how the inputs move it: eqs. (17), (24) and (45)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.feedback_linearization import (
    FeedbackLinearization,
    feedback_linearization,
)
from grosmc_mj.control.references import ReferenceFunction
from grosmc_mj.control.vectors import Vector, each
from grosmc_mj.errors import PremiseError
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import System

_PER_SECOND = ("", "/s", "/s²", "/s³")


@dataclass(frozen=True, eq=False)
class ErrorCoordinates:
    """z = sign * (T(x) - [y_r, y_r', ...]), each output with its derivatives below r_i.

    It is the chapter's x for the servo (sign -1: theta_d - theta, eq. (17)), its z = T(x) for
    the pendulum (y_r = 0, eq. (22)) and its e for the arm (eq. (45)).

    Attributes:
        system: The plant's equations.
        reference: y_r(t) and its derivatives, from ``p.reference``.
        sign: +1 for y - y_r, -1 for y_r - y.
        outputs: y in symbols, as many as inputs; the system's own by default.
        guess: A state near which z determines x, (n,); zero by default. It matters where
            several states have the same outputs.
        unit: Unit of the outputs, if they are no states.
    """

    system: System
    reference: ReferenceFunction
    sign: Literal[1, -1] = 1
    outputs: tuple[Any, ...] | None = None
    guess: tuple[float, ...] | None = None
    unit: str = ""

    @cached_property
    def linearization(self) -> FeedbackLinearization:
        """T, K and E of the outputs.

        Raises:
            PremiseError: If they have no vector relative degree, or the reference another one.
        """
        chains = feedback_linearization(self.system.equations, self.outputs)
        degrees = getattr(self.reference, "degrees", chains.relative_degree)
        if degrees != chains.relative_degree:
            raise PremiseError(
                f"{self.system.name}: the outputs have relative degrees {chains.relative_degree}, "
                f"the reference has derivatives for {degrees}"
            )
        return chains

    @property
    def inputs(self) -> int:
        """m, the number of inputs and outputs."""
        return self.system.equations.inputs

    @property
    def size(self) -> int:
        """Number of entries of z."""
        return sum(self.linearization.relative_degree)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each entry of z."""
        chains = self.linearization
        states = dict(zip(chains.equations.x, self.system.states, strict=True))
        found = []
        for output, degree in zip(chains.h, chains.relative_degree, strict=True):
            unit = states[output].unit if output in states else self.unit
            found += [unit + _PER_SECOND[min(order, 3)] for order in range(degree)]
        return tuple(found)

    @property
    def output_rows(self) -> tuple[int, ...]:
        """Entries of z that are outputs' errors; the others are their derivatives."""
        return self.linearization.first_rows

    @cached_property
    def _lower(self) -> tuple[int, ...]:
        """Where the reference's values are that z is measured from."""
        places, first = [], 0
        for degree in self.linearization.relative_degree:
            places += range(first, first + degree)
            first += degree + 1
        return tuple(places)

    @cached_property
    def _highest(self) -> tuple[int, ...]:
        """Where the reference's derivatives of order r_i are."""
        return tuple((np.cumsum([r + 1 for r in self.linearization.relative_degree]) - 1).tolist())

    @cached_property
    def state(self) -> Callable[[float, Any, Any], Vector]:
        """Jitable (t, x, p) -> z, by the nominal ``p.plant``."""
        reference, transformation = self.reference, self.linearization.transformation
        difference = _signed_difference(self.size, float(self.sign), self._lower)

        def error_state(t: float, x: Any, p: Any) -> Vector:
            return difference(transformation(x, p.plant), reference(t, p.reference))

        return jitable(error_state)

    @cached_property
    def nonlinearity(self) -> Callable[[float, Any, Any], Vector]:
        """Jitable (t, x, p) -> alpha of z_i^(r_i) = alpha_i + (E u)_i, by the nominal plant.

        It is L_f^r h - y_r^(r) of eqs. (23) and (44).
        """
        reference, nonlinearity = self.reference, self.linearization.nonlinearity
        difference = _signed_difference(self.inputs, float(self.sign), self._highest)

        def error_nonlinearity(t: float, x: Any, p: Any) -> Vector:
            return difference(nonlinearity(x, p.plant), reference(t, p.reference))

        return jitable(error_nonlinearity)

    @cached_property
    def decoupling_matrix(self) -> Callable[[Any, Any], Vector]:
        """Jitable (x, p) -> E, row by row, by the nominal plant."""
        matrix, sign = self.linearization.decoupling_matrix, float(self.sign)
        if self.sign == 1:
            return jitable(lambda x, p: matrix(x, p.plant))
        negated = each(self.inputs**2, lambda i, E: sign * E[i])
        return jitable(lambda x, p: negated(matrix(x, p.plant)))

    @cached_property
    def driven(self) -> Callable[[float, Any, Vector, Any], Vector]:
        """Jitable (t, x, u, p) -> alpha + E u, the v that an input comes to by eqs. (24), (45)."""
        nonlinearity, matrix = self.nonlinearity, self.decoupling_matrix
        m = self.inputs

        def entry(i: int, alpha: Any, E: Any, u: Any) -> float:
            total = alpha[i]
            for j in range(m):
                total += E[i * m + j] * u[j]
            return total

        rows = each(m, entry)
        return jitable(lambda t, x, u, p: rows(nonlinearity(t, x, p), matrix(x, p), u))

    def dynamics(self, t: float, x: Any, p: Any) -> tuple[Array, Array]:
        """(alpha, E) of z_i^(r_i) = alpha_i + (E u)_i: (m,) and (m, m)."""
        alpha = np.array(self.nonlinearity(t, x, p))
        return alpha, np.reshape(self.decoupling_matrix(x, p), (self.inputs, self.inputs))

    def moved(
        self, t: float, x: Array, p: Any, plant: Any, w: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """(drift, gain) of z' = drift + gain u on a true plant, as the law sees it: eq. (24).

        z is what the nominal ``p.plant`` makes of x; x moves as the true plant makes it.

        Args:
            t: Time [s].
            x: State, (n,).
            p: The law's parameters, with ``plant`` and ``reference``.
            plant: Parameters of the true plant.
            w: Wrenches on it, (6 * bodies,); None for none.

        Returns:
            drift (size,) and gain (size, m).
        """
        equations = self.system.equations
        f = np.array(equations.drift(x, plant))
        if w is not None:
            f = f + np.array(equations.disturbance(x, np.asarray(w, float), plant))
        g = np.reshape(equations.input_matrix(x, plant), (len(f), -1))
        slope = np.reshape(self.linearization.slope(x, p.plant), (self.size, len(f)))
        raised = np.array(self.reference(t, p.reference))[[row + 1 for row in self._lower]]
        return self.sign * (slope @ f - raised), self.sign * slope @ g

    def pushed(self, x: Array, p: Any, plant: Any, w: ArrayLike) -> Array:
        """What a wrench on a true plant does to z', as the law sees it, (size,)."""
        d = np.array(self.system.equations.disturbance(x, np.asarray(w, float), plant))
        slope = np.reshape(self.linearization.slope(x, p.plant), (self.size, len(d)))
        return self.sign * slope @ d

    def unmatched(self, t: float, x: Array, p: Any, drift: Array) -> Array:
        """What a drift of z' does to the rows without an input, beyond the chains of eq. (24)."""
        chains = self.linearization
        z = np.array(self.state(t, x, p))
        return np.delete(drift - chains.A @ z, chains.last_rows)

    def along(self, time: ArrayLike, x: ArrayLike, parameters: Any) -> Array:
        """z at every sample of a trajectory: time (N,), x (N, n); returns (N, size)."""
        z = self.outputs_along(x, parameters.plant)
        return self.sign * (z - self.reference_along(time, parameters.reference))

    def outputs_along(self, x: ArrayLike, plant: Any) -> Array:
        """T(x) at every state of a trajectory, (N, n); returns (N, size)."""
        x, chains = np.asarray(x, float), self.linearization
        if chains.plain is not None:
            return x[:, chains.plain]
        return np.array([chains.transformation(row, plant) for row in x])

    def reference_along(self, time: ArrayLike, parameters: Any) -> Array:
        """What z is measured from at the instants (N,): y_r and its derivatives, (N, size)."""
        rows = [self.reference(t, parameters) for t in np.asarray(time, float).tolist()]
        return np.array(rows)[:, self._lower]

    def place(self, t: float, z: ArrayLike, p: Any, near: ArrayLike | None = None) -> Array:
        """A state with this error, with all else at rest, (n,).

        Args:
            t: Time [s].
            z: Error state, (size,).
            p: The law's parameters, with ``plant`` and ``reference``.
            near: Where to look, (n,); the coordinates' own guess by default.

        Raises:
            PremiseError: If there is none near the guess.
        """
        near = self.guess if near is None else near
        guess = np.zeros(len(self.system.states)) if near is None else np.array(near, float)
        lower = np.array(self.reference(t, p.reference))[list(self._lower)]
        return self.linearization.place(lower + self.sign * np.asarray(z, float), p.plant, guess)

    def jacobian(self, p: Any) -> tuple[Array, Array]:
        """(A, B) of the linearization of z' about z = 0 with the other coordinates at rest.

        Args:
            p: With ``plant`` and ``reference``, as the laws have them.

        Returns:
            A (size, size) and B (size, m).
        """
        chains, x = self.linearization, self.place(0.0, np.zeros(self.size), p)
        if self.inputs > 1 and not chains.complete:
            raise PremiseError(f"{self.system.name}: z leaves out a part of the state")
        seen, n = chains.seen, len(x)
        of_T = np.reshape(chains.slope(x, p.plant), (self.size, n))[:, seen]
        of_K = np.reshape(chains.nonlinearity_slope(x, p.plant), (self.inputs, n))[:, seen]
        A, B, rows = chains.A.copy(), np.zeros((self.size, self.inputs)), list(chains.last_rows)
        # Of alpha + E u at u = 0, through x = T^-1; a sign of z takes itself out.
        A[rows] = of_K @ np.linalg.inv(of_T)
        B[rows] = self.dynamics(0.0, x, p)[1]
        return A, B


def _signed_difference(
    count: int, sign: float, places: tuple[int, ...]
) -> Callable[[Any, Any], Vector]:
    """Jitable (values, reference) -> sign (values - the reference's entries at the places)."""
    return each(count, lambda i, values, y_r: sign * (values[i] - y_r[places[i]]))

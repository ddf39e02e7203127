"""The error state that a law regulates, and how the inputs move it: eqs. (17), (24) and (45)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arguments import reals, require
from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.base import (
    InputMap,
    OutputCoordinates,
    StateMap,
)
from grosmc_mj.control.coordinates.feedback_linearization import (
    FeedbackLinearization,
    feedback_linearization,
)
from grosmc_mj.control.matrices import divide, solve
from grosmc_mj.errors import ArgumentError, GainError, PremiseError, shown
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import Plant

# A rate that rounding could be, in the unit of z per second.
_AT_REST = 1e-9


@dataclass(frozen=True, eq=False)
class ErrorCoordinates(OutputCoordinates):
    """The errors of outputs in symbols: z = sign * (T(x) - [y_r, y_r', ...]).

    It is the chapter's x for the servo (sign -1: theta_d - theta, eq. (17)), its z = T(x) for
    the pendulum (y_r = 0, eq. (22)) and its e for the arm (eq. (45)).

    Attributes:
        guess: A state near which z determines x, (n,); zero by default. It matters where
            several states have the same outputs.
        unit: Unit of the outputs, if they are no states.
    """

    guess: tuple[float, ...] | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        require("unit", self.unit, str, "a text, such as 'rad'")
        if self.guess is not None:
            guess, n = reals(self.guess), len(self.system.states)
            if guess.shape != (n,) or not np.all(np.isfinite(guess)):
                raise ArgumentError(f"guess = {shown(self.guess)} must be {n} finite numbers")

    @cached_property
    def linearization(self) -> FeedbackLinearization:
        """T, K and E of the outputs.

        Raises:
            PremiseError: If they have no vector relative degree.
        """
        return feedback_linearization(self.system.equations, self.outputs)

    @property
    def output_units(self) -> tuple[str, ...]:
        """Unit of each output."""
        states = dict(zip(self.linearization.equations.x, self.system.states, strict=True))
        return tuple(states[y].unit if y in states else self.unit for y in self.linearization.h)

    @cached_property
    def state(self) -> StateMap:
        """Jitable (t, x, p, z): z = sign (T(x) - y_r), by the nominal ``p.plant``."""
        reference, transformation = self.reference, self.linearization.transformation
        sign, lower = float(self.sign), self._lower

        def error_state(t: float, x: Any, p: Any, z: Any) -> None:
            T, y_r = transformation(x, p.plant), reference(t, p.reference)
            for i in range(len(z)):
                z[i] = sign * (T[i] - y_r[lower[i]])

        return jitable(error_state)

    @cached_property
    def feedback(self) -> InputMap:
        """Jitable (t, x, v, memory, p, u): u = E^-1 (sign v - K + y_r^(r)), eqs. (23) and (44).

        It is not defined outside the system's region and where E is singular.
        """
        chains, linearizable = self.linearization, self.system.linearizable
        nonlinearity, matrix = chains.nonlinearity, chains.decoupling_matrix
        sign, highest, reference = float(self.sign), self._highest, self.reference
        solution = divide if self.inputs == 1 else solve

        def feedback(t: float, x: Any, v: Any, memory: Any, p: Any, u: Any) -> None:
            m = len(u)
            if linearizable(x):
                K, y_r = nonlinearity(x, p.plant), reference(t, p.reference)
                for i in range(m):
                    u[i] = sign * v[i] - (K[i] - y_r[highest[i]])
                if solution(matrix(x, p.plant), u):
                    return
            memory.undefined = 1.0
            for i in range(m):
                u[i] = 0.0

        return jitable(feedback)

    @cached_property
    def virtual_input(self) -> InputMap:
        """Jitable (t, x, u, memory, p, v): v = sign (K - y_r^(r) + E u), eqs. (24) and (45)."""
        chains, reference = self.linearization, self.reference
        nonlinearity, matrix = chains.nonlinearity, chains.decoupling_matrix
        sign, highest = float(self.sign), self._highest

        def virtual_input(t: float, x: Any, u: Any, memory: Any, p: Any, v: Any) -> None:
            m, K, E = len(v), nonlinearity(x, p.plant), matrix(x, p.plant)
            y_r = reference(t, p.reference)
            for i in range(m):
                v[i] = sign * (K[i] - y_r[highest[i]])
                for j in range(m):
                    v[i] += sign * E[i * m + j] * u[j]

        return jitable(virtual_input)

    def dynamics_along(self, t: Sequence[float], x: Array, p: Any) -> tuple[Array, Array]:
        """As for all coordinates."""
        chains, m = self.linearization, self.inputs
        K = _along(chains.nonlinearity, x, p.plant)
        E = np.reshape(_along(chains.decoupling_matrix, x, p.plant), (-1, m, m))
        y_r = np.array([self.reference(at, p.reference) for at in t])[:, self._highest]
        return self.sign * (K - y_r), self.sign * E

    def error_dynamics(
        self,
        t: Sequence[float],
        x: Array,
        p: Any,
        plant: Plant,
        w: Array | None = None,
        u: Array | None = None,
    ) -> tuple[Array, Array]:
        """As for all coordinates, by the true plant's own equations."""
        equations, true, slopes = plant.system.equations, plant.parameters, self._slopes(x, p)
        f = _along(equations.drift, x, true)
        g = np.reshape(_along(equations.input_matrix, x, true), (*f.shape, -1))
        drift = self.sign * (np.einsum("nij,nj->ni", slopes, f) - self.raised_along(t, p))
        if w is not None:
            drift = drift + self.disturbances(x, p, plant, w)
        return drift, self.sign * (slopes @ g)

    def disturbances(self, x: Array, p: Any, plant: Plant, w: Array) -> Array:
        """What wrenches (N, 6 * bodies) add to z' at states (N, n) of a true plant, (N, size)."""
        d = _along(plant.system.equations.disturbance, x, plant.parameters, w)
        return self.sign * np.einsum("nij,nj->ni", self._slopes(x, p), d)

    def _slopes(self, x: Array, p: Any) -> Array:
        """The Jacobians of T by the law's model, at states (N, n); returns (N, size, n)."""
        return np.reshape(_along(self.linearization.slope, x, p.plant), (len(x), self.size, -1))

    def outputs_along(self, x: ArrayLike, plant: Any) -> Array:
        """T(x) at every state of a trajectory, (N, n); returns (N, size)."""
        x, chains = np.asarray(x, float), self.linearization
        if chains.plain is not None:
            return x[:, chains.plain]
        return _along(chains.transformation, x, plant)

    def place(self, t: float, z: ArrayLike, p: Any, near: ArrayLike | None = None) -> Array:
        """A state with this error, with all else at rest or as it is near, (n,)."""
        near = self.guess if near is None else near
        guess = np.zeros(len(self.system.states)) if near is None else np.array(near, float)
        return self.linearization.place(self.placed(t, z, p), p.plant, guess)

    def require_task(self, plant: Plant, p: Any) -> None:
        """As for outputs; outputs whose E is singular at zero error are refused too."""
        super().require_task(plant, p)
        try:
            x = self.place(0.0, np.zeros(self.size), p)
        except (PremiseError, ArithmeticError, ValueError):  # it is not known where that is
            return
        self.linearization.require_regular(x, p.plant)

    def linear_model(self, plant: Plant, p: Any) -> tuple[Array, Array]:
        """(A, B) of the Jacobian linearization, with the other coordinates at rest.

        Raises:
            GainError: If zero error is no equilibrium without input.
            PremiseError: If the outputs do not determine the state.
        """
        name, chains = self.system.name, self.linearization
        x = self.place(0.0, np.zeros(self.size), p)
        alpha, E = self.dynamics(0.0, x, p)
        if np.abs(alpha).max() > _AT_REST:
            raise GainError(
                f"{name}: zero error is no equilibrium without input, z' = {alpha.tolist()} there: "
                "linearize by feedback instead"
            )
        if self.inputs > 1 and not chains.complete:
            raise PremiseError(f"{name}: z leaves out a part of the state")
        seen = [i for i, state in enumerate(chains.equations.x) if state not in chains.inner]
        of_T = np.reshape(chains.slope(x, p.plant), (self.size, len(x)))[:, seen]
        of_K = np.reshape(chains.nonlinearity_slope(x, p.plant), (self.inputs, len(x)))[:, seen]
        if not np.all(np.isfinite(of_T)) or np.linalg.matrix_rank(of_T) < self.size:
            raise PremiseError(
                f"{name}: the outputs' errors do not determine the state at x = {x.tolist()}: "
                "name an operating point with [plant] at, or linearize by feedback"
            )
        A, B, rows = chains.A.copy(), np.zeros((self.size, self.inputs)), list(chains.last_rows)
        # Of alpha + E u at u = 0, through x = T^-1; a sign of z takes itself out.
        A[rows], B[rows] = of_K @ np.linalg.inv(of_T), E
        return A, B


def _along(values: Callable[..., tuple[float, ...]], x: Array, p: Any, *w: Array) -> Array:
    """A generated function (x, w, p) at states (N, n) and wrenches (N, 6 * bodies).

    In Python's floats it is computed several times as fast as in NumPy's, which are for where the
    former have no value, as 1/0.
    """
    wrenches = [part.tolist() for part in w]
    try:
        return np.array([values(*row, p) for row in zip(x.tolist(), *wrenches, strict=True)])
    except ArithmeticError:
        return np.array([values(*row, p) for row in zip(x, *wrenches, strict=True)])

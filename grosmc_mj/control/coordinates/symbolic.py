"""The error state that a law regulates, and how the inputs move it: eqs. (17), (24) and (45)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.base import InputMap, OutputCoordinates, StateMap
from grosmc_mj.control.coordinates.feedback_linearization import (
    FeedbackLinearization,
    feedback_linearization,
)
from grosmc_mj.control.coordinates.torques import LinearTorques, torques_of
from grosmc_mj.control.matrices import regular, solve
from grosmc_mj.errors import ArgumentError, PremiseError
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import Plant
from grosmc_mj.plants.equations import Equations


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

    @cached_property
    def linearization(self) -> FeedbackLinearization:
        """T, K and E of the outputs.

        Raises:
            PremiseError: If they have no vector relative degree, or the reference another one.
        """
        chains = feedback_linearization(self.system.equations, self.outputs)
        self.require_derivatives(chains.relative_degree, "the outputs")
        return chains

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
        chains, linearizable, reference = (
            self.linearization,
            self.system.linearizable,
            self.reference,
        )
        nonlinearity, matrix = chains.nonlinearity, chains.decoupling_matrix
        sign, highest = float(self.sign), self._highest

        def feedback(t: float, x: Any, v: Any, memory: Any, p: Any, u: Any) -> None:
            m, E = len(u), matrix(x, p.plant)
            if not (linearizable(x) and regular(E, m)):
                memory.undefined = 1.0
                for i in range(m):
                    u[i] = 0.0
                return
            K, y_r = nonlinearity(x, p.plant), reference(t, p.reference)
            for i in range(m):
                u[i] = sign * v[i] - (K[i] - y_r[highest[i]])
            solve(E, u)

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

    def dynamics(self, t: float, x: Any, p: Any) -> tuple[Array, Array]:
        """(alpha, E) of z_i^(r_i) = alpha_i + (E u)_i: (m,) and (m, m)."""
        alpha, E = self.dynamics_along([t], np.asarray(x, float)[None], p)
        return alpha[0], E[0]

    def dynamics_along(self, t: Sequence[float], x: Array, p: Any) -> tuple[Array, Array]:
        """``dynamics`` at instants (N,) and states (N, n): (N, m) and (N, m, m)."""
        chains, m = self.linearization, self.inputs
        K = np.array(_along(x, lambda at: chains.nonlinearity(at, p.plant)))
        E = np.reshape(_along(x, lambda at: chains.decoupling_matrix(at, p.plant)), (-1, m, m))
        y_r = np.array([self.reference(at, p.reference) for at in t])[:, self._highest]
        return self.sign * (K - y_r), self.sign * E

    def moved(
        self,
        t: float,
        x: Array,
        p: Any,
        plant: Plant,
        w: ArrayLike | None = None,
        u: ArrayLike | None = None,
    ) -> tuple[Array, Array]:
        """As for every coordinates, by the true plant's own equations."""
        here = np.asarray(x, float)[None]
        pushed = None if w is None else np.asarray(w, float)[None]
        drift, gain = self.moved_along([t], here, p, plant, pushed)
        return drift[0], gain[0]

    def moved_along(
        self, t: Sequence[float], x: Array, p: Any, plant: Plant, w: Array | None = None
    ) -> tuple[Array, Array]:
        """``moved`` at instants (N,) and states (N, n), with wrenches (N, 6 * bodies).

        Returns:
            drift (N, size) and gain (N, size, m).
        """
        equations, true, slopes = plant.system.equations, plant.parameters, self.slopes(x, p)
        drift, gain = self.moved_by(equations, x, true, slopes, self.raised_along(t, p))
        if w is None:
            return drift, gain
        return drift + self.pushed_by(equations, x, true, w, slopes), gain

    def slopes(self, x: Array, p: Any) -> Array:
        """The Jacobians of T by the law's model, at states (N, n); returns (N, size, n)."""
        slope = self.linearization.slope
        rows = _along(x, lambda at: slope(at, p.plant))
        return np.reshape(rows, (len(x), self.size, -1))

    def moved_by(
        self, equations: Equations, x: Array, plant: Any, slopes: Array, raised: Array
    ) -> tuple[Array, Array]:
        """``moved`` at states (N, n) by equations and a true plant's parameters.

        Args:
            equations: The true plant's.
            x: States, (N, n).
            plant: Its parameters.
            slopes: Of T by the law's model, (N, size, n).
            raised: Derivatives of what z is measured from, (N, size).

        Returns:
            (N, size) and (N, size, m).
        """
        drift, matrix = equations.drift, equations.input_matrix
        f = np.array(_along(x, lambda at: drift(at, plant)))
        g = np.reshape(_along(x, lambda at: matrix(at, plant)), (*f.shape, -1))
        moved = np.einsum("nij,nj->ni", slopes, f) - raised
        return self.sign * moved, self.sign * (slopes @ g)

    def pushed_by(
        self, equations: Equations, x: Array, plant: Any, w: Array, slopes: Array
    ) -> Array:
        """What wrenches (N, 6 * bodies) do to z' at states (N, n), as the law sees it, (N, size).

        Other arguments are as those of ``moved_by``.
        """
        d = _along(x, lambda here, wrench: equations.disturbance(here, wrench, plant), w)
        return self.sign * np.einsum("nij,nj->ni", slopes, np.array(d))

    def outputs_along(self, x: ArrayLike, plant: Any) -> Array:
        """T(x) at every state of a trajectory, (N, n); returns (N, size)."""
        x, chains = np.asarray(x, float), self.linearization
        if chains.plain is not None:
            return x[:, chains.plain]
        return np.array(_along(x, lambda at: chains.transformation(at, plant)))

    def place(self, t: float, z: ArrayLike, p: Any, near: ArrayLike | None = None) -> Array:
        """A state with this error, with all else at rest or as it is near, (n,)."""
        near = self.guess if near is None else near
        guess = np.zeros(len(self.system.states)) if near is None else np.array(near, float)
        return self.linearization.place(self.placed(t, z, p), p.plant, guess)

    def torques(self, body: str | None = None) -> LinearTorques:
        """As for every coordinates: all parameters of the plant's torques are unknown.

        Args:
            body: None, for there is none to choose.

        Raises:
            ArgumentError: If a body is given.
            PremiseError: If the system has no parametrization, or other outputs than its joints.
        """
        name, found = self.system.name, self.system.parametrization
        joints = list(self.system.equations.x[: self.inputs]) if found else []
        if found is None or list(found.x[: self.inputs]) != joints:
            return super().torques(body)
        if body is not None:
            raise ArgumentError(f"adaptive: {name} has no body to choose: all of it is adapted")
        if list(self.linearization.h) != joints:
            raise PremiseError(
                f"adaptive: the outputs of {name} must be its joints, {', '.join(map(str, joints))}"
            )
        return torques_of(found)

    def require_regular(self, p: Any) -> None:
        """Refuse outputs whose E is singular at zero error, as far as a state with it is found."""
        try:
            x = self.place(0.0, np.zeros(self.size), p)
        except (PremiseError, ArithmeticError, ValueError, AttributeError, TypeError):
            return
        self.linearization.require_regular(x, p.plant)

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
        if not np.all(np.isfinite(of_T)) or np.linalg.matrix_rank(of_T) < self.size:
            raise PremiseError(
                f"{self.system.name}: the outputs' errors do not determine the state at "
                f"x = {x.tolist()}, where they are linearized: name an operating point with "
                "[plant] at, or linearize by feedback"
            )
        A, B, rows = chains.A.copy(), np.zeros((self.size, self.inputs)), list(chains.last_rows)
        # Of alpha + E u at u = 0, through x = T^-1; a sign of z takes itself out.
        A[rows] = of_K @ np.linalg.inv(of_T)
        B[rows] = self.dynamics(0.0, x, p)[1]
        return A, B


def _at(x: Any, values: Callable[[Any], tuple[float, ...]]) -> tuple[float, ...]:
    """What a generated function gives at a state.

    In Python's floats it is computed several times as fast as in NumPy's, which are for where the
    former have no value, as 1/0.
    """
    try:
        return values(np.asarray(x, float).tolist())
    except ArithmeticError:
        return values(x)


def _along(
    x: Array, values: Callable[..., tuple[float, ...]], *beside: ArrayLike
) -> list[tuple[float, ...]]:
    """The same at states (N, n), each with its row of what is beside them."""
    own = [np.asarray(each, float).tolist() for each in beside]
    try:
        return [values(*row) for row in zip(x.tolist(), *own, strict=True)]
    except ArithmeticError:
        rows = zip(x, *own, strict=True)
        return [_at(here, lambda at, row=row: values(at, *row)) for here, *row in rows]

"""Error coordinates of outputs in symbols, and their dynamics: eqs. (17), (24) and (45)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arguments import reals
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ArgumentError, GainError, PremiseError, array_text, value_text
from grosmc_mj.ground.fields import Is
from grosmc_mj.theory.control.coordinates.base import InputMap, OutputCoordinates, StateMap
from grosmc_mj.theory.control.coordinates.design_model import Advance, DesignModel, midpoint
from grosmc_mj.theory.control.coordinates.feedback_linearization import (
    FeedbackLinearization,
    feedback_linearization,
)
from grosmc_mj.theory.control.lqr import LqrDesign
from grosmc_mj.theory.control.matrices import divide, solve
from grosmc_mj.theory.plants import Plant, System
from grosmc_mj.theory.plants.runge_kutta import state_derivative

# A rate that rounding could be, in the unit of z per second.
_AT_REST = 1e-9


@dataclass(frozen=True, eq=False)
class ErrorCoordinates(OutputCoordinates):
    """Errors of outputs in symbols: z = sign * (T(x) - [y_r, y_r', ...]).

    It is the chapter's x for the servo (sign -1: theta_d - theta, eq. (17)), its z = T(x) for
    the pendulum (y_r = 0, eq. (22)) and its e for the arm (eq. (45)).

    Attributes:
        guess: A state near which z determines x, (n,); zero by default. It matters where
            several states have the same outputs.
        unit: Unit of the outputs that are no states.
    """

    guess: tuple[float, ...] | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        Is(str, "a text, such as 'rad'").require("unit", self.unit)
        if self.guess is not None:
            guess = reals(self.guess)
            n = len(self.system.states)
            if guess.shape != (n,) or not np.all(np.isfinite(guess)):
                raise ArgumentError(f"guess = {value_text(self.guess)} must be {n} finite numbers")

    # sympy takes up to 0.3 s; a law is compiled again for each new function.
    @cached_property
    def linearization(self) -> FeedbackLinearization:
        """T, K and E of the outputs.

        Raises:
            PremiseError: If they have no vector relative degree.
        """
        return feedback_linearization(self.system.symbolic_equations, self.outputs)

    @property
    def output_units(self) -> tuple[str, ...]:
        """Unit of each output."""
        chains = self.linearization
        units = [state.unit for state in self.system.states]
        unit_of_state = dict(zip(chains.equations.x, units, strict=True))
        return tuple(unit_of_state.get(output, self.unit) for output in chains.h)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states that z consists of; other entries are named by their output."""
        return error_names(self.linearization, self.system)

    @cached_property
    def state(self) -> StateMap:
        """Jitable (t, x, p, z): z = sign (T(x) - y_r), by the nominal ``p.plant``."""
        reference = self.reference
        transformation = self.linearization.transformation
        sign = float(self.sign)
        lower = self.lower

        def error_state(t: float, x: Any, p: Any, z: Any) -> None:
            T = transformation(x, p.plant)
            y_r = reference(t, p.reference)
            for i in range(len(z)):
                z[i] = sign * (T[i] - y_r[lower[i]])

        return jitable(error_state)

    @cached_property
    def feedback(self) -> InputMap:
        """Jitable (t, x, v, memory, p, u): u = E^-1 (sign v - K + y_r^(r)), eqs. (23) and (44).

        It is not defined outside the system's region and where E is singular.
        """
        reference = self.reference
        nonlinearity = self.linearization.nonlinearity
        decoupling_matrix = self.linearization.decoupling_matrix
        linearizable = self.system.linearizable
        sign = float(self.sign)
        highest = self._highest
        divide_by = divide if self.inputs == 1 else solve

        def feedback(t: float, x: Any, v: Any, memory: Any, p: Any, u: Any) -> None:
            m = len(u)
            if linearizable(x):
                K = nonlinearity(x, p.plant)
                y_r = reference(t, p.reference)
                for i in range(m):
                    u[i] = sign * v[i] - (K[i] - y_r[highest[i]])
                if divide_by(decoupling_matrix(x, p.plant), u):
                    return

            memory.undefined = 1.0
            for i in range(m):
                u[i] = 0.0

        return jitable(feedback)

    @cached_property
    def virtual_input(self) -> InputMap:
        """Jitable (t, x, u, memory, p, v): v = sign (K - y_r^(r) + E u), eqs. (24) and (45)."""
        reference = self.reference
        nonlinearity = self.linearization.nonlinearity
        decoupling_matrix = self.linearization.decoupling_matrix
        sign = float(self.sign)
        highest = self._highest

        def virtual_input(t: float, x: Any, u: Any, memory: Any, p: Any, v: Any) -> None:
            m = len(v)
            K = nonlinearity(x, p.plant)
            E = decoupling_matrix(x, p.plant)
            y_r = reference(t, p.reference)
            for i in range(m):
                v[i] = sign * (K[i] - y_r[highest[i]])
                for j in range(m):
                    v[i] += sign * E[i * m + j] * u[j]

        return jitable(virtual_input)

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
        chains = self.linearization
        m = self.inputs
        K = _along(chains.nonlinearity, x, p.plant)
        E = _along(chains.decoupling_matrix, x, p.plant).reshape(-1, m, m)
        y_r = np.array([self.reference(instant, p.reference) for instant in t])
        alpha = K - y_r[:, self._highest]
        return self.sign * alpha, self.sign * E

    def error_dynamics(
        self,
        t: Sequence[float],
        x: Array,
        p: Any,
        plant: Plant,
        w: Array | None = None,
        u: Array | None = None,
    ) -> tuple[Array, Array]:
        """(drift, gain) of z' = drift + gain u by the true plant's equations, eq. (24).

        Args:
            t: Times [s], (N,).
            x: States, (N, n).
            p: The law's parameters, with ``plant`` and ``reference``.
            plant: The true plant.
            w: Wrenches on it, (N, 6 * bodies); None for none.
            u: Inputs, which equations do not use.

        Returns:
            drift (N, size) and gain (N, size, m).
        """
        equations = plant.system.symbolic_equations
        f = _along(equations.drift, x, plant.parameters)
        g = _along(equations.input_matrix, x, plant.parameters)
        g = g.reshape(*f.shape, -1)

        slopes = self._slopes(x, p)
        output_rates = np.einsum("nij,nj->ni", slopes, f)
        drift = self.sign * (output_rates - self.raised_along(t, p))
        if w is not None:
            drift = drift + self.disturbances(x, p, plant, w)
        return drift, self.sign * (slopes @ g)

    def disturbances(
        self,
        x: Array,
        p: Any,
        plant: Plant,
        w: Array,
    ) -> Array:
        """Part of z' by wrenches on a true plant.

        Args:
            x: States, (N, n).
            p: The law's parameters, with ``plant``.
            plant: The true plant.
            w: Wrenches on it, (N, 6 * bodies).

        Returns:
            (N, size).
        """
        d = _along(plant.system.symbolic_equations.disturbance, x, plant.parameters, w)
        return self.from_rates(x, p, d)

    def from_rates(self, x: Array, p: Any, rates: Array) -> Array:
        """Part of z' by added rates of the states, (N, n), see ``Coordinates``."""
        output_rates = np.einsum("nij,nj->ni", self._slopes(x, p), rates)
        return self.sign * output_rates

    def _slopes(self, x: Array, p: Any) -> Array:
        """Jacobians of T by the law's model, at states (N, n); returns (N, size, n)."""
        slopes = _along(self.linearization.slope, x, p.plant)
        return slopes.reshape(len(x), self.size, -1)

    def outputs_along(self, x: ArrayLike, plant: Any) -> Array:
        """T(x) at every state of a trajectory, (N, n); returns (N, size)."""
        x = np.asarray(x, float)
        chains = self.linearization
        if chains.plain is not None:
            return x[:, chains.plain]
        return _along(chains.transformation, x, plant)

    def place(
        self,
        t: float,
        z: ArrayLike,
        p: Any,
        near: ArrayLike | None = None,
    ) -> Array:
        """State with this error, with the inner states of ``near``, (n,)."""
        if near is None:
            near = self.guess
        if near is None:
            near = np.zeros(len(self.system.states))
        T = self.placed(t, z, p)
        return self.linearization.place(T, p.plant, np.array(near, float))

    def require_task(self, plant: Plant, p: Any) -> None:
        """Refuse a task as for all outputs, and if E is singular at zero error."""
        super().require_task(plant, p)
        try:
            x = self.place(0.0, np.zeros(self.size), p)
        except (PremiseError, ArithmeticError, ValueError):  # no state of zero error was found
            return
        self.linearization.require_regular(x, p.plant)

    def design_model(self, optimum: LqrDesign, p: Any) -> DesignModel:
        """The nominal equations under no wrench, moved by the midpoint rule."""
        scratch = np.zeros(2 * len(self.system.states))
        no_wrench = np.zeros(max(1, 6 * len(self.system.bodies)))
        return DesignModel(self._motion, np.concatenate([scratch, no_wrench]))

    # Made once for the coordinates: loops are compiled for it.
    @cached_property
    def _motion(self) -> Advance:
        """Motion of the nominal equations."""
        equations = state_derivative(self.system)

        @jitable
        def slope_at(x: Any, u: Any, no_wrench: Any, p: Any, slope: Any) -> None:
            equations(x, u, no_wrench, p.plant, slope)

        return midpoint(slope_at)

    def linear_model(self, plant: Plant, p: Any) -> tuple[Array, Array]:
        """(A, B) of the Jacobian linearization, with the inner states at rest.

        Raises:
            GainError: If zero error is no equilibrium without input.
            PremiseError: If the outputs do not determine the state.
        """
        chains = self.linearization
        x = self.place(0.0, np.zeros(self.size), p)
        alpha, E = self.dynamics(0.0, x, p)
        if np.abs(alpha).max() > _AT_REST:
            raise GainError(
                f"{self.system.name}: zero error is no equilibrium without input, "
                f"z' = {array_text(alpha)} there: linearize by feedback, with law = "
                '"fl-lqr" in a table [laws.NAME] and law = "NAME" in [[controller]]'
            )

        # alpha + E u depends on z through x = T^-1(z), at u = 0; a sign of z cancels.
        slope_of_T, slope_of_K = self._outer_slopes(x, p)
        last_rows = list(chains.last_rows)
        A = chains.A
        A[last_rows] = slope_of_K @ np.linalg.inv(slope_of_T)
        B = np.zeros((self.size, self.inputs))
        B[last_rows] = E
        return A, B

    def _outer_slopes(self, x: Array, p: Any) -> tuple[Array, Array]:
        """Jacobians of T (size, size) and of K (m, size) by the states that z determines.

        Raises:
            PremiseError: If the outputs do not determine the state.
        """
        name = self.system.name
        chains = self.linearization
        if self.inputs > 1 and not chains.complete:
            raise PremiseError(f"{name}: z leaves out a part of the state")

        states = chains.equations.x
        outer = [i for i, state in enumerate(states) if state not in chains.inner]
        slope_of_T = np.reshape(chains.slope(x, p.plant), (self.size, -1))[:, outer]
        slope_of_K = np.reshape(chains.nonlinearity_slope(x, p.plant), (self.inputs, -1))
        finite = np.all(np.isfinite(slope_of_T))
        if not finite or np.linalg.matrix_rank(slope_of_T) < self.size:
            raise PremiseError(
                f"{name}: the outputs' errors do not determine the state at x = {array_text(x)}: "
                "name an operating point with [plant] at, or linearize by feedback"
            )
        return slope_of_T, slope_of_K[:, outer]


def error_names(chains: FeedbackLinearization, system: System) -> tuple[str, ...]:
    """Name of each entry of T(x): of a state, or of an output by its number.

    Args:
        chains: Feedback linearization of the outputs.
        system: The system with the states.
    """
    names_of_states = [state.name for state in system.states]
    name_of_state = dict(zip(chains.equations.x, names_of_states, strict=True))

    names: list[str] = []
    for index, degree in enumerate(chains.relative_degree):
        output = f"output {index + 1}"
        for order in range(degree):
            entry = chains.T[len(names)]
            name = name_of_state.get(entry, _derivative_name(output, order))
            if order == 0:
                output = name
            names.append(name)
    return tuple(names)


def _derivative_name(output: str, order: int) -> str:
    """Name of a derivative of an output that is no state."""
    if order == 0:
        return output
    if order == 1:
        return f"{output} rate"
    return f"{output} rate {order}"


def _along(
    values: Callable[..., tuple[float, ...]],
    x: Array,
    p: Any,
    *w: Array,
) -> Array:
    """Values of a generated function (x, w, p) at states (N, n) and wrenches (N, 6 * bodies).

    Python's floats are several times as fast as NumPy's, which are taken where Python raises an
    error, as for 1/0.
    """
    wrenches = [part.tolist() for part in w]
    rows = zip(x.tolist(), *wrenches, strict=True)
    try:
        return np.array([values(*row, p) for row in rows])
    except ArithmeticError:
        rows = zip(x, *wrenches, strict=True)
        return np.array([values(*row, p) for row in rows])

"""Feedback linearization of an affine plant, from its equations in sympy: section 3.2, 4.2."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated, Any, NamedTuple

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.codegen import generate
from grosmc_mj.ground.errors import PremiseError, array_text, value_text
from grosmc_mj.ground.fields import Is, checked_call
from grosmc_mj.theory.control.coordinates.base import Chains
from grosmc_mj.theory.plants.equations import Equations, Expressions

# Rounding of a rate, and of a sum of terms of size one.
_ROUNDING = 1e-9
# Random points at which an expression is evaluated before it is taken for zero: no expression of
# the plants vanishes at all of these without being zero.
_POINTS = 200


# Jitable (x, p) -> numbers, of states and the plant's parameters.
StateFunction = Callable[[Any, Any], tuple[float, ...]]


@dataclass(frozen=True, eq=False)
class ZeroDynamics:
    """Motion of the inner states while the outputs are held at zero.

    Attributes:
        states: The inner states xi, which z leaves out.
        rates: xi' with the outputs and their derivatives held at zero.
    """

    states: tuple[sp.Symbol, ...]
    rates: tuple[sp.Expr, ...]

    def poles(self, parameters: Any) -> NDArray[np.complex128]:
        """Eigenvalues of the linearization about xi = 0 [1/s]; stable with none on the right.

        Args:
            parameters: The plant's numbers.

        Raises:
            PremiseError: If xi = 0 is no equilibrium.
        """
        rates = sp.Matrix(self.rates)
        symbols = rates.free_symbols - set(self.states)
        values = {symbol: getattr(parameters, str(symbol)) for symbol in symbols}
        rates_at_zero = self._at_zero(rates, values)
        slope = self._at_zero(rates.jacobian(self.states), values)
        if np.abs(rates_at_zero).max() > _ROUNDING:
            raise PremiseError(
                "the zero dynamics are not at rest at zero: rates "
                f"{array_text(rates_at_zero.ravel())}"
            )
        return np.linalg.eigvals(slope).astype(complex)

    def _at_zero(self, matrix: Any, values: dict[Any, Any]) -> Array:
        """Value of a matrix of expressions at xi = 0."""
        zero = dict.fromkeys(self.states, 0)
        numbers = matrix.subs(values).subs(zero).evalf()
        return np.array(numbers, float)


@dataclass(frozen=True, eq=False)
class FeedbackLinearization(Chains):
    """z = T(x) and u = E(x)^-1 (v - K(x)), which make z' = A z + B v of an affine plant.

    Attributes:
        equations: The plant.
        h: Its outputs, one for each input.
        T: z of eq. (22): each output and its derivatives below r_i.
        K: L_f^r_i h_i of eq. (23), m expressions.
        E: Decoupling matrix of eq. (21), (m, m).
    """

    equations: Equations
    h: tuple[Any, ...]
    T: tuple[Any, ...]
    K: tuple[Any, ...]
    E: Any

    @property
    def complete(self) -> bool:
        """Whether z is all of the state: sum r = n, Assumption 7."""
        return sum(self.relative_degree) == len(self.equations.x)

    @property
    def singularity(self) -> Any:
        """Numerator of det E(x), in lowest terms: where it is zero, no input makes v."""
        determinant = sp.factor(sp.simplify(_determinant(self.E)))
        numerator, _ = sp.fraction(determinant)
        return sp.factor(numerator)

    # The functions are cached, as a law is compiled for each of them anew.

    # Functions are generated on first use, and once: a law is compiled again for each new one.
    @cached_property
    def transformation(self) -> StateFunction:
        """Jitable (x, p) -> T(x)."""
        return self._generate("transformation", self.T)

    @cached_property
    def nonlinearity(self) -> StateFunction:
        """Jitable (x, p) -> K(x)."""
        return self._generate("nonlinearity", self.K)

    @cached_property
    def decoupling_matrix(self) -> StateFunction:
        """Jitable (x, p) -> E(x) row by row."""
        return self._generate("decoupling_matrix", self.E.flat())

    @cached_property
    def slope(self) -> StateFunction:
        """Jitable (x, p) -> the Jacobian of T at x, row by row."""
        slopes = sp.Matrix(self.T).jacobian(self.equations.x)
        return self._generate("slope", tuple(slopes))

    @cached_property
    def nonlinearity_slope(self) -> StateFunction:
        """Jitable (x, p) -> the Jacobian of K at x, row by row."""
        slopes = sp.Matrix(self.K).jacobian(self.equations.x)
        return self._generate("nonlinearity_slope", tuple(slopes))

    def _generate(self, name: str, expressions: Sequence[Any]) -> StateFunction:
        return generate(name, expressions, "x, p", self.equations.places())

    def require_regular(self, x: Array, p: Any) -> None:
        """Refuse a state at which no input makes every v.

        Args:
            x: State, (n,).
            p: The plant's numbers.

        Raises:
            PremiseError: If E is singular there, with E and what is possible instead.
        """
        if not self._singular_at(x, p):
            return

        single = self.equations.inputs == 1
        E = self.E[0] if single else self.E.tolist()
        raise PremiseError(
            f"feedback linearization is not possible about x = {array_text(np.round(x, 9))}: the "
            f"decoupling matrix E = {value_text(E, str)} of {', '.join(map(str, self.h))}, of "
            f"relative degree {self.relative_degree}, is singular there (eq. (21)). Possible are "
            "lqr and linear-grosmc on the linearization, about an operating point ([plant] at, a "
            "state_task); and laws of an approximation that has a relative degree ([design] plant)"
        )

    def _singular_at(self, x: Array, p: Any) -> bool:
        """Whether E has a value at a state and is singular there, in any units."""
        E = self._decoupling_matrix_at(x, p)
        if not np.all(np.isfinite(E)):
            return False

        # Sizes of the entries at the state and at states nearby give E units in which no entry is
        # above one.
        steps = 0.1 * np.eye(len(x))
        matrices = [E]
        for state in (*(x - steps), *(x + steps)):
            nearby = self._decoupling_matrix_at(state, p)
            if np.all(np.isfinite(nearby)):
                matrices.append(nearby)
        sizes = np.abs(matrices)
        tiny = np.finfo(float).tiny
        rows = sizes.max(axis=(0, 2))[:, None] + tiny
        columns = (sizes / rows).max(axis=(0, 1)) + tiny

        scaled = E / rows / columns
        least = np.linalg.svd(scaled, compute_uv=False).min()
        return not least > _ROUNDING

    def _decoupling_matrix_at(self, x: Array, p: Any) -> Array:
        """E(x), (m, m); NaN outside the domain of a function in it."""
        m = self.equations.inputs
        try:
            return np.reshape(self.decoupling_matrix(x, p), (m, m))
        except (ArithmeticError, ValueError):
            return np.full((m, m), np.nan)

    def place(self, z: Array, p: Any, guess: Array) -> Array:
        """State with T(x) = z and the inner states of ``guess``.

        Args:
            z: Transformed state, (sum r,).
            p: The plant's numbers.
            guess: State from which the search starts, (n,).

        Raises:
            PremiseError: If there is none near the guess.
        """
        x = np.array(guess, float)
        if self.plain is not None:
            x[self.plain] = z
            return x

        # Imported where it is needed, because it takes time and little else uses it.
        import scipy.optimize

        states = self.equations.x
        outer = [i for i, state in enumerate(states) if state not in self.inner]

        # The root finder takes functions of the outer states only.
        def residual(values: Array) -> Array:
            x[outer] = values
            return np.array(self.transformation(x, p)) - z

        def slope(values: Array) -> Array:
            x[outer] = values
            slopes = np.reshape(self.slope(x, p), (len(self.T), -1))
            return slopes[:, outer]

        try:
            root = scipy.optimize.root(residual, x[outer], jac=slope, tol=1e-13)
            missed = float(np.abs(residual(root.x)).max())
        except (ArithmeticError, ValueError):  # outside the domain of a function in T
            missed = np.inf
        size = max(1.0, float(np.abs(z).max()))
        if missed > 1e-9 * size:
            raise PremiseError(
                f"no state near {array_text(np.asarray(guess))} has z = {array_text(z)}"
            )
        return x

    # Asked at every state of a grid.
    @cached_property
    def plain(self) -> list[int] | None:
        """Indices of the states that z consists of; None if an entry of z is no state."""
        states = list(self.equations.x)
        if not all(entry in states for entry in self.T):
            return None
        return [states.index(entry) for entry in self.T]

    # Asked at every state of a grid.
    @cached_property
    def inner(self) -> tuple[sp.Symbol, ...]:
        """States that complete z to a transformation of the whole state."""
        points = _points(self.equations)
        point = {symbol: values[0] for symbol, values in points.items()}
        states = self.equations.x
        slopes = sp.Matrix(self.T).jacobian(states)
        rows = np.array(slopes.subs(point).evalf(), float)

        inner = []
        for state, unit_row in zip(states, np.eye(len(states)), strict=True):
            wider = np.vstack([rows, unit_row])
            if np.linalg.matrix_rank(wider) > len(rows):
                rows = wider
                inner.append(state)
        return tuple(inner)

    def zero_dynamics(self) -> ZeroDynamics | None:
        """Zero dynamics: motion of the inner states while y = 0; None if z is the whole state.

        Raises:
            PremiseError: If sympy cannot solve T(x) = 0, or finds several branches.
        """
        if self.complete:
            return None
        outer = [x for x in self.equations.x if x not in self.inner]
        solutions = sp.solve(self.T, outer, dict=True)
        if len(solutions) != 1:
            raise PremiseError(f"T(x) = 0 has {len(solutions)} branches for {outer}: {solutions}")

        # The input that holds the outputs at zero makes v = 0.
        u = -self.E.inv() * sp.Matrix(self.K)
        f = sp.Matrix(self.equations.f)
        g = sp.Matrix(self.equations.g)
        rates = (f + g * u).subs(solutions[0])
        rows = [self.equations.x.index(x) for x in self.inner]
        return ZeroDynamics(self.inner, tuple(sp.simplify(rates[row]) for row in rows))


@checked_call
def feedback_linearization(
    equations: Annotated[Equations, Is(Equations, "Equations of a plant, such as plant.system's")],
    h: Expressions | None = None,
) -> FeedbackLinearization:
    """Differentiate each output until an input appears: eqs. (21)-(25) and (43)-(46).

    Args:
        equations: The plant.
        h: Outputs, as many as it has inputs; its own by default.

    Raises:
        PremiseError: If an output has no relative degree, or E is singular everywhere.
    """
    return _linearized(equations, equations.h if h is None else h)


# Cached, because sympy takes seconds and all laws of a plant ask for it.
@lru_cache(maxsize=64)
def _linearized(equations: Equations, outputs: tuple[sp.Expr, ...]) -> FeedbackLinearization:
    """Feedback linearization of a plant for its outputs."""
    m = equations.inputs
    if len(outputs) != m:
        raise PremiseError(f"{len(outputs)} outputs for {m} inputs: E(x) must be square, eq. (21)")

    degrees: list[int] = []
    T: list[Any] = []
    K: list[Any] = []
    E: list[Any] = []
    for index, output in enumerate(outputs):
        chain = _differentiated(equations, index, output)
        degrees.append(len(chain.derivatives))
        T += chain.derivatives
        K.append(chain.drift)
        E.append(chain.gains)

    matrix = sp.ImmutableMatrix(E)
    if is_zero(_determinant(matrix), equations):
        raise PremiseError(
            f"the decoupling matrix E(x) = {array_text(matrix)} is singular everywhere, so the "
            f"vector relative degree {tuple(degrees)} is not defined (eq. (21))"
        )
    return FeedbackLinearization(
        tuple(degrees),
        equations,
        outputs,
        T=tuple(T),
        K=tuple(K),
        E=matrix,
    )


class _Chain(NamedTuple):
    """An output, differentiated until an input appears: y^(r) = drift + gains u.

    Attributes:
        derivatives: y, y' ... y^(r - 1).
        drift: L_f^r y.
        gains: L_g L_f^(r - 1) y, of each input.
    """

    derivatives: list[Any]
    drift: Any
    gains: list[Any]


def _differentiated(equations: Equations, index: int, output: sp.Expr) -> _Chain:
    """Differentiate an output until an input appears.

    Raises:
        PremiseError: If none appears in as many derivatives as there are states.
    """
    f = sp.Matrix(equations.f)
    g = sp.Matrix(equations.g)
    derivatives: list[Any] = []
    derivative: Any = output
    while len(derivatives) < len(equations.x):
        derivatives.append(derivative)
        slope = sp.Matrix([derivative]).jacobian(equations.x)
        gains = slope * g
        derivative = (slope * f)[0]
        if not all(is_zero(gain, equations) for gain in gains):
            return _Chain(derivatives, derivative, list(gains))

    raise PremiseError(
        f"output {index + 1}, {output}, has no relative degree: no input appears in "
        f"its first {len(derivatives)} derivatives (section 3.2, Assumption 7)"
    )


def _determinant(matrix: Any) -> Any:
    """Determinant by minors: sympy's own methods simplify at every step, which takes seconds."""
    if matrix.rows == 1:
        return matrix[0, 0]
    terms = []
    for j in range(matrix.rows):
        minor = _determinant(matrix.minor_submatrix(0, j))
        terms.append((-1) ** j * matrix[0, j] * minor)
    return sp.Add(*terms)


def is_zero(expression: sp.Expr, equations: Equations) -> bool:
    """Whether an expression vanishes at all random points, against the size of its terms.

    Raises:
        PremiseError: If it has no value at any of the points.
    """
    if expression.is_zero:
        return True

    points = _points(equations)
    terms_of_sum = list(sp.Add.make_args(expression))
    evaluate = sp.lambdify(list(points), terms_of_sum, "numpy")
    with np.errstate(all="ignore"):
        values = evaluate(*points.values())
        terms = np.array([np.broadcast_to(term, _POINTS) for term in values])
    defined = np.all(np.isfinite(terms), axis=0)
    terms = terms[:, defined]
    if not terms.size:
        raise PremiseError(f"{expression} has no real value at {_POINTS} random points")

    sums = np.abs(terms.sum(axis=0))
    rounding = _ROUNDING * np.abs(terms).sum(axis=0)
    return bool(np.all(sums <= rounding))


def _points(equations: Equations) -> dict[sp.Symbol, Array]:
    """Random states and parameters, (points,) each, alternately of two sizes.

    Most parameters of plants are positive: at every second point all of them are, at the points
    between they have random signs.
    """
    random = np.random.default_rng(0)
    symbols = (*equations.x, *equations.parameters)
    small = np.arange(_POINTS) % 2 == 0
    shape = (len(symbols), _POINTS)
    sizes = np.where(small, 1.0, 4.0) * random.uniform(0.2, 1, shape)
    signs = random.choice([-1, 1], shape)
    signs[len(equations.x) :, small] = 1
    return dict(zip(symbols, signs * sizes, strict=True))

"""Feedback linearization of an affine plant, from its equations in sympy: section 3.2, 4.2."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated, Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.codegen import generate
from grosmc_mj.control.coordinates.base import Chains
from grosmc_mj.errors import PremiseError, shown
from grosmc_mj.fields import Is, checked_call
from grosmc_mj.plants.equations import Equations, Expressions

# Rounding of a rate, and of a sum of terms of size one.
_ROUNDING = 1e-9
# Random points at which an expression is tried before it is called zero: no expression of the
# plants vanishes at all of these without being zero.
_POINTS = 200


@dataclass(frozen=True, eq=False)
class ZeroDynamics:
    """What goes on inside while the outputs are held at zero.

    Attributes:
        states: The states xi that the outputs leave out.
        rates: xi' with the outputs and their derivatives held at zero.
    """

    states: tuple[sp.Symbol, ...]
    rates: tuple[sp.Expr, ...]

    def poles(self, parameters: Any) -> NDArray[np.complex128]:
        """Eigenvalues of the linearization about xi = 0 [1/s]; none on the right is needed.

        Args:
            parameters: The plant's numbers.

        Raises:
            PremiseError: If xi = 0 is no equilibrium.
        """
        rates, zero = sp.Matrix(self.rates), dict.fromkeys(self.states, 0)
        numbers = {s: getattr(parameters, str(s)) for s in rates.free_symbols - set(self.states)}
        still, slope = (
            np.array(part.subs(numbers).subs(zero).evalf(), float)
            for part in (rates, rates.jacobian(self.states))
        )
        if np.abs(still).max() > _ROUNDING:
            raise PremiseError(
                f"the zero dynamics are not at rest at zero: rates {still.ravel().tolist()}"
            )
        return np.linalg.eigvals(slope).astype(complex)


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
        """Whether z has all of the state: sum r = n, Assumption 7."""
        return sum(self.relative_degree) == len(self.equations.x)

    @cached_property
    def singularity(self) -> Any:
        """The numerator of det E(x), in lowest terms: where it is zero, no input brings v about."""
        return sp.factor(sp.fraction(sp.factor(sp.simplify(_determinant(self.E))))[0])

    @cached_property
    def transformation(self) -> Callable[[Any, Any], tuple[float, ...]]:
        """Jitable (x, p) -> T(x)."""
        return self._generate("transformation", self.T)

    @cached_property
    def nonlinearity(self) -> Callable[[Any, Any], tuple[float, ...]]:
        """Jitable (x, p) -> K(x)."""
        return self._generate("nonlinearity", self.K)

    @cached_property
    def decoupling_matrix(self) -> Callable[[Any, Any], tuple[float, ...]]:
        """Jitable (x, p) -> E(x) row by row."""
        return self._generate("decoupling_matrix", self.E.flat())

    @cached_property
    def slope(self) -> Callable[[Any, Any], tuple[float, ...]]:
        """Jitable (x, p) -> the Jacobian of T at x, row by row."""
        return self._generate("slope", tuple(sp.Matrix(self.T).jacobian(self.equations.x)))

    @cached_property
    def nonlinearity_slope(self) -> Callable[[Any, Any], tuple[float, ...]]:
        """Jitable (x, p) -> the Jacobian of K at x, row by row."""
        slopes = tuple(sp.Matrix(self.K).jacobian(self.equations.x))
        return self._generate("nonlinearity_slope", slopes)

    def _generate(self, name: str, expressions: Sequence[Any]) -> Callable[..., Any]:
        return generate(name, expressions, "x, p", self.equations.places())

    def require_regular(self, x: Array, p: Any) -> None:
        """Refuse a state at which no input brings every v about.

        Args:
            x: State, (n,).
            p: The plant's numbers.

        Raises:
            PremiseError: If E is singular there, with E and what is possible instead.
        """
        m, steps = self.equations.inputs, 0.1 * np.eye(len(x))
        matrices = []
        for state in (x, *(x - steps), *(x + steps)):
            try:
                matrices.append(np.reshape(self.decoupling_matrix(state, p), (m, m)))
            except (ArithmeticError, ValueError):  # outside a function's domain
                matrices.append(np.full((m, m), np.nan))
        # In units in which no entry is above one, here or beside.
        sizes = np.abs([E for E in matrices if np.all(np.isfinite(E))])
        if not np.all(np.isfinite(matrices[0])):
            return
        rows = sizes.max(axis=(0, 2))[:, None] + np.finfo(float).tiny
        columns = (sizes / rows).max(axis=(0, 1)) + np.finfo(float).tiny
        if np.linalg.svd(matrices[0] / rows / columns, compute_uv=False).min() > _ROUNDING:
            return
        E = self.E[0] if m == 1 else self.E.tolist()
        raise PremiseError(
            f"feedback linearization is not possible about x = {np.round(x, 9).tolist()}: the "
            f"decoupling matrix E = {shown(E, str)} of {', '.join(map(str, self.h))}, of relative "
            f"degree {self.relative_degree}, is singular there (eq. (21)). Possible are lqr and "
            "linear-grosmc on the linearization, about an operating point ([plant] at, a "
            "state_task); and laws of an approximation that has a relative degree ([design] plant)"
        )

    def place(self, z: Array, p: Any, guess: Array) -> Array:
        """A state with T(x) = z, the rest of it as in ``guess``.

        Args:
            z: Transformed state, (sum r,).
            p: The plant's numbers.
            guess: Where to look, (n,).

        Raises:
            PremiseError: If there is none near the guess.
        """
        x, names = np.array(guess, float), list(self.equations.x)
        if self.plain is not None:
            x[self.plain] = z
            return x
        free = [i for i, name in enumerate(names) if name not in self.inner]

        def residual(part: Array) -> Array:
            x[free] = part
            return np.array(self.transformation(x, p)) - z

        def slope(part: Array) -> Array:
            x[free] = part
            return np.reshape(self.slope(x, p), (len(self.T), -1))[:, free]

        # Here, for it is a part of scipy that little needs.
        import scipy.optimize

        try:
            root = scipy.optimize.root(residual, x[free], jac=slope, tol=1e-13)
            missed = float(np.abs(residual(root.x)).max())
        except (ArithmeticError, ValueError):  # outside the domain of a function in T
            missed = np.inf
        if missed > 1e-9 * max(1.0, float(np.abs(z).max())):
            raise PremiseError(f"no state near {np.asarray(guess).tolist()} has z = {z.tolist()}")
        return x

    @cached_property
    def plain(self) -> list[int] | None:
        """The states that the entries of z are, if each of them is one."""
        names = list(self.equations.x)
        return [names.index(t) for t in self.T] if all(t in names for t in self.T) else None

    @cached_property
    def inner(self) -> tuple[sp.Symbol, ...]:
        """States that complete z to a transformation of the whole state."""
        n, inner = len(self.equations.x), []
        point = {name: values[0] for name, values in _points(self.equations).items()}
        rows = np.array(sp.Matrix(self.T).jacobian(self.equations.x).subs(point).evalf(), float)
        for i, x in enumerate(self.equations.x):
            wider = np.vstack([rows, np.eye(n)[i]])
            if np.linalg.matrix_rank(wider) > len(rows):
                rows = wider
                inner.append(x)
        return tuple(inner)

    def zero_dynamics(self) -> ZeroDynamics | None:
        """The dynamics inside while y = 0; None if z has all of the state.

        Raises:
            PremiseError: If sympy cannot solve T(x) = 0, or finds several branches.
        """
        if self.complete:
            return None
        outer = [x for x in self.equations.x if x not in self.inner]
        solutions = sp.solve(self.T, outer, dict=True)
        if len(solutions) != 1:
            raise PremiseError(f"T(x) = 0 has {len(solutions)} branches for {outer}: {solutions}")
        u = -self.E.inv() * sp.Matrix(self.K)
        rates = sp.Matrix(self.equations.f) + sp.Matrix(self.equations.g) * u
        rows = [self.equations.x.index(x) for x in self.inner]
        held = tuple(sp.simplify(rates[row].subs(solutions[0])) for row in rows)
        return ZeroDynamics(self.inner, held)


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


@lru_cache(maxsize=64)
def _linearized(equations: Equations, outputs: tuple[sp.Expr, ...]) -> FeedbackLinearization:
    """The same, once for all laws of a plant."""
    if len(outputs) != (m := equations.inputs):
        raise PremiseError(f"{len(outputs)} outputs for {m} inputs: E(x) must be square, eq. (21)")
    f, g = sp.Matrix(equations.f), sp.Matrix(equations.g)
    degrees, T, K, E = [], [], [], []
    for index, output in enumerate(outputs):
        derivative, degree, row = output, 0, sp.zeros(1, m)
        while all(is_zero(entry, equations) for entry in row):
            if degree == len(equations.x):
                raise PremiseError(
                    f"output {index + 1}, {output}, has no relative degree: no input appears in "
                    f"its first {degree} derivatives (section 3.2, Assumption 7)"
                )
            T.append(derivative)
            slope, degree = sp.Matrix([derivative]).jacobian(equations.x), degree + 1
            row, derivative = slope * g, (slope * f)[0]
        degrees.append(degree)
        K.append(derivative)
        E.append(list(row))
    matrix = sp.ImmutableMatrix(E)
    if is_zero(_determinant(matrix), equations):
        raise PremiseError(
            f"the decoupling matrix E(x) = {matrix.tolist()} is singular everywhere, so the "
            f"vector relative degree {tuple(degrees)} is not defined (eq. (21))"
        )
    return FeedbackLinearization(tuple(degrees), equations, outputs, tuple(T), tuple(K), matrix)


def _determinant(matrix: Any) -> Any:
    """By minors, as it is: sympy's own methods simplify at every step, which takes seconds."""
    if matrix.rows == 1:
        return matrix[0, 0]
    minors = (matrix.minor_submatrix(0, j) for j in range(matrix.rows))
    return sp.Add(*((-1) ** j * matrix[0, j] * _determinant(m) for j, m in enumerate(minors)))


def is_zero(expression: sp.Expr, equations: Equations) -> bool:
    """Whether an expression vanishes wherever it was tried, against the size of its terms.

    Raises:
        PremiseError: If it has no value at any of the points.
    """
    if expression.is_zero:
        return True
    points = _points(equations)
    values = sp.lambdify(list(points), list(sp.Add.make_args(expression)), "numpy")
    with np.errstate(all="ignore"):
        terms = np.array([np.broadcast_to(term, _POINTS) for term in values(*points.values())])
    terms = terms[:, np.all(np.isfinite(terms), axis=0)]
    if not terms.size:
        raise PremiseError(f"{expression} has no real value at {_POINTS} random points")
    return bool(np.all(np.abs(terms.sum(axis=0)) <= _ROUNDING * np.abs(terms).sum(axis=0)))


def _points(equations: Equations) -> dict[sp.Symbol, Array]:
    """Random states and parameters, of two sizes in turn.

    Parameters mostly are positive: every other time they are. Those that are not get their turn.
    """
    random, n = np.random.default_rng(0), len(equations.x)
    symbols, small = (*equations.x, *equations.parameters), np.arange(_POINTS) % 2 == 0
    values = np.where(small, 1.0, 4.0) * random.uniform(0.2, 1, (len(symbols), _POINTS))
    signs = random.choice([-1, 1], values.shape)
    signs[n:, small] = 1
    return dict(zip(symbols, signs * values, strict=True))

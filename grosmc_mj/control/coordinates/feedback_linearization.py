"""Feedback linearization of an affine plant, from its equations in sympy: section 3.2, 4.2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from grosmc_mj.arguments import require, require_each
from grosmc_mj.arrays import Array
from grosmc_mj.codegen import generate
from grosmc_mj.control.coordinates.chains import Chains
from grosmc_mj.control.coordinates.expressions import complement, determinant, is_zero
from grosmc_mj.errors import ArgumentError, GrosmcError, PremiseError, shown
from grosmc_mj.plants.equations import Equations

# A rate that rounding could be.
_STILL = 1e-9
# A root is found within this, to rounding; next to it a step gains half of the digits.
_FOUND, _STEPS = 1e-13, 8


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
        numbers = _numbers(sp.Matrix(self.rates), parameters)
        still = numbers.subs(dict.fromkeys(self.states, 0))
        if any(abs(float(rate)) > _STILL for rate in still):
            raise PremiseError(f"the zero dynamics are not at rest at zero: rates {list(still)}")
        slope = numbers.jacobian(self.states).subs(dict.fromkeys(self.states, 0))
        return np.linalg.eigvals(np.array(slope.evalf(), float)).astype(complex)


@dataclass(frozen=True, eq=False)
class FeedbackLinearization(Chains):
    """z = T(x) and u = E(x)^-1 (v - K(x)), which make z' = A z + B v of an affine plant.

    Attributes:
        equations: The plant.
        h: Its outputs, one for each input.
        T: z of eq. (22): each output and its derivatives below r_i.
        K: L_f^r_i h_i of eq. (23), m expressions.
        E: Decoupling matrix of eq. (21), (m, m).
        pushed: L_d L_f^k h_i of a wrench, in the rows of z': eq. (24) has it in the last rows only.
    """

    equations: Equations
    h: tuple[Any, ...]
    T: tuple[Any, ...]
    K: tuple[Any, ...]
    E: Any
    pushed: tuple[Any, ...]

    @property
    def complete(self) -> bool:
        """Whether z has all of the state: sum r = n, Assumption 7."""
        return sum(self.relative_degree) == len(self.equations.x)

    @property
    def matched(self) -> bool:
        """Whether no wrench reaches z' but through the rows of the inputs."""
        rows = set(range(len(self.T))) - set(self.last_rows)
        return all(is_zero(self.pushed[row], self.equations) for row in rows)

    @cached_property
    def singularity(self) -> Any:
        """The numerator of det E(x), in lowest terms: where it is zero, no input brings v about."""
        whole = sp.expand_trig(determinant(self.E))
        # Rational in the sines and cosines, which sin^2 + cos^2 = 1 then reduces.
        names = {each: sp.Dummy() for each in whole.atoms(sp.sin, sp.cos)}
        numerator, _ = sp.fraction(sp.cancel(whole.subs(names)))
        circles = [
            names[sp.sin(angle)] ** 2 + names[sp.cos(angle)] ** 2 - 1
            for angle in {each.args[0] for each in names}
            if sp.sin(angle) in names and sp.cos(angle) in names
        ]
        if circles:
            numerator = sp.reduced(numerator, circles, *names.values())[1]
        return sp.factor(sp.sympify(numerator).subs({name: each for each, name in names.items()}))

    def singular_states(self) -> list[sp.Basic]:
        """Where E is singular, as far as sympy can solve for it: conditions on single states."""
        found: list[sp.Basic] = []
        for factor in sp.factor_list(self.singularity)[1]:
            states = [x for x in self.equations.x if factor[0].has(x)]
            for x in states[:1]:
                solutions = sp.solveset(factor[0], x, sp.Reals)
                if solutions is not sp.S.EmptySet:
                    found.append(sp.Contains(x, solutions, evaluate=False))
        return found

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
    def disturbance(self) -> Callable[[Any, Any, Any], tuple[float, ...]]:
        """Jitable (x, w, p) -> what a wrench does to z', row by row."""
        return generate("disturbance", self.pushed, "x, w, p", self.equations.places())

    @cached_property
    def slope(self) -> Callable[[Any, Any], tuple[float, ...]]:
        """Jitable (x, p) -> the Jacobian of T at x, row by row."""
        return self._generate("slope", tuple(sp.Matrix(self.T).jacobian(self.equations.x)))

    @cached_property
    def nonlinearity_slope(self) -> Callable[[Any, Any], tuple[float, ...]]:
        """Jitable (x, p) -> the Jacobian of K at x, row by row."""
        return self._generate(
            "nonlinearity_slope", tuple(sp.Matrix(self.K).jacobian(self.equations.x))
        )

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
        m = self.equations.inputs

        def matrix(state: Array) -> Array:
            try:
                return np.reshape(self.decoupling_matrix(state, p), (m, m))
            except (ArithmeticError, ValueError):  # outside a function's domain
                return np.full((m, m), np.nan)

        here = matrix(x)
        if not np.all(np.isfinite(here)):
            return
        beside = [matrix(x + side * row) for row in np.eye(len(x)) for side in (-0.1, 0.1)]
        sizes = np.abs([E for E in (here, *beside) if np.all(np.isfinite(E))])
        # In units in which no entry is above one, here or beside.
        rows = sizes.max(axis=(0, 2))[:, None] + np.finfo(float).tiny
        columns = (sizes / rows).max(axis=(0, 1)) + np.finfo(float).tiny
        if np.linalg.svd(here / rows / columns, compute_uv=False).min() > _STILL:
            return
        E = self.E[0] if m == 1 else self.E.tolist()
        raise PremiseError(
            f"feedback linearization is not possible about x = {np.round(x, 9).tolist()}: the "
            f"decoupling matrix E = {shown(E, str)} of {', '.join(map(str, self.h))}, of relative "
            f"degree {self.relative_degree}, is singular there (eq. (21)). Possible are lqr and "
            "linear-grosmc on the linearization, about an operating point ([plant] at, a "
            "StateTask); and laws of an approximation that has a relative degree ([design] plant)"
        )

    def inverse(self, z: Sequence[sp.Symbol]) -> list[Mapping[sp.Symbol, sp.Expr]]:
        """x = T^-1(z) as sympy finds it: every branch, each state by its name.

        Raises:
            PremiseError: If z has not all of the state.
        """
        if not self.complete:
            raise PremiseError(
                f"T(x) has {len(self.T)} of {len(self.equations.x)} states: the other ones are the "
                "zero dynamics, and it has no inverse"
            )
        equations = [t - each for t, each in zip(self.T, z, strict=True)]
        return sp.solve(equations, self.equations.x, dict=True)

    def place(self, z: Array, p: Any, guess: Array) -> Array:
        """A state with T(x) = z, the rest of it as in ``guess``.

        Args:
            z: Transformed state, (sum r,).
            p: The plant's numbers.
            guess: Where to look, (n,).

        Raises:
            PremiseError: If there is none near the guess.
        """
        x = np.array(guess, float)
        if self.plain is not None:
            x[self.plain] = z
            return x
        free = self.seen

        def residual(part: Array) -> Array:
            x[free] = part
            return np.array(self.transformation(x, p)) - z

        def slope(part: Array) -> Any:
            x[free] = part
            return np.reshape(self.slope(x, p), (len(self.T), -1))[:, free]

        scale = max(1.0, float(np.abs(z).max()))
        try:
            part = _newton(residual, slope, x[free], scale)
            if part is None:
                # Here, for it is a part of scipy that little needs.
                import scipy.optimize

                # Damped: Newton's own steps from afar can leave for another branch.
                part = scipy.optimize.least_squares(
                    residual,
                    x[free],
                    slope,  # pyright: ignore[reportArgumentType]  scipy takes a function too
                    method="lm",
                    xtol=1e-15,
                    ftol=1e-15,
                    gtol=1e-15,
                ).x
            missed = float(np.abs(residual(part)).max())
        except (ArithmeticError, ValueError):  # outside the domain of a function in T
            missed = np.inf
        if missed > 1e-9 * scale:
            raise PremiseError(f"no state near {np.asarray(guess).tolist()} has z = {z.tolist()}")
        return x

    @cached_property
    def plain(self) -> list[int] | None:
        """The states that the entries of z are, if each of them is one."""
        names = list(self.equations.x)
        return [names.index(t) for t in self.T] if all(t in names for t in self.T) else None

    @cached_property
    def seen(self) -> list[int]:
        """States that z determines: as many as z has."""
        left_out = set(complement(self.T, self.equations)) if not self.complete else set()
        return [i for i, x in enumerate(self.equations.x) if x not in left_out]

    def zero_dynamics(self) -> ZeroDynamics | None:
        """The dynamics inside while y = 0; None if z has all of the state.

        Raises:
            PremiseError: If sympy cannot solve T(x) = 0.
        """
        if self.complete:
            return None
        inner = complement(self.T, self.equations)
        outer = [x for x in self.equations.x if x not in inner]
        solutions = sp.solve(self.T, outer, dict=True)
        if not solutions:
            raise PremiseError(f"T(x) = 0 has no solution for {outer} in closed form")
        if len(solutions) > 1:
            raise PremiseError(f"T(x) = 0 has {len(solutions)} branches: {solutions}")
        u = -self.E.inv() * sp.Matrix(self.K)
        rates = [
            (f + (sp.Matrix([row]) * u)[0]).subs(solutions[0])
            for x, f, row in zip(self.equations.x, self.equations.f, self.equations.g, strict=True)
            if x in inner
        ]
        return ZeroDynamics(tuple(inner), tuple(sp.simplify(rate) for rate in rates))


def _newton(
    residual: Callable[[Array], Array],
    slope: Callable[[Array], Array],
    start: Array,
    scale: float,
) -> Array | None:
    """A root by Newton's steps from nearby, or None as soon as a step does not help enough."""
    part, missed = np.array(start), residual(start)
    for _ in range(_STEPS):
        if np.abs(missed).max() <= _FOUND * scale:
            return part
        try:
            following = part - np.linalg.solve(slope(part), missed)
        except np.linalg.LinAlgError:
            return None
        left = residual(following)
        if not np.abs(left).max() < 0.25 * np.abs(missed).max():
            return None
        part, missed = following, left
    return None


def feedback_linearization(
    equations: Equations, h: Sequence[Any] | None = None
) -> FeedbackLinearization:
    """Differentiate each output until an input appears: eqs. (21)-(25) and (43)-(46).

    Args:
        equations: The plant.
        h: Outputs, as many as it has inputs; its own by default.

    Raises:
        PremiseError: If an output has no relative degree, or E is singular everywhere.
    """
    require("equations", equations, Equations, "Equations of a plant, such as plant.system's")
    given = equations.h if h is None else h
    require("h", given, Sequence, "a list of expressions in the states")
    try:
        outputs = tuple(sp.sympify(each) for each in given)
        require_each("h", outputs, sp.Expr, "a list of expressions in the states")
    except (sp.SympifyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, GrosmcError):
            raise
        raise ArgumentError(f"h = {shown(given)} cannot be read: {error}") from error
    m = equations.inputs
    if len(outputs) != m:
        raise PremiseError(f"{len(outputs)} outputs for {m} inputs: E(x) must be square, eq. (21)")
    return _linearized(equations, outputs)


@lru_cache(maxsize=64)
def _linearized(equations: Equations, outputs: tuple[sp.Expr, ...]) -> FeedbackLinearization:
    """The same, once for all laws of a plant."""
    f, g, d = (sp.Matrix(each) for each in (equations.f, equations.g, equations.d))
    degrees, T, K, E, pushed = [], [], [], [], []
    for index, output in enumerate(outputs):
        derivative, degree = output, 0
        while True:
            slope = sp.Matrix([derivative]).jacobian(equations.x)
            T.append(derivative)
            pushed.append((slope * d)[0])
            degree += 1
            row = slope * g
            derivative = (slope * f)[0]
            if not all(is_zero(each, equations) for each in row):
                break
            if degree == len(equations.x):
                raise PremiseError(
                    f"output {index + 1}, {output}, has no relative degree: no input appears in "
                    f"its first {degree} derivatives (section 3.2, Assumption 7)"
                )
        degrees.append(degree)
        K.append(derivative)
        E.append(list(row))
    matrix = sp.ImmutableMatrix(E)
    if is_zero(determinant(matrix), equations):
        raise PremiseError(
            f"the decoupling matrix E(x) = {matrix.tolist()} is singular everywhere, so the "
            f"vector relative degree {tuple(degrees)} is not defined (eq. (21))"
        )
    return FeedbackLinearization(
        tuple(degrees), equations, outputs, tuple(T), tuple(K), matrix, tuple(pushed)
    )


def _numbers(matrix: sp.Matrix, parameters: Any) -> sp.Matrix:
    """Expressions with the plant's numbers in place of its parameters."""
    names = {symbol for symbol in matrix.free_symbols if hasattr(parameters, str(symbol))}
    return matrix.subs({symbol: getattr(parameters, str(symbol)) for symbol in names})

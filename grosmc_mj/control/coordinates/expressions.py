"""What can be said of sympy expressions without simplifying them: by minors and by trying."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import sympy as sp

from grosmc_mj.errors import PremiseError
from grosmc_mj.plants.equations import Equations

# Points at which an expression is tried before it is called zero: no expression of the plants
# vanishes at all of these without being zero.
_TRIALS, _DRAWS = 8, 200
# Against the size of its terms.
_ZERO = 1e-9


def determinant(matrix: Any) -> Any:
    """By minors: sympy's other methods simplify at every step."""
    return matrix.det(method="laplace")


def is_zero(expression: sp.Expr, equations: Equations) -> bool:
    """Whether an expression vanishes wherever it was tried, against the size of its terms.

    Raises:
        PremiseError: If it has no value at any of the points.
    """
    if expression.is_zero:
        return True
    terms = sp.Add.make_args(expression)
    symbols = (*equations.x, *equations.w, *equations.parameters)
    values = sp.lambdify(symbols, list(terms), "math")
    tried = 0
    for trial in itertools.islice(_trials(equations), _DRAWS):
        try:
            found = [float(value) for value in values(*trial.values())]
        except (ArithmeticError, ValueError, TypeError):  # outside a function's domain
            continue
        tried += 1
        if abs(sum(found)) > _ZERO * sum(map(abs, found)):
            return False
        if tried == _TRIALS:
            return True
    if not tried:
        raise PremiseError(f"{expression} has no real value at {_DRAWS} random points")
    return True


def complement(T: Sequence[sp.Expr], equations: Equations) -> list[sp.Symbol]:
    """States that complete T to a transformation of the whole state."""
    slopes = sp.Matrix(T).jacobian(equations.x)
    rows = np.array(slopes.subs(next(_trials(equations))).evalf(), float)
    inner: list[sp.Symbol] = []
    for index, x in enumerate(equations.x):
        wider = np.vstack([rows, np.eye(len(equations.x))[index]])
        if np.linalg.matrix_rank(wider) > len(rows) and len(wider) <= len(equations.x):
            rows = wider
            inner.append(x)
    return inner


def _trials(equations: Equations) -> Iterator[dict[sp.Symbol, float]]:
    """Random states, wrenches and parameters, of two sizes in turn.

    Parameters mostly are positive: every other time they are. Those that are not get their turn.
    """
    random, signed = np.random.default_rng(0), (*equations.x, *equations.w)
    symbols = (*signed, *equations.parameters)
    for size in itertools.cycle((1.0, 4.0)):
        values = size * random.uniform(0.2, 1, len(symbols))
        signs = random.choice([-1, 1], len(symbols))
        if size == 1.0:
            signs[len(signed) :] = 1
        yield dict(zip(symbols, (signs * values).tolist(), strict=True))

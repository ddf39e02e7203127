"""Linear algebra with other last digits, as on a machine with other kernels of LAPACK.

A processor can be emulated only by one that has all of its instructions, and two kernels may agree
by chance. Here the last bit of every number that NumPy's and SciPy's linear algebra return is
the other one, on each machine: what is compared to the bit after it, or as text, differs.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg

# Functions of LAPACK, or of a library that calls it. They are looked up in their modules.
FUNCTIONS = {
    np.linalg: (
        *("cholesky", "det", "eig", "eigh", "eigvals", "eigvalsh", "inv", "lstsq"),
        *("norm", "pinv", "qr", "solve", "svd"),
    ),
    scipy.linalg: (
        *("cholesky", "eig", "eigh", "eigvals", "eigvalsh", "expm", "inv", "lstsq", "solve"),
        *("solve_continuous_are", "solve_continuous_lyapunov"),
        *("solve_discrete_are", "solve_discrete_lyapunov"),
    ),
}


def change_last_digits() -> None:
    """Put functions with other last digits in the place of those of NumPy and SciPy."""
    for module, names in FUNCTIONS.items():
        for name in names:
            setattr(module, name, with_other_digits(getattr(module, name)))


def with_other_digits(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function whose floats have the other last bit: the same ones in each call."""

    @functools.wraps(function)
    def other(*args: Any, **keywords: Any) -> Any:
        return other_digits(function(*args, **keywords))

    return other


def other_digits(result: Any) -> Any:
    """Return floats, arrays or tuples of them with the other last bit; zeros stay."""
    if isinstance(result, tuple):
        changed = [other_digits(part) for part in result]
        # A tuple with names takes its parts one by one.
        return type(result)(*changed) if hasattr(result, "_fields") else tuple(changed)
    if not isinstance(result, np.ndarray | np.floating | np.complexfloating | float):
        return result

    values = np.array(result)
    if values.dtype not in (np.float64, np.complex128):
        return result
    floats = np.atleast_1d(values).view(np.float64)
    regular = np.isfinite(floats) & (floats != 0.0)
    floats.view(np.int64)[regular] ^= 1
    return values if isinstance(result, np.ndarray) else values[()]

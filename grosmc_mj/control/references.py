"""Reference trajectories y_r(t) with the derivatives that the laws need (Assumption 8)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from grosmc_mj.arguments import require_each
from grosmc_mj.arrays import Array
from grosmc_mj.codegen import generate
from grosmc_mj.errors import ArgumentError, GrosmcError, PremiseError, shown
from grosmc_mj.jitable import jitable

# (t, p.reference) -> y_r1, y_r1', ... up to the relative degree, then the next output's.
ReferenceFunction = Callable[[float, Any], tuple[float, ...]]

TIME = sp.Symbol("t")
"""Time of a reference in expressions [s]."""
# Operations of what is differentiated, and the highest relative degree.
_LONGEST, _HIGHEST = 500, 20


def reference(outputs: Sequence[Any], degrees: Sequence[int] = (2,)) -> ReferenceFunction:
    """The reference whose outputs are expressions in ``TIME``, with derivatives up to r_i.

    Args:
        outputs: y_r, one expression for each output; every other symbol is a field of the
            reference's parameters.
        degrees: Relative degrees r_i.

    Raises:
        ArgumentError: If an output is no expression, or a derivative too long for the next one.
        PremiseError: If there is not one degree for each output.
    """
    require_each("degrees", degrees, int, "whole numbers, one relative degree for each output")
    if not isinstance(outputs, (list, tuple)) or not all(1 <= r <= _HIGHEST for r in degrees):
        raise ArgumentError(
            f"outputs = {shown(outputs)} with degrees {shown(degrees)} must be a list of "
            f"expressions in TIME, each with a relative degree from 1 to {_HIGHEST}"
        )
    if len(outputs) != len(degrees):
        raise PremiseError(
            f"{len(outputs)} outputs with relative degrees {tuple(degrees)}: give one degree each"
        )
    try:
        rows = [
            row
            for output, degree in zip(map(_expression, outputs), degrees, strict=True)
            for row in _derivatives(output, degree)
        ]
    except GrosmcError:
        raise
    # sympy's own, of numbers beyond all bounds.
    except (ArithmeticError, ValueError, RecursionError) as error:
        raise ArgumentError(f"outputs = {shown(outputs)} cannot be differentiated") from error
    fields = {s for row in rows for s in row.free_symbols} - {TIME}
    places = {TIME: "t", **{s: f"p.{s}" for s in fields}}
    function: Any = generate("reference", rows, "t, p", places)
    # What a design must know of it.
    function.degrees = tuple(degrees)
    function.moves = any(row.has(TIME) for row in rows)
    return function


def _expression(output: Any) -> sp.Expr:
    """An output, which is never text: sympy would execute it."""
    try:
        found = sp.sympify(output, strict=True)
    except sp.SympifyError:
        found = None
    if not isinstance(found, sp.Expr):
        raise ArgumentError(f"{shown(output)} must be an expression of sympy in TIME, or a number")
    return found


def _derivatives(output: sp.Expr, degree: int) -> Iterator[sp.Expr]:
    """An output and its derivatives in time."""
    yield output
    for order in range(1, degree + 1):
        # Each derivative is as many times longer than the one before as that has factors.
        length = int(sp.count_ops(output))
        if length > _LONGEST:
            raise ArgumentError(
                f"derivative {order - 1} of a reference has {length} operations, which is too long "
                f"for another one: {_LONGEST} are allowed; take a simpler reference"
            )
        output = sp.diff(output, TIME)
        yield output


@dataclass(frozen=True)
class Setpoint:
    """A constant reference.

    Attributes:
        value: y_r, in the unit of the output.
    """

    value: float = 0.0


def setpoints(*degrees: int) -> ReferenceFunction:
    """A setpoint for one output of any relative degree, or ``value1``, ``value2`` ... for more."""
    require_each("degrees", degrees, int, "whole numbers, one relative degree for each output")
    return _constant(*degrees)


@cache
def _constant(*degrees: int) -> ReferenceFunction:
    if len(degrees) == 1:
        return reference([sp.Symbol("value")], degrees)
    return reference([sp.Symbol(f"value{i + 1}") for i in range(len(degrees))], degrees)


setpoint = setpoints(2)


@dataclass(frozen=True)
class Setpoints:
    """A constant reference of two outputs.

    Attributes:
        value1: y_r1, in the unit of the first output.
        value2: y_r2, in that of the second.
    """

    value1: float
    value2: float


@dataclass(frozen=True, eq=False)
class FourierSeries:
    """Periodic references y_i = mean_i + sum_k [cosine_ik cos(k w t) + sine_ik sin(k w t)].

    Attributes:
        frequency: w [rad/s].
        mean: In the unit of each output, (m,).
        cosine: (m, harmonics), from k = 1.
        sine: (m, harmonics).
    """

    frequency: float
    mean: Array
    cosine: Array
    sine: Array

    @classmethod
    def through(cls, samples: ArrayLike, frequency: float, harmonics: int) -> FourierSeries:
        """The series of one period of samples at equal distances in time, cut off.

        Args:
            samples: (N, m), the first at t = 0; the next period begins after the last.
            frequency: w [rad/s].
            harmonics: How many are kept, fewer than N/2.

        Raises:
            ArgumentError: If there are too few samples.
        """
        rows = np.asarray(samples, float)
        if not 0 < harmonics < len(rows) / 2:
            raise ArgumentError(f"{len(rows)} samples cannot give {harmonics} harmonics")
        parts = np.fft.rfft(rows, axis=0).T[:, : harmonics + 1] / len(rows)
        return cls(frequency, parts[:, 0].real, 2 * parts[:, 1:].real, -2 * parts[:, 1:].imag)


@cache
def fourier_series(outputs: int, harmonics: int) -> ReferenceFunction:
    """The reference of a ``FourierSeries`` with two exact derivatives of each output."""

    def entry(row: int, c: float, s: float, p: Any) -> float:
        i, order = row // 3, row % 3
        # cos(k w t) and sin(k w t) from those before: two sines in all for a sample.
        cosine, sine, value = c, s, 0.0
        for k in range(harmonics):
            rate = (k + 1) * p.frequency
            if order == 0:
                value += p.cosine[i, k] * cosine + p.sine[i, k] * sine
            elif order == 1:
                value += rate * (p.sine[i, k] * cosine - p.cosine[i, k] * sine)
            else:
                value -= rate * rate * (p.cosine[i, k] * cosine + p.sine[i, k] * sine)
            cosine, sine = cosine * c - sine * s, sine * c + cosine * s
        return value + p.mean[i] if order == 0 else value

    entry, rows = jitable(entry), 3 * outputs

    @jitable
    def series(t: float, p: Any) -> Any:
        c, s, y_r = math.cos(p.frequency * t), math.sin(p.frequency * t), np.empty(rows)
        for row in range(rows):
            y_r[row] = entry(row, c, s, p)
        return y_r

    function: Any = series
    function.degrees = (2,) * outputs
    function.moves = True
    return function

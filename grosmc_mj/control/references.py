"""Reference trajectories y_r(t) with the derivatives that the laws need (Assumption 8)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.codegen import generate
from grosmc_mj.errors import ArgumentError, PremiseError, shown
from grosmc_mj.fields import Items, Range, checked_call
from grosmc_mj.jitable import jitable
from grosmc_mj.plants.equations import Expressions

# (t, p.reference) -> y_r1, y_r1', ... up to the relative degree, then the next output's.
ReferenceFunction = Callable[[float, Any], tuple[float, ...]]

TIME = sp.Symbol("t")
"""Time of a reference in expressions [s]."""
# Operations of what is differentiated, and the highest relative degree.
_LONGEST, _HIGHEST = 500, 20


Degrees = Annotated[Sequence[int], Items(int, "whole numbers, one relative degree for each output")]


@checked_call
def reference(outputs: Expressions, degrees: Degrees = (2,)) -> ReferenceFunction:
    """The reference whose outputs are expressions in ``TIME``, with derivatives up to r_i.

    Args:
        outputs: y_r, one expression for each output; every other symbol is a field of the
            reference's parameters.
        degrees: Relative degrees r_i.

    Raises:
        ArgumentError: If an output is no expression, or a derivative too long for the next one.
        PremiseError: If there is not one degree for each output.
    """
    if not all(1 <= degree <= _HIGHEST for degree in degrees):
        raise ArgumentError(f"degrees = {shown(degrees)} must be from 1 to {_HIGHEST}")
    if len(outputs) != len(degrees):
        raise PremiseError(
            f"{len(outputs)} outputs with relative degrees {degrees}: give one degree each"
        )
    try:
        rows = [row for pair in zip(outputs, degrees, strict=True) for row in _derivatives(*pair)]
    # sympy's own, of numbers beyond all bounds.
    except (ArithmeticError, TypeError, RecursionError) as error:
        raise ArgumentError(f"outputs = {shown(outputs)} cannot be differentiated") from error
    fields = {symbol for row in rows for symbol in row.free_symbols} - {TIME}
    function: Any = generate(
        "reference", rows, "t, p", {TIME: "t", **{s: f"p.{s}" for s in fields}}
    )
    # What a design must know of it.
    function.degrees, function.moves = degrees, any(row.has(TIME) for row in rows)
    return function


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


@checked_call
def setpoints(*degrees: Annotated[int, Range(1, _HIGHEST, whole=True)]) -> ReferenceFunction:
    """A setpoint for one output of any relative degree, or ``value1``, ``value2`` ... for more."""
    return _setpoints(degrees)


@cache
def _setpoints(degrees: tuple[int, ...]) -> ReferenceFunction:
    numbers = range(1, len(degrees) + 1) if len(degrees) > 1 else [""]
    return reference([sp.Symbol(f"value{number}") for number in numbers], degrees)


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
            a, b, rate = p.cosine[i, k], p.sine[i, k], (k + 1) * p.frequency
            for _ in range(order):
                a, b = rate * b, -rate * a
            value += a * cosine + b * sine
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
    function.degrees, function.moves = (2,) * outputs, True
    return function

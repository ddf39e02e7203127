"""Reference trajectories y_r(t) with the derivatives that the laws need (Assumption 8)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.codegen import generate
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ArgumentError, PremiseError, value_text
from grosmc_mj.ground.fields import Items, Range, checked_call
from grosmc_mj.theory.plants.equations import Expressions

# (t, p.reference) -> y_r1, y_r1', ... up to the relative degree, then the next output's.
ReferenceFunction = Callable[[float, Any], tuple[float, ...]]

TIME = sp.Symbol("t")
"""Time of a reference in expressions [s]."""
# Most operations of an expression that is differentiated.
_LONGEST = 500
# Highest relative degree.
_HIGHEST = 20


Degrees = Annotated[Sequence[int], Items(int, "whole numbers, one relative degree for each output")]


@checked_call
def reference(outputs: Expressions, degrees: Degrees = (2,)) -> ReferenceFunction:
    """Reference whose outputs are expressions in ``TIME``, with derivatives up to r_i.

    Args:
        outputs: y_r, one expression for each output; every other symbol is a field of the
            reference's parameters.
        degrees: Relative degrees r_i.

    Raises:
        ArgumentError: If an output is no expression, or a derivative too long for the next one.
        PremiseError: If there is not one degree for each output.
    """
    if not all(1 <= degree <= _HIGHEST for degree in degrees):
        raise ArgumentError(f"degrees = {value_text(degrees)} must be from 1 to {_HIGHEST}")
    if len(outputs) != len(degrees):
        raise PremiseError(
            f"{len(outputs)} outputs with relative degrees {degrees}: give one degree each"
        )

    rows: list[sp.Expr] = []
    try:
        for output, degree in zip(outputs, degrees, strict=True):
            rows += _derivatives(output, degree)
    # sympy raises these for numbers beyond all bounds.
    except (ArithmeticError, TypeError, RecursionError) as error:
        raise ArgumentError(f"outputs = {value_text(outputs)} cannot be differentiated") from error

    places: dict[Any, str] = {}
    for row in rows:
        for symbol in row.free_symbols:
            places[symbol] = f"p.{symbol}"
    places[TIME] = "t"
    function: Any = generate("reference", rows, "t, p", places)
    moves = any(row.has(TIME) for row in rows)
    return _described(function, degrees, moves=moves)


def _described(function: Any, degrees: Sequence[int], *, moves: bool) -> ReferenceFunction:
    """Give a reference the attributes that a design reads, and return it.

    Args:
        function: (t, p) -> y_r and derivatives.
        degrees: Relative degrees r_i that it has derivatives for.
        moves: Whether it depends on time.
    """
    function.degrees = degrees
    function.moves = moves
    return function


def _derivatives(output: sp.Expr, degree: int) -> list[sp.Expr]:
    """An output and its derivatives in time."""
    derivatives = [output]
    for order in range(1, degree + 1):
        # A derivative may be longer by a factor of the number of factors in its terms.
        length = int(sp.count_ops(derivatives[-1]))
        if length > _LONGEST:
            raise ArgumentError(
                f"derivative {order - 1} of a reference has {length} operations, which is too long "
                f"for another one: {_LONGEST} are allowed; take a simpler reference"
            )
        derivatives.append(sp.diff(derivatives[-1], TIME))
    return derivatives


@dataclass(frozen=True)
class Setpoint:
    """A constant reference.

    Attributes:
        value: y_r, in the unit of the output.
    """

    value: float = 0.0


@checked_call
def setpoints(*degrees: Annotated[int, Range(1, _HIGHEST, whole=True)]) -> ReferenceFunction:
    """Setpoint ``value`` of one output of any relative degree, or ``value1`` ... of several.

    Args:
        degrees: Relative degree of each output.
    """
    return _setpoints(degrees)


# Cached, so that error coordinates and laws of one kind of setpoint are compiled once.
@cache
def _setpoints(degrees: tuple[int, ...]) -> ReferenceFunction:
    if len(degrees) < 2:
        return reference([sp.Symbol("value")], degrees)
    numbers = range(1, len(degrees) + 1)
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
        """Truncated series of one period of samples at equal distances in time.

        Args:
            samples: (N, m), the first at t = 0; the next period begins after the last.
            frequency: w [rad/s].
            harmonics: Number of harmonics that are kept, fewer than N/2.

        Raises:
            ArgumentError: If there are too few samples.
        """
        rows = np.asarray(samples, float)
        if not 0 < harmonics < len(rows) / 2:
            raise ArgumentError(f"{len(rows)} samples cannot give {harmonics} harmonics")
        spectrum = np.fft.rfft(rows, axis=0).T
        coefficients = spectrum[:, : harmonics + 1] / len(rows)
        mean = coefficients[:, 0].real
        cosine = 2 * coefficients[:, 1:].real
        sine = -2 * coefficients[:, 1:].imag
        return cls(frequency, mean, cosine, sine)


# Cached, so that error coordinates and laws of one size of series are compiled once.
@cache
def fourier_series(outputs: int, harmonics: int) -> ReferenceFunction:
    """Reference of a ``FourierSeries`` with two exact derivatives of each output.

    Args:
        outputs: Number of outputs, m.
        harmonics: Number of harmonics of each.
    """

    # The functions are nested because numba compiles sizes that a closure fixes.
    def entry(
        i: int,
        order: int,
        c: float,
        s: float,
        p: Any,
    ) -> float:
        # cos(k w t) and sin(k w t) follow from those of k - 1, so that a sample needs two calls.
        cosine = c
        sine = s
        value = 0.0
        for k in range(harmonics):
            a = p.cosine[i, k]
            b = p.sine[i, k]
            rate = (k + 1) * p.frequency
            for _ in range(order):
                a, b = rate * b, -rate * a
            value += a * cosine + b * sine
            cosine, sine = cosine * c - sine * s, sine * c + cosine * s
        if order == 0:
            value = value + p.mean[i]
        return value

    entry = jitable(entry)

    def series(t: float, p: Any) -> Any:
        c = math.cos(p.frequency * t)
        s = math.sin(p.frequency * t)
        y_r = np.zeros(3 * outputs)
        for i in range(outputs):
            for order in range(3):
                y_r[3 * i + order] = entry(i, order, c, s, p)
        return y_r

    return _described(jitable(series), (2,) * outputs, moves=True)

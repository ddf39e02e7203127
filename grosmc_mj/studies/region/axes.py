"""Axes of a region: two states, and the starts on them."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.wording import counted_of, plural, titled, unit_after
from grosmc_mj.studies.region.runs import RegionLoop
from grosmc_mj.theory.plants import Signal

# Largest start on an axis, by its unit.
LIMITS: Mapping[str, float] = {"rad": math.pi / 2, "rad/s": 10.0, "m": 1.0, "m/s": 2.0}


@dataclass(frozen=True)
class Axis:
    """One axis: a state, or the error that is measured on it.

    Attributes:
        state: Index of the state.
        signal: The state's name, symbol and unit.
        limit: Largest start to both sides, in the state's unit.
        direction: Change of the state along the axis: -1 for an error y_r - y.
        origin: Value of the state at zero of the axis.
        is_error: Whether zero of the axis is zero error of a regulated state.
    """

    state: int
    signal: Signal
    limit: float
    direction: float
    origin: float
    is_error: bool

    @property
    def title(self) -> str:
        """Title with symbol and unit; degrees for angles."""
        name = self.signal.name
        if self.is_error:
            name = f"error of {name}"
        _, unit = shown(self.signal, 0.0)
        return titled(f"start {name} {self.signal.symbol}", unit)

    def cells(self, count: int) -> Array:
        """Return the centres of equal cells from minus to plus the limit, (count,)."""
        return self.limit * ((2 * np.arange(count) + 1) / count - 1)


def shown(signal: Signal, value: float) -> tuple[float, str]:
    """Return a value of a signal for people, and its unit: degrees for angles."""
    if signal.unit == "rad":
        return math.degrees(value), "°"
    return value, signal.unit


def ascii_symbol(signal: Signal) -> str:
    """Return the symbol that the command line has: theta_dot for θ̇, q1 for q₁."""
    symbol = ""
    suffix = ""
    for character in unicodedata.normalize("NFD", signal.symbol):
        name = unicodedata.name(character)
        if name == "COMBINING DOT ABOVE":
            suffix = "_dot"
        elif character.isdigit():
            symbol += str(unicodedata.digit(character))
        elif character.isascii():
            symbol += character
        else:
            # GREEK SMALL LETTER THETA
            symbol += name.split()[-1].lower()
    return symbol + suffix


def choose_axes(
    loop: RegionLoop,
    names: tuple[str, str] | None = None,
    limits: tuple[float, float] | None = None,
) -> tuple[Axis, Axis]:
    """Return two axes: the named states, or the first regulated state and its rate.

    Args:
        loop: Loop whose errors the axes measure.
        names: Two states by symbol, such as ``theta`` and ``theta_dot``.
        limits: Largest start on each axis, in degrees or the state's unit; instead of ``LIMITS``.

    Raises:
        ArgumentError: If a state is unknown or named twice, or of a unit without a limit.
    """
    system = loop.system
    symbols = [ascii_symbol(state) for state in system.states]
    first = loop.regulated[0]
    second = first + system.degrees_of_freedom
    if names is not None:
        for name in names:
            require_known(f"state of {system.name}", name, dict.fromkeys(symbols))
        first = symbols.index(names[0])
        second = symbols.index(names[1])

    if first == second:
        raise ArgumentError(
            f"axes {symbols[first]}, {symbols[second]} must be two different states of "
            f"{system.name}: {', '.join(symbols)}"
        )
    across, up = limits or (None, None)
    return _axis(loop, first, across), _axis(loop, second, up)


def _axis(loop: RegionLoop, state: int, limit: float | None) -> Axis:
    """The axis of a state, up to a limit in degrees or its unit; by default that of ``LIMITS``."""
    signal = loop.system.states[state]
    if limit is None:
        require_known(f"unit of an axis, of {ascii_symbol(signal)},", signal.unit, LIMITS)
        limit = LIMITS[signal.unit]
    elif signal.unit == "rad":
        limit = math.radians(limit)

    is_error = state in loop.regulated
    direction = 1.0
    if is_error:
        error = loop.regulated.index(state)
        direction = float(loop.sensitivity[error, state])
    origin = float(loop.equilibrium[state])
    return Axis(state, signal, limit, direction, origin, is_error)


def starts_on(
    loop: RegionLoop,
    axes: tuple[Axis, Axis],
    first: Array,
    second: Array,
) -> Array:
    """Return states (nsim, n) at pairs of values on the axes, else at the equilibrium.

    Args:
        loop: Loop whose equilibrium counts.
        axes: The axes.
        first: Values on the first axis, (nsim,).
        second: Values on the second axis, (nsim,).

    Raises:
        ArgumentError: If one lies where the plant is singular or the laws are undefined.
    """
    system = loop.system
    starts = np.tile(loop.equilibrium, (len(first), 1))
    for axis, values in zip(axes, (first, second), strict=True):
        starts[:, axis.state] += axis.direction * values

    outside = [x for x in starts if system.singular(x) or not system.linearizable(x)]
    if outside:
        words = []
        for axis in axes:
            value, unit = shown(axis.signal, outside[0][axis.state])
            words.append(f"{axis.signal.symbol} = {value:.4g}{unit_after(unit)}")
        raise ArgumentError(
            f"{counted_of(len(outside), len(starts), 'start')}, as {', '.join(words)}, "
            f"{plural(len(outside), 'lies', 'lie')} outside {system.region}, where law and "
            "plant are defined: lower the limits of the axes"
        )
    return starts

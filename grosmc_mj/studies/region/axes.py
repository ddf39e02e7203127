"""The two axes of a region map and the starts that they span."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.studies.region.loop import RegionLoop, outside, state_names

# Where starts end on an axis, by its unit.
LIMITS: Mapping[str, float] = {"rad": math.pi / 2, "rad/s": 10.0, "m": 1.0, "m/s": 2.0}


@dataclass(frozen=True)
class Axis:
    """One axis: a state, or the error that is measured on it.

    Attributes:
        state: Index of the state.
        key: Its symbol in ASCII, as on the command line.
        name: Its name for people.
        symbol: Its symbol.
        unit: Unit of the state and of ``limit``.
        limit: Starts lie between minus this and this.
        direction: How the state moves with the axis: -1 for an error y_r - y.
        origin: Value of the state at zero of the axis.
        is_error: Whether zero of the axis is zero error of a regulated state.
        is_shifted: Whether that error is measured from a reference that is not at rest at zero.
    """

    state: int
    key: str
    name: str
    symbol: str
    unit: str
    limit: float
    direction: float
    origin: float
    is_error: bool
    is_shifted: bool

    @property
    def shown_unit(self) -> str:
        """Unit for people: degrees for angles."""
        return {"rad": "°"}.get(self.unit, self.unit)

    def shown(self, value: float) -> float:
        """A value on the axis in the unit for people."""
        return math.degrees(value) if self.unit == "rad" else value

    @property
    def label(self) -> str:
        """What stands beside the axis."""
        if self.is_shifted:
            return f"start error of {self.name} [{self.shown_unit}]"
        return f"start {self.name} {self.symbol} [{self.shown_unit}]"

    def cells(self, count: int) -> Array:
        """Centres of equal cells from minus to plus the limit."""
        return self.limit * ((2 * np.arange(count) + 1) / count - 1)


def choose_axes(
    loop: RegionLoop, names: Sequence[str] | None, limits: Mapping[str, float]
) -> tuple[Axis, Axis]:
    """Two axes: the named states, or the first regulated state and its rate.

    Args:
        loop: Whose errors the axes are.
        names: Two states by symbol, as ``theta`` and ``theta_dot``; None for the default.
        limits: Largest start by unit, instead of ``LIMITS``.

    Raises:
        ArgumentError: If a state is unknown or named twice, or a limit is not positive.
    """
    for unit, limit in limits.items():
        if not (math.isfinite(limit) and limit > 0):
            raise ArgumentError(f"limit {limit:g} {unit} of the starts must be finite and positive")
    keys = state_names(loop.system)
    if names is None:
        position = loop.regulated[0]
        chosen = [position, position + loop.system.degrees_of_freedom]
    else:
        symbols = [state.symbol for state in loop.system.states]
        chosen = [_find(name, keys, symbols, loop.system.name) for name in names]
    if len(set(chosen)) != 2:
        raise ArgumentError(
            f"axes {', '.join(keys[i] for i in chosen)} must be two different states of "
            f"{loop.system.name}: {', '.join(keys)}"
        )
    first, second = (_axis(loop, state, keys[state], {**LIMITS, **limits}) for state in chosen)
    return first, second


def _find(name: str, keys: Sequence[str], symbols: Sequence[str], system: str) -> int:
    """Index of a state by its ASCII or its own symbol."""
    for known in (keys, symbols):
        if name in known:
            return known.index(name)
    raise ArgumentError(unknown_name(f"state of {system}", name, keys))


def _axis(loop: RegionLoop, state: int, key: str, limits: Mapping[str, float]) -> Axis:
    """The axis of one state."""
    signal = loop.system.states[state]
    if signal.unit not in limits:
        raise ArgumentError(f"{key} is in {signal.unit}, which no axis has: {', '.join(limits)}")
    is_error = state in loop.regulated
    row = loop.sensitivity[loop.regulated.index(state)] if is_error else None
    direction = 1.0 if row is None else float(row[state])
    return Axis(
        state=state,
        key=key,
        name=signal.name,
        symbol=signal.symbol,
        unit=signal.unit,
        limit=limits[signal.unit],
        direction=direction,
        origin=float(loop.equilibrium[state]),
        is_error=is_error,
        is_shifted=is_error and (direction < 0 or bool(loop.equilibrium.any())),
    )


def starts_on(loop: RegionLoop, axes: tuple[Axis, Axis], first: Array, second: Array) -> Array:
    """States (nsim, n) at pairs of values on the axes, (nsim,) each; the rest at equilibrium.

    Raises:
        ArgumentError: If one lies where the plant is singular or the laws are undefined.
    """
    starts = np.tile(loop.equilibrium, (len(first), 1))
    for axis, values in zip(axes, (first, second), strict=True):
        starts[:, axis.state] += axis.direction * values
    wrong = np.flatnonzero(outside(loop.system, starts))
    if len(wrong):
        values = ", ".join(
            f"{axis.symbol} = {axis.shown(starts[wrong[0], axis.state]):.4g} {axis.shown_unit}"
            for axis in axes
        )
        raise ArgumentError(
            f"{len(wrong)} of {len(starts)} starts, as {values}, lie outside {loop.system.region}, "
            "where law and plant are defined: lower the limits of the axes"
        )
    return starts

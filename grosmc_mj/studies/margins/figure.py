"""Bode and Nyquist plots of the laws of a loop, and their delay margins over the amplitude."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.results.result import LineChart, Series
from grosmc_mj.output.results.tables import number
from grosmc_mj.studies.margins.frequency_response import LoopGain, Margins, interpolated
from grosmc_mj.studies.margins.margins import Setup
from grosmc_mj.studies.margins.row import LEVELS, LawMargins, shared_level

# Largest |L| of a Nyquist plot.
_NYQUIST = 3.0
# Least |L| of a Bode plot: no margin depends on less, whose phase is that of noise.
_LEAST = 0.03
# Laws that a figure has room for: a colour and a symbol for each that nobody mistakes.
_MOST_LAWS = 6


def in_figures(laws: Iterable[str]) -> list[list[str]]:
    """Return the names of laws, each once, in groups of which a figure has room for one."""
    names = list(dict.fromkeys(laws))
    return [names[first : first + _MOST_LAWS] for first in range(0, len(names), _MOST_LAWS)]


def charts(setup: Setup, rows: Sequence[LawMargins], laws: Sequence[str]) -> list[LineChart]:
    """Return Bode and Nyquist plots of L at the first input, and the delay over amplitude.

    Args:
        setup: The setup.
        rows: All of its rows, which tell the amplitude that is shown.
        laws: Names of the laws that are drawn, see ``in_figures``.
    """
    shared = shared_level(rows)
    drawn = [row for row in rows if row.law in laws]
    gains: list[Series] = []
    phases: list[Series] = []
    nyquist: list[Series] = []
    disks: list[tuple[float, str]] = []
    for row in drawn:
        index = row.level_index(shared)
        if index is None:
            continue

        level = row.at(index)[0]
        loop = interpolated(level.frequency, level.column[:, level.index])
        size = np.abs(loop.L)
        # Below the lowest measured line the response is extrapolated, and not drawn.
        measured = loop.frequency >= level.frequency[0]
        bode = _about_largest(measured & (size > _LEAST), size)
        near = measured & (size < _NYQUIST)
        gains.append(_series(row.law, loop.frequency, size, bode))
        phases.append(_series(row.law, loop.frequency, _phase(loop, level.margins), bode))
        nyquist.append(_series(row.law, loop.L.real, loop.L.imag, near))
        disks.append((level.margins.disk, row.law))

    beside = ""
    if disks:
        disk, law = min(disks)
        nyquist.append(_disk(disk))
        beside = f", disk margin {number(disk)} ({law})"
    frequency = "f [Hz]"
    unit = setup.case.nominal.system.inputs[0].unit
    return [
        LineChart(name=f"{setup.name}: gain", titles=(frequency, "|L|"), lines=gains, limit=1.0),
        LineChart(name="phase", titles=(frequency, "[deg]"), lines=phases, limit=-180.0),
        LineChart(
            name=f"Nyquist; ×: -1{beside}",
            titles=("Re L", "Im L"),
            lines=nyquist,
            points=[(-1.0, 0.0)],
            equal=True,
        ),
        LineChart(
            name="delay margin; hollow: not trustworthy",
            titles=(f"injected [{unit} rms]", "[ms]"),
            lines=[series for row in drawn for series in _delays(row)],
        ),
    ]


def _series(name: str, x: Array, y: Array, shown: NDArray[np.bool_]) -> Series:
    """Curve through the points that are shown, with a gap where others lie between them."""
    indices = np.flatnonzero(shown)
    points_x: list[float] = []
    points_y: list[float | None] = []
    for place, index in enumerate(indices):
        if place and index > indices[place - 1] + 1:
            points_x.append(float(x[index]))
            points_y.append(None)
        points_x.append(float(x[index]))
        points_y.append(float(y[index]))
    return Series(name=name, x=points_x, y=points_y)


def _about_largest(shown: NDArray[np.bool_], size: Array) -> NDArray[np.bool_]:
    """The points without a gap about the largest one: beyond a gap the phase may be a turn off."""
    largest = int(np.argmax(np.where(shown, size, 0.0)))
    gaps = np.flatnonzero(~shown)
    first = gaps[gaps < largest].max(initial=-1)
    last = gaps[gaps > largest].min(initial=len(shown))
    indices = np.arange(len(shown))
    return shown & (indices > first) & (indices < last)


def _phase(loop: LoopGain, margins: Margins) -> Array:
    """Continuous phase of L on the branch of all laws [deg].

    At the crossover frequency with the least phase margin it lies within half a turn of -180, so
    that its distance from the line there is this margin; without one it does at the lowest gain.
    """
    phase = np.degrees(loop.phase)
    at = len(phase) - 1
    if math.isfinite(margins.crossover):
        at = int(np.argmin(np.abs(np.log(loop.frequency / margins.crossover))))
    turns = np.round((phase[at] + 180) / 360)
    return phase - 360 * turns


def _delays(row: LawMargins) -> list[Series]:
    """Delay margin over the amplitude at the first input, where there is one."""
    levels = row.of_inputs[: len(LEVELS)]
    finite = [level for level in levels if math.isfinite(level.margins.delay)]
    if not finite:
        return []
    return [
        Series(
            name=row.law,
            x=[float(f"{level.rms:.3g}") for level in finite],
            y=[1e3 * level.margins.delay for level in finite],
            good=[not level.doubt for level in finite],
        )
    ]


def _disk(disk: float) -> Series:
    """Disk that L of a law touches, of all with its shape about -1 the largest."""
    circle = disk * np.exp(1j * np.linspace(0, 2 * np.pi, 181)) / 2
    excluded = -(1 - circle) / (1 + circle)
    curve = _series("disk margin", excluded.real, excluded.imag, np.abs(excluded) < _NYQUIST)
    return curve.model_copy(update={"bound": True})

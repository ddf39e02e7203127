"""Bode and Nyquist plots of the laws of a loop, and their delay margins over the amplitude."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.results.result import LineChart, Series
from grosmc_mj.output.results.tables import number
from grosmc_mj.studies.margins.frequency_response import LoopGain, interpolated
from grosmc_mj.studies.margins.margins import Setup
from grosmc_mj.studies.margins.row import LEVELS, LawMargins, shared_level

# Largest |L| of a Nyquist plot.
_NYQUIST = 3.0
# Least |L| of a Bode plot: no margin depends on less, whose phase is that of noise.
_LEAST = 0.03
# Least phase at the lowest frequency of a Bode plot [deg]: that of three integrators.
_LOWEST = -270.0


def charts(setup: Setup, rows: Sequence[LawMargins]) -> list[LineChart]:
    """Return Bode and Nyquist plots of L at the first input, and the delay over amplitude."""
    shared = shared_level(rows)
    gains: list[Series] = []
    phases: list[Series] = []
    nyquist: list[Series] = []
    disks: list[tuple[float, str]] = []
    for row in rows:
        index = row.level_index(shared)
        if index is None:
            continue

        level = row.at(index)[0]
        loop = interpolated(level.frequency, level.column[:, level.index])
        size = np.abs(loop.L)
        # Below the lowest measured line the response is extrapolated, and not drawn.
        measured = loop.frequency >= level.frequency[0]
        bode = measured & (size > _LEAST)
        near = measured & (size < _NYQUIST)
        gains.append(_series(row.law, loop.frequency[bode], size[bode]))
        phases.append(_series(row.law, loop.frequency[bode], _phase(loop)[bode]))
        nyquist.append(_series(row.law, loop.L.real[near], loop.L.imag[near]))
        disks.append((level.margins.disk, row.law))

    if disks:
        nyquist.append(_disk(*min(disks)))
    frequency = "f [Hz]"
    unit = setup.case.nominal.system.inputs[0].unit
    return [
        LineChart(name=f"{setup.name}: gain", titles=(frequency, "|L|"), lines=gains, limit=1.0),
        LineChart(name="phase", titles=(frequency, "[deg]"), lines=phases, limit=-180.0),
        LineChart(name="Nyquist", titles=("Re L", "Im L"), lines=nyquist, equal=True),
        LineChart(
            name="delay margin; hollow: not trustworthy",
            titles=(f"injected [{unit} rms]", "[ms]"),
            lines=[series for row in rows for series in _delays(row)],
        ),
    ]


def _series(name: str, x: Array, y: Array) -> Series:
    """Curve through points."""
    return Series(name=name, x=x.tolist(), y=y.tolist())


def _phase(loop: LoopGain) -> Array:
    """Continuous phase of L that begins within a turn above ``_LOWEST`` [deg]."""
    phase = np.degrees(loop.phase)
    turns = np.floor((phase[0] - _LOWEST) / 360)
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


def _disk(disk: float, law: str) -> Series:
    """Disk that L of a law touches, of all with its shape about -1 the largest."""
    circle = disk * np.exp(1j * np.linspace(0, 2 * np.pi, 181)) / 2
    excluded = -(1 - circle) / (1 + circle)
    inside = excluded[np.abs(excluded) < _NYQUIST]
    return _series(f"disk {number(disk)} ({law})", inside.real, inside.imag)

"""Largest and RMS values of the error or of a state, and of a run beside its nominal optimum."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from grosmc_mj.experiments.requirements.measured_run import MeasuredRun
from grosmc_mj.experiments.requirements.metrics import DWELL, largest_of, rms_of
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.experiments.requirements.signals import signals_of
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.theory.control.controller import Controller


def largest_at(time: Array, rows: Iterable[Array], names: Sequence[str], after: float = 0.0) -> str:
    """Return in words where the largest magnitude of some signals is.

    Args:
        time: Instants [s], (N + 1,).
        rows: Values of each signal, (N + 1,).
        names: Names of the signals; a single one is left out.
        after: Instant from which on they count [s].
    """
    magnitudes = np.abs(np.vstack(list(rows)))
    magnitudes[:, time < after * (1 - 1e-12)] = 0.0
    signal, instant = np.unravel_index(np.argmax(magnitudes), magnitudes.shape)
    name = f" of {names[int(signal)]}" if len(names) > 1 else ""
    return f"peak{name} at {time[instant]:.3g} s"


def _peak_of_outputs(run: MeasuredRun, z: Array, after: float = 0.0) -> str:
    """Return in words where the outputs' part of rows like the error state, (N + 1, n), is largest.

    Args:
        run: The run.
        z: Error states, or their distance from others.
        after: Instant from which on they count [s].
    """
    error = run.controller.designed.error
    names = [error.names[row] for row in error.output_rows]
    return largest_at(run.comparison.time, z[:, error.output_rows].T, names, after)


class StaysWithin(Requirement):
    """Largest error, or |x_i| of a state, from ``after`` on."""

    key = "stays_within"
    quantity = "output"
    options = ("state", "after", "periodic")
    figure = "output"

    @property
    def metric(self) -> str:
        """Name of the largest magnitude."""
        return largest_of(self.signal, self.after, periodic=self.periodic)

    def note(self, run: MeasuredRun, *, kept: bool) -> str:
        """Say of a missed limit when, and by which of several outputs, it is missed most."""
        if kept:
            return ""
        comparison = run.comparison
        if not self.signal:
            return _peak_of_outputs(run, comparison.z, self.after)
        signals = signals_of(run.trajectory, run.controller, [self.signal], comparison)
        values = signals[self.signal]
        if self.periodic:
            values = np.angle(np.exp(1j * values))
        return largest_at(comparison.time, [values], [self.signal], self.after)


class FinalErrorBelow(StaysWithin):
    """Largest error, or |x_i| of a state, in the last tenth of the run."""

    key = "final_error_below"
    options = ("state", "periodic")

    @classmethod
    def holds_from(cls, after: float, duration: float) -> float:
        """Return the beginning of the last tenth [s]."""
        return (1 - DWELL) * duration


class RmsBelow(Requirement):
    """Root mean square of the error, or of a state, from ``after`` on."""

    key = "rms_below"
    quantity = "output"
    options = ("state", "after", "periodic")

    @property
    def metric(self) -> str:
        """Name of the root mean square."""
        return rms_of(self.signal, self.after, periodic=self.periodic)


class OfWeights(Requirement):
    """A requirement beside the nominal optimum, which is asked of laws with weights only."""

    @classmethod
    def can_be_asked_of(cls, law: Controller, value: Any) -> bool:
        """Whether somebody has chosen the weights of the law's optimum."""
        return law.designed.weighed

    @classmethod
    def refuse_undefined(cls, error: Any, laws: Sequence[str], signal: str) -> None:
        """Refuse laws without weights."""
        if not laws:
            raise ArgumentError("no law that it is asked of has weights: give [task] Q and R")
        super().refuse_undefined(error, laws, signal)


class DeviationBelow(OfWeights):
    """Largest distance from the law's own nominal optimum."""

    key = "deviation_below"
    quantity = "output"
    figure = "deviation"
    usual_metric = "deviation"
    not_in_logs = "a log is not compared with the nominal optimum"

    def note(self, run: MeasuredRun, *, kept: bool) -> str:
        """Say of a missed limit when, and by which of several outputs, it is missed most."""
        if kept:
            return ""
        return _peak_of_outputs(run, run.comparison.z - run.comparison.optimal)


class CostRatioBelow(OfWeights):
    """J with the whole input over J*.

    Under a law that chatters it grows with the run's length: the number belongs to a file's
    duration.
    """

    key = "cost_ratio_below"
    quantity = "1"
    usual_metric = "cost_ratio"
    not_in_logs = "a log does not have the input that the index weighs"
    undefined = "J* is zero: the run starts where it shall end"

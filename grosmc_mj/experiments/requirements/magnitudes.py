"""Largest and RMS values of the error or of a state, and of a run beside its nominal optimum."""

from __future__ import annotations

from grosmc_mj.experiments.requirements.metrics import DWELL, largest_of, rms_of
from grosmc_mj.experiments.requirements.requirement import Requirement


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


class DeviationBelow(Requirement):
    """Largest distance from the law's own nominal optimum."""

    key = "deviation_below"
    quantity = "output"
    figure = "deviation"
    usual_metric = "deviation"
    not_in_logs = "a log is not compared with the nominal optimum"


class CostRatioBelow(Requirement):
    """J with the whole input over J*.

    Under a law that chatters it grows with the run's length: the number belongs to a file's
    duration.
    """

    key = "cost_ratio_below"
    quantity = "1"
    usual_metric = "cost_ratio"
    not_in_logs = "a log does not have the input that the index weighs"
    undefined = "J* is zero: the run starts where it shall end"

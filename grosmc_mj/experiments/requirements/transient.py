"""Settling time and overshoot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.experiments.requirements.measured_run import MeasuredRun
from grosmc_mj.experiments.requirements.measurement import Windows, bands
from grosmc_mj.experiments.requirements.metrics import (
    DWELL,
    SETTLING_BAND,
    Metric,
    settled_in,
    settling,
)
from grosmc_mj.experiments.requirements.requirement import ROUNDING, Requirement
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.theory.control.controller import Controller


@dataclass(frozen=True, kw_only=True)
class SettlesWithin(Requirement):
    """The error stays in a band from then on [s], up to the onset of a later disturbance.

    Attributes:
        band: Half width of the band in the unit of the output; None for 2 % of the error at the
            start.
        band_written: The band as written in the file.
    """

    key = "settles_within"
    quantity = "s"
    options = ("band",)
    figure = "output"
    undefined = "not reached"

    band: float | None = None
    band_written: str = ""

    @property
    def metric(self) -> str:
        """Name of the time after which the error has not left the band."""
        return settled_in(self.band)

    @property
    def tolerated_as(self) -> str:
        """Name of the usual settling time."""
        return "settling_time"

    @property
    def windows(self) -> Windows:
        """The band, if it is not the usual one."""
        return bands(self.band)

    @property
    def words(self) -> str:
        """The requirement in words."""
        if self.band is None:
            return super().words
        return f"{super().words} to {self.band_written}"

    def refuse_start(self, law: Controller, x0: Sequence[float]) -> None:
        """Refuse a start without error, of which the usual band is a share."""
        if self.band is None:
            share = f"its band is {100 * SETTLING_BAND:g} %"
            require_initial_error(law, x0, f"{self.key}: {share}")

    def why_undecidable(self, transient: float) -> str:
        """Say that a tenth of the transient must be left to see that the error stays."""
        latest = (1 - DWELL) * transient
        if self.number <= latest * (1 + 1e-12):
            return ""
        needed = math.ceil(100 * self.number / (1 - DWELL)) / 100
        return (
            f"there are {transient:g} s before a run ends or a disturbance begins; they tell up to "
            f"{latest:g} s, since an error counts as settled after a tenth of them in the band: "
            f"require that at most, or make them {needed:g} s at least"
        )

    def value_of(self, run: MeasuredRun) -> float:
        """Return the settling time; infinite if it is not reached."""
        values = run.values(self.windows)
        if self.band is None:
            return values["settling_time"]
        settled = values[self.metric]
        return settled if settled < run.trajectory.time[-1] else math.inf

    def of_optimum(self, run: MeasuredRun) -> Metric:
        """Return the settling time of the nominal optimum."""
        settled = run.settled(run.comparison.optimal, self.band)
        return settling(math.inf if settled is None else settled)

    def note(self, run: MeasuredRun, *, kept: bool) -> str:
        """Say of a simulation that is late how long its nominal optimum takes."""
        if kept or not run.simulated or not _has_nominal_error(run.controller):
            return ""
        settled = self.of_optimum(run)
        if settled.value is None:
            return "its nominal optimum does not settle either"
        return f"its nominal optimum takes {settled.value:.3g} s"

    def order_share(
        self, share: Array, metrics: Mapping[str, Array], transient: Array, start: float
    ) -> Array:
        """Tell runs that never settle apart by the error that is left.

        Their margin is that of the transient's end T. It is made less by the error left in the last
        tenth of T over the nominal error at the start, or over the band if that is wider:
        (number - T) / number - max|e| / max(|e(0)|, band). So the larger error is the worse one.
        """
        never = metrics[self.metric] > (1 - DWELL) * transient
        error_left = metrics["left"] / max(start, self.band or 0.0)
        worse = 1 - transient / self.number - error_left
        return np.minimum(share, np.where(never, worse, np.inf))


def _has_nominal_error(law: Controller) -> bool:
    """Whether the error of the law's nominal loop is that of its design: of K z, with more or not.

    Laws with an integrator of their own and a user's laws are only compared with an optimum.
    """
    return law.designed.follows_optimum or hasattr(law.parameters, "K")


class OvershootBelow(Requirement):
    """Largest error beyond zero, in the transient, as a share of the error at the start."""

    key = "overshoot_below"
    quantity = "1"
    usual_metric = "overshoot"
    undefined = "there is no error at the start"
    # Several times the error at the start is a mistaken percentage.
    usual = 1.0

    @classmethod
    def refuse_undefined(cls, error: Any, laws: Sequence[str], signal: str) -> None:
        """Refuse several outputs."""
        if len(error.output_rows) > 1:
            raise ArgumentError("several outputs have no one overshoot")

    def refuse_start(self, law: Controller, x0: Sequence[float]) -> None:
        """Refuse a start without error."""
        require_initial_error(law, x0, f"{self.key}: it is a share")


# -- the error at the start ------------------------------------------------------------------------


def initial_error(law: Controller, x0: Sequence[float]) -> float:
    """Return the size of the outputs' error at a start (n,), in their unit."""
    error = law.designed.error
    z = error.along(np.zeros(1), np.array([x0]), law.parameters)[0]
    return float(np.linalg.norm(z[list(error.output_rows)]))


def require_initial_error(law: Controller, x0: Sequence[float], reason: str) -> None:
    """Refuse a start without error.

    Args:
        law: One of the laws.
        x0: Start, (n,).
        reason: What is a share of the error at the start.

    Raises:
        ArgumentError: If the error is zero to rounding.
    """
    if initial_error(law, x0) > ROUNDING:
        return
    raise ArgumentError(
        f"{reason} of the error at the start, and runs start without error: ask for "
        "stays_within with after instead, or start elsewhere"
    )

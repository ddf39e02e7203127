"""An event of a run, and the swings before it: a signal reaches a band around its target.

The event is the instant at which the error enters the band and stays there up to the end of the
run. A swing is a reversal of the signal before that: it has left its start by more than the half
width of the band, and then turns back by more than that, so that noise makes no swings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from grosmc_mj.experiments.requirements.accumulator import wrapped
from grosmc_mj.experiments.requirements.conditions import RecordedRun
from grosmc_mj.experiments.requirements.measured_run import MeasuredRun
from grosmc_mj.experiments.requirements.metrics import DWELL, stays
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.experiments.requirements.signals import ERROR
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.compiler import compile_python
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.wording import spelled

# Margin, in parts of the number, of a run without the event: searches compare finite numbers.
_NEVER = -1e3


class Event(NamedTuple):
    """An event of one run.

    Attributes:
        reached: Instant of the event [s]; infinite if it does not come.
        swings: Number of the signal's reversals before it.
        last_peak: Magnitude of the signal at the last of them; 0 without one.
    """

    reached: float
    swings: float
    last_peak: float


def find_event(time: Array, error: Array, turn: float, signal: Array, band: float) -> Event:
    """Return the event of a recorded run.

    Args:
        time: Instants from 0 on [s], (N,).
        error: Error, which shall be in the band, (N,).
        turn: A turn of an error that counts modulo one, else 0.
        signal: Signal whose reversals are counted, (N,).
        band: Half width of the band.
    """
    return Event(*_compiled()(time, error, turn, signal, band))


# Compiled once for all runs.
@cache
def _compiled() -> Any:
    """Return the compiled ``_follow``."""
    return compile_python(_follow)


def _follow(
    time: Array, error: Array, turn: float, signal: Array, band: float
) -> tuple[float, float, float]:
    """Follow a signal from one extreme to the next, up to the event."""
    reached = math.inf
    swings = 0.0
    last_peak = 0.0
    # The sign of the motion is 0 until the signal leaves its start.
    direction = 0.0
    extreme = signal[0]
    extreme_time = 0.0
    reversals = 0.0
    peak = 0.0
    for t, e, value in zip(time, error, signal):  # noqa: B905
        outside = abs(wrapped(e, turn)) > band
        if outside:
            reached = math.inf
        elif math.isinf(reached):
            reached = t

        moved = value - extreme
        turns = direction * moved < 0.0 and abs(moved) > band
        if turns:
            reversals += 1.0
            peak = abs(extreme)
        # It is known only when the signal has turned back, which may be within the band.
        if outside or (turns and extreme_time < reached):
            swings = reversals
            last_peak = peak

        leaves_start = direction == 0.0 and abs(moved) > band
        if turns or leaves_start:
            direction = math.copysign(1.0, moved)
        if turns or leaves_start or direction * moved > 0.0:
            extreme = value
            extreme_time = t
    return reached, swings, last_peak


@dataclass(frozen=True, kw_only=True)
class EventRequirement(Requirement):
    """A requirement on what a run does until an error is in a band for good.

    Attributes:
        band: Half width of the band in the unit of the state or output.
        band_written: The band as written in the file.
        measures: Attribute of the event that is limited.
    """

    options = ("state", "band", "periodic")
    needs_band = True
    recorded = True
    measures: ClassVar[str]

    band: float = math.inf
    band_written: str = ""

    @property
    def metric(self) -> str:
        """Name of the limited value and of the event."""
        before = "" if self.measures == "reached" else " before"
        turn = " modulo a turn" if self.periodic else ""
        signal = self.signal or "error"
        return f"{spelled(self.measures)}{before} {signal} in {self.band!r}{turn}"

    def of_record(self, run: RecordedRun) -> float:
        """Return the limited value; infinite where the error is not in the band for good.

        It must stay for the last tenth of the run at least: one that swings through the band is
        always inside for a moment before some end.
        """
        error = run.controller.designed.error
        outputs = [error.names[row] for row in error.output_rows]
        away = f"{self.signal} error" if self.signal in outputs else self.signal or ERROR
        # Where an output is a state, it is the state itself that swings.
        moving = outputs[0] if not self.signal and len(outputs) == 1 else self.signal
        if moving not in {state.name for state in error.system.states}:
            moving = away

        time = run.trajectory.time
        signals = run.signals({away, moving})
        turn = 2 * math.pi if self.periodic else 0.0
        event = find_event(time, signals[away], turn, signals[moving], self.band)
        if not stays(event.reached, time[-1]):
            return math.inf
        return getattr(event, self.measures)

    @property
    def band_in_words(self) -> str:
        """The band in words."""
        turn = " modulo a turn" if self.periodic else ""
        return f"{self.band_written}{turn}"

    def measured(self, run: MeasuredRun) -> tuple[float | None, str]:
        """Return the limited value of a run, or that the band is not reached."""
        value = self.value_of(run)
        if math.isinf(value):
            return None, f"does not come to {self.band_in_words} and stay"
        return value, ""

    def order_share(
        self, share: Array, metrics: Mapping[str, Array], transient: Array, start: float
    ) -> Array:
        """Return margins in parts of the number, finite ones of runs without the event too."""
        return np.maximum(share, _NEVER)


class SwingRequirement(EventRequirement):
    """A requirement on the swings of one state or output before the event."""

    @property
    def words(self) -> str:
        """The requirement in words."""
        number = f"{self.number:g}" if self.unit == "1" else self.written
        return f"{self.title} {number} before it is within {self.band_in_words}"

    @classmethod
    def refuse_undefined(cls, error: Any, laws: Sequence[str], signal: str) -> None:
        """Refuse several outputs together."""
        if len(error.output_rows) > 1 and not signal:
            raise ArgumentError("several outputs swing together: name one of them as state")


class ReachesWithin(EventRequirement):
    """The error, or |x_i| of a state, enters a band by then [s] and stays to the end of the run.

    Unlike ``settles_within`` it counts the whole run, and any state or output.
    """

    key = "reaches_within"
    quantity = "s"
    figure = "output"
    measures = "reached"

    @property
    def words(self) -> str:
        """The requirement in words."""
        return f"{self.title} {self.written} to {self.band_in_words}"

    @property
    def tolerated_as(self) -> str:
        """Name of the usual settling time."""
        return "settling_time"

    def refuse_duration(self, duration: float) -> None:
        """Refuse runs without a tenth left in which the error is seen to stay."""
        latest = (1 - DWELL) * duration
        if self.number > latest * (1 + 1e-12):
            raise ArgumentError(
                f"{self.key}: a run of {duration:g} s tells up to {latest:g} s, since an error "
                "must stay in the band for its last tenth: require that at most"
            )


class SwingsBelow(SwingRequirement):
    """Number of reversals before the error is in a band for good, at most."""

    key = "swings_below"
    quantity = "1"
    measures = "swings"


class LastPeakBelow(SwingRequirement):
    """Magnitude at the last reversal before the error is in a band for good; 0 without one.

    It is that of the state itself, also where the state is an output; of an output that is no
    state it is that of its error.
    """

    key = "last_peak_below"
    quantity = "output"
    measures = "last_peak"

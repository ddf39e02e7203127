"""Metrics as folds: what is kept of a run, how an instant is noted, and what that says at the end.

All of it is written once. A law notes its samples while it runs, in Python and in compiled code;
of a recorded run every instant is noted, by the same function.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.compilation import compile_python
from grosmc_mj.jitable import jitable
from grosmc_mj.records import pack, record_dtype

# The usual 2 % band, of the initial error.
SETTLING_BAND = 0.02
# The part of the time that an error must stay in it.
DWELL = 0.1


class Windows(NamedTuple):
    """Error windows and settling bands that are measured besides the usual metrics.

    Attributes:
        after: From when on largest and RMS errors are wanted [s].
        bands: Widths of further bands to settle in, in the unit of the output.
    """

    after: tuple[float, ...] = ()
    bands: tuple[float, ...] = ()

    def numbers(self) -> tuple[Array, Array]:
        """The same as ``after`` and ``widths`` of ``MeterNumbers``."""
        return np.array(self.after or (0.0,), float), np.array((0.0, *self.bands))


NO_WINDOWS = Windows()


@dataclass
class Meters:
    """What has been noted of a run up to some instant.

    Attributes:
        error: Largest error of the outputs from each of the wanted times on, (k,).
        squares: Sum of the squares of those errors, (k,).
        count: Of how many instants, (k,).
        start: Error at t = 0.
        band: Errors up to this count as none, for each band, (b,).
        outside: Last time of the transient at which the error was beyond it [s], (b,); or -1.
        left: Largest error in the late part of the transient.
        beyond: Largest error of the other sign than the first, in the transient.
        deviation: Largest distance of the outputs from the optimum.
        sliding: Largest entry of |s|.
        sliding_start: The same at t = 0.
        input: Largest entry of |u| that the plant is given.
        position: Of a cart at t = 0 [m].
        travel: How far it went [m].
    """

    error: Array = field(default_factory=lambda: np.zeros(1))
    squares: Array = field(default_factory=lambda: np.zeros(1))
    count: Array = field(default_factory=lambda: np.zeros(1))
    start: float = 0.0
    band: Array = field(default_factory=lambda: np.zeros(1))
    outside: Array = field(default_factory=lambda: -np.ones(1))
    left: float = 0.0
    beyond: float = 0.0
    deviation: float = 0.0
    sliding: float = 0.0
    sliding_start: float = 0.0
    input: float = 0.0
    position: float = 0.0
    travel: float = 0.0

    @classmethod
    def of(cls, known: MeterNumbers, **more: Any) -> Any:
        """Those of a new run, with room for what these numbers ask."""
        k, b = len(known.after), len(known.widths)
        return cls(
            np.zeros(k), np.zeros(k), np.zeros(k), band=np.zeros(b), outside=-np.ones(b), **more
        )


@dataclass(frozen=True)
class MeterNumbers:
    """What meters need to know.

    Attributes:
        after: From when on largest errors are wanted [s], (k,).
        onset: End of the transient [s].
        part: Part of the error at the start that counts as no error in the first band.
        widths: What else counts as none, for each band, (b,).
        late: When the late part of the transient begins [s].
    """

    after: Array = field(default_factory=lambda: np.zeros(1))
    onset: float = math.inf
    part: float = SETTLING_BAND
    widths: Array = field(default_factory=lambda: np.zeros(1))
    late: float = math.inf


def transient_end(onset: float) -> float:
    """When the transient ends; a disturbance that acts from the start is part of it [s]."""
    return onset if onset > 0 else math.inf


@jitable
def larger(value: float, known: float) -> float:
    """The larger of two; not a number is none, in Python and in compiled code."""
    return value if value > known else known


@jitable
def note(
    t: float,
    error: float,
    deviation: float,
    u: float,
    s: float,
    position: float,
    meters: Any,
    known: Any,
) -> None:
    """Note an instant.

    Args:
        t: Its time [s].
        error: Of a single output with its sign, or the norm of several.
        deviation: The same from the optimum.
        u: Largest entry of |u| that the plant is given.
        s: Largest entry of |s|.
        position: Of a cart [m].
        meters: ``Meters`` of the run.
        known: ``MeterNumbers``.
    """
    if t == 0.0:
        meters.start, meters.sliding_start, meters.position = error, s, position
        for i in range(len(known.widths)):
            meters.band[i] = known.widths[i]
        meters.band[0] += known.part * abs(error)
    if t <= known.onset * (1 + 1e-12):
        for i in range(len(known.widths)):
            if abs(error) > meters.band[i]:
                meters.outside[i] = t
        if t >= known.late * (1 - 1e-12):
            meters.left = larger(abs(error), meters.left)
        meters.beyond = larger(-error if meters.start > 0.0 else error, meters.beyond)
    for i in range(len(known.after)):
        if t >= known.after[i] * (1 - 1e-12):
            meters.error[i] = larger(abs(error), meters.error[i])
            meters.squares[i] += error * error
            meters.count[i] += 1.0
    meters.deviation = larger(abs(deviation), meters.deviation)
    meters.input = larger(u, meters.input)
    meters.sliding = larger(s, meters.sliding)
    meters.travel = larger(abs(position - meters.position), meters.travel)


@dataclass
class Costs:
    """The index up to a sample: by the trapezoid rule of z, and with the input v held.

    Attributes:
        t: Time of the sample [s].
        of_state: ∫ z'Qz dt.
        of_input: ∫ v'Rv dt.
        state_rate: z'Qz at the sample.
        input_rate: v'Rv from there on.
    """

    t: float = 0.0
    of_state: float = 0.0
    of_input: float = 0.0
    state_rate: float = 0.0
    input_rate: float = 0.0


@jitable
def note_costs(t: float, state_rate: Any, input_rate: Any, costs: Any) -> None:
    """Add the interval up to t [s], which ends with these rates, to ``Costs``."""
    elapsed = t - costs.t
    costs.of_state += elapsed * (costs.state_rate + state_rate) / 2
    costs.of_input += elapsed * costs.input_rate
    costs.t, costs.state_rate, costs.input_rate = t, state_rate, input_rate


@dataclass(frozen=True)
class Recording:
    """What is needed, besides its meters, to say what a run did.

    Attributes:
        duration: [s].
        onset: When the first disturbance of each run begins [s], (n,).
        following: From instants to those that were noted next [s].
        windows: What else was measured.
    """

    duration: float
    onset: Array
    following: Callable[[Array], Array]
    windows: Windows = NO_WINDOWS

    @classmethod
    def sampled(
        cls, period: float, duration: float, onset: Array, windows: Windows = NO_WINDOWS
    ) -> Recording:
        """Of runs whose law noted its samples, a period apart [s]."""
        return cls(duration, onset, lambda instants: instants + period, windows)

    @classmethod
    def recorded(cls, time: Array, onset: float, windows: Windows = NO_WINDOWS) -> Recording:
        """Of one run whose instants were recorded [s], (N,); after the last comes none."""

        def following(instants: Array) -> Array:
            return np.append(time, np.inf)[np.searchsorted(time, instants, side="right")]

        return cls(float(time[-1]), np.array([onset]), following, windows)

    @property
    def transient(self) -> Array:
        """How long the transient lasts, in which a run settles [s], (n,)."""
        return transient_of(self.onset, self.duration)


def transient_of(onset: Any, duration: float) -> Any:
    """How long a run of this duration is a transient whose first disturbance begins then [s]."""
    return np.where((onset > 0) & (onset < duration), onset, duration)


def error_after(after: float) -> str:
    """Name of the largest error from then on [s]."""
    return f"error after {after!r} s"


def rms_after(after: float) -> str:
    """Name of the root mean square of the error from then on [s]."""
    return f"rms error after {after!r} s"


def settled_in(band: float | None) -> str:
    """Name of the time to settle in a band, in the unit of the output; None for the usual one."""
    return "settled" if band is None else f"settled in {band!r}"


def folded(meters: Any, recording: Recording) -> dict[str, Array]:
    """What the meters of n runs say, by metric, (n,) each.

    ``settled`` is the first instant from which on a run stays in its band, in its transient. It
    is its settling time if it stays for the last tenth of the transient at least, else infinity:
    an error that swings in and out is always inside for a moment before some end. A run that
    starts without error has a band of zero: it has settled if it never leaves its reference.
    """
    outside = meters["outside"]
    settled = np.where(outside < 0, 0.0, recording.following(outside))
    late = settled[:, 0] > (1 - DWELL) * recording.transient
    windows, start = recording.windows, np.abs(meters["start"])
    # A run that ended before the window begins has no instant in it.
    mean = meters["squares"] / np.maximum(meters["count"], 1.0)
    return {
        "deviation": meters["deviation"],
        "settled": settled[:, 0],
        "settling_time": np.where(late, np.inf, settled[:, 0]),
        "left": meters["left"],
        "overshoot": np.divide(
            meters["beyond"], start, out=np.full(len(start), np.inf), where=start > 0
        ),
        "max_sliding": meters["sliding"],
        "sliding_start": meters["sliding_start"],
        "max_input": meters["input"],
        "cart_travel": meters["travel"],
        **{settled_in(width): settled[:, i + 1] for i, width in enumerate(windows.bands)},
        **{error_after(t): meters["error"][:, i] for i, t in enumerate(windows.after)},
        **{rms_after(t): np.sqrt(mean[:, i]) for i, t in enumerate(windows.after)},
    }


def note_all(time: Array, rows: Array, known: MeterNumbers) -> Any:
    """Meters, (1,), that have noted error, deviation, |u|, |s| and position in rows, (N, 5)."""
    kept = [np.frombuffer(pack(each), record_dtype(each)) for each in (Meters.of(known), known)]
    _noting()(time, rows, *kept)
    return kept[0]


@cache
def _noting() -> Any:
    """The compiled loop over the instants of a recorded run."""

    def note_rows(time: Any, rows: Any, meters: Any, known: Any) -> None:
        for i in range(len(time)):
            row = rows[i]
            note(time[i], row[0], row[1], row[2], row[3], row[4], meters[0], known[0])

    return compile_python(note_rows)

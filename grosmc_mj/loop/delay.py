"""The computer between sensors and actuators: its delay, late samples, missed outputs."""

from __future__ import annotations

import math
from typing import Annotated, Any

from grosmc_mj.fields import Range, checked
from grosmc_mj.jitable import jitable
from grosmc_mj.loop.counter import uniform
from grosmc_mj.loop.rows import row_dtype
from grosmc_mj.loop.sensors import ring_row


@checked()
class Computing:
    """The computer between sensors and actuators.

    Attributes:
        delay: From a sample to its output [s]; a multiple of the timestep. Until the first
            output arrives the actuators are at rest.
        jitter: A sample is late by a whole number of timesteps, evenly from none up to this [s];
            a multiple of the timestep, shorter than the control period.
        missed: Share of the samples whose output comes too late and is thrown away: the previous
            one is held. The law has been sampled all the same.
    """

    delay: Annotated[float, Range(0, unit="s"), "{ms:.4g} ms from sample to output"] = 0.0
    jitter: Annotated[float, Range(0, unit="s"), "samples up to {ms:.4g} ms late"] = 0.0
    missed: Annotated[float, Range(0, 1, below=True), "{percent:.3g} % of the outputs missed"] = 0.0


# Row of the computer: its own numbers with times in timesteps, then the following ones.
COMPUTER = row_dtype(
    Computing,
    # The run: timestep [s], control period [s], timesteps in it, seed and number of the run.
    "timestep",
    "period",
    "stride",
    "seed",
    "run",
    # Kalman filter: 1 if there is one, 1 if it begins settled, age of the oldest measurement.
    "filters",
    "settled",
    "oldest",
    # Extended-state observers: 1 if there is one.
    "observes",
    # Prediction: 1 if the law predicts; the dead time that it knows; the age of its measurements, a
    # part of that; time from a sample to the arrival of its output [s]; share of the model's error
    # that it learns in a period.
    "predicts",
    "dead",
    "age",
    "ahead",
    "learning",
    # Progress: samples taken, timestep of the next one.
    "sample",
    "due",
)


@jitable
def send(u: Any, loop: Any) -> None:
    """Send a law's output u, (m,), unless it is missed, and set the instant of the next sample.

    Sample k is late by a whole number of timesteps from 0 to the jitter.
    """
    q = loop.computer[0]
    n = len(loop.sensors)
    k = int(q.sample)
    if q.missed == 0.0 or uniform(q.seed, q.run, n + 1, k) >= q.missed:
        for j in range(len(loop.actuators)):
            loop.actuators[j].output = u[j]
    late = 0.0
    if q.jitter > 0.0:
        late = math.floor(uniform(q.seed, q.run, n, k + 1) * (q.jitter + 1.0)) * 1.0
    q.sample = k + 1.0
    q.due = (k + 1) * q.stride + late


@jitable
def put_out(a: int, j: int, loop: Any) -> float:
    """Output of the computer to input j in timestep a, within the limit that the law knows."""
    actuator = loop.actuators[j]
    u = actuator.rest if a < 0 else loop.queue[ring_row(a, loop.queue), j]
    return min(actuator.known_limit, max(-actuator.known_limit, u))

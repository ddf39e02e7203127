"""The computer between sensors and actuators: its delay, late samples, missed outputs."""

from __future__ import annotations

import math
from typing import Annotated, Any

from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.fields import Range, checked
from grosmc_mj.simulation.loop.counter import uniform
from grosmc_mj.simulation.loop.rows import row_dtype


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


# Row of the computer: its own numbers with times in timesteps; timestep [s], timesteps in a control
# period, seed and number of the run; number of the next sample and its timestep.
COMPUTER = row_dtype(Computing, "timestep", "stride", "seed", "run", "sample", "due")


@jitable
def send(u: Any, world: Any) -> bool:
    """Send a law's output u, (m,), unless it is missed, and set the instant of the next sample.

    Sample k is late by a whole number of timesteps from 0 to the jitter.

    Returns:
        Whether the output was sent in time.
    """
    q = world.computer[0]
    n = len(world.sensors)
    k = int(q.sample)
    in_time = q.missed == 0.0 or uniform(q.seed, q.run, n + 1, k) >= q.missed
    if in_time:
        for j in range(len(world.actuators)):
            world.actuators[j].output = u[j]

    late = 0.0
    if q.jitter > 0.0:
        late = math.floor(uniform(q.seed, q.run, n, k + 1) * (q.jitter + 1.0)) * 1.0
    q.sample = k + 1.0
    q.due = (k + 1) * q.stride + late
    return in_time

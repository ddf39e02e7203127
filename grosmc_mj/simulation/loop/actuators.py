"""Actuators: delay, gain, resolution, limit, rate limit, lag and dead zone."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.fields import Name, Range, checked
from grosmc_mj.simulation.loop.rows import ring_row, row_dtype
from grosmc_mj.simulation.loop.sensors import quantized
from grosmc_mj.theory.plants.owner_units import INPUT, INPUT_RATE


@checked()
class Actuator:
    """Path from a command to an input of the plant, in this order.

    Attributes:
        of: Name of the input.
        delay: Delay [s]; a multiple of the timestep.
        gain: Factor of the command; 1 of an actuator that is calibrated.
        resolution: Resolution of the command; 0 for none.
        limit: Largest |u|.
        rate_limit: Largest change per second.
        lag: Time constant [s], discretized exactly: the plant gets the mean over each timestep.
        order: 1, or 2 for two equal lags in a row.
        dead_zone: |u| up to which nothing comes out; beyond it, u less the dead zone.
    """

    of: Name
    delay: Annotated[float, Range(0, unit="s"), "{ms:.4g} ms late"] = 0.0
    gain: Annotated[float, Range(), "gain of {value:.4g}"] = 1.0
    resolution: Annotated[float, Range(0, unit=INPUT), "steps of {value:.4g} {unit}"] = 0.0
    limit: Annotated[
        float, Range(0, unit=INPUT, above=True, infinite=True), "within {value:.4g} {unit}"
    ] = math.inf
    rate_limit: Annotated[
        float, Range(0, unit=INPUT_RATE, above=True, infinite=True), "at most {value:.4g} {unit}"
    ] = math.inf
    lag: Annotated[float, Range(0, unit="s"), "{lags} of {ms:.4g} ms"] = 0.0
    order: Annotated[int, Range(1, 2, whole=True)] = 1
    dead_zone: Annotated[float, Range(0, unit=INPUT), "dead up to {value:.4g} {unit}"] = 0.0

    def demanded(self, commands: Array) -> Array:
        """Return what the limit is applied to: commands times the gain, in steps, (N,)."""
        scaled = self.gain * commands
        if self.resolution == 0.0:
            return scaled
        return np.array([quantized(u, self.resolution) for u in scaled.tolist()])


# Row of each input: its actuator with the delay in timesteps; the input at rest;
# exp(-timestep/lag); the outputs of the computer, the rate limit, the first lag and the second lag,
# in the input's unit.
ACTUATOR = row_dtype(Actuator, "rest", "kept", "output", "rated", "first", "second")


def kept_in_a_timestep(actuator: Actuator, timestep: float) -> float:
    """Share exp(-timestep/lag) of its distance from the input that a lag keeps in a timestep."""
    if actuator.lag == 0.0:
        return 0.0
    return math.exp(-timestep / actuator.lag)


@jitable
def lagged(
    u: float,
    tau: float,
    kept: float,
    actuator: Any,
) -> float:
    """Mean over a timestep of u behind one or two lags of tau timesteps, with kept = exp(-1/tau).

    The lags' outputs are brought to the end of the timestep: with the input held they are exact,
    and so is the integral of the output.
    """
    first, second = actuator.first, actuator.second
    actuator.first = u + (first - u) * kept
    mean = u - tau * (actuator.first - first)
    if actuator.order == 1:
        return mean
    actuator.second = u + (second - u) * kept + (first - u) * kept / tau
    return mean - tau * (actuator.second - second)


@jitable
def actuate(i: int, world: Any, given: Any) -> None:
    """Queue the computer's output in timestep i and write the actuators' outputs into given."""
    q = world.computer[0]
    row = ring_row(i, world.queue)
    for j in range(len(world.actuators)):
        actuator = world.actuators[j]
        world.queue[row, j] = actuator.output
        a = i - int(q.delay) - int(actuator.delay)
        u = actuator.rest if a < 0 else world.queue[ring_row(a, world.queue), j]
        u = quantized(actuator.gain * u, actuator.resolution)
        u = min(actuator.limit, max(-actuator.limit, u))
        before, change = actuator.rated, actuator.rate_limit * q.timestep
        u = min(before + change, max(before - change, u))
        actuator.rated = u
        if actuator.lag > 0.0:
            u = lagged(u, actuator.lag / q.timestep, actuator.kept, actuator)
        if actuator.dead_zone > 0.0:
            u = max(u - actuator.dead_zone, 0.0) + min(u + actuator.dead_zone, 0.0)
        given[j] = u

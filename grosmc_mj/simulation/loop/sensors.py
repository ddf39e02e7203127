"""Sensors: resolution, scale, noise, bias, drift, delay and a period of their own."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Annotated, Any

from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import Flag, Name, Range, checked
from grosmc_mj.simulation.loop.counter import normal
from grosmc_mj.simulation.loop.rows import ring_row, row_dtype
from grosmc_mj.theory.plants.owner_units import STATE, STATE_RATE

# A float64 cannot tell whole multiples beyond this apart.
_EXACT = 2.0**52


@checked()
class Sensor:
    """Measurement of a state: y = q round(v / q - phase) + q phase.

    v = scale x + bias + drift t + noise.

    Attributes:
        of: Name of the state.
        resolution: Step q of an encoder; 0 for none.
        phase: Where its steps lie: the middle of one is at q times the phase; 0 for one at 0.
        scale: Factor of the state; 1 of a sensor that is calibrated.
        noise: Standard deviation of a sample.
        bias: Constant error.
        drift: Error that grows with time, per second.
        delay: Age of the measurement [s]; a multiple of the timestep.
        period: Time between two of its own samples, held in between [s], a multiple of the
            timestep; 0 for one at each sample of the law.
        exact: Whether it is ideal on purpose: the state is known exactly, such as a rate that would
            be differenced otherwise.
    """

    of: Name
    resolution: Annotated[float, Range(0, unit=STATE), "steps of {value:.4g} {unit}"] = 0.0
    phase: Annotated[float, Range(-0.5, 0.5), "phase of {value:.4g} steps"] = 0.0
    scale: Annotated[float, Range(), "scale of {value:.4g}"] = 1.0
    noise: Annotated[float, Range(0, unit=STATE), "noise of {value:.4g} {unit}"] = 0.0
    bias: Annotated[float, Range(unit=STATE), "bias of {value:.4g} {unit}"] = 0.0
    drift: Annotated[float, Range(unit=STATE_RATE), "drift of {value:.4g} {unit}"] = 0.0
    delay: Annotated[float, Range(0, unit="s"), "{ms:.4g} ms old"] = 0.0
    period: Annotated[float, Range(0, unit="s"), "every {ms:.4g} ms"] = 0.0
    exact: Flag = False

    def __post_init__(self) -> None:
        if self.exact and not self.ideal:
            raise ArgumentError("exact = true is an ideal sensor: leave its other numbers out")

    @property
    def ideal(self) -> bool:
        """Whether the state is measured as it is."""
        numbers = [item for item in fields(self) if item.name not in ("of", "exact")]
        return all(getattr(self, item.name) == item.default for item in numbers)


# Row of each state: its sensor with times in timesteps; timestep of its last measurement that was
# read.
SENSOR = row_dtype(Sensor, "at")


@jitable
def quantized(value: float, q: float) -> float:
    """Nearest multiple of q; the value itself for q = 0."""
    if q > 0.0 and abs(value) < _EXACT * q:
        return q * math.floor(value / q + 0.5)
    return value


@jitable
def measured_at(i: int, sensor: Any) -> int:
    """Timestep of the newest measurement in timestep i; 0 before the first one arrives."""
    a = i - int(sensor.delay)
    period = int(sensor.period)
    if a > 0 and period > 0:
        a -= a % period
    return max(a, 0)


@jitable
def measure(i: int, k: int, world: Any, measured: Any) -> None:
    """Write the newest measurements in timestep i, at sample k, into ``measured``."""
    q = world.computer[0]
    for j in range(len(world.sensors)):
        sensor = world.sensors[j]
        a = measured_at(i, sensor)
        value = world.past[ring_row(a, world.past), j]
        value = sensor.scale * value + (sensor.bias + sensor.drift * (a * q.timestep))
        if sensor.noise > 0.0:
            value += sensor.noise * normal(q.seed, q.run, j, a)
        middle = sensor.phase * sensor.resolution
        measured.y[j] = quantized(value - middle, sensor.resolution) + middle
        measured.fresh[j] = _new_measurements(a, k, sensor)
        sensor.at = a


@jitable
def _new_measurements(a: int, k: int, sensor: Any) -> int:
    """Number of measurements after the last one that was read, up to that of timestep a."""
    if k == 0:
        return 1
    elapsed = a - int(sensor.at)
    period = int(sensor.period)
    if period > 0:
        return elapsed // period
    return min(elapsed, 1)

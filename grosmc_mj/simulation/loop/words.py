"""A loop in words."""

from __future__ import annotations

import math
from collections.abc import Iterator

from grosmc_mj.plants import System
from grosmc_mj.simulation.loop.loop import Loop
from grosmc_mj.simulation.loop.parts import TUNED_BY, Actuator, Computing, Estimator, Sensor


def loop_words(loop: Loop, system: System) -> list[str]:
    """What is between a law and its plant, a line for each part that is not ideal.

    Args:
        loop: The loop.
        system: Whose states and inputs give the units.
    """
    units = {each.name: each.unit for each in system.states}
    inputs = {each.name: each.unit for each in system.inputs}
    lines = [("computer", _of_computer(loop.computing))]
    lines += [(sensor.of, _of_sensor(sensor, units[sensor.of])) for sensor in loop.sensors]
    lines += [(", ".join(each.of), _of_estimator(each)) for each in loop.estimators]
    lines += [(each.of, _of_actuator(each, inputs[each.of])) for each in loop.actuators]
    said = [(name, ", ".join(words)) for name, words in lines]
    return [f"{name}: {words}" for name, words in said if words]


def _seconds(value: float) -> str:
    return f"{value * 1e3:.4g} ms"


def _of_computer(each: Computing) -> Iterator[str]:
    if each.delay:
        yield f"{_seconds(each.delay)} from sample to output"
    if each.jitter:
        yield f"samples up to {_seconds(each.jitter)} late"
    if each.missed:
        yield f"{100 * each.missed:.3g} % of the outputs missed"


def _of_sensor(each: Sensor, unit: str) -> Iterator[str]:
    if each.resolution:
        yield f"steps of {each.resolution:.4g} {unit}"
    if each.noise:
        yield f"noise of {each.noise:.4g} {unit}"
    if each.bias:
        yield f"bias of {each.bias:.4g} {unit}"
    if each.drift:
        yield f"drift of {each.drift:.4g} {unit}/s"
    if each.delay:
        yield f"{_seconds(each.delay)} old"
    if each.period:
        yield f"every {_seconds(each.period)}"


def _of_estimator(each: Estimator) -> Iterator[str]:
    tuned = f" with {TUNED_BY[each.law].replace('_', ' ')} {each.number:.4g}" if each.number else ""
    yield f"estimated by {each.law}{tuned}" + ("" if each.settled else ", from rest")


def _of_actuator(each: Actuator, unit: str) -> Iterator[str]:
    if math.isfinite(each.limit):
        yield f"within {each.limit:.4g} {unit}"
    if math.isfinite(each.rate_limit):
        yield f"at most {each.rate_limit:.4g} {unit}/s"
    if each.lag:
        yield f"{'two lags' if each.order == 2 else 'a lag'} of {_seconds(each.lag)}"
    if each.delay:
        yield f"{_seconds(each.delay)} late"
    if each.resolution:
        yield f"steps of {each.resolution:.4g} {unit}"
    if each.dead_zone:
        yield f"dead up to {each.dead_zone:.4g} {unit}"

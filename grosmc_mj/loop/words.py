"""A loop in words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import get_args, get_type_hints

from grosmc_mj.loop.actuators import Actuator
from grosmc_mj.loop.delay import Computing
from grosmc_mj.loop.estimators import TUNED_BY, Estimator
from grosmc_mj.loop.loop import Loop
from grosmc_mj.loop.sensors import Sensor
from grosmc_mj.plants import System


def loop_words(loop: Loop, system: System) -> list[str]:
    """What is between a law and its plant, a line for each part that is not ideal.

    Args:
        loop: The loop.
        system: Whose states and inputs give the units.
    """
    units = {each.name: each.unit for each in system.states}
    inputs = {each.name: each.unit for each in system.inputs}
    lines = [("computer", _of(loop.computing))]
    lines += [(sensor.of, _of(sensor, units[sensor.of])) for sensor in loop.sensors]
    lines += [(", ".join(each.of), _of_estimator(each)) for each in loop.estimators]
    lines += [(each.of, _of(each, inputs[each.of])) for each in loop.actuators]
    said = [(name, ", ".join(words)) for name, words in lines]
    return [f"{name}: {words}" for name, words in said if words]


def _of(part: Computing | Sensor | Actuator, unit: str = "") -> Iterator[str]:
    """The words of each number that is not ideal, which stand beside its bounds."""
    lags = "two lags" if getattr(part, "order", 1) == 2 else "a lag"
    for name, hint in get_type_hints(type(part), include_extras=True).items():
        words = next((each for each in get_args(hint)[1:] if isinstance(each, str)), "")
        value = getattr(part, name)
        if words and value and math.isfinite(value):
            yield words.format(
                value=value, unit=unit, ms=1e3 * value, percent=100 * value, lags=lags
            )


def _of_estimator(each: Estimator) -> Iterator[str]:
    tuned = f" with {TUNED_BY[each.law].replace('_', ' ')} {each.number:.4g}" if each.number else ""
    yield f"estimated by {each.law}{tuned}" + ("" if each.settled else ", from rest")

"""A loop in words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from grosmc_mj.loop.loop import Loop
from grosmc_mj.loop.parts import TUNED_BY, Actuator, Computing, Estimator, Sensor
from grosmc_mj.plants import System

# What each number of a part is called, where it is not ideal.
_WORDS: Mapping[type, Mapping[str, str]] = {
    Computing: {
        "delay": "{ms:.4g} ms from sample to output",
        "jitter": "samples up to {ms:.4g} ms late",
        "missed": "{percent:.3g} % of the outputs missed",
    },
    Sensor: {
        "resolution": "steps of {value:.4g} {unit}",
        "noise": "noise of {value:.4g} {unit}",
        "bias": "bias of {value:.4g} {unit}",
        "drift": "drift of {value:.4g} {unit}/s",
        "delay": "{ms:.4g} ms old",
        "period": "every {ms:.4g} ms",
    },
    Actuator: {
        "limit": "within {value:.4g} {unit}",
        "rate_limit": "at most {value:.4g} {unit}/s",
        "lag": "{lags} of {ms:.4g} ms",
        "delay": "{ms:.4g} ms late",
        "resolution": "steps of {value:.4g} {unit}",
        "dead_zone": "dead up to {value:.4g} {unit}",
    },
}


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
    lags = "two lags" if getattr(part, "order", 1) == 2 else "a lag"
    for name, words in _WORDS[type(part)].items():
        value = getattr(part, name)
        if value and math.isfinite(value):
            yield words.format(
                value=value, unit=unit, ms=1e3 * value, percent=100 * value, lags=lags
            )


def _of_estimator(each: Estimator) -> Iterator[str]:
    tuned = f" with {TUNED_BY[each.law].replace('_', ' ')} {each.number:.4g}" if each.number else ""
    yield f"estimated by {each.law}{tuned}" + ("" if each.settled else ", from rest")

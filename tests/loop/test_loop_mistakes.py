"""One clear line for each way in which a loop can be wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from looped import ANGLE, CURRENT, SPEED, H, nominal, scripted, servo

from grosmc_mj.errors import ArgumentError, MistakesError
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor, in_loop
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.simulate import simulate

START = (0.0, 0.0)
# A number of a part by itself.
ALONE: list[tuple[Callable[[], Any], str]] = [
    (lambda: Actuator(CURRENT, limit=0), "limit = 0 must be positive"),
    (lambda: Actuator(CURRENT, limit=math.nan), "limit = nan must be positive"),
    (lambda: Actuator(CURRENT, order=3), "order = 3 must be a whole number from 1 to 2"),
    (lambda: Computing(missed=1), "missed = 1 must be from 0 to below 1"),
    (lambda: Sensor(ANGLE, noise=-1), "noise = -1 must be finite and not negative"),
    (lambda: Sensor(ANGLE, bias=math.inf), "bias = inf must be finite"),
    (lambda: Sensor(3), "of = 3 must be a name"),  # pyright: ignore
    (lambda: Estimator(()), r"of = \(\) must be names of states, at least one"),
    (lambda: Estimator((SPEED,), "eso"), "eso needs bandwidth"),
    (
        lambda: Estimator((SPEED,), "levant", slope=1, bandwidth=3),
        "levant needs slope, has no time_constant, bandwidth",
    ),
    (
        lambda: Estimator((SPEED,), "difference", slope=3),
        "difference needs no number, has no time_constant, slope",
    ),
    (
        lambda: Estimator((SPEED,), "levnt"),  # pyright: ignore
        "unknown estimator 'levnt': did you mean 'levant'",
    ),
    (lambda: Loop(sensors=Sensor(ANGLE)), "must be a tuple of Sensors"),  # pyright: ignore
    (lambda: Loop().changed("sensor", ANGLE, noise=1), r"there is no \[\[sensor\]\]"),
    (lambda: Loop().changed("computing", "", dely=1), "there is no argument dely"),
]
# A part around a law of the servo.
AROUND = [
    (Loop(Computing(delay=1.5 * H)), r"computing: delay = 0.0015 s is no multiple .* take 0.002 s"),
    (Loop(Computing(delay=0.4 * H)), "take 0.001 s, or a shorter timestep"),
    (Loop(sensors=(Sensor(ANGLE, delay=0.1 * H),)), "sensor of rotor angle: delay = 0.0001 s"),
    (Loop(Computing(delay=1000.0)), "delay = 1000 s is 1000000 timesteps"),
    (Loop(actuators=(Actuator(CURRENT, lag=1e6),)), r"lag = 1e\+06 s is more than"),
    (Loop(Computing(jitter=H)), "jitter = 0.001 s must be shorter than the control period"),
    (
        Loop(sensors=(Sensor("rotor angel"),)),
        "sensor: unknown state 'rotor angel': did you mean 'rotor angle'",
    ),
    (Loop(actuators=(Actuator("curent"),)), "unknown input 'curent': did you mean 'current'"),
    (Loop(sensors=(Sensor(ANGLE),) * 2), "2 sensors of 'rotor angle': give one"),
    (
        Loop(estimators=(Estimator((ANGLE,)),)),
        "difference gives a rate: 'rotor angle' is none of rotor speed",
    ),
    (
        Loop(estimators=(Estimator((SPEED,), "kalman", load=1.0),)),
        r"kalman goes by sensors with noise or resolution: there is no \[\[sensor\]\]",
    ),
    (
        Loop(
            sensors=(Sensor(ANGLE),), estimators=(Estimator((SPEED,), "kalman", load=1.0),)
        ),
        "the sensor of rotor angle has neither",
    ),
    (
        Loop(
            sensors=(Sensor(ANGLE, 1e-3),),
            estimators=tuple(Estimator((each,), "kalman", load=1.0) for each in (ANGLE, SPEED)),
        ),
        "two filters by kalman: give one of them all states",
    ),
    (
        Loop(
            sensors=(Sensor(ANGLE, period=2 * H),),
            estimators=(Estimator((SPEED,), "eso", bandwidth=1.0),),
        ),
        "eso runs at the law's pace: the sensor of rotor angle has a period of its own",
    ),
    (
        Loop(
            sensors=(Sensor(ANGLE, 1e-3, delay=H), Sensor(SPEED, 1e-3, delay=2 * H)),
            estimators=(Estimator((ANGLE, SPEED), "kalman", load=1.0),),
        ),
        "kalman: the measurements have different ages, rotor angle 0.001 s, rotor speed 0.002 s",
    ),
]  # fmt: skip


# An option of ``in_loop``.
OPTIONS: list[tuple[dict[str, Any], str]] = [
    ({"run": 1.5}, "run = 1.5 must be a whole number from 0"),
    ({"predict": 3}, "predict = 3 must be True or False"),
    ({"known": Loop(Computing(delay=0.1 * H))}, "delay = 0.0001 s is no multiple"),
    ({"control_period": 1.5 * H}, "control period 0.0015 s is no multiple of the timestep"),
    ({"control_period": 1e6 * H}, "control_period = 1000 s is 1000000 timesteps"),
    ({"timestep": 0.0}, "timestep = 0 must be from 1e-09 to 1e"),
]
LQR = nominal().law("corrected", "lqr")
OBSERVER = Loop(estimators=(Estimator((SPEED,), "eso", bandwidth=1.0),))
Make = Callable[[], Any]
MISTAKES: list[tuple[Make, str]] = [
    *ALONE,
    *((partial(in_loop, LQR, loop, SERVO), words) for loop, words in AROUND),
    *((partial(in_loop, LQR, Loop(), SERVO, **options), words) for options, words in OPTIONS),
    (
        lambda: in_loop(scripted([0.0]), Loop(), SERVO, predict=True),
        "scripted has no design model, which predict needs",
    ),
    (
        lambda: in_loop(scripted([0.0]), OBSERVER, SERVO),
        "scripted has no design model, which eso needs",
    ),
    (
        lambda: in_loop(in_loop(LQR, Loop(), SERVO), Loop(), SERVO),
        "lqr is in a loop already",
    ),
    (
        lambda: simulate(servo(), in_loop(LQR, Loop(), SERVO), START, duration=0.1, timestep=1e-4,
                         control_period=H),
        "a timestep of 0.001 s, not 0.0001 s",
    ),
    (
        lambda: simulate(servo(), in_loop(LQR, Loop(), SERVO), START, duration=0.1,
                         control_period=2 * H),
        "a control period of 0.001 s, not 0.002 s",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("make", "words"), MISTAKES, ids=[words for _, words in MISTAKES])
def test_a_loop_that_cannot_be_is_refused_in_one_line(make: Make, words: str) -> None:
    with pytest.raises(ArgumentError, match=words) as refused:
        make()
    assert "\n" not in str(refused.value)


def test_all_mistakes_are_told_at_once() -> None:
    loop = Loop(
        Computing(delay=1.5 * H, jitter=0.1 * H), (Sensor("x"),), (), (Actuator(CURRENT, 0.1 * H),)
    )
    with pytest.raises(MistakesError) as refused:
        in_loop(LQR, loop, SERVO)
    assert len(refused.value.mistakes) == 4

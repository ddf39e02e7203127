"""One clear line for each way in which a loop can be wrong."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest
from looped import ANGLE, CURRENT, SPEED, H, nominal, scripted, servo

from grosmc_mj.errors import ArgumentError
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor, in_loop
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.simulate import simulate

LQR = nominal().law("corrected", "lqr")
KALMAN = (Estimator((ANGLE, SPEED), "kalman", load=1.0),)
OBSERVER = (Estimator((SPEED,), "eso", bandwidth=1.0),)
PLAIN = in_loop(LQR, Loop(), SERVO)
around = partial(in_loop, LQR, system=SERVO)
played = partial(simulate, servo(), PLAIN, (0, 0), duration=0.1)
# Past the type checker.
wrong: Any = partial
MISTAKES: list[tuple[Any, str]] = [
    # A number of a part by itself.
    (wrong(Estimator, ()), r"of = \(\) must be names of states, at least one"),
    (wrong(Estimator, (SPEED,), "eso"), "eso needs bandwidth"),
    (wrong(Estimator, (SPEED,), slope=3), "difference needs no number, has no time_constant, slop"),
    (wrong(Estimator, (SPEED,), "levnt"), "unknown estimator 'levnt': did you mean 'levant'"),
    (wrong(Loop().changed, "sensor", ANGLE, noise=1), r"there is no \[\[sensor\]\]"),
    # A part around a law of the servo.
    (wrong(around, Loop(Computing(delay=1.5 * H))), r"computing: delay = 0.0015 s is no multiple"),
    (wrong(around, Loop(Computing(delay=0.4 * H))), "take 0.001 s, or a shorter timestep"),
    (wrong(around, Loop(Computing(jitter=H))), "must be shorter than the control period"),
    (wrong(around, Loop(actuators=(Actuator(CURRENT, lag=1e6),))), r"lag = 1e\+06 s is more than"),
    (wrong(around, Loop(sensors=(Sensor("rotor angel"),))), "unknown state .* did you mean 'rotor"),
    (wrong(around, Loop(sensors=(Sensor(ANGLE),) * 2)), "2 sensors of 'rotor angle': give one"),
    (wrong(around, Loop(estimators=(Estimator((ANGLE,)),))), "is none of rotor speed"),
    (wrong(around, Loop(estimators=KALMAN)), r"sensors with noise or resolution: there is no \[\["),
    (wrong(around, Loop(sensors=(Sensor(ANGLE),), estimators=KALMAN)), "angle has neither"),
    (wrong(around, Loop(sensors=(Sensor(ANGLE, 1e-3),), estimators=(
        Estimator((ANGLE,), "kalman", load=1.0), Estimator((SPEED,), "kalman", load=1.0),
    ))), "two filters by kalman: give one of them all states"),
    (wrong(around, Loop(sensors=(Sensor(ANGLE, period=2 * H),), estimators=OBSERVER)),
     "eso runs at the law's pace: the sensor of rotor angle has a period of its own"),
    (wrong(around, Loop(estimators=KALMAN, sensors=(
        Sensor(ANGLE, 1e-3, delay=H), Sensor(SPEED, 1e-3, delay=2 * H),
    ))), "kalman: the measurements have different ages, rotor angle 0.001 s, rotor speed 0.002 s"),
    # Options, and laws that do not fit.
    (wrong(around, Loop(), known=Loop(Computing(delay=0.1 * H))), "0.0001 s is no multiple"),
    (wrong(around, Loop(), control_period=1.5 * H), "period 0.0015 s is no multiple"),
    (wrong(around, Loop(), control_period=1e6 * H), "1000 s is 1000000 timesteps"),
    (wrong(in_loop, scripted([0.0]), Loop(), SERVO, predict=True), "which predict needs"),
    (wrong(in_loop, scripted([0.0]), Loop(estimators=OBSERVER), SERVO), "model, which eso needs"),
    (wrong(in_loop, PLAIN, Loop(), SERVO), "lqr is in a loop already"),
    (wrong(played, timestep=H / 10, control_period=H), "a timestep of 0.001 s, not 0.0001 s"),
    (wrong(played, control_period=2 * H), "a control period of 0.001 s, not 0.002 s"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "words"), MISTAKES)
def test_a_loop_that_cannot_be_is_refused_in_one_line(make: Any, words: str) -> None:
    with pytest.raises(ArgumentError, match=words) as refused:
        make()
    assert "\n" not in str(refused.value)

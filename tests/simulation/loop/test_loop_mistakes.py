"""Loops that are refused, each with one clear line."""

from __future__ import annotations

from typing import Any

import pytest
from looped import ANGLE, CURRENT, SPEED, H, nominal, scripted, servo

from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.simulation.loop import Actuator, Computing, Estimator, Loop, Sensor, apply_loop
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.theory.plants import SERVO

LQR = nominal().law("corrected", "lqr")
AROUND_LQR = apply_loop(Loop(), LQR, SERVO)
WITHOUT_MODEL = scripted([0.0])

KALMAN = (Estimator((ANGLE, SPEED), "kalman", load=1.0),)
TWO_KALMAN = (
    Estimator((ANGLE,), "kalman", load=1.0),
    Estimator((SPEED,), "kalman", load=1.0),
)
OBSERVER = (Estimator((SPEED,), "eso", bandwidth=1.0),)
TWO_AGES = (
    Sensor(ANGLE, 1e-3, delay=H),
    Sensor(SPEED, 1e-3, delay=2 * H),
)


def applied(loop: Loop, law: Any = LQR, **options: Any) -> Any:
    return lambda: apply_loop(loop, law, SERVO, **options)


def run(law: Any = LQR, loop: Any = AROUND_LQR, **periods: Any) -> Any:
    return lambda: simulate(servo(), law, (0, 0), duration=0.1, loop=loop, **periods)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        # Estimators.
        (lambda: Estimator(()), r"of = \(\) must be names of states, at least one"),
        (lambda: Estimator((SPEED,), law="eso"), "eso needs bandwidth"),
        (
            lambda: Estimator((SPEED,), load=3),
            "difference needs no number, has no time_constant, band",
        ),
        (
            lambda: Estimator((SPEED,), law="kalmn"),  # pyright: ignore[reportArgumentType]
            "unknown estimator 'kalmn': did you mean 'kalman'",
        ),
        (
            lambda: Sensor(ANGLE, resolution=1e-3, exact=True),
            "exact = true is an ideal sensor: leave its other",
        ),
        (lambda: Loop().changed("sensor", ANGLE, noise=1), r"there is no \[\[sensor\]\]"),
        # Loops that do not fit the servo.
        (applied(Loop(Computing(delay=1.5 * H))), r"computing: delay = 0.0015 s is no multiple"),
        (applied(Loop(Computing(delay=0.4 * H))), "take 0.001 s, or a shorter timestep"),
        (applied(Loop(Computing(jitter=H))), "must be shorter than the control period"),
        (applied(Loop(actuators=(Actuator(CURRENT, lag=1e6),))), r"lag = 1e\+06 s is more than"),
        (applied(Loop(sensors=(Sensor("rotor angel"),))), "unknown state .* did you mean 'rotor"),
        (applied(Loop(sensors=(Sensor(ANGLE), Sensor(ANGLE)))), "2 sensors of 'rotor angle': give"),
        (applied(Loop(estimators=(Estimator((ANGLE,)),))), "is none of rotor speed"),
        (applied(Loop(estimators=KALMAN)), r"sensors with noise or resolution: there is no \[\["),
        (applied(Loop(sensors=(Sensor(ANGLE),), estimators=KALMAN)), "angle has neither"),
        (
            applied(Loop(sensors=(Sensor(ANGLE, 1e-3),), estimators=TWO_KALMAN)),
            "two filters by kalman: give one of them all states",
        ),
        (
            applied(Loop(sensors=(Sensor(ANGLE, period=2 * H),), estimators=OBSERVER)),
            "eso runs at the law's pace: the sensor of rotor angle has a period of its own",
        ),
        (
            applied(Loop(sensors=TWO_AGES, estimators=KALMAN)),
            "different ages, rotor angle 0.001 s, rotor speed 0.002 s",
        ),
        # Laws and periods.
        (applied(Loop(), known=Loop(Computing(delay=0.1 * H))), "0.0001 s is no multiple"),
        (applied(Loop(), control_period=1.5 * H), "period 0.0015 s is no multiple"),
        (applied(Loop(), control_period=1e6 * H), "1000 s is 1000000 timesteps"),
        (applied(Loop(), WITHOUT_MODEL, predict=True), "which predict needs"),
        (applied(Loop(estimators=OBSERVER), WITHOUT_MODEL), "model, which eso needs"),
        (run(WITHOUT_MODEL), "is around lqr, not around scripted"),
        (run(loop=[AROUND_LQR, None]), "runs of a batch must have a loop, or none"),
        (run(timestep=H / 10, control_period=H), "a timestep of 0.001 s, not 0.0001 s"),
        (run(control_period=2 * H), "a control period of 0.001 s, not 0.002 s"),
    ],
)
def test_a_loop_that_cannot_be_is_refused_in_one_line(call: Any, words: str) -> None:
    with pytest.raises(ArgumentError, match=words) as refused:
        call()
    assert "\n" not in str(refused.value)

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


def assert_one_line(refused: pytest.ExceptionInfo[ArgumentError]) -> None:
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("of", "options", "words"),
    [
        ((), {}, r"of = \(\) must be names of states, at least one"),
        ((SPEED,), {"law": "eso"}, "eso needs bandwidth"),
        (
            (SPEED,),
            {"load": 3},
            "difference needs no number, has no time_constant, band",
        ),
        ((SPEED,), {"law": "kalmn"}, "unknown estimator 'kalmn': did you mean 'kalman'"),
    ],
)
def test_an_estimator_with_wrong_numbers_is_refused(
    of: tuple[str, ...], options: dict[str, Any], words: str
) -> None:
    with pytest.raises(ArgumentError, match=words) as refused:
        Estimator(of, **options)
    assert_one_line(refused)


def test_a_part_that_is_not_there_cannot_be_changed() -> None:
    with pytest.raises(ArgumentError, match=r"there is no \[\[sensor\]\]") as refused:
        Loop().changed("sensor", ANGLE, noise=1)
    assert_one_line(refused)


@pytest.mark.parametrize(
    ("loop", "words"),
    [
        (Loop(Computing(delay=1.5 * H)), r"computing: delay = 0.0015 s is no multiple"),
        (Loop(Computing(delay=0.4 * H)), "take 0.001 s, or a shorter timestep"),
        (Loop(Computing(jitter=H)), "must be shorter than the control period"),
        (Loop(actuators=(Actuator(CURRENT, lag=1e6),)), r"lag = 1e\+06 s is more than"),
        (Loop(sensors=(Sensor("rotor angel"),)), "unknown state .* did you mean 'rotor"),
        (Loop(sensors=(Sensor(ANGLE), Sensor(ANGLE))), "2 sensors of 'rotor angle': give one"),
        (Loop(estimators=(Estimator((ANGLE,)),)), "is none of rotor speed"),
        (Loop(estimators=KALMAN), r"sensors with noise or resolution: there is no \[\["),
        (Loop(sensors=(Sensor(ANGLE),), estimators=KALMAN), "angle has neither"),
        (
            Loop(sensors=(Sensor(ANGLE, 1e-3),), estimators=TWO_KALMAN),
            "two filters by kalman: give one of them all states",
        ),
        (
            Loop(sensors=(Sensor(ANGLE, period=2 * H),), estimators=OBSERVER),
            "eso runs at the law's pace: the sensor of rotor angle has a period of its own",
        ),
        (
            Loop(sensors=TWO_AGES, estimators=KALMAN),
            "kalman: the measurements have different ages, "
            "rotor angle 0.001 s, rotor speed 0.002 s",
        ),
    ],
)
def test_a_loop_that_does_not_fit_the_servo_is_refused(loop: Loop, words: str) -> None:
    with pytest.raises(ArgumentError, match=words) as refused:
        apply_loop(loop, LQR, SERVO)
    assert_one_line(refused)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"known": Loop(Computing(delay=0.1 * H))}, "0.0001 s is no multiple"),
        ({"control_period": 1.5 * H}, "period 0.0015 s is no multiple"),
        ({"control_period": 1e6 * H}, "1000 s is 1000000 timesteps"),
    ],
)
def test_wrong_options_of_a_loop_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ArgumentError, match=words) as refused:
        apply_loop(Loop(), LQR, SERVO, **options)
    assert_one_line(refused)


def test_a_law_without_a_model_cannot_predict() -> None:
    with pytest.raises(ArgumentError, match="which predict needs") as refused:
        apply_loop(Loop(), WITHOUT_MODEL, SERVO, predict=True)
    assert_one_line(refused)


def test_a_law_without_a_model_has_no_observer() -> None:
    with pytest.raises(ArgumentError, match="model, which eso needs") as refused:
        apply_loop(Loop(estimators=OBSERVER), WITHOUT_MODEL, SERVO)
    assert_one_line(refused)


def test_a_loop_around_one_law_is_not_around_another() -> None:
    with pytest.raises(ArgumentError, match="is around lqr, not around scripted") as refused:
        simulate(servo(), WITHOUT_MODEL, (0, 0), duration=0.1, loop=AROUND_LQR)
    assert_one_line(refused)


def test_runs_of_a_batch_are_all_in_a_loop_or_none_is() -> None:
    with pytest.raises(ArgumentError, match="runs of a batch must have a loop, or none") as refused:
        simulate(servo(), LQR, (0, 0), duration=0.1, loop=[AROUND_LQR, None])
    assert_one_line(refused)


@pytest.mark.parametrize(
    ("periods", "words"),
    [
        (
            {"timestep": H / 10, "control_period": H},
            "a timestep of 0.001 s, not 0.0001 s",
        ),
        ({"control_period": 2 * H}, "a control period of 0.001 s, not 0.002 s"),
    ],
)
def test_a_run_with_other_periods_than_its_loop_is_refused(
    periods: dict[str, Any], words: str
) -> None:
    with pytest.raises(ArgumentError, match=words) as refused:
        simulate(servo(), LQR, (0, 0), duration=0.1, loop=AROUND_LQR, **periods)
    assert_one_line(refused)

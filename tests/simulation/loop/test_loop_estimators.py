"""Estimators of a rate and the Kalman filter: exactness, noise and gain."""

from __future__ import annotations

from typing import Any

import control
import numpy as np
import pytest
import scipy.linalg
from looped import ANGLE, CURRENT, SPEED, H, played, scripted, seen, servo

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GainError
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.loop import Actuator, Computing, Estimator, Loop, Sensor, apply_loop
from grosmc_mj.simulation.loop.kalman import kalman_gain
from grosmc_mj.theory.plants import SERVO

EPS = np.finfo(float).eps
# Rate of a coasting rotor [rad/s].
RATE = 2.0
# Readings of up to 3 rad, rounded, over a period: a factor for the roundings on the way.
ROUNDING = 16 * EPS * 3 / H

# Estimators of a rate


def coasting(law: Any, samples: int = 1500, *, settled: bool = False, **number: float) -> Array:
    """Error of an estimate while the rotor turns at a constant rate, held by its input.

    An extended observer gets 0.3 A, which a constant load makes up for.
    """
    p = servo().parameters
    observer = law == "eso"
    if observer:
        u = 0.3
        load = p.Kt * u - p.B * RATE
        disturbances = [Disturbance("rotor", (0, 0, 0, 0, load, 0))]
    else:
        u = p.B * RATE / p.Kt
        disturbances = []

    estimator = Estimator((SPEED,), law, settled=settled, **number)
    run = played(
        np.full(samples, u),
        Loop(estimators=(estimator,)),
        x0=(0.0, RATE),
        modelled=observer,
        disturbances=disturbances,
    )
    np.testing.assert_allclose(run.state[:, 1], RATE, rtol=1e-12)
    return seen(run)[:, 1] - run.state[:-1, 1]


@pytest.mark.parametrize(
    ("law", "number"),
    [
        ("difference", {}),
        ("filtered", {"time_constant": 5e-3}),
        ("eso", {"bandwidth": 50.0}),
    ],
)
def test_a_constant_rate_is_estimated_exactly_in_the_end(law: str, number: dict[str, Any]) -> None:
    error = coasting(law, **number)
    assert error[0] == -RATE
    assert np.abs(error[-100:]).max() < ROUNDING


@pytest.mark.parametrize(
    ("law", "number"),
    [
        ("difference", {}),
        ("filtered", {"time_constant": 5e-3}),
    ],
)
def test_a_settled_estimator_is_exact_from_the_start(law: str, number: dict[str, Any]) -> None:
    error = coasting(law, 200, settled=True, **number)
    assert np.abs(error).max() < ROUNDING


def test_a_sensor_with_a_pace_of_its_own_gives_the_rate_over_its_own_samples() -> None:
    """Two or three of them in a period of the computer."""
    p = servo().parameters
    loop = Loop(sensors=(Sensor(ANGLE, period=2 * H),), estimators=(Estimator((SPEED,)),))
    run = played(np.full(40, p.B * RATE / p.Kt), loop, x0=(0.0, RATE), stride=5)
    assert np.abs(seen(run)[:, 1] - RATE).max() < ROUNDING


def test_a_filtered_rate_begins_with_the_pole_that_it_is_tuned_for() -> None:
    error = coasting("filtered", time_constant=5e-3)
    decay = -RATE * np.exp(-np.arange(50) / 5)
    assert np.abs(error[:50] - decay).max() <= ROUNDING


def largest_error_of_rate(estimator: Estimator, stride: int, *, predict: bool) -> float:
    """Largest error of an estimated rate under random inputs that arrive late."""
    u = np.random.default_rng(0).normal(size=200)
    loop = Loop(
        Computing(delay=4 * H),
        (Sensor(ANGLE, noise=1e-12, delay=2 * H),),
        (estimator,),
        (Actuator(CURRENT, delay=2 * H),),
    )
    run = played(u, loop, stride=stride, modelled=True, predict=predict)
    # A measurement is 2 timesteps old; between samples it grows older.
    errors = seen(run)[2:, 1] - run.state[:-3, 1]
    return np.abs(errors[::stride]).max()


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize(
    "estimator",
    [
        Estimator((SPEED,), "eso", bandwidth=50.0),
        Estimator((SPEED,), "kalman", load=1e-6),
    ],
)
def test_observers_know_when_an_input_arrives(estimator: Estimator, stride: int) -> None:
    """With the loop known they are right while the input jumps; without they are far off.

    A rate gains Kt/J u h in a timestep; the observer's position, which takes the acceleration as
    constant, is off by B h/J of that a sample. |u| is below 4. The noise is 2e-9 in the rate.
    """
    p = servo().parameters
    gained_rate = 4 * p.Kt / p.J * H
    bound = gained_rate * p.B * H / p.J * stride**2
    assert largest_error_of_rate(estimator, stride, predict=True) < bound
    assert bound < 0.1 * largest_error_of_rate(estimator, stride, predict=False)


# The Kalman filter: as much load in a sample as noise, so that it forgets at once

NOISE = 1e-5
LOAD = 1.0


def held_servo() -> tuple[Array, Array]:
    """Transition of the servo over a timestep, by its state and by its input."""
    p = servo().parameters
    rates = np.array(
        [
            [0.0, 1.0, 0.0],
            [0.0, -p.B / p.J, p.Kt / p.J],
            [0.0, 0.0, 0.0],
        ]
    )
    transition = scipy.linalg.expm(rates * H)
    return transition[:2, :2], transition[:2, 2:]


def expected_gain(noise: float, load: float) -> Array:
    A, B = held_servo()
    return kalman_gain(A, B, [0], np.array([noise**2]), load)


def gain_of(noise: float, load: float, of: str = ANGLE, resolution: float = 0.0) -> Array:
    """Gain of the filter in a loop with one sensor."""
    loop = Loop(
        sensors=(Sensor(of, resolution, noise=noise),),
        estimators=(Estimator((ANGLE, SPEED), "kalman", load=load),),
    )
    return apply_loop(loop, scripted([0.0], modelled=True), SERVO).start.software.gain


each_noise = pytest.mark.parametrize(("noise", "load"), [(1e-3, 1e-2), (1e-7, 1.0)])


@each_noise
def test_the_gain_is_python_control_s(noise: float, load: float) -> None:
    """Theirs is of the predicted state, A times ours; two solvers of one Riccati equation."""
    A, B = held_servo()
    C = np.array([[1.0, 0.0]])
    theirs, *_ = control.dlqe(A, B, C, load**2, noise**2)
    np.testing.assert_allclose(A @ expected_gain(noise, load), theirs, rtol=1e-6)


@each_noise
def test_the_gain_of_a_loop_is_that_of_the_linear_model(noise: float, load: float) -> None:
    """Differences over 1e-6 of a linear model are off by rounding: 1e-16 / 1e-6, over h."""
    expected = np.hstack([expected_gain(noise, load), np.zeros((2, 1))])
    np.testing.assert_allclose(gain_of(noise, load), expected, rtol=1e-6)


@each_noise
def test_a_resolution_adds_a_twelfth_of_its_square_to_the_variance(
    noise: float, load: float
) -> None:
    """0.6^2 + 0.8^2 = 1."""
    rounded = gain_of(0.6 * noise, load, resolution=0.8 * noise * 12**0.5)
    np.testing.assert_allclose(gain_of(noise, load), rounded, rtol=1e-9)


@pytest.mark.parametrize(("settled", "start"), [(False, 0.0), (True, 2.0)])
def test_a_filter_begins_at_the_true_state_or_at_zero(settled: bool, start: float) -> None:
    estimator = Estimator((SPEED,), "kalman", load=LOAD, settled=settled)
    loop = Loop(sensors=(Sensor(ANGLE, noise=NOISE),), estimators=(estimator,))
    run = played(np.zeros(50), loop, x0=(0.0, 2.0), modelled=True)
    estimates = seen(run)
    # Its error is of the order of what a load of 1 A does to the rate in a sample.
    assert estimates[-1, 1] == pytest.approx(run.state[-2, 1], abs=0.05)
    # A first reading of pure noise, within five of its deviations.
    gain = expected_gain(NOISE, LOAD)
    assert abs(estimates[0, 1] - start) < 5 * gain[1, 0] * NOISE
    # A state that the filter does not give stays as it was measured.
    assert estimates[0, 0] != 0.0


def test_a_filter_waits_for_the_first_measurement_after_the_start() -> None:
    """Its oldest measurement is of the start of a moving rotor until then."""
    loop = Loop(
        sensors=(Sensor(ANGLE, noise=NOISE, delay=4 * H),),
        estimators=(Estimator((ANGLE, SPEED), "kalman", load=LOAD),),
    )
    run = played(np.zeros(8), loop, x0=(0.0, 2.0), modelled=True)
    estimates = seen(run)
    np.testing.assert_array_equal(estimates[:5], estimates[:1].repeat(5, 0))
    assert np.all(np.diff(estimates[4:, 0]) > H)


@pytest.mark.parametrize(
    ("noise", "load", "of"),
    [
        # Numbers too far apart, for which SciPy finds a filter that diverges.
        (1e-12, 1e-3, ANGLE),
        # A hidden position.
        (1e-3, LOAD, SPEED),
    ],
)
def test_a_filter_that_cannot_be_is_refused(noise: float, load: float, of: str) -> None:
    with pytest.raises(GainError, match="kalman: no steady filter"):
        gain_of(noise, load, of)


# Rates that nothing is said of

ENCODER = Sensor(ANGLE, 1e-3)
ROTOR = np.sin(np.arange(60) / 5.0)


def seen_speeds(*sensors: Sensor, estimators: tuple[Estimator, ...] = ()) -> Array:
    """Speeds that the law gets in a loop with these parts."""
    return seen(played(ROTOR, Loop(sensors=sensors, estimators=estimators)))[:, 1]


def test_the_rate_of_a_measured_position_is_differenced() -> None:
    differenced = seen_speeds(ENCODER, estimators=(Estimator((SPEED,), "difference"),))
    np.testing.assert_array_equal(seen_speeds(ENCODER), differenced)


@pytest.mark.parametrize(
    "loop", [Loop(sensors=(ENCODER, Sensor(SPEED, exact=True))), Loop(Computing(delay=H))]
)
def test_a_rate_with_an_exact_sensor_or_of_a_position_without_one_is_known(loop: Loop) -> None:
    run = played(ROTOR, loop)
    np.testing.assert_array_equal(seen(run)[:, 1], run.state[:-1, 1])


@pytest.mark.parametrize(
    ("loop", "names"),
    [
        (Loop(), []),
        (Loop(sensors=(ENCODER,)), []),
        (Loop(sensors=(ENCODER, Sensor(SPEED, exact=True))), [SPEED]),
        (Loop(sensors=(ENCODER, Sensor(SPEED))), [SPEED]),
        (Loop(sensors=(ENCODER, Sensor(SPEED, noise=1.0))), []),
    ],
)
def test_a_loop_tells_which_rates_are_known_exactly(loop: Loop, names: list[str]) -> None:
    assert loop.completed(SERVO).exact_rates(SERVO) == names

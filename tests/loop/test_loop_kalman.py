"""The Kalman filter: its gain beside python-control's, its covariance beside a long run's."""

from __future__ import annotations

import control
import numba
import numpy as np
import pytest
import scipy.linalg
from looped import ANGLE, SPEED, H, closed, nominal, played, scripted, seen, servo

from grosmc_mj.arrays import Array
from grosmc_mj.errors import GainError
from grosmc_mj.loop import Estimator, Loop, Sensor, in_loop
from grosmc_mj.loop.controllers import loop_of
from grosmc_mj.loop.counter import normal
from grosmc_mj.loop.kalman import kalman_gain
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.disturbances import Disturbance

C = np.array([[1.0, 0.0]])
# What the filter is tuned for: as much load in a sample as noise, so that it forgets at once.
NOISE, LOAD = 1e-5, 1.0
WITHIN, SIGMAS = 0.02, 4.0


def held_servo() -> tuple[Array, Array]:
    p = servo().parameters
    A, B = [[0.0, 1.0], [0.0, -p.B / p.J]], [[0.0], [p.Kt / p.J]]
    transition = scipy.linalg.expm(np.block([[np.array(A), np.array(B)], [np.zeros((1, 3))]]) * H)
    return transition[:2, :2], transition[:2, 2:]


def filtered(noise: float = NOISE, load: float = LOAD) -> Loop:
    return Loop(
        sensors=(Sensor(ANGLE, noise=noise),),
        estimators=(Estimator((ANGLE, SPEED), "kalman", load=load),),
    )


def gain_of(loop: Loop) -> Array:
    return loop_of(in_loop(scripted([0.0], modelled=True), loop, SERVO)).start.gain


@pytest.mark.parametrize("noise", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("load", [1e-2, 1.0])
def test_the_gain_is_python_control_s(noise: float, load: float) -> None:
    """Theirs is of the predicted state, A times ours; two solvers of one Riccati equation."""
    A, B = held_servo()
    gain, covariance = kalman_gain(A, B, [0], np.array([noise**2]), load)
    theirs, predicted, _poles = control.dlqe(A, B, C, [[load**2]], [[noise**2]])
    np.testing.assert_allclose(A @ gain, theirs, rtol=1e-6)
    P = np.asarray(predicted)
    after = P - P @ C.T @ np.linalg.inv(C @ P @ C.T + noise**2) @ C @ P
    np.testing.assert_allclose(covariance, after, rtol=1e-4)


def test_the_loop_s_gain_is_that_of_the_servo() -> None:
    """Differences over 1e-6 of a linear model are off by rounding: 1e-16 / 1e-6, over h."""
    gain = gain_of(filtered())
    wanted = kalman_gain(*held_servo(), [0], np.array([NOISE**2]), LOAD)[0]
    np.testing.assert_allclose(gain[:, :1], wanted, rtol=1e-6)
    np.testing.assert_array_equal(gain[:, 1], 0.0)


def test_a_resolution_counts_as_noise_of_a_twelfth_of_its_square() -> None:
    q = NOISE * 12**0.5
    loops = [filtered(), Loop(sensors=(Sensor(ANGLE, q),), estimators=filtered().estimators)]
    gains = [gain_of(each) for each in loops]
    np.testing.assert_allclose(*gains, rtol=1e-9)


@numba.njit
def drawn(count: int) -> Array:
    found = np.empty(count)
    for i in range(count):
        found[i] = normal(11, 0, 200, i)
    return found


def samples_needed(A: Array, gain: Array, covariance: Array) -> float:
    """For variances within ``WITHIN`` at ``SIGMAS``: Var s^2 = 2/N sum of squared correlations."""
    kept, lagged = (np.eye(2) - gain @ C) @ A, covariance
    total = np.zeros(2)
    for lag in range(1000):
        total += (1 if lag == 0 else 2) * (np.diag(lagged) / np.diag(covariance)) ** 2
        lagged = kept @ lagged
    return 2 * (SIGMAS / WITHIN) ** 2 * total.max()


@pytest.mark.slow
def test_estimates_have_the_covariance_that_the_filter_believes_in() -> None:
    """Under LQR at its target, with a load torque that is held for a sample, as it believes."""
    A, B = held_servo()
    gain, covariance = kalman_gain(A, B, [0], np.array([NOISE**2]), LOAD)
    N, skipped = 110_000, 100
    assert samples_needed(A, gain, covariance) < N - skipped
    w = drawn(N) * LOAD * servo().parameters.Kt
    push = Disturbance("rotor", (0, 0, 0, 0, 1, 0), lambda t: w[round(t / H)])
    law = nominal().law("corrected", "lqr")
    run = closed(law, filtered(), (1.0, 0.0), N * H, disturbances=[push])
    error = (seen(run) - run.state[:-1])[skipped:]
    measured = error.T @ error / len(error)
    np.testing.assert_allclose(np.diag(measured), np.diag(covariance), rtol=WITHIN)
    # The covariance's own spread is at most that of the variances, of their geometric mean.
    scale = np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert abs(measured[0, 1] - covariance[0, 1]) < WITHIN * scale


def test_a_filter_that_begins_unsettled_begins_at_zero() -> None:
    parts = Estimator((SPEED,), "kalman", load=LOAD, settled=False)
    loop = Loop(sensors=(Sensor(ANGLE, noise=NOISE),), estimators=(parts,))
    for settled, start in ((False, 0.0), (True, 2.0)):
        loop = loop.changed("estimator", SPEED, settled=settled)
        run = played([0.0] * 3, loop, x0=(0.0, 2.0), modelled=True)
        gain = kalman_gain(*held_servo(), [0], np.array([NOISE**2]), LOAD)[0]
        # A first reading of pure noise, within five of its deviations.
        assert abs(seen(run)[0, 1] - start) < 5 * gain[1, 0] * NOISE
        # What the filter does not give stays as it was measured.
        assert seen(run)[0, 0] != 0.0


def test_numbers_too_far_apart_are_told() -> None:
    """SciPy solves the equation without a word, for a filter that diverges."""
    with pytest.raises(GainError, match="kalman: no steady filter"):
        in_loop(scripted([0.0], modelled=True), filtered(1e-12, 1e-3), SERVO)


def test_a_position_cannot_be_filtered_out_of_a_rate() -> None:
    """Nothing that is measured tells where the rotor is."""
    loop = Loop(
        sensors=(Sensor(SPEED, noise=1e-3),),
        estimators=(Estimator((ANGLE, SPEED), "kalman", load=LOAD),),
    )
    with pytest.raises(GainError, match="kalman: no steady filter"):
        in_loop(scripted([0.0], modelled=True), loop, SERVO)

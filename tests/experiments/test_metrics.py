"""Metrics against closed forms on made-up runs."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.designs import chapter_controller
from grosmc_mj.experiments.metrics import (
    Comparison,
    compare_with_optimum,
    measure,
    overshoot,
    settling_time,
)
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.trajectory import Status, Trajectory

H = 1e-3
TIME = np.arange(10_001) * H


@pytest.fixture(scope="module")
def servo_lqr() -> Controller:
    return chapter_controller("lqr", MujocoPlant.load("servo").analytic())


def servo_run(theta: np.ndarray, rate: np.ndarray, u: np.ndarray) -> Trajectory:
    """A run of the servo that went through these angles under these inputs."""
    return Trajectory(
        system=SERVO,
        time=TIME,
        state=np.column_stack([theta, rate]),
        command=u,
        input=u,
        sliding=None,
        weighed=u,
        memory=np.zeros(len(u), [("v", np.float64)]),
        wrench=None,
        physics=None,
        status=np.array(Status.COMPLETED, object),
        valid_until=np.array(TIME[-1]),
    )


def optimal_run(controller: Controller) -> Trajectory:
    """The continuous optimum itself, x* and u* = -K x*."""
    assert controller.lqr is not None
    x = controller.lqr.optimal_trajectory([1.0, 0.0], TIME)
    u = -(x @ controller.lqr.K.T)[:-1, 0]
    return servo_run(1.0 - x[:, 0], -x[:, 1], u)


def test_settling_time_of_a_decaying_exponential_is_the_logarithm_of_the_band() -> None:
    settled = settling_time(TIME, np.exp(-2 * TIME))
    assert settled.value == pytest.approx(np.log(50) / 2, abs=H)


def test_an_error_that_stays_outside_the_band_is_not_reached_not_the_final_time() -> None:
    settled = settling_time(TIME, np.exp(-0.1 * TIME))
    assert settled == (None, "s", "not reached")


def test_an_error_that_swings_in_and_out_is_not_reached_wherever_the_run_ends() -> None:
    error = np.where(TIME < 1, 1.0, 0.03 * np.sin(2 * np.pi * TIME))
    for end in range(5000, 10_000, 37):
        assert settling_time(TIME[:end], error[:end]).note == "not reached"


def test_an_error_that_leaves_the_band_again_settles_after_its_return() -> None:
    error = np.where(TIME < 1, 1.0, 0.0)
    error[(TIME > 6) & (TIME < 7)] = 0.1
    assert settling_time(TIME, error).value == pytest.approx(7, abs=2 * H)


def test_settling_and_overshoot_do_not_depend_on_the_sign_of_the_error() -> None:
    error = np.exp(-TIME) * np.cos(3 * TIME)
    assert settling_time(TIME, error) == settling_time(TIME, -error)
    assert overshoot(error) == overshoot(-error)


def test_overshoot_of_a_second_order_response_has_its_closed_form() -> None:
    damping, w = 0.4, 2.0
    wd = w * np.sqrt(1 - damping**2)
    error = np.exp(-damping * w * TIME) * (np.cos(wd * TIME) + damping * w / wd * np.sin(wd * TIME))
    closed_form = 100 * np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    assert overshoot(error).value == pytest.approx(closed_form, rel=1e-5)


def test_the_optimum_deviates_by_nothing_and_costs_its_own_optimum(servo_lqr: Controller) -> None:
    run = optimal_run(servo_lqr)
    metrics = measure(run, servo_lqr, compare_with_optimum(run, servo_lqr))
    deviation, cost = metrics["deviation"].value, metrics["cost_continuous"].value
    optimum = metrics["cost_optimal"].value
    assert deviation is not None
    assert deviation < 1e-12
    # The trapezoid rule errs by h^2/12 times the fastest rate squared, 11.5^2: 1e-5.
    assert cost == pytest.approx(optimum, rel=2e-5)
    # Holding the input errs by half a sample of a falling cost: h/2 * 11.5.
    assert metrics["cost_whole"].value == pytest.approx(optimum, rel=6e-3)


def test_deviation_is_from_the_optimum_and_in_the_output_s_unit(servo_lqr: Controller) -> None:
    run = optimal_run(servo_lqr)
    bumped = run.state.copy()
    bumped[5000, 0] += 0.25
    run = replace(run, state=bumped)
    deviation = measure(run, servo_lqr, compare_with_optimum(run, servo_lqr))["deviation"]
    assert deviation.value == pytest.approx(0.25, abs=1e-12)
    assert deviation.unit == "rad"


def test_total_variation_of_a_square_wave_is_its_jumps_per_second(servo_lqr: Controller) -> None:
    u = np.where(np.arange(10_000) % 2 == 0, 1.5, -1.5)
    run = servo_run(np.ones(10_001), np.zeros(10_001), u)
    metrics = measure(run, servo_lqr, compare_with_optimum(run, servo_lqr))
    assert metrics["total_variation"].value == pytest.approx(3 * 9999 / 10)
    assert metrics["max_input"] == (1.5, "A", "")


def test_a_law_without_a_surface_has_no_sliding_variable(servo_lqr: Controller) -> None:
    run = optimal_run(servo_lqr)
    metrics = measure(run, servo_lqr, compare_with_optimum(run, servo_lqr))
    assert metrics["max_sliding"].value is None
    assert metrics["max_sliding"].note == "no surface"


def test_the_transient_ends_where_the_disturbance_begins(servo_lqr: Controller) -> None:
    run = optimal_run(servo_lqr)
    pushed = run.state.copy()
    pushed[TIME > 8, 0] += 0.5
    run = replace(run, state=pushed)
    comparison = compare_with_optimum(run, servo_lqr)
    whole = measure(run, servo_lqr, comparison)
    transient = measure(run, servo_lqr, comparison, onset=8.0)
    assert whole["settling_time"].note == "not reached"
    assert transient["settling_time"].value == pytest.approx(3.99, abs=0.05)
    assert transient["overshoot"].value == pytest.approx(0, abs=1e-9)
    assert transient["deviation"] == whole["deviation"]


def test_comparison_is_in_the_output_s_own_coordinate(servo_lqr: Controller) -> None:
    """The servo's error is theta_d - theta: its optimum is theta, its reference theta_d."""
    run = optimal_run(servo_lqr)
    found = compare_with_optimum(run, servo_lqr)
    assert found.outputs == (0,)
    assert found.reference.shape == found.optimum.shape == (len(TIME), 1)
    np.testing.assert_array_equal(found.reference, 1.0)
    np.testing.assert_allclose(found.optimum[:, 0], run.state[:, 0], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.error, found.z[:, 0])
    np.testing.assert_array_equal(found.deviation, found.z[:, 0] - found.optimal[:, 0])


def test_error_of_several_outputs_is_the_norm_of_theirs() -> None:
    """Columns of z that are no outputs do not count."""
    random = np.random.default_rng(0)
    z, optimal = random.normal(size=(2, 50, 3))
    nothing = np.zeros((50, 2))
    found = Comparison(np.arange(50.0), z, optimal, (0, 2), nothing, nothing)
    np.testing.assert_allclose(found.error, np.hypot(z[:, 0], z[:, 2]), rtol=1e-15)
    away = z - optimal
    np.testing.assert_allclose(found.deviation, np.hypot(away[:, 0], away[:, 2]), rtol=1e-15)


def test_every_metric_has_a_unit_or_says_why_not(servo_lqr: Controller) -> None:
    run = optimal_run(servo_lqr)
    metrics = measure(run, servo_lqr, compare_with_optimum(run, servo_lqr))
    for name, metric in metrics.items():
        assert metric.unit or metric.note, name
    json.dumps(metrics, allow_nan=False)

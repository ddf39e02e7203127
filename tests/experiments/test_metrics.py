"""Metrics against closed forms on made-up runs, requirements of them and the record of them."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from shipped import find_case, run_case

from grosmc_mj.chapter import expected_results as expected
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.catalogue import chapter_controller, find_experiment
from grosmc_mj.experiments.metrics import (
    Comparison,
    Metric,
    compare_with_optimum,
    cost_shares,
    measure,
    overshoot,
    settling_time,
)
from grosmc_mj.experiments.requirements import Limit, judge
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.disturbances import Disturbance, Pulse
from grosmc_mj.simulation.trajectory import Status, Trajectory

H = 1e-3
TIME = np.arange(10_001) * H
LQR: Controller = chapter_controller("lqr", MujocoPlant.load("servo").analytic())
OPTIMUM = LQR.designed.lqr.optimal_trajectory([1.0, 0.0], TIME)


def servo_run(theta: np.ndarray, rate: np.ndarray, u: np.ndarray) -> Trajectory:
    """A run of the servo that went through these angles under these inputs."""
    return Trajectory(
        system=SERVO, time=TIME, state=np.column_stack([theta, rate]), command=u, input=u,
        sliding=None, weighed=u, memory=np.zeros(len(u), [("v", np.float64)]), wrench=None,
        physics=None, status=np.array([Status.COMPLETED], object)[0],
        valid_until=np.array(TIME[-1]),
    )  # fmt: skip


# The continuous optimum itself, x* and u* = -K x*.
RUN = servo_run(1.0 - OPTIMUM[:, 0], -OPTIMUM[:, 1], -(OPTIMUM @ LQR.designed.lqr.K.T)[:-1, 0])


def bumped(instant: Any, by: float) -> Trajectory:
    """The optimum's run with its angle displaced at some rows."""
    state = RUN.state.copy()
    state[instant, 0] += by
    return replace(RUN, state=state)


def measured(run: Trajectory, **options: Any) -> dict[str, Metric]:
    return measure(run, LQR, compare_with_optimum(run, LQR), **options)


def result_of(run: Trajectory, **metrics: Metric) -> RunResult:
    """The run as the servo's nominal case, with some metrics changed."""
    comparison, metrics = compare_with_optimum(run, LQR), {**measured(run), **metrics}
    nominal = find_experiment("servo", "nominal")
    return RunResult(nominal, "physics", LQR, run, comparison, metrics)


STEP = np.where(TIME < 1, 1.0, 0.0)


@pytest.mark.parametrize(
    ("error", "settled"),
    [
        (np.exp(-2 * TIME), np.log(50) / 2),
        # Still outside at the end; outside once more, from 6 s to 7 s.
        (np.exp(-0.1 * TIME), None),
        (np.where((TIME > 6) & (TIME < 7), 0.1, STEP), 7.0),
        # Without an error at the start a run settles only if it stays.
        (0 * TIME, 0.0),
        (1e-6 * (1 - STEP), None),
        # In and out of its band, and out at some of the ends.
        *((np.where(TIME < 1, 1.0, 0.03 * np.sin(2 * np.pi * TIME))[:end], None)
          for end in (5000, 5370, 6110)),
    ],
)  # fmt: skip
def test_an_error_settles_where_it_enters_its_band_for_good(error, settled) -> None:
    for sign in (1, -1):
        metric = settling_time(TIME[: len(error)], sign * error)
        if settled is None:
            assert metric == (None, "s", "not reached")
        else:
            assert metric.value == pytest.approx(settled, abs=2 * H)


def test_an_overshoot_is_beyond_zero_in_percent_of_the_initial_error() -> None:
    for sign in (1, -1):
        assert overshoot(sign * np.array([2.0, 3.0, -0.5, 0.1])) == (25.0, "%", "")
    assert overshoot(np.zeros(3)) == (None, "%", "no initial error")


def test_the_optimum_deviates_by_nothing_and_costs_its_own_optimum() -> None:
    """In the output's own coordinate: the error is theta_d - theta, with theta_d = 1."""
    metrics, comparison = measured(RUN), compare_with_optimum(RUN, LQR)
    assert metrics["deviation"].value == pytest.approx(0, abs=1e-12)
    optimum = metrics["cost_optimal"].value
    # The trapezoid rule errs by h^2/12 times the fastest rate squared, 11.5^2: 1e-5.
    assert metrics["cost_continuous"].value == pytest.approx(optimum, rel=2e-5)
    # Holding the input errs by half a sample of a falling cost: h/2 * 11.5.
    assert metrics["cost_whole"].value == pytest.approx(optimum, rel=6e-3)
    assert comparison.outputs == (0,)
    np.testing.assert_array_equal(comparison.reference, np.ones((len(TIME), 1)))
    np.testing.assert_allclose(comparison.optimum[:, 0], RUN.state[:, 0], rtol=0, atol=1e-12)
    deviation = measured(bumped(5000, 0.25))["deviation"]
    assert (deviation.value, deviation.unit) == (pytest.approx(0.25, abs=1e-12), "rad")
    assert all(metric.unit or metric.note for metric in metrics.values())


def test_the_transient_ends_where_the_disturbance_begins() -> None:
    """A wrench held from then on has not moved the state yet at its onset."""
    run = bumped(TIME > 8, 0.5)
    full, transient = measured(run), measured(run, onset=8.0)
    assert full["settling_time"].note == "not reached"
    assert transient["settling_time"].value == pytest.approx(3.99, abs=0.05)
    assert transient["overshoot"].value == pytest.approx(0, abs=1e-9)
    assert transient["deviation"] == full["deviation"]
    # One from the start leaves all of it.
    assert measured(RUN, onset=0.0) == measured(RUN)
    for row, percent in ((8000, 50.0), (8001, 0.0)):
        run = bumped(row, 1.5 - RUN.state[row, 0])
        assert measured(run, onset=8.0)["overshoot"].value == pytest.approx(percent, abs=1e-9)
    # A run is measured up to its own case's onset.
    shove = Disturbance("rotor", (0.0, 0.0, 0.0, 0.0, -100.0, 0.0), Pulse(0.3, 1.0))
    case = replace(find_case("servo", "nominal"), duration=0.6, disturbances=(shove,))
    result = run_case(case, "corrected", "lqr", Settings(engine="python"))
    assert result.metrics["overshoot"].value == 0.0
    later = measure(result.trajectory, result.controller, result.comparison)
    assert (later["overshoot"].value or 0.0) > 10.0


def test_sizes_are_of_both_signs_and_from_the_start() -> None:
    """RMS of a sine of full cycles is its amplitude over the root of two."""
    wave = np.sin(2 * np.pi * np.arange(10_000) / 1000)
    run = servo_run(np.ones(10_001), np.zeros(10_001), np.minimum(wave, 0.5))
    run = replace(run, sliding=np.column_stack([0.3 * wave, 0.1 * np.ones(10_000)]))
    z, nothing = np.append(2 * wave, 0.0)[:, None], np.zeros((10_001, 1))
    made_up = Comparison(TIME, np.hstack([z, 0 * z]), 0 * np.hstack([z, z]), (0,), nothing, nothing)
    metrics = measure(run, LQR, made_up)
    assert metrics["max_input"] == (1.0, "A", "")
    assert metrics["rms_error"].value == pytest.approx(2**0.5, rel=1e-4)
    assert metrics["max_sliding"].value == pytest.approx(0.3)
    largest = np.maximum(0.3 * np.abs(wave), 0.1)
    assert metrics["rms_sliding"].value == pytest.approx(float(np.mean(largest**2)) ** 0.5)
    # A square wave jumps by 3 A between its 10 000 samples in 10 s.
    square = replace(run, command=1.5 * (-1.0) ** np.arange(10_000))
    square = replace(square, input=square.command)
    assert measured(square)["total_variation"].value == pytest.approx(3 * 9999 / 10)


def test_a_cart_travels_from_where_it_starts() -> None:
    case = replace(find_case("cart_pendulum", "nominal"), x0=(5.0, 0.0, -0.5, 0.0), duration=0.1)
    result = run_case(case, "corrected", "lqr", Settings(engine="python"))
    cart = result.trajectory.state[:, 0]
    assert result.metrics["cart_travel"].value == pytest.approx(5.0 - cart.min(), rel=1e-12)
    assert 5.0 - cart.min() < 0.1


def test_error_of_several_outputs_is_the_norm_of_theirs() -> None:
    """Columns of z that are no outputs do not count."""
    z, optimal = np.random.default_rng(0).normal(size=(2, 50, 3))
    comparison = Comparison(np.arange(50.0), z, optimal, (0, 2), z, z)
    np.testing.assert_allclose(comparison.error, np.hypot(z[:, 0], z[:, 2]), rtol=1e-15)
    away = z - optimal
    np.testing.assert_allclose(comparison.deviation, np.hypot(away[:, 0], away[:, 2]), rtol=1e-15)


# Requirements


def limit(kind: str, value: float, after: float = 0.0) -> Limit:
    """A requirement of the servo's LQR."""
    return Limit(kind, "", value, "", after, ("lqr",), ("physics",))


COSTS = {"cost_continuous": 5.0, "cost_whole": 3.0, "cost_optimal": 2.0}


@pytest.mark.parametrize(
    ("kind", "metrics", "value"),
    [
        ("settles_within", {"settling_time": 0.125}, 0.125),
        ("deviation_below", {"deviation": 0.125}, 0.125),
        ("sliding_below", {"max_sliding": 0.125}, 0.125),
        ("cart_travel_below", {"cart_travel": 0.125}, 0.125),
        ("cost_ratio_below", COSTS, 1.5),
        ("input_below", {"max_input": 1.5}, 1.5),
    ],
)
def test_a_limit_is_of_its_own_metric_and_kept_if_just_met(kind, metrics, value) -> None:
    result = result_of(RUN, **{name: Metric(size, "") for name, size in metrics.items()})
    for allowed, kept in ((value, True), (value + 1, True), (0.9 * value, False)):
        judgement = judge(limit(kind, allowed), result)
        assert (judgement.measured, judgement.kept) == (value, kept)
        assert judgement.margin == allowed - value


def test_the_rest_of_the_input_costs_a_second_over_the_optimum() -> None:
    metrics = {name: Metric(cost, "1") for name, cost in COSTS.items()}
    continuous, rest = cost_shares(metrics, duration=0.5)
    assert continuous.value == 5.0 / 2.0
    assert rest.value == (3.0 - 5.0) / (2.0 * 0.5)
    assert cost_shares(metrics | {"cost_optimal": Metric(None, "1")}, 0.5)[1].value is None


def test_a_surface_starts_at_zero_and_an_error_stays_within_to_both_sides() -> None:
    for start, kept in ((-1e-3, False), (1e-3, False), (-1e-12, True), (0.0, True)):
        run = replace(RUN, sliding=np.append(start, np.zeros(9999)))
        judgement = judge(limit("no_reaching_phase", 1e-9), result_of(run))
        assert (judgement.measured, judgement.kept) == (abs(start), kept)
    # The instant itself counts; theta beyond theta_d is a negative error, after 6 s of decay.
    for row, away in ((6000, 0.25), (5999, 0.0), (10_000, 0.25)):
        within = limit("stays_within", 0.1, after=6.0)
        assert judge(within, result_of(bumped(row, 0.25))).measured == pytest.approx(away, abs=5e-3)


# The record


def test_a_record_keeps_other_runs_and_tells_what_differs(tmp_path, monkeypatch) -> None:
    path = tmp_path / "expected.json"
    path.write_text(expected.EXPECTED_FILE.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.setattr(expected, "EXPECTED_FILE", path)
    before, result = json.loads(path.read_text()), result_of(RUN)
    expected.record_expected([result])
    after = json.loads(path.read_text())
    assert after["settings"] == before["settings"]
    assert after["runs"].pop(result.key) != before["runs"].pop(result.key)
    assert after["runs"] == before["runs"]

    number, none = Metric(1.25, "s"), Metric(None, "s", "not reached")
    key = "servo/nominal/physics/lqr: settling_time is"
    for now, then, words in ((none, number, [f"{key} none, recorded 1.25 s"]),
                             (number, none, [f"{key} 1.25, recorded none s"]),
                             (none, none, [])):  # fmt: skip
        expected.record_expected([result_of(RUN, settling_time=then)])
        assert expected.differences([result_of(RUN, settling_time=now)]) == words
    # Only laws that switch may repeat roughly.
    for sliding, apart, as_recorded in ((None, 5e-7, True), (None, 5e-6, False),
                                        (np.zeros(10_000), 1e-3, True),
                                        (np.zeros(10_000), 0.5, False)):  # fmt: skip
        run = replace(RUN, sliding=sliding)
        expected.record_expected([result_of(run, cost_whole=Metric(1.0, "1"))])
        now = result_of(run, cost_whole=Metric(1.0 + apart, "1"))
        assert (expected.differences([now]) == []) is as_recorded

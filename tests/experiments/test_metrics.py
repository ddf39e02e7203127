"""Metrics against closed forms on made-up runs, what is required of them and what is recorded."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shipped import find_case, run_case

from grosmc_mj.chapter import expected_results as expected
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.catalogue import chapter_controller, find_experiment
from grosmc_mj.experiments.metrics import (
    Comparison,
    MeterNumbers,
    Meters,
    Metric,
    compare_with_optimum,
    measure,
    note,
    note_all,
    overshoot,
    settling_time,
    tolerance_of,
)
from grosmc_mj.experiments.requirements import Limit, judge, margins_of
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SERVO
from grosmc_mj.records import pack
from grosmc_mj.simulation.disturbances import Disturbance, Pulse
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
        status=np.array([Status.COMPLETED], object)[0],
        valid_until=np.array(TIME[-1]),
    )


def optimal_run(controller: Controller) -> Trajectory:
    """The continuous optimum itself, x* and u* = -K x*."""
    x = controller.designed.lqr.optimal_trajectory([1.0, 0.0], TIME)
    u = -(x @ controller.designed.lqr.K.T)[:-1, 0]
    return servo_run(1.0 - x[:, 0], -x[:, 1], u)


def result_of(run: Trajectory, controller: Controller, **metrics: Metric) -> RunResult:
    """The run as the servo's nominal case, with some metrics changed."""
    comparison = compare_with_optimum(run, controller)
    found = {**measure(run, controller, comparison), **metrics}
    return RunResult(
        find_experiment("servo", "nominal"), "physics", controller, run, comparison, found
    )


def limit(kind: str, value: float, after: float = 0.0) -> Limit:
    """A requirement of the servo's LQR."""
    return Limit(kind, "", value, "", after, ("lqr",), ("physics",))


EXPONENTIAL, STEP = np.exp(-TIME), np.where(TIME < 1, 1.0, 0.0)
SETTLED: list[tuple[np.ndarray, float | None]] = [
    (EXPONENTIAL**2, np.log(50) / 2),
    # Still outside at the end.
    (EXPONENTIAL**0.1, None),
    # Outside once more, from 6 s to 7 s.
    (np.where((TIME > 6) & (TIME < 7), 0.1, STEP), 7.0),
    # Without an error at the start a run settles only if it stays.
    (0 * TIME, 0.0),
    (0.87 * (1 - STEP), None),
    (1e-6 * (1 - STEP), None),
]


@pytest.mark.parametrize(("error", "settled"), SETTLED)
def test_an_error_settles_where_it_enters_its_band_for_good(
    error: np.ndarray, settled: float | None
) -> None:
    found = settling_time(TIME, error)
    if settled is None:
        assert found == (None, "s", "not reached")
    else:
        assert found.value == pytest.approx(settled, abs=2 * H)


def test_an_error_that_swings_in_and_out_is_not_reached_wherever_the_run_ends() -> None:
    error = np.where(TIME < 1, 1.0, 0.03 * np.sin(2 * np.pi * TIME))
    for end in range(5000, 10_000, 370):
        assert settling_time(TIME[:end], error[:end]).note == "not reached"


def test_settling_and_overshoot_do_not_depend_on_the_sign_of_the_error() -> None:
    error = np.exp(-TIME) * np.cos(3 * TIME)
    assert settling_time(TIME, error) == settling_time(TIME, -error)
    assert overshoot(error) == overshoot(-error)
    assert overshoot(-0.5 * error).value == pytest.approx(overshoot(error).value)


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


def test_the_onset_s_sample_is_the_last_of_the_transient(servo_lqr: Controller) -> None:
    """A wrench held from then on has not moved the state yet."""
    run = optimal_run(servo_lqr)
    onset = int(np.flatnonzero(TIME == 8.0)[0])
    for index, percent in ((onset, 50.0), (onset + 1, 0.0)):
        state = run.state.copy()
        state[index, 0] = 1.5
        bumped = replace(run, state=state)
        comparison = compare_with_optimum(bumped, servo_lqr)
        found = measure(bumped, servo_lqr, comparison, onset=8.0)["overshoot"]
        assert found.value == pytest.approx(percent, abs=1e-9)


def test_a_disturbance_from_the_start_leaves_the_transient_whole(servo_lqr: Controller) -> None:
    run = optimal_run(servo_lqr)
    comparison = compare_with_optimum(run, servo_lqr)
    whole = measure(run, servo_lqr, comparison)
    assert measure(run, servo_lqr, comparison, onset=0.0) == whole


def test_a_run_is_measured_up_to_its_own_case_s_onset() -> None:
    shove = Disturbance("rotor", (0.0, 0.0, 0.0, 0.0, -100.0, 0.0), Pulse(0.3, 1.0))
    case = replace(find_case("servo", "nominal"), duration=0.6, disturbances=(shove,))
    result = run_case(case, "corrected", "lqr", Settings(engine="python"))
    whole = measure(result.trajectory, result.controller, result.comparison)
    assert result.metrics["overshoot"].value == 0.0
    assert (whole["overshoot"].value or 0.0) > 10.0


def test_sizes_are_of_both_signs_and_from_the_start(servo_lqr: Controller) -> None:
    """RMS of a sine of whole cycles is its amplitude over the root of two."""
    wave = np.sin(2 * np.pi * np.arange(10_000) / 1000)
    run = servo_run(np.ones(10_001), np.zeros(10_001), np.minimum(wave, 0.5))
    run = replace(run, sliding=np.column_stack([0.3 * wave, 0.1 * np.ones(10_000)]))
    z = np.append(2 * wave, 0.0)[:, None]
    nothing = np.zeros((10_001, 1))
    made_up = Comparison(TIME, np.hstack([z, 0 * z]), 0 * np.hstack([z, z]), (0,), nothing, nothing)
    found = measure(run, servo_lqr, made_up)
    assert found["max_input"].value == 1.0
    assert found["rms_error"].value == pytest.approx(2**0.5, rel=1e-4)
    assert found["max_sliding"].value == pytest.approx(0.3)
    largest = np.maximum(0.3 * np.abs(wave), 0.1)
    assert found["rms_sliding"].value == pytest.approx(float(np.mean(largest**2)) ** 0.5)


def test_a_cart_travels_from_where_it_starts() -> None:
    case = replace(find_case("cart_pendulum", "nominal"), x0=(5.0, 0.0, -0.5, 0.0), duration=0.1)
    result = run_case(case, "corrected", "lqr", Settings(engine="python"))
    cart = result.trajectory.state[:, 0]
    assert result.metrics["cart_travel"].value == pytest.approx(5.0 - cart.min(), rel=1e-12)
    assert 5.0 - cart.min() < 0.1


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


def test_a_run_of_one_instant_has_no_metrics(servo_lqr: Controller) -> None:
    run = optimal_run(servo_lqr)
    whole = compare_with_optimum(run, servo_lqr)
    started = whole._replace(time=whole.time[:1], z=whole.z[:1], optimal=whole.optimal[:1])
    found = measure(run, servo_lqr, started)
    assert set(found) >= {"deviation", "settling_time", "max_input", "cost_whole"}
    assert {(metric.value, metric.note) for metric in found.values()} == {
        (None, "ended at the start")
    }


def test_every_metric_has_a_unit_or_says_why_not(servo_lqr: Controller) -> None:
    run = optimal_run(servo_lqr)
    metrics = measure(run, servo_lqr, compare_with_optimum(run, servo_lqr))
    for name, metric in metrics.items():
        assert metric.unit or metric.note, name
    json.dumps(metrics, allow_nan=False)


def test_rows_are_noted_by_compiled_code_as_in_python() -> None:
    random = np.random.default_rng(3)
    rows, known = random.normal(size=(500, 5)), MeterNumbers(np.array([0.1]), onset=0.3)
    rows[:, 2:4] = np.abs(rows[:, 2:4])
    rows[7, :4] = np.nan
    meters, time = Meters.of(MeterNumbers()), 1e-3 * np.arange(500)
    for t, (e, d, u, s, x) in zip(time.tolist(), rows.tolist(), strict=True):
        note(t, e, d, u, s, x, meters, known)
    (found,) = note_all(time, rows, known)
    assert pack(meters).tobytes() == found.tobytes()
    assert meters.outside == 0.3
    assert meters.error[0] == np.nanmax(np.abs(rows[100:, 0]))


# What is required


def test_a_surface_that_starts_below_zero_has_a_reaching_phase(servo_lqr: Controller) -> None:
    run = optimal_run(servo_lqr)
    for start, kept in ((-1e-3, False), (1e-3, False), (-1e-12, True), (0.0, True)):
        sliding = np.append(start, np.zeros(9999))
        found = judge(
            limit("no_reaching_phase", 1e-9), result_of(replace(run, sliding=sliding), servo_lqr)
        )
        assert (found.measured, found.kept) == (abs(start), kept)


def test_a_limit_that_is_just_met_is_kept(servo_lqr: Controller) -> None:
    result = result_of(optimal_run(servo_lqr), servo_lqr, max_input=Metric(1.5, "A"))
    for value, kept in ((1.5, True), (1.6, True), (1.4, False)):
        found = judge(limit("input_below", value), result)
        assert found.margin == value - 1.5
        assert found.kept == kept


def test_margins_of_many_runs_are_what_is_left_of_the_limit() -> None:
    asked = limit("input_below", 2.0)._replace(key="input_below")
    completed: Any = np.array([True, True, False])
    found = margins_of([asked], {asked.metric: np.array([0.5, 3.0, 0.1])}, completed)
    assert found["input_below"].tolist() == [1.5, -1.0, -np.inf]


def test_an_error_stays_within_from_after_on_to_both_sides(servo_lqr: Controller) -> None:
    """The instant itself counts; theta beyond theta_d is a negative error, after 6 s of decay."""
    run = optimal_run(servo_lqr)
    for instant, away in ((6.0, 0.25), (5.999, 0.0), (10.0, 0.25)):
        state = run.state.copy()
        state[np.isclose(TIME, instant), 0] = 1.25
        found = judge(
            limit("stays_within", 0.1, after=6.0), result_of(replace(run, state=state), servo_lqr)
        )
        assert found.measured == pytest.approx(away, abs=5e-3)


def test_a_cost_ratio_is_of_the_whole_input_over_the_least(servo_lqr: Controller) -> None:
    costs = {"cost_continuous": 5.0, "cost_whole": 3.0, "cost_optimal": 2.0}
    made_up = {name: Metric(value, "1") for name, value in costs.items()}
    result = result_of(optimal_run(servo_lqr), servo_lqr, **made_up)
    assert judge(limit("cost_ratio_below", 2.0), result).measured == 1.5


@pytest.mark.parametrize(
    ("kind", "metric"),
    [("settles_within", "settling_time"), ("deviation_below", "deviation"),
     ("sliding_below", "max_sliding"), ("cart_travel_below", "cart_travel")],
)  # fmt: skip
def test_a_limit_is_of_its_own_metric(servo_lqr: Controller, kind: str, metric: str) -> None:
    result = result_of(optimal_run(servo_lqr), servo_lqr, **{metric: Metric(0.125, "")})
    assert judge(limit(kind, 1.0), result).measured == 0.125


# What is recorded


@pytest.fixture
def record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A record of the package's runs that tests may change."""
    path = tmp_path / "expected.json"
    path.write_text(expected.EXPECTED_FILE.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.setattr(expected, "EXPECTED_FILE", path)
    return path


@pytest.mark.usefixtures("record")
def test_a_number_that_comes_or_goes_is_a_difference(servo_lqr: Controller) -> None:
    number, none = Metric(1.25, "s"), Metric(None, "s", "not reached")
    run = optimal_run(servo_lqr)
    key = "servo/nominal/physics/lqr: settling_time is"
    for now, before, said in (
        (none, number, [f"{key} none, recorded 1.25 s"]),
        (number, none, [f"{key} 1.25, recorded none s"]),
        (none, none, []),
        (number, number, []),
    ):
        recorded = result_of(run, servo_lqr, settling_time=before)
        expected.record_expected([recorded])
        found = result_of(run, servo_lqr, settling_time=now)
        assert expected.differences([found]) == said


@pytest.mark.usefixtures("record")
def test_only_laws_that_switch_may_repeat_roughly(servo_lqr: Controller) -> None:
    smooth = optimal_run(servo_lqr)
    for sliding, apart, as_recorded in (
        (None, 5e-7, True),
        (None, 5e-6, False),
        (np.zeros(10_000), 1e-3, True),
    ):
        run = replace(smooth, sliding=sliding)
        relative, _ = tolerance_of("cost_whole", switched=sliding is not None)
        before, now, beyond = (
            result_of(run, servo_lqr, cost_whole=Metric(value, "1"))
            for value in (1.0, 1.0 + apart, 1.0 + 2 * relative)
        )
        expected.record_expected([before])
        assert (expected.differences([now]) == []) is as_recorded
        assert expected.differences([beyond]) != []


def test_recording_one_run_keeps_the_others_and_the_settings(
    servo_lqr: Controller, record: Path
) -> None:
    def stored() -> dict[str, Any]:
        return json.loads(record.read_text(encoding="utf-8"))

    before, result = stored(), result_of(optimal_run(servo_lqr), servo_lqr)
    expected.record_expected([result])
    after = stored()
    assert after["settings"] == before["settings"]
    assert after["runs"].pop(result.key) != before["runs"].pop(result.key)
    assert after["runs"] == before["runs"]

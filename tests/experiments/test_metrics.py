"""Metrics of made-up runs against closed forms, limits on metrics, and their record."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shipped import find_case, run_case

from grosmc_mj.chapter import expected_results as expected
from grosmc_mj.experiments.catalogue import chapter_controller, find_experiment
from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.experiments.requirements import KINDS
from grosmc_mj.experiments.requirements.accumulator import Rows, replay
from grosmc_mj.experiments.requirements.judging import judge_run, unfailing_line
from grosmc_mj.experiments.requirements.measurement import Measurement
from grosmc_mj.experiments.requirements.metrics import Metric
from grosmc_mj.experiments.requirements.optimum import Comparison, compare_with_optimum
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.experiments.requirements.run_metrics import (
    cost_shares,
    metrics_of,
    metrics_of_rows,
    rows_of,
    usual_metrics,
)
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import Disturbance, InputDisturbance, Pulse
from grosmc_mj.simulation.trajectory import Status, Trajectory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import SERVO

H = 1e-3
TIME = np.arange(10_001) * H
LQR: Controller = chapter_controller("lqr", MujocoPlant.load("servo").analytic())
OPTIMUM = LQR.designed.lqr.optimal_trajectory([1.0, 0.0], TIME)


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


# The continuous optimum itself, x* and u* = -K x*.
RUN = servo_run(1.0 - OPTIMUM[:, 0], -OPTIMUM[:, 1], -(OPTIMUM @ LQR.designed.lqr.K.T)[:-1, 0])


def bumped(instant: Any, by: float) -> Trajectory:
    """The optimum's run with its angle displaced at some rows."""
    state = RUN.state.copy()
    state[instant, 0] += by
    return replace(RUN, state=state)


def measured(run: Trajectory, **options: Any) -> dict[str, Metric]:
    rows = rows_of(run, compare_with_optimum(run, LQR).z)
    return usual_metrics(run, LQR, metrics_of_rows(rows, LQR, **options))


def result_of(run: Trajectory, **metrics: Metric) -> RunResult:
    """The run as the servo's nominal case, with some metrics changed."""
    nominal = find_experiment("servo", "nominal")
    result = RunResult(
        case=nominal,
        plant="physics",
        controller=LQR,
        trajectory=run,
        true=nominal.plant("physics"),
    )
    return with_metrics(result, **metrics)


def with_metrics(result: RunResult, **metrics: Metric) -> RunResult:
    """A copy of a result with some metrics changed."""
    changed = replace(result)
    vars(changed)["metrics"] = {**result.metrics, **metrics}
    return changed


def run_of_error(error: np.ndarray) -> RunResult:
    """A run of the servo whose angle has this error, (N,)."""
    count = len(error)
    whole = servo_run(1.0 - error, np.zeros(count), np.zeros(count - 1))
    return result_of(replace(whole, time=TIME[:count], valid_until=np.array(TIME[count - 1])))


STEP = np.where(TIME < 1, 1.0, 0.0)
# Leaves its band of 2 % once more in each half second.
SWINGING = np.where(TIME < 1, 1.0, 0.03 * np.sin(2 * np.pi * TIME))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("error", "settled"),
    [
        (np.exp(-2 * TIME), np.log(50) / 2),
        # Outside once more, from 6 s to 7 s.
        (np.where((TIME > 6) & (TIME < 7), 0.1, STEP), 7.0),
        # Without an error at the start a run settles only if it stays.
        (0 * TIME, 0.0),
    ],
)
def test_an_error_settles_where_it_enters_its_band_for_good(error, settled, sign) -> None:
    metrics = run_of_error(sign * error).metrics
    assert metrics["settling_time"].value == pytest.approx(settled, abs=2 * H)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    "error",
    [
        # Outside at the end.
        np.exp(-0.1 * TIME),
        1e-6 * (1 - STEP),
        # In and out of its band, and out at some of the ends.
        SWINGING[:5000],
        SWINGING[:5370],
        SWINGING[:6110],
    ],
)
def test_an_error_that_leaves_its_band_late_does_not_settle(error, sign) -> None:
    assert run_of_error(sign * error).metrics["settling_time"] == (None, "s", "not reached")


def test_runs_that_never_settle_are_ordered_by_the_error_that_is_left() -> None:
    """Of a transient of 6 s the last tenth tells: 1 - 6/4 - left/band, for the start is nearer."""
    settles = limit("settles_within", 4.0, band=0.5)
    metrics = {settles.metric: np.array([5.41, 5.39, 5.41]), "left": np.array([0.1, 0.1, 2.0])}
    order = settles.order_share(np.full(3, -0.35), metrics, np.full(3, 6.0), 0.2)
    assert order.tolist() == pytest.approx([-0.5 - 0.2, -0.35, -0.5 - 4.0])


@pytest.mark.parametrize("sign", [1, -1])
def test_an_overshoot_is_beyond_zero_in_percent_of_the_initial_error(sign) -> None:
    error = sign * np.array([2.0, 3.0, -0.5, 0.125])
    assert run_of_error(error).metrics["overshoot"] == (25.0, "%", "")


def test_there_is_no_overshoot_without_an_initial_error() -> None:
    metrics = run_of_error(np.zeros(3)).metrics
    assert metrics["overshoot"] == (None, "%", "no initial error")


def test_the_optimum_costs_its_own_optimum() -> None:
    metrics = measured(RUN)
    optimum = metrics["cost_optimal"].value
    # The trapezoid rule errs by h^2/12 times the fastest rate squared, 11.5^2: 1e-5.
    assert metrics["cost_continuous"].value == pytest.approx(optimum, rel=2e-5)
    # Holding the input errs by half a sample of a falling cost: h/2 * 11.5.
    assert metrics["cost_whole"].value == pytest.approx(optimum, rel=6e-3)


def test_the_optimal_feedback_alone_may_cost_less_than_the_optimum_where_it_moves_nothing() -> None:
    """Two pulses move the angle in two samples and rest; their own cost is in the whole one."""
    theta = np.ones(len(TIME))
    theta[0] = 0.0
    u = np.zeros(len(TIME) - 1)
    u[:2] = 1 / H**2, -1 / H**2
    metrics = measured(servo_run(theta, np.zeros(len(TIME)), u))
    feedback = metrics["cost_continuous"].value
    optimum = metrics["cost_optimal"].value
    whole = metrics["cost_whole"].value
    assert feedback is not None
    assert optimum is not None
    assert whole is not None
    assert feedback < 0.01 * optimum
    assert whole > optimum


@pytest.mark.parametrize("displacement", [0.0, 0.25, -0.3])
def test_a_displaced_optimum_deviates_by_its_displacement(displacement: float) -> None:
    deviation = measured(bumped(5000, displacement))["deviation"]
    assert deviation.value == pytest.approx(abs(displacement), abs=1e-12)
    assert deviation.unit == "rad"


def test_a_comparison_is_in_the_coordinate_of_the_output() -> None:
    """The error is theta_d - theta, with theta_d = 1."""
    comparison = compare_with_optimum(RUN, LQR)
    assert comparison.outputs == (0,)
    np.testing.assert_array_equal(comparison.reference, np.ones((len(TIME), 1)))
    np.testing.assert_allclose(comparison.optimum[:, 0], RUN.state[:, 0], rtol=0, atol=1e-12)


def test_every_metric_has_a_unit_or_a_note() -> None:
    assert all(metric.unit or metric.note for metric in measured(RUN).values())


def test_the_transient_ends_where_the_disturbance_begins() -> None:
    run = bumped(TIME > 8, 0.5)
    full = measured(run)
    transient = measured(run, onset=8.0)
    assert full["settling_time"].note == "not reached"
    assert transient["settling_time"].value == pytest.approx(3.99, abs=0.05)
    assert transient["overshoot"].value == pytest.approx(0, abs=1e-9)
    assert transient["deviation"] == full["deviation"]


@pytest.mark.parametrize(("last_outside", "note"), [(7.1, ""), (7.3, "not reached")])
def test_a_run_settles_only_with_a_tenth_of_its_transient_left(last_outside, note) -> None:
    """A load at 8 s ends the transient: 0.8 s must be left, not a tenth of all 10 s."""
    run = bumped((TIME > 6) & (last_outside > TIME), 0.5)
    settling = measured(run, onset=8.0)["settling_time"]
    assert settling.note == note
    assert settling.value == (pytest.approx(last_outside, abs=2 * H) if not note else None)


def test_a_load_of_nothing_from_the_start_changes_no_metric() -> None:
    """A later load ends the transient, whatever acts from the start."""
    case = replace(find_case("servo", "case1"), duration=11.0)
    nothing = InputDisturbance("current", 0.0)
    runs = [
        run_case(each, "corrected", "lqr", Settings())
        for each in (case, replace(case, disturbances=(nothing, *case.disturbances)))
    ]
    assert runs[0].metrics["settling_time"].value == pytest.approx(3.989, abs=5e-4)
    assert runs[1].metrics == runs[0].metrics


@pytest.mark.parametrize(("row", "percent"), [(8000, 50.0), (8001, 0.0)])
def test_the_instant_of_the_onset_is_part_of_the_transient(row, percent) -> None:
    """A wrench held from then on has not moved the state yet."""
    run = bumped(row, 1.5 - RUN.state[row, 0])
    assert measured(run, onset=8.0)["overshoot"].value == pytest.approx(percent, abs=1e-9)


def test_a_run_is_measured_up_to_the_onset_of_its_case() -> None:
    shove = Disturbance("rotor", (0.0, 0.0, 0.0, 0.0, -100.0, 0.0), Pulse(0.3, 1.0))
    case = replace(find_case("servo", "nominal"), duration=0.6, disturbances=(shove,))
    result = run_case(case, "corrected", "lqr", Settings(engine="python"))
    assert result.metrics["overshoot"].value == 0.0
    assert result.errors(result.comparison.z)["overshoot"] > 0.1


WAVE = np.sin(2 * np.pi * np.arange(10_000) / 1000)
# The error is twice the wave.
CLIPPED = servo_run(1.0 - np.append(2 * WAVE, 0.0), np.zeros(10_001), np.minimum(WAVE, 0.5))
SLIDING = replace(CLIPPED, sliding=np.column_stack([0.3 * WAVE, 0.1 * np.ones(10_000)]))


def test_a_largest_input_is_of_both_signs() -> None:
    assert measured(SLIDING)["max_input"] == (1.0, "A", "")


def test_an_input_is_measured_within_limits_that_differ_on_both_sides() -> None:
    """Of -2, 2.5 and 5 A the plant gets -1, 2.5 and 3 A: changes of 3.5 and 0.5 A in 3 ms."""
    limits = np.array([[-1.0], [3.0]])
    measurement = Measurement(LQR, H, 3 * H, input_limits=limits)
    u = np.array([[-2.0], [2.5], [5.0]])
    rows = Rows(TIME[:4], np.zeros((4, 2)), np.zeros((4, 2)), u, u, np.zeros((3, 0)))
    metrics = metrics_of([measurement], replay(rows, measurement.constants))
    assert metrics["max_input"].tolist() == [3.0]
    assert metrics["total_variation"] == pytest.approx([4.0 / (3 * H)])


def test_the_rms_error_of_a_sine_is_its_amplitude_over_the_root_of_two() -> None:
    assert measured(SLIDING)["rms_error"].value == pytest.approx(2**0.5, rel=1e-4)


def test_the_size_of_s_is_its_largest_entry() -> None:
    metrics = measured(SLIDING)
    assert metrics["max_sliding"].value == pytest.approx(0.3)
    largest = np.maximum(0.3 * np.abs(WAVE), 0.1)
    rms = float(np.mean(largest**2)) ** 0.5
    assert metrics["rms_sliding"].value == pytest.approx(rms)


def test_the_total_variation_is_the_sum_of_the_jumps_of_the_applied_input() -> None:
    """By 1 A between its 10 000 samples in 10 s; a limit takes two thirds of the command."""
    square = 1.5 * (-1.0) ** np.arange(10_000)
    run = replace(SLIDING, command=square, input=square / 3)
    assert measured(run)["total_variation"].value == pytest.approx(9999 / 10)


def test_an_internal_position_is_measured_by_its_largest_magnitude() -> None:
    case = replace(find_case("cart_pendulum", "nominal"), x0=(-5.0, 0.0, -0.5, 0.0), duration=0.1)
    result = run_case(case, "corrected", "lqr", Settings(engine="python"))
    cart = result.trajectory.state[:, 0]
    assert result.metrics["largest cart position"] == (np.abs(cart).max(), "m", "")
    # A controlled position is no internal one.
    assert not any(name.startswith("largest") for name in measured(RUN))


def test_error_of_several_outputs_is_the_norm_of_theirs() -> None:
    """Columns of z that are no outputs do not count."""
    z, optimal = np.random.default_rng(0).normal(size=(2, 50, 3))
    comparison = Comparison(np.arange(50.0), z, optimal, (0, 2), z, z)
    np.testing.assert_allclose(comparison.error, np.hypot(z[:, 0], z[:, 2]), rtol=1e-15)
    away = z - optimal
    np.testing.assert_allclose(comparison.deviation, np.hypot(away[:, 0], away[:, 2]), rtol=1e-15)


# Requirements


def limit(key: str, number: float, **options: Any) -> Requirement:
    """A requirement of a kind."""
    (kind,) = [kind for kind in KINDS if kind.key == key]
    return kind(number=number, **options)


@pytest.mark.parametrize(("factor", "kept"), [(1.0, True), (2.0, True), (0.9, False)])
@pytest.mark.parametrize(
    ("kind", "metric"),
    [
        ("settles_within", "settling_time"),
        ("deviation_below", "deviation"),
        ("sliding_below", "max_sliding"),
        ("input_below", "max_input"),
    ],
)
def test_a_limit_is_of_its_own_metric(kind, metric, factor, kept) -> None:
    """It is kept if it is just met."""
    result = result_of(replace(bumped(100, 0.25), sliding=0.3 * np.ones(10_000)))
    value = result.metrics[metric].value
    assert value
    allowed = factor * value
    judgement = judge_run(limit(kind, allowed), result)
    assert judgement.measured == value
    assert judgement.kept == kept
    assert judgement.margin == allowed - value


@pytest.mark.parametrize(("reasons", "lines"), [(["a", "a"], 1), (["a", ""], 0), ([], 0)])
def test_a_requirement_that_one_of_its_runs_could_fail_is_not_told(reasons, lines) -> None:
    requirement = limit("input_below", 4.0, written="4 A")
    assert len(unfailing_line(requirement, reasons)) == lines


def test_an_optimum_settles_as_a_run_along_it_does() -> None:
    """Through one accumulation, to the bit, with any band."""
    result = result_of(bumped(slice(3000, 3010), 0.5))
    optimum = result_of(RUN)
    assert result.settled(result.comparison.optimal) == optimum.metrics["settling_time"].value
    assert result.settled(result.comparison.optimal, 0.1) == optimum.settled(
        optimum.comparison.z, 0.1
    )
    assert (result.settled(result.comparison.z) or 0.0) >= 3.01 - H


def test_a_cost_ratio_is_that_of_the_costs() -> None:
    result = result_of(bumped(100, 0.25))
    whole = result.metrics["cost_whole"].value
    optimal = result.metrics["cost_optimal"].value
    assert whole
    assert optimal
    assert judge_run(limit("cost_ratio_below", 2.0), result).measured == whole / optimal


COSTS = {"cost_continuous": 5.0, "cost_whole": 3.0, "cost_optimal": 2.0}


def test_the_rest_of_the_input_costs_a_second_over_the_optimum() -> None:
    metrics = {name: Metric(cost, "1") for name, cost in COSTS.items()}
    continuous, rest = cost_shares(metrics, duration=0.5)
    assert continuous.value == 5.0 / 2.0
    assert rest.value == (3.0 - 5.0) / (2.0 * 0.5)
    assert cost_shares(metrics | {"cost_optimal": Metric(None, "1")}, 0.5)[1].value is None


@pytest.mark.parametrize(
    ("start", "kept"), [(-1e-3, False), (1e-3, False), (-1e-12, True), (0.0, True)]
)
def test_a_surface_starts_at_zero_to_rounding(start, kept) -> None:
    run = replace(RUN, sliding=np.append(start, np.zeros(9999)))
    judgement = judge_run(limit("no_reaching_phase", 1e-9), result_of(run))
    assert judgement.measured == abs(start)
    assert judgement.kept == kept


@pytest.mark.parametrize(("row", "error"), [(6000, 0.25), (5999, 0.0), (10_000, 0.25)])
def test_an_error_stays_within_from_the_instant_itself_on(row, error) -> None:
    """To both sides: theta beyond theta_d is a negative error, after 6 s of decay."""
    within = limit("stays_within", 0.1, after=6.0)
    judgement = judge_run(within, result_of(bumped(row, 0.25)))
    assert judgement.measured == pytest.approx(error, abs=5e-3)


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("stays_within", np.abs(RUN.state[2000:, 1]).max()),
        ("final_error_below", np.abs(RUN.state[9000:, 1]).max()),
        ("rms_below", np.sqrt(np.mean(RUN.state[2000:, 1] ** 2))),
    ],
)
def test_a_requirement_on_a_state_limits_its_magnitude(key: str, expected: float) -> None:
    after = 9.0 if key == "final_error_below" else 2.0
    of_state = limit(key, 1.0, signal="rotor speed", after=after)
    judgement = judge_run(of_state, result_of(RUN))
    assert judgement.measured == pytest.approx(expected, rel=1e-12)


def test_a_requirement_on_an_output_by_its_name_limits_its_error() -> None:
    of_output = limit("stays_within", 1.0, signal="rotor angle", after=2.0)
    judgement = judge_run(of_output, result_of(RUN))
    assert judgement.measured == pytest.approx(np.abs(1.0 - RUN.state[2000:, 0]).max(), rel=1e-12)


# The record


@pytest.fixture
def record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the record, which the package takes for its own."""
    path = tmp_path / "expected.json"
    path.write_text(expected.EXPECTED_FILE.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.setattr(expected, "EXPECTED_FILE", path)
    return path


def test_a_record_keeps_other_runs(record: Path) -> None:
    before = json.loads(record.read_text())
    result = result_of(RUN)
    expected.record_expected([result])
    after = json.loads(record.read_text())
    assert after["settings"] == before["settings"]
    assert after["runs"].pop(result.key) != before["runs"].pop(result.key)
    assert after["runs"] == before["runs"]


NUMBER = Metric(1.25, "s")
NONE = Metric(None, "s", "not reached")


@pytest.mark.usefixtures("record")
@pytest.mark.parametrize(
    ("now", "recorded", "differences"),
    [
        (NONE, NUMBER, ["servo/nominal/physics/lqr: settling_time is none, recorded 1.25 s"]),
        (NUMBER, NONE, ["servo/nominal/physics/lqr: settling_time is 1.25, recorded none s"]),
        (NONE, NONE, []),
    ],
)
def test_a_record_tells_which_value_is_there_now(now, recorded, differences) -> None:
    expected.record_expected([result_of(RUN, settling_time=recorded)])
    assert expected.unexpected_results([result_of(RUN, settling_time=now)]) == differences


SWITCHING = chapter_controller("grosmc", MujocoPlant.load("servo").analytic())


@pytest.mark.usefixtures("record")
@pytest.mark.parametrize(
    ("law", "apart", "as_recorded"),
    [
        (LQR, 5e-7, True),
        (LQR, 5e-6, False),
        (SWITCHING, 1e-3, True),
        (SWITCHING, 0.5, False),
    ],
)
def test_only_laws_that_switch_may_repeat_roughly(law, apart, as_recorded) -> None:
    result = replace(result_of(RUN), controller=law)
    expected.record_expected([with_metrics(result, cost_whole=Metric(1.0, "1"))])
    now = with_metrics(result, cost_whole=Metric(1.0 + apart, "1"))
    assert (expected.unexpected_results([now]) == []) is as_recorded

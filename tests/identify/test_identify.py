"""From a log to the parameters of its machine: the fit, its doubts and its case file."""

from __future__ import annotations

import errno
import json
import math
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cases
import numpy as np
import pytest
from commands import Patch, Screen, assert_one_line, run
from identify_logs import (
    ARM_TRUE,
    LOGS,
    TRUE,
    fit_of,
    fit_of_arm,
    servo_log,
    short_arm_log,
    to_identify,
    windows,
)

from benchmarks import coverage
from benchmarks import logs as logs_made
from grosmc_mj import cli
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.arrays import Array
from grosmc_mj.identify.case_file import write_case
from grosmc_mj.identify.compare import PredictionError
from grosmc_mj.identify.fit import Fit, fit, slip
from grosmc_mj.identify.model import LogModel
from grosmc_mj.identify.parameters import parameters_of
from grosmc_mj.identify.quality import Quality, quality, residuals
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.identify.report import identification, values_table
from grosmc_mj.identify.residual import Residual, rescaled, residual_of
from grosmc_mj.identify.slips import likely_slip, unexplained_share
from grosmc_mj.simulation.loop import Loop, Sensor
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.specification import specification_of
from grosmc_mj.studies.sweep.family import Family

ARM_LOG = LOGS / "arm.csv"


@pytest.fixture(scope="module")
def plant() -> Any:
    """The plant of the case that a log is fitted to."""
    return to_identify().plant("physics")


@pytest.fixture(scope="module")
def found(plant: Any) -> Fit:
    """The fit of mass, damping and delay to the first half of a log."""
    return fit(parameters_of(to_identify(), ()), windows(servo_log().between(0, 0.5)), plant)


# -- the fit ---------------------------------------------------------------------------------------


def test_a_fit_finds_the_machine(found: Fit) -> None:
    assert found.fitted.all()
    assert (np.abs(found.values - TRUE) < 2 * found.half).all()
    assert (found.half < [0.02, 0.004, 1e-3]).all()
    assert found.scales["rotor angle"] == pytest.approx(coverage.NOISE, rel=0.05)


def test_a_fit_predicts_what_was_held_out(found: Fit, plant: Any) -> None:
    held_out = windows(servo_log().between(0.7, 1))
    (row,) = quality(residuals(found, held_out, plant), held_out.log, plant.system)
    assert row.rms == pytest.approx(coverage.NOISE, rel=0.1)
    assert row.white


def test_a_late_sensor_shows_what_the_state_was_before(plant: Any) -> None:
    """A ramp of 1 rad/s that a sensor shows 20 ms late is 20 mrad lower at each sample."""
    time = np.arange(100) * 0.01
    late = Log("late", time, np.zeros((100, 1)), {"rotor angle": time - 0.02}, [slice(0, 100)])
    predictor = Predictor.of(late, horizon=10.0, timestep=1e-3)
    instants = np.arange(1001) * 1e-3
    ramp = np.column_stack([instants, np.ones_like(instants)])

    model = LogModel(plant, Loop(sensors=(Sensor("rotor angle", delay=0.02),)))
    (errors,) = predictor.errors([ramp], model)["rotor angle"]
    # Before the window began nothing is predicted.
    assert errors[2:] == pytest.approx(np.zeros(98), abs=1e-12)


def test_fitted_starts_take_their_degrees_of_freedom() -> None:
    """Of three windows two starts each are fitted: three numbers for each measured state."""
    parts = {"angle": [np.full(4, 2.0)] * 3, "rate": [np.full(4, 6.0)] * 3}
    residual: Any = SimpleNamespace(starts=np.zeros((3, 2)), errors=lambda _: parts, huber=False)
    scales = rescaled(residual, np.zeros(6))
    assert scales == pytest.approx({"angle": 2 * math.sqrt(12 / 9), "rate": 6 * math.sqrt(12 / 9)})


def test_the_scale_of_huber_s_loss_is_the_deviation_of_all_but_the_stray_samples() -> None:
    sound = 3.0 * np.random.default_rng(0).standard_normal(20_000)
    parts = {"angle": [sound, np.full(200, 1e6)]}
    residual: Any = SimpleNamespace(starts=np.zeros((1, 1)), errors=lambda _: parts, huber=True)
    assert rescaled(residual, np.zeros(1))["angle"] == pytest.approx(3.0, rel=0.03)


@pytest.fixture(scope="module")
def residual(plant: Any) -> Residual:
    """The residual of mass, damping and delay along a part of a log."""
    parameters = parameters_of(to_identify(), ())
    predictor = windows(servo_log().between(0, 0.3))
    scales = {"rotor angle": coverage.NOISE}
    return residual_of(parameters, np.ones(3, bool), predictor, plant, scales, parameters.nominal)


def test_a_batch_of_any_size_has_the_same_residuals(residual: Residual, monkeypatch: Patch) -> None:
    x = residual.point(residual.parameters.first)
    points = [x, 1.01 * x, 0.99 * x]
    at_once = residual.of(points)
    monkeypatch.setattr("grosmc_mj.identify.residual._MOST_ROWS", 1)
    assert np.array_equal(residual.of(points), at_once)


def test_huber_s_loss_grows_by_twice_its_bound_beyond_it(residual: Residual) -> None:
    """Its bound is 1.345 deviations of the noise, within which it is the square."""
    x = residual.point(residual.parameters.first)
    (errors,) = residual.of([x])
    (rooted,) = replace(residual, huber=True).of([x])

    within = np.minimum(np.abs(errors), 1.345)
    beyond = np.abs(errors) - within
    assert (beyond == 0).any()
    assert beyond.max() > 1
    assert rooted**2 == pytest.approx(within**2 + 2 * 1.345 * beyond)
    assert np.array_equal(np.sign(rooted), np.sign(errors))


def test_a_search_that_ends_at_its_limit_of_steps_says_so(plant: Any, monkeypatch: Patch) -> None:
    monkeypatch.setattr("grosmc_mj.identify.residual.MOST_STEPS", 2)
    ended = fit(parameters_of(to_identify(), ()), windows(servo_log().between(0, 0.1)), plant)
    assert ended.doubts[0].startswith("the search ended after")


def dry_machine(number: int) -> tuple[Array, Log]:
    """Mass, damping and dry friction of a servo, and four seconds of its log with noise.

    By an integration that shares nothing with MuJoCo, exact to 50 us.
    """
    random = np.random.default_rng([5, number])
    scale = random.uniform(0.7, 2.0)
    damping = random.uniform(0.005, 0.03)
    friction = random.uniform(0.03, 0.15)
    u = np.repeat(random.uniform(-0.8, 0.8, 34), 60)[:2000]
    angles = coverage.simulated_angles(u, scale * coverage.INERTIA, damping, 0, friction)
    angles = angles + coverage.NOISE * random.standard_normal(2000)
    time = np.arange(2000) * coverage.SAMPLING
    log = Log(f"dry {number}", time, u[:, None], {"rotor angle": angles}, [slice(0, 2000)])
    return np.array([scale, damping, friction]), log


@pytest.mark.slow
def test_intervals_of_machines_with_dry_friction_have_no_bias(tmp_path: Path) -> None:
    """Mean of (estimate - truth)/deviation: 0 but for 1/sqrt(6), three times which are allowed.

    At 1 ms dry friction stops a joint late: there the mean of the inertias is -1.6.
    """
    ranges = {"rotor.mass_scale": [0.3, 4], "shaft.damping": [5e-4, 0.1], "shaft.friction": [0, 1]}
    uncertain = [{"number": f"edit.{path}", "values": values} for path, values in ranges.items()]
    experiment = Experiment.load(cases.write(tmp_path, "servo", uncertain=uncertain))
    parameters = parameters_of(experiment, ())

    deviations = []
    for number in range(8, 14):
        true, log = dry_machine(number)
        fitted = fit(parameters, windows(log), experiment.plant("physics"))
        deviations.append((fitted.values - true) / np.sqrt(np.diag(fitted.covariance)))
    assert np.abs(deviations).max() < 3.5
    assert (np.abs(np.mean(deviations, axis=0)) < 3 / math.sqrt(6)).all()


# -- doubts ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("current", "angle", "words"),
    [
        (1, 1, ""),
        (-1, 1, "rotor angle seems to have the other sign"),
        (1, 180 / np.pi, "rotor angle seems to be in degrees"),
        (1, 1e3, "rotor angle seems to be in thousandths of its unit"),
        (1e3, 1, "rotor angle seems to be in thousands of its unit"),
    ],
)
def test_another_sign_or_unit_of_a_column_is_noticed(
    plant: Any, current: float, angle: float, words: str
) -> None:
    log = servo_log().between(0, 0.3)
    outputs = {"rotor angle": angle * log.states["rotor angle"]}
    predictor = windows(replace(log, inputs=current * log.inputs, states=outputs))
    # No parameter of the case's ranges mends a slip.
    model = LogModel(plant)
    line = likely_slip(predictor, model, unexplained_share(predictor, model))
    assert line.split(":")[0] == words


@pytest.mark.parametrize(
    ("sign", "words"), [(1, ""), (-1, "rotor angle seems to have the other sign")]
)
def test_only_what_the_fit_of_a_machine_unlike_its_case_leaves_is_a_slip(
    sign: int, words: str, plant: Any
) -> None:
    """Inertia and damping of the case leave much of the motion unexplained."""
    values = [0.037 / coverage.INERTIA, 0.05, 0.0]
    u = np.repeat(np.random.default_rng(11).uniform(-0.8, 0.8, 34), 60)[:2000]
    angles = coverage.simulated_angles(u, 0.037, 0.05, late=0)
    time = np.arange(2000) * coverage.SAMPLING
    log = Log("unlike", time, sign * u[:, None], {"rotor angle": angles}, [slice(0, 2000)])
    predictor = windows(log)
    line = slip(fit_of(parameters_of(to_identify(), ()), values), predictor, plant)
    assert unexplained_share(predictor, LogModel(plant)) > 0.3
    assert line.split(":")[0] == words


def with_gaps(log: Log, every: float) -> Log:
    """A log whose samples are lost now and then."""
    samples = round(every / log.sampling)
    starts = range(0, len(log.time), samples)
    return replace(log, pieces=[slice(start, start + samples - 5) for start in starts])


def test_gaps_that_cut_predictions_short_are_told() -> None:
    assert Predictor.leading(servo_log(), 1.0, 1e-3).short_words(1.0) == ""
    words = Predictor.leading(with_gaps(servo_log(), 0.4), 1.0, 1e-3).short_words(1.0)
    assert words == (
        "the log has 9 gaps or masked parts: predictions last 0.29 s in the median and 0.29 s at "
        "most, not --horizon 1 s"
    )


UNCERTAIN_MASS = "fitted at a timestep of 1 ms: a shorter one may change 0.5 of an interval's half "
AT_1_MS = "fitted at a timestep of 0.25 ms: at 1 ms rotor mass scale would be 0.02"


@pytest.mark.parametrize(
    ("timesteps", "shift", "left", "words"),
    [
        ((1e-3, 5e-4), 0.0, 1e-5, ""),
        ((1e-3, 1e-3), 0.0, 1e-5, ""),
        ((1e-3, 1e-3), 0.0, 0.01, f"{UNCERTAIN_MASS}width, which it counts"),
        ((1e-3, 2.5e-4), 0.02, 1e-5, f"{AT_1_MS} lower, 1 of its interval's half width"),
        (
            (1e-3, 2.5e-4),
            -0.02,
            0.01,
            f"{AT_1_MS} higher, 1 of its interval's half width; a shorter one may change 0.5 of an "
            "interval's half width, which it counts",
        ),
    ],
)
def test_the_effect_of_a_timestep_is_told_beside_the_interval(
    timesteps: tuple[float, float], shift: float, left: float, words: str
) -> None:
    """Of the first of three parameters, whose half width is 0.02."""
    fitted = fit_of(
        parameters_of(to_identify(), ()),
        TRUE,
        half=np.array([0.02, 1.0, 1.0]),
        timesteps=timesteps,
        shift=np.array([shift, 0.0, 0.0]),
        left=np.array([left, 0.0, 0.0]),
    )
    assert fitted.doubts == ([words] if words else [])


# -- the table and the answer ----------------------------------------------------------------------


def row_of(value: float, half: float | None, low: float, high: float) -> list[str]:
    """The row of a mass with a value, half the width of its interval, and a range."""
    support = SimpleNamespace(support=(low, high))
    mass: Any = SimpleNamespace(name="m", unit="kg", nominal=1.23456, distribution=support)
    parameters = SimpleNamespace(quantities=[mass])
    fitted = np.array([half is not None])
    table = values_table(fit_of(parameters, [value], half=np.array([half]), fitted=fitted))
    return [*table.rows[0]]


@pytest.mark.parametrize(
    ("value", "half", "cells"),
    [
        (2.345678, 0.0123456, ["m", "2.346", "2.333 to 2.358", "kg", "1.235", ""]),
        (2.345678, None, ["m", "2.346", "-", "kg", "1.235", "held: not visible in this log"]),
    ],
)
def test_an_interval_is_the_value_and_its_half_width_on_either_side_in_four_digits(
    value: float, half: float | None, cells: list[str]
) -> None:
    assert row_of(value, half, 0.5, 30.0) == cells


@pytest.mark.parametrize(
    ("low", "high", "value", "half", "at_end"),
    [
        # A wide range says nothing about how near its end is.
        (0.01, 100.0, 0.08, 1e-3, False),
        (0.01, 100.0, 0.0101, 1e-2, True),
        (0.0, 0.5, 0.0, 1e-2, True),
        (0.0, 0.5, 0.5, 1e-9, True),
        (0.0, 0.5, 0.4999, 1e-5, False),
    ],
)
def test_a_value_is_at_the_end_of_its_range_by_its_interval(
    low: float, high: float, value: float, half: float, at_end: bool
) -> None:
    note = row_of(value, half, low, high)[-1]
    assert note == ("at the end of its range: widen it, or check the log" if at_end else "")


def test_the_quality_of_a_fit_is_the_residual_beside_the_motion_of_its_windows(plant: Any) -> None:
    """Residuals of 0.5 rad in two windows of a ramp of an encoder with steps of 0.02 rad."""
    time = 0.01 * np.arange(400)
    angle = 0.02 * np.arange(400)
    log = Log("log", time, time[:, None], {"rotor angle": angle}, [slice(0, 400)])
    residual = 0.5 * (-1.0) ** np.arange(100)
    parts = [(slice(0, 100), residual), (slice(300, 400), residual)]
    (row,) = quality({"rotor angle": parts}, log, plant.system)
    spread = np.std([*angle[:100], *angle[300:]])
    assert (row.rms, row.step) == pytest.approx((0.5, 0.02))
    assert row.fit == pytest.approx(1 - 0.5 / spread)
    assert row.moves
    assert not row.diverges


def test_the_worst_prediction_is_that_of_the_most_steps_of_its_sensor() -> None:
    """0.03 rad are 15 steps, 0.4 rad/s are 8."""
    rows = [
        Quality("angle", "rad", 0.0, 1.0, 2e-3, moves=True, diverges=False, white=True),
        Quality("rate", "rad/s", 0.0, 1.0, 50e-3, moves=True, diverges=False, white=True),
    ]
    predicted = [
        PredictionError("physics", "angle", "rad", [0.1, 2.0], [4e-3, 30e-3]),
        PredictionError("physics", "rate", "rad/s", [0.1, 2.0], [0.3, 0.4]),
    ]
    fitted = fit_of(parameters_of(to_identify(), ()), TRUE)
    (answer,) = identification(fitted, rows, predicted, "log", 2.0, 0.3).answers
    assert answer.words == (
        "3 of 3 parameters fitted; "
        "angle of the held-out part predicted to 4.0e-3 rad after 0.1 s and 0.03 rad after 2 s "
        "(2 and 15 steps of its sensor)"
    )


# -- the case file ---------------------------------------------------------------------------------


def family_of_case(fitted: Fit, folder: Path) -> Family:
    """The distribution of a campaign of the case file that is written of a fit."""
    write_case(fitted, "a log", folder / "identified.toml")
    return Campaign.of(specification_of(str(folder / "identified.toml"), runs=4)).family


DEVIATIONS = np.array([0.02, 1e-3, 2e-4])
CORRELATION = np.array([[1.0, 0.4, -0.3], [0.4, 1.0, 0.2], [-0.3, 0.2, 1.0]])


def test_an_identified_case_has_the_distribution_of_its_fit(tmp_path: Path) -> None:
    covariance = CORRELATION * np.outer(DEVIATIONS, DEVIATIONS)
    fitted = fit_of(parameters_of(to_identify(), ()), TRUE, covariance=covariance)
    family = family_of_case(fitted, tmp_path)
    assert family.nominal == pytest.approx(TRUE)
    assert family.correlation == pytest.approx(CORRELATION, abs=1e-9)
    # One standard deviation above the mean has this probability below it.
    one_deviation = 0.8413447460685429
    (upper,) = family.values(np.array([[one_deviation, 0.5, 0.5]]))
    assert upper[0] - TRUE[0] == pytest.approx(DEVIATIONS[0], rel=1e-3)


def test_a_number_that_was_held_stays_as_uncertain_as_declared(tmp_path: Path) -> None:
    """The log showed mass and delay, and not the damping."""
    parameters = parameters_of(to_identify(), ())
    values = [TRUE[0], parameters.nominal[1], TRUE[2]]
    held = fit_of(
        parameters,
        values,
        fitted=np.array([True, False, True]),
        covariance=np.diag(DEVIATIONS[[0, 2]] ** 2),
        half=2 * DEVIATIONS[[0, 2]],
    )
    family = family_of_case(held, tmp_path)
    assert sorted(family.names) == ["computing delay", "rotor mass scale", "shaft damping"]
    damping = family.quantities[family.names.index("shaft damping")]
    assert damping.distribution.support == (0.0005, 0.1)
    assert damping.nominal == parameters.nominal[1]


def test_a_fitted_disturbance_is_written_from_its_number_in_any_spelling(tmp_path: Path) -> None:
    """Half as large again, and twice; a number needs no blank before its unit."""
    loads = [
        {"body": "rotor", "torque": ["0N*m", "-0.2N*m", "0 N m"], "label": "push"},
        {"input": "current", "amplitude": "0.1A", "label": "offset"},
    ]
    uncertain = [
        {
            "number": f"disturbance.{name}.scale",
            "values": [0, 3],
            "nominal": 0,
            "name": f"{name} size",
        }
        for name in ("push", "offset")
    ]
    path = cases.write(tmp_path, "servo", disturbance=loads, uncertain=uncertain)
    fitted = fit_of(parameters_of(Experiment.load(path), ()), [1.5, 2.0])
    write_case(fitted, "a log", tmp_path / "identified.toml")
    push, offset = Experiment.load(tmp_path / "identified.toml").disturbances
    assert push.amplitudes == pytest.approx([0, 0, 0, 0, -0.3, 0])
    assert offset.amplitudes == pytest.approx([0.2])


# -- the command -----------------------------------------------------------------------------------


def test_the_shipped_logs_are_those_of_the_benchmark() -> None:
    """To a unit of the last digit, which another libm may round the other way."""
    computed = np.column_stack(logs_made.arm())
    shipped = np.loadtxt(ARM_LOG, delimiter=",", skiprows=1)
    assert np.abs(shipped - computed).max() < 1e-4


def test_identify_writes_the_numbers_of_the_arm_a_figure_and_a_case(
    printed: Any, tmp_path: Path
) -> None:
    """The equations of the arm have no damping: the identified case leaves them out."""
    shutil.copy(ARM_LOG, tmp_path)
    printed("identify", "arm.csv", "logs/arm")
    folder = tmp_path / "renders"
    document = json.loads((folder / "identification_logs_arm_arm.json").read_text())
    payload, damping = (row["value"] for row in document["parameters"])
    assert payload == pytest.approx(ARM_TRUE[0], rel=2e-3)
    assert damping == pytest.approx(logs_made.DAMPING, rel=0.02)
    assert (folder / "identification_logs_arm_arm.png").is_file()
    assert Experiment.load(folder / "identify_logs_arm_arm.toml").plant_names == ["physics"]


def test_a_full_disk_loses_no_fit(tmp_path: Path, capsys: Screen, monkeypatch: Patch) -> None:
    """No file can be written: the values and the case are on the screen, then the error."""

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    log = short_arm_log(tmp_path)
    monkeypatch.setattr(Path, "replace", full)
    monkeypatch.setattr("grosmc_mj.identify.fit.fit", fit_of_arm)
    assert run("identify", log, "logs/arm", "--horizon", 0.4, "--out", tmp_path) == cli.WRONG
    printed = capsys.readouterr()
    assert "2 of 2 parameters fitted" in printed.out
    assert "No space left on device" in printed.err
    assert_one_line(printed.err)

    _, mark, text = printed.out.partition("# Written by grosmc-mj identify")
    payload = tomllib.loads(mark + text)["uncertain"][0]
    assert payload["nominal"] == pytest.approx(ARM_TRUE[0])


@pytest.mark.slow
def test_ctrl_c_keeps_the_best_so_far(tmp_path: Path, capsys: Screen, monkeypatch: Patch) -> None:
    """After six steps of a search: the answer says so, and the case has the values so far."""
    steps = iter(range(6))
    jacobian = Residual.jacobian

    def interrupted(residual: Residual, x: Array) -> Array:
        if next(steps, None) == 5:
            raise KeyboardInterrupt
        return jacobian(residual, x)

    monkeypatch.setattr(Residual, "jacobian", interrupted)
    options = ("--hold-out", 0.8, "--out", tmp_path)
    assert run("identify", ARM_LOG, "logs/arm", *options) == cli.INTERRUPTED
    assert "interrupted: values are the best so far" in capsys.readouterr().out
    document = json.loads((tmp_path / "identification_logs_arm_arm.json").read_text())
    assert document["parameters"][0]["value"] == pytest.approx(ARM_TRUE[0], rel=0.1)
    assert Experiment.load(tmp_path / "identify_logs_arm_arm.toml").plant_names == ["physics"]


REFUSED: list[tuple[tuple[Any, ...], str]] = [
    (("--hold-out", 1.5), "--hold-out 1.5 must be above 0 and below 0.9"),
    (("--hold-out", 1e-4), "too few samples are left to predict"),
    (("--horizon", 0.001), "0.001 s is 0.5 samples of arm.csv: it must be 10"),
    (("--horizon", "nan"), "--horizon nan must be above 0 s"),
    (("--fit", "link mass"), "unknown parameter 'link mass'"),
    (("--fit", "edit.joint.friction"), "the case has none: give it a range"),
    (("--fit", "edit.lonk.mass_scale"), "unknown body 'lonk'"),
]


@pytest.mark.parametrize(("options", "words"), REFUSED)
def test_a_wrong_option_is_one_line(options: tuple[Any, ...], words: str, capsys: Screen) -> None:
    assert run("identify", ARM_LOG, "logs/arm", *options) == cli.WRONG
    error = capsys.readouterr().err
    assert words in error
    assert_one_line(error)


@pytest.mark.parametrize("command", ["identify", "compare"])
def test_a_place_that_takes_no_file_is_refused_before_the_work(
    command: str, tmp_path: Path, capsys: Screen, monkeypatch: Patch
) -> None:
    monkeypatch.setattr("grosmc_mj.identify.replay.simulate", lambda *_, **__: pytest.fail("ran"))
    out = tmp_path / "a file"
    out.touch()
    assert run(command, ARM_LOG, "logs/arm", "--out", out) == cli.WRONG
    error = capsys.readouterr().err
    assert "a file is a file, and a folder is needed" in error
    assert_one_line(error)

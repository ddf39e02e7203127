"""From a log to the parameters of its machine: logs, fits, what they do not show, the case file."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import assert_one_line, run
from mcap_ros2.writer import Writer

import grosmc_mj as gm
from benchmarks import coverage
from benchmarks import logs as logs_made
from grosmc_mj import cli
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment, experiment_of
from grosmc_mj.experiments.file.reading import parse_case_file
from grosmc_mj.experiments.file.schema import LogTable
from grosmc_mj.identify.case_file import write_case
from grosmc_mj.identify.compare import Rung, best_rung, compared, rungs_of
from grosmc_mj.identify.fit import _residual_of, _weak, fit, quality, residuals
from grosmc_mj.identify.log import Log, held, joined, read_log
from grosmc_mj.identify.parameters import parameters_of
from grosmc_mj.identify.replay import Predictor, require_matching
from grosmc_mj.loop import Computing, Loop
from grosmc_mj.plants import find_system
from grosmc_mj.sweep.campaign import Campaign, specification_of

SERVO = find_system("servo")
HOW: dict[str, Any] = {"horizon": 1.0, "timestep": 1e-3}
HEADER = "time [s],current [A],rotor angle [rad]"


@cache
def short(number: int, seconds: float = 4.0) -> tuple[Array, Log]:
    """The first seconds of a machine of the coverage benchmark."""
    true, log = coverage.machine(number)
    kept = round(seconds / coverage.SAMPLING)
    return true, Log(
        log.name, log.time[:kept], log.inputs[:kept],
        {name: values[:kept] for name, values in log.outputs.items()}, [slice(0, kept)],
    )  # fmt: skip


@pytest.fixture(scope="module")
def log() -> Log:
    return short(0)[1]


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return coverage.case(tmp_path_factory.mktemp("case"))


def csv(path: Path, rows: Array, header: str = HEADER) -> Path:
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def columns(log: Log) -> Array:
    return np.column_stack([log.time, log.inputs, log.outputs["rotor angle"]])


def test_a_log_is_read_in_the_units_of_its_headers(tmp_path: Path, log: Log) -> None:
    rows = columns(log)
    plain = csv(tmp_path / "a.csv", rows)
    gap = read_log(csv(tmp_path / "gap.csv", np.delete(rows, slice(500, 700), axis=0)), SERVO, None)
    rows[:, 0] *= 1e3
    rows[:, 2] = np.degrees(rows[:, 2])
    other = csv(tmp_path / "b.csv", rows, "t [ms],i,Rotor_Angle (deg)")
    for path in (plain, other):
        found = read_log(path, SERVO, None)
        assert np.allclose(found.time, log.time, atol=1e-9)
        assert np.allclose(found.inputs, log.inputs)
        assert np.allclose(found.outputs["rotor angle"], log.outputs["rotor angle"], atol=1e-7)
    # A gap ends a piece, and a part is held out.
    assert gap.pieces == [slice(0, 500), slice(500, 1800)]
    seen, last = gap.between(0, 0.7), gap.between(0.7, 1)
    assert seen.pieces[-1].stop == last.pieces[0].start
    assert gap.time[last.pieces[0].start] == pytest.approx(0.7 * gap.time[-1], abs=0.002)
    # The case names columns, with sign, scale and offset.
    rows = columns(log)[:, 1:]
    rows[:, 1] = 100 - rows[:, 1] / 0.01
    counts = {"column": "counts", "sign": -1, "scale": 0.01, "offset": 100.0}
    named = {"current": {"column": "command"}, "rotor angle": counts}
    table = LogTable.model_validate({"sampling": "2 ms", "columns": named})
    found = read_log(csv(tmp_path / "c.csv", rows, "command,counts"), SERVO, table)
    assert np.allclose(found.time, log.time)
    assert np.allclose(found.outputs["rotor angle"], log.outputs["rotor angle"], atol=1e-6)


def test_messages_of_several_topics_are_brought_to_the_instants_of_the_state(
    tmp_path: Path, log: Log
) -> None:
    path, begin = tmp_path / "bag.mcap", 1_760_000_000_000_000_000
    with path.open("wb") as file:
        writer = Writer(file)
        joints = writer.register_msgdef("sensor_msgs/msg/JointState", "float64[] position\n")
        number = writer.register_msgdef("std_msgs/msg/Float64", "float64 data\n")
        for k, (time, u, angle) in enumerate(columns(log)):
            stamp = begin + round(1e9 * time)
            if k % 60 == 0:  # when it changes
                writer.write_message("/current", number, {"data": u}, log_time=stamp)
            writer.write_message("/joints", joints, {"position": [angle]}, log_time=stamp)
        writer.finish()
    names = {"current": "/current.data", "rotor angle": "/joints.position[0]"}
    table = {"columns": {name: {"column": column} for name, column in names.items()}}
    found = read_log(path, SERVO, LogTable.model_validate(table))
    assert np.allclose(found.time, log.time, atol=1e-9)
    assert np.array_equal(found.inputs, log.inputs)
    assert np.array_equal(found.outputs["rotor angle"], log.outputs["rotor angle"])


def test_several_logs_are_fitted_together_and_no_window_joins_them() -> None:
    first, second = short(0, 1.0)[1], short(1, 2.0)[1]
    both = joined([first, second])
    assert both.pieces == [slice(0, 500), slice(501, 1501)]
    assert (np.diff(both.time) > 0).all()
    assert both.noise("rotor angle") == pytest.approx(coverage.NOISE, rel=0.1)
    for piece, log in zip(both.pieces, (first, second), strict=True):
        assert np.array_equal(both.inputs[piece], log.inputs)
        assert np.array_equal(both.outputs["rotor angle"][piece], log.outputs["rotor angle"])
    start = both.time[501]
    late = held(both.time, both.inputs, 5e-3, start + np.array([0.0, 1e-3]))
    assert late[0] == pytest.approx(second.inputs[0])
    with pytest.raises(ArgumentError, match="several logs must measure the same states"):
        joined([first, replace(second, outputs={"rotor speed": second.outputs["rotor angle"]})])


def changed(where: Any, value: Callable[[Array], Any]) -> Any:
    """A change of some entries of a log's rows."""

    def change(rows: Array) -> Array:
        rows[where] = value(rows)
        return rows

    return change


def saturated(rows: Array) -> Array:
    return np.minimum(np.sin(np.linspace(0, 40, len(rows)) ** 1.5) + 0.8, 0.6)


ALL = slice(None)


WRONG: list[tuple[Any, str, str]] = [
    (lambda rows: rows[:10], HEADER, "has 10 rows of numbers; 50 or more are needed"),
    (changed((300, 0), lambda rows: rows[299, 0]), HEADER, "the time does not rise at row 301"),
    (changed((ALL, 1), lambda _: 0.3), HEADER, "the input is 0.3 A all the time"),
    (changed((100, 2), lambda _: np.nan), HEADER, "is no number in row 102: fill or cut it"),
    (changed((ALL, 1), saturated), HEADER, "it saturates"),
    (np.array, "time [s],volts,rotor angle", "no column of the input 'current'"),
    (np.array, "time [s],current,x", "no column of a state"),
    (np.array, "a,current,rotor angle", "no column of the time"),
    (np.array, "time [s],current [A],rotor angle [kg]", "cannot be converted to rad"),
]


def test_a_log_that_is_wrong_is_named(tmp_path: Path, log: Log, experiment: Experiment) -> None:
    for change, header, words in WRONG:
        path = csv(tmp_path / "log.csv", change(columns(log)), header)
        with pytest.raises(ArgumentError, match=rf"log\.csv.*{re.escape(words)}"):
            read_log(path, SERVO, None)
    plant, angle = experiment.plant("physics"), log.outputs["rotor angle"]
    require_matching(log, plant, **HOW)
    for factors, words in (
        ((-1, 1), "rotor angle seems to have the other sign"),
        ((1, 180 / np.pi), "rotor angle seems to be in degrees"),
        ((1, 1e3), "rotor angle seems to be in thousandths"),
    ):
        outputs = {"rotor angle": factors[1] * angle}
        slipped = replace(log, inputs=factors[0] * log.inputs, outputs=outputs)
        with pytest.raises(ArgumentError, match=words):
            require_matching(slipped, plant, **HOW)


def test_a_held_input_is_late_by_any_delay_without_jumps() -> None:
    time, values = np.arange(5) * 0.1, np.array([[0.0], [1.0], [1.0], [3.0], [0.0]])
    grid = np.arange(9) * 0.05
    assert held(time, values, 0.0, grid)[:, 0].tolist() == pytest.approx([0, 0, 1, 1, 1, 1, 3, 3])
    late = held(time, values, 0.02, grid)[:, 0]
    assert late.tolist() == pytest.approx([0, 0, 0.6, 1, 1, 1, 0.4 * 1 + 0.6 * 3, 3])
    near = held(time, values, 0.02 + 1e-7, grid)[:, 0]
    assert np.abs(near - late).max() < 1e-5


def test_a_fit_finds_the_machine_and_predicts_what_was_held_out(
    experiment: Experiment, tmp_path: Path
) -> None:
    true, log = short(0, 4.0)
    parameters, plant = parameters_of(experiment, coverage.NAMES), experiment.plant("physics")
    found = fit(parameters, log.between(0, 0.7), plant, **HOW)
    assert found.fitted.all()
    assert (np.abs(found.values - true) < 2 * found.half).all()
    assert found.scales["rotor angle"] == pytest.approx(coverage.NOISE, rel=0.05)
    held_out = log.between(0.7, 1)
    (row,) = quality(residuals(found, held_out, plant, **HOW), held_out, plant.system)
    assert row.rms == pytest.approx(coverage.NOISE, rel=0.1)
    assert row.white
    path = tmp_path / "identified.toml"
    write_case(found, log.name, path)
    family = Campaign.of(specification_of(str(path), runs=4)).family
    assert family.nominal == pytest.approx(found.values)
    assert family.correlation == pytest.approx(found.correlation, abs=1e-9)
    (upper,) = family.values(np.array([[0.8413447460685429, 0.5, 0.5]]))
    assert upper[0] - found.values[0] == pytest.approx(found.covariance[0, 0] ** 0.5, rel=1e-3)


MASS = '{ body = "rotor", mass_scale = [0.3, 4] }'
ARMATURE = '{ joint = "shaft", armature = [0, 0.1] }'
DAMPING = '{ joint = "shaft", damping = [0.001, 0.1] }'
FRICTION = '{ joint = "shaft", friction = [0, 0.05] }'
LATE_INPUT = '{ actuator = "current", delay = ["0 ms", "10 ms"] }'
LATE_SENSOR = '{ sensor = "rotor angle", delay = ["0 ms", "10 ms"] }'
SCALE = '{ sensor = "rotor angle", scale = [0.5, 2] }'
BIAS = '{ sensor = "rotor angle", bias = ["-1 rad", "1 rad"] }'
PARTS = """
sensor = [{ of = "rotor angle", delay = "2 ms" }]
actuator = [{ of = "current", delay = "2 ms" }]
"""
# Uncertain numbers, and those that a log of current and angle does not show one by one.
HIDDEN: list[tuple[list[str], set[str]]] = [
    ([MASS, DAMPING, ARMATURE], {"rotor mass scale", "shaft armature"}),
    ([MASS, DAMPING, SCALE], {"rotor mass scale", "shaft damping", "rotor angle scale"}),
    ([MASS, BIAS, DAMPING], {"rotor angle bias"}),
    ([MASS, LATE_INPUT, LATE_SENSOR], {"current delay", "rotor angle delay"}),
    ([DAMPING, FRICTION], set()),
]


def test_parameters_that_a_log_does_not_show_are_named(tmp_path: Path, log: Log) -> None:
    head, path = coverage.CASE[: coverage.CASE.index("uncertain")], tmp_path / "case.toml"
    for uncertain, hidden in HIDDEN:
        text = f"{head}uncertain = [{', '.join(uncertain)}]{PARTS}"
        path.write_text(text, encoding="utf-8")
        case = experiment_of(parse_case_file(text, path), path)
        parameters, plant = parameters_of(case, ()), case.plant("physics")
        free, scales = np.ones(len(parameters.names), bool), {"rotor angle": coverage.NOISE}
        predictor = Predictor.of(log, **HOW)
        residual = _residual_of(parameters, free, predictor, plant, scales, parameters.nominal)
        weak = _weak(parameters, free, residual.jacobian(residual.point(parameters.first)))
        assert ({weak.held, *weak.others} if weak else set()) == hidden


def test_the_rung_that_made_a_log_explains_it_best(experiment: Experiment) -> None:
    true, log = short(1)
    parameters = parameters_of(experiment, coverage.NAMES)
    plant = parameters.plant(true, experiment.plant("physics"))
    late = Loop(computing=Computing(delay=round(float(true[2]), 3)))
    rungs = {**rungs_of(experiment), "ideal": Rung(plant), "as it is": Rung(plant, late)}
    assert {"corrected", "physics", "loop", "machine"} < set(rungs)
    rows, _ = compared(rungs, log, 1.0, 1e-3)
    assert best_rung(rows) == {"rotor angle": "as it is"}


def test_the_log_of_the_arm_gives_a_case_that_runs_on_its_physics(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The equations of the arm have no damping: the identified case leaves them out."""
    logs = Path(gm.__file__).parent / "cases/logs"
    assert run("identify", logs / "arm.csv", "logs/arm", "--out", tmp_path) == cli.DONE
    assert "2 of 2 parameters fitted" in capsys.readouterr().out
    document = json.loads((tmp_path / "identification_arm_arm.json").read_text())
    payload, damping = document["parameters"]
    assert payload["value"] == pytest.approx(logs_made.PAYLOAD / 0.02, rel=2e-3)
    assert damping["value"] == pytest.approx(logs_made.DAMPING, rel=0.02)
    assert (tmp_path / "identification_arm_arm.png").is_file()
    assert Experiment.load(tmp_path / "identify_arm_arm.toml").plant_names == ["physics"]
    assert run("compare", logs / "arm.csv", "logs/arm", "--out", tmp_path) == cli.DONE
    assert "Least error after" in capsys.readouterr().out


def test_the_shipped_logs_are_those_of_the_benchmark() -> None:
    """To a unit of the last digit, which another libm may round the other way."""
    shipped = Path(gm.__file__).parent / "cases/logs/arm.csv"
    made = np.column_stack(logs_made.arm())
    assert np.abs(np.loadtxt(shipped, delimiter=",", skiprows=1) - made).max() < 1e-4


def test_a_wrong_option_is_one_line(
    tmp_path: Path, log: Log, capsys: pytest.CaptureFixture[str]
) -> None:
    path, mass = csv(tmp_path / "bench.csv", columns(log)[:800]), "body.rotor.mass_scale"
    for fitted, options, words in (
        (mass, ("--hold-out", 1.5), "--hold-out 1.5 must be above 0 and below 0.9"),
        (mass, ("--hold-out", 1e-4), "too few samples are left to predict"),
        (mass, ("--horizon", 0.001), "0.001 s is 0.5 samples of bench.csv: it must be 10"),
        (mass, ("--horizon", "nan"), "--horizon nan must be above 0 s"),
        ("rotor mass", (), "unknown parameter 'rotor mass'"),
        ("joint.shaft.armature", (), "the case has none: give it a range"),
        ("body.rotr.mass_scale", (), "unknown body 'rotr'"),
    ):
        assert run("identify", path, "servo/nominal", "--fit", fitted, *options) == cli.WRONG
        error = capsys.readouterr().err
        assert words in error
        assert_one_line(error)

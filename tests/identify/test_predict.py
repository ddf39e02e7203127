"""A closed loop on a machine that is known is predicted; without its friction, it is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cases
import numba
import numpy as np
import pyarrow
import pyarrow.csv
import pytest

from grosmc_mj.cli.program import parse
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.experiments.measured import run_of_log
from grosmc_mj.experiments.requirements.accumulator import _noting_rows
from grosmc_mj.ground.errors import ArgumentError, SetupError
from grosmc_mj.identify import predict as predictions
from grosmc_mj.identify.law_on_log import LawOnLog, law_on_log
from grosmc_mj.identify.predict import (
    PredictedQuantity,
    Prediction,
    PredictionQuestion,
    predict,
    question_of,
)
from grosmc_mj.identify.predict_report import prediction_result, quantities_table
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.output.results.document import json_text
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.studies.comparison.comparison import compare

TABLES: dict[str, Any] = {
    "plant": {"compare": ["physics"]},
    "run": {"start": {"rotor angle": "0 rad"}, "duration": "3 s", "control_period": "5 ms"},
    "computing": {"delay": "5 ms"},
    "sensor": [
        {"of": "rotor angle", "resolution": "1 mrad", "bias": "0.02 rad"},
        {"of": "rotor speed", "noise": "0.05 rad/s"},
    ],
    "edit": [
        {"body": "rotor", "mass_scale": 1.5},
        {"joint": "shaft", "friction": "0.02 N m"},
    ],
    "requirement": {"reaches_within": "2.5 s", "band": "0.1 rad"},
}
SYSTEM = MujocoPlant.load("servo").system
FREE = np.array([[-np.inf], [np.inf]])


def turning(**tables: Any) -> Experiment:
    """A servo that turns by 1 rad, whose friction, mass and sensors are known."""
    return cases.case("servo", **(TABLES | tables))


@pytest.fixture(scope="module")
def machine() -> Experiment:
    """The servo under LQR."""
    return turning()


def log_of(machine: Experiment) -> Log:
    """The log of a run: what the law was told and what it commanded, at its samples."""
    run = machine.changed(run_number=77, duration=3.005).run(law="lqr").trajectory
    assert run.seen is not None
    rows = np.arange(0, len(run.seen), 5)
    names = [state.name for state in run.system.states]
    return Log(
        name="simulated",
        time=run.time[rows],
        inputs=run.command[rows][:, None],
        states={name: run.seen[rows, j] for j, name in enumerate(names)},
        pieces=[slice(0, len(rows))],
    )


@pytest.fixture(scope="module")
def log(machine: Experiment) -> Log:
    """The log of a run of the servo."""
    return log_of(machine)


def found(machine: Experiment, log: Log, limits: np.ndarray = FREE) -> LawOnLog:
    """The law of a machine beside a log."""
    applied = machine.applied_loop("physics", "lqr")
    assert applied is not None
    return law_on_log(applied, log, np.array(machine.x0), limits)


def later(log: Log, rows: int) -> Log:
    """A log whose commands stand some rows after the states that they were computed from."""
    end = len(log.time) - rows
    states = {name: values[:end] for name, values in log.states.items()}
    inputs = np.vstack([np.zeros((rows, 1)), log.inputs[:end]])[:end]
    return replace(log, time=log.time[:end], inputs=inputs, states=states, pieces=[slice(0, end)])


# -- the log of a prediction ----------------------------------------------------------------------


def variation(rows: np.ndarray) -> float:
    """Sum of the steps of an input."""
    return float(np.abs(np.diff(rows, axis=0)).sum())


@pytest.mark.parametrize("rows", [0, 1])
def test_a_jump_from_rest_is_in_both_logs_or_in_none(machine: Experiment, rows: int) -> None:
    """A command that stands beside its states, or a row later, with the delay of the computer."""
    assert machine.loop is not None
    exact = machine.changed(loop=Loop(machine.loop.computing).completed(SYSTEM))
    log = log_of(exact)
    late = np.vstack([np.zeros((rows, 1)), log.inputs])[: len(log.time)]
    question = question_of(exact, "lqr", replace(log, inputs=late), log)
    assert question.law_on_log is not None
    assert question.law_on_log.rows == rows
    prediction = predict(question, 1)
    measured = variation(question.log.inputs)
    # The jump is 1 A; the noise that the differences of a log seem to have gives 0.15 A.
    assert variation(prediction.logs[0].inputs) == pytest.approx(measured, abs=0.2)


# -- the law on logged states ----------------------------------------------------------------------


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_the_law_that_made_a_log_reproduces_its_commands(
    machine: Experiment, log: Log, rows: int
) -> None:
    finding = found(machine, later(log, rows))
    assert finding.first is None
    assert finding.rows == rows
    assert finding.largest < 1e-12


def test_a_law_that_predicts_reproduces_its_commands_to_the_bit() -> None:
    """It counts the ticks of its clock: 0.029 s / 1 ms is 28.999... in floats, and is tick 29."""
    predicting = turning(controller={"law": "lqr", "predict": True})
    log = log_of(predicting)
    assert (log.time // 1e-3 != np.rint(log.time / 1e-3)).any()
    finding = found(predicting, log)
    assert (finding.rows, finding.largest) == (0, 0.0)


def test_a_law_reproduces_commands_within_the_limits_of_its_inputs(
    machine: Experiment, log: Log
) -> None:
    low, high = -0.1, 0.5
    assert log.inputs.max() > high
    limited = replace(log, inputs=np.clip(log.inputs, low, high))
    assert found(machine, limited, np.array([[low], [high]])).first is None


@pytest.mark.parametrize("rows", [0, 1])
def test_another_law_differs_from_its_first_command_on(
    machine: Experiment, log: Log, rows: int
) -> None:
    finding = found(machine, later(replace(log, inputs=1.1 * log.inputs), rows))
    assert finding.first == 0.0
    assert finding.logged == pytest.approx(1.1 * finding.asked)


@pytest.mark.parametrize(
    ("finding", "words"),
    [
        (LawOnLog(0, 2.04e-7, "A"), "reproduces the logged command to 2.0e-07 A"),
        (
            LawOnLog(1, 2.06e-7, "A"),
            "reproduces the logged command to 2.1e-07 A, 1 row after its states",
        ),
        (
            LawOnLog(3, 0.0, "1"),
            "reproduces the logged command to 0.0e+00, 3 rows after its states",
        ),
        (
            LawOnLog(3, 0.5, "A", first=1.25, asked=2.5, logged=2.75),
            "differs from the logged command by up to 0.5 A, first at 1.25 s: 2.5, logged 2.75 A",
        ),
    ],
)
def test_the_finding_says_how_near_the_commands_are_and_how_late(
    finding: LawOnLog, words: str
) -> None:
    assert finding.words == words


def test_a_rate_that_is_not_logged_is_differenced_as_in_the_loop(machine: Experiment) -> None:
    loop = machine.loop
    assert loop is not None
    differencing = machine.changed(loop=Loop(loop.computing, loop.sensors[:1]).completed(SYSTEM))
    log = log_of(differencing)
    angle = {"rotor angle": log.states["rotor angle"]}
    finding = found(differencing, replace(log, states=angle))
    assert finding.first is None
    assert finding.largest < 1e-12


def test_a_law_is_not_asked_on_states_that_it_did_not_have(machine: Experiment, log: Log) -> None:
    angle = {"rotor angle": log.states["rotor angle"]}
    with pytest.raises(ArgumentError, match="does not measure rotor speed"):
        found(machine, replace(log, states=angle))
    with pytest.raises(ArgumentError, match="a row every 10 ms, the law runs every 5 ms"):
        found(machine, replace(log, time=2 * log.time))


def test_a_log_is_judged_without_compiled_code_to_debug(
    machine: Experiment, log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compilation is off: numbers of a log are those with it, and a prediction says why not."""
    judged = run_of_log(machine, log, "lqr", tmp_path / "log.csv").metrics
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    _noting_rows.cache_clear()
    assert run_of_log(machine, log, "lqr", tmp_path / "log.csv").metrics == judged
    with pytest.raises(SetupError, match="NUMBA_DISABLE_JIT is set"):
        question_of(machine, "lqr", log, log)


def test_a_case_without_a_requirement_predicts_nothing(log: Log) -> None:
    with pytest.raises(ArgumentError, match="no requirement that can be predicted: there is none"):
        question_of(turning(requirement=[]), "lqr", log, log)


# -- prediction ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def question(machine: Experiment, log: Log) -> PredictionQuestion:
    """The machine beside the log of one of its runs."""
    return question_of(machine, "lqr", log, log)


@pytest.fixture(scope="module")
def complete(question: PredictionQuestion) -> Prediction:
    """Eight predicted runs."""
    return predict(question, 8)


def test_start_and_sensors_are_those_of_the_log(question: PredictionQuestion) -> None:
    loop = question.experiment.loop
    assert loop is not None
    assert question.experiment.x0[0] == pytest.approx(0.0, abs=2e-3)
    sensors = {sensor.of: sensor for sensor in loop.sensors}
    assert sensors["rotor angle"].resolution == pytest.approx(1e-3, rel=1e-6)
    assert sensors["rotor angle"].bias == 0.02
    assert sensors["rotor speed"].noise == pytest.approx(0.05, rel=0.1)


def test_a_run_of_the_machine_lies_within_the_spread_of_its_predictions(
    complete: Prediction,
) -> None:
    (reaches,) = [item for item in complete.quantities if item.required]
    assert reaches.contains(reaches.measured)
    # An encoder of 1 mrad, and noise of the velocity: the runs differ by little.
    assert complete.misfits.max() < 5e-3


def test_a_start_from_which_no_run_gets_on_is_refused(question: PredictionQuestion) -> None:
    """As of a log whose angle counts 1e14 for a radian."""
    far = question.experiment.changed(x0=(-1e14, 1e17))
    with pytest.raises(ArgumentError, match="every predicted run ends in its first step, from ro"):
        predict(question._replace(experiment=far), 2)


def test_a_run_that_ended_early_never_reaches(
    question: PredictionQuestion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may have been in its band when it ended."""
    runs = predictions._closed_loop(question.experiment, question.law, 2)
    ended = [runs[0], replace(runs[1], status=Status.DIVERGED)]
    monkeypatch.setattr(predictions, "_closed_loop", lambda *_: ended)
    (reached, *_) = predict(question, 2).quantities
    assert reached.required
    assert 0.0 < reached.predicted[0] < 3.0
    assert reached.predicted[1] == np.inf


@pytest.mark.parametrize(
    ("noise", "expected"), [(0.39, 0.0), (0.41, np.sqrt(0.41**2 - 1 / 12))], ids=["below", "above"]
)
def test_noise_below_two_fifths_of_an_encoder_s_step_is_its_rounding(
    noise: float, expected: float
) -> None:
    """A step of 2 mrad is itself off by 2/sqrt(12) mrad."""
    step = 2e-3
    log = SimpleNamespace(noise=lambda _: noise * step, resolution=lambda _: step)
    assert predictions._noise(cast(Log, log), "rotor angle") == pytest.approx(expected * step)


def test_a_run_of_a_log_begins_at_zero_with_the_samples_of_its_time() -> None:
    time = 3.0 + 0.1 * np.arange(50)
    log = Log("log", time, time[:, None], {"rotor angle": 2 * time}, [slice(0, 50)])
    part = predictions._part(log, 4.2, 1.5)
    assert part.time == pytest.approx(0.1 * np.arange(16))
    assert part.inputs[:, 0] == pytest.approx(4.2 + 0.1 * np.arange(16))
    assert part.states["rotor angle"] == pytest.approx(8.4 + 0.2 * np.arange(16))
    assert part.pieces == [slice(0, 16)]


def test_before_a_log_its_inputs_are_zero_for_longer_than_their_delay(log: Log) -> None:
    rested = predictions._after_rest(log, 0.02)
    assert rested.time[0] == pytest.approx(-0.02 - log.sampling)
    assert rested.inputs[0] == 0.0
    assert rested.pieces == [slice(1, len(log.time) + 1)]


def test_a_value_outside_has_the_digits_that_tell_it_from_the_spread(
    question: PredictionQuestion, complete: Prediction
) -> None:
    """The first number has no spread, and so the second one is the headline."""
    constant = PredictedQuantity("rest", "rest", "1", True, 4.4e-3, np.full(2, 4.401e-3))
    angle = PredictedQuantity("angle", "angle", "rad", True, 3.1421, np.array([3.13, 3.1416]))
    inside = PredictedQuantity("time", "time", "s", True, 1.0, np.array([0.9, 1.1]))
    several = replace(complete, quantities=[constant, angle, inside])

    rows = {row[0]: row[1:4] for row in quantities_table(several).rows}
    assert rows["angle [rad]"] == ["3.1421", "3.1358", "3.13 to 3.1416"]
    assert rows["rest"] == ["0.0044", "0.004401", "0.004401 to 0.004401"]
    assert rows["time [s]"] == ["1", "1", "0.9 to 1.1"]
    words = prediction_result(question, several, {}).answers[-1].words
    assert words.startswith("Predicted: angle: 3.1358 rad (3.13 to 3.1416); measured 3.1421 rad;")


# Measured and predicted values, and what is written of them.
WRITTEN = [
    (2.5, [1.0, 2.0, 1.25], True, ("2.5", "1.25", "1 to 2", "outside", ""), "red"),
    (1.75, [1.0, 2.0, 1.25], True, ("1.75", "1.25", "1 to 2", "", ""), ""),
    (2.5, [1.0, 2.0, 1.25], False, ("2.5", "1.25", "1 to 2", "outside", "not required"), ""),
    (np.inf, [1.0, np.inf, np.inf], True, ("never", "never", "1 to never", "", ""), ""),
]


@pytest.mark.parametrize(("measured", "predicted", "required", "cells", "style"), WRITTEN)
def test_the_table_has_measured_value_median_and_spread(
    measured: float, predicted: list[float], required: bool, cells: tuple[str, ...], style: str
) -> None:
    item = PredictedQuantity("a", "reaches", "s", required, measured, np.array(predicted))
    complete: Any = SimpleNamespace(quantities=[item], runs=[None] * 3)
    table = quantities_table(complete)
    assert table.title == "Measured and predicted, 3 seeds"
    assert table.rows == [["reaches [s]", *cells]]
    assert table.styles == [style]


def test_without_its_friction_the_machine_is_another_one(
    question: PredictionQuestion, complete: Prediction
) -> None:
    smooth = question.experiment.changed({"edit.shaft.friction": 0.0})
    lesser = predict(question._replace(experiment=smooth), 4)
    assert not complete.quantities[0].contains(lesser.quantities[0].median)
    assert lesser.misfits.min() > 5 * complete.misfits.min()


def test_diff_compares_the_predictions_of_two_logs_one_by_one(
    question: PredictionQuestion, complete: Prediction, tmp_path: Path
) -> None:
    """Numbers of the second log took the place of the first one's, in silence."""
    for name in ("first", "second"):
        of_log = question._replace(log=replace(question.log, name=f"{name}.csv"))
        content = json_text(prediction_result(of_log, complete, {}))
        (tmp_path / f"{name}.json").write_text(content, encoding="utf-8")
    compared = compare(tmp_path, tmp_path).compared
    assert compared == 2 * len(complete.quantities)

    # That of one log has nothing to do with that of the other.
    with pytest.raises(ArgumentError, match="no results in common"):
        compare(tmp_path / "first.json", tmp_path / "second.json")


def test_a_run_begins_with_the_machine_at_rest(machine: Experiment, log: Log) -> None:
    """Until the first command arrives nothing acts: the first one did not act before the log."""
    late = machine.changed({"sensor.rotor speed.noise": 0.0})
    start = question_of(late, "lqr", log, log).experiment.x0
    assert start[1] == pytest.approx(0.0, abs=0.02)


def test_seeds_differ_by_their_noise_alone(
    question: PredictionQuestion, complete: Prediction
) -> None:
    """Without noise all runs are one."""
    quiet = question.experiment.changed({"sensor.rotor speed.noise": 0.0})
    runs = predict(question._replace(experiment=quiet), 3).runs
    assert np.array_equal(runs[0].state, runs[2].state)
    assert not np.array_equal(complete.runs[0].state, complete.runs[2].state)


def test_predict_judges_the_log_by_the_spread_of_runs(
    log: Log, printed: Any, tmp_path: Path
) -> None:
    """Results of another law have another name."""
    cases.write(tmp_path, "servo", **TABLES)
    header = ["time [s]", "current [A]", "rotor angle [rad]", "rotor speed [rad/s]"]
    columns = [log.time, log.inputs[:, 0], *log.states.values()]
    pyarrow.csv.write_csv(pyarrow.table(columns, names=header), tmp_path / "bench.csv")
    printed("predict", "bench.csv", "mine.toml", "--law", "lqr", "--seeds", 4)
    assert (tmp_path / "renders/predict_mine_bench_lqr.png").is_file()


def test_logs_of_the_case_are_those_of_the_law_or_of_none(tmp_path: Path) -> None:
    time = np.arange(100) * 1e-3
    table = np.column_stack([time, 0.01 * np.sin(50 * time), 0.1 * np.cos(50 * time)])
    header = "time [s],rotor angle [rad],current [A]"
    for name in ("own", "any", "other"):
        np.savetxt(tmp_path / f"{name}.csv", table, delimiter=",", header=header, comments="")
    logs = [{"log": "own.csv", "law": "lqr"}, {"log": "any.csv"}, {"log": "other.csv", "law": "pd"}]
    laws = [{"law": "lqr"}, {"law": "pd", "frequency": "2 rad/s"}]
    limit = {"final_error_below": "1 rad"}
    path = cases.write(tmp_path, controller=laws, measured=logs, requirement=limit)
    command: Any = parse(["predict", str(path), "--law", "lqr"])
    assert [question.path.name for question in command.questions()] == [
        "predict_mine_own_lqr.json",
        "predict_mine_any_lqr.json",
    ]

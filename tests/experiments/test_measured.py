"""Logs of the machine: judged as the run that they are, and undecided where they lack something."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cases
import numpy as np
import pytest
from commands import Screen, assert_one_line, run
from steps import STEP, step

import grosmc_mj as gm
from grosmc_mj import cli
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.file.schema import MeasuredTable
from grosmc_mj.experiments.measured import (
    MeasuredResult,
    disagreements,
    measured_results,
    results_of_logs,
)
from grosmc_mj.experiments.requirements import KINDS
from grosmc_mj.experiments.requirements.judging import Judgement
from grosmc_mj.ground.errors import ArgumentError

# All kinds that a law without a surface can be asked for.
ALL: list[dict[str, Any]] = [
    {
        "settles_within": "4 s",
        "band": "20 mrad",
        "stays_within": "20 mrad",
        "rms_below": "10 mrad",
        "after": "3 s",
        "final_error_below": "10 mrad",
        "overshoot_below": 0.2,
        "deviation_below": "0.1 rad",
        "input_below": "0.5 A",
        "cost_ratio_below": 1.0,
    },
    {
        "reaches_within": "4 s",
        "swings_below": 3,
        "last_peak_below": "1.1 rad",
        "band": "20 mrad",
    },
    {"state": "rotor speed", "stays_within": "1 rad/s"},
    {"always": "abs(rotor speed) < 1 rad/s or abs(error) > 0.1 rad"},
    {"always": "eventually[0 s, 3 s] always[0 s, 1 s] abs(rotor angle - 1 rad) < 20 mrad"},
    {
        "signal": "current",
        "above": "-20 mA",
        "below": "0.2 A",
        "from": "0.2 s",
        "to": "2 s",
        "saturated_for_less_than": "1 s",
    },
    {"recovers_within": "1 s", "band": "20 mrad"},
]
# Requirements that only a log with the rate can decide, and those that no log can.
OF_RATE = ["rotor speed stays within 1 rad/s", "always abs(rotor speed) < 1 rad/s or abs(error) >"]
OF_MODEL = [
    "deviation below 0.1 rad",
    "cost ratio below 1.0",
    "recovers within 1 s of each disturbance to 20 mrad",
]


@pytest.fixture(scope="module")
def case() -> Experiment:
    """A step of the servo under PD."""
    return step(*ALL)


@pytest.fixture(scope="module")
def simulated(case: Experiment) -> RunResult:
    return case.run("physics", "pd")


def write_log(result: RunResult, path: Path, states: list[str], rows: slice = slice(None)) -> Path:
    """Write a run as a log of its time, input and some states; the last input is held."""
    run = result.trajectory
    columns = {"time [s]": run.time, "current [A]": np.append(run.input, run.input[-1])}
    for i, state in enumerate(run.system.states):
        if state.name in states:
            columns[f"{state.name} [{state.unit}]"] = run.state[:, i]
    return write_columns(path, columns, rows)


def write_columns(path: Path, columns: dict[str, Any], rows: Any = slice(None)) -> Path:
    table = np.column_stack(list(columns.values()))[rows]
    np.savetxt(path, table, "%.17g", ",", header=",".join(columns), comments="")
    return path


def measured(case: Experiment, log: Path, **keys: Any) -> MeasuredResult:
    (result,) = results_of_logs(case, [MeasuredTable(log=str(log), **keys)])
    return result


def by_words(judgements: list[Judgement]) -> dict[str, Judgement]:
    return {item.requirement.words: item for item in judgements}


def test_a_log_of_a_run_is_judged_as_the_run(case, simulated, tmp_path) -> None:
    """By all kinds; they are accumulated by the same code."""
    log = write_log(simulated, tmp_path / "log.csv", ["rotor angle", "rotor speed"])
    of_log = by_words(measured(case, log).requirements)
    of_run = by_words(simulated.requirements)
    assert {item.kept for item in of_run.values()} == {True, False}
    assert sorted(of_run.keys() - of_log.keys()) == sorted(OF_MODEL)
    assert {item.plant for item in of_log.values()} == {"measured"}
    margins = {words: of_run[words].margin for words in of_log}
    assert {words: item.margin for words, item in of_log.items()} == pytest.approx(
        margins, rel=1e-9
    )
    assert {words: item.kept for words, item in of_log.items()} == {
        words: of_run[words].kept for words in of_log
    }


def test_every_requirement_is_judged_or_named(case, simulated, tmp_path) -> None:
    result = measured(case, write_log(simulated, tmp_path / "log.csv", ["rotor angle"]))
    judged = by_words(result.requirements)
    assert len(judged) + len(result.not_judged) == len(case.limits)
    for words in (*OF_RATE, *OF_MODEL):
        assert not any(item.startswith(words) for item in judged)
        (line,) = [line for line in result.not_judged if words in line]
        assert line.startswith("not judged on log.csv: ")
    assert any("the log does not have 'rotor speed'" in line for line in result.not_judged)


def test_a_log_tells_the_time_at_the_limit(tmp_path: Path) -> None:
    actuator = {"of": "current", "limit": "20 mA"}
    case = step({"saturated_for_less_than": "1 s"}, actuator=actuator)
    run = case.run("physics", "pd")
    (of_run,) = run.requirements
    (of_log,) = measured(case, write_log(run, tmp_path / "log.csv", ["rotor angle"])).requirements
    assert of_log.measured == of_run.measured
    assert of_run.measured is not None
    assert of_run.measured > 0.01


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.quantity == "sliding"])
def test_no_log_has_a_sliding_variable(kind: Any) -> None:
    law = Experiment.load("servo/nominal").law("physics", "grosmc")
    reason = kind(number=1.0).why_not_measured(law, frozenset({"rotor angle", "error"}))
    assert reason == "a log does not have the sliding variable"


@pytest.mark.parametrize(("period", "judged"), [(0.05, True), (0.32, False), (1.5, False)])
def test_a_log_that_does_not_sample_a_run_in_each_tenth_judges_nothing(
    tmp_path, period, judged
) -> None:
    """Between two samples a run may overshoot, or settle and leave again: nobody knows."""
    case = step({"overshoot_below": 0.5}).changed(duration=3.0)
    time = period * np.arange(200.0)
    columns = {"time [s]": time, "current [A]": 0 * time, "rotor angle [rad]": np.minimum(time, 1)}
    result = measured(case, write_columns(tmp_path / "log.csv", columns))
    assert (len(result.requirements), len(result.not_judged)) == ((1, 0) if judged else (0, 1))


@pytest.mark.parametrize(
    ("target", "output"),
    [("cart_pendulum/nominal", "pole angle"), ("arm/nominal", "joint angle")],
)
def test_a_log_of_positions_has_the_errors_of_outputs(tmp_path, target, output) -> None:
    """Of any system: what an output does not need may be missing."""
    case = Experiment.load(target).changed(duration=0.05)
    law = case.controllers[0]
    run = case.run("physics", law).trajectory
    names = [state.name for state in run.system.states]
    columns = {
        "time [s]": run.time,
        run.system.input.name: np.append(run.input, run.input[-1]),
        output: run.state[:, names.index(output)],
    }
    result = measured(case, write_columns(tmp_path / "log.csv", columns), law=law)
    assert {"error", f"{output} error"} <= result.known
    assert np.all(np.isfinite(result.comparison.error))


def test_an_irregular_log_is_judged_as_the_run(case, simulated, tmp_path) -> None:
    """To what straight lines between 1 to 5 ms leave: (h/2)^2/2 of 9 rad/s^2 is 28 urad."""
    steps = np.random.default_rng(3).integers(1, 6, 3000)
    count = len(simulated.trajectory.time)
    chosen = np.append(0, np.cumsum(steps))
    rows: Any = np.append(chosen[chosen < count - 1], count - 1)
    log = write_log(simulated, tmp_path / "log.csv", ["rotor angle"], rows)
    of_log = by_words(measured(case, log).requirements)
    of_run = by_words(simulated.requirements)
    tolerances = {
        "swings below 3 before it is within 20 mrad": 0,
        "input below 0.5 A": 0,
        "reaches within 4 s to 20 mrad": 6e-3,
        "settles within 4 s to 20 mrad": 6e-3,
        "final error below 10 mrad": 3e-5,
    }
    for words, tolerance in tolerances.items():
        assert of_log[words].measured == pytest.approx(of_run[words].measured, abs=tolerance)


def test_a_run_begins_at_an_instant_of_its_log(case, simulated, tmp_path) -> None:
    """Ten seconds of rest stand before it."""
    run = simulated.trajectory
    columns = {
        "time [s]": np.append(0.001 * np.arange(10_000), 10.0 + run.time),
        "current [A]": np.concatenate([np.zeros(10_000), run.input, run.input[-1:]]),
        "rotor angle [rad]": np.append(np.zeros(10_000), run.state[:, 0]),
    }
    result = measured(case, write_columns(tmp_path / "log.csv", columns), start="10 s")
    assert result.begin == pytest.approx(10.0)
    expected = by_words(simulated.requirements)
    margins = {item.requirement.words: item.margin for item in result.requirements}
    assert margins == {
        words: pytest.approx(expected[words].margin, rel=1e-6, abs=1e-9) for words in margins
    }
    with pytest.raises(ArgumentError, match="start = 19 s is after its end at 16 s"):
        measured(case, tmp_path / "log.csv", start="19 s")


# In a case file and on the command line

LIMITS = [{"final_error_below": "10 mrad", "input_below": "10 A"}]


@pytest.fixture(scope="module")
def folder(simulated: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case file with two logs beside it: of its own run, and of one from 0.05 to 0.9 rad."""
    path = tmp_path_factory.mktemp("logs")
    write_log(simulated, path / "good.csv", ["rotor angle"])
    run = simulated.trajectory
    columns = {
        "time [s]": run.time,
        "current [A]": np.append(run.input, run.input[-1]),
        "rotor angle [rad]": 0.05 + 0.85 * run.state[:, 0],
    }
    write_columns(path / "bad.csv", columns)
    logs = [{"log": f"{name}.csv", "law": "pd"} for name in ("good", "bad")]
    cases.write(path, "servo", name="two", **STEP, requirement=LIMITS, measured=logs)
    return path


def test_several_logs_are_judged_one_by_one_and_a_disagreement_is_named(folder: Path) -> None:
    case = Experiment.load(folder / "two.toml")
    of_logs = [item for result in measured_results(case) for item in result.requirements]
    assert [(item.plant, item.requirement.key, item.kept) for item in of_logs] == [
        ("measured good", "final_error_below", True),
        ("measured good", "input_below", True),
        ("measured bad", "final_error_below", False),
        ("measured bad", "input_below", True),
    ]
    (line,) = disagreements(case, [*case.run("physics", "pd").requirements, *of_logs])
    assert line == (
        "model and machine disagree: pd final error below 10 mrad: kept on physics only"
    )


def test_logs_of_laws_that_are_not_run_are_left_out(folder: Path) -> None:
    laws = [*STEP["controller"], {"law": "lqr"}]
    log = {"log": "good.csv", "law": "pd"}
    case = step(*LIMITS, folder=folder, controller=laws, measured=log)
    assert [result.controller.name for result in measured_results(case)] == ["pd"]
    assert measured_results(case.changed(laws=["lqr"])) == []


def test_run_judges_a_log(printed: Callable[..., None], folder: Path) -> None:
    log = folder / "bad.csv"
    Path("two.toml").write_text((folder / "two.toml").read_text())
    Path("bad.csv").write_text(log.read_text())
    printed("run", "two.toml", "--log", "bad.csv", "--no-figures", "--save")
    document = json.loads(Path("renders/two_bad.json").read_text())
    assert {item["plant"] for item in document["requirements"]} == {"measured"}
    assert document["configuration"]["logs"][0]["file"] == "bad.csv"
    (path,) = Path("renders/trajectories").iterdir()
    saved = gm.load_trajectory(path)
    assert np.isnan(saved.state[:, 1]).all()
    assert np.isfinite(saved.state[:, 0]).all()


def test_run_judges_the_logs_of_its_file_beside_the_model(folder: Path, tmp_path: Path) -> None:
    assert run("run", folder / "two.toml", "--out", tmp_path, "--no-figures") == cli.DIFFERS
    document = json.loads((tmp_path / "two.json").read_text())
    plants = [item["plant"] for item in document["runs"]]
    assert plants == ["corrected", "physics", "measured good", "measured bad"]


@pytest.mark.slow
def test_a_log_has_its_figure(folder: Path, tmp_path: Path) -> None:
    log = folder / "good.csv"
    assert run("run", folder / "two.toml", "--log", log, "--out", tmp_path) == cli.DONE
    assert (tmp_path / "two_good.png").is_file()


@pytest.mark.parametrize(
    ("missing", "code", "words"),
    [
        (1, cli.DONE, "log.csv has 5.999 s of 6 s: the last sample is missing"),
        (2, cli.WRONG, "it has 5.998 s, the case runs 6 s: log for longer"),
    ],
)
def test_a_log_may_lack_its_last_sample(
    simulated: RunResult, tmp_path: Path, capsys: Screen, missing: int, code: int, words: str
) -> None:
    path = cases.write(tmp_path, "servo", **STEP, requirement={"stays_within": "2 rad"})
    log = write_log(simulated, tmp_path / "log.csv", ["rotor angle"], slice(6001 - missing))
    assert run("run", path, "--log", log, "--out", tmp_path, "--no-figures") == code
    printed = capsys.readouterr()
    assert words in printed.out + printed.err


WRONG_LOGS = [
    ({}, "nowhere.csv", "there is no such file"),
    ({"columns": {"rotor angle": {"column": "enc"}}}, "good.csv", "column 'enc'"),
    ({}, "no_input.csv", "no column of the input 'current'"),
    ({}, "short.csv", "it has 3 s, the case runs 6 s: log for longer"),
    ({"mask": [["1 s", "1.5 s"]]}, "good.csv", "nothing is used after 0.999 s, by a gap"),
    ({"use": ["5 s", "6 s"]}, "good.csv", "it has 1 s, the case runs 6 s"),
    ({}, "speed.csv", "no requirement can be judged"),
]


@pytest.fixture(scope="module")
def logs(simulated: RunResult, folder: Path) -> Path:
    """The folder with logs that lack something."""
    write_log(simulated, folder / "short.csv", ["rotor angle"], slice(3001))
    write_log(simulated, folder / "speed.csv", ["rotor speed"])
    good = (folder / "good.csv").read_text()
    (folder / "no_input.csv").write_text(good.replace("current [A]", "other"))
    return folder


@pytest.mark.parametrize(("table", "log", "words"), WRONG_LOGS)
def test_a_wrong_log_is_refused_in_a_line(
    logs: Path, tmp_path: Path, capsys: Screen, table: dict[str, Any], log: str, words: str
) -> None:
    limit = {"final_error_below": "10 mrad"}
    path = cases.write(tmp_path, "servo", **STEP, requirement=limit, log=table)
    assert run("run", path, "--log", logs / log, "--out", tmp_path / "results") == cli.WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert words in error
    assert log in error


def test_a_log_of_one_of_several_laws_needs_its_name(folder: Path) -> None:
    two_laws = Experiment.load("servo/nominal").changed(duration=6.0)
    with pytest.raises(ArgumentError, match="name the one that made the log, by --laws NAME"):
        measured(two_laws, folder / "good.csv")
    assert measured(two_laws, folder / "good.csv", law="lqr").controller.name == "lqr"
    with pytest.raises(ArgumentError, match="unknown law 'lqg'"):
        measured(two_laws, folder / "good.csv", law="lqg")


def test_logs_of_a_system_are_refused(folder: Path, capsys: Screen) -> None:
    assert run("run", "servo", "--log", folder / "good.csv") == cli.WRONG
    assert "cases: name one" in capsys.readouterr().err


def test_an_unknown_law_of_a_log_of_the_file_is_refused(tmp_path: Path, capsys: Screen) -> None:
    log = {"log": "good.csv", "law": "pid"}
    path = cases.write(tmp_path, "servo", **STEP, requirement=LIMITS, measured=log)
    assert run("run", path, "--no-figures") == cli.WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert "measured: unknown law 'pid'" in error

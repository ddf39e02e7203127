"""Logs of the machine: judged as the run that they are, and undecided where they lack something."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from case_texts import STEP, load
from commands import Screen, assert_one_line, run

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

BEGINNING = STEP.split("[[requirement]]")[0]
# All kinds that a law without a surface can be asked for.
ALL = """
[[requirement]]
settles_within = "4 s"
band = "20 mrad"
stays_within = "20 mrad"
rms_below = "10 mrad"
after = "3 s"
final_error_below = "10 mrad"
overshoot_below = 0.2
deviation_below = "0.1 rad"
input_below = "0.5 A"
cost_ratio_below = 1.0
[[requirement]]
reaches_within = "4 s"
swings_below = 3
last_peak_below = "1.1 rad"
band = "20 mrad"
[[requirement]]
state = "rotor speed"
stays_within = "1 rad/s"
[[requirement]]
always = "abs(rotor speed) < 1 rad/s or abs(error) > 0.1 rad"
[[requirement]]
always = "eventually[0 s, 3 s] always[0 s, 1 s] abs(rotor angle - 1 rad) < 20 mrad"
[[requirement]]
signal = "current"
above = "-20 mA"
below = "0.2 A"
from = "0.2 s"
to = "2 s"
saturated_for_less_than = "1 s"
[[requirement]]
recovers_within = "1 s"
band = "20 mrad"
"""
# Requirements that only a log with the rate can decide, and those that no log can.
OF_RATE = ["rotor speed stays within 1 rad/s", "always abs(rotor speed) < 1 rad/s or abs(error) >"]
OF_MODEL = [
    "deviation below 0.1 rad",
    "cost ratio below 1.0",
    "recovers within 1 s of each disturbance to 20 mrad",
]


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """A step of the servo under PD."""
    return load(tmp_path_factory.mktemp("measured"), BEGINNING + ALL)


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
    assert {"kept", "failed"} == {"kept" if item.kept else "failed" for item in of_run.values()}
    for words, judgement in of_log.items():
        assert judgement.margin == pytest.approx(of_run[words].margin, rel=1e-9), words
        assert judgement.kept == of_run[words].kept
        assert judgement.plant == "measured"
    assert sorted(of_run.keys() - of_log.keys()) == sorted([*OF_MODEL])


def test_every_requirement_is_judged_or_named(case, simulated, tmp_path) -> None:
    log = write_log(simulated, tmp_path / "log.csv", ["rotor angle"])
    result = measured(case, log)
    judged = [item.requirement.words for item in result.requirements]
    assert len(judged) + len(result.not_judged) == len(case.limits)
    for words in (*OF_RATE, *OF_MODEL):
        assert not any(item.startswith(words) for item in judged)
        (line,) = [line for line in result.not_judged if words in line]
        assert line.startswith("not judged on log.csv: ")
    assert any("the log does not have 'rotor speed'" in line for line in result.not_judged)


def test_a_log_tells_the_time_at_the_limit(tmp_path: Path) -> None:
    limited = '[[actuator]]\nof = "current"\nlimit = "20 mA"\n'
    table = '[[requirement]]\nsaturated_for_less_than = "1 s"\n'
    case = load(tmp_path, BEGINNING + limited + table)
    run = case.run("physics", "pd")
    (of_run,) = run.requirements
    (of_log,) = measured(case, write_log(run, tmp_path / "log.csv", ["rotor angle"])).requirements
    assert of_log.measured == of_run.measured
    assert of_run.measured is not None
    assert of_run.measured > 0.01


@pytest.mark.parametrize("kind", [kind.key for kind in KINDS if kind.quantity == "sliding"])
def test_no_log_has_a_sliding_variable(kind: str, tmp_path: Path) -> None:
    (of_surface,) = [item for item in KINDS if item.key == kind]
    law = Experiment.load("servo/nominal").law("physics", "grosmc")
    reason = of_surface(number=1.0).why_not_measured(law, frozenset({"rotor angle", "error"}))
    assert reason == "a log does not have the sliding variable"


@pytest.mark.parametrize("period", [0.05, 0.5, 1.5, 3.0])
def test_a_log_that_does_not_sample_a_run_in_each_tenth_judges_nothing(tmp_path, period) -> None:
    """Between two samples a run may overshoot, or settle and leave again: nobody knows."""
    experiment = load(tmp_path, f"{STEP}overshoot_below = 0.5\n")
    time = period * np.arange(200.0)
    rows = [f"{t!r},0,{min(t, 1.0)!r}" for t in time.tolist()]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time [s],current [A],rotor angle [rad]", *rows]))
    case = experiment.changed(duration=3.0)
    assert bool(measured(case, path).requirements) is (period < 0.3)
    assert len(measured(case, path).not_judged) == (period > 0.3)


def test_a_log_of_positions_has_the_errors_of_outputs(tmp_path: Path) -> None:
    """Of any system: what an output does not need may be missing."""
    for target, output in (("cart_pendulum/nominal", "pole angle"), ("arm/nominal", "joint angle")):
        case = Experiment.load(target)
        law = case.controllers[0]
        run = case.changed(duration=0.5).run("physics", law).trajectory
        names = [state.name for state in run.system.states]
        angle = run.state[:, names.index(output)]
        inputs = np.append(run.input, run.input[-1])
        header = f"time [s],{run.system.input.name},{output}"
        table = np.column_stack([run.time, inputs, angle])
        path = tmp_path / f"{case.system}.csv"
        np.savetxt(path, table, "%.17g", ",", header=header, comments="")
        result = measured(case.changed(duration=0.5), path, law=law)
        assert {"error", f"{output} error"} <= result.known
        assert np.all(np.isfinite(result.comparison.error))


def test_an_irregular_log_is_judged_as_the_run(case, simulated, tmp_path) -> None:
    """To what straight lines between 1 to 5 ms leave: (h/2)^2/2 of 9 rad/s^2 is 28 urad."""
    path = write_log(simulated, tmp_path / "whole.csv", ["rotor angle"])
    lines = path.read_text().splitlines()
    steps = np.random.default_rng(3).integers(1, 6, 3000)
    chosen = [1 + int(k) for k in np.append(0, np.cumsum(steps)) if k < len(lines) - 1]
    thinned = tmp_path / "thinned.csv"
    thinned.write_text("\n".join([lines[0], *(lines[k] for k in chosen), lines[-1]]))
    of_log = by_words(measured(case, thinned).requirements)
    of_run = by_words(simulated.requirements)
    for words in ("swings below 3 before it is within 20 mrad", "input below 0.5 A"):
        assert of_log[words].measured == of_run[words].measured
    for words in ("reaches within 4 s to 20 mrad", "settles within 4 s to 20 mrad"):
        assert of_log[words].measured == pytest.approx(of_run[words].measured, abs=6e-3)
    words = "final error below 10 mrad"
    assert of_log[words].measured == pytest.approx(of_run[words].measured, abs=3e-5)


def test_a_run_begins_at_an_instant_of_its_log(case, simulated, tmp_path) -> None:
    """Ten seconds of rest stand before it."""
    path = write_log(simulated, tmp_path / "log.csv", ["rotor angle"])
    header, *rows = path.read_text().splitlines()
    late = [row.split(",") for row in rows]
    moved = [",".join([repr(float(row[0]) + 10.0), *row[1:]]) for row in late]
    rest = [f"{0.001 * k!r},0,0" for k in range(10_000)]
    path.write_text("\n".join([header, *rest, *moved]))
    result = measured(case, path, start="10 s")
    assert result.begin == pytest.approx(10.0)
    for words, judgement in by_words(result.requirements).items():
        expected = by_words(simulated.requirements)[words].margin
        assert judgement.margin == pytest.approx(expected, rel=1e-6, abs=1e-9), words


# In a case file and on the command line

LOGGED = '[[measured]]\nlog = "{}.csv"\nlaw = "pd"\n'


@pytest.fixture(scope="module")
def folder(simulated: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case file with two logs beside it: of its own run, and of a run that stays at 0.9 rad."""
    path = tmp_path_factory.mktemp("logs")
    write_log(simulated, path / "good.csv", ["rotor angle"])
    header, *rows = (path / "good.csv").read_text().splitlines()
    short = [row.split(",") for row in rows]
    moved = [",".join([*row[:2], repr(0.9 * float(row[2]))]) for row in short]
    (path / "bad.csv").write_text("\n".join([header, *moved]))
    limits = '[[requirement]]\nfinal_error_below = "10 mrad"\ninput_below = "10 A"\n'
    (path / "two.toml").write_text(
        BEGINNING + limits + LOGGED.format("good") + LOGGED.format("bad"), encoding="utf-8"
    )
    return path


def test_several_logs_are_judged_one_by_one(folder: Path) -> None:
    results = measured_results(Experiment.load(folder / "two.toml"))
    judgements = [item for result in results for item in result.requirements]
    kept = [(item.plant, item.requirement.key, item.kept) for item in judgements]
    assert kept == [
        ("measured good", "final_error_below", True),
        ("measured good", "input_below", True),
        ("measured bad", "final_error_below", False),
        ("measured bad", "input_below", True),
    ]


def test_a_model_that_is_kept_where_its_machine_is_not_is_named(folder: Path) -> None:
    case = Experiment.load(folder / "two.toml")
    results = [case.run("physics", "pd"), *measured_results(case)]
    judgements = [item for result in results for item in result.requirements]
    (line,) = disagreements(case, judgements)
    assert line == (
        "model and machine disagree: pd final error below 10 mrad: kept on physics only"
    )


@pytest.mark.parametrize(("log", "code"), [("good", cli.DONE), ("bad", cli.DIFFERS)])
def test_run_judges_a_log(folder: Path, tmp_path: Path, capsys: Screen, log: str, code) -> None:
    arguments = (folder / "two.toml", "--log", folder / f"{log}.csv", "--out", tmp_path)
    assert run("run", *arguments) == code
    document = json.loads((tmp_path / f"two_{log}.json").read_text())
    assert document["kind"] == "run"
    assert {item["plant"] for item in document["requirements"]} == {"measured"}
    assert document["configuration"]["logs"][0]["file"] == f"{log}.csv"
    assert (tmp_path / f"two_{log}.png").is_file()
    assert "measured" in capsys.readouterr().out


def test_run_judges_the_logs_of_its_file_beside_the_model(folder: Path, tmp_path: Path) -> None:
    assert run("run", folder / "two.toml", "--out", tmp_path, "--no-figures") == cli.DIFFERS
    document = json.loads((tmp_path / "two.json").read_text())
    plants = [item["plant"] for item in document["runs"]]
    assert plants == ["corrected", "physics", "measured good", "measured bad"]


def test_a_trajectory_of_a_log_is_saved(folder: Path, tmp_path: Path) -> None:
    arguments = (folder / "two.toml", "--log", folder / "good.csv", "--out", tmp_path, "--save")
    assert run("run", *arguments, "--no-figures") == cli.DONE
    (path,) = (tmp_path / "trajectories").iterdir()
    saved = gm.load_trajectory(path)
    assert np.isnan(saved.state[:, 1]).all()
    assert np.isfinite(saved.state[:, 0]).all()


def test_a_log_may_lack_its_last_sample(
    folder: Path, simulated: RunResult, tmp_path: Path, capsys: Screen
) -> None:
    """It is judged as it is, with a note; without its last two samples it is refused."""
    text = f'{BEGINNING}[[requirement]]\nstays_within = "2 rad"\n'
    (tmp_path / "case.toml").write_text(text, encoding="utf-8")
    codes = {}
    for missing in (1, 2):
        log = tmp_path / f"lacks_{missing}.csv"
        write_log(simulated, log, ["rotor angle"], slice(6001 - missing))
        arguments = (tmp_path / "case.toml", "--log", log, "--out", tmp_path, "--no-figures")
        codes[missing] = run("run", *arguments)
    printed = capsys.readouterr()
    assert codes == {1: cli.DONE, 2: cli.WRONG}
    assert "lacks_1.csv has 5.999 s of 6 s: the last sample is missing" in printed.out
    assert "it has 5.998 s, the case runs 6 s: log for longer" in printed.err


WRONG_LOGS = [
    ("", "nowhere.csv", "there is no such file"),
    ('[log.columns."rotor angle"]\ncolumn = "enc"', "good.csv", "column 'enc'"),
    ("", "no_input.csv", "no column of the input 'current'"),
    ("", "short.csv", "it has 3 s, the case runs 6 s: log for longer"),
    ("[log]\nmask = [['1 s', '1.5 s']]", "good.csv", "nothing is used after 0.999 s, by a gap"),
    ("[log]\nuse = ['5 s', '6 s']", "good.csv", "it has 1 s, the case runs 6 s"),
    ("", "speed.csv", "no requirement can be judged"),
]


@pytest.mark.parametrize(("table", "log", "words"), WRONG_LOGS)
def test_a_wrong_log_is_refused_in_a_line(
    folder: Path, simulated: RunResult, tmp_path: Path, capsys: Screen, table, log, words
) -> None:
    text = f'{BEGINNING}[[requirement]]\nfinal_error_below = "10 mrad"\n{table}\n'
    (tmp_path / "case.toml").write_text(text, encoding="utf-8")
    write_log(simulated, tmp_path / "short.csv", ["rotor angle"], slice(3001))
    write_log(simulated, tmp_path / "speed.csv", ["rotor speed"])
    good = (folder / "good.csv").read_text()
    (tmp_path / "good.csv").write_text(good)
    (tmp_path / "no_input.csv").write_text(good.replace("current [A]", "other"))

    arguments = (tmp_path / "case.toml", "--log", tmp_path / log, "--out", tmp_path / "results")
    assert run("run", *arguments) == cli.WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert words in error
    assert log in error


def test_a_log_of_one_of_several_laws_needs_its_name(case, folder: Path, capsys: Screen) -> None:
    two_laws = Experiment.load("servo/nominal").changed(duration=6.0)
    with pytest.raises(ArgumentError, match="name the one that made the log, by --laws NAME"):
        measured(two_laws, folder / "good.csv")
    result = measured(two_laws, folder / "good.csv", law="lqr")
    assert result.controller.name == "lqr"
    with pytest.raises(ArgumentError, match="unknown law 'lqg'"):
        measured(two_laws, folder / "good.csv", law="lqg")


def test_an_unknown_law_of_a_log_is_refused(folder: Path, capsys: Screen) -> None:
    text = (folder / "two.toml").read_text().replace('law = "pd"\n[[', 'law = "pid"\n[[')
    (folder / "wrong.toml").write_text(text)
    assert run("run", folder / "wrong.toml", "--no-figures") == cli.WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert "measured: unknown law 'pid'" in error


def test_logs_of_a_system_are_refused(folder: Path, capsys: Screen) -> None:
    assert run("run", "servo", "--log", folder / "good.csv") == cli.WRONG
    assert "cases: name one" in capsys.readouterr().err


def test_a_start_after_the_end_of_a_log_is_refused(case, folder: Path) -> None:
    with pytest.raises(ArgumentError, match="start = 9 s is after its end at 6 s"):
        measured(case, folder / "good.csv", start="9 s")

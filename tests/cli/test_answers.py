"""Answers of the commands as they are printed; help, options, names of results, and progress."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import cases
import pytest
from commands import Patch, Screen, run
from rich.cells import cell_len

from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.cli.commands import COMMANDS, STUDIES, Entry, study
from grosmc_mj.cli.program import parse
from grosmc_mj.cli.targets import recorded_experiments, result_name, shown_experiment
from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.ground.errors import ArgumentError

MACHINE_WORDS = (
    "transmission of shaft: inertia 0.002031 kg m^2, stiffness 100 N m/rad*,",
    "motor of current: constant 0.00768 N m/A, resistance 2.6 ohm,",
    "assumed numbers of the loop (computing: delay, jitter, missed)",
)


def require_screen(output: str) -> None:
    """Require that nothing is cut off, in at most 100 columns and 40 lines."""
    lines = output.rstrip("\n").split("\n")
    assert "…" not in output
    assert len(lines) <= 40
    assert max(cell_len(line.rstrip()) for line in lines) <= 100


def test_a_run_of_which_nothing_is_required_is_printed(printed: Callable[..., None]) -> None:
    printed("run", "servo/nominal", "--laws", "lqr", "--no-figures")


def test_a_run_of_kept_and_unjudged_requirements_is_printed(
    tmp_path: Path, printed: Callable[..., None]
) -> None:
    """It ends before the time within which the servo has to settle."""
    limits = {"settles_within": "19 ms", "input_below": "1 kA"}
    run_table = {"start": {"rotor angle": "0.1 rad"}, "engine": "python"}
    cases.write(tmp_path, "servo", run=run_table, requirement=limits)
    printed("run", "mine.toml", "--no-figures")


def test_names_of_laws_with_commas_are_told_apart(capsys: Screen) -> None:
    assert run("list", "servo/bench") == cli.DONE
    assert "'implicit', 'implicit, predicted'" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("target", ["", "servo", "maglev", "mine.toml"])
def test_a_list_is_printed(target: str, tmp_path: Path, printed: Callable[..., None]) -> None:
    """Also of a file with the title of a markup, a loop and a law that cannot be designed."""
    cases.write(
        tmp_path,
        "servo",
        title="[/] of mine",
        run={"control_period": "1 ms", "timestep": "0.25 ms"},
        edit={"joint": "shaft", "damping": 0.1},
        sensor={"of": "rotor angle", "noise": "1 mrad"},
        estimator={"of": "rotor speed"},
        actuator={"of": "current", "limit": "4 A"},
        controller={"law": "pd"},
    )
    printed("list", *target.split())


def test_a_list_needs_no_more_than_a_plant(tmp_path: Path, capsys: Screen) -> None:
    (tmp_path / "bare.toml").write_text('[plant]\nsystem = "servo"\n')
    assert run("list", tmp_path / "bare.toml") == cli.DONE
    assert "rotor angle [rad], rotor speed [rad/s]" in capsys.readouterr().out


def test_premises_begin_with_the_number_of_those_that_fail(
    tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    """Numbers along a run that switches belong to the machine."""
    monkeypatch.chdir(tmp_path)
    assert run("claims", "premises", "arm/case1") == cli.DONE
    output = capsys.readouterr().out
    assert output.startswith("1 of 8 premises of grosmc fails.\n")
    require_screen(output)


@pytest.mark.slow
def test_the_answer_of_a_machine_describes_it_part_by_part(
    tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("run", "servo/machine", "--laws", "lqr", "--no-figures") == cli.DIFFERS
    output = capsys.readouterr().out
    assert output.startswith("3 of 5 requirements are not kept")
    assert "…" not in output
    words = " ".join(output.split())
    assert [part for part in MACHINE_WORDS if part not in words] == []


@pytest.mark.parametrize(
    ("target", "cases"),
    [("arm", ["nominal", "case1", "case2", "bench"]), ("arm/case2", ["case2"])],
)
def test_results_are_recorded_of_a_system_or_a_case(target: str, cases: list[str]) -> None:
    assert [experiment.name for experiment in recorded_experiments(target)] == cases


@pytest.mark.parametrize(
    ("target", "case"),
    [("arm", "arm/case1"), ("arm/nominal", "arm/nominal"), ("jaco", "jaco/eight")],
)
def test_a_film_shows_one_case_of_a_target(target: str, case: str) -> None:
    assert shown_experiment(target).path == shipped_files()[case]


def test_results_have_the_name_of_their_case(tmp_path: Path) -> None:
    mine = cases.write(tmp_path)
    assert shown_experiment(str(mine)).path == mine
    assert result_name(mine) == "mine"
    assert result_name(shipped_files()["arm/case1"]) == "arm_case1"


def test_commands_stand_in_the_order_of_their_use() -> None:
    first = "new run campaign film view validate claims study"
    second = "tune identify compare predict export report diff list"
    assert list(COMMANDS) == [*first.split(), *second.split()]


def test_every_module_of_a_study_is_a_command_that_asks_a_question() -> None:
    assert {*STUDIES} == {module.name for module in iter_modules(study.__path__)}
    assert all(entry.summary.endswith("?") for entry in STUDIES.values())


@pytest.mark.parametrize("command", ["", "campaign"])
def test_the_overview_and_the_help_of_a_command_are_printed(
    command: str, monkeypatch: Patch, printed: Callable[..., None]
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    printed(*command.split(), "--help")


LEAVES = [
    *(name for name, entry in COMMANDS.items() if isinstance(entry, Entry)),
    *(
        f"{group} {name}"
        for group, entries in COMMANDS.items()
        if not isinstance(entries, Entry)
        for name in entries
    ),
]
# Words on an option that say what holds without it.
HOLDS = re.compile(r"\[default: |\[required\]|by default|instead")


@pytest.mark.parametrize("command", [*LEAVES, "claims", "study", ""])
def test_help_fits_on_a_screen_of_a_hundred_columns(
    command: str, capsys: Screen, monkeypatch: Patch
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    assert run(*command.split(), "--help") == cli.DONE
    output = capsys.readouterr().out
    lines = output.splitlines()
    assert max(map(len, lines)) <= 100
    assert len(lines) <= 50
    # Help of a group may speak of it, too.
    assert "--verbose" in output or command not in LEAVES


@pytest.mark.parametrize("command", LEAVES)
def test_help_says_of_each_option_with_a_value_what_holds_without_it(
    command: str, capsys: Screen, monkeypatch: Patch
) -> None:
    monkeypatch.setenv("COLUMNS", "1000")
    assert run(*command.split(), "--help") == cli.DONE
    options = re.findall(r"^│ \*? *(--[a-z].*?) *│$", capsys.readouterr().out, re.MULTILINE)
    takes_value = [option for option in options if re.match(r"--\S+( -o)? [A-Z\[]\S*", option)]
    assert [option for option in takes_value if not HOLDS.search(option)] == []


@pytest.mark.parametrize("arguments", ["claims servo", "claims judge servo"])
def test_claims_alone_are_judged(arguments: str) -> None:
    command = parse(arguments.split())
    assert type(command).__name__ == "JudgeCommand"
    assert command == parse(["claims", "judge", "servo"])


@pytest.mark.parametrize(
    ("arguments", "values"),
    [
        ("run servo", {"laws": (), "save": None, "figures": True, "film": False}),
        ("run servo --laws lqr grosmc --no-figures", {"laws": ("lqr", "grosmc"), "figures": False}),
        ("run --laws lqr grosmc --film servo", {"laws": ("lqr", "grosmc"), "target": "servo"}),
        ("run servo --laws lqr --laws=grosmc", {"laws": ("lqr", "grosmc")}),
        ("run --laws lqr -- servo", {"laws": ("lqr",), "target": "servo"}),
        ('run servo --laws ["lqr"]', {"laws": ('["lqr"]',)}),
        ("run servo --save --film", {"save": "parquet", "film": True}),
        ("run --save csv servo", {"save": "csv", "target": "servo"}),
        ("campaign servo --runs 4 --runs 8", {"runs": 8}),
        ("campaign servo --seed -3 --at-least .5", {"seed": -3, "at_least": 0.5}),
        ("campaign servo --control_period 0.1", {"control_period": 0.1}),
        ("film servo --from -1 --to 3 -o f.mp4", {"start": -1.0, "stop": 3.0}),
        ("study region servo --limits -10 1", {"limits": (-10.0, 1.0)}),
        ("validate arm servo --no-claims", {"targets": ("arm", "servo"), "claims": False}),
    ],
)
def test_options_are_the_fields_of_a_command(arguments: str, values: dict[str, object]) -> None:
    command = parse(arguments.split())
    assert {name: getattr(command, name) for name in values} == values


@pytest.mark.parametrize(
    ("seconds", "lines"),
    [(10.0, []), (0.0, ["1 of 3 runs in 0 s: one of them", "3 of 3 runs in 0 s"])],
)
def test_without_a_terminal_progress_is_a_line_at_intervals(
    seconds: float, lines: list[str], capsys: Screen, monkeypatch: Patch
) -> None:
    assert screen.LINE_EVERY == 10.0
    monkeypatch.setattr(screen, "LINE_EVERY", seconds)
    with screen.progress(3, "runs") as advance:
        advance("one  of them ")
        advance(by=2)
    assert capsys.readouterr().err.splitlines() == lines


def test_progress_counts_and_times_from_the_beginning(capsys: Screen, monkeypatch: Patch) -> None:
    clock = iter([0.0, 12.0, 30.0])
    monkeypatch.setattr(screen.time, "monotonic", lambda: next(clock))
    with screen.progress(4, "runs") as advance:
        advance()
        advance(by=2)
    assert capsys.readouterr().err.splitlines() == [
        "1 of 4 runs in 12 s, about 36 s left",
        "3 of 4 runs in 30 s, about 10 s left",
    ]


@pytest.mark.parametrize("name", ["tune", "study contest"])
def test_a_search_has_the_numbers_of_its_options(name: str) -> None:
    options = "--law lqr" if name == "tune" else ""
    command: Any = parse(f"{name} servo {options} --runs 9 --draws 3 --held-out 7 --seed 5".split())
    asked = command.search_options()
    assert (asked["runs"], asked["draws"], asked["held_out"], asked["seed"]) == (9, 3, 7, 5)


def test_a_run_is_judged_over_as_many_draws_as_are_asked_for(
    tmp_path: Path, monkeypatch: Patch
) -> None:
    asked: list[int] = []

    def judged(result: RunResult, draws: int) -> RunResult:
        asked.append(draws)
        return result

    monkeypatch.setattr("grosmc_mj.studies.sweep.draws.judged_over_draws", judged)
    cases.write(tmp_path, sensor={"of": "rotor angle", "noise": "1 mrad"})
    assert run("run", tmp_path / "mine.toml", "--draws", 3, "--no-figures", "--out", tmp_path) == 0
    assert set(asked) == {3}


@pytest.mark.parametrize(("seconds", "left"), [(2.0, "78 s"), (30.0, "20 min"), (1000.0, "11 h")])
def test_without_a_terminal_progress_says_how_long_the_rest_takes(
    seconds: float, left: str, capsys: Screen, monkeypatch: Patch
) -> None:
    """One step of 40 has taken so long."""
    clock = iter([0.0, seconds])
    monkeypatch.setattr(screen.time, "monotonic", lambda: next(clock))
    monkeypatch.setattr(screen, "LINE_EVERY", 0.0)
    with screen.progress(40, "runs") as advance:
        advance()
    assert capsys.readouterr().err.splitlines() == [
        f"1 of 40 runs in {seconds:.0f} s, about {left} left"
    ]


def test_a_film_says_which_laws_of_its_file_it_leaves_out(
    tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    laws = [{"law": "lqr"}, {"name": "softer", "law": "lqr", "Q": [1, 4]}, {"law": "grosmc"}]
    path = cases.write(tmp_path, controller=laws)
    shown: list[tuple[str, ...]] = []

    def seen(experiment: Any, controllers: tuple[str, ...], form: Any) -> None:
        shown.append(controllers)
        raise ArgumentError("seen")

    monkeypatch.setattr("grosmc_mj.cli.commands.film._require_filmable", seen)
    run("film", path)
    run("film", path, "--laws", "softer")
    assert shown == [("lqr", "grosmc"), ("softer",)]
    lines = [line for line in capsys.readouterr().err.splitlines() if "not shown" in line]
    assert lines == ["not shown: softer; --laws takes up to 4 laws"]

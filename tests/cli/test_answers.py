"""Answers of the commands: the verdict first, all of it within a screen; lists, help and names."""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import cases
import pytest
from commands import Patch, Screen, run
from rich.cells import cell_len

from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.commands import CLAIMS, COMMANDS, STUDIES, Entry, study
from grosmc_mj.cli.program import parse
from grosmc_mj.cli.targets import recorded_experiments, result_name, shown_experiment
from grosmc_mj.experiments.file.shipped import campaign_files, shipped_files
from grosmc_mj.experiments.file.text import complete_text

slow = pytest.mark.slow
MACHINE_WORDS = (
    "transmission of shaft: inertia 0.002031 kg m^2, stiffness 100 N m/rad*,",
    "motor of current: constant 0.00768 N m/A, resistance 2.6 ohm,",
    "assumed of it:",
)
# A case file with the title of a markup, an edit and a loop.
MINE = cases.text(
    "servo",
    title="[/] of mine",
    run={"control_period": "1 ms", "timestep": "0.25 ms"},
    edit={"joint": "shaft", "damping": 0.1},
    sensor={"of": "rotor angle", "noise": "1 mrad"},
    estimator={"of": "rotor speed"},
    actuator={"of": "current", "limit": "4 A"},
)


def all_commands() -> list[type[Command]]:
    """The commands, those of groups included."""
    entries = [entry for entry in COMMANDS.values() if isinstance(entry, Entry)]
    commands = []
    for entry in (*entries, *STUDIES.values(), *CLAIMS.values()):
        module, _, name = entry.path.partition(":")
        commands.append(getattr(import_module(f"grosmc_mj.cli.commands.{module}"), name))
    return commands


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: Patch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write_short_campaign(folder: Path) -> None:
    """Write the campaign of the servo, cut before its load."""
    text = campaign_files()["servo"].read_text(encoding="utf-8")
    short = re.sub(r'(?m)^duration = ".*"', 'duration = "0.5 s"', text)
    (folder / "short.toml").write_text(short, encoding="utf-8")


# The campaign runs for some seconds, and several tests read its answer.
@cache
def answer(command: str) -> str:
    """Run a command in a folder with a short campaign; return its output."""
    output = io.StringIO()
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.chdir(folder),
        contextlib.redirect_stdout(output),
    ):
        write_short_campaign(Path(folder))
        # The campaign's search finds a plant that fails.
        code = cli.DIFFERS if command == CAMPAIGN else cli.DONE
        assert run(*command.split()) == code
    return output.getvalue()


LIST = "list"
PREMISES = "claims premises arm/case1"
RUN = "run servo/nominal --laws lqr --no-figures"
CAMPAIGN = "campaign short.toml --runs 8 --worst --evaluations 128 --no-figures"


@pytest.mark.parametrize(
    ("command", "verdict"),
    [
        (LIST, f"4 systems, {len(shipped_files())} case files."),
        (PREMISES, "1 of 8 premises of grosmc fails"),
        (RUN, "Nothing is required"),
        pytest.param(CAMPAIGN, r"lqr keeps everything on \d of 8 plants", marks=slow),
    ],
)
def test_the_answer_begins_with_the_verdict(command: str, verdict: str) -> None:
    line = answer(command).partition("\n")[0]
    assert re.match(verdict, line), line


@pytest.mark.parametrize("command", [LIST, PREMISES, RUN, pytest.param(CAMPAIGN, marks=slow)])
def test_the_answer_fits_on_a_screen(command: str) -> None:
    output = answer(command)
    lines = output.rstrip("\n").split("\n")
    assert "…" not in output
    assert len(lines) <= 40
    assert max(cell_len(line.rstrip()) for line in lines) <= 100


def test_list_names_the_systems() -> None:
    assert "cart_pendulum" in answer(LIST)


def test_list_names_the_laws() -> None:
    assert "grosmc" in answer(LIST)


def test_a_run_shows_the_costs_of_its_laws() -> None:
    assert "J of u_c" in answer(RUN)


@slow
@pytest.mark.usefixtures("folder")
def test_the_answer_of_a_machine_describes_it_part_by_part(capsys: Screen) -> None:
    assert run("run", "servo/machine", "--no-figures") == cli.DIFFERS
    output = capsys.readouterr().out
    assert output.startswith("6 of 20 requirements are not kept")
    assert "…" not in output
    words = " ".join(output.split())
    assert [part for part in MACHINE_WORDS if part not in words] == []


def listed(output: str) -> dict[str, str]:
    """Return the words of list by title, without remarks in brackets."""
    entries: dict[str, str] = {}
    for line in output.splitlines():
        words = line.partition("  (")[0].strip().split(None, 1)
        if len(words) == 2:
            entries[words[0]] = words[1]
    return entries


@pytest.mark.parametrize(
    ("target", "title", "entry"),
    [
        ("servo", "states", "rotor angle [rad], rotor speed [rad/s]"),
        ("servo", "inputs", "current [A]"),
        ("servo", "bodies", "rotor"),
        ("servo", "joints", "shaft [rad] about -y"),
        ("servo", "laws", "lqr, fl-lqr, grosmc, lqi, fl-pid, adrc, adaptive"),
        ("servo", "rotor", "mass 2.885 kg; principal inertia 0.029066, 0.0577, 0.029066 kg m^2"),
        ("servo", "equations", "J 0.0577 kg m^2; B 0.0088 N m s/rad; Kt 0.667 N m/A"),
        ("maglev", "states", "gap [m], rate [m/s], current [A]"),
        ("maglev", "parameters", "m, g, C, R, L"),
    ],
)
def test_list_names_what_tables_of_a_case_file_take(
    target: str, title: str, entry: str, capsys: Screen
) -> None:
    assert run("list", target) == cli.DONE
    assert listed(capsys.readouterr().out)[title] == entry


def test_the_headline_counts_what_is_not_judged(folder: Path, capsys: Screen) -> None:
    limits = {"settles_within": "19 ms", "input_below": "1 kA"}
    run_table = {"start": {"rotor angle": "0.1 rad"}, "engine": "python"}
    cases.write(folder, "servo", run=run_table, requirement=limits)
    assert run("run", "mine.toml", "--no-figures") == cli.DONE
    assert capsys.readouterr().out.startswith("1 requirement is kept, 1 not judged.")


def test_list_needs_no_more_than_a_plant(folder: Path, capsys: Screen) -> None:
    (folder / "bare.toml").write_text('[plant]\nsystem = "servo"\n')
    assert run("list", "bare.toml") == cli.DONE
    assert listed(capsys.readouterr().out)["states"] == "rotor angle [rad], rotor speed [rad/s]"


def test_list_says_why_a_law_cannot_be_designed(folder: Path, capsys: Screen) -> None:
    text = '[plant]\nsystem = "servo"\n[[controller]]\nlaw = "pd"\n'
    (folder / "bare.toml").write_text(text)
    assert run("list", "bare.toml") == cli.DONE
    output = capsys.readouterr().out
    assert "not designed controller pd: " in " ".join(output.split())
    assert "shaft [rad] about -y" in output


def test_list_takes_a_file_whose_tables_have_those_names(folder: Path, capsys: Screen) -> None:
    (folder / "mine.toml").write_text(MINE)
    assert run("list", "mine.toml") == cli.DONE
    output = capsys.readouterr().out
    assert listed(output)["states"] == "rotor angle [rad], rotor speed [rad/s]"
    assert "[/] of mine" in output


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
    packaged = shipped_files()["arm/case1"]
    mine = tmp_path / "mine.toml"
    mine.write_text(complete_text(packaged), encoding="utf-8")
    assert shown_experiment(str(mine)).path == mine
    assert result_name(mine) == "mine"
    assert result_name(packaged) == "arm_case1"


def test_commands_stand_in_the_order_of_their_use() -> None:
    first = "new run campaign film view validate claims study"
    second = "tune identify compare predict export report diff list"
    assert list(COMMANDS) == [*first.split(), *second.split()]


def test_every_module_of_a_study_is_a_command_that_asks_a_question() -> None:
    modules = {module.name for module in iter_modules(study.__path__)}
    assert {*STUDIES} == modules
    for entry in STUDIES.values():
        assert entry.summary.endswith("?")


@pytest.mark.parametrize("command", all_commands())
def test_every_command_has_a_summary(command: type[Command]) -> None:
    summary = (command.__doc__ or "").partition("\n")[0]
    assert summary.endswith((".", ":"))


@pytest.mark.parametrize("command", all_commands())
def test_every_command_takes_verbose(command: type[Command]) -> None:
    assert "verbose" in command.__dataclass_fields__


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("", f"Usage: grosmc-mj {' '.join(COMMANDS)}"),
        ("validate", "TARGETS SYSTEM --verbose --out"),
        ("film", "FILE.toml --laws --camera --size --from -o"),
        ("study", " ".join(STUDIES)),
    ],
)
def test_help_names_the_options(arguments: str, words: str, capsys: Screen) -> None:
    assert run(*arguments.split(), "--help") == cli.DONE
    output = capsys.readouterr().out
    assert [word for word in words.split() if word not in output] == []


def panels(command: str, screen: Screen) -> dict[str, list[str]]:
    """Return the options of each panel of a command's help."""
    assert run(*command.split(), "--help") == cli.DONE
    found: dict[str, list[str]] = {}
    title = ""
    for line in screen.readouterr().out.splitlines():
        if line.startswith("╭─"):
            title = line.split()[1]
            found[title] = []
        elif title:
            found[title].extend(re.findall(r"^│ (--[a-z-]+)", line))
    return found


def test_the_help_of_a_campaign_begins_with_eight_options(capsys: Screen) -> None:
    found = panels("campaign", capsys)
    assert list(found) == [
        "Arguments",
        "Options",
        "Runs",
        "Output",
    ]
    first = "--runs --laws --at-least --worst --radius --out --resume --plant"
    assert found["Options"] == first.split()


PAGES = [
    *(name for name, entry in COMMANDS.items() if isinstance(entry, Entry)),
    *(
        f"{group} {name}"
        for group, entries in COMMANDS.items()
        if not isinstance(entries, Entry)
        for name in entries
    ),
    *(name for name, entry in COMMANDS.items() if not isinstance(entry, Entry)),
    "",
]
# Words on an option that say what holds without it.
HOLDS = re.compile(r"\[default: |\[required\]|by default|instead")


@pytest.mark.parametrize("command", PAGES)
def test_help_fits_on_a_screen_of_a_hundred_columns(
    command: str, capsys: Screen, monkeypatch: Patch
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    assert run(*command.split(), "--help") == cli.DONE
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    assert len(lines) <= 50


@pytest.mark.parametrize("command", PAGES)
def test_help_says_of_each_option_with_a_value_what_holds_without_it(
    command: str, capsys: Screen, monkeypatch: Patch
) -> None:
    monkeypatch.setenv("COLUMNS", "1000")
    assert run(*command.split(), "--help") == cli.DONE
    options = re.findall(r"^│ \*? *(--[a-z].*?) *│$", capsys.readouterr().out, re.MULTILINE)
    takes_value = [option for option in options if re.match(r"--\S+( -o)? [A-Z\[]\S*", option)]
    silent = [option for option in takes_value if not HOLDS.search(option)]
    assert silent == []


def test_the_overview_has_a_line_for_each_command(capsys: Screen, monkeypatch: Patch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert run("--help") == cli.DONE
    lines = capsys.readouterr().out.splitlines()
    rows = [line for line in lines if line.startswith("│")]
    assert [row.split()[1] for row in rows] == [*COMMANDS, "--help", "--version"]


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
        ("run servo --laws lqr --laws grosmc", {"laws": ("lqr", "grosmc")}),
        ("run servo --laws=lqr", {"laws": ("lqr",)}),
        ("run --laws lqr -- servo", {"laws": ("lqr",), "target": "servo"}),
        ('run servo --laws ["lqr"]', {"laws": ('["lqr"]',)}),
        ("run servo --save", {"save": "parquet"}),
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

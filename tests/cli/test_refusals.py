"""Wrong use of every command: one line that names the mistake, exit code 2, and no file."""

from __future__ import annotations

import contextlib
import io
import tempfile
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest
from commands import Screen, assert_one_line, run

from grosmc_mj import cli
from grosmc_mj.cli.commands import STUDIES
from grosmc_mj.cli.exit_codes import WRONG
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.file.text import complete_text

# Command lines and words of their refusals; small.toml is there, and no backend renders.
REFUSALS = [
    (
        "frobnicate",
        "claims, study, tune, identify, compare, predict, export, report, diff, list",
    ),
    ("doctor", "unknown command 'doctor': valid: new, run, campaign, film, view"),
    ("validate arm/case9", "valid: nominal, case1, case2, tuned, bench"),
    ("validate small.toml", "judged by grosmc-mj run"),
    ("validate servo/machine", "no results of a machine are recorded"),
    ("validate fig3", "grosmc-mj validate cart_pendulum/case1 writes fig3_pendulum_variation.png"),
    ("run servo --no-figure", "unknown option --no-figure: did you mean --no-figures?; for help"),
    (
        "run servo --save npz",
        '"npz" for --save. Choose from: "parquet", "csv"; for help',
    ),
    ("diff a b --junit c.xml", "unknown option --junit; for help: grosmc-mj diff --help"),
    ("report --worst", "unknown option --worst; for help: grosmc-mj report --help"),
    ("report --out x", "unknown option --out: did you mean --output?"),
    ("report nowhere", "nowhere does not exist"),
    ("report .", "no results in ."),
    ("report . -o page.pdf", "-o page.pdf must end in .html"),
    ("claims arm-epsilonn", "did you mean 'arm-epsilon'?"),
    ("claims servo --page page.md", "--page page.md is about all claims: leave out servo"),
    ("claims --page docs", "must end in .md"),
    ("claims sweep servo --record", "leave out servo"),
    ("claims premises", "SYSTEM|SYSTEM/CASE"),
    ("claims premises arm/case7", "did you mean 'arm/case2'"),
    ("claims premises arm --laws grosmk", "did you mean 'grosmc'?"),
    ("study tolerance maglev", "there is no loop"),
    ("predict log.csv servo", "--law"),
    ("predict log.csv servo --law mpc", "unknown law 'mpc'"),
    ("predict log.csv servo --law lqr --seeds 0", "--seeds 0 must be from 1 to 1000"),
    ("predict log.csv servo --law lqr", "log.csv"),
    ("predict servo --law lqr", "no log to predict: name one before"),
    ("predict --law lqr", "CASE"),
    ("export servo --law mpc", "controller mpc: unknown law 'mpc': valid: lqr, fl-lqr, grosmc"),
    ("export servo", "--law"),
    ("export servo --law lqr --plants -1", "--plants -1 must not be below 0"),
    ("export servo/case1 --law lqr --loop", "--loop: the case has no loop"),
    (
        "study switching",
        f"unknown command 'switching': valid: {', '.join(STUDIES)}",
    ),
    ("campaign servo --case-file small.toml", "--case-file is for --plant only"),
    ("campaign out --plant 3 --runs 7", "--runs is not for --plant"),
    ("campaign out --plant 3 --laws lqr grosmc", "--laws lqr grosmc: name one, for --plant"),
    ("view servo --speed 0", "speed 0 must be from 1/64 to 64 times real time"),
    ("view nothing.toml", "there is no such file"),
    ("film servo --size banana", "--size banana must be WIDTHxHEIGHT"),
    ("film servo --fps 30.5", "--fps: '30.5' is no whole number"),
    ("film servo --fps 30 31", "unexpected argument '31'"),
    ("run servo --verbose=maybe", "--verbose"),
    ("run servo --out", "--out: a value is missing; for help: grosmc-mj run --help"),
    ("run --target servo", "unknown option --target"),
    ("study region servo --limits 1 x", "--limits"),
    (
        "study",
        f"missing: one of {', '.join(STUDIES)}; for help: grosmc-mj",
    ),
    ("film servo --from 100", "shows nothing: the runs begin at 0 s and end at 18 s"),
    ("film servo --camera nose", "unknown camera 'nose': valid: fixed, follow"),
    # More frames, and more processes, than any memory holds.
    ("film servo --speed 1e-12", "speed = 1e-12 must be from 0.015625 to 64"),
    ("film servo --workers 1000000", "workers = 1e+06 must be a whole number from 1 to 256"),
    ("film servo -o f.avi", "must end in .mp4"),
    ("film small.toml --laws mpc", "unknown law 'mpc': valid: lqr"),
    (
        "film small.toml --controllers lqr",
        "unknown option --controllers; for help: grosmc-mj film",
    ),
    ("film small.toml --laws", "1 to 4 controllers, not 0"),
    ("film small.toml --to 0.1", "no OpenGL backend renders off-screen (glfw: no display ("),
]


class Ended(NamedTuple):
    """Exit code of a command, its two outputs, and the files of its working folder."""

    code: int
    output: str
    error: str
    files: list[str]


# Two tests read what each command leaves.
@cache
def ended(command: str) -> Ended:
    """Run a command in a folder with one case file and no display."""
    output = io.StringIO()
    error = io.StringIO()
    with (
        tempfile.TemporaryDirectory() as name,
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(output),
        contextlib.redirect_stderr(error),
    ):
        folder = Path(name)
        text = complete_text(shipped_files()["servo/case2"])
        (folder / "small.toml").write_text(text, encoding="utf-8")

        patch.chdir(folder)
        patch.setenv("MUJOCO_GL", "glfw")
        patch.delenv("DISPLAY", raising=False)
        patch.delenv("WAYLAND_DISPLAY", raising=False)
        code = run(*command.split())
        files = [path.name for path in folder.iterdir()]
    return Ended(code, output.getvalue(), error.getvalue(), files)


@pytest.mark.parametrize(("command", "words"), REFUSALS)
def test_wrong_use_is_one_line(command: str, words: str) -> None:
    code, output, error, _ = ended(command)
    assert code == cli.WRONG
    assert words in error
    assert_one_line(error)
    assert output == ""


@pytest.mark.parametrize("command", [command for command, _ in REFUSALS])
def test_wrong_use_leaves_no_file(command: str) -> None:
    assert ended(command).files == ["small.toml"]


@pytest.mark.parametrize(
    "command", ["run", "campaign", "view", "new", "new --schema", "campaign --plant 0"]
)
@pytest.mark.parametrize("name", ["a\0b", "a\x1b[31mb.toml", "\udcff", "x" * 5000, "a/" * 999])
def test_odd_names_are_one_line(command: str, name: str, capsys: Screen) -> None:
    assert run(*command.split(), name) == cli.WRONG
    assert_one_line(capsys.readouterr().err)


def test_no_command_executes_a_formula(tmp_path: Path, capsys: Screen) -> None:
    canary = tmp_path / "canary"
    program = f"__import__('pathlib').Path({str(canary)!r}).touch()"
    # Octal escapes: the string holds no quote of its own.
    escaped = "".join(f"\\{ord(letter):o}" for letter in program)
    case = tmp_path / "formula.toml"
    case.write_text(
        f"""
[plant]
system = "arm"
[run]
duration = "1 s"
[[controller]]
law = "lqr"
[task]
reference = ['''sin("{escaped}")''']
"""
    )
    assert run("run", case) == cli.WRONG
    assert "at character 5, may have t" in capsys.readouterr().err
    assert not canary.exists()


# Commands that write into a folder, or to a file.
WRITING = [
    "run servo/case1 --out",
    "validate servo/case1 --out",
    "claims servo --out",
    "claims sweep servo --out",
    "claims premises servo/case1 --out",
    "export servo/case1 --law lqr --out",
    "campaign servo --out",
    "study ladder servo --out",
    "study tolerance servo --out",
    "study margins servo --out",
    "study region servo --out",
    "study disturbance servo/case1 --on current --bound 1A --out",
    "study contest servo --out",
    "identify a.csv servo/case1 --out",
    "compare a.csv servo/case1 --out",
    "predict a.csv servo/case1 --law lqr --out",
    "diff a b --out",
    "film servo -o",
    "report a -o",
]


@pytest.mark.parametrize("command", WRITING)
def test_a_file_in_the_place_of_a_folder_is_refused_before_all_work(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Screen
) -> None:
    monkeypatch.chdir(tmp_path)
    # Nothing is read, designed or run.
    monkeypatch.setattr("grosmc_mj.experiments.experiment.Experiment.of_file", pytest.fail)
    (tmp_path / "taken").write_text("precious", encoding="utf-8")
    suffix = {"film": "/a.mp4", "report": "/a.html"}.get(command.split()[0], "/below")
    assert run(*command.split(), f"taken{suffix}") == WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert "taken is a file, and a folder is needed: name another one" in error
    assert (tmp_path / "taken").read_text(encoding="utf-8") == "precious"

"""Wrong use of every command: one line that names the mistake, exit code 2, and no file."""

from __future__ import annotations

from pathlib import Path

import cases
import pytest
from commands import Screen, assert_one_line, run

from grosmc_mj import cli
from grosmc_mj.cli.commands import STUDIES

# Command lines and words of their refusals; small.toml is there, and no backend renders.
REFUSALS = [
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
    ("study tolerance maglev", "there is no loop"),
    ("predict log.csv servo", "--law"),
    ("predict log.csv servo --law lqr --seeds 0", "--seeds 0 must be from 1 to 1000"),
    ("predict log.csv servo --law lqr", "log.csv"),
    ("predict servo --law lqr", "no log to predict: name one before"),
    ("predict --law lqr", "CASE"),
    ("export servo --law mpc", "controller mpc: unknown law 'mpc': valid: lqr, fl-lqr, grosmc"),
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
    ("film servo --fps 30 31", "unexpected argument '31'"),
    ("run servo --verbose=maybe", "--verbose"),
    ("run servo --out", "--out: a value is missing; for help: grosmc-mj run --help"),
    ("study region servo --limits 1 x", "--limits"),
    (
        "study",
        f"missing: one of {', '.join(STUDIES)}; for help: grosmc-mj",
    ),
    ("film servo --from 100", "shows nothing: the runs begin at 0 s and end at 18 s"),
    # More frames, and more processes, than any memory holds.
    ("film servo --speed 1e-12", "speed = 1e-12 must be from 0.015625 to 64"),
    ("film servo --workers 1000000", "workers = 1e+06 must be a whole number from 1 to 256"),
    ("film servo -o f.avi", "must end in .mp4"),
    ("film small.toml --laws", "1 to 4 controllers, not 0"),
    ("film small.toml --to 0.1", "no OpenGL backend renders off-screen (glfw: no display ("),
]


@pytest.mark.parametrize(("command", "words"), REFUSALS)
def test_wrong_use_is_one_line_and_leaves_no_file(
    command: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Screen
) -> None:
    cases.write(tmp_path, "servo", name="small", run={"duration": "2 s"})
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert run(*command.split()) == cli.WRONG
    output = capsys.readouterr()
    assert words in output.err
    assert_one_line(output.err)
    assert output.out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["small.toml"]


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
    formula = f'sin("{escaped}")'
    path = cases.write(tmp_path, "arm", task={"reference": [formula]})
    assert run("run", path) == cli.WRONG
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
    assert run(*command.split(), f"taken{suffix}") == cli.WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert "taken is a file, and a folder is needed: name another one" in error
    assert (tmp_path / "taken").read_text(encoding="utf-8") == "precious"

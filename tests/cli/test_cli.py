"""The command line: what it says, its exit codes, and wrong use in one line."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from grosmc_mj import cli


def run(*arguments: str) -> int:
    """Exit code of the command line."""
    with pytest.raises(SystemExit) as stop:
        cli.main(arguments)
    assert isinstance(stop.value.code, int)
    return stop.value.code


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("validate", "servoo"), "did you mean 'servo'?"),
        (("validate", "arm/case9"), "valid: nominal, case1, case2, bench"),
        (("validate", "--colour", "red"), "--colour"),
        (("film", "servo", "--speed", "soon"), "could not convert"),
        (
            ("run", "servo", "--no-figure"),
            "unknown option --no-figure: did you mean --no-figures?; for help",
        ),
        (
            ("report", "--worst"),
            "unknown option --worst; for help: grosmc-mj report --help",
        ),
        (
            ("report", "--out", "x"),
            "unknown option --out: did you mean --output?",
        ),
        (
            ("frobnicate",),
            "validate, claims, study, identify, compare, report, diff, list",
        ),
        (("study", "tolerance", "arm", "--seeds", "0"), "must be from 1 to 1000"),
        (("study", "tolerance", "maglev"), "there is no loop"),
        (("claims", "--page", "docs"), "must end in .md"),
        (("claims", "premises", "arm/case7"), "did you mean 'arm/case2'"),
        (("film",), "SYSTEM"),
        (("film", "maglev"), "its plant is equations alone, and a film shows a model in MuJoCo"),
        (("film", "leg"), "unknown case 'leg': valid: arm, ball_beam, cart_pendulum"),
        (("film", "servo/case9"), "did you mean 'servo/case2'"),
        (("film", "servo", "--size", "banana"), "--size banana must be WIDTHxHEIGHT"),
        (("film", "servo", "--size", "641x480"), "641 x 480 pixels: both must be even"),
        (("film", "servo", "--size", "10x10"), "from 320 to 3840"),
        (("film", "servo", "--size", "99999x99999"), "from 320 to 3840"),
        (("film", "servo", "--size", "640x-480"), "--size"),
        (("film", "servo", "--fps", "0"), "must be a whole number from 1 to 240"),
        (("film", "servo", "--fps", "30.5"), "--fps"),
        (("film", "servo", "--speed", "0"), "speed = 0 must be from 0.015625 to 64"),
        (("film", "servo", "--speed", "nan"), "speed = nan must be from 0.015625 to 64"),
        (("film", "servo", "--from", "5", "--to", "3"), "from 5 s to 3 s shows nothing"),
        (("film", "servo", "--from", "-1"), "start = -1 must be finite and not negative"),
        (("film", "servo", "--workers", "0"), "workers = 0 must be a whole number from 1 to 256"),
        (("film", "servo", "-o", "f.avi"), "must end in .mp4"),
    ],
)
def test_wrong_use_gets_one_line_and_exit_code_2(
    arguments: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*arguments) == cli.WRONG
    error = capsys.readouterr().err
    assert says in error
    assert error.startswith("grosmc-mj: ")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--from", "100"), "shows nothing: the runs begin at 0 s and end at 18 s"),
        (("--to", "100"), "from 0 s to 100 s shows nothing"),
        (("--camera", "nose"), "unknown camera 'nose': valid: fixed, follow"),
        (("--controllers", "mpc"), "valid: lqr, fl-lqr, grosmc"),
        (("--controllers",), "1 to 4 controllers, not 0"),
        (("--controllers", "pid", "lqr", "fl-lqr", "grosmc", "smc"), "controller"),
        (
            ("--speed", "1e-12"),
            "speed = 1e-12 must be from 0.015625 to 64",
        ),  # of which there would be more than any memory holds
        (("--workers", "1000000"), "workers = 1e+06 must be a whole number"),
    ],
)
def test_wrong_use_of_film_is_said_before_a_backend_is_looked_for(
    arguments: tuple[str, ...],
    says: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # There is none that works.
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    path = tmp_path / "f.mp4"
    assert run("film", "servo", "-o", str(path), *arguments) == cli.WRONG
    error = capsys.readouterr().err
    assert says in error
    assert error.startswith("grosmc-mj: ")
    assert error.count("\n") == 1
    assert not list(tmp_path.glob("*f.*"))


@pytest.mark.slow
def test_an_output_folder_that_cannot_be_written_is_one_line_after_the_results(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    arguments = ("servo/nominal", "--out", str(blocked / "renders"))
    assert run("validate", *arguments) == cli.WRONG
    said = capsys.readouterr()
    assert "cannot write" in said.err
    assert said.err.count("\n") == 1
    assert "grosmc" in said.out  # what was computed is not lost


def test_help_of_every_command_names_its_options(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--help") == cli.DONE
    summary = capsys.readouterr().out
    for command, words in {
        "validate": (
            "SYSTEM/CASE",
            "--verbose",
            "--out",
        ),
        "film": ("FILE.toml", "--laws", "--camera", "--size", "--from", "-o"),
        "doctor": ("Exit code 1",),
        "list": (),
        "study": ("switching", "region", "tolerance", "ladder"),
    }.items():
        assert command in summary
        assert run(command, "--help") == cli.DONE
        text = capsys.readouterr().out
        for word in words:
            assert word in text


def test_list_shows_systems_cases_plants_and_controllers(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run("list", "cart_pendulum") == cli.DONE
    text = capsys.readouterr().out
    names = ("pole angle [rad]", "force [N]", "slider [m]")
    for word in ("cart_pendulum", "case1", "physics", "fl-lqr", "grosmc", *names):
        assert word in text


@pytest.mark.parametrize(
    ("target", "said"),
    [
        (
            "servo",
            {
                "states": "rotor angle [rad], rotor speed [rad/s]",
                "inputs": "current [A]",
                "bodies": "rotor",
                "joints": "shaft [rad]",
                "laws": "lqr, fl-lqr, grosmc, lqi, pid, adrc, adaptive",
                "rotor": "mass 2.885 kg; principal inertia 0.029066, 0.0577, 0.029066 kg m^2",
                "equations": "J 0.0577 kg m^2; B 0.0088 N m s/rad; Kt 0.667 N m/A",
            },
        ),
        ("cart_pendulum/bench", {"bodies": "cart, pole", "joints": "slider [m], hinge [rad]"}),
        ("maglev", {"states": "gap [m], rate [m/s], current [A]", "parameters": "m, g, C, R, L"}),
    ],
)
def test_list_names_what_tables_of_a_case_file_ask_for(
    target: str, said: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("list", target) == cli.DONE
    lines = [
        line.partition("  (")[0].strip().split(None, 1)
        for line in capsys.readouterr().out.splitlines()
    ]
    found = {words[0]: words[1] for words in lines if len(words) == 2}
    assert {what: found[what] for what in said} == said


def test_names_that_are_listed_are_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the tables that the list says they are for; of a file of one's own, too."""
    file = tmp_path / "mine.toml"
    file.write_text(
        'title = "[/] of mine"\n[plant]\nsystem = "servo"\n[run]\nduration = "0.1 s"\n'
        'start = { "rotor speed" = "1 rad/s" }\n[[controller]]\nlaw = "lqr"\n'
        '[[edit]]\nbody = "rotor"\nmass_scale = 2\n[[edit]]\njoint = "shaft"\ndamping = 0.1\n'
        '[[sensor]]\nof = "rotor angle"\nnoise = "1 mrad"\n[[estimator]]\nof = "rotor speed"\n'
        '[[actuator]]\nof = "current"\nlimit = "4 A"\n'
    )
    assert run("list", str(file)) == cli.DONE
    text = capsys.readouterr().out
    for name in ("rotor angle [rad]", "rotor speed [rad/s]", "current [A]", "shaft [rad]"):
        assert name in text
    assert "[/] of mine" in text


def test_a_closed_pipe_is_no_error() -> None:
    program = f"{sys.executable} -m grosmc_mj.cli list | head -1"
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {program}"], capture_output=True, text=True, check=False
    )
    assert done.stdout.startswith("4 systems")
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_graphics_backend_that_is_not_there_hinders_no_more_than_films() -> None:
    for arguments, code, said in (
        (("list",), cli.DONE, ""),
        (
            ("run", "servo/nominal", "--no-figures", "--out", "/dev/null/x"),
            cli.WRONG,
            "Not a directory",
        ),
        (("film", "servo"), cli.WRONG, "MUJOCO_GL: unknown backend 'banana': valid: egl, osmesa"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "grosmc_mj.cli", *arguments],
            env={**os.environ, "MUJOCO_GL": "banana"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == code
        assert said in done.stderr
        assert done.stderr.count("\n") == (1 if code else 0)


def test_standard_output_on_a_full_disk_is_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "grosmc_mj.cli", "list"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == cli.WRONG
    assert done.stderr == "grosmc-mj: standard output: No space left on device\n"


def test_without_a_terminal_progress_is_a_line_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from grosmc_mj.cli import screen

    assert screen.LINE_EVERY == 10.0
    with screen.progress(3, "runs") as advance:
        advance("soon")
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(screen, "LINE_EVERY", 0.0)
    with screen.progress(3, "runs") as advance:
        advance("one  of them ")
        advance(by=2)
    assert capsys.readouterr().err.splitlines() == [
        "1 of 3 runs in 0 s: one of them", "3 of 3 runs in 0 s"
    ]  # fmt: skip

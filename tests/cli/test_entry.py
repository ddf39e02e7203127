"""From the start of the program to its exit code: nothing computed is lost, and 1 is a verdict."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from campaign_cases import pair
from commands import assert_one_line, run
from rich.console import Console

from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.errors import SetupError
from grosmc_mj.results.result import Answer, result

SMALL = """
[plant]
system = "arm"
compare = ["physics"]
[run]
duration = "0.02 s"
[[controller]]
law = "lqr"
[[requirement]]
input_below = "50 N m"
"""
FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
NO_SPACE = "grosmc-mj: standard output: No space left on device\n"


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """A case file that is kept."""
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    return path


def never_kept(case: Path) -> Path:
    case.write_text(SMALL.replace("50 N m", "1e-9 N m"))
    return case


def raising(error: BaseException) -> Callable[..., Any]:
    """A function that raises an error, whatever it is given."""

    def fail(*_: Any, **__: Any) -> Any:
        raise error

    return fail


def process(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    """Python in a process of its own."""
    command = [sys.executable, *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=200, **options
    )


# In one process: --help, list and run of a file, and the libraries that are imported afterwards.
IMPORTS = """
import contextlib, io, sys
from grosmc_mj.cli import main
heavy = {"numpy", "mujoco", "numba", "sympy", "scipy", "pydantic", "matplotlib", "typeguard"}
others = {"matplotlib", "control", "pint", "scipy.stats", "scipy.optimize", "pyarrow", "dask",
          "loky"}
for command, without in (("--help", heavy | {"rich.console"}), ("list", heavy),
                         ("run servo/nominal --no-figures --out " + sys.argv[1], others)):
    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
        main(command.split())
    print(command.split()[0], sorted(without & set(sys.modules)))
"""
# Ctrl-C while a module is looked for: most of the time of a short command goes into imports.
INTERRUPTS = """
import signal, sys
from grosmc_mj.cli import main

class Interrupting:
    def find_spec(self, name, *_):
        if name == self.moment:
            print(name, flush=True)
            signal.raise_signal(signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)
sys.meta_path.insert(0, interrupting := Interrupting())
for interrupting.moment in ("tyro", "grosmc_mj.cli.commands.run", "numpy", "mujoco"):
    try:
        main(["run", sys.argv[1]])
    except SystemExit as stop:
        print(stop.code)
"""


@pytest.mark.slow
def test_a_command_imports_only_libraries_that_it_needs(tmp_path: Path) -> None:
    done = process("-c", IMPORTS, str(tmp_path))
    assert (done.stdout, done.stderr) == ("--help []\nlist []\nrun []\n", "")


@pytest.mark.slow
def test_an_interrupt_of_an_import_is_answered(case: Path) -> None:
    done = process("-c", INTERRUPTS, str(case))
    modules = ("tyro", "grosmc_mj.cli.commands.run", "numpy", "mujoco")
    assert done.stdout == "".join(f"{module}\n{cli.INTERRUPTED}\n" for module in modules)
    line = "grosmc-mj: interrupted; run the same command again to start over\n"
    assert done.stderr == 4 * line


@pytest.mark.slow
def test_surroundings_of_the_program_change_nothing(case: Path) -> None:
    """A matplotlibrc in the working folder, no graphics backend, an encoding without letters."""
    case.write_text(case.read_text().replace('"lqr"', '"lqr"\nname = "law é"'))
    (case.parent / "matplotlibrc").write_text("text.usetex: True\nlines.linewidth: 9\n")
    plain, odd = case.parent / "plain", case.parent / "odd"
    surroundings = {**os.environ, "MUJOCO_GL": "banana", "PYTHONIOENCODING": "ascii"}
    done = process(
        "-P", "-m", "grosmc_mj.cli", "run", str(case), "--out", str(odd), cwd=case.parent,
        env=surroundings,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (cli.DONE, "")
    assert "law ?" in done.stdout
    assert run("run", case, "--out", plain) == cli.DONE
    assert (plain / "small.png").read_bytes() == (odd / "small.png").read_bytes()


@pytest.mark.slow
def test_streams_that_are_closed_or_full_change_no_verdict(case: Path) -> None:
    """1 is also what an interpreter ends with that cannot write."""
    command = f"{sys.executable} -m grosmc_mj.cli run {never_kept(case)} --out {case.parent}"
    streams = "--no-figures <&- >&- 2>/dev/full"
    done = subprocess.run(["bash", "-c", f"{command} {streams}"], check=False, timeout=200)
    assert done.returncode == cli.DIFFERS
    assert json.loads(case.with_suffix(".json").read_text())["kept"] is False


# Exit codes.


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (ZeroDivisionError("a\nb"), cli.WRONG, "unforeseen ZeroDivisionError: a b; --debug shows"),
        (AssertionError(), cli.WRONG, "unforeseen AssertionError: "),
        (UnicodeEncodeError("ascii", "é", 0, 1, "no"), cli.WRONG, "unforeseen UnicodeEncodeError"),
        (ValueError("\x1b[31mred\x07" + "x" * 9999), cli.WRONG, r"\x1b[31mred\x07xxx"),
        (OSError(errno.EIO, "Input/output error", "f\x1b"), cli.WRONG, r"f\x1b: Input/output"),
        (KeyboardInterrupt(), cli.INTERRUPTED, "interrupted; run the same command again"),
        (KeyboardInterrupt("3\nparts" + "x" * 9999), cli.INTERRUPTED, "3 partsxxx"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_every_error_is_one_line(
    error: BaseException, code: int, words: str, case: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr("grosmc_mj.experiments.runs.simulate", raising(error))
    assert run("run", case, "--out", case.parent) == code
    line = capsys.readouterr().err
    assert words in line
    assert_one_line(line.replace("unforeseen", ""))
    assert len(line) < 1100


def test_debug_adds_where_it_happened(
    case: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("grosmc_mj.experiments.runs.simulate", raising(ZeroDivisionError("no")))
    assert run("run", case, "--out", case.parent, "--debug") == cli.WRONG
    error = capsys.readouterr().err
    assert "Traceback (most recent call last)" in error
    assert error.endswith("grosmc-mj: unforeseen ZeroDivisionError: no\n")


# What becomes of the results.


@pytest.fixture
def commands(case: Path, tmp_path: Path) -> dict[str, tuple[tuple[Any, ...], Path]]:
    """Commands that judge: their arguments and their JSON."""
    campaign, out = tmp_path / "campaign.toml", tmp_path / "out"
    campaign.write_text(pair())
    few = ("--runs", 4, "--shard", 2, "--out", out)
    return {
        "run": (("run", case, "--out", out), out / "small.json"),
        "premises": (
            ("claims", "premises", "servo/nominal", "--out", out), out / "premises_servo.json",
        ),
        "claims": (("claims", "arm-eq57", "--out", out), out / "claims" / "arm-eq57.json"),
        "campaign": (("campaign", campaign, *few), out / "results.json"),
    }  # fmt: skip


@pytest.mark.parametrize("name", ["run", "premises", "claims", "campaign"])
def test_results_are_written_before_anything_is_printed(
    name: str, commands: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And a full disk at the figure leaves results and verdict."""
    arguments, document = commands[name]
    with monkeypatch.context() as patch:
        patch.setattr(Console, "print", raising(RuntimeError("printing fails")))
        assert run(*arguments) == cli.WRONG
    assert "unforeseen RuntimeError: printing fails" in capsys.readouterr().err
    assert json.loads(document.read_text(encoding="utf-8"))["schema_version"] == 2
    shutil.rmtree(document.parent)
    if name != "premises":
        monkeypatch.setattr("matplotlib.figure.Figure.savefig", raising(FULL))
        assert run(*arguments) == cli.WRONG
        output = capsys.readouterr()
        pattern = r"grosmc-mj: cannot write .*: No space left on device; .*\n"
        assert re.fullmatch(pattern, output.err)
        assert output.out


def test_results_that_cannot_be_written_are_printed(
    case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blocked = case / "renders"
    assert run("run", case, "--out", blocked) == cli.WRONG
    assert_one_line(capsys.readouterr().err)
    (case.parent / "out" / "small.json").mkdir(parents=True)
    assert run("run", case, "--out", case.parent / "out") == cli.WRONG
    output = capsys.readouterr()
    assert "cannot write" in output.err
    assert output.out.startswith("The requirement is kept")


def test_the_answer_of_a_result_that_cannot_be_written_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = result("run", {}, answers=[Answer(question="Is it?", verdict="kept", words="It is")])
    with pytest.raises(SetupError, match="cannot write"):
        screen.say_result(content, tmp_path, full=False)
    assert capsys.readouterr().out == "It is.\n"


def disk_full() -> Any:
    return os.fdopen(os.open("/dev/full", os.O_WRONLY), "w")


def reader_gone() -> Any:
    """A pipe whose reader has gone."""
    reader, writer = os.pipe()
    os.close(reader)
    return os.fdopen(writer, "w", buffering=1)


class Failing(io.StringIO):
    """A stream that is full, and how often it was written to."""

    error, count = FULL, 0

    def write(self, text: str) -> int:
        self.count += 1
        raise self.error


class Gone(Failing):
    error = BrokenPipeError()


@pytest.mark.parametrize("kept", [True, False])
@pytest.mark.parametrize(
    ("streams", "full"),
    [
        ({"stdout": lambda: None}, False),
        ({"stdout": lambda: None, "stderr": lambda: None}, False),
        ({"stdout": Failing}, True),
        ({"stdout": Gone}, False),
        ({"stdout": disk_full}, True),
        ({"stderr": disk_full}, False),
        ({"stdout": reader_gone}, False),
    ],
)
def test_the_verdict_does_not_depend_on_who_reads_it(
    streams: dict[str, Any], full: bool, kept: bool, case: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """With the objects that the interpreter makes of such streams; 1 is a verdict."""
    opened = {name: opener() for name, opener in streams.items()}
    arguments = ("run", case if kept else never_kept(case), "--no-figures", "--out", case.parent)
    with monkeypatch.context() as patch:
        for name, stream in opened.items():
            patch.setattr(sys, name, stream)
        assert run(*arguments) == (cli.WRONG if full else cli.DONE if kept else cli.DIFFERS)
        null = [getattr(sys, name) for name in streams]
    # What has failed once is not written to again.
    assert all(stream.count == 1 for stream in opened.values() if isinstance(stream, Failing))
    for stream in [*opened.values(), *null]:
        with contextlib.suppress(OSError, AttributeError):
            stream.close()
    assert capsys.readouterr().err == (NO_SPACE if full else "")
    assert json.loads(case.with_suffix(".json").read_text())["kept"] is kept


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp437"])
def test_an_encoding_that_lacks_letters_is_no_error(
    encoding: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding))
    (tmp_path / "small.toml").write_text(f'title = "law 一"\n{SMALL}', encoding="utf-8")
    assert run("list", tmp_path / "small.toml") == cli.DONE
    assert b"law ?" in written.getvalue()

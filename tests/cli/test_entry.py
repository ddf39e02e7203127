"""From the start of the program to its exit code: nothing computed is lost, and 1 is a verdict."""

from __future__ import annotations

import contextlib
import errno
import io
import itertools
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
from grosmc_mj.experiments import runs

SMALL = """
[plant]
system = "arm"
compare = ["physics"]
[run]
duration = "0.02 s"
[[controller]]
law = "lqr"
[[requirement]]
input_below = "{} N m"
"""
FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """A case file that is kept."""
    path = tmp_path / "small.toml"
    path.write_text(SMALL.format(50))
    return path


@pytest.fixture
def never_kept(case: Path) -> Path:
    case.write_text(SMALL.format(1e-9))
    return case


def raising(error: BaseException) -> Callable[..., Any]:
    """A function that raises an error, whatever its arguments."""

    def fail(*_: Any, **__: Any) -> Any:
        raise error

    return fail


def process(*arguments: Any, **options: Any) -> subprocess.CompletedProcess[str]:
    """Python in a process of its own."""
    command = [sys.executable, *map(str, arguments)]
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
def test_a_command_imports_only_libraries_that_it_needs_and_an_interrupt_of_that_is_answered(
    case: Path,
) -> None:
    done = process("-c", IMPORTS, case.parent)
    assert (done.stdout, done.stderr) == ("--help []\nlist []\nrun []\n", "")
    done = process("-c", INTERRUPTS, case)
    modules = ("tyro", "grosmc_mj.cli.commands.run", "numpy", "mujoco")
    assert done.stdout == "".join(f"{module}\n{cli.INTERRUPTED}\n" for module in modules)
    assert done.stderr == 4 * "grosmc-mj: interrupted; run the same command again to start over\n"


@pytest.mark.slow
def test_surroundings_of_the_program_change_nothing(never_kept: Path) -> None:
    """A matplotlibrc in the working folder, no graphics backend; streams that are closed or full.

    1 is also what an interpreter ends with that cannot write.
    """
    folder = never_kept.parent
    (folder / "matplotlibrc").write_text("text.usetex: True\nlines.linewidth: 9\n")
    arguments = ("-P", "-m", "grosmc_mj.cli", "run", never_kept, "--out", folder / "odd")
    done = process(*arguments, cwd=folder, env={**os.environ, "MUJOCO_GL": "banana"})
    assert (done.returncode, done.stderr) == (cli.DIFFERS, "")
    assert run("run", never_kept, "--out", folder / "plain") == cli.DIFFERS
    assert (folder / "plain/small.png").read_bytes() == (folder / "odd/small.png").read_bytes()
    command = f"{sys.executable} {' '.join(map(str, arguments))} --no-figures <&- >&- 2>/dev/full"
    done = subprocess.run(["bash", "-c", command], check=False, timeout=200)
    assert done.returncode == cli.DIFFERS


@pytest.mark.parametrize("command", [("run", "servo/nominal"), ("validate", "servo")])
def test_ctrl_c_keeps_finished_runs(
    command: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate, count = runs.simulate, itertools.count()

    def counted(*arguments: Any, **numbers: Any) -> Any:
        if next(count) == 1:
            raise KeyboardInterrupt
        return simulate(*arguments, **numbers)

    monkeypatch.setattr(runs, "simulate", counted)
    assert run(*command, "--no-figures", "--out", tmp_path) == cli.INTERRUPTED
    (file,) = tmp_path.glob("*.json")
    content = json.loads(file.read_text(encoding="utf-8"))
    assert (content["complete"], len(content["runs"])) == (False, 1)


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (ZeroDivisionError("a\nb"), cli.WRONG, "unforeseen ZeroDivisionError: a b; --debug shows"),
        (ValueError("\x1b[31mred\x07" + "x" * 9999), cli.WRONG, r"\x1b[31mred\x07xxx"),
        (OSError(errno.EIO, "Input/output error", "f\x1b"), cli.WRONG, r"f\x1b: Input/output"),
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
    if isinstance(error, ZeroDivisionError):
        assert run("run", case, "--out", case.parent, "--debug") == cli.WRONG
        more = capsys.readouterr().err
        assert "Traceback (most recent call last)" in more
        assert more.endswith("grosmc-mj: unforeseen ZeroDivisionError: a b\n")


@pytest.mark.parametrize("name", ["run", "premises", "claims", "campaign"])
def test_results_are_written_before_anything_is_printed(
    name: str, case: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And a full disk at the figure leaves results and verdict."""
    campaign, out = case.with_name("campaign.toml"), case.with_name("out")
    campaign.write_text(pair())
    arguments, document = {
        "run": (("run", case), "small.json"),
        "premises": (("claims", "premises", "servo/nominal"), "premises_servo.json"),
        "claims": (("claims", "arm-eq57"), "claims/arm-eq57.json"),
        "campaign": (("campaign", campaign, "--runs", 4, "--shard", 2), "results.json"),
    }[name]
    with monkeypatch.context() as patch:
        patch.setattr(Console, "print", raising(RuntimeError("printing fails")))
        assert run(*arguments, "--out", out) == cli.WRONG
    assert "unforeseen RuntimeError: printing fails" in capsys.readouterr().err
    assert json.loads((out / document).read_text(encoding="utf-8"))["schema_version"] == 2
    shutil.rmtree(out)
    if name != "premises":
        monkeypatch.setattr("matplotlib.figure.Figure.savefig", raising(FULL))
        assert run(*arguments, "--out", out) == cli.WRONG
        output = capsys.readouterr()
        pattern = r"grosmc-mj: cannot write .*: No space left on device; .*\n"
        assert re.fullmatch(pattern, output.err)
        assert output.out


def test_results_that_cannot_be_written_are_printed(
    case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (case.parent / "out" / "small.json").mkdir(parents=True)
    assert run("run", case, "--out", case.parent / "out") == cli.WRONG
    output = capsys.readouterr()
    assert "cannot write" in output.err
    assert output.out.startswith("The requirement is kept")


def disk_full() -> Any:
    return os.fdopen(os.open("/dev/full", os.O_WRONLY), "w")


def reader_gone() -> Any:
    """A pipe whose reader has gone."""
    reader, writer = os.pipe()
    os.close(reader)
    return os.fdopen(writer, "w", buffering=1)


class Failing(io.StringIO):
    """A stream that is full, and how often it was written to."""

    count = 0

    def write(self, text: str) -> int:
        self.count += 1
        raise FULL


@pytest.mark.parametrize(
    ("streams", "full"),
    [
        ({"stdout": lambda: None, "stderr": lambda: None}, False),
        ({"stdout": Failing}, True),
        ({"stdout": disk_full}, True),
        ({"stderr": disk_full}, False),
        ({"stdout": reader_gone}, False),
    ],
)
def test_the_verdict_does_not_depend_on_who_reads_it(
    streams: dict[str, Any], full: bool, never_kept: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """With the objects that the interpreter makes of such streams; 1 is a verdict."""
    opened = {name: opener() for name, opener in streams.items()}
    arguments = ("run", never_kept, "--no-figures", "--out", never_kept.parent)
    with monkeypatch.context() as patch:
        for name, stream in opened.items():
            patch.setattr(sys, name, stream)
        assert run(*arguments) == (cli.WRONG if full else cli.DIFFERS)
        null = [getattr(sys, name) for name in streams]
    # A stream that has failed once is not written to again.
    assert all(stream.count == 1 for stream in opened.values() if isinstance(stream, Failing))
    for stream in [*opened.values(), *null]:
        with contextlib.suppress(OSError, AttributeError):
            stream.close()
    line = "grosmc-mj: standard output: No space left on device\n"
    assert capsys.readouterr().err == (line if full else "")
    assert json.loads(never_kept.with_suffix(".json").read_text())["kept"] is False


def test_an_encoding_that_lacks_letters_is_no_error(
    case: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, "latin-1"))
    case.write_text(f'title = "law 一"\n{case.read_text()}', encoding="utf-8")
    assert run("list", case) == cli.DONE
    assert b"law ?" in written.getvalue()

"""From the start of the program to its exit code: nothing computed is lost, and 1 is a verdict."""

from __future__ import annotations

import contextlib
import errno
import io
import itertools
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import campaigns
import cases
import pytest
from commands import Patch, Screen, assert_one_line, run
from rich.console import Console

from grosmc_mj import cli
from grosmc_mj.experiments import experiment

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def write_case(folder: Path, limit: str = "50 N m", **more: Any) -> Path:
    """Write the case of an arm that keeps its limit by default."""
    plant = {"compare": ["physics"]}
    limits = {"input_below": limit}
    return cases.write(folder, "arm", name="small", plant=plant, requirement=limits, **more)


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    """A case file that is kept."""
    return write_case(tmp_path)


@pytest.fixture
def never_kept(tmp_path: Path) -> Path:
    """A case file that is not kept."""
    return write_case(tmp_path, "1e-09 N m")


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


# One command, and those of the libraries that are imported afterwards.
IMPORTS = """
import contextlib, io, sys
from grosmc_mj.cli import main

libraries, *arguments = sys.argv[1:]
with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
    with contextlib.redirect_stderr(io.StringIO()):
        main(arguments)
print(*[name for name in libraries.split() if name in sys.modules])
"""
# Libraries that take longer to import than a short command may take.
HEAVY = "numpy mujoco numba sympy scipy pydantic matplotlib rich.markdown"
# Libraries that no equations, no design of a law and no run needs.
UNUSED = (
    "matplotlib plotly PIL control pandas scipy.stats scipy.optimize pyarrow dask loky dm_control"
)
# And those that reading and checking a case file does not need.
UNREAD = f"{UNUSED} scipy.linalg scipy.ndimage scipy.special"
# Ctrl-C while a module is looked for: most of the time of a short command goes into imports.
INTERRUPT = """
import signal, sys
from grosmc_mj.cli import main

class Interrupting:
    def find_spec(self, name, *_):
        if name == sys.argv[1]:
            print(name, flush=True)
            signal.raise_signal(signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)
sys.meta_path.insert(0, Interrupting())
main(["run", sys.argv[2]])
"""


@pytest.mark.parametrize(
    ("libraries", "command"),
    [
        (HEAVY, "--help"),
        (HEAVY, "list"),
        (HEAVY, "study margins --help"),
        (HEAVY, "run nosuch"),
        (HEAVY, "run servo --no-figure"),
        (HEAVY, "run no_toml.toml"),
        pytest.param(UNREAD, "run no_state.toml", marks=pytest.mark.slow),
        pytest.param(UNUSED, "run servo/nominal --no-figures", marks=pytest.mark.slow),
    ],
)
def test_a_command_imports_only_libraries_that_it_needs(
    libraries: str, command: str, tmp_path: Path
) -> None:
    (tmp_path / "no_toml.toml").write_text("[plant]\nsystem = servo\n")
    cases.write(tmp_path, name="no_state", run={"start": {"rotor angel": "1 rad"}})
    done = process("-c", IMPORTS, libraries, *command.split(), cwd=tmp_path)
    assert done.stdout == "\n"
    assert done.stderr == ""


@pytest.mark.slow
@pytest.mark.parametrize("module", ["cyclopts", "mujoco"])
def test_an_interrupt_of_an_import_is_answered(module: str, kept: Path) -> None:
    done = process("-c", INTERRUPT, module, kept)
    assert done.returncode == cli.INTERRUPTED
    assert done.stdout == f"{module}\n"
    assert done.stderr == "grosmc-mj: interrupted; run the same command again to start over\n"


@pytest.mark.slow
def test_settings_of_other_libraries_change_nothing(never_kept: Path) -> None:
    """A matplotlibrc in the working folder, and no graphics backend."""
    folder = never_kept.parent
    (folder / "matplotlibrc").write_text("text.usetex: True\nlines.linewidth: 9\n")
    arguments = ("-P", "-m", "grosmc_mj.cli", "run", never_kept, "--out", folder / "odd")
    done = process(*arguments, cwd=folder, env={**os.environ, "MUJOCO_GL": "banana"})
    assert done.returncode == cli.DIFFERS
    assert done.stderr == ""
    assert run("run", never_kept, "--out", folder / "plain") == cli.DIFFERS
    assert (folder / "plain/small.png").read_bytes() == (folder / "odd/small.png").read_bytes()


@pytest.mark.slow
def test_streams_that_fail_leave_the_verdict(never_kept: Path) -> None:
    """1 is also the exit code of an interpreter that cannot write: nothing is left to fail."""
    program = f"{sys.executable} -P -m grosmc_mj.cli"
    command = f"{program} run {never_kept} --no-figures --out {never_kept.parent}"
    done = subprocess.run(
        ["bash", "-c", f"{command} <&- >&- 2>/dev/full"], check=False, timeout=200
    )
    assert done.returncode == cli.DIFFERS


@pytest.mark.parametrize("command", [("run", "servo/nominal"), ("validate", "servo")])
def test_ctrl_c_keeps_finished_runs(
    command: tuple[str, ...], tmp_path: Path, monkeypatch: Patch
) -> None:
    simulate = experiment.simulate
    count = itertools.count()

    def interrupted_at_the_second(*arguments: Any, **numbers: Any) -> Any:
        if next(count) == 1:
            raise KeyboardInterrupt
        return simulate(*arguments, **numbers)

    monkeypatch.setattr(experiment, "simulate", interrupted_at_the_second)
    assert run(*command, "--no-figures", "--out", tmp_path) == cli.INTERRUPTED
    (file,) = tmp_path.glob("*.json")
    content = json.loads(file.read_text(encoding="utf-8"))
    assert content["complete"] is False
    assert len(content["runs"]) == 1


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
    error: BaseException, code: int, words: str, kept: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    monkeypatch.setattr(experiment, "simulate", raising(error))
    assert run("run", kept, "--out", kept.parent) == code
    line = capsys.readouterr().err
    assert words in line
    assert_one_line(line.replace("unforeseen", ""))
    assert len(line) < 1100


def test_debug_adds_the_traceback(kept: Path, monkeypatch: Patch, capsys: Screen) -> None:
    monkeypatch.setattr(experiment, "simulate", raising(ZeroDivisionError("a\nb")))
    assert run("run", kept, "--out", kept.parent, "--debug") == cli.WRONG
    error = capsys.readouterr().err
    assert "Traceback (most recent call last)" in error
    assert error.endswith("grosmc-mj: unforeseen ZeroDivisionError: a b\n")


@pytest.fixture
def folder(kept: Path, monkeypatch: Patch) -> Path:
    """Working folder with a case and a campaign."""
    (kept.parent / "campaign.toml").write_text(campaigns.pair())
    monkeypatch.chdir(kept.parent)
    return kept.parent


# Commands in a folder with both files, and the document that each writes to --out.
RUN = ("run small.toml", "small.json")
CLAIM = ("claims arm-eq57", "claims/arm-eq57.json")
CAMPAIGN = ("campaign campaign.toml --runs 4 --shard 2", "results.json")
PREMISES = ("claims premises servo/nominal", "premises_servo_nominal.json")


@pytest.mark.parametrize(("command", "document"), [RUN, CLAIM, CAMPAIGN, PREMISES])
def test_results_are_written_before_anything_is_printed(
    command: str, document: str, folder: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    monkeypatch.setattr(Console, "print", raising(RuntimeError("printing fails")))
    assert run(*command.split(), "--out", "out") == cli.WRONG
    assert "unforeseen RuntimeError: printing fails" in capsys.readouterr().err
    content = json.loads((folder / "out" / document).read_text(encoding="utf-8"))
    assert content["schema_version"] == 2


@pytest.mark.parametrize(("command", "document"), [RUN, CLAIM, CAMPAIGN])
def test_a_full_disk_at_the_figure_leaves_the_results(
    command: str, document: str, folder: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", raising(FULL))
    assert run(*command.split(), "--out", "out") == cli.WRONG
    output = capsys.readouterr()
    pattern = r"grosmc-mj: cannot write .*: No space left on device; .*\n"
    assert re.fullmatch(pattern, output.err)
    assert output.out
    assert (folder / "out" / document).is_file()


def test_results_that_cannot_be_written_are_printed(
    kept: Path, capsys: Screen, monkeypatch: Patch
) -> None:
    # Their place is taken after it was looked at.
    monkeypatch.setattr("grosmc_mj.cli.answering.require_writable", lambda *paths: None)
    (kept.parent / "out" / "small.json").mkdir(parents=True)
    assert run("run", kept, "--out", kept.parent / "out") == cli.WRONG
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


def no_stream() -> None:
    """Standard output of a process that was started without one."""


@pytest.mark.parametrize(
    ("streams", "full"),
    [
        ({"stdout": no_stream, "stderr": no_stream}, False),
        ({"stdout": Failing}, True),
        ({"stdout": disk_full}, True),
        ({"stderr": disk_full}, False),
        ({"stdout": reader_gone}, False),
    ],
)
def test_the_verdict_does_not_depend_on_who_reads_it(
    streams: dict[str, Any], full: bool, never_kept: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    """With the objects that the interpreter makes of such streams; 1 is a verdict."""
    opened = {name: opener() for name, opener in streams.items()}
    with monkeypatch.context() as patch:
        for name, stream in opened.items():
            patch.setattr(sys, name, stream)
        code = run("run", never_kept, "--no-figures", "--out", never_kept.parent)
        replaced = [getattr(sys, name) for name in streams]
    # A stream that has failed is not written to again.
    assert all(stream.count == 1 for stream in opened.values() if isinstance(stream, Failing))
    for stream in [*opened.values(), *replaced]:
        with contextlib.suppress(OSError, AttributeError):
            stream.close()

    assert code == (cli.WRONG if full else cli.DIFFERS)
    line = "grosmc-mj: standard output: No space left on device\n"
    assert capsys.readouterr().err == (line if full else "")
    assert json.loads(never_kept.with_suffix(".json").read_text())["kept"] is False


def test_an_encoding_that_lacks_letters_is_no_error(tmp_path: Path, monkeypatch: Patch) -> None:
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, "latin-1"))
    assert run("list", write_case(tmp_path, title="law 一")) == cli.DONE
    assert b"law ?" in written.getvalue()


@pytest.mark.parametrize(
    ("limit", "kept", "code"), [("1e-6 mrad", 0, cli.DIFFERS), ("100 mrad", 4, cli.DONE)]
)
def test_a_campaign_in_which_a_law_passes_nowhere_is_a_verdict(
    limit: str, kept: int, code: int, tmp_path: Path, capsys: Screen
) -> None:
    path = tmp_path / "campaign.toml"
    limits = campaigns.deviation_below(limit)
    path.write_text(campaigns.servo(laws=campaigns.LQR, limits=limits))
    command = ("campaign", path, "--runs", "4", "--no-figures", "--out", tmp_path / "out")
    assert run(*command) == code
    assert f"lqr keeps everything on {kept} of 4 plants" in capsys.readouterr().out

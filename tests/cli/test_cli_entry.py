"""From the start of the program to its exit code: nothing computed is lost, and 1 is a verdict."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from campaign_cases import pair
from rich.console import Console

from grosmc_mj import cli
from grosmc_mj.cli.output import Output

SMALL = """
[plant]
system = "arm"
compare = ["physics"]
[run]
duration = "0.02 s"
[[controller]]
law = "lqr"
[[requirement]]
input_below = "{limit} N m"
"""


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """A case file that is kept."""
    path = tmp_path / "small.toml"
    path.write_text(SMALL.format(limit=50))
    return path


def run(*arguments: Any) -> int:
    """The exit code of a command in this process."""
    with pytest.raises(SystemExit) as stop:
        cli.main([str(each) for each in arguments])
    assert isinstance(stop.value.code, int)
    return stop.value.code


def started(*arguments: Any, **options: Any) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own."""
    command = [sys.executable, "-m", "grosmc_mj", *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    return subprocess.run(command, text=True, check=False, timeout=120, **pipes)


def raising(error: BaseException) -> Any:
    """A function that raises an error, whatever it is given."""

    def fail(*_: Any, **__: Any) -> Any:
        raise error

    return fail


# Exit codes.


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (ZeroDivisionError("a\nb"), cli.WRONG, "unforeseen ZeroDivisionError: a b; --debug shows"),
        (RecursionError("too deep"), cli.WRONG, "unforeseen RecursionError: too deep"),
        (AssertionError(), cli.WRONG, "unforeseen AssertionError: "),
        (UnicodeEncodeError("ascii", "é", 0, 1, "no"), cli.WRONG, "unforeseen UnicodeEncodeError"),
        (ValueError("\x1b[31mred\x07" + "x" * 9999), cli.WRONG, r"\x1b[31mred\x07xxx"),
        (OSError(errno.EIO, "Input/output error", "f\x1b"), cli.WRONG, r"f\x1b: Input/output"),
        (KeyboardInterrupt(), cli.INTERRUPTED, "interrupted; run the same command again"),
        (KeyboardInterrupt("interrupted: 3 parts"), cli.INTERRUPTED, "interrupted: 3 parts"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_whatever_happens_is_one_line(error, code, said, case: Path, monkeypatch, capsys):
    monkeypatch.setattr("grosmc_mj.experiments.runs.simulate", raising(error))
    assert run("run", case, "--out", case.parent) == code
    line = capsys.readouterr().err
    assert line.startswith("grosmc-mj: ")
    assert said in line
    assert line.count("\n") == 1
    assert line[:-1].isprintable()
    assert len(line) < 1100


def test_debug_adds_where_it_happened(case: Path, monkeypatch, capsys):
    monkeypatch.setattr("grosmc_mj.experiments.runs.simulate", raising(ZeroDivisionError("no")))
    assert run("run", case, "--out", case.parent, "--debug") == cli.WRONG
    said = capsys.readouterr().err
    assert "Traceback (most recent call last)" in said
    assert said.endswith("grosmc-mj: unforeseen ZeroDivisionError: no\n")


def test_exit_code_1_is_a_verdict(case: Path, capsys):
    assert run("run", case, "--no-figures", "--out", case.parent) == cli.DONE
    case.write_text(SMALL.format(limit=1e-9))
    assert run("run", case, "--no-figures", "--out", case.parent) == cli.DIFFERS
    assert capsys.readouterr().err == ""


@pytest.mark.slow
@pytest.mark.parametrize("moment", ["numpy", "mujoco", "tyro", "grosmc_mj.cli.commands.run"])
def test_an_interrupt_of_an_import_is_answered(moment: str, case: Path):
    """Ctrl-C comes when it comes; most of the time of a short command goes into imports."""
    program = f"""
import os, signal, sys

class Interrupting:
    def find_spec(self, name, *_):
        if name == {moment!r}:
            signal.raise_signal(signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)
from grosmc_mj.cli import main
sys.meta_path.insert(0, Interrupting())
main(["run", {str(case)!r}])
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == cli.INTERRUPTED
    assert done.stderr == "grosmc-mj: interrupted; run the same command again to start over\n"


# What becomes of the results.

# Of the documents of the commands that judge.
SCHEMAS = {"run": 2, "premises": 2, "claims": 2, "campaign": 2}


def commands(folder: Path, case: Path) -> dict[str, tuple[tuple[Any, ...], Path, int]]:
    """Commands that judge: arguments, their JSON, and their exit code."""
    out = ("--out", folder / "out")
    campaign = folder / "campaign.toml"
    campaign.write_text(pair())
    few = ("--runs", 4, "--shard", 2)
    return {
        "run": (("run", case, *out), folder / "out" / "small.json", 0),
        "premises": (
            ("claims", "premises", "servo/nominal", *out),
            folder / "out" / "premises_servo.json",
            0,
        ),
        "claims": (
            ("claims", "arm-eq57", *out),
            folder / "out" / "claims" / "arm-eq57.json",
            0,
        ),
        "campaign": (("campaign", campaign, *few, *out), folder / "out" / "results.json", 0),
    }


@pytest.mark.parametrize("name", ["run", "premises", "claims", "campaign"])
def test_results_are_written_before_anything_is_printed(
    name: str, tmp_path: Path, case: Path, monkeypatch, capsys
):
    arguments, document, _ = commands(tmp_path, case)[name]
    monkeypatch.setattr(Console, "print", raising(RuntimeError("printing fails")))
    assert run(*arguments) == cli.WRONG
    assert "unforeseen RuntimeError: printing fails" in capsys.readouterr().err
    assert json.loads(document.read_text(encoding="utf-8"))["schema_version"] == SCHEMAS[name]


@pytest.mark.parametrize("name", ["run", "campaign", "claims"])
def test_a_full_disk_at_the_figure_leaves_results_and_verdict(
    name: str, tmp_path: Path, case: Path, monkeypatch, capsys
):
    arguments, document, _ = commands(tmp_path, case)[name]
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", raising(full))
    assert run(*arguments) == cli.WRONG
    said = capsys.readouterr()
    assert re.fullmatch(r"grosmc-mj: cannot write .*: No space left on device; .*\n", said.err)
    assert json.loads(document.read_text(encoding="utf-8"))["schema_version"] == SCHEMAS[name]
    assert said.out


@pytest.mark.parametrize("name", ["run", "campaign"])
@pytest.mark.parametrize("reader", ["has gone", "has a full disk"])
def test_the_verdict_does_not_depend_on_who_reads_it(
    name: str, reader: str, tmp_path: Path, case: Path, monkeypatch, capsys
):
    arguments, document, code = commands(tmp_path, case)[name]
    gone = reader == "has gone"
    error = BrokenPipeError() if gone else OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    class Failing(io.StringIO):
        def write(self, text: str) -> int:
            raise error

    monkeypatch.setattr(sys, "stdout", Failing())
    assert run(*arguments) == (code if gone else cli.WRONG)
    said = capsys.readouterr().err
    assert said == ("" if gone else "grosmc-mj: standard output: No space left on device\n")
    assert document.is_file()


def kept_by_file(out: Path) -> bool:
    """What a run has written, which is removed."""
    document = out / "small.json"
    kept = json.loads(document.read_text(encoding="utf-8"))["kept"]
    document.unlink()
    return kept


@pytest.mark.slow
def test_streams_that_are_closed_or_full_change_no_verdict(tmp_path: Path):
    """1 is also what an interpreter ends with that cannot write."""
    case, out = tmp_path / "small.toml", tmp_path / "out"
    case.write_text(SMALL.format(limit=1e-9))
    command = f"{sys.executable} -m grosmc_mj.cli run {case} --no-figures --out {out}"
    for streams, code in (
        (">&-", cli.DIFFERS),
        ("<&- >&- 2>&-", cli.DIFFERS),
        (">/dev/full", cli.WRONG),
        ("2>/dev/full", cli.DIFFERS),
        ("| true; exit ${PIPESTATUS[0]}", cli.DIFFERS),
    ):
        done = subprocess.run(["bash", "-c", f"{command} {streams}"], check=False, timeout=120)
        assert (streams, done.returncode) == (streams, code)
        assert kept_by_file(out) is False


def full() -> Any:
    """A full disk."""
    return Path("/dev/full").open("w")


def gone() -> Any:
    """A pipe whose reader has gone."""
    reader, writer = os.pipe()
    os.close(reader)
    return os.fdopen(writer, "w", buffering=1)


@pytest.mark.parametrize(
    ("streams", "code"),
    [
        ({"stdout": lambda: None}, cli.DONE),
        ({"stdout": lambda: None, "stderr": lambda: None}, cli.DONE),
        ({"stdout": full}, cli.WRONG),
        ({"stderr": full}, cli.DONE),
        ({"stdout": gone}, cli.DONE),
    ],
)
def test_nor_do_they_change_that_all_is_kept(
    streams: dict[str, Any], code: int, case: Path, monkeypatch
):
    """With the objects that the interpreter makes of such streams."""
    opened = {name: opener() for name, opener in streams.items()}
    with monkeypatch.context() as patch:
        for name, stream in opened.items():
            patch.setattr(sys, name, stream)
        assert run("run", case, "--no-figures", "--out", case.parent) == code
        # The null device, where there was nothing.
        opened |= {name: getattr(sys, name) for name in streams}
    for stream in opened.values():
        with contextlib.suppress(OSError):
            stream.close()
    assert kept_by_file(case.parent) is True


@pytest.mark.parametrize(
    "encoding", [pytest.param("ascii", marks=pytest.mark.slow), "latin-1", "cp437"]
)
def test_an_encoding_that_lacks_letters_is_no_error(encoding: str, case: Path, monkeypatch):
    case.write_text(SMALL.format(limit=50).replace('"lqr"', '"lqr"\nname = "law 一"'))
    arguments = ("run", case, "--no-figures", "--out", case.parent)
    if encoding == "ascii":
        env = {**os.environ, "PYTHONIOENCODING": encoding}
        done = started(*arguments, env=env, encoding=encoding)
        assert (done.returncode, done.stderr) == (cli.DONE, "")
        said = done.stdout
    else:
        written = io.BytesIO()
        monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding))
        assert run(*arguments) == cli.DONE
        said = written.getvalue().decode(encoding)
    assert "law ?" in said


def test_output_that_failed_is_not_asked_again():
    asked = []

    class Failing:
        def write(self, text: str) -> int:
            asked.append(text)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    output = Output(Failing())
    assert (output.write("one"), output.write("three")) == (3, 5)
    assert (asked, output.lost) == (["one"], "No space left on device")


# What is read.


@pytest.mark.parametrize(
    "name", ["a\0b", "a\x1b[31mb.toml", "\udcff", "x" * 5000, "a/" * 1000 + "x"]
)
@pytest.mark.parametrize("command", ["run", "campaign", "view", "new", "--replay"])
def test_odd_names_are_one_line(command: str, name: str, capsys):
    arguments = ("campaign", name, command, "0") if command == "--replay" else (command, name)
    assert run(*arguments) == cli.WRONG
    line = capsys.readouterr().err
    assert line.startswith("grosmc-mj: ")
    assert "unforeseen" not in line
    assert line[:-1].isprintable()


@pytest.mark.parametrize("command", ["run", "view", "campaign"])
def test_no_command_executes_a_formula(command: str, case: Path, capsys):
    canary = case.with_name("canary")
    program = f"__import__('pathlib').Path({str(canary)!r}).touch()"
    octal = "".join(f"\\{ord(each):o}" for each in program)
    text = case.read_text() + f"[task]\nreference = ['''sin(\"{octal}\")''']\n"
    case.write_text(text)
    assert run(command, case) == cli.WRONG
    assert "is no formula in t" in capsys.readouterr().err
    assert not canary.exists()


@pytest.mark.slow
def test_a_matplotlibrc_in_the_working_folder_is_not_obeyed(case: Path):
    plain, odd = case.parent / "plain", case.parent / "odd"
    (case.parent / "matplotlibrc").write_text("text.usetex: True\nlines.linewidth: 9\n")
    program = f"""
import sys
from grosmc_mj.cli import main
main(["run", {str(case)!r}, "--out", sys.argv[1]])
"""
    command = [sys.executable, "-P", "-c", program, str(odd)]
    done = subprocess.run(command, cwd=case.parent, capture_output=True, check=False)
    assert done.returncode == 0
    assert run("run", case, "--out", plain) == cli.DONE
    assert (plain / "small.png").read_bytes() == (odd / "small.png").read_bytes()

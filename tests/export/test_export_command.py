"""The command export: its files, and its answer without a compiler."""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path

import cases
import pytest
from commands import Patch, Screen, assert_one_line, run

from grosmc_mj.cli.exit_codes import DIFFERS, DONE, WRONG
from grosmc_mj.export.compiler import find_compiler


def test_without_a_compiler_the_law_is_not_proven(
    tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    code = run("export", "servo/case1", "--law", "lqr", "--out", tmp_path)
    assert code == DONE
    assert "not proven" in capsys.readouterr().out
    assert "not proven" in (tmp_path / "servo_case1_lqr.c").read_text(encoding="utf-8")


@pytest.mark.skipif(find_compiler() is None, reason="there is no C compiler")
def test_the_files_say_how_the_law_was_proven(tmp_path: Path) -> None:
    case = cases.write(tmp_path)
    assert run("export", case, "--law", "lqr", "--plants", 0, "--fmu", "--out", tmp_path) == DONE
    content = json.loads((tmp_path / "export_mine_lqr.json").read_text(encoding="utf-8"))
    assert content["answers"][0]["verdict"] == "kept"
    words = f"equal to the last bit in {content['samples']} samples"
    assert "random plant" not in content["answers"][0]["words"]
    source = (tmp_path / "mine_lqr.c").read_text(encoding="utf-8")
    assert words in content["answers"][0]["words"]
    assert words in " ".join(source.split())
    assert f"SHA-256 {content['configuration']['sha256']}" in " ".join(source.split())
    with zipfile.ZipFile(tmp_path / "mine_lqr.fmu") as fmu:
        assert fmu.read("sources/mine_lqr.c").decode() == source


def test_a_link_at_a_file_s_place_is_replaced_and_not_followed(
    tmp_path: Path, monkeypatch: Patch
) -> None:
    monkeypatch.setenv("PATH", "")
    victim = tmp_path / "victim.txt"
    victim.write_text("precious")
    link = tmp_path / "servo_case1_lqr.c"
    link.symlink_to(victim)
    assert run("export", "servo/case1", "--law", "lqr", "--out", tmp_path) == DONE
    assert victim.read_text() == "precious"
    assert not link.is_symlink()


@pytest.mark.parametrize("suffix", [".c", ".h", ".fmu", ".json"])
def test_a_pipe_at_a_file_s_place_is_refused_before_the_proof(
    suffix: str, tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    monkeypatch.setattr("grosmc_mj.export.compiler.find_compiler", pytest.fail)
    name = "export_servo_case1_lqr" if suffix == ".json" else "servo_case1_lqr"
    os.mkfifo(tmp_path / f"{name}{suffix}")
    assert run("export", "servo/case1", "--law", "lqr", "--fmu", "--out", tmp_path) == WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert "is a folder, a device, a pipe or a socket" in error


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("/bin/sleep 600", "was stopped after 0.1 s"),
        ("/bin/sleep 600 & exit 0", "was stopped after 0.1 s"),
        ("exit 0", "made no library that loads"),
        ("echo what >&2; exit 1", "does not compile the law: what"),
    ],
)
def test_a_compiler_that_makes_nothing_is_one_line_in_a_bounded_time(
    script: str, words: str, tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    compiler = tmp_path / "cc"
    compiler.write_text(f"#!/bin/sh\n{script}\n")
    compiler.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("grosmc_mj.export.compiler.LONGEST_COMPILATION", 0.1)
    assert run("export", "servo/case1", "--law", "lqr", "--out", tmp_path / "o") == WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert words in error


@pytest.mark.skipif(find_compiler() is None, reason="there is no C compiler")
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('u[0] = x[0] * float("nan")', "law returned nan at t = 0 s, which is not finite"),
        ("memory.undefined = 1.0; u[0] = 0.0", "no sample to compare"),
        ("u[0] = 'text'", "must be one number"),
        ("u[0] = 0.0; u[3] = 1.0", "index 3 is not known to lie in 0 ... 0"),
        ("u[0] = int(x[0] * float('inf')) % 3", "cannot convert float NaN to integer"),
    ],
)
def test_a_law_without_an_answer_at_its_start_is_refused_in_one_line(
    line: str, words: str, tmp_path: Path, capsys: Screen
) -> None:
    (tmp_path / "mine.py").write_text(f"def law(t, x, memory, p, u):\n    {line}\n")
    case = cases.write(tmp_path, plant={"compare": ["physics"]}, law="mine:law")
    arguments = ["--law", "law", "--plants", 0, "--out", tmp_path]
    assert run("export", case, *arguments) == WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert words in error


@pytest.mark.skipif(find_compiler() is None, reason="there is no C compiler")
def test_a_law_whose_c_runs_otherwise_is_different(tmp_path: Path, capsys: Screen) -> None:
    """int(inf) is an error in Python and in C; compiled Python goes on with some number."""
    line = "u[0] = int(x[0] / max(0.0, 0.01 - t)) % 5"
    (tmp_path / "mine.py").write_text(f"def law(t, x, memory, p, u):\n    {line}\n")
    case = cases.write(tmp_path, plant={"compare": ["physics"]}, law="mine:law")
    arguments = ["--law", "law", "--plants", 0, "--out", tmp_path]
    assert run("export", case, *arguments) == DIFFERS
    assert "C ends its run at 0.01 s on physics" in " ".join(capsys.readouterr().out.split())
    content = json.loads((tmp_path / "export_mine_law.json").read_text(encoding="utf-8"))
    assert content["answers"][0]["verdict"] == "measured"

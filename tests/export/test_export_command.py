"""The command export: its files, and its answer without a compiler."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest
from commands import Patch, Screen, run

from grosmc_mj.cli.exit_codes import DONE
from grosmc_mj.export.compiler import find_compiler


def test_without_a_compiler_the_law_is_not_proven(
    tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    code = run("export", "servo/case1", "--law", "lqr", "--out", tmp_path)
    assert code == DONE
    assert "not proven" in capsys.readouterr().out
    assert "not proven" in (tmp_path / "servo_case1_lqr.c").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.skipif(find_compiler() is None, reason="there is no C compiler")
def test_the_files_say_how_the_law_was_proven(tmp_path: Path) -> None:
    arguments = ["--law", "lqr", "--plants", 2, "--fmu", "--out", tmp_path]
    assert run("export", "servo/case1", *arguments) == DONE
    content = json.loads((tmp_path / "export_servo_case1_lqr.json").read_text(encoding="utf-8"))
    words = f"equal to the last bit in {content['samples']} samples"
    source = (tmp_path / "servo_case1_lqr.c").read_text(encoding="utf-8")
    assert words in content["answers"][0]["words"]
    assert words in " ".join(source.split())
    assert f"SHA-256 {content['configuration']['sha256']}" in " ".join(source.split())
    with zipfile.ZipFile(tmp_path / "servo_case1_lqr.fmu") as fmu:
        assert fmu.read("sources/servo_case1_lqr.c").decode() == source

"""gm.judge refuses a case file as grosmc-mj run does, in the same words."""

from __future__ import annotations

from pathlib import Path

import pytest
from commands import Screen, run

import grosmc_mj as gm
from grosmc_mj import cli

CASE = """
extends = "servo/case2"
[run]
duration = "0.1 s"
"""
MISTAKES = {
    "key": ('number = "edit.rotor.mas_scale"\nvalues = [1, 2]', "did you mean 'mass_scale'?"),
    "range": ('number = "edit.rotor.mass_scale"\nvalues = [2, 1]', "least must be below most"),
    "sign": ('number = "edit.rotor.mass_scale"\nvalues = [-1, 1]', "must be finite and positive"),
}


@pytest.mark.parametrize(("lines", "words"), MISTAKES.values(), ids=MISTAKES)
def test_a_wrong_uncertain_number_is_refused_by_judge_and_by_run(
    lines: str, words: str, tmp_path: Path, capsys: Screen
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f"{CASE}[[uncertain]]\n{lines}\n", encoding="utf-8")
    assert run("run", path, "--out", tmp_path) == cli.WRONG
    with pytest.raises(gm.GrosmcError) as refused:
        gm.judge(path)
    assert words in str(refused.value)
    assert capsys.readouterr().err == f"grosmc-mj: {refused.value}\n"

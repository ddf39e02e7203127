"""A law of the user's own that is no law, or writes some of its inputs never: one line, exit 2."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cases
import pytest
from commands import Screen, assert_one_line, run

from grosmc_mj import cli

LAWS = """
def short(t, x, u):
    u[0] = 1.0

def forgets(t, x, memory, p, u):
    u[0] = -x[0]

def idle(t, x, memory, p, u):
    pass

def one(t, x, memory, p):
    return 1.0

def by_name(t, x, memory, p, u):
    u[-1] = u[0] = 0.0

def by_slice(t, x, memory, p, u):
    u[:] = 0.0

def _fill(u):
    u[0] = 0.0
    u[1] = 0.0

def by_helper(t, x, memory, p, u):
    _fill(u)

def make(plant, kp):
    return None
"""


def written(folder: Path, law: str, **numbers: Any) -> Path:
    """A case file of two inputs under a law."""
    (folder / "own.py").write_text(LAWS, encoding="utf-8")
    Q = {"output 1": 1, "output 2": 1}
    task = {"reference": ["0", "0"], "Q": Q, "R": 1}
    return cases.write(
        folder, "two_link_arm", task=task, controller={"law": f"own:{law}"} | numbers
    )


@pytest.mark.parametrize(
    ("law", "numbers", "words"),
    [
        ("short", {}, "own.py:2: short has the arguments (t, x, u): a law is (t, x, memory, p, u)"),
        ("forgets", {}, "own.py:5: forgets never writes u[1] ("),
        ("idle", {}, "own.py:8: idle never writes u[0] ("),
        ("one", {}, "one returned 1 at t = 0 s, must return a tuple of 2 numbers"),
        ("make", {"kq": 1}, "own:make(plant, kp) cannot be called with the nominal plant and kq"),
        ("make", {"kp": "two"}, "kp = 'two' must be a number or the rows of a matrix"),
    ],
)
def test_a_mistake_in_a_law_of_ones_own_is_one_line(
    law: str, numbers: dict[str, Any], words: str, tmp_path: Path, capsys: Screen
) -> None:
    path = written(tmp_path, law, **numbers)
    assert run("run", path, "--no-figures", "--out", tmp_path) == cli.WRONG
    error = capsys.readouterr().err
    assert words in error
    assert_one_line(error)


@pytest.mark.parametrize("law", ["by_name", "by_slice", "by_helper"])
def test_a_law_that_writes_its_inputs_in_any_way_runs(
    law: str, tmp_path: Path, capsys: Screen
) -> None:
    """Its Q by name weighs its runs alone: nothing is said of what it leaves out."""
    path = written(tmp_path, law)
    assert run("run", path, "--no-figures", "--verbose", "--out", tmp_path) == cli.DONE
    assert "leaves out" not in capsys.readouterr().out

"""What a law of one's own remembers between two samples."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grosmc_mj as gm
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.memory import Memory
from grosmc_mj.errors import ArgumentError
from grosmc_mj.simulation.law_inputs import require_answer

PERIOD, PAST = 1e-3, 8
PID = """
def pid(t, x, memory, p):
    '''PI with anti-windup on the angle; the rate is a mean over the last samples.'''
    e = 1.0 - x[0]
    for i in range(len(memory.past) - 1, 0, -1):
        memory.past[i] = memory.past[i - 1]
    memory.past[0] = x[1]
    rate = 0.0
    for i in range(len(memory.past)):
        rate += memory.past[i] / len(memory.past)
    wanted = p.proportional * e + p.integral * memory.integral - p.derivative * rate
    u = min(max(wanted, -p.most), p.most)
    # The integral stands still while the input is cut.
    if u == wanted:
        memory.integral += 1e-3 * e
    return u
"""
NUMBERS = {"proportional": 4.0, "integral": 2.0, "derivative": 1.5, "most": 3.0}
MEMORY = {"integral": 0.0, "past": np.zeros(PAST)}


def law() -> Any:
    module: dict[str, Any] = {"__name__": "pid"}
    exec(compile(PID, "pid.py", "exec"), module)
    return module["pid"]


def controller(memory: Any = MEMORY, found: Any = None) -> Controller:
    like = gm.chapter_controller("lqr", plant().analytic())
    return gm.custom_controller("pid", found or law(), like, NUMBERS, memory)


def plant() -> Any:
    return gm.MujocoPlant.load("servo")


@pytest.mark.parametrize("kind", ["physics", "analytic"])
def test_both_engines_remember_the_same_bit_for_bit(kind: str) -> None:
    where = plant() if kind == "physics" else plant().analytic()
    made = controller()
    native, python = (
        gm.simulate(where, made, [0.0, 0.0], duration=10.0, control_period=PERIOD, engine=engine)
        for engine in ("native", "python")
    )
    for name in ("state", "input"):
        np.testing.assert_array_equal(getattr(native, name), getattr(python, name))
    for name in ("integral", "past"):
        np.testing.assert_array_equal(native.memory[name], python.memory[name])
    # Row by row what the law has seen; the integral of an error that the input limit holds up.
    np.testing.assert_array_equal(native.memory["past"][10], native.state[3:11, 1][::-1])
    assert np.abs(native.input).max() <= 3.0
    assert native.state[-1, 0] == pytest.approx(1.0, abs=0.02)
    assert 0 < native.memory["integral"][-1] < np.abs(1 - native.state[:, 0]).sum() * PERIOD


def test_every_run_begins_with_its_own_memory() -> None:
    made = controller({"integral": 0.25, "past": np.ones(PAST)})
    one, two = made.begin()[0], made.begin()[0]
    one.past[0], one.integral = 7.0, 3.0  # pyright: ignore[reportAttributeAccessIssue]
    assert (two.past[0], two.integral) == (1.0, 0.25)  # pyright: ignore[reportAttributeAccessIssue]
    require_answer(made, np.zeros(2), 1)
    starts = np.array([[0.0, 0.0], [0.5, 0.0], [-1.0, 0.2]])
    batch = gm.simulate(plant(), made, starts, duration=0.2, control_period=PERIOD)
    for row, start in enumerate(starts):
        alone = gm.simulate(plant(), made, start, duration=0.2, control_period=PERIOD)
        np.testing.assert_array_equal(batch.state[row], alone.state)
        np.testing.assert_array_equal(batch.memory["integral"][row], alone.memory["integral"])


@pytest.mark.parametrize(
    ("memory", "says"),
    [
        ({"v": 0.0}, "'v' cannot be the name"),
        ({"for": 0.0}, "'for' cannot be"),
        ({"past": [0.0, np.nan]}, "past = .* must be finite"),
    ],
)
def test_what_cannot_be_remembered_is_refused(memory: Any, says: str) -> None:
    with pytest.raises(ArgumentError, match=says) as told:
        controller(memory)
    assert "\n" not in str(told.value)


FILE = """
[plant]
system = "servo"
[run]
start = {{ "rotor angle" = "0 rad" }}
duration = "3 s"
control_period = "1 ms"
[[controller]]
law = "{law}"
proportional = 4
integral = 2
derivative = 1.5
most = 3
memory = {memory}
"""


def write(folder: Path, law: str, memory: str) -> Path:
    (folder / "mine.py").write_text(PID, encoding="utf-8")
    file = folder / "mine.toml"
    file.write_text(FILE.format(law=law, memory=memory), encoding="utf-8")
    return file


def test_a_case_file_says_what_its_law_remembers(tmp_path: Path) -> None:
    file = write(tmp_path, "mine:pid", f"{{ integral = 0, past = {PAST * [0]} }}")
    from_file = gm.Experiment.load(file).run("physics").trajectory
    direct = gm.simulate(plant(), controller(), [0.0, 0.0], duration=3.0, control_period=PERIOD)
    np.testing.assert_array_equal(from_file.state[:, 0], direct.state[:, 0])
    np.testing.assert_array_equal(from_file.memory["past"], direct.memory["past"])


@pytest.mark.parametrize(
    ("law", "memory", "says"),
    [
        ("lqr", "{ integral = 0 }", "memory is of a law"),
        ("mine:pid", '{ integral = "0" }', "memory: integral = "),
    ],
)
def test_wrong_memory_in_a_file_is_one_line(
    law: str, memory: str, says: str, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError, match=says) as told:
        gm.Experiment.load(write(tmp_path, law, memory))
    assert "\n" not in str(told.value)


def test_memory_holds_no_address() -> None:
    """Or two runs of one robot would differ."""
    mine = controller()
    held = Controller("pid", mine.law, mine.parameters, lambda: with_workspace(mine.memory()))
    run = gm.simulate(plant(), held, [0.0, 1.0], duration=0.01)
    np.testing.assert_array_equal(run.memory["workspace"], 0.0)


def with_workspace(memory: Memory) -> Memory:
    memory.workspace = 4711.0
    return memory

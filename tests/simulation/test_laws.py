"""Laws of one's own: what they remember, and one line with file, line and instant if they fail."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

import grosmc_mj as gm
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.memory import Memory
from grosmc_mj.errors import ArgumentError, UndefinedLawError
from grosmc_mj.loop import Loop, in_loop
from grosmc_mj.simulation.law_inputs import require_answer
from grosmc_mj.simulation.simulate import Engine
from grosmc_mj.studies.region import guarded

each_engine = pytest.mark.parametrize("engine", ["native", "python"])
each_kind = pytest.mark.parametrize("kind", ["corrected", "physics"])
LATE = 0.005


@cache
def physics(system: str = "servo") -> gm.MujocoPlant:
    return gm.MujocoPlant.load(system)


def controller(
    law: Any, system: str = "servo", memory: Any = None, numbers: Any = None
) -> Controller:
    like = gm.chapter_controller("lqr", physics(system).analytic())
    return gm.custom_controller("mine", law, like, numbers or {"a": np.zeros(2)}, memory)


def run(
    law: Any, kind: str, engine: Engine, system: str = "servo", *, looped: bool = False
) -> gm.Trajectory:
    """A few samples of a law on a plant at rest."""
    plant, mine = physics(system), law if isinstance(law, Controller) else controller(law, system)
    mine = in_loop(mine, Loop(), plant.system) if looped else mine
    x0 = np.zeros(len(plant.system.states))
    target = plant if kind == "physics" else plant.analytic()
    return gm.simulate(target, mine, x0, duration=0.01, engine=engine)


# Indices


def beyond_the_state(t: float, x: Any, memory: Any, p: Any) -> float:
    return x[4000 if t > LATE else 0]


def beyond_the_memory(t: float, x: Any, memory: Any, p: Any) -> float:
    return memory.v[7]


@numba.njit
def entry(x: Any, i: int) -> float:
    return x[i]


def beyond_in_a_helper(t: float, x: Any, memory: Any, p: Any) -> float:
    return entry(p.a, 400)


@numba.njit
def beyond_and_compiled(t: float, x: Any, memory: Any, p: Any) -> float:
    return x[400]


@each_engine
@pytest.mark.parametrize(
    ("law", "kind", "plain"),
    [
        (beyond_the_state, "corrected", False),
        (beyond_the_state, "physics", True),
        (beyond_the_memory, "physics", False),
        (beyond_in_a_helper, "corrected", False),
        (beyond_and_compiled, "physics", True),
    ],
)
def test_an_index_out_of_bounds_is_told_with_its_line(
    law: Any, kind: str, plain: bool, engine: Engine, capfd: pytest.CaptureFixture[str]
) -> None:
    source, first = inspect.getsourcelines(getattr(law, "py_func", law))
    line, t = first + len(source) - 1, "0.006" if law is beyond_the_state else "0"
    mine = controller(law)
    with pytest.raises(ArgumentError) as error:
        run(Controller("mine", law, mine.parameters, mine.memory) if plain else mine, kind, engine)
    words = rf"test_laws.py:{line}: IndexError: .*\(mine at t = {t} s\)"
    assert re.fullmatch(words, str(error.value))
    assert engine == "native" or isinstance(error.value.__cause__, IndexError)
    assert capfd.readouterr().err == ""


# What is returned: of one input, then of two


def returning(value: Any, after: float = -1.0) -> Callable[..., Any]:
    def law(t: float, x: Any, memory: Any, p: Any) -> Any:
        if t > after:
            return value
        return 0.0

    return law


def nothing_later(t: float, x: Any, memory: Any, p: Any) -> float | None:
    if t > LATE:
        return None
    return 0.0


@each_engine
@pytest.mark.parametrize(("kind", "looped"), [("corrected", False), ("physics", True)])
@pytest.mark.parametrize(
    ("system", "law", "words"),
    [
        ("servo", nothing_later, "None at t = 0.006 s"),
        ("servo", lambda t, x, memory, p: x, r"\[0.0, 0.0\] at t = 0 s"),
        ("servo", lambda t, x, memory, p: x[0] > 0, r"np.False_ at t = 0 s"),
        ("servo", returning("a"), "'a' at t = 0 s"),
        ("two_link_arm", returning((1.0, 2.0, 3.0)), r"\(1.0, 2.0, 3.0\) at t = 0 s"),
        ("two_link_arm", returning((1.0,)), r"\(1.0,\) at t = 0 s"),
        ("two_link_arm", nothing_later, "0.0 at t = 0 s|0 at t = 0 s"),
    ],
)
def test_a_value_that_is_no_input_is_told_at_its_instant(
    system: str, law: Any, words: str, looped: bool, kind: str, engine: Engine, capfd: Any
) -> None:
    needed = "a number" if system == "servo" else "a tuple of 2 numbers"
    with pytest.raises(ArgumentError, match=f"^mine returned ({words}), must return {needed}$"):
        run(law, kind, engine, system, looped=looped)
    assert capfd.readouterr().err == ""


@each_engine
def test_whole_numbers_are_inputs_and_a_negative_index_counts_from_the_end(engine: Engine) -> None:
    both = run(lambda t, x, memory, p: (3, -1), "physics", engine, "two_link_arm")
    assert both.command[-1].tolist() == [3.0, -1.0]
    last = run(lambda t, x, memory, p: 1.0 - x[-2], "physics", engine)
    np.testing.assert_array_equal(last.command, 1.0 - last.state[:-1, 0])


@each_engine
@each_kind
@pytest.mark.parametrize("value", [math.nan, -math.inf])
def test_an_input_that_is_not_finite_ends_the_run_where_it_is(
    value: float, kind: str, engine: Engine
) -> None:
    with pytest.raises(UndefinedLawError, match="the law returned no finite number") as ended:
        run(returning(value, LATE), kind, engine)
    assert ended.value.time == pytest.approx(0.006, abs=1e-12)
    assert np.all(np.isfinite(ended.value.trajectory.state))


# Compiling


def uncompiled(t: float, x: Any, memory: Any, p: Any) -> float:
    return 2.0


uncompiled.python_only = True  # pyright: ignore[reportFunctionMemberAccess]


def test_a_law_for_python_only_stays_so_whatever_is_put_around_it() -> None:
    mine, system = controller(uncompiled), physics().system
    around = [mine, in_loop(mine, Loop(), system)]
    for law in [*around, *(guarded(law, system) for law in around)]:
        assert run(law, "corrected", "python").command[-1] == 2.0
        with pytest.raises(ArgumentError, match="mine runs in Python only"):
            run(law, "corrected", "native")


@pytest.mark.filterwarnings("error")
def test_numbas_warnings_reach_nobody(capfd: pytest.CaptureFixture[str]) -> None:
    """Such as that of the product of a row that is not contiguous."""
    run(lambda t, x, memory, p: np.dot(np.zeros((2, 4))[:, ::2], x)[0], "physics", "native")
    assert capfd.readouterr().err == ""


def unknown_to_numba(t: float, x: Any, memory: Any, p: Any) -> float:
    return float(sum(x.tolist()))


def names_nothing(t: float, x: Any, memory: Any, p: Any) -> float:
    return -x[0] if t < 1.0 else nowhere * x[0]  # pyright: ignore[reportUndefinedVariable] # noqa: F821


def remembers_a_list(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.kept = [t, x[0]]
    return 0.0


def lacks_a_field(t: float, x: Any, memory: Any, p: Any) -> float:
    return memory.missing if t > 1.0 else 0.0


class Pushes:
    """A law that is no function."""

    def __call__(self, t: float, x: Any, memory: Any, p: Any) -> float:
        return 2.0


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (unknown_to_numba, r"^test_laws.py:\d+: numba cannot compile the law: Unknown attr"),
        (names_nothing, "NameError: name 'nowhere' is not defined"),
        (remembers_a_list, "begin it as a list of numbers"),
        (lacks_a_field, r"memory or p has no such field: write memory = \{ missing = 0 \}"),
        (Pushes(), "numba cannot compile the law"),
    ],
    ids=["attribute", "name", "list", "field", "object"],
)
def test_a_law_that_numba_cannot_compile_is_told_in_one_line(law: Any, words: str) -> None:
    mine = controller(law, memory={"kept": 0.0})
    with pytest.raises(ArgumentError, match=words) as refused:
        run(mine, "physics", "native")
    assert str(refused.value).endswith('; engine = "python" runs it uncompiled')
    assert "\n" not in str(refused.value)
    if law is not remembers_a_list:
        run(mine, "physics", "python")


# Memory

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
    unlimited = p.proportional * e + p.integral * memory.integral - p.derivative * rate
    u = min(max(unlimited, -p.most), p.most)
    # The integral stands still while the input is cut.
    if u == unlimited:
        memory.integral += 1e-3 * e
    return u
"""
NUMBERS = {"proportional": 4.0, "integral": 2.0, "derivative": 1.5, "most": 3.0}
MEMORY = {"integral": 0.0, "past": np.zeros(8)}


def pid(memory: Any = MEMORY) -> Controller:
    module: dict[str, Any] = {"__name__": "pid"}
    exec(compile(PID, "pid.py", "exec"), module)
    return controller(module["pid"], memory=memory, numbers=NUMBERS)


@each_kind
def test_both_engines_remember_the_same_bit_for_bit(kind: str) -> None:
    where, law = physics() if kind == "physics" else physics().analytic(), pid()
    native, python = (
        gm.simulate(where, law, [0.0, 0.0], duration=1.0, engine=engine)
        for engine in ("native", "python")
    )
    for name in ("state", "input"):
        np.testing.assert_array_equal(getattr(native, name), getattr(python, name))
    for name in ("integral", "past"):
        np.testing.assert_array_equal(native.memory[name], python.memory[name])
    # Row by row what the law has seen; the integral of an error that the input limit holds up.
    np.testing.assert_array_equal(native.memory["past"][10], native.state[3:11, 1][::-1])
    free = np.abs(native.input) < 3.0
    assert np.any(free[1:] & ~free[:-1])
    expected = 1e-3 * np.cumsum(free * (1.0 - native.state[:-1, 0]))
    np.testing.assert_allclose(native.memory["integral"], expected, atol=1e-12)


def test_every_run_begins_with_its_own_memory() -> None:
    law = pid({"integral": 0.25, "past": np.ones(8)})
    one, two = (law.begin()[0] for _ in range(2))
    one.past[0], one.integral = 7.0, 3.0  # pyright: ignore[reportAttributeAccessIssue]
    assert (two.past[0], two.integral) == (1.0, 0.25)  # pyright: ignore[reportAttributeAccessIssue]
    require_answer(law, np.zeros(2), 1)
    starts = np.array([[0.0, 0.0], [0.5, 0.0], [-1.0, 0.2]])
    batch = gm.simulate(physics(), law, starts, duration=0.1)
    for row, start in enumerate(starts):
        alone = gm.simulate(physics(), law, start, duration=0.1)
        np.testing.assert_array_equal(batch.state[row], alone.state)
        np.testing.assert_array_equal(batch.memory["integral"][row], alone.memory["integral"])


def with_workspace(memory: Memory) -> Memory:
    memory.workspace = 4711.0
    return memory


def test_memory_holds_no_address() -> None:
    """Or two runs of one robot would differ."""
    mine = pid()
    law = Controller("pid", mine.law, mine.parameters, lambda: with_workspace(mine.memory()))
    run = gm.simulate(physics(), law, [0.0, 1.0], duration=0.01)
    np.testing.assert_array_equal(run.memory["workspace"], 0.0)


FILE = """
[plant]
system = "servo"
[run]
start = {{ "rotor angle" = "0 rad" }}
duration = "0.5 s"
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
    file = write(tmp_path, "mine:pid", f"{{ integral = 0, past = {8 * [0]} }}")
    from_file = gm.Experiment.load(file).run("physics").trajectory
    direct = gm.simulate(physics(), pid(), [0.0, 0.0], duration=0.5)
    np.testing.assert_array_equal(from_file.state[:, 0], direct.state[:, 0])
    np.testing.assert_array_equal(from_file.memory["past"], direct.memory["past"])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda folder: pid({"v": 0.0}), "'v' cannot be the name"),
        (lambda folder: pid({"for": 0.0}), "'for' cannot be"),
        (lambda folder: pid({"past": [0.0, np.nan]}), "past = .* must be finite"),
        (lambda folder: gm.Experiment.load(write(folder, "lqr", "{ integral = 0 }")),
         "memory is of a law"),
        (lambda folder: gm.Experiment.load(write(folder, "mine:pid", '{ integral = "0" }')),
         "memory: integral = "),
    ],
)  # fmt: skip
def test_what_cannot_be_remembered_is_refused(
    call: Callable[[Path], Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError, match=words) as refused:
        call(tmp_path)
    assert "\n" not in str(refused.value)

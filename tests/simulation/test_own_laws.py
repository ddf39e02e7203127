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


def run(law: Any, kind: str, engine: Engine, system: str = "servo") -> gm.Trajectory:
    """A few samples of a law on a plant at rest."""
    plant, mine = physics(system), law if isinstance(law, Controller) else controller(law, system)
    x0, target = (
        np.zeros(len(plant.system.states)),
        plant if kind == "physics" else plant.analytic(),
    )
    return gm.simulate(target, mine, x0, duration=0.01, engine=engine)


# Laws that fail, or return something else than one input, then than two


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


def at_line(law: Any, t: str) -> str:
    source, first = inspect.getsourcelines(getattr(law, "py_func", law))
    return rf"test_laws.py:{first + len(source) - 1}: IndexError: .*\(mine at t = {t} s\)"


def returned(words: str, needed: str = "a number") -> str:
    return f"mine returned ({words}), must return {needed}"


@each_engine
@pytest.mark.parametrize("setup", ["plain on equations", "in a loop on physics"])
@pytest.mark.parametrize(
    ("system", "law", "words"),
    [
        ("servo", beyond_the_state, at_line(beyond_the_state, "0.006")),
        *(("servo", law, at_line(law, "0"))
          for law in (beyond_the_memory, beyond_in_a_helper, beyond_and_compiled)),
        ("servo", nothing_later, returned("None at t = 0.006 s")),
        ("servo", lambda t, x, memory, p: x, returned(r"\[0.0, 0.0\] at t = 0 s")),
        ("servo", lambda t, x, memory, p: x[0] > 0, returned(r"np.False_ at t = 0 s")),
        ("servo", returning("a"), returned("'a' at t = 0 s")),
        *(("two_link_arm", law, returned(words, "a tuple of 2 numbers")) for law, words in (
            (returning((1.0, 2.0, 3.0)), r"\(1.0, 2.0, 3.0\) at t = 0 s"),
            (returning((1.0,)), r"\(1.0,\) at t = 0 s"),
            (nothing_later, "0.0 at t = 0 s|0 at t = 0 s"),
        )),
    ],
)  # fmt: skip
def test_a_wrong_law_is_told_with_its_line_and_instant(
    system: str, law: Any, words: str, setup: str, engine: Engine, capfd: Any
) -> None:
    mine = controller(law, system)
    if setup.startswith("plain"):
        mine, kind = Controller("mine", law, mine.parameters, mine.memory), "corrected"
    else:
        mine, kind = in_loop(mine, Loop(), physics(system).system), "physics"
    with pytest.raises(ArgumentError) as error:
        run(mine, kind, engine, system)
    assert re.fullmatch(words, str(error.value))
    assert capfd.readouterr().err == ""


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


@each_engine
def test_whole_numbers_are_inputs_and_a_negative_index_counts_from_the_end(engine: Engine) -> None:
    both = run(lambda t, x, memory, p: (3, -1), "physics", engine, "two_link_arm")
    assert both.command[-1].tolist() == [3.0, -1.0]
    last = run(lambda t, x, memory, p: 1.0 - x[-2], "physics", engine)
    np.testing.assert_array_equal(last.command, 1.0 - last.state[:-1, 0])


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


def pid(t: float, x: Any, memory: Any, p: Any) -> float:
    """PI with anti-windup on the angle; the rate is a mean over the last samples."""
    e, rate = 1.0 - x[0], 0.0
    for i in range(len(memory.past) - 1, 0, -1):
        memory.past[i] = memory.past[i - 1]
    memory.past[0] = x[1]
    for i in range(len(memory.past)):
        rate += memory.past[i] / len(memory.past)
    unlimited = 4.0 * e + 2.0 * memory.integral - p.derivative * rate
    u = min(max(unlimited, -3.0), 3.0)
    # The integral stands still while the input is cut.
    if u == unlimited:
        memory.integral += 1e-3 * e
    return u


def with_pid(**memory: Any) -> Controller:
    return controller(pid, memory=memory, numbers={"derivative": 1.5})


@each_kind
def test_both_engines_remember_the_same_bit_for_bit(kind: str) -> None:
    where, law = (
        physics() if kind == "physics" else physics().analytic(),
        with_pid(integral=0.0, past=np.zeros(8)),
    )
    native, python = (
        gm.simulate(where, law, [0.0, 0.0], duration=1.0, engine=engine)
        for engine in ("native", "python")
    )
    np.testing.assert_array_equal(native.state, python.state)
    np.testing.assert_array_equal(native.memory, python.memory)
    # Row by row what the law has seen; the integral of an error that the input limit holds up.
    np.testing.assert_array_equal(native.memory["past"][10], native.state[3:11, 1][::-1])
    free = np.abs(native.input) < 3.0
    assert np.any(free[1:] & ~free[:-1])
    expected = 1e-3 * np.cumsum(free * (1.0 - native.state[:-1, 0]))
    np.testing.assert_allclose(native.memory["integral"], expected, atol=1e-12)


def test_every_run_begins_with_its_own_memory_which_holds_no_address() -> None:
    """Or two runs of one robot would differ."""
    law = with_pid(integral=0.25, past=np.ones(8))
    one, two = (law.begin()[0] for _ in range(2))
    one.past[0], one.integral = 7.0, 3.0  # pyright: ignore[reportAttributeAccessIssue]
    assert (two.past[0], two.integral) == (1.0, 0.25)  # pyright: ignore[reportAttributeAccessIssue]
    require_answer(law, np.zeros(2), 1)
    starts = np.array([[0.0, 0.0], [0.5, 0.0], [-1.0, 0.2]])
    batch = gm.simulate(physics(), law, starts, duration=0.1)
    for row, start in enumerate(starts):
        alone = gm.simulate(physics(), law, start, duration=0.1)
        np.testing.assert_array_equal(batch.state[row], alone.state)
        np.testing.assert_array_equal(batch.memory[row], alone.memory)

    def placed() -> Any:
        memory = law.memory()
        memory.workspace = 4711.0
        return memory

    held = Controller("pid", law.law, law.parameters, placed)
    run = gm.simulate(physics(), held, [0.0, 1.0], duration=0.01)
    np.testing.assert_array_equal(run.memory["workspace"], 0.0)


def from_file(folder: Path, old: str, new: str) -> gm.Experiment:
    """A shipped case whose law remembers, changed."""
    for path in (Path(gm.__file__).parent / "cases" / "own_laws").glob("*.*"):
        (folder / path.name).write_text(path.read_text("utf-8").replace(old, new), "utf-8")
    return gm.Experiment.load(folder / "from_positions.toml")


REMEMBERS = "memory = { angles = [0, 0, 0, 0, 0] }"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda folder: with_pid(v=0.0), "'v' cannot be the name"),
        (lambda folder: with_pid(**{"for": 0.0}), "'for' cannot be"),
        (lambda folder: with_pid(past=[0.0, np.nan]), "past = .* must be finite"),
        (lambda folder: from_file(folder, REMEMBERS, 'memory = { angles = "0" }'),
         "memory: angles = "),
    ],
)  # fmt: skip
def test_what_cannot_be_remembered_is_refused(
    call: Callable[[Path], Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError, match=words) as refused:
        call(tmp_path)
    assert "\n" not in str(refused.value)

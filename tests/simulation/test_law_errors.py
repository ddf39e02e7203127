"""Laws of one's own that go wrong: one line with file, line and instant, in both engines."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable
from functools import cache
from typing import Any

import numba
import numpy as np
import pytest

import grosmc_mj as gm
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, UndefinedLawError
from grosmc_mj.loop import Loop, in_loop
from grosmc_mj.simulation.simulate import Engine
from grosmc_mj.studies.region import guarded

each_engine = pytest.mark.parametrize("engine", ["native", "python"])
each_kind = pytest.mark.parametrize("kind", ["corrected", "physics"])
LATE = 0.005


@cache
def physics(system: str) -> gm.MujocoPlant:
    return gm.MujocoPlant.load(system)


def controller(law: Any, system: str = "servo", memory: Any = None) -> Controller:
    like = gm.chapter_controller("lqr", physics(system).analytic())
    return gm.custom_controller("mine", law, like, {"a": np.zeros(2)}, memory)


def run(
    law: Any, kind: str, engine: Engine, system: str = "servo", *, looped: bool = False
) -> gm.Trajectory:
    """A few samples of a law on a plant at rest."""
    plant, mine = physics(system), law if isinstance(law, Controller) else controller(law, system)
    mine = in_loop(mine, Loop(), plant.system) if looped else mine
    x0 = np.zeros(len(plant.system.states))
    target = plant if kind == "physics" else plant.analytic()
    return gm.simulate(target, mine, x0, duration=0.01, engine=engine)


# Indices.


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
@each_kind
@pytest.mark.parametrize(
    "law", [beyond_the_state, beyond_the_memory, beyond_in_a_helper, beyond_and_compiled]
)
@pytest.mark.parametrize("plain", [False, True], ids=["custom", "plain"])
def test_an_index_out_of_bounds_is_told_with_its_line(
    law: Any, plain: bool, kind: str, engine: Engine, capfd: pytest.CaptureFixture[str]
) -> None:
    source, first = inspect.getsourcelines(getattr(law, "py_func", law))
    line, t = first + len(source) - 1, "0.006" if law is beyond_the_state else "0"
    mine = controller(law)
    with pytest.raises(ArgumentError) as error:
        run(Controller("mine", law, mine.parameters, mine.memory) if plain else mine, kind, engine)
    told = rf"test_law_errors.py:{line}: IndexError: .*\(mine at t = {t} s\)"
    assert re.fullmatch(told, str(error.value))
    assert capfd.readouterr().err == ""


# What is returned: of one input, then of two.


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


WRONG = [
    ("servo", nothing_later, "None at t = 0.006 s"),
    ("servo", lambda t, x, memory, p: x, r"\[0.0, 0.0\] at t = 0 s"),
    ("servo", lambda t, x, memory, p: x[0] > 0, r"np.False_ at t = 0 s"),
    ("servo", returning("a"), "'a' at t = 0 s"),
    ("two_link_arm", returning((1.0, 2.0, 3.0)), r"\(1.0, 2.0, 3.0\) at t = 0 s"),
    ("two_link_arm", returning((1.0,)), r"\(1.0,\) at t = 0 s"),
    ("two_link_arm", nothing_later, "0.0 at t = 0 s|0 at t = 0 s"),
]


@each_engine
@pytest.mark.parametrize(("kind", "looped"), [("corrected", False), ("physics", True)])
@pytest.mark.parametrize(("system", "law", "words"), WRONG)
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


# Compiling.


def uncompiled(t: float, x: Any, memory: Any, p: Any) -> float:
    return 2.0


uncompiled.python_only = True  # pyright: ignore[reportFunctionMemberAccess]


def test_a_law_for_python_only_stays_so_whatever_is_put_around_it() -> None:
    mine, system = controller(uncompiled), physics("servo").system
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
        (unknown_to_numba, r"^test_law_errors.py:\d+: numba cannot compile the law: Unknown attr"),
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

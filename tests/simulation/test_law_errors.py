"""Laws of one's own that go wrong: one line with file, line and instant, in both engines."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable
from functools import cache, partial
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


def run(law: Any, system: str, kind: str, engine: Engine, *, looped: bool = False) -> gm.Trajectory:
    """A few samples of a law on a plant at rest, weighed by the system's index."""
    plant = physics(system)
    like = gm.chapter_controller("lqr", plant.analytic())
    mine = gm.custom_controller("mine", law, like, {"a": np.zeros(2)})
    mine = in_loop(mine, Loop(), plant.system) if looped else mine
    target = plant if kind == "physics" else plant.analytic()
    x0 = np.zeros(len(plant.system.states))
    return gm.simulate(target, mine, x0, duration=0.01, engine=engine)


# Indices.


def beyond_the_state(t: float, x: Any, memory: Any, p: Any) -> float:
    return x[4000 if t > LATE else 0]


def beyond_the_memory(t: float, x: Any, memory: Any, p: Any) -> float:
    return memory.v[7]


def beyond_the_numbers(t: float, x: Any, memory: Any, p: Any) -> float:
    return p.a[2]


@numba.njit
def entry(x: Any, i: int) -> float:
    return x[i]


def beyond_in_a_helper(t: float, x: Any, memory: Any, p: Any) -> float:
    return entry(x, 400)


@numba.njit
def beyond_and_compiled(t: float, x: Any, memory: Any, p: Any) -> float:
    return x[400]


BEYOND = (beyond_the_state, beyond_the_memory, beyond_the_numbers)


@each_engine
@each_kind
@pytest.mark.parametrize("law", [*BEYOND, beyond_in_a_helper, beyond_and_compiled])
def test_an_index_out_of_bounds_is_told_with_its_line(
    law: Any, kind: str, engine: Engine, capfd: pytest.CaptureFixture[str]
) -> None:
    source, first = inspect.getsourcelines(getattr(law, "py_func", law))
    line = first + len(source) - 1
    t = "0.006" if law is beyond_the_state else "0"
    with pytest.raises(ArgumentError) as error:
        run(law, "servo", kind, engine)
    told = rf"test_law_errors.py:{line}: IndexError: .*\(mine at t = {t} s\)"
    assert re.fullmatch(told, str(error.value))
    assert capfd.readouterr().err == ""


@each_kind
def test_a_negative_index_counts_from_the_end_in_both_engines(kind: str) -> None:
    def last(t: float, x: Any, memory: Any, p: Any) -> float:
        return 1.0 - x[-1] - x[-2]

    native, python = (run(last, "servo", kind, engine) for engine in ("native", "python"))
    assert np.any(native.state[-1])
    assert np.array_equal(native.state, python.state)


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


def whole_state(t: float, x: Any, memory: Any, p: Any) -> Any:
    return x


def truth(t: float, x: Any, memory: Any, p: Any) -> Any:
    return x[0] > 0


@each_engine
def test_whole_numbers_are_inputs(engine: Engine) -> None:
    run_ = run(lambda t, x, memory, p: (3, -1), "two_link_arm", "physics", engine)
    assert run_.command[-1].tolist() == [3.0, -1.0]


WRONG = [
    ("servo", nothing_later, "None at t = 0.006 s"),
    ("servo", whole_state, r"\[0.0, 0.0\] at t = 0 s"),
    ("servo", truth, r"np.False_ at t = 0 s"),
    ("servo", returning(1j), "1j at t = 0 s"),
    ("servo", returning("a"), "'a' at t = 0 s"),
    ("servo", returning((1.0, 2.0)), r"\(1.0, 2.0\) at t = 0 s"),
    ("two_link_arm", returning((1.0, 2.0, 3.0)), r"\(1.0, 2.0, 3.0\) at t = 0 s"),
    ("two_link_arm", returning((1.0,)), r"\(1.0,\) at t = 0 s"),
    ("two_link_arm", nothing_later, "0.0 at t = 0 s|0 at t = 0 s"),
]


@each_engine
@pytest.mark.parametrize(("kind", "looped"), [("corrected", False), ("physics", True)])
@pytest.mark.parametrize(("system", "law", "said"), WRONG)
def test_a_value_that_is_no_input_is_told_at_its_instant(
    system: str, law: Any, said: str, looped: bool, kind: str, engine: Engine, capfd: Any
) -> None:
    wanted = "a number" if system == "servo" else "a tuple of 2 numbers"
    with pytest.raises(ArgumentError, match=f"^mine returned ({said}), must return {wanted}$"):
        run(law, system, kind, engine, looped=looped)
    assert capfd.readouterr().err == ""


def uncompiled(t: float, x: Any, memory: Any, p: Any) -> float:
    return 2.0


uncompiled.python_only = True  # pyright: ignore[reportFunctionMemberAccess]


def test_a_law_for_python_only_stays_so_whatever_is_put_around_it() -> None:
    like = gm.chapter_controller("lqr", nominal())
    mine = gm.custom_controller("mine", uncompiled, like)
    around = [mine, in_loop(mine, Loop(), like.designed.error.system)]
    around += [guarded(law, like.designed.error.system) for law in around]
    for law in around:
        found = gm.simulate(nominal(), law, [0.0, 0.0], duration=0.01, engine="python")
        assert found.command[-1] == 2.0
        with pytest.raises(ArgumentError, match="mine runs in Python only"):
            gm.simulate(nominal(), law, [0.0, 0.0], duration=0.01)


@each_engine
@each_kind
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_an_input_that_is_not_finite_ends_the_run_where_it_is(
    value: float, kind: str, engine: Engine
) -> None:
    with pytest.raises(UndefinedLawError, match="the law returned no finite number") as told:
        run(returning(value, LATE), "servo", kind, engine)
    assert told.value.time == pytest.approx(0.006, abs=1e-12)
    assert np.all(np.isfinite(told.value.trajectory.state))


def nominal() -> gm.AnalyticPlant:
    return physics("servo").analytic()


# Compiling.


def slow_product(t: float, x: Any, memory: Any, p: Any) -> float:
    """The product of a row that is not contiguous, which numba warns of."""
    rows = np.zeros((2, 4))
    return np.dot(rows[:, ::2], x)[0]


@pytest.mark.filterwarnings("error")
def test_numbas_warnings_reach_nobody(capfd: pytest.CaptureFixture[str]) -> None:
    run(slow_product, "servo", "physics", "native")
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
    ("law", "said"),
    [
        (unknown_to_numba, r"^test_law_errors.py:\d+: numba cannot compile the law: Unknown attr"),
        (names_nothing, "NameError: name 'nowhere' is not defined"),
        (remembers_a_list, "begin it as a list of numbers"),
        (lacks_a_field, r"memory or p has no such field: write memory = \{ missing = 0 \}"),
        (partial(Pushes()), "numba cannot compile the law"),
        (Pushes(), "numba cannot compile the law"),
    ],
    ids=["attribute", "name", "list", "field", "partial", "object"],
)
def test_a_law_that_numba_cannot_compile_is_told_in_one_line(law: Any, said: str) -> None:
    like = gm.chapter_controller("lqr", nominal())
    mine = gm.custom_controller("mine", law, like, memory={"kept": 0.0})
    with pytest.raises(ArgumentError, match=said) as told:
        gm.simulate(physics("servo"), mine, [0.0, 0.0], duration=0.01)
    assert str(told.value).endswith('; engine = "python" runs it uncompiled')
    assert "\n" not in str(told.value)
    if law is not remembers_a_list:
        gm.simulate(physics("servo"), mine, [0.0, 0.0], duration=0.01, engine="python")


@pytest.mark.parametrize("law", BEYOND)
def test_a_law_of_a_plain_controller_is_checked_too(law: Any) -> None:
    like = gm.chapter_controller("lqr", nominal())
    numbers = gm.custom_controller("mine", law, like, {"a": np.zeros(2)}).parameters
    with pytest.raises(ArgumentError, match="IndexError"):
        gm.simulate(
            physics("servo"), Controller("mine", law, numbers, like.memory), [0, 0], duration=0.01
        )

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


def later(value: Any) -> Callable[..., Any]:
    def law(t: float, x: Any, memory: Any, p: Any) -> Any:
        if t > LATE:
            return value
        return 0.0

    return law


def nothing_later(t: float, x: Any, memory: Any, p: Any) -> float | None:
    if t > LATE:
        return None
    return 0.0


def whole_state(t: float, x: Any, memory: Any, p: Any) -> Any:
    return x


def truths(t: float, x: Any, memory: Any, p: Any) -> Any:
    return x > 0


def truth(t: float, x: Any, memory: Any, p: Any) -> Any:
    return x[0] > 0


def imaginary(t: float, x: Any, memory: Any, p: Any) -> complex:
    return 1j


def text(t: float, x: Any, memory: Any, p: Any) -> str:
    return "a"


def pair(t: float, x: Any, memory: Any, p: Any) -> tuple[float, float]:
    return (1.0, 2.0)


def triple(t: float, x: Any, memory: Any, p: Any) -> tuple[float, float, float]:
    return (1.0, 2.0, 3.0)


def single(t: float, x: Any, memory: Any, p: Any) -> tuple[float]:
    return (1.0,)


@each_engine
@each_kind
def test_whole_numbers_are_inputs(kind: str, engine: Engine) -> None:
    def law(t: float, x: Any, memory: Any, p: Any) -> tuple[int, int]:
        return (3, -1)

    assert run(law, "two_link_arm", kind, engine).command[-1].tolist() == [3.0, -1.0]


WRONG = [
    ("servo", nothing_later, "None at t = 0.006 s"),
    ("servo", whole_state, r"\[0.0, 0.0\] at t = 0 s"),
    ("servo", truths, r"\[False, False\] at t = 0 s"),
    ("servo", truth, r"np.False_ at t = 0 s"),
    ("servo", imaginary, "1j at t = 0 s"),
    ("servo", text, "'a' at t = 0 s"),
    ("servo", pair, r"\(1.0, 2.0\) at t = 0 s"),
    ("two_link_arm", triple, r"\(1.0, 2.0, 3.0\) at t = 0 s"),
    ("two_link_arm", single, r"\(1.0,\) at t = 0 s"),
    ("two_link_arm", truth, r"np.False_ at t = 0 s"),
    ("two_link_arm", nothing_later, "0.0 at t = 0 s|0 at t = 0 s"),
]


@each_engine
@each_kind
@pytest.mark.parametrize("looped", [False, True])
@pytest.mark.parametrize(("system", "law", "said"), WRONG)
def test_what_is_no_input_is_told_at_its_instant(
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
        run(later(value), "servo", kind, engine)
    assert told.value.time == pytest.approx(0.006, abs=1e-12)
    assert told.value.trajectory.status is gm.simulation.Status.UNDEFINED_INPUT
    assert np.all(np.isfinite(told.value.trajectory.state))


@each_engine
@each_kind
def test_in_a_batch_it_is_a_status_and_harms_no_other(kind: str, engine: Engine) -> None:
    def beside(t: float, x: Any, memory: Any, p: Any) -> float:
        return math.nan if x[0] > 0.5 else 0.0

    plant = physics("servo") if kind == "physics" else physics("servo").analytic()
    mine = gm.custom_controller("mine", beside, gm.chapter_controller("lqr", nominal()))
    runs = gm.simulate(plant, mine, [[0.0, 0.0], [1.0, 0.0]], duration=0.01, engine=engine)
    assert list(runs.status) == [
        gm.simulation.Status.COMPLETED,
        gm.simulation.Status.UNDEFINED_INPUT,
    ]
    assert runs.valid_until.tolist() == pytest.approx([0.01, 0.0])


def nominal() -> gm.AnalyticPlant:
    return physics("servo").analytic()


# Compiling.


def slow_product(t: float, x: Any, memory: Any, p: Any) -> float:
    """The product of a row that is not contiguous, which numba warns of."""
    rows = np.zeros((2, 4))
    return np.dot(rows[:, ::2], x)[0]


def unknown_to_numba(t: float, x: Any, memory: Any, p: Any) -> float:
    return float(sum(x.tolist()))


@pytest.mark.filterwarnings("error")
def test_numbas_warnings_reach_nobody(capfd: pytest.CaptureFixture[str]) -> None:
    run(slow_product, "servo", "physics", "native")
    assert capfd.readouterr().err == ""


@each_kind
def test_a_law_that_numba_cannot_compile_is_told_in_one_line(kind: str) -> None:
    said = r"^test_law_errors.py:\d+: numba cannot compile this: .*; engine = \"python\" runs it"
    with pytest.raises(ArgumentError, match=said) as told:
        run(unknown_to_numba, "servo", kind, "native")
    assert "\n" not in str(told.value)
    run(unknown_to_numba, "servo", kind, "python")


def names_nothing(t: float, x: Any, memory: Any, p: Any) -> float:
    return -x[0] if t < 1.0 else nowhere * x[0]  # pyright: ignore[reportUndefinedVariable] # noqa: F821


def remembers_a_list(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.kept = [t, x[0]]
    return 0.0


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (names_nothing, r"test_law_errors.py:\d+: name 'nowhere' is not defined"),
        (remembers_a_list, "begin it as a list of numbers"),
    ],
)
def test_what_numba_says_pages_about_is_said_in_a_few_words(law: Any, said: str) -> None:
    like = gm.chapter_controller("lqr", nominal())
    mine = gm.custom_controller("mine", law, like, memory={"kept": 0.0})
    with pytest.raises(ArgumentError, match=said):
        gm.simulate(physics("servo"), mine, [0.0, 0.0], duration=0.01)


@pytest.mark.parametrize("law", BEYOND)
def test_a_law_given_straight_to_a_controller_is_checked_too(law: Any) -> None:
    like = gm.chapter_controller("lqr", nominal())
    numbers = gm.custom_controller("mine", law, like, {"a": np.zeros(2)}).parameters
    mine = Controller("mine", law, numbers, like.memory)
    with pytest.raises(ArgumentError, match="IndexError"):
        gm.simulate(physics("servo"), mine, [0.0, 0.0], duration=0.01)


class Pushes:
    """A law that is no function."""

    def __call__(self, t: float, x: Any, memory: Any, p: Any) -> float:
        return 2.0


@pytest.mark.parametrize("law", [partial(Pushes()), Pushes()], ids=["partial", "object"])
def test_what_is_called_and_is_no_function_runs_uncompiled_only(law: Any) -> None:
    assert run(law, "servo", "corrected", "python").command[-1] == 2.0
    with pytest.raises(gm.GrosmcError, match='engine = "python" runs it uncompiled') as told:
        run(law, "servo", "corrected", "native")
    assert "\n" not in str(told.value)

"""Laws of one's own: their memory, and one line with file, line and instant if they fail."""

from __future__ import annotations

import inspect
import math
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grosmc_mj as gm
from grosmc_mj.ground.errors import ArgumentError, UndefinedLawError
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.simulation.simulate import Engine
from grosmc_mj.studies.region.runs import guarded
from grosmc_mj.theory.control.controller import Controller

ENGINES: Any = ("native", "python")
each_engine = pytest.mark.parametrize("engine", ENGINES)
LATE = 0.005
HERE = Path(__file__).name


@cache
def physics(system: str = "servo") -> gm.MujocoPlant:
    return gm.MujocoPlant.load(system)


def controller(
    law: Any, system: str = "servo", memory: Any = None, numbers: Any = None
) -> Controller:
    like = gm.chapter_controller("lqr", physics(system).analytic())
    return gm.custom_controller("mine", law, like, numbers or {"a": np.zeros(2)}, memory)


def run(
    law: Any, kind: str, engine: Engine, system: str = "servo", loop: Loop | None = None
) -> gm.Trajectory:
    """A few samples of a law on a plant at rest."""
    plant = physics(system)
    target = plant if kind == "physics" else plant.analytic()
    if not isinstance(law, Controller):
        law = controller(law, system)
    x0 = np.zeros(len(plant.system.states))
    return gm.simulate(target, law, x0, duration=0.01, loop=loop, engine=engine)


# Laws that fail, or return something else than one input, then than two


def beyond_the_state(t: float, x: Any, memory: Any, p: Any) -> float:
    return x[4000 if t > LATE else 0]


def nothing_later(t: float, x: Any, memory: Any, p: Any) -> float | None:
    if t > LATE:
        return None
    return 0.0


def infinite_later(t: float, x: Any, memory: Any, p: Any) -> float:
    return -math.inf if t > LATE else 0.0


def one_input(t: float, x: Any, memory: Any, p: Any) -> tuple[float]:
    return (1.0,)


def without_its_number(t: float, x: Any, memory: Any, p: Any) -> float:
    return p.k * x[0]


def without_its_memory(t: float, x: Any, memory: Any, p: Any) -> float:
    return memory.kept * x[0]


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (without_its_number, "p has no 'k': give it as k = 0 beside the law"),
        (without_its_memory, r"memory has no 'kept': give it as memory = \{ kept = 0 \} beside"),
    ],
)
def test_a_law_that_lacks_a_number_is_told_how_to_give_it(law: Any, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        run(law, "corrected", "python")


def last_line_of(law: Any) -> int:
    lines, first = inspect.getsourcelines(law)
    return first + len(lines) - 1


WRONG_LAWS = [
    (
        "servo",
        beyond_the_state,
        rf"{HERE}:{last_line_of(beyond_the_state)}: IndexError: .*\(mine at t = 0.006 s\)",
    ),
    (
        "servo",
        nothing_later,
        r"mine returned (None at t = 0.006 s), must return a number",
    ),
    (
        "two_link_arm",
        one_input,
        r"mine returned (\(1.0,\) at t = 0 s), must return a tuple of 2 numbers",
    ),
]


@each_engine
@pytest.mark.parametrize("loop", [None, Loop()])
@pytest.mark.parametrize(("system", "law", "words"), WRONG_LAWS)
def test_a_wrong_law_is_refused_in_one_line(
    system: str,
    law: Any,
    words: str,
    loop: Loop | None,
    engine: Engine,
    capfd: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(ArgumentError) as error:
        run(controller(law, system), "corrected", engine, system, loop)
    assert re.fullmatch(words, str(error.value))
    assert capfd.readouterr().err == ""


@each_engine
@pytest.mark.parametrize("kind", ["corrected", "physics"])
def test_an_input_that_is_not_finite_ends_the_run_where_it_is(kind: str, engine: Engine) -> None:
    with pytest.raises(UndefinedLawError, match="the law returned no finite number") as ended:
        run(infinite_later, kind, engine)
    assert ended.value.time == pytest.approx(0.006, abs=1e-12)
    assert np.all(np.isfinite(ended.value.trajectory.state))


@each_engine
def test_integers_are_inputs(engine: Engine) -> None:
    arm = run(lambda t, x, memory, p: (3, -1), "physics", engine, "two_link_arm")
    assert arm.command[-1].tolist() == [3.0, -1.0]


@each_engine
def test_a_negative_index_counts_from_the_end(engine: Engine) -> None:
    servo = run(lambda t, x, memory, p: 1.0 - x[-2], "physics", engine)
    np.testing.assert_array_equal(servo.command, 1.0 - servo.state[:-1, 0])


# Compiling


def uncompiled(t: float, x: Any, memory: Any, p: Any) -> float:
    return 2.0


uncompiled.python_only = True  # pyright: ignore[reportFunctionMemberAccess]


@pytest.mark.parametrize("around", [lambda law: law, lambda law: guarded(law, physics().system)])
@pytest.mark.parametrize("loop", [None, Loop()])
def test_a_law_for_python_only_stays_so_whatever_is_put_around_it(
    around: Any, loop: Loop | None
) -> None:
    law = around(controller(uncompiled))
    assert run(law, "corrected", "python", loop=loop).command[-1] == 2.0
    with pytest.raises(ArgumentError, match="mine runs in Python only"):
        run(law, "corrected", "native", loop=loop)


def unknown_to_numba(t: float, x: Any, memory: Any, p: Any) -> float:
    return float(sum(x.tolist()))


def names_nothing(t: float, x: Any, memory: Any, p: Any) -> float:
    return -x[0] if t < 1.0 else nowhere * x[0]  # pyright: ignore[reportUndefinedVariable] # noqa: F821


def remembers_a_list(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.kept = [t, x[0]]
    return 0.0


def lacks_a_field(t: float, x: Any, memory: Any, p: Any) -> float:
    return memory.missing if t > 1.0 else 0.0


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (unknown_to_numba, rf"^{HERE}:\d+: numba cannot compile the law: Unknown attr"),
        (names_nothing, "NameError: name 'nowhere' is not defined"),
        (remembers_a_list, "begin it as a list of numbers"),
        (lacks_a_field, r"memory or p has no such field: write memory = \{ missing = 0 \}"),
    ],
)
def test_a_law_that_numba_cannot_compile_is_refused_in_one_line(law: Any, words: str) -> None:
    mine = controller(law, memory={"kept": 0.0})
    with pytest.raises(ArgumentError, match=words) as refused:
        run(mine, "physics", "native")
    assert str(refused.value).endswith('; engine = "python" runs it uncompiled')
    assert "\n" not in str(refused.value)


def test_a_law_that_numba_cannot_compile_runs_in_python() -> None:
    run(controller(unknown_to_numba), "physics", "python")


# Memory


def pid(t: float, x: Any, memory: Any, p: Any) -> float:
    """PI with anti-windup on the angle; the rate is a mean over the last samples."""
    for i in range(len(memory.past) - 1, 0, -1):
        memory.past[i] = memory.past[i - 1]
    memory.past[0] = x[1]

    e = 1.0 - x[0]
    rate = 0.0
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


def run_with_pid(engine: Engine) -> gm.Trajectory:
    law = with_pid(integral=0.0, past=np.zeros(8))
    return gm.simulate(physics(), law, [0.0, 0.0], duration=1.0, engine=engine)


def test_both_engines_remember_the_same_bit_for_bit() -> None:
    native = run_with_pid("native")
    python = run_with_pid("python")
    np.testing.assert_array_equal(native.state, python.state)
    np.testing.assert_array_equal(native.memory, python.memory)


def with_powers(t: float, x: Any, memory: Any, p: Any) -> float:
    whole = (1.1 - x[0]) ** 3 - (1.2 - x[0]) ** 2.0 - x[1]
    return whole + math.pow(2.0, -x[1]) - abs(x[0]) ** 1.5


def _inner(a: float) -> float:
    return a - 0.25


def _helper(a: float) -> float:
    return 2.0 * _inner(a)


def with_helpers(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = -_helper(x[0]) - math.fmod(3.0 * x[1], 0.7)


@pytest.mark.parametrize("law", [with_powers, with_helpers])
def test_powers_helpers_and_fmod_mean_the_same_in_both_engines(law: Any) -> None:
    """Powers are those of the C library: compilers would take products, which round otherwise."""
    mine = controller(law)
    native, python = [
        gm.simulate(physics(), mine, [0.3, 0.0], duration=0.3, engine=engine) for engine in ENGINES
    ]
    np.testing.assert_array_equal(native.state, python.state)
    np.testing.assert_array_equal(native.command, python.command)


def test_a_memory_is_recorded_row_by_row_at_the_samples() -> None:
    run = run_with_pid("native")
    np.testing.assert_array_equal(run.memory["past"][10], run.state[3:11, 1][::-1])


def test_an_integral_stands_still_at_the_limit_of_the_input() -> None:
    run = run_with_pid("native")
    free = np.abs(run.input) < 3.0
    assert np.any(free[1:] & ~free[:-1])
    expected = 1e-3 * np.cumsum(free * (1.0 - run.state[:-1, 0]))
    np.testing.assert_allclose(run.memory["integral"], expected, atol=1e-12)


def test_a_run_of_a_batch_begins_with_its_own_memory() -> None:
    law = with_pid(integral=0.25, past=np.ones(8))
    run: Any = gm.simulate(physics(), law, [[0.0, 1.0]] * 2, duration=0.01)
    np.testing.assert_array_equal(run.memory[0], run.memory[1])


@pytest.mark.parametrize(
    ("memory", "words"),
    [
        ({"v": 0.0}, "'v' cannot be the name"),
        ({"past": [0.0, np.nan]}, "past = .* must be finite"),
        ({"past": "0"}, "past = "),
    ],
)
def test_a_memory_that_cannot_be_is_refused(memory: dict[str, Any], words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        with_pid(**memory)

"""Python that has C: what operators mean, what is refused, and names that C takes."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import (
    compiled,
    differing_samples,
    function_in,
    needs_compiler,
    of_ones_own,
    states_about_start,
)

from grosmc_mj.export.compiler import FLAGS, CompiledLaw
from grosmc_mj.export.law import UNDEFINED_LAW
from grosmc_mj.export.syntax import ExportError
from grosmc_mj.ground.arrays import Array

ROWS = np.array([[1.0, 2.0], [3.0, 4.0]])


def _first(row: Any) -> float:
    return row[0]


def _counted(memory: Any) -> float:
    memory.k += 1
    return memory.k


def operators(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    """A law that keeps the value of each operator."""
    k = int(memory.k)
    results = memory.results
    results[0] = x[0] or 3.0
    results[1] = x[0] or 0.0
    results[2] = (x[0] and x[1]) or -p.most
    results[3] = (0.0 or x[0]) + (2.0 and x[1])
    results[4] = float(x[0] > 0.0 and x[1]) + float(x[1] > 0.0 or x[0])
    # Products as conditions, and truth values as numbers.
    results[5] = x[0] if k * 2 and not x[1] * 2.0 >= 0.5 else bool(x[1]) + abs(k - 3)
    # Powers and products that a compiler would round otherwise.
    results[6] = 2.0 ** x[0] + 10.0 ** x[1] + math.pow(2.0, x[1])
    results[7] = x[0] ** 3 - x[1] ** 2 + (1.0 + abs(x[0])) ** -2 + abs(x[0]) ** 0.5
    # Remainders have the sign of the divisor, math.fmod that of the dividend.
    results[8] = (int(x[0] * 10.0) % 7) + (-k % 3)
    results[9] = math.fmod(x[0], 0.3)
    results[10] = _first(ROWS[0]) * x[0] + _first(ROWS[1]) * x[1]
    results[11] = math.floor(x[0] * 3.0) - 10 * math.ceil(x[1] * 3.0)
    results[12] = np.sign(x[0]) - 3.0 * np.sign(x[1]) + 7 * int(x[0] * 5.0)
    # A whole number of more than 32 bits.
    total = 0
    for i in range(3):
        total = i * 2_000_000_000
    u[0] = total * 1.0 + x[0]


def arrays_and_loops(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    """A law with what Python has besides sums."""
    k = int(memory.k) % 4
    memory.past[k] = x[0]
    memory.k += 1
    memory.other[1:] = memory.past[:-1]
    memory.results[1:][1:][0] = _first(memory.past[:-1][2:])
    memory.results[-1] = x[1]
    # The index changes with the value that is written.
    memory.results[3 + int(memory.k) % 4] = _counted(memory)
    memory.k -= 1
    # The end of a range is computed once.
    for _ in range(int(memory.k) % 3):
        memory.k += 1
    rooms = np.zeros((2, 2))
    for i in range(2):
        rooms[i, 1 - i] = x[i]
    total = 0.0
    for value in memory.past:
        total += value
        if total > 0.5:
            break
    j = 3
    while j >= 0 and memory.past[j & 3] > 0.2:
        j -= 1
    a, b = rooms[0, 1], rooms[1, 0]
    b, a = a, b
    mean = total / 4 if k > 0 else total
    u[0] = max(-p.most, min(mean, p.most)) + np.sign(a) * math.exp(-abs(b)) + 0.1 * j
    # A quotient of whole numbers is none.
    u[0] += j / 4
    for i in range(4, 1, -1):
        u[0] = 0.5 * u[0] + i


def constant_law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    """A law that reads nothing."""
    u[0] = p.most


def returning_law(t: float, x: Any, memory: Any, p: Any) -> float:
    """A law that remembers, and returns its input."""
    memory.k += 1
    t1 = x[0] * memory.k
    for k1 in memory.past:
        t1 += k1
    return t1 if t > 0.05 else -t1


@needs_compiler
@pytest.mark.parametrize("own", [arrays_and_loops, constant_law, returning_law])
def test_a_law_of_ones_own_in_c_is_the_python_one(own: Callable[..., Any], tmp_path: Path) -> None:
    law = of_ones_own(own)
    assert differing_samples(law, compiled(law, tmp_path), states_about_start()) == 0


@needs_compiler
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_operators_mean_in_c_what_they_mean_in_python(compiler: str, tmp_path: Path) -> None:
    path = shutil.which(compiler)
    if path is None:
        pytest.skip(f"{compiler} is not installed")
    law = of_ones_own(operators)
    x = states_about_start()
    x[3:6, 0] = 0.0
    x[5:9, 1] = -0.0
    optimized = compiled(law, tmp_path, path, [*FLAGS, "-O3"])
    assert differing_samples(law, optimized, x) == 0


def extremes(t: float, x: Any, memory: Any, p: Any) -> float:
    a = min(x[0], x[1])
    b = max(x[0], x[1])
    signs = math.copysign(1.0, a) + 3.0 * math.copysign(1.0, b)
    return signs + 9.0 * float(a == x[0]) + 18.0 * float(a == x[1]) + 36.0 * float(b == x[1])


@needs_compiler
def test_the_first_of_two_numbers_is_the_extreme_if_neither_is_beyond_the_other(
    tmp_path: Path,
) -> None:
    """As Python has it; fmin and fmax of C take the number beside NaN, and either zero."""
    law = of_ones_own(extremes)
    x = np.array([[0.0, -0.0], [-0.0, 0.0], [math.nan, 2.0], [2.0, math.nan]])
    python = [law.controller.input_at(0.0, row, law.controller.memory())[0] for row in x]
    assert python == [67.0, 59.0, 4.0, 13.0]
    assert differing_samples(law, compiled(law, tmp_path), x) == 0


def whole_part(t: float, x: Any, memory: Any, p: Any) -> float:
    return float(int(x[0]) % 7)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> CompiledLaw:
    return compiled(of_ones_own(whole_part), tmp_path_factory.mktemp("whole"))


@needs_compiler
@pytest.mark.parametrize(
    ("x", "answer"),
    [
        (math.nan, UNDEFINED_LAW),
        (math.inf, UNDEFINED_LAW),
        (2.0**63, UNDEFINED_LAW),
        (-(2.0**63), 0),
        (-8.5, 0),
    ],
)
def test_a_step_tells_that_int64_has_no_such_whole_number(
    x: float, answer: int, whole: CompiledLaw
) -> None:
    state: Array = np.array([x, 0.0])
    memory = np.zeros(len(of_ones_own(whole_part).memory.places))
    whole.begin(memory, state)
    u = np.zeros(1)
    assert whole.step(0.0, state, memory, u) == answer
    if not answer:
        assert u[0] == int(x) % 7


# Refusals: the body of a law, and what is said of it.

HEAD = """
import math

def counted(memory):
    memory.k += 1
    return memory.k

def without_end(a):
    if a > 1.0:
        return 1.0

def law(t, x, memory, p, u):
    """
REFUSED = [
    ("u[0] = sum([x[0], x[1]])", "mine.py:13: [x[0], x[1]]: has no C: use numbers, arrays, loops"),
    ("u[0] = memory.past[int(memory.k)]", "is not known to lie in 0 ... 3: write a loop over"),
    ("u[0] = memory.past[4]", "is not known to lie in 0 ... 3"),
    ("u[0] = p.gains @ x", "p.gains @ x: has no C: write a loop over entries"),
    ("p.gains[0] = x[0]", "would change a number of the law: write into memory"),
    ("u[0] = memory.nothing", "there is no 'nothing': name a field of memory or of the numbers"),
    ("law(t, x, memory, p, u)", "mine.py:12: law calls itself: write a loop"),
    ("u[0] = math.gamma(x[0])", "gamma has no C: write a loop, or use functions of math"),
    ("u[0] = memory.k + counted(memory)", "changes something: give it a line of its own before"),
    ("memory.past[:2] = memory.past[1], memory.past[0]", "moves entries of one array: write a"),
    ("for v in memory.past: memory.past[1] = v", "writes into the array that it runs over: write"),
    ("u[0] = counted()", "missing a required argument: 'memory'"),
    ("u[0] = x[0] % 1.0", "is for whole numbers: write math.fmod or math.floor"),
    ("u[0] = int(x[0]) % int(x[1])", "the divisor must be known to be positive"),
    ("u[0] = int(x[0]) % (int(x[1]) % 3)", "the divisor must be known to be positive"),
    ("for i in range(2): i = i + 1", "i has a value already: give this one another name"),
    ("i = 7\n    for i in range(2): u[0] = i", "i has a value already: give the loop another"),
    ("for i in range(x[0]): u[0] = x[i % 2]", "range takes whole numbers: write int"),
    ("for _ in range(int(memory.k), 3, 0): u[0] = 1.0", "arg 3 must not be zero"),
    ("u[0] = x[0] * 10**30", "is a whole number of more than 64 bits: write it as a float"),
    ("u[0] = without_end(x[0])", "mine.py:8: without_end does not always return a value: end it"),
    ("x[0] + 1.0", "has no effect: leave it out"),
]


@pytest.mark.parametrize(("body", "words"), REFUSED)
def test_what_has_no_c_is_refused_with_its_line(body: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match=r"mine\.py:\d+: ") as refused:
        _ = of_ones_own(function_in(HEAD + body, tmp_path / "mine.py")).source
    assert words in str(refused.value)


def test_a_law_that_is_nested_too_deep_is_refused(tmp_path: Path) -> None:
    text = f"def wide(t, x, memory, p, u):\n    u[0] = {' + '.join(['x[0]'] * 700)}\n"
    with pytest.raises(ExportError, match="wide is nested too deep: write its longest expressions"):
        _ = of_ones_own(function_in(text, tmp_path / "wide.py", "wide")).source


# Names.

NAMES = "round main NAN pow pow_ floor M_PI y0 gamma fabs min_ table_1 t1_ double int8_t INT64_MIN"
NAMES = (NAMES + " out state printf index free _ ä").split()


def functions_of_these_names() -> str:
    functions = "".join(f"def {name}(a):\n    return {k}.0 * a\n" for k, name in enumerate(NAMES))
    nested = "@njit\ndef _2nd(a):\n    return gamma(a)\n"
    total = " + ".join(f"{name}(x[{k % 2}])" for k, name in enumerate(NAMES))
    law = f"def law(t, x, memory, p, u):\n    u[0] = _2nd(x[0]) + {total}\n"
    return f"from numba import njit\n{functions}{nested}{law}"


def variables_of_these_names() -> str:
    lines = ["def law(t, x, memory, p, u):"]
    for k, name in enumerate(NAMES):
        lines.append(f"    {name} = x[0] * {k}.0")
        lines.append(f"    {name}_ = x[1] - {name}")
        lines.append(f"    {name}_v = {name}_ * {name}")
        lines.append(f"    u[0] += {name}_v + abs({name}_)")
    return "\n".join(lines)


@needs_compiler
@pytest.mark.parametrize("text", [functions_of_these_names(), variables_of_these_names()])
def test_a_name_that_c_takes_is_another_one_there(text: str, tmp_path: Path) -> None:
    law = of_ones_own(function_in(text, tmp_path / "named.py"))
    assert differing_samples(law, compiled(law, tmp_path), states_about_start()) == 0


@needs_compiler
def test_a_long_law_is_translated(tmp_path: Path) -> None:
    lines = [f"    v{k + 1} = v{k} + x[1] * {k}.0" for k in range(400)]
    text = "\n".join(["def law(t, x, memory, p, u):", "    v0 = x[0]", *lines, "    u[0] = v400"])
    law = of_ones_own(function_in(text, tmp_path / "long.py"))
    assert differing_samples(law, compiled(law, tmp_path), np.ones((3, 2))) == 0

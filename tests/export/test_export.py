"""Laws as C: equal to the Python law in every bit, as strict compilers take them, or refused."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grosmc_mj
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.export.compiler import FLAGS, CompiledLaw, compile_law, find_compiler, write_law
from grosmc_mj.export.law import UNDEFINED_INPUT, UNDEFINED_LAW, LawInC
from grosmc_mj.export.proof import prove
from grosmc_mj.export.samples import compare_at_samples
from grosmc_mj.export.syntax import ExportError
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import SetupError
from grosmc_mj.theory.control.controller import Controller, custom_controller
from grosmc_mj.theory.control.switching import SWITCHINGS

SAMPLES = 200
COMPILER = find_compiler()
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")
has_fma = "fma" in Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else False

CASES = {
    "servo/case1": ("lqr", "grosmc"),
    "cart_pendulum/case2": ("lqr", "fl-lqr", "grosmc"),
    "arm/case1": ("lqr", "grosmc"),
    "two_link_arm/case1": ("lqr", "pd", "grosmc"),
    "two_link_arm/bench": ("lqr", "sign"),
    "rivals/servo": ("lqi", "fl-pid", "adrc", "adaptive"),
    "rivals/cart_pendulum": ("lqi", "fl-pid", "adrc"),
    "rivals/arm": ("lqi", "fl-pid", "adrc", "adaptive"),
    "rivals/two_link_arm": ("lqi", "fl-pid", "adrc", "adaptive"),
    "own_laws/pid": ("pid",),
    "own_laws/looked_up": ("looked_up",),
    "own_laws/from_positions": ("from_positions",),
    "own_laws/transfer_function": ("lead",),
    "ball_beam/sine": ("fl-lqr", "grosmc"),
    "maglev/warm": ("grosmc",),
    "furuta/heavier": ("grosmc",),
}
SYSTEMS = ("servo/case1", "cart_pendulum/case2", "arm/case1", "two_link_arm/case1")
LAWS = [pytest.param(case, law, {}, id=f"{case}-{law}") for case in CASES for law in CASES[case]]
SWITCHED = [
    pytest.param(case, "grosmc", {"switching": how, "surface": "discrete"}, id=f"{case}-{how}")
    for case in SYSTEMS
    for how in SWITCHINGS
]


def law_of(target: str, name: str, real: str = "double", **settings: Any) -> LawInC:
    experiment = Experiment.load(target)
    if settings:
        experiment = experiment.changed(**settings)
    controller = experiment.law(experiment.nominal.truest, name)
    return exported(experiment, controller, real)


def exported(experiment: Experiment, controller: Controller, real: str = "double") -> LawInC:
    return LawInC(
        controller,
        "law_in_c",
        experiment.nominal.system,
        experiment.settings.control_period,
        ["A law."],
        real,
    )


def compiled(law: LawInC, folder: Path, compiler: str | None = COMPILER) -> CompiledLaw:
    assert compiler is not None
    write_law(law, folder)
    return compile_law(law, folder, compiler)


def states_about_start(target: str) -> Array:
    """States about the start of a case, (SAMPLES, n)."""
    x0 = np.array(Experiment.load(target).x0)
    random = np.random.default_rng(1)
    return x0 + 0.3 * random.normal(size=(SAMPLES, len(x0)))


def differing_samples(law: LawInC, compiled: CompiledLaw, x: Array) -> int:
    """Number of samples in which C and Python law differ in any bit of inputs or memory."""
    return compare_at_samples(law, compiled, [x]).different


def answer_at(law: LawInC, compiled: CompiledLaw, state: Any) -> int:
    """Answer of the first step of a run."""
    memory = np.zeros(len(law.memory.places))
    x = np.array(state, float)
    compiled.begin(memory, x)
    return compiled.step(0.0, x, memory, np.zeros(len(law.system.inputs)))


# Equality.


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize(("target", "name", "settings"), [*LAWS, *SWITCHED])
def test_a_law_in_c_is_the_python_law_to_the_last_bit(
    target: str, name: str, settings: dict[str, str], compiler: str, tmp_path: Path
) -> None:
    path = shutil.which(compiler)
    if path is None:
        pytest.skip(f"{compiler} is not installed")
    law = law_of(target, name, **settings)
    assert differing_samples(law, compiled(law, tmp_path, path), states_about_start(target)) == 0


@needs_compiler
@pytest.mark.skipif(not has_fma, reason="this processor has no fused multiply-add")
def test_contraction_differs_so_the_comparison_can_fail(tmp_path: Path) -> None:
    law = law_of("two_link_arm/case1", "grosmc")
    _, source = write_law(law, tmp_path)
    text = source.read_text(encoding="utf-8")
    source.write_text(text.replace("fp-contract=off", "fp-contract=fast"), encoding="utf-8")
    flags = ["-std=gnu99", "-O2", "-mfma", "-ffp-contract=fast"]
    assert COMPILER is not None
    contracted = compile_law(law, tmp_path, COMPILER, flags)
    assert differing_samples(law, contracted, states_about_start("two_link_arm/case1")) > 0


@needs_compiler
def test_fast_math_is_refused_by_the_file_itself(tmp_path: Path) -> None:
    law = law_of("servo/case1", "grosmc")
    write_law(law, tmp_path)
    assert COMPILER is not None
    with pytest.raises(SetupError, match="-ffast-math changes the law"):
        compile_law(law, tmp_path, COMPILER, [*FLAGS, "-ffast-math"])


MAIN = """
#include "law_in_c.h"
extern const @real ones[4];
const @real ones[4] = {1, 1, 1, 1};
int main(void)
{
    struct law_in_c_memory memory;
    @real signals[@n];
    @real u[2];
    law_in_c_init(@init);
    for (int k = 0; k < 1000; k++) {
        for (int i = 0; i < @n; i++) {
            signals[i] = (@real)0.001 * k + (@real)0.3 * i;
        }
        if (law_in_c_step(@step, &memory, u)) {
            return 1;
        }
    }
    return 0;
}
"""
LAW_ALONE = {"@init": "&memory", "@step": "k * (@real)0.001, signals"}
IN_LOOP = {"@init": "&memory, ones", "@step": "2 * k, signals, ones"}


def run_sanitized(law: LawInC, signals: int, calls: dict[str, str], folder: Path) -> None:
    """Run an export under sanitizers, which end it where they find something."""
    _, source = write_law(law, folder)
    text = MAIN
    for word, code in {**calls, "@real": law.real, "@n": str(signals)}.items():
        text = text.replace(word, code)
    main = folder / "main.c"
    main.write_text(text, encoding="utf-8")
    program = folder / "program"
    flags = [*FLAGS, "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    assert COMPILER is not None
    subprocess.run([COMPILER, *flags, main, source, "-o", program, "-lm"], check=True)
    subprocess.run([program], check=True)


@needs_compiler
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("target", ["servo/case1", "two_link_arm/case1"])
def test_sanitizers_find_nothing_in_a_law(real: str, target: str, tmp_path: Path) -> None:
    law = law_of(target, "grosmc", real, switching="adaptive")
    run_sanitized(law, len(law.system.states), LAW_ALONE, tmp_path)


# Decimal numbers of a C file; whole ones are sizes, indices and lines.
DECIMAL = re.compile(r"-?\b\d+(?:\.\d+(?:e[+-]?\d+)?|e[+-]?\d+)\b")


# Where a function stands: file and line.
SOURCE = re.compile(r"\[(\w+\.py):(\d+)\]")


def parted(source: str) -> tuple[str, list[float]]:
    """Return a C file without its decimal numbers and the lines of its sources; these numbers."""
    numbers = [float(number) for number in DECIMAL.findall(source)]
    return SOURCE.sub(r"[\1]", DECIMAL.sub("#", source)), numbers


def test_the_file_names_the_lines_where_functions_begin() -> None:
    source = law_of("servo/case1", "grosmc", switching="implicit").source
    package = Path(grosmc_mj.__file__).parent
    begins = []
    for file, number in SOURCE.findall(source):
        texts = [path.read_text(encoding="utf-8").splitlines() for path in package.rglob(file)]
        lines = [text[int(number) - 1].lstrip() for text in texts if len(text) >= int(number)]
        begins.append(any(line.startswith(("def ", "@")) for line in lines))
    assert begins
    assert all(begins)


def test_the_file_is_the_one_that_was_reviewed() -> None:
    """Text to the letter; numbers up to the rounding of LAPACK's Riccati solver.

    It leaves some 1e-15 of a gain, which depend on the processor. Other tests compare the numbers
    of a file with those of its law to the bit.
    """
    golden = Path(__file__).with_name("golden_law.c").read_text(encoding="utf-8")
    text, numbers = parted(law_of("servo/case1", "grosmc", switching="implicit").source)
    golden_text, golden_numbers = parted(golden)
    assert text == golden_text
    assert numbers == pytest.approx(golden_numbers, rel=1e-13, abs=0.0)


# Answers.


@needs_compiler
def test_a_step_tells_that_the_law_is_not_defined(tmp_path: Path) -> None:
    law = law_of("cart_pendulum/case2", "fl-lqr")
    beyond_horizontal = [0.0, math.pi / 2 + 0.1, 0.0, 0.0]
    assert answer_at(law, compiled(law, tmp_path), beyond_horizontal) == UNDEFINED_LAW


@needs_compiler
def test_a_step_tells_that_an_input_is_not_finite(tmp_path: Path) -> None:
    law = law_of("servo/case1", "lqr")
    assert answer_at(law, compiled(law, tmp_path), [math.nan, 0.0]) == UNDEFINED_INPUT


# Laws of one's own.


def own_law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    """A law with what Python has besides sums."""
    k = int(memory.k) % 4
    memory.past[k] = x[0]
    memory.k += 1
    memory.other[1:] = memory.past[:-1]
    rooms = np.zeros((2, 2))
    for i in range(2):
        rooms[i, 1 - i] = x[i]
    total = 0.0
    for value in memory.past:
        total += value
        if total > 10.0:
            break
    j = 3
    while j >= 0 and memory.past[j & 3] > 0.2:
        j -= 1
    a, b = rooms[0, 1], rooms[1, 0]
    b, a = a, b
    mean = total / 4 if k > 0 else total
    u[0] = max(-p.most, min(mean, p.most)) + np.sign(a) * math.exp(-abs(b)) + 0.1 * j


def _refused_list(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = sum([x[0], x[1]])


def _refused_index(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = memory.past[int(memory.k)]


def _refused_product(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = p.gains @ x


def _refused_number(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    p.gains[0] = x[0]


def _refused_field(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = memory.nothing


def _refused_recursion(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    _refused_recursion(t, x, memory, p, u)


def _refused_function(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = math.gamma(x[0])


def _counted(memory: Any) -> float:
    memory.k += 1
    return memory.k


def _refused_order(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = memory.k + _counted(memory)


def _refused_swap(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    memory.past[:2] = memory.past[1], memory.past[0]


def _refused_pass(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    for value in memory.past:
        memory.past[1] = x[0]
        u[0] += value


def _refused_arguments(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = _counted()  # type: ignore[reportCallIssue]


def _refused_remainder(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = x[0] % 1.0


def _refused_loop(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    for i in range(2):
        i = i + 1
        u[0] = x[i - 1]


def _refused_variable(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    i = 7
    for i in range(2):  # noqa: B007
        u[0] = x[0]
    u[0] = i


def _refused_name(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    if t > 1.0:
        x = memory.past
    u[0] = x[0]


def of_ones_own(law: Callable[..., Any]) -> LawInC:
    experiment = Experiment.load("servo/case1")
    like = experiment.law("physics", "lqr")
    memory = {"past": np.zeros(4), "other": np.zeros(4), "k": 0}
    numbers = {"most": 1.5, "gains": np.ones(2)}
    return exported(experiment, custom_controller("own", law, like, numbers, memory))


@needs_compiler
def test_a_law_of_ones_own_in_c_is_the_python_one(tmp_path: Path) -> None:
    law = of_ones_own(own_law)
    assert differing_samples(law, compiled(law, tmp_path), states_about_start("servo/case1")) == 0


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


def powers(t: float, x: Any, memory: Any, p: Any) -> float:
    """A law whose products a compiler would round otherwise."""
    return x[0] ** 3 - x[1] ** 2 + abs(x[0]) ** -2 + math.pow(2.0, x[1]) + abs(x[0]) ** 0.5


ROWS = np.array([[1.0, 2.0], [3.0, 4.0]])


def _first(row: Any) -> float:
    return row[0]


def rows_of_a_table(t: float, x: Any, memory: Any, p: Any) -> float:
    """A law that gives rows of a known table to a function."""
    return _first(ROWS[0]) * x[0] + _first(ROWS[1]) * x[1]


def entry_by_counter(t: float, x: Any, memory: Any, p: Any) -> float:
    """A law whose index changes with the value that is written."""
    memory.past[int(memory.k) % 4] = _counted(memory)
    return memory.past[0] - memory.past[1]


OWN_LAWS = [constant_law, returning_law, powers, rows_of_a_table, entry_by_counter]


@needs_compiler
@pytest.mark.parametrize("own", OWN_LAWS)
def test_short_laws_of_ones_own_are_the_python_ones(
    own: Callable[..., Any], tmp_path: Path
) -> None:
    law = of_ones_own(own)
    assert differing_samples(law, compiled(law, tmp_path), states_about_start("servo/case1")) == 0


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (_refused_list, r"\[x\[0\], x\[1\]\]: has no C: use numbers, arrays, loops"),
        (_refused_index, "is not known to lie in 0 ... 3: write a loop over range.4., or k % 4"),
        (_refused_product, "p.gains @ x: has no C: write a loop over entries"),
        (_refused_number, "would change a number of the law: write into memory"),
        (_refused_field, "there is no 'nothing': name a field of memory or of the numbers"),
        (_refused_recursion, "calls itself: write a loop"),
        (_refused_function, "gamma has no C: write a loop, or use functions of math"),
        (_refused_loop, "i has a value already: give this one another name"),
        (_refused_variable, "i has a value already: give the loop another name"),
        (_refused_name, "x has a value already: give this one another name"),
        (_refused_order, "changes something: give it a line of its own before"),
        (_refused_swap, "moves entries of one array: write a loop"),
        (_refused_pass, "writes into the array that it runs over: write a loop over range"),
        (_refused_arguments, "missing a required argument: 'memory'"),
        (_refused_remainder, "is for whole numbers: write math.fmod or math.floor"),
    ],
)
def test_what_has_no_c_is_refused_with_its_line(law: Callable[..., Any], words: str) -> None:
    with pytest.raises(ExportError, match=rf"test_export.py:\d+: .*{words}"):
        _ = of_ones_own(law).source


# In the kernel.


@needs_compiler
@pytest.mark.slow
def test_c_of_a_robots_law_computes_its_dynamics(tmp_path: Path) -> None:
    law = law_of("jaco/eight", "grosmc")
    proof = prove(Experiment.load("jaco/eight"), law, compiled(law, tmp_path), plants=0)
    assert proof.equal


@needs_compiler
@pytest.mark.slow
def test_c_and_python_law_make_the_same_runs(tmp_path: Path) -> None:
    law = law_of("servo/case1", "grosmc")
    proof = prove(Experiment.load("servo/case1"), law, compiled(law, tmp_path), plants=3)
    assert proof.equal
    assert (proof.runs, proof.random_plants) == (2, 3)
    assert [verdict.python.measured for verdict in proof.verdicts] == [
        verdict.in_c.measured for verdict in proof.verdicts
    ]


@needs_compiler
@pytest.mark.slow
def test_single_precision_differs_by_its_rounding(tmp_path: Path) -> None:
    law = law_of("servo/case1", "lqr", "float")
    proof = prove(Experiment.load("servo/case1"), law, compiled(law, tmp_path), plants=0)
    assert not proof.equal
    assert proof.largest is not None
    # 2^-24 of an input of 1 A, which the loop hardly amplifies.
    assert 0.0 < proof.largest.value < 1e-6
    assert proof.largest.unit == "A"
    assert proof.overturned == []


# Values that Python gives.


def _first_true(t: float, x: Any, memory: Any, p: Any) -> float:
    return x[0] or 3.0


def _last_false(t: float, x: Any, memory: Any, p: Any) -> float:
    return x[0] or 0.0


def _both(t: float, x: Any, memory: Any, p: Any) -> float:
    return (x[0] and x[1]) or -p.most


def _known_first(t: float, x: Any, memory: Any, p: Any) -> float:
    return (0.0 or x[0]) + (2.0 and x[1])


def _mixed(t: float, x: Any, memory: Any, p: Any) -> float:
    return float(x[0] > 0.0 and x[1]) + float(x[1] > 0.0 or x[0])


def _products_as_conditions(t: float, x: Any, memory: Any, p: Any) -> float:
    k = int(memory.k)
    memory.k += 1
    return x[0] if k * 2 and not x[1] * 2.0 >= 0.5 else bool(x[1]) + abs(k - 3)


def _wide(t: float, x: Any, memory: Any, p: Any) -> float:
    total = 0
    for i in range(70000):
        total = i * 100000
    return total * 1.0


def _powers_of_two(t: float, x: Any, memory: Any, p: Any) -> float:
    return 2.0 ** x[0] + 10.0 ** x[1]


def _slice_of_a_slice(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.past[1:][1:][0] = x[0]
    memory.past[-1] = x[1]
    return _first(memory.past[:-1][2:]) - memory.past[3]


def _negative_remainder(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.k += 1
    return (int(x[0] * 10.0) % 7) + (-int(memory.k) % 3)


def _extremes(t: float, x: Any, memory: Any, p: Any) -> float:
    a = min(x[0], x[1])
    b = max(x[0], x[1])
    signs = math.copysign(1.0, a) + 3.0 * math.copysign(1.0, b)
    return signs + 9.0 * float(a == x[0]) + 18.0 * float(a == x[1]) + 36.0 * float(b == x[1])


def _remainder_of_floats(t: float, x: Any, memory: Any, p: Any) -> float:
    return math.fmod(x[0], 0.3)


PYTHONS = [
    _first_true,
    _last_false,
    _both,
    _known_first,
    _mixed,
    _products_as_conditions,
    _wide,
    _powers_of_two,
    _slice_of_a_slice,
    _negative_remainder,
    _remainder_of_floats,
]


@needs_compiler
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("own", PYTHONS)
def test_operators_mean_in_c_what_they_mean_in_python(
    own: Callable[..., Any], compiler: str, tmp_path: Path
) -> None:
    path = shutil.which(compiler)
    if path is None:
        pytest.skip(f"{compiler} is not installed")
    law = of_ones_own(own)
    x = states_about_start("servo/case1")
    x[3:6, 0] = 0.0
    x[5:9, 1] = -0.0
    write_law(law, tmp_path)
    fast = compile_law(law, tmp_path, path, [*FLAGS, "-O3"])
    assert differing_samples(law, fast, x) == 0


@needs_compiler
def test_the_first_of_two_numbers_is_the_extreme_if_neither_is_beyond_the_other(
    tmp_path: Path,
) -> None:
    """As Python has it; fmin and fmax of C take the number beside NaN, and either zero."""
    law = of_ones_own(_extremes)
    x = np.array([[0.0, -0.0], [-0.0, 0.0], [math.nan, 2.0], [2.0, math.nan]])
    assert [law.controller.input_at(0.0, row, law.controller.memory())[0] for row in x] == [
        67.0,
        59.0,
        4.0,
        13.0,
    ]
    assert differing_samples(law, compiled(law, tmp_path), x) == 0


@needs_compiler
@pytest.mark.parametrize("x", [math.nan, math.inf, 1e300])
def test_a_step_tells_that_there_is_no_such_whole_number(x: float, tmp_path: Path) -> None:
    law = of_ones_own(_negative_remainder)
    assert answer_at(law, compiled(law, tmp_path), [x, 0.0]) == UNDEFINED_LAW


def _refused_type(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    for i in range(x[0]):
        u[0] = x[i % 2]


def _refused_step(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    for _ in range(0, 3, 0):
        u[0] = 1.0


def _refused_step_of_a_loop(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    for _ in range(int(memory.k), 3, 0):
        u[0] = 1.0


def _refused_size(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = x[0] * 10**30


def _sometimes(a: float) -> float | None:
    if a > 1.0:
        return 1.0
    return None


def _refused_value(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = _sometimes(x[0])


def _without_end(a: float) -> Any:  # noqa: RET503
    if a > 1.0:
        return 1.0


def _refused_end(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = _without_end(x[0])


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (_refused_type, "range takes whole numbers: write int"),
        (_refused_step, "arg 3 must not be zero"),
        (_refused_step_of_a_loop, "arg 3 must not be zero"),
        (_refused_size, "is a whole number of more than 64 bits: write it as a float"),
        (_refused_value, "does not always return a value: end it with one"),
        (_refused_end, "does not always return a value: end it with one"),
    ],
)
def test_what_python_would_refuse_is_refused(law: Callable[..., Any], words: str) -> None:
    with pytest.raises(ExportError, match=rf"test_export.py:\d+: .*{words}"):
        _ = of_ones_own(law).source


# Names.


NAMED = """
from numba import njit


def {name}(a):
    return 2.0 * a


@njit
def _2nd(a):
    return {name}(a)


def law(t, x, memory, p, u):
    result = {name}(x[0])
    u[0] = result + _2nd(x[1])
"""
VARIABLE = """
def law(t, x, memory, p, u):
    {name} = x[0] * 2.0
    {name}_ = x[1] - {name}
    {name}_v = {name}_ * {name}
    u[0] = {name}_v + abs({name}_)
"""
NAMES = "round main NAN pow pow_ floor M_PI y0 gamma fabs min_ table_1 t1_ double int8_t INT64_MIN"
NAMES += " out state printf index free _ ä"


@needs_compiler
@pytest.mark.parametrize("text", [NAMED, VARIABLE])
@pytest.mark.parametrize("name", NAMES.split())
def test_a_name_that_c_takes_is_another_one_there(name: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / "named.py"
    path.write_text(text.format(name=name), encoding="utf-8")
    names: dict[str, Any] = {"__name__": "named"}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
    law = of_ones_own(names["law"])
    x = states_about_start("servo/case1")
    assert differing_samples(law, compiled(law, tmp_path), x) == 0


@needs_compiler
def test_a_long_law_is_written_in_a_short_time_or_refused(tmp_path: Path) -> None:
    lines = [f"    v{k + 1} = v{k} + x[1] * {k}.0" for k in range(800)]
    long = ["def law(t, x, memory, p, u):", "    v0 = x[0]", *lines, "    u[0] = v800"]
    wide = ["def wide(t, x, memory, p, u):", f"    u[0] = {' + '.join(['x[0]'] * 700)}", ""]
    path = tmp_path / "long.py"
    path.write_text("\n".join([*wide, *long]), encoding="utf-8")
    names: dict[str, Any] = {"__name__": "long"}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
    law = of_ones_own(names["law"])
    assert differing_samples(law, compiled(law, tmp_path), np.ones((3, 2))) == 0
    with pytest.raises(ExportError, match="wide is nested too deep: write its longest expressions"):
        _ = of_ones_own(names["wide"]).source

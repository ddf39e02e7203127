"""Shipped laws as C: equal to the Python law in every bit, by strict compilers."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import (
    COMPILER,
    compiled,
    complaints_of_sanitizers,
    differing_samples,
    each_law,
    each_switching,
    law_of,
    load,
    needs_compiler,
    states_about_start,
)

import grosmc_mj
from grosmc_mj.export.compiler import FLAGS, CompiledLaw, compile_law, write_law
from grosmc_mj.export.law import UNDEFINED_INPUT, UNDEFINED_LAW, LawInC
from grosmc_mj.export.proof import Proof, prove
from grosmc_mj.ground.errors import SetupError

pytestmark = needs_compiler
has_fma = "fma" in Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else False
clang = pytest.param("clang", marks=pytest.mark.slow)


@pytest.mark.parametrize("compiler", ["gcc", clang])
@each_law
def test_a_law_in_c_is_the_python_law_to_the_last_bit(
    target: str, name: str, compiler: str, tmp_path: Path
) -> None:
    path = shutil.which(compiler)
    if path is None:
        pytest.skip(f"{compiler} is not installed")
    law = law_of(target, name)
    assert differing_samples(law, compiled(law, tmp_path, path), states_about_start(target)) == 0


@each_switching
def test_each_switching_in_c_is_that_of_python(switching: str, tmp_path: Path) -> None:
    """On two inputs, and with a surface in discrete time."""
    target = "two_link_arm/case1"
    law = law_of(target, "grosmc", switching=switching, surface="discrete")
    assert differing_samples(law, compiled(law, tmp_path), states_about_start(target)) == 0


@pytest.mark.skipif(not has_fma, reason="this processor has no fused multiply-add")
def test_contraction_differs_so_the_comparison_can_fail(tmp_path: Path) -> None:
    law = law_of("two_link_arm/case1", "grosmc")
    _, source = write_law(law, tmp_path)
    text = source.read_text(encoding="utf-8")
    source.write_text(text.replace("fp-contract=off", "fp-contract=fast"), encoding="utf-8")
    flags = ["-std=gnu99", "-O2", "-mfma", "-ffp-contract=fast"]
    contracted = compile_law(law, tmp_path, COMPILER, flags)
    assert differing_samples(law, contracted, states_about_start("two_link_arm/case1")) > 0


def test_fast_math_is_refused_by_the_file_itself(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match="-ffast-math changes the law"):
        compiled(law_of("servo/case1", "grosmc"), tmp_path, flags=[*FLAGS, "-ffast-math"])


@pytest.mark.parametrize("real", ["float", pytest.param("double", marks=pytest.mark.slow)])
def test_sanitizers_find_nothing_in_a_law(real: str, tmp_path: Path) -> None:
    law = law_of("two_link_arm/case1", "grosmc", real, switching="adaptive")
    assert complaints_of_sanitizers(law, tmp_path) == ""


# The file.

# Decimal numbers of a C file; whole ones are sizes, indices and lines.
DECIMAL = re.compile(r"-?\b\d+(?:\.\d+(?:e[+-]?\d+)?|e[+-]?\d+)\b")
# Where a function stands: file and line.
SOURCE = re.compile(r"\[(\w+\.py):(\d+)\]")


def test_the_file_names_the_lines_where_functions_begin() -> None:
    package = Path(grosmc_mj.__file__).parent
    named = SOURCE.findall(law_of("servo/case1", "grosmc", switching="implicit").source)
    for file, number in named:
        texts = [path.read_text(encoding="utf-8").splitlines() for path in package.rglob(file)]
        lines = [text[int(number) - 1].lstrip() for text in texts if len(text) >= int(number)]
        assert any(line.startswith(("def ", "@")) for line in lines), file
    assert named


def test_the_file_is_the_one_that_was_reviewed() -> None:
    """Text to the letter; numbers up to the rounding of LAPACK's Riccati solver.

    It leaves some 1e-15 of a gain, which depend on the processor. Other tests compare the numbers
    of a file with those of its law to the bit.
    """
    golden = Path(__file__).with_name("golden_law.c").read_text(encoding="utf-8")
    text = law_of("servo/case1", "grosmc", switching="implicit").source
    without_numbers = [SOURCE.sub(r"[\1]", DECIMAL.sub("#", each)) for each in (text, golden)]
    assert without_numbers[0] == without_numbers[1]
    numbers = [float(number) for number in DECIMAL.findall(text)]
    expected = [float(number) for number in DECIMAL.findall(golden)]
    assert numbers == pytest.approx(expected, rel=1e-13, abs=0.0)


def test_members_that_the_law_does_not_read_are_left_out() -> None:
    header = law_of("servo/case1", "grosmc").header
    members = re.findall(r"double (\w+)", header)
    assert not {"workspace", "nothing", "slope", "share", "period"} & set(members)
    assert {"K", "integral"} <= set(members)


# Answers.


def answer_at(law: LawInC, compiled: CompiledLaw, state: Any) -> int:
    """Answer of the first step of a run."""
    memory = np.zeros(len(law.memory.places))
    x = np.array(state, float)
    compiled.begin(memory, x)
    return compiled.step(0.0, x, memory, np.zeros(len(law.system.inputs)))


@pytest.mark.parametrize(
    ("target", "name", "state", "answer"),
    [
        ("cart_pendulum/case2", "fl-lqr", [0.0, math.pi / 2 + 0.1, 0.0, 0.0], UNDEFINED_LAW),
        ("servo/case1", "lqr", [math.nan, 0.0], UNDEFINED_INPUT),
        ("servo/case1", "lqr", [0.1, 0.0], 0),
    ],
)
def test_a_step_tells_whether_law_and_input_are_defined(
    target: str, name: str, state: list[float], answer: int, tmp_path: Path
) -> None:
    law = law_of(target, name)
    assert answer_at(law, compiled(law, tmp_path), state) == answer


# In the kernel.


def short_proof(law: LawInC, target: str, folder: Path, plants: int = 0) -> Proof:
    experiment = load(target).changed(duration=0.1)
    return prove(experiment, law, compiled(law, folder), plants)


@pytest.mark.slow
def test_c_of_a_robots_law_computes_its_dynamics(tmp_path: Path) -> None:
    assert short_proof(law_of("jaco/eight", "grosmc"), "jaco/eight", tmp_path).equal


def test_c_and_python_law_make_the_same_runs(tmp_path: Path) -> None:
    proof = short_proof(law_of("servo/case1", "grosmc"), "servo/case1", tmp_path, plants=1)
    assert proof.equal
    assert (proof.runs, proof.random_plants) == (2, 1)
    python = [verdict.python.measured for verdict in proof.verdicts]
    assert python == [verdict.in_c.measured for verdict in proof.verdicts]


def test_single_precision_differs_by_its_rounding(tmp_path: Path) -> None:
    proof = short_proof(law_of("servo/case1", "lqr", "float"), "servo/case1", tmp_path)
    assert not proof.equal
    assert proof.largest is not None
    # 2^-24 of an input of 1 A, which the loop hardly amplifies.
    assert 0.0 < proof.largest.value < 1e-6
    assert proof.largest.unit == "A"
    assert proof.overturned == []

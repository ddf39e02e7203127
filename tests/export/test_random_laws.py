"""Laws made at random: their C is the Python, to the bit, and never C that a compiler refuses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import compiled, function_in, needs_compiler, of_ones_own
from random_laws import RandomLaw

from grosmc_mj.export.law import LawInC
from grosmc_mj.export.syntax import ExportError
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.records import pack

FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-ffp-contract=off"]


def states() -> Array:
    """States with zeros of both signs among them, (60, 2)."""
    x = 2.0 * np.random.default_rng(1).normal(size=(60, 2))
    x[5] = 0.0
    x[6] = -0.0
    x[7, 0] = 0.0
    return x


def samples(law: LawInC, folder: Path, flags: list[str]) -> Iterator[tuple[Array, Array]]:
    """Inputs and memory after each sample, by Python and by C, as long as Python has an answer."""
    in_c = compiled(law, folder, flags=flags)
    controller = law.controller
    memory: Any = controller.memory()
    places = law.memory.places
    memory_in_c = np.zeros(len(places))
    in_c.begin(memory_in_c, states()[0])
    for k, x in enumerate(states()):
        expected = np.zeros(1)
        written = np.zeros(1)
        t = k * law.period
        try:
            with np.errstate(all="ignore"):
                controller.law(t, x, memory, controller.parameters, expected)
        except (ArithmeticError, TypeError, ValueError):
            return
        memory.begun = 1.0
        in_c.step(t, x, memory_in_c, written)
        yield np.append(pack(memory)[places], expected), np.append(memory_in_c, written)


def equal(a: Array, b: Array) -> bool:
    """Whether all numbers are the same.

    Zeros may differ in their sign: Python's -(0 if c else x) is 0, in compiled code the choice is a
    float, and this -0.0.
    """
    return np.array_equal(a, b, equal_nan=True)


@needs_compiler
@pytest.mark.parametrize(
    ("seeds", "optimized", "fewest"),
    [
        pytest.param(range(8), "-O2", 5, id="few"),
        pytest.param(range(8, 48), "-O3", 28, id="many", marks=pytest.mark.slow),
    ],
)
def test_random_laws_in_c_are_the_python_ones(
    seeds: range, optimized: str, fewest: int, tmp_path: Path
) -> None:
    """A warning of numpy, or an operation that it lacks for truth values, ends some at once."""
    compared = 0
    for seed in seeds:
        # A library of a path is loaded once.
        folder = tmp_path / str(seed)
        folder.mkdir()
        law = of_ones_own(function_in(RandomLaw(seed).text(), folder / f"random_law_{seed}.py"))
        try:
            _ = law.source
        except ExportError:
            continue
        pairs = list(samples(law, folder, [*FLAGS, optimized]))
        compared += bool(pairs)
        different = [k for k, (python, in_c) in enumerate(pairs) if not equal(python, in_c)]
        assert not different, f"seed {seed}, samples {different}"
    assert compared >= fewest

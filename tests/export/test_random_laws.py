"""Laws made at random: their C is the Python, to the bit, and never C that a compiler refuses."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from random_laws import RandomLaw
from test_export import COMPILER, needs_compiler, of_ones_own

from grosmc_mj.export.compiler import compile_law, write_law
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.syntax import ExportError
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.records import pack

SEEDS = range(40)
# Laws that a warning of numpy, or an operation that it lacks for truth values, ends at their start.
FEWEST = 30


def law_of_seed(seed: int, folder: Path) -> LawInC:
    path = folder / f"random_law_{seed}.py"
    path.write_text(RandomLaw(seed).text(), encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return of_ones_own(module.law)


def states() -> Array:
    """States with zeros of both signs among them, (60, 2)."""
    x = 2.0 * np.random.default_rng(1).normal(size=(60, 2))
    x[5] = 0.0
    x[6] = -0.0
    x[7, 0] = 0.0
    return x


def samples(law: LawInC, folder: Path, flags: list[str]) -> Iterator[tuple[Array, Array]]:
    """Inputs and memory after each sample, by Python and by C, as long as Python has an answer."""
    assert COMPILER is not None
    write_law(law, folder)
    compiled = compile_law(law, folder, COMPILER, flags)
    controller = law.controller
    memory: Any = controller.memory()
    places = law.memory.places
    in_c = np.zeros(len(places))
    compiled.begin(in_c, states()[0])
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
        compiled.step(t, x, in_c, written)
        yield np.append(pack(memory)[places], expected), np.append(in_c, written)


def equal(a: Array, b: Array) -> bool:
    """Whether all numbers are the same.

    Zeros may differ in their sign: Python's -(0 if c else x) is 0, in compiled code the choice is a
    float, and this -0.0.
    """
    return np.array_equal(a, b, equal_nan=True)


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("optimized", ["-O2", "-O3"])
def test_random_laws_in_c_are_the_python_ones(optimized: str, tmp_path: Path) -> None:
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-ffp-contract=off"]
    compared = 0
    for seed in SEEDS:
        # A library of a path is loaded once.
        folder = tmp_path / str(seed)
        folder.mkdir()
        law = law_of_seed(seed, folder)
        try:
            _ = law.source
        except ExportError:
            continue
        pairs = list(samples(law, folder, [*flags, optimized]))
        compared += bool(pairs)
        different = [k for k, (python, in_c) in enumerate(pairs) if not equal(python, in_c)]
        assert not different, f"seed {seed}, samples {different}"
    assert compared >= FEWEST

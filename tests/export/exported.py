"""Exports for the tests: shipped laws, laws in a few lines of Python, and their compiled C."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.export.compiler import (
    FLAGS,
    CompiledLaw,
    compile_law,
    find_compiler,
    run_compiler,
    write_law,
)
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.samples import compare_at_samples
from grosmc_mj.ground.arrays import Array
from grosmc_mj.theory.control.controller import Controller, custom_controller
from grosmc_mj.theory.control.switching import SWITCHINGS

COMPILER = find_compiler() or ""
needs_compiler = pytest.mark.skipif(not COMPILER, reason="there is no C compiler")

# A law of each kind, of one and two inputs, on plants by equations, of MuJoCo and of one's own.
LAWS = [
    ("servo/case1", "lqr"),
    ("servo/case1", "grosmc"),
    ("cart_pendulum/case2", "fl-lqr"),
    ("arm/case1", "grosmc"),
    ("two_link_arm/case1", "pd"),
    ("two_link_arm/case1", "grosmc"),
    ("two_link_arm/bench", "sign"),
    ("rivals/cart_pendulum", "lqi"),
    ("rivals/cart_pendulum", "adrc"),
    ("rivals/two_link_arm", "fl-pid"),
    ("rivals/two_link_arm", "adaptive"),
    ("own_laws/pid", "pid"),
    ("own_laws/looked_up", "looked_up"),
    ("own_laws/from_positions", "from_positions"),
    ("own_laws/transfer_function", "lead"),
    ("ball_beam/sine", "fl-lqr"),
    ("maglev/warm", "grosmc"),
    ("furuta/heavier", "grosmc"),
]
each_law = pytest.mark.parametrize(("target", "name"), LAWS)
each_switching = pytest.mark.parametrize("switching", SWITCHINGS)


# Laws are designed when a case is loaded.
load = cache(Experiment.load)


def law_of(target: str, name: str, real: str = "double", **settings: Any) -> LawInC:
    """Export of a law of a case."""
    experiment = load(target)
    if settings:
        experiment = experiment.changed(**settings)
    return _export(experiment, experiment.law(experiment.nominal.truest, name), real)


def of_ones_own(law: Callable[..., Any]) -> LawInC:
    """Export of a Python function for the servo, with numbers and a memory for all of them."""
    experiment = load("servo/case1")
    like = experiment.law("physics", "lqr")
    memory = {"past": np.zeros(4), "other": np.zeros(4), "k": 0, "results": np.zeros(16)}
    numbers = {"most": 1.5, "gains": np.ones(2)}
    return _export(experiment, custom_controller("own", law, like, numbers, memory), "double")


def _export(experiment: Experiment, controller: Controller, real: str) -> LawInC:
    period = experiment.settings.control_period
    return LawInC(controller, "law_in_c", experiment.nominal.system, period, ["A law."], real)


def function_in(text: str, path: Path, name: str = "law") -> Callable[..., Any]:
    """A function of a module, which is written to a file: an export reads its source."""
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, name)


def compiled(
    law: LawInC, folder: Path, compiler: str = COMPILER, flags: Sequence[str] = FLAGS
) -> CompiledLaw:
    """The C of a law, compiled in an empty folder."""
    write_law(law, folder)
    return compile_law(law, folder, compiler, flags)


def states_about_start(target: str = "servo/case1") -> Array:
    """States about the start of a case, (200, n)."""
    x0 = np.array(load(target).x0)
    return x0 + 0.3 * np.random.default_rng(1).normal(size=(200, len(x0)))


def differing_samples(law: LawInC, compiled: CompiledLaw, x: Array) -> int:
    """Number of samples in which C and Python law differ in any bit of inputs or memory."""
    compared = compare_at_samples(law, compiled, [x])
    assert compared.samples > len(x) / 2
    return compared.different


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


def complaints_of_sanitizers(law: LawInC, folder: Path) -> str:
    """Return the words of compiler, sanitizers or the law itself on 1,000 samples."""
    calls = {"@init": "&memory", "@step": "k * (@real)0.001, signals"}
    if law.loop is not None:
        calls = {"@init": "&memory, ones", "@step": "2 * k, signals, ones"}
    text = MAIN
    for word, code in {**calls, "@real": law.real, "@n": str(len(law.signals))}.items():
        text = text.replace(word, code)
    main = folder / "main.c"
    main.write_text(text, encoding="utf-8")
    _, source = write_law(law, folder)
    program = folder / "program"
    flags = [*FLAGS, "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    complaints = run_compiler([COMPILER, *flags, main, source, "-o", program, "-lm"])
    return complaints or run_compiler([program])

"""Samples of a law alone: random states, and numbers that are no state of a machine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.export.compiler import RunningLaw
from grosmc_mj.export.law import UNDEFINED_INPUT, UNDEFINED_LAW, LawInC
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.records import pack

# Numbers that no machine has as a state, but a faulty sensor may send.
_EXTREMES = (np.nan, np.inf, -np.inf, -0.0)
_SEED = 3
# Least spread of random states about the start, in the unit of each.
_LEAST_SPREAD = 0.3


class Answer(NamedTuple):
    """Answer of a law at a sample.

    Attributes:
        u: Inputs, (m,).
        memory: Memory that the C has, flat, after the sample.
        code: Answer of ``NAME_step``.
    """

    u: Array
    memory: Array
    code: int

    def equals(self, other: Answer) -> bool:
        """Return True if an answer is the same to the last bit; NaN is equal to itself."""
        numbers = np.concatenate([self.u, self.memory])
        others = np.concatenate([other.u, other.memory])
        return self.code == other.code and not unequal_bits(numbers, others).any()


def unequal_bits(a: Array, b: Array) -> NDArray[np.bool_]:
    """Return where numbers differ in any bit; NaN is equal to itself, 0 is not -0."""
    same = (a == b) & (np.signbit(a) == np.signbit(b))
    return ~(same | (np.isnan(a) & np.isnan(b)))


def random_runs(start: Sequence[float], count: int) -> list[Array]:
    """Return runs of states, (samples, n) each, which begin anew where the law ends one.

    The first is of random states about a start; each of the others has one number that no state of
    a machine is.

    Args:
        start: Start of the case, (n,).
        count: Number of random states.
    """
    x0 = np.array(start, float)
    spread = np.maximum(np.abs(x0), _LEAST_SPREAD)
    rng = np.random.default_rng(_SEED)
    runs: list[Array] = [x0 + spread * rng.normal(size=(count, len(x0)))]
    for index in range(len(x0)):
        for number in _EXTREMES:
            run = np.tile(x0, (2, 1))
            run[1, index] = number
            runs.append(run)
    return runs


def python_answers(law: LawInC, runs: Sequence[Array]) -> Iterator[Answer | None]:
    """Yield the answers of the Python law; None where it raises an error, which ends a run."""
    controller = law.controller
    places = law.memory.places
    m = len(law.system.inputs)
    for run in runs:
        memory = controller.memory()
        k = 0
        for state in run:
            u = np.zeros(m)
            try:
                with np.errstate(all="ignore"):
                    controller.law(k * law.period, state.copy(), memory, controller.parameters, u)
            except (ArithmeticError, ValueError):
                yield None
                memory = controller.memory()
                k = 0
                continue

            memory.begun = 1.0
            code = 0
            if memory.undefined:
                code = UNDEFINED_LAW
            elif not np.all(np.isfinite(u)):
                code = UNDEFINED_INPUT
            yield Answer(u, pack(memory)[places], code)
            k += 1
            if code:
                memory = controller.memory()
                k = 0


def c_answers(
    law: LawInC, compiled: RunningLaw, runs: Sequence[Array], ends: Sequence[bool]
) -> Iterator[Answer]:
    """Yield the answers of the C.

    Args:
        law: The export.
        compiled: The same, compiled.
        runs: Runs of states.
        ends: Whether a run begins anew after each sample, in their order.
    """
    memory = np.zeros(len(law.memory.places))
    u = np.zeros(len(law.system.inputs))
    ended = iter(ends)
    for run in runs:
        compiled.begin(memory, run[0])
        k = 0
        for state in run:
            code = compiled.step(k * law.period, state.copy(), memory, u)
            yield Answer(u.copy(), memory.copy(), code)
            k += 1
            if next(ended):
                compiled.begin(memory, run[0])
                k = 0


class SampleComparison(NamedTuple):
    """Comparison of a compiled law with the Python law at random states.

    Attributes:
        samples: Samples at which Python has an answer.
        different: Samples at which the C has another one.
    """

    samples: int
    different: int


def compare_at_samples(
    law: LawInC, compiled: RunningLaw, runs: Sequence[Array]
) -> SampleComparison:
    """Compare a compiled law with the Python law, from ``NAME_init`` on."""
    expected = list(python_answers(law, runs))
    ends = [answer is None or answer.code != 0 for answer in expected]
    actual = list(c_answers(law, compiled, runs, ends))
    samples = 0
    different = 0
    for python, in_c in zip(expected, actual, strict=True):
        if python is not None:
            samples += 1
            different += not python.equals(in_c)
    return SampleComparison(samples, different)

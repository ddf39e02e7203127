"""The proof of an export: it notices what the C does otherwise, and says where."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from exported import COMPILER, compiled, law_of, load, needs_compiler, of_ones_own

from grosmc_mj.export.answer import delay_table, export_result
from grosmc_mj.export.changed_digit import changed_sources, compile_changed
from grosmc_mj.export.compiler import CompiledLaw
from grosmc_mj.export.law import UNDEFINED_INPUT, UNDEFINED_LAW, LawInC
from grosmc_mj.export.proof import prove
from grosmc_mj.export.samples import compare_at_samples, random_runs, unequal_bits
from grosmc_mj.ground.arrays import Array

CASE = "cart_pendulum/case2"
CONTROL_PERIOD = 1e-3


@dataclass
class Faulty:
    """The C with a fault: what it has written is changed.

    Attributes:
        right: The C without it.
        begun: Changes the memory that a run begins with.
        stepped: Changes memory and inputs after a step at a time, and returns its answer.
    """

    right: CompiledLaw
    begun: Callable[[Array], Any] = lambda memory: None
    stepped: Callable[[float, Array, Array, int], int] = lambda t, memory, u, answer: answer

    def begin(self, memory: Array, start: Array) -> None:
        self.right.begin(memory, start)
        self.begun(memory)

    def step(self, t: float, x: Array, memory: Array, u: Array) -> int:
        answer = self.right.step(t, x, memory, u)
        return self.stepped(t, memory, u, answer)

    def step_in_loop(self, clock: float, y: Array, fresh: Array, memory: Array, u: Array) -> int:
        raise NotImplementedError

    def missed(self, memory: Array) -> None:
        raise NotImplementedError


def one_bit_more(values: Array, place: int) -> None:
    values[place] = np.nextafter(values[place], np.inf)


def of_input(t: float, memory: Array, u: Array, answer: int) -> int:
    one_bit_more(u, 0)
    return answer


def of_memory(t: float, memory: Array, u: Array, answer: int) -> int:
    one_bit_more(memory, -1)
    return answer


FAULTS = {
    "memory begins elsewhere": {"begun": lambda memory: np.add(memory, 1e-9, out=memory)},
    "a bit of an input": {"stepped": of_input},
    "a bit of the memory": {"stepped": of_memory},
    "a good step is none": {"stepped": lambda t, memory, u, answer: answer or UNDEFINED_LAW},
    "an undefined law is defined": {
        "stepped": lambda t, memory, u, answer: answer * (answer != UNDEFINED_LAW)
    },
    "an input that is not finite is one": {
        "stepped": lambda t, memory, u, answer: answer * (answer != UNDEFINED_INPUT)
    },
}


@pytest.fixture(scope="module")
def law() -> LawInC:
    return law_of(CASE, "grosmc")


@pytest.fixture(scope="module")
def right(law: LawInC, tmp_path_factory: pytest.TempPathFactory) -> CompiledLaw:
    return compiled(law, tmp_path_factory.mktemp("right"))


@needs_compiler
@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_fault_is_noticed_at_random_states(fault: Any, law: LawInC, right: CompiledLaw) -> None:
    runs = random_runs(load(CASE).x0, 200)
    assert compare_at_samples(law, right, runs).different == 0
    assert compare_at_samples(law, Faulty(right, **fault), runs).different > 0


@needs_compiler
def test_samples_that_one_law_alone_makes_differ(
    law: LawInC, right: CompiledLaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_number_from_10_ms(t: float, memory: Array, u: Array, answer: int) -> int:
        if t > 9.5e-3:
            u[0] = np.nan
        return answer

    monkeypatch.setattr("grosmc_mj.export.proof._prove_at_random_states", lambda *_: None)
    experiment = load(CASE).changed(duration=0.02)
    proof = prove(experiment, law, Faulty(right, stepped=no_number_from_10_ms), plants=0)
    assert proof.samples == 20 * proof.runs
    assert proof.different >= 9 * proof.runs
    assert "C ends its run at 0.01 s" in proof.words


@needs_compiler
def test_a_difference_in_the_memory_alone_is_said_to_change_no_input(
    law: LawInC, right: CompiledLaw
) -> None:
    experiment = load(CASE).changed(duration=0.02)
    proof = prove(experiment, law, Faulty(right, stepped=of_memory), plants=0)
    assert proof.words.endswith("; all inputs are equal")


@pytest.mark.parametrize(("real", "size"), [("float", 4), ("double", 8)])
def test_a_result_has_the_size_of_the_memory_in_bytes(real: str, size: int) -> None:
    """A disturbance observer of the cart's four errors remembers five numbers or more."""
    law = law_of(CASE, "adrc", real)
    places = len(law.memory.places)
    assert places >= 5
    result: Any = export_result(load(CASE), law, None)
    assert result.memory_bytes == size * places


def test_a_computing_time_is_told_in_ms() -> None:
    on: Any = SimpleNamespace(delayed=[], delay=0.0025)
    assert delay_table(on).title == "With a computing time of 2.5 ms"


@needs_compiler
@pytest.mark.parametrize("name", [*FAULTS][:4])
def test_a_fault_is_noticed_in_a_run(
    name: str, law: LawInC, right: CompiledLaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grosmc_mj.export.proof._prove_at_random_states", lambda *_: None)
    experiment = load(CASE).changed(duration=0.02)
    assert prove(experiment, law, right, plants=0).equal
    assert not prove(experiment, law, Faulty(right, **FAULTS[name]), plants=0).equal


@needs_compiler
def test_the_largest_difference_of_an_input_has_its_time_and_plant(
    law: LawInC, right: CompiledLaw
) -> None:
    def half_a_newton_at_5_ms(t: float, memory: Array, u: Array, answer: int) -> int:
        u[0] -= 0.5 * (t == 5 * CONTROL_PERIOD)
        return answer

    experiment = load(CASE).changed(duration=6.5e-3)
    proof = prove(experiment, law, Faulty(right, stepped=half_a_newton_at_5_ms), plants=0)
    plant = next(iter(experiment.plant_names))
    assert proof.largest is not None
    assert proof.largest.value == pytest.approx(0.5)
    assert proof.largest[1:] == ("N", 5 * CONTROL_PERIOD, plant)
    assert f"the input by at most 0.5 N, at 0.005 s on {plant}" in proof.words


@pytest.mark.parametrize(
    ("a", "b", "unequal"),
    [(0.0, -0.0, True), (np.nan, -np.nan, False), (np.nan, 0.0, True), (1.0, 1 + 2**-52, True)],
)
def test_numbers_are_equal_in_all_bits_but_those_of_nan(a: float, b: float, unequal: bool) -> None:
    assert unequal_bits(np.array([a]), np.array([b])) == unequal


@needs_compiler
def test_a_changed_digit_is_noticed(law: LawInC, right: CompiledLaw, tmp_path: Path) -> None:
    experiment = load(CASE).changed(duration=0.02)
    changed = next(compile_changed(law, tmp_path, COMPILER))
    # A number on which no input depends, such as an index of a robot, is not the last one.
    assert not prove(experiment, law, right, 0, changed=[right, changed]).blind
    # The same C in place of a changed one: the proof says that it cannot see.
    blind = prove(experiment, law, right, 0, changed=[right, right])
    assert blind.blind
    assert "not proven: a changed digit is not noticed" in blind.words


def quarter(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    u[0] = 0.25 * x[0]


@pytest.mark.parametrize("make", [lambda: law_of(CASE, "lqr"), lambda: of_ones_own(quarter)])
def test_one_number_is_changed_in_its_seventh_digit(make: Callable[[], LawInC]) -> None:
    """A gain, or a number in the code of a law that has no others."""
    law = make()
    changed = next(changed_sources(law))
    lines = zip(law.source.splitlines(), changed.splitlines(), strict=True)
    (different,) = [pair for pair in lines if pair[0] != pair[1]]
    numbers = [float(re.findall(r"-?\d+\.\d+", line)[0]) for line in different]
    assert numbers[1] / numbers[0] == pytest.approx(1 + 1e-6, rel=1e-12)

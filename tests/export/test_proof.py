"""Faults put into an exported law between emission and compilation: the proof notices them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from test_export import COMPILER, law_of, needs_compiler

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.export.changed_digit import changed_source, compile_changed
from grosmc_mj.export.compiler import CompiledLaw, compile_law, write_law
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.proof import Proof, prove

CASE = "cart_pendulum/case2"


def faulty(law: LawInC, pattern: str, replacement: str, folder: Path) -> CompiledLaw:
    """The law, compiled after the first place of a pattern in its C has been changed."""
    assert COMPILER is not None
    _, path = write_law(law, folder)
    source = path.read_text(encoding="utf-8")
    changed, count = re.subn(pattern, replacement, source, count=1)
    assert count == 1
    path.write_text(changed, encoding="utf-8")
    return compile_law(law, folder, COMPILER, ["-std=c99", "-O2", "-ffp-contract=off"])


def proof_of(law: LawInC, compiled: CompiledLaw) -> Proof:
    experiment = Experiment.load(CASE).changed(duration=0.5)
    return prove(experiment, law, compiled, plants=0)


FAULTS = {
    "integral begins elsewhere": (r"\.integral = \{0\.0\}", ".integral = {1e-9}"),
    "time begins elsewhere": (r"memory->t = t;", "memory->t = t + 1e-9;"),
    "the run never begins": (r"    memory->begun = 1;\n", ""),
    "the run has begun already": (r"\.begun = 0\.0", ".begun = 1.0"),
    "answer of an undefined law": (r"(undefined != 0\) \{\s+return) 1;", r"\1 0;"),
    "answer of an input that is not finite": (r"return 2;", "return 0;"),
    "no check of the input": (r"!isfinite\(u\[0\]\)", "0"),
    "answer of a good step": (r"return 0;\n\}\s*$", "return 2;\n}\n"),
    "a digit of a gain": (r"\.K = \{(-?\d\.\d{5})\d", r".K = {\g<1>0"),
    "a sign": (r"memory->integral\[0\] \+=", "memory->integral[0] -="),
    "an entry for another": (r"memory->z0\[j\] = z\[j\]", "memory->z0[j] = z[0]"),
    "a number that is not stored": (
        r"memory->elapsed = t - memory->t;",
        "memory->elapsed = 0.001;",
    ),
    "a limit that is left out": (r"memory->undefined = 1", "memory->undefined = 0"),
}


@needs_compiler
@pytest.mark.parametrize(("pattern", "replacement"), FAULTS.values(), ids=FAULTS)
def test_a_fault_in_the_c_is_noticed(pattern: str, replacement: str, tmp_path: Path) -> None:
    law = law_of(CASE, "grosmc")
    assert not proof_of(law, faulty(law, pattern, replacement, tmp_path)).equal


@needs_compiler
def test_the_c_without_a_fault_is_equal(tmp_path: Path) -> None:
    law = law_of(CASE, "grosmc")
    proof = proof_of(law, faulty(law, "return 2;", "return 2;", tmp_path))
    assert proof.equal, proof.words
    assert proof.random_states > 1000


@needs_compiler
@pytest.mark.parametrize("name", ["lqr", "fl-lqr", "grosmc"])
def test_a_changed_digit_is_noticed(name: str, tmp_path: Path) -> None:
    law = law_of(CASE, name)
    assert COMPILER is not None
    folders = [tmp_path / "own", tmp_path / "changed"]
    for folder in folders:
        folder.mkdir()
    write_law(law, folders[0])
    own = compile_law(law, folders[0], COMPILER)
    changed = compile_changed(law, folders[1], COMPILER)
    experiment = Experiment.load(CASE).changed(duration=0.1)
    assert changed is not None
    assert not prove(experiment, law, own, 0, changed=changed).blind
    # The same C in place of a changed one: the proof says that it cannot see.
    blind = prove(experiment, law, own, 0, changed=own)
    assert blind.blind
    assert "a changed digit is not noticed" in blind.words


def test_one_number_is_changed_in_its_seventh_digit() -> None:
    law = law_of("servo/case1", "lqr")
    changed = changed_source(law)
    assert changed is not None
    lines = zip(law.source.splitlines(), changed.splitlines(), strict=True)
    different = [pair for pair in lines if pair[0] != pair[1]]
    assert len(different) == 1
    gains = [float(re.findall(r"-?\d+\.\d+", line)[0]) for line in different[0]]
    assert gains[1] / gains[0] == pytest.approx(1 + 1e-6, rel=1e-12)


def test_members_that_the_law_does_not_read_are_left_out() -> None:
    header = law_of("servo/case1", "grosmc").header
    for name in ("workspace", "nothing", "slope", "share", "period"):
        assert re.search(rf"\b{name}\b;", header) is None

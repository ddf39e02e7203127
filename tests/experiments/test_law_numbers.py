"""Numbers of laws and of their switching laws, in a case file and by their paths."""

from typing import Any

import cases
import pytest

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.law_numbers import tunable_numbers
from grosmc_mj.experiments.number import Number
from grosmc_mj.ground.errors import ArgumentError

LAWS: dict[str, dict[str, Any]] = {
    "layer": {
        "law": "grosmc",
        "k": "5 1/s",
        "epsilon": 3,
        "switching": "boundary-layer",
        "width": 3,
    },
    "twist": {"law": "grosmc", "k": 5, "epsilon": 3, "switching": "super-twisting"},
    "own-twist": {
        "law": "grosmc",
        "k": 5,
        "epsilon": 3,
        "switching": "super-twisting",
        "slope": 80,
    },
    "pid": {"law": "pid", "frequency": "4 rad/s"},
}


def laws(changed: str = "", **numbers: Any) -> Experiment:
    """The arm under these laws, one of which has further numbers."""
    tables = LAWS | ({changed: LAWS[changed] | numbers} if changed else {})
    return cases.case(
        "arm",
        task={"Q": [10, 1], "R": 1, "slope": 40},
        laws=tables,
        controller=[{"law": name} for name in tables],
    )


@pytest.fixture(scope="module")
def case() -> Experiment:
    return laws()


def switching_of(case: Experiment, law: str) -> dict[str, float]:
    return vars(case.law("corrected", law).parameters.switching)


def test_a_switching_law_has_the_numbers_of_its_law(case: Experiment) -> None:
    assert switching_of(case, "layer")["width"] == 3.0
    assert switching_of(case, "twist")["slope"] == 40.0
    assert switching_of(case, "own-twist")["slope"] == 80.0
    assert case.law("corrected", "layer").parameters.k == 5.0


@pytest.mark.parametrize(
    ("path", "law", "key", "before"),
    [
        ("laws.layer.width", "layer", "width", 3.0),
        ("laws.layer.gain", "layer", "gain", 1.0),
        ("laws.twist.slope", "twist", "slope", 40.0),
        ("laws.own-twist.slope", "own-twist", "slope", 80.0),
        ("controller.twist.gain", "twist", "gain", 1.0),
    ],
)
def test_a_number_of_a_switching_law_is_set_by_its_path(
    path: str, law: str, key: str, before: float, case: Experiment
) -> None:
    number = Number.of(case, path)
    assert number.get(case) == before
    changed = number.set(case, 2.5)
    assert switching_of(changed, law)[key] == 2.5
    others = {"layer", "twist", "own-twist"} - {law}
    assert all(switching_of(changed, name) == switching_of(case, name) for name in others)


def test_an_asked_switching_law_reads_its_own_numbers_of_the_law(case: Experiment) -> None:
    asked = case.changed(switching="super-twisting")
    assert switching_of(asked, "layer")["slope"] == 40.0
    assert switching_of(asked, "own-twist")["slope"] == 80.0


@pytest.mark.parametrize(
    ("law", "numbers", "words"),
    [
        ("layer", {"share": 0.1}, "share is a number of adaptive: .* is 'boundary-layer'"),
        ("twist", {"width": 1}, "width is a number of boundary-layer: .* is 'super-twisting'"),
        ("layer", {"widht": 1}, "unknown key 'widht': did you mean 'width'"),
        ("twist", {"gain": -1}, "gain = -1 must be finite and not negative"),
        ("twist", {"gain": "big"}, "gain = 'big' must be finite and not negative"),
        ("pid", {"gain": 2}, "unknown key 'gain'"),
        ("pid", {"kp": 8}, "pid needs kp .*, or frequency, .*, not kp and frequency"),
    ],
)
def test_a_number_that_a_law_does_not_have_is_refused(
    law: str, numbers: dict[str, Any], words: str
) -> None:
    with pytest.raises(ArgumentError, match=words):
        laws(law, **numbers)


def test_a_search_is_offered_the_numbers_of_a_law(case: Experiment) -> None:
    assert set(tunable_numbers(case, "layer")) == {"k", "epsilon", "gain", "width", "Q", "R"}
    of_pid = tunable_numbers(case, "pid")
    assert "frequency" in of_pid
    assert not {"kp", "ki", "kd", "limit", "Q"} & set(of_pid)


@pytest.mark.parametrize("law", ["layer", "twist", "pid"])
def test_numbers_that_a_search_is_offered_are_those_of_the_paths(
    case: Experiment, law: str
) -> None:
    declared = {
        key: number for key, number in tunable_numbers(case, law).items() if not number.each
    }
    numbers = {key: Number.of(case, f"laws.{law}.{key}") for key in declared}
    assert {key: number.bounds for key, number in numbers.items()} == declared
    assert all(number.bounds.holds(number.get(case)) for number in numbers.values())

"""Words around numbers: nouns of a count, units of a value."""

from __future__ import annotations

import pytest

from grosmc_mj.ground.errors import unknown_name
from grosmc_mj.ground.wording import counted, counted_of, quantity_and_unit, titled, unit_after


@pytest.mark.parametrize(
    ("count", "noun", "words"),
    [
        (0, ("run",), "0 runs"),
        (1, ("run",), "1 run"),
        (2, ("run",), "2 runs"),
        (1, ("switch", "switches"), "1 switch"),
        (3, ("switch", "switches"), "3 switches"),
    ],
)
def test_one_has_the_singular_and_all_else_the_plural(
    count: int, noun: tuple[str, ...], words: str
) -> None:
    assert counted(count, *noun) == words


@pytest.mark.parametrize(
    ("part", "whole", "words"),
    [
        (0, 1, "0 of 1 law keeps"),
        (1, 1, "1 of 1 law keeps"),
        (0, 2, "0 of 2 laws keep"),
        (1, 2, "1 of 2 laws keeps"),
        (2, 2, "2 of 2 laws keep"),
    ],
)
def test_the_verb_of_a_part_agrees_with_the_part_or_with_the_only_one(
    part: int, whole: int, words: str
) -> None:
    assert counted_of(part, whole, "law", "keeps", "keep") == words


@pytest.mark.parametrize("unit", ["", "1"])
def test_a_pure_number_has_no_unit(unit: str) -> None:
    assert f"0.3{unit_after(unit)}" == "0.3"
    assert titled("share", unit) == "share"


@pytest.mark.parametrize(
    ("quantity", "unit"), [("share", ""), ("pole angle", "rad"), ("u [given]", "N m"), ("x", "%")]
)
def test_a_title_gives_its_quantity_and_unit_back(quantity: str, unit: str) -> None:
    assert quantity_and_unit(titled(quantity, unit)) == (quantity, unit)


def test_an_unknown_name_is_told_the_first_twenty_and_how_many_more_there_are() -> None:
    line = unknown_name("case", "zzz", [f"case{number}" for number in range(27)])
    assert "case19 and 7 more" in line
    assert "case20" not in line

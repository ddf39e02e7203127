"""The map from the chapter's equations to the code: nothing on it is missing, and no equation."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MAP = (ROOT / "docs" / "map.md").read_text(encoding="utf-8")
# The chapter numbers its equations from (1) to (58).
EQUATIONS = 58
PLACES = re.findall(r"`([\w/]+\.(?:py|xml)|[\w/]+/)(?:::(\w+))?`", MAP)


def test_every_equation_is_on_the_map() -> None:
    numbers: set[int] = set()
    for first, last in re.findall(r"\((\d+)\)(?:-\((\d+)\))?", MAP):
        numbers.update(range(int(first), int(last or first) + 1))
    assert numbers == set(range(1, EQUATIONS + 1))


@pytest.mark.parametrize(("place", "name"), PLACES, ids="::".join)
def test_every_place_on_the_map_is_there(place: str, name: str) -> None:
    roots = [ROOT / "grosmc_mj", ROOT / "tests", ROOT]
    found = next((root / place for root in roots if (root / place).exists()), None)
    assert found is not None
    if name:
        text = found.read_text(encoding="utf-8")
        assert re.search(rf"^ *(def|class) {name}\b|^{name}\b", text, re.MULTILINE)

"""A reader who follows a tutorial gets the output that it shows."""

from __future__ import annotations

from pathlib import Path

import pytest
from commands import Patch, Screen
from shown_output import follow

pytestmark = pytest.mark.slow

TUTORIALS = Path(__file__).parents[1] / "docs" / "tutorials"

# Half a minute: it trains an agent.
TRAINS = pytest.param(TUTORIALS / "your_agent.md", marks=pytest.mark.apart)
PAGES = [TRAINS if page.stem == "your_agent" else page for page in sorted(TUTORIALS.glob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_shows_what_comes_out(
    page: Path, tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    monkeypatch.chdir(tmp_path)
    follow(page.read_text(encoding="utf-8"), page.name, capsys)

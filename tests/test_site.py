"""The documentation's site: links lead somewhere, and the map has every equation."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
import repository

from grosmc_mj import control, environments, films, loop, machine, physics, simulation, sweep

ROOT = Path(__file__).parents[1]
LOADED = {("script", "src"), ("img", "src"), ("iframe", "src"), ("link", "href")}


class Links(HTMLParser):
    """What a page links to and loads, and where it can be linked to."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.targets: set[str] = set()
        self.loaded: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("id", "name"):
                self.anchors.add(value or "")
            elif value and name in ("href", "src"):
                self.targets.add(value)
                if (tag, name) in LOADED:
                    self.loaded.add(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, Links]:
    """Every page of the site as it is built, or as it lies in ``SITE``."""
    folder = Path(os.environ.get("SITE") or tmp_path_factory.mktemp("site")).resolve()
    if "SITE" not in os.environ:
        command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", folder]
        subprocess.run(command, cwd=ROOT, check=True)
    return {page: Links(page) for page in folder.rglob("*.html") if page.name != "404.html"}


@pytest.mark.slow
def test_every_link_leads_to_a_file_and_a_place_in_it(site: dict[Path, Links]) -> None:
    broken = []
    for page, links in site.items():
        for target in links.targets:
            parts = urlsplit(target)
            if parts.scheme:
                continue
            file = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            anchor = unquote(parts.fragment)
            if not file.exists() or (anchor and anchor not in site[file].anchors):
                broken.append((page.name, target))
    assert not broken
    # Nothing is loaded from elsewhere.
    assert not [each for links in site.values() for each in links.loaded if "//" in each]


@pytest.mark.slow
def test_the_map_leads_to_lines(site: dict[Path, Links]) -> None:
    (page,) = (links for page, links in site.items() if page.name == "map.html")
    lines = [target for target in page.targets if "codelineno" in target]
    text = (ROOT / "grosmc_mj/control/laws.py").read_text()
    number = repository.line_of(text, "grosmc")
    assert text.splitlines()[number - 1].startswith("def grosmc")
    assert f"repository/grosmc_mj/control/laws.py.html#__codelineno-0-{number}" in lines
    assert len(lines) >= len({place for place in PLACES if place[0].endswith(".py")})


@pytest.mark.slow
def test_every_public_name_is_on_the_pages_of_the_site(site: dict[Path, Links]) -> None:
    anchors = set().union(*(links.anchors for links in site.values()))
    for module in (sweep, control, environments, films, loop, machine, physics, simulation):
        missing = [n for n in module.__all__ if f"{module.__name__}.{n}" not in anchors]
        assert not missing, module


def test_the_summary_of_the_ladder_agrees_with_its_tables() -> None:
    """The first step on which a law fails, of each machine; a cell above 1 has an x."""
    labels = {
        "LQR": ["lqr"],
        "LQI, as quick as the actuator allows": ["lqi, quick"],
        "ADRC": ["adrc"],
        "GROSMC, sign function as printed": ["sign"],
        "GROSMC, implicit": ["implicit"],
        "GROSMC, super-twisting": ["super-twisting"],
        "GROSMC, adaptive gain": ["grosmc adaptive", "adaptive"],
    }
    tables = (ROOT / "docs/ladder_tables.md").read_text(encoding="utf-8")
    summary = (ROOT / "docs/ladder.md").read_text(encoding="utf-8")
    systems = ("servo", "cart_pendulum", "arm", "two_link_arm")
    for label, laws in labels.items():
        shown = next(row for row in rows(summary) if row[0] == label)[1:]
        assert len(shown) == len(systems)
        for system, failing in zip(systems, shown, strict=True):
            text = tables.partition(f"**{system}/machine**")[2]
            head, _, *climbs = rows(text.partition("Each alone")[0])
            cells = next(row[1:] for law in laws for row in climbs if row[0] == law)
            steps = [step.strip("\\*") for step in head[1:]]
            bad = (s for s, cell in zip(steps, cells, strict=True) if cell[-1] in "xrd")
            assert failing == next(bad, "kept"), (label, system)


def rows(text: str) -> list[list[str]]:
    """The cells of the tables of a text in Markdown."""
    lines = (line for line in text.splitlines() if line.startswith("|"))
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


MAP = (ROOT / "docs" / "map.md").read_text(encoding="utf-8")
# The chapter numbers its equations from (1) to (58).
EQUATIONS = 58
PLACES = re.findall(r"`([\w/]+\.(?:py|xml)|[\w/]+/)(?:::(\w+))?`", MAP)


def test_every_equation_is_on_the_map() -> None:
    numbers: set[int] = set()
    for first, last in re.findall(r"\((\d+)\)(?:-\((\d+)\))?", MAP):
        numbers.update(range(int(first), int(last or first) + 1))
    assert numbers == set(range(1, EQUATIONS + 1))


@pytest.mark.parametrize(("place", "name"), PLACES, ids=["::".join(one) for one in PLACES])
def test_every_place_on_the_map_is_there(place: str, name: str) -> None:
    roots = [ROOT / "grosmc_mj", ROOT / "tests", ROOT]
    found = next((root / place for root in roots if (root / place).exists()), None)
    assert found is not None
    if name:
        text = found.read_text(encoding="utf-8")
        assert re.search(rf"^ *(def|class) {name}\b|^{name}\b", text, re.MULTILINE)

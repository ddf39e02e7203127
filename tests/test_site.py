"""The documentation's site: links lead somewhere, nothing comes from elsewhere."""

from __future__ import annotations

import os
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import colours
import pytest
import repository

from grosmc_mj.results import palette

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
        command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-d", folder]
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


@pytest.mark.slow
def test_nothing_is_loaded_from_elsewhere(site: dict[Path, Links]) -> None:
    assert not [each for links in site.values() for each in links.loaded if "//" in each]


@pytest.mark.slow
def test_the_map_leads_to_lines(site: dict[Path, Links]) -> None:
    (page,) = (links for page, links in site.items() if page.name == "map.html")
    lines = [target for target in page.targets if "codelineno" in target]
    law = "def grosmc"
    number = repository.line_of((ROOT / "grosmc_mj/control/laws.py").read_text(), "grosmc")
    assert (ROOT / "grosmc_mj/control/laws.py").read_text().splitlines()[number - 1].startswith(law)
    assert f"repository/grosmc_mj/control/laws.py.html#__codelineno-0-{number}" in lines
    assert len(lines) > 50


@pytest.mark.slow
def test_every_public_name_is_on_the_pages_of_the_site(site: dict[Path, Links]) -> None:
    from grosmc_mj import control, environments, films, loop, machine, physics, simulation, sweep

    anchors = set().union(*(links.anchors for links in site.values()))
    for module in (sweep, control, environments, films, loop, machine, physics, simulation):
        missing = [n for n in module.__all__ if f"{module.__name__}.{n}" not in anchors]
        assert not missing, module


def test_a_line_is_that_of_the_definition() -> None:
    text = "call(law)\n\nclass laws: ...\ndef law(): ...\nLAW = 1\n"
    assert [repository.line_of(text, name) for name in ("law", "LAW", "laws", "")] == [4, 5, 3, 1]


def test_a_link_has_a_path_and_perhaps_an_anchor() -> None:
    (first, second) = repository.links("[a](../x.md#b), [c](d.md) and [e](https://f.g/h.md)")
    assert (first["path"], first["anchor"], second["path"]) == ("../x.md", "#b", "d.md")


def test_the_site_has_the_colours_of_the_figures() -> None:
    assert f"--md-primary-fg-color: {palette.BLUE};" in colours.style()

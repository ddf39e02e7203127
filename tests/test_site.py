"""The documentation's site: links lead somewhere, and the map has every equation."""

from __future__ import annotations

import importlib
import inspect
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote, urlsplit

import doors
import law_numbers
import pytest
import repository

from grosmc_mj import control, environments, films, loop, machine, physics, simulation, studies
from grosmc_mj.theory.control.kinds import KINDS
from grosmc_mj.theory.control.switching import SWITCHINGS

ROOT = Path(__file__).parents[1]
LOADED = {("script", "src"), ("img", "src"), ("iframe", "src"), ("link", "href")}


class Links(HTMLParser):
    """Targets that a page links to, files that it loads, and anchors that it has."""

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
    """Return every page of the site as it is built, or as it lies in ``SITE``."""
    if "SITE" in os.environ:
        folder = Path(os.environ["SITE"]).resolve()
    else:
        folder = tmp_path_factory.mktemp("site").resolve()
        command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", folder]
        subprocess.run(command, cwd=ROOT, check=True)
    return {page: Links(page) for page in folder.rglob("*.html") if page.name != "404.html"}


def is_broken(target: str, page: Path, site: dict[Path, Links]) -> bool:
    """Return True if a link leads to a file or a place in it that does not exist."""
    parts = urlsplit(target)
    if parts.scheme:
        return False
    file = page
    if parts.path:
        file = (page.parent / unquote(parts.path)).resolve()
    if not file.exists():
        return True
    anchor = unquote(parts.fragment)
    return bool(anchor) and anchor not in site[file].anchors


@pytest.mark.slow
def test_no_link_is_broken(site: dict[Path, Links]) -> None:
    broken = []
    for page, links in site.items():
        targets = [target for target in links.targets if is_broken(target, page, site)]
        broken += [(page.name, target) for target in targets]
    assert not broken


@pytest.mark.slow
def test_no_page_loads_a_file_from_elsewhere(site: dict[Path, Links]) -> None:
    loaded = set().union(*(links.loaded for links in site.values()))
    assert not [target for target in loaded if "//" in target]


@pytest.mark.slow
def test_the_map_leads_to_lines(site: dict[Path, Links]) -> None:
    (page,) = [links for page, links in site.items() if page.name == "map.html"]
    lines = [target for target in page.targets if "codelineno" in target]
    files = {place for place in PLACES if place[0].endswith(".py")}
    assert len(lines) >= len(files)

    text = (ROOT / "grosmc_mj/theory/control/laws.py").read_text()
    number = repository.line_of(text, "grosmc")
    assert text.splitlines()[number - 1].startswith("def grosmc")
    assert f"repository/grosmc_mj/theory/control/laws.py.html#__codelineno-0-{number}" in lines


MODULES = (studies, control, environments, films, loop, machine, physics, simulation)


@pytest.mark.slow
@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_every_public_name_is_on_the_pages_of_the_site(
    module: ModuleType, site: dict[Path, Links]
) -> None:
    anchors = set().union(*(links.anchors for links in site.values()))
    # A module has a page of its own.
    names = [name for name in module.__all__ if not inspect.ismodule(getattr(module, name))]
    assert [name for name in names if f"{module.__name__}.{name}" not in anchors] == []


# The ladder.

TABLES = (ROOT / "docs" / "ladder_tables.md").read_text(encoding="utf-8")
SUMMARY = (ROOT / "docs" / "ladder.md").read_text(encoding="utf-8")
# Systems in the order of the summary's columns.
SYSTEMS = ("servo", "cart_pendulum", "arm", "two_link_arm")
# A law of the summary, and its names in the tables.
LAWS = [
    ("lqr", ("lqr",)),
    ("lqi, quick", ("lqi, quick",)),
    ("adrc", ("adrc",)),
    ("sign", ("sign",)),
    ("implicit", ("implicit",)),
    ("super-twisting", ("super-twisting",)),
    ("grosmc adaptive", ("grosmc adaptive", "adaptive")),
]


def rows(text: str) -> list[list[str]]:
    """Return the cells of the tables of a text in Markdown."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def row_of(text: str, names: tuple[str, ...]) -> list[str]:
    """Return the cells of the first name that a table has a row of, without the name."""
    cells = {row[0]: row[1:] for row in reversed(rows(text))}
    for name in names:
        if name in cells:
            return cells[name]
    raise AssertionError(f"no row of {names}")


def first_failing_step(system: str, names: tuple[str, ...]) -> str:
    """Return the first step of a machine on which a law fails; ``kept`` if it fails on none."""
    _, _, after = TABLES.partition(f"**{system}/machine**")
    table, _, _ = after.partition("Each alone")
    steps = [step.strip("\\*") for step in rows(table)[0][1:]]
    for step, cell in zip(steps, row_of(table, names), strict=True):
        # Such as 12x, for twelve times the limit, or 7 of 10 draws.
        verdict = cell.rstrip("?")
        if verdict.endswith(("x", "never", "ended")) or " of " in verdict:
            return step
    return "kept"


@pytest.mark.parametrize(("label", "names"), LAWS, ids=[label for label, _ in LAWS])
def test_the_summary_of_the_ladder_agrees_with_its_tables(
    label: str, names: tuple[str, ...]
) -> None:
    steps = [first_failing_step(system, names) for system in SYSTEMS]
    cells = [re.sub(r" \(.*\)", "", cell.rstrip("?")) for cell in row_of(SUMMARY, (label,))]
    assert cells == steps


# The map.

MAP = (ROOT / "docs" / "map.md").read_text(encoding="utf-8")
# The chapter numbers its equations from (1) to (58).
EQUATIONS = 58
# Files with the names in them that the map leads to.
PLACE = r"`([\w/]+\.(?:py|xml)|[\w/]+/)(?:::(\w+))?`"
PLACES = re.findall(PLACE, MAP)
ARCHITECTURE = doors.PAGE.read_text(encoding="utf-8")
NAMED = [*PLACES, *re.findall(PLACE, ARCHITECTURE)]


def test_every_equation_is_on_the_map() -> None:
    numbers: set[int] = set()
    for first, last in re.findall(r"\((\d+)\)(?:-\((\d+)\))?", MAP):
        numbers.update(range(int(first), int(last or first) + 1))
    assert numbers == set(range(1, EQUATIONS + 1))


@pytest.mark.parametrize(("place", "name"), NAMED, ids=["::".join(place) for place in NAMED])
def test_every_place_on_the_map_and_in_the_architecture_exists(place: str, name: str) -> None:
    candidates = [ROOT / "grosmc_mj" / place, ROOT / "tests" / place, ROOT / place]
    paths = [path for path in candidates if path.exists()]
    assert paths
    if name:
        text = paths[0].read_text(encoding="utf-8")
        assert re.search(rf"^ *(def|class) {name}\b|^{name}\b", text, re.MULTILINE)


# The doors.


def test_drawing_and_table_of_the_doors_are_those_of_the_code() -> None:
    assert doors.DRAWING.read_text(encoding="utf-8") == doors.drawing()
    assert "\n".join(doors.table()) in ARCHITECTURE


def test_table_of_the_laws_numbers_is_that_of_their_classes() -> None:
    assert law_numbers.table() in law_numbers.PAGE.read_text(encoding="utf-8")


def test_the_guide_lists_all_laws_and_switching_laws() -> None:
    guide = law_numbers.PAGE.read_text(encoding="utf-8")
    laws = guide[guide.index("\n## Laws\n") : guide.index("\n### Numbers of the laws\n")]
    named = set(re.findall(r"`([^`]+)`", laws))
    assert {kind.key for kind in KINDS} | set(SWITCHINGS) <= named


DOORS = [door for floor in doors.floors() for door in floor]


@pytest.mark.parametrize("name", DOORS)
def test_a_door_has_the_names_that_it_offers(name: str) -> None:
    door = importlib.import_module(f"grosmc_mj.{name}")
    offered = getattr(door, "__all__", [])
    assert [each for each in offered if not hasattr(door, each)] == []


@pytest.mark.parametrize(
    ("former", "place"),
    [
        ("grosmc_mj.loop", "grosmc_mj.simulation.loop"),
        ("grosmc_mj.results", "grosmc_mj.output.results"),
        ("grosmc_mj.control", "grosmc_mj.theory.control"),
    ],
)
def test_a_module_that_has_moved_says_its_place(former: str, place: str) -> None:
    with pytest.raises(ModuleNotFoundError, match=f"{former} is {place} now"):
        importlib.import_module(former)
    assert importlib.import_module(place)

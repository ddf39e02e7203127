"""The page of results: its words, charts and film, that nothing stops it, that nothing in it runs.

Plotly's script is left out: the tests of the page in a browser have it.
"""

from __future__ import annotations

import base64
import copy
import gzip
import hashlib
import json
import os
import re
import tempfile
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from page_documents import (
    CURVES,
    DOCUMENTS,
    LADDER,
    RUN,
    write_document,
    write_documents,
    write_film,
)
from printed import Printed
from syrupy.assertion import SnapshotAssertion

from grosmc_mj.output.charts.interactive import PageFigure, page_figure
from grosmc_mj.output.page import reading, write
from grosmc_mj.output.page.curves import curves_chart
from grosmc_mj.output.page.reading import Curves, read_results
from grosmc_mj.output.page.verdicts import stories
from grosmc_mj.output.page.write import Page, write_page
from grosmc_mj.output.results.result import ReportTable, Standing
from grosmc_mj.output.results.tables import Column, numbers, table, verdicts, words
from grosmc_mj.output.results.tables import text as prose

HOSTILE = "</script><script>window.stolen=1</script><img src=x onerror=alert(1)>'\"&{{7*7}}"


@pytest.fixture(scope="module", autouse=True)
def _without_plotly() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(write, "plotly_script", lambda: "plotly();")
        yield


class Reader(HTMLParser):
    """Lines that a reader sees of a page, and addresses and scripts that could lead elsewhere."""

    LINKS = ("src", "href", "action", "data", "xlink:href")
    INSIDE = ("#", "data:,", "data:video/mp4;base64,", "data:image/png;base64,")
    INLINE = ("span", "b", "small", "code", "li", "a", "svg")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: list[str | None] = []
        self.odd: list[str] = []
        self.lines: list[str] = []
        self._hidden = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self._hidden = tag in ("script", "style")
        if tag == "script":
            self.scripts.append(given.get("type"))
        elif tag in ("td", "th"):
            self.lines[-1] += " | "
        elif tag not in self.INLINE:
            self.lines.append("#" * int(tag[1]) + " " if tag in ("h1", "h2", "h3") else "")
        elif tag == "span":
            self.lines[-1] += f"({given['class']}) "
        for name, value in attrs:
            leads_out = name in self.LINKS and not (value or "").startswith(self.INSIDE)
            if leads_out or name.startswith("on"):
                self.odd.append(f"{tag} {name}={value}")

    def handle_endtag(self, tag: str) -> None:
        self._hidden = False

    def handle_data(self, data: str) -> None:
        if not self._hidden and data.strip():
            self.lines[-1] += f"{' '.join(data.split())} "


class Written(NamedTuple):
    """A page, its HTML, its figures, and the lines that a reader sees."""

    page: Page
    text: str
    figures: Any
    lines: list[str]


def page_of(folder: Path) -> Written:
    """Write the page of a folder; check that nothing in it runs or leads elsewhere."""
    page = write_page(read_results([folder]), [folder], folder / "out" / "r.html")
    text = page.path.read_text(encoding="utf-8")
    reader = Reader(text)
    assert reader.odd == []
    assert [kind for kind in reader.scripts if kind != "text/plain"] == [None, None]
    packed = re.search(r'<script type="text/plain" id="figures">([^<]*)</script>', text)
    assert packed is not None
    figures = json.loads(gzip.decompress(base64.b64decode(packed[1])))
    lines = [line.strip() for line in reader.lines if line.strip(" #|")]
    return Written(page, text, figures, lines)


# Documents of any content.


def change(content: Any, draw: Any, value: Any) -> None:
    """Remove or replace one value somewhere in a document."""
    parent, place, key = content, content, None
    while isinstance(place, dict | list) and len(place):
        keys = sorted(place) if isinstance(place, dict) else list(range(len(place)))
        parent, key = place, draw(st.sampled_from(keys))
        place = parent[key]
        if draw(st.booleans()):
            break
    if key is not None and draw(st.booleans()):
        del parent[key]
    elif key is not None:
        parent[key] = copy.deepcopy(value)


NUMBERS = [0, -1, 10**400, 1e308, -1e308, float("nan"), float("inf")]
LISTS = [[], [[[[]]]], [1.0], [None], [[1.0]], ["a", "b"]]
OTHERS = [None, True, HOSTILE, "", {}, {HOSTILE: HOSTILE}]
VALUES = st.sampled_from([*NUMBERS, *LISTS, *OTHERS]) | st.text(max_size=20)


@given(st.data())
@settings(max_examples=10)
def test_no_mixture_of_results_stops_the_page(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in data.draw(st.lists(st.sampled_from(sorted(DOCUMENTS)), unique=True)):
            content = copy.deepcopy(DOCUMENTS[kind])
            for _ in range(data.draw(st.integers(0, 5))):
                change(content, data.draw, data.draw(VALUES))
            text = json.dumps(content)
            end = data.draw(st.none() | st.integers(0, len(text)))
            (folder / f"{kind}.json").write_text(text[:end], encoding="utf-8")
        (folder / "odd.json").write_bytes(data.draw(st.binary(max_size=30)))
        page_of(folder)


# Fields whose texts have a fixed form.
FIXED = {"colour", "verdict", "standard", "form", "kind", "letter", "grid"}


def with_hostile_texts(value: Any, key: str = "") -> Any:
    """Copy of a document with a hostile text in place of every free text."""
    if isinstance(value, dict):
        return {name: with_hostile_texts(item, name) for name, item in value.items()}
    if isinstance(value, list):
        return [with_hostile_texts(item, key) for item in value]
    if isinstance(value, str) and key not in FIXED:
        return HOSTILE
    return value


def test_a_text_of_somebody_else_stays_text(tmp_path: Path) -> None:
    for kind, content in DOCUMENTS.items():
        plain = json.loads(json.dumps(content))
        write_document(tmp_path / f"{kind}.json", with_hostile_texts(plain))
    written = page_of(tmp_path)
    # The template would make 49 of it.
    assert "{{7*7}}" in written.text
    assert len(written.page.answers) == 4


# The page of all documents.


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    return page_of(write_documents(tmp_path_factory.mktemp("results")))


def test_the_policy_lets_two_scripts_run_and_nothing_out(written: Written) -> None:
    found = re.search(r'Security-Policy" content="([^"]*)"', written.text)
    assert found is not None
    directives = found[1].replace("&#39;", "'").split("; ")
    policy = dict(directive.split(" ", 1) for directive in directives)
    scripts = re.findall(r"<script>(.*?)</script>", written.text, re.DOTALL)
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()) for text in scripts]
    assert policy["script-src"] == " ".join(f"'sha256-{digest.decode()}'" for digest in digests)
    assert policy["default-src"] == "'none'"
    assert {"connect-src", "frame-src", "font-src"}.isdisjoint(policy)


def test_the_words_of_the_page(written: Written, snapshot: SnapshotAssertion) -> None:
    """Without the provenance of documents; classes of verdicts stand in brackets."""
    end = written.lines.index("## Where it comes from")
    shown = "\n".join(written.lines[:end]).replace(str(written.page.path.parents[1]), "FOLDER")
    assert shown == snapshot.use_extension(Printed)


def test_the_page_says_which_commands_made_it_and_its_documents(written: Written) -> None:
    assert f"<code>grosmc-mj report {written.page.path.parents[1]}</code>" in written.text
    made = re.findall(r"<dt>made by</dt><dd><code>([^<]*)", written.text)
    studies = ("run", "ladder", "region", "claims")
    assert made == [f"grosmc-mj {study} servo/case1" for study in studies]


def test_curves_have_numbers_colours_and_windows_of_disturbances(written: Written) -> None:
    _, curves, *_ = written.figures
    (trace,) = (trace for trace in curves["data"] if trace.get("y") == [0.5, 1.0, 0.0])
    assert trace["x"] == [0.0, 1.5, 3.0]
    assert trace["line"]["color"] == "#D55E00"
    spans = [(shape["x0"], shape["x1"]) for shape in curves["layout"]["shapes"]]
    # A window in each panel, and the backlash.
    assert spans == [(1.0, 2.0), (1.0, 2.0), (0, 1)]
    assert curves["layout"]["shapes"][2]["y0"] == -0.25


def test_cells_have_their_values_and_texts(written: Written) -> None:
    cells = written.figures[2]["data"][0]
    assert (cells["z"], cells["text"], cells["customdata"]) == ([[0.5]], [["3"]], [["deviation"]])
    assert (cells["zmin"], cells["zmax"]) == (-2.0, 2.0)


def test_a_grid_has_the_number_of_each_letter(written: Written) -> None:
    grid = written.figures[3]["data"][0]
    assert grid["z"] == [[0, 0], [0, 1]]
    assert (grid["x"], grid["y"]) == ([-0.75, 0.75], [-1.0, 1.0])


def test_lines_have_their_numbers_with_a_hollow_symbol_where_not_kept(written: Written) -> None:
    lines = written.figures[4]
    (series,) = lines["data"]
    assert (series["x"], series["y"]) == ([50.0, 100.0], [2.0, None])
    assert series["marker"]["symbol"] == ["circle-open", "circle"]
    assert [shape["x0"] for shape in lines["layout"]["shapes"]] == [62.5, 0]


# Curves.


def read(content: dict[str, Any]) -> Curves:
    """Read curves as the page does, from JSON."""
    return Curves.model_validate_json(json.dumps(content))


def figure(panel: dict[str, Any], **fields: Any) -> PageFigure:
    """Return the figure of a case with one panel."""
    content = {**CURVES, "panels": [{"label": "angle [rad]", **panel}], **fields}
    curves = read(content)
    return page_figure(curves_chart(curves, curves.panels))


def law_curve(law: str, plant: str = "physics", last: float = 1.0) -> dict[str, Any]:
    return {"law": law, "plant": plant, "t": [0.0, 3.0], "y": [0.0, last]}


def limit(value: float, words: str = "stays within") -> dict[str, Any]:
    return {"words": words, "t": [0.0, 3.0], "y": [value, value]}


@pytest.mark.parametrize(("last", "lines"), [(2.0, 1), (2.019, 1), (2.021, 2)])
def test_equations_that_coincide_with_mujoco_are_one_line(last: float, lines: int) -> None:
    """They do up to one per cent of the range."""
    curves = [law_curve("lqr", last=2.0), law_curve("lqr", "corrected", last)]
    assert len(figure({"curves": curves}).data) == lines


@pytest.mark.parametrize("count", [1, 7, 8, 20])
def test_a_legend_has_at_most_eight_entries(count: int) -> None:
    laws = [f"law {number}" for number in range(count)]
    panel = {"curves": [law_curve(law) for law in laws], "limits": [limit(2.0)]}
    legend = figure(panel, laws={law: {"colour": "#D55E00"} for law in laws}).legend
    assert len(legend) == min(count + 1, 8)
    assert legend[-1].name == "limit"


@pytest.mark.parametrize(
    ("value", "text", "on_axis"),
    [
        (1.4, "1.4", True),
        (-0.4, "-0.4", True),
        (1.6, "↑ 1.6", False),
        (50.0, "↑ 50", False),
        (-9.0, "↓ -9", False),
    ],
)
def test_a_limit_far_outside_is_an_arrow_with_its_number(
    value: float, text: str, on_axis: bool
) -> None:
    """It is on the axis up to half the curves' range away."""
    layout = figure({"curves": [law_curve("lqr")], "limits": [limit(value)]}).layout
    low, high = layout["yaxis"]["range"]
    assert (low < value < high) is on_axis
    assert low < 0.0 < 1.0 < high
    assert [note["text"] for note in layout["annotations"]] == ["angle [rad]", text]


def test_of_two_limits_at_one_height_one_has_its_number() -> None:
    """They are at 1.2 and 1.25 of an axis of 1.37."""
    panel = {"curves": [law_curve("lqr")], "limits": [limit(1.2), limit(1.25), limit(0.9)]}
    notes = [note["text"] for note in figure(panel).layout["annotations"]]
    assert notes == ["angle [rad]", "1.2", "0.9"]


# Quantities of a case, words of their limits, and the last values under LQR.
QUANTITIES = [
    ("angle [rad]", "stays within 2", 3.0),
    ("rate [rad/s]", "stays within 20 rad/s", 1.0),
    ("current [A]", "", -1.0),
]
# Range of the current under LQR, which switches.
SWITCHED = ([-9.0, -9.0], [2.0, 2.0])


def story_of(*standings: Standing) -> tuple[str, str]:
    """Return quantity and sentence of a case in which grosmc is at 1."""
    panels = []
    for label, requirement, largest in QUANTITIES:
        curves = [law_curve("lqr", last=largest), law_curve("grosmc")]
        if label == "current [A]":
            curves[0]["range"] = SWITCHED
        limits = [limit(2.0, requirement)] if requirement else []
        panels.append({"label": label, "curves": curves, "limits": limits})
    curves = read({**CURVES, "panels": panels})
    verdicts_of = {standing.law: standing for standing in standings}
    (story,) = stories({("servo", "case1"): curves}, {"servo/case1": verdicts_of})
    return story.panel.label, story.sentence


def standing(law: str, requirement: str = "", share: float = 0.5) -> Standing:
    """Standing of a law that keeps everything or breaks a requirement."""
    words = f"{share:g} of the limit"
    breaks_at = "physics" if requirement else ""
    return Standing(
        case="servo/case1",
        law=law,
        breaks_at=breaks_at,
        requirement=requirement,
        words=words,
        share=share,
    )


@pytest.mark.parametrize(
    ("requirement", "label"),
    [("stays within 20 rad/s", "rate [rad/s]"), ("no reaching phase", "current [A]")],
    ids=["of a curve, though another one's begins alike", "of no curve"],
)
def test_the_missed_quantity_is_shown_or_else_that_in_which_laws_differ_most(
    requirement: str, label: str
) -> None:
    assert story_of(standing("lqr", requirement, 1.5))[0] == label


@pytest.mark.parametrize(
    ("standings", "sentence"),
    [
        (
            [standing("lqr"), standing("grosmc")],
            "Each of 2 laws keeps everything; largest current: 1 A under grosmc, 9 A under lqr.",
        ),
        (
            [standing("lqr", "a", 1.5), standing("pd", "a", 3), standing("x")],
            "pd breaks a requirement (3 of the limit), and so does 1 more; x keeps everything.",
        ),
        ([], "Largest current: 1 A under grosmc, 9 A under lqr."),
    ],
    ids=["kept", "broken", "nothing required"],
)
def test_a_sentence_says_who_keeps_everything_and_how_far_laws_are_apart(
    standings: list[Standing], sentence: str
) -> None:
    assert story_of(*standings)[1] == sentence


def test_of_a_system_the_case_in_which_some_laws_break_a_requirement_is_told() -> None:
    """Not that of the same curves in which all keep everything."""
    names = ("case1", "case2", "case3")
    curves = {("servo", name): read({**CURVES, "case": name}) for name in names}
    kept = {"lqr": standing("lqr"), "grosmc": standing("grosmc")}
    broken = kept | {"lqr": standing("lqr", "stays within 2", 1.5)}
    verdicts_of = {"servo/case1": kept, "servo/case2": broken, "servo/case3": kept}
    (story,) = stories(curves, verdicts_of)
    assert story.curves.case == "case2"


# Pages of some documents.


def test_a_case_in_which_nothing_is_required_is_not_in_the_tables(tmp_path: Path) -> None:
    standings = [
        {"case": "servo/case1", "law": "grosmc", "words": "settles within 1 s: 0.5 s"},
        {"case": "arm/case1", "law": "lqr", "required": False, "words": "as before"},
    ]
    content = {**RUN, "kind": "validation", "standings": standings}
    write_document(tmp_path / "validation.json", content)
    text = page_of(tmp_path).text
    assert 'data-header="servo"' in text
    assert 'data-header="arm"' not in text


@pytest.mark.parametrize("curves", [[], [{"law": "lqr", "plant": "physics", "t": [], "y": []}]])
def test_a_panel_without_a_curve_has_a_page(tmp_path: Path, curves: list[Any]) -> None:
    panel = {"label": "angle [rad]", "curves": curves}
    write_document(tmp_path / "curves.json", {**CURVES, "panels": [panel]})
    assert "there are no curves" in page_of(tmp_path).text


def write_verdict(path: Path, words: str, modified: float) -> None:
    """Write a run's verdict, in a file that was modified then [s]."""
    standing = {"case": "servo/case1", "law": "lqr", "words": words}
    write_document(path, {**RUN, "standings": [standing]})
    os.utime(path, (modified, modified))


def test_the_newer_of_two_results_counts(tmp_path: Path) -> None:
    for name, title, modified in (("a", "newer", 2000), ("b", "older", 1000)):
        write_verdict(tmp_path / f"{name}.json", title, modified)
        curves = write_document(tmp_path / f"curves_{name}.json", {**CURVES, "title": title})
        os.utime(curves, (modified, modified))
    assert "older" not in page_of(tmp_path).text


def test_a_document_that_is_too_large_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "_LARGEST_DOCUMENT", 2**20)
    write_documents(tmp_path, "curves")
    (tmp_path / "run.json").write_text(json.dumps(RUN) + " " * 2**20, encoding="utf-8")
    assert page_of(tmp_path).page.notices == [f"{tmp_path / 'run.json'}: is larger than 1 MB"]


def test_a_result_that_was_set_aside_is_marked(tmp_path: Path) -> None:
    """It is of another configuration, so its verdicts are in no table of laws."""
    write_verdict(tmp_path / "servo.json", "later", 2000)
    write_document(tmp_path / "servo.previous2.json", LADDER)
    text = page_of(tmp_path).text
    assert "<b>Ladder of servo, from an earlier run</b>" in text
    assert "3 times the limit" not in text
    assert text.count("from an earlier run") == 2


@pytest.mark.parametrize(
    ("columns", "form"),
    [
        ([*words("premise"), *numbers("margin"), *verdicts(), *prose("required")], "wide stacked"),
        ([*words("case"), *numbers("lqr", "grosmc", "sign")], "wide"),
        ([*words("servo-stable"), *prose("SUPPORTED")], "wide"),
        ([*words("a", "b", "c"), *numbers("d", "e", "f", "g")], "wide"),
    ],
    ids=["words", "numbers", "two columns", "seven columns"],
)
def test_rows_of_words_are_cards_on_a_narrow_screen(
    tmp_path: Path, columns: list[Column], form: str
) -> None:
    sheet = ReportTable(table=table("rows", columns, [["x"] * len(columns)]))
    write_document(tmp_path / "ladder.json", {**LADDER, "sheets": [sheet.model_dump()]})
    region = f'<div class="{form}" tabindex="0" role="region" aria-label="rows">'
    assert region in page_of(tmp_path).text


def test_an_interrupted_result_is_named(tmp_path: Path) -> None:
    write_document(tmp_path / "ladder.json", {**LADDER, "standings": [], "complete": False})
    assert "1 of the results were interrupted and are not complete" in page_of(tmp_path).text


def test_a_film_is_in_the_page_with_its_start_and_speed(tmp_path: Path) -> None:
    write_documents(tmp_path, "curves")
    content = b"film" * 100_000
    write_film(tmp_path, content)
    page, text, *_ = page_of(tmp_path)
    (film,) = re.findall(r"data:video/mp4;base64,([^\"]*)", text)
    assert base64.b64decode(film) == content
    assert 'data-start="0.25" data-speed="0.5"' in text
    assert page.notices == []
    assert page.size == page.path.stat().st_size


def test_a_film_that_is_not_that_of_its_document_is_named(tmp_path: Path) -> None:
    write_documents(tmp_path, "curves")
    write_film(tmp_path, b"film")
    (tmp_path / "film.mp4").write_bytes(b"another")
    assert "is not the film" in page_of(tmp_path).page.notices[0]


# The command.


@pytest.mark.parametrize("kinds", [["run", "curves", "film"], []], ids=["readable", "unreadable"])
def test_the_command_names_its_page_and_the_files_that_it_leaves_out(
    kinds: list[str], tmp_path: Path, printed: Callable[..., None]
) -> None:
    """Without a readable file it writes no page."""
    for kind in kinds:
        write_documents(tmp_path, kind)
    (tmp_path / "torn.json").write_text('{"schema_version": 1, "claims": [', encoding="utf-8")
    write_document(tmp_path / "old.json", {"schema_version": 1, "answers": 3, "kind": "run"})
    printed("report", ".")
    assert (tmp_path / "report.html").exists() == bool(kinds)

"""The page of results: its content, that nothing stops it, that nothing in it runs."""

from __future__ import annotations

import base64
import contextlib
import copy
import gzip
import io
import json
import os
import re
import tempfile
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from commands import Screen, run
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
from plotly.offline import get_plotlyjs

from grosmc_mj import cli
from grosmc_mj.output.charts.interactive import PageFigure, page_figure
from grosmc_mj.output.page.curves import curves_chart
from grosmc_mj.output.page.reading import Curves, read_results
from grosmc_mj.output.page.write import Page, write_page
from grosmc_mj.output.results.result import ReportTable
from grosmc_mj.output.results.tables import Column, numbers, table, verdicts, words
from grosmc_mj.output.results.tables import text as prose

HOSTILE = "</script><script>window.stolen=1</script><img src=x onerror=alert(1)>'\"&{{7*7}}"


class Tags(HTMLParser):
    """Types of the scripts of a page, and attributes that could run or lead elsewhere."""

    LINKS = ("src", "href", "action", "data", "xlink:href")
    INSIDE = ("#", "data:,", "data:video/mp4;base64,", "data:image/png;base64,")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: list[str | None] = []
        self.odd: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "script":
            self.scripts.append(dict(attrs).get("type"))
        for name, value in attrs:
            leads_out = name in self.LINKS and not (value or "").startswith(self.INSIDE)
            if leads_out or name.startswith("on"):
                self.odd.append(f"{tag} {name}={value}")


class Written(NamedTuple):
    """A page, its text without Plotly, and the figures in it."""

    page: Page
    text: str
    figures: Any


def page_of(folder: Path) -> Written:
    """Write the page of a folder; check that nothing in it runs or leads elsewhere."""
    page = write_page(read_results([folder]), [folder], folder / "out" / "r.html")
    # Parsing Plotly takes a second.
    text = page.path.read_text(encoding="utf-8").replace(get_plotlyjs(), "")

    tags = Tags(text)
    assert tags.odd == []
    assert [kind for kind in tags.scripts if kind != "text/plain"] == [None, None]

    packed = re.search(r'<script type="text/plain" id="figures">([^<]*)</script>', text)
    assert packed is not None
    figures = json.loads(gzip.decompress(base64.b64decode(packed[1])))
    return Written(page, text, figures)


# Documents of any content.


def change(content: Any, draw: Any, value: Any) -> None:
    """Remove or replace one value somewhere in a document."""
    parent = content
    place = content
    key = None
    while isinstance(place, dict | list) and len(place):
        keys = sorted(place) if isinstance(place, dict) else list(range(len(place)))
        parent = place
        key = draw(st.sampled_from(keys))
        place = parent[key]
        if draw(st.booleans()):
            break

    if key is None:
        return
    if draw(st.booleans()):
        del parent[key]
    else:
        parent[key] = copy.deepcopy(value)


NUMBERS = [0, -1, 10**400, 1e308, -1e308, float("nan"), float("inf")]
LISTS = [[], [[[[]]]], [1.0], [None], [[1.0]], ["a", "b"]]
OTHERS = [None, True, HOSTILE, "", {}, {HOSTILE: HOSTILE}]
VALUES = st.sampled_from([*NUMBERS, *LISTS, *OTHERS]) | st.text(max_size=20)


@given(st.data())
@settings(max_examples=20)
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
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_documents(tmp_path_factory.mktemp("results"))


@pytest.fixture(scope="module")
def written(folder: Path) -> Written:
    return page_of(folder)


@pytest.fixture(scope="module")
def policy(written: Written) -> dict[str, str]:
    """Return the directives of the page's security policy, by name."""
    policy = re.search(r'Security-Policy" content="([^"]*)"', written.text)
    assert policy is not None
    directives = policy[1].replace("&#39;", "'").split(";")
    return dict(directive.strip().split(" ", 1) for directive in directives)


def test_the_policy_names_two_scripts(policy: dict[str, str]) -> None:
    assert re.fullmatch(r"('sha256-[\w+/=]+' ?){2}", policy["script-src"])


def test_the_policy_lets_nothing_out(policy: dict[str, str]) -> None:
    assert policy["default-src"] == "'none'"
    assert {"connect-src", "frame-src", "font-src"}.isdisjoint(policy)


def test_a_film_that_is_missing_is_named(written: Written, folder: Path) -> None:
    assert written.page.notices == [f"{folder / 'film.mp4'}: No such file or directory"]


def test_an_answer_that_is_not_kept_comes_first(written: Written) -> None:
    verdicts = re.findall(r'data-header="verdict"><span class="([\w-]+)">', written.text)
    assert verdicts[:4] == ["not-kept", "measured", "kept", "kept"]


def test_a_system_has_a_mark_and_the_binding_requirement_of_every_law(written: Written) -> None:
    cells = re.findall(r'data-header="servo"><span class="([\w-]+)">.</span>([^<]*)', written.text)
    assert cells == [
        ("not-kept", " stays within 2: 3 rad (case1)"),
        ("kept", " stays within 2: 1 rad (case1)"),
        ("measured", " nothing required"),
    ]


def test_a_verdict_that_is_expected_is_not_called_kept(written: Written) -> None:
    row = re.search(r'<th scope="row">Claims of servo</th>.*', written.text)
    assert row is not None
    assert '<span class="kept">✓</span> as expected</td>' in row[0]


def test_the_first_sentence_names_the_law_that_breaks_a_requirement(written: Written) -> None:
    sentence = "lqr breaks a requirement (stays within 2: 3 rad); grosmc keeps everything."
    assert written.text.index(sentence) < written.text.index("<table>")


def test_laws_of_studies_are_listed_with_the_rung_that_they_break_at(written: Written) -> None:
    places = re.findall(r'data-header="breaks at"><span class="[\w-]+">.</span>[^<]*', written.text)
    assert [place.partition(">")[2].replace("</span>", "") for place in places] == [
        '<span class="not-kept">✗ friction',
        '<span class="not-decided">? nowhere so far',
    ]


@pytest.fixture(scope="module")
def curve(written: Written) -> dict[str, Any]:
    """Return the curve with the angles of the run under LQR."""
    _, curves, *_ = written.figures
    traces = [trace for trace in curves["data"] if trace.get("y") == [0.5, 1.0, 0.0]]
    return traces[0]


def test_a_curve_has_its_numbers(curve: dict[str, Any]) -> None:
    assert curve["x"] == [0.0, 1.5, 3.0]


def test_a_curve_has_the_colour_of_its_law(curve: dict[str, Any]) -> None:
    assert curve["line"]["color"] == "#D55E00"


def test_each_panel_has_the_windows_of_disturbances(written: Written) -> None:
    _, curves, *_ = written.figures
    assert [shape["x0"] for shape in curves["layout"]["shapes"]] == [1.0, 1.0, 0]


def test_cells_have_their_values(written: Written) -> None:
    _, _, cells, _, _ = written.figures
    assert cells["data"][0]["z"] == [[0.5]]


def test_cells_have_their_texts(written: Written) -> None:
    _, _, cells, _, _ = written.figures
    assert cells["data"][0]["text"] == [["3"]]


def test_a_grid_has_the_number_of_each_letter(written: Written) -> None:
    _, _, _, grid, _ = written.figures
    assert grid["data"][0]["z"] == [[0, 0], [0, 1]]
    assert grid["data"][0]["x"] == [-0.75, 0.75]


def test_lines_have_their_numbers_with_a_hollow_symbol_where_not_kept(written: Written) -> None:
    *_, lines = written.figures
    (series,) = lines["data"]
    assert series["x"] == [50.0, 100.0]
    assert series["y"] == [2.0, None]
    assert series["marker"]["symbol"] == ["circle-open", "circle"]
    assert [shape["x0"] for shape in lines["layout"]["shapes"]] == [62.5, 0]


# Curves.


def figure(panel: dict[str, Any], **fields: Any) -> PageFigure:
    """Return the figure of a case with one panel."""
    content = {**CURVES, "panels": [panel], **fields}
    curves = Curves.model_validate(json.loads(json.dumps(content)))
    return page_figure(curves_chart(curves, curves.panels))


def law_curve(law: str, plant: str, last: float) -> dict[str, Any]:
    return {"law": law, "plant": plant, "t": [0.0, 3.0], "y": [0.0, last]}


@pytest.mark.parametrize(("last", "lines"), [(1.0, 1), (1.005, 1), (1.5, 2)])
def test_equations_that_coincide_with_mujoco_are_one_line(last: float, lines: int) -> None:
    curves = [law_curve("lqr", "physics", 1.0), law_curve("lqr", "corrected", last)]
    assert len(figure({"label": "angle [rad]", "curves": curves}).data) == lines


@pytest.mark.parametrize("count", [1, 7, 8, 20])
def test_a_legend_has_at_most_eight_entries(count: int) -> None:
    laws = [f"law {number}" for number in range(count)]
    panel = {
        "label": "angle [rad]",
        "curves": [law_curve(law, "physics", 1.0) for law in laws],
        "limits": [{"words": "stays within", "t": [0.0, 3.0], "y": [2.0, 2.0]}],
    }
    styles = {law: {"colour": "#D55E00"} for law in laws}
    legend = figure(panel, laws=styles).legend
    assert len(legend) == min(count + 1, 8)
    assert legend[-1].name == "limit"


@pytest.mark.parametrize(
    ("limit", "text", "on_axis"), [(1.2, "1.2", True), (50.0, "↑ 50", False), (-9.0, "↓ -9", False)]
)
def test_a_limit_far_outside_is_an_arrow_with_its_number(
    limit: float, text: str, on_axis: bool
) -> None:
    panel = {
        "label": "angle [rad]",
        "curves": [law_curve("lqr", "physics", 1.0)],
        "limits": [{"words": "stays within", "t": [0.0, 3.0], "y": [limit, limit]}],
    }
    layout = figure(panel).layout
    low, high = layout["yaxis"]["range"]
    assert (low < limit < high) is on_axis
    assert low < 0.0 < 1.0 < high
    assert [note["text"] for note in layout["annotations"]] == ["angle [rad]", text]


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
    write_verdict(tmp_path / "a.json", "newer", 2000)
    write_verdict(tmp_path / "b.json", "older", 1000)
    assert "older" not in page_of(tmp_path).text.partition("All answers")[0]


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
)
def test_rows_of_words_are_cards_on_a_narrow_screen(
    tmp_path: Path, columns: list[Column], form: str
) -> None:
    sheet = ReportTable(table=table("rows", columns, [["x"] * len(columns)]))
    write_document(tmp_path / "ladder.json", {**LADDER, "sheets": [sheet.model_dump()]})
    assert (
        f'<div class="{form}" tabindex="0" role="region" aria-label="rows">'
        in page_of(tmp_path).text
    )


def test_an_interrupted_result_is_named(tmp_path: Path) -> None:
    write_document(tmp_path / "ladder.json", {**LADDER, "standings": [], "complete": False})
    assert "1 of the results were interrupted and are not complete" in page_of(tmp_path).text


def test_a_film_is_in_the_page(tmp_path: Path) -> None:
    write_documents(tmp_path, "curves")
    content = b"film" * 1_000_000
    write_film(tmp_path, content)
    page, text, _ = page_of(tmp_path)
    (film,) = re.findall(r"data:video/mp4;base64,([^\"]*)", text)
    assert base64.b64decode(film) == content
    assert page.notices == []
    assert page.size == page.path.stat().st_size


def test_a_page_has_start_and_speed_of_a_film(tmp_path: Path) -> None:
    write_documents(tmp_path, "curves")
    write_film(tmp_path, b"film")
    assert 'data-start="0.25" data-speed="0.5"' in page_of(tmp_path).text


def test_a_film_that_is_not_that_of_its_document_is_named(tmp_path: Path) -> None:
    write_documents(tmp_path, "curves")
    write_film(tmp_path, b"film")
    (tmp_path / "film.mp4").write_bytes(b"another")
    assert "is not the film" in page_of(tmp_path).page.notices[0]


# The command.

TORN = '{"schema_version": 1, "claims": ['
OLD = '{"schema_version": 1, "answers": 3, "kind": "run"}'


def test_the_command_refuses_a_folder_without_a_readable_file(
    tmp_path: Path, capsys: Screen
) -> None:
    torn = write_text(tmp_path / "torn.json", TORN)
    old = write_text(tmp_path / "old.json", OLD)
    assert run("report", tmp_path) == cli.WRONG
    error = capsys.readouterr().err
    assert f"unreadable: {torn}: is no whole JSON" in error
    assert f"unreadable: {old}: unknown schema_version 1: valid: 2" in error


class Reported(NamedTuple):
    """A folder with a torn file, the command's output on it, and the text of its page."""

    folder: Path
    output: str
    text: str


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Reported:
    folder = write_documents(tmp_path_factory.mktemp("reported"))
    write_text(folder / "torn.json", TORN)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert run("report", folder) == cli.DONE
    output = " ".join(printed.getvalue().split())
    text = (folder / "report.html").read_text(encoding="utf-8")
    return Reported(folder, output, text)


def test_the_command_names_its_page(reported: Reported) -> None:
    assert f"{reported.folder / 'report.html'}" in reported.output


def test_the_command_names_a_file_that_it_leaves_out(reported: Reported) -> None:
    torn = reported.folder / "torn.json"
    assert f"left out: {torn}: is no whole JSON" in reported.output


def test_the_page_has_the_commands_of_its_documents(reported: Reported) -> None:
    assert "grosmc-mj run servo/case1" in reported.text


def test_the_page_has_its_own_command(reported: Reported) -> None:
    assert f"grosmc-mj report {reported.folder}" in reported.text


def write_text(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_notes_on_a_verdict_stand_under_the_verdicts(tmp_path: Path) -> None:
    write_document(tmp_path / "run.json", RUN)
    text = page_of(tmp_path).text
    note = "<li>Run of servo: the load on &lt;b&gt;rotor&lt;/b&gt; is unmatched</li>"
    assert note in text

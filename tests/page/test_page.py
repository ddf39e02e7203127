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
    CLAIM,
    CLAIMS,
    DOCUMENTS,
    LADDER,
    RUN,
    write_document,
    write_documents,
    write_film,
)
from plotly.offline import get_plotlyjs

from grosmc_mj import cli
from grosmc_mj.page.reading import read_results
from grosmc_mj.page.write import Page, write_page

HOSTILE = "</script><script>window.stolen=1</script><img src=x onerror=alert(1)>'\"&{{7*7}}"


class Tags(HTMLParser):
    """Types of the scripts of a page, and attributes that could run or lead elsewhere."""

    LINKS = ("src", "href", "action", "data", "xlink:href")
    INSIDE = ("#", "data:,", "data:video/mp4;base64,")

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
FIXED = {"colour", "verdict", "form", "kind", "letter", "grid"}


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


UNREADABLE = [
    r"\frac{" * 300,
    r"\href{javascript:alert(1)}{x}",
    r"\input{/etc/passwd}",
    r"\alpha" * 1000,
]


@pytest.mark.parametrize(
    ("formula", "shown"),
    [
        (r"\tfrac12 \dot q^2 \le \varepsilon", "1/2 q̇^2 ≤ ε"),
        (r"\text{<script>alert(1)</script>}", "&lt;script&gt;alert(1)&lt;/script&gt;"),
        ("<b>", "&lt;b&gt;"),
        # A formula that cannot be read stays as it is.
        *[(formula, formula) for formula in UNREADABLE],
    ],
)
def test_a_formula_is_a_line_of_text(formula: str, shown: str, tmp_path: Path) -> None:
    claim = {**CLAIM, "equation": formula}
    write_document(tmp_path / "claims.json", {**CLAIMS, "claims": [claim]})
    text = page_of(tmp_path).text
    assert re.findall(r'<p class="equation">([^<]*)</p>', text) == [shown]


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


def test_the_summary_counts_verdicts(written: Written) -> None:
    assert "All requirements are kept by LQR in 0 of 1, GROSMC in 1 of 1." in written.text
    assert "Answers: 1 not kept, 1 measured, 2 kept." in written.text


def test_an_answer_that_is_not_kept_comes_first(written: Written) -> None:
    assert written.page.answers[0].verdict == "not kept"


def test_the_matrix_has_the_standing_of_every_law_in_every_case(written: Written) -> None:
    row = written.text[written.text.index('<th scope="row">servo/case1</th>') :]
    marks = re.findall(r'<span class="mark ([\w-]+)">.</span> ([^<]*)</td>', row)
    assert marks[:2] == [("not-kept", "3 of 2.0e-3 rad"), ("kept", "1 of 2.0e-3 rad")]


def test_laws_of_studies_are_listed_with_the_rung_that_they_break_at(written: Written) -> None:
    text = written.text
    breaks = text[text.index("Where each law breaks first") :]
    assert breaks.index("✗ friction") < breaks.index("? nowhere so far")
    assert "✓ nowhere" not in text


@pytest.fixture(scope="module")
def curve(written: Written) -> dict[str, Any]:
    """Return the curve with the angles of the run under LQR."""
    curves, *_ = written.figures
    traces = [trace for trace in curves["data"] if trace.get("y") == [0.5, 1.0, 0.0]]
    return traces[0]


def test_a_curve_has_its_numbers(curve: dict[str, Any]) -> None:
    assert curve["x"] == [0.0, 1.5, 3.0]


def test_a_curve_has_the_colour_of_its_law(curve: dict[str, Any]) -> None:
    assert curve["line"]["color"] == "#D55E00"


def test_curves_have_the_windows_of_disturbances(written: Written) -> None:
    curves, *_ = written.figures
    assert [shape["x0"] for shape in curves["layout"]["shapes"]] == [1.0, 0, 0]


def test_cells_have_their_values(written: Written) -> None:
    _, cells, _, _ = written.figures
    assert cells["data"][0]["z"] == [[0.5]]


def test_cells_have_their_texts(written: Written) -> None:
    _, cells, _, _ = written.figures
    assert cells["data"][0]["text"] == [["3"]]


def test_a_grid_has_the_number_of_each_letter(written: Written) -> None:
    _, _, grid, _ = written.figures
    assert grid["data"][0]["z"] == [[0, 0], [0, 1]]
    assert grid["data"][0]["x"] == [-0.75, 0.75]


def test_lines_have_their_numbers_with_a_cross_where_not_kept(written: Written) -> None:
    _, _, _, lines = written.figures
    (series,) = lines["data"]
    assert series["x"] == [50.0, 100.0]
    assert series["y"] == [2.0, None]
    assert series["marker"]["symbol"] == ["x", "circle"]
    assert [shape["x0"] for shape in lines["layout"]["shapes"]] == [0, 62.5]


# Pages of some documents.


def test_a_law_of_which_nothing_is_required_stands_by_the_record(tmp_path: Path) -> None:
    """It has another mark, and is not counted among those that keep their requirements."""
    standings = [
        {"case": "servo/case1", "law": "lqr", "required": False, "words": "as before"},
        {"case": "servo/case2", "law": "lqr", "required": False, "breaks_at": "record"},
        {"case": "servo/case1", "law": "grosmc"},
    ]
    content = {**RUN, "kind": "validation", "standings": standings}
    write_document(tmp_path / "validation.json", content)
    text = page_of(tmp_path).text
    marks = re.findall(r'data-law="(\w+)"><span class="mark ([\w-]+)">(.)</span>', text)
    assert marks == [("LQR", "measured", "•"), ("GROSMC", "kept", "✓"), ("LQR", "not-kept", "✗")]
    assert "All requirements are kept by GROSMC in 1 of 1." in text


def write_claim(path: Path, verdict: str, modified: float) -> None:
    """Write a claim with a verdict, in a file that was modified then [s]."""
    claim = {**CLAIM, "verdict": verdict}
    write_document(path, {**CLAIMS, "claims": [claim]})
    os.utime(path, (modified, modified))


def test_the_newer_of_two_results_counts(tmp_path: Path) -> None:
    write_claim(tmp_path / "a.json", "supported", 2000)
    write_claim(tmp_path / "b.json", "refuted", 1000)
    assert re.findall(r'data-verdict="(\w+)"', page_of(tmp_path).text) == ["supported"]


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
    assert text.index(note) < text.index("<summary>All answers</summary>")

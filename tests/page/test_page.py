"""The page of results: its content, that nothing stops it, that nothing in it runs."""

from __future__ import annotations

import base64
import copy
import gzip
import json
import os
import re
import tempfile
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import page_documents as made
import pytest
from commands import run
from hypothesis import given, settings
from hypothesis import strategies as st
from page_documents import DOCUMENTS, write_document, write_documents, write_film
from plotly.offline import get_plotlyjs

from grosmc_mj import cli
from grosmc_mj.page.reading import read_results
from grosmc_mj.page.write import Page, write_page

HOSTILE = "</script><script>window.stolen=1</script><img src=x onerror=alert(1)>'\"&{{7*7}}"


class Tags(HTMLParser):
    """Elements of a page with all that could run or lead elsewhere."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: list[str | None] = []
        self.odd: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.scripts += [dict(attrs).get("type")] if tag == "script" else []
        for name, value in attrs:
            leads = name in ("src", "href", "action", "data", "xlink:href")
            inside = ("#", "data:,", "data:video/mp4;base64,")
            if name.startswith("on") or (leads and not (value or "").startswith(inside)):
                self.odd.append(f"{tag} {name}={value}")


def page_of(folder: Path) -> tuple[Page, str, Any]:
    """The page, its text without Plotly, and its figures; nothing in it runs or leads elsewhere."""
    page = write_page(read_results([folder]), [folder], folder / "out" / "r.html")
    # Parsing Plotly takes a second.
    text = page.path.read_text(encoding="utf-8").replace(get_plotlyjs(), "")
    tags = Tags(text)
    assert tags.odd == []
    assert [kind for kind in tags.scripts if kind != "text/plain"] == [None, None]
    packed = re.search(r'<script type="text/plain" id="figures">([^<]*)</script>', text)
    assert packed is not None
    return page, text, json.loads(gzip.decompress(base64.b64decode(packed[1])))


def change(content: Any, draw: Any, value: Any) -> None:
    """Take away or replace one value somewhere in a document."""
    place, last, key = content, content, None
    while isinstance(place, dict | list) and len(place):
        keys = sorted(place) if isinstance(place, dict) else range(len(place))
        last, key = place, draw(st.sampled_from(list(keys)))
        place = place[key]
        if draw(st.booleans()):
            break
    if key is not None:
        if draw(st.booleans()):
            del last[key]
        else:
            last[key] = copy.deepcopy(value)


VALUES = st.sampled_from(
    [None, True, 0, -1, 10**400, 1e308, -1e308, float("nan"), float("inf"), HOSTILE, "", [], {},
     [[[[]]]], {HOSTILE: HOSTILE}, [1.0], [None], [[1.0]], ["a", "b"]]
) | st.text(max_size=20)  # fmt: skip


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


def test_a_text_of_somebody_else_stays_text(tmp_path: Path) -> None:
    fixed = {"colour", "verdict", "form", "kind", "letter", "grid"}

    def everywhere(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {name: everywhere(item, name) for name, item in value.items()}
        if isinstance(value, list):
            return [everywhere(item, key) for item in value]
        return HOSTILE if isinstance(value, str) and key not in fixed else value

    for kind, content in DOCUMENTS.items():
        write_document(tmp_path / f"{kind}.json", everywhere(json.loads(json.dumps(content))))
    page, text, _ = page_of(tmp_path)
    assert "{{7*7}}" in text  # and not 49
    assert len(page.answers) == 4


@pytest.mark.parametrize(
    ("formula", "shown"),
    [
        (r"\tfrac12 \dot q^2 \le \varepsilon", "1/2 q̇^2 ≤ ε"),
        # Formulas that cannot be read stand as they are.
        (r"\frac{" * 300, r"\frac{" * 300),
        (r"\href{javascript:alert(1)}{x}", r"\href{javascript:alert(1)}{x}"),
        (r"\input{/etc/passwd}", r"\input{/etc/passwd}"),
        (r"\alpha" * 1000, r"\alpha" * 1000),
        # Elements in a formula are text.
        (r"\text{<script>alert(1)</script>}", "&lt;script&gt;alert(1)&lt;/script&gt;"),
        ("<b>", "&lt;b&gt;"),
    ],
)
def test_a_formula_is_a_line_of_text(formula: str, shown: str, tmp_path: Path) -> None:
    claims = {**made.CLAIMS, "claims": [{**made.CLAIM, "equation": formula}]}
    write_document(tmp_path / "claims.json", claims)
    _, text, _ = page_of(tmp_path)
    assert re.findall(r'<p class="equation">([^<]*)</p>', text) == [shown]


def test_the_page_has_the_answers_and_the_numbers_of_its_documents(tmp_path: Path) -> None:
    page, text, (curves, cells, grid, lines) = page_of(write_documents(tmp_path))
    policy = re.search(r'Security-Policy" content="([^"]*)"', text)
    assert policy is not None
    rules = dict(rule.strip().split(" ", 1) for rule in policy[1].replace("&#39;", "'").split(";"))
    assert rules["default-src"] == "'none'"
    # Scripts are named by their hashes, and nothing leaves.
    assert re.fullmatch(r"('sha256-[\w+/=]+' ?){2}", rules["script-src"])
    assert {"connect-src", "frame-src", "font-src"}.isdisjoint(rules)
    # How every law stands in every case.
    assert page.notices == [f"{tmp_path / 'film.mp4'}: No such file or directory"]
    assert "All requirements are kept by LQR in 0 of 1, GROSMC in 1 of 1." in text
    assert "Answers: 1 not kept, 1 measured, 2 kept." in text
    row = text[text.index('<th scope="row">servo/case1</th>') :]
    marks = re.findall(r'<span class="mark ([\w-]+)">.</span> ([^<]*)</td>', row)[:2]
    assert marks == [("not-kept", "3 of 2.0e-3 rad"), ("kept", "1 of 2.0e-3 rad")]
    breaks = text[text.index("Where each law breaks first") :]
    assert breaks.index("✗ friction") < breaks.index("? nowhere so far")
    assert "✓ nowhere" not in text
    assert page.answers[0].verdict == "not kept"
    # Charts.
    angle = next(trace for trace in curves["data"] if trace.get("y") == [0.5, 1.0, 0.0])
    assert (angle["x"], angle["line"]["color"]) == ([0.0, 1.5, 3.0], "#D55E00")
    assert [shape["x0"] for shape in curves["layout"]["shapes"]] == [1.0, 0, 0]
    assert (cells["data"][0]["z"], cells["data"][0]["text"]) == ([[0.5]], [["3"]])
    assert (grid["data"][0]["z"], grid["data"][0]["x"]) == ([[0, 0], [0, 1]], [-0.75, 0.75])
    (series,) = lines["data"]
    assert (series["x"], series["y"]) == ([50.0, 100.0], [2.0, None])
    assert series["marker"]["symbol"] == ["x", "circle"]
    assert [shape["x0"] for shape in lines["layout"]["shapes"]] == [0, 62.5]


def test_a_law_of_which_nothing_is_required_stands_by_the_record(tmp_path: Path) -> None:
    """It keeps nothing: its mark is another one, and it is not counted."""
    standings = [
        {"case": "servo/case1", "law": "lqr", "required": False, "words": "as before"},
        {"case": "servo/case2", "law": "lqr", "required": False, "breaks_at": "record"},
        {"case": "servo/case1", "law": "grosmc"},
    ]
    content = {**made.RUN, "kind": "validation", "standings": standings}
    write_document(tmp_path / "validation.json", content)
    # The newer of two results counts, and an interrupted one is named.
    for name, verdict, modified in (("a", "supported", 2000), ("b", "refuted", 1000)):
        claims = {**made.CLAIMS, "claims": [{**made.CLAIM, "verdict": verdict}]}
        os.utime(write_document(tmp_path / f"{name}.json", claims), (modified, modified))
    write_document(tmp_path / "ladder.json", {**made.LADDER, "standings": [], "complete": False})
    _, text, _ = page_of(tmp_path)
    marks = re.findall(r'data-law="(\w+)"><span class="mark ([\w-]+)">(.)</span>', text)
    expected = [("LQR", "measured", "•"), ("GROSMC", "kept", "✓"), ("LQR", "not-kept", "✗")]
    assert marks == expected
    assert "All requirements are kept by GROSMC in 1 of 1." in text
    assert re.findall(r'data-verdict="(\w+)"', text) == ["supported"]
    assert "1 of the results were interrupted and are not complete" in text


def test_a_film_is_in_the_page_or_named(tmp_path: Path) -> None:
    write_documents(tmp_path, "curves")
    content = b"film" * 1_000_000
    write_film(tmp_path, content)
    page, text, _ = page_of(tmp_path)
    (film,) = re.findall(r"data:video/mp4;base64,([^\"]*)", text)
    assert base64.b64decode(film) == content
    assert page.notices == []
    assert page.size == page.path.stat().st_size
    (tmp_path / "film.mp4").write_bytes(b"another")
    assert "is not the film" in page_of(tmp_path)[0].notices[0]


def test_the_command_makes_a_page_and_names_files_that_it_cannot_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torn, old = tmp_path / "torn.json", tmp_path / "old.json"
    torn.write_text('{"schema_version": 1, "claims": [', encoding="utf-8")
    old.write_text('{"schema_version": 1, "answers": 3, "kind": "run"}', encoding="utf-8")
    assert run("report", tmp_path) == cli.WRONG
    error = capsys.readouterr().err
    assert f"unreadable: {torn}: is no whole JSON" in error
    assert f"unreadable: {old}: schema_version: Input should be 2" in error
    write_documents(tmp_path)
    assert run("report", tmp_path) == cli.DONE
    output = " ".join(capsys.readouterr().out.split())
    assert f"{tmp_path / 'report.html'}" in output
    assert f"left out: {torn}: is no whole JSON" in output
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    # The command that made a document, and the one that makes this page again.
    assert "grosmc-mj run servo/case1" in text
    assert f"grosmc-mj report {tmp_path}" in text

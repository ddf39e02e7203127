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

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from page_documents import (
    CLAIM,
    CLAIMS,
    DOCUMENTS,
    LADDER,
    write_document,
    write_documents,
    write_film,
)
from plotly.offline import get_plotlyjs

from grosmc_mj.errors import ArgumentError
from grosmc_mj.page.equations import mathml
from grosmc_mj.page.reading import read_results
from grosmc_mj.page.write import LARGEST, Page, write_page

HOSTILE = "</script><script>window.stolen=1</script><img src=x onerror=alert(1)>'\"&{{7*7}}"


class Tags(HTMLParser):
    """Elements of a page with all that could run or lead elsewhere."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: list[str | None] = []
        self.odd: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "script":
            self.scripts.append(dict(attrs).get("type"))
        for name, value in attrs:
            leads = name in ("src", "href", "action", "data", "xlink:href")
            inside = ("#", "data:,", "data:video/mp4;base64,")
            if name.startswith("on") or (leads and not (value or "").startswith(inside)):
                self.odd.append(f"{tag} {name}={value}")


def page_of(folder: Path, shrink: Any = lambda film, most: None) -> tuple[Page, str]:
    page = write_page(read_results([folder]), [folder], folder / "out" / "r.html")
    # Parsing Plotly takes a second.
    return page, page.path.read_text(encoding="utf-8").replace(get_plotlyjs(), "")


def figures_in(text: str) -> Any:
    packed = re.search(r'<script type="text/plain" id="figures">([^<]*)</script>', text)
    assert packed is not None
    return json.loads(gzip.decompress(base64.b64decode(packed[1])))


def assert_safe(text: str) -> None:
    tags = Tags(text)
    assert tags.odd == []
    assert [kind for kind in tags.scripts if kind != "text/plain"] == [None, None]


def changed(content: Any, draw: Any, value: Any) -> None:
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


VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from([0, -1, 10**400, 1e308, -1e308, float("nan"), float("inf"), HOSTILE, ""]),
    st.text(max_size=20),
    st.sampled_from([[], {}, [[[[]]]], {HOSTILE: HOSTILE}, [1.0], [None], [[1.0]], ["a", "b"]]),
)


@given(st.data())
@settings(max_examples=40, deadline=None)
def test_no_mixture_of_results_stops_the_page(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in data.draw(st.lists(st.sampled_from(sorted(DOCUMENTS)), unique=True)):
            content = copy.deepcopy(DOCUMENTS[kind])
            for _ in range(data.draw(st.integers(0, 3))):
                changed(content, data.draw, data.draw(VALUES))
            text = json.dumps(content)
            end = data.draw(st.none() | st.integers(0, len(text)))
            (folder / f"{kind}.json").write_text(text[:end], encoding="utf-8")
        if data.draw(st.booleans()):
            (folder / "odd.json").write_bytes(data.draw(st.binary(max_size=30)))
        _, text = page_of(folder)
        assert_safe(text)
        figures_in(text)


def test_a_text_of_somebody_else_stays_text(tmp_path: Path) -> None:
    fixed = {"colour", "verdict", "form", "kind", "letter", "grid"}

    def everywhere(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {name: everywhere(each, name) for name, each in value.items()}
        if isinstance(value, list):
            return [everywhere(each, key) for each in value]
        return HOSTILE if isinstance(value, str) and key not in fixed else value

    for kind, content in DOCUMENTS.items():
        write_document(tmp_path / f"{kind}.json", everywhere(json.loads(json.dumps(content))))
    page, text = page_of(tmp_path)
    assert_safe(text)
    assert "{{7*7}}" in text  # and not 49
    assert len(page.answers) == 4


def test_the_policy_names_the_scripts_by_their_hashes_and_nothing_leaves(tmp_path: Path) -> None:
    _, text = page_of(write_documents(tmp_path))
    policy = re.search(r'Security-Policy" content="([^"]*)"', text)
    assert policy is not None
    rules = dict(rule.strip().split(" ", 1) for rule in policy[1].replace("&#39;", "'").split(";"))
    assert rules["default-src"] == "'none'"
    assert re.fullmatch(r"('sha256-[\w+/=]+' ?){2}", rules["script-src"])
    assert {"connect-src", "frame-src", "font-src"}.isdisjoint(rules)


def test_the_first_screen_tells_how_each_law_stands_in_each_case(tmp_path: Path) -> None:
    page, text = page_of(write_documents(tmp_path))
    assert page.notices == [f"{tmp_path / 'film.mp4'}: No such file or directory"]
    assert "All requirements are kept by LQR in 0 of 1, GROSMC in 1 of 1." in text
    assert "Answers: 1 not kept, 1 measured, 2 kept." in text
    row = text[text.index('<th scope="row">servo/case1</th>') :]
    (first, second) = re.findall(r'<span class="mark ([\w-]+)">.</span> ([^<]*)</td>', row)[:2]
    assert (first, second) == (("not-kept", "3 of 2.0e-3 rad"), ("kept", "1 of 2.0e-3 rad"))
    breaks = text[text.index("Where each law breaks first") :]
    assert breaks.index("✗ friction") < breaks.index("? nowhere so far")
    assert "✓ nowhere" not in text
    assert page.answers[0].verdict == "not kept"


def test_a_law_of_which_nothing_is_required_stands_by_the_record(tmp_path: Path) -> None:
    """It keeps nothing: its mark is another one, and it is not counted."""
    standings = [
        {"case": "servo/case1", "law": "lqr", "required": False, "words": "as before", **more}
        for more in ({}, {"case": "servo/case2", "breaks_at": "record"})
    ] + [{"case": "servo/case1", "law": "grosmc"}]
    content = {**DOCUMENTS["run"], "kind": "validation", "standings": standings}
    write_document(tmp_path / "validation.json", content)
    _, text = page_of(tmp_path)
    marks = re.findall(r'data-law="(\w+)"><span class="mark ([\w-]+)">(.)</span>', text)
    assert marks == [
        ("LQR", "measured", "•"), ("GROSMC", "kept", "✓"), ("LQR", "not-kept", "✗"),
    ]  # fmt: skip
    assert "All requirements are kept by GROSMC in 1 of 1." in text


def test_an_interrupted_result_is_named(tmp_path: Path) -> None:
    write_document(tmp_path / "ladder.json", {**LADDER, "complete": False})
    assert "1 of the results were interrupted and are not complete" in page_of(tmp_path)[1]


def test_charts_have_the_numbers_of_their_documents(tmp_path: Path) -> None:
    _, text = page_of(write_documents(tmp_path))
    curves, cells, grid, lines = figures_in(text)
    angle = next(trace for trace in curves["data"] if trace.get("y") == [0.5, 1.0, 0.0])
    assert (angle["x"], angle["line"]["color"]) == ([0.0, 1.5, 3.0], "#D55E00")
    assert [shape["x0"] for shape in curves["layout"]["shapes"]] == [1.0, 0, 0]
    assert (cells["data"][0]["z"], cells["data"][0]["text"]) == ([[0.5]], [["3"]])
    assert grid["data"][0]["z"] == [[0, 0], [0, 1]]
    assert grid["data"][0]["x"] == [-0.75, 0.75]
    (series,) = lines["data"]
    assert (series["x"], series["y"]) == ([50.0, 100.0], [2.0, None])
    assert series["marker"]["symbol"] == ["x", "circle"]
    assert [shape["x0"] for shape in lines["layout"]["shapes"]] == [0, 62.5]


def test_the_newer_of_two_results_counts(tmp_path: Path) -> None:
    for name, verdict, modified in (("a", "supported", 2000), ("b", "refuted", 1000)):
        claims = {**CLAIMS, "claims": [{**CLAIM, "verdict": verdict}]}
        file = write_document(tmp_path / f"{name}.json", claims)
        os.utime(file, (modified, modified))
    assert re.findall(r'data-verdict="(\w+)"', page_of(tmp_path)[1]) == ["supported"]


def test_a_film_is_shown_or_named(tmp_path: Path) -> None:
    write_documents(tmp_path, "curves")
    write_film(tmp_path, b"film")
    assert f'base64,{base64.b64encode(b"film").decode()}"' in page_of(tmp_path)[1]
    write_film(tmp_path, bytes(LARGEST))
    page, _ = page_of(tmp_path)
    assert page.size < LARGEST
    assert page.notices == [f"{tmp_path / 'film.mp4'}: has no room in a page of 8 MB"]
    (tmp_path / "film.mp4").write_bytes(b"another")
    assert "is not the film" in page_of(tmp_path)[0].notices[0]


def test_a_path_that_is_not_there_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="nowhere does not exist"):
        read_results([tmp_path / "nowhere"])


def test_an_equation_is_mathml_without_links() -> None:
    assert "<mfrac>" in mathml(r"\frac{a}{b}")
    for hostile in (r"\href{javascript:alert(1)}{x}", r"\text{<script>alert(1)</script>}", "<b>"):
        assert (Tags(mathml(hostile)).odd, Tags(mathml(hostile)).scripts) == ([], [])

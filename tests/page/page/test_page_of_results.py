"""The page of results: what it answers, that nothing stops it, that nothing in it runs."""

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

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from page_documents import DOCUMENTS, write_documents, write_film, write_part
from plotly.offline import get_plotlyjs

from grosmc_mj.errors import ArgumentError
from grosmc_mj.page.answers import Break, answers, breaks
from grosmc_mj.page.equations import mathml
from grosmc_mj.page.reading import read_results
from grosmc_mj.page.write import LARGEST, Page, write_page

HOSTILE = "</script><script>window.stolen=1</script><img src=x onerror=alert(1)>'\"&{{7*7}}"


class Tags(HTMLParser):
    """Elements of a page with what could run or lead elsewhere."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: list[str | None] = []
        self.odd: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = dict(attrs)
        if tag == "script":
            self.scripts.append(named.get("type"))
        for name, value in attrs:
            leads = name in ("src", "href", "action", "data", "xlink:href")
            if name.startswith("on") or (leads and not (value or "").startswith(("#", "data:,"))):
                self.odd.append(f"{tag} {name}={value}")


def page_of(folder: Path, shrink: Any = lambda film, most: None) -> tuple[Page, str]:
    page = write_page(read_results([folder]), [folder], folder / "out" / "r.html", shrink)
    # What is not ours is left out: parsing it takes a second.
    return page, page.path.read_text(encoding="utf-8").replace(get_plotlyjs(), "")


def data_in(text: str) -> Any:
    found = re.search(r'<script type="text/plain" id="data">([^<]*)</script>', text)
    assert found is not None
    return json.loads(gzip.decompress(base64.b64decode(found[1])))


def changed(content: Any, draw: Any, value: Any) -> Any:
    """A document with one value somewhere in it taken away or replaced."""
    place: Any = content
    last: Any = None
    key: Any = None
    while isinstance(place, dict | list) and len(place):
        keys = sorted(place) if isinstance(place, dict) else range(len(place))
        last, key = place, draw(st.sampled_from(list(keys)))
        place = place[key]
        if draw(st.booleans()):
            break
    if last is not None:
        if draw(st.booleans()):
            del last[key]
        else:
            last[key] = copy.deepcopy(value)
    return content


VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from([0, -1, 10**400, 1e308, -1e308, float("nan"), float("inf"), HOSTILE, ""]),
    st.text(max_size=20),
    st.sampled_from([[], {}, [[[[]]]], {HOSTILE: HOSTILE}, [1.0], [None]]),
)


@given(st.data())
@settings(max_examples=40, deadline=None)
def test_no_mixture_of_results_stops_the_page(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kinds = data.draw(st.lists(st.sampled_from(sorted(DOCUMENTS)), unique=True))
        if kinds:
            write_documents(folder, *kinds)
        for file in sorted(folder.rglob("*.json")):
            content = copy.deepcopy(DOCUMENTS[file.stem])
            for _ in range(data.draw(st.integers(0, 3))):
                content = changed(content, data.draw, data.draw(VALUES))
            text = json.dumps(content)
            end = data.draw(st.none() | st.integers(0, len(text)))
            file.write_text(text[:end], encoding="utf-8")
        if data.draw(st.booleans()):
            (folder / "odd.json").write_bytes(data.draw(st.binary(max_size=30)))
        for part in folder.rglob("*.parquet"):
            part.write_bytes(part.read_bytes()[: data.draw(st.none() | st.integers(0, 900))])
        _, text = page_of(folder)
        tags = Tags(text)
        assert tags.odd == []
        assert [each for each in tags.scripts if each != "text/plain"] == [None, None]
        data_in(text)


def write_hostile(folder: Path) -> None:
    """Write documents of all kinds all of whose texts are hostile."""

    def everywhere(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {name: everywhere(each, name) for name, each in value.items()}
        if isinstance(value, list):
            return [everywhere(each, key) for each in value]
        return HOSTILE if isinstance(value, str) and key != "colour" else value

    for kind, content in DOCUMENTS.items():
        (folder / f"{kind}.json").write_text(json.dumps(everywhere(content)), encoding="utf-8")


def test_a_text_of_somebody_else_stays_text(tmp_path: Path) -> None:
    write_hostile(tmp_path)
    page, text = page_of(tmp_path)
    tags = Tags(text)
    assert tags.odd == []
    assert [each for each in tags.scripts if each != "text/plain"] == [None, None]
    assert "{{7*7}}" in text  # and not 49
    assert len(page.answers) == 12


def test_what_runs_is_named_by_its_hash_and_nothing_leaves(tmp_path: Path) -> None:
    _, text = page_of(write_documents(tmp_path))
    found = re.search(r'Security-Policy" content="([^"]*)"', text)
    assert found is not None
    policy = found[1].replace("&#39;", "'")
    rules = dict(each.strip().split(" ", 1) for each in policy.split(";"))
    assert rules["default-src"] == "'none'"
    assert re.fullmatch(r"('sha256-[\w+/=]+' ?){2}", rules["script-src"])
    assert {"connect-src", "frame-src", "font-src"}.isdisjoint(rules)


def test_a_law_breaks_at_its_first_failed_rung(tmp_path: Path) -> None:
    documents = read_results([write_documents(tmp_path, "ladder", "tolerance", "run")]).documents
    assert set(breaks(documents)) == {
        Break("servo/machine", "lqr", "friction", "deviation below: 3 times the limit (nominal)"),
        Break(
            "servo/bench",
            "lqr",
            "computing delay",
            "kept up to 1.5 ms, then deviation below (nominal)",
        ),
        Break(
            "servo/case1",
            "lqr",
            "physics",
            "deviation below: 1.42 of 2.0e-3 rad by lqr on physics",
        ),
    }


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        ({}, "not kept"),
        ({"requirements": []}, "kept"),
        ({"requirements": [], "complete": False}, "open"),
    ],
)
def test_what_is_interrupted_is_kept_by_nobody(
    tmp_path: Path, change: dict[str, Any], verdict: str
) -> None:
    content = {**DOCUMENTS["run"], **change}
    (tmp_path / "one.json").write_text(json.dumps(content), encoding="utf-8")
    (found,) = answers(read_results([tmp_path]).documents)
    assert found.verdict == verdict


@pytest.mark.parametrize(
    ("kind", "verdict", "words", "numbers"),
    [
        ("region", "measured", "lqr converges from 83.3 % of the starts in case1", ["5 (83.3 %)"]),
        ("switching", "measured", "sign: max |s| = 2.0e-3 at 1 ms", ["2.0e-3", "0.5"]),
        ("sweeps", "measured", "1 of 1 choices turn a claim's answer", ["1 to 2", "1 of 2"]),
        ("premises", "not kept", "1 of 1 premises fail", ["-0.5 A (25 %)", "rho = 2 A"]),
        ("worst", "not kept", "lqr can be made to fail", ["mass 2, length 1.5", "mass 1.25"]),
        ("radius", "measured", "lqr up to 0.75 of what is declared", ["0.75", "1.5"]),
        (
            "self_test",
            "not kept",
            "1 of 2 faults are not noticed",
            ["servo-index", "0"],
        ),
    ],
)
def test_a_study_has_its_answer_and_its_numbers(
    tmp_path: Path, kind: str, verdict: str, words: str, numbers: list[str]
) -> None:
    page, text = page_of(write_documents(tmp_path, kind))
    (answer,) = page.answers
    assert answer.verdict == verdict
    assert words in answer.words
    studies = text[text.index('id="studies"') :]
    for each in numbers:
        assert f">{each}</td>" in studies


def test_an_interrupted_ladder_is_marked(tmp_path: Path) -> None:
    ladder = {**DOCUMENTS["ladder"], "complete": False}
    # Only what stands is there yet.
    ladder["standings"] = [each for each in ladder["standings"] if each["kept"]]
    (tmp_path / "ladder.json").write_text(json.dumps(ladder))
    documents = read_results([tmp_path]).documents
    (answer,) = answers(documents)
    assert answer.verdict == "open"
    assert answer.words.endswith("(interrupted: not complete)")
    assert breaks(documents) == [
        Break("servo/machine", "lqr", "", "stands on every rung so far", complete=False)
    ]
    _, text = page_of(tmp_path)
    assert "? nowhere so far" in text
    assert "✓ nowhere" not in text
    assert ">stands so far<" in text


def test_the_last_rung_alone_decides_a_ladder_s_answer(tmp_path: Path) -> None:
    """The law of the example fails on friction and keeps all at the stops, but not under a load."""
    ladder = DOCUMENTS["ladder"]
    loaded = [{**each, "condition": "case1", "kept": False} for each in ladder["standings"]]
    for standings, verdict, words in (
        (ladder["standings"], "kept", "nominal 1 of 1"),
        ([*ladder["standings"], *loaded], "not kept", "nominal 1 of 1, case1 0 of 1"),
    ):
        (tmp_path / "ladder.json").write_text(json.dumps({**ladder, "standings": standings}))
        (answer,) = answers(read_results([tmp_path]).documents)
        assert answer.verdict == verdict
        assert answer.words == f"laws that keep everything at stops: {words}"


def test_values_of_claims_are_by_plant(tmp_path: Path) -> None:
    _, text = page_of(write_documents(tmp_path, "validation"))
    head = re.search(
        r'aria-label="Values of [^"]*"><table>\s*<thead><tr><th scope="col">(.*?)<', text
    )
    assert head is not None
    assert head[1] == "plant"


def test_a_ladder_says_on_which_rung_a_claim_falls(tmp_path: Path) -> None:
    page, text = page_of(write_documents(tmp_path, "ladder"))
    assert page.notices == []
    studies = " ".join(text[text.index('id="studies"') :].split())
    assert "servo-index: J is least." in studies
    for law, rung in (("lqr", "friction"), ("sign", "stands")):
        row = studies[studies.rindex(f">{law}</th>") :]
        assert re.findall(r"<td[^>]*>([^<]*)</td>", row)[:3] == ["nominal", "servo-index", rung]


def test_a_chart_of_a_study_has_the_numbers_of_its_document(tmp_path: Path) -> None:
    _, text = page_of(write_documents(tmp_path, "region", "sweeps"))
    (nominal, case1), (sweep,) = data_in(text)["sheets"]
    assert (nominal["grid"], case1["grid"]) == (["cc", "cc", "cc"], ["cc", "cl", "cc"])
    assert case1["axes"] == [["start rotor angle [°]", pytest.approx(85.94, abs=0.01)],
                             ["start cart position [m]", 2.0]]  # fmt: skip
    (line,) = sweep["lines"]
    assert (line["x"], line["y"], line["good"]) == ([50.0, 100.0], [2.0, 1.0], [False, True])
    assert (sweep["marks"], sweep["titles"][0]) == ([62.5], "bandwidth [rad/s]")


def test_an_older_document_has_less_and_is_read(tmp_path: Path) -> None:
    claim = {
        key: value
        for key, value in DOCUMENTS["validation"]["claims"][0].items()
        if key not in ("equation", "cause", "expected")
    }
    older = {"schema_version": 1, "claims": [claim]}
    (tmp_path / "claims.json").write_text(json.dumps(older), encoding="utf-8")
    page, text = page_of(tmp_path)
    assert page.notices == []
    assert "servo-index" in text


def test_claims_are_counted_by_the_sentence_that_they_rest_on(tmp_path: Path) -> None:
    claims = [
        {**DOCUMENTS["validation"]["claims"][0], "id": name, "verdict": verdict}
        for name, verdict in (("one", "supported"), ("two", "supported"), ("three", "refuted"))
    ]
    sentences = [{"quote": "q", "verdict": "refuted", "claims": ["one", "two", "three"]}]
    content = {"schema_version": 1, "sentences": sentences, "claims": claims}
    (tmp_path / "claims.json").write_text(json.dumps(content), encoding="utf-8")
    page, text = page_of(tmp_path)
    assert page.notices == []
    assert "sentences of the chapter: 1 refuted" in text


def test_the_newer_of_two_results_counts(tmp_path: Path) -> None:
    for name, verdict, modified in (("a", "supported", 2000), ("b", "refuted", 1000)):
        claims = [{**DOCUMENTS["validation"]["claims"][0], "verdict": verdict}]
        file = tmp_path / f"{name}.json"
        file.write_text(json.dumps({"schema_version": 1, "claims": claims}), encoding="utf-8")
        os.utime(file, (modified, modified))
    _, text = page_of(tmp_path)
    assert re.findall(r'data-verdict="(\w+)"', text) == ["supported"]


def test_a_campaign_of_many_runs_is_counted_whole_and_drawn_in_part(tmp_path: Path) -> None:
    write_documents(tmp_path, "results")
    count = 100_000
    margins = np.random.default_rng(0).normal(0.2, 0.1, count)
    margins[[17, 1234]] = -5.0, np.nan
    write_part(tmp_path / "camp", margins)
    page, text = page_of(tmp_path)
    (campaign,) = data_in(text)["campaigns"]
    own = campaign["laws"]["lqr"]
    assert own["runs"] == count
    assert sum(own["histograms"][0]["counts"]) + own["histograms"][0]["endless"] == count
    assert sum(own["planes"]["0,1"]["counts"]) == count - 1  # NaN has no place
    # The worst are all there, what has no margin before all others.
    assert own["ids"][:2] == [1234, 17]
    assert len(own["ids"]) < 3000
    assert page.size < LARGEST


def test_a_film_that_has_no_room_is_made_smaller_or_named(tmp_path: Path) -> None:
    write_documents(tmp_path, "curves")
    film = bytes(LARGEST)
    write_film(tmp_path, film)
    page, text = page_of(tmp_path, lambda file, most: b"small")
    assert base64.b64encode(b"small").decode() in text
    assert page.notices == []
    page, text = page_of(tmp_path)
    assert page.size < LARGEST
    assert page.notices == [f"{tmp_path / 'film.mp4'}: has no room in a page of 8 MB"]


def test_a_film_of_something_else_is_not_shown(tmp_path: Path) -> None:
    write_documents(tmp_path, "curves")
    write_film(tmp_path, b"film")
    (tmp_path / "film.mp4").write_bytes(b"another")
    page, _ = page_of(tmp_path)
    assert "is not the film" in page.notices[0]


def test_nothing_there_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="nowhere does not exist"):
        read_results([tmp_path / "nowhere"])


def test_an_equation_is_mathml_without_links() -> None:
    assert "<mfrac>" in mathml(r"\frac{a}{b}")
    assert mathml(r"\frac{a}") == "" or "<math" in mathml(r"\frac{a}")
    for hostile in (r"\href{javascript:alert(1)}{x}", r"\text{<script>alert(1)</script>}", "<b>"):
        assert Tags(mathml(hostile)).odd == []
        assert Tags(mathml(hostile)).scripts == []

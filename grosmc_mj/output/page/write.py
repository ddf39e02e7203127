"""Writing of the page as one file: a template with its style, two scripts and the figures."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import shlex
from collections.abc import Collection, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import markupsafe

from grosmc_mj.ground.files import atomic_write
from grosmc_mj.ground.versions import __version__
from grosmc_mj.output.charts.chart import Chart
from grosmc_mj.output.charts.interactive import PageFigure, page_figure, plotly_script
from grosmc_mj.output.charts.of_results import chart_of
from grosmc_mj.output.page.curves import curves_chart
from grosmc_mj.output.page.reading import Curves, Document, FilmClock, FilmDocument, Results
from grosmc_mj.output.page.verdicts import (
    MARKS,
    Story,
    answers_table,
    cases_table,
    free_laws,
    required_verdicts,
    stories,
    studies_table,
    systems_table,
)
from grosmc_mj.output.palette import FAILED, KEPT, VERDICT_COLOURS
from grosmc_mj.output.results.document import plain
from grosmc_mj.output.results.result import Answer, Result
from grosmc_mj.output.results.tables import Table

# Largest number of letters of a configuration; the page cuts a longer one off.
_LONGEST_CONFIGURATION = 20_000
# Mark of a result that a later run set aside.
_EARLIER = "from an earlier run"
# On a narrow screen the rows of a table with so many columns of words are cards. One of fewer
# columns fits, and one of more scrolls sideways: a card would be longer than the screen.
_WORDS_OF_CARDS = 2
_LINES_OF_A_CARD = range(3, 7)


class Page(NamedTuple):
    """A page that was written.

    Attributes:
        path: Path of its file.
        size: Size of its file [byte].
        answers: Answers of all results.
        notices: A line for each file that is left out.
    """

    path: Path
    size: int
    answers: Sequence[Answer]
    notices: Sequence[str]


class ShownFilm(NamedTuple):
    """A film on the page.

    Attributes:
        film: MP4 in base 64.
        poster: PNG in base 64; empty for none.
        clock: Time of the film.
    """

    film: str
    poster: str
    clock: FilmClock


def write_page(reading: Results, paths: Sequence[Path], path: Path) -> Page:
    """Write results as one page.

    Args:
        reading: The results.
        paths: Files and folders that the results were read from.
        path: Path of the HTML file.

    Raises:
        SetupError: If it cannot be written.
    """
    documents = reading.documents
    results = [document for document in documents if isinstance(document.content, Result)]
    newest = _newest_curves(documents)
    cases = required_verdicts(results)
    free = free_laws(documents, cases)
    answers = [answer for document in results for answer in _answers(document)]

    # The functions below append figures and notices to these lists.
    figures: list[PageFigure] = []
    notices = list(reading.notices)
    films = _films(documents, newest, notices)
    content = {
        "title": "Results of grosmc-mj",
        "interrupted": sum(not _result(document).complete for document in results),
        "stories": [_story(story, figures) for story in stories(newest, cases)],
        "systems": systems_table(cases, free),
        "cases": cases_table(cases, free),
        "answers": answers_table(answers),
        "notes": [
            f"{answer.question}: {line}"
            for answer in answers
            for line in (*answer.faults, *answer.notes)
        ],
        "breaks": studies_table(results),
        "curves": [_case(curves, films, figures) for _, curves in sorted(newest.items())],
        "studies": [_study(document, figures) for document in results if _result(document).sheets],
        "notices": notices,
        "version": __version__,
        "command": _text(Path(shlex.join(["grosmc-mj", "report", *map(str, paths)]))),
        "origins": [_origin(document) for document in documents],
        "class_of": _class_of,
    }
    with atomic_write(path) as part:
        part.write_text(_render(content, figures), encoding="utf-8", errors="replace")
    return Page(path, path.stat().st_size, answers, notices)


def _result(document: Document) -> Result:
    """Return the content of a document that is known to be a result."""
    assert isinstance(document.content, Result)
    return document.content


def _answers(document: Document) -> list[Answer]:
    """Return the answers of a result; those of an earlier run say that they are."""
    answers = list(_result(document).answers)
    if not document.earlier:
        return answers
    return [
        answer.model_copy(update={"question": f"{answer.question}, {_EARLIER}"})
        for answer in answers
    ]


def _class_of(cell: str) -> str:
    """Return the class of a cell with a verdict: by its mark, or by its word."""
    for verdict, mark in MARKS.items():
        if cell.startswith((mark, verdict)):
            return verdict.replace(" ", "-")
    colour = VERDICT_COLOURS.get(cell.rstrip(" *").lower())
    return {KEPT: "kept", FAILED: "not-kept"}.get(colour or "", "not-decided")


def _newest_curves(documents: Sequence[Document]) -> dict[tuple[str, str], Curves]:
    """Return the newest curves of each case, by system and case."""
    newest: dict[tuple[str, str], Curves] = {}
    for document in documents:
        content = document.content
        if isinstance(content, Curves) and content.panels:
            newest[content.system, content.case] = content
    return newest


def _story(story: Story, figures: list[PageFigure]) -> dict[str, Any]:
    """Return the sentence and the picture of a system."""
    curves = story.curves
    chart = curves_chart(curves, [story.panel], only_main_plant=True)
    return {
        "system": curves.system,
        "case": f"{curves.case}: {curves.title}" if curves.title else curves.case,
        "sentence": story.sentence,
        "plot": _plot(chart, figures),
    }


def _case(
    curves: Curves,
    films: Mapping[tuple[str, str], ShownFilm],
    figures: list[PageFigure],
) -> dict[str, Any]:
    """Return the curves of a case, with its film."""
    windows = [
        f"{window.label or 'disturbance'} from {window.start:g} to {window.stop:g} s"
        for window in curves.disturbances
    ]
    return {
        "name": f"{curves.system}/{curves.case}",
        "title": curves.title,
        "film": films.get((curves.system, curves.case)),
        "plot": _plot(curves_chart(curves, curves.panels), figures),
        "shaded": "; ".join(windows),
    }


def _plot(chart: Chart, figures: list[PageFigure]) -> dict[str, Any]:
    """Add a chart to the figures of the page; return its number, its height and its legend."""
    figure = page_figure(chart)
    figures.append(figure)
    return {
        "figure": len(figures) - 1,
        "height": figure.layout["height"],
        "legend": figure.legend,
    }


def _study(document: Document, figures: list[PageFigure]) -> dict[str, Any]:
    """Return the tables and charts of a result."""
    content = _result(document)
    answers = _answers(document)
    name = answers[0].question if answers else document.path.stem
    sheets = []
    for sheet in content.sheets:
        beside = sheet.charts
        charts = [(chart.name, _plot(chart_of(chart, beside), figures)) for chart in beside]
        if sheet.table.rows or charts:
            stacked = _reads_as_cards(sheet.table)
            sheets.append({"table": sheet.table, "charts": charts, "stacked": stacked})
    return {
        "name": name,
        "kind": document.kind,
        "sheets": sheets,
        "remarks": content.remarks,
    }


def _reads_as_cards(shown: Table) -> bool:
    """Return True if the rows of a table are cards on a narrow screen."""
    words = sum(column.kind != "numbers" for column in shown.columns)
    return words >= _WORDS_OF_CARDS and len(shown.columns) in _LINES_OF_A_CARD


def _films(
    documents: Sequence[Document],
    cases: Collection[tuple[str, str]],
    notices: list[str],
) -> dict[tuple[str, str], ShownFilm]:
    """Return the newest film of each case with curves on the page.

    A film that is left out adds a line to ``notices``.
    """
    newest: dict[tuple[str, str], tuple[Path, FilmDocument]] = {}
    for document in documents:
        film = document.content
        if not isinstance(film, FilmDocument):
            continue
        case = (film.configuration.case.system, film.configuration.case.case)
        if case in cases:
            newest[case] = (document.path.with_suffix(".mp4"), film)
        else:
            notices.append(f"{_text(document.path)}: its case has no curves here")

    films: dict[tuple[str, str], ShownFilm] = {}
    for case, (file, film) in newest.items():
        try:
            content = file.read_bytes()
        except OSError as error:
            notices.append(f"{_text(file)}: {error.strerror}")
            continue
        if hashlib.sha256(content).hexdigest() != film.sha256:
            notices.append(f"{_text(file)} is not the film that the document beside it is of")
            continue
        poster = file.with_suffix(".png")
        picture = poster.read_bytes() if poster.is_file() else b""
        films[case] = ShownFilm(_base64(content), _base64(picture), film.configuration.film)
    return films


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()


def _origin(document: Document) -> dict[str, Any]:
    """Return the provenance of a document."""
    configuration = document.content.model_dump(include={"configuration"})["configuration"]
    text = json.dumps(plain(configuration), indent=1, ensure_ascii=True)
    if len(text) > _LONGEST_CONFIGURATION:
        text = text[:_LONGEST_CONFIGURATION] + "\n..."
    return {
        "path": _text(document.path),
        "kind": document.kind,
        "content": document.content,
        "sha256": document.sha256,
        "configuration": "" if configuration is None else text,
    }


def _text(path: Path) -> str:
    """Write a path as text that can be printed."""
    return str(path).encode("utf-8", "replace").decode()


def _render(content: Mapping[str, Any], figures: Sequence[PageFigure]) -> str:
    """Fill the template; the page runs no script but the two whose hashes its policy names."""
    js = _page_file("page.js")
    plotly = plotly_script()
    policy = (
        f"default-src 'none'; script-src {_hash(plotly)} {_hash(js)}; style-src 'unsafe-inline'; "
        "img-src data: blob:; media-src data:; base-uri 'none'; form-action 'none'"
    )

    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(_page_file("page.html")).render(
        **content,
        policy=policy,
        css=markupsafe.Markup(_page_file("page.css")),
        js=js,
        plotly=plotly,
        figures=_packed(figures),
    )


def _page_file(name: str) -> str:
    return files("grosmc_mj.output.page").joinpath(name).read_text(encoding="utf-8")


def _hash(script: str) -> str:
    """Return the hash of a script as a content security policy writes it."""
    digest = hashlib.sha256(script.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def _packed(figures: Sequence[PageFigure]) -> str:
    """Return the figures as compressed JSON, in letters that cannot end an element of HTML."""
    drawn = [{"data": figure.data, "layout": figure.layout} for figure in figures]
    text = json.dumps(plain(drawn), separators=(",", ":"), allow_nan=False)
    return _base64(gzip.compress(text.encode(), mtime=0))

"""Writing of the page as one file: a template with its style, two scripts and the figures."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import markupsafe
from plotly.offline import get_plotlyjs

from grosmc_mj.files import atomic_write
from grosmc_mj.page.charts import Figure, chart_figure, curves_figure
from grosmc_mj.page.reading import (
    Claim,
    ClaimsResult,
    Curves,
    Document,
    Film,
    FilmClock,
    Results,
)
from grosmc_mj.results.document import plain
from grosmc_mj.results.formulas import in_text
from grosmc_mj.results.palette import label_of
from grosmc_mj.results.result import VERDICTS, Answer, Result, StudyVerdict
from grosmc_mj.results.tables import number
from grosmc_mj.versions import __version__

# Largest number of letters of a configuration; the page cuts a longer one off.
_LONGEST_CONFIGURATION = 20_000
# Largest number of letters of a formula; the page shows a longer one in LaTeX.
_LONGEST_FORMULA = 2000
# Kinds of results in the table of every law in every case.
_KINDS_IN_MATRIX = ("run", "validation")


class Page(NamedTuple):
    """A page that was written.

    Attributes:
        path: Path of its file.
        size: Size of its file [byte].
        answers: Answers, those that are not kept first.
        notices: A line for each file that is left out.
    """

    path: Path
    size: int
    answers: Sequence[Answer]
    notices: Sequence[str]


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
    answers = _answers(results)
    laws, cases = _matrix(results)

    # The functions below append figures and notices to these lists.
    figures: list[Figure] = []
    notices = list(reading.notices)
    content = {
        "title": "Results of grosmc-mj",
        "summary": _summary(answers, laws, cases, results),
        "answers": answers,
        "laws": laws,
        "matrix": cases,
        "standings": _standings(results),
        "curves": _cases(documents, figures),
        "studies": [_study(document, figures) for document in results if _result(document).sheets],
        "claims": _claims(results),
        "films": _films(documents, notices),
        "notices": notices,
        "version": __version__,
        "command": _text(Path(shlex.join(["grosmc-mj", "report", *map(str, paths)]))),
        "origins": [_origin(document) for document in documents],
        "number": number,
        "label_of": label_of,
    }
    with atomic_write(path) as part:
        part.write_text(_render(content, figures), encoding="utf-8", errors="replace")
    return Page(path, path.stat().st_size, answers, notices)


def _answers(results: Sequence[Document]) -> list[Answer]:
    """Return the answers of all results, those that are not kept first."""
    answers = [answer for document in results for answer in _result(document).answers]
    return sorted(answers, key=lambda answer: VERDICTS.index(answer.verdict))


def _standings(results: Sequence[Document]) -> list[tuple[str, StudyVerdict]]:
    """Return the kind of study and the standing of each law in the studies."""
    standings = []
    for document in results:
        if document.kind not in _KINDS_IN_MATRIX:
            standings += [(document.kind, standing) for standing in _result(document).standings]
    return standings


def _result(document: Document) -> Result:
    """Return the content of a document that is known to be a result."""
    assert isinstance(document.content, Result)
    return document.content


def _matrix(results: Sequence[Document]) -> tuple[list[str], dict[str, dict[str, StudyVerdict]]]:
    """Return the laws, and the standing of each law in each case."""
    cases: dict[str, dict[str, StudyVerdict]] = {}
    for document in results:
        if document.kind in _KINDS_IN_MATRIX:
            for standing in _result(document).standings:
                cases.setdefault(standing.case, {})[standing.law] = standing

    laws = dict.fromkeys(law for case in cases.values() for law in case)
    return list(laws), dict(sorted(cases.items()))


def _summary(
    answers: Sequence[Answer],
    laws: Sequence[str],
    cases: Mapping[str, Mapping[str, StudyVerdict]],
    results: Sequence[Document],
) -> list[str]:
    """Write in sentences what was tested, and what came out."""
    if not answers:
        return ["No results here answer anything."]

    sentences = []
    if cases:
        scores = ", ".join(_scores(laws, cases))
        sentences.append(
            f"{len(laws)} control laws were run in {len(cases)} cases and judged by the "
            f"requirements of each. All requirements are kept by {scores}."
        )

    counts = Counter(answer.verdict for answer in answers)
    verdicts = [f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict]]
    sentences.append(f"Answers: {', '.join(verdicts)}.")

    interrupted = sum(not _result(document).complete for document in results)
    if interrupted:
        sentences.append(f"{interrupted} of the results were interrupted and are not complete.")
    return sentences


def _scores(laws: Sequence[str], cases: Mapping[str, Mapping[str, StudyVerdict]]) -> Iterator[str]:
    """Write for each law in how many of its cases it keeps all requirements."""
    for law in laws:
        standings = [case[law] for case in cases.values() if law in case]
        required = [standing for standing in standings if standing.required]
        if required:
            kept = sum(not standing.breaks_at for standing in required)
            yield f"{label_of(law)} in {kept} of {len(required)}"


def _cases(documents: Sequence[Document], figures: list[Figure]) -> list[dict[str, Any]]:
    """Return the newest curves of each case, with the time of its film."""
    newest: dict[tuple[str, str], Curves] = {}
    clocks: dict[tuple[str, str], FilmClock] = {}
    for document in documents:
        content = document.content
        if isinstance(content, Curves) and content.panels:
            newest[content.system, content.case] = content
        elif isinstance(content, Film):
            clocks[_case_of_film(content)] = content.configuration.film

    return [
        {
            "name": "/".join(case),
            "title": curves.title,
            "film": case if case in clocks else None,
            "clock": clocks.get(case),
            "figure": _numbered(curves_figure(curves), figures),
        }
        for case, curves in sorted(newest.items())
    ]


def _case_of_film(film: Film) -> tuple[str, str]:
    """Return system and case of a film."""
    case = film.configuration.case
    return case.system, case.case


def _numbered(figure: Figure, figures: list[Figure]) -> int:
    """Add a figure to those of the page; return its number."""
    figures.append(figure)
    return len(figures) - 1


def _study(document: Document, figures: list[Figure]) -> dict[str, Any]:
    """Return the tables and charts of a result."""
    content = _result(document)
    name = content.answers[0].question if content.answers else document.path.stem
    sheets = []
    for sheet in content.sheets:
        charts = [(chart.name, _numbered(chart_figure(chart), figures)) for chart in sheet.charts]
        if sheet.table.rows or charts:
            sheets.append({"table": sheet.table, "charts": charts})
    return {"name": name, "kind": document.kind, "sheets": sheets}


def _claims(results: Sequence[Document]) -> dict[str, list[tuple[Claim, str]]]:
    """Return the newest version of each claim with its equation, by system."""
    newest: dict[str, Claim] = {}
    for document in results:
        if isinstance(document.content, ClaimsResult):
            newest.update((claim.id, claim) for claim in document.content.claims)

    systems: dict[str, list[tuple[Claim, str]]] = {}
    for claim in newest.values():
        systems.setdefault(claim.system, []).append((claim, _equation(claim.equation)))
    return systems


def _equation(formula: str) -> str:
    """Write a LaTeX formula as a line of text; unchanged if it cannot be read."""
    if len(formula) > _LONGEST_FORMULA:
        return formula
    try:
        text = in_text(formula)
    # A user's formula may raise any error in the parser.
    except Exception:
        return formula
    return text or formula


def _films(documents: Sequence[Document], notices: list[str]) -> dict[tuple[str, str], str]:
    """Return the newest film of each case with curves on the page, in base 64.

    A film that is left out adds a line to ``notices``.
    """
    cases = {
        (document.content.system, document.content.case)
        for document in documents
        if isinstance(document.content, Curves)
    }
    newest: dict[tuple[str, str], tuple[Path, Film]] = {}
    for document in documents:
        if not isinstance(document.content, Film):
            continue
        case = _case_of_film(document.content)
        if case in cases:
            newest[case] = (document.path.with_suffix(".mp4"), document.content)
        else:
            notices.append(f"{_text(document.path)}: its case has no curves here")

    films: dict[tuple[str, str], str] = {}
    for case, (file, description) in newest.items():
        try:
            film = file.read_bytes()
        except OSError as error:
            notices.append(f"{_text(file)}: {error.strerror}")
            continue
        if hashlib.sha256(film).hexdigest() != description.sha256:
            notices.append(f"{_text(file)}: is not the film that the document beside it is of")
            continue
        films[case] = base64.b64encode(film).decode()
    return films


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


def _render(content: Mapping[str, Any], figures: Sequence[Figure]) -> str:
    """Fill the template; the page runs no script but the two whose hashes its policy names."""
    js = _page_file("page.js")
    plotly = get_plotlyjs()
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
    return files("grosmc_mj.page").joinpath(name).read_text(encoding="utf-8")


def _hash(script: str) -> str:
    """Return the hash of a script as a content security policy writes it."""
    digest = hashlib.sha256(script.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def _packed(figures: Sequence[Figure]) -> str:
    """Return the figures as compressed JSON, in letters that cannot end an element of HTML."""
    text = json.dumps(plain(figures), separators=(",", ":"), allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode()

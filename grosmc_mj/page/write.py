"""The page as one file: a template, one style, two scripts by their hashes, and the figures."""

from __future__ import annotations

import base64
import functools
import gzip
import hashlib
import json
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import markupsafe
from plotly.offline import get_plotlyjs

from grosmc_mj.files import written_aside
from grosmc_mj.page.charts import Figure, chart_figure, curves_figure
from grosmc_mj.page.reading import ClaimsResult, Curves, Document, Film, Results
from grosmc_mj.results.document import plain
from grosmc_mj.results.formulas import in_text
from grosmc_mj.results.palette import label_of
from grosmc_mj.results.result import VERDICTS, Answer, Result, Standing
from grosmc_mj.results.tables import number
from grosmc_mj.versions import __version__

# Letters of a configuration and of a formula; a longer formula is shown in LaTeX.
_LONGEST_CONFIGURATION = 20_000
_LONGEST_FORMULA = 2000
# Results that stand in the table of every law in every case.
_OF_CASES = ("run", "validation")


class Page(NamedTuple):
    """A page that was written.

    Attributes:
        path: Its file.
        size: In bytes.
        answers: Its answers, what is not kept first.
        notices: What is left out, a line each.
    """

    path: Path
    size: int
    answers: Sequence[Answer]
    notices: Sequence[str]


def write_page(reading: Results, paths: Sequence[Path], path: Path) -> Page:
    """Write results as one page.

    Args:
        reading: The results.
        paths: Where they were looked for.
        path: The HTML file.

    Raises:
        SetupError: If it cannot be written.
    """
    figures = list[Figure]()
    notices = list(reading.notices)
    documents = reading.documents
    results = [document for document in documents if isinstance(document.content, Result)]
    answers = _answers(results)
    laws, cases = _matrix(results)

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
    with written_aside(path) as part:
        part.write_text(_render(content, figures), encoding="utf-8", errors="replace")
    return Page(path, path.stat().st_size, answers, notices)


def _answers(results: Sequence[Document]) -> list[Answer]:
    """The answers of all results, those that are not kept first."""
    answers = [answer for document in results for answer in _result(document).answers]
    return sorted(answers, key=lambda answer: VERDICTS.index(answer.verdict))


def _standings(results: Sequence[Document]) -> list[tuple[str, Standing]]:
    """Kind of study and standing of each law in it."""
    return [
        (document.kind, standing)
        for document in results
        if document.kind not in _OF_CASES
        for standing in _result(document).standings
    ]


def _result(document: Document) -> Result:
    assert isinstance(document.content, Result)
    return document.content


def _matrix(results: Sequence[Document]) -> tuple[list[str], dict[str, dict[str, Standing]]]:
    """The laws, and how each stands in each case."""
    cases: dict[str, dict[str, Standing]] = {}
    for result in results:
        if result.kind in _OF_CASES:
            for standing in _result(result).standings:
                cases.setdefault(standing.case, {})[standing.law] = standing
    laws = dict.fromkeys(law for case in cases.values() for law in case)
    return list(laws), dict(sorted(cases.items()))


def _summary(
    answers: Sequence[Answer],
    laws: Sequence[str],
    cases: Mapping[str, Mapping[str, Standing]],
    results: Sequence[Document],
) -> list[str]:
    """What was tested and what came out, in sentences."""
    if not answers:
        return ["No results here answer anything."]
    sentences = []
    if cases:
        scores = []
        for law in laws:
            own = [case[law] for case in cases.values() if law in case and case[law].required]
            kept = sum(not item.breaks_at for item in own)
            scores += [f"{label_of(law)} in {kept} of {len(own)}"] if own else []
        sentences.append(
            f"{len(laws)} control laws were run in {len(cases)} cases and judged by the "
            f"requirements of each. All requirements are kept by {', '.join(scores)}."
        )
    counts = Counter(answer.verdict for answer in answers)
    verdicts = ", ".join(f"{counts[item]} {item}" for item in VERDICTS if counts[item])
    sentences.append(f"Answers: {verdicts}.")
    if unfinished := sum(not _result(item).complete for item in results):
        sentences.append(f"{unfinished} of the results were interrupted and are not complete.")
    return sentences


def _cases(documents: Sequence[Document], figures: list[Figure]) -> list[dict[str, Any]]:
    """The curves of each case with the number of its film, and the tables of its run."""
    newest = {
        (document.content.system, document.content.case): document.content
        for document in documents
        if isinstance(document.content, Curves) and document.content.panels
    }
    clocks = {
        (document.content.configuration.case.system, document.content.configuration.case.case):
            document.content.configuration.film
        for document in documents
        if isinstance(document.content, Film)
    }  # fmt: skip
    return [
        {
            "name": "/".join(key),
            "title": curves.title,
            "film": key if key in clocks else None,
            "clock": clocks.get(key),
            "figure": _numbered(curves_figure(curves), figures),
        }
        for key, curves in sorted(newest.items())
    ]


def _numbered(figure: Figure, figures: list[Figure]) -> int:
    """The number of a figure, which joins the others."""
    figures.append(figure)
    return len(figures) - 1


def _study(document: Document, figures: list[Figure]) -> dict[str, Any]:
    """The tables and charts of a result."""
    content = _result(document)
    name = content.answers[0].question if content.answers else document.path.stem
    sheets = [
        {"table": sheet.table,
         "charts": [(x.name, _numbered(chart_figure(x), figures)) for x in sheet.charts]}
        for sheet in content.sheets
        if sheet.table.rows or sheet.charts
    ]  # fmt: skip
    return {"name": name, "kind": document.kind, "sheets": sheets}


def _claims(results: Sequence[Document]) -> dict[str, list[tuple[Any, str]]]:
    """The claims by system, each once and with its equation."""
    claims = {
        claim.id: claim
        for result in results
        if isinstance(result.content, ClaimsResult)
        for claim in result.content.claims
    }
    systems: dict[str, list[tuple[Any, str]]] = {}
    for claim in claims.values():
        systems.setdefault(claim.system, []).append((claim, _equation(claim.equation)))
    return systems


def _equation(formula: str) -> str:
    """A formula in LaTeX as a line of text, or as it is if it cannot be read."""
    if len(formula) > _LONGEST_FORMULA:
        return formula
    try:
        text = in_text(formula)
    # A parser of other people's texts has errors of every kind.
    except Exception:
        return formula
    return text or formula


def _films(documents: Sequence[Document], notices: list[str]) -> dict[tuple[str, str], str]:
    """The newest film of each case whose curves are on the page, by system and case, in base 64.

    A line of ``notices`` for each film that is left out.
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
        case = document.content.configuration.case
        key = (case.system, case.case)
        if key in cases:
            newest[key] = (document.path.with_suffix(".mp4"), document.content)
        else:
            notices.append(f"{_text(document.path)}: its case has no curves here")

    films: dict[tuple[str, str], str] = {}
    for key, (file, description) in newest.items():
        try:
            film = file.read_bytes()
        except OSError as error:
            notices.append(f"{_text(file)}: {error.strerror}")
            continue
        if hashlib.sha256(film).hexdigest() != description.sha256:
            notices.append(f"{_text(file)}: is not the film that the document beside it is of")
            continue
        films[key] = base64.b64encode(film).decode()
    return films


def _origin(document: Document) -> dict[str, Any]:
    """Where a document comes from."""
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
    """A path as text that can be printed."""
    return str(path).encode("utf-8", "replace").decode()


def _render(content: Mapping[str, Any], figures: Sequence[Figure]) -> str:
    """The template with its content; scripts run by their hashes alone."""
    home = files("grosmc_mj.page")
    css, js = (home.joinpath(f"page.{end}").read_text(encoding="utf-8") for end in ("css", "js"))
    plotly = _plotly()
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = environment.from_string(home.joinpath("page.html").read_text(encoding="utf-8"))
    hashes = " ".join(f"'sha256-{_sha256(script)}'" for script in (plotly, js))
    return template.render(
        **content,
        policy=(
            f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; "
            "img-src data: blob:; media-src data:; base-uri 'none'; form-action 'none'"
        ),
        css=markupsafe.Markup(css),
        js=js,
        plotly=plotly,
        figures=_packed(figures),
    )


@functools.cache
def _plotly() -> str:
    """Plotly's script."""
    return get_plotlyjs()


@functools.cache
def _sha256(script: str) -> str:
    """Of a script, as a content security policy has it."""
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def _packed(figures: Sequence[Figure]) -> str:
    """JSON, compressed and in letters that end no element of HTML."""
    text = json.dumps(plain(figures), separators=(",", ":"), allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode()

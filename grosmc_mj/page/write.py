"""The page as one file: a template, one style, two scripts by their hashes, and the data."""

from __future__ import annotations

import base64
import functools
import gzip
import hashlib
import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import markupsafe
import pyarrow as pa
from plotly.offline import get_plotlyjs

from grosmc_mj.errors import one_line
from grosmc_mj.files import written_aside
from grosmc_mj.page.answers import (
    answers,
    as_expected,
    breaks,
    changed,
    rate_text,
    target_of,
    where,
)
from grosmc_mj.page.campaigns import campaign_data
from grosmc_mj.page.charts import claim_data, curves_data, sheets
from grosmc_mj.page.documents import (
    StoredCampaignResults,
    StoredClaims,
    StoredCurves,
    StoredFilm,
    StoredValidation,
)
from grosmc_mj.page.equations import mathml
from grosmc_mj.page.reading import Document, Results
from grosmc_mj.page.verdicts import VERDICTS, Answer
from grosmc_mj.results.document import plain
from grosmc_mj.results.tables import number
from grosmc_mj.versions import __version__

# Bytes of a page, with what its text around the films needs; letters of a configuration.
LARGEST, _AROUND, _CONFIGURATION = 8_000_000, 20_000, 20_000
# A film in at most so many bytes; None if that cannot be.
Shrink = Callable[[Path, int], bytes | None]


class Page(NamedTuple):
    """A page that was written.

    Attributes:
        path: Its file.
        size: In bytes.
        answers: What it begins with.
        notices: What is left out, a line each.
    """

    path: Path
    size: int
    answers: Sequence[Answer]
    notices: Sequence[str]


def write_page(reading: Results, paths: Sequence[Path], path: Path, shrink: Shrink) -> Page:
    """Write what was read as one page.

    Args:
        reading: The results.
        paths: Where they were looked for.
        path: The HTML file.
        shrink: Makes a film smaller.

    Raises:
        SetupError: If it cannot be written.
    """
    notices = list(reading.notices)
    # Of two that say something of the same, the newer one counts.
    documents = sorted(reading.documents, key=lambda each: each.modified)
    found = answers(documents)
    content = {
        "title": "Results of grosmc-mj",
        "headline": _headline(found),
        "answers": found,
        "breaks": breaks(documents),
        "changes": changed(documents),
        "version": __version__,
        "command": where(Path(shlex.join(["grosmc-mj", "report", *map(str, paths)]))),
        "origins": [_origin(each) for each in reading.documents],
        "number": number,
        "rate_text": rate_text,
        **_claims(documents),
    }
    shown, data = _drawn(documents, notices)
    # The rest first: the films have the room that it leaves.
    text = _render({**content, **shown, "notices": notices, "films": []}, data([]))
    room = LARGEST - len(text.encode("utf-8", "replace")) - _AROUND
    films = _films(documents, room, shrink, notices)
    if films or len(notices) > len(reading.notices):
        coded = [base64.b64encode(each).decode() for _, each in films]
        beside = [each for each, _ in films]
        text = _render({**content, **shown, "notices": notices, "films": coded}, data(beside))
    with written_aside(path) as part:
        part.write_text(text, encoding="utf-8", errors="replace")
    return Page(path, len(text.encode("utf-8", "replace")), found, notices)


def _headline(found: Sequence[Answer]) -> str:
    """The answer in a line."""
    if not found:
        return "No results here answer anything"
    counts = [(verdict, [each.verdict for each in found].count(verdict)) for verdict in VERDICTS]
    said = "1 answer: " if len(found) == 1 else f"{len(found)} answers: "
    return said + ", ".join(f"{n} {name}" for name, n in counts if n)


def _claims(documents: Sequence[Document]) -> dict[str, Any]:
    """The claims, each once, and what they can be filtered by."""
    found = {}
    for each in documents:
        if isinstance(each.content, StoredValidation | StoredClaims):
            found |= {claim.id: claim for claim in each.content.claims}
    choices = {
        "verdict": dict.fromkeys(each.verdict for each in found.values()),
        "system": dict.fromkeys(each.system for each in found.values()),
        "cause": dict.fromkeys(each.cause for each in found.values() if each.cause),
    }
    return {
        "claims": [(each, mathml(each.equation), as_expected(each)) for each in found.values()],
        "filters": {name: list(each) for name, each in choices.items()},
    }


def _drawn(
    documents: Sequence[Document], notices: list[str]
) -> tuple[dict[str, Any], Callable[[Sequence[Document]], Mapping[str, Any]]]:
    """What the template says of curves, campaigns and maps; and their data, given the films."""
    curves = {
        (each.content.system, each.content.case): each.content
        for each in documents
        if isinstance(each.content, StoredCurves) and each.content.panels
    }
    campaigns, plotted = [], []
    for each in documents:
        if isinstance(each.content, StoredCampaignResults):
            runs = _campaign_data(each, each.content, notices)
            campaigns.append(_campaign(each, each.content, bool(runs["laws"])))
            plotted.append(runs)
    studies = sheets(documents)
    claims = [each for each, *_ in _claims(documents)["claims"]]
    shown = {
        "cases": ["/".join(key) for key in curves],
        "campaigns": campaigns,
        "sheets": studies,
        "sections": [
            ("curves", "Curves", curves),
            ("claims", "Claims", claims),
            ("campaigns", "Campaigns", campaigns),
            ("studies", "Studies", studies),
        ],
    }

    def data(films: Sequence[Document]) -> Mapping[str, Any]:
        beside: dict[tuple[str, str], tuple[int, StoredFilm]] = {}
        for index, each in enumerate(films):
            assert isinstance(each.content, StoredFilm)
            case = each.content.configuration.case
            beside.setdefault((case.system, case.case), (index, each.content))
        return {
            "cases": [curves_data(each, beside.get(key)) for key, each in curves.items()],
            "claims": [claim_data(each) for each in claims],
            "campaigns": plotted,
            "sheets": [each.charts for each in studies],
        }

    return shown, data


def _campaign_data(
    document: Document, content: StoredCampaignResults, notices: list[str]
) -> dict[str, Any]:
    """The runs of a campaign; none of one whose parts cannot be read."""
    try:
        return campaign_data(document, content)
    except (OSError, ValueError, KeyError, TypeError, OverflowError, pa.ArrowException) as error:
        notices.append(one_line(f"runs of {where(document.path)}: {error}")[:300])
        return {"laws": {}}


def _campaign(document: Document, content: StoredCampaignResults, plotted: bool) -> dict[str, Any]:
    """What the template says of a campaign."""
    margins = {(each.requirement, each.controller): each for each in content.margins}
    rates = content.pass_rates
    return {
        "name": target_of(document),
        "says": content.says,
        "rates": [(each, margins.get((each.requirement, each.controller))) for each in rates],
        "plotted": plotted,
    }


def _films(
    documents: Sequence[Document], room: int, shrink: Shrink, notices: list[str]
) -> list[tuple[Document, bytes]]:
    """The films of cases whose curves are there and that fit, made smaller if they must be."""
    cases = {
        (each.content.system, each.content.case)
        for each in documents
        if isinstance(each.content, StoredCurves)
    }
    wanted: dict[tuple[str, str], Document] = {}
    for each in documents:
        if isinstance(each.content, StoredFilm):
            case = each.content.configuration.case
            if (case.system, case.case) in cases:
                wanted[case.system, case.case] = each
            else:
                notices.append(f"{where(each.path)}: its case has no curves here")
    found, left = [], room * 3 // 4
    for index, each in enumerate(wanted.values()):
        file, share = each.path.with_suffix(".mp4"), left // (len(wanted) - index)
        film = _film(file, each.content, share, shrink)
        if isinstance(film, str):
            notices.append(f"{where(file)}: {film}")
        else:
            found.append((each, film))
            left -= len(film)
    return found


def _film(file: Path, beside: Any, share: int, shrink: Shrink) -> bytes | str:
    """A film in at most so many bytes, or why not."""
    try:
        content = file.read_bytes()
    except OSError as error:
        return str(error.strerror)
    if hashlib.sha256(content).hexdigest() != beside.sha256:
        return "is not the film that the document beside it is of"
    if len(content) <= share:
        return content
    smaller = shrink(file, share) if share > 0 else None
    if smaller is None or len(smaller) > share:
        return f"has no room in a page of {LARGEST // 10**6} MB"
    return smaller


def _origin(document: Document) -> dict[str, Any]:
    """Where a document comes from."""
    said = document.provenance
    text = json.dumps(plain(said.configuration), indent=1, ensure_ascii=True)
    if len(text) > _CONFIGURATION:
        text = text[:_CONFIGURATION] + "\n..."
    return {
        "path": where(document.path),
        "kind": document.kind,
        "said": said,
        "sha256": document.sha256,
        "configuration": "" if said.configuration is None else text,
    }


def _render(content: Mapping[str, Any], data: Mapping[str, Any]) -> str:
    """The template with its content; scripts run by their hashes alone."""
    home = files("grosmc_mj.page")
    css, js = (home.joinpath(f"page.{end}").read_text(encoding="utf-8") for end in ("css", "js"))
    plotly = _plotly()
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string(home.joinpath("page.html").read_text(encoding="utf-8"))
    hashes = " ".join(f"'sha256-{_sha256(each)}'" for each in (plotly, js))
    return template.render(
        **content,
        policy=(
            f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; "
            "img-src data: blob:; media-src data: blob:; base-uri 'none'; form-action 'none'"
        ),
        css=markupsafe.Markup(css),
        js=js,
        plotly=plotly,
        data=_packed(data),
    )


@functools.cache
def _plotly() -> str:
    """Plotly's script."""
    return get_plotlyjs()


@functools.cache
def _sha256(script: str) -> str:
    """Of a script, as a content security policy has it."""
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def _packed(data: Any) -> str:
    """JSON, compressed and in letters that end no element of HTML."""
    text = json.dumps(plain(data), separators=(",", ":"), allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode()

"""What documents of results tell, one number or word at a time, by names that two of them share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from grosmc_mj.comparison.figure import LESS, MORE, OTHER, Figure
from grosmc_mj.comparison.study_figures import STUDIES
from grosmc_mj.report.page import documents
from grosmc_mj.report.page.reading import Document

# Words that are better than others, best first; between others there is no order.
_RANK = (("kept", "not kept"), ("completed", "diverged"), ("as recorded", "not as recorded"),
         ("as expected", "not as expected"), ("agree", "disagree"), ("holds", "fails"))  # fmt: skip
# A requirement on a metric is called after it: deviation_below, settles_within.
_METRICS = {"settles_within": "settling_time"}


def direction(old: str, new: str) -> int:
    """Whether a word is better (1) or worse (-1) than the one before, or just another one (0)."""
    for good, bad in _RANK:
        if old == good or new == bad:
            return -1
        if new == good or old == bad:
            return 1
    return 0


def figures_of(document: Document) -> Iterator[Figure]:
    """All that can be compared of a document; nothing of a kind that tells no results."""
    tell = _TELL.get(document.kind)
    if tell is not None:
        for figure in tell(document.content):
            yield figure._replace(kind=document.kind)


def _runs(content: documents.StoredRunResults | documents.StoredValidation) -> Iterator[Figure]:
    """How each run ended, and its metrics."""
    for run in content.runs:
        name = f"{run.system}/{run.case} {run.plant} {run.controller}"
        yield Figure("", f"{name}: status", run.status)
        for metric, found in run.metrics.items():
            yield Figure(
                "", f"{name}: {metric}", found.value, OTHER, metric, bool(run.switching), found.unit
            )


def _run(content: documents.StoredRunResults) -> Iterator[Figure]:
    cases = {f"{case.system}/{case.case}" for case in content.configuration.cases}
    switched = {run.controller for run in content.runs if run.switching}
    for each in content.requirements:
        name = f"{', '.join(sorted(cases))} {each.plant} {each.controller}: {each.requirement}"
        metric = _METRICS.get(each.requirement, each.requirement.removesuffix("_below"))
        of = each.controller in switched
        yield Figure("", name, "kept" if each.kept else "not kept")
        unit = str(each.limit.get("unit", ""))
        margin = Figure("", f"{name}, margin", each.margin, MORE, metric, of, unit, each.measured)
        yield margin
    yield from _runs(content)


def _claims(content: documents.StoredClaims | documents.StoredValidation) -> Iterator[Figure]:
    for claim in content.claims:
        if claim.expected.verdicts:
            found = {plant: each.verdict for plant, each in claim.plants.items()}
            fine = found == claim.expected.verdicts
            yield Figure("", f"{claim.id}", "as expected" if fine else "not as expected")
        for plant, each in claim.plants.items():
            yield Figure("", f"{claim.id} on {plant}: verdict", each.verdict)
            yield Figure("", f"{claim.id} on {plant}", each.value, OTHER, "", True, claim.unit)


def _validation(content: documents.StoredValidation) -> Iterator[Figure]:
    if content.as_recorded is not None:
        yield Figure("", "all runs", "as recorded" if content.as_recorded else "not as recorded")
    yield from _runs(content)
    yield from _claims(content)


def _tolerances(content: documents.StoredTolerances) -> Iterator[Figure]:
    target = content.configuration.get("target", "")
    for each in content.tolerances:
        name = f"{target} {each.condition} {each.law}, {each.imperfection}"
        if each.impossible is None:
            yield Figure("", f"{name}: ideally", "kept" if each.kept_ideally else "not kept")
            most = each.largest_kept
            yield Figure(
                "", f"{name}: largest kept", None if most is None else most.factor, MORE, "", True
            )


def _ladder(content: documents.StoredLadder) -> Iterator[Figure]:
    target = content.configuration.get("target", "")
    for each in content.standings:
        how = "up to" if each.together else "alone"
        name = f"{target} {each.condition} {each.law}, {how} {each.rung}"
        if each.impossible is None:
            yield Figure("", name, "kept" if each.kept else "not kept")
            yield Figure(
                "", f"{name}: share of the limit", each.share_of_the_tightest_limit, LESS, "", True
            )


_TELL: dict[str, Callable[[Any], Iterator[Figure]]] = {
    "run": _run,
    "validation": _validation,
    "claims": _claims,
    "tolerance": _tolerances,
    "ladder": _ladder,
    **STUDIES,
}

"""What documents of results tell, one number or word at a time, by names that two of them share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from grosmc_mj.page import documents
from grosmc_mj.page.reading import Document
from grosmc_mj.page.studies import documents as study_documents

# What is more on one side of a comparison than on the other is better, worse, or just other.
MORE, LESS, OTHER = 1, -1, 0


class Figure(NamedTuple):
    """One thing that results tell.

    Attributes:
        name: Of what, and which number of it.
        value: A number, a word, or None for what has none.
        better: ``MORE`` if more is better, ``LESS`` if less is, else ``OTHER``; words are ranked by
            :func:`direction`.
        metric: Name of the metric that the number is, or is a margin of; empty for others.
        switched: Whether a switching law made it, which amplifies rounding.
        unit: Of the number.
        size: What the number's relative accuracy is of; None for itself.
        kind: Of document that tells it.
    """

    name: str
    value: float | str | None
    better: int = OTHER
    metric: str = ""
    switched: bool = False
    unit: str = ""
    size: float | None = None
    kind: str = ""


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
    tell = _TELL.get(document.kind, lambda _: iter(()))
    yield from (figure._replace(kind=document.kind) for figure in tell(document.content))


def _runs(content: documents.StoredRunResults | documents.StoredValidation) -> Iterator[Figure]:
    """How each run ended, and its metrics."""
    for run in content.runs:
        name = f"{run.system}/{run.case} {run.plant} {run.controller}"
        yield Figure(f"{name}: status", run.status)
        yield from (
            Figure(f"{name}: {key}", metric.value, OTHER, key, bool(run.switching), metric.unit)
            for key, metric in run.metrics.items()
        )


def _run(content: documents.StoredRunResults) -> Iterator[Figure]:
    cases = {f"{case.system}/{case.case}" for case in content.configuration.cases}
    switched = {run.controller for run in content.runs if run.switching}
    for each in content.requirements:
        name = f"{', '.join(sorted(cases))} {each.plant} {each.controller}: {each.requirement}"
        metric = _METRICS.get(each.requirement, each.requirement.removesuffix("_below"))
        of = each.controller in switched
        yield Figure(name, "kept" if each.kept else "not kept")
        unit = str(each.limit.get("unit", ""))
        yield Figure(f"{name}, margin", each.margin, MORE, metric, of, unit, each.measured)
    yield from _runs(content)


def _claims(content: documents.StoredClaims | documents.StoredValidation) -> Iterator[Figure]:
    for claim in content.claims:
        if claim.expected.verdicts:
            found = {plant: each.verdict for plant, each in claim.plants.items()}
            fine = found == claim.expected.verdicts
            yield Figure(f"{claim.id}", "as expected" if fine else "not as expected")
        for plant, each in claim.plants.items():
            yield Figure(f"{claim.id} on {plant}: verdict", each.verdict)
            yield Figure(f"{claim.id} on {plant}", each.value, OTHER, "", True, claim.unit)


def _validation(content: documents.StoredValidation) -> Iterator[Figure]:
    if content.as_recorded is not None:
        yield Figure("all runs", "as recorded" if content.as_recorded else "not as recorded")
    yield from _runs(content)
    yield from _claims(content)


def _tolerances(content: documents.StoredTolerances) -> Iterator[Figure]:
    target = content.configuration.get("target", "")
    for each in content.tolerances:
        name = f"{target} {each.condition} {each.law}, {each.imperfection}"
        if each.impossible is None:
            yield Figure(f"{name}: ideally", "kept" if each.kept_ideally else "not kept")
            most = each.largest_kept and each.largest_kept.factor
            yield Figure(f"{name}: largest kept", most, MORE, "", True)


def _ladder(content: documents.StoredLadder) -> Iterator[Figure]:
    target = content.configuration.get("target", "")
    for each in content.standings:
        how = "up to" if each.together else "alone"
        name = f"{target} {each.condition} {each.law}, {how} {each.rung}"
        if each.impossible is None:
            yield Figure(name, "kept" if each.kept else "not kept")
            yield Figure(
                f"{name}: share of the limit", each.share_of_the_tightest_limit, LESS, "", True
            )


def _region(content: study_documents.StoredRegion) -> Iterator[Figure]:
    converged = content.outcomes["c"].name if "c" in content.outcomes else ""
    for each in content.maps:
        starts = sum(each.counts.values())
        share = 100 * each.counts.get(converged, 0) / starts if starts > 0 else None
        name = f"{content.system}/{each.case} {each.controller}: starts that converge"
        yield Figure(name, share, MORE, "", True, "%")


def _switching(content: study_documents.StoredSwitching) -> Iterator[Figure]:
    found = content.benchmark
    for over, samples in (("h", found.sample_times), ("r", found.gain_ratios)):
        for each in samples:
            at = f"{over} = {each.h if over == 'h' else each.gain_ratio:g}"
            name = f"scalar benchmark, {each.law} at {at}: max |s|"
            yield Figure(name, each.max_sliding, LESS, "", True)
    for each in content.cases:
        name = f"{each.system}/{each.case} {each.law}, {each.surface}, at {each.control_period:g} s"
        yield Figure(f"{name}: deviation", each.deviation, LESS, "", True)


def _sweeps(content: study_documents.StoredSweeps) -> Iterator[Figure]:
    words = {True: "the claim holds", False: "it does not", None: "nothing can be told"}
    for each in content.sweeps:
        for trial in each.values:
            name = f"{each.claim} with {trial.choice}"
            yield Figure(name, words[trial.holds])
            yield Figure(f"{name}: measured", trial.measured, OTHER, "", True)


def _premises(content: study_documents.StoredPremises) -> Iterator[Figure]:
    for audit in content.premises:
        for each in audit.premises:
            name = f"{audit.system}/{audit.case} {audit.controller}: {each.name}"
            yield Figure(name, "holds" if each.holds else "fails")
            yield from (
                Figure(f"{name}, margin in the {where}", reading.margin, MORE, "", True, each.unit)
                for where, reading in (("region", each.region), ("run", each.along_run))
                if reading is not None
            )


_TELL: dict[str, Callable[[Any], Iterator[Figure]]] = {
    "run": _run,
    "validation": _validation,
    "claims": _claims,
    "tolerance": _tolerances,
    "ladder": _ladder,
    "region": _region,
    "switching": _switching,
    "sweep": _sweeps,
    "premises": _premises,
}

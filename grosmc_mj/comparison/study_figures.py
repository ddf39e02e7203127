"""What studies, sweeps and premises tell, one number or word at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from grosmc_mj.comparison.figure import LESS, MORE, OTHER, Figure
from grosmc_mj.report.page.studies import documents


def _region(content: documents.StoredRegion) -> Iterator[Figure]:
    converged = content.outcomes["c"].name if "c" in content.outcomes else ""
    for each in content.maps:
        starts = sum(each.counts.values())
        share = 100 * each.counts.get(converged, 0) / starts if starts > 0 else None
        name = f"{content.system}/{each.case} {each.controller}: starts that converge"
        yield Figure("", name, share, MORE, "", True, "%")


def _agreement(content: documents.StoredAgreements) -> Iterator[Figure]:
    # Below the bound a difference is rounding.
    yield Figure("", "equations and MuJoCo", "disagree" if content.disagreements else "agree")


def _switching(content: documents.StoredSwitching) -> Iterator[Figure]:
    found = content.benchmark
    for over, samples in (("h", found.sample_times), ("r", found.gain_ratios)):
        for each in samples:
            at = each.h if over == "h" else each.gain_ratio
            name = f"scalar benchmark, {each.law} at {over} = {at:g}: max |s|"
            yield Figure("", name, each.max_sliding, LESS, "", True)
    for each in content.cases:
        name = f"{each.system}/{each.case} {each.law}, {each.surface}, at {each.control_period:g} s"
        yield Figure("", f"{name}: deviation", each.deviation, LESS, "", True)


def _cart(content: documents.StoredCart) -> Iterator[Figure]:
    for each in content.runs:
        name = f"{each.case} {each.controller}"
        yield Figure("", f"{name}: status", each.ended or "completed")
        for measure, found in each.measures.items():
            yield Figure("", f"{name}: {measure}", found.value, OTHER, "", True, found.unit)
    for each in content.projections:
        deviation = each.deviation
        name = f"G = {each.name}: deviation"
        yield Figure("", name, deviation.value, LESS, "", True, deviation.unit)


def _sweeps(content: documents.StoredSweeps) -> Iterator[Figure]:
    words = {True: "the claim holds", False: "it does not", None: "nothing can be told"}
    for each in content.sweeps:
        for trial in each.values:
            name = f"{each.claim} with {trial.choice}"
            yield Figure("", name, words[trial.holds])
            yield Figure("", f"{name}: measured", trial.measured, OTHER, "", True)


def _premises(content: documents.StoredPremises) -> Iterator[Figure]:
    for audit in content.premises:
        for each in audit.premises:
            name = f"{audit.system}/{audit.case} {audit.controller}: {each.name}"
            yield Figure("", name, "holds" if each.holds else "fails")
            for where, found in (("region", each.region), ("run", each.along_run)):
                if found is not None:
                    named = f"{name}, margin in the {where}"
                    yield Figure("", named, found.margin, MORE, "", True, each.unit)


STUDIES: Mapping[str, Callable[[Any], Iterator[Figure]]] = {
    "region": _region,
    "agreement": _agreement,
    "switching": _switching,
    "cart": _cart,
    "sweep": _sweeps,
    "premises": _premises,
}

"""results.json, worst.json and radius.json: what a campaign says, as plain values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.findings.basis import NO_PROOF
from grosmc_mj.campaign.findings.findings import Findings
from grosmc_mj.campaign.findings.radius import Radius
from grosmc_mj.campaign.findings.worst import Worst
from grosmc_mj.campaign.runs.replay import ReplayedRun
from grosmc_mj.results.document import origin

# Of these documents; manifest and parts have their own.
_SCHEMA_VERSION = 4
RESULTS = "results.json"


def results_document(campaign: Campaign, found: Findings) -> dict[str, Any]:
    """What the runs say; a margin without bound is that of a run that did not complete."""
    return {
        **_origin(campaign),
        "sampled": {**found.sampled._asdict(), "words": found.sampled.words},
        "says": found.sampled.footnote,
        "intervals": found.sampled.intervals,
        "distributions_from": found.looked_at.runs,
        "pass_rates": [
            {"requirement": requirement, "controller": law, **rate._asdict()}
            for (requirement, law), rate in found.rates.items()
        ],
        "ended_early": dict(found.cut_short),
        "judged": {
            law: {**judge._asdict(), "wrong_at_most": judge.wrong_at_most}
            for law, judge in found.judges.items()
        },
        "margins": [
            {
                "requirement": requirement,
                "controller": law,
                "unit": found.units[requirement],
                **summary._asdict(),
            }
            for (requirement, law), summary in found.summaries.items()
        ],
        "differences": [
            {"requirement": requirement, "first": first, "second": second, **each._asdict()}
            for (requirement, first, second), each in found.differences.items()
        ],
        "drivers": {
            law: [each._asdict() for each in several]
            for law, several in found.sensitivities.items()
        },
        "worst_runs": dict(found.worst),
        "units": {each.name: each.unit for each in campaign.family.quantities},
    }


def worst_document(campaign: Campaign, found: Sequence[Worst]) -> dict[str, Any]:
    """The worst plants, by controller."""
    plants = {
        each.controller: {
            "fails": each.fails,
            "relative": each.relative,
            "worst": _named(campaign, each.values),
            "worst_by": each.winner,
            "worst_of_the_samples": each.samples,
            "worst_of_the_search": each.search,
            "worst_of_as_many_random_plants": each.random,
            "evaluations": each.evaluations,
            "shrunk": None if each.shrunk is None else _named(campaign, each.shrunk),
            "shrunk_relative": each.shrunk_relative,
            "not_nominal": list(each.changed),
        }
        for each in found
    }
    return {**_origin(campaign), "says": NO_PROOF, "controllers": plants}


def radius_document(campaign: Campaign, found: Sequence[Radius]) -> dict[str, Any]:
    """How far each controller keeps what is required."""
    reached = {
        each.controller: {
            "found": each.found,
            "largest_looked_at": each.largest,
            "plants_at_each_scale": each.plants,
            "outside": None if each.outside is None else _named(campaign, each.outside.values),
            "outside_scale": None if each.outside is None else each.outside.scale,
            "promised": each.promised.scale,
            "promised_note": each.promised.note,
            "surface_band": each.band,
            "surface_kept": each.stayed,
            "surface_left_scale": None if each.left is None else each.left.scale,
            "surface_left": None
            if each.left is None or each.left.leaver is None
            else _named(campaign, each.left.leaver),
            "looks": [
                {
                    "scale": look.scale,
                    "least": look.least,
                    "failures": look.failures,
                    "surface": look.surface,
                    "leaving": look.leaving,
                }
                for look in each.looks
            ],
        }
        for each in found
    }
    return {**_origin(campaign), "says": NO_PROOF, "controllers": reached}


def _origin(campaign: Campaign) -> dict[str, Any]:
    """Where a document of a campaign comes from."""
    return origin(campaign.specification.seed, _SCHEMA_VERSION)


def _named(campaign: Campaign, values: Array) -> dict[str, float]:
    """The uncertain numbers by name."""
    return dict(zip(campaign.family.names, values.tolist(), strict=True))


def replay_document(campaign: Campaign, found: ReplayedRun, engine: str) -> dict[str, Any]:
    """One run that was repeated."""
    return {
        **_origin(campaign),
        "engine": engine,
        "controller": found.outcome.controller,
        "judged_by": found.outcome.judged_by[0],
        "uncertain": dict(found.values),
        "status": found.outcome.status[0],
        "ended": found.outcome.ended[0],
        "metrics": {name: each[0] for name, each in found.outcome.metrics.items()},
        "margins": {
            each.words: found.outcome.margins[each.key][0]
            for each in campaign.requirements
            if found.outcome.controller in each.of
        },
        "as_stored": not found.differences if found.stored else None,
        "differences": list(found.differences),
    }

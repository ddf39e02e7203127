"""results.json, worst.json and radius.json: what a campaign says, as plain values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.findings.basis import NO_PROOF
from grosmc_mj.campaign.findings.findings import Findings
from grosmc_mj.campaign.findings.promise import MOST
from grosmc_mj.campaign.findings.radius import Radius
from grosmc_mj.campaign.findings.worst import Worst
from grosmc_mj.campaign.runs.manifest import read_json
from grosmc_mj.errors import SetupError

if TYPE_CHECKING:
    from grosmc_mj.campaign.runs.replay import ReplayedRun

# Of these documents; manifest and parts have their own.
SCHEMA_VERSION = 1
RESULTS, WORST, RADIUS = "results.json", "worst.json", "radius.json"
# Plants that are not samples, by what they are called.
FOUND = {"worst": WORST, "shrunk": WORST, "outside": RADIUS}


def results_document(campaign: Campaign, found: Findings) -> dict[str, Any]:
    """What the runs say; numbers that are infinite are texts."""
    return _plain(
        {
            "schema_version": SCHEMA_VERSION,
            "sampled": {**found.sampled._asdict(), "words": found.sampled.words},
            "says": found.sampled.footnote,
            "distributions_from": found.looked_at.runs,
            "pass_rates": [
                {"requirement": requirement, "controller": law, **rate._asdict()}
                for (requirement, law), rate in found.rates.items()
            ],
            "ended_early": dict(found.cut_short),
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
    )


def worst_document(campaign: Campaign, found: Sequence[Worst]) -> dict[str, Any]:
    """The worst plants, by controller."""
    plants = {
        each.controller: {
            "fails": each.fails,
            "relative": each.relative,
            "worst": _named(campaign, each.values),
            "worst_of_the_samples_it_began_with": each.samples,
            "worst_of_as_many_random_plants": each.random,
            "evaluations": each.evaluations,
            "shrunk": None if each.shrunk is None else _named(campaign, each.shrunk),
            "shrunk_relative": each.shrunk_relative,
            "not_nominal": list(each.changed),
        }
        for each in found
    }
    return _plain({"schema_version": SCHEMA_VERSION, "says": NO_PROOF, "controllers": plants})


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
            "looks": [
                {"scale": look.scale, "least": look.least, "failures": look.failures}
                for look in each.looks
            ],
        }
        for each in found
    }
    return _plain({"schema_version": SCHEMA_VERSION, "says": NO_PROOF, "controllers": reached})


def found_values(campaign: Campaign, folder: Path, which: str, controller: str) -> Array:
    """The uncertain numbers of a plant that was searched for, (d,).

    Args:
        campaign: The campaign.
        folder: Its folder.
        which: ``worst``, ``shrunk`` or ``outside``.
        controller: For whom it was found.

    Raises:
        SetupError: If there is no such plant, or one that the family cannot have.
    """
    path = folder / FOUND[which]
    how = {WORST: "--worst", RADIUS: "--radius"}[FOUND[which]]
    try:
        found = read_json(path).get("controllers")
    except FileNotFoundError:
        raise SetupError(f"{folder} has no {path.name}: run the campaign with {how}") from None
    for key, absent in ((controller, {}), (which, None)):
        if not isinstance(found, dict):
            raise SetupError(f"{path}: cannot be read: it has no table of {controller}")
        found = found.get(key, absent)
    if found is None:
        raise SetupError(f"{path}: no plant was found that fails under {controller}")
    if not isinstance(found, dict) or set(found) != set(campaign.family.names):
        raise SetupError(
            f"{path}: cannot be read: {which} of {controller} must have the numbers "
            f"{', '.join(campaign.family.names)} and no others"
        )
    # Nothing was searched for farther from the nominal plant than that.
    scale = min(MOST, campaign.family.largest_scale) if which == "outside" else 1.0
    for quantity in campaign.family.quantities:
        value, ends = found[quantity.name], (quantity.nominal, *quantity.ends(scale))
        slack = 1e-9 * (1 + max(abs(end) for end in ends if math.isfinite(end)))
        least, most = min(ends) - slack, max(ends) + slack
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not (number and least <= value <= most and quantity.physical(value)):
            raise SetupError(
                f"{path}: cannot be read: {which} of {controller}: {quantity.name} = "
                f"{str(value)[:40]} must be a number from {min(ends):g} to {max(ends):g}"
            )
    return np.array([float(found[name]) for name in campaign.family.names])


def _named(campaign: Campaign, values: Array) -> dict[str, float]:
    """The uncertain numbers by name."""
    return dict(zip(campaign.family.names, values.tolist(), strict=True))


def _plain(value: Any) -> Any:
    """Values that JSON has: infinities and NaN as texts."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def replay_document(campaign: Campaign, found: ReplayedRun, engine: str) -> dict[str, Any]:
    """One run that was repeated."""
    return _plain(
        {
            "schema_version": SCHEMA_VERSION,
            "engine": engine,
            "controller": found.outcome.controller,
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
    )

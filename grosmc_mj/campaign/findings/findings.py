"""What the runs of a campaign say: rates, margins, differences and what drives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.findings.basis import Basis
from grosmc_mj.campaign.findings.judges import Judges, judges_of
from grosmc_mj.campaign.findings.pairing import PairedDifference, paired
from grosmc_mj.campaign.findings.sensitivity import Sensitivity, sensitivities
from grosmc_mj.campaign.findings.statistics import (
    MarginSummary,
    PassRate,
    margin_summary,
    pass_rate,
    replicated_pass_rate,
)
from grosmc_mj.campaign.runs.folder import Folder
from grosmc_mj.campaign.runs.manifest import read_manifest, replicates_in
from grosmc_mj.campaign.runs.part import (
    COMPLETES,
    EVERYTHING,
    ReplicateCounts,
    margin_column,
)
from grosmc_mj.errors import SetupError

# Runs that distributions, differences and drivers are computed from; counts are of all.
MOST = 2**20
# What the least margin of all requirements is called.
ALL = "all requirements"
# How many of the worst runs are told, and of how many others a search asks if they are worse.
WORST, _OTHERS = 16, 48


@dataclass(frozen=True, eq=False)
class Findings:
    """The statements of a campaign.

    Attributes:
        sampled: What the rates rest on.
        looked_at: What the rest does.
        rates: By requirement, in words, and law.
        cut_short: Runs that ended early, by law.
        margins: By requirement, in words, and law, (n,) each.
        summaries: Of these.
        differences: By requirement, first and second law.
        sensitivities: By law that something is required of: what drives its least margin, in parts
            of the limit.
        worst: By law: numbers of its worst runs, the worst first, and after these of others that
            never settle, whose margins are about the same.
        units: Of margins, by requirement.
        judges: By law: by what its runs were judged; empty where none was to be screened.
    """

    sampled: Basis
    looked_at: Basis
    rates: Mapping[tuple[str, str], PassRate]
    cut_short: Mapping[str, int]
    margins: Mapping[tuple[str, str], Array]
    summaries: Mapping[tuple[str, str], MarginSummary]
    differences: Mapping[tuple[str, str, str], PairedDifference]
    sensitivities: Mapping[str, list[Sensitivity]]
    worst: Mapping[str, list[int]]
    units: Mapping[str, str]
    judges: Mapping[str, Judges] = field(default_factory=dict)


def findings(campaign: Campaign, folder: Folder, confidence: float) -> Findings:
    """Read back what is there of a campaign and compute what it says.

    Args:
        campaign: The campaign.
        folder: Where it is kept.
        confidence: Of every interval, between 0 and 1.

    Raises:
        GrosmcError: If there are no runs, a part is broken, or the confidence is no share.
    """
    specification = campaign.specification
    if not any(map(folder.done, range(specification.shards))):
        raise SetupError(f"{folder.path} has no runs yet: --resume runs what is missing")
    replicates = replicates_in(read_manifest(folder.path))
    counts = folder.replicate_counts(campaign, range(specification.shards), replicates or 1)
    runs = int(next(iter(counts.values()))["runs"].sum())
    sampled = Basis(runs, specification.runs, specification.sampler, specification.seed, replicates)
    first = range(min(specification.shards, -(-MOST // specification.shard)))
    asked = [margin_column(each.key) for each in campaign.requirements]
    if specification.screen != "none":
        asked += ["overturned", "band"]
    names = ["id", "relative", "settling_time", "deviation", *campaign.family.names]
    columns = folder.columns(campaign, [*names, *asked], first)
    draws = sampled.draws(next(iter(columns.values()))["id"])
    causes: dict[str, list[Sensitivity]] = {}
    worst: dict[str, list[int]] = {}
    for law, own in columns.items():
        settles = any(
            law in each.of and each.kind == "settles_within" for each in campaign.requirements
        )
        worst[law] = own["id"][_worst(own, settles=settles)].tolist()
        if law not in campaign.judged:
            continue
        values = {name: own[name] for name in campaign.family.names}
        causes[law] = sensitivities(values, own["relative"], confidence, draws)
    margins = {(ALL, law): columns[law]["relative"] for law in campaign.judged if law in columns}
    for each in campaign.requirements:
        margins |= {(each.words, law): columns[law][margin_column(each.key)] for law in each.of}
    looked = len(next(iter(columns.values()))["id"])
    last = (campaign.judged or list(campaign.laws))[-1]
    return Findings(
        sampled=sampled,
        looked_at=sampled._replace(runs=looked),
        rates=_rates(campaign, counts, sampled, confidence),
        cut_short={
            law: int((each["runs"] - each[COMPLETES]).sum()) for law, each in counts.items()
        },
        margins=margins,
        summaries={key: margin_summary(each, confidence, draws) for key, each in margins.items()},
        differences={
            (requirement, law, last): paired(each, margins[requirement, last], confidence, draws)
            for (requirement, law), each in margins.items()
            if law != last and (requirement, last) in margins
        },
        sensitivities=causes,
        worst=worst,
        units={ALL: "of the limit", **{each.words: each.unit for each in campaign.requirements}},
        judges=judges_of(counts, columns),
    )


def _worst(own: Mapping[str, Array], *, settles: bool) -> list[int]:
    """Rows of the worst runs and, if they must settle, of those that never do and deviate most."""
    order = own["relative"].argsort(kind="stable").tolist()
    worst = order[:WORST]
    if settles:
        never = [i for i in order[WORST:] if np.isinf(own["settling_time"][i])]
        worst += sorted(never, key=lambda i: -own["deviation"][i])[:_OTHERS]
    return worst


def _rates(
    campaign: Campaign, counts: ReplicateCounts, sampled: Basis, confidence: float
) -> dict[tuple[str, str], PassRate]:
    """Pass rates of all requirements, and of all together."""
    asked = [(COMPLETES, COMPLETES, tuple(campaign.laws))]
    asked += [(each.words, each.key, each.of) for each in campaign.requirements]
    asked.append((ALL, EVERYTHING, tuple(campaign.judged)))
    return {
        (words, law): _rate(counts[law][key], counts[law]["runs"], sampled, confidence)
        for words, key, of in asked
        for law in of
    }


def _rate(
    kept: NDArray[np.int64], runs: NDArray[np.int64], sampled: Basis, confidence: float
) -> PassRate:
    """A pass rate with the interval that the sampler gives, if it gives one."""
    if sampled.replicates:
        return replicated_pass_rate(kept.tolist(), runs.tolist(), confidence)
    found = pass_rate(int(kept.sum()), int(runs.sum()), confidence)
    if sampled.why_not:
        return found._replace(low=None, high=None, note=sampled.why_not)
    return found

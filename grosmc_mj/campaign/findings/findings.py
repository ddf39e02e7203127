"""What the runs of a campaign say: rates, margins, differences and what drives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

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
)
from grosmc_mj.campaign.runs.folder import Folder
from grosmc_mj.campaign.runs.part import COMPLETES, EVERYTHING, margin_column
from grosmc_mj.errors import SetupError

# Runs that distributions, differences and drivers are computed from; counts are of all.
MOST = 2**20
# Name of the least margin of all requirements.
ALL = "all requirements"
# How many of the worst runs are named.
WORST = 16


@dataclass(frozen=True, eq=False)
class Findings:
    """The statements of a campaign.

    Attributes:
        sampled: The runs that rates rest on.
        looked_at: The runs that all else rests on.
        rates: By requirement, in words, and law.
        cut_short: Runs that ended early, by law.
        margins: By requirement, in words, and law, (n,) each.
        summaries: Of these.
        differences: By requirement, first and second law.
        sensitivities: By law that something is required of: what drives its least margin, in parts
            of the limit.
        worst: By law: numbers of its worst runs, the worst first; of runs that never settle, the
            one with the larger error left is the worse.
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
    """Read back what is there of a campaign and compute its statements.

    Args:
        campaign: The campaign.
        folder: Where it is kept.
        confidence: Of every interval, between 0 and 1.

    Raises:
        GrosmcError: If there are no runs, a part is broken, or the confidence is no share.
    """
    specification, requirements = campaign.specification, campaign.requirements
    counts = folder.counts(campaign, range(specification.shards))
    if not counts:
        raise SetupError(f"{folder.path} has no runs yet: --resume runs what is missing")
    sampled = Basis(
        next(iter(counts.values()))["runs"], specification.runs, specification.sampler,
        specification.seed,
    )  # fmt: skip
    first = range(min(specification.shards, -(-MOST // specification.shard)))
    screening = () if specification.screen == "none" else ("screened", "overturned", "band")
    names = ("id", "relative", "order", *campaign.family.names, *screening)
    margin_names = [margin_column(limit.key) for limit in requirements]
    columns = folder.columns(campaign, [*names, *margin_names], first)
    independent, judged = sampled.independent, campaign.judged
    margins = {(ALL, law): columns[law]["relative"] for law in judged}
    rated = [(COMPLETES, COMPLETES, tuple(campaign.laws))]
    for limit, name in zip(requirements, margin_names, strict=True):
        margins |= {(limit.words, law): columns[law][name] for law in limit.of}
        rated.append((limit.words, limit.key, limit.of))
    last = (judged or list(campaign.laws))[-1]
    return Findings(
        sampled=sampled,
        looked_at=sampled._replace(runs=len(columns[last]["id"])),
        rates={
            (words, law): _rate(counts[law][key], counts[law]["runs"], confidence, sampled)
            for words, key, of in [*rated, (ALL, EVERYTHING, tuple(judged))]
            for law in of
        },
        cut_short={law: count["runs"] - count[COMPLETES] for law, count in counts.items()},
        margins=margins,
        summaries={
            key: margin_summary(values, confidence, independent=independent)
            for key, values in margins.items()
        },
        differences={
            (words, law, last): paired(
                values, margins[words, last], confidence, independent=independent
            )
            for (words, law), values in margins.items()
            if law != last and (words, last) in margins
        },
        sensitivities={
            law: sensitivities(
                {name: columns[law][name] for name in campaign.family.names},
                columns[law]["relative"], confidence, independent=independent,
            )
            for law in judged
        },
        worst={
            law: own["id"][own["order"].argsort(kind="stable")[:WORST]].tolist()
            for law, own in columns.items()
        },
        units={ALL: "of the limit", **{limit.words: limit.unit for limit in requirements}},
        judges=judges_of(counts, columns),
    )  # fmt: skip


def _rate(kept: int, runs: int, confidence: float, sampled: Basis) -> PassRate:
    """A pass rate, with its interval if runs are independent."""
    rate = pass_rate(kept, runs, confidence)
    return rate if sampled.independent else rate._replace(low=None, high=None)

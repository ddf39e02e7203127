"""What the runs of a campaign say: rates, margins, differences and what drives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.errors import SetupError
from grosmc_mj.executors import make_executor
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.folder import (
    COMPLETES,
    DRAWN,
    DRAWN_OVERTURNED,
    EVERYTHING,
    OVERTURNED,
    SCREENED,
    Counts,
    Folder,
)
from grosmc_mj.sweep.runs import MARGIN
from grosmc_mj.sweep.statistics import (
    MarginSummary,
    PairedDifference,
    PassRate,
    Sensitivity,
    margin_summary,
    paired,
    pass_rate,
    sensitivities,
)
from grosmc_mj.sweep.work import run_missing

NO_PROOF = "Absence of failures among the runs sampled is no proof that there are none."
# The ranges are somebody's declaration, their distributions a choice.
DESIGN = "Shares are of the declared design, not probabilities."
# Runs that distributions, differences and drivers are computed from; counts are of all.
MOST = 2**20
# Name of the least margin of all requirements.
ALL = "all requirements"
# How many of the worst runs, and of those that MuJoCo overturned, are named; with which confidence
# the share of wrong verdicts is bounded.
WORST, CONFIDENCE = 16, 0.95


class Basis(NamedTuple):
    """The runs that a statement about a campaign rests on.

    Attributes:
      runs: Runs that are done, of each law.
      planned: Runs that the campaign shall have.
      sampler: random, sobol, lhs or corners.
      seed: The campaign's seed.
    """

    runs: int
    planned: int
    sampler: str
    seed: int

    @property
    def words(self) -> str:
        """For a title: ``512 of 4096 runs, random, seed 0``."""
        of = "" if self.runs == self.planned else f" of {self.planned}"
        return f"{self.runs}{of} runs, {self.sampler}, seed {self.seed}"

    @property
    def independent(self) -> bool:
        """Whether the runs are independent random draws, which alone give intervals."""
        return self.sampler == "random"

    @property
    def intervals(self) -> str:
        """How intervals are computed, or why there are none, as a clause."""
        if self.independent:
            return "intervals and p: of independent runs"
        return f"no interval: --sampler {self.sampler} draws no independent runs; random does"

    @property
    def footnote(self) -> str:
        """Limits of the sample: unproved claims, the population of its shares, its intervals."""
        return f"{NO_PROOF} {DESIGN} {self.intervals[0].upper()}{self.intervals[1:]}."


class Judges(NamedTuple):
    """Who judged the runs of one controller.

    Attributes:
        runs: How many there are.
        by_equations: How many of them the equations judged; MuJoCo the others.
        overturned: Of how many MuJoCo overturned a verdict of the equations.
        overturned_runs: Numbers of the first of these.
        band: The band about a limit within which margins were confirmed, in parts of it.
        difference: Largest difference of a least margin that was confirmed, in parts of a limit.
        drawn: Runs that were confirmed by chance alone.
        drawn_overturned: Of how many of these MuJoCo overturned a verdict.
    """

    runs: int
    by_equations: int
    overturned: int
    overturned_runs: list[int]
    band: float
    difference: float
    drawn: int
    drawn_overturned: int

    @property
    def wrong_at_most(self) -> float:
        """Share of the runs that equations judge of which MuJoCo would overturn a verdict, at most.

        One-sided bound of Clopper and Pearson at 95 %, from the runs confirmed by chance.
        """
        if not self.drawn:
            return 1.0
        test = stats.binomtest(self.drawn_overturned, self.drawn, alternative="less")
        return float(test.proportion_ci(CONFIDENCE, method="exact").high)


def judges_of(counts: Counts, columns: Mapping[str, Mapping[str, Array]]) -> dict[str, Judges]:
    """Who judged, by controller; none where runs were not to be screened.

    Args:
        counts: Of all runs.
        columns: ``id``, ``relative``, ``screened``, ``overturned`` and ``band`` of the first runs,
            by controller.
    """
    judges: dict[str, Judges] = {}
    for law, count in counts.items():
        if SCREENED not in count:
            continue
        own = columns[law]
        both = np.isfinite(own["screened"]) & np.isfinite(own["relative"])
        difference = np.abs(own["screened"][both] - own["relative"][both])
        judges[law] = Judges(
            runs=count["runs"],
            by_equations=count[SCREENED],
            overturned=count[OVERTURNED],
            overturned_runs=own["id"][own["overturned"] > 0][:WORST].astype(int).tolist(),
            band=float(own["band"].max(initial=0.0)),
            difference=float(difference.max(initial=0.0)),
            drawn=count[DRAWN],
            drawn_overturned=count[DRAWN_OVERTURNED],
        )
    return judges


def judged_words(judges: Mapping[str, Judges]) -> str:
    """Who judged all runs, and what is known of their verdicts; empty where MuJoCo judged all."""
    by_equations = sum(judge.by_equations for judge in judges.values())
    if not by_equations:
        return ""
    runs = sum(judge.runs for judge in judges.values())
    band = max(judge.band for judge in judges.values())
    difference = max(judge.difference for judge in judges.values())
    sentences = [
        f"{by_equations:,} of {runs:,} runs judged by the equations, {runs - by_equations:,} in "
        f"MuJoCo (band {band:.2g} of a limit; margins confirmed differ by {difference:.2g})."
    ]
    if difference > band:
        sentences.append("That is more than the band: --screen none judges all in MuJoCo.")
    for law, judge in judges.items():
        sentences.append(
            f"{law}: of {judge.drawn} confirmed at random, {judge.drawn_overturned} overturned: at "
            f"most {100 * judge.wrong_at_most:.2g} % of those by the equations at "
            f"{100 * CONFIDENCE:g} %."
        )
        if judge.overturned:
            more = ", ..." if judge.overturned > len(judge.overturned_runs) else ""
            first = ", ".join(map(str, judge.overturned_runs))
            sentences.append(f"MuJoCo overturned {judge.overturned}: {first}{more}.")
    return " ".join(sentences)


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
    judges: Mapping[str, Judges]


def findings(campaign: Campaign, folder: Folder, confidence: float = 0.95) -> Findings:
    """Read back the runs of a campaign that are there, and compute its statements.

    Args:
        campaign: The campaign.
        folder: Where it is kept.
        confidence: Of every interval, between 0 and 1.

    Raises:
        SetupError: If there are no runs, or a part is damaged.
    """
    specification, judged, names = campaign.specification, campaign.judged, campaign.family.names
    counts = folder.counts(campaign, range(specification.shards))
    if not counts:
        raise SetupError(f"{folder.path} has no runs yet: --resume runs what is missing")
    runs, last = next(iter(counts.values()))["runs"], (judged or list(campaign.laws))[-1]
    sampled = Basis(runs, specification.runs, specification.sampler, specification.seed)
    how = {"confidence": confidence, "independent": sampled.independent}
    first = range(min(specification.shards, -(-MOST // specification.shard)))
    screening = () if specification.screen == "none" else ("screened", "overturned", "band")
    margin_names = [MARGIN + limit.key for limit in campaign.requirements]
    column_names = ["id", "relative", "order", *names, *screening, *margin_names]
    columns = folder.columns(campaign, column_names, first)
    margins = {(ALL, law): columns[law]["relative"] for law in judged}
    rated = {(COMPLETES, law): COMPLETES for law in campaign.laws}
    for limit in campaign.requirements:
        margins |= {(limit.words, law): columns[law][MARGIN + limit.key] for law in limit.of}
        rated |= {(limit.words, law): limit.key for law in limit.of}
    rated |= {(ALL, law): EVERYTHING for law in judged}
    return Findings(
        sampled=sampled,
        looked_at=sampled._replace(runs=len(columns[last]["id"])),
        rates={
            (words, law): pass_rate(counts[law][key], counts[law]["runs"], **how)
            for (words, law), key in rated.items()
        },
        cut_short={law: count["runs"] - count[COMPLETES] for law, count in counts.items()},
        margins=margins,
        summaries={key: margin_summary(values, **how) for key, values in margins.items()},
        differences={
            (words, law, last): paired(values, margins[words, last], **how)
            for (words, law), values in margins.items()
            if law != last and (words, last) in margins
        },
        sensitivities={
            law: sensitivities(
                {name: columns[law][name] for name in names}, columns[law]["relative"], **how
            )
            for law in judged
        },
        worst={
            law: own["id"][own["order"].argsort(kind="stable")[:WORST]].tolist()
            for law, own in columns.items()
        },
        units={ALL: "of the limit", **{limit.words: limit.unit for limit in campaign.requirements}},
        judges=judges_of(counts, columns),
    )


def run_campaign(
    campaign: Campaign, folder: str | Path, *, resume: bool = False, confidence: float = 0.95
) -> Findings:
    """Run a campaign in this process, on all cores.

    Args:
        campaign: What is run.
        folder: Where it is kept, as ``grosmc-mj campaign`` keeps it.
        resume: Whether to go on with what is in the folder.
        confidence: Of the intervals, between 0 and 1.

    Raises:
        ArgumentError: If the folder has another campaign, or this one and ``resume`` is not wanted.
        SetupError: If it cannot be written.
    """
    kept = Folder(Path(folder))
    with kept.held():
        kept.begin(campaign, resume=resume)
        executor = make_executor("batch")
        run_missing(campaign, kept, executor, lambda line: None, lambda runs, rates: None)
    return findings(campaign, kept, confidence)

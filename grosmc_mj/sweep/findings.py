"""What the runs of a campaign say: rates, margins, differences and what drives them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.errors import SetupError
from grosmc_mj.executors import make_executor
from grosmc_mj.results.palette import label_of
from grosmc_mj.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    Sheet,
)
from grosmc_mj.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.runs import MARGIN
from grosmc_mj.sweep.statistics import (
    TAIL,
    MarginSummary,
    PairedDifference,
    PassRate,
    Sensitivity,
    margin_summary,
    paired,
    pass_rate,
    runs_needed,
    sensitivities,
)
from grosmc_mj.sweep.store import (
    COMPLETES,
    DRAWN,
    DRAWN_OVERTURNED,
    EVERYTHING,
    NO_PROOF,
    OVERTURNED,
    SCREENED,
    Counts,
    Folder,
    result_of,
    run_missing,
)

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


# A pass rate that one may want to state.
_AIM = 0.99


def findings_tables(campaign: Campaign, found: Findings) -> list[Table]:
    """Pass rates, margins, differences between laws, and what drives each law's margin."""
    tables = [pass_rates_table(found)]
    if found.summaries:
        tables.append(margins_table(found))
    if found.differences:
        tables.append(paired_table(found))
    return [*tables, *(sensitivity_table(found, law) for law in campaign.judged)]


def pass_rates_table(found: Findings) -> Table:
    """How many runs keep each requirement."""
    confidence = next(iter(found.rates.values())).confidence
    rows = []
    for (requirement, law), rate in found.rates.items():
        # Only all of the runs are 100 %, and only none 0 %.
        inner = 0 < rate.kept < rate.runs
        share = f"{min(max(100 * rate.rate, 0.01), 99.99):.2f}" if inner else f"{100 * rate.rate:g}"
        counts = (str(rate.kept), str(rate.runs), share, rate_interval(rate, "..") or "-")
        rows.append((requirement, label_of(law), *counts, str(found.cut_short.get(law, 0))))
    interval = f"{_percent(confidence)} interval"
    columns = numbers("kept", "of runs", "rate %", interval, "not completed")
    return table(
        "Runs of the declared design that keep each requirement",
        [*text("requirement"), *names("law"), *columns],
        rows,
        grouped=True,
        legend="Intervals of Clopper and Pearson. A run that did not complete keeps nothing. To "
        f'state "at least {_percent(_AIM)} of the declared design passes" with '
        f"{_percent(confidence)} confidence takes {runs_needed(_AIM, confidence)} independent runs "
        f"without a failure.\n{found.sampled.words}. {found.sampled.footnote}",
    )


def margins_table(found: Findings) -> Table:
    """The distribution of each requirement's margin."""
    rows = []
    for (requirement, law), of in found.summaries.items():
        values = (of.least, of.cvar, of.q01, of.q05, of.median, of.q95)
        mean = number(of.mean)
        if of.mean_low is not None and of.mean_high is not None:
            mean += f"\n({number(of.mean_low)} ..\n{number(of.mean_high)})"
        unit = found.units[requirement]
        rows.append((requirement, label_of(law), *map(number, values), mean, unit))
    headers = ("least", f"worst {TAIL} %", "1 %", "5 %", "median", "95 %", "mean", "unit")
    return table(
        "Margins: limit less measured",
        [*text("requirement"), *names("law"), *numbers(*headers)],
        rows,
        grouped=True,
        legend=f"Below zero the requirement failed. Worst {TAIL} %: mean of the worst {TAIL} % of "
        "the margins (CVaR); then quantiles, and the mean with its interval (Student's t). -inf: a "
        f"run that did not complete.\n{found.looked_at.words}. {found.looked_at.footnote}",
    )


def paired_table(found: Findings) -> Table:
    """Laws against each other on the same plants."""
    rows = []
    for (requirement, first, second), of in found.differences.items():
        ends = (None if end is None else 100 * end for end in (of.low, of.high))
        points = _between("", 100 * of.difference, *ends)
        median = _between(found.units[requirement], of.median, of.median_low, of.median_high)
        laws = f"{label_of(first)},\n{label_of(second)}"
        counts = (str(of.only_first), str(of.only_second))
        rows.append((requirement, laws, *counts, points, _p_value(of.p_value), median))
    headers = ("only\nfirst", "only\nsecond", "pass rate\n[% points]", "p", "median of\nmargins")
    return table(
        "Two laws on the same plants: second less first",
        [*text("requirement"), *names("laws"), *numbers(*headers)],
        rows,
        grouped=True,
        legend="Only: plants on which one law alone keeps the requirement. In brackets: intervals, "
        "of the rates two of Clopper and Pearson together, of the median by order statistics; p: "
        "McNemar's, exact. All requirements: of each law its own."
        f"\n{found.looked_at.words}. {found.looked_at.footnote}",
    )


def sensitivity_table(found: Findings, law: str) -> Table:
    """What drives the least margin under one law."""
    rows, styles = [], []
    for of in found.sensitivities[law]:
        styles.append("dim" if of.note else "")
        if of.share is None or of.correlation is None:
            rows.append((of.parameter, "-", "", "-", of.note))
            continue
        correlation = f"{of.correlation:+.2f}"
        if of.low is not None and of.high is not None:
            correlation += f" ({of.low:+.2f} .. {of.high:+.2f})"
        rows.append((of.parameter, f"{100 * of.share:.0f}", _p_value(of.p_value), correlation, ""))
    return table(
        f"What drives the margin of {ALL!r} under {label_of(law)}",
        [*text("parameter"), *numbers("share %", "p", "rank correlation"), *words("")],
        rows,
        styles=styles,
        legend="Share of the variance of the margins' ranks that the parameter explains alone, "
        "less what chance gives; p: of a share at least as large if it explained nothing. "
        "Correlation: Spearman's, positive if more of the parameter leaves more margin. Shares of "
        "correlated parameters overlap."
        f"\n{found.looked_at.words}. {found.looked_at.footnote}",
    )


def _percent(share: float) -> str:
    """A share in per cent."""
    return f"{100 * share:.6g} %"


def _p_value(p: float | None) -> str:
    """A p-value; a dash where there is none."""
    if p is None:
        return "-"
    return "< 1e-4" if p < 1e-4 else f"{p:.2g}"


def _between(unit: str, value: float, low: float | None, high: float | None) -> str:
    """A signed number over its interval, if it has one; an end may be open."""

    def signed(value: float) -> str:
        return ("+" if value > 0 else "") + number(value)

    interval = "" if low is None or high is None else f"\n({signed(low)} .. {signed(high)})"
    return f"{signed(value)} {unit}".rstrip() + interval


def rate_interval(rate: PassRate, between: str) -> str:
    """The interval of a pass rate [%]; empty if there is none."""
    if rate.low is None or rate.high is None:
        return ""
    # Rounded outwards, so that the interval shown covers the exact one.
    low, high = math.floor(1e4 * rate.low) / 100, math.ceil(1e4 * rate.high) / 100
    return f"{low:.2f} {between} {high:.2f}"


RESULTS = "results.json"


def results_document(campaign: Campaign, found: Findings) -> dict[str, Any]:
    """What the runs say; a margin without bound is that of a run that did not complete."""
    complete = found.sampled.runs == found.sampled.planned
    # Where nothing is required, the rates are those of the runs that complete.
    rates = [(law, rate) for (of, law), rate in found.rates.items() if of == ALL] or [
        (law, rate) for (_, law), rate in found.rates.items()
    ]
    kept = all(rate.kept == rate.runs for _, rate in rates)
    answer = Answer(
        question=f"Campaign {campaign.specification.name}",
        verdict=NOT_KEPT if not kept else KEPT if complete else OPEN,
        words="; ".join(f"{law}: {_rate_words(rate)}" for law, rate in rates),
    )
    return result_of(
        campaign,
        "campaign",
        complete=complete,
        answers=[answer],
        sheets=[Sheet(table=table) for table in findings_tables(campaign, found)],
        sampled={**found.sampled._asdict(), "words": found.sampled.words},
        says=found.sampled.footnote,
        intervals=found.sampled.intervals,
        distributions_from=found.looked_at.runs,
        pass_rates=[
            {"requirement": requirement, "controller": law, **rate._asdict()}
            for (requirement, law), rate in found.rates.items()
        ],
        ended_early=dict(found.cut_short),
        judged={
            law: {**judge._asdict(), "wrong_at_most": judge.wrong_at_most}
            for law, judge in found.judges.items()
        },
        margins=[
            {
                "requirement": requirement,
                "controller": law,
                "unit": found.units[requirement],
                **summary._asdict(),
            }
            for (requirement, law), summary in found.summaries.items()
        ],
        differences=[
            {"requirement": requirement, "first": first, "second": second, **pair._asdict()}
            for (requirement, first, second), pair in found.differences.items()
        ],
        drivers={
            law: [driver._asdict() for driver in drivers]
            for law, drivers in found.sensitivities.items()
        },
        worst_runs=dict(found.worst),
        units={number.name: number.unit for number in campaign.family.quantities},
    )


def _rate_words(rate: PassRate) -> str:
    """A share of runs with its interval."""
    if rate.low is None or rate.high is None:
        return f"{rate.kept} of {rate.runs}"
    return f"{rate.kept} of {rate.runs} [{100 * rate.low:.4g} to {100 * rate.high:.4g} %]"

"""Statements of a campaign's runs: rates, margins, differences and drivers; tables and document."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import SetupError
from grosmc_mj.executors import make_executor
from grosmc_mj.results.palette import label_of
from grosmc_mj.results.result import KEPT, NOT_KEPT, OPEN, Answer, Sheet
from grosmc_mj.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.runs import COMPLETED, MARGIN
from grosmc_mj.sweep.screening import EQUATIONS
from grosmc_mj.sweep.statistics import (
    TAIL,
    MarginSummary,
    PairedDifference,
    PassRate,
    Sensitivity,
    margin_summary,
    paired,
    pass_rate,
    rate_shown,
    runs_needed,
    sensitivities,
)
from grosmc_mj.sweep.store import NO_PROOF, Folder, result_of, run_missing

RESULTS = "results.json"
# The ranges are somebody's declaration, their distributions a choice.
DESIGN = "Shares are of the declared design, not probabilities."
# Names of what every run is rated by, beside the file's requirements.
ALL, COMPLETES = "all requirements", "completes"
# How many of the worst runs, and of those that MuJoCo overturned, are named; with which confidence
# the share of wrong verdicts is bounded; a pass rate that one may want to state.
WORST, CONFIDENCE, _AIM = 16, 0.95, 0.99


class Basis(NamedTuple):
    """The runs that a statement about a campaign rests on.

    Attributes:
      runs: Runs that are done, of each law.
      planned: Runs that the campaign shall have.
      sampler: random or corners.
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
        kept = self.drawn - self.drawn_overturned
        return 1 - rate_shown(kept, self.drawn, CONFIDENCE) if self.drawn else 1.0

    @classmethod
    def of(cls, rows: Mapping[str, Array]) -> Judges:
        """The judges of one controller's rows."""
        difference = np.abs(rows["screened"] - rows["relative"])
        overturned, drawn = rows["overturned"] > 0, rows["drawn"] > 0
        return cls(
            len(overturned),
            int((rows["judged_by"] == EQUATIONS).sum()),
            int(overturned.sum()),
            rows["id"][overturned][:WORST].astype(int).tolist(),
            float(rows["band"].max()),
            float(difference[np.isfinite(difference)].max(initial=0.0)),
            int(drawn.sum()),
            int((drawn & overturned).sum()),
        )


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
        sampled: The runs that they rest on.
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
    specification, judged, numbers = campaign.specification, campaign.judged, campaign.family.names
    screened = specification.screen != "none"
    columns = folder.columns(
        campaign,
        [
            *("id", "relative", "order", "status", *numbers),
            *(MARGIN + limit.key for limit in campaign.requirements),
            *(("judged_by", "screened", "overturned", "drawn", "band") if screened else ()),
        ],
        range(specification.shards),
    )
    if not columns:
        raise SetupError(f"{folder.path} has no runs yet: --resume runs what is missing")
    last = (judged or list(campaign.laws))[-1]
    runs, sampler = len(columns[last]["id"]), specification.sampler
    sampled = Basis(runs, specification.runs, sampler, specification.seed)
    how = {"confidence": confidence, "independent": sampled.independent}
    margins = {(ALL, law): columns[law]["relative"] for law in judged}
    for limit in campaign.requirements:
        margins |= {(limit.words, law): columns[law][MARGIN + limit.key] for law in limit.of}
    completed = {law: int((own["status"] == COMPLETED).sum()) for law, own in columns.items()}
    kept = {(COMPLETES, law): count for law, count in completed.items()}
    # The requirements in the order of the file, then all of them together.
    for key in sorted(margins, key=lambda key: key[0] == ALL):
        kept[key] = int((margins[key] >= 0).sum())
    return Findings(
        sampled=sampled,
        rates={key: pass_rate(count, runs, **how) for key, count in kept.items()},
        cut_short={law: runs - count for law, count in completed.items()},
        margins=margins,
        summaries={key: margin_summary(values, **how) for key, values in margins.items()},
        differences={
            (words, law, last): paired(values, margins[words, last], **how)
            for (words, law), values in margins.items()
            if law != last and (words, last) in margins
        },
        sensitivities={
            law: sensitivities(
                {name: columns[law][name] for name in numbers}, columns[law]["relative"], **how
            )
            for law in judged
        },
        worst={
            law: own["id"][own["order"].argsort(kind="stable")[:WORST]].tolist()
            for law, own in columns.items()
        },
        units={ALL: "of the limit", **{limit.words: limit.unit for limit in campaign.requirements}},
        judges={law: Judges.of(own) for law, own in columns.items()} if screened else {},
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


# ---- tables


def findings_tables(campaign: Campaign, findings: Findings) -> list[Table]:
    """Pass rates, margins, differences between laws, and what drives each law's margin."""
    tables = [pass_rates_table(findings)]
    tables += [margins_table(findings)] if findings.summaries else []
    tables += [paired_table(findings)] if findings.differences else []
    return [*tables, *(sensitivity_table(findings, law) for law in campaign.judged)]


def _sampled(findings: Findings) -> str:
    """The last lines of every legend."""
    return f"\n{findings.sampled.words}. {findings.sampled.footnote}"


def pass_rates_table(findings: Findings) -> Table:
    """How many runs keep each requirement."""
    confidence = next(iter(findings.rates.values())).confidence
    rows = []
    for (requirement, law), rate in findings.rates.items():
        # Only all of the runs are 100 %, and only none 0 %.
        inner = 0 < rate.kept < rate.runs
        share = f"{min(max(100 * rate.rate, 0.01), 99.99):.2f}" if inner else f"{100 * rate.rate:g}"
        counts = (str(rate.kept), str(rate.runs), share, rate_interval(rate, "..") or "-")
        rows.append((requirement, label_of(law), *counts, str(findings.cut_short.get(law, 0))))
    level = f"{100 * confidence:.6g} %"
    columns = numbers("kept", "of runs", "rate %", f"{level} interval", "not completed")
    return table(
        "Runs of the declared design that keep each requirement",
        [*text("requirement"), *names("law"), *columns],
        rows,
        grouped=True,
        legend="Intervals of Clopper and Pearson. A run that did not complete keeps nothing. To "
        f'state "at least {100 * _AIM:g} % of the declared design passes" with {level} confidence '
        f"takes {runs_needed(_AIM, confidence)} independent runs without a failure."
        f"{_sampled(findings)}",
    )


def margins_table(findings: Findings) -> Table:
    """The distribution of each requirement's margin."""
    rows = []
    for (requirement, law), of in findings.summaries.items():
        values = map(number, (of.least, of.cvar, of.q01, of.q05, of.median, of.q95))
        mean = number(of.mean)
        if of.mean_low is not None:
            mean += f"\n({number(of.mean_low)} ..\n{number(of.mean_high)})"
        rows.append((requirement, label_of(law), *values, mean, findings.units[requirement]))
    headers = ("least", f"worst {TAIL} %", "1 %", "5 %", "median", "95 %", "mean", "unit")
    return table(
        "Margins: limit less measured",
        [*text("requirement"), *names("law"), *numbers(*headers)],
        rows,
        grouped=True,
        legend=f"Below zero the requirement failed. Worst {TAIL} %: mean of the worst {TAIL} % of "
        "the margins (CVaR); then quantiles, and the mean with its interval (Student's t). -inf: a "
        f"run that did not complete.{_sampled(findings)}",
    )


def paired_table(findings: Findings) -> Table:
    """Laws against each other on the same plants."""
    rows = []
    for (requirement, first, second), of in findings.differences.items():
        ends = (None if end is None else 100 * end for end in (of.low, of.high))
        points = _between("", 100 * of.difference, *ends)
        median = _between(findings.units[requirement], of.median, of.median_low, of.median_high)
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
        f"McNemar's, exact. All requirements: of each law its own.{_sampled(findings)}",
    )


def sensitivity_table(findings: Findings, law: str) -> Table:
    """What drives the least margin under one law."""
    rows, styles = [], []
    for of in findings.sensitivities[law]:
        styles.append("dim" if of.note else "")
        if of.share is None or of.correlation is None:
            rows.append((of.parameter, "-", "", "-", of.note))
            continue
        correlation = f"{of.correlation:+.2f}"
        if of.low is not None:
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
        f"correlated parameters overlap.{_sampled(findings)}",
    )


def _p_value(p: float | None) -> str:
    """A p-value; a dash where there is none."""
    return "-" if p is None else "< 1e-4" if p < 1e-4 else f"{p:.2g}"


def _between(unit: str, *values: float | None) -> str:
    """A signed number over its interval, if it has one; an end may be open."""
    signed = [("+" if value and value > 0 else "") + number(value) for value in values]
    interval = "" if values[1] is None else f"\n({signed[1]} .. {signed[2]})"
    return f"{signed[0]} {unit}".rstrip() + interval


def rate_interval(rate: PassRate, between: str) -> str:
    """The interval of a pass rate [%]; empty if there is none."""
    if rate.low is None or rate.high is None:
        return ""
    # Rounded outwards, so that the interval shown covers the exact one.
    low, high = math.floor(1e4 * rate.low) / 100, math.ceil(1e4 * rate.high) / 100
    return f"{low:.2f} {between} {high:.2f}"


# ---- the document


def results_document(campaign: Campaign, findings: Findings) -> dict[str, Any]:
    """results.json; a margin without bound is that of a run that did not complete."""
    sampled, complete = findings.sampled, findings.sampled.runs == findings.sampled.planned
    # Where nothing is required, the rates are those of the runs that complete.
    shown = ALL if campaign.judged else COMPLETES
    rates = {law: rate for (of, law), rate in findings.rates.items() if of == shown}
    kept = all(rate.kept == rate.runs for rate in rates.values())
    sentences = []
    for law, rate in rates.items():
        interval = rate_interval(rate, "to")
        sentences.append(f"{law}: {rate.kept} of {rate.runs}" + (interval and f" [{interval} %]"))
    answer = Answer(
        question=f"Campaign {campaign.specification.name}",
        verdict=NOT_KEPT if not kept else KEPT if complete else OPEN,
        words="; ".join(sentences),
        more=judged_words(findings.judges),
    )
    return result_of(
        campaign,
        "campaign",
        complete=complete,
        answers=[answer],
        sheets=[Sheet(table=table) for table in findings_tables(campaign, findings)],
        sampled={**sampled._asdict(), "words": sampled.words},
        says=sampled.footnote,
        pass_rates=[
            {"requirement": requirement, "controller": law, **rate._asdict()}
            for (requirement, law), rate in findings.rates.items()
        ],
        ended_early=dict(findings.cut_short),
        judged={
            law: {**judge._asdict(), "wrong_at_most": judge.wrong_at_most}
            for law, judge in findings.judges.items()
        },
        margins=[
            {"requirement": of, "controller": law, "unit": findings.units[of], **summary._asdict()}
            for (of, law), summary in findings.summaries.items()
        ],
        differences=[
            {"requirement": requirement, "first": first, "second": second, **pair._asdict()}
            for (requirement, first, second), pair in findings.differences.items()
        ],
        drivers={
            law: [driver._asdict() for driver in drivers]
            for law, drivers in findings.sensitivities.items()
        },
        worst_runs=dict(findings.worst),
        units={number.name: number.unit for number in campaign.family.quantities},
    )

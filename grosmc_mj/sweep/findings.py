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
from grosmc_mj.results.result import KEPT, NOT_KEPT, OPEN, Answer, ReportTable
from grosmc_mj.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.family import SCREENING
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
ALL = "all requirements"
COMPLETES = "completes"
# How many of the worst runs, and of those that MuJoCo overturned, are named.
WORST = 16
# Confidence with which the share of wrong verdicts is bounded.
CONFIDENCE = 0.95
# A pass rate that one may want to state.
_AIM = 0.99
# Columns of every run that statements need.
_COLUMNS = ("id", "relative", "order", "status")


class SampledRuns(NamedTuple):
    """Runs that a statement about a campaign rests on.

    Attributes:
      runs: Number of runs of each law that are done.
      planned: Number of runs of a complete campaign.
      sampler: random or corners.
      seed: The campaign's seed.
    """

    runs: int
    planned: int
    sampler: str
    seed: int

    @property
    def words(self) -> str:
        """Text for a title: ``512 of 4096 runs, random, seed 0``."""
        runs = f"{self.runs}"
        if self.runs != self.planned:
            runs += f" of {self.planned}"
        return f"{runs} runs, {self.sampler}, seed {self.seed}"

    @property
    def independent(self) -> bool:
        """Whether the runs are independent random draws, which alone give intervals."""
        return self.sampler == "random"

    @property
    def intervals(self) -> str:
        """Clause on how intervals are computed, or why there are none."""
        if self.independent:
            return "intervals and p: of independent runs"
        return f"no interval: --sampler {self.sampler} draws no independent runs; random does"

    @property
    def footnote(self) -> str:
        """Limits of the sample: unproved claims, the population of its shares, its intervals."""
        sentence = self.intervals[0].upper() + self.intervals[1:]
        return f"{NO_PROOF} {DESIGN} {sentence}."


class ScreeningSummary(NamedTuple):
    """Shares of the equations and of MuJoCo in judging the runs of one controller.

    Attributes:
        runs: Number of runs.
        by_equations: Number of runs that the equations judged; MuJoCo judged the others.
        overturned: Number of runs of which MuJoCo overturned a verdict of the equations.
        overturned_runs: Numbers of the first of these.
        band: The band about a limit within which margins were confirmed, in parts of it.
        difference: Largest difference of a least margin that was confirmed, in parts of a limit.
        drawn: Number of runs that were confirmed by chance alone.
        drawn_overturned: Number of these of which MuJoCo overturned a verdict.
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
        """Largest share of the runs by equations of which MuJoCo would overturn a verdict.

        One-sided bound of Clopper and Pearson at 95 %, from the runs confirmed by chance.
        """
        if not self.drawn:
            return 1.0
        kept = self.drawn - self.drawn_overturned
        return 1 - rate_shown(kept, self.drawn, CONFIDENCE)

    @classmethod
    def of(cls, rows: Mapping[str, Array]) -> ScreeningSummary:
        """Count the judges of one controller's rows."""
        difference = np.abs(rows["screened"] - rows["relative"])
        overturned = rows["overturned"] > 0
        drawn = rows["drawn"] > 0
        return cls(
            runs=len(overturned),
            by_equations=int((rows["judged_by"] == EQUATIONS).sum()),
            overturned=int(overturned.sum()),
            overturned_runs=rows["id"][overturned][:WORST].astype(int).tolist(),
            band=float(rows["band"].max()),
            difference=float(difference[np.isfinite(difference)].max(initial=0.0)),
            drawn=int(drawn.sum()),
            drawn_overturned=int((drawn & overturned).sum()),
        )


def screening_sentences(judges: Mapping[str, ScreeningSummary]) -> str:
    """Say who judged all runs, and what is known of their verdicts.

    Args:
        judges: By law.

    Returns:
        Sentences; nothing where MuJoCo judged all.
    """
    by_equations = sum(judge.by_equations for judge in judges.values())
    band = max((judge.band for judge in judges.values()), default=0.0)
    # Without a model in MuJoCo nothing is screened: equations are the plant.
    if not by_equations or not band:
        return ""

    runs = sum(judge.runs for judge in judges.values())
    difference = max(judge.difference for judge in judges.values())
    sentences = [
        f"{by_equations:,} of {runs:,} runs judged by the equations, {runs - by_equations:,} in "
        f"MuJoCo (band {band:.2g} of a limit; margins confirmed differ by {difference:.2g})."
    ]
    if difference > band:
        sentences.append("That is more than the band: --screen none judges all in MuJoCo.")
    for law, judge in judges.items():
        if judge.drawn:
            sentences.append(
                f"{law}: of {judge.drawn} confirmed at random, {judge.drawn_overturned} "
                f"overturned: at most {100 * judge.wrong_at_most:.2g} % of those by the equations "
                f"at {100 * CONFIDENCE:g} %."
            )
        if judge.overturned:
            runs_named = ", ".join(map(str, judge.overturned_runs))
            if judge.overturned > len(judge.overturned_runs):
                runs_named += ", ..."
            sentences.append(f"MuJoCo overturned {judge.overturned}: {runs_named}.")
    return " ".join(sentences)


@dataclass(frozen=True, eq=False)
class Findings:
    """Statements of a campaign.

    Attributes:
        sampled: The runs that they rest on.
        rates: Pass rates by requirement, in words, and law.
        cut_short: Number of runs that ended early, by law.
        margins: Margins by requirement, in words, and law, (n,) each.
        summaries: Summaries of the margins.
        differences: Differences of two laws, by requirement, first and second law.
        sensitivities: Drivers of the least margin, in parts of the limit, by law that something is
            required of.
        worst: Numbers of the worst runs, the worst first, by law; of runs that never settle, the
            one with the larger error left is the worse.
        units: Units of margins, by requirement.
        judges: Judges of the runs by law; empty where none was to be screened.
    """

    sampled: SampledRuns
    rates: Mapping[tuple[str, str], PassRate]
    cut_short: Mapping[str, int]
    margins: Mapping[tuple[str, str], Array]
    summaries: Mapping[tuple[str, str], MarginSummary]
    differences: Mapping[tuple[str, str, str], PairedDifference]
    sensitivities: Mapping[str, list[Sensitivity]]
    worst: Mapping[str, list[int]]
    units: Mapping[str, str]
    judges: Mapping[str, ScreeningSummary]


def findings(campaign: Campaign, folder: Folder, confidence: float = 0.95) -> Findings:
    """Read back the runs of a campaign that are there, and compute its statements.

    Args:
        campaign: The campaign.
        folder: Where it is kept.
        confidence: Confidence of every interval, between 0 and 1.

    Raises:
        SetupError: If there are no runs, or a part is damaged.
    """
    specification = campaign.specification
    judged = campaign.judged
    columns = _columns(campaign, folder)

    # Every law was run on the same plants, and is compared with the last one.
    last = judged[-1] if judged else list(campaign.laws)[-1]
    runs = len(columns[last]["id"])
    sampled = SampledRuns(runs, specification.runs, specification.sampler, specification.seed)
    options = {"confidence": confidence, "independent": sampled.independent}

    margins = _margins(campaign, columns)
    completed: dict[str, int] = {}
    for law, rows in columns.items():
        completed[law] = int((rows["status"] == COMPLETED).sum())
    kept = _runs_kept(completed, margins)
    differences: dict[tuple[str, str, str], PairedDifference] = {}
    for (requirement, law), values in margins.items():
        if law != last and (requirement, last) in margins:
            of_last = margins[requirement, last]
            differences[requirement, law, last] = paired(values, of_last, **options)
    drivers: dict[str, list[Sensitivity]] = {}
    for law in judged:
        numbers = {name: columns[law][name] for name in campaign.family.names}
        drivers[law] = sensitivities(numbers, columns[law]["relative"], **options)

    judges: dict[str, ScreeningSummary] = {}
    if specification.screen != "none":
        judges = {law: ScreeningSummary.of(rows) for law, rows in columns.items()}
    units = {ALL: "of the limit"}
    units |= {item.words: item.unit for item in campaign.requirements}

    return Findings(
        sampled=sampled,
        rates={key: pass_rate(count, runs, **options) for key, count in kept.items()},
        cut_short={law: runs - count for law, count in completed.items()},
        margins=margins,
        summaries={key: margin_summary(values, **options) for key, values in margins.items()},
        differences=differences,
        sensitivities=drivers,
        worst={law: _worst_runs(rows) for law, rows in columns.items()},
        units=units,
        judges=judges,
    )


def _columns(campaign: Campaign, folder: Folder) -> dict[str, dict[str, Array]]:
    """The columns of all runs that are there, by controller and name.

    Raises:
        SetupError: If there are none.
    """
    names = [*_COLUMNS, *campaign.family.names]
    names += [MARGIN + item.name for item in campaign.requirements]
    if campaign.specification.screen != "none":
        names += SCREENING
    columns = folder.columns(campaign, names, range(campaign.specification.shards))
    if not columns:
        raise SetupError(f"{folder.path} has no runs yet: --resume runs what is missing")
    return columns


def _margins(
    campaign: Campaign, columns: Mapping[str, Mapping[str, Array]]
) -> dict[tuple[str, str], Array]:
    """Margins by requirement, in words, and law, (n,) each: first the least of all requirements."""
    margins = {(ALL, law): columns[law]["relative"] for law in campaign.judged}
    for requirement in campaign.requirements:
        for law in requirement.laws:
            margins[requirement.words, law] = columns[law][MARGIN + requirement.name]
    return margins


def _runs_kept(
    completed: Mapping[str, int], margins: Mapping[tuple[str, str], Array]
) -> dict[tuple[str, str], int]:
    """Number of runs that keep each requirement, by requirement and law."""
    kept = {(COMPLETES, law): count for law, count in completed.items()}
    # The requirements in the order of the file, then all of them together.
    for key in sorted(margins, key=lambda key: key[0] == ALL):
        kept[key] = int((margins[key] >= 0).sum())
    return kept


def _worst_runs(rows: Mapping[str, Array]) -> list[int]:
    """Numbers of the worst runs of one controller, the worst first."""
    worst_first = rows["order"].argsort(kind="stable")
    return rows["id"][worst_first[:WORST]].tolist()


def run_campaign(
    campaign: Campaign,
    folder: str | Path,
    *,
    resume: bool = False,
    confidence: float = 0.95,
) -> Findings:
    """Run a campaign in this process, on all cores.

    Args:
        campaign: The campaign.
        folder: Where it is kept, as ``grosmc-mj campaign`` keeps it.
        resume: Whether to go on with what is in the folder.
        confidence: Confidence of the intervals, between 0 and 1.

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
    if findings.summaries:
        tables.append(margins_table(findings))
    if findings.differences:
        tables.append(paired_table(findings))
    tables += [sensitivity_table(findings, law) for law in campaign.judged]
    return tables


def _sampled(findings: Findings) -> str:
    """The last lines of every legend."""
    return f"\n{findings.sampled.words}. {findings.sampled.footnote}"


def pass_rates_table(findings: Findings) -> Table:
    """Number and share of the runs that keep each requirement."""
    confidence = next(iter(findings.rates.values())).confidence
    rows = [
        (
            requirement,
            label_of(law),
            str(rate.kept),
            str(rate.runs),
            _percentage(rate),
            rate_interval(rate, "..") or "-",
            str(findings.cut_short.get(law, 0)),
        )
        for (requirement, law), rate in findings.rates.items()
    ]
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


def _percentage(rate: PassRate) -> str:
    """A pass rate [%]: only all of the runs are 100, and only none 0."""
    if 0 < rate.kept < rate.runs:
        return f"{min(max(100 * rate.rate, 0.01), 99.99):.2f}"
    return f"{100 * rate.rate:g}"


def margins_table(findings: Findings) -> Table:
    """The distribution of each requirement's margin."""
    rows = [
        (requirement, label_of(law), *_margin_cells(summary), findings.units[requirement])
        for (requirement, law), summary in findings.summaries.items()
    ]
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


def _margin_cells(summary: MarginSummary) -> list[str]:
    """The quantiles of a margin and its mean with its interval."""
    mean = number(summary.mean)
    if summary.mean_low is not None:
        mean += f"\n({number(summary.mean_low)} ..\n{number(summary.mean_high)})"
    return [
        number(summary.least),
        number(summary.cvar),
        number(summary.q01),
        number(summary.q05),
        number(summary.median),
        number(summary.q95),
        mean,
    ]


def paired_table(findings: Findings) -> Table:
    """Laws against each other on the same plants."""
    rows = [
        (
            requirement,
            f"{label_of(first)},\n{label_of(second)}",
            *_difference_cells(difference, findings.units[requirement]),
        )
        for (requirement, first, second), difference in findings.differences.items()
    ]
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


def _difference_cells(pair: PairedDifference, unit: str) -> list[str]:
    """Counts, difference of the pass rates, its p, and median difference of the margins."""
    low = high = None
    if pair.low is not None and pair.high is not None:
        low = 100 * pair.low
        high = 100 * pair.high
    return [
        str(pair.only_first),
        str(pair.only_second),
        _between("", 100 * pair.difference, low, high),
        _p_value(pair.p_value),
        _between(unit, pair.median, pair.median_low, pair.median_high),
    ]


def sensitivity_table(findings: Findings, law: str) -> Table:
    """Drivers of the least margin under one law."""
    drivers = findings.sensitivities[law]
    rows = [_driver_cells(driver) for driver in drivers]
    styles = ["dim" if driver.note else "" for driver in drivers]
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


def _driver_cells(driver: Sensitivity) -> tuple[str, ...]:
    """The row of one parameter."""
    if driver.share is None or driver.correlation is None:
        return (driver.parameter, "-", "", "-", driver.note)

    correlation = f"{driver.correlation:+.2f}"
    if driver.low is not None:
        correlation += f" ({driver.low:+.2f} .. {driver.high:+.2f})"
    share = f"{100 * driver.share:.0f}"
    return (driver.parameter, share, _p_value(driver.p_value), correlation, "")


def _p_value(p: float | None) -> str:
    """A p-value; a dash where there is none."""
    if p is None:
        return "-"
    if p < 1e-4:
        return "< 1e-4"
    return f"{p:.2g}"


def _between(
    unit: str,
    value: float,
    low: float | None,
    high: float | None,
) -> str:
    """A signed number over its interval, if it has one; an end may be open."""
    words = f"{_signed(value)} {unit}".rstrip()
    if low is None:
        return words
    return f"{words}\n({_signed(low)} .. {_signed(high)})"


def _signed(value: float | None) -> str:
    """A number with its sign."""
    sign = "+" if value and value > 0 else ""
    return sign + number(value)


def rate_interval(rate: PassRate, between: str) -> str:
    """Return the interval of a pass rate [%]; empty if there is none.

    Args:
        rate: The pass rate.
        between: Text between both ends.
    """
    if rate.low is None or rate.high is None:
        return ""
    # Rounded outwards, so that the interval shown covers the exact one.
    low = math.floor(1e4 * rate.low) / 100
    high = math.ceil(1e4 * rate.high) / 100
    return f"{low:.2f} {between} {high:.2f}"


# ---- the document


def results_document(campaign: Campaign, findings: Findings) -> dict[str, Any]:
    """Return results.json; a margin without bound is that of a run that did not complete."""
    sampled = findings.sampled
    sheets = [ReportTable(table=table) for table in findings_tables(campaign, findings)]
    pass_rates = [
        {"requirement": requirement, "controller": law, **rate._asdict()}
        for (requirement, law), rate in findings.rates.items()
    ]
    judged = {
        law: {**judge._asdict(), "wrong_at_most": judge.wrong_at_most}
        for law, judge in findings.judges.items()
    }
    margins = [
        {
            "requirement": requirement,
            "controller": law,
            "unit": findings.units[requirement],
            **summary._asdict(),
        }
        for (requirement, law), summary in findings.summaries.items()
    ]
    differences = [
        {"requirement": requirement, "first": first, "second": second, **pair._asdict()}
        for (requirement, first, second), pair in findings.differences.items()
    ]
    drivers = {
        law: [driver._asdict() for driver in drivers]
        for law, drivers in findings.sensitivities.items()
    }
    return result_of(
        campaign,
        "campaign",
        complete=sampled.runs == sampled.planned,
        answers=[_answer(campaign, findings)],
        sheets=sheets,
        sampled={**sampled._asdict(), "words": sampled.words},
        says=sampled.footnote,
        pass_rates=pass_rates,
        ended_early=dict(findings.cut_short),
        judged=judged,
        margins=margins,
        differences=differences,
        drivers=drivers,
        worst_runs=dict(findings.worst),
        units={number.name: number.unit for number in campaign.family.quantities},
    )


def _answer(campaign: Campaign, findings: Findings) -> Answer:
    """Number of runs that keep everything, by law."""
    # Where nothing is required, the rates are those of the runs that complete.
    requirement = ALL if campaign.judged else COMPLETES
    laws = [law for name, law in findings.rates if name == requirement]

    verdict = KEPT
    if findings.sampled.runs != findings.sampled.planned:
        verdict = OPEN
    sentences: list[str] = []
    for law in laws:
        rate = findings.rates[requirement, law]
        if rate.kept < rate.runs:
            # One failure decides, however many runs are missing.
            verdict = NOT_KEPT
        sentence = f"{law}: {rate.kept} of {rate.runs}"
        interval = rate_interval(rate, "to")
        if interval:
            sentence += f" [{interval} %]"
        sentences.append(sentence)
    return Answer(
        question=f"Campaign {campaign.specification.name}",
        verdict=verdict,
        words="; ".join(sentences),
        more=screening_sentences(findings.judges),
        notes=campaign.notes,
    )

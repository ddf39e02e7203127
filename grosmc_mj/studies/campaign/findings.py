"""Statements of a campaign's runs: rates, margins, differences and drivers; tables and document."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import SetupError
from grosmc_mj.ground.executors import make_executor
from grosmc_mj.ground.wording import counted
from grosmc_mj.output.results.result import KEPT, NOT_KEPT, OPEN, Answer, ReportTable, Result
from grosmc_mj.output.results.tables import Table
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.drivers import (
    Sensitivity,
    driver_words,
    drivers_table,
    sensitivities,
)
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.manifest import result_of
from grosmc_mj.studies.campaign.paired import PairedDifference, paired, paired_table
from grosmc_mj.studies.campaign.screening import ScreeningSummary, screening_sentences
from grosmc_mj.studies.campaign.work import run_missing
from grosmc_mj.studies.pieces import held
from grosmc_mj.studies.sweep.family import SCREENING
from grosmc_mj.studies.sweep.margin_summary import MarginSummary, margin_summary, margins_table
from grosmc_mj.studies.sweep.pass_rates import PassRate, pass_rate, pass_rates_table, rate_shown
from grosmc_mj.studies.sweep.runs import COMPLETED, MARGIN
from grosmc_mj.studies.sweep.sampled import ALL, COMPLETES, SampledRuns

RESULTS = "results.json"
# How many of the worst runs are named.
WORST = 16
# Columns of every run that statements need.
_COLUMNS = ("id", "relative", "order", "status")


@dataclass(frozen=True, eq=False)
class Findings:
    """Statements of a campaign.

    Attributes:
        sampled: The runs that they rest on.
        rates: Pass rates by requirement, in words, and law.
        cut_short: Number of runs that ended early, by law.
        summaries: Summaries of the margins, by requirement, in words, and law.
        differences: Differences of two laws, by requirement, first and second law.
        sensitivities: Drivers of the least margin, in parts of the limit, by law that something is
            required of.
        worst: Numbers of the worst runs, the worst first, by law; of runs that never settle, the
            one with the larger error left is the worse.
        units: Units of margins, by requirement.
        screening: Summary of the screening by law; empty where nothing was to be screened.
    """

    sampled: SampledRuns
    rates: Mapping[tuple[str, str], PassRate]
    cut_short: Mapping[str, int]
    summaries: Mapping[tuple[str, str], MarginSummary]
    differences: Mapping[tuple[str, str, str], PairedDifference]
    sensitivities: Mapping[str, list[Sensitivity]]
    worst: Mapping[str, list[int]]
    units: Mapping[str, str]
    screening: Mapping[str, ScreeningSummary]


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
    columns = _columns(campaign, folder)
    runs = len(next(iter(columns.values()))["id"])
    sampled = SampledRuns(runs, specification.runs, specification.sampler, specification.seed)
    independent = sampled.independent

    margins = _margins(campaign, columns)
    completed = {law: int((rows["status"] == COMPLETED).sum()) for law, rows in columns.items()}
    rates: dict[tuple[str, str], PassRate] = {}
    for key, kept in _runs_kept(completed, margins).items():
        rates[key] = pass_rate(kept, runs, confidence, independent=independent)
    summaries: dict[tuple[str, str], MarginSummary] = {}
    for key, values in margins.items():
        summaries[key] = margin_summary(values, confidence, independent=independent)

    screening: dict[str, ScreeningSummary] = {}
    if specification.screen != "none":
        screening = {law: ScreeningSummary.of(rows) for law, rows in columns.items()}
    units = {item.words: item.unit for item in campaign.requirements}
    return Findings(
        sampled=sampled,
        rates=rates,
        cut_short={law: runs - count for law, count in completed.items()},
        summaries=summaries,
        differences=_differences(campaign, margins, confidence, independent=independent),
        sensitivities=_sensitivities(campaign, columns, independent=independent),
        worst={law: _worst_runs(rows) for law, rows in columns.items()},
        units={ALL: "of the limit", **units},
        screening=screening,
    )


def _differences(
    campaign: Campaign,
    margins: Mapping[tuple[str, str], Array],
    confidence: float,
    *,
    independent: bool,
) -> dict[tuple[str, str, str], PairedDifference]:
    """Each law, by requirement, against the last one, which met the same plants."""
    differences: dict[tuple[str, str, str], PairedDifference] = {}
    if not campaign.judged:
        return differences

    last = campaign.judged[-1]
    for (requirement, law), of_law in margins.items():
        of_last = margins.get((requirement, last))
        if law != last and of_last is not None:
            difference = paired(of_law, of_last, confidence, independent=independent)
            differences[requirement, law, last] = difference
    return differences


def _sensitivities(
    campaign: Campaign, columns: Mapping[str, Mapping[str, Array]], *, independent: bool
) -> dict[str, list[Sensitivity]]:
    """Influence of each uncertain number on the least margin, by law."""
    of_laws: dict[str, list[Sensitivity]] = {}
    for law in campaign.judged:
        rows = columns[law]
        numbers = {name: rows[name] for name in campaign.family.names}
        of_laws[law] = sensitivities(numbers, rows["relative"], independent=independent)
    return of_laws


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
    with held(kept.path):
        kept.begin(campaign, resume=resume)
        executor = make_executor("batch")
        run_missing(campaign, kept, executor, lambda line: None, lambda runs, rates: None)
    return findings(campaign, kept, confidence)


# ---- tables


def findings_tables(campaign: Campaign, findings: Findings) -> list[Table]:
    """Pass rates, margins, differences between laws, and what drives each law's margin."""
    sampled = findings.sampled
    units = findings.units
    tables = [pass_rates_table(findings.rates, findings.summaries, units, sampled)]
    if findings.summaries:
        tables.append(margins_table(findings.summaries, units, sampled))
    if findings.differences:
        tables.append(paired_table(findings.differences, units, sampled))
    drivers = findings.sensitivities
    tables += [drivers_table(law, drivers[law], sampled) for law in campaign.judged]
    return tables


# ---- the document


def campaign_result(
    campaign: Campaign,
    findings: Findings,
    at_least: float | None = None,
    progress: Sequence[str] = (),
    searched: Mapping[str, Sequence[str]] | None = None,
    failing: Collection[str] = (),
) -> Result:
    """Return the result; a margin without bound is that of a run that did not complete.

    Args:
        campaign: The campaign.
        findings: Statements that its runs allow.
        at_least: Share of the plants that each law must be shown to keep; None without.
        progress: Lines on how its runs were made.
        searched: What searches from the runs found, by law.
        failing: Laws under which a search found a plant that fails inside the declared ranges.
    """
    sampled = findings.sampled
    pass_rates_of_all, *further = findings_tables(campaign, findings)
    # The remarks say of all tables what the sample allows.
    first = pass_rates_of_all.model_copy(update={"legend": ""})
    sheets = [ReportTable(table=first, brief=True)]
    sheets += [ReportTable(table=table) for table in further]
    pass_rates = [
        {"requirement": requirement, "controller": law, **rate._asdict()}
        for (requirement, law), rate in findings.rates.items()
    ]
    judged = {
        law: {**summary._asdict(), "wrong_at_most": summary.wrong_at_most}
        for law, summary in findings.screening.items()
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
        answers=_answers(campaign, findings, at_least, searched or {}, failing),
        sheets=sheets,
        remarks=[*_remarks(campaign, findings), *progress],
        sampled={**sampled._asdict(), "words": sampled.words},
        pass_rates=pass_rates,
        ended_early=dict(findings.cut_short),
        judged=judged,
        margins=margins,
        differences=differences,
        drivers=drivers,
        worst_runs=dict(findings.worst),
        units={number.name: number.unit for number in campaign.family.quantities},
    )


def _answers(
    campaign: Campaign,
    findings: Findings,
    at_least: float | None,
    searched: Mapping[str, Sequence[str]],
    failing: Collection[str],
) -> Iterator[Answer]:
    """Yield on how many plants each law keeps everything, the worst law first."""
    rates = rates_of_laws(findings)
    notes = campaign.notes
    for law in sorted(rates, key=lambda law: rates[law].rate):
        rate = rates[law]
        good = rate.kept == rate.runs and law not in failing
        words = _rate_words(law, rate, findings)
        if at_least is not None and law in campaign.judged:
            bound = rate_shown(rate.kept, rate.runs, rate.confidence)
            good = keeps_enough(rate, at_least)
            plants = counted(rate.runs, "plant")
            words = (
                f"{law}: at least {100 * bound:.4g} % of the declared design keep everything "
                f"({rate.kept} of {plants}, one-sided confidence {rate.confidence:g}); "
                f"{100 * at_least:g} % are asked for."
            )
        if law in searched:
            words = "; ".join([words.removesuffix("."), *searched[law]])
        verdict = KEPT
        if not good:
            # One failure decides, however many runs are missing.
            verdict = NOT_KEPT
        elif findings.sampled.runs != findings.sampled.planned:
            verdict = OPEN
        question = f"Campaign {campaign.specification.name}"
        yield Answer(question=question, verdict=verdict, words=words, notes=notes)
        # Notes are on the plants, not on a law.
        notes = ()


def keeps_enough(rate: PassRate, at_least: float | None) -> bool:
    """Return True if a law is shown to keep a share of the plants; without one, at least a plant.

    Args:
        rate: Plants on which the law keeps everything.
        at_least: The share; None if none is asked for.
    """
    if at_least is None:
        return rate.kept > 0
    # Of a tie, rounding has no say.
    return rate_shown(rate.kept, rate.runs, rate.confidence) >= at_least * (1 - 1e-12)


def rates_of_laws(findings: Findings) -> dict[str, PassRate]:
    """Return the share of plants on which each law keeps everything.

    A law that nothing is required of has the share of its runs that complete.
    """
    rates = {law: rate for (name, law), rate in findings.rates.items() if name == COMPLETES}
    rates |= {law: rate for (name, law), rate in findings.rates.items() if name == ALL}
    return rates


def _rate_words(law: str, rate: PassRate, findings: Findings) -> str:
    """Return a sentence on how many plants a law keeps everything, with the interval."""
    bounds = rate.interval("to")
    interval = findings.sampled.intervals
    if bounds:
        interval = f"{bounds} % ({100 * rate.confidence:g} % interval)"
    keeps = "keeps everything"
    if (ALL, law) not in findings.rates:
        keeps = "completes, and nothing more is required of it,"
    plants = counted(rate.runs, "plant")
    return f"{law} {keeps} on {rate.kept} of {plants} of the declared design: {interval}."


def _remarks(campaign: Campaign, findings: Findings) -> Iterator[str]:
    """Yield lines on pairs of laws, on what drives margins, on screening and the sample."""
    for (requirement, first_law, second_law), counts in findings.differences.items():
        if requirement == ALL:
            yield (
                f"same plants: {first_law} alone keeps everything on {counts.only_first}, "
                f"{second_law} alone on {counts.only_second}"
            )
    lines = [driver_words(law, rows) for law, rows in findings.sensitivities.items()]
    lines += [screening_sentences(findings.screening), findings.sampled.sentences]
    yield from filter(None, lines)

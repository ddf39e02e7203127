"""Answer of a campaign on the terminal: pass rates, worst plants, radii."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Console

from grosmc_mj.cli import screen
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.drivers import driver_words
from grosmc_mj.sweep.findings import Findings, findings_tables
from grosmc_mj.sweep.judges import screening_sentences
from grosmc_mj.sweep.pass_rates import PassRate, rate_shown
from grosmc_mj.sweep.radius import Radius, radius_table
from grosmc_mj.sweep.sampled import ALL
from grosmc_mj.sweep.worst import WorstPlant, worst_table

# Rows of the table of pass rates that fit beside the rest of the answer.
_MOST_ROWS = 8


def say_campaign_verdict(
    console: Console,
    campaign: Campaign,
    findings: Findings,
    at_least: float | None,
    confidence: float,
) -> int:
    """Say on how many plants each law keeps everything, the worst law first.

    Args:
        console: Where it is printed.
        campaign: The campaign.
        findings: Statements that its runs allow.
        at_least: Share that each law must be shown to keep; None if none is required.
        confidence: Confidence of the bound that is compared with that share.

    Returns:
        The exit code.
    """
    all_kept = True
    for law, rate in _laws_worst_first(findings):
        if at_least is None:
            good = rate.kept == rate.runs
            words = _rate_words(law, rate, findings)
        else:
            bound = rate_shown(rate.kept, rate.runs, confidence)
            # Of a tie, rounding has no say.
            good = bound >= at_least * (1 - 1e-12)
            all_kept = all_kept and good
            words = (
                f"{law}: at least {100 * bound:.4g} % of the declared design keep everything "
                f"({rate.kept} of {rate.runs} plants, one-sided confidence {confidence:g}); "
                f"{100 * at_least:g} % are asked for."
            )
        # Without a share that is asked for, one plant is enough.
        all_kept = all_kept and rate.kept > 0
        screen.say_verdict(console, words, good=good)

    for law in campaign.laws:
        if law not in campaign.judged:
            console.print(f"{law}: nothing is required of it.", style="dim")
    return DONE if all_kept else DIFFERS


def _laws_worst_first(findings: Findings) -> list[tuple[str, PassRate]]:
    """Return the laws with the share of plants on which they keep everything."""
    rates: list[tuple[str, PassRate]] = []
    for (requirement, law), rate in findings.rates.items():
        if requirement == ALL:
            rates.append((law, rate))
    return sorted(rates, key=lambda pair: pair[1].rate)


def _rate_words(law: str, rate: PassRate, findings: Findings) -> str:
    """Return a sentence on how many plants a law keeps everything, with the interval."""
    bounds = rate.interval("to")
    interval = findings.sampled.intervals
    if bounds:
        interval = f"{bounds} % ({100 * rate.confidence:g} % interval)"
    return (
        f"{law} keeps everything on {rate.kept} of {rate.runs} plants of the declared "
        f"design: {interval}."
    )


def say_findings(
    console: Console,
    campaign: Campaign,
    findings: Findings,
    progress: Sequence[str],
    *,
    full: bool,
) -> None:
    """Print pass rates, paired differences and what drives the margins.

    Args:
        console: Where they are printed.
        campaign: The campaign.
        findings: Statements that its runs allow.
        progress: Lines on the runs that were made.
        full: True to print every table.
    """
    tables = findings_tables(campaign, findings)
    pass_rates = tables[0].model_copy(update={"title": "", "legend": ""})
    console.print(pass_rates.brief(_MOST_ROWS))
    drivers = [driver_words(law, rows) for law, rows in findings.sensitivities.items()]
    lines = [*_difference_lines(findings), *filter(None, drivers)]
    screen.say_lines(console, lines, "", full=False)

    for line in (screening_sentences(findings.judges), findings.sampled.sentences, *progress):
        if line:
            console.print(line, style="dim", markup=False)
    if full:
        for table in tables:
            console.print("", table)


def _difference_lines(findings: Findings) -> Iterator[str]:
    """Yield a line on each two laws: on how many plants only one of them keeps everything."""
    for (requirement, first_law, second_law), counts in findings.differences.items():
        if requirement == ALL:
            yield (
                f"same plants: {first_law} alone keeps everything on {counts.only_first}, "
                f"{second_law} alone on {counts.only_second}"
            )


def say_worst(
    console: Console, campaign: Campaign, searches: Sequence[WorstPlant], *, full: bool
) -> None:
    """Print the worst plant under each law, the worst first."""
    by_margin = sorted(searches, key=lambda plant: plant.relative)
    screen.say_lines(console, [plant.sentence(campaign) for plant in by_margin], "", full=False)
    if full and searches:
        console.print(worst_table(campaign, searches), "")


def say_radius(
    console: Console, campaign: Campaign, searches: Sequence[Radius], *, full: bool
) -> None:
    """Print how far the uncertainty may grow under each law, the least first."""
    by_radius = sorted(searches, key=lambda search: search.found)
    screen.say_lines(console, [search.sentence for search in by_radius], "", full=False)
    if full and searches:
        console.print(radius_table(campaign, searches), "")

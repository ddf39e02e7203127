"""Answer of a campaign on the terminal: pass rates, worst plants, radii."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Console

from grosmc_mj.cli import screen
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.results.tables import Table, number
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.findings import (
    ALL,
    Findings,
    findings_tables,
    rate_interval,
    screening_sentences,
)
from grosmc_mj.sweep.radius import Radius, radius_table
from grosmc_mj.sweep.statistics import PassRate, rate_shown
from grosmc_mj.sweep.worst import WorstPlant, worst_table


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
    bounds = rate_interval(rate, "to")
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
    console.print(_rates_table(findings))
    lines = [*_difference_lines(findings), *_driver_lines(findings)]
    screen.say_lines(console, lines, "", full=False)

    sampled = findings.sampled
    notes = [
        screening_sentences(findings.judges),
        f"{sampled.words}. {sampled.footnote}",
        *progress,
    ]
    for line in notes:
        if line:
            console.print(line, style="dim", markup=False)

    if full:
        for table in findings_tables(campaign, findings):
            console.print("", table)


def _rates_table(findings: Findings) -> Table:
    """Return the table of single requirements, those that fail most first."""
    rows = []
    for (requirement, law), rate in sorted(findings.rates.items(), key=lambda pair: pair[1].rate):
        if requirement == ALL:
            continue
        least = "-"
        margin = findings.summaries.get((requirement, law))
        if margin:
            least = f"{number(margin.least)} {findings.units[requirement]}".rstrip()
        kept = f"{rate.kept} of {rate.runs}"
        rows.append((requirement, law, kept, rate_interval(rate, "..") or "-", least))

    columns = ("requirement", "law", "kept", "interval %", "least margin")
    return screen.brief_table("", columns, rows, words=2, most=8)


def _difference_lines(findings: Findings) -> Iterator[str]:
    """Yield a line on each two laws: on how many plants only one of them keeps everything."""
    for (requirement, first_law, second_law), counts in findings.differences.items():
        if requirement == ALL:
            yield (
                f"same plants: {first_law} alone keeps everything on {counts.only_first}, "
                f"{second_law} alone on {counts.only_second}"
            )


def _driver_lines(findings: Findings) -> Iterator[str]:
    """Yield a line on each law whose margin one parameter drives most."""
    for law, sensitivities in findings.sensitivities.items():
        driver = sensitivities[0]
        if driver.drives:
            percent = 100 * (driver.share or 0)
            yield (
                f"{law}: {driver.parameter} drives its margin most "
                f"({percent:.0f} % of the variance of the ranks)"
            )


def say_worst(
    console: Console, campaign: Campaign, searches: Sequence[WorstPlant], *, full: bool
) -> None:
    """Print the worst plant under each law, the worst first."""
    lines = []
    for plant in sorted(searches, key=lambda plant: plant.relative):
        line = (
            f"{plant.controller}: worst plant, by {plant.winner}: margin {number(plant.relative)} "
            f"of its limit, {campaign.words(plant.values)}"
        )
        if plant.shrunk is not None:
            line += f"; nearest that fails: {campaign.words(plant.shrunk)}"
        lines.append(line)

    screen.say_lines(console, lines, "", full=False)
    if full and searches:
        console.print(worst_table(campaign, searches), "")


def say_radius(
    console: Console, campaign: Campaign, searches: Sequence[Radius], *, full: bool
) -> None:
    """Print how far the uncertainty may grow under each law, the least first."""
    by_radius = sorted(searches, key=lambda search: search.found)
    screen.say_lines(console, [_radius_line(search) for search in by_radius], "", full=False)
    if full and searches:
        console.print(radius_table(campaign, searches), "")


def _radius_line(search: Radius) -> str:
    """Return a line on the scales of the uncertainty at which a law fails."""
    line = f"{search.controller}: no failure up to {search.found:.3g} times the uncertainty"
    if search.outside is not None:
        line += f", one at {search.outside.scale:.3g}"
    if search.promised.scale is not None:
        line += f"; |s| is promised its bound up to {search.promised.scale:.3g}"
    if search.stayed is not None:
        line += f", keeps it up to {search.stayed:.3g}"
    if search.left is not None:
        line += f", leaves it at {search.left.scale:.3g}"
    return line

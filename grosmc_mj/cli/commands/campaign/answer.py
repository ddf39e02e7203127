"""What a campaign answers: who keeps what, what fails first, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from grosmc_mj.cli import screen
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.results.tables import number
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.findings import ALL, Findings, findings_tables, judged_words, rate_interval
from grosmc_mj.sweep.radius import Radius, radius_table
from grosmc_mj.sweep.statistics import rate_shown
from grosmc_mj.sweep.worst import Worst, worst_table


def say_verdict(
    console: Console,
    campaign: Campaign,
    findings: Findings,
    at_least: float | None,
    confidence: float,
) -> int:
    """Say on how many plants each law keeps everything, the worst law first.

    Args:
        console: Where to.
        campaign: The campaign.
        findings: What the runs say.
        at_least: Share that each must be shown to keep; None if none is required.
        confidence: Of the intervals, and of the bound that is compared with that share.

    Returns:
        The exit code.
    """
    rates = {law: rate for (requirement, law), rate in findings.rates.items() if requirement == ALL}
    missed = False
    for law, rate in sorted(rates.items(), key=lambda pair: pair[1].rate):
        if at_least is not None:
            shown = rate_shown(rate.kept, rate.runs, confidence)
            # Of a tie, rounding has no say.
            good = shown >= at_least * (1 - 1e-12)
            missed = missed or not good
            words = (
                f"{law}: at least {100 * shown:.4g} % of the declared design keep everything "
                f"({rate.kept} of {rate.runs} plants, one-sided confidence {confidence:g}); "
                f"{100 * at_least:g} % are asked for."
            )
        else:
            good, interval = rate.kept == rate.runs, rate_interval(rate, "to")
            interval = interval and f"{interval} % ({100 * rate.confidence:g} % interval)"
            words = (
                f"{law} keeps everything on {rate.kept} of {rate.runs} plants of the declared "
                f"design: {interval or findings.sampled.intervals}."
            )
        screen.say_verdict(console, words, good=good)
    for law in campaign.laws:
        if law not in campaign.judged:
            console.print(f"{law}: nothing is required of it.", style="dim")
    return DIFFERS if missed else DONE


def say_findings(
    console: Console, campaign: Campaign, findings: Findings, progress: Sequence[str], *, full: bool
) -> None:
    """The requirements that fail most first, what drives the margins, and what was sampled."""
    rows, lines = [], []
    for (requirement, law), rate in sorted(findings.rates.items(), key=lambda pair: pair[1].rate):
        if requirement != ALL:
            margin = findings.summaries.get((requirement, law))
            least = f"{number(margin.least)} {findings.units[requirement]}" if margin else "-"
            kept = (
                f"{rate.kept} of {rate.runs}",
                rate_interval(rate, "..") or "-",
            )
            rows.append((requirement, law, *kept, least.rstrip()))
    columns = ("requirement", "law", "kept", "interval %", "least margin")
    console.print(screen.brief_table("", columns, rows, words=2, most=8))
    for (requirement, first, second), pair in findings.differences.items():
        if requirement == ALL:
            lines.append(
                f"same plants: {first} alone keeps everything on {pair.only_first}, {second} alone "
                f"on {pair.only_second}"
            )
    for law, (driver, *_) in findings.sensitivities.items():
        if driver.drives:
            lines.append(
                f"{law}: {driver.parameter} drives its margin most "
                f"({100 * (driver.share or 0):.0f} % of the variance of the ranks)"
            )
    screen.say_lines(console, lines, "", full=False)
    notes = [
        judged_words(findings.judges),
        f"{findings.sampled.words}. {findings.sampled.footnote}",
    ]
    for line in filter(None, [*notes, *progress]):
        console.print(line, style="dim", markup=False)
    for table in findings_tables(campaign, findings) if full else ():
        console.print("", table)


def say_worst(
    console: Console, campaign: Campaign, searches: Sequence[Worst], *, full: bool
) -> None:
    """The worst plant under each law, the worst first."""
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
    """How far the uncertainty may grow under each law, the least first."""
    lines = []
    for search in sorted(searches, key=lambda search: search.found):
        line = f"{search.controller}: no failure up to {search.found:.3g} times the uncertainty"
        for words, at in (
            (", one at", search.outside and search.outside.scale),
            ("; |s| is promised its bound up to", search.promised.scale),
            (", keeps it up to", search.stayed),
            (", leaves it at", search.left and search.left.scale),
        ):
            line += "" if at is None else f"{words} {at:.3g}"
        lines.append(line)
    screen.say_lines(console, lines, "", full=False)
    if full and searches:
        console.print(radius_table(campaign, searches), "")

"""What a campaign answers: who keeps what, what fails first, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from grosmc_mj.cli import screen

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.campaign.family.campaign import Campaign
    from grosmc_mj.campaign.findings.findings import Findings
    from grosmc_mj.campaign.findings.radius import Radius
    from grosmc_mj.campaign.findings.statistics import PassRate
    from grosmc_mj.campaign.findings.worst import Worst


def say_verdict(
    console: Console, asked: Campaign, found: Findings, at_least: float | None, confidence: float
) -> int:
    """Say on how many plants each law keeps everything, the worst law first.

    Args:
        console: Where to.
        asked: The campaign.
        found: What the runs say.
        at_least: Share that each must be shown to keep; None if none is asked for.
        confidence: Of the intervals, and of the bound that is compared with that share.

    Returns:
        The exit code.
    """
    from grosmc_mj.campaign.findings.findings import ALL
    from grosmc_mj.campaign.findings.statistics import rate_shown

    rates = {law: rate for (asked, law), rate in found.rates.items() if asked == ALL}
    missed = False
    for law, rate in sorted(rates.items(), key=lambda each: each[1].rate):
        if at_least is not None:
            shown = rate_shown(rate.kept, rate.runs, confidence)
            # Of a tie, rounding has no say.
            enough = shown >= at_least * (1 - 1e-12)
            missed = missed or not enough
            words = (
                f"{law}: at least {100 * shown:.4g} % of the declared design keep everything "
                f"({rate.kept} of {rate.runs} plants, one-sided confidence {confidence:g}); "
                f"{100 * at_least:g} % are asked for."
            )
            screen.say_verdict(console, words, good=enough)
        else:
            words = (
                f"{law} keeps everything on {rate.kept} of {rate.runs} plants of the declared "
                f"design: {_rate(rate) or found.sampled.no_interval}."
            )
            screen.say_verdict(console, words, good=rate.kept == rate.runs)
    for law in asked.laws:
        if law not in asked.judged:
            console.print(f"{law}: nothing is required of it.", style="dim")
    return screen.DIFFERS if missed else screen.DONE


def _rate(rate: PassRate) -> str:
    """The interval of a pass rate; empty if there is none."""
    from grosmc_mj.campaign.report.tables import rate_interval

    interval = rate_interval(rate, "to")
    return interval and f"{interval} % ({100 * rate.confidence:g} % interval)"


def say_findings(console: Console, asked: Campaign, found: Findings) -> None:
    """The requirements that fail most first, what drives the margins, and what was sampled."""
    from grosmc_mj.campaign.findings.findings import ALL
    from grosmc_mj.campaign.findings.judges import judged_words
    from grosmc_mj.campaign.report.tables import rate_interval
    from grosmc_mj.results.tables import number

    rows = []
    for (requirement, law), rate in sorted(found.rates.items(), key=lambda each: each[1].rate):
        if requirement == ALL:
            continue
        margin = found.summaries.get((requirement, law))
        least = "-" if margin is None else f"{number(margin.least)} {found.units[requirement]}"
        kept = f"{rate.kept} of {rate.runs}"
        rows.append((requirement, law, kept, rate_interval(rate, "..") or "-", least.rstrip()))
    columns = ("requirement", "law", "kept", "interval %", "least margin")
    console.print(screen.brief_table("", columns, rows, words=2, most=8))
    drivers = [
        f"{law}: {driver.parameter} drives its margin most "
        f"({100 * (driver.share or 0):.0f} % of the variance of the ranks)"
        for law, drivers in found.sensitivities.items()
        for driver in drivers[:1]
        if driver.drives
    ]
    pairs = [
        f"same plants: {first} alone keeps everything on {each.only_first}, {second} alone on "
        f"{each.only_second}"
        for (requirement, first, second), each in found.differences.items()
        if requirement == ALL
    ]
    screen.say_lines(console, [*pairs, *drivers], "", all=False)
    if judged := judged_words(found.judges):
        console.print(judged, style="dim", markup=False)
    console.print(f"{found.sampled.words}. {found.sampled.footnote}", style="dim", markup=False)


def say_tables(console: Console, asked: Campaign, found: Findings) -> None:
    """Print everything that the runs say."""
    from grosmc_mj.campaign.findings.findings import ALL
    from grosmc_mj.campaign.report import tables

    console.print()
    console.print(tables.pass_rates_table(found.rates, found.cut_short, found.sampled))
    if found.summaries:
        console.print()
        console.print(tables.margins_table(found.summaries, found.units, found.looked_at))
    if found.differences:
        console.print()
        console.print(tables.paired_table(found.differences, found.units, found.looked_at))
    for law in asked.judged:
        console.print()
        console.print(tables.sensitivity_table(found.sensitivities[law], ALL, law, found.looked_at))
    console.print()


def say_worst(console: Console, asked: Campaign, found: Sequence[Worst], *, full: bool) -> None:
    """The worst plant under each law, the worst first."""
    from grosmc_mj.campaign.report.tables import plant_words, worst_table
    from grosmc_mj.results.tables import number

    lines = []
    for each in sorted(found, key=lambda each: each.relative):
        line = (
            f"{each.controller}: worst plant, by {each.winner}: margin {number(each.relative)} of "
            f"its limit, {plant_words(asked, each.values)}"
        )
        if each.shrunk is not None:
            line += f"; nearest that fails: {plant_words(asked, each.shrunk)}"
        lines.append(line)
    screen.say_lines(console, lines, "", all=False)
    if full:
        console.print(worst_table(asked, found))
        console.print()


def say_radius(console: Console, asked: Campaign, found: Sequence[Radius], *, full: bool) -> None:
    """How far the uncertainty may grow under each law, the least first."""
    from grosmc_mj.campaign.report.tables import radius_table

    lines = []
    for each in sorted(found, key=lambda each: each.found):
        line = f"{each.controller}: no failure up to {each.found:.3g} times the uncertainty"
        if each.outside is not None:
            line += f", one at {each.outside.scale:.3g}"
        if each.promised.scale is not None:
            line += f"; |s| is promised its bound up to {each.promised.scale:.3g}"
        if each.stayed is not None:
            line += f", keeps it up to {each.stayed:.3g}"
        if each.left is not None:
            line += f", leaves it at {each.left.scale:.3g}"
        lines.append(line)
    screen.say_lines(console, lines, "", all=False)
    if full:
        console.print(radius_table(asked, found))
        console.print()

"""What a campaign says, as tables for the terminal, at most 100 columns wide.

Each says below itself what was sampled and what that does not prove.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rich.markup import escape
from rich.table import Table

from grosmc_mj.campaign.findings.basis import Basis
from grosmc_mj.campaign.findings.pairing import PairedDifference
from grosmc_mj.campaign.findings.sensitivity import Sensitivity
from grosmc_mj.campaign.findings.statistics import TAIL, MarginSummary, PassRate, runs_needed
from grosmc_mj.errors import ArgumentError
from grosmc_mj.report.palette import LABELS
from grosmc_mj.report.tables import empty_table, number

WIDTH = 100
# The least width of a requirement, and the largest of a law.
_REQUIREMENT, _LAW = 20, 20
# A pass rate that one may want to state.
_AIM = 0.99


def pass_rates_table(
    rates: Mapping[tuple[str, str], PassRate],
    diverged: Mapping[str, int],
    sampled: Basis,
) -> Table:
    """How many runs keep each requirement.

    Args:
      rates: By requirement (in words) and law.
      diverged: By law, the runs that did not complete; they count as failures.
      sampled: What the campaign sampled.

    Raises:
      ArgumentError: If there are no rates.
    """
    confidence = _the_confidence([each.confidence for each in rates.values()])
    table = _table("Runs that keep each requirement", ("requirement", "law"))
    for header in (
        "kept",
        "of runs",
        "rate %",
        f"{_percent(confidence)} interval",
        "not completed",
    ):
        table.add_column(header, justify="right", no_wrap=True)
    shown = ""
    for (requirement, law), rate in rates.items():
        # Rounded outwards, so that the interval shown covers the exact one.
        low, high = math.floor(1e4 * rate.low) / 100, math.ceil(1e4 * rate.high) / 100
        cells = (str(rate.kept), str(rate.runs), _rate(rate))
        interval = f"{low:.2f} .. {high:.2f}"
        _row(table, shown, (requirement, law), *cells, interval, str(diverged.get(law, 0)))
        shown = requirement
    needed = runs_needed(_AIM, confidence)
    return _captioned(
        table,
        sampled,
        "Intervals of Clopper and Pearson. A run that did not complete keeps nothing. To state "
        f'"at least {_percent(_AIM)} of this distribution passes" with {_percent(confidence)} '
        f"confidence takes {needed} independent runs without a failure.",
    )


def margins_table(
    summaries: Mapping[tuple[str, str], MarginSummary], units: Mapping[str, str], sampled: Basis
) -> Table:
    """The distribution of each requirement's margin.

    Args:
      summaries: By requirement (in words) and law.
      units: The unit of each requirement's margin; none for a number without.
      sampled: What the campaign sampled.

    Raises:
      ArgumentError: If there are no summaries.
    """
    if not summaries:
        raise ArgumentError("no margins for a table: give at least one requirement and law")
    table = _table("Margins: limit less measured", ("requirement", "law"))
    for header in ("least", f"worst {TAIL} %", "1 %", "5 %", "median", "95 %", "unit"):
        table.add_column(header, justify="right", no_wrap=True)
    shown = ""
    for (requirement, law), each in summaries.items():
        values = (each.least, each.cvar, each.q01, each.q05, each.median, each.q95)
        _row(table, shown, (requirement, law), *map(number, values), units.get(requirement, ""))
        shown = requirement
    return _captioned(
        table,
        sampled,
        f"Below zero the requirement failed. Worst {TAIL} %: mean of the worst {TAIL} % of the "
        "margins (CVaR); then quantiles. -inf: a run that did not complete is among them.",
    )


def paired_table(
    differences: Mapping[tuple[str, str, str], PairedDifference],
    units: Mapping[str, str],
    sampled: Basis,
) -> Table:
    """Laws against each other on the same plants.

    Args:
      differences: By requirement (in words), first and second law.
      units: The unit of each requirement's margin; none for a number without.
      sampled: What the campaign sampled.

    Raises:
      ArgumentError: If there are no differences.
    """
    confidence = _the_confidence([each.confidence for each in differences.values()])
    table = _table("Two laws on the same plants: second less first", ("requirement", "laws"))
    table.add_column("only\nfirst", justify="right", no_wrap=True)
    for header in ("only\nsecond", "pass rate\n[% points]", "McNemar\np", "median of\nmargins"):
        table.add_column(escape(header), justify="right", no_wrap=True)
    shown = ""
    for (requirement, first, second), each in differences.items():
        points = _between("", *(100 * v for v in (each.difference, each.low, each.high)))
        median = _between(
            units.get(requirement, ""), each.median, each.median_low, each.median_high
        )
        laws = f"{LABELS.get(first, first)},\n{LABELS.get(second, second)}"
        counts = (str(each.only_first), str(each.only_second))
        _row(table, shown, (requirement, laws), *counts, points, _p_value(each.p_value), median)
        shown = requirement
    return _captioned(
        table,
        sampled,
        f"Only: plants on which one law alone keeps the requirement. In brackets: "
        f"{_percent(confidence)} intervals, of the rates conservative (two Clopper-Pearson "
        "intervals together), of the median by order statistics. All requirements: of each law its "
        "own.",
    )


def sensitivity_table(
    found: Sequence[Sensitivity], requirement: str, law: str, sampled: Basis
) -> Table:
    """What drives one requirement's margin under one law.

    Args:
      found: The parameters, the strongest first.
      requirement: In words.
      law: Whose margins.
      sampled: What the campaign sampled.

    Raises:
      ArgumentError: If there are no parameters.
    """
    if not found:
        raise ArgumentError("no parameters for a table: give at least one")
    title = f"What drives the margin of {requirement!r} under {LABELS.get(law, law)}"
    table = _table(escape(title), ("parameter",))
    for header in ("share %", "p", "rank correlation"):
        table.add_column(header, justify="right", no_wrap=True)
    table.add_column("")
    for each in found:
        if each.share is None or each.p_value is None or each.correlation is None:
            table.add_row(escape(each.parameter), "-", "", "-", each.note, style="dim")
            continue
        assert each.low is not None
        assert each.high is not None
        correlation = f"{each.correlation:+.2f} ({each.low:+.2f} .. {each.high:+.2f})"
        share, p_value = f"{100 * each.share:.0f}", _p_value(each.p_value)
        table.add_row(escape(each.parameter), share, p_value, correlation, each.note)
    return _captioned(
        table,
        sampled,
        "Share of the variance of the margins' ranks that the parameter explains alone, less what "
        "chance gives; p: of a share at least as large if it explained nothing. Correlation: "
        "Spearman's, positive if more of the parameter leaves more margin. Shares of correlated "
        "parameters overlap.",
    )


def _the_confidence(all_of_them: Sequence[float]) -> float:
    """The one confidence of a table's intervals."""
    if len(set(all_of_them)) != 1:
        raise ArgumentError("a table needs at least one row, and one confidence for all of them")
    return all_of_them[0]


def _table(title: str, names: Sequence[str]) -> Table:
    """An empty table of the full width, whose first columns are names."""
    table = empty_table(title)
    table.width = WIDTH
    table.add_column(names[0], overflow="fold", ratio=1, min_width=_REQUIREMENT)
    for header in names[1:]:
        table.add_column(header, overflow="fold", max_width=_LAW)
    return table


def _row(table: Table, shown: str, names: tuple[str, str], *cells: str) -> None:
    """A row; a requirement that the row above has is not said again."""
    requirement, law = names
    if shown and shown != requirement:
        table.add_section()
    said = "" if shown == requirement else requirement
    table.add_row(escape(said), escape(LABELS.get(law, law)), *map(escape, cells))


def _captioned(table: Table, sampled: Basis, legend: str) -> Table:
    """The table over what it means, what was sampled and what that does not prove."""
    table.caption = escape(f"{legend}\n{sampled.words}. {sampled.footnote}")
    table.caption_justify = "left"
    table.caption_style = "dim"
    return table


def _rate(rate: PassRate) -> str:
    """A pass rate [%]; only all of the runs are 100 %, and only none 0 %."""
    if 0 < rate.kept < rate.runs:
        return f"{min(max(100 * rate.rate, 0.01), 99.99):.2f}"
    return f"{100 * rate.rate:.0f}"


def _percent(share: float) -> str:
    """A share in per cent."""
    return f"{100 * share:.6g} %"


def _p_value(p: float) -> str:
    """A p-value."""
    return "< 1e-4" if p < 1e-4 else f"{p:.2g}"


def _between(unit: str, value: float, low: float, high: float) -> str:
    """A signed number over its interval; an end may be open."""
    return f"{_signed(value)} {unit}".rstrip() + f"\n({_signed(low)} .. {_signed(high)})"


def _signed(value: float) -> str:
    """A number with its sign."""
    return ("+" if value > 0 else "") + number(value)

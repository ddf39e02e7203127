"""What a campaign says, as tables."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.results.palette import label_of
from grosmc_mj.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.family import Quantity
from grosmc_mj.sweep.findings import ALL, NO_PROOF, Findings
from grosmc_mj.sweep.radius import Radius
from grosmc_mj.sweep.statistics import TAIL, PassRate, runs_needed
from grosmc_mj.sweep.worst import Worst

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


def worst_table(campaign: Campaign, found: Sequence[Worst]) -> Table:
    """The worst plant under each controller, and who came how far."""
    rows = []
    for plant in found:
        nearest = "none was found"
        if plant.shrunk is not None:
            margin = number(plant.shrunk_relative)
            nearest = f"{plant_words(campaign, plant.shrunk)}: margin {margin}"
        margins = map(number, (plant.samples, plant.search, plant.random))
        values = f"{plant_words(campaign, plant.values)}: margin {number(plant.relative)}"
        rows.append((label_of(plant.controller), *margins, plant.winner, values, nearest))
    runs = found[0].evaluations
    return table(
        "The worst plant: least margin in parts of its limit",
        [
            *names("law"), *numbers("samples", "search", "random"), *words("worst by"),
            *text("the worst plant"), *text("nearest to the nominal plant that fails"),
        ],
        rows,
        legend="Samples: the worst run of the campaign. Search: differential evolution that begins "
        f"with the worst samples and the corners of the ranges, {runs} runs; random: {runs} random "
        "plants. All three were judged in MuJoCo; of equally bad ones the first is named. Of "
        "plants that never settle the one with the largest error left is the worst, of runs that "
        "end early the earliest. Below zero something is not kept; numbers not named are nominal. "
        f"{NO_PROOF}",
    )  # fmt: skip


def radius_table(campaign: Campaign, found: Sequence[Radius]) -> Table:
    """How far the uncertainty may grow under each controller, beside what is promised."""
    rows, notes = [], []
    for search in found:
        law, outside, promised = label_of(search.controller), search.outside, search.promised
        fails_at, leaves_at = (look and look.scale for look in (outside, search.left))
        scales = (search.found, fails_at, promised.scale, search.stayed, leaves_at)
        plant = plant_words(campaign, outside.values) if outside else "none was found"
        rows.append((law, *("-" if at is None else f"{at:.3g}" for at in scales), plant))
        band = promised.band
        bound = "" if band is None else f"; there |s| - |s(0)| is at most {band:.3g}"
        notes.append(f"{law}: {promised.note}{bound}.")
    headers = (
        "no failure\nup to", "failure\nat", "promised", "|s| kept\nup to", "|s| leaves\nat",
    )  # fmt: skip
    return table(
        "How far the uncertainty may grow: 1 is as declared",
        [*names("law"), *numbers(*headers), *text("the failing plant just outside")],
        rows,
        legend=f"{found[0].plants} plants at each scale, up to "
        f"{max(search.largest for search in found):.3g}. Promised: scale up to which the premises "
        "hold for every extreme plant, so that |s| does not grow but for what one sample does. "
        "Compare it with where |s| leaves that bound: of the requirements, which may be looser or "
        f"stricter, premises say nothing. {' '.join(notes)} {NO_PROOF}",
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


def plant_words(campaign: Campaign, values: Array) -> str:
    """The uncertain numbers that are not nominal, as they are run."""
    quantities = numbers_as_run(campaign, values)
    parts = [of.words(value) for of, value, nominal in quantities if value != nominal]
    return ", ".join(parts) or "the nominal one"


def numbers_as_run(campaign: Campaign, values: Array) -> list[tuple[Quantity, float, float]]:
    """Each uncertain number with its value in a plant (d,) and its nominal one, as they are run."""
    quantities = campaign.family.quantities
    pairs = np.stack([values, campaign.family.nominal], axis=1)
    rows = [campaign.as_run(of, pair) for of, pair in zip(quantities, pairs, strict=True)]
    return [(of, *row.tolist()) for of, row in zip(quantities, rows, strict=True)]

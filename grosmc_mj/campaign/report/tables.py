"""What a campaign says, as tables for the terminal, at most 100 columns wide.

Each says below itself what was sampled and what that does not prove.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.family import Quantity
from grosmc_mj.campaign.findings.basis import NO_PROOF, Basis
from grosmc_mj.campaign.findings.pairing import PairedDifference
from grosmc_mj.campaign.findings.radius import Radius
from grosmc_mj.campaign.findings.sensitivity import Sensitivity
from grosmc_mj.campaign.findings.statistics import TAIL, MarginSummary, PassRate, runs_needed
from grosmc_mj.campaign.findings.worst import Worst
from grosmc_mj.errors import ArgumentError
from grosmc_mj.results.palette import label_of
from grosmc_mj.results.tables import Table, names, number, numbers, table, text, words

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
    rows = []
    for (requirement, law), rate in rates.items():
        counts = (str(rate.kept), str(rate.runs), _rate(rate), rate_interval(rate, "..") or "-")
        rows.append((requirement, label_of(law), *counts, str(diverged.get(law, 0))))
    needed = runs_needed(_AIM, confidence)
    interval = f"{_percent(confidence)} interval"
    return table(
        "Runs of the declared design that keep each requirement",
        [
            *text("requirement"), *names("law"),
            *numbers("kept", "of runs", "rate %", interval, "not completed"),
        ],
        rows,
        grouped=True,
        legend=f"{_clopper(sampled)}A run that did not complete keeps nothing. To state "
        f'"at least {_percent(_AIM)} of the declared design passes" with '
        f"{_percent(confidence)} confidence takes {needed} independent runs (--sampler random) "
        "without a failure." + _basis(sampled),
    )  # fmt: skip


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
    confidence = _the_confidence([each.confidence for each in summaries.values()])
    rows = []
    for (requirement, law), each in summaries.items():
        values = (each.least, each.cvar, each.q01, each.q05, each.median, each.q95)
        mean = number(each.mean)
        if each.mean_low is not None and each.mean_high is not None:
            mean += f"\n({number(each.mean_low)} ..\n{number(each.mean_high)})"
        cells = (*map(number, values), mean, units.get(requirement, ""))
        rows.append((requirement, label_of(law), *cells))
    return table(
        "Margins: limit less measured",
        [
            *text("requirement"), *names("law"),
            *numbers("least", f"worst {TAIL} %", "1 %", "5 %", "median", "95 %", "mean", "unit"),
        ],
        rows,
        grouped=True,
        legend=f"Below zero the requirement failed. Worst {TAIL} %: mean of the worst {TAIL} % of "
        "the margins (CVaR); then quantiles, and the mean with its "
        f"{_percent(confidence)} interval (Student's t) where there is one. -inf: a run that did "
        "not complete is among them, so that their mean has no interval." + _basis(sampled),
    )  # fmt: skip


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
    rows = []
    for (requirement, first, second), each in differences.items():
        ends = (None if end is None else 100 * end for end in (each.low, each.high))
        points = _between("", 100 * each.difference, *ends)
        unit = units.get(requirement, "")
        median = _between(unit, each.median, each.median_low, each.median_high)
        laws = f"{label_of(first)},\n{label_of(second)}"
        counts = (str(each.only_first), str(each.only_second))
        rows.append((requirement, laws, *counts, points, _p_value(each.p_value), median))
    return table(
        "Two laws on the same plants: second less first",
        [
            *text("requirement"), *names("laws"),
            *numbers(
                "only\nfirst", "only\nsecond", "pass rate\n[% points]", "p",
                "median of\nmargins",
            ),
        ],
        rows,
        grouped=True,
        legend=f"Only: plants on which one law alone keeps the requirement. In brackets: "
        f"{_percent(confidence)} intervals{_of_pairs(sampled)}. All requirements: of each law its "
        "own." + _basis(sampled),
    )  # fmt: skip


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
    rows = []
    for each in found:
        if each.share is None or each.correlation is None:
            rows.append((each.parameter, "-", "", "-", each.note))
            continue
        correlation = f"{each.correlation:+.2f}"
        if each.low is not None and each.high is not None:
            correlation += f" ({each.low:+.2f} .. {each.high:+.2f})"
        share, p_value = f"{100 * each.share:.0f}", _p_value(each.p_value)
        rows.append((each.parameter, share, p_value, correlation, each.note))
    return table(
        f"What drives the margin of {requirement!r} under {label_of(law)}",
        [*text("parameter"), *numbers("share %", "p", "rank correlation"), *words("")],
        rows,
        styles=["dim" if each.share is None else "" for each in found],
        legend="Share of the variance of the margins' ranks that the parameter explains alone, "
        "less what chance gives; p: of a share at least as large if it explained nothing. "
        "Correlation: Spearman's, positive if more of the parameter leaves more margin. Shares of "
        "correlated parameters overlap." + _basis(sampled),
    )


def worst_table(campaign: Campaign, found: Sequence[Worst]) -> Table:
    """The worst plant under each controller, and who came how far."""
    rows = []
    for plant in found:
        nearest = "none was found"
        if plant.shrunk is not None and plant.shrunk_relative is not None:
            margin = number(plant.shrunk_relative)
            nearest = f"{plant_words(campaign, plant.shrunk)}: margin {margin}"
        margins = (plant.samples, plant.search, plant.random)
        values = f"{plant_words(campaign, plant.values)}: margin {number(plant.relative)}"
        law = label_of(plant.controller)
        rows.append((law, *map(number, margins), plant.winner, values, nearest))
    runs = found[0].evaluations
    return table(
        "The worst plant: least margin in parts of its limit",
        [
            *names("law"), *numbers("samples", "search", "random"),
            *words("worst by"), *text("the worst plant"),
            *text("nearest to the nominal plant that fails"),
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
    for each in found:
        law, outside, promised = label_of(each.controller), each.outside, each.promised
        plant = "none was found" if outside is None else plant_words(campaign, outside.values)
        scales = (
            each.found,
            None if outside is None else outside.scale,
            promised.scale,
            each.stayed,
            None if each.left is None else each.left.scale,
        )
        rows.append((law, *("-" if at is None else f"{at:.3g}" for at in scales), plant))
        bound = "" if each.band is None else f"; there |s| - |s(0)| is at most {each.band:.3g}"
        notes.append(f"{law}: {promised.note}{bound}.")
    return table(
        "How far the uncertainty may grow: 1 is as declared",
        [
            *names("law"),
            *numbers(
                "no failure\nup to", "failure\nat", "promised", "|s| kept\nup to", "|s| leaves\nat"
            ),
            *text("the failing plant just outside"),
        ],
        rows,
        legend=f"{found[0].plants} plants at each scale, up to "
        f"{max(each.largest for each in found):.3g}. Promised: scale up to which the premises hold "
        "for every extreme plant, so that |s| does not grow but for what one sample does. Compare "
        "it with where |s| leaves that bound: of the requirements, which may be looser or "
        f"stricter, premises say nothing. {' '.join(notes)} {NO_PROOF}",
    )  # fmt: skip


def _the_confidence(all_of_them: Sequence[float]) -> float:
    """The one confidence of a table's intervals."""
    if len(set(all_of_them)) != 1:
        raise ArgumentError("a table needs at least one row, and one confidence for all of them")
    return all_of_them[0]


def _basis(sampled: Basis) -> str:
    """What was sampled, and what that does not prove."""
    return f"\n{sampled.words}. {sampled.footnote}"


def _rate(rate: PassRate) -> str:
    """A pass rate [%]; only all of the runs are 100 %, and only none 0 %."""
    if 0 < rate.kept < rate.runs:
        return f"{min(max(100 * rate.rate, 0.01), 99.99):.2f}"
    return f"{100 * rate.rate:.0f}"


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
    interval = "" if low is None or high is None else f"\n({_signed(low)} .. {_signed(high)})"
    return f"{_signed(value)} {unit}".rstrip() + interval


def rate_interval(rate: PassRate, between: str) -> str:
    """The interval of a pass rate [%]; empty if there is none."""
    if rate.low is None or rate.high is None:
        return ""
    # Rounded outwards, so that the interval shown covers the exact one.
    low, high = math.floor(1e4 * rate.low) / 100, math.ceil(1e4 * rate.high) / 100
    return f"{low:.2f} {between} {high:.2f}"


def _clopper(sampled: Basis) -> str:
    """What the intervals of pass rates are, of independent runs."""
    return "Intervals of Clopper and Pearson. " if sampled.independent else ""


def _of_pairs(sampled: Basis) -> str:
    """What the intervals of differences are, of independent runs."""
    if not sampled.independent:
        return ""
    return (
        ", of the rates conservative (two Clopper-Pearson intervals together), of the median by "
        "order statistics; p: McNemar's, exact"
    )


def _signed(value: float) -> str:
    """A number with its sign."""
    return ("+" if value > 0 else "") + number(value)


def plant_words(campaign: Campaign, values: Array) -> str:
    """The uncertain numbers that are not nominal, as they are run."""
    numbers = numbers_as_run(campaign, values)
    parts = [each.words(value) for each, value, nominal in numbers if value != nominal]
    return ", ".join(parts) or "the nominal one"


def numbers_as_run(
    campaign: Campaign, values: Sequence[float] | Array
) -> list[tuple[Quantity, float, float]]:
    """Each uncertain number with its value in a plant (d,) and its nominal one, as they are run."""
    quantities = campaign.family.quantities
    pairs = np.stack([np.asarray(values), campaign.family.nominal], axis=1)
    rows = [campaign.as_run(each, pair) for each, pair in zip(quantities, pairs, strict=True)]
    return [(each, *row.tolist()) for each, row in zip(quantities, rows, strict=True)]

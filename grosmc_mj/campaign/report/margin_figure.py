"""The distribution of each requirement's margin under each law, as one figure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.findings.findings import ALL, Findings
from grosmc_mj.results.figure import board, in_lines, write_figure
from grosmc_mj.results.palette import FAILED_SHADE, OPTIMUM, LawStyle, law_styles

_SIZE = (4.9, 3.2)
# Of one law in the legend [inch].
_ENTRY_HEIGHT = 0.24
# Tukey's fence of what lies far out, in distances of the quartiles.
_FENCE = 1.5
# How much wider than the tightest law the axis may be, so that this one can still be read.
_WIDEST = 8.0
# The part of the axis that each side of zero has at least.
_LEAST_SIDE = 0.16


def write_margins(campaign: Campaign, found: Findings, files: Sequence[Path]) -> None:
    """Draw the distribution of each requirement's margin into each file."""
    requirements = list(dict.fromkeys(each.words for each in campaign.requirements)) or [ALL]
    panels = {
        words: {law: each for (of, law), each in found.margins.items() if of == words}
        for words in requirements
    }
    title = f"{campaign.experiment.case.title}: margins ({found.looked_at.words})"
    write_figure(draw_margins(panels, found.units, title, found.sampled.footnote), files)


def draw_margins(
    panels: Mapping[str, Mapping[str, Array]], units: Mapping[str, str], title: str, footnote: str
) -> Figure:
    """A panel a requirement, a curve a law.

    Args:
        panels: Each law's margins, (n,), -inf for a run that did not complete, by the requirement.
        units: Of each requirement's margin; empty for a number without.
        title: Of the figure: of what, and what was sampled.
        footnote: What it does not prove.
    """
    styles = law_styles(dict.fromkeys(law for margins in panels.values() for law in margins))
    size = (_SIZE[0], _SIZE[1] + _ENTRY_HEIGHT * len(styles))
    with board(len(panels), size, title, footnote) as found:
        for axes, (words, margins) in zip(found.panels, panels.items(), strict=True):
            _draw(axes, margins, units[words], styles)
            axes.set_title(in_lines(words), pad=16)
    return found.figure


def _draw(
    axes: Axes, found: Mapping[str, Array], unit: str, styles: Mapping[str, LawStyle]
) -> None:
    """One requirement's empirical distribution functions."""
    low, high = _range(found.values())
    # A little further left, so that a step at the edge is seen.
    edge = low - 0.015 * (high - low)
    axes.axvspan(edge, 0, color=FAILED_SHADE, zorder=0)
    axes.axvline(0, color=OPTIMUM, lw=1.0, zorder=1)
    for law, margins in found.items():
        rising = np.sort(margins)
        # The runs that did not complete are a step at the left edge.
        x = np.concatenate([[low], np.clip(rising, low, None), [max(high, rising[-1])]])
        y = np.concatenate([[0.0], np.arange(1, len(rising) + 1), [len(rising)]]) / len(rising)
        style = styles[law]
        axes.plot(
            x, y, drawstyle="steps-post", color=style.colour, ls=style.line, lw=1.8,
            label=_entry(style.label, rising, low, high),
        )  # fmt: skip
    axes.set_xlim(edge, high)
    axes.set_ylim(0, 1.02)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.xaxis.set_major_locator(MaxNLocator(nbins=5))
    place = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "va": "bottom"}
    axes.annotate("failed", (0, 1), (-4, 1), ha="right", fontsize=8.5, **place)
    axes.annotate("kept", (0, 1), (4, 1), ha="left", fontsize=8.5, **place)
    axes.set_xlabel(f"margin [{unit}]" if unit else "margin")
    axes.set_ylabel("runs with this margin or less")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), frameon=False)


def _entry(label: str, rising: Array, low: float, high: float) -> str:
    """A law in the legend, with what the axis does not show."""
    text = f"{label}: {np.count_nonzero(rising >= 0)} of {len(rising)} kept"
    counts = {
        "did not complete": np.count_nonzero(rising == -np.inf),
        "beyond the left edge": np.count_nonzero((rising > -np.inf) & (rising < low)),
        "beyond the right edge": np.count_nonzero(rising > high),
    }
    said = [text, *(f"{count} {what}" for what, count in counts.items() if count)]
    return in_lines("; ".join(said), 52)


def _range(margins: Iterable[Array]) -> tuple[float, float]:
    """Where the axis begins and ends: no margin far out, zero inside, no law squeezed to a line."""
    ends = np.array([_fences(each[each > -np.inf]) for each in margins if each.max() > -np.inf])
    if not len(ends):
        return (-1.0, 1.0)
    low, high = min(ends[:, 0].min(), 0.0), max(ends[:, 1].max(), 0.0)
    scales = np.abs(ends).max(axis=1)
    if scales.any():
        widest = _WIDEST * scales[scales > 0].min()
        low, high = max(low, -widest), min(high, widest)
    width = 1.06 * ((high - low) or 2.0)
    left, right = max(-low, _LEAST_SIDE * width), max(high, _LEAST_SIDE * width)
    return (-1.06 * left, 1.03 * right)


def _fences(margins: Array) -> tuple[float, float]:
    """The least and the largest margin that is not far out."""
    lower, upper = np.quantile(margins, [0.25, 0.75])
    reach = _FENCE * (upper - lower)
    near = margins[(margins >= lower - reach) & (margins <= upper + reach)]
    return (float(near.min()), float(near.max()))

"""How far the uncertainty can be scaled: what the search found beside what the premises promise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.findings.basis import NO_PROOF
from grosmc_mj.campaign.findings.radius import Radius
from grosmc_mj.results.figure import board, in_lines, write_figure
from grosmc_mj.results.palette import FAILED_SHADE, OPTIMUM, LawStyle, law_styles

_SIZE = (5.2, 4.9)


def write_radius(campaign: Campaign, found: Sequence[Radius], files: Sequence[Path]) -> None:
    """Draw the least margin over the scale of the uncertainty into each file."""
    plants = max(each.plants for each in found)
    title = f"{campaign.experiment.case.title}: scale of the uncertainty ({plants} plants at each)"
    write_figure(draw_radius(found, title, NO_PROOF), files)


def draw_radius(searches: Sequence[Radius], title: str, footnote: str) -> Figure:
    """A panel a law, a mark a scale that was tried.

    Args:
        searches: One a law.
        title: Of the figure: of what, and what was sampled.
        footnote: What it does not prove.
    """
    styles = law_styles(each.controller for each in searches)
    with board(len(searches), _SIZE, title, footnote) as found:
        for axes, each in zip(found.panels, searches, strict=True):
            _draw(axes, each, styles[each.controller])
    return found.figure


def _draw(axes: Axes, search: Radius, style: LawStyle) -> None:
    """One law's scales."""
    scales = np.array([look.scale for look in search.looks])
    least = np.array([look.least for look in search.looks])
    diverged = least == -np.inf
    low, high = _range(least[~diverged])
    # A run that did not complete has no least margin: its mark lies on the lower edge.
    shown = np.where(diverged, low, least)
    marks = (
        (least >= 0, "o", style.colour, "no failure found"),
        ((least < 0) & ~diverged, "o", "white", "failure found"),
        (diverged, "v", "white", "a run did not complete"),
    )
    axes.axhspan(low, 0, color=FAILED_SHADE, zorder=0)
    axes.axhline(0, color=OPTIMUM, lw=1.0, zorder=1)
    axes.plot(scales, shown, color=style.colour, lw=1.2, zorder=2)
    for mask, marker, face, label in marks:
        if mask.any():
            axes.plot(
                scales[mask], shown[mask], ls="", marker=marker, mfc=face, mec=style.colour,
                mew=1.6, ms=7, label=label, zorder=5, clip_on=False,
            )  # fmt: skip
    right = max(scales[-1], search.found, search.promised.scale or 0.0, search.stayed or 0.0)
    axes.set_xlim(0, 1.06 * float(right) or 1.0)
    axes.set_ylim(low, high)
    _draw_radii(axes, search, style)
    axes.set_title(in_lines(style.label), pad=18)
    axes.set_xlabel("scale of the uncertainty (1 as configured)")
    axes.set_ylabel("least margin found over its limit")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), frameon=False)


def _draw_radii(axes: Axes, search: Radius, style: LawStyle) -> None:
    """The radii as lines, both outer ones with their values above, and in words in the legend."""
    # The values stand on the outer sides of the lines, where they cannot meet.
    promised = search.promised.scale
    outer = promised is None or search.found >= promised
    line: dict[str, Any] = {"lw": 2.2, "color": style.colour}
    _radius(axes, search.found or None, _found_words(search), line, right=outer)
    words = "premises promise no radius" if promised is None else f"premises promise {promised:.3g}"
    if search.promised.note:
        words += f": {search.promised.note}"
    line = {"lw": 1.8, "color": OPTIMUM, "ls": (0, (4, 2))}
    _radius(axes, promised, words, line, right=not outer)
    if search.stayed is not None:
        words = f"|s| keeps the promised bound up to {search.stayed:.3g}"
        if search.left is not None:
            words += f", leaves it at {search.left.scale:.3g}"
        # Its value stands in the legend: a third one above the panel would meet the others.
        axes.axvline(
            search.stayed, zorder=3, label=in_lines(words, 52), lw=1.6, color=OPTIMUM, ls=":"
        )


def _found_words(search: Radius) -> str:
    """What the found radius says."""
    if not search.found:
        return "a failure was found at every scale tried"
    largest = ", the largest tried" if search.found >= search.looks[-1].scale else ""
    return f"no failure found up to {search.found:.3g}{largest}"


def _radius(axes: Axes, at: float | None, words: str, line: dict[str, Any], *, right: bool) -> None:
    """A vertical line with its value above it; without one its words alone, in the legend."""
    if at is None:
        axes.plot([], [], ls="", label=in_lines(words, 52))
        return
    axes.axvline(at, zorder=3, label=in_lines(words, 52), **line)
    axes.annotate(
        f"{at:.3g}", (at, 1), (1 if right else -1, 2), xycoords=("data", "axes fraction"),
        textcoords="offset points", ha="left" if right else "right", va="bottom",
        fontsize=10, color=line["color"],
    )  # fmt: skip


def _range(margins: Array) -> tuple[float, float]:
    """Both ends of the axis of margins, zero inside."""
    low, high = min(margins.min(initial=0.0), 0.0), max(margins.max(initial=0.0), 0.0)
    height = (high - low) or 1.0
    return (float(low - 0.12 * height), float(high + 0.12 * height))

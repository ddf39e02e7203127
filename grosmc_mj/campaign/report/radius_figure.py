"""How far the uncertainty can be scaled: what the search found beside what the premises promise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.findings.basis import NO_PROOF
from grosmc_mj.campaign.findings.checks import checked_margins, checked_values
from grosmc_mj.campaign.findings.radius import Radius
from grosmc_mj.errors import ArgumentError
from grosmc_mj.report.figure import board, in_lines, write_figure
from grosmc_mj.report.palette import FAILED_SHADE, OPTIMUM, LawStyle, law_styles

_SIZE = (5.2, 4.9)


class RadiusCurve(NamedTuple):
    """The search of one law.

    Attributes:
      law: Its name.
      scales: Scales of the uncertainty that were tried, (n,).
      least: Least margin found at each, over its requirement's limit, (n,); -inf if a run there
        did not complete.
      found: Largest scale at which no failure was found; None if there was one at each.
      promised: Scale up to which the premises hold; None if they hold at none.
      promised_note: What that rests on, or why there is none.
      stayed: Largest scale at which |s| kept the bound that is promised; None if it is not known.
      left: Smallest scale at which |s| left it; None if it never did.
    """

    law: str
    scales: Array
    least: Array
    found: float | None
    promised: float | None
    promised_note: str
    stayed: float | None = None
    left: float | None = None


def write_radius(campaign: Campaign, found: Sequence[Radius], files: Sequence[Path]) -> None:
    """Draw the least margin over the scale of the uncertainty into each file."""
    curves = [
        RadiusCurve(
            each.controller,
            np.array([look.scale for look in each.looks]),
            np.array([look.least for look in each.looks]),
            each.found or None,
            each.promised.scale,
            each.promised.note,
            each.stayed,
            None if each.left is None else each.left.scale,
        )
        for each in found
    ]
    plants = max(each.plants for each in found)
    title = f"{campaign.experiment.case.title}: scale of the uncertainty ({plants} plants at each)"
    write_figure(draw_radius(curves, title, NO_PROOF), files)


def draw_radius(curves: Sequence[RadiusCurve], title: str, footnote: str) -> Figure:
    """A panel a law, a mark a scale that was tried.

    Args:
        curves: One a law.
        title: Of the figure: of what, and what was sampled.
        footnote: What it does not prove.

    Raises:
        ArgumentError: If there is nothing to draw, or arrays do not fit each other.
    """
    if not curves:
        raise ArgumentError("no radius to draw: give at least one law's search")
    styles = law_styles(curve.law for curve in curves)
    with board(len(curves), _SIZE, title, footnote) as found:
        for axes, curve in zip(found.panels, curves, strict=True):
            _draw(axes, curve, styles[curve.law])
    return found.figure


def _draw(axes: Axes, curve: RadiusCurve, style: LawStyle) -> None:
    """One law's scales."""
    least = checked_margins(f"least margins of {curve.law}", curve.least)
    scales = checked_values(f"scales of {curve.law}", curve.scales, len(least))
    order = np.argsort(scales)
    scales, least = scales[order], least[order]
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
    right = max(
        [
            float(scales[-1]),
            *(v for v in (curve.found, curve.promised, curve.stayed) if v is not None),
        ]
    )
    axes.set_xlim(0, 1.06 * right or 1.0)
    axes.set_ylim(low, high)
    _draw_radii(axes, curve, style)
    axes.set_title(in_lines(style.label), pad=18)
    axes.set_xlabel("scale of the uncertainty (1 as configured)")
    axes.set_ylabel("least margin found over its limit")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), frameon=False)


def _draw_radii(axes: Axes, curve: RadiusCurve, style: LawStyle) -> None:
    """The radii as lines, both outer ones with their values above, and in words in the legend."""
    # The values stand on the outer sides of the lines, where they cannot meet.
    outer = curve.promised is None or (curve.found or 0.0) >= curve.promised
    line: dict[str, Any] = {"lw": 2.2, "color": style.colour}
    _radius(axes, curve.found, _found_words(curve), line, right=outer)
    words = "premises promise no radius"
    if curve.promised is not None:
        words = f"premises promise {curve.promised:.3g}"
    if curve.promised_note:
        words += f": {curve.promised_note}"
    line = {"lw": 1.8, "color": OPTIMUM, "ls": (0, (4, 2))}
    _radius(axes, curve.promised, words, line, right=not outer)
    if curve.stayed is not None:
        words = f"|s| keeps the promised bound up to {curve.stayed:.3g}"
        if curve.left is not None:
            words += f", leaves it at {curve.left:.3g}"
        # Its value stands in the legend: a third one above the panel would meet the others.
        axes.axvline(
            curve.stayed, zorder=3, label=in_lines(words, 52), lw=1.6, color=OPTIMUM, ls=":"
        )


def _found_words(curve: RadiusCurve) -> str:
    """What the found radius says."""
    if curve.found is None:
        return "a failure was found at every scale tried"
    largest = ", the largest tried" if curve.found >= max(curve.scales) else ""
    return f"no failure found up to {curve.found:.3g}{largest}"


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

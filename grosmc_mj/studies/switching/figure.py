"""One figure of accuracy and chattering against sample time, as PNG and SVG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from grosmc_mj.results.figure import figure_written
from grosmc_mj.results.palette import BLUE, GREEN, OPTIMUM, ORANGE, PURPLE, SKY, VERMILION
from grosmc_mj.results.tables import number
from grosmc_mj.studies.switching.measure import GAIN, OWN_VARIATION, PUSH, SLOPE, Benchmark, CaseRow

NAME = "switching"

# A colour, a marker each for those who see none, and a width: where laws do the
# same, the wider lines show beside the narrower ones above them.
_LAWS: dict[str, tuple[str, str, float]] = {
    "sign": (VERMILION, "o", 1.3),
    "boundary-layer": (ORANGE, "s", 2.6),
    "implicit": (BLUE, "D", 1.9),
    "implicit-estimate": (GREEN, "v", 1.1),
    "super-twisting": (PURPLE, "^", 2.6),
    "adaptive": (SKY, "P", 3.4),
}
# The cases of the figure where every system is measured: what the chapter promises, and its
# hardest test.
_CHOSEN = (("servo", "nominal"), ("cart_pendulum", "case1"))
_NOTE: dict[str, Any] = {"fontsize": 8.5, "color": OPTIMUM}


def write_chattering_figure(
    by_time: Sequence[Benchmark],
    by_ratio: Sequence[Benchmark],
    cases: Sequence[CaseRow],
    folder: Path,
) -> Path:
    """Draw the scalar benchmark over a row for each case, under the discrete-time surface.

    Args:
        by_time: Benchmark over the sample times.
        by_ratio: Benchmark over the input-gain ratios, at one sample time.
        cases: The cases; if they are of several systems, two stand for all.
        folder: Where to write.

    Returns:
        The PNG; the SVG lies beside it.

    Raises:
        SetupError: If a file cannot be written.
    """
    rows = _rows(cases)
    path = folder / f"{NAME}.png"
    with figure_written(path, (11.5, 3.1 * (1 + len(rows)) + 0.9)) as figure:
        axes = figure.subplots(1 + len(rows), 3, squeeze=False)
        _accuracy(axes[0, 0], by_time)
        _variation(axes[0, 1], by_time)
        _limits(axes[0, 2], by_ratio)
        for panels, found in zip(axes[1:], rows, strict=True):
            _case(list(panels), found)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
        figure.suptitle("Accuracy and chattering against sample time", fontsize=12.5)
    return path


def _rows(cases: Sequence[CaseRow]) -> list[list[CaseRow]]:
    """The rows of each case that is drawn, under the discrete-time surface."""
    systems = {row.run.system for row in cases}
    names = dict.fromkeys((row.run.system, row.run.case) for row in cases)
    drawn = [name for name in names if len(systems) == 1 or name in _CHOSEN]
    return [
        [
            row
            for row in cases
            if (row.run.system, row.run.case) == name and row.run.surface == "discrete"
        ]
        for name in drawn
    ]


def _curve(axes: Axes, law: str, x: Sequence[float], y: Sequence[float], **line: Any) -> None:
    """One law's curve; it ends where it diverges."""
    colour, marker, width = _LAWS[law]
    shown = [value if math.isfinite(value) and value > 0 else math.nan for value in y]
    style = {"color": colour, "marker": marker, "lw": width, "zorder": 3 - 0.1 * width, **line}
    axes.plot(x, shown, label=law, markeredgewidth=0, ms=3 + width, **style)


def _log(axes: Axes, title: str, unit: str) -> None:
    """Both scales logarithmic, sample times in milliseconds."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_title(title, loc="left")
    axes.set_xlabel("sample time T [ms]")
    axes.set_ylabel(unit)
    low, high = axes.get_xlim()
    ticks = [t for t in (0.25, 0.5, 1, 2, 4, 8) if low <= t <= high]
    axes.set_xticks(ticks)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    bottom, top = axes.get_ylim()
    if top < 50 * bottom:  # too few powers of ten to read values from
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _accuracy(axes: Axes, rows: Sequence[Benchmark]) -> None:
    """Largest |s| on the scalar benchmark, with lines of the first and the second order."""
    for law in _LAWS:
        found = [row for row in rows if row.law == law]
        _curve(axes, law, [1e3 * row.h for row in found], [row.max_sliding for row in found])
    h = np.array(sorted({row.h for row in rows}))
    for y, label in ((PUSH * h, "order 1: W T"), (SLOPE * h**2, "order 2: L T²")):
        axes.plot(1e3 * h, y, color=OPTIMUM, lw=0.9, ls=(0, (2, 2)), zorder=5)
        middle = len(h) // 2
        place = {"xytext": (6, -3), "textcoords": "offset points", "va": "top"}
        axes.annotate(label, (1e3 * h[middle], y[middle]), **place, **_NOTE)
    _log(axes, "Scalar s′ = u + 0.5 sin 2πt: largest |s|", "max |s|")


def _variation(axes: Axes, rows: Sequence[Benchmark]) -> None:
    """Total variation of the input on the scalar benchmark, beside that of w."""
    for law in _LAWS:
        found = [row for row in rows if row.law == law]
        _curve(axes, law, [1e3 * row.h for row in found], [row.total_variation for row in found])
    axes.axhline(OWN_VARIATION, color=OPTIMUM, lw=0.9, ls=(0, (2, 2)), zorder=5)
    axes.annotate(
        "that of w itself", (0.02, OWN_VARIATION), xycoords=("axes fraction", "data"),
        xytext=(0, -4), textcoords="offset points", va="top", **_NOTE,
    )  # fmt: skip
    axes.set_ylim(bottom=0.5 * OWN_VARIATION)
    _log(axes, "Scalar: total variation of u per second", "variation of u [1/s]")


def _limits(axes: Axes, rows: Sequence[Benchmark]) -> None:
    """Largest |s| over T against the ratio of the true to the nominal input gain."""
    for law in _LAWS:
        found = [row for row in rows if row.law == law]
        x, y = [row.gain_ratio for row in found], [row.max_sliding / row.h for row in found]
        _curve(axes, law, x, y, markevery=4)
    top = 1e4
    marked = (
        (PUSH / GAIN, "r ρ = W"),
        (4 / 3, "4/3, estimate"),
        (2.0, "2, implicit"),
    )
    for ratio, label in marked:
        axes.axvline(ratio, color=OPTIMUM, lw=0.9, ls=(0, (2, 2)))
        place = {"xytext": (2, -2), "textcoords": "offset points", "va": "top"}
        axes.annotate(label, (ratio, top), **place, **_NOTE)
    axes.set_yscale("log")
    axes.set_ylim(1e-3, top)
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_title(f"Scalar with input r u, T = {1e3 * rows[0].h:g} ms", loc="left")
    axes.set_xlabel("true over nominal input gain r")
    axes.set_ylabel("max |s| / T")


def _case(panels: Sequence[Axes], rows: Sequence[CaseRow]) -> None:
    """Deviation, total variation and cost of one case."""
    run = rows[0].run
    system = run.experiment.nominal.system
    output, u = system.positions[system.output].unit, system.input.unit
    for law in _LAWS:
        found = [row for row in rows if row.run.law == law]
        x = [1e3 * row.run.control_period for row in found]
        values = (
            [row.deviation for row in found],
            [row.total_variation for row in found],
            [row.cost_rate for row in found],
        )
        for axes, y in zip(panels, values, strict=True):
            _curve(
                axes,
                law,
                x,
                [math.nan if row.ended else v for row, v in zip(found, y, strict=True)],
            )
    name = f"{system.title}, {run.case}"
    _log(panels[0], f"{name}: max |x₁ − x₁*|", f"deviation [{output}]")
    _log(panels[1], f"{name}: variation of u", f"variation of u [{u}/s]")
    _log(panels[2], f"{name}: cost of u_d per second", "over J* [1/s]")
    # What makes up for a load may cost less than nothing: u_d spares what u_c would spend.
    panels[2].set_yscale("symlog", linthresh=1e-2)
    panels[2].axhline(0.0, color=OPTIMUM, lw=0.9, ls=(0, (2, 2)))
    panels[2].yaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))

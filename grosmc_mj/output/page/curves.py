"""Charts of curves over time: all quantities of a case, or the one that tells its story.

Laws have their colours and plants their dashes. Equations that coincide with MuJoCo have no line of
their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from grosmc_mj.output.charts.chart import (
    Band,
    Chart,
    ChartAxis,
    Curve,
    Layer,
    LegendEntry,
    Panel,
    Span,
)
from grosmc_mj.output.page.reading import CurvePanel, Curves, RecordedCurve
from grosmc_mj.output.page.verdicts import main_plant
from grosmc_mj.output.palette import DISTURBANCE, GREY, GROSMC_LAWS, INK, PLANTS, Dash, Stroke
from grosmc_mj.output.results.tables import number

# Curves that are nowhere further apart than this share of their range are one line.
_COINCIDE = 0.01
# A limit is on the axis if it lies no further out than this share of the curves' range.
_NEAR = 0.5
# Space above and below the curves, as a share of their range.
_SPACE = 0.06
_MOST_ENTRIES = 8
_GREY_LAW = "#9a9a9a"
_DASHES: Mapping[str, Dash] = {"corrected": "dash", "printed": "dot", "measured": "longdashdot"}
# Name of the curve of a state as a law is given it.
_SEEN = "seen"


def curves_chart(
    curves: Curves,
    panels: Sequence[CurvePanel],
    *,
    only_main_plant: bool = False,
) -> Chart:
    """Return the chart of quantities of a case over time.

    Args:
        curves: The case.
        panels: The quantities.
        only_main_plant: True to show the runs on one plant, MuJoCo if there are some.
    """
    shown = [_ShownPanel.of(panel, only_main_plant=only_main_plant) for panel in panels]
    signs = list(_signs(shown))
    colours = _colours(curves, shown, _MOST_ENTRIES - len(signs))
    windows = [
        Span("x", window.start, window.stop, DISTURBANCE, 0.1) for window in curves.disturbances
    ]
    time = ChartAxis("time t [s]", low=0.0, high=curves.duration)
    rows = []
    for panel in shown:
        low, high = panel.limits
        layers = [*windows, *panel.layers(colours)]
        rows.append([Panel(layers, time, ChartAxis(panel.panel.label, low=low, high=high))])
    return Chart(rows, shared="x", entries=[*_law_entries(colours), *signs])


@dataclass(frozen=True)
class _ShownPanel:
    """A panel with the curves that are drawn.

    Attributes:
        panel: The panel.
        curves: Curves that are no copy of MuJoCo's.
    """

    panel: CurvePanel
    curves: Sequence[RecordedCurve]

    @classmethod
    def of(cls, panel: CurvePanel, *, only_main_plant: bool) -> _ShownPanel:
        """Return a panel with the curves on its main plant, and those that differ from them."""
        main = main_plant(panel)
        shown = [curve for curve in panel.curves if curve.plant == main]
        if not only_main_plant:
            others = [curve for curve in panel.curves if curve.plant != main]
            shown += [curve for curve in others if not _coincides(curve, shown)]
        return cls(panel, shown)

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper end of the axis: they fit the curves, and limits that are near."""
        values = [0.0]
        if self.curves:
            values = [value for curve in self.curves for value in _extent(curve)]
        low = min(values)
        high = max(values)
        span = (high - low) or abs(high) or 1.0

        for limit in self.panel.limits:
            if low - _NEAR * span <= min(limit.y) and max(limit.y) <= high + _NEAR * span:
                values += limit.y
        return min(values) - _SPACE * span, max(values) + _SPACE * span

    def layers(self, colours: dict[str, str]) -> Iterator[Layer]:
        """Yield backlash, curves, reference and limits."""
        play = self.panel.play
        if play:
            yield Span("y", -play / 2, play / 2, GREY, 0.2)
        for curve in self.curves:
            yield from _curve_layers(curve, colours.get(curve.law, _GREY_LAW), self.panel)
        reference = self.panel.reference
        if reference is not None:
            yield Curve(reference.t, reference.y, Stroke(INK, 1.0, "dashdot"), name="reference")
        for limit in self.panel.limits:
            # A limit that follows a reference has no single number.
            note = number(limit.y[0]) if len(set(limit.y)) == 1 else ""
            name = f"limit: {limit.words}"
            yield Curve(limit.t, limit.y, Stroke(INK, 1.0, "longdash"), name=name, note=note)


def _curve_layers(curve: RecordedCurve, colour: str, panel: CurvePanel) -> Iterator[Layer]:
    """Yield range and values of a run; its curve on the main plant is solid."""
    if curve.range is not None:
        yield Band(curve.t, *curve.range, colour)

    plant = PLANTS.get(curve.plant, curve.plant)
    name = ", ".join(filter(None, (curve.law, plant, curve.name)))
    dash: Dash = "solid"
    if curve.plant != main_plant(panel):
        dash = _DASHES.get(curve.plant, "solid")
    if curve.name == _SEEN:
        dash = "dot"
    width = 1.5 if dash == "solid" else 1.1
    yield Curve(curve.t, curve.y, Stroke(colour, width, dash), name=name)


def _coincides(curve: RecordedCurve, others: Sequence[RecordedCurve]) -> bool:
    """True if a law's curve is that of the law on another plant."""
    for other in others:
        if (curve.law, curve.name) != (other.law, other.name) or not (curve.t and other.t):
            continue
        low, high = _extent(other)
        difference = np.abs(np.interp(other.t, curve.t, curve.y) - other.y).max()
        if difference <= _COINCIDE * (high - low) and abs(curve.t[-1] - other.t[-1]) < 1e-2:
            return True
    return False


def _extent(curve: RecordedCurve) -> tuple[float, float]:
    """Return the least and the largest value of a curve."""
    values = curve.y or [0.0]
    if curve.range is not None:
        values = [*values, *curve.range[0], *curve.range[1]]
    return min(values), max(values)


# -- legend --------------------------------------------------------------------------------------


def _signs(drawn: Sequence[_ShownPanel]) -> Iterator[LegendEntry]:
    """Yield the entries of lines that are drawn and are no laws."""
    plants = {curve.plant for panel in drawn for curve in panel.curves}
    names = {curve.name for panel in drawn for curve in panel.curves}
    for plant, dash in _DASHES.items():
        if plant in plants and "physics" in plants:
            yield LegendEntry(PLANTS[plant], INK, dash)
    if _SEEN in names:
        yield LegendEntry("as the law sees it", INK, "dot")
    if any(panel.panel.reference is not None for panel in drawn):
        yield LegendEntry("reference", INK, "dashdot")
    if any(panel.panel.limits for panel in drawn):
        yield LegendEntry("limit", INK, "longdash")


def _colours(curves: Curves, drawn: Sequence[_ShownPanel], most: int) -> dict[str, str]:
    """Return the colour of each law, grey for those beyond so many."""
    laws = list(dict.fromkeys(curve.law for panel in drawn for curve in panel.curves))
    # GROSMC and its variants come first: they are never among the grey ones.
    laws.sort(key=lambda law: law.partition(", ")[0] not in GROSMC_LAWS)
    own_entries = len(laws) if len(laws) <= most else most - 1
    colours = {}
    for index, law in enumerate(laws):
        style = curves.laws.get(law)
        colours[law] = style.colour if style and index < own_entries else _GREY_LAW
    return colours


def _law_entries(colours: dict[str, str]) -> Iterator[LegendEntry]:
    """Yield an entry for each law with a colour, and one for the grey ones."""
    for law, colour in colours.items():
        if colour != _GREY_LAW:
            yield LegendEntry(law, colour)
    if _GREY_LAW in colours.values():
        yield LegendEntry("other laws", _GREY_LAW)

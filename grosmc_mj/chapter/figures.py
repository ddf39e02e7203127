"""The figures of the cases: counterparts of the chapter's Figs. 1 to 8, and the two-link arm's.

Their panels are those of every experiment, see ``experiments.curves``.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from grosmc_mj.chapter.tip import true_tip
from grosmc_mj.experiments.answer.curves import panel_of, quantity_panel
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.output.charts.chart import Chart, ChartAxis, Curve, Layer, Marks, Panel
from grosmc_mj.output.charts.figure import write_chart
from grosmc_mj.output.palette import OPTIMUM, PLANTS, REFERENCE, Stroke, law_colours

_SIZE = (7.2, 6.4)
_TIP = "tip path"
# Plants whose runs are drawn.
_PLANTS: Sequence[PlantName] = ("physics", "corrected")
# Distances from the optimum that are far larger are drawn on a logarithmic scale beyond this one.
_LINEAR = 1e-3
_FAR = 10 * _LINEAR


class CaseFigure(NamedTuple):
    """One figure of a case.

    Attributes:
        name: File name without its ending.
        title: Title.
        system: System of the case.
        case: The case.
        quantities: Quantity of each panel.
    """

    name: str
    title: str
    system: str
    case: str
    quantities: Sequence[str]


PICTURES = (
    CaseFigure(
        name="fig1_servo_load_torque",
        title="Fig. 1  Servo, case 1: load torque of 1 N m",
        system="servo",
        case="case1",
        quantities=("output", "deviation"),
    ),
    CaseFigure(
        name="fig2_servo_inertia",
        title="Fig. 2  Servo, case 2: three times the inertia",
        system="servo",
        case="case2",
        quantities=("output", "deviation"),
    ),
    CaseFigure(
        name="fig3_pendulum_variation",
        title="Fig. 3  Cart-pendulum, case 1: four times the mass and the length",
        system="cart_pendulum",
        case="case1",
        quantities=("output", "deviation"),
    ),
    CaseFigure(
        name="fig4_pendulum_disturbance",
        title="Fig. 4  Cart-pendulum, case 2: d(t) = 0.01 sin 2t rad/s² from t = 9 s",
        system="cart_pendulum",
        case="case2",
        quantities=("output", "deviation"),
    ),
    CaseFigure(
        name="fig5_pendulum_sliding",
        title="Fig. 5  Cart-pendulum, case 1: the switching function",
        system="cart_pendulum",
        case="case1",
        quantities=("sliding",),
    ),
    CaseFigure(
        name="fig6_arm_position",
        title="Fig. 6  Arm, case 1: tracking of the joint angle",
        system="arm",
        case="case1",
        quantities=("output", "deviation"),
    ),
    CaseFigure(
        name="fig7_arm_rate",
        title="Fig. 7  Arm, case 1: tracking of the joint rate",
        system="arm",
        case="case1",
        quantities=("joint rate",),
    ),
    CaseFigure(
        name="fig8_arm_torque",
        title="Fig. 8  Arm, case 1: the control input",
        system="arm",
        case="case1",
        quantities=("input",),
    ),
    CaseFigure(
        name="two_link_disturbance",
        title="Two-link arm, case 1: a circle under forces on tip and link",
        system="two_link_arm",
        case="case1",
        quantities=(_TIP, "deviation"),
    ),
    CaseFigure(
        name="two_link_variation",
        title="Two-link arm, case 2: 1 kg at the tip, links 5 % longer than believed\n"
        "(above the true tip, below what the law regulates)",
        system="two_link_arm",
        case="case2",
        quantities=(_TIP, "deviation"),
    ),
)


def case_panel(results: Sequence[RunResult], quantity: str) -> Panel:
    """Return the panel of a quantity of the runs of one case, or of the tip's path in the plane.

    Args:
        results: The runs.
        quantity: See ``panel_of``; or the path of the tip.
    """
    if quantity == _TIP:
        return _tip_panel(results)

    colours = law_colours(result.controller.name for result in results)
    shown = panel_of(results, quantity)
    panel = quantity_panel(shown, colours, results)
    y_axis = panel.y
    largest = max(float(np.nanmax(np.abs(curve.values))) for curve in shown.curves)
    if quantity == "deviation" and largest > _FAR:
        y_axis = replace(y_axis, scale="symlog", linear=_LINEAR)
    if not shown.signed:
        y_axis = replace(y_axis, low=0.0)
    return replace(panel, y=y_axis)


def over_time(panel: Panel) -> Panel:
    """Return the lowest of some panels, which names the axis of time."""
    return replace(panel, x=replace(panel.x, title="time t [s]"))


def _tip_panel(results: Sequence[RunResult]) -> Panel:
    """Return the true path of the tip under each law in MuJoCo, and the reference."""
    colours = law_colours(result.controller.name for result in results)
    layers: list[Layer] = []
    for result in results:
        if result.plant == "physics":
            law = result.controller.name
            x, z = true_tip(result).T
            label = f"{law}, {PLANTS[result.plant]}"
            layers.append(Curve(x, z, Stroke(colours[law], 1.5), name=label))
            layers.append(Marks(x[:1], z[:1], OPTIMUM, size=4.0))

    x, z = results[0].comparison.reference.T
    layers.append(Curve(x, z, REFERENCE, name="reference"))
    # A plane needs more height than a curve over time.
    return Panel(layers, ChartAxis("tip x [m]"), ChartAxis("tip z [m]"), equal=True, height=1.6)


def claim_runs(lab: RunCache, system: str, case: str, laws: Sequence[str]) -> list[RunResult]:
    """Return the runs of a case that show a claim, by the laws named."""
    pairs = itertools.product(_PLANTS, laws)
    return [lab.case(system, case, plant, law) for plant, law in pairs]


def drawable(selected: Sequence[Experiment]) -> list[CaseFigure]:
    """Return the figures that these cases suffice for."""
    cases = {(case.system, case.name) for case in selected}
    return [picture for picture in PICTURES if (picture.system, picture.case) in cases]


def write_figures(results: Sequence[RunResult], folder: Path) -> Iterator[Path]:
    """Write every figure whose runs exist, one by one.

    Yields:
        The PNG of each figure; the SVG lies beside it.

    Raises:
        SetupError: If a file cannot be written.
    """
    by_case: dict[str, list[RunResult]] = {}
    for result in results:
        if result.plant in _PLANTS:
            by_case.setdefault(result.case.target, []).append(result)

    for picture in drawable([result.case for result in results]):
        runs = by_case[f"{picture.system}/{picture.case}"]
        yield write_chart(_case_chart(picture, runs), folder / f"{picture.name}.png")


def _case_chart(picture: CaseFigure, runs: Sequence[RunResult]) -> Chart:
    """Return the panels of a figure, one below the other."""
    panels = [case_panel(runs, quantity) for quantity in picture.quantities]
    rows = [[panel] for panel in (*panels[:-1], over_time(panels[-1]))]
    return Chart(rows, title=picture.title, size=_SIZE)

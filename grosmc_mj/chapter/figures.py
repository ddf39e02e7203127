"""The figures of the cases: counterparts of the chapter's Figs. 1 to 8, and the two-link arm's."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.chapter.tip import true_tip
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.curves import shade_disturbances
from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.experiments.runs import PlantName
from grosmc_mj.plants import find_system
from grosmc_mj.results.figure import TITLE_SIZE, draw_legend_below, figure_written
from grosmc_mj.results.palette import (
    COLOURS,
    LINES,
    OPTIMUM,
    PLANTS,
    REFERENCE,
    colour_of,
    label_of,
)

_SIZE = (7.2, 6.4)
# Style of a chattering curve on each plant: thin enough to show its density.
_CHATTER: Mapping[str, Mapping[str, Any]] = {
    "physics": {"lw": 0.35},
    "corrected": {"lw": 0, "marker": ".", "ms": 0.6, "color": OPTIMUM},
}

# By plant and controller.
Runs = Mapping[tuple[str, str], RunResult]


class CurvePanel(NamedTuple):
    """Curves of runs over time, physics thick and the equations thin on top.

    Attributes:
        label: Label of the vertical axis.
        curve: The curve that is drawn of each run, a key of ``_CURVES``.
        laws: Laws whose runs are drawn.
        styles: Line style by plant; a plant without one is not drawn.
        dotted: A curve of GROSMC's run on physics that is drawn dotted, and its label.
        both_scales: Whether the vertical axis is linear within 1 and logarithmic beyond.
        limit: Limit of the vertical axis, to both sides.
    """

    label: str
    curve: str
    laws: Sequence[str] = ("lqr", "grosmc")
    styles: Mapping[str, Mapping[str, Any]] = LINES
    dotted: tuple[str, str] | None = None
    both_scales: bool = False
    limit: float | None = None

    def draw(self, axes: Axes, runs: Runs) -> None:
        """Draw the curves of those runs that exist."""
        for law in self.laws:
            for plant, style in self.styles.items():
                if (plant, law) in runs:
                    time, values = _curve(self.curve, runs[plant, law])
                    label = f"{label_of(law)}, {PLANTS[plant]}"
                    line: dict[str, Any] = {"color": COLOURS[law], **style}
                    axes.plot(time, values, label=label, rasterized=True, **line)

        if self.dotted is not None and ("physics", "grosmc") in runs:
            curve, label = self.dotted
            time, values = _curve(curve, runs["physics", "grosmc"])
            axes.plot(time, values, label=label, **REFERENCE)

        if self.both_scales:
            axes.set_yscale("symlog", linthresh=1.0)
            axes.axhline(0, color="#999999", lw=0.6)
        if self.limit is not None:
            axes.set_ylim(-self.limit, self.limit)
        axes.set_ylabel(self.label)


def _output(result: RunResult, order: int = 0) -> Array:
    """The controlled coordinate, or its rate for order 1."""
    system = result.trajectory.system
    return result.trajectory.state[:, system.output + order * system.degrees_of_freedom]


def _reference(result: RunResult, order: int = 0) -> Array:
    """Reference of the controlled coordinate, or of its rate for order 1."""
    return _output(result, order) - result.comparison.z[:, order]


def _sliding(result: RunResult) -> Array:
    """1000 s."""
    s = result.trajectory.sliding
    assert s is not None
    return 1e3 * s


# Curves by name, over the instants at which they have a value; with 1e3 in thousandths.
_CURVES: Mapping[str, Callable[[RunResult], Array]] = {
    "output": _output,
    "rate": partial(_output, order=1),
    "reference": _reference,
    "reference rate": partial(_reference, order=1),
    "e1": lambda run: run.comparison.z[:, 0],
    "e2": lambda run: run.comparison.z[:, 1],
    "error": lambda run: 1e3 * run.comparison.error,
    "deviation": lambda run: 1e3 * run.comparison.deviation,
    "optimum": lambda run: run.comparison.optimum[:, 0],
    "s": _sliding,
    "input": lambda run: run.trajectory.input,
    "cart": lambda run: run.trajectory.state[:, 0],
}


def _curve(name: str, result: RunResult) -> tuple[Array, Array]:
    """Instants and values of a curve; the run's law must have the quantity."""
    values = _CURVES[name](result)
    return result.trajectory.time[: len(values)], values


def claim_panel(
    lab: RunCache,
    system: str,
    panel: str,
    case: str,
    laws: Sequence[str] = (),
) -> tuple[CurvePanel, Runs]:
    """Return a panel of one case that shows a claim, and its runs.

    Args:
        lab: Cache of the runs.
        system: The system.
        panel: Name of the panel, such as ``output``.
        case: The case.
        laws: Laws whose runs are drawn; the panel's own by default.
    """
    output = find_system(system).positions[find_system(system).output]
    panels = {
        "output": CurvePanel(f"{output.name} {output.symbol} [{output.unit}]", "output"),
        "close-up": CurvePanel("error, in thousandths", "error", limit=0.6),
        "deviation": CurvePanel("distance from the optimum, in thousandths", "deviation"),
        "cart": CurvePanel("cart position p [m]", "cart"),
        "s": CurvePanel("s, in thousandths", "s", ("grosmc",), _CHATTER),
        "u": CurvePanel("input", "input", ("grosmc",), _CHATTER),
    }
    chosen = panels[panel]
    if laws:
        chosen = chosen._replace(laws=tuple(laws))

    runs = {}
    for plant in _PLANTS:
        for law in chosen.laws:
            runs[plant, law] = lab.case(system, case, plant, law)
    return chosen, runs


def _stacked(panels: Sequence[CurvePanel], figure: Figure, runs: Runs) -> None:
    """Draw panels over the time of a case, one below the other, with one legend."""
    rows = list(figure.subplots(len(panels), 1, sharex=True))
    for axes, panel in zip(rows, panels, strict=True):
        panel.draw(axes, runs)
        shade_disturbances(axes, runs["physics", "grosmc"].case)
    rows[-1].set_xlabel("time t [s]")
    draw_legend_below(figure, rows)


def _tracking(figure: Figure, runs: Runs) -> None:
    """Draw the path in the plane, and the deviation over time."""
    plane, distance = figure.subplots(2, 1, height_ratios=(1.6, 1))
    for index, law in enumerate(("lqr", "pd", "grosmc")):
        result = runs.get(("physics", law))
        if result is None:
            continue
        style: dict[str, Any] = {
            "color": colour_of(law, index),
            "label": label_of(law),
            "lw": 2.2 if law == "grosmc" else 1.2,
            "rasterized": True,
        }
        x, z = true_tip(result).T
        plane.plot(x, z, **style)
        time, deviation = _curve("deviation", result)
        distance.plot(time, deviation, **style)

    result = runs["physics", "grosmc"]
    comparison = result.comparison
    # The circle closes after 2 s.
    x, z = comparison.reference[comparison.time <= 2.0].T
    plane.plot(x, z, label="reference", **REFERENCE)
    x, z = true_tip(result)[0]
    plane.plot(x, z, "o", color=OPTIMUM, ms=4)
    plane.set_aspect("equal", adjustable="datalim")
    plane.set(xlabel="tip x [m]", ylabel="tip z [m]")

    distance.set_yscale("symlog", linthresh=1.0)
    distance.set(xlabel="time t [s]", ylabel="|h(x) − y*| as believed [mm]")
    distance.set(xlim=(0, float(comparison.time[-1])), ylim=(0, None))
    draw_legend_below(figure, (plane, distance), columns=4)


class CaseFigure(NamedTuple):
    """One figure of a case.

    Attributes:
        name: File name without its ending.
        title: Title.
        system: System of the case.
        case: The case.
        draw: Function that draws on an empty figure.
    """

    name: str
    title: str
    system: str
    case: str
    draw: Callable[[Figure, Runs], None]


_PLANTS: Sequence[PlantName] = ("physics", "corrected")
_VARIATION_LAWS = ("lqr", "fl-lqr", "grosmc")
_SERVO_PANELS = (
    CurvePanel("rotor angle θ [rad]", "output", dotted=("optimum", "nominal optimum x*")),
    CurvePanel("x₁ − x₁* [mrad]", "deviation", both_scales=True),
)
_VARIATION_PANELS = (
    CurvePanel(
        "pole angle θ [rad]",
        "output",
        _VARIATION_LAWS,
        dotted=("optimum", "nominal optimum of GROSMC"),
    ),
    CurvePanel("θ − θ* of each law [mrad]", "deviation", _VARIATION_LAWS, both_scales=True),
)
_DISTURBANCE_PANELS = (
    CurvePanel("pole angle θ [rad]", "output"),
    CurvePanel("close-up: θ [mrad]", "error", limit=0.6),
)
_SLIDING_PANELS = (
    CurvePanel("s [mrad/s]", "s", ("grosmc",), {"physics": _CHATTER["physics"]}),
    CurvePanel("s [mrad/s]", "s", ("grosmc",), {"corrected": _CHATTER["corrected"]}),
)
_ARM_POSITION_PANELS = (
    CurvePanel("joint angle q [rad]", "output", dotted=("reference", "reference")),
    CurvePanel("error [rad]", "e1"),
)
_ARM_RATE_PANELS = (
    CurvePanel("joint rate q̇ [rad/s]", "rate", dotted=("reference rate", "reference")),
    CurvePanel("error [rad/s]", "e2"),
)
_ARM_TORQUE_PANELS = (
    CurvePanel("torque τ [N m]", "input", ("grosmc",), _CHATTER),
    CurvePanel("torque τ [N m]", "input", ("lqr",)),
)

PICTURES = (
    CaseFigure(
        name="fig1_servo_load_torque",
        title="Fig. 1  Servo, case 1: load torque of 1 N m",
        system="servo",
        case="case1",
        draw=partial(_stacked, _SERVO_PANELS),
    ),
    CaseFigure(
        name="fig2_servo_inertia",
        title="Fig. 2  Servo, case 2: three times the inertia",
        system="servo",
        case="case2",
        draw=partial(_stacked, _SERVO_PANELS),
    ),
    CaseFigure(
        name="fig3_pendulum_variation",
        title="Fig. 3  Cart-pendulum, case 1: four times the mass and the length",
        system="cart_pendulum",
        case="case1",
        draw=partial(_stacked, _VARIATION_PANELS),
    ),
    CaseFigure(
        name="fig4_pendulum_disturbance",
        title="Fig. 4  Cart-pendulum, case 2: d(t) = 0.01 sin 2t rad/s² from t = 9 s",
        system="cart_pendulum",
        case="case2",
        draw=partial(_stacked, _DISTURBANCE_PANELS),
    ),
    CaseFigure(
        name="fig5_pendulum_sliding",
        title="Fig. 5  Cart-pendulum, case 1: the switching function",
        system="cart_pendulum",
        case="case1",
        draw=partial(_stacked, _SLIDING_PANELS),
    ),
    CaseFigure(
        name="fig6_arm_position",
        title="Fig. 6  Arm, case 1: tracking of the joint angle",
        system="arm",
        case="case1",
        draw=partial(_stacked, _ARM_POSITION_PANELS),
    ),
    CaseFigure(
        name="fig7_arm_rate",
        title="Fig. 7  Arm, case 1: tracking of the joint rate",
        system="arm",
        case="case1",
        draw=partial(_stacked, _ARM_RATE_PANELS),
    ),
    CaseFigure(
        name="fig8_arm_torque",
        title="Fig. 8  Arm, case 1: the control input",
        system="arm",
        case="case1",
        draw=partial(_stacked, _ARM_TORQUE_PANELS),
    ),
    CaseFigure(
        name="two_link_disturbance",
        title="Two-link arm, case 1: a circle under forces on tip and link",
        system="two_link_arm",
        case="case1",
        draw=_tracking,
    ),
    CaseFigure(
        name="two_link_variation",
        title="Two-link arm, case 2: 1 kg at the tip, links 5 % longer than believed\n"
        "(above the true tip, below what the law regulates)",
        system="two_link_arm",
        case="case2",
        draw=_tracking,
    ),
)


def drawable(selected: Sequence[Case]) -> list[CaseFigure]:
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
    runs: dict[tuple[str, str], dict[tuple[str, str], RunResult]] = {}
    for result in results:
        runs_of_case = runs.setdefault((result.case.system, result.case.name), {})
        runs_of_case[result.plant, result.controller.name] = result

    for picture in drawable([result.case for result in results]):
        path = folder / f"{picture.name}.png"
        with figure_written(path, _SIZE) as figure:
            figure.suptitle(picture.title, fontsize=TITLE_SIZE)
            picture.draw(figure, runs[picture.system, picture.case])
        yield path

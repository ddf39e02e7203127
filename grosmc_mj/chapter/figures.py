"""The figures of the cases: counterparts of the chapter's Figs. 1 to 8, and the two-link arm's."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.chapter.claims.measurements.two_link_arm import true_tip
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.curves import shade_disturbances
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.runs import PlantName, RunResult
from grosmc_mj.plants import find_system
from grosmc_mj.results.figure import TITLE_SIZE, figure_written, labelled_below
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
# How the chatter of a plant is drawn: thin enough to show its density.
_CHATTER: Mapping[str, Mapping[str, Any]] = {
    "physics": {"lw": 0.35},
    "corrected": {"lw": 0, "marker": ".", "ms": 0.6, "color": OPTIMUM},
}

# By plant and controller.
Runs = Mapping[tuple[str, str], RunResult]


class Panel(NamedTuple):
    """Curves of runs over time, physics thick and the equations thin on top.

    Attributes:
        label: Of the second axis.
        curve: Of each run, one of ``_CURVES``.
        laws: Whose runs.
        styles: By plant; those that are not named are not drawn.
        dotted: A curve of GROSMC's run on physics that is drawn dotted, and its label.
        both_scales: Whether the axis is linear within 1 and logarithmic beyond.
        limit: Of the second axis, to both sides.
    """

    label: str
    curve: str
    laws: Sequence[str] = ("lqr", "grosmc")
    styles: Mapping[str, Mapping[str, Any]] = LINES
    dotted: tuple[str, str] | None = None
    both_scales: bool = False
    limit: float | None = None

    def draw(self, axes: Axes, runs: Runs) -> None:
        """Draw the curves of the runs that are there."""
        for law in self.laws:
            for plant, style in self.styles.items():
                if (result := runs.get((plant, law))) is not None:
                    label = f"{label_of(law)}, {PLANTS[plant]}"
                    look: dict[str, Any] = {"color": COLOURS[law], **style}
                    axes.plot(*_curve(self.curve, result), label=label, rasterized=True, **look)
        if self.dotted is not None and ("physics", "grosmc") in runs:
            curve, label = self.dotted
            axes.plot(*_curve(curve, runs["physics", "grosmc"]), label=label, **REFERENCE)
        if self.both_scales:
            axes.set_yscale("symlog", linthresh=1.0)
            axes.axhline(0, color="#999999", lw=0.6)
        if self.limit is not None:
            axes.set_ylim(-self.limit, self.limit)
        axes.set_ylabel(self.label)


def _output(result: RunResult, order: int = 0) -> Array:
    """The controlled coordinate or its rate."""
    system = result.trajectory.system
    return result.trajectory.state[:, system.output + order * system.degrees_of_freedom]


def _reference(result: RunResult, order: int = 0) -> Array:
    """Its reference or that of its rate."""
    return _output(result, order) - result.comparison.z[:, order]


# By name, what is drawn over the instants that it has a value at; with 1e3 in thousandths.
_CURVES: Mapping[str, Callable[[RunResult], Array | None]] = {
    "output": _output,
    "rate": partial(_output, order=1),
    "reference": _reference,
    "reference rate": partial(_reference, order=1),
    "e1": lambda run: run.comparison.z[:, 0],
    "e2": lambda run: run.comparison.z[:, 1],
    "error": lambda run: 1e3 * run.comparison.error,
    "deviation": lambda run: 1e3 * run.comparison.deviation,
    "optimum": lambda run: run.comparison.optimum[:, 0],
    "s": lambda run: None if run.trajectory.sliding is None else 1e3 * run.trajectory.sliding,
    "input": lambda run: run.trajectory.input,
    "cart": lambda run: run.trajectory.state[:, 0],
}


def _curve(name: str, result: RunResult) -> tuple[Array, Array]:
    """A curve of a run over time; its law has what is asked for."""
    values = _CURVES[name](result)
    assert values is not None
    return result.trajectory.time[: len(values)], values


def claim_panel(
    lab: Laboratory, system: str, panel: str, case: str, laws: Sequence[str] = ()
) -> tuple[Panel, Runs]:
    """A panel of one case that shows a claim, and its runs.

    Args:
        lab: Where the runs are.
        system: The system.
        panel: Such as ``output``.
        case: The case.
        laws: Whose runs; the panel's own by default.
    """
    output = find_system(system).positions[find_system(system).output]
    panels = {
        "output": Panel(f"{output.name} {output.symbol} [{output.unit}]", "output"),
        "close-up": Panel("error, in thousandths", "error", limit=0.6),
        "deviation": Panel("distance from the optimum, in thousandths", "deviation"),
        "cart": Panel("cart position p [m]", "cart"),
        "s": Panel("s, in thousandths", "s", ("grosmc",), _CHATTER),
        "u": Panel("input", "input", ("grosmc",), _CHATTER),
    }
    chosen = panels[panel]._replace(laws=tuple(laws) or panels[panel].laws)
    plants: Sequence[PlantName] = ("physics", "corrected")
    runs = {
        (plant, law): lab.case(system, case, plant, law) for plant in plants for law in chosen.laws
    }
    return chosen, runs


def _stacked(*panels: Panel) -> Callable[[Figure, Runs], None]:
    """Panels over the time of a case, one below the other, with one legend."""

    def draw(figure: Figure, runs: Runs) -> None:
        axes = list(figure.subplots(len(panels), 1, sharex=True))
        for where, panel in zip(axes, panels, strict=True):
            panel.draw(where, runs)
            shade_disturbances(where, runs["physics", "grosmc"].case)
        axes[-1].set_xlabel("time t [s]")
        labelled_below(figure, axes)

    return draw


def _tracking(figure: Figure, runs: Runs) -> None:
    """The path in the plane, and the deviation over time."""
    plane, distance = figure.subplots(2, 1, height_ratios=(1.6, 1))
    for index, law in enumerate(("lqr", "pd", "grosmc")):
        if (result := runs.get(("physics", law))) is not None:
            style: dict[str, Any] = {"color": colour_of(law, index), "label": label_of(law)}
            style |= {"lw": 2.2 if law == "grosmc" else 1.2, "rasterized": True}
            plane.plot(*true_tip(result).T, **style)
            distance.plot(*_curve("deviation", result), **style)
    result = runs["physics", "grosmc"]
    last = result.comparison
    plane.plot(*last.reference[last.time <= 2.0].T, label="reference", **REFERENCE)
    plane.plot(*true_tip(result)[0], "o", color=OPTIMUM, ms=4)
    plane.set_aspect("equal", adjustable="datalim")
    plane.set(xlabel="tip x [m]", ylabel="tip z [m]")
    distance.set_yscale("symlog", linthresh=1.0)
    distance.set(xlabel="time t [s]", ylabel="|h(x) − y*| as believed [mm]")
    distance.set(xlim=(0, float(last.time[-1])), ylim=(0, None))
    labelled_below(figure, (plane, distance), columns=4)


class Picture(NamedTuple):
    """One figure of a case.

    Attributes:
        name: File name without its ending.
        title: Title.
        system: System that it is about.
        case: Its case.
        draw: Draws on an empty figure.
    """

    name: str
    title: str
    system: str
    case: str
    draw: Callable[[Figure, Runs], None]


_SERVO = _stacked(
    Panel("rotor angle θ [rad]", "output", dotted=("optimum", "nominal optimum x*")),
    Panel("x₁ − x₁* [mrad]", "deviation", both_scales=True),
)
_VARIATION_LAWS = ("lqr", "fl-lqr", "grosmc")
_PENDULUM_OPTIMUM = ("optimum", "nominal optimum of GROSMC")
_PLANTS: Sequence[PlantName] = ("physics", "corrected")

PICTURES = (
    Picture(
        "fig1_servo_load_torque", "Fig. 1  Servo, case 1: load torque of 1 N m",
        "servo", "case1", _SERVO,
    ),
    Picture(
        "fig2_servo_inertia", "Fig. 2  Servo, case 2: three times the inertia",
        "servo", "case2", _SERVO,
    ),
    Picture(
        "fig3_pendulum_variation",
        "Fig. 3  Cart-pendulum, case 1: four times the mass and the length",
        "cart_pendulum", "case1",
        _stacked(
            Panel("pole angle θ [rad]", "output", _VARIATION_LAWS, dotted=_PENDULUM_OPTIMUM),
            Panel("θ − θ* of each law [mrad]", "deviation", _VARIATION_LAWS, both_scales=True),
        ),
    ),
    Picture(
        "fig4_pendulum_disturbance",
        "Fig. 4  Cart-pendulum, case 2: d(t) = 0.01 sin 2t rad/s² from t = 9 s",
        "cart_pendulum", "case2",
        _stacked(
            Panel("pole angle θ [rad]", "output"),
            Panel("close-up: θ [mrad]", "error", limit=0.6),
        ),
    ),
    Picture(
        "fig5_pendulum_sliding", "Fig. 5  Cart-pendulum, case 1: the switching function",
        "cart_pendulum", "case1",
        _stacked(
            *(
                Panel("s [mrad/s]", "s", ("grosmc",), {plant: _CHATTER[plant]})
                for plant in _PLANTS
            )
        ),
    ),
    Picture(
        "fig6_arm_position", "Fig. 6  Arm, case 1: tracking of the joint angle", "arm", "case1",
        _stacked(
            Panel("joint angle q [rad]", "output", dotted=("reference", "reference")),
            Panel("error [rad]", "e1"),
        ),
    ),
    Picture(
        "fig7_arm_rate", "Fig. 7  Arm, case 1: tracking of the joint rate", "arm", "case1",
        _stacked(
            Panel("joint rate q̇ [rad/s]", "rate", dotted=("reference rate", "reference")),
            Panel("error [rad/s]", "e2"),
        ),
    ),
    Picture(
        "fig8_arm_torque", "Fig. 8  Arm, case 1: the control input", "arm", "case1",
        _stacked(
            Panel("torque τ [N m]", "input", ("grosmc",), _CHATTER),
            Panel("torque τ [N m]", "input", ("lqr",)),
        ),
    ),
    Picture(
        "two_link_disturbance", "Two-link arm, case 1: a circle under forces on tip and link",
        "two_link_arm", "case1", _tracking,
    ),
    Picture(
        "two_link_variation",
        "Two-link arm, case 2: 1 kg at the tip, links 5 % longer than believed\n"
        "(above the true tip, below what the law regulates)",
        "two_link_arm", "case2", _tracking,
    ),
)  # fmt: skip


def drawable(selected: Sequence[Case]) -> list[Picture]:
    """The figures that these cases suffice for."""
    there = {(case.system, case.name) for case in selected}
    return [picture for picture in PICTURES if (picture.system, picture.case) in there]


def write_figures(results: Sequence[RunResult], folder: Path) -> Iterator[Path]:
    """Write every figure whose runs are there, one by one.

    Yields:
        The PNG of each figure; the SVG lies beside it.

    Raises:
        SetupError: If a file cannot be written.
    """
    for picture in drawable([result.case for result in results]):
        runs = {
            (result.plant, result.controller.name): result
            for result in results
            if (result.case.system, result.case.name) == (picture.system, picture.case)
        }
        path = folder / f"{picture.name}.png"
        with figure_written(path, _SIZE) as figure:
            figure.suptitle(picture.title, fontsize=TITLE_SIZE)
            picture.draw(figure, runs)
        yield path

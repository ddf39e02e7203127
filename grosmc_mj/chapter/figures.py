"""The figures of the cases: counterparts of the chapter's Figs. 1 to 8, and the two-link arm's."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.chapter.claims.measurements.two_link_arm import true_tip
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.curves.figure import shade_disturbances
from grosmc_mj.experiments.runs import PlantName, RunResult
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

# By case, plant and controller.
Runs = Mapping[tuple[str, str, str], RunResult]
Curve = Callable[[RunResult], tuple[Array, Array]]


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


def drawable(selected: Sequence[Case]) -> list[Picture]:
    """The figures that these cases suffice for."""
    there = {(case.system, case.name) for case in selected}
    return [picture for picture in PICTURES if (picture.system, picture.case) in there]


def write_figures(results: Sequence[RunResult], folder: Path) -> Iterator[Path]:
    """Write every figure whose runs are there, one by one.

    Args:
        results: Runs; what a figure needs and is not there keeps it from being drawn.
        folder: Where to write.

    Yields:
        The PNG of each figure; the SVG lies beside it.

    Raises:
        SetupError: If a file cannot be written.
    """
    by_system: dict[str, dict[tuple[str, str, str], RunResult]] = {}
    for result in results:
        key = (result.case.name, result.plant, result.controller.name)
        by_system.setdefault(result.case.system, {})[key] = result
    for picture in drawable([result.case for result in results]):
        path = folder / f"{picture.name}.png"
        with figure_written(path, _SIZE) as figure:
            figure.suptitle(picture.title, fontsize=TITLE_SIZE)
            picture.draw(figure, by_system[picture.system])
        yield path


def _stacked(case: str, draw: Callable[[Sequence[Axes], Runs], None]) -> Callable[..., None]:
    """A drawing on two panels over the time of a case, one below the other, with one legend."""

    def draw_both(figure: Figure, runs: Runs) -> None:
        axes = list(figure.subplots(2, 1, sharex=True))
        draw(axes, runs)
        for panel in axes:
            shade_disturbances(panel, runs[(case, "physics", "grosmc")].case)
        axes[-1].set_xlabel("time t [s]")
        labelled_below(figure, axes)

    return draw_both


def _curves(
    axes: Axes, runs: Runs, case: str, curve: Curve, controllers: Sequence[str] = ("lqr", "grosmc")
) -> None:
    """One curve for each controller and plant: physics thick, the equations thin on top."""
    for controller in controllers:
        for plant, line in LINES.items():
            result = runs.get((case, plant, controller))
            if result is None:
                continue
            x, y = curve(result)
            label = f"{label_of(controller)}, {PLANTS[plant]}"
            axes.plot(x, y, color=COLOURS[controller], label=label, rasterized=True, **line)


def _output(result: RunResult) -> tuple[Array, Array]:
    """The controlled coordinate."""
    run = result.trajectory
    return run.time, run.state[:, run.system.output]


def _rate(result: RunResult) -> tuple[Array, Array]:
    """Its rate."""
    run = result.trajectory
    return run.time, run.state[:, run.system.output + run.system.degrees_of_freedom]


def _deviation(result: RunResult) -> tuple[Array, Array]:
    """x1 - x1* in thousandths."""
    comparison = result.comparison
    return comparison.time, 1e3 * comparison.deviation


def _milliradians(result: RunResult) -> tuple[Array, Array]:
    """x1 in thousandths."""
    return result.comparison.time, 1e3 * result.comparison.error


def _optimum(axes: Axes, runs: Runs, case: str, controller: str, label: str) -> None:
    """The nominal optimal trajectory of a law, in the output's own coordinate."""
    result = runs.get((case, "physics", controller))
    if result is None:
        return
    time, optimum = result.comparison.time, result.comparison.optimum
    axes.plot(time, optimum[:, 0], label=label, **REFERENCE)


def _servo(case: str) -> Callable[[Sequence[Axes], Runs], None]:
    """Figs. 1 and 2: position, and how far it is from the optimum."""

    def draw(axes: Sequence[Axes], runs: Runs) -> None:
        _curves(axes[0], runs, case, _output)
        _optimum(axes[0], runs, case, "grosmc", "nominal optimum x*")
        _curves(axes[1], runs, case, _deviation)
        _both_scales(axes[1])
        axes[0].set_ylabel("rotor angle θ [rad]")
        axes[1].set_ylabel("x₁ − x₁* [mrad]")

    return draw


def _both_scales(axes: Axes) -> None:
    """A scale that is linear within 1 and logarithmic beyond: it shows both laws' deviations."""
    axes.set_yscale("symlog", linthresh=1.0)
    axes.axhline(0, color="#999999", lw=0.6)


def _pendulum_variation(axes: Sequence[Axes], runs: Runs) -> None:
    """Fig. 3: the pole's angle with the variation, and how far it is from each optimum."""
    laws = ("lqr", "fl-lqr", "grosmc")
    _curves(axes[0], runs, "case1", _output, laws)
    _optimum(axes[0], runs, "case1", "grosmc", "nominal optimum of GROSMC")
    _curves(axes[1], runs, "case1", _deviation, laws)
    _both_scales(axes[1])
    axes[0].set_ylabel("pole angle θ [rad]")
    axes[1].set_ylabel("θ − θ* of each law [mrad]")


def _pendulum_disturbance(axes: Sequence[Axes], runs: Runs) -> None:
    """Fig. 4: the pole's angle under d(t), whole and close up."""
    _curves(axes[0], runs, "case2", _output)
    _curves(axes[1], runs, "case2", _milliradians)
    axes[0].set_ylabel("pole angle θ [rad]")
    axes[1].set_ylabel("close-up: θ [mrad]")
    axes[1].set_ylim(-0.6, 0.6)


def _sliding(axes: Sequence[Axes], runs: Runs) -> None:
    """Fig. 5: s(t) from the start, in MuJoCo and by the equations."""

    def s(result: RunResult) -> tuple[Array, Array]:
        run = result.trajectory
        assert run.sliding is not None
        return run.time[:-1], 1e3 * run.sliding

    for panel, plant in zip(axes, ("physics", "corrected"), strict=True):
        _chatter(panel, runs, "case1", s, "grosmc", plant)
        panel.set_ylabel("s [mrad/s]")


def _chatter(
    axes: Axes, runs: Runs, case: str, curve: Curve, controller: str, plant: PlantName
) -> None:
    """A signal that jumps at every sample, drawn thin enough to show its density."""
    result = runs.get((case, plant, controller))
    if result is None:
        return
    x, y = curve(result)
    label = f"{label_of(controller)}, {PLANTS[plant]}"
    colour = COLOURS[controller] if plant == "physics" else OPTIMUM
    style: Any = {"lw": 0.35} if plant == "physics" else {"lw": 0, "marker": ".", "ms": 0.6}
    axes.plot(x, y, color=colour, label=label, rasterized=True, **style)


def _arm(curve: Curve, reference: Callable[[Array], Array], label: str) -> Callable[..., None]:
    """Figs. 6 and 7: tracking, and the error."""

    def draw(axes: Sequence[Axes], runs: Runs) -> None:
        _curves(axes[0], runs, "case1", curve)
        time = runs[("case1", "physics", "grosmc")].trajectory.time
        axes[0].plot(time, reference(time), label="reference", **REFERENCE)

        def error(result: RunResult) -> tuple[Array, Array]:
            x, y = curve(result)
            return x, y - reference(x)

        _curves(axes[1], runs, "case1", error)
        axes[0].set_ylabel(label)
        axes[1].set_ylabel("error " + label[label.index("[") :])

    return draw


def _torque(axes: Sequence[Axes], runs: Runs) -> None:
    """Fig. 8: the control input."""

    def u(result: RunResult) -> tuple[Array, Array]:
        run = result.trajectory
        return run.time[:-1], run.input

    _chatter(axes[0], runs, "case1", u, "grosmc", "physics")
    _chatter(axes[0], runs, "case1", u, "grosmc", "corrected")
    _curves(axes[1], runs, "case1", u, ("lqr",))
    for panel in axes:
        panel.set_ylabel("torque τ [N m]")


_TWO_LINK_LAWS = ("lqr", "pd", "grosmc")


def _tracking(case: str) -> Callable[[Figure, Runs], None]:
    """The path in the plane, and the deviation over time."""

    def draw(figure: Figure, runs: Runs) -> None:
        plane, distance = figure.subplots(2, 1, height_ratios=(1.6, 1))
        for index, law in enumerate(_TWO_LINK_LAWS):
            result = runs.get((case, "physics", law))
            if result is None:
                continue
            style = {"color": colour_of(law, index), "label": label_of(law)}
            path, width = true_tip(result), 2.2 if law == "grosmc" else 1.2
            plane.plot(path[:, 0], path[:, 1], lw=width, rasterized=True, **style)
            time, deviation = result.comparison.time, 1e3 * result.comparison.deviation
            distance.plot(time, deviation, lw=width, rasterized=True, **style)
        last = runs[(case, "physics", "grosmc")].comparison
        circle = last.reference[last.time <= 2.0]
        plane.plot(*circle.T, label="reference", **REFERENCE)
        plane.plot(*true_tip(runs[(case, "physics", "grosmc")])[0], "o", color=OPTIMUM, ms=4)
        plane.set_aspect("equal", adjustable="datalim")
        plane.set_xlabel("tip x [m]")
        plane.set_ylabel("tip z [m]")
        distance.set_yscale("symlog", linthresh=1.0)
        distance.set_ylim(0, None)
        distance.set_xlim(0, float(last.time[-1]))
        distance.set_xlabel("time t [s]")
        distance.set_ylabel("|h(x) − y*| as believed [mm]")
        labelled_below(figure, (plane, distance), columns=4)

    return draw


PICTURES = (
    Picture(
        "fig1_servo_load_torque", "Fig. 1  Servo, case 1: load torque of 1 N m",
        "servo", "case1", _stacked("case1", _servo("case1")),
    ),
    Picture(
        "fig2_servo_inertia", "Fig. 2  Servo, case 2: three times the inertia",
        "servo", "case2", _stacked("case2", _servo("case2")),
    ),
    Picture(
        "fig3_pendulum_variation",
        "Fig. 3  Cart-pendulum, case 1: four times the mass and the length",
        "cart_pendulum", "case1", _stacked("case1", _pendulum_variation),
    ),
    Picture(
        "fig4_pendulum_disturbance",
        "Fig. 4  Cart-pendulum, case 2: d(t) = 0.01 sin 2t rad/s² from t = 9 s",
        "cart_pendulum", "case2", _stacked("case2", _pendulum_disturbance),
    ),
    Picture(
        "fig5_pendulum_sliding", "Fig. 5  Cart-pendulum, case 1: the switching function",
        "cart_pendulum", "case1", _stacked("case1", _sliding),
    ),
    Picture(
        "fig6_arm_position", "Fig. 6  Arm, case 1: tracking of the joint angle", "arm", "case1",
        _stacked("case1", _arm(_output, lambda t: np.sin(np.pi * t), "joint angle q [rad]")),
    ),
    Picture(
        "fig7_arm_rate", "Fig. 7  Arm, case 1: tracking of the joint rate", "arm", "case1",
        _stacked("case1", _arm(_rate, lambda t: np.pi * np.cos(np.pi * t), "joint rate q̇ [rad/s]")),
    ),
    Picture(
        "fig8_arm_torque", "Fig. 8  Arm, case 1: the control input",
        "arm", "case1", _stacked("case1", _torque),
    ),
    Picture(
        "two_link_disturbance", "Two-link arm, case 1: a circle under forces on tip and link",
        "two_link_arm", "case1", _tracking("case1"),
    ),
    Picture(
        "two_link_variation",
        "Two-link arm, case 2: 1 kg at the tip, links 5 % longer than believed\n"
        "(above the true tip, below what the law regulates)",
        "two_link_arm", "case2", _tracking("case2"),
    ),
)  # fmt: skip

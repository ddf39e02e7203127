"""Counterparts of the chapter's Figs. 1 to 8."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from grosmc_mj.arrays import Array
from grosmc_mj.chapter.figure import Picture, Runs, stacked
from grosmc_mj.experiments.runs import PlantName, RunResult
from grosmc_mj.report.palette import COLOURS, DISTURBANCE, LABELS, LINES, OPTIMUM, PLANTS


def _result(runs: Runs, case: str, plant: str, controller: str) -> RunResult | None:
    """A run, if it is there."""
    return runs.get((case, plant, controller))


def _window(axes: Axes, result: RunResult) -> None:
    """Shade the time in which a disturbance acts."""
    end = float(result.trajectory.time[-1])
    for disturbance in result.case.disturbances:
        start, stop = disturbance.window
        label = disturbance.label
        axes.axvspan(start, min(stop, end), color=DISTURBANCE, alpha=0.13, lw=0, label=label)
    axes.set_xlim(0, end)


Curve = Callable[[RunResult], tuple[Array, Array]]


def _curves(
    axes: Axes, runs: Runs, case: str, curve: Curve, controllers: Sequence[str] = ("lqr", "grosmc")
) -> None:
    """One curve for each controller and plant: physics thick, the equations thin on top."""
    for controller in controllers:
        for plant, line in LINES.items():
            result = _result(runs, case, plant, controller)
            if result is None:
                continue
            x, y = curve(result)
            axes.plot(
                x,
                y,
                color=COLOURS[controller],
                label=f"{LABELS[controller]}, {PLANTS[plant]}",
                rasterized=True,
                **line,
            )


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
    result = _result(runs, case, "physics", controller)
    if result is None:
        return
    time, optimum = result.comparison.time, result.comparison.optimum
    axes.plot(time, optimum[:, 0], color=OPTIMUM, lw=1, ls=(0, (1, 2)), label=label, zorder=5)


def _servo(case: str) -> Callable[[Sequence[Axes], Runs], None]:
    """Figs. 1 and 2: position, and how far it is from the optimum."""

    def draw(axes: Sequence[Axes], runs: Runs) -> None:
        _curves(axes[0], runs, case, _output)
        _optimum(axes[0], runs, case, "grosmc", "nominal optimum x*")
        _curves(axes[1], runs, case, _deviation)
        for panel in axes:
            _window(panel, runs[(case, "physics", "grosmc")])
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
    _window(axes[0], runs[("case1", "physics", "grosmc")])
    axes[0].set_ylabel("pole angle θ [rad]")
    axes[1].set_ylabel("θ − θ* of each law [mrad]")


def _pendulum_disturbance(axes: Sequence[Axes], runs: Runs) -> None:
    """Fig. 4: the pole's angle under d(t), whole and close up."""
    _curves(axes[0], runs, "case2", _output)
    _curves(axes[1], runs, "case2", _milliradians)
    for panel in axes:
        _window(panel, runs[("case2", "physics", "grosmc")])
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
        _window(panel, runs[("case1", "physics", "grosmc")])
        panel.set_ylabel("s [mrad/s]")


def _chatter(
    axes: Axes, runs: Runs, case: str, curve: Curve, controller: str, plant: PlantName
) -> None:
    """A signal that jumps at every sample, drawn thin enough to show its density."""
    result = _result(runs, case, plant, controller)
    if result is None:
        return
    x, y = curve(result)
    label = f"{LABELS[controller]}, {PLANTS[plant]}"
    colour = COLOURS[controller] if plant == "physics" else OPTIMUM
    style: Any = {"lw": 0.35} if plant == "physics" else {"lw": 0, "marker": ".", "ms": 0.6}
    axes.plot(x, y, color=colour, label=label, rasterized=True, **style)


def _arm(curve: Curve, reference: Callable[[Array], Array], label: str) -> Callable[..., None]:
    """Figs. 6 and 7: tracking, and the error."""

    def draw(axes: Sequence[Axes], runs: Runs) -> None:
        _curves(axes[0], runs, "case1", curve)
        time = runs[("case1", "physics", "grosmc")].trajectory.time
        axes[0].plot(time, reference(time), color=OPTIMUM, lw=1, ls=(0, (1, 2)), label="reference")

        def error(result: RunResult) -> tuple[Array, Array]:
            x, y = curve(result)
            return x, y - reference(x)

        _curves(axes[1], runs, "case1", error)
        for panel in axes:
            _window(panel, runs[("case1", "physics", "grosmc")])
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
        _window(panel, runs[("case1", "physics", "grosmc")])
        panel.set_ylabel("torque τ [N m]")


PICTURES = (
    Picture(
        "fig1_servo_load_torque",
        "Fig. 1  Servo, case 1: load torque of 1 N m",
        "servo",
        ("case1",),
        stacked(_servo("case1")),
    ),
    Picture(
        "fig2_servo_inertia",
        "Fig. 2  Servo, case 2: three times the inertia",
        "servo",
        ("case2",),
        stacked(_servo("case2")),
    ),
    Picture(
        "fig3_pendulum_variation",
        "Fig. 3  Cart-pendulum, case 1: four times the mass and the length",
        "cart_pendulum",
        ("case1",),
        stacked(_pendulum_variation),
    ),
    Picture(
        "fig4_pendulum_disturbance",
        "Fig. 4  Cart-pendulum, case 2: d(t) = 0.01 sin 2t rad/s² from t = 9 s",
        "cart_pendulum",
        ("case2",),
        stacked(_pendulum_disturbance),
    ),
    Picture(
        "fig5_pendulum_sliding",
        "Fig. 5  Cart-pendulum, case 1: the switching function",
        "cart_pendulum",
        ("case1",),
        stacked(_sliding),
    ),
    Picture(
        "fig6_arm_position",
        "Fig. 6  Arm, case 1: tracking of the joint angle",
        "arm",
        ("case1",),
        stacked(_arm(_output, lambda t: np.sin(np.pi * t), "joint angle q [rad]")),
    ),
    Picture(
        "fig7_arm_rate",
        "Fig. 7  Arm, case 1: tracking of the joint rate",
        "arm",
        ("case1",),
        stacked(_arm(_rate, lambda t: np.pi * np.cos(np.pi * t), "joint rate q̇ [rad/s]")),
    ),
    Picture(
        "fig8_arm_torque",
        "Fig. 8  Arm, case 1: the control input",
        "arm",
        ("case1",),
        stacked(_torque),
    ),
)

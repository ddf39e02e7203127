"""Counterparts of the chapter's Figs. 1 to 8, as PNG and SVG."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.errors import SetupError
from grosmc_mj.rendering.palette import COLOURS, DISTURBANCE, GRID, LABELS, OPTIMUM
from grosmc_mj.validation.cases import Case
from grosmc_mj.validation.runs import PlantName, RunResult

Runs = Mapping[tuple[str, PlantName, str], RunResult]

_LINES: Mapping[PlantName, Mapping[str, object]] = {
    "physics": {"lw": 3.2, "alpha": 0.45, "ls": "-"},
    "corrected": {"lw": 1.1, "ls": "--"},
    "printed": {"lw": 1.1, "ls": ":"},
}
_PLANTS: Mapping[PlantName, str] = {
    "physics": "MuJoCo",
    "corrected": "corrected equations",
    "printed": "printed equations",
}
_STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "legend.fontsize": 8.5,
    "legend.framealpha": 0.9,
    "savefig.dpi": 150,
    "svg.hashsalt": "grosmc_mj",
    "figure.constrained_layout.use": True,
}


@dataclass(frozen=True)
class Picture:
    """One figure of the chapter and how its counterpart is drawn.

    Attributes:
        name: File name without its ending.
        title: Title.
        system: System that it is about.
        cases: Cases that it needs.
        draw: Draws on the two panels, one below the other.
    """

    name: str
    title: str
    system: str
    cases: tuple[str, ...]
    draw: Callable[[Sequence[Axes], Runs], None]


def drawable(selected: Sequence[Case]) -> list[Picture]:
    """The figures that these cases suffice for."""
    there = {(case.system, case.name) for case in selected}
    return [p for p in PICTURES if {(p.system, case) for case in p.cases} <= there]


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
    by_system: dict[str, dict[tuple[str, PlantName, str], RunResult]] = {}
    for result in results:
        key = (result.case.name, result.plant, result.controller.name)
        by_system.setdefault(result.case.system, {})[key] = result
    for picture in drawable([result.case for result in results]):
        runs = by_system[picture.system]
        path = folder / f"{picture.name}.png"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _save(picture, runs, path)
        except OSError as error:
            raise SetupError(
                f"cannot write {path}: {error.strerror}; free the disk or choose another place"
            ) from error
        yield path


def _save(picture: Picture, runs: Runs, path: Path) -> None:
    """Draw one figure and write its PNG and SVG aside before renaming them."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(7.2, 6.4))
        axes = figure.subplots(2, 1, sharex=True)
        picture.draw(list(axes), runs)
        axes[-1].set_xlabel("time t [s]")
        _legend(figure, list(axes))
        figure.suptitle(picture.title, fontsize=11.5)
        for suffix in (".png", ".svg"):
            aside = path.with_name(f".{path.stem}{suffix}")
            metadata = {"Date": None} if suffix == ".svg" else {"Software": None}
            try:
                figure.savefig(aside, format=suffix[1:], metadata=metadata)
                aside.replace(path.with_suffix(suffix))
            finally:
                aside.unlink(missing_ok=True)


def _result(runs: Runs, case: str, plant: PlantName, controller: str) -> RunResult | None:
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
        for plant, line in _LINES.items():
            result = _result(runs, case, plant, controller)
            if result is None:
                continue
            x, y = curve(result)
            axes.plot(
                x,
                y,
                color=COLOURS[controller],
                label=f"{LABELS[controller]}, {_PLANTS[plant]}",
                rasterized=True,
                **line,  # pyright: ignore[reportArgumentType]
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
    return comparison.time, 1e3 * (comparison.z[:, 0] - comparison.optimal[:, 0])


def _milliradians(result: RunResult) -> tuple[Array, Array]:
    """x1 in thousandths."""
    return result.comparison.time, 1e3 * result.comparison.z[:, 0]


def _optimum(axes: Axes, runs: Runs, case: str, controller: str, label: str) -> None:
    """The nominal optimal trajectory of a law, in the output's own coordinate."""
    result = _result(runs, case, "physics", controller)
    if result is None:
        return
    time, optimum = result.comparison.time, result.comparison.optimum
    axes.plot(time, optimum, color=OPTIMUM, lw=1, ls=(0, (1, 2)), label=label, zorder=5)


def _legend(figure: Figure, axes: Sequence[Axes]) -> None:
    """One legend for all panels, below them, where it hides nothing."""
    entries = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend(
        list(entries.values()), list(entries), loc="outside lower center", ncols=3, markerscale=8
    )


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
    label = f"{LABELS[controller]}, {_PLANTS[plant]}"
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
        _servo("case1"),
    ),
    Picture(
        "fig2_servo_inertia",
        "Fig. 2  Servo, case 2: three times the inertia",
        "servo",
        ("case2",),
        _servo("case2"),
    ),
    Picture(
        "fig3_pendulum_variation",
        "Fig. 3  Cart-pendulum, case 1: four times the mass and the length",
        "cart_pendulum",
        ("case1",),
        _pendulum_variation,
    ),
    Picture(
        "fig4_pendulum_disturbance",
        "Fig. 4  Cart-pendulum, case 2: d(t) = 0.01 sin 2t rad/s² from t = 9 s",
        "cart_pendulum",
        ("case2",),
        _pendulum_disturbance,
    ),
    Picture(
        "fig5_pendulum_sliding",
        "Fig. 5  Cart-pendulum, case 1: the switching function",
        "cart_pendulum",
        ("case1",),
        _sliding,
    ),
    Picture(
        "fig6_arm_position",
        "Fig. 6  Arm, case 1: tracking of the joint angle",
        "arm",
        ("case1",),
        _arm(_output, lambda t: np.sin(np.pi * t), "joint angle q [rad]"),
    ),
    Picture(
        "fig7_arm_rate",
        "Fig. 7  Arm, case 1: tracking of the joint rate",
        "arm",
        ("case1",),
        _arm(_rate, lambda t: np.pi * np.cos(np.pi * t), "joint rate q̇ [rad/s]"),
    ),
    Picture(
        "fig8_arm_torque",
        "Fig. 8  Arm, case 1: the control input",
        "arm",
        ("case1",),
        _torque,
    ),
)

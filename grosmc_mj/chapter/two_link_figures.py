"""Figures of the two-link arm: the tip's path and its distance from the optimum."""

from __future__ import annotations

from collections.abc import Callable

from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.chapter.figure import Picture, Runs
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.report.figure import labelled_below
from grosmc_mj.report.palette import LABELS, OPTIMUM, colour_of

_LAWS = ("lqr", "pd", "grosmc")


def true_tip(result: RunResult) -> Array:
    """Where the tip truly is, by the plant's own lengths: (x, z) from the shoulder [m], (N, 2)."""
    error = result.controller.error
    assert isinstance(error, ErrorCoordinates)
    z = error.outputs_along(result.trajectory.state, result.plant_parameters)
    return z[:, error.output_rows]


def _tracking(case: str) -> Callable[[Figure, Runs], None]:
    """The path in the plane, and the deviation over time."""

    def draw(figure: Figure, runs: Runs) -> None:
        plane, distance = figure.subplots(2, 1, height_ratios=(1.6, 1))
        for index, law in enumerate(_LAWS):
            result = runs.get((case, "physics", law))
            if result is None:
                continue
            style = {"color": colour_of(law, index), "label": LABELS.get(law, law)}
            path, width = true_tip(result), 2.2 if law == "grosmc" else 1.2
            plane.plot(path[:, 0], path[:, 1], lw=width, rasterized=True, **style)
            time, deviation = result.comparison.time, 1e3 * result.comparison.deviation
            distance.plot(time, deviation, lw=width, rasterized=True, **style)
        last = runs[(case, "physics", "grosmc")].comparison
        circle = last.reference[last.time <= 2.0]
        plane.plot(*circle.T, color=OPTIMUM, lw=1, ls=(0, (3, 2)), label="reference", zorder=5)
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
        "two_link_disturbance",
        "Two-link arm, case 1: a circle under forces on tip and link",
        "two_link_arm",
        ("case1",),
        _tracking("case1"),
    ),
    Picture(
        "two_link_variation",
        "Two-link arm, case 2: 1 kg at the tip, links 5 % longer than believed\n"
        "(above the true tip, below what the law regulates)",
        "two_link_arm",
        ("case2",),
        _tracking("case2"),
    ),
)

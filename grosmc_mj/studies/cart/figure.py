"""The figure of ``grosmc-mj study cart``: pole, cart, force, and what the unmatched part costs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.curves.figure import shade_disturbances
from grosmc_mj.report.envelope import jumps
from grosmc_mj.report.figure import TITLE_SIZE, figure_written, labelled_below
from grosmc_mj.report.palette import COLOURS, OPTIMUM
from grosmc_mj.studies.cart.measure import ALONE, LAWS, Study, holding_case, run_of

NAME = "cart"
_CASES = ("case1", "case2")
_WORDS = {
    "grosmc": "GROSMC of the chapter",
    "cart-lqr": "cart-lqr: LQR of four states",
    "cart-ism": "cart-ism: with integral sliding mode",
    "cart-pfl": "cart-pfl: linearized, shaped by the cart",
}
# Dashes tell the laws apart without their colours.
_DASHES: dict[str, Any] = {
    "grosmc": (0, (1, 1)),
    "cart-lqr": (0, (5, 1.5)),
    "cart-ism": "-",
    "cart-pfl": (0, (7, 1.5, 1, 1.5)),
}
# The cart's axis is linear within this [m] and logarithmic beyond, out to the rail's end.
_LINEAR = 2.0


def write_holding_figure(found: Study, folder: Path) -> Path:
    """Write cart.png and cart.svg.

    Returns:
        The PNG; the SVG lies beside it.

    Raises:
        SetupError: If a file cannot be written.
    """
    path = folder / f"{NAME}.png"
    with figure_written(path, (10.0, 11.0)) as figure:
        grid = figure.add_gridspec(4, 6, height_ratios=(1, 1.25, 1, 1.0))
        rows = [[figure.add_subplot(grid[i, 3 * j : 3 * j + 3]) for j in (0, 1)] for i in range(3)]
        for column, case in enumerate(_CASES):
            _draw_case([row[column] for row in rows], found, case)
        for row in rows:
            _share(row)
        _draw_costs([figure.add_subplot(grid[3, 2 * i : 2 * i + 2]) for i in range(3)], found)
        labelled_below(figure, rows[1])
        figure.suptitle(
            f"Cart-pendulum in MuJoCo from −10°: laws that hold pole and cart "
            f"({found.settings.switching} switching, {found.settings.surface} surface)",
            fontsize=TITLE_SIZE,
        )
    return path


def _draw_case(axes: list[Axes], found: Study, name: str) -> None:
    """Angle, cart and force of one case, from top to bottom."""
    case = holding_case(name).case
    for law in LAWS:
        run = run_of(found, name, law)
        forces = run.time[:-1], run.input
        curves = ((run.time, run.state[:, 1]), (run.time, run.state[:, 0]), forces)
        chatters = jumps(run.input)
        for panel, (x, y), thin in zip(axes, curves, (False, False, chatters), strict=True):
            panel.plot(
                x,
                y,
                color=COLOURS[law],
                ls="-" if thin else _DASHES[law],
                lw=0.35 if thin else 1.7,
                # Where LQR and sliding mode coincide the dashes let the line below show.
                zorder=3 if law == "cart-lqr" else 2,
                label=_WORDS[law],
                rasterized=True,
            )
    axes[0].set_title(f"{name}: {case.title}")
    for panel in axes:
        shade_disturbances(panel, case)
        panel.set_xticks(np.arange(0.0, case.duration + 1, 5.0))
    axes[1].set_yscale("symlog", linthresh=_LINEAR, linscale=1.6)
    axes[1].set_ylim(-0.5, 1.6 * found.rail)
    axes[1].set_yticks([0, 1, 2, 5, 10], ["0", "1", "2", "5", "10"])
    axes[1].minorticks_off()
    axes[1].axhline(found.rail, color=OPTIMUM, lw=1.4, ls="-")
    axes[1].annotate(
        f"end of the rail, {found.rail:g} m", (0, found.rail), xytext=(4, -3),
        textcoords="offset points", ha="left", va="top", fontsize=8.5,
    )  # fmt: skip
    if case.onset < case.duration:
        _close_up(axes[0], found, name, 1, "close-up: θ [mrad]")
        _close_up(axes[1], found, name, 0, "close-up: p [mm]")
    axes[0].set_ylabel("pole angle θ [rad]")
    axes[1].set_ylabel("cart position p [m]\n(logarithmic beyond 2 m)")
    axes[2].set_ylabel("force u [N]")
    axes[2].set_xlabel("time t [s]")


def _close_up(axes: Axes, found: Study, name: str, row: int, label: str) -> None:
    """What the disturbance does to a coordinate, in thousandths, where there is room for it."""
    case = holding_case(name).case
    inset = axes.inset_axes((0.36, 0.13, 0.62, 0.27) if row else (0.36, 0.3, 0.62, 0.28))
    for law in LAWS:
        if row == 0 and law == "grosmc":
            continue
        run = run_of(found, name, law)
        late = run.time >= case.onset - 1
        style: dict[str, Any] = {"color": COLOURS[law], "ls": _DASHES[law], "lw": 1.1}
        style["zorder"] = 3 if law == "cart-lqr" else 2
        inset.plot(run.time[late], 1e3 * run.state[late, row], rasterized=True, **style)
    inset.set_xlim(case.onset - 1, case.duration)
    inset.set_title(label, fontsize=8, pad=2)
    inset.tick_params(labelsize=7.5)


def _share(row: list[Axes]) -> None:
    """One scale for both cases, which its left panel names."""
    limits = [panel.get_ylim() for panel in row]
    for panel in row:
        panel.set_ylim(min(low for low, _ in limits), max(high for _, high in limits))
    row[1].set_ylabel("")
    row[1].tick_params(labelleft=False)


def _draw_costs(axes: list[Axes], found: Study) -> None:
    """One row for each G: how far astray it goes, and at what force and with which pole."""
    rows = found.projections
    names = [row.name if row.G is None else f"G = {row.name}" for row in rows]
    values: list[tuple[str, list[float | None]]] = [
        ("max |θ − θ*|, % of the start", [row.deviation.value for row in rows]),
        ("max |u| [N]", [row.max_input.value for row in rows]),
        ("slowest pole on s = 0 [1/s]", [row.pole for row in rows]),
    ]
    for panel, (label, column) in zip(axes, values, strict=True):
        _bars(panel, names, column, [row.name == ALONE for row in rows])
        panel.set_xlabel(label)
        panel.tick_params(labelleft=panel is axes[0])
    axes[0].set_title("case1: what each G leaves", loc="left")
    axes[1].set_title("what it asks of the motor", loc="left")
    axes[2].set_title("linear model; must be < 0", loc="left")


def _bars(axes: Axes, names: list[str], values: list[float | None], alone: list[bool]) -> None:
    """Horizontal bars with their values beside them."""
    places = np.arange(len(names))
    lengths: Array = np.array([0.0 if value is None else value for value in values])
    colours = [COLOURS["cart-lqr" if each else "cart-ism"] for each in alone]
    axes.barh(places, lengths, color=colours, height=0.62)
    for place, value, length in zip(places, values, lengths, strict=True):
        words = "ended early" if value is None else f"{value:.3g}"
        axes.annotate(
            words, (length, place), xytext=(3 if length >= 0 else -3, 0),
            textcoords="offset points", va="center", ha="left" if length >= 0 else "right",
            fontsize=8.5,
        )  # fmt: skip
    axes.set_yticks(places, names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.margins(x=0.2)
    axes.grid(visible=False, axis="y")

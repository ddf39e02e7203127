"""What a figure of the cases is: which runs it needs, and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.validation.runs import PlantName, RunResult

Runs = Mapping[tuple[str, PlantName, str], RunResult]


@dataclass(frozen=True)
class Picture:
    """One figure of a system.

    Attributes:
        name: File name without its ending.
        title: Title.
        system: System that it is about.
        cases: Cases that it needs.
        draw: Draws on an empty figure, from the runs by case, plant and controller.
    """

    name: str
    title: str
    system: str
    cases: tuple[str, ...]
    draw: Callable[[Figure, Runs], None]


def stacked(draw: Callable[[Sequence[Axes], Runs], None]) -> Callable[[Figure, Runs], None]:
    """A drawing on two panels over time, one below the other, with one legend."""

    def draw_both(figure: Figure, runs: Runs) -> None:
        axes = list(figure.subplots(2, 1, sharex=True))
        draw(axes, runs)
        axes[-1].set_xlabel("time t [s]")
        labelled_below(figure, axes)

    return draw_both


def labelled_below(figure: Figure, axes: Sequence[Axes], columns: int = 3) -> None:
    """One legend for all panels, below them, where it hides nothing."""
    entries = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend(
        list(entries.values()), list(entries), loc="outside lower center", ncols=columns,
        markerscale=8,
    )  # fmt: skip

"""What a figure of the cases is: which runs it needs, and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.report.figure import labelled_below

Runs = Mapping[tuple[str, str, str], RunResult]


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

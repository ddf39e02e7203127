"""The figures of the cases, as PNG and SVG."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from grosmc_mj.chapter import chapter_figures, two_link_figures
from grosmc_mj.chapter.figure import Picture
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.report.figure import figure_written

PICTURES = (*chapter_figures.PICTURES, *two_link_figures.PICTURES)
_SIZE = (7.2, 6.4)


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
    by_system: dict[str, dict[tuple[str, str, str], RunResult]] = {}
    for result in results:
        key = (result.case.name, result.plant, result.controller.name)
        by_system.setdefault(result.case.system, {})[key] = result
    for picture in drawable([result.case for result in results]):
        path = folder / f"{picture.name}.png"
        with figure_written(path, _SIZE) as figure:
            figure.suptitle(picture.title, fontsize=11.5)
            picture.draw(figure, by_system[picture.system])
        yield path

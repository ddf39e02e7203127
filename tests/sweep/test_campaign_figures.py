"""The figures of campaigns: the runs, margins and scales that were handed over are drawn."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from grosmc_mj.sweep.findings import NO_PROOF
from grosmc_mj.sweep.map import PassMap, write_pass_map
from grosmc_mj.sweep.promise import Promise
from grosmc_mj.sweep.radius import Look, Radius, chart

INF = math.inf
TITLE = "Cart-pendulum: 8 of 16 runs, random, seed 0"
MARGINS = np.array([-INF, -INF, -0.5, 0.0, 0.5, 0.75, 1.0, 1.25])


def pass_map(**premises: Any) -> PassMap:
    x, y = np.linspace(1, 4, 8), np.linspace(-20, 20, 8)
    laws = {"grosmc": (x, y, MARGINS), "lqr": (x, y, x)}
    return PassMap(("mass scale of pole", "start angle [deg]"), laws, premises)


def premise(offset: float) -> Any:
    """A premise that holds up to a mass scale of ``offset``, the rows being start angles."""
    x, y = np.linspace(1, 4, 13), np.linspace(-20, 20, 5)
    return x, y, np.tile(offset - x, (5, 1))


def searched(promised: float | None = 1.5, least: Any = (0.5, 0.1, -0.2, -INF)) -> Radius:
    """Scales 1, 2 ..., of which those fail whose margin is negative; |s| leaves beyond 2."""
    looks = [
        Look(scale, margin, int(margin < 0), np.zeros(1), leaving=int(scale > 2))
        for scale, margin in enumerate(least, start=1)
    ]
    return Radius("grosmc", 16, tuple(looks), Promise(promised, "a note", 0.1), largest=8.0)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Callable[[PassMap], Any]:
    """Draws a map."""
    figures: list[Figure] = []
    write = lambda figure, _: figures.append(figure)  # noqa: E731
    monkeypatch.setattr("grosmc_mj.results.figure.write_figure", write)

    def draw(shown: PassMap) -> Figure:
        write_pass_map(Path("map.png"), shown, TITLE, NO_PROOF)
        return figures[-1]

    return draw


def entries(legend: Any) -> list[str]:
    """The texts of a legend, a line each."""
    return [text.get_text().replace("\n", " ") for text in legend.get_texts()]


def test_every_run_is_marked_by_its_outcome(drawn: Callable[[PassMap], Any]) -> None:
    shown = pass_map()
    figure = drawn(shown)
    assert figure.get_suptitle().replace("\n", " ") == TITLE
    assert NO_PROOF in figure.get_supxlabel().replace("\n", " ")
    first, second = figure.axes
    marks = {each.get_label(): each for each in first.collections}
    masks = {
        "passed": MARGINS >= 0,
        "failed": (MARGINS < 0) & (MARGINS > -INF),
        "did not complete": MARGINS == -INF,
    }
    points = np.stack(shown.runs["grosmc"][:2], axis=1)
    assert list(marks) == list(masks)
    for outcome, mask in masks.items():
        np.testing.assert_array_equal(marks[outcome].get_offsets(), points[mask])
    assert len({to_hex(each.get_facecolor()[0]) for each in marks.values()}) == 3
    assert first.get_title() == "GROSMC: 5 of 8 passed"
    assert second.get_title() == "LQR: 8 of 8 passed"
    assert (first.get_xlabel(), first.get_ylabel()) == ("mass scale of pole", "start angle [deg]")


def test_the_premise_is_drawn_where_it_begins_to_fail(drawn: Callable[[PassMap], Any]) -> None:
    figure = drawn(pass_map(grosmc=premise(2.1)))
    hatched, line = figure.axes[0].collections[3:]
    # Between the columns of the grid the margin is linear, as the contour is.
    np.testing.assert_allclose(line.get_paths()[0].vertices[:, 0], 2.1, rtol=1e-12)
    assert hatched.get_paths()[0].vertices[:, 0].min() == pytest.approx(2.1)
    everywhere = drawn(pass_map(grosmc=premise(9.0)))
    assert len(everywhere.axes[0].collections) == 3
    assert entries(everywhere.legends[0])[-1] == "the premises hold all over the map"
    endless = premise(2.5)
    endless[2][:, -3:] = -INF
    line = drawn(pass_map(grosmc=endless)).axes[0].collections[-1]
    np.testing.assert_allclose(line.get_paths()[0].vertices[:, 0], 2.5, rtol=1e-12)


def test_a_radius_is_drawn_beside_the_promise() -> None:
    shown = chart(searched())
    assert shown.name == "GROSMC: no failure up to 2, promised 1.5"
    (line,) = shown.lines
    assert [*line.x] == [1, 2, 3, 4]
    # A run that did not complete has no margin.
    assert [*line.y] == [0.5, 0.1, -0.2, None]
    assert [*line.good] == [True, True, False, False]
    assert (shown.limit, [*shown.marks]) == (0.0, [2, 1.5])
    never = chart(searched(None, (-1.0, -1.0)))
    assert (never.name, [*never.marks]) == ("GROSMC: no failure up to 0", [])

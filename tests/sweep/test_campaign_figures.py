"""The figures of campaigns: the runs, margins and scales that were handed over are drawn."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex

from grosmc_mj.sweep.findings import NO_PROOF
from grosmc_mj.sweep.map import PassMap, draw_pass_map
from grosmc_mj.sweep.promise import Promise
from grosmc_mj.sweep.radius import Look, Radius, draw_radius

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


def panels(figure: Any) -> Any:
    return figure.subfigs[0].axes


def entries(legend: Any) -> list[str]:
    """The texts of a legend, a line each."""
    return [text.get_text().replace("\n", " ") for text in legend.get_texts()]


def test_every_run_is_marked_by_its_outcome() -> None:
    shown = pass_map()
    figure = draw_pass_map(shown, TITLE, NO_PROOF)
    assert figure.subfigs[0].get_suptitle().replace("\n", " ") == TITLE
    assert NO_PROOF in figure.texts[0].get_text().replace("\n", " ")
    first, second = panels(figure)
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


def test_the_premise_is_drawn_where_it_begins_to_fail() -> None:
    figure = draw_pass_map(pass_map(grosmc=premise(2.1)), TITLE, NO_PROOF)
    hatched, line = panels(figure)[0].collections[3:]
    # Between the columns of the grid the margin is linear, as the contour is.
    np.testing.assert_allclose(line.get_paths()[0].vertices[:, 0], 2.1, rtol=1e-12)
    assert hatched.get_paths()[0].vertices[:, 0].min() == pytest.approx(2.1)
    everywhere = draw_pass_map(pass_map(grosmc=premise(9.0)), TITLE, NO_PROOF)
    assert len(panels(everywhere)[0].collections) == 3
    assert entries(everywhere.subfigs[0].legends[0])[-1] == "the premises hold all over the map"
    endless = premise(2.5)
    endless[2][:, -3:] = -INF
    line = panels(draw_pass_map(pass_map(grosmc=endless), TITLE, ""))[0].collections[-1]
    np.testing.assert_allclose(line.get_paths()[0].vertices[:, 0], 2.5, rtol=1e-12)


def test_a_radius_is_drawn_beside_the_promise() -> None:
    (panel,) = panels(draw_radius([searched()], TITLE))
    lines = {each.get_label().replace("\n", " "): each for each in panel.lines}
    data = {label: [list(row) for row in line.get_data()] for label, line in lines.items()}
    assert data["no failure found"] == [[1, 2], [0.5, 0.1]]
    assert data["failure found"][0] == [3, 4]
    # A run that did not complete lies below all others.
    assert data["failure found"][1] == [-0.2, pytest.approx(-0.24)]
    assert data["no failure found up to 2"][0] == [2, 2]
    assert data["promised: 1.5: a note"][0] == [1.5, 1.5]
    assert data["|s| keeps the promised bound up to 2, leaves it at 3"][0] == [2, 2]
    (panel,) = panels(draw_radius([searched(None, (-1.0, -1.0))], TITLE))
    words = entries(panel.get_legend())
    assert "no failure found up to 0" in words
    assert "premises promise no radius: a note" in words

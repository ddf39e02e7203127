"""Axes of charts: ends about one number; names of columns."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from grosmc_mj.output.charts.chart import Chart, Curve, Panel
from grosmc_mj.output.charts.figure import drawn
from grosmc_mj.output.charts.of_results import cells_chart
from grosmc_mj.output.palette import INK, Stroke
from grosmc_mj.output.results.result import CellChart


def test_an_axis_about_one_number_has_ends_that_a_person_can_read() -> None:
    time = np.linspace(0, 1, 5)
    delay = 3.05 + 1e-9 * time
    chart = Chart(rows=[[Panel(layers=[Curve(time, delay, Stroke(INK), name="lqr")])]])
    (axes,) = drawn(chart).axes
    low, high = axes.get_ylim()
    assert low < 3.0
    assert high > 3.1


def test_names_of_neighbouring_columns_do_not_touch() -> None:
    """Twelve letters are as wide as a cell; a word of twelve stays whole."""
    names = ["tuned: case1", "tuned: case2", "actuator lag", "flexibility*"]
    cells = CellChart(
        name="laws",
        rows=["implicit-estimate, predicted"],
        columns=names,
        values=[[1.0] * len(names)],
        texts=[[""] * len(names)],
        whys=[[""] * len(names)],
        most=2.0,
    )
    figure = drawn(cells_chart("laws", [cells], ""))
    figure.draw_without_rendering()
    labels = figure.axes[0].get_xticklabels()
    assert labels[3].get_text() == "flexibility*"
    boxes = [label.get_window_extent() for label in labels]
    gaps = [right.x0 - left.x1 for left, right in pairwise(boxes)]
    letter = boxes[0].width / max(map(len, labels[0].get_text().splitlines()))
    assert min(gaps) > letter

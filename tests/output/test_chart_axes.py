"""Axes of charts: where values differ by rounding alone they stand in the middle."""

from __future__ import annotations

import numpy as np

from grosmc_mj.output.charts.chart import Chart, Curve, Panel
from grosmc_mj.output.charts.figure import drawn
from grosmc_mj.output.palette import INK, Stroke


def test_an_axis_about_one_number_has_ends_that_a_person_can_read() -> None:
    time = np.linspace(0, 1, 5)
    delay = 3.05 + 1e-9 * time
    chart = Chart(rows=[[Panel(layers=[Curve(time, delay, Stroke(INK), name="lqr")])]])
    (axes,) = drawn(chart).axes
    low, high = axes.get_ylim()
    assert low < 3.0
    assert high > 3.1

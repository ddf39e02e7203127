"""A design's rows, run as one batch: the same as each alone, in any order."""

from __future__ import annotations

import numpy as np
import pytest

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.sweep.runs import Outcomes, Row, run_rows

SERVO = Experiment.load("servo/case1").varied(duration=0.1)
BENCH = Experiment.load("servo/bench").varied(duration=0.05)


def rows() -> list[Row]:
    """Both laws on three plants, with edits, starts and disturbances changed by their paths."""
    return [
        Row(law, {"body.rotor.mass_scale": scale, "start.rotor angle.value": 0.1 * scale})
        for scale in (1.0, 1.5, 2.0)
        for law in ("lqr", "grosmc")
    ]


def row_of(table: Outcomes, index: int) -> dict[str, object]:
    """One row as plain values."""
    return {name: str(values[index]) for name, values in table.columns.items()}


def test_a_row_of_a_batch_is_the_row_alone_and_equations_agree_with_physics() -> None:
    design, table = rows(), run_rows(SERVO, rows())
    for i, row in enumerate(design):
        assert row_of(run_rows(SERVO, [row]), 0) == row_of(table, i)
    by_equations = run_rows(SERVO, rows(), plant="corrected")
    np.testing.assert_allclose(by_equations["deviation"], table["deviation"], rtol=1e-6, atol=1e-9)
    # The margin is the limit less the metric, of the laws that it is required of.
    (limit,) = (limit for limit in table.limits if limit.kind == "deviation_below")
    margin = table[f"margin {limit.key}"]
    of = [row.law in limit.of for row in design]
    np.testing.assert_array_equal(margin[of], (limit.value - table["deviation"])[of])


def test_numbers_of_the_loop_are_as_run_and_an_impossible_row_is_an_outcome() -> None:
    delay = "sensor.rotor angle.delay"
    design = [Row("grosmc", {delay: seconds}) for seconds in (0.002, 0.0021, 0.004)]
    impossible = Row("grosmc", {"sensor.no state.delay": 0.0})
    table = run_rows(BENCH, [*design, impossible], [], keep_impossible=True)
    assert table["status"].tolist() == ["completed"] * 3 + ["impossible"]
    assert list(table.impossible) == [3]
    assert "no state" in table.impossible[3]
    first, rounded, later = table["deviation"][:3]
    assert first == rounded != later
    with pytest.raises(ValueError, match="no state"):
        run_rows(BENCH, [impossible], [])
    # What the loop draws depends on the number of the run alone.
    once, again, other = run_rows(BENCH, [Row("grosmc", number=n) for n in (1, 1, 2)], [])["left"]
    assert once == again != other

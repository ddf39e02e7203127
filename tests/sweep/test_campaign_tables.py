"""The tables of campaigns: the numbers, their width, and what they say of themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rich.console import Console

from grosmc_mj.results.tables import WIDTH, Table
from grosmc_mj.sweep.findings import (
    DESIGN,
    NO_PROOF,
    Basis,
    Findings,
    margins_table,
    paired_table,
    pass_rates_table,
    sensitivity_table,
)
from grosmc_mj.sweep.statistics import margin_summary, paired, pass_rate, sensitivities

LONG = "stays within 2 deg of a [bracketed] requirement with a very long name from 2 s on"
LAW = "a_law_of_my_own_with_a_very_long_name"
SETTLES = "settles within 4 s"
X = np.arange(400) - 199.5
WIDE = np.linspace(-123456, 98765, 40)


def found(sampler: str = "random") -> Findings:
    """Findings with long names and wide numbers."""
    of, basis = {"independent": sampler == "random"}, Basis(512, 4096, sampler, 7)
    drivers = {"start [angle]": X, LONG: np.ones(400), "mass": np.abs(X)}
    margins = {
        (SETTLES, "grosmc"): np.linspace(0.5, 1.5, 101),
        (LONG, LAW): np.array([-math.inf, *np.linspace(-123456, 0.001234, 999)]),
    }
    pairs = {
        (SETTLES, "lqr", "grosmc"): (np.array([-1.0] * 6 + [1.0]), np.array([0.5] * 6 + [1.0])),
        (LONG, "grosmc", LAW): (WIDE, WIDE**2 / 1e3),
        (LONG, LAW, "lqr"): (np.array([1.0]), np.array([-math.inf])),
    }
    return Findings(
        sampled=basis,
        rates={
            (SETTLES, "grosmc"): pass_rate(512, 512, **of),
            (SETTLES, "lqr"): pass_rate(5119, 5120, **of),
            (LONG, LAW): pass_rate(99999, 100000, **of),
            (LONG, "lqr"): pass_rate(0, 512, **of),
        },
        cut_short={"lqr": 25},
        margins=margins,
        summaries={key: margin_summary(values, **of) for key, values in margins.items()},
        differences={key: paired(*pair, **of) for key, pair in pairs.items()},
        sensitivities={LAW: sensitivities(drivers, -np.abs(X), **of)},
        worst={},
        units={SETTLES: "s", LONG: "deg"},
        judges={},
    )


def tables(sampler: str = "random") -> list[Table]:
    of = found(sampler)
    return [pass_rates_table(of), margins_table(of), paired_table(of), sensitivity_table(of, LAW)]


def lines(table: Table) -> list[str]:
    """What the terminal shows."""
    console = Console(width=WIDTH, color_system=None)
    with console.capture() as shown:
        console.print(table)
    return [line.rstrip() for line in shown.get().splitlines()]


@pytest.mark.parametrize("sampler", ["random", "sobol"])
def test_every_table_is_narrow_and_says_what_was_sampled(sampler: str) -> None:
    for table in tables(sampler):
        assert max(map(len, lines(table))) <= WIDTH
        words = " ".join(" ".join(lines(table)).split())
        assert f"512 of 4096 runs, {sampler}, seed 7. {NO_PROOF} {DESIGN}" in words
        assert ("No interval: --sampler sobol" in words) == (sampler == "sobol")
        if sampler == "sobol":
            cells = [cell for row in table.rows for cell in row]
            # But for rates, whose interval has a column.
            assert not any(" .. " in cell or "< 1e-4" in cell for cell in cells)


def test_numbers_are_shown_with_their_intervals_and_units() -> None:
    rates, margins, pairs, drivers = tables()
    assert rates.rows[0] == [SETTLES, "GROSMC", "512", "512", "100", "99.28 .. 100.00", "0"]
    # Only all of the runs are 100 %, and only none 0 %.
    assert [row[4] for row in rates.rows[1:]] == ["99.98", "99.99", "0"]
    assert [row[6] for row in rates.rows] == ["0", "25", "0", "25"]
    assert margins.rows[0][2:6] == ["0.5", "0.525", "0.51", "0.55"]
    assert (margins.rows[0][-1], margins.rows[1][2]) == ("s", "-inf")
    assert pairs.rows[0][2:4] == ["0", "6"]
    assert pairs.rows[0][4].startswith("+85.7\n(")
    assert pairs.rows[0][6].startswith("+1.5 s\n(")
    assert pairs.rows[2][6] == "-inf deg\n(-inf .. +inf)"
    assert [row[0] for row in drivers.rows] == ["mass", "start [angle]", LONG]
    assert drivers.rows[0][3].startswith("-1.00 (-1.00 .. -")
    assert drivers.rows[2] == [LONG, "-", "", "-", "the parameter does not vary"]

"""The tables of campaigns: the numbers, their width, and what they say of themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rich.console import Console

from grosmc_mj.campaign.findings.basis import DESIGN, NO_PROOF, Basis
from grosmc_mj.campaign.findings.pairing import paired
from grosmc_mj.campaign.findings.sensitivity import sensitivities
from grosmc_mj.campaign.findings.statistics import (
    margin_summary,
    pass_rate,
)
from grosmc_mj.campaign.report.tables import (
    margins_table,
    paired_table,
    pass_rates_table,
    sensitivity_table,
)
from grosmc_mj.errors import ArgumentError
from grosmc_mj.results.tables import WIDTH

SAMPLED = Basis(512, 4096, "random", 7)
LONG = "stays within 2 deg of a [bracketed] requirement with a very long name from 2 s on"
LAW = "a_law_of_my_own_with_a_very_long_name"


def pass_rates(sampled=SAMPLED):
    rates = {
        ("settles within 4 s", "grosmc"): pass_rate(512, 512),
        ("settles within 4 s", "lqr"): pass_rate(5119, 5120),
        (LONG, LAW): pass_rate(99999, 100000),
        (LONG, "lqr"): pass_rate(0, 512),
    }
    return pass_rates_table(rates, {"lqr": 25}, sampled)


def margins(sampled=SAMPLED):
    rows = {
        ("settles within 4 s", "grosmc"): margin_summary(np.linspace(0.5, 1.5, 101)),
        (LONG, LAW): margin_summary(np.array([-math.inf, *np.linspace(-123456, 0.001234, 999)])),
    }
    return margins_table(rows, {"settles within 4 s": "s", LONG: "deg"}, sampled)


def pairs(sampled=SAMPLED):
    wide = np.linspace(-123456, 98765, 40)
    rows = {
        ("settles within 4 s", "lqr", "grosmc"): paired([-1.0] * 6 + [1.0], [0.5] * 6 + [1.0]),
        (LONG, "grosmc", LAW): paired(wide, wide**2 / 1e3),
        (LONG, LAW, "lqr"): paired([1.0], [-math.inf]),
    }
    return paired_table(rows, {"settles within 4 s": "s", LONG: "N m"}, sampled)


def driving(sampled=SAMPLED):
    x = np.arange(400) - 199.5
    values = {"start [angle]": x, LONG: np.ones(400), "mass": np.abs(x)}
    return sensitivity_table(sensitivities(values, -np.abs(x)), LONG, LAW, sampled)


def lines(table, width=WIDTH):
    """What the terminal shows."""
    console = Console(width=width, color_system=None)
    with console.capture() as shown:
        console.print(table)
    return [line.rstrip() for line in shown.get().splitlines()]


def words(table):
    """The same as one line."""
    return " ".join(" ".join(lines(table)).split())


@pytest.mark.parametrize("make", [pass_rates, margins, pairs, driving])
def test_every_table_is_narrow_and_says_what_was_sampled(make):
    # On a wider terminal too; nothing is cut off.
    for line in lines(make(), 160):
        assert len(line) <= WIDTH
        assert "…" not in line
    text = words(make())
    assert f"512 of 4096 runs, random, seed 7. {NO_PROOF} {DESIGN}" in text
    assert "certified" not in text.lower()
    # The only probability is the one that it is not.
    assert text.replace(DESIGN, "").lower().count("probabilit") == 0


@pytest.mark.parametrize("make", [pass_rates, margins, pairs, driving])
@pytest.mark.parametrize(
    ("sampled", "says"),
    [
        (Basis(8, 8, "random", 0), "8 runs, random, seed 0. {} {} Intervals and p: of indep"),
        (Basis(8, 8, "lhs", 0), "No interval: points of Latin hypercubes are not independent runs"),
        (Basis(8, 8, "corners", 0), "No interval: corners of the ranges are not independent runs"),
        (Basis(8, 8, "sobol", 0), "No interval: points of a Sobol sequence are not independent"),
    ],
)
def test_every_table_says_what_its_intervals_are(make, sampled, says):
    text = words(make(sampled))
    assert says.format(NO_PROOF, DESIGN) in text
    # These are of independent runs, and of nothing else.
    for name in ("Clopper", "McNemar"):
        assert sampled.sampler == "random" or name not in text


def test_runs_that_are_not_independent_have_no_interval_in_any_table():
    sampled, wide = Basis(64, 64, "sobol", 0), np.linspace(-1, 2, 64)
    rate = pass_rate(40, 64)._replace(low=None, high=None)
    text = lines(pass_rates_table({("a", "lqr"): rate}, {}, sampled))
    assert " ".join(text[3].split()) == "a LQR 40 64 62.50 - 0"
    summary = margin_summary(wide, independent=False)
    assert (summary.mean_low, summary.mean_high) == (None, None)
    assert lines(margins_table({("a", "lqr"): summary}, {}, sampled))[3].split()[-1] == "0.5"
    assert "(-" not in "".join(lines(margins_table({("a", "lqr"): summary}, {}, sampled)))
    pair = paired(wide, wide + 1, independent=False)
    assert (pair.low, pair.high, pair.p_value, pair.median_low) == (None, None, None, None)
    row = next(
        row for row in lines(paired_table({("a", "b", "c"): pair}, {}, sampled)) if "b," in row
    )
    assert row.split()[-4:] == ["21", "+32.8", "-", "+1"]
    (driver,) = sensitivities({"x": wide}, wide, independent=False)
    assert (driver.low, driver.high, driver.p_value) == (None, None, None)


def test_pass_rates_are_shown_with_their_intervals():
    text = lines(pass_rates())
    grosmc, lqr = text[3:5]
    # 0.025^(1/512) = 0.99282, rounded outwards.
    assert " ".join(grosmc.split()) == "settles within 4 s GROSMC 512 512 100 99.28 .. 100.00 0"
    assert lqr.split()[:4] == ["LQR", "5119", "5120", "99.98"]
    assert lqr.split()[-1] == "25"
    # One failure of 100,000 is not 100 %.
    assert any("99999   100000   99.99" in line for line in text)
    said = '"at least 99 % of the declared design passes" with 95 % confidence takes 299'
    assert said in words(pass_rates())


def test_margins_are_shown_with_their_unit():
    grosmc = lines(margins())[3].split()
    # Worst six of 101 evenly spaced.
    found = [*grosmc[-8:]]
    assert found == ["0.5", "0.525", "0.51", "0.55", "1", "1.45", "1", "s"]
    # 1 ± 1.984 sqrt(101 / 1200 * 1.02) / sqrt(101): Student's t of 101 independent runs.
    assert "(0.942 .." in lines(margins())[4]
    assert "1.06)" in lines(margins())[5]
    assert "-inf" in words(margins())


def test_pairs_are_shown_over_their_intervals():
    text = lines(pairs())
    first = next(row for row in text if "LQR," in row).split()
    assert first[-6:] == ["0", "6", "+85.7", "0.031", "+1.5", "s"]
    assert "(-inf .. +inf)" in words(pairs())
    assert "-inf N m" in words(pairs())


def test_drivers_are_shown_the_strongest_first():
    text = [line.split() for line in lines(driving())]
    rows = [row for row in text if row and row[0] in ("mass", "start", "stays")]
    assert [row[0] for row in rows] == ["mass", "start", "stays"]
    assert rows[0][1:] == ["100", "<", "1e-4", "-1.00", "(-1.00", "..", "-1.00)"]
    assert rows[1][2:5] == ["99", "<", "1e-4"]
    assert "the parameter does not vary" in " ".join(rows[2])


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: pass_rates_table({}, {}, SAMPLED), "at least one row"),
        (
            lambda: pass_rates_table(
                {("a", "b"): pass_rate(1, 1, 0.9), ("a", "c"): pass_rate(1, 1, 0.8)}, {}, SAMPLED
            ),
            "one confidence",
        ),
        (lambda: margins_table({}, {}, SAMPLED), "no margins"),
        (lambda: paired_table({}, {}, SAMPLED), "at least one row"),
        (lambda: sensitivity_table([], "a", "b", SAMPLED), "no parameters"),
    ],
)
def test_empty_tables_are_refused(wrong, said):
    with pytest.raises(ArgumentError, match=said):
        wrong()

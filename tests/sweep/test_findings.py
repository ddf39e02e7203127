"""The findings of a campaign, its tables and its figures, against the columns of its parts."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_cases import BOTH, DEVIATION, PAIR, campaign, falling, kept, pair, servo, uncertain
from commands import Patch
from matplotlib.colors import to_hex
from rich.console import Console

from grosmc_mj.cli.commands.campaign.answer import say_findings
from grosmc_mj.results.document import json_text
from grosmc_mj.results.tables import WIDTH
from grosmc_mj.sweep import findings as module
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.findings import ALL, DESIGN, NO_PROOF, Findings, findings, results_document
from grosmc_mj.sweep.map import PassMap, map_axes, write_pass_map
from grosmc_mj.sweep.promise import Promise
from grosmc_mj.sweep.radius import Radius, ScaleTrial, chart
from grosmc_mj.sweep.runs import COMPLETED
from grosmc_mj.sweep.statistics import Sensitivity, margin_summary, paired, pass_rate, sensitivities
from grosmc_mj.sweep.store import Folder

INF = math.inf
COMPLETES = "completes"
WORDS = "deviation below 3 mrad"
COLUMNS = [
    "margin deviation_below",
    "margin input_below",
    "relative",
    "rotor mass scale",
    "load amplitude",
]


def declared() -> Campaign:
    return campaign(servo(), seed=5)


@pytest.fixture(scope="module")
def shown(servos: Folder) -> Findings:
    """Those of eight servos."""
    return findings(declared(), servos, 0.9)


def test_findings_are_those_of_the_columns(servos: Folder, shown: Findings) -> None:
    columns = servos.columns(declared(), COLUMNS, range(2))
    for law, own in columns.items():
        for words, name in zip((WORDS, "input below 10 A", ALL), COLUMNS, strict=False):
            assert shown.rates[words, law] == pass_rate(int((own[name] >= 0).sum()), 8, 0.9)
            assert shown.summaries[words, law] == margin_summary(own[name], 0.9)
        assert (shown.rates[COMPLETES, law].kept, shown.cut_short[law]) == (8, 0)
        # The worst runs come first.
        assert sorted(shown.worst[law]) == list(range(8))
        assert np.all(np.diff(own["relative"][shown.worst[law]]) >= 0)
    lqr, grosmc = (columns[law]["relative"] for law in ("lqr", "grosmc"))
    difference = shown.differences[ALL, "lqr", "grosmc"]
    assert difference == paired(lqr, grosmc, 0.9)
    assert (difference.only_first, difference.only_second) == (0, 6)
    assert ((lqr < 0) & (grosmc >= 0)).sum() == 6
    values = {name: columns["lqr"][name] for name in declared().family.names}
    assert shown.sensitivities["lqr"] == sensitivities(values, lqr, 0.9)
    # A requirement of one law is not another's.
    laws = [law for words, law in shown.rates if words == "sliding below 0.02 A s"]
    assert (laws, {key[1:] for key in shown.differences}) == (["grosmc"], {("lqr", "grosmc")})
    tables = module.findings_tables(declared(), shown)
    rows = [len(table.rows) for table in tables[1:3]]
    assert rows == [len(shown.summaries), len(shown.differences)]
    content = json.loads(json_text(results_document(declared(), shown)))
    for words in ("no proof", "not probabilities", "Intervals and p: of independent runs"):
        assert words in content["says"]
    # All runs that are kept give an interval too: 0.05^(1/8) is its lower end.
    rates = [rate for rate in content["pass_rates"] if rate["requirement"] == COMPLETES]
    assert [rate["low"] for rate in rates] == pytest.approx([0.05 ** (1 / 8)] * 2, rel=1e-9)
    assert [rate["high"] for rate in rates] == [1.0, 1.0]


def test_the_same_requirement_may_stand_in_a_table_of_each_law(tmp_path: Path) -> None:
    both = "".join(f'{DEVIATION}of = ["{law}"]\n' for law in ("lqr", "stiff"))
    split = campaign(servo(laws=PAIR, limits=both))
    separate = findings(split, kept(split, tmp_path / "split"))
    for law in ("lqr", "stiff"):
        assert separate.rates[WORDS, law].kept == (separate.margins[WORDS, law] >= 0).sum()
    assert (WORDS, "lqr", "stiff") in separate.differences


def test_runs_that_end_early_are_failures_with_their_cause(tmp_path: Path) -> None:
    folder, law = kept(falling(), tmp_path), "fl-lqr"
    fallen = findings(falling(), folder)
    early = int((folder.columns(falling(), ["status"], [0])[law]["status"] != COMPLETED).sum())
    assert fallen.cut_short[law] == np.isneginf(fallen.margins[ALL, law]).sum() == early > 0
    assert fallen.rates[COMPLETES, law].kept == 16 - early >= fallen.rates[ALL, law].kept
    assert np.all(np.isneginf(fallen.margins[ALL, law][fallen.worst[law][:early]]))
    # JSON has no infinities: null stands for them, and beside it how many runs ended early.
    written = json.loads(json_text(results_document(falling(), fallen)))["margins"]
    nothing = [row["diverged"] for row in written if row["least"] is None]
    assert set(nothing) == {early}


def test_corners_are_no_independent_runs_and_give_no_interval(tmp_path: Path) -> None:
    regular = campaign(pair(), sampler="corners", runs=4)
    no_chance = findings(regular, kept(regular, tmp_path), 0.9)
    rate, difference = no_chance.rates[ALL, "lqr"], no_chance.differences[ALL, "lqr", "stiff"]
    assert (rate.runs, rate.low, rate.high) == (4, None, None)
    assert (difference.low, difference.p_value, difference.median_low) == (None, None, None)
    assert {summary.mean_low for summary in no_chance.summaries.values()} == {None}
    for table in module.findings_tables(regular, no_chance):
        assert "No interval: --sampler corners" in printed(table)
        assert not any(" .. " in cell or "< 1e-4" in cell for row in table.rows for cell in row)


def test_a_number_with_0_percent_is_not_named_as_a_driver(shown: Findings) -> None:
    for share, named in ((0.0049, False), (0.0051, True)):
        driver = Sensitivity("rotor mass scale", 0.1, -0.1, 0.3, share, 0.5)
        console = Console(width=100, color_system=None)
        with console.capture() as screen:
            other = replace(shown, sensitivities={"lqr": [driver]})
            say_findings(console, declared(), other, [], full=False)
        words = " ".join(screen.get().split())
        assert ("rotor mass scale drives its margin most (1 % of" in words) == named


LONG = "stays within 2 deg of a [bracketed] requirement with a very long name from 2 s on"
LAW, SETTLES = "a_law_of_my_own_with_a_very_long_name", "settles within 4 s"
X = np.arange(400) - 199.5


def printed(table: Any) -> str:
    console = Console(width=WIDTH, color_system=None)
    with console.capture() as screen:
        console.print(table)
    assert max(len(line.rstrip()) for line in screen.get().splitlines()) <= WIDTH
    return " ".join(screen.get().split())


def test_tables_are_narrow_and_have_the_numbers_with_their_intervals_and_units() -> None:
    first, second = np.array([-1.0] * 6 + [1.0]), np.array([0.5] * 6 + [1.0])
    kept_by = {(SETTLES, "grosmc"): (512, 512), (SETTLES, "lqr"): (5119, 5120),
               (LONG, LAW): (99999, 100000), (LONG, "lqr"): (0, 512)}  # fmt: skip
    drivers = {"start [angle]": X, LONG: np.ones(400), "mass": np.abs(X)}
    wide = Findings(
        sampled=module.Basis(512, 4096, "random", 7),
        rates={key: pass_rate(*counts) for key, counts in kept_by.items()},
        cut_short={"lqr": 25},
        margins={},
        summaries={
            (SETTLES, "grosmc"): margin_summary(np.linspace(0.5, 1.5, 101)),
            (LONG, LAW): margin_summary(np.array([-INF, *np.linspace(-123456, 0.001234, 999)])),
        },
        differences={
            (SETTLES, "lqr", "grosmc"): paired(first, second),
            (LONG, LAW, "lqr"): paired(np.array([1.0]), np.array([-INF])),
        },
        sensitivities={LAW: sensitivities(drivers, -np.abs(X))},
        worst={},
        units={SETTLES: "s", LONG: "deg"},
        judges={},
    )
    tables = [module.pass_rates_table(wide), module.margins_table(wide), module.paired_table(wide),
              module.sensitivity_table(wide, LAW)]  # fmt: skip
    for table in tables:
        assert f"512 of 4096 runs, random, seed 7. {NO_PROOF} {DESIGN}" in printed(table)
    rates, of_margins, of_pairs, of_drivers = (table.rows for table in tables)
    assert rates[0] == [SETTLES, "GROSMC", "512", "512", "100", "99.28 .. 100.00", "0"]
    # Only all of the runs are 100 %, and only none 0 %.
    assert [(row[4], row[6]) for row in rates[1:]] == [("99.98", "25"), ("99.99", "0"), ("0", "25")]
    assert of_margins[0][2:6] == ["0.5", "0.525", "0.51", "0.55"]
    assert (of_margins[0][-1], of_margins[1][2]) == ("s", "-inf")
    assert of_pairs[0][2:4] == ["0", "6"]
    assert of_pairs[0][4].startswith("+85.7\n(")
    assert of_pairs[0][6].startswith("+1.5 s\n(")
    assert of_pairs[1][6] == "-inf deg\n(-inf .. +inf)"
    assert [row[0] for row in of_drivers] == ["mass", "start [angle]", LONG]
    assert of_drivers[0][3].startswith("-1.00 (-1.00 .. -")
    assert of_drivers[2] == [LONG, "-", "", "-", "the parameter does not vary"]


MARGINS = np.array([-INF, -INF, -0.5, 0.0, 0.5, 0.75, 1.0, 1.25])


def test_a_map_marks_kept_and_failed_plants(monkeypatch: Patch) -> None:
    figures: list[Any] = []
    door = "grosmc_mj.results.figure.write_figure"
    monkeypatch.setattr(door, lambda figure, _: figures.append(figure))
    x, y = np.linspace(1, 4, 8), np.linspace(-20, 20, 8)
    laws = {"grosmc": (x, y, MARGINS), "lqr": (x, y, x)}
    titles = ("mass scale [1]", "angle [deg]")
    write_pass_map(Path("map.png"), PassMap(titles, laws), "8 of 16 runs", NO_PROOF)
    first, second = figures[0].axes
    masks = {"kept": MARGINS >= 0, "failed": MARGINS == -0.5, "did not complete": MARGINS == -INF}
    assert len(first.collections) == 3
    for mark, (outcome, mask) in zip(first.collections, masks.items(), strict=True):
        assert mark.get_label() == outcome
        np.testing.assert_array_equal(mark.get_offsets(), np.stack([x, y], axis=1)[mask])
    # Colours and markers differ.
    assert len({to_hex(mark.get_facecolor()[0]) for mark in first.collections}) == 3
    assert len({len(mark.get_paths()[0].vertices) for mark in first.collections}) == 3
    kept_by = (first.get_title(), second.get_title())
    assert kept_by == ("GROSMC: 5 of 8 kept", "LQR: 8 of 8 kept")
    assert (first.get_xlabel(), first.get_ylabel()) == titles
    (legend,) = figures[0].legends
    assert [entry.get_text() for entry in legend.get_texts()] == list(masks)


def test_a_map_is_over_the_two_numbers_that_drive_margins_most(shown: Findings) -> None:
    both = declared().family.quantities
    mass, load = both
    assert map_axes(declared(), shown) == both
    assert map_axes(declared(), shown, [load.name, mass.name]) == (load, mass)
    # Of three numbers the one that explains least under every law is left out.
    hum = uncertain('disturbance = "hum"', 'phase = ["0 rad", "1 rad"]')
    three = campaign(servo(BOTH + hum))
    mass, load, phase = three.family.quantities
    shares = {mass.name: (0.1, 0.2), load.name: (0.3, 0.1), phase.name: (0.0, 0.9)}
    drivers = {
        law: [Sensitivity(name, share=pair[number]) for name, pair in shares.items()]
        for number, law in enumerate(("lqr", "grosmc"))
    }
    assert map_axes(three, replace(shown, sensitivities=drivers)) == (load, phase)


def test_a_radius_is_drawn_beside_the_promise() -> None:
    """Scales 1, 2 ..., of which those fail whose margin is negative; |s| leaves beyond 2."""
    looks = [
        ScaleTrial(scale, margin, int(margin < 0), np.zeros(1), leaving=int(scale > 2))
        for scale, margin in enumerate((0.5, 0.1, -0.2, -INF), start=1)
    ]
    shown = chart(Radius("grosmc", 16, tuple(looks), Promise(1.5, "a note", 0.1), largest=8.0))
    (line,) = shown.lines
    # A run that did not complete has no margin.
    assert ([*line.x], [*line.y]) == ([1, 2, 3, 4], [0.5, 0.1, -0.2, None])
    assert [*line.good] == [True, True, False, False]
    assert shown.name == "GROSMC: no failure up to 2, promised 1.5"
    assert (shown.limit, [*shown.marks]) == (0.0, [2, 1.5])
    nothing = chart(Radius("grosmc", 16, tuple(looks[2:]), Promise(None, "", 0.1), largest=8.0))
    assert (nothing.name, [*nothing.marks]) == ("GROSMC: no failure up to 0", [])

"""Findings of a campaign, its tables and its figures, against the columns of its parts."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaigns import BOTH, PAIR, campaign, falling, kept, pair, servo, uncertain
from printed import Printed
from rich.console import Console
from syrupy.assertion import SnapshotAssertion

from grosmc_mj.output.charts.figure import drawn
from grosmc_mj.output.results.document import json_text
from grosmc_mj.output.results.tables import WIDTH
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.drivers import Sensitivity, drivers_table, sensitivities
from grosmc_mj.studies.campaign.findings import Findings, campaign_result, findings, findings_tables
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.map import PassMap, map_axes, pass_map_chart
from grosmc_mj.studies.campaign.paired import paired, paired_table
from grosmc_mj.studies.campaign.radius import Radius, ScaleTrial, chart
from grosmc_mj.studies.sweep.margin_summary import margin_summary, margins_table
from grosmc_mj.studies.sweep.pass_rates import PassRate, pass_rate, pass_rates_table
from grosmc_mj.studies.sweep.runs import COMPLETED
from grosmc_mj.studies.sweep.sampled import ALL, NO_PROOF, SampledRuns

INF = math.inf
COMPLETES = "completes"
WORDS = "deviation below 3 mrad"
COLUMNS = {
    WORDS: "margin deviation_below",
    "input below 10 A": "margin input_below",
    ALL: "relative",
}
Columns = dict[str, dict[str, Any]]


def declared() -> Campaign:
    """The campaign of eight servos."""
    return campaign(servo(), seed=5)


@pytest.fixture(scope="module")
def servo_findings(servos: Folder) -> Findings:
    """Findings of eight servos."""
    return findings(declared(), servos, 0.9)


@pytest.fixture(scope="module")
def columns(servos: Folder) -> Columns:
    """The columns of eight servos, by law and name."""
    names = [*COLUMNS.values(), *declared().family.names]
    return servos.columns(declared(), names, range(2))


EACH_LAW = pytest.mark.parametrize("law", ["lqr", "grosmc"])


@EACH_LAW
@pytest.mark.parametrize("words", COLUMNS)
def test_rates_and_summaries_are_those_of_the_columns(
    words: str, law: str, columns: Columns, servo_findings: Findings
) -> None:
    margins = columns[law][COLUMNS[words]]
    assert servo_findings.rates[words, law] == pass_rate(int((margins >= 0).sum()), 8, 0.9)
    assert servo_findings.summaries[words, law] == margin_summary(margins, 0.9)


@EACH_LAW
def test_the_worst_runs_come_first(law: str, columns: Columns, servo_findings: Findings) -> None:
    worst = servo_findings.worst[law]
    assert sorted(worst) == list(range(8))
    assert np.all(np.diff(columns[law]["relative"][worst]) >= 0)


def test_laws_are_compared_on_the_same_plants(columns: Columns, servo_findings: Findings) -> None:
    lqr = columns["lqr"]["relative"]
    grosmc = columns["grosmc"]["relative"]
    difference = servo_findings.differences[ALL, "lqr", "grosmc"]
    assert difference == paired(lqr, grosmc, 0.9)
    assert (difference.only_first, difference.only_second) == (0, 6)
    assert ((lqr < 0) & (grosmc >= 0)).sum() == 6
    assert {key[1:] for key in servo_findings.differences} == {("lqr", "grosmc")}


def test_drivers_are_those_of_the_columns(columns: Columns, servo_findings: Findings) -> None:
    lqr = columns["lqr"]
    values = {name: lqr[name] for name in declared().family.names}
    assert servo_findings.sensitivities["lqr"] == sensitivities(values, lqr["relative"])


def test_a_requirement_of_one_law_is_not_another_s(servo_findings: Findings) -> None:
    laws = [law for words, law in servo_findings.rates if words == "sliding below 0.02 A s"]
    assert laws == ["grosmc"]


def test_rates_without_a_failure_have_an_interval_too(servo_findings: Findings) -> None:
    rate: Any = servo_findings.rates[COMPLETES, "lqr"]
    # The lower end is 0.05^(1/8).
    assert (rate.kept, rate.high) == (8, 1.0)
    assert rate.low == pytest.approx(0.05 ** (1 / 8), rel=1e-9)
    assert servo_findings.cut_short["lqr"] == 0


@pytest.mark.parametrize(("failing", "verdict"), [((), "kept"), (("lqr",), "not kept")])
def test_a_law_is_not_kept_if_a_search_found_a_failing_plant_of_the_declared_design(
    failing: tuple[str, ...], verdict: str, servo_findings: Findings
) -> None:
    """Whatever the runs say."""
    every_run = {key: rate._replace(kept=rate.runs) for key, rate in servo_findings.rates.items()}
    kept_by_all = replace(servo_findings, rates=every_run)
    answers = campaign_result(declared(), kept_by_all, failing=failing).answers
    assert [x.verdict for x in answers if x.words.startswith("lqr")] == [verdict]


def test_the_same_requirement_may_stand_in_a_table_of_each_law(pairs: Folder) -> None:
    """Its laws are compared as if it stood in one table."""
    of_each = [{"deviation_below": "3 mrad", "of": [law]} for law in ("lqr", "stiff")]
    split = campaign(servo(laws=PAIR, limits=of_each), shard=8)
    together = findings(campaign(pair()), pairs)
    separate = findings(split, kept(split, pairs.path.with_name("split")))
    assert separate.rates == together.rates
    assert separate.differences.keys() == together.differences.keys()


# Runs that end early.

LAW_THAT_FALLS = "fl-lqr"


@pytest.fixture(scope="module")
def fallen_folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """The folder of sixteen pendulums, of which some fall."""
    return kept(falling(), tmp_path_factory.mktemp("falling"))


@pytest.fixture(scope="module")
def fallen(fallen_folder: Folder) -> Findings:
    """Findings of sixteen pendulums, of which some fall."""
    return findings(falling(), fallen_folder)


def test_runs_that_end_early_are_failures_and_the_worst(
    fallen_folder: Folder, fallen: Findings
) -> None:
    rows = fallen_folder.columns(falling(), ["status", "relative"], [0])[LAW_THAT_FALLS]
    early = int((rows["status"] != COMPLETED).sum())
    diverged = fallen.summaries[ALL, LAW_THAT_FALLS].diverged
    assert fallen.cut_short[LAW_THAT_FALLS] == diverged == early > 0
    completed = fallen.rates[COMPLETES, LAW_THAT_FALLS].kept
    assert completed == 16 - early >= fallen.rates[ALL, LAW_THAT_FALLS].kept
    assert np.all(np.isneginf(rows["relative"][fallen.worst[LAW_THAT_FALLS][:early]]))


def test_json_has_null_for_the_margin_of_a_run_that_ended_early(fallen: Findings) -> None:
    content = json.loads(json_text(campaign_result(falling(), fallen)))
    # Beside it stands how many runs ended early.
    diverged = {row["diverged"] for row in content["margins"] if row["least"] is None}
    assert diverged == {fallen.cut_short[LAW_THAT_FALLS]}


# Corners are no independent runs.


def corner_campaign() -> Campaign:
    """The campaign of the four corners of a family."""
    return campaign(pair(), sampler="corners", runs=4)


@pytest.fixture(scope="module")
def corners(tmp_path_factory: pytest.TempPathFactory) -> Findings:
    """Findings of the four corners of a family."""
    return findings(
        corner_campaign(), kept(corner_campaign(), tmp_path_factory.mktemp("corners")), 0.9
    )


def test_findings_of_corners_have_no_interval(corners: Findings) -> None:
    rate = corners.rates[ALL, "lqr"]
    assert (rate.runs, rate.low, rate.high) == (4, None, None)
    difference = corners.differences[ALL, "lqr", "stiff"]
    assert (difference.low, difference.median_low, difference.p_value) == (None, None, None)
    assert {summary.mean_low for summary in corners.summaries.values()} == {None}


@pytest.mark.parametrize("index", range(5))
def test_a_table_of_corners_shows_no_interval(index: int, corners: Findings) -> None:
    table = findings_tables(corner_campaign(), corners)[index]
    assert "No interval: --sampler corners" in " ".join(on_screen(table).split())
    cells = [cell for row in table.rows for cell in row]
    assert not any(" .. " in cell or "< 1e-4" in cell for cell in cells)


@pytest.mark.parametrize(
    ("p_value", "words"),
    [
        (0.009, "lqr: rotor mass scale drives its margin most (11 % of the variance"),
        (0.011, "lqr: no uncertain number alone drives its margin more than chance would"),
    ],
)
def test_a_number_is_named_as_a_driver_if_its_share_is_no_noise(
    p_value: float, words: str, servo_findings: Findings
) -> None:
    driver = Sensitivity("rotor mass scale", 0.1, 0.11, p_value)
    changed = replace(servo_findings, sensitivities={"lqr": [driver], "grosmc": [driver]})
    remarks = campaign_result(declared(), changed).remarks
    assert any(words in line for line in remarks)


# Tables of long names and large numbers.

LONG = "stays within 2 deg of a [bracketed] requirement with a very long name from 2 s on"
LAW = "a_law_of_my_own_with_a_very_long_name"
SETTLES = "settles within 4 s"
SAMPLED = SampledRuns(512, 4096, "random", 7)
UNITS = {SETTLES: "s", LONG: "deg"}


def on_screen(table: Any) -> str:
    """A table as it is printed."""
    console = Console(width=WIDTH, color_system=None)
    with console.capture() as screen:
        console.print(table)
    return "\n".join(line.rstrip() for line in screen.get().splitlines())


def rates_of_long_names() -> Any:
    rates = {
        (SETTLES, "grosmc"): pass_rate(512, 512),
        (SETTLES, "lqr"): pass_rate(5119, 5120),
        (LONG, LAW): pass_rate(99999, 100000),
        (LONG, "lqr"): pass_rate(0, 512),
    }
    return pass_rates_table(rates, summaries_of_long_names(), UNITS, SAMPLED)


def summaries_of_long_names() -> Any:
    many = np.array([-INF, *np.linspace(-123456, 0.001234, 999)])
    return {
        (SETTLES, "grosmc"): margin_summary(np.linspace(0.5, 1.5, 101)),
        (LONG, LAW): margin_summary(many),
    }


@pytest.mark.parametrize(
    ("margin", "unit", "words"),
    [(0.1, "1", "0.1"), (0.1, "s", "0.1 s"), (-INF, "s", "ended early")],
)
def test_a_least_margin_has_its_unit_or_says_that_a_run_ended_early(
    margin: float, unit: str, words: str
) -> None:
    rates = {(SETTLES, "lqr"): pass_rate(1, 2)}
    summaries = {(SETTLES, "lqr"): margin_summary(np.array([margin, 0.2]))}
    (row,) = pass_rates_table(rates, summaries, {SETTLES: unit}, SAMPLED).rows
    assert row[-1] == words


def margins_of_long_names() -> Any:
    return margins_table(summaries_of_long_names(), UNITS, SAMPLED)


def differences_of_long_names() -> Any:
    """Six plants are kept by the second law alone; then the second does not complete."""
    first = np.array([-1.0] * 6 + [1.0])
    second = np.array([0.5] * 6 + [1.0])
    differences = {
        (SETTLES, "lqr", "grosmc"): paired(first, second),
        (LONG, LAW, "lqr"): paired(np.array([1.0]), np.array([-INF])),
    }
    return paired_table(differences, UNITS, SAMPLED)


def drivers_of_long_names() -> Any:
    x = np.arange(400) - 199.5
    drivers = sensitivities({"start [angle]": x, LONG: np.ones(400), "mass": np.abs(x)}, -np.abs(x))
    return drivers_table(LAW, drivers, SAMPLED)


@pytest.mark.parametrize(
    "table",
    [
        rates_of_long_names,
        margins_of_long_names,
        differences_of_long_names,
        drivers_of_long_names,
    ],
)
def test_a_table_of_long_names_is_printed(table: Any, snapshot: SnapshotAssertion) -> None:
    """The requirement that fails most comes first, and the number that drives most."""
    text = on_screen(table())
    assert max(map(len, text.splitlines())) <= WIDTH
    assert text + "\n" == snapshot.use_extension(Printed)


def test_only_all_of_the_runs_are_100_percent_and_only_none_is_0() -> None:
    assert [row[3] for row in rates_of_long_names().rows] == ["0", "99.98", "99.99", "100"]


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [(0.123499, 0.987601, "12.34 .. 98.77"), (0.12345, 0.9876, "12.34 .. 98.76")],
)
def test_an_interval_is_rounded_outwards(low: float, high: float, shown: str) -> None:
    """So the one that is shown covers the exact one."""
    assert PassRate(3, 4, 0.75, low, high, 0.95).interval("..") == shown


# Figures.

MARGINS = np.array([-INF, -INF, -0.5, 0.0, 0.5, 0.75, 1.0, 1.25])
MAP_X = np.linspace(1, 4, 8)
MAP_Y = np.linspace(-20, 20, 8)
TITLES = ("mass scale", "angle [deg]")


@pytest.fixture(scope="module")
def map_figure() -> Any:
    """The figure of a map of eight plants under two laws."""
    laws = {"grosmc": (MAP_X, MAP_Y, MARGINS), "lqr": (MAP_X, MAP_Y, MAP_X)}
    title = f"Arm: payload, length of the link, disturbance: {8 * 'all requirements '}"
    return drawn(pass_map_chart(PassMap(TITLES, laws), title, NO_PROOF))


@pytest.mark.parametrize(
    ("index", "outcome", "plants"),
    [(0, "kept", MARGINS >= 0), (1, "failed", MARGINS == -0.5), (2, "did not complete", [0, 1])],
)
def test_a_map_marks_plants_by_their_outcome(
    index: int, outcome: str, plants: Any, map_figure: Any
) -> None:
    mark = map_figure.axes[0].lines[index]
    (legend,) = map_figure.legends
    assert mark.get_label() == legend.get_texts()[index].get_text() == outcome
    np.testing.assert_array_equal(mark.get_xydata(), np.stack([MAP_X, MAP_Y], axis=1)[plants])


def test_the_title_of_a_map_does_not_reach_into_its_legend(map_figure: Any) -> None:
    (legend,) = map_figure.legends
    map_figure.draw_without_rendering()
    title = map_figure._suptitle.get_window_extent()
    assert title.x1 < legend.get_window_extent().x0


def test_marks_of_a_map_differ_in_colour_and_form(map_figure: Any) -> None:
    marks = map_figure.axes[0].lines
    assert len(marks) == 3
    assert len({mark.get_color() for mark in marks}) == 3
    assert len({mark.get_marker() for mark in marks}) == 3


def test_a_map_counts_the_plants_that_are_kept(map_figure: Any) -> None:
    first, second = map_figure.axes
    assert first.get_title(loc="left") == "grosmc: 5 of 8 kept"
    assert second.get_title(loc="left") == "lqr: 8 of 8 kept"
    assert (first.get_xlabel(), first.get_ylabel()) == TITLES


def test_a_map_is_over_the_named_numbers(servo_findings: Findings) -> None:
    mass, load = declared().family.quantities
    assert map_axes(declared(), servo_findings) == (mass, load)
    assert map_axes(declared(), servo_findings, [load.name, mass.name]) == (load, mass)


def test_a_map_is_over_the_two_numbers_that_drive_margins_most(servo_findings: Findings) -> None:
    three = campaign(servo(*BOTH, uncertain("disturbance.hum.phase", "0 rad", "1 rad")))
    mass, load, phase = three.family.names
    # The mass explains least under every law.
    shares = {
        "lqr": {mass: 0.1, load: 0.3, phase: 0.0},
        "grosmc": {mass: 0.2, load: 0.1, phase: 0.9},
    }
    drivers = {
        law: [Sensitivity(name, share=share) for name, share in of_law.items()]
        for law, of_law in shares.items()
    }
    axes: Any = map_axes(three, replace(servo_findings, sensitivities=drivers))
    assert [axis.name for axis in axes] == [load, phase]


def trial(scale: float, margin: float) -> ScaleTrial:
    """A trial that fails if the margin is negative."""
    margins = np.array([margin])
    return ScaleTrial(scale, np.zeros((1, 1)), margins, margins, (0,))


TRIALS = (trial(1, 0.5), trial(2, 0.1), trial(3, -0.2), trial(4, -INF))


def test_a_radius_is_drawn_where_the_first_failure_was_found() -> None:
    radius = chart(Radius("grosmc", 16, TRIALS, largest=8.0))
    (line,) = radius.lines
    assert [*line.x] == [1, 2, 3, 4]
    # A run that did not complete has no margin.
    assert [*line.y] == [0.5, 0.1, -0.2, None]
    assert [*line.good] == [True, True, False, False]
    assert radius.name == "grosmc: no failure found up to 2"
    assert (radius.limit, [*radius.marks]) == (0.0, [2])


def test_a_radius_of_nothing_has_no_marks() -> None:
    radius = chart(Radius("grosmc", 16, TRIALS[2:], largest=8.0))
    assert radius.name == "grosmc: no failure found up to 0"
    assert [*radius.marks] == []

"""Findings of a campaign, its tables and its figures, against the columns of its parts."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaign_cases import BOTH, PAIR, campaign, falling, kept, pair, servo
from rich.console import Console

from grosmc_mj.output.charts.figure import drawn
from grosmc_mj.output.results.document import json_text
from grosmc_mj.output.results.tables import WIDTH
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.drivers import LEVEL, Sensitivity, drivers_table, sensitivities
from grosmc_mj.studies.campaign.findings import Findings, campaign_result, findings, findings_tables
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.map import PassMap, map_axes, pass_map_chart
from grosmc_mj.studies.campaign.paired import paired, paired_table
from grosmc_mj.studies.campaign.radius import Radius, ScaleTrial, chart
from grosmc_mj.studies.sweep.margin_summary import margin_summary, margins_table
from grosmc_mj.studies.sweep.pass_rates import PassRate, pass_rate, pass_rates_table
from grosmc_mj.studies.sweep.runs import COMPLETED
from grosmc_mj.studies.sweep.sampled import ALL, DESIGN, NO_PROOF, SampledRuns

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
    """The campaign of eight servos."""
    return campaign(servo(), seed=5)


@pytest.fixture(scope="module")
def servo_findings(servos: Folder) -> Findings:
    """Findings of eight servos."""
    return findings(declared(), servos, 0.9)


Columns = dict[str, dict[str, Any]]


@pytest.fixture(scope="module")
def columns(servos: Folder) -> Columns:
    """The columns of eight servos, by law and name."""
    return servos.columns(declared(), COLUMNS, range(2))


EACH_LAW = pytest.mark.parametrize("law", ["lqr", "grosmc"])
EACH_REQUIREMENT = pytest.mark.parametrize(
    ("words", "name"),
    [
        (WORDS, "margin deviation_below"),
        ("input below 10 A", "margin input_below"),
        (ALL, "relative"),
    ],
)


@EACH_LAW
@EACH_REQUIREMENT
def test_rates_are_those_of_the_columns(
    words: str, name: str, law: str, columns: Columns, servo_findings: Findings
) -> None:
    kept_runs = int((columns[law][name] >= 0).sum())
    assert servo_findings.rates[words, law] == pass_rate(kept_runs, 8, 0.9)


@EACH_LAW
@EACH_REQUIREMENT
def test_summaries_are_those_of_the_columns(
    words: str, name: str, law: str, columns: Columns, servo_findings: Findings
) -> None:
    margins = columns[law][name]
    assert servo_findings.summaries[words, law] == margin_summary(margins, 0.9)


@EACH_LAW
def test_runs_that_complete_are_counted(law: str, servo_findings: Findings) -> None:
    assert servo_findings.rates[COMPLETES, law].kept == 8
    assert servo_findings.cut_short[law] == 0


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


def test_the_second_table_has_a_row_for_each_margin(servo_findings: Findings) -> None:
    of_margins = findings_tables(declared(), servo_findings)[1]
    assert len(of_margins.rows) == len(servo_findings.summaries)


def test_the_third_table_has_a_row_for_each_difference(servo_findings: Findings) -> None:
    of_pairs = findings_tables(declared(), servo_findings)[2]
    assert len(of_pairs.rows) == len(servo_findings.differences)


@pytest.fixture(scope="module")
def document(servo_findings: Findings) -> dict[str, Any]:
    """The document of eight servos, as it is written."""
    return json.loads(json_text(campaign_result(declared(), servo_findings)))


@pytest.mark.parametrize(
    "words", ["no proof", "not probabilities", "Intervals and p: of independent runs"]
)
def test_the_document_says_what_it_does_not_show(words: str, document: dict[str, Any]) -> None:
    assert any(words in line for line in document["remarks"])


def test_rates_without_a_failure_have_an_interval_too(document: dict[str, Any]) -> None:
    rates = [rate for rate in document["pass_rates"] if rate["requirement"] == COMPLETES]
    # The lower end is 0.05^(1/8).
    assert [rate["low"] for rate in rates] == pytest.approx([0.05 ** (1 / 8)] * 2, rel=1e-9)
    assert [rate["high"] for rate in rates] == [1.0, 1.0]


OF_EACH = """
[[requirement]]
deviation_below = "3 mrad"
of = ["lqr"]
[[requirement]]
deviation_below = "3 mrad"
of = ["stiff"]
"""


@pytest.mark.parametrize(("found", "verdict"), [(0, "kept"), (1, "not kept")])
def test_a_failing_plant_that_a_search_found_is_a_law_that_is_not_kept(
    servo_findings: Findings, found: int, verdict: str
) -> None:
    """Whatever the runs say: the plant is one of the declared design."""
    law = declared().judged[0]
    every_run = {key: rate._replace(kept=rate.runs) for key, rate in servo_findings.rates.items()}
    kept = replace(servo_findings, rates=every_run)
    answers = campaign_result(declared(), kept, failing=[law] * found).answers
    (of_law,) = [answer.verdict for answer in answers if answer.words.startswith(law)]
    assert of_law == verdict


@pytest.fixture(scope="module")
def separate(tmp_path_factory: pytest.TempPathFactory) -> Findings:
    """Findings where the same requirement stands in a table of each law."""
    split = campaign(servo(laws=PAIR, limits=OF_EACH))
    return findings(split, kept(split, tmp_path_factory.mktemp("split") / "campaign"))


@pytest.mark.parametrize("law", ["lqr", "stiff"])
def test_the_same_requirement_may_stand_in_a_table_of_each_law(
    law: str, separate: Findings
) -> None:
    assert separate.rates[WORDS, law].runs == separate.summaries[WORDS, law].runs


def test_a_requirement_in_a_table_of_each_law_is_compared(separate: Findings) -> None:
    assert (WORDS, "lqr", "stiff") in separate.differences


LAW_THAT_FALLS = "fl-lqr"


@pytest.fixture(scope="module")
def fallen_folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """The folder of sixteen pendulums, of which some fall."""
    return kept(falling(), tmp_path_factory.mktemp("falling"))


@pytest.fixture(scope="module")
def fallen(fallen_folder: Folder) -> Findings:
    """Findings of sixteen pendulums, of which some fall."""
    return findings(falling(), fallen_folder)


@pytest.fixture(scope="module")
def fallen_rows(fallen_folder: Folder) -> dict[str, Any]:
    """Columns of sixteen pendulums, of which some fall."""
    return fallen_folder.columns(falling(), ["status", "relative"], [0])[LAW_THAT_FALLS]


@pytest.fixture(scope="module")
def early(fallen_rows: dict[str, Any]) -> int:
    """Number of pendulums that fell."""
    return int((fallen_rows["status"] != COMPLETED).sum())


def test_runs_that_end_early_are_failures(fallen: Findings, early: int) -> None:
    diverged = fallen.summaries[ALL, LAW_THAT_FALLS].diverged
    assert fallen.cut_short[LAW_THAT_FALLS] == diverged == early > 0
    completed = fallen.rates[COMPLETES, LAW_THAT_FALLS].kept
    assert completed == 16 - early >= fallen.rates[ALL, LAW_THAT_FALLS].kept


def test_runs_that_end_early_are_the_worst(
    fallen: Findings, fallen_rows: dict[str, Any], early: int
) -> None:
    worst = fallen.worst[LAW_THAT_FALLS][:early]
    assert np.all(np.isneginf(fallen_rows["relative"][worst]))


def test_json_has_null_for_the_margin_of_a_run_that_ended_early(
    fallen: Findings, early: int
) -> None:
    content = json.loads(json_text(campaign_result(falling(), fallen)))
    # Beside it stands how many runs ended early.
    diverged = [row["diverged"] for row in content["margins"] if row["least"] is None]
    assert set(diverged) == {early}


@pytest.fixture(scope="module")
def corners(tmp_path_factory: pytest.TempPathFactory) -> Findings:
    """Findings of the four corners of a family."""
    declared = campaign(pair(), sampler="corners", runs=4)
    return findings(declared, kept(declared, tmp_path_factory.mktemp("corners")), 0.9)


# Corners are no independent runs.


def test_a_rate_of_corners_has_no_interval(corners: Findings) -> None:
    rate = corners.rates[ALL, "lqr"]
    assert (rate.runs, rate.low, rate.high) == (4, None, None)


def test_a_difference_of_corners_has_no_interval(corners: Findings) -> None:
    difference = corners.differences[ALL, "lqr", "stiff"]
    assert (difference.low, difference.median_low) == (None, None)


def test_a_difference_of_corners_has_no_p_value(corners: Findings) -> None:
    assert corners.differences[ALL, "lqr", "stiff"].p_value is None


def test_a_mean_of_corners_has_no_interval(corners: Findings) -> None:
    assert {summary.mean_low for summary in corners.summaries.values()} == {None}


def corner_tables(corners: Findings) -> list[Any]:
    """The tables of the four corners."""
    return list(findings_tables(campaign(pair(), sampler="corners", runs=4), corners))


def test_tables_of_corners_show_no_interval(corners: Findings) -> None:
    for table in corner_tables(corners):
        assert "No interval: --sampler corners" in printed(table)
        cells = [cell for row in table.rows for cell in row]
        assert not any(" .. " in cell or "< 1e-4" in cell for cell in cells)


def test_tables_of_corners_are_narrow(corners: Findings) -> None:
    for table in corner_tables(corners):
        assert width(table) <= WIDTH


@pytest.mark.parametrize(
    ("p_value", "words"),
    [
        (0.9 * LEVEL, "lqr: rotor mass scale drives its margin most (11 % of the variance"),
        (1.1 * LEVEL, "lqr: no uncertain number alone drives its margin more than chance would"),
    ],
)
def test_a_number_is_named_as_a_driver_if_its_share_is_no_noise(
    p_value: float, words: str, servo_findings: Findings
) -> None:
    driver = Sensitivity("rotor mass scale", 0.1, 0.11, p_value)
    changed = replace(servo_findings, sensitivities={"lqr": [driver], "grosmc": [driver]})
    remarks = campaign_result(declared(), changed).remarks
    assert any(words in line for line in remarks)


LONG = "stays within 2 deg of a [bracketed] requirement with a very long name from 2 s on"
LAW = "a_law_of_my_own_with_a_very_long_name"
SETTLES = "settles within 4 s"
X = np.arange(400) - 199.5


def printed_lines(table: Any) -> list[str]:
    """The lines of a table as it is printed."""
    console = Console(width=WIDTH, color_system=None)
    with console.capture() as screen:
        console.print(table)
    return screen.get().splitlines()


def printed(table: Any) -> str:
    """A table as it is printed, in one line."""
    return " ".join(" ".join(printed_lines(table)).split())


def width(table: Any) -> int:
    """The length of the longest line of a table as it is printed."""
    return max(len(line.rstrip()) for line in printed_lines(table))


def wide_findings() -> Findings:
    """Findings with long names and large numbers."""
    first = np.array([-1.0] * 6 + [1.0])
    second = np.array([0.5] * 6 + [1.0])
    many = np.array([-INF, *np.linspace(-123456, 0.001234, 999)])
    drivers = {"start [angle]": X, LONG: np.ones(400), "mass": np.abs(X)}
    return Findings(
        sampled=SampledRuns(512, 4096, "random", 7),
        rates={
            (SETTLES, "grosmc"): pass_rate(512, 512),
            (SETTLES, "lqr"): pass_rate(5119, 5120),
            (LONG, LAW): pass_rate(99999, 100000),
            (LONG, "lqr"): pass_rate(0, 512),
        },
        cut_short={"lqr": 25},
        summaries={
            (SETTLES, "grosmc"): margin_summary(np.linspace(0.5, 1.5, 101)),
            (LONG, LAW): margin_summary(many),
        },
        differences={
            (SETTLES, "lqr", "grosmc"): paired(first, second),
            (LONG, LAW, "lqr"): paired(np.array([1.0]), np.array([-INF])),
        },
        sensitivities={LAW: sensitivities(drivers, -np.abs(X))},
        worst={},
        units={SETTLES: "s", LONG: "deg"},
        screening={},
    )


WIDE = wide_findings()
RATES = pass_rates_table(WIDE.rates, WIDE.summaries, WIDE.units, WIDE.sampled)
MARGINS_OF_WIDE = margins_table(WIDE.summaries, WIDE.units, WIDE.sampled)
PAIRS_OF_WIDE = paired_table(WIDE.differences, WIDE.units, WIDE.sampled)
DRIVERS = drivers_table(LAW, WIDE.sensitivities[LAW], WIDE.sampled)


EACH_TABLE = pytest.mark.parametrize(
    "table",
    [
        RATES,
        MARGINS_OF_WIDE,
        PAIRS_OF_WIDE,
        DRIVERS,
    ],
)


@EACH_TABLE
def test_a_table_is_narrow(table: Any) -> None:
    assert width(table) <= WIDTH


@EACH_TABLE
def test_a_table_says_what_it_rests_on(table: Any) -> None:
    assert f"512 of 4096 runs, random, seed 7. {NO_PROOF} {DESIGN}" in printed(table)


def test_the_requirement_that_fails_most_comes_first() -> None:
    assert [row[2] for row in RATES.rows] == [
        "0 of 512",
        "5119 of 5120",
        "99999 of 100000",
        "512 of 512",
    ]


def test_a_pass_rate_is_shown_with_its_interval_and_least_margin() -> None:
    row = RATES.rows[-1]
    assert row == [SETTLES, "grosmc", "512 of 512", "100", "99.28 .. 100.00", "0.5 s"]


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [(0.123499, 0.987601, "12.34 .. 98.77"), (0.12345, 0.9876, "12.34 .. 98.76")],
)
def test_an_interval_is_rounded_outwards(low: float, high: float, shown: str) -> None:
    """So the one that is shown covers the exact one."""
    assert PassRate(3, 4, 0.75, low, high, 0.95).interval("..") == shown


def test_only_all_of_the_runs_are_100_percent_and_only_none_is_0() -> None:
    assert [row[3] for row in RATES.rows] == ["0", "99.98", "99.99", "100"]


def test_margins_are_shown_with_their_unit() -> None:
    settles, long = MARGINS_OF_WIDE.rows
    assert settles[2:6] == ["0.5", "0.525", "0.51", "0.55"]
    assert settles[-1] == "s"
    assert long[2] == "-inf"


def test_plants_that_one_law_alone_keeps_are_shown() -> None:
    settles, _ = PAIRS_OF_WIDE.rows
    assert settles[2:4] == ["0", "6"]


def test_a_difference_of_pass_rates_is_shown_with_its_interval() -> None:
    settles, _ = PAIRS_OF_WIDE.rows
    assert settles[4].startswith("+85.7\n(")


def test_a_difference_of_margins_is_shown_with_its_unit() -> None:
    settles, _ = PAIRS_OF_WIDE.rows
    assert settles[6].startswith("+1.5 s\n(")


def test_an_infinite_difference_of_margins_has_infinite_bounds() -> None:
    _, long = PAIRS_OF_WIDE.rows
    assert long[6] == "-inf deg\n(-inf .. +inf)"


def test_drivers_are_shown_with_their_correlation() -> None:
    rows = DRIVERS.rows
    assert [row[0] for row in rows] == ["mass", "start [angle]", LONG]
    assert rows[0][3] == "-1.00"
    assert rows[2] == [LONG, "-", "", "-", "the number does not vary"]


MARGINS = np.array([-INF, -INF, -0.5, 0.0, 0.5, 0.75, 1.0, 1.25])
OUTCOMES = {
    "kept": MARGINS >= 0,
    "failed": MARGINS == -0.5,
    "did not complete": MARGINS == -INF,
}
MAP_X = np.linspace(1, 4, 8)
MAP_Y = np.linspace(-20, 20, 8)
TITLES = ("mass scale [1]", "angle [deg]")


@pytest.fixture(scope="module")
def map_figure() -> Any:
    """The figure of a map of eight plants under two laws."""
    laws = {"grosmc": (MAP_X, MAP_Y, MARGINS), "lqr": (MAP_X, MAP_Y, MAP_X)}
    return drawn(pass_map_chart(PassMap(TITLES, laws), "8 of 16 runs", NO_PROOF))


def test_a_map_marks_plants_by_their_outcome(map_figure: Any) -> None:
    marks = map_figure.axes[0].lines
    assert len(marks) == 3
    for mark, (outcome, plants) in zip(marks, OUTCOMES.items(), strict=True):
        assert mark.get_label() == outcome
        expected = np.stack([MAP_X, MAP_Y], axis=1)[plants]
        np.testing.assert_array_equal(mark.get_xydata(), expected)


def test_the_legend_of_a_map_names_the_outcomes(map_figure: Any) -> None:
    (legend,) = map_figure.legends
    assert [entry.get_text() for entry in legend.get_texts()] == list(OUTCOMES)


def test_marks_of_a_map_differ_in_colour(map_figure: Any) -> None:
    assert len({mark.get_color() for mark in map_figure.axes[0].lines}) == 3


def test_marks_of_a_map_differ_in_form(map_figure: Any) -> None:
    assert len({mark.get_marker() for mark in map_figure.axes[0].lines}) == 3


def test_a_map_counts_the_plants_that_are_kept(map_figure: Any) -> None:
    first, second = map_figure.axes
    assert first.get_title(loc="left") == "grosmc: 5 of 8 kept"
    assert second.get_title(loc="left") == "lqr: 8 of 8 kept"
    assert (first.get_xlabel(), first.get_ylabel()) == TITLES


def test_a_map_is_over_the_named_numbers(servo_findings: Findings) -> None:
    mass, load = declared().family.quantities
    assert map_axes(declared(), servo_findings) == (mass, load)
    assert map_axes(declared(), servo_findings, [load.name, mass.name]) == (load, mass)


PHASE = """
[[uncertain]]
number = "disturbance.hum.phase"
values = ["0 rad", "1 rad"]
"""


def test_a_map_is_over_the_two_numbers_that_drive_margins_most(servo_findings: Findings) -> None:
    three = campaign(servo(BOTH + PHASE))
    mass, load, phase = three.family.quantities
    # The mass explains least under every law.
    drivers = {
        "lqr": [
            Sensitivity(mass.name, share=0.1),
            Sensitivity(load.name, share=0.3),
            Sensitivity(phase.name, share=0.0),
        ],
        "grosmc": [
            Sensitivity(mass.name, share=0.2),
            Sensitivity(load.name, share=0.1),
            Sensitivity(phase.name, share=0.9),
        ],
    }
    changed = replace(servo_findings, sensitivities=drivers)
    assert map_axes(three, changed) == (load, phase)


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

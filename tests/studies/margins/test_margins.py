"""The margins study: its setups, sizes, rows, tables, document, command and refusals."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import cases
import numpy as np
import pytest
from commands import Screen, assert_one_line, run

from grosmc_mj import cli
from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.charts.chart import Curve, Marks
from grosmc_mj.output.charts.of_results import panels_chart
from grosmc_mj.output.palette import INK
from grosmc_mj.output.results.result import LineChart
from grosmc_mj.output.results.verdicts import Verdict
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.studies.margins import figure as margins_figure
from grosmc_mj.studies.margins import margins as studies
from grosmc_mj.studies.margins import row as rows_of_laws
from grosmc_mj.studies.margins.answer import margin_table, notes, sheets, verdict
from grosmc_mj.studies.margins.changes import DELAY, GAIN_DOWN, GAIN_UP, ChangeSearch
from grosmc_mj.studies.margins.chatter import Chatter
from grosmc_mj.studies.margins.frequency_response import LoopGain, Margins, margins_of
from grosmc_mj.studies.margins.margins import MarginStudy, law_margins, margin_study
from grosmc_mj.studies.margins.row import LEVELS, LawMargins, Level
from grosmc_mj.studies.margins.sensitivity import LoopPlace
from grosmc_mj.studies.study import CellRunner

# A step of the servo through an encoder and an observer, on which the implicit law chatters.
STEP: Mapping[str, Any] = {
    "run": {
        "start": {"rotor angle": "0 rad"},
        "duration": "4 s",
        "control_period": "2 ms",
        "timestep": "2 ms",
    },
    "actuator": {"of": "current", "limit": "4 A"},
    "requirement": {"stays_within": "0.1 rad", "after": "3 s"},
}
LOOP: Mapping[str, Any] = {
    "computing": {"delay": "2 ms"},
    "sensor": {"of": "rotor angle", "resolution": "1.534 mrad"},
    "estimator": {"of": "rotor speed", "law": "eso", "bandwidth": "100 rad/s"},
}
IMPLICIT = {"law": "grosmc", "switching": "implicit", "surface": "discrete"}
FREQUENCY = np.geomspace(0.1, 100, 40)


@cache
def servo() -> MarginStudy:
    """Return the servo's bench with two laws."""
    return margin_study("servo/bench", ["lqr", "implicit"])


def step(folder: Path, **tables: Any) -> str:
    """Write the case of the step, and return its path."""
    return str(cases.write(folder, **(dict(STEP) | tables)))


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[MarginStudy, LawMargins, LawMargins]:
    """The study of the step through the encoder, with its rows of LQR and the implicit law."""
    laws = [{"law": "lqr"}, {"name": "implicit", **IMPLICIT}]
    target = step(tmp_path_factory.mktemp("step"), **LOOP, controller=laws)
    studied = margin_study(target, period="2 s")
    setup = studied.setups[1]
    lqr, implicit = [law_margins(studied, setup, law) for law in setup.laws]
    return studied, lqr, implicit


def level(index: int, doubt: str = "", gain: float = 1.0, output: bool = False) -> Level:
    """Return S of an integrator at one amplitude."""
    S = 1 / (1 + gain / (2j * np.pi * FREQUENCY))
    return Level(
        place="current",
        output=output,
        rms=float(LEVELS[index]),
        unit="A",
        margins=margins_of(FREQUENCY, S),
        errors=Margins(*[0.0] * len(fields(Margins))),
        doubt=doubt,
        frequency=FREQUENCY.tolist(),
        real=S.real[:, None].tolist(),
        imaginary=S.imag[:, None].tolist(),
        index=0,
    )


def row(law: str, doubts: str, **changes: Any) -> LawMargins:
    """Return a row whose amplitudes are doubted where a letter is x."""
    levels = [level(i, "noise" if letter == "x" else "") for i, letter in enumerate(doubts)]
    return LawMargins(setup="servo/bench", law=law, levels=levels, **changes)


def test_a_case_is_studied_in_an_ideal_loop_and_in_its_own() -> None:
    assert [setup.name for setup in servo().setups] == ["servo/bench, ideal loop", "servo/bench"]


def test_a_system_is_studied_on_its_bench_and_its_machine() -> None:
    studied = margin_study("servo", ["lqr"])
    names = [setup.name for setup in studied.setups]
    assert names == ["servo/bench, ideal loop", "servo/bench", "servo/machine"]
    assert [setup.plant_name for setup in studied.setups] == ["corrected", "corrected", "physics"]
    assert all(condition.experiment.parts for condition in studied.setups[2].conditions)


def test_the_laws_of_a_file_are_studied_by_the_names_that_it_gives_them(tmp_path: Path) -> None:
    """The second one is GROSMC with the implicit law, and is not studied again by that name."""
    target = step(tmp_path, controller=[{"law": "lqr"}, IMPLICIT])
    own = [law.name for law in margin_study(target).setups[0].laws]
    assert own == ["lqr", "grosmc"]
    further = [law.name for law in margin_study(target, further=True).setups[0].laws]
    assert further[:2] == own
    assert "implicit" not in further
    assert {"sign", "super-twisting", "implicit, predicted"} <= set(further)


def test_a_switching_law_leaves_its_name_to_another_law_of_the_file(tmp_path: Path) -> None:
    """A law that is called sign and does not chatter is no sign law."""
    lqr = {"name": "sign", "law": "lqr", "R": 2}
    target = step(tmp_path, controller=[lqr, {"law": "grosmc", "surface": "discrete"}])
    laws = margin_study(target, further=True).setups[0].laws
    switching = {law.name: law.controller.designed.switching for law in laws}
    assert len(switching) == len(laws)
    assert not switching["sign"]
    assert switching["grosmc sign"] == "sign"


def test_an_input_gets_a_quarter_of_its_limit_and_a_state_a_quarter_of_its_range() -> None:
    """The servo steps by 1 rad; its encoder is the only sensor."""
    places = servo().places(servo().setups[1])
    assert places[LoopPlace("current")] == 1.0
    assert places[LoopPlace("rotor angle", output=True)] == pytest.approx(0.25, rel=0.05)
    assert len(places) == 2


@pytest.mark.slow
def test_on_the_bench_the_delay_of_a_law_by_its_signals_is_near_that_of_its_task() -> None:
    """LQR is linear; slow signals see the implicit law between the switching."""
    setup = servo().setups[1]
    lqr, implicit = [law_margins(servo(), setup, law) for law in setup.laws]
    (linear,) = lqr.at(len(LEVELS) - 1)
    assert linear.margins.delay == pytest.approx(0.113, rel=0.01)
    assert linear.margins.disk == pytest.approx(1.52, rel=0.01)
    (slow,) = implicit.at(len(LEVELS) - 1)
    assert slow.margins.delay == pytest.approx(9.2e-3, abs=3 * 0.25e-3)
    assert slow.errors.delay < 0.4e-3
    worst = implicit.worst_of_task(DELAY)
    assert worst is not None
    assert (worst.condition, worst.largest_kept) == ("case1", pytest.approx(8e-3, abs=5e-4))
    rows = margin_table(setup, [lqr, implicit]).rows
    assert [row[:2] for row in rows] == [["lqr", "case1"], ["implicit", ""]]
    assert rows[0][2] == "1/2.44 case2"


def test_the_delay_of_a_linear_law_by_its_signals_is_that_of_its_task(
    small: tuple[MarginStudy, LawMargins, LawMargins],
) -> None:
    """Nominally it is kept up to 108 ms."""
    _, lqr, _ = small
    (largest,) = lqr.at(len(LEVELS) - 1)
    (nominal,) = [v for v in lqr.changes if v.step == DELAY and v.condition == "nominal"]
    assert largest.margins.delay == pytest.approx(0.1116, rel=0.01)
    assert nominal.largest_kept == pytest.approx(largest.margins.delay, rel=0.05)
    assert [refused.condition for refused in lqr.refused] == ["case1"]
    assert not lqr.switches


def test_a_small_injection_into_a_chattering_loop_is_not_trusted(
    small: tuple[MarginStudy, LawMargins, LawMargins],
) -> None:
    _, _, implicit = small
    assert implicit.chatter == Chatter(True, 1.0, 0.0)
    assert 0 not in implicit.trusted
    assert len(LEVELS) - 1 in implicit.trusted


def test_rows_are_read_as_they_were_written(
    tmp_path: Path, small: tuple[MarginStudy, LawMargins, LawMargins]
) -> None:
    studied, lqr, _ = small
    *_, cell, other = studied.cells()
    stored = CellRunner(tmp_path, LawMargins)
    stored.write(cell, lqr)
    found = stored.read(cell)
    assert found is not None
    assert found.task == lqr.task
    assert found.levels[0].column.tolist() == lqr.levels[0].column.tolist()
    assert stored.read(other) is None


SWITCHES = Chatter(True, 1.0, 0.0)


@pytest.mark.parametrize(
    ("doubts", "shared"),
    [(["-----", "xx---"], 2), (["xxxxx", "x----"], 1), (["xxxxx"], None)],
)
def test_laws_that_switch_are_shown_at_the_lowest_amplitude_that_all_of_them_allow(
    doubts: list[str], shared: int | None
) -> None:
    rows = [row(f"law{i}", letters, chatter=SWITCHES) for i, letters in enumerate(doubts)]
    assert rows_of_laws.shared_level(rows) == shared


def test_a_law_that_does_not_switch_is_shown_at_its_smallest_trusted_amplitude() -> None:
    """S of a linear law is that of small signals; others do not move it to a larger one."""
    linear = row("linear", "x----")
    switching = row("switching", "xxx--", chatter=SWITCHES)
    shared = rows_of_laws.shared_level([linear, switching])
    assert linear.level_index(shared) == 1
    assert switching.level_index(shared) == 3


def test_a_law_that_cannot_be_trusted_at_the_shared_amplitude_is_marked() -> None:
    rows = [
        row("first", "--xxx", chatter=SWITCHES),
        row("second", "xxx--", chatter=SWITCHES),
        row("linear", "-----"),
    ]
    cells = margin_table(servo().setups[1], rows).rows
    assert cells[0][4].endswith("*")
    assert not cells[1][4].endswith("*")
    assert not cells[2][4].endswith("*")


@pytest.mark.parametrize(
    ("factor", "error", "says"),
    [(1.24, 0.0, False), (1.26, 0.0, True), (2.0, 0.49, True), (2.0, 0.51, False)],
)
def test_trusted_amplitudes_that_disagree_by_more_than_their_errors_are_named(
    factor: float, error: float, says: bool
) -> None:
    levels = []
    for index in range(len(LEVELS)):
        found = level(index)
        delay = found.margins.delay * (factor if index else 1.0)
        margins = replace(found.margins, delay=delay)
        errors = replace(found.errors, delay=error * found.margins.delay)
        levels.append(found.model_copy(update={"margins": margins, "errors": errors}))
    law = LawMargins(setup="servo/bench", law="implicit", levels=levels, chatter=SWITCHES)
    assert any("depends on the amplitude" in note for note in notes([law])) == says
    (cells,) = margin_table(servo().setups[1], [law]).rows
    assert (" to " in cells[4]) == says


# Margins that differ from each other, and their errors.
SHOWN = Margins(0.25, 4.5, 61.5, 0.0125, 0.75, 0.625, 3.25, 1.75)
ERRORS = Margins(0.0, 0.3, 0.4, 0.0005, 0.0, 0.003, 0.0, 0.0)


def test_the_table_shows_delay_phase_disk_and_bandwidth_with_errors_beyond_half_a_percent() -> None:
    """Of a disk margin of 0.625 half a percent is 0.0031."""
    shown = level(0).model_copy(update={"margins": SHOWN, "errors": ERRORS})
    law = LawMargins(setup="servo/bench", law="lqr", levels=[shown] * len(LEVELS))
    table = margin_table(servo().setups[1], [law])
    assert table.rows[0][4:] == ["12.5±0.5", "61.5±0.4", "0.625", "1.75"]
    assert [column.header for column in table.columns[4:]] == [
        "delay by\nS [ms]",
        "phase\n[°]",
        "disk",
        "bandwidth\n[Hz]",
    ]


def test_the_table_of_amplitudes_has_each_margin_under_its_name() -> None:
    shown = level(0).model_copy(update={"margins": SHOWN, "errors": ERRORS})
    law = LawMargins(setup="servo/bench", law="lqr", levels=[shown] * len(LEVELS))
    table = sheets(servo(), [law])[2].table
    headers = [column.header for column in table.columns]
    assert dict(zip(headers, table.rows[0], strict=True)) == {
        "law": "lqr",
        "injected at": "current",
        "rms": "0.01 A",
        "gain down": "0.25",
        "gain up": "4.5±0.3",
        "phase [°]": "61.5±0.4",
        "delay [ms]": "12.5±0.5",
        "modulus": "0.75",
        "disk": "0.625",
        "crossover [Hz]": "3.25",
        "bandwidth [Hz]": "1.75",
        "not trustworthy, because": "",
    }


def test_the_answer_names_the_laws_with_the_least_and_the_most_delay_of_the_last_setup() -> None:
    """Of each law the condition with the least delay counts."""
    delays = {"quick": (2.5e-3, 0.3), "middle": (9e-3, 8e-3), "slow": (0.5, 40e-3)}
    rows = [row("first", "-----").model_copy(update={"setup": "servo/bench, ideal loop"})]
    for law, kept in delays.items():
        task = [Verdict(law=law, step=DELAY, largest_kept=delay) for delay in kept]
        rows.append(row(law, "-----", task=task))
    rows.append(row("failing", "-----"))
    assert verdict(rows) == (
        "Without any change failing: not kept. servo/bench: quick tolerates 2.5 ms more delay, "
        "slow 40 ms."
    )


def test_a_law_without_a_trusted_amplitude_is_said_to_have_none() -> None:
    untrusted = row("sign", "xxxxx")
    assert notes([untrusted]) == ["sign: S is not trustworthy, because noise"]
    assert margin_table(servo().setups[1], [untrusted]).rows[0][4:] == ["-"] * 4


@pytest.mark.parametrize(
    ("chatter", "words"),
    [
        (Chatter(True, 1.0, 0.0), "chatters at rest; S tells how it answers slow signals"),
        (Chatter(False, 2.0, 1e-3), "begins to chatter at gain 2, delay 1 ms"),
        (Chatter(False, math.inf, math.inf), "does not chatter"),
    ],
)
def test_it_is_said_where_a_law_chatters(chatter: Chatter, words: str) -> None:
    both = [row("a, predicted", "-----", chatter=chatter), row("b", "-----", chatter=chatter)]
    assert notes(both) == [f"a, predicted; b: {words}"]


@pytest.mark.parametrize(
    ("kind", "failed", "words"),
    [
        (GAIN_DOWN, 3.0, "1/2.5 case2"),
        (GAIN_UP, 3.0, "2.5 case2"),
        (GAIN_UP, math.inf, "≥2.5"),
        (GAIN_DOWN, math.inf, "≤1/2.5"),
        (DELAY, 3.0, "2000 case2"),
    ],
)
def test_a_margin_is_shown_with_the_case_that_decides(kind: str, failed: float, words: str) -> None:
    """The nominal margin is larger."""
    search = ChangeSearch(kind, Loop(), [], 1.0)
    kept = 2.0 if kind == DELAY else 2.5
    search.known |= {kept: True}
    if math.isfinite(failed):
        search.known |= {failed: False}
    decides = Verdict(
        step=kind,
        condition="case2",
        largest_kept=kept,
        smallest_failed=search.failed,
        text=search.text,
    )
    task = [decides.changed(condition="nominal", largest_kept=9.0), decides]
    cells = margin_table(servo().setups[1], [row("lqr", "-----", task=task)]).rows[0]
    assert words in cells[1:4]


def test_of_several_inputs_the_one_with_the_least_disk_margin_is_shown() -> None:
    (setup, *_) = margin_study("two_link_arm/nominal", ["lqr"]).setups
    levels = []
    for place, disk, phase in (("torque 1", 0.9, 50.0), ("torque 2", 0.4, 70.0)):
        margins = replace(SHOWN, disk=disk, phase=phase)
        levels += [
            level(i).model_copy(update={"place": place, "margins": margins}) for i in range(5)
        ]
    law = LawMargins(setup=setup.name, law="lqr", levels=levels)
    table = margin_table(setup, [law])
    cells = dict(zip([column.header for column in table.columns], table.rows[0], strict=True))
    assert (cells["disk"], cells["phase\n[°]"]) == ("0.4", "70")


def test_inputs_that_do_not_meet_have_the_least_of_their_disk_margins_together() -> None:
    """Only lines that count at both inputs are taken."""
    slow = level(0)
    fast = level(0, gain=30.0)
    zeros = [0.0] * len(FREQUENCY)
    first = {"real": np.stack([np.ravel(slow.real), zeros], axis=1).tolist()}
    first |= {"imaginary": np.stack([np.ravel(slow.imaginary), zeros], axis=1).tolist()}
    second = {"real": np.stack([zeros, np.ravel(fast.real)], axis=1).tolist()[3:]}
    second |= {"imaginary": np.stack([zeros, np.ravel(fast.imaginary)], axis=1).tolist()[3:]}
    second |= {"frequency": FREQUENCY.tolist()[3:]}
    both = [slow.model_copy(update=first), fast.model_copy(update=second)]
    assert rows_of_laws.together(both) == pytest.approx(2.0, rel=0.01)
    assert rows_of_laws.together([both[0], both[1].model_copy(update={"frequency": []})]) is None


def integrator(delay: float, turns: int = 0) -> LoopGain:
    """Return 1/s with a delay [s], whose phase is a number of turns off."""
    s = 2j * np.pi * FREQUENCY
    L = np.exp(-s * delay) / s
    phase = np.unwrap(np.angle(L)) + 2 * np.pi * turns
    return LoopGain(FREQUENCY, np.log(np.abs(L)), phase)


@pytest.mark.parametrize("turns", [-1, 0, 2])
def test_the_distance_of_the_phase_from_the_line_at_the_crossover_is_the_phase_margin(
    turns: int,
) -> None:
    """1/s crosses at 1/(2 pi) Hz with -90 degrees, whichever branch the measurement has."""
    loop = integrator(0.0, turns)
    margins = margins_of(FREQUENCY, 1 / (1 + loop.L))
    phase = margins_figure._phase(loop, margins)
    assert phase == pytest.approx(np.full(len(FREQUENCY), -90.0))
    assert phase[0] + 180 == pytest.approx(margins.phase, abs=0.5)


def of_size(size: Array) -> list[LineChart]:
    """Return the charts of a loop with L = -i |L|, from |L| at each frequency."""
    S = 1 / (1 - 1j * size)
    parts = {"real": S.real[:, None].tolist(), "imaginary": S.imag[:, None].tolist()}
    shown = level(0).model_copy(update=parts)
    law = LawMargins(setup="servo/bench", law="lqr", levels=[shown] * len(LEVELS))
    return margins_figure.charts(servo().setups[1], [law], ["lqr"])


@pytest.mark.parametrize(("slow", "fast"), [(2.0, 0.5), (0.5, 2.0)])
def test_a_curve_ends_at_the_first_gap_on_either_side_of_its_largest_value(
    slow: float, fast: float
) -> None:
    """Beyond the gap the phase may be a turn off."""
    notch = (FREQUENCY > 1) & (FREQUENCY < 3)
    gain, phase, _, _ = of_size(np.select([notch, FREQUENCY < 1], [0.01, slow], fast))
    sides = {float(f) < 1.5 for f in gain.lines[0].x}
    assert sides == {slow > fast}
    assert phase.lines[0].x == gain.lines[0].x


def test_points_beyond_an_edge_are_not_joined_across_it() -> None:
    _, _, nyquist, _ = of_size(np.where((FREQUENCY > 1) & (FREQUENCY < 3), 5.0, 1.0))
    assert list(nyquist.lines[0].y).count(None) == 1


def test_laws_beyond_six_get_a_figure_of_their_own() -> None:
    assert margins_figure.in_figures("abcdefghab") == [list("abcdef"), list("gh")]


def test_six_laws_of_a_figure_have_each_a_colour_and_a_symbol() -> None:
    """And the point -1 and the disk margin of all are drawn without."""
    names = [f"law {i}" for i in range(6)]
    charts = margins_figure.charts(servo().setups[1], [row(name, "-----") for name in names], names)
    gain, phase, nyquist, _ = panels_chart("L", [charts]).panels
    curves = [layer for layer in gain.layers if isinstance(layer, Curve)]
    assert [curve.name for curve in curves] == names
    assert len({curve.stroke.colour for curve in curves}) == 6
    assert len({curve.symbol for curve in curves}) == 6
    assert phase.y.scale == "linear"
    (point,) = [layer for layer in nyquist.layers if isinstance(layer, Marks)]
    assert (point.x, point.y) == ([-1.0], [0.0])
    (disk,) = [layer for layer in nyquist.layers if layer.name == "disk margin"]
    assert isinstance(disk, Curve)
    assert (disk.symbol, disk.stroke.colour) == ("", INK)


def test_the_delay_margin_over_the_amplitude_is_in_milliseconds_and_hollow_where_doubted() -> None:
    levels = [level(i, "noise" if i == 1 else "") for i in range(len(LEVELS))]
    shown = [one.model_copy(update={"margins": SHOWN}) for one in levels]
    law = LawMargins(setup="servo/bench", law="lqr", levels=shown)
    (series,) = margins_figure.charts(servo().setups[1], [law], ["lqr"])[3].lines
    assert series.x == pytest.approx(LEVELS, rel=1e-2)
    assert series.y == [12.5] * 5
    assert series.good == [True, False, True, True, True]


def test_the_disk_that_is_drawn_passes_the_axis_at_the_least_gains() -> None:
    """A gain from (2 - a)/(2 + a) to (2 + a)/(2 - a) is allowed."""
    disk = margins_figure._disk(0.5)
    x = [value for value in disk.x if isinstance(value, float)]
    assert min(x) == pytest.approx(-2.5 / 1.5)
    assert max(x) == pytest.approx(-1.5 / 2.5)


def test_the_command_prints_its_answer_and_resumes(
    tmp_path: Path, printed: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Late by two samples, but linear.
    step(tmp_path, computing={"delay": "4 ms"})
    command = ("study", "margins", "mine.toml", "--laws", "lqr", "--period", "1 s", "--verbose")
    assert run(*command, "--out", "out") == cli.DONE
    path = tmp_path / "out" / "margins_mine.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    assert (document["kind"], document["complete"]) == ("margins", True)
    assert [row["setup"] for row in document["rows"]] == ["servo/mine, ideal loop", "servo/mine"]
    assert path.with_suffix(".png").exists()
    assert path.with_suffix(".svg").exists()

    monkeypatch.setattr(studies, "_task_margins", lambda *_: pytest.fail("measured again"))
    printed(*command, "--resume", "--no-figures", "--out", "out")


def test_a_law_that_the_file_does_not_run_stops_no_other_one(
    tmp_path: Path, small: tuple[MarginStudy, LawMargins, LawMargins]
) -> None:
    """It raises an error in its first step; that is said in its row."""
    code = "def beyond(t, x, memory, p, u):\n    u[0] = u[5] = 1.0\n"
    (tmp_path / "mine.py").write_text(code)
    studied = margin_study(step(tmp_path, laws={"wrong": {"law": "mine:beyond"}}), ["wrong"])
    (law,) = studied.setups[1].laws
    wrong = law_margins(studied, studied.setups[1], law)
    assert "IndexError" in wrong.impossible
    _, lqr, _ = small
    assert verdict([wrong, lqr]).startswith("Without any change wrong: not kept. ")


@pytest.mark.parametrize(
    ("without", "options", "words"),
    [
        ("requirement", (), "nothing is required"),
        ("actuator", (), "has no limit to size"),
        ("", ("--injection", "5 A"), "is beyond the limit of current, 4 A"),
        ("", ("--injection", "1 N m"), "1 N m"),
        ("", ("--injection=-1 A",), "must be positive"),
        ("", ("--period", "10 ms"), "at least 16 control periods"),
        ("", ("--laws", "nobody"), "unknown law 'nobody'"),
        ("", ("--laws", "lqr", "--all"), "leave out --all"),
    ],
)
def test_a_mistake_gets_one_line(
    without: str, options: tuple[str, ...], words: str, tmp_path: Path, capsys: Screen
) -> None:
    tables = {name: table for name, table in STEP.items() if name != without}
    target = cases.write(tmp_path, **tables)
    assert run("study", "margins", target, *options, "--out", tmp_path) == cli.WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert words in error


def test_an_unknown_target_gets_one_line(capsys: Screen) -> None:
    assert run("study", "margins", "servo/nowhere") == cli.WRONG
    assert_one_line(capsys.readouterr().err)


@pytest.mark.slow
def test_a_loop_that_leaves_its_region_under_an_injection_gets_one_line(
    tmp_path: Path, capsys: Screen
) -> None:
    """The feedback linearization of the pendulum is undefined at the horizontal."""
    options = ("--laws", "fl-lqr", "--injection", "400 N", "--period", "2 s", "--out", tmp_path)
    assert run("study", "margins", "cart_pendulum/bench", *options) == cli.WRONG
    # On a slow computer lines of progress stand before it.
    error = capsys.readouterr().err.splitlines(keepends=True)[-1]
    assert_one_line(error)
    assert "leaves its region under an injection of 400 N rms" in error

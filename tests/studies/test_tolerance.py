"""Tolerances: the search, known margins, both engines, the tables, the command."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from grosmc_mj import cli, executors
from grosmc_mj.errors import ArgumentError
from grosmc_mj.executors import Batch, Processes
from grosmc_mj.loop import Loop
from grosmc_mj.results.charts import write_cells
from grosmc_mj.results.document import json_text
from grosmc_mj.studies import tolerance
from grosmc_mj.studies.studied import Condition, judgeable_in
from grosmc_mj.studies.tolerance import (
    BEYOND,
    LEAST,
    MOST,
    NOTE,
    RESOLUTION,
    Setting,
    Tolerance,
    Trial,
    TrialResult,
    Trials,
    charts,
    geometric_mean,
    least_of,
    least_table,
    resolved,
    setting,
    tolerance_document,
    tolerances,
    tolerances_of_laws,
    tolerances_text,
    verdict,
)
from grosmc_mj.sweep.search import Search

DELAY = 0.05
FILE = f"""
[plant]
system = "servo"
[run]
start = {{ "rotor angle" = "0 rad" }}
duration = "60 s"
control_period = "5 ms"
timestep = "5 ms"
[computing]
delay = "{DELAY} s"
[[controller]]
law = "lqr"
[[requirement]]
stays_within = "0.5 rad"
after = "50 s"
"""
SHORT = FILE.replace("60 s", "2 s").replace("50 s", "1 s")
INFINITE = math.inf


def of_file(tmp_path: Path, text: str = FILE, *laws: str) -> Setting:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    studied = setting(str(path), laws or ["lqr"])
    return replace(studied, conditions=studied.conditions[:1])


def searched(most: float = MOST, **options: Any) -> Search:
    return Search(most, geometric_mean, resolved, least=LEAST, **options)


def answered(search: Search, keeps: Callable[[float], bool]) -> Search:
    while factors := search.on_grid(BEYOND):
        assert not set(factors) & set(search.known)
        search.known |= {factor: keeps(factor) for factor in factors}
    return search


@pytest.mark.parametrize(
    ("keeps", "bound", "again"),
    [
        *((lambda x, b=b: x <= b, b, []) for b in (0.07, 0.9, 1.0, 3.3, 700.0)),
        (lambda x: x <= 3 or 8 <= x <= 16, 3, [(8, 16)]),
        # The first failure counts though larger amounts are kept.
        (lambda x: not 0.2 < x < 0.3, 0.2, [(0.5, MOST)]),
    ],
)
def test_the_bound_is_searched_from_below(
    keeps: Callable[[float], bool], bound: float, again: list[tuple[float, float]]
) -> None:
    search = answered(searched(), keeps)
    assert search.largest is not None
    assert search.failed is not None
    assert search.largest <= bound < search.failed <= search.largest * RESOLUTION * 1.001
    assert search.again == again


def test_nothing_breaks_it_and_everything_does_and_a_bound_ends_the_grid() -> None:
    kept, never = answered(searched(), lambda _: True), answered(searched(), lambda _: False)
    assert (kept.largest, kept.failed) == (MOST, None)
    assert (never.largest, never.failed, never.again) == (None, LEAST, [])
    bounded = answered(searched(3.0), lambda _: True)
    assert sorted(bounded.known) == [0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 3.0]


def test_times_on_a_grid_are_tried_once() -> None:
    search = searched(same=lambda factor: round(4 * factor))
    answered(search, lambda factor: round(4 * factor) <= 5)
    assert (round(4 * (search.largest or 0)), round(4 * (search.failed or 0))) == (5, 6)


@pytest.mark.parametrize("begin", [0.5, 40.0])
def test_physics_walks_from_where_the_equations_end(begin: float) -> None:
    search = searched()
    search.known[begin] = begin <= 5
    while factors := search.factors():
        search.known |= {factor: factor <= 5 for factor in factors}
    assert search.largest is not None
    assert search.failed is not None
    assert search.largest <= 5 < search.failed <= search.largest * RESOLUTION * 1.001


def test_each_number_of_a_bench_is_an_imperfection() -> None:
    studied = setting("servo")
    found = {x.name: x for x in studied.imperfections}
    assert list(found) == [
        "computing delay", "computing jitter", "computing missed", "sensor resolution",
        "actuator resolution", "actuator limit", "actuator lag", "estimated rates",
        "sensor resolution, estimated rates", "all",
    ]  # fmt: skip
    assert [each.name for each in studied.conditions] == ["nominal", "case1", "case2"]
    jitter, limit, whole = found["computing jitter"], found["actuator limit"], found["all"]
    assert jitter.at(jitter.most).computing.jitter < studied.experiment.settings.control_period
    assert limit.at(4.0).actuators[0].limit == 1.0
    assert limit.at(0.0).actuators[0].limit == INFINITE
    assert whole.at(1.0) == studied.bench
    assert whole.at(2.0).estimators == studied.bench.estimators
    delay = found["computing delay"]
    assert (delay.text(4.4), delay.heading) == ("4.5", "computing delay [ms]")


def test_of_all_together_each_amount_ends_at_its_bound() -> None:
    """In proportion until there: one sample in a hundred comes through, times are below 1 s."""
    studied = setting("servo")
    whole = studied.imperfections[-1]
    settings, bench = studied.experiment.settings, studied.bench.computing
    far, near = whole.at(MOST).computing, whole.at(2.0).computing
    assert far.missed == pytest.approx(0.99)
    assert far.jitter == pytest.approx(settings.control_period - settings.timestep)
    assert far.delay == pytest.approx(min(MOST * bench.delay, 1 - settings.timestep))
    assert near.missed == pytest.approx(2 * bench.missed)


@pytest.mark.parametrize("failing", [None, 0, 1, 3])
def test_all_seeds_must_keep_it(failing: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    studied, numbers = setting("servo", ["lqr"]), set[int]()

    def made_up(self: Trials, condition: Condition, runs: Sequence[tuple[Trial, int]]) -> None:
        numbers.update(number for _, number in runs)
        self.known.update({x: TrialResult(x[1] != failing, 0.5, "", x[1]) for x in runs})

    monkeypatch.setattr(Trials, "_run", made_up)
    trials = Trials(studied.laws[0], "corrected", {}, studied.bench, seeds=4)
    (worst,) = trials.worst([Trial(studied.conditions[0], studied.bench)])
    assert worst.kept is (failing is None)
    # None is run for a loop that has failed already.
    assert numbers == ({0} if failing == 0 else {0, 1, 2, 3})


def test_laws_are_those_of_the_file_and_every_switching_law_once_and_rivals_on_request() -> None:
    every, chosen = setting("servo/case1", rivals=True), setting("servo/case1")
    names = [law.name for law in every.laws]
    assert names[:5] == ["lqr", "lqi", "pid", "adrc", "adaptive"]
    assert len(names) == len(set(names)) == 14
    assert [law.name for law in chosen.laws[:2]] == ["lqr", "sign"]
    assert "adrc" in [law.name for law in setting("servo/case1", ["adrc"]).laws]
    assert every.bench_of == "servo/bench"
    assert [each.name for each in every.conditions] == ["nominal", "under load"]


@pytest.mark.parametrize("system", ["servo", "cart_pendulum", "arm", "two_link_arm", "jaco"])
def test_every_bench_is_ready_to_be_studied(system: str) -> None:
    names = {law.name for law in setting(system).laws}
    assert {"lqr", "implicit", "implicit, predicted"} <= names


def test_requirements_hold_for_every_law() -> None:
    studied = setting("arm/case1", ["lqr", "implicit"])
    lqr, implicit = (studied.limits(law, studied.conditions[0]) for law in studied.laws)
    assert [each.kind for each in lqr] == ["deviation_below"]
    assert [each.kind for each in implicit] == ["deviation_below", "no_reaching_phase"]


def test_an_input_is_judged_where_the_actuator_that_gives_it_is_there() -> None:
    """sgn asks for 6 A of an ideal actuator on the servo's bench, whose amplifier gives 4 A."""
    studied = setting("servo", ["sign"])
    limits, built = studied.limits(studied.laws[0], studied.conditions[0]), studied.bench
    kinds = {limit.kind for limit in limits}
    stronger = replace(built, actuators=(replace(built.actuators[0], limit=8.0),))
    for loop, whole, judged in (
        (built, built, True), (Loop(), built, False), (stronger, built, False),
        # Of a file whose loop has no actuator with a range the limit is the file's own.
        (Loop(), None, True), (Loop(), Loop(), True),
    ):  # fmt: skip
        left = {limit.kind for limit in judgeable_in(limits, loop, whole)}
        assert left == (kinds if judged else kinds - {"input_below"})


@pytest.mark.parametrize(
    ("target", "laws", "said"),
    [
        ("maglev", (), "there is no loop"),
        ("banana", (), "banana"),
        ("arm", ("banana",), "unknown law"),
        (FILE.partition("[[requirement]]")[0], (), "nothing is required"),
    ],
)
def test_what_cannot_be_studied_is_refused(
    target: str, laws: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError, match=said):
        of_file(tmp_path, target) if "\n" in target else setting(target, laws)


@pytest.mark.slow
def test_lqr_stands_its_delay_margin_and_physics_agrees(tmp_path: Path) -> None:
    studied = of_file(tmp_path)
    design = studied.laws[0].controller.designed.lqr
    loop = control.ss(design.A, design.B, design.K, np.zeros((1, 1)))
    _, phase, _, crossing = control.margin(loop)
    held = studied.experiment.settings.control_period / 2
    margin = math.radians(phase) / crossing - held
    rows = tolerances(studied, 0, 1)
    delay = next(row for row in rows if row.imperfection.name == "computing delay")
    assert delay.smallest_failed is not None
    # What grows by less than half in fifty seconds is not told from what does not.
    assert delay.largest_kept * DELAY < 1.1 * margin
    assert delay.smallest_failed * DELAY > 0.95 * margin
    assert delay.physics_agrees


@pytest.mark.slow
def test_physics_confirms_the_least_and_what_is_next_to_a_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And everything once it differs."""
    sensor = '[[sensor]]\nof = "rotor angle"\ndelay = "0.1 s"\nresolution = "0.1 rad"\n'
    studied = of_file(tmp_path, FILE.replace("[[controller]]", f"{sensor}[[controller]]"))

    def checked() -> list[Tolerance]:
        rows = tolerances(studied, 0, 1)
        return [row for row in rows if row.physics_agrees is not None]

    monkeypatch.setattr(tolerance, "_RANDOM", 0.0)
    least = checked()
    # The distance of the others from their limits is less than that.
    monkeypatch.setattr(tolerance, "LEAST_BAND", INFINITE)
    whole = checked()
    assert len(whole) == len(studied.imperfections) == 4
    assert all(row.physics_agrees for row in whole)
    assert least == [min(whole, key=lambda row: row.largest_kept)]
    monkeypatch.undo()
    monkeypatch.setattr(tolerance, "_RANDOM", 0.0)
    confirmed = tolerance._confirmed
    differs = lambda *parts: dict.fromkeys(confirmed(*parts), False)  # noqa: E731
    monkeypatch.setattr(tolerance, "_confirmed", differs)
    assert [row.physics_agrees for row in checked()] == [False] * 4


@pytest.mark.slow
def test_laws_studied_in_processes_answer_as_here(tmp_path: Path) -> None:
    two = '[[controller]]\nlaw = "grosmc"\n\n[[controller]]'
    of_file(tmp_path, SHORT.replace("[[controller]]", two, 1), "lqr", "implicit")
    studied = setting(str(tmp_path / "mine.toml"), ["lqr", "implicit"])
    here, there = (dict(tolerances_of_laws(studied, 1, x)) for x in (Batch(), Processes(2)))
    assert here == there
    assert [rows[0].law for _, rows in sorted(here.items())] == ["lqr", "implicit"]


@pytest.mark.slow
def test_a_law_that_ignores_its_state_stands_everything(tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text("def rests(t, x, memory, p):\n    return 0.0\n")
    sensor = '[[sensor]]\nof = "rotor angle"\nnoise = "1 mrad"\n\n[[controller]]'
    text = SHORT.replace('law = "lqr"', 'name = "rests"\nlaw = "law:rests"')
    text = text.replace("[[controller]]", sensor).replace('"0.5 rad"', '"1.5 rad"')
    studied = of_file(tmp_path, text, "rests")
    rows = tolerances(studied, 0, 2)
    assert [row.imperfection.name for row in rows] == ["computing delay", "sensor noise", "all"]
    assert all(math.isinf(row.weakness) for row in rows)
    assert all(row.cell.startswith("≥") for row in rows)


def row_of(
    studied: Setting, index: int, kept: float, failed: float | None, **more: Any
) -> Tolerance:
    usual = {"law": studied.laws[0].name, "condition": "nominal", "kept_ideally": True}
    usual["breaks"] = "deviation_below"
    kind = studied.imperfections[index]
    return Tolerance(
        imperfection=kind, largest_kept=kept, smallest_failed=failed, **{**usual, **more}
    )


def made_up(studied: Setting, **more: Any) -> list[Tolerance]:
    changes = {"kept_again": [(4.0, 8.0)], "physics_agrees": True, **more}
    return [row_of(studied, i, 2.0, 2.1, **changes) for i in range(len(studied.imperfections))]


@pytest.mark.parametrize(
    ("index", "kept", "failed", "more", "shown"),
    [
        (0, 2.9, 3.5, {}, "3"),
        # Less than half a timestep is none of it.
        (0, 0.125, 0.5, {}, "none"),
        (0, 0.0, 0.5, {"kept_ideally": False}, "no"),
        (0, 1024.0, None, {"breaks": ""}, "≥ 1000"),
        (5, 16.0, None, {"breaks": ""}, "≤ 0.25"),
        (3, 2.0, 2.1, {"physics_agrees": False}, "3.07!"),
        (7, 1.0, None, {"breaks": ""}, "yes"),
        (7, 0.0, 1.0, {}, "no"),
        (9, 2.0, 2.1, {}, "2"),
        (1, 0.0, None, {"kept_ideally": False, "impossible": "there is no filter"}, "-"),
    ],
)
def test_a_cell_has_the_amount_that_is_run(
    index: int, kept: float, failed: float | None, more: dict[str, Any], shown: str
) -> None:
    studied = setting("servo", ["lqr"])
    assert row_of(studied, index, kept, failed, **more).cell == shown


def test_the_verdict_has_the_amount_of_the_table_and_the_one_that_fails() -> None:
    studied = setting("servo", ["lqr"])
    assert verdict([row_of(studied, 0, 2.9, 3.5)]) == (
        "lqr breaks first, by computing delay: all is kept up to 3 ms (2.9 times the bench's), "
        "and no longer at 3.5 ms (3.5 times the bench's): deviation below."
    )
    assert math.isinf(row_of(studied, 0, 1024.0, None).weakness)
    never = row_of(studied, 0, 0.125, 0.5, condition="case1")
    said = verdict([never])
    assert "under case1: all is kept only without it, and no longer at 0.5 ms" in said


def test_the_page_of_a_result_says_the_least_that_is_stood_ideally() -> None:
    studied = setting("servo", ["lqr", "implicit"])
    weaker = [
        row_of(studied, i, 1.0, 1.1, condition="case1") for i in range(len(studied.imperfections))
    ]
    never = made_up(studied, condition="case2", kept_ideally=False)
    endless = row_of(studied, 5, 0.0, 0.0625, law="implicit", condition="nominal")
    rows = [*made_up(studied), *weaker, *never, endless]
    document = json.loads(json_text(tolerance_document(studied, rows, 4, complete=False)))
    assert {x.condition for (law, _), x in least_of(rows).items() if law == "lqr"} == {"case1"}
    lines = tolerances_text([document]).splitlines()
    header, lqr, implicit = (
        [cell.strip() for cell in lines[i].strip("|").split("|")] for i in (2, 4, 5)
    )
    expected = {row.imperfection.heading: row.cell for row in weaker}
    assert dict(zip(header, lqr, strict=True)) == {
        "law": "lqr", "keeps ideally": "nominal, case1", **expected
    }  # fmt: skip
    # The other law was interrupted after its first answer.
    assert implicit[header.index("actuator limit [A]")] == "none"
    assert implicit.count("") == len(studied.imperfections) - 1
    assert lines[-1] == "MuJoCo was asked about 20 of the answers, and differs on 0."
    assert len(least_table(rows).rows) == 2
    assert [x["breaks_at"] for x in document["standings"]] == ["computing delay", "actuator limit"]


@pytest.mark.parametrize("conditions", [1, 3])
def test_a_figure_names_its_case_and_cuts_nothing_off(
    conditions: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    studied = setting("servo", ["lqr"])
    named = [condition.name for condition in studied.conditions[:conditions]]
    rows = [row for name in named for row in made_up(studied, condition=name)]
    figures: list[Figure] = []

    def drawn(figure: Figure, _: object) -> None:
        figures.append(figure)
        figure.draw_without_rendering()

    monkeypatch.setattr("grosmc_mj.results.figure.write_figure", drawn)
    write_cells(tmp_path / "tolerance.png", "servo/bench", charts(studied, rows), NOTE)
    (figure,) = figures
    assert figure.get_suptitle() == "servo/bench"
    page = figure.bbox
    for text in figure.findobj(Text):
        if text.get_text() and text.get_visible():
            box = text.get_window_extent()
            assert page.x0 <= box.x0 <= box.x1 <= page.x1, text
            assert page.y0 <= box.y0 <= box.y1 <= page.y1, text


def test_an_interrupt_keeps_what_is_there_and_the_answer_says_what_breaks_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(studied: Setting, index: int, **_: object) -> list[Tolerance]:
        if index == 1:
            raise KeyboardInterrupt
        return made_up(studied)

    monkeypatch.setattr(tolerance, "tolerances", interrupted)
    monkeypatch.setattr(executors, "executor_for", lambda _: Batch())
    file = tmp_path / "tolerance_arm_bench.json"
    for laws, code in ((["lqr", "pid"], 130), (["lqr"], cli.DONE)):
        with pytest.raises(SystemExit) as stop:
            cli.main(["study", "tolerance", "arm", "--laws", *laws, "--out", str(tmp_path)])
        assert stop.value.code == code
        content = json.loads(file.read_text(encoding="utf-8"))
        assert content["complete"] is (code == cli.DONE)
        assert {row["law"] for row in content["tolerances"]} == {"lqr"}
        row = content["tolerances"][0]
        assert row["largest_kept"]["factor"] == 2.0
        assert row["kept_again"][0][1] == {"factor": 8.0, "shown": 0.008}
        assert file.with_suffix(".png").is_file()
        lines = capsys.readouterr().out.splitlines()
    studied = setting("arm", ["lqr"])
    assert " ".join(lines[:2]) == verdict(made_up(studied))
    assert max(map(len, lines)) <= 100 + len(str(tmp_path))

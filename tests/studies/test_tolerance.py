"""What of the loop a law stands: the search, known margins, both engines, the command."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from grosmc_mj import cli, executors
from grosmc_mj.errors import ArgumentError
from grosmc_mj.executors.batch import Batch
from grosmc_mj.executors.processes import Processes
from grosmc_mj.loop import Loop
from grosmc_mj.results.document import json_text
from grosmc_mj.studies.studied import judgeable_in
from grosmc_mj.studies.tolerance import measure
from grosmc_mj.studies.tolerance.answers import (
    amount_text,
    cell_text,
    heading,
    least,
    never_kept,
    verdict,
)
from grosmc_mj.studies.tolerance.document import tolerance_document, tolerances_in
from grosmc_mj.studies.tolerance.figure import write_tolerance_figure
from grosmc_mj.studies.tolerance.measure import Tolerance, tolerances, tolerances_of_laws
from grosmc_mj.studies.tolerance.page import tolerances_text
from grosmc_mj.studies.tolerance.search import LEAST, MOST, RESOLUTION, Search, Span
from grosmc_mj.studies.tolerance.setting import Setting, setting

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


def answered(search: Search, keeps: Callable[[float], bool]) -> Search:
    while asked := search.asks():
        assert not set(asked) & set(search.known)
        for factor in asked:
            search.told(factor, kept=keeps(factor))
    return search


def of_file(tmp_path: Path, text: str = FILE) -> Setting:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    studied = setting(str(path), ["lqr"])
    return replace(studied, conditions=studied.conditions[:1])


@pytest.mark.parametrize("bound", [0.07, 0.9, 1.0, 3.3, 700.0])
def test_the_bound_is_found_from_below(bound: float) -> None:
    search = answered(Search(), lambda factor: factor <= bound)
    assert search.largest is not None
    assert search.failed is not None
    assert search.largest <= bound < search.failed <= search.largest * RESOLUTION * 1.001
    assert search.again == []


def test_what_is_kept_again_is_shown() -> None:
    search = answered(Search(), lambda factor: factor <= 3 or 8 <= factor <= 16)
    assert search.largest == pytest.approx(3, rel=RESOLUTION - 1)
    assert search.again == [Span(8, 16)]


def test_the_first_failure_counts_though_larger_amounts_are_kept() -> None:
    search = answered(Search(), lambda factor: not 0.2 < factor < 0.3)
    assert search.largest is not None
    assert search.largest <= 0.2
    assert search.again[-1].high == MOST


def test_nothing_breaks_it_and_everything_does() -> None:
    kept = answered(Search(), lambda factor: True)
    assert (kept.largest, kept.failed, kept.tried) == (MOST, None, MOST)
    never = answered(Search(), lambda factor: False)
    assert (never.largest, never.failed, never.again) == (None, LEAST, [])


def test_a_bound_ends_the_grid() -> None:
    search = answered(Search(3.0), lambda factor: True)
    assert sorted(search.known) == [0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 3.0]


def test_times_on_a_grid_are_tried_once() -> None:
    search = Search(same=lambda factor: round(4 * factor))
    answered(search, lambda factor: round(4 * factor) <= 5)
    assert round(4 * (search.largest or 0)) == 5
    assert round(4 * (search.failed or 0)) == 6


@pytest.mark.parametrize("begin", [0.5, 40.0])
def test_physics_walks_from_where_the_equations_end(begin: float) -> None:
    search = Search()
    search.told(begin, kept=begin <= 5)
    while asked := search.local():
        for factor in asked:
            search.told(factor, kept=factor <= 5)
    assert search.largest is not None
    assert search.failed is not None
    assert search.largest <= 5 < search.failed <= search.largest * RESOLUTION * 1.001


def test_each_number_of_a_bench_is_a_column() -> None:
    studied = setting("servo")
    assert [each.name for each in studied.imperfections] == [
        "computing delay",
        "computing jitter",
        "computing missed",
        "sensor resolution",
        "actuator resolution",
        "actuator limit",
        "actuator lag",
        "estimated rates",
        "sensor resolution, estimated rates",
        "all",
    ]
    assert [each.name for each in studied.conditions] == ["nominal", "case1", "case2"]
    jitter, limit, whole = (studied.imperfections[i] for i in (1, 5, -1))
    assert jitter.at(jitter.most).computing.jitter < studied.experiment.settings.control_period
    assert limit.at(4.0).actuators[0].limit == 1.0
    assert limit.at(0.0).actuators[0].limit == math.inf
    assert whole.at(1.0) == studied.bench
    assert whole.at(2.0).estimators == studied.bench.estimators
    assert amount_text(studied.imperfections[0], 4.4) == "4.5 ms"


def test_laws_are_those_of_the_file_and_every_switching_law_once() -> None:
    names = [law.name for law in setting("servo/case1").laws]
    assert names[:5] == ["lqr", "lqi", "pid", "adrc", "adaptive"]
    assert len(names) == len(set(names)) == 14
    assert setting("servo/case1").bench_of == "servo/bench"
    assert [each.name for each in setting("servo/case1").conditions] == ["nominal", "under load"]


def test_requirements_are_asked_of_every_law() -> None:
    studied = setting("arm/case1", ["lqr", "implicit"])
    lqr, implicit = (studied.limits(law, studied.conditions[0]) for law in studied.laws)
    assert [each.kind for each in lqr] == ["deviation_below"]
    assert [each.kind for each in implicit] == ["deviation_below", "no_reaching_phase"]


@pytest.mark.parametrize(
    ("target", "laws", "said"),
    [
        ("maglev", (), "there is no loop"),
        ("banana", (), "banana"),
        ("arm", ("banana",), "unknown law"),
    ],
)
def test_what_cannot_be_studied_is_said(target: str, laws: tuple[str, ...], said: str) -> None:
    with pytest.raises(ArgumentError, match=said):
        setting(target, laws)


@pytest.mark.parametrize("system", ["servo", "cart_pendulum", "arm", "two_link_arm", "jaco"])
def test_every_bench_is_ready_to_be_studied(system: str) -> None:
    names = [law.name for law in setting(system).laws]
    assert {"lqr", "implicit", "implicit, predicted"} <= set(names)


def test_a_file_that_requires_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="nothing is required"):
        of_file(tmp_path, FILE.partition("[[requirement]]")[0])


@pytest.mark.slow
def test_lqr_stands_its_delay_margin_and_physics_agrees(tmp_path: Path) -> None:
    studied = of_file(tmp_path)
    design = studied.laws[0].controller.designed.lqr
    loop = control.ss(design.A, design.B, design.K, np.zeros((1, 1)))
    _, phase, _, crossing = control.margin(loop)
    held = studied.experiment.settings.control_period / 2
    margin = math.radians(phase) / crossing - held
    delay = next(
        row
        for row in tolerances(studied, studied.laws[0], 1, every=True)
        if row.imperfection.name == "computing delay"
    )
    assert delay.failed is not None
    # What grows by less than half in fifty seconds is not told from what does not.
    assert delay.largest * DELAY < 1.1 * margin
    assert delay.failed * DELAY > 0.95 * margin
    assert delay.agreed


@pytest.mark.slow
def test_physics_is_asked_about_the_least_and_what_is_next_to_a_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And about everything once it has said something else."""
    sensor = '[[sensor]]\nof = "rotor angle"\ndelay = "0.1 s"\nresolution = "0.1 rad"\n'
    studied = of_file(tmp_path, FILE.replace("[[controller]]", f"{sensor}[[controller]]"))

    def asked(*, every: bool = False) -> list[Tolerance]:
        rows = tolerances(studied, studied.laws[0], 1, every=every)
        return [row for row in rows if row.agreed is not None]

    monkeypatch.setattr(measure, "_RANDOM", 0.0)
    whole = asked(every=True)
    assert len(whole) == len(studied.imperfections) == 4
    assert all(row.agreed for row in whole)
    found = asked()
    assert found == [min(whole, key=lambda row: row.largest)]
    # The distance of the others from their limits is less than that.
    monkeypatch.setattr(measure, "LEAST_BAND", math.inf)
    assert asked() == whole
    monkeypatch.undo()
    monkeypatch.setattr(measure, "_RANDOM", 0.0)
    confirmed = measure._confirmed
    monkeypatch.setattr(
        measure, "_confirmed", lambda *given: dict.fromkeys(confirmed(*given), False)
    )
    assert [row.agreed for row in asked()] == [False] * 4


@pytest.mark.slow
def test_laws_asked_in_processes_answer_as_here(tmp_path: Path) -> None:
    two = '[[controller]]\nlaw = "grosmc"\n\n[[controller]]'
    text = FILE.replace("[[controller]]", two, 1).replace("60 s", "2 s").replace("50 s", "1 s")
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    studied = setting(str(path), ["lqr", "implicit"])
    here, there = (
        dict(tolerances_of_laws(studied, 1, executor)) for executor in (Batch(), Processes(2))
    )
    assert here == there
    assert [rows[0].law for _, rows in sorted(here.items())] == ["lqr", "implicit"]


@pytest.mark.slow
def test_a_law_that_ignores_its_state_stands_everything(tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text("def rests(t, x, memory, p):\n    return 0.0\n")
    text = FILE.replace('law = "lqr"', 'name = "rests"\nlaw = "law:rests"').replace(
        "[[controller]]",
        '[[sensor]]\nof = "rotor angle"\nnoise = "1 mrad"\n\n[[controller]]',
    )
    text = text.replace('"0.5 rad"', '"1.5 rad"').replace("60 s", "2 s").replace("50 s", "1 s")
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    studied = setting(str(path), ["rests"])
    studied = replace(studied, conditions=studied.conditions[:1])
    rows = tolerances(studied, studied.laws[0], 2)
    assert [row.imperfection.name for row in rows] == ["computing delay", "sensor noise", "all"]
    assert all(row.unbroken and row.largest == row.tried for row in rows)
    assert all(cell_text(row).startswith("≥") for row in rows)


def made_up(studied: Setting) -> list[Tolerance]:
    law, condition = studied.laws[0].name, studied.conditions[0].name
    return [
        Tolerance(
            law, each, condition, True, 2.0, 2.1, (Span(4.0, 8.0),), 64.0, "deviation_below", 0.1,
            "corrected", True,
        )
        for each in studied.imperfections
    ]  # fmt: skip


def test_the_least_is_of_the_conditions_that_a_law_stands_ideally() -> None:
    studied = setting("arm", ["lqr"])
    nominal = made_up(studied)
    weaker = [row._replace(condition="case1", largest=1.0, failed=1.1) for row in nominal]
    never = [row._replace(condition="case2", ideally=False, largest=0.0) for row in nominal]
    rows = [*nominal, *weaker, *never]
    assert never_kept(rows, "case2") == ["lqr"]
    graded = [row for row in least(rows) if row.imperfection.graded]
    assert {row.condition for row in graded} == {"case1"}


def test_less_than_half_a_timestep_is_none_of_it() -> None:
    delay = made_up(setting("servo", ["lqr"]))[0]
    texts = [cell_text(delay._replace(largest=factor, again=())) for factor in (0.125, 2.9)]
    assert texts == ["none", "3"]


def test_the_verdict_has_the_amount_of_the_table_and_the_one_that_fails() -> None:
    delay = made_up(setting("servo", ["lqr"]))[0]._replace(largest=2.9, failed=3.5)
    assert cell_text(delay) == "3*"
    assert verdict([delay]) == (
        "lqr breaks first, by computing delay: all is kept up to 3 ms (2.9 times the bench's), "
        "and no longer at 3.5 ms (3.5 times the bench's): deviation below."
    )
    never = delay._replace(largest=0.125, failed=0.5, condition="case1")
    assert cell_text(never) == "none*"
    assert "under case1: all is kept only without it, and no longer at 0.5 ms" in verdict([never])


def test_a_document_says_what_was_found_and_can_be_read_again() -> None:
    studied = setting("servo", ["lqr"])
    first, *rest = made_up(studied)
    rows = [first._replace(failed=None, again=(), margin=-math.inf, agreed=None), *rest]
    document = tolerance_document(studied, rows, 4, complete=True)
    found = tolerances_in(json.loads(json_text(document)))
    for row, read in zip(rows, found, strict=True):
        assert read._replace(imperfection=row.imperfection) == row
        assert (cell_text(read), heading(read.imperfection)) == (
            cell_text(row), heading(row.imperfection),
        )  # fmt: skip


def test_the_page_says_the_same_as_the_terminal_of_what_cannot_be_and_of_none() -> None:
    studied = setting("servo", ["lqr", "implicit"])
    delay, jitter, *rest = made_up(studied)
    rows = [
        delay._replace(largest=0.125, failed=0.25, again=()),
        jitter._replace(ideally=False, again=(), impossible="there is no filter"),
        *rest,
    ]
    # The other law was interrupted after its first answer.
    rows.append(rest[0]._replace(law="implicit", agreed=False))
    document = tolerance_document(studied, rows, 4, complete=False)
    lines = tolerances_text([json.loads(json_text(document))]).splitlines()
    header, lqr, implicit = (
        [cell.strip() for cell in lines[i].strip("|").split("|")] for i in (2, 4, 5)
    )
    assert dict(zip(header, lqr, strict=True)) == {
        "law": "lqr",
        "keeps ideally": "nominal",
        **{heading(row.imperfection): cell_text(row) for row in rows[:-1]},
    }
    assert {lqr[header.index(f"computing {name} [ms]")] for name in ("delay", "jitter")} == {
        "none", "-",
    }  # fmt: skip
    assert implicit[header.index(heading(rest[0].imperfection))] == cell_text(rows[-1])
    assert implicit.count("") == len(studied.imperfections) - 1


@pytest.mark.parametrize("conditions", [1, 3])
def test_a_figure_names_its_case_and_cuts_nothing_off(
    conditions: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one row of one law as with three, whose bars of colours are as high."""
    studied = setting("servo", ["lqr"])
    found = made_up(studied)
    rows = [r._replace(condition=c.name) for c in studied.conditions[:conditions] for r in found]
    figures: list[Figure] = []

    def kept(figure: Figure, _: object) -> None:
        figures.append(figure)
        figure.draw_without_rendering()

    monkeypatch.setattr("grosmc_mj.results.figure.write_figure", kept)
    write_tolerance_figure(studied, rows, tmp_path / "tolerance.png")
    (figure,) = figures
    assert figure.get_suptitle() == "servo/bench: what of the loop each law stands"
    page = figure.bbox
    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    for text in texts:
        box = text.get_window_extent()
        assert page.x0 <= box.x0 <= box.x1 <= page.x1, text
        assert page.y0 <= box.y0 <= box.y1 <= page.y1, text
    assert any("so many" in text.get_text().replace("\n", " ") for text in texts)


def test_what_was_found_before_an_interrupt_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(studied: Setting, law: object, *_: object, **__: object) -> list[Tolerance]:
        if law is studied.laws[-1]:
            raise KeyboardInterrupt
        return made_up(studied)

    monkeypatch.setattr(measure, "tolerances", interrupted)
    monkeypatch.setattr(executors, "executor_for", lambda _: Batch())
    with pytest.raises(SystemExit) as stop:
        cli.main(["study", "tolerance", "arm", "--laws", "lqr", "pid", "--out", str(tmp_path)])
    assert stop.value.code == 130
    assert "tolerance_arm_bench.json" in capsys.readouterr().out
    found = json.loads((tmp_path / "tolerance_arm_bench.json").read_text(encoding="utf-8"))
    assert not found["complete"]
    assert {row["law"] for row in found["tolerances"]} == {"lqr"}
    row = found["tolerances"][0]
    assert row["largest_kept"]["factor"] == 2.0
    assert row["kept_again"][0]["to"]["parts"][0] == {
        "of": "computing",
        "quantity": "delay",
        "unit": "s",
        "value": 0.008,
    }
    assert (tmp_path / "tolerance_arm_bench.png").is_file()


def test_the_answer_says_what_breaks_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(measure, "tolerances", lambda studied, *_, **__: made_up(studied))
    with pytest.raises(SystemExit) as stop:
        cli.main(["study", "tolerance", "arm", "--laws", "lqr", "--out", str(tmp_path)])
    lines = capsys.readouterr().out.splitlines()
    assert stop.value.code == cli.DONE
    assert " ".join(lines[:2]) == verdict(made_up(setting("arm", ["lqr"])))
    assert max(map(len, lines)) <= 100 + len(str(tmp_path))


def test_an_input_is_judged_where_the_actuator_that_gives_it_is_there() -> None:
    """sgn asks for 6 A of an ideal actuator on the servo's bench, whose amplifier gives 4 A."""
    studied = setting("servo", ["sign"])
    (law,), nominal = studied.laws, studied.conditions[0]
    limits, built = studied.limits(law, nominal), studied.bench
    kinds = {limit.kind for limit in limits}
    assert "input_below" in kinds
    assert {limit.kind for limit in judgeable_in(limits, built, built)} == kinds
    assert {limit.kind for limit in judgeable_in(limits, Loop(), built)} == kinds - {"input_below"}
    (actuator,) = built.actuators
    stronger = replace(built, actuators=(replace(actuator, limit=8.0),))
    assert {limit.kind for limit in judgeable_in(limits, stronger, built)} == kinds - {
        "input_below"
    }
    # Of a file whose loop has no actuator with a range the limit is the file's own.
    assert {limit.kind for limit in judgeable_in(limits, Loop(), None)} == kinds
    assert {limit.kind for limit in judgeable_in(limits, Loop(), Loop())} == kinds

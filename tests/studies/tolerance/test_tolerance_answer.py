"""Answer of a tolerance study: amounts as they are run, the page, and what the command prints."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from commands import run

from grosmc_mj import cli
from grosmc_mj.ground.executors.pools import InProcess
from grosmc_mj.output.results.document import json_text
from grosmc_mj.output.results.verdicts import Verdict, Verdicts
from grosmc_mj.studies.tolerance import answer, tolerance
from grosmc_mj.studies.tolerance.answer import verdict
from grosmc_mj.studies.tolerance.tolerance import ToleranceStudy, tolerance_study
from grosmc_mj.studies.tolerance.words import with_words

SERVO = tolerance_study("servo", ["lqr", "implicit"])


def row_of(
    studied: ToleranceStudy, at: int, kept: float | None, failed: float | None, **more: Any
) -> Verdict:
    """The tolerance to an imperfection; what the bench has of it is kept."""
    kind = studied.imperfections[at]
    fields = {
        "law": "lqr",
        "step": kind.name,
        "condition": "nominal",
        "share": 0.5,
        "tightest": "deviation_below",
        "largest_kept": kept,
        "smallest_failed": failed,
        **more,
    }
    return with_words(Verdict(**fields), kind)


def rows_of(studied: ToleranceStudy, kept: float | None = 2.0, **more: Any) -> list[Verdict]:
    """Tolerances to all imperfections."""
    changes = {"kept_again": ((4.0, 8.0),), "physics_agrees": True, **more}
    failed = 0.0 if kept is None else kept + 0.1
    return [row_of(studied, i, kept, failed, **changes) for i in range(len(studied.imperfections))]


@pytest.mark.parametrize(
    ("index", "kept", "failed", "more", "cell"),
    [
        (0, 2.9, 3.5, {}, "3"),
        # Less than half a timestep is none of it.
        (0, 0.125, 0.5, {}, "none"),
        (0, None, 0.0, {"share": math.inf}, "no"),
        (0, 1024.0, None, {"tightest": ""}, "≥ 1000"),
        (5, 16.0, None, {"tightest": ""}, "≤ 0.25"),
        (3, 2.0, 2.1, {"physics_agrees": False}, "3.07!"),
        (7, 1.0, None, {"tightest": "", "share": 0.0}, "yes"),
        (7, 0.0, 1.0, {"share": math.inf}, "no"),
        (9, 2.0, 2.1, {}, "2"),
        (1, None, 0.0, {"impossible": "there is no filter"}, "-"),
    ],
)
def test_a_cell_has_the_amount_that_is_run(
    index: int, kept: float | None, failed: float | None, more: dict[str, Any], cell: str
) -> None:
    assert row_of(SERVO, index, kept, failed, **more).cell == cell


def test_the_verdict_has_the_amount_that_fails() -> None:
    assert verdict([row_of(SERVO, 0, 2.9, 3.5)], SERVO.kinds) == (
        "lqr breaks first, by computing delay: all is kept up to 3 ms (2.9 times the bench's); "
        "the first failure found is at 3.5 ms (3.5 times the bench's): deviation below."
    )
    never = verdict([row_of(SERVO, 0, 0.125, 0.5, condition="case1")], SERVO.kinds)
    assert "under case1: all is kept only without it; the first failure found is at 0.5 ms" in never


def test_laws_without_a_row_are_not_finished_in_whatever_order_rows_come() -> None:
    second = SERVO.laws[1].name
    rows = [Verdicts(rows=(row_of(SERVO, 0, 1.0, 2.0, law=second),))]
    assert second not in SERVO.missing(rows)
    assert SERVO.missing(rows)[0] == SERVO.laws[0].name


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    """The document of a study of two laws, the second of which has one answer yet."""
    weaker = rows_of(SERVO, 1.0, condition="case1", kept_again=())
    never = rows_of(SERVO, None, condition="case2", share=math.inf)
    endless = row_of(SERVO, 5, 0.0, 0.0625, law="implicit")
    rows = [*rows_of(SERVO), *weaker, *never, endless]
    return json.loads(json_text(answer.tolerance_result(SERVO, rows, complete=False)))


def test_the_page_has_the_least_that_is_stood_under_conditions_kept_ideally(
    document: dict[str, Any],
) -> None:
    lines = answer.tolerances_text([document]).splitlines()
    header, lqr, implicit = (
        [cell.strip() for cell in lines[i].strip("|").split("|")] for i in (2, 4, 5)
    )
    # Of case1, where less is stood than nominally.
    least = rows_of(SERVO, 1.0, condition="case1", kept_again=())
    answers = {SERVO.kinds[row.step].heading: row.cell for row in least}
    expected = {"law": "lqr", "keeps ideally": "nominal, case1", **answers}
    assert dict(zip(header, lqr, strict=True)) == expected
    assert implicit[header.index("actuator limit [A]")] == "none"
    assert implicit.count("") == len(SERVO.imperfections) - 1
    assert lines[-1] == "MuJoCo confirmed 30 of 30 answers."


def test_a_standing_is_the_imperfection_that_breaks_a_law_first(document: dict[str, Any]) -> None:
    first, second = document["standings"]
    assert (first["breaks_at"], second["breaks_at"]) == ("computing delay", "actuator limit")
    assert second["words"] == "kept only without it, then deviation below (nominal)"


# The command, with made-up tolerances.


ARM = ("study", "tolerance", "arm", "--laws", "lqr")


def answer_by(answers: Callable[[ToleranceStudy, int], Any], monkeypatch: Any) -> None:
    """Replace the answers of a law by those of a function of the study and the law's number."""
    monkeypatch.setattr(tolerance, "tolerances", lambda studied, i, **_: answers(studied, i))
    monkeypatch.setattr(tolerance, "executor_for", lambda _: InProcess())


@pytest.mark.parametrize("kept", [2.0, None])
def test_the_command_prints_its_answer(
    kept: float | None, printed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ends with 1 if a law keeps everything under no condition."""
    answer_by(lambda studied, _: rows_of(studied, kept), monkeypatch)
    printed(*ARM, "--out", "results")


def first_law(studied: ToleranceStudy, index: int) -> list[Verdict]:
    """Tolerances of the first law; an interrupt at the second one."""
    if index == 1:
        raise KeyboardInterrupt
    return rows_of(studied)


def test_an_interrupt_keeps_finished_laws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer_by(first_law, monkeypatch)
    assert run(*ARM, "fl-pid", "--out", tmp_path) == cli.INTERRUPTED
    content = json.loads((tmp_path / "tolerance_arm_bench.json").read_text(encoding="utf-8"))
    assert content["complete"] is False
    assert {row["law"] for row in content["verdicts"]} == {"lqr"}
    assert content["verdicts"][0]["largest_kept"] == 2.0
    assert content["verdicts"][0]["kept_again"] == [[4.0, 8.0]]
    assert (tmp_path / "tolerance_arm_bench.png").is_file()

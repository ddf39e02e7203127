"""Verdicts: from shares of limits, over draws, in words."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from grosmc_mj.output.results.document import json_text
from grosmc_mj.output.results.verdicts import (
    ENDED,
    Verdict,
    described,
    first_failed,
    over_draws,
    share_of,
    standings,
    values_of,
    verdict_of,
)


def test_the_tightest_limit_decides() -> None:
    verdict = verdict_of({"error": 0.5, "effort": 0.995}, draw=3)
    assert (verdict.share, verdict.tightest, verdict.draw) == (0.995, "effort", 3)
    assert verdict.kept
    assert not verdict_of({"error": 1.5, "effort": 0.995}).kept


def test_a_requirement_without_a_measurement_is_not_kept() -> None:
    verdict = verdict_of({"effort": 0.5, "error": share_of(math.nan, 1.0)})
    assert (verdict.kept, verdict.broken) == (False, "error")


@pytest.mark.parametrize("margin", [-math.inf, -0.1, -1e-300, 0.0, 1e-300, 0.1])
def test_a_limit_is_kept_exactly_where_its_margin_is_not_negative(margin: float) -> None:
    """However small a margin is beside its limit."""
    assert verdict_of({"error": share_of(margin, 3.0)}).kept == (margin >= 0)


def test_a_run_that_ended_keeps_nothing() -> None:
    verdict = verdict_of({"error": 0.5}, ended="diverged")
    assert (verdict.kept, verdict.broken, verdict.tightest) == (False, ENDED, "")


def test_nothing_that_is_required_is_kept() -> None:
    assert verdict_of({}).kept


def test_the_worst_draw_counts_and_all_that_keep_are_told() -> None:
    shares = (0.5, 1.5, 0.9)
    draws = [verdict_of({"error": share}, draw=number) for number, share in enumerate(shares)]
    verdict = over_draws(draws)
    assert (verdict.share, verdict.draw) == (1.5, 1)
    assert (verdict.kept_draws, verdict.draws, verdict.state) == (2, 3, "partly")


def test_a_claim_falls_in_the_draw_that_is_worst_for_it() -> None:
    draws = [
        verdict_of({"error": 0.9}).changed(claims={"quick": 0.2}),
        verdict_of({"error": 0.5}).changed(claims={"quick": 2.0}),
    ]
    assert over_draws(draws).claims == {"quick": 2.0}


@pytest.mark.parametrize(
    ("verdict", "text", "words"),
    [
        (verdict_of({"settles_within": 0.5}), "0.5", "0.5 of the limit"),
        (verdict_of({"settles_within": 3.0}), "3x", "settles within: 3 times"),
        (verdict_of({"settles_within": 1.001}), "1x", "settles within: at its limit"),
        (verdict_of({"settles_within": math.inf}), "never", "settles within: never"),
        (verdict_of({}, ended="diverged"), "ended", "the run ended"),
        (Verdict(impossible="there is no loop"), "-", "there is no loop"),
    ],
)
def test_a_verdict_on_a_run_is_its_share_of_the_tightest_limit(
    verdict: Verdict, text: str, words: str
) -> None:
    row = described(verdict)
    assert (row.cell, row.words) == (text, words)


def test_a_verdict_says_what_the_optimum_itself_needs() -> None:
    row = described(verdict_of({"settles_within": 3.0}), "the nominal optimum needs 1.84 s")
    assert row.words == "settles within: 3 times (the nominal optimum needs 1.84 s)"


def test_a_verdict_on_draws_says_how_many_keep_all() -> None:
    row = described(verdict_of({"settles_within": 3.0}).changed(draws=10, kept_draws=7))
    assert row.cell == "7 of 10"
    assert row.words == "settles within: 3 times, kept in 7 of 10 draws"


def test_marks_say_what_decides_besides() -> None:
    row = Verdict(share=0.5, text="0.5", turned_by=("lugre.shaft.static times 2",))
    assert row.cell == "0.5?"
    assert row.changed(turned_by=(), physics_agrees=False).cell == "0.5!"


def test_the_first_row_that_fails_is_found() -> None:
    rows = [verdict_of({"a": share}) for share in (0.5, 2.0, 0.5, 3.0)]
    assert first_failed(rows) is rows[1]
    assert first_failed(rows[:1]) is None


def test_values_of_two_conditions_have_names_of_their_own() -> None:
    rows = [
        verdict_of({"error": 0.5}).changed(law="lqr", step="sensors", group="up to", condition=name)
        for name in ("case1", "case2")
    ]
    names = [value.name for value in values_of("servo/machine", rows)]
    assert len(set(names)) == 4
    assert names[:2] == [
        "servo/machine case1 lqr, up to sensors",
        "servo/machine case1 lqr, up to sensors: share of the limit",
    ]


def test_a_search_is_compared_by_its_largest_size_and_what_cannot_be_by_nothing() -> None:
    fields: Any = {"law": "lqr", "step": "delay", "condition": "nominal"}
    found = Verdict(**fields, share=0.5, largest_kept=2.0, smallest_failed=2.1)
    never = Verdict(**fields, smallest_failed=0.0)
    impossible = Verdict(**fields, impossible="there is no loop")
    values = list(values_of("servo", [found, never, impossible]))
    assert [value.value for value in values] == ["kept", 2.0, "not kept", None]
    assert {value.name for value in values} == {
        "servo nominal lqr, delay",
        "servo nominal lqr, delay: largest kept",
    }


def test_one_failure_decides_the_standing_of_a_law_in_an_interrupted_study() -> None:
    rows = [
        verdict_of({"error": share}).changed(law=law, step=step)
        for law, step, share in [("a", "one", 0.5), ("a", "two", 2.0), ("b", "one", 0.5)]
    ]
    failing, keeping = standings(
        "servo", rows, first_failed, lambda of_law: f"{len(of_law)} rows", complete=False
    )
    assert (failing.law, failing.breaks_at, failing.words) == ("a", "two", "2 rows")
    assert (failing.complete, keeping.complete, keeping.breaks_at) == (True, False, "")


def test_a_verdict_is_read_from_its_document() -> None:
    row = verdict_of({"error": math.inf}, ended="diverged").changed(numbers={"variation": 2.0})
    assert Verdict.model_validate(json.loads(json_text(row.model_dump()))) == row


def test_less_of_a_limit_is_better_in_a_comparison() -> None:
    row = verdict_of({"settles_within": 0.5}).changed(law="lqr", step="friction")
    (share,) = [value for value in values_of("servo", [row]) if "share of the limit" in value.name]
    assert (share.value, share.better) == (0.5, -1)

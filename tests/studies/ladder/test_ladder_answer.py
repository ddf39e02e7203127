"""The answer of a ladder from its verdicts: which rung breaks a law, and which a claim."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from syrupy.assertion import SnapshotAssertion

from grosmc_mj.chapter.claims.ledger import cited_claims
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.results.document import json_text
from grosmc_mj.output.results.verdicts import Verdict, described, verdict_of
from grosmc_mj.studies.ladder import answer, pages, shown
from grosmc_mj.studies.ladder.climb import ALONE, UP_TO
from grosmc_mj.studies.ladder.ladder import Ladder, ladder
from grosmc_mj.studies.ladder.rungs import Rung

TIME: Array = 1e-3 * np.arange(10_000)


def sine(frequency: float) -> Array:
    return np.sin(2 * math.pi * frequency * TIME)


@pytest.mark.parametrize(
    ("error", "amplitude", "frequency"),
    [
        (0.5 + 0.2 * sine(7.3), 0.2, 7.3),
        # Only the end of a run counts, and a ripple on a swing is no swing of its own.
        (np.where(TIME < 8, 5 * np.sin(50 * TIME), 0.1 * sine(5)), 0.1, 5.0),
        (sine(3) + 0.05 * sine(211), 1.05, 3.0),
        # Without three swings there is no cycle: at rest, half of a creep, two swings.
        (np.full(10_000, 0.3), 0.0, None),
        (0.1 * TIME, 0.1, None),
        (sine(1), 1.0, None),
    ],
)
def test_a_swing_at_the_end_has_its_amplitude_and_frequency(
    error: Array, amplitude: float, frequency: float | None
) -> None:
    """The end is 2 s long, in which a crossing more or less is a quarter of a hertz."""
    swing, cycle = shown.oscillation(TIME, error)
    assert swing == pytest.approx(amplitude, rel=0.01)
    assert cycle == (None if frequency is None else pytest.approx(frequency, abs=0.25))


def row(rung: str, used: float, law: str = "lqr", **changes: Any) -> Verdict:
    """A verdict on a rung."""
    fields = {"law": law, "step": rung, "group": UP_TO, "condition": "nominal", **changes}
    return described(verdict_of({"settles_within": used}).changed(**fields))


RUNGS = ("printed", "physics", "sampled", "delay", "friction", "stops")
# The book's misprints are no rung to fall from.
SHARES = (9, 0.3, 1.0, 1.2, 0.9, math.inf)
LQR = [row(name, share) for name, share in zip(RUNGS, SHARES, strict=True)]
FOUR_LAWS = [
    *LQR,
    *(row(name, 0.5, "stands") for name in RUNGS[1:]),
    row("delay", 3.0, "recovers"),
    row("stops", 0.9, "recovers"),
    row("physics", 0.5, "interrupted"),
    # Alone and under load are not on this way.
    row("physics", 9.0, "stands", group=ALONE),
    row("physics", 9.0, "stands", condition="case1"),
]


@cache
def made_up() -> Ladder:
    """A ladder of these rungs."""
    own = tuple(Rung(name, "physics") for name in RUNGS)
    return replace(ladder("servo", ["lqr", "fl-pid"]), climbing=own)


def test_the_verdict_counts_laws_on_every_rung_apart_from_those_on_the_machine() -> None:
    assert answer.verdict(made_up(), FOUR_LAWS, "nominal") == (
        "1 of 3 laws passes every rung, 2 the complete machine; delay breaks 2."
    )


def test_a_law_that_is_on_its_way_is_not_judged() -> None:
    words = answer.verdict(made_up(), [row("physics", 0.5)], "nominal")
    assert words == "no law has climbed every rung yet."


def test_the_answer_has_a_column_for_every_rung_beside_that_of_the_machine() -> None:
    first_screen = answer.answer_table(made_up(), FOUR_LAWS, made_up().conditions[0])
    assert [cells[:4] for cells in first_screen.rows] == [
        ["stands", "yes", "yes (0.5)", ""],
        ["lqr", "no", "no (never)", "delay: settles within: 1.2 times"],
        ["interrupted", "not finished", "not finished", ""],
        ["recovers", "no", "yes (0.9)", "delay: settles within: 3 times"],
    ]


@pytest.mark.parametrize(
    ("shares", "verdict"),
    [((0.5, 0.9), "not decided"), ((0.5, 1.2), "not kept"), ((1.2, 0.9), "not decided")],
)
def test_one_law_that_fails_on_the_complete_machine_decides_an_interrupted_ladder(
    shares: tuple[float, float], verdict: str
) -> None:
    """A law that fails below may pass the complete machine."""
    climbs = [row(name, share) for name, share in zip(("delay", "stops"), shares, strict=True)]
    rows = [*climbs, row("delay", 0.5, "fl-pid")]
    (standing,) = answer._answers(made_up(), rows, complete=False)
    assert standing.verdict == verdict


def test_a_claim_falls_on_the_first_rung_that_breaks_it() -> None:
    rows = [
        row("printed", 0.5, claims={"quick": 7.0}),
        row("physics", 0.5, claims={"quick": 0.2, "same": 1.0, "well": 0.1}),
        row("delay", 0.5, claims={"quick": 1.01, "same": 0.9}),
        row("friction", 0.5, claims={"quick": 2.0, "same": math.inf}),
        row("physics", 0.5, "fl-pid"),
    ]
    table = answer.claims_table(made_up(), rows, "nominal")
    assert table is not None
    assert [column.header for column in table.columns] == ["law", "`quick`", "`same`", "`well`"]
    assert table.rows == [["lqr", "delay", "friction", "stands"]]
    assert answer.claims_table(made_up(), LQR, "nominal") is None


@pytest.mark.parametrize("system", ["servo", "cart_pendulum", "arm", "two_link_arm"])
def test_claims_of_machines_are_in_the_ledger_with_its_limits(system: str) -> None:
    """The same and well are 2 %: of the step, of the start, or of the amplitude of 1 rad."""
    made = find_experiment(system, "machine")
    cited = cited_claims(made)
    law = made.law("physics", "lqr")
    error = law.designed.error
    z = np.array(error.error_state(0.0, np.array(made.x0), law.parameters))
    start = float(np.linalg.norm(z[list(error.output_rows)]))
    for table, limit in zip(made.file.claim, made.claimed, strict=True):
        claim = cited[table.id]
        share = claim.threshold / 100
        expected: Any = pytest.approx(share * start, rel=2e-3)
        if claim.id == "arm-tracking":
            expected = share * 1.0
        elif limit.key == "settles_within":
            expected = 2 * (1 + share)
        assert claim.system == system
        assert limit.number == expected


def test_pages_have_each_condition_the_claims_and_the_assumed_numbers(
    snapshot: SnapshotAssertion,
) -> None:
    loaded = ladder("servo", ["lqr", "fl-pid"], loaded=True)
    studied = replace(
        loaded,
        climbing=[Rung("physics", "physics", assumed=("computing: jitter",))],
        conditions=loaded.conditions[:2],
        statements={"quick": "It is so"},
    )
    rows = [
        row("physics", 0.5, numbers={"deviation": 0.0123}, claims={"quick": 0.5}),
        row("physics", 0.5, "fl-pid"),
        row("physics", 3.25, condition="case1"),
        row("physics", 3.25, "fl-pid", condition="case1"),
    ]
    document = json.loads(json_text(answer.ladder_result(studied, rows, complete=True)))
    assert [Verdict.model_validate(verdict) for verdict in document["verdicts"]] == rows
    assert pages.ladders_text([document]) == snapshot


def test_a_law_has_a_second_row_with_tuned_numbers() -> None:
    """On the first page; a machine without tuned numbers has a dash."""
    documents = [
        {
            "target": target,
            "conditions": [{"name": "nominal"}],
            "verdicts": [row("friction", share).model_dump()],
        }
        for target, share in [("servo/machine", 2.0), ("servo/tuned", 0.5), ("arm/machine", 3.0)]
    ]
    assert pages.few_failures_text(documents).splitlines()[2:] == [
        "| lqr | friction | friction |",
        "| lqr, tuned | kept | - |",
    ]


@pytest.mark.parametrize(("share", "words"), [(0.5, "kept?"), (2.0, "friction?")])
def test_an_assumed_number_that_turns_a_verdict_is_a_question_mark(
    share: float, words: str
) -> None:
    document = {
        "target": "servo/machine",
        "conditions": [{"name": "nominal"}],
        "verdicts": [row("friction", share, turned_by=("computing: jitter",)).model_dump()],
    }
    assert pages.few_failures_text([document]).splitlines()[2:] == [f"| lqr | {words} |"]

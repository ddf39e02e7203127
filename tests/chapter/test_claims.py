"""The claims: their data, their verdicts, and the tables and documents about them."""

from __future__ import annotations

import io
import itertools
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from commands import Patch
from rich.cells import cell_len
from rich.console import Console
from shipped import REGULATION, uncertainty_of
from stored import Store

from grosmc_mj import cli
from grosmc_mj.chapter.claims import claim as claims
from grosmc_mj.chapter.claims import story
from grosmc_mj.chapter.claims.claim import (
    Claim,
    ClaimFinding,
    ClaimValue,
    ClaimVerdict,
    Kind,
    PlantFinding,
)
from grosmc_mj.chapter.claims.judging import judge, verdict_differences
from grosmc_mj.chapter.claims.ledger import CLAIMS, ClaimMeasurement, select_claims
from grosmc_mj.chapter.claims.measurements import measures
from grosmc_mj.chapter.claims.measurements.arm import tracking
from grosmc_mj.chapter.claims.measurements.theory import optimum_of_rate
from grosmc_mj.chapter.claims.results import claims_result, counts_words, sweeps_result
from grosmc_mj.chapter.claims.sweep import stored_flips, stored_sweeps, sweep
from grosmc_mj.cli.commands import claims as claims_command
from grosmc_mj.experiments import cases
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.errors import ArgumentError, GainError
from grosmc_mj.output.results.document import json_text
from grosmc_mj.output.results.result import Result
from grosmc_mj.output.results.tables import WIDTH

LAB = RunCache(Settings())
PAGE = Path(cli.__file__).parents[2] / "docs" / "claims.md"
BY_ID = {claim.id: claim for claim in CLAIMS}

SUPPORTED = ClaimVerdict.SUPPORTED
REFUTED = ClaimVerdict.REFUTED
UNDETERMINED = ClaimVerdict.UNDETERMINED
PREMISE_NOT_MET = ClaimVerdict.PREMISE_NOT_MET
INCONCLUSIVE = ClaimVerdict.INCONCLUSIVE


def finding(
    claim: Claim, verdict: ClaimVerdict | None = None, value: float = -1.234e-5
) -> ClaimFinding:
    """A finding as wide as numbers get, with the expected verdicts or one for all plants."""
    measured = ClaimValue(value, "something short")
    plants: dict[PlantName, PlantFinding] = {}
    for plant in claim.plants:
        on_plant = PlantFinding(measured, ClaimValue(value), verdict or claim.verdicts[plant])
        plants[plant] = on_plant
    return ClaimFinding(claim, plants)


EXPECTED = [finding(claim) for claim in CLAIMS]


def measurement(name: str) -> ClaimMeasurement:
    measure = BY_ID[name].measure
    assert isinstance(measure, ClaimMeasurement)
    return measure


def texts(claim: Claim) -> tuple[str, ...]:
    """The texts that a claim needs and that its story has."""
    return (claim.statement, claim.source, claim.criterion, claim.why, claim.reason)


def too_wide(*tables: object) -> list[str]:
    """Lines that need more than the width, of a screen that has more."""
    console = Console(file=io.StringIO(), width=200, color_system=None)
    with console.capture() as capture:
        console.print(*tables)
    lines = capture.get().splitlines()
    return [line for line in lines if cell_len(line.rstrip()) > WIDTH]


# The data of the claims


@pytest.mark.parametrize("claim", CLAIMS, ids=BY_ID)
def test_a_claim_has_its_texts_and_the_place_that_it_rests_on(claim: Claim) -> None:
    assert all(text.strip() for text in (*texts(claim), claim.untested))
    assert re.search(r"\d", claim.source), "no section, figure, equation or theorem"
    assert claim.quote or claim.kind is not Kind.CLAIM


def test_claims_are_judged_on_physics_but_for_one_that_is_algebra() -> None:
    elsewhere = {claim.id for claim in CLAIMS if "physics" not in claim.plants}
    assert elsewhere == {"proof-3"}


@pytest.mark.parametrize("expected", EXPECTED, ids=BY_ID)
def test_an_expected_verdict_has_its_cause_its_premise_or_its_choice(
    expected: ClaimFinding,
) -> None:
    """An undetermined claim turns on a choice that it must hold for, and that is not printed."""
    claim = expected.claim
    assert bool(claim.cause) == (expected.verdict is not SUPPORTED)
    assert expected.verdict is not PREMISE_NOT_MET or claim.premise is not None
    if expected.verdict is UNDETERMINED:
        unprinted = {choice.name for choice in claim.choices if not choice.printed}
        assert unprinted & set(stored_flips(claim.id)) & set(claim.every)


@pytest.mark.parametrize("expected", EXPECTED, ids=BY_ID)
def test_the_story_of_a_claim_has_its_texts_within_the_width(expected: ClaimFinding) -> None:
    tables = story.claim_tables(replace(expected, because="epsilon: " + "a reason " * 20))
    told = " ".join(cell for row in tables[0].rows for cell in row)
    assert [text for text in texts(expected.claim) if text not in told] == []
    assert too_wide(*tables) == []


def test_no_id_stands_twice() -> None:
    assert len(BY_ID) == len(CLAIMS)


QUESTIONS = [claim.id for claim in CLAIMS if claim.kind is Kind.QUESTION]


@pytest.mark.parametrize("name", QUESTIONS)
def test_a_question_of_this_project_is_used_by_a_page_or_a_machine(name: str) -> None:
    """A finding names the questions that it rests on; the ladder asks those of its machines."""
    pages = [page for page in PAGE.parent.glob("*.md") if page != PAGE]
    machines = Path(cases.__file__).parent.glob("*/machine.toml")
    texts = " ".join(file.read_text(encoding="utf-8") for file in (*pages, *machines))
    assert re.search(rf"(?<![\w-]){name}(?![\w-])", texts)


def test_no_claim_of_the_chapter_but_theorem_3_has_a_gain_of_this_project() -> None:
    """Theorem 3 is about any gain that exceeds its bound."""
    chapter = [claim.id for claim in CLAIMS if claim.kind is Kind.CLAIM]
    with_gain = [name for name in chapter if "epsilon" in measurement(name).arguments]
    assert with_gain == ["theorem-3"]


def test_four_equations_are_misprinted() -> None:
    misprints = {claim.id for claim in CLAIMS if claim.kind is Kind.MISPRINT}
    assert misprints == {"proof-3", "servo-semidefinite", "pendulum-eq40", "arm-eq57"}


def test_a_word_has_one_limit_wherever_it_stands() -> None:
    limits = set()
    for claim in CLAIMS:
        if claim.word:
            limits.add((claim.word, claim.sense, claim.threshold, claim.unit, claim.why))
    assert sorted(limit[0] for limit in limits) == sorted(claims.WORDS)


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        ("pendulum-region", "pendulum-region-lqr"),
        ("pendulum-disturbance-grosmc", "pendulum-disturbance-lqr"),
        ("servo-load-grosmc", "servo-load-lqr"),
    ],
)
def test_both_laws_of_a_comparison_are_measured_alike(ours: str, theirs: str) -> None:
    controller = measurement(ours).arguments["controller"]
    arguments = {**measurement(theirs).arguments, "controller": controller}
    assert replace(measurement(theirs), arguments=arguments) == measurement(ours)


def test_claims_about_uncertainty_have_the_declared_ranges() -> None:
    low, high = uncertainty_of("servo").scales["J"]
    assert f"outside {low:g} to {high:g} times" in BY_ID["servo-inertia-grosmc"].untested
    payload = measurement("two-link-projection").arguments["payload"]
    assert payload == uncertainty_of(REGULATION).scales["mp"][1]


def test_the_stored_sweeps_are_those_of_the_claims_choices() -> None:
    choices = [(claim.id, choice) for claim in CLAIMS for choice in claim.choices]
    for row, (name, choice) in zip(stored_sweeps(), choices, strict=True):
        assert row["claim"] == name
        assert row["choice"] == choice.name
        written = [choice.written(value) for value in choice.values]
        assert [trial["choice"] for trial in row["values"]] == written


# Measurements


def test_errors_of_the_arm_are_shares_of_their_own_reference() -> None:
    """y_r = sin(pi t) is 1 rad large: the state less its error."""
    result = LAB.case("arm", "case1", "corrected", "grosmc")
    comparison = result.comparison
    error = comparison.z[:, 0]
    reference = result.trajectory.state[:, 0] - error
    size = np.abs(reference[comparison.time > 3.5]).max()
    assert size == pytest.approx(1.0, rel=1e-4)

    optimal = np.abs(comparison.optimal[:, 0])
    arrived = np.flatnonzero(optimal > 2e-3 * size)[-1] + 1
    share = error[arrived:] / size
    peak = tracking(LAB, "corrected", statistic="peak", arrived=0.2)
    assert peak.value == pytest.approx(100 * np.abs(share).max(), rel=1e-3)
    rms = tracking(LAB, "corrected", statistic="RMS", arrived=0.2)
    assert rms.value == pytest.approx(100 * np.sqrt(np.mean(share**2)), rel=1e-3)


def test_the_least_cost_is_singular_where_the_weight_does_not_see_the_angle() -> None:
    """P solves (6) for Q = diag(0, 1), R = 1, and is zero along the angle."""
    linear = find_experiment("servo", "nominal").law("corrected", "lqr").designed.lqr
    K, P = optimum_of_rate(linear)
    residual = linear.A.T @ P + P @ linear.A - K.T @ K + np.diag([0.0, 1.0])
    assert np.abs(residual).max() < 1e-9
    assert pytest.approx(linear.B.T @ P) == K
    assert np.linalg.eigvalsh(P).min() == 0.0


@pytest.mark.parametrize(
    ("weights", "K"),
    [
        (None, [10.0, math.sqrt(21.0)]),
        ([400, 100], [20.0, math.sqrt(140.0)]),
    ],
)
def test_laws_of_a_varied_run_cache_have_its_weights(
    weights: list[int] | None, K: list[float]
) -> None:
    """Of a double integrator K = [sqrt(q1), sqrt(q2 + 2 sqrt(q1))]; q = [100, 1] in the file."""
    lab = LAB
    if weights is not None:
        lab = LAB.varied("task.Q", weights)
        assert LAB.varied("task.Q", weights) is lab
    experiment = find_experiment("cart_pendulum", "nominal")
    law = lab.controller(experiment, "physics", "fl-lqr")
    assert pytest.approx(np.array([K]), rel=1e-9) == law.parameters.K


def test_runs_of_a_varied_run_cache_have_its_duration() -> None:
    experiment = find_experiment("cart_pendulum", "nominal")
    result = LAB.varied("run.duration", 0.01).run(experiment, "physics", "fl-lqr")
    assert result.trajectory.time[-1] == pytest.approx(0.01)


# Verdicts of invented claims, in a run cache that is nothing but a level of refinement


@dataclass(frozen=True)
class Level:
    """A stub of a run cache: its level of refinement, and the measurements that were made."""

    depth: int = 0
    log: list[tuple[int, str]] = field(default_factory=list)

    @property
    def refined(self) -> Level:
        return Level(self.depth + 1, self.log)


@dataclass(frozen=True)
class Invented:
    """A measurement with these values, by level or by plant; without values, the size."""

    values: Sequence[ClaimValue] | Mapping[str, ClaimValue]

    def __call__(self, lab: Any, plant: PlantName, size: float = 2.5) -> ClaimValue:
        if size < 0:
            raise GainError("no gain")
        lab.log.append((lab.depth, plant))
        if isinstance(self.values, Mapping):
            return self.values[plant]
        if lab.depth < len(self.values):
            return self.values[lab.depth]
        return ClaimValue(size)


def invented(
    values: Sequence[ClaimValue] | Mapping[str, ClaimValue],
    plants: Sequence[str] = ("physics",),
    **changes: Any,
) -> Claim:
    """A claim with the threshold 2 and an invented measurement."""
    fields: dict[str, Any] = {
        "id": "invented",
        "system": "servo",
        "statement": "s",
        "source": "section 1",
        "criterion": "c",
        "why": "w",
        "measure": Invented(values),
        "sense": "at most",
        "threshold": 2.0,
        "unit": "1",
        "verdicts": dict.fromkeys(plants, SUPPORTED),
        "reason": "r.",
        "untested": "u",
    }
    return Claim(**{**fields, **changes})


def judged(claim: Claim, level: Any = None, **options: Any) -> ClaimFinding:
    stub: Any = level or Level()
    return judge(stub, claim, **options)


BELOW = ClaimValue(math.nextafter(2.0, 0.0))
ABOVE = ClaimValue(math.nextafter(2.0, 3.0))
AT = ClaimValue(2.0)
NONE = ClaimValue(None)
NAN = ClaimValue(math.nan)
TIME_STEPS = [
    # The threshold itself supports, and no value refutes.
    (BELOW, BELOW, SUPPORTED, REFUTED),
    (AT, AT, SUPPORTED, SUPPORTED),
    (ABOVE, ABOVE, REFUTED, SUPPORTED),
    (NONE, NONE, REFUTED, REFUTED),
    # A value that moves without crossing the threshold is conclusive, one that crosses is not.
    (ClaimValue(1.9), ClaimValue(0.1), SUPPORTED, REFUTED),
    (ClaimValue(1.0), ClaimValue(3.0), INCONCLUSIVE, INCONCLUSIVE),
    (ClaimValue(3.0), ClaimValue(1.0), INCONCLUSIVE, INCONCLUSIVE),
    # A run that ended early, or a value that is no number, is inconclusive.
    (ClaimValue(1.0, broken=True), ClaimValue(1.0), INCONCLUSIVE, INCONCLUSIVE),
    (ClaimValue(3.0), ClaimValue(3.0, broken=True), INCONCLUSIVE, INCONCLUSIVE),
    (NAN, NAN, INCONCLUSIVE, INCONCLUSIVE),
]
over_time_steps = pytest.mark.parametrize(("coarse", "fine", "at_most", "at_least"), TIME_STEPS)


@over_time_steps
def test_verdict_by_the_values_at_both_time_steps(
    coarse: ClaimValue, fine: ClaimValue, at_most: ClaimVerdict, at_least: ClaimVerdict
) -> None:
    assert judged(invented([coarse, fine])).verdict is at_most
    assert judged(invented([coarse, fine], sense="at least")).verdict is at_least


@over_time_steps
def test_a_premise_is_named_only_where_the_claim_failed(
    coarse: ClaimValue, fine: ClaimValue, at_most: ClaimVerdict, at_least: ClaimVerdict
) -> None:
    failing = judged(invented([coarse, fine], premise=lambda _: "too small"))
    if at_most is REFUTED:
        assert failing.verdict is PREMISE_NOT_MET
        assert failing.because == "too small"
    else:
        assert failing.verdict is at_most
        assert failing.because == ""
    assert judged(invented([coarse, fine], premise=lambda _: "")).verdict is at_most


# Whether a claim is exact, how it is judged, and the levels at which it is measured.
over_refinements = pytest.mark.parametrize(
    ("exact", "options", "depths"),
    [
        (True, {}, {0}),
        (False, {}, {0, 1}),
        (False, {"refine": False}, {0}),
    ],
)


def on_two_plants(exact: bool) -> Claim:
    """A claim that is refuted on the first plant, and supported on the last one."""
    values = {"printed": ClaimValue(9.0), "corrected": ClaimValue(1.0)}
    return invented(values, ("printed", "corrected"), exact=exact)


@over_refinements
def test_only_a_claim_that_is_not_exact_is_measured_twice(
    exact: bool, options: dict[str, bool], depths: set[int]
) -> None:
    claim = on_two_plants(exact)
    level = Level()
    result = judged(claim, level, **options)
    assert sorted(level.log) == sorted(itertools.product(depths, claim.plants))
    for on_plant in result.plants.values():
        assert (on_plant.refined is None) == (depths == {0})


@over_refinements
def test_the_last_plant_decides(exact: bool, options: dict[str, bool], depths: set[int]) -> None:
    result = judged(on_two_plants(exact), **options)
    assert result.verdict is SUPPORTED
    assert result.plants["printed"].verdict is REFUTED


@pytest.mark.parametrize(
    ("physics", "halved"),
    [
        (ClaimValue(1.0 + 1e-9), "corrected"),
        (ClaimValue(1.0 + 1e-5), "physics"),
        (ClaimValue(1.0, broken=True), "physics"),
        (ClaimValue(None), "physics"),
    ],
)
def test_time_steps_are_halved_on_the_equations_where_physics_gives_the_same(
    physics: ClaimValue, halved: str
) -> None:
    level = Level()
    values = {"corrected": ClaimValue(1.0), "physics": physics}
    claim = invented(values, ("corrected", "physics"))
    on_physics = judged(claim, level).plants["physics"]
    assert on_physics.measured == physics
    assert on_physics.finer == halved
    assert ((1, "physics") in level.log) == (halved == "physics")


@pytest.mark.parametrize(
    ("value", "near"), [(0.9, False), (1.1, True), (2.9, True), (3.1, False), (None, False)]
)
def test_a_value_within_half_of_the_threshold_is_near(value: float | None, near: bool) -> None:
    assert judged(invented([ClaimValue(value)] * 2)).near is near


class Chosen(NamedTuple):
    """A claim over the values of a choice.

    Attributes:
        values: Of the choice.
        meant: Its quantifier.
        verdict: Its verdict.
        holds: Answers at the values; None where the law cannot be designed.
        flip: Value at which the answer changes, if it does.
    """

    values: list[float]
    meant: dict[str, tuple[str, ...]]
    verdict: ClaimVerdict
    holds: list[bool | None]
    flip: float | None

    def claim(self, **changes: Any) -> Claim:
        choice = claims.Choice("size", tuple(self.values), argument="size")
        return invented([], choices=(choice,), **self.meant, **changes)


EVERY = {"every": ("size",)}
SOME = {"some": ("size",)}
CHOICES = [
    Chosen([1.0, 3.0], EVERY, UNDETERMINED, [True, False], 2.0),
    Chosen([3.0, 4.0], EVERY, REFUTED, [False, False], None),
    Chosen([1.0, 3.0], SOME, SUPPORTED, [True, False], 2.0),
    Chosen([3.0, 4.0], SOME, REFUTED, [False, False], None),
    Chosen([1.0, 3.0], {}, REFUTED, [True, False], 2.0),
    # A choice that cannot be designed tells nothing.
    Chosen([-1.0, 3.0], EVERY, REFUTED, [None, False], None),
]
over_choices = pytest.mark.parametrize("chosen", CHOICES)


@over_choices
def test_verdict_over_choices(chosen: Chosen) -> None:
    result = judged(chosen.claim())
    assert result.verdict is chosen.verdict
    assert bool(result.turns) == (chosen.verdict is UNDETERMINED)
    assert ("for every" in chosen.claim().quantifier) == ("every" in chosen.meant)


@over_choices
def test_a_premise_explains_a_verdict_over_choices(chosen: Chosen) -> None:
    result = judged(chosen.claim(premise=lambda _: "too small"))
    assert result.verdict is (PREMISE_NOT_MET if chosen.verdict is REFUTED else chosen.verdict)
    assert result.because == ("" if chosen.verdict is SUPPORTED else "too small")


def test_a_choice_that_is_printed_is_none_that_an_answer_turns_on() -> None:
    claim = CHOICES[0].claim()
    printed = replace(claim, choices=(replace(claim.choices[0], printed=True),))
    stub: Any = Level()
    (swept,) = sweep(stub, [printed])
    assert swept["flips"]
    assert sweeps_result([swept], LAB.settings).answers[0].words.startswith("0 of 1")


def test_lqr_on_the_plant_that_it_is_designed_for_has_no_excess_cost() -> None:
    """But for the sampling: J over J*, less 1, in percent."""
    excess = measures.excess_cost(
        LAB, "physics", system="servo", case="nominal", name="cost_continuous", controller="lqr"
    )
    assert excess.value == pytest.approx(0, abs=0.1)


@pytest.mark.parametrize(("sense", "words"), [("at most", "≤ 2 rad"), ("at least", "≥ 2 rad")])
def test_a_criterion_is_a_relation_to_the_threshold_in_its_unit(sense: str, words: str) -> None:
    assert story.criterion_text(invented([], sense=sense, unit="rad")) == words


@over_choices
def test_a_claim_that_holds_for_some_value_only_names_it(chosen: Chosen) -> None:
    result = judged(chosen.claim())
    assert result.needs == ("size = 1" if chosen.verdict is SUPPORTED else "")
    (statements,) = story.statements_tables([result])
    assert ("(with size = 1)" in statements.rows[0][1]) == (chosen.verdict is SUPPORTED)


@over_choices
def test_a_sweep_finds_where_the_answer_changes(chosen: Chosen) -> None:
    stub: Any = Level()
    (swept,) = sweep(stub, [chosen.claim()])
    words = sweeps_result([swept], LAB.settings).answers[0].words
    assert [trial["holds"] for trial in swept["values"]] == chosen.holds
    assert words.startswith("0 of 1" if chosen.flip is None else "1 of 1")
    if chosen.flip is None:
        assert swept["flips"] == ""
    else:
        size = float(swept["flips"].removeprefix("at size = "))
        assert size == pytest.approx(chosen.flip, abs=1 / 16)


def shifted(lab: Any, _: str, *, case: float, shift: float = 0.0) -> ClaimValue:
    """A measurement with an error of 2^-depth; without a value at 0, and of no run above 90."""
    if case > 90:
        raise claims.NoValueError("the run ended")
    if case == 0:
        return ClaimValue(None)
    return ClaimValue(case + shift + 0.5**lab.depth)


def extreme(cases: list[float], take: Any, shift: float = 0.0, **options: Any) -> ClaimValue:
    stub: Any = Level()
    return ClaimMeasurement(shifted, {"case": cases}, take, **options)(stub, "physics", shift=shift)


@pytest.mark.parametrize(
    ("measured", "expected"),
    [
        # 2 (3 + 1/2) - (3 + 1).
        (extreme([1.0, 3.0, 2.0], "largest", extrapolated=True), ClaimValue(3.0)),
        (extreme([1.0, 3.0, 2.0], "least", shift=1.0), ClaimValue(3.0)),
        (extreme([1.0, 0.0], "least"), ClaimValue(None)),
        (extreme([1.0, 99.0], "largest"), ClaimValue(None, "the run ended", broken=True)),
    ],
    ids=["extrapolated", "least", "no value at a point", "a run ended"],
)
def test_a_measurement_takes_the_extreme_of_its_points(
    measured: ClaimValue, expected: ClaimValue
) -> None:
    assert (measured.value, measured.broken) == (expected.value, expected.broken)
    assert measured.note.startswith(expected.note)


@pytest.mark.parametrize(
    ("name", "verdict", "value"),
    [
        # For every statistic: the worst.
        ("arm-tracking", SUPPORTED, 1.5),
        # For some region: the best.
        ("pendulum-region-robust", SUPPORTED, 1.5),
        # At least: none comes nearer.
        ("pendulum-disturbance-lqr", REFUTED, 1.5),
        # It turns on them: as declared.
        ("arm-rejects-d", UNDETERMINED, 1.0),
    ],
)
def test_one_measurement_represents_several_choices(
    name: str, verdict: ClaimVerdict, value: float
) -> None:
    trials = {"one": ClaimValue(0.6), "other": ClaimValue(1.5)}
    result = replace(finding(BY_ID[name], verdict, 1.0), trials=trials)
    assert result.representative.value == value


over_sentences = pytest.mark.parametrize(
    ("verdicts", "together"),
    [
        ([SUPPORTED, SUPPORTED, SUPPORTED], SUPPORTED),
        ([REFUTED, PREMISE_NOT_MET, UNDETERMINED, INCONCLUSIVE, SUPPORTED], REFUTED),
        ([UNDETERMINED, PREMISE_NOT_MET, INCONCLUSIVE], PREMISE_NOT_MET),
        ([INCONCLUSIVE, UNDETERMINED], UNDETERMINED),
        ([SUPPORTED, INCONCLUSIVE], INCONCLUSIVE),
    ],
)


@over_sentences
def test_claims_under_one_sentence_have_one_verdict(
    verdicts: list[ClaimVerdict], together: ClaimVerdict
) -> None:
    findings = [finding(BY_ID["theorem-1"], verdict) for verdict in verdicts]
    assert claims.Sentence("quote", tuple(findings)).verdict is together
    assert claims.verdicts_of(findings, Kind.CLAIM) == [together]


@over_sentences
def test_questions_are_counted_one_by_one(
    verdicts: list[ClaimVerdict], together: ClaimVerdict
) -> None:
    questions = [finding(BY_ID["servo-bench-load"], verdict) for verdict in verdicts]
    assert claims.verdicts_of(questions, Kind.QUESTION) == verdicts
    assert claims.sentences_of(questions) == []


# Tables, documents and the page

SENTENCES = claims.sentences_of(EXPECTED)
# Ids of the claims that are not supported, with their causes.
CAUSES = {
    expected.claim.id: expected.claim.cause
    for expected in EXPECTED
    if expected.verdict is not SUPPORTED
}


def counts_row() -> list[str]:
    """The row of the chapter's sentences in the table of counts."""
    verdicts = [sentence.verdict for sentence in SENTENCES]
    counts = [str(verdicts.count(verdict)) for verdict in ClaimVerdict]
    return [Kind.CLAIM.value, *counts, str(len(SENTENCES))]


def test_no_quote_is_a_part_of_another() -> None:
    """Quotes that are parts of one sentence would count it twice."""
    quotes = [sentence.quote for sentence in SENTENCES]
    assert [(a, b) for a, b in itertools.permutations(quotes, 2) if a in b] == []


def test_the_document_has_every_sentence_with_its_verdict() -> None:
    content = claims_result(EXPECTED, LAB.settings)
    tables = {sheet.table.title: sheet.table.rows for sheet in content.sheets}
    rows = [(quote, verdict) for quote, _, verdict in tables[Kind.CLAIM.value]]
    assert rows == [(sentence.quote, sentence.verdict.value) for sentence in SENTENCES]


def test_the_table_of_causes_has_every_claim_that_is_not_supported() -> None:
    causes = {}
    for cause, ids, _ in story.causes_table(EXPECTED).rows:
        causes |= dict.fromkeys(ids.split(", "), cause)
    assert causes == CAUSES


def test_the_page_has_the_counts() -> None:
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    assert f"| {' | '.join(counts_row())} |" in lines


def test_the_page_has_every_sentence() -> None:
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    for sentence in SENTENCES:
        (line,) = [line for line in lines if line.startswith(f"| {sentence.quote} |")]
        assert line.endswith(f" {sentence.verdict.value} |")
        assert all(under.claim.id in line for under in sentence.findings)


def test_the_page_tells_every_claim_that_is_not_supported() -> None:
    headings = re.findall(r"^### (.+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert set(CAUSES) <= set(headings)


def result_of_misprint(verdict: ClaimVerdict | None) -> dict[str, Any]:
    """The document of a claim without a number: with its expected verdict, or another one."""
    misprint = finding(BY_ID["arm-eq57"], verdict, math.nan)
    return json.loads(json_text(claims_result([misprint], LAB.settings)))


@pytest.mark.parametrize("verdict", [None, SUPPORTED])
def test_a_result_of_claims_holds_no_nan(verdict: ClaimVerdict | None) -> None:
    content = result_of_misprint(verdict)
    assert content["claims"][0]["plants"]["corrected"]["value"] is None


@pytest.mark.parametrize(
    ("verdict", "words", "value"),
    [
        (None, "All verdicts are as expected", "as expected"),
        (SUPPORTED, "1 of 1 verdict differs from the expected ones", "not as expected"),
    ],
)
def test_a_result_of_claims_says_whether_verdicts_are_as_expected(
    verdict: ClaimVerdict | None, words: str, value: str
) -> None:
    document = Result.model_validate(result_of_misprint(verdict))
    assert document.answers[0].words == words
    assert document.values[0].value == value


def test_verdicts_that_are_not_expected_are_named() -> None:
    assert verdict_differences(EXPECTED) == []
    differences = verdict_differences([finding(BY_ID["arm-eq57"], SUPPORTED)])
    assert differences == ["claim arm-eq57 on printed: supported, expected refuted"]


def test_every_claim_stands_in_one_table_within_the_width_whatever_its_verdict() -> None:
    verdicts = itertools.cycle(ClaimVerdict)
    mixed = [finding(claim, verdict) for claim, verdict in zip(CLAIMS, verdicts, strict=False)]
    names = [row[0] for table in story.statements_tables(mixed) for row in table.rows]
    assert sorted(names) == sorted(BY_ID)
    assert too_wide(*story.claims_tables(mixed)) == []


@pytest.mark.slow
def test_the_command_tells_and_draws_one_claim(store: Store) -> None:
    told = store.command("claims", "arm-epsilon")
    assert told.code == cli.DONE
    for words in ("REFUTED", "Theorem 3", "along a run that stays on its surface", "|d/M(q)|"):
        assert words in told.said
    assert (told.folder / "claims" / "arm-epsilon.png").stat().st_size > 10_000


def test_the_command_answers_briefly_where_all_verdicts_are_as_expected(
    printed: Any, monkeypatch: Patch
) -> None:
    monkeypatch.setattr(claims_command, "judge_in_processes", lambda *_: EXPECTED)
    printed("claims")


@pytest.mark.parametrize(
    ("place", "claim"),
    [
        ("Fig. 3", "pendulum-variation-lqr"),
        ("fig 4", "pendulum-comparison"),
        ("eq. (37)", "pendulum-naive-gain"),
        ("Eq 6", "servo-semidefinite"),
    ],
)
def test_claims_are_found_by_the_place_that_they_rest_on(place: str, claim: str) -> None:
    found = [item.id for item in select_claims(place)]
    assert claim in found
    assert "servo-inertia-lqr" not in found


def test_a_place_without_claims_is_told_where_equations_and_figures_are() -> None:
    with pytest.raises(ArgumentError, match=r"no claim rests on Fig\. 77: docs/map\.md leads"):
        select_claims("Fig. 77")


def test_a_sentence_is_not_counted_by_a_part_of_its_claims() -> None:
    """Of three claims under one sentence the two others are not judged."""
    (one,) = [finding for finding in EXPECTED if finding.claim.id == "servo-inertia-lqr"]
    assert counts_words([one]) == "1 of the 3 claims under one sentence: see docs/claims.md"
    assert counts_words(EXPECTED).startswith("sentences of the chapter: ")
    assert "claims under" not in counts_words(EXPECTED)

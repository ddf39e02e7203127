"""The claims: their data, how a verdict comes about, and the words and tables on them."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import run
from rich.cells import cell_len
from rich.console import Console
from shipped import SERVO_UNCERTAINTY, TWO_LINK_UNCERTAINTY

from grosmc_mj import cli
from grosmc_mj.chapter.claims import claim as claims
from grosmc_mj.chapter.claims import story
from grosmc_mj.chapter.claims.claim import (
    Choice,
    Claim,
    Finding,
    Kind,
    Measured,
    NoValueError,
    PlantFinding,
    Sentence,
    Verdict,
)
from grosmc_mj.chapter.claims.judging import judge, verdict_differences
from grosmc_mj.chapter.claims.ledger import CLAIMS, Measurement
from grosmc_mj.chapter.claims.measurements.arm import tracking
from grosmc_mj.chapter.claims.measurements.theory import optimal_gain
from grosmc_mj.chapter.claims.page import slips_table
from grosmc_mj.chapter.claims.results import claims_result, sweeps_result
from grosmc_mj.chapter.claims.sweep import stored_flips, stored_sweeps, sweep
from grosmc_mj.cli.commands import claims as claims_command
from grosmc_mj.errors import GainError
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.results.document import json_text
from grosmc_mj.results.result import Result
from grosmc_mj.results.tables import WIDTH

LAB = Laboratory(Settings())
PAGE = Path(cli.__file__).parents[2] / "docs" / "claims.md"
BY_ID = {claim.id: claim for claim in CLAIMS}
S, R, U, P, I = (
    Verdict.SUPPORTED, Verdict.REFUTED, Verdict.UNDETERMINED, Verdict.PREMISE_NOT_MET,
    Verdict.INCONCLUSIVE,
)  # fmt: skip


def finding(claim: Claim, verdict: Verdict | None = None, value: float = -1.234e-5) -> Finding:
    """A finding as wide as numbers get, with the expected verdicts or one for all plants."""
    measured = Measured(value, "something short")
    plants: dict[PlantName, PlantFinding] = {
        plant: PlantFinding(measured, Measured(value), verdict or claim.verdicts[plant])
        for plant in claim.plants
    }
    return Finding(claim, plants)


EXPECTED = [finding(claim) for claim in CLAIMS]


def measurement(claim: Claim) -> Measurement:
    assert isinstance(claim.measure, Measurement)
    return claim.measure


def too_wide(*tables: object) -> list[str]:
    """Lines that need more than the width, of a screen that has more."""
    console = Console(file=io.StringIO(), width=200, color_system=None)
    with console.capture() as capture:
        console.print(*tables)
    return [line for line in capture.get().splitlines() if cell_len(line.rstrip()) > WIDTH]


# The chapter's claims.


@pytest.mark.parametrize("judged", EXPECTED, ids=list(BY_ID))
def test_every_claim_has_its_place_criterion_verdict_and_cause(judged: Finding) -> None:
    claim = judged.claim
    words = (claim.statement, claim.source, claim.criterion, claim.why, claim.untested)
    assert all(map(str.strip, words))
    assert re.search(r"\d", claim.source), "no section, figure, equation or theorem"
    assert claim.reason.endswith(".")
    assert I not in claim.verdicts.values()
    # The physics is judged, unless no force makes the error or algebra has no plant.
    assert "physics" in claim.plants or claim.id in {"servo-unmatched", "proof-3"}
    assert bool(claim.cause) == (judged.verdict is not S)
    if judged.verdict is U:
        # The choice that turns it is one that it must hold for.
        turns = {x.name for x in claim.choices if not x.printed} & set(stored_flips(claim.id))
        assert turns & set(claim.every)
    assert judged.verdict is not P or claim.premise is not None
    assert bool(claim.quote) or claim.kind is not Kind.CLAIM
    assert not (claim.quote and claim.kind is Kind.QUESTION)
    tables = story.claim_tables(replace(judged, because="epsilon: " + "a reason " * 20))
    text = " ".join(cell for row in tables[0].rows for cell in row)
    assert [word for word in (*words[:4], claim.reason) if word not in text] == []
    assert too_wide(*tables) == []


def test_the_claims_rest_on_the_chapter_s_own_numbers() -> None:
    assert len(BY_ID) == len(CLAIMS) == 100
    systems = list(dict.fromkeys(claim.system for claim in CLAIMS))
    assert systems == ["servo", "cart_pendulum", "arm", "two_link_arm"]
    # No claim but Theorem 3, about any gain that exceeds its bound, has a gain of this project.
    own = [c.id for c in CLAIMS if c.kind is Kind.CLAIM and "epsilon" in measurement(c).arguments]
    assert own == ["theorem-3"]
    misprints = {claim.id for claim in CLAIMS if claim.kind is Kind.MISPRINT}
    assert misprints == {"proof-3", "servo-semidefinite", "pendulum-eq40", "arm-eq57"}
    # Claims of the continuous law are extrapolated to a sampling time of zero.
    assert {claim.id for claim in CLAIMS if measurement(claim).extrapolated} == {
        "servo-sliding-dynamics", "pendulum-sliding-dynamics", "arm-sliding-dynamics",
        "arm-asymptotic", "two-link-sliding-dynamics",
    }  # fmt: skip
    # A word has one number wherever it stands.
    limits = {(c.word, c.sense, c.threshold, c.unit, c.why) for c in CLAIMS if c.word}
    assert sorted(limit[0] for limit in limits) == sorted(claims.WORDS)
    # Both laws of a comparison are judged alike.
    for one, other in (
        ("pendulum-region", "pendulum-region-lqr"),
        ("pendulum-disturbance-grosmc", "pendulum-disturbance-lqr"),
        ("servo-load-grosmc", "servo-load-lqr"),
    ):
        ours, theirs = (measurement(BY_ID[name]) for name in (one, other))
        arguments = {**theirs.arguments, "controller": ours.arguments["controller"]}
        assert replace(theirs, arguments=arguments) == ours
    low, high = SERVO_UNCERTAINTY.scales["J"]
    assert f"outside {low:g} to {high:g} times" in BY_ID["servo-inertia-grosmc"].untested
    payload = measurement(BY_ID["two-link-projection"]).arguments["payload"]
    assert payload == TWO_LINK_UNCERTAINTY.scales["mp"][1]


def test_the_record_of_sweeps_is_about_these_claims_and_choices() -> None:
    recorded = [
        (row["claim"], row["choice"], [value["choice"] for value in row["values"]])
        for row in stored_sweeps()
    ]
    assert recorded == [
        (claim.id, choice.name, [choice.written(value) for value in choice.values])
        for claim in CLAIMS
        for choice in claim.choices
    ]


def test_errors_of_the_arm_are_shares_of_their_own_reference() -> None:
    """y_r = sin(pi t) is 1 rad large, its rate pi rad/s: the state less its error."""
    result = LAB.case("arm", "case1", "corrected", "grosmc")
    z, optimal = result.comparison.z, np.abs(result.comparison.optimal)
    reference = np.abs(result.trajectory.state - z)[result.comparison.time > 3.5].max(axis=0)
    assert reference == pytest.approx([1.0, math.pi], rel=1e-4)
    for state, size in enumerate(reference.tolist()):
        arrived = np.flatnonzero(optimal[:, state] > 2e-3 * size)[-1] + 1
        own = z[arrived:, state] / size
        for statistic, share in (("peak", np.abs(own).max()), ("RMS", np.sqrt(np.mean(own**2)))):
            measured = tracking(LAB, "corrected", state=state, statistic=statistic, arrived=0.2)
            assert measured.value == pytest.approx(100 * share, rel=1e-3)


def test_optimal_gain_is_riccati_s_where_the_weight_sees_every_state() -> None:
    """And with a weight that does not see the angle the least P is singular."""
    linear = find_experiment("servo", "nominal").law("corrected", "lqr").designed.lqr
    K, P = optimal_gain(linear.A, linear.B, np.eye(2))
    assert pytest.approx(linear.K, rel=1e-6) == K
    assert pytest.approx(linear.P, rel=1e-6) == P
    Q = np.diag([0.0, 1.0])
    K, P = optimal_gain(linear.A, linear.B, Q)
    assert np.abs(linear.A.T @ P + P @ linear.A - K.T @ K + Q).max() < 1e-6
    assert np.linalg.eigvalsh(P).min() == 0.0


# How a verdict comes about, with claims made up and a laboratory that is nothing but a level.


class Level:
    """A stub of a laboratory: its level of refinement, and the measurements that were made."""

    def __init__(self, depth: int = 0, log: list[tuple[float, str]] | None = None) -> None:
        self.depth, self.log = depth, [] if log is None else log

    @property
    def refined(self) -> Level:
        return Level(self.depth + 1, self.log)


def invented(
    values: Sequence[Measured] | dict[str, Measured], plants: Sequence[str] = ("physics",),
    **changes: Any,
) -> Claim:  # fmt: skip
    """A claim with the threshold 2 whose measure gives these values by level, or by plant."""

    def measure(lab: Any, plant: PlantName) -> Measured:
        lab.log.append((lab.depth, plant))
        return values[plant] if isinstance(values, dict) else values[lab.depth]

    fields: dict[str, Any] = {
        "id": "invented", "system": "servo", "statement": "s", "source": "section 1",
        "criterion": "c", "why": "w", "measure": measure, "sense": "at most", "threshold": 2.0,
        "unit": "1", "verdicts": dict.fromkeys(plants, S), "reason": "r.", "untested": "u",
    }  # fmt: skip
    return Claim(**{**fields, **changes})


def judged(claim: Claim, level: Any = None, **options: Any) -> Finding:
    stub: Any = level or Level()
    return judge(stub, claim, **options)


NONE, BROKEN = Measured(None), Measured(1.0, broken=True)


@pytest.mark.parametrize(
    ("levels", "at_most", "at_least"),
    [
        # The threshold itself supports, and no value refutes.
        ([Measured(math.nextafter(2.0, 0.0))] * 2, S, R),
        ([Measured(2.0)] * 2, S, S),
        ([Measured(math.nextafter(2.0, 3.0))] * 2, R, S),
        ([NONE] * 2, R, R),
        # A value that moves without crossing the threshold is conclusive, one that crosses not.
        ([Measured(1.9), Measured(0.1)], S, R),
        ([Measured(1.0), Measured(3.0)], I, I),
        ([Measured(3.0), Measured(1.0)], I, I),
        # So is nothing that ended early, or is no number.
        ([BROKEN, Measured(1.0)], I, I),
        ([Measured(3.0), Measured(3.0, broken=True)], I, I),
        ([Measured(math.nan)] * 2, I, I),
    ],
)
def test_verdict_by_the_values_at_both_time_steps(
    levels: list[Measured], at_most: Verdict, at_least: Verdict
) -> None:
    assert judged(invented(levels)).verdict is at_most
    assert judged(invented(levels, sense="at least")).verdict is at_least


def test_exact_claim_is_measured_once_and_others_twice_and_the_last_plant_decides() -> None:
    values = {"printed": Measured(9.0), "corrected": Measured(1.0)}
    for exact, options, depths in (
        (True, {}, {0}),
        (False, {}, {0, 1}),
        (False, {"refine": False}, {0}),
    ):
        level, claim = Level(), invented(values, ("printed", "corrected"), exact=exact)
        result = judged(claim, level, **options)
        assert sorted(level.log) == sorted((d, plant) for d in depths for plant in claim.plants)
        assert all((own.refined is None) == (depths == {0}) for own in result.plants.values())
        assert (result.verdict, result.plants["printed"].verdict) == (S, R)


@pytest.mark.parametrize(
    ("physics", "halved"),
    [
        (Measured(1.0 + 1e-9), "corrected"),
        (Measured(1.0 + 1e-5), "physics"),
        (BROKEN, "physics"),
        (NONE, "physics"),
    ],
)
def test_time_steps_are_halved_on_the_equations_where_physics_gives_the_same(
    physics: Measured, halved: PlantName
) -> None:
    values, level = {"corrected": Measured(1.0), "physics": physics}, Level()
    result = judged(invented(values, ("corrected", "physics")), level).plants["physics"]
    assert (result.measured, result.finer) == (physics, halved)
    assert ((1, "physics") in level.log) == (halved == "physics")


def turning(values: Sequence[float], **meant: Any) -> Claim:
    """A claim that holds for sizes up to 2, tried with these; 2.5 where nothing else is named."""

    def measure(_: Any, plant: PlantName, size: float = 2.5) -> Measured:
        if size < 0:
            raise GainError("no gain")
        return Measured(size)

    choice = Choice("size", tuple(values), argument="size")
    return replace(invented([]), measure=measure, choices=(choice,), **meant)


@pytest.mark.parametrize(
    ("values", "meant", "verdict"),
    [
        ([1.0, 3.0], {"every": ("size",)}, U),
        ([3.0, 4.0], {"every": ("size",)}, R),
        ([1.0, 3.0], {"some": ("size",)}, S),
        ([3.0, 4.0], {"some": ("size",)}, R),
        ([1.0, 3.0], {}, R),
        # A choice that cannot be designed says nothing.
        ([-1.0, 3.0], {"every": ("size",)}, R),
    ],
)
def test_verdict_over_choices(values: list[float], meant: Any, verdict: Verdict) -> None:
    claim = turning(values, **meant)
    result = judged(claim)
    assert result.verdict is verdict
    assert bool(result.turns) == (verdict is U)
    assert ("for every" in claim.quantifier) == ("every" in meant)
    # A claim that holds for some value only names it beside the verdict.
    assert result.needs == ("size = 1" if verdict is S else "")
    (statements,) = story.statements_tables([result])
    assert ("(with size = 1)" in statements.rows[0][1]) == (verdict is S)


@pytest.mark.parametrize(
    ("value", "near"), [(0.9, False), (1.1, True), (2.9, True), (3.1, False), (None, False)]
)
def test_a_verdict_near_its_threshold_is_labelled(value: float | None, near: bool) -> None:
    assert judged(invented([Measured(value)] * 2)).near is near


@pytest.mark.parametrize(
    ("levels", "premise", "verdict", "because"),
    [
        ([3.0, 3.0], "too small", P, "too small"),
        ([3.0, 3.0], "", R, ""),
        ([1.0, 1.0], "too small", S, ""),
        ([1.0, 3.0], "too small", I, ""),
    ],
)
def test_premise_is_named_only_where_the_claim_failed(
    levels: list[float], premise: str, verdict: Verdict, because: str
) -> None:
    result = judged(invented([Measured(v) for v in levels], premise=lambda _: premise))
    assert (result.verdict, result.because) == (verdict, because)
    result = judged(turning([1.0, 3.0], every=("size",), premise=lambda _: "too small"))
    assert (result.verdict, result.because) == (U, "too small")


@pytest.mark.parametrize(
    ("values", "holds", "flip"),
    [
        ([1.0, 3.0], [True, False], 2.0),
        ([0.5, 1.0], [True, True], None),
        ([-1.0, 3.0], [None, False], None),
    ],
)
def test_a_sweep_finds_where_the_answer_changes(
    values: list[float], holds: list[bool | None], flip: float | None
) -> None:
    (swept,) = sweep(Level(), [turning(values)])  # pyright: ignore[reportArgumentType]
    assert [trial["holds"] for trial in swept["values"]] == holds
    at = float(swept["flips"].removeprefix("at size = ")) if swept["flips"] else None
    assert at == (flip and pytest.approx(flip, abs=1 / 16))
    content = Result.model_validate(sweeps_result([swept], LAB))
    assert content.answers[0].words.startswith("1 of 1" if flip else "0 of 1")


def test_a_measurement_takes_the_extreme_and_extrapolates() -> None:
    def measure(lab: Any, _: str, *, case: float, shift: float = 0.0) -> Measured:
        if case > 90:
            raise NoValueError("the run ended")
        return Measured(case + shift + 0.5**lab.depth if case else None)

    for cases, take, options, shift, value in (
        # 2 (3 + 1/2) - (3 + 1)
        ([1.0, 3.0, 2.0], "largest", {"extrapolated": True}, 0.0, Measured(3.0)),
        ([1.0, 3.0, 2.0], "least", {}, 1.0, Measured(3.0)),
        ([1.0, 0.0], "least", {}, 0.0, Measured(None)),
        ([1.0, 99.0], "largest", {}, 0.0, Measured(None, "the run ended", broken=True)),
    ):
        extreme: Any = Measurement(measure, {"case": cases}, take, **options)  # pyright: ignore
        measured = extreme(Level(), "physics", shift=shift)
        assert (measured.value, measured.broken) == (value.value, value.broken)
        assert not value.note or measured.note == value.note


def test_a_laboratory_with_another_number_has_it_in_laws_and_runs() -> None:
    other = LAB.varied("task.Q", [400, 100])
    assert LAB.varied("task.Q", [400, 100]) is other
    experiment = find_experiment("cart_pendulum", "nominal")
    laws = [one.controller(experiment, "physics", "fl-lqr") for one in (LAB, other)]
    # Of a double integrator: sqrt(q1), sqrt(q2 + 2 sqrt(q1)).
    assert pytest.approx(np.array([[20.0, math.sqrt(140.0)]]), rel=1e-9) == laws[1].parameters.K
    assert pytest.approx(np.array([[10.0, math.sqrt(21.0)]]), rel=1e-9) == laws[0].parameters.K
    shorter = LAB.varied("run.duration", 0.01).run(experiment, "physics", "fl-lqr")
    assert shorter.trajectory.time[-1] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("name", "verdict", "shown"),
    [
        ("arm-tracking", S, 1.5),  # for every statistic: the worst
        ("pendulum-region-robust", S, 1.5),  # for some region: the best
        ("pendulum-disturbance-lqr", R, 1.5),  # at least: none comes nearer
        ("arm-rejects-d", U, 1.0),  # it turns on them: as declared
    ],
)
def test_the_measurement_that_stands_for_several_choices(
    name: str, verdict: Verdict, shown: float
) -> None:
    trials = {"one": Measured(0.6), "other": Measured(1.5)}
    assert replace(finding(BY_ID[name], verdict, 1.0), trials=trials).shown.value == shown


@pytest.mark.parametrize(
    ("verdicts", "together"),
    [([S, S, S], S), ([R, P, U, I, S], R), ([U, P, I], P), ([I, U], U), ([S, I], I)],
)
def test_claims_of_a_sentence_have_one_verdict(verdicts: list[Verdict], together: Verdict) -> None:
    claim = BY_ID["theorem-1"]
    findings = [finding(claim, verdict) for verdict in verdicts]
    assert Sentence(claim.quote, tuple(findings)).verdict is together
    assert claims.verdicts_of(findings, Kind.CLAIM) == [together]
    # Questions are no claims of the chapter: they are counted one by one.
    questions = [finding(BY_ID["servo-bench"], verdict) for verdict in verdicts]
    assert claims.verdicts_of(questions, Kind.QUESTION) == verdicts
    assert claims.sentences_of(questions) == []


# Tables, documents and the page.


def test_tables_fit_the_width_and_name_every_claim_once() -> None:
    for verdict in Verdict:
        findings = [finding(claim, verdict) for claim in CLAIMS]
        names = [row[0] for own in story.statements_tables(findings) for row in own.rows]
        assert sorted(names) == sorted(BY_ID)
        assert too_wide(*story.claims_tables(findings)) == []


def test_terminal_document_and_page_count_sentences() -> None:
    sentences = claims.sentences_of(EXPECTED)
    under = [one.claim.id for sentence in sentences for one in sentence.findings]
    assert sorted(under) == sorted(claim.id for claim in CLAIMS if claim.kind is Kind.CLAIM)
    # Quotes that are parts of one sentence would count it twice.
    quotes = [sentence.quote for sentence in sentences]
    assert [(a, b) for a in quotes for b in quotes if a != b and a in b] == []
    counts = [[one.verdict for one in sentences].count(verdict) for verdict in Verdict]
    content = claims_result(EXPECTED, LAB)
    sheets = {sheet["table"]["title"]: sheet["table"]["rows"] for sheet in content["sheets"]}
    rows = [[sentence.quote, sentence.verdict.value] for sentence in sentences]
    assert [[row[0], row[2]] for row in sheets[Kind.CLAIM.value]] == rows
    row = [Kind.CLAIM.value, *map(str, counts), str(len(sentences))]
    assert story.counts_table(EXPECTED).rows[0] == row
    causes = {cause: ids.split(", ") for cause, ids, _ in story.causes_table(EXPECTED).rows}
    failed = {own.claim.id: own.claim.cause for own in EXPECTED if own.verdict is not S}
    assert {name: cause for cause, own in causes.items() for name in own} == failed
    page = PAGE.read_text(encoding="utf-8").splitlines()
    assert f"| {' | '.join(row)} |" in page
    for sentence in sentences:
        (line,) = [line for line in page if line.startswith(f"| {sentence.quote} |")]
        assert line.endswith(f" {sentence.verdict.value} |")
        assert all(one.claim.id in line for one in sentence.findings)


def test_page_points_to_stories_and_files_that_are_there() -> None:
    """Every link of the page has its story, and every figure its file; slips are no claims."""
    text = PAGE.read_text(encoding="utf-8")
    links, stories = re.findall(r"\]\(#([\w-]+)\)", text), re.findall(r"^### (.+)$", text, re.M)
    assert set(links) == {*stories, "what-the-claims-turn-on"}
    figures = re.findall(r"!\[[\w-]+\]\(([^)]+)\)", text)
    assert all((PAGE.parent / name).is_file() for name in figures)
    assert {one.claim.id for one in EXPECTED if one.verdict is not S} <= set(stories)
    slips = slips_table().rows
    assert len(slips) > 10
    assert all(where in text.partition("## Slips")[2] for where, *_ in slips)
    assert not any(name in " ".join(slip) for slip in slips for name in BY_ID)


def test_a_result_of_claims_answers_and_holds_no_nan() -> None:
    claim = BY_ID["arm-eq57"]
    for verdict, words, value in (
        (None, "All verdicts are as expected", "as expected"),
        (S, "1 of 1 verdicts differ from the expected ones", "not as expected"),
    ):
        content = json.loads(json_text(claims_result([finding(claim, verdict, math.nan)], LAB)))
        assert content["claims"][0]["plants"]["corrected"]["value"] is None
        known = Result.model_validate(content)
        assert (known.answers[0].words, known.values[0].value) == (words, value)
    assert verdict_differences(EXPECTED) == []
    differences = verdict_differences([finding(claim, S)])
    assert differences == ["claim arm-eq57 on printed: supported, expected refuted"]


def test_the_answer_on_all_claims_comes_first_and_fits_on_a_screen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(claims_command, "judge_with_progress", lambda *_: EXPECTED)
    assert run("claims", "--out", tmp_path) == cli.DONE
    lines = capsys.readouterr().out.rstrip("\n").split("\n")
    assert lines[0].startswith("All verdicts are as expected")
    assert len(lines) <= 40


@pytest.mark.slow
def test_the_command_shows_and_draws_one_claim(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("claims", "arm-epsilon", "--out", tmp_path) == cli.DONE
    output = capsys.readouterr().out
    for words in ("REFUTED", "Theorem 3", "along a run that stays on its surface", "|d/M(q)|"):
        assert words in output
    figure = (tmp_path / "claims" / "arm-epsilon.png").read_bytes()
    assert figure.startswith(b"\x89PNG")
    assert len(figure) > 10_000

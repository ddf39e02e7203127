"""The claims: their data, how a verdict comes about, and what is written of them."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from commands import run
from rich.cells import cell_len
from rich.console import Console
from shipped import SERVO_UNCERTAINTY, TWO_LINK_UNCERTAINTY

from grosmc_mj import cli
from grosmc_mj.chapter.claims import ledger
from grosmc_mj.chapter.claims.claim import (
    WORDS,
    Choice,
    Claim,
    Finding,
    Kind,
    Measured,
    NoValueError,
    PlantFinding,
    Sentence,
    Verdict,
    sentences_of,
    verdicts_of,
)
from grosmc_mj.chapter.claims.judging import judge, verdict_differences
from grosmc_mj.chapter.claims.ledger import CLAIMS, Measurement
from grosmc_mj.chapter.claims.measurements.arm import tracking
from grosmc_mj.chapter.claims.measurements.theory import optimal_gain
from grosmc_mj.chapter.claims.page import slips_table
from grosmc_mj.chapter.claims.results import claims_result, sweeps_result
from grosmc_mj.chapter.claims.story import (
    causes_table,
    claim_tables,
    claims_tables,
    counts_table,
    statements_tables,
)
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

# No force makes an unmatched error, and algebra has no plant.
NO_PHYSICS = {"servo-unmatched", "proof-3"}
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
    console.print(*tables)
    assert isinstance(console.file, io.StringIO)
    lines = console.file.getvalue().splitlines()
    return [line for line in lines if cell_len(line.rstrip()) > WIDTH]


# The chapter's claims.


@pytest.mark.parametrize("found", EXPECTED, ids=list(BY_ID))
def test_every_claim_has_its_place_criterion_verdict_and_cause(found: Finding) -> None:
    claim = found.claim
    for name in ("statement", "source", "criterion", "why", "untested"):
        assert getattr(claim, name).strip(), name
    assert re.search(r"\d", claim.source), "no section, figure, equation or theorem"
    assert claim.reason.endswith(".")
    assert I not in claim.verdicts.values()
    # What is judged is the physics, unless no force can make it or the equations are at stake.
    assert "physics" in claim.plants or claim.id in NO_PHYSICS
    assert bool(claim.cause) == (found.verdict is not S)
    if found.verdict is U:
        # The choice that turns it is one that it must hold for.
        turns = {x.name for x in claim.choices if not x.printed} & set(stored_flips(claim.id))
        assert turns & set(claim.every)
    assert found.verdict is not P or claim.premise is not None
    assert bool(claim.quote) or claim.kind is not Kind.CLAIM
    assert not (claim.quote and claim.kind is Kind.QUESTION)
    story, values = claim_tables(replace(found, because="epsilon: " + "a reason " * 20))
    told = " ".join(cell for row in story.rows for cell in row)
    for words in (claim.statement, claim.source, claim.criterion, claim.why, claim.reason):
        assert words in told
    assert too_wide(story, values) == []


def test_what_the_claims_rest_on() -> None:
    assert len(BY_ID) == len(CLAIMS) == 100
    systems = list(dict.fromkeys(claim.system for claim in CLAIMS))
    assert systems == ["servo", "cart_pendulum", "arm", "two_link_arm"]
    # No claim but Theorem 3, about any gain that exceeds its bound, has a gain of this project.
    own = [c.id for c in CLAIMS if c.kind is Kind.CLAIM and "epsilon" in measurement(c).arguments]
    assert own == ["theorem-3"]
    misprints = {claim.id for claim in CLAIMS if claim.kind is Kind.MISPRINT}
    assert misprints == {"proof-3", "servo-semidefinite", "pendulum-eq40", "arm-eq57"}
    # What is claimed of the continuous law is extrapolated to a sampling time of zero.
    assert {claim.id for claim in CLAIMS if measurement(claim).extrapolated} == {
        "servo-sliding-dynamics", "pendulum-sliding-dynamics", "arm-sliding-dynamics",
        "arm-asymptotic", "two-link-sliding-dynamics",
    }  # fmt: skip
    # A word has one number wherever it is said.
    limits = {word: set() for word in WORDS}
    for claim in CLAIMS:
        if claim.word:
            limits[claim.word].add((claim.sense, claim.threshold, claim.unit, claim.why))
    assert {word for word, own in limits.items() if len(own) != 1} == set()
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
    lab = Laboratory(Settings())
    result = lab.case("arm", "case1", "corrected", "grosmc")
    z, optimal = result.comparison.z, np.abs(result.comparison.optimal)
    reference = np.abs(result.trajectory.state - z)[result.comparison.time > 3.5].max(axis=0)
    assert reference == pytest.approx([1.0, math.pi], rel=1e-4)
    for state, size in enumerate(reference.tolist()):
        arrived = np.flatnonzero(optimal[:, state] > 2e-3 * size)[-1] + 1
        own = z[arrived:, state] / size
        for statistic, share in (("peak", np.abs(own).max()), ("RMS", np.sqrt(np.mean(own**2)))):
            found = tracking(lab, "corrected", state=state, statistic=statistic, arrived=0.2)
            assert found.value == pytest.approx(100 * share, rel=1e-3)


def test_optimal_gain_is_riccati_s_where_the_weight_sees_every_state() -> None:
    """And with a weight that does not see the angle the least P is singular."""
    linear = find_experiment("servo", "nominal").law("corrected", "lqr").designed.lqr
    K, P = optimal_gain(linear.A, linear.B, np.eye(2))
    assert pytest.approx(linear.K, rel=1e-6) == K
    assert pytest.approx(linear.P, rel=1e-6) == P
    K, P = optimal_gain(linear.A, linear.B, np.diag([0.0, 1.0]))
    assert np.abs(linear.A.T @ P + P @ linear.A - K.T @ K + np.diag([0.0, 1.0])).max() < 1e-6
    assert np.linalg.eigvalsh(P).min() == 0.0


# How a verdict comes about, with claims made up and a laboratory that is nothing but a level.


class Level:
    """A stub of a laboratory: its level of refinement, and the measurements made."""

    def __init__(self, depth: int = 0, made: list[tuple[float, str]] | None = None) -> None:
        self.depth = depth
        self.made = [] if made is None else made

    @property
    def refined(self) -> Level:
        return Level(self.depth + 1, self.made)


def made_up(
    values: Sequence[Measured] | dict[str, Measured],
    sense: Literal["at most", "at least"] = "at most",
    plants: tuple[PlantName, ...] = ("physics",),
    **changes: Any,
) -> Claim:
    """A claim with the threshold 2 whose measure gives these values by level, or by plant."""

    def measure(lab: Any, plant: PlantName) -> Measured:
        lab.made.append((lab.depth, plant))
        return values[plant] if isinstance(values, dict) else values[lab.depth]

    fields: dict[str, Any] = {
        "id": "made-up", "system": "servo", "statement": "s", "source": "section 1",
        "criterion": "c", "why": "w", "measure": measure, "sense": sense, "threshold": 2.0,
        "unit": "1", "verdicts": dict.fromkeys(plants, S), "reason": "r.", "untested": "u",
    }  # fmt: skip
    return Claim(**{**fields, **changes})


def judged(claim: Claim, level: Level | None = None, **options: Any) -> Finding:
    return judge(level or Level(), claim, **options)  # pyright: ignore[reportArgumentType]


TWINS: tuple[PlantName, ...] = ("corrected", "physics")
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
    assert judged(made_up(levels)).verdict is at_most
    assert judged(made_up(levels, "at least")).verdict is at_least


def test_exact_claim_is_measured_once_and_others_twice_and_the_last_plant_decides() -> None:
    for exact, options, depths in (
        (True, {}, {0}),
        (False, {}, {0, 1}),
        (False, {"refine": False}, {0}),
    ):
        level, values = Level(), {"printed": Measured(9.0), "corrected": Measured(1.0)}
        claim = made_up(values, exact=exact, plants=("printed", "corrected"))
        found = judged(claim, level, **options)
        assert sorted(level.made) == sorted((d, plant) for d in depths for plant in claim.plants)
        assert all((own.refined is None) == (depths == {0}) for own in found.plants.values())
        assert (found.verdict, found.plants["printed"].verdict) == (S, R)


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
    level = Level()
    claim = made_up({"corrected": Measured(1.0), "physics": physics}, plants=TWINS)
    found = judged(claim, level).plants["physics"]
    assert (found.measured, found.finer) == (physics, halved)
    assert ((1, "physics") in level.made) == (halved == "physics")


def turning(values: Sequence[float], **meant: Any) -> Claim:
    """A claim that holds for sizes up to 2, tried with these; 2.5 where nothing else is said."""

    def measure(_: Any, plant: PlantName, size: float = 2.5) -> Measured:
        if size < 0:
            raise GainError("no gain")
        return Measured(size)

    choice = Choice("size", tuple(values), argument="size")
    return replace(made_up([]), measure=measure, choices=(choice,), **meant)


@pytest.mark.parametrize(
    ("values", "meant", "verdict"),
    [
        ([1.0, 3.0], {"every": ("size",)}, U),
        ([3.0, 4.0], {"every": ("size",)}, R),
        ([1.0, 3.0], {"some": ("size",)}, S),
        ([3.0, 4.0], {"some": ("size",)}, R),
        ([1.0, 3.0], {}, R),
        # What cannot be designed says nothing.
        ([-1.0, 3.0], {"every": ("size",)}, R),
    ],
)
def test_verdict_over_choices(values: list[float], meant: Any, verdict: Verdict) -> None:
    claim = turning(values, **meant)
    found = judged(claim)
    assert found.verdict is verdict
    assert bool(found.turns) == (verdict is U)
    assert ("for every" in claim.quantifier) == ("every" in meant)
    # What holds for some value only names it beside the verdict.
    assert found.needs == ("size = 1" if verdict is S else "")
    (statements,) = statements_tables([found])
    assert ("(with size = 1)" in statements.rows[0][1]) == (verdict is S)


@pytest.mark.parametrize(
    ("value", "near"), [(0.9, False), (1.1, True), (2.9, True), (3.1, False), (None, False)]
)
def test_a_verdict_near_its_threshold_is_labelled(value: float | None, near: bool) -> None:
    assert judged(made_up([Measured(value)] * 2)).near is near


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
    found = judged(made_up([Measured(v) for v in levels], premise=lambda _: premise))
    assert (found.verdict, found.because) == (verdict, because)
    found = judged(turning([1.0, 3.0], every=("size",), premise=lambda _: "too small"))
    assert (found.verdict, found.because) == (U, "too small")


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
    content = Result.model_validate(sweeps_result([swept], Laboratory(Settings())))
    assert content.answers[0].words.startswith("1 of 1" if flip else "0 of 1")


def test_a_measurement_takes_the_extreme_and_extrapolates() -> None:
    def measure(lab: Any, _: str, *, case: float, shift: float = 0.0) -> Measured:
        if case > 90:
            raise NoValueError("the run ended")
        return Measured(case + shift + 0.5**lab.depth if case else None)

    lab: Any = Level()
    arguments = {"case": [1.0, 3.0, 2.0]}
    largest = Measurement(measure, arguments, "largest", extrapolated=True)
    assert largest(lab, "physics").value == 3.0  # 2 (3 + 1/2) - (3 + 1)
    assert Measurement(measure, arguments, "least")(lab, "physics", shift=1.0).value == 3.0
    assert Measurement(measure, {"case": [1.0, 0.0]}, "least")(lab, "physics").value is None
    broken = Measurement(measure, {"case": [1.0, 99.0]}, "largest")(lab, "physics")
    assert broken == Measured(None, "the run ended", broken=True)


def test_a_laboratory_with_another_number_has_it_in_laws_and_runs() -> None:
    lab = Laboratory(Settings())
    other = lab.varied("task.Q", [400, 100])
    assert lab.varied("task.Q", [400, 100]) is other
    experiment = find_experiment("cart_pendulum", "nominal")
    laws = [one.controller(experiment, "physics", "fl-lqr") for one in (lab, other)]
    # Of a double integrator: sqrt(q1), sqrt(q2 + 2 sqrt(q1)).
    assert pytest.approx(np.array([[20.0, math.sqrt(140.0)]]), rel=1e-9) == laws[1].parameters.K
    assert pytest.approx(np.array([[10.0, math.sqrt(21.0)]]), rel=1e-9) == laws[0].parameters.K
    shorter = lab.varied("run.duration", 0.01).run(experiment, "physics", "fl-lqr")
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
    assert verdicts_of(findings, Kind.CLAIM) == [together]
    # What is no claim of the chapter is counted one by one.
    questions = [finding(BY_ID["servo-bench"], verdict) for verdict in verdicts]
    assert verdicts_of(questions, Kind.QUESTION) == verdicts
    assert sentences_of(questions) == []


# What people read.


@pytest.mark.parametrize("verdict", list(Verdict))
def test_tables_fit_the_width_and_name_every_claim_once(verdict: Verdict) -> None:
    findings = [finding(claim, verdict) for claim in CLAIMS]
    assert too_wide(*claims_tables(findings)) == []
    names = [row[0] for own in statements_tables(findings) for row in own.rows]
    assert sorted(names) == sorted(BY_ID)


def test_terminal_document_and_page_count_sentences() -> None:
    sentences = sentences_of(EXPECTED)
    under = [one.claim.id for sentence in sentences for one in sentence.findings]
    assert sorted(under) == sorted(claim.id for claim in CLAIMS if claim.kind is Kind.CLAIM)
    # Quotes that are parts of one sentence would count it twice.
    quotes = [sentence.quote for sentence in sentences]
    assert [(a, b) for a in quotes for b in quotes if a != b and a in b] == []
    counts = [[one.verdict for one in sentences].count(verdict) for verdict in Verdict]
    content = claims_result(EXPECTED, Laboratory(Settings()))
    sheets = {sheet["table"]["title"]: sheet["table"]["rows"] for sheet in content["sheets"]}
    rows = [[sentence.quote, sentence.verdict.value] for sentence in sentences]
    assert [[row[0], row[2]] for row in sheets[Kind.CLAIM.value]] == rows
    row = [Kind.CLAIM.value, *map(str, counts), str(len(sentences))]
    assert counts_table(EXPECTED).rows[0] == row
    causes = {cause: ids.split(", ") for cause, ids, _ in causes_table(EXPECTED).rows}
    failed = {own.claim.id: own.claim.cause for own in EXPECTED if own.verdict is not S}
    assert {name: cause for cause, own in causes.items() for name in own} == failed
    page = PAGE.read_text(encoding="utf-8").splitlines()
    assert f"| {' | '.join(row)} |" in page
    for sentence in sentences:
        (line,) = [line for line in page if line.startswith(f"| {sentence.quote} |")]
        assert line.endswith(f" {sentence.verdict.value} |")
        assert all(one.claim.id in line for one in sentence.findings)


def test_page_points_to_what_is_there() -> None:
    """Every link of the page has its story, and every figure its file; slips are no claims."""
    text = PAGE.read_text(encoding="utf-8")
    links, stories = re.findall(r"\]\(#([\w-]+)\)", text), re.findall(r"^### (.+)$", text, re.M)
    assert set(links) == {*stories, "what-the-claims-turn-on"}
    for name in re.findall(r"!\[[\w-]+\]\(([^)]+)\)", text):
        assert (PAGE.parent / name).is_file()
    assert {found.claim.id for found in EXPECTED if found.verdict is not S} <= set(stories)
    slips = slips_table().rows
    assert len(slips) > 10
    assert all(where in text.partition("## Slips")[2] for where, *_ in slips)
    assert not any(name in " ".join(slip) for slip in slips for name in BY_ID)


def test_a_result_of_claims_answers_and_holds_no_nan() -> None:
    claim, lab = BY_ID["arm-eq57"], Laboratory(Settings())
    for verdict, words, value in (
        (None, "All verdicts are as expected", "as expected"),
        (S, "1 of 1 verdicts differ from the expected ones", "not as expected"),
    ):
        found = [finding(claim, verdict, math.nan)]
        content = json.loads(json_text(claims_result(found, lab)))
        assert content["claims"][0]["plants"]["corrected"]["value"] is None
        known = Result.model_validate(content)
        assert (known.answers[0].words, known.values[0].value) == (words, value)
    assert verdict_differences(EXPECTED) == []
    found = verdict_differences([finding(claim, S)])
    assert found == ["claim arm-eq57 on printed: supported, expected refuted"]


def test_the_answer_on_all_claims_comes_first_and_fits_on_a_screen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(claims_command, "judge_with_progress", lambda *_: EXPECTED)
    assert run("claims", "--out", str(tmp_path)) == cli.DONE
    lines = capsys.readouterr().out.rstrip("\n").split("\n")
    assert lines[0].startswith("All verdicts are as expected")
    assert len(lines) <= 40


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("claims servoo", "did you mean 'servo'?"),
        ("claims arm-epsilonn", "did you mean 'arm-epsilon'?"),
        ("claims servo --page page.md", "--page page.md is about all claims"),
        ("claims --page page.txt", "ends in .md"),
        ("claims sweep servo --record", "leave out servo"),
        ("claims premises armm", "did you mean 'arm'?"),
        ("claims premises arm/case9", "valid: arm, ball_beam, cart_pendulum"),
        ("claims premises arm --controller grosmk", "did you mean 'grosmc'?"),
        ("claims premises", "SYSTEM"),
    ],
)
def test_wrong_use_gets_one_line_and_exit_code_2(
    arguments: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*arguments.split()) == cli.WRONG
    error = capsys.readouterr().err
    assert says in error
    assert error.startswith("grosmc-mj: ")
    assert error.count("\n") == 1


@pytest.mark.slow
def test_one_claim_is_told_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("claims", "arm-epsilon", "--out", str(tmp_path)) == cli.DONE
    told = capsys.readouterr().out
    for words in ("REFUTED", "Theorem 3", "along a run that stays on its surface", "|d/M(q)|"):
        assert words in told
    figure = tmp_path / "claims" / "arm-epsilon.png"
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert figure.stat().st_size > 10_000


@pytest.mark.slow
def test_validate_judges_the_claims_of_the_system(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = ("servo-circular-bound", "servo-load-lqr", "arm-eq57")
    monkeypatch.setattr(ledger, "CLAIMS", tuple(BY_ID[name] for name in few))
    assert run("validate", "servo", "--no-figures", "--out", str(tmp_path)) == cli.DONE
    document = json.loads((tmp_path / "validation.json").read_text(encoding="utf-8"))
    assert [claim["id"] for claim in document["claims"]] == list(few[:2])
    assert Result.model_validate(document).answers[0].verdict == "kept"

"""The claims: their data, how a verdict comes about, and the words and tables on them."""

from __future__ import annotations

import io
import itertools
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
from grosmc_mj.chapter.claims.claim import Claim, Finding, Kind, Measured, Verdict
from grosmc_mj.chapter.claims.judging import judge, verdict_differences
from grosmc_mj.chapter.claims.ledger import CLAIMS, Measurement
from grosmc_mj.chapter.claims.measurements.arm import tracking
from grosmc_mj.chapter.claims.measurements.theory import optimal_gain
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
    plants: dict[PlantName, claims.PlantFinding] = {
        plant: claims.PlantFinding(measured, Measured(value), verdict or claim.verdicts[plant])
        for plant in claim.plants
    }
    return Finding(claim, plants)


EXPECTED = [finding(claim) for claim in CLAIMS]


def measurement(name: str) -> Measurement:
    measure = BY_ID[name].measure
    assert isinstance(measure, Measurement)
    return measure


def too_wide(*tables: object) -> list[str]:
    """Lines that need more than the width, of a screen that has more."""
    console = Console(file=io.StringIO(), width=200, color_system=None)
    with console.capture() as capture:
        console.print(*tables)
    return [line for line in capture.get().splitlines() if cell_len(line.rstrip()) > WIDTH]


# The chapter's claims.


def test_every_claim_has_its_place_criterion_verdict_and_cause() -> None:
    for expected in EXPECTED:
        claim, verdict = expected.claim, expected.verdict
        words = (claim.statement, claim.source, claim.criterion, claim.why, claim.reason)
        assert all(map(str.strip, (*words, claim.untested))), claim.id
        assert re.search(r"\d", claim.source), "no section, figure, equation or theorem"
        # The physics is judged, unless no force makes the error or algebra has no plant.
        assert "physics" in claim.plants or claim.id in {"servo-unmatched", "proof-3"}
        assert bool(claim.cause) == (verdict is not S), claim.id
        assert claim.quote or claim.kind is not Kind.CLAIM
        assert verdict is not P or claim.premise is not None
        if verdict is U:
            # The choice that turns it is one that it must hold for.
            turns = {x.name for x in claim.choices if not x.printed} & set(stored_flips(claim.id))
            assert turns & set(claim.every), claim.id
        tables = story.claim_tables(replace(expected, because="epsilon: " + "a reason " * 20))
        text = " ".join(cell for row in tables[0].rows for cell in row)
        assert [word for word in words if word not in text] == []
        assert too_wide(*tables) == []


def test_the_claims_rest_on_the_chapter_s_own_numbers() -> None:
    assert len(BY_ID) == len(CLAIMS) == 100
    # No claim but Theorem 3, about any gain that exceeds its bound, has a gain of this project.
    chapter = [claim.id for claim in CLAIMS if claim.kind is Kind.CLAIM]
    assert [x for x in chapter if "epsilon" in measurement(x).arguments] == ["theorem-3"]
    misprints = {claim.id for claim in CLAIMS if claim.kind is Kind.MISPRINT}
    assert misprints == {"proof-3", "servo-semidefinite", "pendulum-eq40", "arm-eq57"}
    # A word has one number wherever it stands.
    limits = {(c.word, c.sense, c.threshold, c.unit, c.why) for c in CLAIMS if c.word}
    assert sorted(limit[0] for limit in limits) == sorted(claims.WORDS)
    # Both laws of a comparison are judged alike.
    for one, other in (
        ("pendulum-region", "pendulum-region-lqr"),
        ("pendulum-disturbance-grosmc", "pendulum-disturbance-lqr"),
        ("servo-load-grosmc", "servo-load-lqr"),
    ):
        ours, theirs = measurement(one), measurement(other)
        arguments = {**theirs.arguments, "controller": ours.arguments["controller"]}
        assert replace(theirs, arguments=arguments) == ours
    low, high = SERVO_UNCERTAINTY.scales["J"]
    assert f"outside {low:g} to {high:g} times" in BY_ID["servo-inertia-grosmc"].untested
    payload = measurement("two-link-projection").arguments["payload"]
    assert payload == TWO_LINK_UNCERTAINTY.scales["mp"][1]
    choices = [(claim.id, choice) for claim in CLAIMS for choice in claim.choices]
    for row, (name, choice) in zip(stored_sweeps(), choices, strict=True):
        assert (row["claim"], row["choice"]) == (name, choice.name)
        assert [x["choice"] for x in row["values"]] == list(map(choice.written, choice.values))


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


def test_a_laboratory_with_another_number_has_it_in_laws_and_runs() -> None:
    other = LAB.varied("task.Q", [400, 100])
    assert LAB.varied("task.Q", [400, 100]) is other
    experiment = find_experiment("cart_pendulum", "nominal")
    # Of a double integrator: sqrt(q1), sqrt(q2 + 2 sqrt(q1)).
    for lab, K in ((LAB, [10.0, math.sqrt(21.0)]), (other, [20.0, math.sqrt(140.0)])):
        law = lab.controller(experiment, "physics", "fl-lqr")
        assert pytest.approx(np.array([K]), rel=1e-9) == law.parameters.K
    shorter = LAB.varied("run.duration", 0.01).run(experiment, "physics", "fl-lqr")
    assert shorter.trajectory.time[-1] == pytest.approx(0.01)


# How a verdict comes about, with claims made up and a laboratory that is nothing but a level.


class Level:
    """A stub of a laboratory: its level of refinement, and the measurements that were made."""

    def __init__(self, depth: int = 0, log: list[tuple[int, str]] | None = None) -> None:
        self.depth, self.log = depth, [] if log is None else log

    @property
    def refined(self) -> Level:
        return Level(self.depth + 1, self.log)


def invented(
    values: Sequence[Measured] | dict[str, Measured], plants: Sequence[str] = ("physics",),
    **changes: Any,
) -> Claim:  # fmt: skip
    """A claim with the threshold 2 whose measure gives these values by level, or by plant."""

    def measure(lab: Any, plant: PlantName, size: float = 2.5) -> Measured:
        """By the size, where there are no values."""
        if size < 0:
            raise GainError("no gain")
        lab.log.append((lab.depth, plant))
        own = values[plant] if isinstance(values, dict) else values[lab.depth : lab.depth + 1]
        return own if isinstance(own, Measured) else own[0] if own else Measured(size)

    fields: dict[str, Any] = {
        "id": "invented", "system": "servo", "statement": "s", "source": "section 1",
        "criterion": "c", "why": "w", "measure": measure, "sense": "at most", "threshold": 2.0,
        "unit": "1", "verdicts": dict.fromkeys(plants, S), "reason": "r.", "untested": "u",
    }  # fmt: skip
    return Claim(**{**fields, **changes})


def judged(claim: Claim, level: Any = None, **options: Any) -> Finding:
    stub: Any = level or Level()
    return judge(stub, claim, **options)


def test_verdict_by_the_values_at_both_time_steps() -> None:
    below, above = math.nextafter(2.0, 0.0), math.nextafter(2.0, 3.0)
    for coarse, fine, at_most, at_least in (
        # The threshold itself supports, and no value refutes.
        (below, below, S, R), (2.0, 2.0, S, S), (above, above, R, S), (None, None, R, R),
        # A value that moves without crossing the threshold is conclusive, one that crosses not.
        (1.9, 0.1, S, R), (1.0, 3.0, I, I), (3.0, 1.0, I, I),
        # So is nothing that ended early, or is no number.
        (Measured(1.0, broken=True), 1.0, I, I), (3.0, Measured(3.0, broken=True), I, I),
        (math.nan, math.nan, I, I),
    ):  # fmt: skip
        values = [x if isinstance(x, Measured) else Measured(x) for x in (coarse, fine)]
        assert judged(invented(values)).verdict is at_most
        assert judged(invented(values, sense="at least")).verdict is at_least
        # A premise is named only where the claim failed.
        failed = judged(invented(values, premise=lambda _: "too small"))
        named = (P, "too small") if at_most is R else (at_most, "")
        assert (failed.verdict, failed.because) == named
        assert judged(invented(values, premise=lambda _: "")).verdict is at_most


def test_exact_claim_is_measured_once_and_others_twice_and_the_last_plant_decides() -> None:
    values = {"printed": Measured(9.0), "corrected": Measured(1.0)}
    for exact, options, depths in (
        (True, {}, {0}), (False, {}, {0, 1}), (False, {"refine": False}, {0})
    ):  # fmt: skip
        level, claim = Level(), invented(values, ("printed", "corrected"), exact=exact)
        result = judged(claim, level, **options)
        assert sorted(level.log) == sorted(itertools.product(depths, claim.plants))
        assert all((own.refined is None) == (depths == {0}) for own in result.plants.values())
        assert (result.verdict, result.plants["printed"].verdict) == (S, R)
    # Time steps are halved on the equations where physics gives the same.
    for physics, halved in (
        (Measured(1.0 + 1e-9), "corrected"), (Measured(1.0 + 1e-5), "physics"),
        (Measured(1.0, broken=True), "physics"), (Measured(None), "physics"),
    ):  # fmt: skip
        level, both = Level(), {"corrected": Measured(1.0), "physics": physics}
        own = judged(invented(both, ("corrected", "physics")), level).plants["physics"]
        assert (own.measured, own.finer) == (physics, halved)
        assert ((1, "physics") in level.log) == (halved == "physics")
    for value, near in ((0.9, False), (1.1, True), (2.9, True), (3.1, False), (None, False)):
        assert judged(invented([Measured(value)] * 2)).near is near


def test_verdict_over_choices() -> None:
    for values, meant, verdict, holds, flip in (
        ([1.0, 3.0], {"every": ("size",)}, U, [True, False], 2.0),
        ([3.0, 4.0], {"every": ("size",)}, R, [False, False], None),
        ([1.0, 3.0], {"some": ("size",)}, S, [True, False], 2.0),
        ([3.0, 4.0], {"some": ("size",)}, R, [False, False], None),
        ([1.0, 3.0], {}, R, [True, False], 2.0),
        # A choice that cannot be designed tells nothing.
        ([-1.0, 3.0], {"every": ("size",)}, R, [None, False], None),
    ):
        choice = claims.Choice("size", tuple(values), argument="size")
        claim = invented([], choices=(choice,), premise=lambda _: "too small", **meant)
        result = judged(claim)
        assert result.verdict is (P if verdict is R else verdict)
        assert judged(replace(claim, premise=None)).verdict is verdict
        assert result.because == ("" if verdict is S else "too small")
        assert bool(result.turns) == (verdict is U)
        assert ("for every" in claim.quantifier) == ("every" in meant)
        # A claim that holds for some value only names it beside the verdict.
        assert result.needs == ("size = 1" if verdict is S else "")
        (statements,) = story.statements_tables([result])
        assert ("(with size = 1)" in statements.rows[0][1]) == (verdict is S)
        # A sweep finds where the answer changes.
        (swept,) = sweep(Level(), [claim])  # pyright: ignore[reportArgumentType]
        assert [trial["holds"] for trial in swept["values"]] == holds
        at = float(swept["flips"].removeprefix("at size = ")) if swept["flips"] else None
        assert at == (flip and pytest.approx(flip, abs=1 / 16))
        content = Result.model_validate(sweeps_result([swept], LAB))
        assert content.answers[0].words.startswith("1 of 1" if flip else "0 of 1")


def test_a_measurement_takes_the_extreme_and_extrapolates() -> None:
    def measure(lab: Any, _: str, *, case: float, shift: float = 0.0) -> Measured:
        if case > 90:
            raise claims.NoValueError("the run ended")
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


def test_several_choices_have_one_measurement_and_several_claims_one_verdict() -> None:
    trials = {"one": Measured(0.6), "other": Measured(1.5)}
    for name, verdict, shown in (
        ("arm-tracking", S, 1.5),  # for every statistic: the worst
        ("pendulum-region-robust", S, 1.5),  # for some region: the best
        ("pendulum-disturbance-lqr", R, 1.5),  # at least: none comes nearer
        ("arm-rejects-d", U, 1.0),  # it turns on them: as declared
    ):
        representative = replace(finding(BY_ID[name], verdict, 1.0), trials=trials).representative
        assert representative.value == shown
    for verdicts, together in (
        ([S, S, S], S), ([R, P, U, I, S], R), ([U, P, I], P), ([I, U], U), ([S, I], I)
    ):  # fmt: skip
        findings = [finding(BY_ID["theorem-1"], verdict) for verdict in verdicts]
        assert claims.Sentence("quote", tuple(findings)).verdict is together
        assert claims.verdicts_of(findings, Kind.CLAIM) == [together]
        # Questions are no claims of the chapter: they are counted one by one.
        questions = [finding(BY_ID["servo-bench"], verdict) for verdict in verdicts]
        assert claims.verdicts_of(questions, Kind.QUESTION) == verdicts
        assert claims.sentences_of(questions) == []


# Tables, documents and the page.


def test_terminal_document_and_page_count_sentences() -> None:
    sentences = claims.sentences_of(EXPECTED)
    # Quotes that are parts of one sentence would count it twice.
    quotes = [sentence.quote for sentence in sentences]
    assert [(a, b) for a, b in itertools.permutations(quotes, 2) if a in b] == []
    counts = [[one.verdict for one in sentences].count(verdict) for verdict in Verdict]
    content = claims_result(EXPECTED, LAB)
    sheets = {sheet["table"]["title"]: sheet["table"]["rows"] for sheet in content["sheets"]}
    rows = [[sentence.quote, sentence.verdict.value] for sentence in sentences]
    assert [[row[0], row[2]] for row in sheets[Kind.CLAIM.value]] == rows
    row = [Kind.CLAIM.value, *map(str, counts), str(len(sentences))]
    assert story.counts_table(EXPECTED).rows[0] == row
    failed = {own.claim.id: own.claim.cause for own in EXPECTED if own.verdict is not S}
    causes = [(cause, ids.split(", ")) for cause, ids, _ in story.causes_table(EXPECTED).rows]
    assert {name: cause for cause, own in causes for name in own} == failed
    text = PAGE.read_text(encoding="utf-8")
    page = text.splitlines()
    assert f"| {' | '.join(row)} |" in page
    for sentence in sentences:
        (line,) = [line for line in page if line.startswith(f"| {sentence.quote} |")]
        assert line.endswith(f" {sentence.verdict.value} |")
        assert all(one.claim.id in line for one in sentence.findings)
    assert set(failed) <= set(re.findall(r"^### (.+)$", text, re.M))


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
    mixed = [finding(x, v) for x, v in zip(CLAIMS, itertools.cycle(Verdict), strict=False)]
    names = [row[0] for own in story.statements_tables(mixed) for row in own.rows]
    assert sorted(names) == sorted(BY_ID)
    assert too_wide(*story.claims_tables(mixed)) == []


@pytest.mark.slow
def test_the_command_shows_and_draws_one_claim(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("claims", "arm-epsilon", "--out", tmp_path) == cli.DONE
    output = capsys.readouterr().out
    for words in ("REFUTED", "Theorem 3", "along a run that stays on its surface", "|d/M(q)|"):
        assert words in output
    assert (tmp_path / "claims" / "arm-epsilon.png").stat().st_size > 10_000
    monkeypatch.setattr(claims_command, "judge_with_progress", lambda *_: EXPECTED)
    assert run("claims", "--out", tmp_path) == cli.DONE
    lines = capsys.readouterr().out.rstrip("\n").split("\n")
    assert lines[0].startswith("All verdicts are as expected")
    assert len(lines) <= 40

"""The ledger: how a verdict comes about, what is written, and whether it notices what is wrong."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from rich.cells import cell_len
from rich.console import Console
from shipped import case_plant, controller_names, find_case

from grosmc_mj import cli
from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.balance import switching_rate
from grosmc_mj.chapter.claims import ledger as ledgers
from grosmc_mj.chapter.claims import reading
from grosmc_mj.chapter.claims.claim import (
    Choice,
    Claim,
    Finding,
    Kind,
    Measured,
    PlantFinding,
    Sentence,
    Verdict,
    sentences_of,
    verdicts_of,
)
from grosmc_mj.chapter.claims.faults import FAULTS
from grosmc_mj.chapter.claims.ledger import (
    CLAIMS,
    find_claim,
    judge,
    select_claims,
    verdict_differences,
)
from grosmc_mj.chapter.claims.measurements.theory import left_unseen, optimal_gain
from grosmc_mj.chapter.claims.reading import read_claims
from grosmc_mj.chapter.claims.self_test import Caught, self_test
from grosmc_mj.chapter.claims.sweep import STORED, stored_flips, sweep
from grosmc_mj.chapter.claims.words import WORDS
from grosmc_mj.chapter.claims_document import claim_document, claims_document
from grosmc_mj.chapter.claims_page import slips
from grosmc_mj.chapter.claims_tables import (
    WIDTH,
    caught_table,
    decisive,
    ledger_tables,
    sentences_table,
    story,
)
from grosmc_mj.cli.commands import claims as claims_command
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.reaching import nominal
from grosmc_mj.errors import GainError, SetupError
from grosmc_mj.executors.batch import Batch
from grosmc_mj.experiments.catalogue import chapter_controller, find_experiment
from grosmc_mj.experiments.laboratory import Fault, Laboratory
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.results.document import json_text

SYSTEMS = ("servo", "cart_pendulum", "arm", "two_link_arm")
# No force makes an unmatched error, and algebra has no plant.
NO_PHYSICS = {"servo-unmatched", "proof-3"}
PAGE = Path(cli.__file__).parents[2] / "docs" / "claims.md"
FILES = [Path(reading.__file__).with_name(f"{system}.toml") for system in SYSTEMS]
BY_ID = {claim.id: claim for claim in CLAIMS}
each_claim = pytest.mark.parametrize("claim", CLAIMS, ids=list(BY_ID))


def run(*arguments: str) -> int:
    """Exit code of the command line."""
    with pytest.raises(SystemExit) as stop:
        cli.main(arguments)
    assert isinstance(stop.value.code, int)
    return stop.value.code


# What the ledger says of each claim.


def test_ids_are_unique_and_every_system_has_claims() -> None:
    assert len(BY_ID) == len(CLAIMS)
    assert {claim.system for claim in CLAIMS} == set(SYSTEMS)
    assert [claim for name in SYSTEMS for claim in select_claims(name)] == list(CLAIMS)


@each_claim
def test_claim_says_where_it_is_from_how_it_is_judged_and_what_that_leaves_open(
    claim: Claim,
) -> None:
    for name in ("statement", "source", "criterion", "why", "untested"):
        assert getattr(claim, name).strip(), name
    assert math.isfinite(claim.threshold)
    # What is judged is the physics, unless no force can make it or the equations are at stake.
    if claim.plants[-1] != "physics":
        assert "physics" in claim.plants or claim.id in NO_PHYSICS
    assert re.search(r"\d", claim.source), "no section, figure, equation or theorem"


@each_claim
def test_every_verdict_is_expected_with_a_reason(claim: Claim) -> None:
    assert Verdict.INCONCLUSIVE not in claim.verdicts.values()
    assert claim.reason.endswith(".")


@each_claim
def test_what_is_not_supported_has_a_cause_and_what_is_open_a_choice(claim: Claim) -> None:
    verdict = claim.verdicts[claim.plants[-1]]
    assert bool(claim.cause) == (verdict is not Verdict.SUPPORTED)
    if verdict is Verdict.UNDETERMINED:
        assert claim.every
        assert not all(choice.printed for choice in claim.choices)
    if verdict is Verdict.PREMISE_NOT_MET:
        assert claim.premise is not None


def test_a_word_has_one_number_wherever_it_is_said() -> None:
    said = {word: set() for word in WORDS}
    for claim in CLAIMS:
        if claim.word:
            said[claim.word].add((claim.sense, claim.threshold, claim.unit, claim.why))
    assert {word for word, limits in said.items() if len(limits) != 1} == set()


def measurement(claim: Claim) -> tuple[Any, dict[str, Any]]:
    """A claim's measuring function, and what its file gives it but for the controller."""
    measure: Any = claim.measure
    return measure.func, {**measure.keywords, "controller": ""}


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("pendulum-region", "pendulum-region-lqr"),
        ("pendulum-disturbance-grosmc", "pendulum-disturbance-lqr"),
        ("servo-load-grosmc", "servo-load-lqr"),
    ],
)
def test_both_laws_of_a_comparison_are_judged_alike(one: str, other: str) -> None:
    assert measurement(BY_ID[one]) == measurement(BY_ID[other])
    assert BY_ID[one].unit == BY_ID[other].unit


def test_the_record_of_sweeps_is_about_these_claims_and_choices() -> None:
    content = json.loads(STORED.read_text(encoding="utf-8"))["sweeps"]
    recorded = [
        (each["claim"], each["choice"], [value["choice"] for value in each["values"]])
        for each in content
    ]
    assert recorded == [
        (claim.id, choice.name, [choice.written(value) for value in choice.values])
        for claim in CLAIMS
        for choice in claim.choices
    ]
    # What is undetermined turns on something that was swept.
    for claim in CLAIMS:
        if claim.verdicts[claim.plants[-1]] is Verdict.UNDETERMINED:
            assert stored_flips()[claim.id]


def test_optimal_gain_is_riccati_s_where_the_weight_sees_every_state() -> None:
    """And with a weight that does not see the angle the least P is singular."""
    linear = sound("servo", "lqr").designed.lqr
    K, P = optimal_gain(linear.A, linear.B, np.eye(2))
    assert pytest.approx(linear.K, rel=1e-6) == K
    assert pytest.approx(linear.P, rel=1e-6) == P
    K, P = optimal_gain(linear.A, linear.B, np.diag([0.0, 1.0]))
    assert np.abs(linear.A.T @ P + P @ linear.A - K.T @ K + np.diag([0.0, 1.0])).max() < 1e-6
    assert np.abs(np.linalg.eigvals(linear.A - linear.B @ K)).min() == 0.0
    assert np.linalg.eigvalsh(P).min() == 0.0


@pytest.mark.slow
def test_what_the_weight_sees_settles() -> None:
    lab = Laboratory(Settings())
    seen, unseen = (left_unseen(lab, "physics", angle=angle).value for angle in (1.0, 0.0))
    assert seen == pytest.approx(0.0, abs=1e-3)
    assert unseen is not None
    assert unseen > 50


def test_claim_of_a_variation_names_the_declared_range() -> None:
    from shipped import SERVO_UNCERTAINTY, TWO_LINK_UNCERTAINTY

    low, high = SERVO_UNCERTAINTY.scales["J"]
    assert f"outside {low:g} to {high:g} times" in BY_ID["servo-inertia-grosmc"].untested
    (_, heaviest), measure = TWO_LINK_UNCERTAINTY.scales["mp"], BY_ID["two-link-projection"].measure
    assert isinstance(measure, partial)
    assert measure.keywords == {"payload": heaviest}


# How the claims' files are read.

SOUND = """
[claim-1]
statement = "s"
source = "section 1"
criterion = "c"
measure = { function = "measures.deviation", case = "case1", controller = "lqr" }
limit = { at_most = 2.0, unit = "%" }
why = "w"
verdicts = { corrected = "refuted", physics = "supported" }
reason = "r."
untested = "u"
"""


def test_claim_is_what_its_file_says(tmp_path: Path) -> None:
    """With the system that the file has the name of, and the plants in the order of the file."""
    path = tmp_path / "arm.toml"
    path.write_text(SOUND, encoding="utf-8")
    # The other functions are named by the package's own files.
    (claim,) = [c for c in read_claims([*FILES, path]) if c.id == "claim-1"]
    assert (claim.system, claim.threshold, claim.kind) == ("arm", 2.0, Kind.CLAIM)
    assert claim.plants == ("corrected", "physics")
    assert claim.verdicts["corrected"] is Verdict.REFUTED
    lab = Laboratory(Settings())
    assert claim.measure(lab, "corrected") == BY_ID["arm-lqr-d"].measure(lab, "corrected")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[claim-1]", "[claim-1", "no valid TOML"),
        ("[claim-1]", "claim-2 = 1\n[claim-1]", "claim claim-2: 1 must be a table"),
        ('why = "w"', "", "claim claim-1: why must be given too"),
        ("why =", "whi =", "claim claim-1: unknown key 'whi': did you mean 'why'?"),
        ('why = "w"', "why = 1", "why = 1 must be a text"),
        ("untested", 'premiss = "p"\nuntested', "unknown key 'premiss': did you mean 'premise'?"),
        ("2.0", "2", "limit = {'at_most': 2, 'unit': '%'} must have at_most or at_least, a number"),
        ("at_most", "below", "limit = {'below': 2.0, 'unit': '%'} must have at_most or at_least"),
        ("2.0,", "2.0, at_least = 1.0,", "must have at_most or at_least, a number with a point"),
        ("refuted", "perhaps", "unknown verdict 'perhaps': valid: supported, refuted"),
        ("physics =", "physic =", "unknown plant 'physic': did you mean 'physics'?"),
        ('{ corrected = "refuted", physics = "supported" }', "{}", "verdicts name no plant"),
        ("measures.deviation", "measures.deviatoin", "did you mean 'measures.deviation'?"),
        ("function =", "funktion =", "unknown function None: valid: servo."),
        ('"measures.deviation"', "[]", "unknown function []: valid: servo."),
        (', case = "case1"', "", "measures.deviation: missing a required argument: 'case'"),
        ("case =", "cases =", "measure: measures.deviation: "),
        ("measures.deviation", "measures.outputs", "measures.outputs: too many positional"),
        ("", "", "no claim names servo.before_the_load, "),
    ],
)  # fmt: skip
def test_file_that_is_wrong_is_one_line(old: str, new: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(SOUND.replace(old, new, 1) if old else SOUND, encoding="utf-8")
    with pytest.raises(SetupError) as error:
        read_claims([path])
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_missing_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match=r"arm\.toml is missing: install again"):
        read_claims([tmp_path / "arm.toml"])


# How a verdict comes about, with made-up claims and a laboratory that is nothing but a level.


class Level:
    """A stub of a laboratory: which level of refinement it is at, and who asked."""

    def __init__(self, depth: int = 0, asked: list[tuple[int, str]] | None = None) -> None:
        self.depth = depth
        self.asked = [] if asked is None else asked

    @property
    def refined(self) -> Level:
        return Level(self.depth + 1, self.asked)


def made_up(
    values: Sequence[Measured] | dict[str, Measured],
    sense: Literal["at most", "at least"] = "at most",
    plants: tuple[PlantName, ...] = ("physics",),
    **changes: Any,
) -> Claim:
    """A claim with the threshold 2 whose measure gives these values by level, or by plant."""

    def measure(lab: Any, plant: PlantName) -> Measured:
        lab.asked.append((lab.depth, plant))
        return values[plant] if isinstance(values, dict) else values[lab.depth]

    fields: dict[str, Any] = {
        "id": "made-up", "system": "servo", "statement": "s", "source": "section 1",
        "criterion": "c", "why": "w", "measure": measure, "sense": sense, "threshold": 2.0,
        "unit": "1", "verdicts": dict.fromkeys(plants, Verdict.SUPPORTED), "reason": "r.",
        "untested": "u",
    }  # fmt: skip
    return Claim(**{**fields, **changes})


def judged(claim: Claim, level: Level | None = None, **options: Any) -> Finding:
    return judge(level or Level(), claim, **options)  # pyright: ignore[reportArgumentType]


TWINS: tuple[PlantName, ...] = ("corrected", "physics")
BELOW, AT, ABOVE = math.nextafter(2.0, 0.0), 2.0, math.nextafter(2.0, 3.0)


@pytest.mark.parametrize(
    ("sense", "value", "verdict"),
    [
        ("at most", BELOW, Verdict.SUPPORTED),
        ("at most", AT, Verdict.SUPPORTED),
        ("at most", ABOVE, Verdict.REFUTED),
        ("at least", BELOW, Verdict.REFUTED),
        ("at least", AT, Verdict.SUPPORTED),
        ("at least", ABOVE, Verdict.SUPPORTED),
        ("at most", None, Verdict.REFUTED),
        ("at least", None, Verdict.REFUTED),
    ],
)
def test_threshold_itself_supports_and_no_value_refutes(
    sense: Literal["at most", "at least"], value: float | None, verdict: Verdict
) -> None:
    assert judged(made_up([Measured(value)] * 2, sense)).verdict is verdict


@pytest.mark.parametrize("sense", ["at most", "at least"])
@pytest.mark.parametrize(
    "levels",
    [
        [Measured(1.0), Measured(3.0)],
        [Measured(3.0), Measured(1.0)],
        [Measured(1.0, broken=True), Measured(1.0)],
        [Measured(3.0), Measured(3.0, broken=True)],
        [Measured(None, broken=True), Measured(None, broken=True)],
    ],
    ids=["worse", "better", "broken at T", "broken at T/2", "broken"],
)
def test_verdict_that_depends_on_the_time_step_or_on_a_broken_run_is_none(
    sense: Literal["at most", "at least"], levels: list[Measured]
) -> None:
    assert judged(made_up(levels, sense)).verdict is Verdict.INCONCLUSIVE


def test_value_that_moves_without_crossing_the_threshold_is_conclusive() -> None:
    found = judged(made_up([Measured(1.9), Measured(0.1)]))
    assert found.verdict is Verdict.SUPPORTED
    assert found.plants["physics"].refined == Measured(0.1)


@pytest.mark.parametrize("sense", ["at most", "at least"])
def test_what_is_not_a_number_neither_supports_nor_refutes(
    sense: Literal["at most", "at least"],
) -> None:
    """0/0 says nothing about a claim, whichever way its inequality points."""
    found = judged(made_up([Measured(math.nan)] * 2, sense))
    assert found.verdict is Verdict.INCONCLUSIVE


def test_exact_claim_is_measured_once_and_others_twice() -> None:
    plants = ("printed", "corrected")
    for exact, options, depths in (
        (True, {}, {0}),
        (False, {}, {0, 1}),
        (False, {"refine": False}, {0}),
    ):
        level = Level()
        claim = made_up([Measured(1.0)] * 2, exact=exact, plants=plants)
        found = judged(claim, level, **options)
        assert sorted(level.asked) == sorted((d, plant) for d in depths for plant in plants)
        assert all((each.refined is None) == (depths == {0}) for each in found.plants.values())


@pytest.mark.parametrize(
    ("physics", "halved"),
    [
        (Measured(1.0), "corrected"),
        (Measured(1.0 + 1e-9), "corrected"),
        (Measured(1.0 + 1e-5), "physics"),
        (Measured(1.0, broken=True), "physics"),
        (Measured(None), "physics"),
    ],
    ids=["equal", "rounding", "another", "broken", "none"],
)
def test_time_steps_are_halved_on_the_equations_where_physics_gives_the_same(
    physics: Measured, halved: PlantName
) -> None:
    level = Level()
    claim = made_up({"corrected": Measured(1.0), "physics": physics}, plants=TWINS)
    found = judged(claim, level).plants["physics"]
    assert found.measured == physics
    assert found.finer == halved
    assert ((1, "physics") in level.asked) == (halved == "physics")


def test_what_smaller_steps_show_on_the_equations_counts_for_physics() -> None:
    values = {0: Measured(1.9), 1: Measured(2.1)}
    claim = replace(
        made_up([Measured(0.0)], plants=TWINS), measure=lambda lab, _plant: values[lab.depth]
    )
    found = judged(claim)
    assert [each.verdict for each in found.plants.values()] == [Verdict.INCONCLUSIVE] * 2


def test_the_last_plant_decides() -> None:
    values = {"printed": Measured(9.0), "corrected": Measured(9.0), "physics": Measured(1.0)}
    found = judged(made_up(values, plants=("printed", "corrected", "physics")))
    assert found.verdict is Verdict.SUPPORTED
    assert found.plants["printed"].verdict is Verdict.REFUTED
    found = judged(made_up(values, plants=("corrected", "physics", "printed")))
    assert found.verdict is Verdict.REFUTED


# What it turns on: a stub of a measurement that takes the choice's value for its own.
SIZE = Choice("size", printed=False, values=(1.0, 3.0), argument="size")


def turning(values: Sequence[float], plants: tuple[PlantName, ...] = ("physics",), **meant: Any):
    """A claim that holds for sizes up to 2, tried with these; 2.5 where nothing else is said."""

    def measure(_lab: Any, _plant: PlantName, size: float = 2.5) -> Measured:
        if size < 0:
            raise GainError("no gain")
        return Measured(size)

    choice = replace(SIZE, values=tuple(values))
    return replace(
        made_up([Measured(1.0)], plants=plants), measure=measure, choices=(choice,), **meant
    )


@pytest.mark.parametrize(
    ("values", "meant", "verdict"),
    [
        ([1.0, 3.0], {"every": ("size",)}, Verdict.UNDETERMINED),
        ([3.0, 4.0], {"every": ("size",)}, Verdict.REFUTED),
        ([1.0, 3.0], {"some": ("size",)}, Verdict.SUPPORTED),
        ([3.0, 4.0], {"some": ("size",)}, Verdict.REFUTED),
        ([1.0, 3.0], {}, Verdict.REFUTED),
        # What cannot be designed says nothing.
        ([-1.0, 3.0], {"every": ("size",)}, Verdict.REFUTED),
    ],
)
def test_verdict_over_choices(values: list[float], meant: Any, verdict: Verdict) -> None:
    claim = turning(values, **meant)
    found = judged(claim)
    assert found.verdict is verdict
    assert bool(found.turns) == (verdict is Verdict.UNDETERMINED)
    assert ("for every" in claim.quantifier) == ("every" in meant)


def test_what_holds_for_some_value_only_names_it_beside_the_verdict() -> None:
    found = judged(turning([1.0, 3.0], some=("size",)))
    assert found.needs == "size = 1"
    assert any("(with size = 1)" in line for line in printed(*ledger_tables([found])))
    assert claim_document(found, Laboratory(Settings()))["needs"] == "size = 1"
    # Neither what holds as declared nor what does not hold needs anything.
    assert judged(turning([1.0, 3.0], every=("size",))).needs == ""
    assert judged(made_up([Measured(1.0)] * 2)).needs == ""


@pytest.mark.parametrize("name", ["arm-quick", "arm-tracking", "arm-rejects-d", "pendulum-rest"])
def test_the_choice_that_turns_an_answer_is_one_that_the_claim_must_hold_for(name: str) -> None:
    claim = BY_ID[name]
    turns = {each.name for each in claim.choices if not each.printed} & set(stored_flips()[name])
    assert turns
    assert turns <= set(claim.every)
    assert set(claim.verdicts.values()) == {Verdict.UNDETERMINED}


def test_claims_of_the_chapter_rest_on_no_gain_of_this_project() -> None:
    """But for Theorem 3, whose words are about any gain that exceeds its bound."""
    given = {
        claim.id
        for claim in CLAIMS
        if claim.kind is Kind.CLAIM and "epsilon" in measurement(claim)[1]
    }
    assert given == {"theorem-3"}


@pytest.mark.parametrize(
    ("strange", "in_physics"),
    [
        # The nearest to 2 on either side.
        ((), [1.5, 3.0]),
        # One that was confirmed is another one there, so all are asked.
        ((3.0,), [0.5, 1.5, 3.0, 4.0]),
    ],
)
def test_equations_screen_the_choices_and_physics_confirms_the_nearest(
    strange: Sequence[float], in_physics: list[float]
) -> None:
    asked: list[float] = []

    def measure(_lab: Any, plant: PlantName, size: float = 2.5) -> Measured:
        if plant == "physics" and size != 2.5:
            asked.append(size)
            size -= 1.5 if size in strange else 0.0
        return Measured(size)

    claim = replace(
        turning([0.5, 1.5, 3.0, 4.0], TWINS, every=("size",)), measure=measure, exact=False
    )
    found = judged(claim, refine=False)
    assert sorted(set(asked)) == in_physics
    told = [measured.value for measured in found.trials.values()]
    assert told == [each - 1.5 if each in strange else each for each in (0.5, 1.5, 3.0, 4.0)]


def test_an_answer_without_a_value_is_asked_of_physics_too() -> None:
    """It decides like any other: here it is what the statement turns on."""
    asked: list[tuple[str, float]] = []

    def measure(_lab: Any, plant: PlantName, size: float = 1.0) -> Measured:
        asked.append((plant, size))
        return Measured(size if size < 2 else None)

    claim = replace(turning([1.5, 3.0], TWINS, every=("size",)), measure=measure)
    assert judged(claim, refine=False).verdict is Verdict.UNDETERMINED
    assert ("physics", 3.0) in asked


def test_a_verdict_near_its_threshold_is_labelled() -> None:
    for value, near in ((0.9, False), (1.1, True), (2.9, True), (3.1, False), (None, False)):
        assert judged(made_up([Measured(value)] * 2)).near is near


def test_a_premise_that_failed_is_the_verdict() -> None:
    claim = made_up([Measured(3.0)] * 2, premise=lambda _: "gain: too small")
    assert judged(claim).verdict is Verdict.PREMISE_NOT_MET
    kept = made_up([Measured(1.0)] * 2, premise=lambda _: "gain: too small")
    assert judged(kept).verdict is Verdict.SUPPORTED
    claim = replace(turning([1.0, 3.0], every=("size",)), premise=lambda _: "too small")
    found = judged(claim)
    assert (found.verdict, found.because) == (Verdict.UNDETERMINED, "too small")


def test_a_sweep_finds_where_the_answer_changes() -> None:
    (found,) = sweep(Level(), [turning([1.0, 3.0])])  # pyright: ignore[reportArgumentType]
    assert [holds for _, _, holds in found.values] == [True, False]
    assert float(found.flips.removeprefix("at size = ")) == pytest.approx(2.0, abs=1 / 16)
    (found,) = sweep(Level(), [turning([0.5, 1.0])])  # pyright: ignore[reportArgumentType]
    assert found.flips == ""
    (found,) = sweep(Level(), [turning([-1.0, 3.0])])  # pyright: ignore[reportArgumentType]
    assert [holds for _, _, holds in found.values] == [None, False]
    assert found.flips == ""


def test_a_laboratory_with_another_number_has_it_in_laws_and_runs() -> None:
    lab = Laboratory(Settings())
    other = lab.varied("task.Q", [400, 100])
    assert lab.varied("task.Q", [400, 100]) is other
    experiment = find_experiment("cart_pendulum", "nominal")
    laws = [each.controller(experiment, "physics", "fl-lqr") for each in (lab, other)]
    # Of a double integrator: sqrt(q1), sqrt(q2 + 2 sqrt(q1)).
    assert pytest.approx(np.array([[20.0, math.sqrt(140.0)]]), rel=1e-9) == laws[1].parameters.K
    assert pytest.approx(np.array([[10.0, math.sqrt(21.0)]]), rel=1e-9) == laws[0].parameters.K
    shorter = lab.varied("run.duration", 0.01).run(experiment, "physics", "fl-lqr")
    assert shorter.trajectory.time[-1] == pytest.approx(0.01)
    k = lab.varied("laws.grosmc.k", 5.0).controller(
        find_experiment("arm", "case1"), "physics", "grosmc"
    )
    assert k.parameters.k == 5.0


@pytest.mark.parametrize(
    ("levels", "because"),
    [
        ([3.0, 3.0], "gain: too small"),
        ([1.0, 1.0], ""),
        ([1.0, 3.0], ""),
    ],
    ids=["refuted", "supported", "inconclusive"],
)
def test_premise_is_named_only_where_the_claim_failed(levels: list[float], because: str) -> None:
    claim = made_up([Measured(v) for v in levels], premise=lambda _: "gain: too small")
    assert judged(claim).because == because


def test_failed_premise_of_a_sound_case_is_silent() -> None:
    assert judged(made_up([Measured(3.0)] * 2, premise=lambda _: "")).because == ""


def finding(claim: Claim, verdict: Verdict | None = None, value: float = -1.234e-5) -> Finding:
    """A finding as wide as numbers get, with the expected verdicts or one for all plants."""
    return Finding(
        claim,
        {
            plant: PlantFinding(
                Measured(value, "something short"),
                Measured(value),
                verdict or claim.verdicts[plant],
            )
            for plant in claim.plants
        },
    )


@pytest.mark.parametrize(
    ("name", "verdict", "shown"),
    [
        ("arm-tracking", Verdict.SUPPORTED, 1.5),  # for every statistic: the worst
        ("pendulum-region-robust", Verdict.SUPPORTED, 1.5),  # for some region: the best
        ("pendulum-disturbance-lqr", Verdict.REFUTED, 1.5),  # at least: none comes nearer
        ("arm-rejects-d", Verdict.UNDETERMINED, 1.0),  # it turns on them: as declared
    ],
)
def test_what_is_shown_of_several_choices(name: str, verdict: Verdict, shown: float) -> None:
    trials = {"one": Measured(0.6), "other": Measured(1.5)}
    found = replace(finding(BY_ID[name], verdict, 1.0), trials=trials)
    assert decisive(found).value == shown


def test_every_claim_of_the_chapter_quotes_it_and_no_question_does() -> None:
    assert {bool(claim.quote) for claim in CLAIMS if claim.kind is Kind.CLAIM} == {True}
    assert {bool(claim.quote) for claim in CLAIMS if claim.kind is Kind.QUESTION} == {False}


def test_what_is_counted_is_no_slip_and_a_wrong_equation_no_claim() -> None:
    said = " ".join(text for slip in slips() for text in slip)
    assert [claim.id for claim in CLAIMS if claim.id in said] == []
    assert "‖s‖₁" not in said
    for name in ("proof-3", "servo-semidefinite", "pendulum-eq40", "arm-eq57"):
        assert BY_ID[name].kind is Kind.MISPRINT


def test_slips_are_where_the_page_says() -> None:
    _, _, listed = PAGE.read_text(encoding="utf-8").partition("## Slips")
    assert len(slips()) > 10
    for where, _, _ in slips():
        assert where in listed


def test_expected_verdicts_make_no_difference() -> None:
    assert verdict_differences([finding(claim) for claim in CLAIMS]) == []


def test_each_other_verdict_makes_one_line() -> None:
    claim = BY_ID["arm-eq57"]
    found = verdict_differences([finding(claim, Verdict.SUPPORTED)])
    assert found == ["claim arm-eq57 on printed: supported, expected refuted"]
    found = verdict_differences([finding(claim, Verdict.INCONCLUSIVE)])
    assert [line.split(" on ")[1].split(":")[0] for line in found] == list(claim.plants)


# What people read.


def printed(*things: object) -> list[str]:
    """Lines as rich prints them on a wide screen."""
    console = Console(file=io.StringIO(), width=200, color_system=None)
    for thing in things:
        console.print(thing)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue().splitlines()


def too_wide(lines: Sequence[str]) -> list[str]:
    """Lines that do not fit, unless a single word of them does not."""
    return [
        line
        for line in lines
        if cell_len(line.rstrip()) > WIDTH
        and max(map(cell_len, line.split())) <= WIDTH - (len(line) - len(line.lstrip()))
    ]


# One verdict a sentence.
S, R, U, P, I = (
    Verdict.SUPPORTED, Verdict.REFUTED, Verdict.UNDETERMINED, Verdict.PREMISE_NOT_MET,
    Verdict.INCONCLUSIVE,
)  # fmt: skip


@pytest.mark.parametrize(
    ("verdicts", "together"),
    [
        ([S], S),
        ([S, S, S], S),
        ([S, R], R),
        ([R, P, U, I, S], R),
        ([S, P], P),
        ([U, P, I], P),
        ([S, U], U),
        ([I, U], U),
        ([S, I], I),
    ],
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


def test_every_claim_of_the_chapter_is_under_one_sentence() -> None:
    """Quotes that are parts of one sentence would count it twice."""
    sentences = sentences_of([finding(claim) for claim in CLAIMS])
    under = [each.claim.id for sentence in sentences for each in sentence.findings]
    assert sorted(under) == sorted(claim.id for claim in CLAIMS if claim.kind is Kind.CLAIM)
    quotes = [sentence.quote for sentence in sentences]
    assert [(a, b) for a in quotes for b in quotes if a != b and a in b] == []


def test_terminal_document_and_page_count_sentences() -> None:
    findings = [finding(claim) for claim in CLAIMS]
    sentences = sentences_of(findings)
    wanted = [[each.verdict for each in sentences].count(verdict) for verdict in Verdict]
    content = claims_document(findings, Laboratory(Settings()))
    assert list(content["verdicts"][Kind.CLAIM.plural].values()) == wanted
    assert [each["verdict"] for each in content["sentences"]] == [
        s.verdict.value for s in sentences
    ]
    row = [Kind.CLAIM.plural, *map(str, wanted), str(len(sentences))]
    lines = printed(claims_command.verdicts_table(findings))
    assert [line.split() for line in lines if Kind.CLAIM.plural in line] == [" ".join(row).split()]
    page = PAGE.read_text(encoding="utf-8").splitlines()
    (counts,) = [line for line in page if line.startswith(f"| {Kind.CLAIM.plural}")]
    assert [cell.strip() or "0" for cell in counts.split("|")[1:-1]] == row
    for sentence in sentences:
        (line,) = [line for line in page if line.startswith(f"| *{sentence.quote}*")]
        assert line.endswith(f" {sentence.verdict.value} |")
        assert all(each.claim.id in line for each in sentence.findings)


def test_sentences_fit_the_width() -> None:
    lines = printed(sentences_table([finding(claim) for claim in CLAIMS]))
    assert max(map(cell_len, lines)) <= WIDTH


@pytest.mark.parametrize("verdict", list(Verdict))
def test_ledger_fits_the_width_and_names_every_claim_once(verdict: Verdict) -> None:
    lines = printed(*ledger_tables([finding(claim, verdict) for claim in CLAIMS]))
    assert max(map(cell_len, lines)) <= WIDTH
    first_words = [line.split()[0] for line in lines if line.split()]
    for claim in CLAIMS:
        assert first_words.count(claim.id) == 1
    assert sum(verdict.value.upper() in line for line in lines) == len(CLAIMS)


def test_table_of_faults_fits_the_width() -> None:
    caught = [Caught(fault, tuple(BY_ID), len(BY_ID)) for fault in FAULTS]
    lines = printed(caught_table(caught))
    assert max(map(cell_len, lines)) <= WIDTH
    assert sum(f"{len(CLAIMS)} of {len(CLAIMS)}" in line for line in lines) == len(FAULTS)


@each_claim
def test_story_fits_the_width_and_leaves_nothing_out(claim: Claim) -> None:
    found = replace(finding(claim), because="epsilon (Theorem 3): " + "a long reason " * 20)
    lines = [line.plain for line in story(found, Laboratory(Settings()))]
    assert too_wide(lines) == []
    told = " ".join(" ".join(lines).split())
    for words in (claim.statement, claim.source, claim.criterion, claim.why, claim.untested):
        assert " ".join(words.split()) in told
    assert claim.reason in told


def test_story_with_a_long_note_fits_the_width() -> None:
    claim = BY_ID["arm-epsilon"]
    note = "ε = 8.54 along the run and 12.5 over the region, instead of 6"
    physics = PlantFinding(Measured(0.703, note), Measured(0.702, note), Verdict.REFUTED)
    lines = story(Finding(claim, {"physics": physics}), Laboratory(Settings()))
    assert too_wide([line.plain for line in lines]) == []


# Faults: each changes what it says, and nothing else.


@cache
def fault(name: str) -> Fault:
    return next(each for each in FAULTS if each.name == name)


@cache
def sound(system: str, name: str) -> Controller:
    return chapter_controller(name, MujocoPlant.load(system).analytic())


def faulty(name: str, system: str, controller: str = "grosmc", case: str = "nominal") -> Controller:
    return fault(name).controller(
        sound(system, controller), find_experiment(system, case), "physics"
    )


def faulty_plant(name: str, system: str, case: str) -> Any:
    chosen = find_experiment(system, case)
    return fault(name).plant(chosen.plant("physics"), chosen, "physics")


LAWS = [(system, name) for system in SYSTEMS for name in controller_names(system)]
each_law = pytest.mark.parametrize(("system", "name"), LAWS)


def samples(law: Controller, count: int = 20) -> list[tuple[float, Array]]:
    """Random instants and states in the region of every law."""
    random, n = np.random.default_rng(3), len(law.designed.error.system.states)
    return [(0.01 * k, random.uniform(-1, 1, n)) for k in range(count)]


def inputs(law: Controller) -> tuple[Array, Array]:
    """u and, for a law with a surface, s of a law along the samples, (count, m)."""
    memory, u, s = law.memory(), [], []
    for t, x in samples(law):
        u.append(np.atleast_1d(law.input_at(t, x, memory)))
        s.append(np.array(getattr(memory, "s", [0.0])))
    return np.array(u), np.array(s)


@each_law
def test_wrong_sign_negates_the_input_exactly(system: str, name: str) -> None:
    (u, s), (wrong, s_wrong) = (
        inputs(sound(system, name)),
        inputs(faulty("wrong sign of u", system, name)),
    )
    assert np.array_equal(wrong, -u)
    assert np.array_equal(s_wrong, s)


@each_law
def test_zero_gain_leaves_the_continuous_law(system: str, name: str) -> None:
    law = faulty("zero switching gain", system, name)
    continuous = "fl-lqr" if system == "cart_pendulum" else "lqr"
    alone = sound(system, continuous if name == "grosmc" else name)
    assert inputs(law)[0] == pytest.approx(inputs(alone)[0], rel=1e-13)
    design, p = law.designed, law.parameters
    x = np.array([find_experiment(system, "nominal").case.x0])
    own = nominal(design, p, [0.0], x, np.full((1, law.coordinates.size), 0.3))
    assert switching_rate(p, own).tolist() == [0.0]


@pytest.mark.parametrize("system", SYSTEMS)
def test_surface_without_its_integral_is_the_projection_alone(system: str) -> None:
    law = faulty("integral left out", system)
    z = np.array([law.designed.error.error_state(t, x, law.parameters) for t, x in samples(law)])
    assert inputs(law)[1] == pytest.approx((z - z[0]) @ law.parameters.G.T, abs=1e-13)


@pytest.mark.parametrize("system", SYSTEMS)
def test_small_projection_scales_all_that_is_made_of_it(system: str) -> None:
    """Consistently: s is a hundredth, so eqs. (12) and (37) have an eta a hundred times as strong.

    And S = G (A - B K), G B = G B and its inverse still hold.
    """
    law, p = faulty("G too small", system), sound(system, "grosmc").parameters
    small = law.parameters
    for name in ("G", "S", "GB", "size_of_GB"):
        assert getattr(small, name) == pytest.approx(0.01 * getattr(p, name), rel=1e-15)
    assert pytest.approx(small.S, rel=1e-12) == small.G @ law.designed.lqr.closed_loop
    assert pytest.approx(small.G @ law.designed.lqr.B, rel=1e-12) == small.GB
    assert small.GB @ small.GB_inverse == pytest.approx(np.eye(len(small.GB)), rel=1e-12)
    assert small.size_of_GB == pytest.approx(np.linalg.norm(small.GB), rel=1e-12)
    for name in ("K", "eta", "gamma0", "gamma1", "k", "epsilon"):
        assert np.all(getattr(small, name, 0) == getattr(p, name, 0))


@pytest.mark.parametrize("name", controller_names("cart_pendulum"))
def test_law_of_the_printed_equation_believes_in_it(name: str) -> None:
    law = faulty("printed a in the law", "cart_pendulum", name)
    p = sound("cart_pendulum", name).parameters.plant
    assert law.parameters.plant == replace(p, printed=1.0)
    assert law.name == name
    for system in ("servo", "arm"):
        assert faulty("printed a in the law", system) is sound(system, "grosmc")


@pytest.mark.parametrize(
    ("system", "case", "body"),
    [("servo", "case2", "rotor"), ("cart_pendulum", "case1", "pole"), ("arm", "case2", "link")],
)
def test_mass_without_inertia_scales_the_mass_only(system: str, case: str, body: str) -> None:
    before = MujocoPlant.load(system).model
    wrong = faulty_plant("mass without inertia", system, case).model
    (edit,) = find_case(system, case).edits
    assert isinstance(edit, BodyEdit)
    assert edit.mass_scale > 1
    assert wrong.body(body).mass == pytest.approx(edit.mass_scale * before.body(body).mass)
    assert np.array_equal(wrong.body(body).inertia, before.body(body).inertia)
    assert np.array_equal(wrong.body(body).ipos, before.body(body).ipos)
    # What is loaded afterwards has not been touched.
    after = MujocoPlant.load(system).model
    assert np.array_equal(after.body_mass, before.body_mass)
    assert np.array_equal(after.body_inertia, before.body_inertia)
    right = MujocoPlant.load(system, edits=(edit,)).model.body(body)
    assert right.inertia == pytest.approx(
        edit.mass_scale * edit.length_scale**2 * before.body(body).inertia, rel=1e-12
    )


@pytest.mark.parametrize("system", SYSTEMS)
def test_dropped_edit_leaves_the_nominal_plant(system: str) -> None:
    case = "case1" if system == "cart_pendulum" else "case2"
    nominal = MujocoPlant.load(system).analytic().parameters
    assert faulty_plant("edit dropped", system, case).analytic().parameters == nominal
    edited = case_plant(find_case(system, case), "physics", Settings())
    assert isinstance(edited, MujocoPlant)
    assert edited.analytic().parameters != nominal


@pytest.mark.parametrize("system", SYSTEMS)
def test_gravity_is_turned_in_the_copy_only(system: str) -> None:
    plant = faulty_plant("gravity upside down", system, "nominal")
    gravity = MujocoPlant.load(system).model.opt.gravity
    assert np.array_equal(plant.model.opt.gravity, -gravity)
    assert gravity[2] == -9.8
    edits = find_case(system, "case1").edits
    assert faulty_plant("gravity upside down", system, "case1").edits == edits


@pytest.mark.parametrize("system", SYSTEMS)
def test_printed_physics_are_the_printed_equations(system: str) -> None:
    plant = faulty_plant("printed physics", system, "nominal")
    assert isinstance(plant, AnalyticPlant)
    assert plant.variant == ("printed" if system in ("cart_pendulum", "arm") else "corrected")


@pytest.mark.parametrize("name", ["gravity upside down", "edit dropped", "printed physics"])
def test_faults_of_physics_leave_the_equations_alone(name: str) -> None:
    experiment = find_experiment("cart_pendulum", "case1")
    plant = experiment.plant("corrected")
    assert fault(name).plant(plant, experiment, "corrected") is plant


def test_slow_sampling_is_ten_times_slower_at_both_levels() -> None:
    lab = Laboratory(Settings(), fault("slow sampling"))
    assert lab.settings == replace(Settings(), control_period=10 * Settings().control_period)
    halves = replace(
        lab.settings,
        control_period=lab.settings.control_period / 2,
        timestep=lab.settings.timestep / 2,
    )
    assert lab.refined.settings == halves


def test_dropped_disturbance_leaves_the_case_otherwise() -> None:
    experiment = find_experiment("arm", "case1")
    found = fault("disturbance dropped").experiment(experiment)
    assert found.case == replace(experiment.case, disturbances=())


@pytest.mark.parametrize(("system", "case"), [("servo", "case2"), ("arm", "case2")])
def test_law_that_knows_the_plant_is_designed_from_the_edited_numbers(
    system: str, case: str
) -> None:
    true = MujocoPlant.load(system, edits=find_case(system, case).edits).analytic()
    law = faulty("laws know the plant", system, "grosmc", case)
    assert law.parameters.plant == true.parameters
    assert law.parameters.plant != sound(system, "grosmc").parameters.plant


def test_sound_laboratory_differs_from_each_faulty_one() -> None:
    names = [each.name for each in FAULTS]
    assert len(names) == len(set(names))
    assert all(each.what for each in FAULTS)


@pytest.mark.slow
def test_every_fault_is_noticed() -> None:
    """By a few of the claims already; grosmc-mj claims --self-test tries them all."""
    quick = ("servo-load-grosmc", "servo-circular-bound", "pendulum-eq40", "arm-eq57")
    # Runs of many seconds meet only what the quick ones cannot notice, or not alone.
    slow = {
        "servo-load-lqr": ("disturbance dropped",),
        "pendulum-naive-gain": ("printed a in the law",),
        "arm-variations": ("zero switching gain", "G too small", "slow sampling"),
        "two-link-projection": ("edit done twice",),
    }
    tried = [(quick, FAULTS)] + [
        ((name,), [each for each in FAULTS if each.name in noticed])
        for name, noticed in slow.items()
    ]
    caught: dict[str, set[str]] = {each.name: set() for each in FAULTS}
    for names, faults in tried:
        for each in self_test(
            Settings(), [find_claim(name) for name in names], faults, Batch(), thorough=True
        ):
            caught[each.fault.name] |= set(each.claims)
    assert all(caught.values()), [name for name, claims in caught.items() if not claims]
    assert {"servo-load-grosmc", "arm-variations"} <= caught["zero switching gain"]
    assert "servo-load-lqr" in caught["disturbance dropped"]
    assert "servo-circular-bound" in caught["mass without inertia"]
    assert {"pendulum-eq40", "arm-eq57"} <= caught["printed physics"]
    # Neither claim looks at a law.
    for name in ("wrong sign of u", "zero switching gain", "G too small", "slow sampling"):
        assert not {"pendulum-eq40", "arm-eq57"} & caught[name]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("verdict", "claim", "name"),
    [
        (Verdict.SUPPORTED, "servo-unknown-gains", "disturbance dropped"),
        (Verdict.REFUTED, "servo-sliding-dynamics", "integral left out"),
        (Verdict.UNDETERMINED, "pendulum-disturbance-lqr", "decimal point misplaced"),
        (Verdict.PREMISE_NOT_MET, "servo-sliding-dynamics", "zero switching gain"),
        (Verdict.INCONCLUSIVE, "servo-load-lqr", "wrong sign of u"),
    ],
)
def test_a_fault_brings_each_verdict_about(verdict: Verdict, claim: str, name: str) -> None:
    """Of a claim whose verdict in a sound laboratory is another one."""
    assert BY_ID[claim].verdicts["physics"] is not verdict
    (found,) = self_test(Settings(), [BY_ID[claim]], [fault(name)], Batch())
    assert found.claims == (claim,)
    assert found.became == (verdict,)


def test_the_kinds_of_verdict_that_faults_bring_about_are_all() -> None:
    marks: Any = getattr(test_a_fault_brings_each_verdict_about, "pytestmark", ())
    (cases,) = (mark.args[1] for mark in marks if mark.name == "parametrize")
    assert {verdict for verdict, _, _ in cases} == set(Verdict)


@pytest.mark.parametrize(("system", "case"), [("servo", "case1"), ("arm", "case1")])
def test_misplaced_decimal_point_scales_every_wrench(system: str, case: str) -> None:
    experiment = find_experiment(system, case)
    found = fault("decimal point misplaced").experiment(experiment).case
    for was, now in zip(experiment.case.disturbances, found.disturbances, strict=True):
        assert np.array(now.wrench) == pytest.approx(10 * np.array(was.wrench))
        assert replace(now, wrench=was.wrench) == was


def test_a_claim_that_has_noticed_is_asked_no_more() -> None:
    """Every fault is still put in, and asked of others as long as nobody notices."""
    claims = [find_claim("pendulum-eq40"), find_claim("arm-eq57")]
    blind, printed = fault("gravity upside down"), fault("printed physics")
    found = self_test(Settings(), claims, [printed, printed, blind], Batch())
    assert [(each.claims, each.tried) for each in found[:2]] == [
        (("pendulum-eq40", "arm-eq57"), 2),
        (("pendulum-eq40",), 1),
    ]
    assert found[2].tried in (1, 2)
    thorough = self_test(Settings(), claims, [printed, printed], Batch(), thorough=True)
    assert [each.tried for each in thorough] == [2, 2]
    assert thorough[0].became == (Verdict.REFUTED,)


def test_claims_that_look_at_the_law_look_at_the_faulty_one() -> None:
    """The law with the printed C is a controller like any other, with the same faults."""
    seen: list[str] = []

    def spy(law: Controller, *_: Any) -> Controller:
        seen.append(law.name)
        return law

    lab = Laboratory(Settings(), Fault("spy", "looks on", controller=spy))
    BY_ID["arm-printed-c"].measure(lab, "corrected")
    assert seen


# The command line.


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("claims", "servoo"), "did you mean 'servo'?"),
        (("claims", "--explain", "arm-epsilonn"), "did you mean 'arm-epsilon'?"),
        (("claims", "--explain", "theorem-4"), "did you mean 'theorem-"),
        (("claims", "servo", "--explain", "arm-epsilon"), "--explain names one claim"),
        (("claims", "servo", "--page", "page.md"), "--page is about all claims"),
        (("claims", "--explain"), "--explain"),
        (("claims", "leg", "--premises"), "valid: arm, ball_beam, cart_pendulum"),
        (("claims", "armm", "--premises"), "did you mean 'arm'?"),
        (("claims", "arm/case9", "--premises"), "valid: arm, ball_beam, cart_pendulum"),
        (("claims", "arm", "--premises", "--controller", "grosmk"), "did you mean 'grosmc'?"),
        (("claims", "--premises"), "SYSTEM"),
    ],
)
def test_wrong_use_gets_one_line_and_exit_code_2(
    arguments: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*arguments) == cli.WRONG
    error = capsys.readouterr().err
    assert says in error
    assert error.startswith("grosmc-mj: ")
    assert error.count("\n") == 1


@pytest.mark.slow
def test_explain_tells_the_story_and_draws_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("claims", "--explain", "arm-epsilon", "--out", str(tmp_path)) == cli.DONE
    told = capsys.readouterr().out
    for words in ("REFUTED", "Theorem 3", "along a run that stays on its surface", "|d/M(q)|"):
        assert words in told
    (figure,) = tmp_path.rglob("*.png")
    assert figure == tmp_path / "claims" / "arm-epsilon.png"
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert figure.stat().st_size > 10_000


KEYS = {
    "equation", "quote",
    "id", "system", "source", "statement", "criterion", "sense", "threshold", "unit", "why",
    "word", "kind", "quantifier", "choices", "cause", "near_its_threshold", "turns", "verdict",
    "because", "untested", "plants", "expected", "needs",
}  # fmt: skip


def test_the_answer_on_all_claims_comes_first_and_fits_on_a_screen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On findings with the expected verdicts, as wide as numbers get."""
    made_up = [finding(claim) for claim in CLAIMS]
    monkeypatch.setattr(claims_command, "judge_with_progress", lambda *_: made_up)
    assert run("claims", "--out", str(tmp_path)) == cli.DONE
    lines = capsys.readouterr().out.rstrip("\n").split("\n")
    assert lines[0].startswith("All verdicts are as expected")
    assert len(lines) <= 40
    assert [line for line in lines if cell_len(line.rstrip()) > 100] == []


@pytest.mark.slow
def test_json_prints_what_it_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ledgers, "CLAIMS", (BY_ID["servo-circular-bound"],))
    assert run("claims", "--json", "--out", str(tmp_path)) == cli.DONE
    written = json.loads((tmp_path / "claims.json").read_text(encoding="utf-8"))
    assert json.loads(capsys.readouterr().out) == written
    assert [claim["id"] for claim in written["claims"]] == ["servo-circular-bound"]


@pytest.mark.slow
def test_validate_judges_the_claims_of_the_system(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = ("servo-circular-bound", "servo-load-lqr", "arm-eq57")
    monkeypatch.setattr(ledgers, "CLAIMS", tuple(BY_ID[name] for name in few))
    assert run("validate", "servo", "--no-figures", "--out", str(tmp_path)) == cli.DONE
    document = json.loads((tmp_path / "validation.json").read_text(encoding="utf-8"))
    assert [claim["id"] for claim in document["claims"]] == list(few[:2])
    for claim in document["claims"]:
        assert set(claim) == KEYS
        assert set(claim["expected"]) == {"verdicts", "reason"}
        for each in claim["plants"].values():
            assert set(each) == {"value", "note", "verdict", "evidence", "trials"}


def test_document_of_a_claim_holds_no_nan() -> None:
    claim = BY_ID["servo-sliding"]
    for number in (math.nan, math.inf):
        content = claim_document(finding(claim, value=number), Laboratory(Settings()))
        assert json.loads(json_text(content))["plants"]["physics"]["value"] is None
    assert set(content) == KEYS
    assert content["expected"]["reason"] == claim.reason


def test_page_points_to_what_is_there() -> None:
    """Every link of the page's tables has its story, and every figure its file."""
    text = PAGE.read_text(encoding="utf-8")
    links, stories = re.findall(r"\]\(#([\w-]+)\)", text), re.findall(r"^### (.+)$", text, re.M)
    # Of the causes, then of the tables.
    assert set(links) == {*stories, "what-turns"}
    assert links[-len(stories) :] == stories
    for name in re.findall(r"!\[[\w-]+\]\(([^)]+)\)", text):
        assert (PAGE.parent / name).is_file()
    # A verdict that is expected to be refuted is told.
    for name, claim in BY_ID.items():
        if claim.verdicts[claim.plants[-1]] is not Verdict.SUPPORTED:
            assert name in stories

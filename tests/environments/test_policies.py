"""Policies in the place of laws: the same runs, the same metrics, the same verdicts."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shipped import case_plant, find_case, nominal_controller

from grosmc_mj.arrays import Array
from grosmc_mj.chapter.claims.claim import Measured, Verdict
from grosmc_mj.chapter.claims.judging import judge
from grosmc_mj.chapter.claims.ledger import find_claim, select_claims
from grosmc_mj.control.controller import Controller
from grosmc_mj.environments import judge_policy, law_policy, policy_controller
from grosmc_mj.errors import ArgumentError, UndefinedLawError
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.metrics import compare_with_optimum, measure
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory

pytestmark = pytest.mark.slow

# One of each system, and both designs of the two-link arm.
RUNS = [("servo", "case2"), ("cart_pendulum", "case1"), ("arm", "case1"),
        ("two_link_arm", "case1"), ("two_link_arm", "regulation1")]  # fmt: skip
COARSE = Settings(engine="python", control_period=1e-2, timestep=1e-2)
PENDULUM = find_case("cart_pendulum", "nominal")


@cache
def law(system: str, name: str = "grosmc", design: str | None = None) -> Controller:
    return nominal_controller(system, name, "corrected", design=design)


def run(
    case: Case, controller: Controller, plant: Any = "physics", duration: float = 0.1, T: float = 0
) -> Trajectory:
    return simulate(
        case_plant(case, plant, Settings()), controller, case.x0, duration=duration,
        control_period=T or 1e-3, disturbances=case.disturbances, engine="python",
    )  # fmt: skip


def asking(policy: Any, **options: Any) -> Controller:
    """A policy for the pendulum as a controller."""
    return policy_controller(policy, law("cart_pendulum"), **options)


@pytest.mark.parametrize(("system", "name"), RUNS)
@pytest.mark.parametrize("plant", ["physics", "corrected"])
def test_a_law_as_a_policy_as_a_controller_is_the_law_itself(
    system: str, name: str, plant: str
) -> None:
    case = find_case(system, name)
    controller = law(system, design=case.controllers)
    policy = policy_controller(law_policy(controller), controller)
    direct, asked = (run(case, each, plant) for each in (controller, policy))
    assert np.array_equal(direct.state, asked.state)
    assert np.array_equal(direct.command, asked.command)
    # v is computed back from u = E^-1 (v - alpha).
    assert asked.weighed == pytest.approx(direct.weighed, rel=1e-11, abs=1e-11)
    wanted = measure(direct, controller, compare_with_optimum(direct, controller))
    for metric, found in measure(asked, policy, compare_with_optimum(asked, policy)).items():
        if found.value is None:
            assert found.note == "no surface" or found == wanted[metric]
        elif metric == "cost_whole":
            assert found.value == pytest.approx(wanted[metric].value, rel=1e-11)
        else:
            assert found == wanted[metric]


def test_each_run_of_a_batch_begins_anew() -> None:
    controller, starts = law("arm"), [find_case("arm", "nominal").x0, (0.3, 3.0)]
    policy = policy_controller(law_policy(controller), controller)
    plant = case_plant(find_case("arm", "nominal"), "physics", Settings())
    asked, direct = (
        simulate(plant, each, starts, duration=0.05, engine="python")
        for each in (policy, controller)
    )
    assert np.array_equal(asked.state, direct.state)

    class Counting:
        count = 0

        def reset(self) -> None:
            self.count = 0

        def __call__(self, observation: Any) -> float:
            self.count += 1
            return float(self.count)

    counting = asking(Counting())
    for _ in range(2):
        assert run(PENDULUM, counting, duration=0.004).command.tolist() == [1.0, 2.0, 3.0, 4.0]


def test_what_predicts_is_asked_the_same_question() -> None:
    def force(observation: Any) -> Array:
        return 30.0 * observation["error"][:1] + 5.0 * observation["error"][1:]

    class Model:
        def predict(self, observation: Any) -> tuple[Array, None]:
            return force(observation), None

    case = find_case("cart_pendulum", "case1")
    assert np.array_equal(run(case, asking(Model())).state, run(case, asking(force)).state)


def test_a_policy_is_undefined_where_its_index_or_its_law_is() -> None:
    with pytest.raises(UndefinedLawError, match=r"the law is undefined outside \|theta\| < pi/2"):
        run(PENDULUM, asking(lambda _: -20.0), duration=3.0, T=1e-2)
    case = replace(find_case("two_link_arm", "nominal"), x0=(0.6, 0.0, 0.0, 0.0))
    controller = law("two_link_arm")
    for each in (controller, policy_controller(law_policy(controller), controller)):
        with pytest.raises(UndefinedLawError, match="matrix E") as found:
            run(case, each)
        assert found.value.time == 0.0
    plant = case_plant(PENDULUM, "physics", Settings())
    nan = asking(lambda _: math.nan)
    batch = simulate(plant, nan, [PENDULUM.x0], duration=0.01, engine="python")
    assert batch.status[0] is Status.UNDEFINED_INPUT


def missing(observation: Any) -> Any:
    return observation["pole angel"]


def calling(observation: Any) -> Any:
    return np.linalg.inv(np.zeros((2, 2)))


@pytest.mark.parametrize(
    ("policy", "said"),
    [(missing, "KeyError: 'pole angel'"), (calling, "LinAlgError: Singular matrix")],
)
def test_an_error_in_a_policy_points_to_its_line(policy: Any, said: str) -> None:
    line = inspect.getsourcelines(policy)[1] + 1
    with pytest.raises(ArgumentError) as found:
        run(PENDULUM, asking(policy))
    expected = f"{Path(__file__).name}:{line}: {said} ({policy.__name__} at t = 0 s)"
    assert str(found.value) == expected


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: asking(1.0), "a float is no policy: give a function of an obs"),
        (lambda: run(PENDULUM, asking(lambda: 0.0)), r"TypeError: .*takes 0 positional"),
        (lambda: run(PENDULUM, asking(lambda _: [1.0, 2.0])),
         r"returned \[1.0, 2.0\], must return 1 number\(s\): force \[N\]"),
        (lambda: run(PENDULUM, asking(lambda _: None)), "returned None, must return 1 number"),
        (lambda: judge_policy("servo", missing, ["arm-index"]),
         "claim arm-index is about arm, not about servo"),
        (lambda: judge_policy("servo", missing, ["servo-load"]), "unknown claim 'servo-load'"),
    ],
)  # fmt: skip
def test_wrong_use_is_told_in_one_line(wrong: Callable[[], Any], said: str) -> None:
    with pytest.raises(ArgumentError, match=said):
        wrong()


# Verdicts


def test_a_law_as_a_policy_gets_the_law_s_verdicts() -> None:
    names, laboratory = ["servo-index", "servo-whole-cost"], Laboratory(COARSE)
    found = judge_policy("servo", law_policy(law("servo")), names, settings=COARSE, refine=False)
    for name, finding in zip(names, found, strict=True):
        wanted = judge(laboratory, find_claim(name), refine=False)
        assert finding.claim.id == name
        for plant, each in finding.plants.items():
            assert each.verdict is wanted.plants[plant].verdict
            value = wanted.plants[plant].measured.value
            assert each.measured.value == pytest.approx(value, rel=1e-11)


def test_a_policy_that_does_nothing_gets_other_verdicts() -> None:
    """Only what it can't be asked is inconclusive; it fails where the law succeeds."""
    names = ["servo-before-load", "servo-sliding", "servo-index-minimal", "servo-load-lqr"]
    found = judge_policy("servo", lambda _: 0.0, names, settings=COARSE, refine=False)
    open_, lost = Verdict.INCONCLUSIVE, Verdict.REFUTED
    assert [each.verdict for each in found] == [lost, open_, open_, Verdict.SUPPORTED]
    notes = [finding.plants["corrected"].measured.note for finding in found]
    assert notes[1] == "not judged: it asks for the law's sliding variable"
    assert notes[2].startswith("not judged: it asks for the law's ")
    # A claim about another law does not become one about the policy.
    assert notes[3] == ""

    def broken(*_: Any) -> Measured:
        raise AssertionError("a slip of ours")

    claim = replace(find_claim("servo-load-grosmc"), measure=broken)
    with pytest.raises(AssertionError, match="a slip of ours"):
        judge_policy("servo", lambda _: 0.0, [claim], settings=COARSE, refine=False)


def test_a_policy_is_judged_by_all_claims_of_its_system() -> None:
    settings = replace(COARSE, engine="native")
    found = judge_policy("servo", lambda _: 0.0, settings=settings, refine=False)
    assert [finding.claim.id for finding in found] == [claim.id for claim in select_claims("servo")]
    verdicts = {finding.claim.id: finding.verdict for finding in found}
    assert verdicts["servo-load-grosmc"] is Verdict.REFUTED
    assert verdicts["servo-sliding"] is verdicts["theorem-1"] is Verdict.INCONCLUSIVE
    # It is about another law.
    assert verdicts["servo-load-lqr"] is Verdict.SUPPORTED
    # These run it in a batch and by hand.
    usual = judge(Laboratory(settings), find_claim("servo-unmatched"), refine=False)
    changed = next(finding for finding in found if finding.claim.id == "servo-unmatched")
    for plant, finding in usual.plants.items():
        assert changed.plants[plant].measured.value != finding.measured.value

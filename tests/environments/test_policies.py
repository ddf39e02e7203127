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

from grosmc_mj.chapter.claims.claim import Verdict
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

COARSE = Settings(engine="python", control_period=1e-2, timestep=1e-2)
PENDULUM = find_case("cart_pendulum", "nominal")


@cache
def law(system: str, design: str | None = None) -> Controller:
    return nominal_controller(system, "grosmc", "corrected", design=design)


def run(
    case: Case, controller: Controller, plant: Any = "physics", duration: float = 0.1,
    T: float = 1e-3, starts: Any = None,
) -> Trajectory:  # fmt: skip
    return simulate(
        case_plant(case, plant, Settings()), controller, starts or case.x0, duration=duration,
        control_period=T, disturbances=case.disturbances, engine="python",
    )  # fmt: skip


def asking(policy: Any) -> Controller:
    """A policy for the pendulum as a controller."""
    return policy_controller(policy, law("cart_pendulum"))


def as_policy(controller: Controller) -> Controller:
    """A law as a policy as a controller."""
    return policy_controller(law_policy(controller), controller)


@pytest.mark.parametrize(
    ("system", "name", "plant"),
    [("servo", "case2", "physics"), ("arm", "case1", "corrected"),
     ("two_link_arm", "regulation1", "physics")],
)  # fmt: skip
def test_a_law_as_a_policy_as_a_controller_is_the_law_itself(
    system: str, name: str, plant: str
) -> None:
    case = find_case(system, name)
    controller = law(system, design=case.controllers)
    policy = as_policy(controller)
    direct, other = (run(case, one, plant) for one in (controller, policy))
    assert np.array_equal(direct.state, other.state)
    assert np.array_equal(direct.command, other.command)
    # v is computed back from u = E^-1 (v - alpha).
    assert other.weighed == pytest.approx(direct.weighed, rel=1e-11, abs=1e-11)
    expected = measure(direct, controller, compare_with_optimum(direct, controller))
    for metric, number in measure(other, policy, compare_with_optimum(other, policy)).items():
        if number.value is None:
            assert number.note == "no surface" or number == expected[metric]
        elif metric == "cost_whole":
            assert number.value == pytest.approx(expected[metric].value, rel=1e-11)
        else:
            assert number == expected[metric]


def test_every_run_of_a_batch_begins_anew_and_a_model_that_predicts_is_a_policy_too() -> None:
    controller, case = law("arm"), find_case("arm", "nominal")
    starts = [case.x0, (0.3, 3.0)]
    direct, other = (run(case, one, starts=starts) for one in (controller, as_policy(controller)))
    assert np.array_equal(other.state, direct.state)

    class Counting:
        def reset(self) -> None:
            self.count = 0

        def predict(self, observation: Any) -> tuple[Any, None]:
            self.count += 1
            return observation["error"][:1] * 0 + self.count, None

    counting = asking(Counting())
    for _ in range(2):
        assert run(PENDULUM, counting, duration=0.004).command.tolist() == [1.0, 2.0, 3.0, 4.0]


def test_a_policy_is_undefined_where_its_index_or_its_law_is() -> None:
    with pytest.raises(UndefinedLawError, match=r"the law is undefined outside \|theta\| < pi/2"):
        run(PENDULUM, asking(lambda _: -20.0), duration=3.0, T=1e-2)
    case = replace(find_case("two_link_arm", "nominal"), x0=(0.6, 0.0, 0.0, 0.0))
    controller = law("two_link_arm")
    for one in (controller, as_policy(controller)):
        with pytest.raises(UndefinedLawError, match="matrix E") as error:
            run(case, one)
        assert error.value.time == 0.0
    batch = run(PENDULUM, asking(lambda _: math.nan), duration=0.01, starts=[PENDULUM.x0])
    assert batch.status[0] is Status.UNDEFINED_INPUT


def missing(observation: Any) -> Any:
    return observation["pole angel"]


def test_an_error_in_a_policy_points_to_its_line() -> None:
    line = inspect.getsourcelines(missing)[1] + 1
    with pytest.raises(ArgumentError) as error:
        run(PENDULUM, asking(missing))
    expected = f"{Path(__file__).name}:{line}: KeyError: 'pole angel' (missing at t = 0 s)"
    assert str(error.value) == expected


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: asking(1.0), "a float is no policy: give a function of an obs"),
        (lambda: run(PENDULUM, asking(lambda _: [1.0, 2.0])),
         r"returned \[1.0, 2.0\], must return 1 number\(s\): force \[N\]"),
        (lambda: judge_policy("servo", missing, ["arm-index"]),
         "claim arm-index is about arm, not about servo"),
    ],
)  # fmt: skip
def test_wrong_use_is_refused_in_one_line(wrong: Callable[[], Any], words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        wrong()


def test_a_policy_that_does_nothing_gets_other_verdicts() -> None:
    """Only claims that need more than inputs are inconclusive; it fails where the law succeeds."""
    settings = replace(COARSE, engine="native")
    results = judge_policy("servo", lambda _: 0.0, settings=settings, refine=False)
    assert [result.claim.id for result in results] == [c.id for c in select_claims("servo")]
    judged = {result.claim.id: result for result in results}
    for name, verdict, note in (
        ("servo-load-grosmc", Verdict.REFUTED, ""),
        ("theorem-1", Verdict.INCONCLUSIVE, "not judged: it asks for the law's "),
        ("servo-sliding", Verdict.INCONCLUSIVE, "not judged: it asks for the law's sliding varia"),
    ):
        assert judged[name].verdict is verdict
        assert judged[name].plants["corrected"].measured.note.startswith(note)
    # A claim about another law does not become one about the policy.
    assert judged["servo-load-lqr"].verdict is Verdict.SUPPORTED
    # These run it in a batch and by hand.
    usual = judge(Laboratory(settings), find_claim("servo-unmatched"), refine=False)
    for plant, one in usual.plants.items():
        assert judged["servo-unmatched"].plants[plant].measured.value != one.measured.value

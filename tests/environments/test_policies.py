"""Policies in the place of laws: the same runs, the same metrics, the same verdicts."""

from __future__ import annotations

import inspect
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from open_loop import held
from shipped import case_plant, find_case, nominal_controller

from grosmc_mj.environments import law_policy, policy_controller
from grosmc_mj.environments.episode import Episode
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements.metrics import Metric
from grosmc_mj.experiments.requirements.optimum import compare_with_optimum
from grosmc_mj.experiments.requirements.run_metrics import (
    metrics_of_rows,
    rows_of,
    usual_metrics,
)
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.errors import ArgumentError, UndefinedLawError
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.switching import find_switching
from grosmc_mj.theory.control.task import Realization

PENDULUM = find_case("cart_pendulum", "nominal")


@cache
def law(system: str, design: str | None = None) -> Controller:
    return nominal_controller(system, "grosmc", "corrected", design=design)


def run(
    case: Experiment,
    controller: Controller,
    plant: Any = "physics",
    duration: float = 0.05,
    T: float = 1e-3,
    starts: Any = None,
) -> Trajectory:
    return simulate(
        case_plant(case, plant, Settings()),
        controller,
        starts or case.x0,
        duration=duration,
        control_period=T,
        disturbances=case.disturbances,
        engine="python",
    )


# A law as a policy.


def observed(system: str) -> Any:
    return Episode(system).observation()


@pytest.mark.parametrize(
    "observation",
    [{}, dict.fromkeys(observed("cart_pendulum"), np.zeros((2, 1))), np.zeros(9)],
    ids=["empty", "batched", "flat"],
)
def test_a_law_needs_its_states_by_name(observation: Any) -> None:
    with pytest.raises(ArgumentError, match="must map time, cart position, pole angle, cart"):
        law_policy(law("cart_pendulum"))(observation)


def test_a_law_is_undefined_where_its_plant_is() -> None:
    observation = observed("cart_pendulum")
    observation["pole angle"][:] = 2.0
    with pytest.raises(UndefinedLawError, match="t = 0 s: grosmc is undefined at this state"):
        law_policy(law("cart_pendulum"))(observation)


def test_a_law_without_design_needs_its_system() -> None:
    with pytest.raises(ArgumentError, match="open loop has no error coordinates"):
        law_policy(held(1.0))
    assert law_policy(held(1.5), "servo")(observed("servo")) == [1.5]


def test_a_law_as_a_policy_begins_anew_at_time_zero() -> None:
    policy = law_policy(law("servo"))
    runs = []
    for _ in range(2):
        for k, angle in enumerate((0.3, -0.1, 0.2)):
            seen = {"time": k * 1e-3, "rotor angle": angle, "rotor speed": 1.0}
            runs.append(policy(seen)[0])
    assert runs[:3] == runs[3:]


def test_a_law_in_discrete_time_needs_its_control_period() -> None:
    discrete = Realization(find_switching("sign"), 1e-3)
    policy = law_policy(nominal_controller("servo", "grosmc", "corrected", discrete))
    observation = observed("servo")
    policy(observation)
    observation["time"][:] = 1e-3
    policy(observation)
    observation["time"][:] = 3e-3
    with pytest.raises(ArgumentError) as refused:
        policy(observation)
    assert "for a control period of 0.001 s, not 0.002 s" in str(refused.value)
    assert str(refused.value).endswith("with control_period=0.001")


# A policy as a controller.


def asking(policy: Any) -> Controller:
    """A policy for the pendulum as a controller."""
    return policy_controller(policy, law("cart_pendulum"))


def as_policy(controller: Controller) -> Controller:
    """A law as a policy as a controller."""
    return policy_controller(law_policy(controller), controller)


def measured(run: Trajectory, controller: Controller) -> dict[str, Metric]:
    """The usual metrics of a run."""
    rows = rows_of(run, compare_with_optimum(run, controller).z)
    return usual_metrics(run, controller, metrics_of_rows(rows, controller))


@pytest.mark.parametrize(
    ("system", "name", "plant"),
    [
        ("servo", "case2", "physics"),
        ("arm", "case1", "corrected"),
        ("two_link_arm", "regulation1", "physics"),
    ],
)
def test_a_law_as_a_policy_as_a_controller_is_the_law_itself(
    system: str, name: str, plant: str
) -> None:
    case = find_case(system, name)
    controller = law(system, design=case.file.task.name or case.system)
    policy = as_policy(controller)
    direct = run(case, controller, plant)
    by_policy = run(case, policy, plant)
    assert np.array_equal(direct.state, by_policy.state)
    assert np.array_equal(direct.command, by_policy.command)
    # v is computed back from u = E^-1 (v - alpha).
    assert by_policy.weighed == pytest.approx(direct.weighed, rel=1e-11, abs=1e-11)

    expected = measured(direct, controller)
    metrics = measured(by_policy, policy)
    cost = metrics.pop("cost_whole").value
    assert cost == pytest.approx(expected.pop("cost_whole").value, rel=1e-11)
    of_surface = {name for name, metric in metrics.items() if metric.note == "no surface"}
    assert {name for name in metrics if metrics[name] != expected[name]} <= of_surface


def test_every_run_of_a_batch_begins_anew() -> None:
    controller = law("arm")
    case = find_case("arm", "nominal")
    starts = [case.x0, (0.3, 3.0)]
    direct = run(case, controller, starts=starts)
    by_policy = run(case, as_policy(controller), starts=starts)
    assert np.array_equal(by_policy.state, direct.state)


class Counting:
    """A model that predicts the number of its prediction."""

    def reset(self) -> None:
        self.count = 0

    def predict(self, observation: Any) -> tuple[Any, None]:
        self.count += 1
        return observation["error"][:1] * 0 + self.count, None


def test_a_model_that_predicts_is_a_policy_and_reset_where_a_run_begins() -> None:
    counting = asking(Counting())
    for _ in range(2):
        assert run(PENDULUM, counting, duration=0.004).command.tolist() == [1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize(("name", "called"), [("", "missing"), ("mine", "mine")])
def test_a_policy_is_called_as_its_function_or_by_a_name(name: str, called: str) -> None:
    assert policy_controller(missing, law("cart_pendulum"), name=name).name == called


def test_a_policy_is_undefined_where_its_index_is() -> None:
    with pytest.raises(UndefinedLawError, match=r"the law is undefined outside \|theta\| < pi/2"):
        run(PENDULUM, asking(lambda _: -20.0), duration=3.0, T=1e-2)


@pytest.mark.parametrize("controller_of", [lambda law: law, as_policy], ids=["law", "policy"])
def test_a_policy_is_undefined_where_its_law_is(controller_of: Any) -> None:
    case = replace(find_case("two_link_arm", "nominal"), x0=(0.6, 0.0, 0.0, 0.0))
    with pytest.raises(UndefinedLawError, match="matrix E") as error:
        run(case, controller_of(law("two_link_arm")))
    assert error.value.time == 0.0


def test_a_policy_s_nan_is_an_undefined_input() -> None:
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
    ("policy", "words"),
    [
        (1.0, "a float is no policy: give a function of an obs"),
        (
            lambda _: [1.0, 2.0],
            r"returned \[1.0, 2.0\], must return 1 number\(s\): force \[N\]",
        ),
    ],
)
def test_what_gives_no_action_is_no_policy(policy: Any, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        run(PENDULUM, asking(policy))

"""Files without weights: laws that do not follow them run, and what needs an optimum is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from own_files import OWN, pendulum

from grosmc_mj.environments.signals import Index
from grosmc_mj.experiments.answer.document import run_document
from grosmc_mj.experiments.answer.tables import results_table
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.output.results.tables import Table

RUN = OWN["run"] | {"duration": "0.02 s"}
WEIGHTS: dict[str, Any] = {"Q": [7, 3], "R": 2}
WITHOUT: dict[str, dict[str, Any]] = {
    "pid": {"law": "pid", "kp": 8, "ki": 2, "kd": 1, "filter": "10 ms"},
    "fl-pid": {"law": "fl-pid", "frequency": 3},
    "pd": {"law": "pd", "frequency": 3},
    "own": {"law": "own:law", "a": 1, "b": 2},
}
FOLLOWING: dict[str, dict[str, Any]] = {
    "lqr": {"law": "fl-lqr"},
    "grosmc": {"law": "grosmc", "k": 5, "epsilon": 5},
    "lqi": {"law": "lqi", "integral_weight": 1},
    "adrc": {"law": "adrc", "bandwidth": 20},
}


def weighed(folder: Path, law: dict[str, Any], weights: dict[str, Any], **more: Any) -> Experiment:
    """A pendulum of one's own under a law, with weights or without."""
    return pendulum(folder, run=RUN, task=weights, controller=law, **more)


def without(folder: Path, law: str = "pid", **more: Any) -> Experiment:
    return weighed(folder, WITHOUT[law], {}, **more)


@pytest.mark.parametrize("law", WITHOUT)
def test_a_law_that_does_not_follow_weights_runs_as_with_any(tmp_path: Path, law: str) -> None:
    of_any = weighed(tmp_path, WITHOUT[law], WEIGHTS).run()
    run = without(tmp_path, law).run()
    np.testing.assert_array_equal(run.trajectory.state, of_any.trajectory.state)
    assert run.metrics["settling_time"] == of_any.metrics["settling_time"]
    assert run.metrics["max_input"] == of_any.metrics["max_input"]


@pytest.mark.parametrize("law", FOLLOWING)
def test_a_law_that_follows_weights_asks_for_them_by_name(tmp_path: Path, law: str) -> None:
    with pytest.raises(ArgumentError, match=r"task: Q is missing: .* Q weighs q, w"):
        weighed(tmp_path, FOLLOWING[law], {})
    with pytest.raises(ArgumentError, match=r"task: R is missing: .* R weighs"):
        weighed(tmp_path, FOLLOWING[law], {"Q": [1, 1]})


def test_half_an_index_is_none(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match=r"task: R is missing: the index needs .* R weighs q"):
        weighed(tmp_path, WITHOUT["pid"], {"Q": [1, 1]})


def headers(table: Table) -> list[str]:
    return [column.header for column in table.columns]


def test_without_weights_nothing_is_told_of_an_optimum(tmp_path: Path) -> None:
    run = without(tmp_path).run()
    for name in ("deviation", "cost_continuous", "cost_whole", "cost_optimal"):
        assert run.metrics[name].value is None
        assert run.metrics[name].note == "no weights"
    assert run_document(run)["weights"] == {}
    assert not any("*" in header or "J" in header for header in headers(results_table([run])))

    of_any = weighed(tmp_path, WITHOUT["pid"], WEIGHTS).run()
    assert of_any.metrics["cost_whole"].value is not None
    assert any("*" in header for header in headers(results_table([of_any])))


@pytest.mark.parametrize(
    ("requirement", "words"),
    [
        (
            {"deviation_below": "1 rad"},
            "deviation_below: no law .* has weights: give .* Q and R",
        ),
        ({"cost_ratio_below": 2}, "cost_ratio_below: no law .* has weights"),
        ({"always": "deviation < 1 rad"}, "has 'deviation' at character 1"),
    ],
)
def test_a_requirement_on_the_optimum_asks_for_weights(
    tmp_path: Path, requirement: dict[str, Any], words: str
) -> None:
    with pytest.raises(ArgumentError, match=words):
        without(tmp_path, requirement=requirement)
    assert weighed(tmp_path, WITHOUT["pid"], WEIGHTS, requirement=requirement).limits


def test_an_environment_has_no_reward_without_weights(tmp_path: Path) -> None:
    law = without(tmp_path).law("corrected", "pid")
    with pytest.raises(ArgumentError, match="pid has no weights"):
        Index(law)

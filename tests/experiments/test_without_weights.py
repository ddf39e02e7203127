"""Files without weights: laws that do not follow them run, and what needs an optimum is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from case_texts import PYTHON

from grosmc_mj.environments.signals import Index
from grosmc_mj.experiments.answer.document import run_document
from grosmc_mj.experiments.answer.tables import results_table
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.output.results.tables import Table

PENDULUM = """
[plant]
plant = "own:pendulum"
[run]
start = {{ q = "10 deg" }}
duration = "0.2 s"
engine = "python"
[task]
{weights}
[[controller]]
{law}
"""
WEIGHTS = "Q = [7, 3]\nR = 2"
WITHOUT = {
    "pid": 'law = "pid"\nkp = 8\nki = 2\nkd = 1\nfilter = "10 ms"',
    "fl-pid": 'law = "fl-pid"\nfrequency = 3',
    "pd": 'law = "pd"\nfrequency = 3',
    "own": 'law = "own:law"\na = 1\nb = 2',
}
FOLLOWING = {
    "lqr": 'law = "fl-lqr"',
    "grosmc": 'law = "grosmc"\nk = 5\nepsilon = 5',
    "lqi": 'law = "lqi"\nintegral_weight = 1',
    "adrc": 'law = "adrc"\nbandwidth = 20',
}


def load(folder: Path, law: str, weights: str = "", more: str = "") -> Experiment:
    (folder / "own.py").write_text(PYTHON, encoding="utf-8")
    path = folder / "mine.toml"
    path.write_text(PENDULUM.format(law=law, weights=weights) + more, encoding="utf-8")
    return Experiment.load(path)


@pytest.mark.parametrize("law", WITHOUT)
def test_a_law_that_does_not_follow_weights_runs_as_with_any(tmp_path: Path, law: str) -> None:
    weighed = load(tmp_path, WITHOUT[law], WEIGHTS).run()
    run = load(tmp_path, WITHOUT[law]).run()
    np.testing.assert_array_equal(run.trajectory.state, weighed.trajectory.state)
    assert run.metrics["settling_time"] == weighed.metrics["settling_time"]
    assert run.metrics["max_input"] == weighed.metrics["max_input"]


@pytest.mark.parametrize("law", FOLLOWING)
def test_a_law_that_follows_weights_asks_for_them_by_name(tmp_path: Path, law: str) -> None:
    with pytest.raises(ArgumentError, match=r"task: Q is missing: .* Q weighs q, w"):
        load(tmp_path, FOLLOWING[law])
    with pytest.raises(ArgumentError, match=r"task: R is missing: .* R weighs"):
        load(tmp_path, FOLLOWING[law], "Q = [1, 1]")


def test_half_an_index_is_none(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match=r"task: R is missing: the index needs .* R weighs q"):
        load(tmp_path, WITHOUT["pid"], "Q = [1, 1]")


def headers(table: Table) -> list[str]:
    return [column.header for column in table.columns]


def test_without_weights_nothing_is_told_of_an_optimum(tmp_path: Path) -> None:
    run = load(tmp_path, WITHOUT["pid"]).run()
    for name in ("deviation", "cost_continuous", "cost_whole", "cost_optimal"):
        assert run.metrics[name].value is None
        assert run.metrics[name].note == "no weights"
    assert run_document(run)["weights"] == {}
    assert not any("*" in header or "J" in header for header in headers(results_table([run])))

    weighed = load(tmp_path, WITHOUT["pid"], WEIGHTS).run()
    assert weighed.metrics["cost_whole"].value is not None
    assert any("*" in header for header in headers(results_table([weighed])))


@pytest.mark.parametrize(
    ("requirement", "words"),
    [
        ('deviation_below = "1 rad"', "deviation_below: no law .* has weights: give .* Q and R"),
        ("cost_ratio_below = 2", "cost_ratio_below: no law .* has weights"),
        ('always = "deviation < 1 rad"', "has 'deviation' at character 1"),
    ],
)
def test_a_requirement_on_the_optimum_asks_for_weights(
    tmp_path: Path, requirement: str, words: str
) -> None:
    with pytest.raises(ArgumentError, match=words):
        load(tmp_path, WITHOUT["pid"], more=f"[[requirement]]\n{requirement}")
    load(tmp_path, WITHOUT["pid"], WEIGHTS, f"[[requirement]]\n{requirement}")


def test_an_environment_has_no_reward_without_weights(tmp_path: Path) -> None:
    law = load(tmp_path, WITHOUT["pid"]).law("corrected", "pid")
    with pytest.raises(ArgumentError, match="pid has no weights"):
        Index(law)

"""Verdict over draws: that of the worst run among those of the draws, each run by itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cases
import numpy as np
import pytest

from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.studies.sweep.draws import _worst, judged_over_draws
from grosmc_mj.studies.sweep.runs import Outcomes

DRAWS = 6


@pytest.fixture(scope="module")
def case() -> Experiment:
    return cases.case(
        plant={"compare": ["physics"]},
        run={"duration": "0.2 s"},
        requirement=[{"final_error_below": "0.89 rad"}, {"input_below": "1 kA"}],
        sensor={"of": "rotor angle", "noise": "30 mrad", "resolution": "1 mrad"},
    )


def run_alone(case: Experiment, draw: int) -> RunResult:
    assert case.loop is not None
    return replace(case, loop=case.loop.draw(draw), run_number=draw).run("physics", "lqr")


@pytest.fixture(scope="module")
def alone(case: Experiment) -> list[Any]:
    """Judgements of each draw, run alone."""
    return [run_alone(case, draw).requirements for draw in range(DRAWS)]


@pytest.mark.parametrize("index", [0, 1])
def test_each_requirement_is_judged_by_its_worst_draw(
    index: int, case: Experiment, alone: list[Any]
) -> None:
    judgement = judged_over_draws(case.run("physics", "lqr"), DRAWS).requirements[index]
    worst = min((of_draw[index] for of_draw in alone), key=lambda x: x.margin)
    assert judgement.margin == pytest.approx(worst.margin, rel=1e-9)
    assert judgement.measured == pytest.approx(worst.measured, rel=1e-9)
    assert judgement.kept == worst.kept


def test_a_verdict_says_how_many_draws_keep_a_requirement(
    case: Experiment, alone: list[Any]
) -> None:
    judgement, _ = judged_over_draws(case.run("physics", "lqr"), DRAWS).requirements
    kept = sum(of_draw[0].kept for of_draw in alone)
    assert 0 < kept < DRAWS
    assert judgement.note.endswith(f"kept in {kept} of {DRAWS} draws")


def test_a_run_without_a_loop_is_judged_alone() -> None:
    run = Experiment.load("servo/case1").run("physics", "grosmc")
    assert judged_over_draws(run, DRAWS) is run


@pytest.mark.parametrize(("error", "completed"), [(np.nan, True), (0.5, False)])
def test_a_draw_without_a_value_is_not_kept(
    error: float, completed: bool, case: Experiment
) -> None:
    first = case.run("physics", "lqr").requirements[1]
    columns = {
        first.requirement.metric: np.array([error, 0.1]),
        "status": np.array(["completed" if completed else "diverged", "completed"], object),
    }
    worst = _worst(first, Outcomes([first.requirement], columns))
    assert not worst.kept
    assert worst.margin is None
    assert worst.note.endswith("kept in 2 of 3 draws")

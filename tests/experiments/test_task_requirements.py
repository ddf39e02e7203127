"""Requirements of a task under any law, and the answers of a run to them."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from cases import case
from steps import STEP, step

from grosmc_mj.experiments.answer.document import experiment_result
from grosmc_mj.experiments.answer.tables import requirements_table, results_table
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements.judging import Judgement, judge_run, judge_runs
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.experiments.requirements.transient import SettlesWithin
from grosmc_mj.output.results.document import json_text
from grosmc_mj.output.results.result import Result, Value

ALL = {
    "settles_within": "4 s",
    "overshoot_below": 0.5,
    "rms_below": "1 rad",
    "stays_within": "1 rad",
    "after": "1 s",
    "final_error_below": "1 mrad",
}
# e'' + 3 e' + 9 e = 0 from 1 rad at rest, which the nominal error obeys.
TIME = np.arange(6001) * 1e-3
WD = 3.0 * math.sqrt(0.75)
E = np.exp(-1.5 * TIME) * (np.cos(WD * TIME) + 1.5 / WD * np.sin(WD * TIME))


def settled(band: float) -> float:
    """When the textbook's error enters a band for good [s]."""
    last_outside = np.flatnonzero(np.abs(E) > band)[-1]
    return float(TIME[last_outside + 1])


@pytest.fixture(scope="module", params=["corrected", "physics"])
def stepped(request: pytest.FixtureRequest) -> RunResult:
    """A second-order step, sampled at 1 kHz, under all kinds of limits on its error."""
    return step(ALL).run(request.param, "pd")


def measured(result: RunResult, kind: str) -> float:
    """The measured value of a kind of limit."""
    (limit,) = [limit for limit in result.case.limits if limit.key == kind]
    value = judge_run(limit, result).measured
    assert value is not None
    return value


@pytest.mark.parametrize(
    ("kind", "expected", "tolerance"),
    [
        # M_p = exp(-pi zeta / sqrt(1 - zeta^2)) = 16.3 %.
        ("overshoot_below", math.exp(-math.pi / math.sqrt(3)), 0.01),
        ("rms_below", np.sqrt(np.mean(E[TIME >= 1] ** 2)), 0.01),
        ("stays_within", np.abs(E[TIME >= 1]).max(), 0.01),
        ("final_error_below", np.abs(E[TIME >= 5.4]).max(), 0.02),
    ],
)
def test_a_second_order_step_has_its_textbook_figures(stepped, kind, expected, tolerance) -> None:
    """To what sampling leaves of a continuous law."""
    assert measured(stepped, kind) == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize(
    ("band", "plant"), [(0.2, "corrected"), (0.05, "corrected"), (0.004, "physics")]
)
def test_a_second_order_step_settles_when_the_textbook_says(band, plant) -> None:
    experiment = step(ALL | {"band": f"{band} rad"})
    assert f"settles within 4 s to {band} rad" in [limit.words for limit in experiment.limits]
    settling = measured(experiment.run(plant, "pd"), "settles_within")
    assert settling == pytest.approx(settled(band), abs=0.005)


def judged_on_settling(plant: PlantName, **tables: Any) -> Judgement:
    """The judgement of a step that shall settle within 1 s."""
    experiment = step(**tables)
    (limit,) = experiment.limits
    judgement = judge_run(limit, experiment.run(plant, "pd"))
    assert not judgement.kept
    return judgement


def test_a_band_that_is_reached_late_says_how_long_the_optimum_takes() -> None:
    """By the law's own error dynamics, without the lag of twice the inertia."""
    heavier = {"body": "rotor", "mass_scale": 2}
    judgement = judged_on_settling("corrected", requirement={"settles_within": "1 s"}, edit=heavier)
    assert (judgement.measured or 0) > settled(0.02) + 0.5
    assert judgement.note == f"its nominal optimum takes {settled(0.02):.3g} s"


def test_a_band_that_is_never_reached_says_so_of_the_optimum_too() -> None:
    """Poles at 3 rad/s leave 1 % of the step after 1.5 s, not a millionth."""
    short = STEP["run"] | {"duration": "1.5 s"}
    settles = {"settles_within": "1 s", "band": "1e-6 rad"}
    judgement = judged_on_settling("physics", run=short, requirement=settles)
    assert judgement.measured is None
    assert judgement.note == "not reached; its nominal optimum does not settle either"


# Machines whose outputs are held, and those whose outputs follow a reference.
REGULATED = [
    "servo/bench",
    "servo/machine",
    "cart_pendulum/bench",
    "cart_pendulum/machine",
]
FOLLOWING = [
    "arm/bench",
    "arm/machine",
    "two_link_arm/bench",
    "two_link_arm/machine",
    "jaco/bench",
    "jaco/machine",
]


@cache
def machine(name: str) -> Experiment:
    return Experiment.load(name)


def limits_of(experiment: Experiment) -> dict[str, Requirement]:
    """The first limit of each kind."""
    return {limit.key: limit for limit in reversed(experiment.limits)}


@pytest.mark.parametrize("name", REGULATED + FOLLOWING)
def test_a_machine_asks_every_law_for_no_more_than_its_actuators_give(name: str) -> None:
    experiment = machine(name)
    limits = limits_of(experiment)
    laws = set[str]().union(*(limit.laws for limit in limits.values()))
    assert laws == set(experiment.controllers)
    assert experiment.loop is not None
    largest = max(actuator.limit for actuator in experiment.loop.actuators)
    assert limits["input_below"].number == largest


@pytest.mark.parametrize("name", REGULATED)
def test_a_regulated_machine_stays_where_it_has_settled(name: str) -> None:
    """It ends within two steps of its sensor."""
    experiment = machine(name)
    assert experiment.loop is not None
    system = experiment.law("physics", "lqr").coordinates.system
    outputs = {system.states[row].name for row in system.controlled}
    (step,) = (sensor.resolution for sensor in experiment.loop.sensors if sensor.of in outputs)
    limits = limits_of(experiment)
    assert limits["final_error_below"].number == pytest.approx(2 * step, rel=0.01)
    assert limits["stays_within"].after == limits["settles_within"].number


@pytest.mark.parametrize("name", FOLLOWING)
def test_a_machine_that_follows_stays_in_the_band_of_its_settling(name: str) -> None:
    """Its rms error is half its largest."""
    limits = limits_of(machine(name))
    settles = limits["settles_within"]
    assert isinstance(settles, SettlesWithin)
    assert settles.band == limits["stays_within"].number
    assert limits["rms_below"].number == pytest.approx((settles.band or 0) / 2, rel=0.01)


def test_a_state_is_an_output_of_relative_degree_one() -> None:
    """y' = v = -3 (y - 2): the speed is 2 (1 - exp(-3 t)), but for the hold at 1 kHz."""
    outputs = {"formulas": ["rotor speed"]}
    experiment = case(
        "servo",
        law="first",
        laws={"first": {"law": "fl-lqr"}},
        run=STEP["run"],
        task={"outputs": outputs, "reference": ["2"], "sign": 1, "Q": 9, "R": 1},
        requirement={"stays_within": "10 mrad/s", "after": "3 s"},
    )
    run = experiment.run("physics", "first")
    expected = 2 * (1 - np.exp(-3 * run.trajectory.time))
    assert np.abs(run.trajectory.state[:, 1] - expected).max() < 2e-3
    assert run.requirements[0].kept


class Judged(NamedTuple):
    """Runs of a case of which one of two requirements is not kept."""

    experiment: Experiment
    runs: list[RunResult]
    judgements: list[Judgement]

    def result(self, *, complete: bool = True) -> Result:
        content = experiment_result(self.experiment, self.runs, self.judgements, complete=complete)
        return Result.model_validate_json(json_text(content))


@pytest.fixture(scope="module")
def judged() -> Judged:
    experiment = case(
        "servo",
        plant={"compare": ["corrected"]},
        run={"start": {"rotor angle": "0.5 rad"}, "duration": "0.05 s", "engine": "python"},
        controller=[{"law": "lqr"}, {"law": "grosmc"}],
        requirement={"of": ["lqr"], "input_below": "1 kA", "stays_within": "0.1 rad"},
    )
    runs = list(experiment.runs())
    return Judged(experiment, runs, judge_runs(experiment.limits, runs))


def test_a_run_answers_which_requirement_is_nearest_and_where_each_law_breaks(judged) -> None:
    result = judged.result()
    (answer,) = result.answers
    assert answer.verdict == "not kept"
    assert answer.words == "1 of 2 requirements is not kept"
    assert answer.more == "tightest requirement: stays within 0.1 rad (0.5 rad by lqr on corrected)"
    (standing,) = result.standings
    assert (standing.law, standing.breaks_at) == ("lqr", "corrected")
    assert standing.words == "stays within 0.1 rad: 0.5 rad"


def test_a_result_has_tables_of_requirements_runs_gains(judged: Judged) -> None:
    result = judged.result()
    titles = [sheet.table.title.split(":")[0] for sheet in result.sheets]
    assert titles == ["Requirements", judged.experiment.nominal.system.title, ""]
    assert [row[2] for row in result.sheets[1].table.rows] == ["lqr", "grosmc"]


def test_tables_say_which_draws_their_numbers_are_of(judged: Judged) -> None:
    """A time of the first draw stood beside that of the worst one, both without a name."""
    requirements = requirements_table(judged.judgements, 10)
    runs = results_table(judged.runs, 10)
    assert requirements.title == "Requirements, the worst of 10 draws"
    assert runs.title.startswith(f"{judged.experiment.nominal.system.title}, draw 0 of 10: y = ")


@pytest.mark.parametrize(
    ("requirements", "complete", "ended", "verdict"),
    [
        ("kept", True, "", "kept"),
        ("none", True, "", "kept"),
        ("kept", False, "", "not decided"),
        ("none", True, "diverged", "not kept"),
    ],
)
def test_a_run_is_kept_that_is_complete_and_breaks_nothing(
    judged: Judged, requirements: str, complete: bool, ended: str, verdict: str
) -> None:
    judgements = [item for item in judged.judgements if item.kept and requirements == "kept"]
    runs = [replace(run, ended=ended) for run in judged.runs]
    result = judged._replace(runs=runs, judgements=judgements).result(complete=complete)
    assert result.answers[0].verdict == verdict


@pytest.fixture(scope="module")
def values(judged: Judged) -> dict[str, Value]:
    """Values of the result by name."""
    return {value.name: value for value in judged.result().values}


def test_margins_and_statuses_are_values_of_the_result(values: dict[str, Value]) -> None:
    margin = values["servo/mine corrected lqr: stays within 0.1 rad, margin"]
    assert margin.value == pytest.approx(-0.4)
    assert margin.size == pytest.approx(0.5)
    assert (margin.unit, margin.better, margin.relative) == ("rad", 1, 1e-6)
    assert values["servo/mine corrected lqr: status"].value == "completed"


def test_values_of_a_switching_law_repeat_roughly_and_others_closely(judged, values) -> None:
    assert values["servo/mine corrected lqr: deviation"].relative == 1e-6
    deviation = values["servo/mine corrected grosmc: deviation"]
    assert (deviation.relative, deviation.absolute) == (0.25, 1e-4)
    assert deviation.value == judged.runs[1].metrics["deviation"].value

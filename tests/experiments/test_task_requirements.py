"""Requirements of a task under any law, and the answers of a run to them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from case_texts import STEP, load

from grosmc_mj.experiments.answer.document import experiment_result
from grosmc_mj.experiments.answer.tables import requirements_table, results_table
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.requirements.judging import Judgement, judge_run, judge_runs
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.experiments.requirements.transient import SettlesWithin
from grosmc_mj.output.results.document import json_text
from grosmc_mj.output.results.result import Result, Value

ALL = """
settles_within = "4 s"
band = "{} rad"
overshoot_below = 0.5
rms_below = "1 rad"
stays_within = "1 rad"
after = "1 s"
final_error_below = "1 mrad"
"""
# e'' + 3 e' + 9 e = 0 from 1 rad at rest, which the nominal error obeys.
TIME = np.arange(6001) * 1e-3
WD = 3.0 * math.sqrt(0.75)
E = np.exp(-1.5 * TIME) * (np.cos(WD * TIME) + 1.5 / WD * np.sin(WD * TIME))


def settled(band: float) -> float:
    """When the textbook's error enters a band for good [s]."""
    last_outside = np.flatnonzero(np.abs(E) > band)[-1]
    return float(TIME[last_outside + 1])


@pytest.fixture(scope="module", params=["corrected", "physics"])
def step(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """A second-order step, sampled at 1 kHz, under all kinds of limits on its error."""
    experiment = load(tmp_path_factory.mktemp("step"), STEP + ALL.format(0.2))
    return experiment.run(request.param, "pd")


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
def test_a_second_order_step_has_its_textbook_figures(step, kind, expected, tolerance) -> None:
    """To what sampling leaves of a continuous law."""
    assert measured(step, kind) == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize(
    ("band", "plant"), [(0.2, "corrected"), (0.05, "corrected"), (0.004, "physics")]
)
def test_a_second_order_step_settles_when_the_textbook_says(tmp_path, band, plant) -> None:
    experiment = load(tmp_path, STEP + ALL.format(band))
    result = experiment.run(plant, "pd")
    assert measured(result, "settles_within") == pytest.approx(settled(band), abs=0.005)


def test_a_band_is_named_in_words(step: RunResult) -> None:
    words = [limit.words for limit in step.case.limits]
    assert "settles within 4 s to 0.2 rad" in words


HEAVIER = """
settles_within = "1 s"
[[edit]]
body = "rotor"
mass_scale = 2
"""


def test_a_band_that_is_reached_late_says_how_long_the_optimum_takes(tmp_path) -> None:
    """By the law's own error dynamics, without the lag of twice the inertia."""
    experiment = load(tmp_path, STEP + HEAVIER)
    (limit,) = experiment.limits
    judgement = judge_run(limit, experiment.run("corrected", "pd"))
    assert not judgement.kept
    assert (judgement.measured or 0) > settled(0.02) + 0.5
    assert judgement.note == f"its nominal optimum itself: takes {settled(0.02):.3g} s"


SHORT = """
[plant]
system = "servo"
[run]
duration = "1.5 s"
control_period = "1 ms"
timestep = "1 ms"
[task]
reference = ["1"]
sign = -1
Q = [1, 1]
R = 1
[[controller]]
law = "pd"
frequency = 3
damping = 0.5
[[requirement]]
settles_within = "1 s"
band = "1e-6 rad"
"""


def test_a_band_that_is_never_reached_says_so_of_the_optimum_too(tmp_path) -> None:
    """Poles at 3 rad/s leave 1 % of the step after 1.5 s, not a millionth."""
    experiment = load(tmp_path, SHORT)
    (limit,) = experiment.limits
    judgement = judge_run(limit, experiment.run("physics", "pd"))
    assert not judgement.kept
    assert judgement.measured is None
    assert judgement.note == "not reached; its nominal optimum itself: not reached"


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


def limits_of(experiment: Experiment) -> dict[str, Requirement]:
    """The first limit of each kind."""
    return {limit.key: limit for limit in reversed(experiment.limits)}


@pytest.mark.parametrize("name", REGULATED + FOLLOWING)
def test_a_machine_asks_something_of_every_law(name: str) -> None:
    experiment = Experiment.load(name)
    laws = set[str]().union(*(limit.laws for limit in limits_of(experiment).values()))
    assert laws == set(experiment.controllers)


@pytest.mark.parametrize("name", REGULATED + FOLLOWING)
def test_a_machines_input_may_use_the_range_of_its_actuators(name: str) -> None:
    experiment = Experiment.load(name)
    loop = experiment.loop
    assert loop is not None
    largest = max(actuator.limit for actuator in loop.actuators)
    assert limits_of(experiment)["input_below"].number == largest


@pytest.mark.parametrize("name", REGULATED)
def test_a_regulated_machine_ends_within_two_steps_of_its_sensor(name: str) -> None:
    experiment = Experiment.load(name)
    loop = experiment.loop
    assert loop is not None
    system = experiment.law("physics", "lqr").coordinates.system
    outputs = {system.states[row].name for row in system.controlled}
    (step,) = (sensor.resolution for sensor in loop.sensors if sensor.of in outputs)
    limit = limits_of(experiment)["final_error_below"]
    assert limit.number == pytest.approx(2 * step, rel=0.01)


@pytest.mark.parametrize("name", REGULATED)
def test_a_regulated_machine_stays_where_it_has_settled(name: str) -> None:
    limits = limits_of(Experiment.load(name))
    assert limits["stays_within"].after == limits["settles_within"].number


@pytest.mark.parametrize("name", FOLLOWING)
def test_a_machine_that_follows_stays_in_the_band_of_its_settling(name: str) -> None:
    limits = limits_of(Experiment.load(name))
    settles = limits["settles_within"]
    assert isinstance(settles, SettlesWithin)
    assert settles.band == limits["stays_within"].number


@pytest.mark.parametrize("name", FOLLOWING)
def test_the_rms_error_of_a_machine_that_follows_is_half_its_largest(name: str) -> None:
    limits = limits_of(Experiment.load(name))
    half = limits["stays_within"].number / 2
    assert limits["rms_below"].number == pytest.approx(half, rel=0.01)


SPEED = """
[plant]
system = "servo"
[run]
duration = "6 s"
control_period = "1 ms"
timestep = "1 ms"
[task]
outputs = { formulas = ["rotor speed"] }
reference = ["2"]
sign = 1
Q = 9
R = 1
[laws.first]
law = "fl-lqr"
[[controller]]
law = "first"
[[requirement]]
stays_within = "10 mrad/s"
after = "3 s"
"""


def test_a_state_is_an_output_of_relative_degree_one(tmp_path) -> None:
    """y' = v = -3 (y - 2): the speed is 2 (1 - exp(-3 t)), but for the hold at 1 kHz."""
    run = load(tmp_path, SPEED).run("physics", "first")
    expected = 2 * (1 - np.exp(-3 * run.trajectory.time))
    assert np.abs(run.trajectory.state[:, 1] - expected).max() < 2e-3
    assert run.requirements[0].kept


CASE = """
[plant]
system = "servo"
compare = ["corrected"]
[run]
start = { "rotor angle" = "0.5 rad" }
duration = "0.05 s"
engine = "python"
[[controller]]
law = "lqr"
[[controller]]
law = "grosmc"
[[requirement]]
of = ["lqr"]
input_below = "1 kA"
stays_within = "0.1 rad"
"""


class Judged(NamedTuple):
    """Runs of a case of which one of two requirements is not kept."""

    experiment: Experiment
    runs: list[RunResult]
    judgements: list[Judgement]

    def result(self, *, complete: bool = True) -> Result:
        content = experiment_result(self.experiment, self.runs, self.judgements, complete=complete)
        return Result.model_validate_json(json_text(content))


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Judged:
    experiment = load(tmp_path_factory.mktemp("judged"), CASE)
    runs = list(experiment.runs())
    return Judged(experiment, runs, judge_runs(experiment.limits, runs))


def test_a_run_answers_which_requirement_is_nearest(judged: Judged) -> None:
    (answer,) = judged.result().answers
    assert answer.verdict == "not kept"
    assert answer.words == "1 of 2 requirements is not kept"
    assert answer.more == "tightest: stays within 0.1 rad: 0.5 rad by lqr on corrected"


def test_a_run_answers_where_each_law_breaks(judged: Judged) -> None:
    (standing,) = judged.result().standings
    assert standing.law == "lqr"
    assert standing.breaks_at == "corrected"
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


def test_a_run_that_keeps_all_requirements_is_kept(judged: Judged) -> None:
    kept = [item for item in judged.judgements if item.kept]
    result = judged._replace(judgements=kept).result()
    assert result.answers[0].verdict == "kept"


def test_a_run_without_requirements_is_kept(judged: Judged) -> None:
    result = judged._replace(judgements=[]).result()
    assert result.answers[0].verdict == "kept"


def test_an_interrupted_run_is_not_decided(judged: Judged) -> None:
    kept = [item for item in judged.judgements if item.kept]
    result = judged._replace(judgements=kept).result(complete=False)
    assert result.answers[0].verdict == "not decided"


def test_a_run_without_requirements_that_ends_early_is_not_kept(judged: Judged) -> None:
    ended = replace(judged.runs[0], ended="diverged")
    result = judged._replace(runs=[ended], judgements=[]).result()
    assert result.answers[0].verdict == "not kept"


@pytest.fixture(scope="module")
def values(judged: Judged) -> dict[str, Value]:
    """Values of the result by name."""
    return {value.name: value for value in judged.result().values}


def test_a_margin_is_a_value_of_the_result(values: dict[str, Value]) -> None:
    margin = values["servo/mine corrected lqr: stays within 0.1 rad, margin"]
    assert margin.value == pytest.approx(-0.4)
    assert margin.size == pytest.approx(0.5)
    assert margin.unit == "rad"
    assert margin.better == 1
    assert margin.relative == 1e-6


def test_a_status_is_a_value_of_the_result(values: dict[str, Value]) -> None:
    assert values["servo/mine corrected lqr: status"].value == "completed"


def test_values_of_a_smooth_law_repeat_closely(values: dict[str, Value]) -> None:
    assert values["servo/mine corrected lqr: deviation"].relative == 1e-6


def test_values_of_a_switching_law_repeat_roughly(judged: Judged, values: dict[str, Value]) -> None:
    deviation = values["servo/mine corrected grosmc: deviation"]
    assert deviation.relative == 0.25
    assert deviation.absolute == 1e-4
    assert deviation.value == judged.runs[1].metrics["deviation"].value

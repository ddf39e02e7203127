"""Task margins by search, and where chatter begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
import pytest

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.results.tables import number
from grosmc_mj.output.results.verdicts import Verdict, verdict_of
from grosmc_mj.simulation.disturbances import Table
from grosmc_mj.simulation.loop import Actuator, Loop
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.studies.margins.changes import DELAY, GAIN_DOWN, GAIN_UP, ChangeSearch, changed
from grosmc_mj.studies.margins.chatter import Chatter, chatter, is_quiet
from grosmc_mj.studies.margins.sensitivity import LoopPlace, RunningLoop
from grosmc_mj.studies.margins.task import AS_IS, task_margins
from grosmc_mj.studies.sweep.search import run_searches
from grosmc_mj.studies.target import Condition, StudiedLaw, chosen_laws, limits_in
from grosmc_mj.studies.target import conditions_of as conditions
from grosmc_mj.studies.trials import Trial, Trials


class ServoTask(NamedTuple):
    """A law on the servo's bench under a condition."""

    trials: Trials
    law: StudiedLaw
    condition: Condition

    @property
    def loop(self) -> Loop:
        """The loop of the bench."""
        assert self.condition.experiment.loop
        return self.condition.experiment.loop

    @property
    def margins(self) -> dict[str, Verdict]:
        """The margins of the task by their kinds."""
        return {row.step: row for row in task_margins(self.trials, self.law, self.condition)}

    def failing_draws(self, loop: Loop) -> int:
        """The number of draws of a loop that do not keep the task."""
        draws = self.trials.all_draws(Trial(self.law, self.condition, loop))
        return sum(not draw.kept for draw in draws)


def servo_task(name: str, condition: str = "nominal", draws: int = 1) -> ServoTask:
    """Return a law on the servo's bench under a condition."""
    bench = Experiment.load("servo/bench")
    bare = bench.changed(loop=None)
    (law,) = chosen_laws(bare, [name])
    (under,) = [item for item in conditions(bare) if item.name == condition]
    limits = limits_in(bare.file.requirement, law, under, ["corrected"])
    trials = Trials("corrected", lambda *_: limits, draws, threads=1)
    looped = replace(under, experiment=under.experiment.changed(loop=bench.loop))
    return ServoTask(trials, law, looped)


@pytest.fixture(scope="module")
def lqr() -> dict[str, Verdict]:
    """The task margins of LQR on the nominal bench."""
    return servo_task("lqr").margins


@pytest.mark.parametrize(
    ("kind", "kept", "by_frequency"), [(GAIN_UP, 14.0, 13.7), (DELAY, 0.106, 0.113)]
)
def test_the_task_margins_of_lqr_are_near_those_by_frequency_response(
    lqr: dict[str, Verdict], kind: str, kept: float, by_frequency: float
) -> None:
    assert lqr[kind].largest_kept == pytest.approx(kept, rel=0.02)
    assert lqr[kind].largest_kept == pytest.approx(by_frequency, rel=0.07)


@pytest.mark.parametrize("kind", [GAIN_DOWN, GAIN_UP, DELAY])
def test_what_breaks_is_named_and_a_failing_change_stands_above_the_kept_one(
    lqr: dict[str, Verdict], kind: str
) -> None:
    kept = lqr[kind].largest_kept
    failed = lqr[kind].smallest_failed
    assert lqr[kind].words
    assert kept is not None
    assert failed is not None
    assert kept < failed <= max(1.02 * kept, kept + 5e-4 + 1e-9)


@pytest.mark.parametrize(("condition", "factor"), [("nominal", 29), ("case1", 1.45)])
def test_the_load_of_case_1_decides_how_far_the_gain_of_sign_may_fall(
    condition: str, factor: float
) -> None:
    margin = servo_task("sign", condition).margins[GAIN_DOWN]
    assert margin.largest_kept == pytest.approx(factor, rel=0.03)
    assert margin.tightest == "stays_within"


def test_lqr_does_not_keep_its_task_under_case_1() -> None:
    margins = servo_task("lqr", "case1").margins
    assert list(margins) == [AS_IS]
    assert margins[AS_IS].words == "stays within"
    assert not margins[AS_IS].kept


@pytest.mark.slow
def test_every_change_that_is_kept_is_kept_in_all_draws_and_the_failing_one_is_not() -> None:
    """Larger gains are kept in some draws."""
    task = servo_task("implicit", draws=8)
    margin = task.margins[GAIN_UP]
    assert margin.draws == 8
    assert margin.largest_kept is not None
    assert margin.smallest_failed is not None
    assert margin.largest_kept < (servo_task("implicit").margins[GAIN_UP].largest_kept or 0.0)
    kept = changed(task.loop, ["current"], gain=margin.largest_kept)
    failed = changed(task.loop, ["current"], gain=margin.smallest_failed)
    assert task.failing_draws(kept) == 0
    assert task.failing_draws(failed) == margin.numbers["failing_draws"] != 0


class ScriptedDraws(Trials):
    """Draws that keep a gain up to 4; from the sixth on up to 2."""

    def results(self, runs: Sequence[tuple[Trial, int]]) -> list[Verdict]:
        for trial, draw in runs:
            assert trial.loop
            (actuator,) = trial.loop.actuators
            share = actuator.gain / (4.0 if draw < 5 else 2.0)
            self.known[trial, draw] = verdict_of({"stays_within": share}, draw=draw)
        return [self.known[run] for run in runs]


@pytest.mark.parametrize(
    ("draws", "kept", "words"), [(5, 4.0, "stays within"), (8, 2.0, "stays within in 3 of 8 draws")]
)
def test_a_change_is_kept_in_all_draws_and_those_that_break_are_told_unless_all_do(
    draws: int, kept: float, words: str
) -> None:
    task = servo_task("lqr")
    trials = ScriptedDraws("corrected", task.trials.limits, draws)
    _, margin, _ = task_margins(trials, task.law, task.condition)
    assert (margin.step, margin.draws, margin.words) == (GAIN_UP, draws, words)
    assert margin.largest_kept == kept
    assert margin.numbers == {"failing_draws": 5 if draws == 5 else 3}


def searched(kind: str, bound: float) -> ChangeSearch:
    """A finished search in which changes up to this one pass."""
    search = ChangeSearch(kind, Loop(), ["current"], 1e-3)
    run_searches([search], lambda tried: [factor <= bound for _, factor in tried])
    return search


@pytest.mark.parametrize("kind", [GAIN_DOWN, GAIN_UP])
@pytest.mark.parametrize("bound", [1.017, 2.4449, 28.46, 507.3])
def test_a_printed_gain_is_one_that_was_run(kind: str, bound: float) -> None:
    kept, _ = searched(kind, bound).bounds
    assert float(number(kept)) == kept <= bound


def test_a_change_is_before_the_limit_of_the_actuator() -> None:
    loop = Loop(actuators=(Actuator("current", limit=4.0, delay=1e-3, gain=0.5),))
    (actuator,) = changed(loop, ["current"], gain=3.0, delay=2e-3).actuators
    assert actuator == Actuator("current", limit=4.0, delay=3e-3, gain=1.5)


def test_a_loop_without_actuators_gets_one_for_each_input() -> None:
    actuators = changed(Loop(), ["a", "b"], gain=2.0).actuators
    assert actuators == (Actuator("a", gain=2.0), Actuator("b", gain=2.0))


@pytest.mark.parametrize("kind", [GAIN_DOWN, GAIN_UP, DELAY])
@pytest.mark.parametrize("bound", [1.0, 3.3, 700.0])
def test_a_search_ends_within_one_percent_or_one_timestep(kind: str, bound: float) -> None:
    kept, failed = searched(kind, bound).bounds
    unit = 1e-3 if kind == DELAY else 1.0
    assert kept <= bound * unit < failed
    if kind == DELAY and bound == 700.0:
        assert failed == float("inf")
    else:
        assert failed - kept <= max(0.011 * kept, 1e-3 if kind == DELAY else 0.0) + 1e-12


def begins(name: str) -> Chatter:
    """Return where a law of the servo begins to chatter, at rest on the equations."""
    experiment = Experiment.load("servo/bench").changed(loop=None)
    (law,) = chosen_laws(experiment, [name])
    controller = law.controller
    rest = controller.designed.error.rest(controller.parameters)
    plant = experiment.plant("corrected")

    def running(loop: Loop) -> RunningLoop:
        loops = (experiment.loop_around(controller, loop),)
        return RunningLoop(plant, controller, rest, 1e-3, 5e-4, loops=loops, threads=1)

    return chatter(running, Loop(), LoopPlace("current"), 4.0, 0.5)


def test_the_implicit_law_begins_to_chatter_at_gain_2_and_a_sample_of_delay() -> None:
    """S = 1 - 1/z is stable up to there."""
    found = begins("implicit")
    assert not found.at_rest
    assert found.gain == pytest.approx(2.0, rel=0.02)
    assert found.delay == pytest.approx(1e-3)


def test_the_sign_law_chatters_at_rest() -> None:
    found = begins("sign")
    assert found == Chatter(True, 1.0, 0.0)


class ScriptedLoop:
    """A loop of two realizations whose input is given, (2, samples, 1)."""

    loops = (None, None)
    control_period = 1e-3

    def __init__(self, inputs: Array, status: Status) -> None:
        self._run = SimpleNamespace(input=inputs, status=[Status.COMPLETED, status])
        self.pulse = Table((0.0,), 1.0)

    def run(self, _place: object, tables: Sequence[Table], *_: object) -> Any:
        self.pulse = tables[1]
        return self._run

    def sampled(self, inputs: Array) -> Array:
        return inputs


@pytest.mark.parametrize(
    ("amplitude", "status", "quiet"),
    [
        (0.99, Status.COMPLETED, True),
        (1.01, Status.COMPLETED, False),
        (0.0, Status.DIVERGED, False),
    ],
)
def test_a_loop_is_quiet_if_no_input_changes_by_a_thousandth_of_its_size(
    amplitude: float, status: Status, quiet: bool
) -> None:
    """The size is 8 A, and the second run switches between +a and -a in its second half."""
    inputs = np.zeros((2, 400, 1))
    inputs[:, :200] = np.random.default_rng(0).normal(size=(2, 200, 1))
    inputs[1, 200::2, 0] = amplitude * 4e-3
    inputs[1, 201::2, 0] = -amplitude * 4e-3
    loop = ScriptedLoop(inputs, status)
    assert is_quiet(cast(RunningLoop, loop), LoopPlace("current"), 8.0, 0.4) == quiet
    assert loop.pulse == Table((0.08,), 1e-3)

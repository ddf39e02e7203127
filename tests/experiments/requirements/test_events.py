"""Events: when an error is in its band for good, and the swings before it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from event_metrics import event_metrics
from steps import step

from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements.conditions import Conditions, RecordedRun
from grosmc_mj.experiments.requirements.judging import judge_run
from grosmc_mj.experiments.requirements.metrics import Metric
from grosmc_mj.experiments.requirements.optimum import compare_with_optimum
from grosmc_mj.experiments.requirements.swings import ReachesWithin
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.trajectory import Status, Trajectory
from grosmc_mj.studies.sweep.runs import Row, run_rows
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import SERVO

H = 1e-3
TIME = np.arange(10_001) * H
TURN = 2 * math.pi
LQR: Controller = chapter_controller("lqr", MujocoPlant.load("servo").analytic())
# A mode of 0.25 rad/s decay and half a turn a second: its extremes are at whole seconds.
DECAY = 0.25
RING = np.exp(-DECAY * TIME) * np.cos(math.pi * TIME)


def of_error(error: np.ndarray) -> Trajectory:
    """A run of the servo, whose angle shall be 1 rad, with this error."""
    u = np.zeros(len(TIME) - 1)
    return Trajectory(
        system=SERVO,
        time=TIME,
        state=np.column_stack([1.0 - error, np.zeros(len(TIME))]),
        command=u,
        input=u,
        sliding=None,
        weighed=u,
        memory=np.zeros(len(u), [("v", np.float64)]),
        wrench=None,
        physics=None,
        status=np.array([Status.COMPLETED], object)[0],
        valid_until=np.array(TIME[-1]),
    )


def measured(run: Trajectory, band: float, **options: Any) -> dict[str, Metric]:
    comparison = compare_with_optimum(run, LQR)
    return event_metrics(run, LQR, comparison, "rotor angle", band, **options)


@pytest.mark.parametrize("band", [0.15, 0.2, 0.5])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_decaying_oscillation_reaches_its_band_after_its_last_half_swing(band, sign) -> None:
    """A half swing's extreme, at a whole second n, is exp(-n/4): it swings n times beyond 0."""
    events = measured(of_error(sign * RING), band)
    beyond = math.floor(-math.log(band) / DECAY)
    last_outside = np.flatnonzero(np.abs(RING) > band)[-1]
    assert events["reached"] == (pytest.approx(TIME[last_outside + 1]), "s", "")
    assert events["swings"].value == beyond
    assert beyond <= (events["reached"].value or 0.0) < beyond + 0.5


@pytest.mark.parametrize("sign", [1, -1])
def test_the_last_peak_is_that_of_the_state_itself(sign) -> None:
    """The angle is 1 rad less the error; the extreme of a damped cosine leads the cosine's."""
    events = measured(of_error(sign * RING), 0.2)
    lead = math.atan(DECAY / math.pi) / math.pi
    error = math.exp(-DECAY * (6 - lead)) * math.cos(math.pi * lead)
    assert events["last_peak"].value == pytest.approx(abs(1 - sign * error), abs=1e-5)


def test_noise_within_the_band_makes_no_swings() -> None:
    noise = np.random.default_rng(0).uniform(-0.02, 0.02, len(TIME))
    quiet = measured(of_error(RING), 0.2)
    noisy = measured(of_error(RING + noise), 0.2)
    assert noisy["swings"] == quiet["swings"]
    assert noisy["reached"].value == pytest.approx(quiet["reached"].value, abs=0.1)


def test_a_monotone_approach_has_no_swing() -> None:
    events = measured(of_error(np.exp(-TIME)), 0.2)
    assert events["reached"].value == pytest.approx(math.log(5), abs=2 * H)
    assert events["swings"].value == 0
    assert events["last_peak"] == (None, "rad", "no swing")


def test_an_overshoot_just_beyond_the_band_is_a_swing() -> None:
    """It is known only within the band: back from 0.21 rad by 0.2 rad is 0.01 rad."""
    error = np.interp(TIME, [0, 1, 2], [1, -0.21, 0])
    events = measured(of_error(error), 0.2)
    assert events["swings"].value == 1
    assert events["last_peak"].value == pytest.approx(1.21, abs=1e-12)


@pytest.mark.parametrize("late", [9.5, 10.1])
def test_a_band_that_is_reached_in_the_last_tenth_counts_as_not_reached(late) -> None:
    events = measured(of_error(np.where(late > TIME, 1.0, 0.0)), 0.2)
    assert {events[name].note for name in ("reached", "swings", "last_peak")} == {"not reached"}
    assert events["final_error"].value == 1.0


@pytest.mark.parametrize("turns", [-2, -1, 1, 3])
def test_an_angle_is_reached_from_any_number_of_turns(turns) -> None:
    """The state itself is that of another turn."""
    here = measured(of_error(RING), 0.2, periodic=True)
    there = measured(of_error(RING + turns * TURN), 0.2, periodic=True)
    assert there["reached"] == here["reached"]
    assert there["swings"] == here["swings"]
    assert there["final_error"].value == pytest.approx(here["final_error"].value, abs=1e-12)
    assert measured(of_error(RING + turns * TURN), 0.2)["reached"].note == "not reached"


# In a case file

ASKED = {
    "reaches_within": "4 s",
    "swings_below": 3,
    "last_peak_below": "1.2 rad",
    "band": "0.02 rad",
}


@pytest.fixture(scope="module")
def case() -> Experiment:
    """A second-order step with damping 0.5, to 1 rad."""
    return step(ASKED)


def test_a_second_order_step_peaks_where_the_textbook_says(case) -> None:
    """Peaks of exp(-zeta pi/sqrt(1 - zeta^2)) = 16.3 % and 2.7 %: two are beyond 2 %."""
    run = case.run("physics", "pd")
    judged = {item.requirement.key: judge_run(item.requirement, run) for item in run.requirements}
    assert judged["swings_below"].measured == 2
    share = math.exp(-math.pi / math.sqrt(3))
    assert judged["last_peak_below"].measured == pytest.approx(1 - share**2, rel=1e-3)
    assert all(item.kept for item in judged.values())


def test_an_unrecorded_run_has_the_same_events_to_the_bit(case) -> None:
    run = case.run("physics", "pd")
    outcomes = run_rows(case, [Row("pd")], plant="physics")
    for limit in outcomes.limits:
        assert outcomes[f"margin {limit.name}"][0] == judge_run(limit, run).margin


def test_a_run_that_reaches_nothing_keeps_no_limit_on_the_way(case) -> None:
    run = case.run("physics", "pd")
    stuck = replace(run, trajectory=of_error(np.ones(len(TIME))))
    for judgement in case.limits:
        judged = judge_run(judgement, stuck)
        assert not judged.kept
        assert judged.note == "does not come to 0.02 rad and stay"


def test_runs_without_the_event_are_ordered_behind_all_others_by_a_finite_number(case) -> None:
    """A search compares them: the margin of a run that never reaches is minus infinity."""
    shares = np.array([-math.inf, -2.5, 0.5])
    (reaches, *_) = case.limits
    assert isinstance(reaches, ReachesWithin)
    order = reaches.order_share(shares, {}, np.full(3, 6.0), 1.0)
    assert order[1:].tolist() == [-2.5, 0.5]
    assert -math.inf < order[0] < -100


def test_a_periodic_requirement_without_a_state_is_one_on_the_error_modulo_a_turn(case) -> None:
    (reaches, *_) = case.limits
    periodic = replace(reaches, periodic=True, band=0.2)
    assert not periodic.signal
    unloaded = Conditions([], np.zeros((2, 1)))
    here, there = [
        periodic.of_record(RecordedRun(of_error(RING + angle), LQR, unloaded))
        for angle in (0.0, 2 * TURN)
    ]
    assert here == there == measured(of_error(RING), 0.2)["reached"].value


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (
            {"reaches_within": "4 s"},
            'give the half width of its band, such as band = "0.1 rad"',
        ),
        (
            {"reaches_within": "5.9 s", "band": "0.1 rad"},
            "a run of 6 s tells up to 5.4 s",
        ),
        ({"input_below": "1 A", "periodic": True}, "periodic is for"),
        (
            {"stays_within": "1 rad/s", "state": "rotor speed", "periodic": True},
            "periodic is for angles, not for rad/s",
        ),
    ],
)
def test_a_wrong_event_is_refused_in_a_line(table: dict[str, Any], words: str) -> None:
    with pytest.raises(ArgumentError, match=words) as refused:
        step(table)
    assert "\n" not in str(refused.value)

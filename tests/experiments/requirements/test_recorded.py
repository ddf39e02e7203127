"""Kinds that are measured on a recorded run: envelope, recovery, saturation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from cases import case

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements.conditions import Conditions
from grosmc_mj.experiments.requirements.judging import judge_run, unfailing
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.simulation.loop import Actuator
from grosmc_mj.studies.sweep.runs import Row, run_rows


def push(start: float, stop: float) -> dict[str, Any]:
    """A torque of 20 mN m between two instants [s]."""
    torque = ["0 N m", "20 mN m", "0 N m"]
    pulse = {"profile": "pulse", "start": f"{start} s", "stop": f"{stop} s"}
    return {"body": "rotor", "torque": torque} | pulse


PUSHES = [push(4, 4.5), push(8, 8.4)]


def servo(*requirements: dict[str, Any], pushes: Sequence[dict[str, Any]] = PUSHES) -> Experiment:
    """The servo under LQR with an input of 0.2 A at most, pushed twice, with requirements."""
    return case(
        "servo",
        plant={"compare": ["corrected"]},
        run={"duration": "12 s"},
        actuator={"of": "current", "limit": "0.2 A"},
        disturbance=list(pushes),
        requirement=list(requirements),
    )


def measured(experiment: Experiment) -> list[float]:
    """Measured values of its requirements that have one."""
    result = experiment.run("corrected", "lqr")
    values = []
    for limit in experiment.limits:
        if not limit.has_value:
            continue
        value = judge_run(limit, result).measured
        assert value is not None
        values.append(value)
    return values


# -- the envelope ----------------------------------------------------------------------------------

# Envelopes of a run, and formulas that say the same.
ENVELOPES = [
    (
        {"signal": "rotor angle", "above": "-0.5 rad", "below": "60 deg"},
        {"always": "-0.5 rad < rotor angle < 60 deg"},
    ),
    (
        {"signal": "rotor angle", "below": "1.1 rad", "from": "3 s"},
        {"always": "rotor angle < 1.1 rad", "after": "3 s"},
    ),
    ({"signal": "current", "below": "100 mA"}, {"always": "current < 0.1 A"}),
    ({"signal": "deviation", "below": "0.2 rad"}, {"always": "deviation < 0.2 rad"}),
]


@pytest.mark.parametrize(("envelope", "formula"), ENVELOPES)
def test_an_envelope_has_the_margin_of_its_formula(envelope, formula) -> None:
    of_envelope, of_formula = measured(servo(envelope, formula))
    assert of_envelope == pytest.approx(of_formula, rel=1e-12)


def test_an_envelope_holds_from_an_instant_to_another_one() -> None:
    window = {"from": "1 s", "to": "3 s"}
    experiment = servo({"signal": "rotor angle", "above": "0.9 rad"} | window)
    run_of_it = experiment.run("corrected", "lqr").trajectory
    counting = (run_of_it.time > 1 - 1e-9) & (run_of_it.time < 3 + 1e-9)
    assert measured(experiment) == [run_of_it.state[counting, 0].min()]
    assert experiment.limits[0].words == "rotor angle above 0.9 rad from 1 s to 3 s"


# -- recovery --------------------------------------------------------------------------------------


def recovery(experiment: Experiment, band: float, onset: float, end: float) -> float:
    """Time from an onset to the last instant outside a band before an end, and a timestep [s]."""
    trajectory = experiment.run("corrected", "lqr").trajectory
    last = onset
    for t, angle in zip(trajectory.time, trajectory.state[:, 0], strict=True):
        if onset - 1e-9 < t < end - 1e-9 and abs(angle - 1) > band:
            last = t + trajectory.time[1]
    return float(last) - onset


def recovering(*pushes: dict[str, Any], band: float = 5e-3) -> Experiment:
    """The servo that must recover from pushes."""
    return servo({"recovers_within": "2.5 s", "band": f"{band} rad"}, pushes=pushes)


def test_recovery_counts_from_each_onset_to_the_last_instant_outside_the_band() -> None:
    experiment = recovering(*PUSHES)
    expected = [recovery(experiment, 5e-3, 4, 8), recovery(experiment, 5e-3, 8, 12)]
    assert min(expected) > 0.1
    assert measured(experiment) == [pytest.approx(max(expected), abs=1e-9)]


def test_the_end_of_a_load_has_a_recovery_of_its_own() -> None:
    """The rotor turns for a while after the load comes, and after it goes."""
    requirement = {"state": "rotor speed", "recovers_within": "3 s", "band": "2 mrad/s"}
    experiment = servo(requirement, pushes=[push(5, 8)])
    trajectory = experiment.run("corrected", "lqr").trajectory
    outside = np.abs(trajectory.state[:, 1]) > 2e-3
    lengths = []
    for begin, end in ((5, 8), (8, 12)):
        window = (trajectory.time > begin - 1e-9) & (trajectory.time < end - 1e-9)
        last = trajectory.time[window & outside].max() + trajectory.time[1]
        lengths.append(last - begin)
    assert 0.5 < max(lengths) < 3
    assert measured(experiment) == [pytest.approx(max(lengths), abs=1e-9)]


def test_a_late_onset_is_no_part_of_the_recovery_before_it() -> None:
    (alone,) = measured(recovering(push(4, 4.5)))
    assert measured(recovering(push(4, 4.5), push(11, 11.5))) == [alone]


@pytest.mark.parametrize(("start", "stop"), [(0, 20), (11, 11.5)])
def test_an_onset_at_the_start_or_too_near_the_end_asks_for_no_recovery(start, stop) -> None:
    experiment = recovering(push(start, stop))
    (limit,) = experiment.limits
    judgement = judge_run(limit, experiment.run("corrected", "lqr"))
    assert (judgement.measured, judgement.note) == (0.0, "no disturbance begins in time")


def test_a_load_from_the_start_hides_no_later_one() -> None:
    (alone,) = measured(recovering(*PUSHES))
    (beside,) = measured(recovering({"input": "current", "amplitude": "1e-9 A"}, *PUSHES))
    assert alone > 0.1
    assert beside == pytest.approx(alone, abs=1e-9)


def test_an_onset_outside_the_band_prolongs_the_recovery_before_it() -> None:
    experiment = recovering(push(4, 4.5), push(4.6, 5.1))
    expected = recovery(experiment, 5e-3, 4, 12)
    assert expected > 1.1
    assert measured(experiment) == [pytest.approx(expected, abs=1e-9)]


def test_a_recovery_that_is_not_over_counts_up_to_the_end() -> None:
    """The torque stays, and LQR has no integrator."""
    assert measured(recovering(push(4, 12), band=1e-6)) == [pytest.approx(8, abs=2e-3)]


# -- saturation ------------------------------------------------------------------------------------


def saturated(seconds: float) -> Experiment:
    """The servo whose time at the limit is bounded by a key and by a text."""
    within = f"eventually[0 s, {seconds} s] abs(current) < 0.1999999 A"
    text = f"abs(current) > 0.1999999 A implies {within}"
    return servo({"saturated_for_less_than": f"{seconds} s", "always": text})


def test_the_longest_time_at_the_limit_is_that_of_the_command() -> None:
    experiment = saturated(1)
    trajectory = experiment.run("corrected", "lqr").trajectory
    longest = run_length = 0
    for command in trajectory.command:
        run_length = run_length + 1 if abs(command) >= 0.2 else 0
        longest = max(longest, run_length)
    assert longest > 100
    assert measured(experiment)[0] == pytest.approx(longest * trajectory.time[1], rel=1e-12)


@pytest.mark.parametrize("step", [-1, 1])
def test_a_text_bounds_the_time_at_the_limit_as_the_key_does(step) -> None:
    """Two timesteps around the longest time."""
    (longest,) = measured(saturated(1))
    experiment = saturated(round(longest + 2e-3 * step, 6))
    result = experiment.run("corrected", "lqr")
    kept = [judge_run(limit, result).kept for limit in experiment.limits]
    assert kept == [step > 0, step > 0]


@pytest.mark.parametrize(
    ("gain", "at_limit"), [(0.5, False), (-0.5, False), (0.9, True), (-0.9, True)]
)
def test_an_actuator_is_at_its_limit_where_what_it_gives_is(gain, at_limit) -> None:
    """The law asks for 1 A at the start, of which the actuator gives a part, up to 0.8 A."""
    experiment = servo({"saturated_for_less_than": "1 s"})
    loop = experiment.loop
    assert loop is not None
    loop = loop.changed("actuator", "current", limit=0.8, gain=gain)
    result = experiment.changed(loop=loop, duration=0.01).run("corrected", "lqr")
    assert np.abs(result.trajectory.command).max() == pytest.approx(1.0, rel=0.1)
    assert np.abs(result.trajectory.input).max() == pytest.approx(min(abs(gain), 0.8), rel=0.1)
    assert (result.saturated > 0) is at_limit
    assert bool(result.cut.any()) is at_limit
    (judgement,) = [judge_run(limit, result) for limit in experiment.limits]
    assert (judgement.measured > 0) is at_limit  # pyright: ignore[reportOptionalOperand]


def test_each_input_is_at_a_limit_of_its_own_side_by_what_its_actuator_would_give() -> None:
    """Input 0 gives twice its command from -1 to 3 A, input 1 its command from -5 to 2 A."""
    limits = np.array([[-1.0, -5.0], [3.0, 2.0]])
    conditions = Conditions([], limits, [(0, Actuator("a", gain=2.0))])
    commands = np.array([[-0.51, 1.9], [-0.49, 2.1], [1.4, -4.9], [1.6, -5.1]])
    expected = [[True, False], [False, True], [False, False], [True, True]]
    assert conditions.at_limit(commands).tolist() == expected


def test_inputs_without_a_limit_are_never_saturated() -> None:
    experiment = saturated(1).changed(loop=None)
    limit = experiment.limits[0]
    assert unfailing([limit], [experiment.run("corrected", "lqr")]) == [
        "cannot fail: saturated for less than 1 s (no input has a limit)"
    ]


# -- all of them -----------------------------------------------------------------------------------


def test_batches_measure_as_single_runs_do() -> None:
    experiment = servo(
        {"recovers_within": "2.5 s", "band": "20 mrad", "saturated_for_less_than": "1 s"},
        {"signal": "rotor angle", "below": "1.1 rad"},
    )
    outcomes = run_rows(experiment, [Row("lqr")], plant="corrected")
    values = [limit.number - outcomes[f"margin {limit.name}"][0] for limit in outcomes.limits]
    assert values == pytest.approx(measured(experiment), rel=1e-12)


ABOVE = {"signal": "current", "above": "1 A"}


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"signal": "rotor angle"}, 'give a bound, such as above = "1 rad", or below'),
        ({"signal": "angle", "above": "1 rad"}, "unknown signal 'angle'"),
        (ABOVE | {"above": "1 rad"}, '"1 rad" cannot be converted to A'),
        (ABOVE | {"to": "20 s"}, "to = 20 s is after the end of a run at 12 s"),
        (ABOVE | {"from": "2 s", "to": "1 s"}, "there is no time from 2 s to 1 s"),
        (ABOVE | {"from": "12 s"}, "there is no time from 12 s to 12 s"),
        ({"stays_within": "1 rad", "to": "2 s"}, "to is for signal, which is not there"),
        (
            {"recovers_within": "1 s"},
            'give the half width of its band, such as band = "0.1 rad"',
        ),
        ({"saturated_for_less_than": 1}, "1 has no unit"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(table: dict[str, Any], words: str) -> None:
    with pytest.raises(ArgumentError) as refusal:
        servo(table)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)

"""Kinds that are measured on a recorded run: envelope, recovery, saturation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from case_texts import load

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements.conditions import Conditions
from grosmc_mj.experiments.requirements.judging import judge_run, unfailing
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.simulation.loop import Actuator
from grosmc_mj.studies.sweep.runs import Row, run_rows

# The servo under LQR with an input of 0.2 A at most, pushed twice.
SERVO = """
[plant]
system = "servo"
compare = ["corrected"]
[run]
duration = "12 s"
[[actuator]]
of = "current"
limit = "0.2 A"
[[controller]]
law = "lqr"
"""
PUSH = """
[[disturbance]]
body = "rotor"
torque = ["0 N m", "20 mN m", "0 N m"]
profile = "pulse"
start = "{}"
stop = "{}"
"""
PUSHES = PUSH.format("4 s", "4.5 s") + PUSH.format("8 s", "8.4 s")


def servo(folder: Path, requirements: str, pushes: str = PUSHES) -> Experiment:
    """The servo with these requirements."""
    return load(folder, f"{SERVO}{pushes}{requirements}")


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
ENVELOPES = {
    'signal = "rotor angle"\nabove = "-0.5 rad"\nbelow = "60 deg"\n': (
        'always = "-0.5 rad < rotor angle < 60 deg"\n'
    ),
    'signal = "rotor angle"\nbelow = "1.1 rad"\nfrom = "3 s"\n': (
        'always = "rotor angle < 1.1 rad"\nafter = "3 s"\n'
    ),
    'signal = "current"\nbelow = "100 mA"\n': 'always = "current < 0.1 A"\n',
    'signal = "deviation"\nbelow = "0.2 rad"\n': 'always = "deviation < 0.2 rad"\n',
}


@pytest.mark.parametrize("table", ENVELOPES)
def test_an_envelope_has_the_margin_of_its_formula(tmp_path, table) -> None:
    same = f"[[requirement]]\n{ENVELOPES[table]}"
    envelope, formula = measured(servo(tmp_path, f"[[requirement]]\n{table}{same}"))
    assert envelope == pytest.approx(formula, rel=1e-12)


def test_an_envelope_holds_from_an_instant_to_another_one(tmp_path) -> None:
    table = '[[requirement]]\nsignal = "rotor angle"\nabove = "0.9 rad"\nfrom = "1 s"\nto = "3 s"\n'
    experiment = servo(tmp_path, table)
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


def recovering(folder: Path, pushes: str = PUSHES, band: float = 5e-3) -> Experiment:
    """The servo that must recover from pushes."""
    table = f'[[requirement]]\nrecovers_within = "2.5 s"\nband = "{band} rad"\n'
    return servo(folder, table, pushes)


def test_recovery_counts_from_each_onset_to_the_last_instant_outside_the_band(tmp_path) -> None:
    experiment = recovering(tmp_path)
    expected = [recovery(experiment, 5e-3, 4, 8), recovery(experiment, 5e-3, 8, 12)]
    assert min(expected) > 0.1
    assert measured(experiment) == [pytest.approx(max(expected), abs=1e-9)]


def test_the_end_of_a_load_has_a_recovery_of_its_own(tmp_path) -> None:
    """The rotor turns for a while after the load comes, and after it goes."""
    table = '[[requirement]]\nstate = "rotor speed"\nrecovers_within = "3 s"\nband = "2 mrad/s"\n'
    experiment = servo(tmp_path, table, PUSH.format("5 s", "8 s"))
    trajectory = experiment.run("corrected", "lqr").trajectory
    outside = np.abs(trajectory.state[:, 1]) > 2e-3
    lengths = []
    for begin, end in ((5, 8), (8, 12)):
        window = (trajectory.time > begin - 1e-9) & (trajectory.time < end - 1e-9)
        last = trajectory.time[window & outside].max() + trajectory.time[1]
        lengths.append(last - begin)
    assert 0.5 < max(lengths) < 3
    assert measured(experiment) == [pytest.approx(max(lengths), abs=1e-9)]


def test_a_late_onset_is_no_part_of_the_recovery_before_it(tmp_path) -> None:
    early = PUSH.format("4 s", "4.5 s")
    (alone,) = measured(recovering(tmp_path, early))
    assert measured(recovering(tmp_path, early + PUSH.format("11 s", "11.5 s"))) == [alone]


def test_a_load_from_the_start_has_no_onset(tmp_path) -> None:
    experiment = recovering(tmp_path, PUSH.format("0 s", "20 s"))
    (limit,) = experiment.limits
    judgement = judge_run(limit, experiment.run("corrected", "lqr"))
    assert (judgement.measured, judgement.note) == (0.0, "no disturbance begins in time")


def test_a_load_from_the_start_hides_no_later_one(tmp_path) -> None:
    nothing = '[[disturbance]]\ninput = "current"\namplitude = "1e-9 A"\n'
    (alone,) = measured(recovering(tmp_path))
    (beside,) = measured(recovering(tmp_path, nothing + PUSHES))
    assert alone > 0.1
    assert beside == pytest.approx(alone, abs=1e-9)


def test_an_onset_outside_the_band_prolongs_the_recovery_before_it(tmp_path) -> None:
    pushes = PUSH.format("4 s", "4.5 s") + PUSH.format("4.6 s", "5.1 s")
    experiment = recovering(tmp_path, pushes)
    expected = recovery(experiment, 5e-3, 4, 12)
    assert expected > 1.1
    assert measured(experiment) == [pytest.approx(expected, abs=1e-9)]


def test_a_recovery_that_is_not_over_counts_up_to_the_end(tmp_path) -> None:
    """The torque stays, and LQR has no integrator."""
    experiment = recovering(tmp_path, PUSH.format("4 s", "12 s"), band=1e-6)
    assert measured(experiment) == [pytest.approx(8, abs=2e-3)]


def test_an_onset_is_not_asked_if_the_run_ends_too_early(tmp_path) -> None:
    experiment = recovering(tmp_path, PUSH.format("11 s", "11.5 s"))
    (limit,) = experiment.limits
    judgement = judge_run(limit, experiment.run("corrected", "lqr"))
    assert (judgement.measured, judgement.note) == (0.0, "no disturbance begins in time")


# -- saturation ------------------------------------------------------------------------------------


def saturated(folder: Path, seconds: float) -> Experiment:
    """The servo whose time at the limit is bounded by a key and by a text."""
    within = f"eventually[0 s, {seconds} s] abs(current) < 0.1999999 A"
    text = f"abs(current) > 0.1999999 A implies {within}"
    table = f'[[requirement]]\nsaturated_for_less_than = "{seconds} s"\nalways = "{text}"\n'
    return servo(folder, table)


def test_the_longest_time_at_the_limit_is_that_of_the_command(tmp_path) -> None:
    experiment = saturated(tmp_path, 1)
    trajectory = experiment.run("corrected", "lqr").trajectory
    longest = run_length = 0
    for command in trajectory.command:
        run_length = run_length + 1 if abs(command) >= 0.2 else 0
        longest = max(longest, run_length)
    assert longest > 100
    assert measured(experiment)[0] == pytest.approx(longest * trajectory.time[1], rel=1e-12)


@pytest.mark.parametrize("step", [-1, 1])
def test_a_text_bounds_the_time_at_the_limit_as_the_key_does(tmp_path, step) -> None:
    """Two timesteps around the longest time."""
    (longest,) = measured(saturated(tmp_path, 1))
    experiment = saturated(tmp_path, round(longest + 2e-3 * step, 6))
    result = experiment.run("corrected", "lqr")
    kept = [judge_run(limit, result).kept for limit in experiment.limits]
    assert kept == [step > 0, step > 0]


@pytest.mark.parametrize(
    ("gain", "at_limit"), [(0.5, False), (-0.5, False), (0.9, True), (-0.9, True)]
)
def test_an_actuator_is_at_its_limit_where_what_it_gives_is(tmp_path, gain, at_limit) -> None:
    """The law asks for 1 A at the start, of which the actuator gives a part, up to 0.8 A."""
    experiment = servo(tmp_path, '[[requirement]]\nsaturated_for_less_than = "1 s"\n')
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


def test_inputs_without_a_limit_are_never_saturated(tmp_path) -> None:
    experiment = saturated(tmp_path, 1).changed(loop=None)
    limit = experiment.limits[0]
    assert unfailing([limit], [experiment.run("corrected", "lqr")]) == [
        "cannot fail: saturated for less than 1 s (no input has a limit)"
    ]


# -- all of them -----------------------------------------------------------------------------------

ALL = """
[[requirement]]
recovers_within = "2.5 s"
band = "20 mrad"
saturated_for_less_than = "1 s"
signal = "rotor angle"
below = "1.1 rad"
"""


def test_batches_measure_as_single_runs_do(tmp_path) -> None:
    experiment = servo(tmp_path, ALL)
    outcomes = run_rows(experiment, [Row("lqr")], plant="corrected")
    values = [limit.number - outcomes[f"margin {limit.name}"][0] for limit in outcomes.limits]
    assert values == pytest.approx(measured(experiment), rel=1e-12)


WRONG = {
    'signal = "rotor angle"': 'give a bound, such as above = "1 rad", or below',
    'signal = "angle"\nabove = "1 rad"': "unknown signal 'angle'",
    'signal = "current"\nabove = "1 rad"': '"1 rad" cannot be converted to A',
    'signal = "current"\nabove = "1 A"\nto = "20 s"': "to = 20 s is after the end of a run at 12 s",
    'signal = "current"\nabove = "1 A"\nfrom = "2 s"\nto = "1 s"': (
        "there is no time from 2 s to 1 s"
    ),
    'signal = "current"\nabove = "1 A"\nfrom = "12 s"': "there is no time from 12 s to 12 s",
    'stays_within = "1 rad"\nto = "2 s"': "to is for signal, which is not there",
    'recovers_within = "1 s"': 'give the half width of its band, such as band = "0.1 rad"',
    "saturated_for_less_than = 1": "1 has no unit",
}


@pytest.mark.parametrize("table", WRONG)
def test_a_wrong_table_is_refused_in_one_line(tmp_path, table) -> None:
    with pytest.raises(ArgumentError) as refusal:
        servo(tmp_path, f"[[requirement]]\n{table}\n")
    assert WRONG[table] in str(refusal.value)
    assert "\n" not in str(refusal.value)

"""Plants about an operating point, laws of other equations, implausible numbers."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from campaign_cases import run
from case_texts import LEG_MODEL, MAGLEV, OWN, STEP, load, written

import grosmc_mj as gm
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.errors import ImplausibleWarning
from grosmc_mj.mechanics.physics.edits import AddedMass
from grosmc_mj.studies.sweep.runs import Row, run_rows
from grosmc_mj.theory.plants.parameter_scale import ParameterScale

LEVITATED = """
[plant]
plant = "grosmc_mj.experiments.cases.maglev.maglev:plant"
at = { gap = "10 mm" }
[run]
duration = "0.01 s"
[task]
Q = [1e8, 1e5, 10]
R = 1e-3
[[controller]]
law = "fl-lqr"
"""
LEVITATED_BY_USERS_LAW = """
[plant]
plant = "grosmc_mj.experiments.cases.maglev.maglev:plant"
at = { gap = "10 mm" }
[run]
start = { gap = "11 mm" }
duration = "0.01 s"
[task]
Q = [1e8, 1e5, 10]
R = 1e-3
[[controller]]
law = "mine:held"
gain = -300
"""
USERS_LAW = """
def held(t, x, memory, p):
    return p.reference.u[0] - p.gain * (x[0] - p.reference.x[0])
"""
APPROXIMATED = """
[plant]
plant = "grosmc_mj.experiments.cases.ball_beam.ball_beam:plant"
[design]
plant = "grosmc_mj.experiments.cases.ball_beam.ball_beam:approximation"
[run]
duration = "0.01 s"
[task]
Q = [10, 10, 1, 1]
R = 0.1
[[controller]]
law = "fl-lqr"
"""
LOADED = """
[plant]
model = "furuta.xml"
[run]
duration = "0.01 s"
[task]
Q = [1, 5, 0.02, 0.02]
R = 100
[[controller]]
law = "lqr"
[[edit]]
body = "rod"
added_mass = "20 g"
at = ["1 cm", "2 cm", "3 cm"]
"""


@pytest.mark.parametrize("law", ["lqr", "linear-grosmc"])
def test_a_law_is_designed_for_the_linearization_at_the_operating_point(tmp_path, law) -> None:
    """By hand: m g = C (i/y)^2 holds the ball, whose pull falls by 2 m g/y and grows by 2 m g/i."""
    design = load(tmp_path, MAGLEV.replace('"lqr"', f'"{law}"')).law("corrected", law)
    gap = 0.01
    current = gap * np.sqrt(0.05 * 9.81 / 1e-4)
    A = [[0, 1, 0], [2 * 9.81 / gap, 0, -2 * 9.81 / current], [0, 0, -100]]
    np.testing.assert_allclose(design.designed.lqr.A, A, rtol=1e-6)
    np.testing.assert_allclose(design.designed.lqr.B, [[0], [0], [50]], rtol=1e-12)


def test_runs_start_at_the_operating_point(tmp_path) -> None:
    experiment = load(tmp_path, LEVITATED)
    point = experiment.nominal.at
    assert point is not None
    np.testing.assert_array_equal(experiment.x0, point.x)


def test_runs_are_held_at_the_operating_point(tmp_path) -> None:
    experiment = load(tmp_path, LEVITATED)
    point = experiment.nominal.at
    assert point is not None
    run = experiment.run().trajectory
    np.testing.assert_allclose(run.state - run.state[0], 0, atol=1e-9)
    np.testing.assert_allclose(run.input, point.u[0], rtol=1e-6)


def test_a_start_replaces_states_of_the_operating_point(tmp_path) -> None:
    (tmp_path / "mine.py").write_text(USERS_LAW)
    experiment = load(tmp_path, LEVITATED_BY_USERS_LAW)
    point = experiment.nominal.at
    assert point is not None
    assert experiment.x0[0] == pytest.approx(0.011)
    assert experiment.x0[2] == point.x[2]


def test_the_index_weighs_the_input_from_the_operating_point(tmp_path) -> None:
    (tmp_path / "mine.py").write_text(USERS_LAW)
    experiment = load(tmp_path, LEVITATED_BY_USERS_LAW)
    point = experiment.nominal.at
    assert point is not None
    trajectory = experiment.run().trajectory
    v = trajectory.memory["v"][:, 0]
    assert v[0] == pytest.approx(300 * 0.001)
    assert trajectory.input[0] - v[0] == pytest.approx(point.u[0])


def test_a_law_believes_in_the_equations_of_the_design(tmp_path) -> None:
    law = load(tmp_path, APPROXIMATED).law("corrected", "fl-lqr")
    assert law.coordinates.linearization.relative_degree == (4,)
    assert law.designed.error.system.name == "ball_beam_approximated"


def test_a_plant_keeps_its_equations_beside_a_design(tmp_path) -> None:
    experiment = load(tmp_path, APPROXIMATED)
    assert experiment.plant("corrected").system.name == "ball_beam"


def test_a_load_is_where_the_file_says(tmp_path) -> None:
    edits = load(tmp_path, LOADED).edits
    assert edits == (AddedMass("rod", 0.02, (0.01, 0.02, 0.03)),)


def test_edits_of_one_parameter_multiply_one_after_the_other(tmp_path) -> None:
    edit = '[[edit]]\nparameter = "m"\nscale = 1.1\n'
    experiment = load(tmp_path, OWN + edit)
    nominal = experiment.nominal.plant.parameters.m
    assert experiment.plant("corrected").parameters.m == 1.1 * (1.5 * nominal)


def rate(x, u, m):
    """x' of the pendulum of one's own."""
    return np.stack([x[:, 1], u - m * np.sin(x[:, 0])], axis=1)


def test_a_plant_has_the_edited_parameter_and_its_law_the_nominal_one(tmp_path) -> None:
    """The file's m is 2 and 1.5 times as much in truth."""
    run = load(tmp_path, OWN).run().trajectory
    x = run.state[:-1]
    np.testing.assert_allclose(run.command, 2 * np.sin(x[:, 0]) - 4 * x[:, 0] - 4 * x[:, 1])

    h = run.time[1]
    middle = x + h / 2 * rate(x, run.input, 3)
    for _ in range(2):
        # The midpoint rule, whose error in a timestep is of the order of h^3.
        middle = x + h / 2 * rate(middle, run.input, 3)
    np.testing.assert_allclose(run.state[1:], x + h * rate(middle, run.input, 3), atol=1e-8)


def test_a_row_of_a_design_scales_the_edited_parameter_and_not_the_law_s(tmp_path) -> None:
    """The true m is 1.5 times 2 times the nominal one."""
    text = OWN.replace('"own:law"\na = 4\nb = 4', '"lqr"')
    edited = load(tmp_path, text)
    scales = (*edited.nominal.scales, ParameterScale("m", 2.0))
    case = edited.changed(nominal=replace(edited.nominal, scales=scales))
    table = run_rows(edited, [Row("lqr", case=case)], plant="corrected")

    thrice = load(tmp_path, text.replace("scale = 1.5", "scale = 3.0"))
    run = thrice.run(law="lqr").trajectory
    np.testing.assert_allclose(table["last"][0], run.state[-1], rtol=1e-12)
    for experiment in (edited, thrice):
        assert experiment.law("corrected", "lqr").designed.lqr.A[1, 0] == pytest.approx(-2.0)


def test_a_law_for_equations_is_sampled_in_its_control_period(tmp_path) -> None:
    """Its input changes at multiples of 10 ms, to the law's value for the state there."""
    periods = 'duration = "0.2 s"\ncontrol_period = "10 ms"\ntimestep = "1 ms"'
    text = OWN.replace('duration = "0.2 s"', periods)
    run = load(tmp_path, text).run().trajectory
    periods_of_input = run.input.reshape(20, 10)
    x = run.state[:-1:10]
    sampled = 2 * np.sin(x[:, 0]) - 4 * x[:, 0] - 4 * x[:, 1]
    assert np.all(np.diff(sampled) != 0)
    np.testing.assert_allclose(periods_of_input, np.tile(sampled[:, None], 10), rtol=1e-12)


def test_a_disturbance_of_zero_acts_on_nothing_but_ends_the_transient(tmp_path) -> None:
    zero = """[[disturbance]]
body = "rotor"
torque = ["0 N m", "0 N m", "0 N m"]
profile = "pulse"
start = "0.1 s"
stop = "0.2 s"
"""
    disturbed = load(tmp_path, CASE + zero)
    free = load(tmp_path, CASE)
    assert disturbed.onset == 0.1
    assert free.onset == np.inf
    state = disturbed.run().trajectory.state
    np.testing.assert_array_equal(state, free.run().trajectory.state)


CASE = STEP + 'stays_within = "1e9 rad"\n'


IMPLAUSIBLE = pytest.mark.parametrize(
    ("more", "line"),
    [
        (
            '[[edit]]\nbody = "rotor"\nmass_scale = 1733',
            "edit of 'rotor': mass_scale = 1733 is implausible; usual: 0.01 to 100",
        ),
        (
            '[[motor]]\ninput = "current"\nadded = false\nconstant = "7.68e-3 N m/A"\n'
            'resistance = "2.6 ohm"\nratio = 70\nvoltage = "24 kV"',
            "motor of 'current': voltage = 24000 V is implausible; usual: 0.001 to 1000 V",
        ),
        (
            '[[drive_friction]]\njoint = "shaft"\ncoulomb = "0.1 N m"\nload_motor = 19.8',
            "drive_friction of 'shaft': load_motor = 19.8 is implausible; usual: 1e-07 to 2",
        ),
        (
            '[run.start]\n"rotor angle" = "1e6 rad"',
            "start: rotor angle = 1e+06 rad is implausible; usual: 0 to 10000 rad",
        ),
    ],
)


@IMPLAUSIBLE
def test_an_implausible_number_is_a_warning(tmp_path, more, line) -> None:
    with pytest.warns(ImplausibleWarning) as caught:
        load(tmp_path, CASE + more)
    assert [str(item.message) for item in caught] == [f"{tmp_path / 'mine.toml'}: {line}"]


@IMPLAUSIBLE
def test_the_command_prints_a_line_for_an_implausible_number(tmp_path, capsys, more, line) -> None:
    path = written(tmp_path, CASE + more)
    run("list", path)
    assert f"grosmc-mj: {path}: {line}\n" in capsys.readouterr().err


# A hinge and a slide that stop at 2 (deg, unless it is radian) and at 0.1 m.
STOPPED = """
<mujoco model="stopped"><compiler autolimits="true" {}/><worldbody>
  <body name="link" pos="0 0 1"><joint name="hinge" axis="0 1 0" range="-2 2" damping="1"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1"/>
    <body name="sled" pos="0.3 0 0"><joint name="slide" type="slide" range="-0.1 0.1" damping="1"/>
      <geom type="box" size="0.02 0.02 0.02" mass="0.1"/></body></body></worldbody>
  <actuator><motor name="torque" joint="hinge"/><motor name="force" joint="slide"/></actuator>
</mujoco>
"""
STOPPED_CASE = """
[plant]
model = "stopped.xml"
[run]
start = {{ hinge = "{start} rad" }}
duration = "1 s"
[task]
reference = {{ hinge = "{hinge}", slide = "{slide}" }}
Q = {{ hinge = 100, slide = 100 }}
R = 1
[[controller]]
law = "lqr"
"""
DEGREES = "; angles of an MJCF are in degrees, unless it has "


@pytest.mark.parametrize(
    ("compiler", "numbers", "lines"),
    [
        ("", (0, "0.03", "0.05"), []),
        ('angle="radian"', (0.3, "0.3", "0.1"), []),
        (
            "",
            (0, "0.3", "0"),
            ["task: reference: hinge = 0.3 rad is beyond the joint's range of -0.03491 to 0.03491"],
        ),
        (
            "",
            (0.1, "0.02 * sin(t)", "0.2 * step(t - 0.5)"),
            [
                "start: hinge = 0.1 rad is beyond the joint's range",
                "task: reference: slide = 0.2 m is beyond the joint's range of -0.1 to 0.1 m",
            ],
        ),
    ],
)
def test_a_start_or_reference_beyond_a_joints_range_is_told_before_the_run(
    tmp_path: Path, compiler: str, numbers: tuple[float, str, str], lines: list[str]
) -> None:
    """A range in degrees that was meant in radians is told so."""
    (tmp_path / "stopped.xml").write_text(STOPPED.format(compiler))
    start, hinge, slide = numbers
    text = STOPPED_CASE.format(start=start, hinge=hinge, slide=slide)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load(tmp_path, text)
    told = [str(item.message) for item in caught]
    assert len(told) == len(lines)
    for message, line in zip(told, lines, strict=True):
        assert line in message
        assert (DEGREES in message) == ("hinge" in line)


class LoadedCase(NamedTuple):
    """Limits of a shipped case, and the warnings until they are there."""

    limits: Sequence[Requirement]
    warned: list[str]


@cache
def shipped_case(name: str) -> LoadedCase:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        limits = Experiment.load(name).limits
    return LoadedCase(limits, [str(item.message) for item in caught])


each_shipped_case = pytest.mark.parametrize("name", shipped_files())


@pytest.mark.slow
@each_shipped_case
def test_a_shipped_case_is_plausible(name: str) -> None:
    assert shipped_case(name).warned == []


@pytest.mark.slow
@each_shipped_case
def test_a_shipped_case_requires_something(name: str) -> None:
    assert shipped_case(name).limits


KNOWN_GEAR = """
[plant]
model = "leg.xml"
[run]
duration = "0.01 s"
[task]
Q = {{ hip = 1, knee = 1 }}
R = 1
[[edit]]
input = "hip"
gear = 0.5
known = {known}
[[controller]]
law = "lqr"
"""


def test_a_gear_that_the_laws_of_a_robot_would_not_use_is_no_known_one(tmp_path: Path) -> None:
    """Their input is the torque at the joint: a law that ignored a known gear would fail."""
    (tmp_path / "leg.xml").write_text(LEG_MODEL, encoding="utf-8")
    path = tmp_path / "leg.toml"
    path.write_text(KNOWN_GEAR.format(known="false"), encoding="utf-8")
    assert gm.Experiment.load(path).edits
    path.write_text(KNOWN_GEAR.format(known="true"), encoding="utf-8")
    with pytest.raises(gm.GrosmcError, match="known = true of a gear is not for a model"):
        gm.Experiment.load(path)

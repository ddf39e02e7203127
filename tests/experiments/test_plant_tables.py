"""Plants about an operating point, laws of other equations, implausible numbers."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import cases
import numpy as np
import pytest
from cases import case
from commands import Screen, run
from own_files import LEG, OWN, pendulum

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.plausible import unusual_limits
from grosmc_mj.ground.errors import ImplausibleWarning
from grosmc_mj.mechanics.physics.edits import AddedMass
from grosmc_mj.studies.sweep.runs import Row, run_rows
from grosmc_mj.theory.plants.parameter_scale import ParameterScale

BALL = "grosmc_mj.experiments.cases.ball_beam.ball_beam"
USERS_LAW = """
def held(t, x, memory, p):
    return p.reference.u[0] - p.gain * (x[0] - p.reference.x[0])
"""


def levitated(folder: Path = Path(), **tables: Any) -> Experiment:
    """A ball that a magnet holds at a gap of 10 mm."""
    return case(
        "grosmc_mj.experiments.cases.maglev.maglev:plant",
        folder=folder,
        **{
            "plant": {"at": {"gap": "10 mm"}},
            "run": {"duration": "0.01 s", "engine": "python"},
            "task": {"Q": [1e8, 1e5, 10], "R": 1e-3},
            **tables,
        },
    )


@pytest.mark.parametrize("law", ["lqr", "linear-grosmc"])
def test_a_law_is_designed_for_the_linearization_at_the_operating_point(law: str) -> None:
    """By hand: m g = C (i/y)^2 holds the ball, whose pull falls by 2 m g/y and grows by 2 m g/i."""
    design = levitated(law=law).law("corrected", law)
    gap = 0.01
    current = gap * np.sqrt(0.05 * 9.81 / 1e-4)
    A = [[0, 1, 0], [2 * 9.81 / gap, 0, -2 * 9.81 / current], [0, 0, -100]]
    np.testing.assert_allclose(design.designed.lqr.A, A, rtol=1e-6)
    np.testing.assert_allclose(design.designed.lqr.B, [[0], [0], [50]], rtol=1e-12)


def test_runs_start_and_are_held_at_the_operating_point() -> None:
    experiment = levitated(law="fl-lqr")
    point = experiment.nominal.at
    assert point is not None
    np.testing.assert_array_equal(experiment.x0, point.x)
    run = experiment.run().trajectory
    np.testing.assert_allclose(run.state - run.state[0], 0, atol=1e-9)
    np.testing.assert_allclose(run.input, point.u[0], rtol=1e-6)


def test_a_start_and_the_weighed_input_are_from_the_operating_point_on(tmp_path: Path) -> None:
    """A gap of 11 mm in place of 10 mm, and the current that holds the ball at 10 mm."""
    (tmp_path / "mine.py").write_text(USERS_LAW)
    run = {"start": {"gap": "11 mm"}, "duration": "0.01 s", "engine": "python"}
    experiment = levitated(tmp_path, run=run, controller={"law": "mine:held", "gain": -300})
    point = experiment.nominal.at
    assert point is not None
    assert experiment.x0 == (pytest.approx(0.011), 0.0, point.x[2])
    trajectory = experiment.run().trajectory
    v = trajectory.memory["v"][:, 0]
    assert v[0] == pytest.approx(300 * 0.001)
    assert trajectory.input[0] - v[0] == pytest.approx(point.u[0])


def test_a_robot_is_held_at_its_operating_point_without_a_reference(tmp_path: Path) -> None:
    (tmp_path / "leg.xml").write_text(LEG)
    at = {"hip": "20 deg", "knee": "-30 deg"}
    experiment = case("leg.xml", folder=tmp_path, plant={"at": at}, task={"Q": 1, "R": 1})
    law = experiment.law("physics", "lqr")
    reference = law.coordinates.reference(0.5, law.parameters.reference)
    np.testing.assert_allclose(reference[::3], np.radians([20, -30]), rtol=1e-9)


def test_a_law_believes_in_the_equations_of_the_design_and_the_plant_keeps_its_own() -> None:
    experiment = case(
        f"{BALL}:plant",
        law="fl-lqr",
        design={"plant": f"{BALL}:approximation"},
        task={"Q": [10, 10, 1, 1], "R": 0.1},
    )
    law = experiment.law("corrected", "fl-lqr")
    assert law.coordinates.linearization.relative_degree == (4,)
    assert law.designed.error.system.name == "ball_beam_approximated"
    assert experiment.plant("corrected").system.name == "ball_beam"


def test_a_load_is_where_the_file_says(tmp_path: Path) -> None:
    (tmp_path / "leg.xml").write_text(LEG)
    load = {"body": "shank", "added_mass": "20 g", "at": ["1 cm", "2 cm", "3 cm"]}
    experiment = case("leg.xml", folder=tmp_path, task={"Q": 1, "R": 1}, edit=load)
    assert experiment.edits == (AddedMass("shank", 0.02, (0.01, 0.02, 0.03)),)


def test_laws_of_a_robot_know_a_known_gear(tmp_path: Path) -> None:
    """The input that accelerates the joints as designed is the torque over the gear."""
    (tmp_path / "leg.xml").write_text(LEG)
    tables = {"task": {"Q": {"hip": 1, "knee": 1}, "R": 1}, "run": {"start": {"hip": "0.2 rad"}}}
    gear = {"input": "hip", "gear": -0.5, "known": True}
    plain = case("leg.xml", folder=tmp_path, **tables).run().trajectory
    geared = case("leg.xml", folder=tmp_path, edit=gear, **tables).run().trajectory
    np.testing.assert_allclose(geared.state, plain.state, rtol=0, atol=1e-12)
    np.testing.assert_allclose(geared.input * [-0.5, 1], plain.input, rtol=1e-9)


def test_edits_of_one_parameter_multiply_one_after_the_other(tmp_path: Path) -> None:
    edits = [OWN["edit"], {"parameter": "m", "scale": 1.1}]
    experiment = pendulum(tmp_path, edit=edits)
    nominal = experiment.nominal.plant.parameters.m
    assert experiment.plant("corrected").parameters.m == 1.1 * (1.5 * nominal)


def rate(x, u, m):
    """x' of the pendulum of one's own."""
    return np.stack([x[:, 1], u - m * np.sin(x[:, 0])], axis=1)


def test_a_plant_has_the_edited_parameter_and_its_law_the_nominal_one(tmp_path: Path) -> None:
    """The file's m is 2 and 1.5 times as much in truth."""
    run = pendulum(tmp_path).run().trajectory
    x = run.state[:-1]
    np.testing.assert_allclose(run.command, 2 * np.sin(x[:, 0]) - 4 * x[:, 0] - 4 * x[:, 1])

    h = run.time[1]
    middle = x + h / 2 * rate(x, run.input, 3)
    for _ in range(2):
        # The midpoint rule, whose error in a timestep is of the order of h^3.
        middle = x + h / 2 * rate(middle, run.input, 3)
    np.testing.assert_allclose(run.state[1:], x + h * rate(middle, run.input, 3), atol=1e-8)


def test_a_row_of_a_design_scales_the_edited_parameter_and_not_the_law_s(tmp_path: Path) -> None:
    """The true m is 1.5 times 2 times the nominal one."""
    edited = pendulum(tmp_path, controller={"law": "lqr"})
    scales = (*edited.nominal.scales, ParameterScale("m", 2.0))
    scaled = edited.changed(nominal=replace(edited.nominal, scales=scales))
    table = run_rows(edited, [Row("lqr", case=scaled)], plant="corrected")

    edit = {"parameter": "m", "scale": 3.0}
    thrice = pendulum(tmp_path, controller={"law": "lqr"}, edit=edit)
    run = thrice.run(law="lqr").trajectory
    np.testing.assert_allclose(table["last"][0], run.state[-1], rtol=1e-12)
    gravity = [e.law("corrected", "lqr").designed.lqr.A[1, 0] for e in (edited, thrice)]
    assert gravity == pytest.approx([-2.0, -2.0])


def test_a_law_for_equations_is_sampled_in_its_control_period(tmp_path: Path) -> None:
    """Its input changes at multiples of 10 ms, to the law's value for the state there."""
    periods = {"control_period": "10 ms", "timestep": "1 ms"}
    run = pendulum(tmp_path, run=OWN["run"] | periods).run().trajectory
    x = run.state[:-1:10]
    sampled = 2 * np.sin(x[:, 0]) - 4 * x[:, 0] - 4 * x[:, 1]
    assert np.all(np.diff(sampled) != 0)
    held = np.tile(sampled[:, None], 10)
    np.testing.assert_allclose(run.input.reshape(20, 10), held, rtol=1e-12)


def test_a_disturbance_of_zero_acts_on_nothing_but_ends_the_transient() -> None:
    zero = {
        "body": "rotor",
        "torque": ["0 N m", "0 N m", "0 N m"],
        "profile": "pulse",
        "start": "5 ms",
        "stop": "10 ms",
    }
    run = {"start": {"rotor angle": "1 rad"}}
    disturbed = case("servo", run=run, disturbance=zero)
    free = case("servo", run=run)
    assert (disturbed.onset, free.onset) == (0.005, np.inf)
    np.testing.assert_array_equal(disturbed.run().trajectory.state, free.run().trajectory.state)


# Implausible numbers


@pytest.mark.parametrize(
    ("tables", "line"),
    [
        (
            {"edit": {"body": "rotor", "mass_scale": 1733}},
            "edit of 'rotor': mass_scale = 1733 is implausible; usual: 0.01 to 100",
        ),
        (
            {
                "motor": {
                    "input": "current",
                    "added": False,
                    "constant": "7.68e-3 N m/A",
                    "resistance": "2.6 ohm",
                    "ratio": 70,
                    "voltage": "24 kV",
                }
            },
            "motor of 'current': voltage = 24000 V is implausible; usual: 0.001 to 1000 V",
        ),
        (
            {"drive_friction": {"joint": "shaft", "coulomb": "0.1 N m", "load_motor": 19.8}},
            "drive_friction of 'shaft': load_motor = 19.8 is implausible; usual: 1e-07 to 2",
        ),
        (
            {"run": {"start": {"rotor angle": "1e6 rad"}}},
            "start: rotor angle = 1e+06 rad is implausible; usual: 0 to 10000 rad",
        ),
    ],
)
def test_an_implausible_number_is_a_warning(tmp_path: Path, tables, line) -> None:
    path = cases.write(tmp_path, "servo", **tables)
    with pytest.warns(ImplausibleWarning) as caught:
        Experiment.load(path)
    assert [str(item.message) for item in caught] == [f"{path}: {line}"]


def test_the_command_prints_a_line_for_an_implausible_number(tmp_path, capsys: Screen) -> None:
    path = cases.write(tmp_path, "servo", edit={"body": "rotor", "mass_scale": 1733})
    run("list", path)
    line = "edit of 'rotor': mass_scale = 1733 is implausible; usual: 0.01 to 100"
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
DEGREES = "; angles of an MJCF are in degrees, unless it has "


@pytest.mark.parametrize(
    ("compiler", "start", "reference", "lines"),
    [
        ("", 0, {"hinge": "0.03", "slide": "0.05"}, []),
        ('angle="radian"', 0.3, {"hinge": "0.3", "slide": "0.1"}, []),
        (
            "",
            0,
            {"hinge": "0.3", "slide": "0"},
            ["task: reference: hinge = 0.3 rad is beyond the joint's range of -0.03491 to 0.03491"],
        ),
        (
            "",
            0.1,
            {"hinge": "0.02 * sin(t)", "slide": "0.2 * step(t - 0.5)"},
            [
                "start: hinge = 0.1 rad is beyond the joint's range",
                "task: reference: slide = 0.2 m is beyond the joint's range of -0.1 to 0.1 m",
            ],
        ),
    ],
)
def test_a_start_or_reference_beyond_a_joints_range_is_told_before_the_run(
    tmp_path: Path, compiler: str, start: float, reference: dict[str, str], lines: list[str]
) -> None:
    """A range in degrees that was meant in radians is told so."""
    (tmp_path / "stopped.xml").write_text(STOPPED.format(compiler))
    experiment = case(
        "stopped.xml",
        folder=tmp_path,
        run={"start": {"hinge": f"{start} rad"}, "duration": "1 s"},
        task={"reference": reference, "Q": {"hinge": 100, "slide": 100}, "R": 1},
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        experiment.warn_of_implausible()
    told = [str(item.message) for item in caught]
    assert len(told) == len(lines)
    assert all(line in message for message, line in zip(told, lines, strict=True))
    assert [DEGREES in message for message in told] == ["hinge" in line for line in lines]


def test_a_stop_narrows_the_range_of_its_joint_and_never_widens_it(tmp_path: Path) -> None:
    (tmp_path / "stopped.xml").write_text(STOPPED.format('angle="radian"'))
    stop = {"joint": "hinge", "low": "-1 rad", "high": "3 rad"}
    task = {"reference": {"hinge": "2.5", "slide": "0"}, "Q": {"hinge": 1, "slide": 1}, "R": 1}
    experiment = case("stopped.xml", folder=tmp_path, task=task, stop=stop)
    with pytest.warns(ImplausibleWarning, match="is beyond the joint's range of -1 to 2 rad"):
        experiment.warn_of_implausible()


def test_an_overshoot_of_several_times_the_step_is_implausible() -> None:
    (limit,) = case("servo/case1", requirement={"overshoot_below": 5}).limits
    (line,) = unusual_limits([limit])
    assert line == "overshoot_below = 5 is implausible; usual: up to 1, a share"
    assert unusual_limits([replace(limit, number=1.0)]) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_files())
def test_a_shipped_case_is_plausible_and_requires_something(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", ImplausibleWarning)
        assert Experiment.load(name).limits

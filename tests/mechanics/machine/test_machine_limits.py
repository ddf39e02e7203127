"""A machine's parts at their extremes, together, and in both engines."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import mujoco
import numpy as np
import pytest
from machined import stepped

from grosmc_mj.experiments.catalogue import chapter_controller, find_experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, ModelError
from grosmc_mj.mechanics.machine import (
    LuGre,
    MachinePart,
    Motor,
    Stop,
    Transmission,
    Wall,
)
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory

# A part of the model's own inertia

NOMINAL = MujocoPlant.load("servo", timestep=5e-5)
STIFF = NOMINAL.changed(Transmission("shaft", 0.05, stiffness=1e5, damping=40.0, added=False))


def shaft_angles(plant: MujocoPlant) -> Array:
    """Angles of the shaft [rad] under a sine."""
    return stepped(plant, 0.25, lambda d: d.qpos[0], lambda t: math.sin(20 * t))


def test_a_stiff_transmission_within_the_models_inertia_is_the_rigid_joint() -> None:
    rigid = shaft_angles(NOMINAL)
    soft = shaft_angles(STIFF)
    assert np.abs(soft - rigid).max() < 3e-4


@pytest.mark.parametrize("plant", [STIFF, STIFF.rigid])
def test_a_part_of_the_models_inertia_leaves_its_numbers(plant: MujocoPlant) -> None:
    assert plant.analytic().parameters == NOMINAL.analytic().parameters


# Hidden states


@pytest.fixture(scope="module")
def machine() -> MujocoPlant:
    """A cart-pendulum with a belt and friction."""
    parts = (
        Transmission("slider", inertia=0.05, stiffness=1e4, damping=20.0),
        LuGre("slider", 1.0, stiffness=1e3),
    )
    return MujocoPlant.load("cart_pendulum", edits=parts)


@pytest.fixture(scope="module")
def run(machine: MujocoPlant) -> Trajectory:
    """A run of it by the LQR."""
    law = find_experiment("cart_pendulum", "nominal").law("physics", "lqr")
    return simulate(machine, law, [0, 0.1, 0, 0], duration=0.05, control_period=1e-3)


def test_hidden_states_are_named_with_their_unit(machine: MujocoPlant) -> None:
    units = {state.name: state.unit for state in machine.hidden_states}
    assert units == {"slider twist": "m", "slider friction bristle": "m"}


def test_hidden_states_are_recorded_beside_the_state(machine: MujocoPlant, run: Trajectory) -> None:
    """A motor begins with its joint, and so without a twist."""
    assert run.state.shape[1] == 4
    assert run.physics is not None
    assert run.physics[0, 1:4].tolist() == [0.0, 0.1, 0.0]
    (state,) = (state for state in machine.hidden_states if state.name == "slider twist")
    twist = state.of(run.physics)
    assert twist[0] == 0
    assert 0 < np.abs(twist).max() < 1e-2


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda plant: plant.derivative([0.0] * 4), r"states that x does not tell \(slider twist"),
        (lambda plant: plant.linearization(), r"ask its \.rigid plant"),
    ],
)
def test_a_plant_with_hidden_states_has_no_derivative(
    ask: Any, words: str, machine: MujocoPlant
) -> None:
    with pytest.raises(ModelError, match=words):
        ask(machine)


def test_the_rigid_plant_has_the_derivative_of_its_equations(machine: MujocoPlant) -> None:
    x = [0.0, 1.0, 0.0, 0.0]
    expected = machine.analytic().derivative(x, 1.0)
    assert machine.rigid.derivative(x, 1.0) == pytest.approx(expected)


# Impossible parts


def model(*edits: Edit, name: str = "servo", integrator: Any = "RK4", h: float = 1e-3) -> Any:
    return MujocoPlant.load(name, edits=edits, integrator=integrator, timestep=h).model


BRISTLES = LuGre("shaft", 0.05, 0.07, damping=3.0)
HEAVY_PART = Transmission("shaft", inertia=0.06, stiffness=1e5, added=False)
UNDRIVEN = Transmission("hinge", 0.1, 1e3)
# Arguments of wrong types are meant.
wrong: Any = partial


@pytest.mark.parametrize(
    ("make", "words"),
    [
        # Numbers that no part has.
        (wrong(Transmission, "j", 0.1), "it is rigid: give a stiffness, a backlash or both"),
        (wrong(LuGre, "j", 0.2, 0.1), r"static = 0\.1 must be at least coulomb = 0\.2"),
        (wrong(Stop, "j", 1.0, -1.0), "low = 1 must be below high = -1"),
        (wrong(Motor, "i", 0.1, 1.0, ratio=0.0), "ratio = 0 must be at least 1e-15, or negative"),
        (wrong(Motor, "i", 0.1, 1.0, thermal_resistance=1.0), "heating needs both"),
        (wrong(Wall, "b", 0.1, normal=(0, 0, 0)), "must point somewhere"),
        (wrong(Wall, "b", 0.1, at=(0, 0)), "3 finite numbers"),
        # Parts that a plant cannot have.
        (partial(model, Transmission("shfat", 0.1, 1e3)), r"unknown joint 'shfat'.*did you mean"),
        (partial(model, LuGre("shaft", 0.1), LuGre("shaft", 0.2)), "two of the kind 'lugre'"),
        (partial(model, Motor("currant", 0.1, 1.0)), "unknown input 'currant'"),
        (
            partial(model, Transmission("shaft", 1e-4, 1e4)),
            r"at most 0\.00\d+ s, or make",
        ),
        (
            partial(model, Motor("current", 0.1, 1.0, inductance=1e-5)),
            "another integrator, or",
        ),
        (partial(model, Motor("current", 0.1, 1.0, added=False)), "let them be added"),
        (partial(model, HEAVY_PART), r"0\.06 is no part .* armature of 0 .* 0\.0577: give less"),
        (partial(model, UNDRIVEN, name="cart_pendulum"), "no input drives joint 'hinge'"),
        (partial(model, BRISTLES, integrator="implicitfast"), r"= 1\.05: take integrator RK4"),
    ],
)
def test_a_part_that_cannot_be_is_refused_in_one_line(make: Any, words: str) -> None:
    with pytest.raises(ModelError, match=words) as refused:
        make()
    assert "\n" not in str(refused.value)


def rotor_about(joint: list[float]) -> mujoco.MjSpec:
    """A driven rotor of 0.06 kg m^2 with its mass at (0, 0, 0.2), hinged about y at a point."""
    x, y, z = joint
    return mujoco.MjSpec.from_string(f"""<mujoco><worldbody><body name="rotor">
      <inertial mass="1" pos="0 0 0.2" diaginertia="0.05 0.06 0.07"/>
      <joint name="shaft" pos="{x} {y} {z}" axis="0 1 0"/></body></worldbody>
      <actuator><motor name="current" joint="shaft"/></actuator></mujoco>""")


PART_OF_ROTOR = Transmission("shaft", inertia=0.01, stiffness=1e3, added=False)


def test_an_inertia_is_taken_off_an_armature_that_is_large_enough() -> None:
    spec = rotor_about([0.0, 0.3, 0.2])
    spec.joint("shaft").armature = 0.03
    PART_OF_ROTOR.write(spec, spec.compile())
    assert spec.joint("shaft").armature == pytest.approx(0.02)
    assert spec.body("rotor").inertia[1] == pytest.approx(0.06)


def test_an_inertia_of_a_slide_is_taken_off_its_body_s_mass() -> None:
    belt = Transmission("slider", inertia=0.4, stiffness=1e4, added=False)
    nominal = MujocoPlant.load("cart_pendulum")
    carts = [plant.model.body("cart").mass[0] for plant in (nominal, nominal.changed(belt))]
    assert carts[1] == pytest.approx(carts[0] - 0.4)


def test_an_inertia_is_that_about_the_joint_s_axis_however_the_principal_axes_lie() -> None:
    """They are cyclically swapped: the first one, of 0.05 kg m^2, is the joint's."""
    spec = rotor_about([0.0, 0.3, 0.2])
    spec.body("rotor").iquat = [0.5, 0.5, 0.5, 0.5]
    PART_OF_ROTOR.write(spec, spec.compile())
    assert spec.body("rotor").inertia == pytest.approx([0.04, 0.048, 0.056])


def test_an_inertia_is_taken_off_a_rotor_whose_mass_lies_on_its_axis() -> None:
    """The axis is the joint's, wherever the body's frame is."""
    spec = rotor_about([0.0, 0.3, 0.2])
    PART_OF_ROTOR.write(spec, spec.compile())
    assert spec.body("rotor").inertia[1] == pytest.approx(0.05)
    beside = rotor_about([0.0, 0.0, 0.0])
    with pytest.raises(ModelError, match="is no part of"):
        PART_OF_ROTOR.write(beside, beside.compile())


@pytest.mark.parametrize(
    "part",
    [
        Transmission("shaft", 0.05, backlash=0.1),
        Stop("shaft", -1.0, 0.5, duration=0.01),
        Wall("rotor", 0.02, point=(0, 0, 0), duration=0.01),
    ],
)
def test_no_integrator_makes_the_damping_of_a_constraint_implicit(part: MachinePart) -> None:
    """The timestep that the message tells is short enough."""
    with pytest.raises(ModelError, match=r"0\.001 s makes unstable: take at most (.*) s,") as info:
        model(part, integrator="implicitfast")
    longest = float(str(info.value).split("at most ")[1].split()[0])
    assert model(part, integrator="implicitfast", h=longest)


def test_explicit_euler_may_have_bristles() -> None:
    assert model(BRISTLES, integrator="Euler")


@pytest.mark.parametrize("starts", [0.0, [-2.1, -1.5]])
def test_a_start_beyond_a_stop_is_refused(starts: Any) -> None:
    """MuJoCo would throw the rotor back by a force without bound: no run tells of that plant."""
    plant = MujocoPlant.load("servo", edits=(Stop("shaft", -2.0, -1.0),))
    law = chapter_controller("lqr", plant.analytic())
    x0 = np.stack([starts, np.zeros_like(starts)], axis=-1)
    with pytest.raises(ArgumentError, match="beyond its stops at -2 and -1 rad"):
        simulate(plant, law, x0, duration=0.01)


DRY = LuGre("shaft", 0.05, stiffness=1e3)
STRIBECK = LuGre("shaft", 0.05, 0.08, stiffness=1e3, stribeck=0.2)


@pytest.mark.parametrize(
    ("part", "speed", "changes", "refused"),
    [
        (DRY, 0.139, {}, ""),
        (DRY, -0.14, {}, r"0\.00099 s, a stiffness .* 9\.9e\+02, or integrator"),
        (DRY, 0.15, {"timestep": 0.9e-3}, ""),
        (DRY, -0.15, {"integrator": "Euler"}, ""),
        # g = 0.05 + 0.03 exp(-(v/0.2)^2) is 0.0640 and 0.0633.
        (STRIBECK, 0.175, {}, ""),
        (STRIBECK, 0.18, {}, r"where its friction is 0\.0633"),
    ],
)
def test_bristles_are_refused_at_a_speed_that_makes_them_unstable(
    part: LuGre, speed: float, changes: dict[str, Any], refused: str
) -> None:
    """RK4 carries z' = -s0 |v| z/g up to h s0 |v|/g = 2.785: 0.139 rad/s without Stribeck."""
    plant = MujocoPlant.load("servo", edits=(part,), **{"timestep": 1e-3, **changes})
    start = np.array([0.0, speed])
    if not refused:
        plant.require_start(start)
        return
    with pytest.raises(ArgumentError, match=refused):
        plant.require_start(start)


@pytest.mark.parametrize(("inductance", "stable"), [(0.361e-3, True), (0.357e-3, False)])
def test_a_winding_needs_a_timestep_within_the_stability_of_runge_and_kutta(
    inductance: float, stable: bool
) -> None:
    """Its lag is L/R, and RK4 is stable up to h R/L = 2.785."""
    winding = Motor("current", constant=0.05, resistance=1.0, inductance=inductance)
    if stable:
        assert model(winding, integrator="RK4")
        return
    with pytest.raises(ModelError, match=r"0\.001 s makes unstable: take at most"):
        model(winding, integrator="RK4")


# Batches


def built_servo(stiffness: float) -> MujocoPlant:
    parts = (
        Transmission("shaft", inertia=0.01, stiffness=stiffness, damping=1.0, backlash=1e-3),
        LuGre("shaft", 0.05),
    )
    return MujocoPlant.load("servo", edits=parts)


PLANTS = [built_servo(300.0), built_servo(500.0)]
STARTS = [[0.0, 0.0], [0.1, -0.1]]


def physics_of_run(plants: Any, starts: Any, **settings: Any) -> Any:
    """States of MuJoCo in a run by the law of the servo."""
    law = find_experiment("servo", "nominal").law("physics", "grosmc")
    run = simulate(plants, law, starts, duration=0.05, control_period=1e-3, **settings)
    assert run.physics is not None
    return run.physics


@pytest.fixture(scope="module")
def batch() -> Any:
    return physics_of_run(PLANTS, STARTS)


@pytest.mark.parametrize("index", [0, 1])
def test_a_run_of_a_batch_of_machines_is_the_single_run(batch: Any, index: int) -> None:
    alone = physics_of_run(PLANTS[index], STARTS[index])
    np.testing.assert_array_equal(alone, batch[index])


def test_each_motor_of_a_batch_begins_with_its_joint(batch: Any) -> None:
    for physics, (angle, speed) in zip(batch, STARTS, strict=True):
        assert physics[0].tolist() == [0.0, angle, angle, speed, speed, 0.0]


def test_a_batch_that_is_not_recorded_has_its_last_states(batch: Any) -> None:
    unrecorded = physics_of_run(PLANTS, STARTS, record=False)
    np.testing.assert_array_equal(unrecorded[:, -1], batch[:, -1])

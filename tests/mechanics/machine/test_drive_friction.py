"""Friction of drives against an integration of its own equations, stick and slip apart.

Parameters of the servos MX-106 and XL330: github.com/Rhoban/bam, bam/params (Apache-2.0), whose
names stand beside those here. The test bench is theirs, too: a pendulum under a position servo.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import mujoco
import numpy as np
import pytest
from machined import J, servo

import grosmc_mj as gm
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.mechanics.machine import DriveFriction, LuGre, Stop, Transmission
from grosmc_mj.mechanics.machine.drive_friction import friction_limit
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.edits import AddedMass, BodyEdit, InputEdit, JointEdit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.steppers import Steppers

G = 9.8
# Timesteps of the integration and of the law [s].
FINE = 2.5e-5
PERIOD = 1e-3

MX106 = {
    "M1": DriveFriction("shaft", coulomb=0.15, viscous=0.05),
    "M3": DriveFriction("shaft", coulomb=0.1, viscous=0.05, load_motor=0.1, load_external=0.1),
    # As published.
    "M6": DriveFriction(
        "shaft",
        coulomb=1.0232526438525893e-05,  # friction_base
        viscous=0.05071566473605552,  # friction_viscous
        load_motor=0.19800553725822115,  # load_friction_motor
        load_external=0.022215529897348624,  # load_friction_external
        stribeck_force=0.12195409579603411,  # friction_stribeck
        stribeck_motor=0.19859970173941574,  # load_friction_motor_stribeck
        stribeck_external=0.08710328264676681,  # load_friction_external_stribeck
        quadratic_motor=0.009999930103371748,  # load_friction_motor_quad
        quadratic_external=7.326919843140997e-05,  # load_friction_external_quad
        stribeck_speed=1.7463251741328727,  # dtheta_stribeck
        stribeck_exponent=1.142827788004191,  # alpha
    ),
}
XL330_M6 = DriveFriction(
    "shaft",
    coulomb=0.0023258418670152347,
    viscous=0.0185448141303962,
    load_motor=0.23063000784446322,
    load_external=0.26077932692372613,
    stribeck_force=0.0001856264715700908,
    stribeck_motor=1.9157733081388423e-06,
    stribeck_external=0.15158776983752117,
    quadratic_motor=0.005595958708218643,
    quadratic_external=0.0037747149629857673,
    stribeck_speed=0.11532863880939243,
    stribeck_exponent=1.000022697315946,
)


@dataclass(frozen=True)
class Bench:
    """A pendulum on a servo that follows a sine about hanging down by u = k (r - q) - d v.

    Without k and d a torque alone drives it, and nothing corrects its angle.

    Attributes:
        armature: Inertia without the load [kg m^2].
        mass: Load [kg].
        arm: Distance of the load from the shaft [m].
        k: Of the position [N m/rad].
        d: Of the speed [N m s/rad].
        torque: Amplitude of a torque besides [N m].
    """

    armature: float
    mass: float
    arm: float
    k: float
    d: float
    torque: float = 0.0

    def demand(self, t: float, q: float, v: float) -> float:
        """Torque of the motor [N m]."""
        course = math.sin(4.0 * t) * math.cos(1.3 * t)
        reference = -math.pi / 2 + 0.8 * course
        return self.k * (reference - q) - self.d * v + self.torque * course

    def edits(self, part: DriveFriction) -> tuple[Edit, ...]:
        """The bench as edits of the servo."""
        return (
            BodyEdit("rotor", mass_scale=self.armature / J),
            AddedMass("rotor", self.mass, (self.arm, 0.0, 0.0)),
            InputEdit("current", 1.0),
            part,
        )


MX106_BENCH = Bench(armature=0.026, mass=1.0, arm=0.15, k=8.0, d=0.2)
XL330_BENCH = Bench(armature=0.00257, mass=0.1, arm=0.1, k=0.6, d=0.01)


def limit(part: DriveFriction, v: float, motor: float, load: float) -> float:
    """Dry friction that the joint has at most, as BAM's paper and its source have it."""
    always = part.coulomb + abs(load * part.load_external - motor * part.load_motor)
    if not part.stribeck_speed:
        return always
    at_rest = part.stribeck_force
    at_rest += abs(load * part.stribeck_external - motor * part.stribeck_motor)
    if np.sign(load) != np.sign(motor):
        at_rest += (abs(load) < abs(motor)) * part.quadratic_external * load**2
        at_rest += (abs(load) > abs(motor)) * part.quadratic_motor * motor**2
    return always + at_rest * math.exp(-(abs(v / part.stribeck_speed) ** part.stribeck_exponent))


EVERYTHING = DriveFriction(
    "shaft",
    coulomb=0.1,
    viscous=0.2,
    load_motor=0.3,
    load_external=0.17,
    stribeck_force=0.4,
    stribeck_motor=0.23,
    stribeck_external=0.6,
    stribeck_speed=0.5,
    stribeck_exponent=1.3,
    quadratic_motor=0.7,
    quadratic_external=0.9,
)


@pytest.mark.parametrize("part", [EVERYTHING, MX106["M3"]])
@pytest.mark.parametrize("load", [-1.0, 0.0, 1.5])
@pytest.mark.parametrize("motor", [-2.0, 0.0, 0.7])
@pytest.mark.parametrize("v", [-0.6, 0.0, 0.3])
def test_the_limit_is_that_of_the_paper(
    part: DriveFriction, load: float, motor: float, v: float
) -> None:
    assert friction_limit(v, motor, load, part) == pytest.approx(limit(part, v, motor, load))


def integrated(bench: Bench, part: DriveFriction, duration: float) -> Array:
    """Angles at each period, by Heun's method while it slips; a reversal ends in a stick."""
    inertia = bench.armature + bench.mass * bench.arm**2
    q = -math.pi / 2
    v = 0.0
    u = 0.0
    direction = 0.0
    angles = []

    def acceleration(q: float, v: float) -> float:
        load = -bench.mass * G * bench.arm * math.cos(q)
        dry = direction * limit(part, v, u, load)
        return (u + load - part.viscous * v - dry) / inertia

    steps_in_period = round(PERIOD / FINE)
    for i in range(round(duration / FINE)):
        if i % steps_in_period == 0:
            angles.append(q)
            u = bench.demand(i * FINE, q, v)

        if direction == 0.0:
            load = -bench.mass * G * bench.arm * math.cos(q)
            if abs(u + load) <= limit(part, 0.0, u, load):
                continue
            direction = math.copysign(1.0, u + load)

        before = acceleration(q, v)
        after = acceleration(q + FINE * v, v + FINE * before)
        change = FINE * (before + after) / 2
        if (v + change) * direction < 0:
            # It stops within the step, and sticks or reverses at the next one.
            q += FINE * v / 2 * (-v / change)
            v = 0.0
            direction = 0.0
        else:
            q += FINE * (v + change / 2)
            v += change
    return np.array(angles)


@dataclass(frozen=True)
class Numbers:
    """Numbers of ``Bench.demand``, which compiled code can read."""

    k: float
    d: float
    torque: float


def law(t: float, x: Array, memory: Any, p: Numbers, u: Array) -> None:
    course = math.sin(4.0 * t) * math.cos(1.3 * t)
    reference = -math.pi / 2 + 0.8 * course
    u[0] = p.k * (reference - x[0]) - p.d * x[1] + p.torque * course


def simulated(
    bench: Bench,
    part: DriveFriction,
    duration: float,
    timestep: float = 2.5e-4,
    integrator: str = "RK4",
    engine: Any = "native",
    starts: Any = (-math.pi / 2, 0.0),
) -> Any:
    """Run of the bench in MuJoCo."""
    plant = servo(*bench.edits(part), timestep=timestep, integrator=integrator)
    controller = gm.Controller("servo", law, Numbers(bench.k, bench.d, bench.torque))
    return gm.simulate(
        plant,
        controller,
        starts,
        duration=duration,
        control_period=PERIOD,
        engine=engine,
    )


@cache
def expected_angles(bench: Bench, part: DriveFriction) -> Array:
    """Angles of the integration in 2 s [rad]."""
    angles = integrated(bench, part, 2.0)
    assert np.ptp(angles) > 1.0
    return angles


def error(bench: Bench, part: DriveFriction, timestep: float, integrator: str = "RK4") -> float:
    """Largest error of the angle in 2 s [rad]."""
    run = simulated(bench, part, 2.0, timestep=timestep, integrator=integrator)
    stride = round(PERIOD / timestep)
    return float(np.abs(run.state[:-1:stride, 0] - expected_angles(bench, part)).max())


# Measured on M1 to M6: at most 0.67, 0.15, 1.6 and 0.40 mrad of 1.5 rad of motion.
COARSE = ("RK4", 1e-3, 1e-3)
BOUNDS = [("RK4", 2.5e-4, 0.25e-3), ("implicitfast", 1e-3, 2.4e-3), ("implicitfast", 2.5e-4, 6e-4)]


@pytest.mark.parametrize(
    ("name", "integrator", "timestep", "bound"),
    [*[(name, *COARSE) for name in MX106], *[("M6", *bounds) for bounds in BOUNDS]],
)
def test_a_servo_moves_as_its_equations(
    name: str, integrator: str, timestep: float, bound: float
) -> None:
    """The limits are those of the beginning of a step, so the error is of its order."""
    assert error(MX106_BENCH, MX106[name], timestep, integrator) < bound


def test_without_a_position_loop_errors_add_up_in_proportion_to_the_timestep() -> None:
    """At motions of 2.4 to 3.4 rad; of the position servo above at most 0.67 mrad."""
    driven = replace(MX106_BENCH, k=0.0, d=0.0, torque=1.8)
    coarse = error(driven, MX106["M6"], 1e-3)
    assert coarse == pytest.approx(4.3e-3, rel=0.1)
    assert error(driven, MX106["M6"], 2.5e-4) < 0.35 * coarse


@pytest.mark.parametrize("mass", [0.1, 0.15])
def test_a_published_servo_moves_as_its_equations_under_any_load(mass: float) -> None:
    """Measured: 0.14 mrad, and 0.06 mrad at 1.5 times the load."""
    assert error(replace(XL330_BENCH, mass=mass), XL330_M6, 2.5e-4) < 0.25e-3


def test_both_engines_have_the_same_bits() -> None:
    native, python = (
        simulated(MX106_BENCH, MX106["M6"], 0.2, engine=engine) for engine in ("native", "python")
    )
    np.testing.assert_array_equal(native.state, python.state)


@pytest.mark.parametrize("index", [0, 1])
def test_a_run_of_a_batch_is_the_single_run(index: int) -> None:
    """A run begins with the limits of rest, whatever ran in the same memory before."""
    starts = np.array([[-2.0, 3.0], [-1.0, -2.0]])
    run = partial(simulated, MX106_BENCH, MX106["M6"], 0.2)
    np.testing.assert_array_equal(
        run(starts=starts).state[index],
        run(starts=starts[index]).state,
    )


def advanced(
    plant: MujocoPlant,
    duration: float,
    u: float,
    start: Any = (0.0, 0.0),
) -> Any:
    """Stepper of a plant after a time under an input."""
    stepper = Steppers(0.0).of(plant)
    stepper.restart(np.array(start))
    stepper.u[:] = u
    for _ in range(round(duration / plant.step_length)):
        stepper.advance(stepper.model, stepper.data)
    assert not stepper.warnings[::2].any()
    return stepper


# At rest

TORQUE = InputEdit("current", 1.0)


def torque_of(part: DriveFriction, share: float) -> float:
    """Torque of the motor at a share of its friction at rest, without a load."""
    motor = part.load_motor + part.stribeck_motor
    force = part.coulomb + part.stribeck_force
    return share * force / (1 - share * motor)


@pytest.mark.parametrize(
    ("name", "integrator"), [("M1", "RK4"), ("M3", "implicitfast"), ("M6", "RK4")]
)
def test_a_joint_under_half_of_its_friction_holds(name: str, integrator: str) -> None:
    """The soft constraint creeps by 1e-4 h w u a second, as the package's dry friction does."""
    part = MX106[name]
    u = torque_of(part, 0.5)
    assert limit(part, 0.0, u, 0.0) == pytest.approx(2 * u)
    stepper = advanced(servo(TORQUE, part, timestep=1e-3, integrator=integrator), 2.0, u)
    # In the first 2 timesteps it moves towards that speed.
    creep = 2.0 * 1e-4 * 1e-3 * u / J
    assert abs(stepper.q[0]) < 1.1 * creep
    assert abs(stepper.q[0]) < 5e-6


def test_a_joint_holds_a_load_by_the_friction_of_that_load() -> None:
    """Without motor, m g l <= F_c + (k_e + s_e) m g l, and not at 1.5 times the load."""
    part = DriveFriction(
        "shaft",
        coulomb=0.5,
        load_external=0.2,
        stribeck_external=0.3,
        stribeck_speed=0.1,
    )
    held = servo(AddedMass("rotor", 0.8 / G, (1.0, 0.0, 0.0)), part, timestep=1e-3)
    fallen = servo(AddedMass("rotor", 1.2 / G, (1.0, 0.0, 0.0)), part, timestep=1e-3)
    assert abs(advanced(held, 2.0, 0.0).q[0]) < 5e-6
    assert advanced(fallen, 1.0, 0.0).q[0] < -0.1


@pytest.mark.parametrize(("share", "moves"), [(0.99, False), (1.01, True)])
def test_a_joint_breaks_away_at_its_friction_at_rest(share: float, moves: bool) -> None:
    part = MX106["M6"]
    stepper = advanced(servo(TORQUE, part, timestep=1e-3), 2.0, torque_of(part, share))
    assert (stepper.q[0] > 0.01) == moves


def test_self_locking_gears_hold_any_load() -> None:
    """Friction is more than the load that it comes from: k_e > 1."""
    nominal = MujocoPlant.load("two_link_arm")
    parts = [DriveFriction(j, coulomb=1e-3, load_external=1.2) for j in nominal.system.joints]
    stepper = advanced(nominal.changed(*parts), 1.0, 0.0, start=np.zeros(4))
    loads = np.abs(stepper.data.qfrc_bias[:2])
    assert np.all(loads > 0.05)
    creep = 1e-4 * 1e-3 * stepper.model.dof_invweight0[:2] * loads
    assert np.all(np.abs(stepper.v) < 1.1 * creep)


# In motion


@pytest.mark.parametrize("u", [1.0, -3.0])
def test_a_steady_speed_is_that_at_which_friction_takes_the_torque(u: float) -> None:
    """U = b v + limit(v, u, 0) at the speed of a motor without load."""
    part = MX106["M6"]
    # It approaches that speed within 1.3 s, its inertia over its viscous friction.
    near = math.copysign(10.0, u)
    v = advanced(servo(TORQUE, part, timestep=5e-3), 30.0, u, start=(0.0, near)).v[0]
    assert part.viscous * abs(v) + limit(part, v, u, 0.0) == pytest.approx(abs(u), rel=1e-9)


def test_a_stop_is_a_load() -> None:
    """The limit is that of the motor and the stop, without the friction in the same solver."""
    part = MX106["M6"]
    plant = servo(TORQUE, Stop("shaft", -1.0, 0.5), part, timestep=2e-4)
    stepper = advanced(plant, 2.0, 2.0)
    data = stepper.data
    mujoco.mj_forward(stepper.model, data)
    of_stop = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
    load = -float(data.efc_force[: data.nefc][of_stop].sum())
    assert load < -1.0

    stepper.advance(stepper.model, data)
    expected = limit(part, float(data.qvel[0]), 2.0, load)
    assert stepper.model.dof_frictionloss[0] == pytest.approx(expected, rel=1e-6)


def test_friction_is_that_of_the_motor_behind_a_transmission() -> None:
    gear = Transmission("shaft", inertia=0.02, stiffness=50.0, damping=0.1)
    part = DriveFriction("shaft", coulomb=0.1, viscous=0.3, load_motor=0.2, load_external=0.1)
    stepper = advanced(servo(TORQUE, gear, part, timestep=5e-4), 3.0, 1.0)

    model = stepper.model
    assert model.dof_frictionloss[0] == 0.0
    assert model.dof_damping.tolist() == [0.0, 0.3]
    # In steady motion the gear is not loaded, and friction takes the motor's torque.
    assert model.dof_frictionloss[1] == pytest.approx(0.1 + 0.2, rel=1e-3)
    assert stepper.data.qvel[:2] == pytest.approx([0.7 / 0.3] * 2, rel=1e-2)


def test_viscous_friction_of_a_drive_adds_to_the_joint_s_damping() -> None:
    part = DriveFriction("shaft", coulomb=0.1, viscous=0.3)
    plant = MujocoPlant.load("servo", edits=(JointEdit("shaft", damping=0.25), part))
    assert plant.undrawn_model.dof_damping.tolist() == [pytest.approx(0.55)]


def test_a_run_begins_with_the_friction_of_a_joint_at_rest() -> None:
    """F_c + F_s = 0.1 + 0.4; after a run under load the limit of the last step stands there."""
    part = DriveFriction(
        "shaft", coulomb=0.1, load_motor=0.2, stribeck_force=0.4, stribeck_speed=0.5
    )
    stepper = advanced(servo(TORQUE, part, timestep=1e-3), 0.05, 3.0)
    limit_of_run = stepper.model.dof_frictionloss[0]
    stepper.restart(np.zeros(2))
    assert stepper.model.dof_frictionloss[0] == pytest.approx(0.5)
    assert limit_of_run > 0.6


def test_a_plant_has_its_own_limits() -> None:
    plant = servo(TORQUE, MX106["M6"])
    before = plant.undrawn_model.dof_frictionloss.copy()
    advanced(plant, 0.01, 3.0)
    np.testing.assert_array_equal(plant.undrawn_model.dof_frictionloss, before)


# Refusals.

COULOMB = DriveFriction("shaft", 0.1)


def write_into_a_model_that_softens_friction() -> None:
    spec = mujoco.MjSpec.from_string("""<mujoco><option noslip_iterations="5"/>
      <worldbody><body><joint name="shaft"/><geom size="0.1"/></body></worldbody></mujoco>""")
    COULOMB.write(spec, spec.compile())


def built(*edits: Edit) -> Any:
    return lambda: MujocoPlant.load("servo", edits=edits, timestep=1e-4).model


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (built(LuGre("shaft", 0.1), COULOMB), r"has a \[\[lugre\]\] as well: take one of them"),
        (
            built(JointEdit("shaft", friction=0.2), COULOMB),
            "dry friction of 0.2 as well: set that to 0",
        ),
        (
            built(Transmission("shaft", 0.01, 1e3, friction=0.3), COULOMB),
            "dry friction of 0.3 as well",
        ),
        (built(COULOMB, DriveFriction("shaft", 0.2)), "two of the kind 'drive friction'"),
        (write_into_a_model_that_softens_friction, "noslip_iterations: set them to 0"),
        (partial(DriveFriction, "shaft", 0.1, stribeck_force=0.1), "need a stribeck_speed"),
        # Of a state alone.
        (lambda: servo(COULOMB).derivative([0.0, 1.0], 1.0), "computed for a timestep"),
    ],
)
def test_friction_that_cannot_be_is_refused_in_one_line(make: Any, words: str) -> None:
    with pytest.raises(ModelError, match=words) as refused:
        make()
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("term", ["stribeck_force", "quadratic_motor", "quadratic_external"])
def test_each_term_of_a_stribeck_curve_needs_its_speed(term: str) -> None:
    with pytest.raises(ModelError, match="need a stribeck_speed"):
        DriveFriction("shaft", coulomb=1.5, **{term: 0.1})


def test_the_words_of_a_drive_s_friction_have_each_share() -> None:
    shares = {"load_motor": 0.02, "stribeck_motor": 0.01, "load_external": 0.05}
    part = DriveFriction("shaft", coulomb=1.5, stribeck_speed=0.1, **shares)
    assert str(part) == (
        "shaft: drive friction of 1.5 at rest and 0.03 of the motor's torque and 0.05 of the load's"
    )

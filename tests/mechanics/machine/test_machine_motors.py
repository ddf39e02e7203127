"""DC motors: Ohm's and Kirchhoff's laws, current loops on a supply, heat and reversed motors."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from machined import GEAR, HEAVY, J, servo, stepped
from scipy.integrate import solve_ivp

from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.machine import Motor, Transmission
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.edits import BodyEdit, InputEdit, JointEdit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.theory.plants import SERVO

# Constant [N m/A], resistance [ohm], inductance [H], gear, voltage [V] and bandwidth [rad/s].
K = 7.68e-3
R = 2.6
L = 2e-3
N = 10.0
V = 6.0
BANDWIDTH = 1e4
STEP = 1e-5
# Share of its way that a lag has gone after its time constant.
REACHED = 1 - math.exp(-1)


ON_SUPPLY = {"bandwidth": BANDWIDTH, "voltage": V}


def motor(**numbers: Any) -> Motor:
    return Motor("current", K, R, **{"ratio": N, **numbers})


def loop(**numbers: Any) -> Motor:
    """With a current loop on a supply."""
    return motor(**{**ON_SUPPLY, **numbers})


def fine(*edits: Edit, timestep: float = STEP) -> MujocoPlant:
    return servo(*edits, timestep=timestep, integrator="implicitfast")


def input_for(amperes: float) -> float:
    """The input that demands a current of the winding."""
    return amperes * N * K / GEAR


def angle(data: mujoco.MjData) -> float:
    return data.qpos[0]


def speed(data: mujoco.MjData) -> float:
    return data.qvel[0]


def torque(data: mujoco.MjData) -> float:
    return data.qfrc_actuator[0]


def activation(data: mujoco.MjData) -> float:
    return data.act[-1]


def currents(plant: MujocoPlant, amperes: float, duration: float, at_speed: float = 0.0) -> Array:
    """Current of the winding at a held speed, for a demand."""
    winding = plant.hidden_states[-1]
    u = input_for(amperes)
    activations = stepped(plant, duration, activation, u, at_speed, held=True)
    return winding.scale * activations


def time_constant(rising: Array, final: float) -> float:
    """Time until a signal has 63 % of its final value [s]."""
    return STEP * float(np.argmax(rising >= REACHED * final))


# Limits.

EFFICIENCY = 0.7


@pytest.mark.parametrize(
    ("numbers", "demand", "speed", "duration", "expected"),
    [
        # Numbers of a motor, the demand of its current [A], its speed [rad/s], the time [s] after
        # which the current is steady, and that current [A] by Ohm's law or the motor's limit.
        (ON_SUPPLY, 100.0, 60.0, 4e-3, (V - K * N * 60) / R),
        (ON_SUPPLY, -100.0, 30.0, 4e-3, -(V + K * N * 30) / R),
        # A current that the supply has enough voltage for is given whatever the speed.
        (ON_SUPPLY, 0.25, 60.0, 4e-3, 0.25),
        ({"inductance": L, "voltage": V}, 100.0, 0.0, 2e-2, V / R),
        ({**ON_SUPPLY, "current": 1.5}, 100.0, 0.0, 4e-3, 1.5),
        ({"current": 2.0}, 100.0, 0.0, 4e-3, 2.0),
    ],
)
def test_a_motor_gives_the_torque_of_the_current_that_is_possible(
    numbers: dict[str, Any], demand: float, speed: float, duration: float, expected: float
) -> None:
    """The share ``efficiency`` arrives at the joint, and the winding is asked for more by it."""
    plant = fine(HEAVY, motor(efficiency=EFFICIENCY, **numbers))
    u = input_for(demand * EFFICIENCY)
    last = stepped(plant, duration, lambda d: (torque(d), *d.act), u, speed, held=True)[-1]
    assert last[0] == pytest.approx(EFFICIENCY * N * K * expected, rel=1e-6)
    windings = [state for state in plant.hidden_states if state.kind == "winding"]
    if windings and "current" not in numbers:
        assert windings[-1].scale * last[-1] == pytest.approx(expected, rel=1e-6)


# Lags

TIME = STEP * np.arange(1, 201)


def test_a_loop_at_the_pole_of_its_winding_follows_kirchhoffs_law() -> None:
    """At the pole R/L no bound but the supply's acts: V = L i' + R i + K w is exact."""
    amperes = currents(fine(HEAVY, loop(inductance=L, bandwidth=R / L)), 100.0, 2e-3)
    np.testing.assert_allclose(amperes, V / R * (1 - np.exp(-R / L * TIME)), rtol=1e-6)


def kirchhoff(demand: float) -> Array:
    """Current under the supply's voltage at rest, (200,)."""

    def rise(_t: float, i: Array) -> Array:
        return np.clip(BANDWIDTH * (demand - i), (-V - R * i) / L, (V - R * i) / L)

    solution = solve_ivp(rise, (0, TIME[-1]), [0.0], t_eval=TIME, rtol=1e-10, atol=1e-12)
    return solution.y[0]


def test_a_quick_loop_is_ahead_of_kirchhoffs_law_by_its_voltage_drop() -> None:
    """By (K w + R i)/V of the rise: the bound on the rate is that of a winding at rest."""
    demand = 1.0
    amperes = currents(fine(HEAVY, loop(inductance=L)), demand, 2e-3)
    exact = kirchhoff(demand)
    ahead = R * demand / V * np.minimum(V / L * TIME, demand)
    assert np.all(amperes >= exact - 1e-6)
    assert np.all(amperes - exact <= ahead + 1e-6)
    assert amperes[-1] == pytest.approx(demand, rel=1e-3)


def test_a_supply_changes_a_current_by_v_over_l_at_most() -> None:
    amperes = currents(fine(HEAVY, loop(inductance=L)), 1.0, 2e-3)
    rates = np.diff(amperes, prepend=0.0) / STEP
    assert np.abs(rates).max() <= V / L * (1 + 1e-9)


def test_a_winding_is_a_hidden_state_with_its_lag() -> None:
    plant = servo(HEAVY, motor(inductance=L), timestep=STEP)
    assert [(state.name, state.unit) for state in plant.hidden_states] == [("current winding", "A")]
    tau = time_constant(currents(plant, V / R, 2e-3), V / R)
    assert tau == pytest.approx(L / R, rel=0.01)


def test_an_input_has_the_narrower_of_the_model_s_limits_and_the_amplifier_s() -> None:
    """A voltage V gives N K V/R at rest; behind the efficiency it asks for more of the winding."""
    spec = MujocoPlant.load("servo").spec.copy()
    spec.actuators[0].ctrlrange = (-0.1, 3.0)
    spec.actuators[0].ctrllimited = True
    (low,), (high,) = MujocoPlant(SERVO, spec, (motor(voltage=V, efficiency=0.7),)).input_limits
    assert (low, high) == pytest.approx((-0.1, 0.7 * N * K * V / R / GEAR))


def test_a_motor_runs_at_its_no_load_speed() -> None:
    plant = servo(BodyEdit("rotor", mass_scale=0.01), motor(), timestep=1e-3)
    speeds = stepped(plant, 5.0, speed, input_for(V / R))
    assert speeds[-1] == pytest.approx(V / (N * K), rel=1e-3)


@pytest.mark.parametrize("voltage", [math.inf, 40.0])
def test_a_current_loop_follows_with_its_bandwidth(voltage: float) -> None:
    """On a supply, too, if the winding has no inductance."""
    torques = stepped(fine(motor(bandwidth=5e3, voltage=voltage)), 2e-3, torque, 1.0)
    assert time_constant(torques, GEAR) == pytest.approx(1 / 5e3, rel=0.06)
    assert torques[-1] == pytest.approx(GEAR, rel=1e-4)


def test_a_current_loop_makes_up_for_the_back_emf() -> None:
    speeds = stepped(fine(motor(bandwidth=5e3)), 0.1, speed, speed=3.0)
    assert speeds[-1] == pytest.approx(3.0, rel=1e-6)


# The gear


@pytest.mark.parametrize("voltage", [V, math.inf])
def test_cogging_is_seen_through_the_gear(voltage: float) -> None:
    model = fine(HEAVY, loop(voltage=voltage, cogging=2e-3, cogging_periods=4.0)).model
    data = mujoco.MjData(model)
    data.qpos[0] = 0.01
    mujoco.mj_forward(model, data)
    assert torque(data) == pytest.approx(N * 2e-3 * math.sin(4 * N * 0.01), rel=1e-9)


def test_the_inertia_of_a_rotor_is_seen_through_the_gear() -> None:
    """By its kinetic energy at the joint's speed the joint is slower by 1 + N^2 J_m/J."""
    model = servo(motor(ratio=-70.0, inertia=2e-5)).model
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.5 / GEAR
    mujoco.mj_forward(model, data)
    assert data.qacc[0] == pytest.approx(0.5 / (J + 70.0**2 * 2e-5), rel=1e-9)


def test_behind_a_transmission_its_inertia_is_that_of_the_rotor() -> None:
    gear = Transmission("shaft", inertia=0.05, stiffness=500.0)
    model = servo(gear, motor(ratio=-70.0, inertia=2e-5)).model
    M = np.zeros((model.nv, model.nv))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, M)
    assert np.diag(M) == pytest.approx([J, 0.05])


def slow_angles(*edits: Edit) -> Array:
    """Angles of the edited servo [rad] under a slow sine."""
    plant = MujocoPlant.load("servo", edits=edits)
    return stepped(plant, 0.5, angle, lambda t: math.sin(5 * t))


def test_a_motor_that_the_model_has_already_changes_nothing() -> None:
    """While it is cold and slow."""
    part = motor(efficiency=0.8, inertia=1e-5, added=False)
    drive = JointEdit("shaft", damping=0.02, armature=0.03)
    rigid = slow_angles(drive)
    driven = slow_angles(drive, part)
    assert driven == pytest.approx(rigid, rel=1e-9, abs=1e-12)
    assert part.emf_damping == pytest.approx(0.8 * (N * K) ** 2 / R)


# Heat

HEATED = {"thermal_resistance": 5.0, "heat_capacity": 0.02}


def test_a_voltage_heats_a_winding_to_its_thermal_resistance() -> None:
    """By R i^2; copper's resistance grows by 0.39 % a kelvin, and a voltage heats it less then."""
    plant = fine(HEAVY, motor(**HEATED), timestep=1e-3)
    (heat,) = plant.hidden_states
    activations = stepped(plant, 2.0, lambda d: d.act[0], input_for(V / R))
    kelvin = heat.scale * activations[-1]
    assert heat.unit == "K"
    assert kelvin == pytest.approx(5.0 * V**2 / (R * (1 + 0.0039 * kelvin)), rel=1e-3)


def test_a_current_loop_heats_a_winding_by_the_same_current() -> None:
    """Without a supply, however large the winding's resistance grows."""
    plant = fine(HEAVY, motor(bandwidth=500.0, **HEATED), timestep=1e-4)
    heat, winding = plant.hidden_states
    rows = stepped(plant, 0.2, lambda d: (d.act[0], d.act[-1]), input_for(1.5))
    kelvin = heat.scale * rows[-1, 0]
    amperes = winding.scale * rows[-1, 1]
    # The current is there within 2 ms of the 0.2 s.
    rise = 5.0 * R * 1.5**2 * (1 - math.exp(-0.2 / (5.0 * 0.02)))
    assert kelvin == pytest.approx(rise, rel=0.01)
    assert amperes == pytest.approx(1.5, rel=1e-6)


# Reversed motors


def angle_speed_torque_current(data: mujoco.MjData) -> tuple[float, ...]:
    return angle(data), speed(data), torque(data), activation(data)


def wave(plant: MujocoPlant, sign: float = 1.0) -> Array:
    """Angle, speed, torque and winding under an input that uses all of the supply."""
    rows = stepped(plant, 0.25, angle_speed_torque_current, lambda t: sign * 3 * math.sin(100 * t))
    return rows * [1, 1, 1, plant.hidden_states[0].scale]


REVERSIBLE = [motor(inductance=L, voltage=V), loop(inductance=L, bandwidth=500.0)]


@pytest.mark.parametrize("part", REVERSIBLE)
def test_a_motor_that_turns_against_its_joint_has_the_opposite_current(part: Motor) -> None:
    rows = wave(fine(part, timestep=1e-4))
    against = wave(fine(replace(part, ratio=-N), timestep=1e-4))
    assert np.abs(rows[:, 0]).max() > 0.01
    np.testing.assert_array_equal(against * [1, 1, 1, -1], rows)


@pytest.mark.parametrize("part", REVERSIBLE)
def test_a_motor_under_a_negative_gear_has_the_opposite_input(part: Motor) -> None:
    turned = wave(fine(InputEdit("current", gear=-GEAR), part, timestep=1e-4))
    opposite = wave(fine(part, timestep=1e-4), sign=-1.0)
    np.testing.assert_array_equal(turned, opposite)


def test_the_words_of_a_motor_have_its_voltage_and_its_current() -> None:
    motor = Motor("current", constant=0.05, resistance=2.0, voltage=24.0, current=5.0)
    assert str(motor) == "current: DC motor by voltage, within 24 V and 5 A"

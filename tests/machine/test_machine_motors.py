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

from grosmc_mj.arrays import Array
from grosmc_mj.machine import Motor
from grosmc_mj.physics.edit import Edit
from grosmc_mj.physics.edits import BodyEdit, InputEdit, JointEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant

K, R, L, N, V, BANDWIDTH, STEP = 7.68e-3, 2.6, 2e-3, 10.0, 6.0, 1e4, 1e-5


def motor(**numbers: Any) -> Motor:
    return Motor("current", K, R, **{"ratio": N, **numbers})


def loop(**numbers: Any) -> Motor:
    """With a current loop on a supply."""
    return motor(**{"bandwidth": BANDWIDTH, "voltage": V, **numbers})


def fine(*edits: Edit, timestep: float = STEP) -> MujocoPlant:
    return servo(*edits, timestep=timestep, integrator="implicitfast")


def asked(amperes: float) -> float:
    """The input that asks for a current of the winding."""
    return amperes * N * K / GEAR


def torque(data: mujoco.MjData) -> float:
    return data.qfrc_actuator[0]


def currents(plant: MujocoPlant, amperes: float, duration: float, speed: float = 0.0) -> Array:
    """Of the winding at a held speed, where a current is asked for."""
    winding = plant.hidden_states[-1]
    act = stepped(plant, duration, lambda d: d.act[-1], asked(amperes), speed, held=True)
    return winding.scale * act


@pytest.mark.parametrize(
    ("numbers", "demand", "speed", "expected"),
    [
        ({"bandwidth": BANDWIDTH, "voltage": V}, 100.0, 60.0, (V - K * N * 60) / R),
        ({"bandwidth": BANDWIDTH, "voltage": V}, 100.0, -30.0, (V + K * N * 30) / R),
        # What the supply has enough voltage for is given whatever the speed.
        ({"bandwidth": BANDWIDTH, "voltage": V}, 0.25, 60.0, 0.25),
        ({"bandwidth": BANDWIDTH, "voltage": V, "current": 1.5}, 100.0, 0.0, 1.5),
        ({"inductance": L, "voltage": V}, 100.0, 0.0, V / R),
        ({"inductance": L}, V / R, 0.0, V / R),
        ({"current": 2.0}, 100.0, 0.0, 2.0),
    ],
)
def test_a_motor_gives_the_current_that_ohms_law_and_its_limits_leave(
    numbers: dict[str, Any], demand: float, speed: float, expected: float
) -> None:
    """The share ``efficiency`` of its torque arrives at the joint, and is asked for more."""
    efficiency = 0.7
    plant = fine(HEAVY, motor(efficiency=efficiency, **numbers))
    duration = 2e-2 if "inductance" in numbers else 4e-3
    arrived = stepped(plant, duration, torque, asked(demand * efficiency), speed, held=True)[-1]
    assert arrived == pytest.approx(efficiency * N * K * expected, rel=1e-6)
    if plant.hidden_states and "current" not in numbers:
        amperes = currents(plant, demand * efficiency, duration, speed)[-1]
        assert amperes == pytest.approx(expected, rel=1e-6)


def test_a_current_loop_is_as_quick_as_its_supply_and_winding_allow() -> None:
    """At the pole R/L no bound but the supply's acts: V = L i' + R i + K w is exact.

    A quicker loop is ahead of Kirchhoff's law by (K w + R i)/V of the rise: the bound on the rate
    is that of a winding at rest.
    """
    time, demand = STEP * np.arange(1, 201), 1.0
    slow = currents(fine(HEAVY, loop(inductance=L, bandwidth=R / L)), 100.0, 2e-3)
    np.testing.assert_allclose(slow, V / R * (1 - np.exp(-R / L * time)), rtol=1e-6)

    def rise(_t: float, i: Array) -> Array:
        return np.clip(BANDWIDTH * (demand - i), (-V - R * i) / L, (V - R * i) / L)

    true = solve_ivp(rise, (0, time[-1]), [0.0], t_eval=time, rtol=1e-10, atol=1e-12).y[0]
    quick = currents(fine(HEAVY, loop(inductance=L)), demand, 2e-3)
    assert np.all(quick >= true - 1e-6)
    assert np.all(quick - true <= R * demand / V * np.minimum(V / L * time, demand) + 1e-6)
    assert np.abs(np.diff(quick, prepend=0.0) / STEP).max() <= V / L * (1 + 1e-9)
    assert quick[-1] == pytest.approx(demand, rel=1e-3)
    # Without the limit of a winding the loop's own lag is all that there is.
    free = currents(fine(HEAVY, loop()), demand, 2e-3)
    assert np.diff(free, prepend=0.0).max() / STEP > 2 * V / L


def test_a_winding_and_a_loop_have_their_lag_and_a_motor_its_no_load_speed() -> None:
    plant = servo(HEAVY, motor(inductance=L), timestep=STEP)
    assert [(state.name, state.unit) for state in plant.hidden_states] == [("current winding", "A")]
    reached = np.argmax(currents(plant, V / R, 2e-3) >= (1 - math.exp(-1)) * V / R) * STEP
    assert reached == pytest.approx(L / R, rel=0.01)
    quick = servo(BodyEdit("rotor", mass_scale=0.01), motor())
    speeds = stepped(quick, 5.0, lambda d: d.qvel[0], asked(V / R))
    assert speeds[-1] == pytest.approx(V / (N * K), rel=1e-3)
    # A current loop follows with its bandwidth, and makes up for the back-EMF.
    plant = fine(motor(bandwidth=5e3))
    rising = stepped(plant, 2e-3, torque, 1.0)
    reached = np.argmax(rising >= (1 - math.exp(-1)) * GEAR) * STEP
    assert (reached, rising[-1]) == (
        pytest.approx(1 / 5e3, rel=0.06),
        pytest.approx(GEAR, rel=1e-4),
    )
    assert stepped(plant, 0.1, lambda d: d.qvel[0], speed=3.0)[-1] == pytest.approx(3.0, rel=1e-6)


def test_cogging_and_a_rotor_s_inertia_are_seen_through_the_gear() -> None:
    for voltage in (V, math.inf):
        plant = fine(HEAVY, loop(voltage=voltage, cogging=2e-3, cogging_periods=4.0))
        data = mujoco.MjData(plant.model)
        data.qpos[0] = 0.01
        mujoco.mj_forward(plant.model, data)
        assert torque(data) == pytest.approx(N * 2e-3 * math.sin(4 * N * 0.01), rel=1e-9)
    # By its kinetic energy at the joint's speed the joint is slower by 1 + N^2 J_m/J.
    data = mujoco.MjData((plant := servo(motor(ratio=-70.0, inertia=2e-5))).model)
    data.ctrl[0] = 0.5 / GEAR
    mujoco.mj_forward(plant.model, data)
    assert data.qacc[0] == pytest.approx(0.5 / (J + 70.0**2 * 2e-5), rel=1e-9)


def test_a_motor_that_the_model_has_already_changes_nothing_while_it_is_cold_and_slow() -> None:
    part, brakes = motor(efficiency=0.8, added=False), JointEdit("shaft", damping=0.02)
    plants = (MujocoPlant.load("servo", edits=(brakes, *parts)) for parts in ((), (part,)))
    rigid, driven = (
        stepped(plant, 0.5, lambda d: d.qpos[0], lambda t: math.sin(5 * t)) for plant in plants
    )
    assert driven == pytest.approx(rigid, rel=1e-9, abs=1e-12)
    assert part.emf_damping == pytest.approx(0.8 * (N * K) ** 2 / R)


def test_a_winding_warms_up_to_its_thermal_resistance() -> None:
    """As R i^2; behind a current loop without a supply, however large its resistance grows.

    Copper's resistance grows by 0.39 % a kelvin, and a voltage heats it less then.
    """
    heated = {"thermal_resistance": 5.0, "heat_capacity": 0.02}
    plant = fine(HEAVY, motor(**heated), timestep=1e-3)
    (heat,) = plant.hidden_states
    kelvin = heat.scale * stepped(plant, 2.0, lambda d: d.act[0], asked(V / R))[-1]
    assert heat.unit == "K"
    assert kelvin == pytest.approx(5.0 * V**2 / (R * (1 + 0.0039 * kelvin)), rel=1e-3)
    plant = fine(HEAVY, motor(bandwidth=500.0, **heated), timestep=1e-4)
    heat, winding = plant.hidden_states
    kelvin, amperes = stepped(plant, 0.2, lambda d: (d.act[0], d.act[-1]), asked(1.5))[-1]
    # The current is there within 2 ms of the 0.2 s.
    rise = 5.0 * R * 1.5**2 * (1 - math.exp(-0.2 / (5.0 * 0.02)))
    assert heat.scale * kelvin == pytest.approx(rise, rel=0.01)
    assert winding.scale * amperes == pytest.approx(1.5, rel=1e-6)


def test_a_motor_the_other_way_round_is_mirrored() -> None:
    """Its current, where it turns against its joint; its input, under a negative gear."""

    def wave(plant: MujocoPlant, sign: float) -> Array:
        """Angle, speed, torque and winding under an input that uses all of the supply."""
        read = lambda d: (d.qpos[0], d.qvel[0], torque(d), d.act[-1])  # noqa: E731
        rows = stepped(plant, 0.25, read, lambda t: sign * 3 * math.sin(100 * t))
        return rows * [1, 1, 1, plant.hidden_states[0].scale]

    for part in (motor(inductance=L, voltage=V), loop(inductance=L, bandwidth=500.0)):
        rows = wave(fine(part, timestep=1e-4), 1.0)
        assert np.abs(rows[:, 0]).max() > 0.01
        against = wave(fine(replace(part, ratio=-N), timestep=1e-4), 1.0)
        np.testing.assert_array_equal(against * [1, 1, 1, -1], rows)
        turned = fine(InputEdit("current", gear=-GEAR), part, timestep=1e-4)
        np.testing.assert_array_equal(wave(turned, 1.0), wave(fine(part, timestep=1e-4), -1.0))

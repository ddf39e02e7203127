"""DC motors: a current loop on a supply against Ohm's and Kirchhoff's laws; reversed motors."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from grosmc_mj.arrays import Array
from grosmc_mj.machine import Motor
from grosmc_mj.physics.edits import BodyEdit, Edit, InputEdit, JointEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant

GEAR = 0.667
K, R, L, N, V, BANDWIDTH = 7.68e-3, 2.6, 2e-3, 10.0, 6.0, 1e4
HEAVY = BodyEdit("rotor", mass_scale=1e9)


def servo(*edits: Edit, timestep: float = 1e-5, integrator: Any = "implicitfast") -> MujocoPlant:
    free = JointEdit("shaft", damping=0.0)
    return MujocoPlant.load("servo", edits=(free, *edits), timestep=timestep, integrator=integrator)


def loop(**numbers: Any) -> Motor:
    return Motor("current", K, R, **{"ratio": N, "bandwidth": BANDWIDTH, "voltage": V, **numbers})


def asked(amperes: float) -> float:
    """The input that asks for a current of the winding."""
    return amperes * N * K / GEAR


def run(plant: MujocoPlant, u: float, steps: int, held: float | None = None) -> Array:
    """Speed, torque at the joint and current of the winding after each step."""
    (winding,) = plant.hidden_states
    model, rows = plant.model, []
    data = mujoco.MjData(model)
    data.ctrl[0] = u
    for _ in range(steps):
        if held is not None:
            data.qvel[0] = held
        mujoco.mj_step(model, data)
        rows.append((data.qvel[0], data.qfrc_actuator[0], winding.scale * data.act[-1]))
    return np.array(rows)


@pytest.mark.parametrize("efficiency", [1.0, 0.7])
@pytest.mark.parametrize("speed", [0.0, 20.0, 60.0, -30.0])
def test_a_supply_holds_the_current_that_ohms_law_leaves_at_a_speed(
    speed: float, efficiency: float
) -> None:
    plant = servo(HEAVY, loop(efficiency=efficiency))
    _, torque, amperes = run(plant, asked(100.0), 400, held=speed)[-1]
    holds = (V - K * N * speed) / R
    assert amperes == pytest.approx(holds, rel=1e-6)
    assert torque == pytest.approx(efficiency * N * K * holds, rel=1e-6)
    # What the supply has enough voltage for is given whatever the speed.
    small = 0.5 * min(holds, V / R)
    share = asked(small * efficiency)
    assert run(plant, share, 400, held=speed)[-1, 2] == pytest.approx(small, rel=1e-6)


@pytest.mark.parametrize("speed", [0.0, 30.0])
def test_a_current_rises_by_the_voltage_over_the_inductance_at_most(speed: float) -> None:
    plant = servo(HEAVY, loop(inductance=L))
    amperes = run(plant, asked(1.0), 200, held=speed)[:, 2]
    slopes = np.diff(amperes, prepend=0.0) / 1e-5
    assert np.abs(slopes).max() <= V / L * (1 + 1e-9)
    assert amperes[-1] == pytest.approx(1.0, rel=1e-3)
    # Without the limit of a winding the loop's own lag is all that there is.
    free = np.diff(run(servo(HEAVY, loop()), asked(1.0), 200, held=speed)[:, 2], prepend=0.0)
    assert free.max() / 1e-5 > 2 * V / L


def test_a_loop_as_slow_as_its_winding_is_kirchhoffs_law() -> None:
    """Its pole is R/L: then no bound but the supply's acts, and V = L i' + R i + K w is exact."""
    plant = servo(HEAVY, loop(inductance=L, bandwidth=R / L))
    amperes = run(plant, asked(100.0), 300)[:, 2]
    time = 1e-5 * np.arange(1, 301)
    np.testing.assert_allclose(amperes, V / R * (1 - np.exp(-R / L * time)), rtol=1e-6)


def test_a_quick_loop_is_ahead_of_kirchhoffs_law_by_what_docs_say_at_most() -> None:
    """By (K w + R i)/V of the rise: the bound on the rate is that of a winding at rest."""
    most, demand = V / L, 1.0
    amperes = run(servo(HEAVY, loop(inductance=L)), asked(demand), 200)[:, 2]
    time = 1e-5 * np.arange(1, 201)

    def rise(_t: float, i: Array) -> Array:
        return np.clip(BANDWIDTH * (demand - i), (-V - R * i) / L, (V - R * i) / L)

    true = solve_ivp(rise, (0, time[-1]), [0.0], t_eval=time, rtol=1e-10, atol=1e-12).y[0]
    assert np.all(amperes >= true - 1e-6)
    assert np.all(amperes - true <= R * demand / V * np.minimum(most * time, demand) + 1e-6)


def test_most_current_and_cogging_are_the_motors_own_on_a_supply() -> None:
    plant = servo(HEAVY, loop(current=1.5))
    assert run(plant, asked(100.0), 400)[-1, 1] == pytest.approx(1.5 * N * K, rel=1e-6)
    bumpy = {"cogging": 2e-3, "cogging_periods": 4.0}
    made = [servo(HEAVY, loop(voltage=voltage, **bumpy)) for voltage in (V, math.inf)]
    torques = []
    for plant in made:
        data = mujoco.MjData(plant.model)
        data.qpos[0] = 0.01
        mujoco.mj_forward(plant.model, data)
        torques.append(data.qfrc_actuator[0])
    assert torques[0] == pytest.approx(N * 2e-3 * math.sin(4 * N * 0.01), rel=1e-9)
    assert torques[0] == pytest.approx(torques[1], rel=1e-9)


@pytest.mark.parametrize("efficiency", [1.0, 0.7])
def test_a_voltage_amplifier_stalls_at_ohms_current_times_the_share_that_arrives(
    efficiency: float,
) -> None:
    plant = servo(HEAVY, Motor("current", K, R, L, ratio=N, efficiency=efficiency, voltage=V))
    _, torque, amperes = run(plant, asked(100.0), 2000)[-1]
    assert amperes == pytest.approx(V / R, rel=1e-6)
    assert torque == pytest.approx(efficiency * N * K * V / R, rel=1e-6)


def test_a_winding_behind_a_current_loop_without_a_supply_is_heated_by_its_own_resistance() -> None:
    """As R i^2 of the winding, however large the resistance that keeps its current up."""
    thermal, capacity, current = 5.0, 0.02, 1.5
    motor = Motor(
        "current", K, R, ratio=N, bandwidth=500.0, thermal_resistance=thermal,
        heat_capacity=capacity,
    )  # fmt: skip
    plant = servo(HEAVY, motor, timestep=1e-4)
    heat, winding = plant.hidden_states
    data = mujoco.MjData(plant.model)
    data.ctrl[0] = asked(current)
    mujoco.mj_step(plant.model, data, nstep=2000)
    # The current is there within 2 ms of the 0.2 s.
    rise = thermal * R * current**2 * (1 - math.exp(-data.time / (thermal * capacity)))
    assert heat.scale * data.act[0] == pytest.approx(rise, rel=0.01)
    assert winding.scale * data.act[-1] == pytest.approx(current, rel=1e-6)


# --- motors the other way round ---

KINDS = {
    "voltage": Motor("current", K, R, L, ratio=N, voltage=V),
    "current": Motor("current", K, R, ratio=N, bandwidth=500.0),
    "both": loop(inductance=L, bandwidth=500.0),
}


def wave(plant: MujocoPlant, sign: float) -> tuple[Array, Array]:
    """States and winding's current under an input that uses all of the supply."""
    (winding,) = plant.hidden_states
    model, rows, amperes = plant.model, [], []
    data = mujoco.MjData(model)
    for step in range(3000):
        data.ctrl[0] = sign * 3 * math.sin(0.01 * step)
        mujoco.mj_step(model, data)
        rows.append((data.qpos[0], data.qvel[0], data.qfrc_actuator[0]))
        amperes.append(winding.scale * data.act[-1])
    return np.array(rows), np.array(amperes)


@pytest.mark.parametrize("motor", KINDS.values(), ids=list(KINDS))
def test_a_motor_that_turns_against_its_joint_has_its_current_mirrored(motor: Motor) -> None:
    against = replace(motor, ratio=-motor.ratio)
    rows, amperes = wave(servo(motor, timestep=1e-4), 1.0)
    mirrored, other = wave(servo(against, timestep=1e-4), 1.0)
    assert np.abs(rows[:, 0]).max() > 0.01
    np.testing.assert_array_equal(mirrored, rows)
    np.testing.assert_array_equal(other, -amperes)


@pytest.mark.parametrize("motor", KINDS.values(), ids=list(KINDS))
def test_a_negative_gear_is_the_mirrored_input(motor: Motor) -> None:
    mirrored = wave(servo(motor, timestep=1e-4), -1.0)
    turned = servo(InputEdit("current", gear=-GEAR), motor, timestep=1e-4)
    for found, wanted in zip(wave(turned, 1.0), mirrored, strict=True):
        np.testing.assert_array_equal(found, wanted)

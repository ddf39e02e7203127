"""Play in a loop: its limit cycle against that of an ideal play."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.task import NoNumbers
from grosmc_mj.machine import Motor, Transmission
from grosmc_mj.physics.edits import BodyEdit, JointEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import simulate

# The motor's inertia, the loop's frequency without damping and play, and the full play.
J, OMEGA, PLAY = 0.05, 4.0, 0.1
GEAR = 0.667
# A load that weighs a ten-thousandth of the motor stays where it is within the play by a friction
# that is 4 times its inertia force, J_load A w^2, and a five-hundredth of the motor's brake.
LOAD, FRICTION = 1e-4, 1e-4
# A step for the teeth's 4 ms and an implicit integrator.
STEP = 5e-4


def proportional(t: float, x: Any, memory: Any, p: Any) -> float:
    return -J * OMEGA**2 / GEAR * x[0]


def swung(damping: float, start: float, periods: int = 30) -> Array:
    """The motor's angle under feedback of the load's; both start together.

    Args:
        damping: Ratio, of a motor's back-EMF.
        start: Over half of the play.
        periods: Length of the run.
    """
    parts = (
        BodyEdit("rotor", mass_scale=LOAD),
        JointEdit("shaft", damping=0.0, friction=FRICTION),
        Transmission("shaft", inertia=J, backlash=PLAY),
        Motor("current", constant=0.1, resistance=1 / (2 * damping * J * OMEGA), ratio=10.0),
    )
    plant = MujocoPlant.load("servo", edits=parts, timestep=STEP, integrator="implicitfast")
    law, T = Controller("proportional", proportional, NoNumbers()), periods * 2 * math.pi / OMEGA
    run: Any = simulate(plant, law, [start * PLAY / 2, 0.0], duration=T)
    return run.physics[:, 2]


def exact(damping: float, start: float, periods: int = 30) -> Array:
    """The motor's angle with an ideal play, a load that is nowhere else; by the midpoint rule."""
    h = STEP * OMEGA
    q, v, load = start, 0.0, start
    rows: list[float] = []
    for _ in range(round(periods * 2 * math.pi / h)):
        middle, speed = q + h / 2 * v, v + h / 2 * (-load - 2 * damping * v)
        carried = min(max(load, middle - 1), middle + 1)
        v += h * (-carried - 2 * damping * speed)
        q += h * speed
        load = min(max(load, q - 1), q + 1)
        rows.append(q * PLAY / 2)
    return np.array(rows)


def cycle_of(signal: Array) -> tuple[float, float]:
    """Amplitude over half of the play and frequency over OMEGA, of the last third of a signal."""
    tail = signal[2 * len(signal) // 3 :]
    ups = np.flatnonzero((tail[:-1] < 0) & (tail[1:] >= 0))
    at = [i + tail[i] / (tail[i] - tail[i + 1]) for i in ups]
    frequency = 2 * math.pi * (len(at) - 1) / ((at[-1] - at[0]) * STEP)
    return float(np.ptp(tail)) / PLAY, frequency / OMEGA


def test_play_swings_as_an_ideal_one_and_comes_to_rest_where_that_does() -> None:
    """Its harmonic balance has no solution from a damping ratio between 0.27 and 0.28 on."""
    for damping in (0.1, 0.2):
        amplitude, frequency = cycle_of(swung(damping, 5.0))
        ideal = cycle_of(exact(damping, 5.0))
        assert amplitude == pytest.approx(ideal[0], rel=0.01)
        assert frequency == pytest.approx(ideal[1], rel=0.003)
    rested = swung(0.35, 8.0, periods=60)
    assert np.ptp(rested[-len(rested) // 6 :]) < PLAY

"""The bump test of Quanser's SRV02: a square voltage on the motor, whose speed answers like a lag.

Its speed is K/(tau s + 1) times the voltage; `docs/ladder.md` has both beside measured ones.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

import grosmc_mj as gm

# Levels [V] and the time at each [s], of the laboratory's own test.
LOW, HIGH, HALF = 0.5, 3.5, 1.25
LADDER = (Path(__file__).parents[2] / "docs" / "ladder.md").read_text(encoding="utf-8")


def bump(plant: gm.MujocoPlant, motor: gm.machine.Motor) -> tuple[float, float]:
    """K [rad/(V s)] and tau [s], to 63 % of the way, of a servo with a current as its input."""
    h, data = plant.model.opt.timestep, mujoco.MjData(plant.model)
    steps, speeds = round(HALF / h), []
    for volts in (LOW, HIGH):
        data.ctrl[0] = volts / motor.resistance
        for _ in range(steps):
            mujoco.mj_step(plant.model, data)
            speeds.append(float(data.qvel[0]))
    first, last = speeds[steps - 1], speeds[-1]
    reached = np.argmax(np.array(speeds[steps:]) >= first + (1 - math.exp(-1)) * (last - first))
    return (last - first) / (HIGH - LOW), (1 + reached) * h


@pytest.mark.parametrize(
    ("row", "built"), [("maker's nominal numbers, rigid", False), ("the same as built", True)]
)
def test_the_bump_test_of_the_servo_is_that_of_its_documentation(row: str, built: bool) -> None:
    machine = gm.Experiment.load("servo/machine")
    parts = [part for part in machine.case.parts if not isinstance(part, gm.machine.Stop)]
    motor = next(part for part in parts if isinstance(part, gm.machine.Motor))
    nominal = machine.nominal.plant
    assert isinstance(nominal, gm.MujocoPlant)
    plant = gm.MujocoPlant(nominal.system, nominal.spec, (), machine.settings.timestep)
    gain, time_constant = bump(plant.edited(*parts) if built else plant, motor)
    told = re.search(rf"\| {row} \| ([\d.]+) \| ([\d.]+) \|", LADDER)
    assert told is not None
    assert (f"{gain:.3g}", f"{1e3 * time_constant:.3g}") == told.groups()

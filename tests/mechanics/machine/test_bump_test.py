"""The bump test of Quanser's SRV02: a square voltage on the motor, whose speed answers like a lag.

Its speed is K/(tau s + 1) times the voltage; `docs/ladder.md` has both beside measured ones.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import grosmc_mj as gm
from grosmc_mj.ground.arrays import Array

# Levels [V] and the time at each [s], of the laboratory's own test.
LOW = 0.5
HIGH = 3.5
HALF = 1.25
LADDER = (Path(__file__).parents[3] / "docs" / "ladder.md").read_text(encoding="utf-8")


def documented(row: str) -> tuple[str, ...]:
    """K and tau in a row of the documentation's table, as they stand there."""
    match = re.search(rf"\| {row} \| ([\d.]+) \| ([\d.]+) \|", LADDER)
    assert match is not None
    return match.groups()


def bump_test(model: mujoco.MjModel, resistance: float) -> Array:
    """Speeds [rad/s] after the low voltage, and after each step of the high one."""
    data = mujoco.MjData(model)
    steps = round(HALF / model.opt.timestep)
    data.ctrl[0] = LOW / resistance
    mujoco.mj_step(model, data, nstep=steps)
    speeds = [float(data.qvel[0])]
    data.ctrl[0] = HIGH / resistance
    for _ in range(steps):
        mujoco.mj_step(model, data)
        speeds.append(float(data.qvel[0]))
    return np.array(speeds)


@pytest.mark.parametrize(
    ("row", "built"), [("maker's nominal numbers, rigid", False), ("the same as built", True)]
)
def test_the_bump_test_of_the_servo_is_that_of_its_documentation(row: str, built: bool) -> None:
    """K [rad/(V s)] and tau [s], to 63 % of the way, of a servo with a current as its input."""
    machine = gm.Experiment.load("servo/machine")
    parts = [part for part in machine.parts if not isinstance(part, gm.machine.Stop)]
    (motor,) = (part for part in parts if isinstance(part, gm.machine.Motor))
    nominal: Any = machine.nominal.plant
    plant = gm.MujocoPlant(nominal.system, nominal.spec, (), machine.settings.timestep)
    model = plant.changed(*parts).model if built else plant.model

    rises = bump_test(model, motor.resistance)
    rises -= rises[0]
    tau = model.opt.timestep * np.argmax(rises >= (1 - math.exp(-1)) * rises[-1])
    assert documented(row) == (f"{rises[-1] / (HIGH - LOW):.3g}", f"{1e3 * tau:.3g}")

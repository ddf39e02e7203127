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

# Levels [V] and the time at each [s], of the laboratory's own test.
LOW, HIGH, HALF = 0.5, 3.5, 1.25
LADDER = (Path(__file__).parents[2] / "docs" / "ladder.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("row", "built"), [("maker's nominal numbers, rigid", False), ("the same as built", True)]
)
def test_the_bump_test_of_the_servo_is_that_of_its_documentation(row: str, built: bool) -> None:
    """K [rad/(V s)] and tau [s], to 63 % of the way, of a servo with a current as its input."""
    machine = gm.Experiment.load("servo/machine")
    parts = [part for part in machine.case.parts if not isinstance(part, gm.machine.Stop)]
    (motor,) = (part for part in parts if isinstance(part, gm.machine.Motor))
    nominal: Any = machine.nominal.plant
    plant = gm.MujocoPlant(nominal.system, nominal.spec, (), machine.settings.timestep)
    model = (plant.edited(*parts) if built else plant).model
    data, h, speeds = mujoco.MjData(model), model.opt.timestep, []
    for volts in (LOW, HIGH):
        data.ctrl[0] = volts / motor.resistance
        for _ in range(round(HALF / h)):
            mujoco.mj_step(model, data)
            speeds.append(float(data.qvel[0]))
    before, after = np.split(np.array(speeds), 2)
    rise = after[-1] - before[-1]
    reached = h * (1 + np.argmax(after >= before[-1] + (1 - math.exp(-1)) * rise))
    documented = re.search(rf"\| {row} \| ([\d.]+) \| ([\d.]+) \|", LADDER)
    assert documented is not None
    assert documented.groups() == (f"{rise / (HIGH - LOW):.3g}", f"{1e3 * reached:.3g}")

"""The bump test of Quanser's SRV02: a rigid and a built machine beside measured ones.

A square voltage between two levels on the motor; the speed answers like K/(tau s + 1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import mujoco

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.machine import Motor, Stop
from grosmc_mj.physics.mujoco_plant import MujocoPlant

# Levels [V] and the time at each [s], of the laboratory's own test.
_LOW, _HIGH, _HALF = 0.5, 3.5, 1.25


class Bump(NamedTuple):
    """What a bump test says.

    Attributes:
        gain: K [rad/(V s)].
        time_constant: tau, to 63 % of the way [s].
        source: Where it is from; empty of what is simulated here.
    """

    gain: float
    time_constant: float
    source: str = ""


# Quanser's nominal numbers, and what laboratories have measured on theirs.
MEASURED: Sequence[Bump] = (
    Bump(1.787, 0.048, "Embry-Riddle AE443, bump test (anuranan.info)"),
    Bump(1.68, 0.044, "the same unit, fit of the whole trace"),
    Bump(2.108, 0.0197, "Waterloo MTE 484, mean of six runs"),
    Bump(1.883, 0.0216, "Waterloo MTE 484, another group"),
)


def simulated() -> dict[str, Bump]:
    """The bump test of the servo's machine, rigid and as built."""
    machine = Experiment.load("servo/machine")
    motor = next(part for part in machine.case.parts if isinstance(part, Motor))
    parts = [part for part in machine.case.parts if not isinstance(part, Stop)]
    plant = machine.nominal.plant
    assert isinstance(plant, MujocoPlant)
    fine = MujocoPlant(plant.system, plant.spec, (), machine.settings.timestep)
    return {
        "maker's nominal numbers, rigid": bump(fine, motor),
        "the same as built": bump(fine.edited(*parts), motor),
    }


def bump(plant: MujocoPlant, motor: Motor) -> Bump:
    """The bump test of a servo.

    Args:
        plant: Rigid or as built, with a current as its input.
        motor: Its motor, which says what voltage is behind a current.
    """
    model, speeds = plant.model, []
    data = mujoco.MjData(model)
    steps = round(_HALF / model.opt.timestep)
    for volts in (_LOW, _HIGH):
        data.ctrl[0] = volts / motor.resistance
        for _ in range(steps):
            mujoco.mj_step(model, data)
            speeds.append(float(data.qvel[0]))
    first, last = speeds[steps - 1], speeds[-1]
    level = first + (1 - math.exp(-1)) * (last - first)
    reached = next(i for i, speed in enumerate(speeds[steps:], start=1) if speed >= level)
    return Bump((last - first) / (_HIGH - _LOW), reached * float(model.opt.timestep))

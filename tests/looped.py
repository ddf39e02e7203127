"""Laws in a loop for the tests: scripted inputs to a servo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.loop import Loop, apply_loop
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.memory import Memory
from grosmc_mj.theory.plants import SERVO, AnalyticPlant

H = 1e-3
ANGLE, SPEED = (state.name for state in SERVO.states)
CURRENT = SERVO.input.name


@dataclass(frozen=True, eq=False)
class Script:
    """Input at each sample, the time between two [s], and the model of the observers."""

    u: Array
    period: float
    plant: Any
    reference: Any


@dataclass
class Noticed(Memory):
    """The number of samples, and the state that the law got at the last one, (2,)."""

    samples: float = 0.0
    x: Array = field(default_factory=lambda: np.zeros(2))


def as_scripted(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.samples += 1.0
    for i in range(2):
        memory.x[i] = x[i]
    # A law that predicts is asked beyond the end.
    sample = min(round(t / p.period), len(p.u) - 1)
    memory.v = p.u[sample]
    return memory.v


def scripted(
    u: Sequence[float] | Array, period: float = H, *, modelled: bool = False
) -> Controller:
    """An open loop that sends one input after the other, with a design model or without."""
    lqr = nominal().law("corrected", "lqr")
    script = Script(np.array(u, float), period, lqr.parameters.plant, lqr.parameters.reference)
    design = lqr.design if modelled else None
    return Controller("scripted", as_scripted, script, Noticed, design)


@cache
def servo() -> AnalyticPlant:
    return MujocoPlant.load("servo").analytic()


def played(
    u: Sequence[float] | Array,
    loop: Loop,
    *,
    stride: int = 1,
    x0: Sequence[float] = (0.0, 0.0),
    modelled: bool = False,
    disturbances: Sequence[Disturbance] = (),
    **options: Any,
) -> Trajectory:
    """The servo under a script in a loop, for as long as the script lasts."""
    control_period = stride * H
    periods: dict[str, Any] = {"control_period": control_period, "timestep": H}
    script = scripted(u, control_period, modelled=modelled)
    return simulate(
        servo(),
        script,
        x0,
        duration=len(u) * control_period,
        loop=apply_loop(loop, script, SERVO, **options, **periods),
        disturbances=disturbances,
        engine="python",
        **periods,
    )


def seen(run: Trajectory) -> Array:
    """States that a law in a loop got, a row for each timestep."""
    assert run.seen is not None
    return run.seen


@cache
def nominal(**settings: Any) -> Experiment:
    """The servo's nominal case with other simulation settings."""
    return Experiment.load("servo/nominal").changed(**settings)

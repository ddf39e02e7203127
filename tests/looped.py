"""Laws in a loop as tests ask for them: scripted inputs, and the servo that meets them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.memory import Memory
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.loop import Loop, in_loop
from grosmc_mj.loop.controllers import AppliedLoop
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SERVO, AnalyticPlant
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory

H = 1e-3
ANGLE, SPEED = (state.name for state in SERVO.states)
CURRENT = SERVO.input.name


@dataclass(frozen=True, eq=False)
class Script:
    """What is asked for at each sample, the time between two [s], and what observers believe in."""

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
    # One that predicts is asked for what comes after the end.
    memory.v = p.u[min(round(t / p.period), len(p.u) - 1)]
    return memory.v


def scripted(
    u: Sequence[float] | Array, period: float = H, *, modelled: bool = False
) -> Controller:
    """An open loop that asks for one number after the other, with a design model or without."""
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
    """The servo under a script in a loop, as long as there is something to ask for."""
    periods: dict[str, Any] = {"control_period": stride * H, "timestep": H}
    law = in_loop(scripted(u, stride * H, modelled=modelled), loop, SERVO, **options, **periods)
    periods |= {"duration": len(u) * stride * H, "engine": "python"}
    return simulate(servo(), law, x0, disturbances=disturbances, **periods)


def applied(law: Controller) -> AppliedLoop:
    """The loop around a law."""
    assert law.loop is not None
    return law.loop


def seen(run: Trajectory) -> Array:
    """What a law in a loop saw."""
    assert run.seen is not None
    return run.seen


@cache
def nominal(**settings: Any) -> Experiment:
    """The servo's nominal case, run in another way."""
    return Experiment.load("servo/nominal").with_settings(**settings)

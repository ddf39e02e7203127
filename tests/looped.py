"""Laws in a loop as tests ask for them: scripted inputs, and the servo that meets them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.plants import SERVO, AnalyticPlant
from grosmc_mj.simulation.loop import Actuator, Loop, in_loop
from grosmc_mj.simulation.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.simulation.trajectory import Trajectory

H = 1e-3
ANGLE, SPEED = (state.name for state in SERVO.states)
CURRENT = SERVO.input.name


@dataclass(frozen=True, eq=False)
class Script:
    """What is asked for at each sample, and the time between two [s]."""

    u: Array
    period: float


def as_scripted(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.v = p.u[round(t / p.period)]
    return memory.v


def scripted(u: Sequence[float] | Array, period: float = H) -> Controller:
    """An open loop that asks for one number after the other."""
    return Controller("scripted", as_scripted, Script(np.array(u, float), period))


@cache
def servo() -> AnalyticPlant:
    return MujocoPlant.load("servo").analytic()


def played(
    u: Sequence[float] | Array,
    loop: Loop,
    *,
    stride: int = 1,
    h: float = H,
    x0: Sequence[float] = (0.0, 0.0),
    run: int = 0,
    engine: Engine = "python",
) -> Trajectory:
    """The servo under a script in a loop, as long as there is something to ask for."""
    period = stride * h
    law = in_loop(scripted(u, period), loop, SERVO, control_period=period, timestep=h, run=run)
    return simulate(
        servo(), law, x0, duration=len(u) * period, control_period=period, timestep=h, engine=engine
    )


def seen(run: Trajectory) -> Array:
    """What a law in a loop saw."""
    assert run.seen is not None
    return run.seen


def behind(u: Sequence[float] | Array, *, h: float = H, **numbers: Any) -> Array:
    """What an actuator of these numbers makes of a script, timestep by timestep."""
    return played(u, Loop(actuators=(Actuator(CURRENT, **numbers),)), h=h).input


@cache
def nominal(**settings: Any) -> Experiment:
    """The servo's nominal case, run in another way."""
    return Experiment.load("servo/nominal").with_settings(**settings)


def closed(
    bare: Controller,
    loop: Loop,
    x0: Sequence[float],
    duration: float,
    *,
    predict: bool = False,
    **options: Any,
) -> Trajectory:
    """The servo under a law in its loop."""
    law = in_loop(bare, loop, SERVO, predict=predict)
    return simulate(servo(), law, x0, duration=duration, **options)

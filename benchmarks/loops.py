"""Throughput as ratios within one run: what the law costs beside MuJoCo itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from benchmarks.batches import OPEN_LOOP, closed_loop, open_batch
from benchmarks.timing import Throughput, TimedLoop, measured
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.films.offscreen import without_graphics
from grosmc_mj.loop import Loop, in_loop
from grosmc_mj.physics.mujoco_plant import Integrator, MujocoPlant

_MANY = 1024
_STEPS = {1: 50_000, _MANY: 500}


def benchmark(integrator: Integrator | None = None, rounds: int = 15) -> list[Throughput]:
    """Measure the pendulum under the full GROSMC law at every timestep, and what it is beside.

    Args:
        integrator: MuJoCo's integrator; None for the model's own.
        rounds: How often each loop is measured.
    """
    return measured(_loops(MujocoPlant.load("cart_pendulum", integrator=integrator)), rounds)


def _loops(plant: MujocoPlant) -> Sequence[TimedLoop]:
    """The loops, each baseline before what is compared with it."""
    experiment = find_experiment("cart_pendulum", "nominal")
    case, controller = experiment.case, experiment.law("physics", "grosmc")
    h = plant.step_length

    looped, predicting = (
        in_loop(
            controller, _every_part(), plant.system, control_period=h, timestep=h, predict=predict
        )
        for predict in (False, True)
    )

    def open_loop_one() -> Callable[[], object]:
        data = mujoco.MjData(plant.undrawn_model)
        data.qpos[1] = case.x0[1]
        return lambda: mujoco.mj_step(plant.undrawn_model, data, nstep=_STEPS[1])

    def native(name: str, law: Controller, many: int, beside: str, **how: bool) -> TimedLoop:
        starts = np.tile(case.x0, (many, 1))
        return closed_loop(name, [plant] * many, law, starts, _STEPS[many], beside=beside, **how)

    few = _STEPS[1] // 10

    def python_loop() -> Callable[[], object]:
        model, memory = plant.undrawn_model, controller.memory()
        data = mujoco.MjData(model)
        data.qpos[1] = case.x0[1]

        def run() -> None:
            for k in range(few):
                x = np.concatenate([data.qpos, data.qvel])
                controller.law(k * h, x, memory, controller.parameters, data.ctrl)
                mujoco.mj_step(model, data)

        return run

    one, batch = "mj_step(nstep), open loop", "GROSMC, native, batch"
    return [
        TimedLoop(one, 1, _STEPS[1], open_loop_one, one),
        native("GROSMC, native", controller, 1, one),
        native("GROSMC, native, recorded", controller, 1, one, record=True),
        TimedLoop("GROSMC, Python mj_step loop", 1, few, python_loop, one),
        *_suite_loop(one),
        open_batch([plant] * _MANY, np.tile(case.x0, (_MANY, 1)), _STEPS[_MANY]),
        native(batch, controller, _MANY, OPEN_LOOP),
        native("GROSMC in its loop, batch", looped, _MANY, batch),
        native("GROSMC in its loop, predicting, batch", predicting, _MANY, batch),
        native(f"{batch}, recorded", controller, _MANY, OPEN_LOOP, record=True),
    ]


def _every_part() -> Loop:
    """The bench's loop of the pendulum with every number that a loop has."""
    loop = find_experiment("cart_pendulum", "bench").case.loop or Loop()
    return Loop(
        replace(loop.computing, delay=1e-3, missed=1e-3),
        tuple(replace(s, noise=1e-5, bias=1e-6, drift=1e-6, delay=1e-3) for s in loop.sensors),
        loop.estimators,
        tuple(
            replace(a, delay=1e-3, rate_limit=1e6, order=2, dead_zone=1e-3) for a in loop.actuators
        ),
    )


def _suite_loop(baseline: str) -> list[TimedLoop]:
    """dm_control's cartpole under a constant action; nothing where dm_control is missing."""
    try:
        with without_graphics():
            from dm_control import suite
    except ImportError:
        return []
    environment = suite.load("cartpole", "balance", task_kwargs={"random": 0})
    substeps = round(environment.control_timestep() / environment.physics.timestep())
    calls = 2000

    def ready() -> Callable[[], object]:
        environment.reset()
        action = np.zeros(environment.action_spec().shape)

        def run() -> None:
            for _ in range(calls):
                environment.step(action)

        return run

    return [TimedLoop("dm_control suite cartpole", 1, calls * substeps, ready, baseline)]

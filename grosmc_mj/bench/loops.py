"""Throughput as ratios within one run: what the law costs beside MuJoCo itself."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch

from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.films.offscreen.backends import without_graphics
from grosmc_mj.simulation.engines.native_batch import NativeBatch
from grosmc_mj.simulation.loop import Loop, in_loop
from grosmc_mj.simulation.mujoco_plant import Integrator, MujocoPlant
from grosmc_mj.simulation.simulate import prepare

_STEPS = {1: 50_000, 1024: 100}


class Throughput(NamedTuple):
    """One measured loop.

    Attributes:
        loop: What ran.
        simulations: How many at once.
        rate: Median physics steps per second, over all simulations.
        ratio: Median of its rate over the baseline's in the same round.
        baseline: What it is compared with.
    """

    loop: str
    simulations: int
    rate: float
    ratio: float
    baseline: str


class TimedLoop(NamedTuple):
    """A loop to measure.

    Attributes:
        name: What runs.
        simulations: How many at once.
        steps: Physics steps of each.
        ready: Sets it up, untimed, and returns what is timed.
        baseline: Name of the loop that it is compared with.
    """

    name: str
    simulations: int
    steps: int
    ready: Callable[[], Callable[[], object]]
    baseline: str


def benchmark(integrator: Integrator | None = None, rounds: int = 15) -> list[Throughput]:
    """Measure the pendulum under the full GROSMC law at every timestep, and what it is beside.

    Args:
        integrator: MuJoCo's integrator; None for the model's own.
        rounds: How often each loop is measured.
    """
    return measured(_loops(MujocoPlant.load("cart_pendulum", integrator=integrator)), rounds)


def measured(loops: Sequence[TimedLoop], rounds: int) -> list[Throughput]:
    """Run all loops once in each round, in turn: a slow moment of the machine meets all of them.

    Ratios are taken within a round, and their median is reported.

    Args:
        loops: Each baseline before what is compared with it.
        rounds: How often each loop is measured.
    """
    rates: dict[str, list[float]] = {loop.name: [] for loop in loops}
    for _ in range(rounds):
        for loop in loops:
            run = loop.ready()
            gc.collect()
            start = time.perf_counter()
            run()
            elapsed = time.perf_counter() - start
            rates[loop.name].append(loop.simulations * loop.steps / elapsed)
    return [
        Throughput(
            loop.name,
            loop.simulations,
            statistics.median(rates[loop.name]),
            statistics.median(
                own / base for own, base in zip(rates[loop.name], rates[loop.baseline], strict=True)
            ),
            loop.baseline,
        )
        for loop in loops
    ]


def _loops(plant: MujocoPlant) -> Sequence[TimedLoop]:
    """The loops, each baseline before what is compared with it."""
    experiment = find_experiment("cart_pendulum", "nominal")
    case, controller = experiment.case, experiment.law("physics", "grosmc")
    h = float(plant.model.opt.timestep)

    looped = in_loop(
        controller, _every_part(), plant.system, control_period=h, timestep=h, predict=True
    )

    def native(law: Controller, simulations: int, *, record: bool) -> NativeBatch:
        starts = np.tile(case.x0, (simulations, 1))
        steps = _STEPS[simulations]
        problem, _ = prepare(plant, law, starts, duration=steps * h, record=record)
        return NativeBatch(problem)

    def open_loop_one() -> Callable[[], object]:
        data = mujoco.MjData(plant.model)
        data.qpos[1] = case.x0[1]
        return lambda: mujoco.mj_step(plant.model, data, nstep=_STEPS[1])

    def open_loop_batch() -> Callable[[], object]:
        batch = Batch(plant.model, 1024)
        batch.qpos[:, 1] = case.x0[1]
        return lambda: batch.step(nstep=_STEPS[1024])

    def closed(law: Controller, simulations: int) -> Callable[[], Callable[[], object]]:
        def ready() -> Callable[[], object]:
            batch = native(law, simulations, record=False)
            return lambda: batch.advance(_STEPS[simulations])

        return ready

    def recorded(simulations: int) -> Callable[[], Callable[[], object]]:
        return lambda: native(controller, simulations, record=True).run

    few = _STEPS[1] // 10

    def python_loop() -> Callable[[], object]:
        model, data, memory = plant.model, mujoco.MjData(plant.model), controller.memory()
        data.qpos[1] = case.x0[1]

        def run() -> None:
            for k in range(few):
                x = np.concatenate([data.qpos, data.qvel])
                data.ctrl[0] = controller.law(k * h, x, memory, controller.parameters)
                mujoco.mj_step(model, data)

        return run

    one, many = "mj_step(nstep), open loop", "Batch.step(nstep), open loop"
    closed_batch = "GROSMC, native, batch"
    return [
        TimedLoop(one, 1, _STEPS[1], open_loop_one, one),
        TimedLoop("GROSMC, native", 1, _STEPS[1], closed(controller, 1), one),
        TimedLoop("GROSMC, native, recorded", 1, _STEPS[1], recorded(1), one),
        TimedLoop("GROSMC, Python mj_step loop", 1, few, python_loop, one),
        *_suite_loop(one),
        TimedLoop(many, 1024, _STEPS[1024], open_loop_batch, many),
        TimedLoop(closed_batch, 1024, _STEPS[1024], closed(controller, 1024), many),
        TimedLoop(
            "GROSMC in its loop, batch", 1024, _STEPS[1024], closed(looped, 1024), closed_batch
        ),
        TimedLoop("GROSMC, native, batch, recorded", 1024, _STEPS[1024], recorded(1024), many),
    ]


def _every_part() -> Loop:
    """The bench's loop of the pendulum with every number that a loop has, and prediction."""
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

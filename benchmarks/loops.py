"""Throughput as ratios within one run: what the law costs beside MuJoCo itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np

from benchmarks.batches import closed_loop, in_pair, open_batches
from benchmarks.timing import Throughput, TimedLoop, measured
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.mechanics.physics.mujoco_plant import Integrator, MujocoPlant
from grosmc_mj.output.films.offscreen import without_graphics
from grosmc_mj.simulation.loop import Loop, apply_loop

_MANY = 1024
_STEPS = {1: 50_000, _MANY: 500}


def benchmark(integrator: Integrator | None = None, rounds: int = 15) -> list[Throughput]:
    """Measure the pendulum under the full GROSMC law, sampled at every timestep.

    Args:
        integrator: MuJoCo's integrator; None for the model's own.
        rounds: Number of rounds.

    Returns:
        Single simulations, then batches.
    """
    plant = MujocoPlant.load("cart_pendulum", integrator=integrator)
    return [*_single(plant, rounds), *_batches(plant, rounds)]


def _single(plant: MujocoPlant, rounds: int) -> list[Throughput]:
    """Loops of one simulation."""
    experiment = find_experiment("cart_pendulum", "nominal")
    x0 = np.array(experiment.x0)
    law = experiment.law("physics", "grosmc")
    steps = _STEPS[1]
    few = steps // 10

    def at_start() -> mujoco.MjData:
        data = mujoco.MjData(plant.undrawn_model)
        data.qpos[:] = x0[:2]
        return data

    def open_loop() -> Callable[[], object]:
        data = at_start()
        return lambda: mujoco.mj_step(plant.undrawn_model, data, nstep=steps)

    def python_loop() -> Callable[[], object]:
        model = plant.undrawn_model
        memory = law.memory()
        data = at_start()

        def run() -> None:
            for k in range(few):
                x = np.concatenate([data.qpos, data.qvel])
                law.law(k * plant.step_length, x, memory, law.parameters, data.ctrl)
                mujoco.mj_step(model, data)

        return run

    shipped, untimed = in_pair("mj_step(nstep), open loop", 1, steps, open_loop)
    loops = [
        closed_loop("GROSMC, native", [plant], law, x0[None], steps),
        closed_loop("GROSMC, native, recorded", [plant], law, x0[None], steps, record=True),
        TimedLoop("GROSMC, Python mj_step loop", 1, few, python_loop),
        *_gymnasium_loop(),
        *_suite_loop(),
    ]
    return measured(shipped, untimed, loops, rounds)


def _batches(plant: MujocoPlant, rounds: int) -> list[Throughput]:
    """Loops of many simulations at once."""
    experiment = find_experiment("cart_pendulum", "nominal")
    law = experiment.law("physics", "grosmc")
    h = plant.step_length
    loop, known_loop = (
        apply_loop(_every_part(), law, plant.system, control_period=h, timestep=h, predict=predict)
        for predict in (False, True)
    )
    plants = [plant] * _MANY
    x0 = np.tile(experiment.x0, (_MANY, 1))
    steps = _STEPS[_MANY]

    shipped, untimed = open_batches(plants, x0, steps)
    name = "GROSMC, native, batch"
    loops = [
        closed_loop(name, plants, law, x0, steps),
        closed_loop(f"{name}, recorded", plants, law, x0, steps, record=True),
        closed_loop("GROSMC in its loop, batch", plants, law, x0, steps, loop=loop),
        closed_loop(
            "GROSMC in its loop, predicting, batch", plants, law, x0, steps, loop=known_loop
        ),
    ]
    return measured(shipped, untimed, loops, rounds)


def _every_part() -> Loop:
    """The bench's loop of the pendulum with every number that a loop has."""
    loop = find_experiment("cart_pendulum", "bench").loop or Loop()
    return Loop(
        replace(loop.computing, delay=1e-3, missed=1e-3),
        tuple(replace(s, noise=1e-5, bias=1e-6, drift=1e-6, delay=1e-3) for s in loop.sensors),
        loop.estimators,
        tuple(
            replace(a, delay=1e-3, rate_limit=1e6, order=2, dead_zone=1e-3) for a in loop.actuators
        ),
    )


def _gymnasium_loop() -> list[TimedLoop]:
    """The case as an environment of Gymnasium, without input; nothing without Gymnasium."""
    try:
        with without_graphics():
            from grosmc_mj.environments import CaseEnv
    except ImportError:
        return []
    environment = CaseEnv("cart_pendulum", "nominal")
    substeps = environment.episode.problem.stride
    calls = 1000

    def ready() -> Callable[[], object]:
        environment.reset(seed=0)
        action = np.zeros(np.shape(environment.episode.low))

        def run() -> None:
            for _ in range(calls):
                *_, terminated, truncated, _info = environment.step(action)
                # The pole has fallen.
                if terminated or truncated:
                    environment.reset(seed=0)

        return run

    return [TimedLoop("Gymnasium environment", 1, calls * substeps, ready)]


def _suite_loop() -> list[TimedLoop]:
    """Cartpole of dm_control's suite, without input; nothing without dm_control."""
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

    return [TimedLoop("dm_control suite cartpole", 1, calls * substeps, ready)]

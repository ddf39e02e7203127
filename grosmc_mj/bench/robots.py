"""Throughput of a batch of robots under GROSMC beside the same batch in open loop."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mujoco.batch import Batch

from grosmc_mj.bench.loops import Throughput, TimedLoop, measured
from grosmc_mj.cases.jaco.jaco import controllers, jaco, joint_sines, payload, start
from grosmc_mj.simulation.engines.native_batch import NativeBatch
from grosmc_mj.simulation.prepare import prepare

# A compiled Jaco is 1.7 MB of meshes, so several simulations share one.
_SIMULATIONS, _PAYLOADS, _HEAVIEST, _STEPS = 1024, 64, 1.5, 50


def benchmark_robots(rounds: int = 5) -> list[Throughput]:
    """Measure 1024 Jaco arms with 64 different payloads, the law sampled at every timestep.

    In open loop the same batch holds zero torque from the same start.

    Args:
        rounds: How often each loop is measured.

    Raises:
        SetupError: If dm_control is not installed.
    """
    robot = jaco()
    path = joint_sines(robot)
    law, x0 = controllers(robot, path).grosmc, start(path)
    masses = np.linspace(0.0, _HEAVIEST, _PAYLOADS + 1)[1:]
    loaded = [robot.plant.edited(payload(robot, float(mass))) for mass in masses]
    plants = [loaded[i % _PAYLOADS] for i in range(_SIMULATIONS)]
    duration = _STEPS * float(robot.plant.model.opt.timestep)

    def open_loop() -> Callable[[], object]:
        batch = Batch(plants[0].model, _SIMULATIONS)
        batch.set_models([plant.model for plant in plants])
        batch.bind("qpos")[:] = x0[: robot.joints]
        return lambda: batch.step(nstep=_STEPS)

    def closed_loop(record: bool) -> Callable[[], Callable[[], object]]:
        def ready() -> Callable[[], object]:
            starts = np.tile(x0, (_SIMULATIONS, 1))
            problem, _ = prepare(plants, law, starts, duration=duration, record=record)
            batch = NativeBatch(problem)
            return batch.run if record else lambda: batch.advance(_STEPS)

        return ready

    name = "Batch.step(nstep), open loop"
    loops = [
        TimedLoop(name, _SIMULATIONS, _STEPS, open_loop, name),
        TimedLoop("GROSMC, native, batch", _SIMULATIONS, _STEPS, closed_loop(record=False), name),
        TimedLoop(
            "GROSMC, native, batch, recorded", _SIMULATIONS, _STEPS, closed_loop(record=True), name
        ),
    ]
    return measured(loops, rounds)

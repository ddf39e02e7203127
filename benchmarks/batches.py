"""Plants under a law in the native engine, and the same models in MuJoCo's own open loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mujoco.batch import Batch

from benchmarks.timing import TimedLoop
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.hidden_states import starts
from grosmc_mj.mechanics.physics.hooks import clock_suspended
from grosmc_mj.simulation.native_engine import run_native
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import Plant


def batch_at(plants: Sequence[Plant], x0: Array) -> Batch:
    """MuJoCo's batch of plants at their starts, where runs of them begin, too.

    Args:
        plants: One for each simulation.
        x0: Starts, (nsim, n).
    """
    models = [plant.undrawn_model for plant in plants]
    batch = Batch(models[0], len(plants))
    if len(set(plants)) > 1:
        batch.set_models(models)
    qpos, qvel = starts(models[0], plants[0].system, x0)
    batch.bind("qpos")[:] = qpos
    batch.bind("qvel")[:] = qvel
    return batch


def open_batches(plants: Sequence[Plant], x0: Array, steps: int) -> tuple[TimedLoop, TimedLoop]:
    """MuJoCo's batch without inputs and disturbances, as shipped and without its clock.

    Args:
        plants: One for each simulation.
        x0: Starts, (nsim, n).
        steps: Steps of each simulation.
    """

    def ready() -> Callable[[], object]:
        batch = batch_at(plants, x0)
        return lambda: batch.step(nstep=steps)

    return in_pair("Batch.step(nstep), open loop", len(plants), steps, ready)


def in_pair(
    name: str, simulations: int, steps: int, ready: Callable[[], Callable[[], object]]
) -> tuple[TimedLoop, TimedLoop]:
    """One open loop of MuJoCo, as shipped and without its clock, see ``TimedLoop``."""

    def untimed() -> Callable[[], object]:
        run = ready()

        def run_without_clock() -> None:
            with clock_suspended():
                run()

        return run_without_clock

    return (
        TimedLoop(name, simulations, steps, ready),
        TimedLoop(f"{name}, no clock", simulations, steps, untimed),
    )


def closed_loop(
    name: str,
    plants: Sequence[Plant],
    law: Controller | Sequence[Controller],
    x0: Array,
    steps: int,
    *,
    record: bool = False,
    **asked: Any,
) -> TimedLoop:
    """Plants under a law in the native engine.

    Args:
        name: Name of the loop.
        plants: One for each simulation.
        law: One for all, or one for each.
        x0: Starts, (nsim, n).
        steps: Steps of each simulation.
        record: Whether the runs are recorded.
        asked: Arguments of ``prepare``; without a control period the law is sampled at every
            timestep.
    """
    h = float(plants[0].undrawn_model.opt.timestep)
    problem, _single = prepare(plants, law, x0, duration=steps * h, record=record, **asked)
    return TimedLoop(name, len(plants), steps, lambda: lambda: run_native(problem))

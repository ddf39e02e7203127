"""Plants under a law in the native engine, and the same models in MuJoCo's own open loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mujoco.batch import Batch

from benchmarks.timing import TimedLoop
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.physics.hidden_states import starts
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.native_engine import run_native
from grosmc_mj.simulation.prepare import prepare

OPEN_LOOP = "Batch.step(nstep), open loop"


def batch_at(plants: Sequence[Plant], x0: Array) -> Batch:
    """MuJoCo's batch of plants at their starts, where runs of them begin, too.

    Args:
        plants: One for each simulation.
        x0: Their starts, (nsim, n).
    """
    models = [plant.undrawn_model for plant in plants]
    batch = Batch(models[0], len(plants))
    if len(set(plants)) > 1:
        batch.set_models(models)
    batch.bind("qpos")[:], batch.bind("qvel")[:] = starts(models[0], plants[0].system, x0)
    return batch


def open_batch(plants: Sequence[Plant], x0: Array, steps: int) -> TimedLoop:
    """That batch without inputs and disturbances.

    Args:
        plants: One for each simulation.
        x0: Their starts, (nsim, n).
        steps: Of each.
    """

    def ready() -> Callable[[], object]:
        batch = batch_at(plants, x0)
        return lambda: batch.step(nstep=steps)

    return TimedLoop(OPEN_LOOP, len(plants), steps, ready, OPEN_LOOP)


def closed_loop(
    name: str,
    plants: Sequence[Plant],
    law: Controller | Sequence[Controller],
    x0: Array,
    steps: int,
    *,
    beside: str = OPEN_LOOP,
    record: bool = False,
    **asked: Any,
) -> TimedLoop:
    """These plants under a law in the native engine.

    Args:
        name: What runs.
        plants: One for each simulation.
        law: One for all, or one for each.
        x0: Their starts, (nsim, n).
        steps: Of each.
        beside: Name of the loop that it is compared with.
        record: Whether the runs are recorded.
        asked: As for ``prepare``; without a control period the law is asked at every timestep.
    """
    h = float(plants[0].undrawn_model.opt.timestep)
    problem, _ = prepare(plants, law, x0, duration=steps * h, record=record, **asked)

    return TimedLoop(name, len(plants), steps, lambda: lambda: run_native(problem), beside)

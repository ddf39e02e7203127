"""The one entry: close the loop of a controller and a plant, once or thousands of times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, DivergenceError, UndefinedLawError, unknown_name
from grosmc_mj.simulation.disturbances import AnyDisturbance
from grosmc_mj.simulation.loop import AppliedLoop, Loop
from grosmc_mj.simulation.native_engine import run_native
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.problem import Accumulator, Problem, Record
from grosmc_mj.simulation.python_engine import run_python
from grosmc_mj.simulation.stability import remedy
from grosmc_mj.simulation.trajectory import Status, Trajectory, why_ended
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import Plant

Engine = Literal["native", "python"]
_ENGINES = {"native": run_native, "python": run_python}


def simulate(
    plant: Plant | Sequence[Plant],
    controller: Controller | Sequence[Controller],
    x0: ArrayLike,
    *,
    duration: float,
    loop: Loop | AppliedLoop | Sequence[Loop | AppliedLoop | None] | None = None,
    control_period: float | None = None,
    timestep: float | None = None,
    disturbances: Sequence[AnyDisturbance] | Sequence[Sequence[AnyDisturbance]] = (),
    accumulator: Accumulator | Sequence[Accumulator] | None = None,
    engine: Engine = "native",
    record: bool = True,
    threads: int = 0,
) -> Trajectory:
    """Run the closed loop with a sampled law and a zero-order hold.

    A sequence of plants, controllers or disturbance lists, or an x0 with two axes, makes a
    batch; what is given once serves every simulation of it.

    Args:
        plant: An analytic plant or one in MuJoCo, or several of one system and kind.
        controller: A controller, or several with the same law and different numbers.
        x0: Start, (n,) or (nsim, n), in the order and units of ``plant.system.states``.
        duration: [s]; rounded up to whole timesteps.
        loop: Sensors, estimators, computer and actuators around the law, for all simulations or one
            for each; ideal by default. ``apply_loop`` makes one for a law that knows its loop.
        control_period: Time between two samples of the law [s]; the timestep by default. It
            must be a multiple of the timestep.
        timestep: Of an analytic plant [s], 1 ms by default; a model in MuJoCo has its own.
        disturbances: Of bodies, inputs, measured states and rates, in one list for all
            simulations, or one list for each.
        accumulator: Metrics to accumulate, for all simulations or one for each.
        engine: ``native`` compiles law and loop; ``python`` runs any callable law.
        record: Whether to keep every timestep, or only start and end.
        threads: For the native engine; 0 for all cores.

    Returns:
        The trajectory; that of a batch has one more axis in front.

    Raises:
        ArgumentError: If an argument does not fit.
        DivergenceError: If a single run diverges. In a batch the status says so.
        UndefinedLawError: If a single run reaches a state where its law or plant is undefined.
    """
    if not isinstance(engine, str) or engine not in _ENGINES:
        raise ArgumentError(unknown_name("engine", engine, _ENGINES))
    problem, single = prepare(
        plant,
        controller,
        x0,
        duration=duration,
        loop=loop,
        control_period=control_period,
        timestep=timestep,
        disturbances=disturbances,
        accumulator=accumulator,
        record=record,
        threads=threads,
    )
    trajectory = _trajectory(problem, _ENGINES[engine](problem))
    if not single:
        return trajectory

    run = trajectory[0]
    status = trajectory.status[0]
    if status is Status.COMPLETED:
        return run
    end = float(trajectory.valid_until[0])
    advice = remedy(problem) if status is Status.DIVERGED else ""
    reason = why_ended(status, run.system, problem.controller, end, run.state[-1], advice)
    if status is Status.DIVERGED:
        raise DivergenceError(reason, end, run)
    raise UndefinedLawError(reason, end, run)


def _trajectory(problem: Problem, record: Record) -> Trajectory:
    """Record of an engine as a batch of trajectories."""
    rows = record.rows
    # The last valid row is repeated; an unrecorded run that ended early has only its start.
    for run in np.flatnonzero(record.status).tolist():
        last = int(record.valid[run]) if problem.record else 0
        rows[run, last + 1 :] = rows[run, last]

    columns = problem.columns
    held = {name: rows[:, 1:, place] for name, place in columns.items()}
    memory = held["memory"].view(problem.memory_dtype)[..., 0]
    names = memory.dtype.names or ()
    time = np.arange(problem.steps + 1) * problem.timestep
    if not problem.record:
        time = time[[0, -1]]
    output = held["given"] if problem.looped else held["command"]
    accumulated = None
    accumulator = problem.accumulators[0]
    if accumulator is not None:
        _note, values_dtype, _numbers_dtype = accumulator.kind
        accumulated = record.accumulated.view(values_dtype)[:, 0]
    return Trajectory(
        system=problem.system,
        time=time,
        state=rows[..., columns["x"]],
        command=_squeezed(held["command"]),
        seen=held["seen"] if problem.looped else None,
        input=_squeezed(_applied(problem, output)),
        sliding=_squeezed(memory["s"]) if "s" in names else None,
        weighed=_squeezed(memory["v"]),
        memory=memory,
        wrench=_if_disturbed(held["w"]),
        input_disturbance=_if_disturbed(_squeezed(held["input_disturbance"])),
        output_disturbance=_if_disturbed(held["output_disturbance"]),
        rate_disturbance=_if_disturbed(held["rate_disturbance"]),
        physics=_physics(problem, rows),
        status=np.array([Status(value) for value in record.status], object),
        valid_until=record.valid * problem.timestep,
        unseen=tuple(getattr(plant, "hidden_states", ()) for plant in problem.plants),
        accumulated=accumulated,
    )


def _if_disturbed(rows: Array) -> Array | None:
    """Disturbances in the rows of a record; None if none was given."""
    return rows if rows.size else None


def _physics(problem: Problem, rows: Array) -> Array | None:
    """mjSTATE_FULLPHYSICS in the rows of a record; None of equations."""
    if problem.plants[0].kind != "physics":
        return None
    if rows.shape[2] > problem.width:
        return rows[..., problem.width :]
    # Without hidden states it is the time and the state.
    columns = problem.columns
    return rows[..., columns["engine_time"].start : columns["x"].stop]


def _squeezed(rows: Array) -> Array:
    """Values of a single input without an axis for it: (nsim, rows) for (nsim, rows, 1)."""
    if rows.ndim == 3 and rows.shape[-1] == 1:
        return rows[..., 0]
    return rows


def _applied(problem: Problem, u: Array) -> Array:
    """Commands within the range of the actuators, as MuJoCo applies them."""
    low, high = np.stack([plant.input_limits for plant in problem.plants], axis=1)
    return np.clip(u, low[:, None], high[:, None])

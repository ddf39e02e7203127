"""The one entry: close the loop of a controller and a plant, once or thousands of times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, DivergenceError, UndefinedLawError, unknown_name
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.native_engine import run_native
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.problem import Meters, Problem, Record
from grosmc_mj.simulation.python_engine import run_python
from grosmc_mj.simulation.trajectory import Status, Trajectory, why_ended

Engine = Literal["native", "python"]
_ENGINES = {"native": run_native, "python": run_python}


def simulate(
    plant: Plant | Sequence[Plant],
    controller: Controller | Sequence[Controller],
    x0: ArrayLike,
    *,
    duration: float,
    control_period: float | None = None,
    timestep: float | None = None,
    disturbances: Sequence[Disturbance] | Sequence[Sequence[Disturbance]] = (),
    meters: Meters | Sequence[Meters] | None = None,
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
        control_period: Time between two samples of the law [s]; the timestep by default. It
            must be a multiple of the timestep.
        timestep: Of an analytic plant [s], 1 ms by default; a model in MuJoCo has its own.
        disturbances: Wrenches, for all simulations or one list for each.
        meters: Metrics to accumulate, for all simulations or one for each.
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
        plant, controller, x0, duration=duration, control_period=control_period, timestep=timestep,
        disturbances=disturbances, meters=meters, record=record, threads=threads,
    )  # fmt: skip
    result = _ENGINES[engine](problem)
    trajectory = _trajectory(problem, result)
    if not single:
        return trajectory
    run, status, end = trajectory[0], trajectory.status[0], float(trajectory.valid_until[0])
    if status is not Status.COMPLETED:
        why = why_ended(status, run.system, problem.controller, end, run.state[-1])
        raise (DivergenceError if status is Status.DIVERGED else UndefinedLawError)(why, end, run)
    return run


def _trajectory(problem: Problem, record: Record) -> Trajectory:
    """What the engine wrote, with names, as a batch."""
    rows = record.rows
    columns = problem.columns
    # The last valid row is repeated; of an unrecorded run that ended early only the start is.
    for run in np.flatnonzero(record.status).tolist():
        last = int(record.valid[run]) if problem.record else 0
        rows[run, last + 1 :] = rows[run, last]
    held = {name: rows[:, 1:, place] for name, place in columns.items()}
    memory = held["memory"].view(problem.memory_dtype)[..., 0]
    names, looped, meters = memory.dtype.names or (), problem.looped, problem.meters[0]
    if "workspace" in names:
        memory["workspace"] = 0.0  # an address, which means nothing after the run
    time = np.arange(problem.steps + 1) * problem.timestep
    return Trajectory(
        system=problem.system,
        time=time if problem.record else time[[0, -1]],
        state=rows[..., columns["x"]],
        command=_squeezed(held["command"]),
        seen=held["seen"] if looped else None,
        input=_squeezed(_applied(problem, held["given" if looped else "command"])),
        sliding=_squeezed(memory["s"]) if "s" in names else None,
        weighed=_squeezed(memory["v"]),
        memory=memory,
        wrench=held["w"] if problem.disturbed else None,
        physics=_physics(problem, rows),
        status=np.array([Status(value) for value in record.status], object),
        valid_until=record.valid * problem.timestep,
        unseen=tuple(getattr(plant, "hidden_states", ()) for plant in problem.plants),
        meters=record.meters.view(meters.kind[1])[:, 0] if meters else None,
    )


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
    """Values of one input without an axis of their own: (nsim, rows) instead of (nsim, rows, 1)."""
    return rows[..., 0] if rows.ndim == 3 and rows.shape[-1] == 1 else rows


def _applied(problem: Problem, u: Array) -> Array:
    """Commands within the actuator's range, as MuJoCo applies them."""
    low, high = np.stack([plant.input_limits for plant in problem.plants], axis=1)
    return np.clip(u, low[:, None], high[:, None])

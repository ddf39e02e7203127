"""The reference engine: an ordinary loop over any callable law, easy to step through."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.control_callback import refuse_foreign_callback
from grosmc_mj.simulation.inputs import written_inputs
from grosmc_mj.simulation.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.problem import Plant, Problem, Record
from grosmc_mj.simulation.quiet import warnings_counted_only
from grosmc_mj.simulation.records import pack
from grosmc_mj.simulation.runge_kutta import runge_kutta_step
from grosmc_mj.simulation.trajectory import Status

# State, step under held input and wrench (False if it diverged), and the physics state.
Stepper = tuple[Array, Callable[[Array, Array], bool], Callable[[], Array | None]]

# A state beyond this has diverged; MuJoCo's own bound.
LARGEST = mujoco.mjMAXVAL


def run_python(problem: Problem) -> Record:
    """Run every simulation of the problem, one after the other.

    Raises:
        SetupError: If somebody else's control callback is installed.
    """
    refuse_foreign_callback()
    record = Record.empty(problem)
    # A diverging run overflows quietly, as in C; its state tells.
    with np.errstate(all="ignore"), warnings_counted_only():
        for run in range(len(problem.x0)):
            _run_one(problem, run, record)
    return record


def _run_one(problem: Problem, run: int, record: Record) -> None:
    """Run one simulation and write its rows."""
    controller, system = problem.controllers[run], problem.system
    law, p = controller.law, controller.parameters
    memory, _kept_alive = controller.begin()
    x, step, physics = _stepper(problem.plants[run], problem.x0[run], problem.timestep)
    wrenches, u = problem.wrench(run), np.zeros(len(system.inputs))
    inputs = written_inputs(len(u))
    w = np.zeros(6 * len(system.bodies))
    state = physics()
    if state is not None and record.physics is None:
        record.physics = np.zeros((*record.u.shape[:2], len(state)))
        record.start = np.zeros((len(record.u), len(state)))
    if state is not None and record.start is not None:
        record.start[run] = state

    def keep(i: int) -> None:
        row = i if problem.record else 0
        record.x[run, row], record.u[run, row], record.memory[run, row] = x, u, pack(memory)
        if record.physics is not None:
            record.physics[run, row] = physics()

    for i in range(problem.steps):
        if i % problem.stride == 0:
            status = Status.COMPLETED
            if system.singular(x):
                status = Status.SINGULAR_PLANT
            else:
                t = i // problem.stride * problem.control_period
                try:
                    inputs(u, law(t, x, memory, p))
                except ArithmeticError:  # where C goes on with infinities and NaN
                    u[:] = np.nan
                except ValueError as error:
                    if "math domain" not in str(error):
                        raise
                    u[:] = np.nan
                if memory.undefined:
                    status = Status.UNDEFINED_LAW
            if status is not Status.COMPLETED:
                record.status[run], record.valid[run] = status.value, i
                return
        if wrenches is not None:
            w = wrenches[i]
        if not step(u, w):
            record.status[run], record.valid[run] = Status.DIVERGED.value, i
            return
        keep(i)


def _stepper(plant: Plant, x0: Array, h: float) -> Stepper:
    """How to move one simulation of a plant."""
    if isinstance(plant, AnalyticPlant):
        return _analytic_stepper(plant, x0, h)
    return _physics_stepper(plant, x0)


def _analytic_stepper(plant: AnalyticPlant, x0: Array, h: float) -> Stepper:
    x, scratch = x0.copy(), np.zeros((3, len(x0)))
    rk4 = runge_kutta_step(plant.system)

    def step(u: Array, w: Array) -> bool:
        try:
            rk4(x, u, w, plant.parameters, h, *scratch)
        except (ArithmeticError, ValueError):  # where C goes on with infinities and NaN
            return False
        return bool(np.all(np.abs(x) < LARGEST))

    return x, step, lambda: None


def _physics_stepper(plant: MujocoPlant, x0: Array) -> Stepper:
    model, system = plant.model, plant.system
    data, x, n = mujoco.MjData(model), x0.copy(), system.degrees_of_freedom
    data.qpos, data.qvel = x0[:n], x0[n:]
    bodies = [model.body(name).id for name in system.bodies]
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)

    def step(u: Array, w: Array) -> bool:
        data.ctrl[:] = u
        data.xfrc_applied[bodies] = w.reshape(-1, 6)
        mujoco.mj_step(model, data)
        x[:n], x[n:] = data.qpos, data.qvel
        return not np.any(data.warning.number)

    def physics() -> Array:
        state = np.zeros(size)
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        return state

    return x, step, physics

"""Loads of runs, and those among them that move nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.experiments.assumptions.audit import ROUNDING
from grosmc_mj.experiments.assumptions.balance import Loads
from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.ground.arrays import Array, as_rows
from grosmc_mj.mechanics.physics.wrenches import generalized_forces
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.reaching import matrix_vector
from grosmc_mj.theory.plants import Plant

# So many instants of a run are looked at.
_INSTANTS = 40
_COMPONENTS = tuple(f"{kind} {axis}" for kind in ("force along", "torque about") for axis in "xyz")


class Instants(NamedTuple):
    """Some instants of a run.

    Attributes:
        t: Times [s], (N,).
        x: States, (N, n).
        u: Inputs, (N, m).
    """

    t: list[float]
    x: Array
    u: Array


class Load(NamedTuple):
    """A load on a body, an input or a state's rate.

    Attributes:
        of: Name of the body, the input or the state.
        at: Instants at which it acts.
        alone: Disturbances by this load alone at these.
        column: First of its columns there.
    """

    of: str
    at: Instants
    alone: Loads
    column: int

    @property
    def wrench(self) -> Array:
        """Wrench of a load on a body, (N, 6)."""
        return self.alone.wrench[:, self.column : self.column + 6]


def some_of(rows: NDArray[np.int_]) -> NDArray[np.int_]:
    """Return at most so many of some rows of a run as are looked at, evenly."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, _INSTANTS).astype(int))]


def instants_of(run: Trajectory, rows: NDArray[np.int_]) -> Instants:
    """Return the instants of a run in these rows, (N,)."""
    inputs = as_rows(run.input)
    return Instants(run.time[rows].tolist(), run.state[rows], inputs[rows])


def loads_of(result: RunResult) -> list[Load]:
    """Return the loads that acted in a run; a disturbance of a measurement is none."""
    run = result.trajectory
    inputs = [signal.name for signal in run.system.inputs]
    states = [state.name for state in run.system.states]
    return [*wrenches_of(result), *_loads(run, "input", inputs), *_loads(run, "rate", states)]


def wrenches_of(result: RunResult) -> list[Load]:
    """Return the loads on bodies that acted in a run."""
    run = result.trajectory
    return _loads(run, "wrench", run.system.bodies, width=6)


def _loads(run: Trajectory, part: str, names: Sequence[str], width: int = 1) -> list[Load]:
    """Return the loads of a part of ``Loads`` that acted in a run.

    Args:
        run: The run.
        part: ``wrench``, ``input`` or ``rate``.
        names: Names of the bodies, inputs or states.
        width: Columns of each.
    """
    values = getattr(Loads.of_run(run, slice(None)), part)
    loads = []
    for index, name in enumerate(names):
        columns = slice(width * index, width * (index + 1))
        acting = np.flatnonzero(values[:, columns].any(axis=1))
        if len(acting):
            rows = some_of(acting)
            alone = Loads.none(run.system, len(rows))
            getattr(alone, part)[:, columns] = values[rows, columns]
            loads.append(Load(name, instants_of(run, rows), alone, columns.start))
    return loads


def idle_loads(results: Sequence[RunResult]) -> list[str]:
    """Return a line for each component of a wrench that moves nothing in any of these runs.

    Jᵀ of its body, or the disturbance in the equations, is zero for it where a run begins to feel
    the load and along the run.

    Args:
        results: Runs on one plant.
    """
    effects: dict[str, list[Array]] = {}
    wrenches: dict[str, list[Array]] = {}
    for result in results:
        for load in wrenches_of(result):
            assert result.true is not None
            effects.setdefault(load.of, []).append(_effects(result.true, load))
            wrenches.setdefault(load.of, []).append(load.wrench)

    lines = []
    for body, of_runs in effects.items():
        lines += _idle(body, np.concatenate(of_runs), np.concatenate(wrenches[body]))
    return lines


def _effects(plant: Plant, load: Load) -> Array:
    """Effect of each unit component of a load on joints or states, (N, joints or n, 6)."""
    if plant.kind == "physics":
        return generalized_forces(plant, load.of, list(load.at.x))

    effects = np.zeros((*load.at.x.shape, 6))
    disturbance = plant.system.symbolic_equations.disturbance
    for component in range(6):
        w = np.zeros(6 * len(plant.system.bodies))
        w[load.column + component] = 1.0
        for i, x in enumerate(load.at.x):
            effects[i, :, component] = disturbance(x, w, plant.parameters)
    return effects


def _idle(body: str, effects: Array, wrench: Array) -> list[str]:
    """Return the lines on a load: (N, joints, 6) of each unit component, and its wrench (N, 6)."""
    sizes = np.abs(effects)
    acting = np.abs(wrench).max(axis=0) > 0
    idle = acting & (sizes.max(axis=(0, 1)) < ROUNDING)

    # Components may also cancel, such as a force along a link that turns about its end.
    forces = np.abs(matrix_vector(effects, wrench)).max(axis=-1)
    if np.all(forces <= ROUNDING * np.abs(wrench).sum(axis=-1)):
        names = [_COMPONENTS[i] for i in np.flatnonzero(acting)]
        return [f"{_subject(names, body)} no joint: the disturbance does nothing"]

    names = [_COMPONENTS[i] for i in np.flatnonzero(idle)]
    if not names:
        return []
    return [f"{_subject(names, body)} no joint: the rest of the disturbance acts"]


def _subject(names: Sequence[str], body: str) -> str:
    """Return components of a load on a body with their verb."""
    listed = " and the ".join(names)
    return f"the {listed} on {body} {'moves' if len(names) == 1 else 'move'}"

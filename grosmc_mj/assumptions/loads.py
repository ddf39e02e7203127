"""What the disturbances of runs do: loads that move nothing, and loads that no input matches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.audit import ROUNDING, per_second
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.reaching import matrix_vector
from grosmc_mj.experiments.plants import design_variant
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.physics.hooks import warnings_counted_only
from grosmc_mj.physics.wrenches import generalized_forces
from grosmc_mj.plants import Plant

# A load is looked at so many instants of a run.
_INSTANTS = 40
# Share of a load's effect on z' up to which it is matched: MuJoCo's input matrix comes from finite
# differences, and dry friction answers to a load.
_MATCHED = 1e-3
_COMPONENTS = tuple(f"{kind} {axis}" for kind in ("force along", "torque about") for axis in "xyz")


class Load(NamedTuple):
    """A load on a body, an input or a state's rate at some instants of a run at which it acts.

    Attributes:
        of: Name of the body, the input or the rate.
        column: Its first column in the wrenches of the run.
        t: Times [s], (N,).
        x: States, (N, n).
        u: Inputs, (N, m).
        w: Wrenches of this load alone, (N, 6 * bodies).
    """

    of: str
    column: int
    t: list[float]
    x: Array
    u: Array
    w: Array

    @property
    def wrench(self) -> Array:
        """Its wrench, (N, 6)."""
        return self.w[:, self.column : self.column + 6]

    @property
    def words(self) -> str:
        """Name of what it acts on."""
        return self.of.removeprefix("rate of ")


def loads_of(result: RunResult) -> list[Load]:
    """Return the loads that acted in a run."""
    run = result.trajectory
    if run.wrench is None or not len(run.input):
        return []

    loads = []
    inputs = run.input.reshape(len(run.input), -1)
    for index, body in enumerate(run.system.bodies):
        columns = slice(6 * index, 6 * index + 6)
        acting = np.flatnonzero(run.wrench[:, columns].any(axis=1))
        if not len(acting):
            continue
        chosen = np.unique(np.linspace(0, len(acting) - 1, _INSTANTS).astype(int))
        rows = acting[chosen]
        w = np.zeros((len(rows), run.wrench.shape[1]))
        w[:, columns] = run.wrench[rows, columns]
        times = run.time[rows].tolist()
        loads.append(Load(body, columns.start, times, run.state[rows], inputs[rows], w))
    return loads


def idle_loads(results: Sequence[RunResult]) -> list[str]:
    """Return a line for each component of a load that moves nothing in any of these runs.

    Jᵀ of its body, or the disturbance in the equations, is zero for it where a run begins to feel
    the load and along the run.

    Args:
        results: Runs on one plant.
    """
    effects: dict[str, list[Array]] = {}
    wrenches: dict[str, list[Array]] = {}
    for result in results:
        for load in loads_of(result):
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
        return generalized_forces(plant, load.of, list(load.x))

    effects = np.zeros((len(load.x), load.x.shape[1], 6))
    disturbance = plant.system.equations.disturbance
    for component in range(6):
        w = np.zeros(load.w.shape[1])
        w[load.column + component] = 1.0
        for i, x in enumerate(load.x):
            effects[i, :, component] = disturbance(x, w, plant.parameters)
    return effects


def _idle(body: str, effects: Array, wrench: Array) -> list[str]:
    """Return the lines on a load: (N, joints, 6) of each unit component, and its wrench (N, 6)."""
    sizes = np.abs(effects)
    acting = np.abs(wrench).max(axis=0) > 0
    idle = acting & (sizes.max(axis=(0, 1)) < ROUNDING)

    # Components may also cancel, such as a force along a link that turns about its end.
    forces = np.abs(matrix_vector(effects, wrench)).max(axis=-1)
    scale = matrix_vector(sizes, np.abs(wrench)).max(axis=-1)
    if np.all(forces <= ROUNDING * np.maximum(scale, 1.0)):
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


def unmatched_loads(results: Sequence[RunResult]) -> list[str]:
    """Return a line for each load that the inputs cannot match in the coordinates of some laws.

    Args:
        results: Runs on one plant.
    """
    largest: dict[tuple[str, int], tuple[float, str]] = {}
    laws: dict[tuple[str, int], list[str]] = {}
    names = []
    for result in results:
        law = result.controller
        if law.design is None:
            continue
        names.append(law.name)
        for load in loads_of(result):
            value, unit = _unmatched(result, law, load)
            key = load.words, id(law.design.error)
            if value:
                largest[key] = max(largest.get(key, (0.0, unit)), (value, unit))
                laws.setdefault(key, []).append(law.name)

    lines = []
    for key, (value, unit) in largest.items():
        of_laws = ""
        if len(laws[key]) < len(names):
            of_laws = f" for {', '.join(laws[key])}"
        lines.append(
            f"the load on {key[0]} is unmatched{of_laws}: no switching term rejects it (up to "
            f"{value:.3g} {unit} in z' where no input acts)"
        )
    return lines


def _unmatched(result: RunResult, law: Controller, load: Load) -> tuple[float, str]:
    """Return the largest entry of z' by a load that no input could make, with its unit.

    It is the measure of the premise "matching": the part of z' beside the columns of the true
    plant's input matrix. Zero stands for a matched load.
    """
    true: Any = result.true
    error = law.designed.error
    if isinstance(error, ErrorCoordinates):
        true = true.analytic(design_variant(result.plant))
    true = true.rigid
    p = law.parameters

    with np.errstate(all="ignore"), warnings_counted_only():
        loaded, gain = error.error_dynamics(load.t, load.x, p, true, load.w, load.u)
        free, _ = error.error_dynamics(load.t, load.x, p, true, None, load.u)
        effect = loaded - free

    # A run that diverges has states at which nothing is a number.
    finite = np.isfinite(effect).all(axis=-1) & np.isfinite(gain).all(axis=(-2, -1))
    effect = effect[finite]
    gain = gain[finite]
    matched = matrix_vector(gain @ np.linalg.pinv(gain), effect)
    sizes = np.abs(effect - matched)

    noticeable = sizes.max(axis=-1) > _MATCHED * np.abs(effect).max(axis=-1)
    if not np.any(noticeable):
        return 0.0, ""
    sizes = sizes[noticeable]
    row = int(sizes.max(axis=0).argmax())
    return float(sizes[:, row].max()), per_second(error.units[row])

"""Signals of a run by the names that temporal formulas have for them."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from grosmc_mj.experiments.requirements.optimum import Comparison, compare_with_optimum
from grosmc_mj.ground.arrays import Array
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller

# Signals of the outputs together: the error of a single one, or the norm of several.
ERROR = "error"
DEVIATION = "deviation"
SLIDING = "s"


def named_units(law: Controller, sliding_unit: str) -> dict[str, str]:
    """Return the units of all signals by name.

    They are time, states, outputs that are no states, inputs, each error of a state or output, the
    error and the deviation from the optimum of all outputs, and the sliding variable.

    Args:
        law: A law of the plant.
        sliding_unit: Unit of s; empty for a law without one.
    """
    error = law.designed.error
    units = {"t": "s"}
    units.update(zip(error.names, error.units, strict=True))
    for signal in (*error.system.states, *error.system.inputs):
        units[signal.name] = signal.unit
    for name, unit in zip(error.names, error.units, strict=True):
        units[f"{name} error"] = unit

    output_units = {error.units[row] for row in error.output_rows}
    if len(output_units) == 1:
        units[ERROR] = output_units.pop()
        if law.designed.weighed:
            units[DEVIATION] = units[ERROR]
    if sliding_unit:
        units.update(dict.fromkeys(sliding_names(error.inputs), sliding_unit))
    return units


def references_and_errors(run: Trajectory, law: Controller) -> dict[str, tuple[str, Array]]:
    """Return unit and values (N + 1,) of each reference and of each error that a law follows."""
    error = law.designed.error
    reference = error.reference_along(run.time, law.parameters.reference)
    z = error.beside(reference, run.state, law.parameters)
    columns = {}
    for i, (name, unit) in enumerate(zip(error.names, error.units, strict=True)):
        columns[f"{name} reference"] = (unit, reference[:, i])
        columns[f"{name} error"] = (unit, z[:, i])
    return columns


def sliding_names(count: int) -> list[str]:
    """Return the names of so many sliding variables."""
    if count == 1:
        return [SLIDING]
    return [f"{SLIDING} {i + 1}" for i in range(count)]


def signals_of(
    run: Trajectory,
    law: Controller,
    names: Collection[str],
    comparison: Comparison | None = None,
) -> dict[str, Array]:
    """Return signals of a run by name, (N + 1,) each; the last input is held once more.

    Args:
        run: A recorded run; of one that ended in its first step the inputs are NaN.
        law: Its law.
        names: Names of the signals, see ``named_units``; ``t`` is always among them.
        comparison: The run beside its optimum; computed here by default.
    """
    if comparison is None:
        comparison = compare_with_optimum(run, law)
    error = law.designed.error
    states = [state.name for state in error.system.states]
    reference = error.reference_along(run.time, law.parameters.reference)

    signals = {"t": run.time, ERROR: comparison.error, DEVIATION: comparison.deviation}
    for i, name in enumerate(error.names):
        signals[f"{name} error"] = comparison.z[:, i]
        signals[name] = reference[:, i] + error.sign * comparison.z[:, i]
    for i, name in enumerate(states):
        signals[name] = run.state[:, i]

    held: dict[str, Array] = {}
    steps = len(run.time) - 1
    inputs = run.applied.reshape(steps, len(error.system.inputs))
    for i, signal in enumerate(error.system.inputs):
        held[signal.name] = inputs[:, i]
    if run.sliding is not None:
        variables = run.sliding.shape[1] if run.sliding.ndim > 1 else 1
        sliding = run.sliding.reshape(steps, variables)
        for i, name in enumerate(sliding_names(sliding.shape[1])):
            held[name] = sliding[:, i]
    for name, values in held.items():
        last = values[-1] if steps else np.nan
        signals[name] = np.append(values, last)
    return {name: signals[name] for name in ("t", *names)}

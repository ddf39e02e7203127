"""A run beside the optimum that its law was designed for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError
from grosmc_mj.simulation.trajectory import Trajectory


class Comparison(NamedTuple):
    """A run beside the optimum that its law was designed for.

    Attributes:
        time: Instants [s], (N + 1,).
        z: Error state of the run, (N + 1, n).
        optimal: x* or z* of eqs. (7), (30) and (50) from the same start, (N + 1, n).
        outputs: Columns of z that are outputs' errors; the others are their derivatives.
        reference: y_r in the outputs' own coordinates, (N + 1, m).
        optimum: The outputs on the optimal trajectory, (N + 1, m).
    """

    time: Array
    z: Array
    optimal: Array
    outputs: tuple[int, ...]
    reference: Array
    optimum: Array

    @property
    def error(self) -> Array:
        """The output's error or, of several outputs, the norm of their errors, (N + 1,)."""
        return _size(self.z[:, self.outputs])

    @property
    def deviation(self) -> Array:
        """The same of the distance from the optimal trajectory, (N + 1,)."""
        return _size((self.z - self.optimal)[:, self.outputs])


def _size(rows: Array) -> Array:
    """A single column as it is, or the norms of the rows."""
    return rows[:, 0] if rows.shape[1] == 1 else np.linalg.norm(rows, axis=1)


def compare_with_optimum(run: Trajectory, controller: Controller) -> Comparison:
    """The error state of a run and its nominal optimal trajectory, exact by matrix exponential.

    Raises:
        ArgumentError: If the controller follows no optimum.
    """
    if controller.error is None or controller.lqr is None:
        raise ArgumentError(f"{controller.name} has no error coordinates or no optimum")
    error, p = controller.error, controller.parameters
    z = error.along(run.time, run.state, p)
    optimal = controller.lqr.optimal_trajectory(z[0], run.time)
    reference = error.reference_along(run.time, p.reference)
    outputs = error.output_rows
    optimum = reference + error.sign * optimal
    return Comparison(run.time, z, optimal, outputs, reference[:, outputs], optimum[:, outputs])

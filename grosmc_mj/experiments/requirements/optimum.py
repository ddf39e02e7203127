"""A recorded run beside the optimum that its law was designed for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller


class Comparison(NamedTuple):
    """A run beside the optimum that its law was designed for.

    Attributes:
        time: Instants [s], (N + 1,).
        z: Error state of the run, (N + 1, n).
        optimal: x* or z* of eqs. (7), (30) and (50) from the same start, (N + 1, n).
        outputs: Columns of z that are errors of outputs; the others are their derivatives.
        reference: y_r in the outputs' own coordinates, (N + 1, m).
        optimum: Outputs on the optimal trajectory, (N + 1, m).
    """

    time: Array
    z: Array
    optimal: Array
    outputs: tuple[int, ...]
    reference: Array
    optimum: Array

    @property
    def error(self) -> Array:
        """Error of a single output, or the norm of several, (N + 1,)."""
        return _size(self.z[:, self.outputs])

    @property
    def deviation(self) -> Array:
        """Distance of the outputs from the optimal trajectory, (N + 1,)."""
        return _size((self.z - self.optimal)[:, self.outputs])


def _size(rows: Array) -> Array:
    """Return a single column as it is, else the norms of the rows."""
    if rows.shape[1] == 1:
        return rows[:, 0]
    return np.linalg.norm(rows, axis=1)


def compare_with_optimum(run: Trajectory, controller: Controller) -> Comparison:
    """Return the error state of a run beside the nominal optimum, by matrix exponential.

    Raises:
        ArgumentError: If the controller follows no optimum.
    """
    error = controller.designed.error
    p = controller.parameters
    reference = error.reference_along(run.time, p.reference)
    z = error.beside(reference, run.state, p)
    optimal = controller.designed.lqr.optimal_trajectory(z[0], run.time)
    optimum = reference + error.sign * optimal

    outputs = error.output_rows
    return Comparison(run.time, z, optimal, outputs, reference[:, outputs], optimum[:, outputs])

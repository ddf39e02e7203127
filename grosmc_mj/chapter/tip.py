"""The tip of the two-link arm, by the plant's own lengths."""

from __future__ import annotations

from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.ground.arrays import Array
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates


def true_tip(result: RunResult) -> Array:
    """Return the true path of the tip, by the plant's own lengths.

    Returns:
        (x, z) from the shoulder [m], (N, 2).
    """
    error = result.controller.designed.error
    assert isinstance(error, ErrorCoordinates)
    z = error.outputs_along(result.trajectory.state, result.true.parameters)
    return z[:, error.output_rows]

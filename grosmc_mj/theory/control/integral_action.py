"""Linear feedback with integrals of the outputs' errors."""

from __future__ import annotations

from functools import partial

import numpy as np
import scipy

from grosmc_mj.ground.arrays import Array
from grosmc_mj.theory.control.controller import Controller, named_gains
from grosmc_mj.theory.control.dynamic_feedback import (
    Dynamics,
    dynamic_controller,
)
from grosmc_mj.theory.control.lqr import LqrDesign
from grosmc_mj.theory.control.task import Task


def integrating_controller(
    name: str,
    task: Task,
    optimum: LqrDesign,
    *,
    K: Array,
    H: Array,
    limit: float,
    source: str,
    linearizing: bool,
) -> Controller:
    """Return the controller with v = -(K z + H xi), xi' = e.

    Args:
        name: Name of the law.
        task: The task.
        optimum: The optimum that its runs are compared with.
        K: Gain of the error state, (m, n).
        H: Gain of the integrals, (m, m).
        limit: Largest |u|, in the unit of the input; infinite for none.
        source: Source of the law in the literature.
        linearizing: Whether through feedback linearization.
    """
    return dynamic_controller(
        name,
        task,
        optimum,
        partial(integrals, optimum, output_matrix(task), K, H),
        linearizing=linearizing,
        holds=True,
        gains=named_gains(K=K, Ki=H),
        limit=limit,
        source=source,
    )


def integrals(
    optimum: LqrDesign,
    C: Array,
    K: Array,
    H: Array,
    period: float,
) -> Dynamics:
    """Integrals of C z over each period, exact for z' = A z.

    They do not count the input's part: where the input makes up for a load they would take it for
    a motion, and keep an error of the order of the load times the period squared.

    Args:
        optimum: Design with A, (n, n).
        C: Matrix of the integrand C z, (m, n).
        K: Gain of z, (m, n).
        H: Gain of the integrals, (m, m).
        period: Control period [s].
    """
    n, m = optimum.B.shape
    # States are the integrals, then z.
    system = np.block([[np.zeros((m, m)), C], [np.zeros((n, m)), optimum.A]])
    transition = scipy.linalg.expm(system * period)
    F, G = np.split(transition[:m], [m], axis=1)
    L = np.zeros((m, m))
    start = np.zeros((m, n))
    return Dynamics(K, H, F, G, L, start)


def output_matrix(task: Task) -> Array:
    """C of e = C z, the outputs' errors, (m, n)."""
    return np.eye(task.error.size)[list(task.error.output_rows)]

"""LQR with integral action, and computed-torque PID: laws that integrate the outputs' errors."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, Any

import numpy as np
import scipy.linalg

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GainError
from grosmc_mj.ground.fields import Positive, Range, checked_call
from grosmc_mj.theory.control.controller import Controller, named_gains
from grosmc_mj.theory.control.lqr import LqrDesign, lqr
from grosmc_mj.theory.control.rivals.dynamic_feedback import (
    Dynamics,
    dynamic_controller,
    input_rows,
)
from grosmc_mj.theory.control.task import Limit, Task

# Beyond this the powers of a frequency overflow.
_MOST = 1e50


@checked_call
def lqi(
    task: Task,
    integral_weight: Positive,
    limit: Limit = math.inf,
    *,
    linearizing: bool = True,
) -> Controller:
    """LQR with integral action, through feedback linearization.

    The optimum of z'Qz + v'Rv + q_i |xi|^2 with xi' = e, the outputs' errors: the LQ regulator on
    the plant augmented by integrators (P. C. Young and J. C. Willems, "An approach to the linear
    multivariable servomechanism problem", International Journal of Control 15(5), 1972).

    Args:
        task: The task.
        integral_weight: q_i, the weight of each output's integral, in 1/s^2 of that of the output.
        limit: Largest |u|, in the unit of the input: the integrals hold while an input is beyond.
        linearizing: Whether through feedback linearization; else on the plant's linearization
            about zero error.

    Raises:
        ArgumentError: If a number is not positive.
        GainError: If there is no optimum or, on the linearization, zero error is no equilibrium
            without input.
    """
    optimum = task.optimum(linearizing=linearizing)
    n, m = optimum.B.shape

    # The plant with the integrals as further states.
    A = np.block([[optimum.A, np.zeros((n, m))], [_output_matrix(task), np.zeros((m, m))]])
    B = np.vstack([optimum.B, np.zeros((m, m))])
    Q: Any = scipy.linalg.block_diag(optimum.Q, integral_weight * np.eye(m))
    gain = lqr(A, B, Q, optimum.R).K

    return _integrating(
        "lqi",
        task,
        optimum,
        K=gain[:, :n],
        H=gain[:, n:],
        limit=limit,
        source="Young and Willems 1972",
        linearizing=linearizing,
    )


@checked_call
def fl_pid(
    task: Task,
    frequency: Annotated[float, Range(0, _MOST, "rad/s", above=True)],
    limit: Limit = math.inf,
    *,
    linearizing: bool = True,
) -> Controller:
    """PID through feedback linearization, with three poles at one place for every output.

    v = -3 w^2 e - w^3 xi - 3 w e' with xi' = e, so that (s + w)^3 is what the nominal error obeys:
    computed-torque PID (J. J. Craig, "Introduction to Robotics", 3rd ed., section 10.7; F. L.
    Lewis, D. M. Dawson and C. T. Abdallah, "Robot Manipulator Control", 2nd ed., section 4.4).
    The rate e' is the measured one, as all laws here have it.

    Args:
        task: The task; every output must have relative degree two.
        frequency: w [rad/s].
        limit: Largest |u|, in the unit of the input: the integrals hold while an input is beyond.
        linearizing: Whether through feedback linearization; else on the plant's linearization
            about zero error.

    Raises:
        ArgumentError: If a number is not positive.
        GainError: If an output has another relative degree or, on the linearization, zero error is
            no equilibrium without input.
    """
    optimum = task.optimum(linearizing=linearizing)
    chains = task.outputs.linearization
    if set(chains.relative_degree) != {2}:
        raise GainError(f"PID: the relative degrees {chains.relative_degree} must all be 2")

    a, E = input_rows(task, optimum)
    identity = np.eye(task.error.inputs)
    gains_of_output = [[3 * frequency**2, 3 * frequency]]
    gain_of_error = np.kron(identity, gains_of_output)
    return _integrating(
        "fl-pid",
        task,
        optimum,
        K=np.linalg.solve(E, gain_of_error + a),
        H=np.linalg.solve(E, frequency**3 * identity),
        limit=limit,
        source="computed-torque PID, Craig",
        linearizing=linearizing,
    )


def _integrating(
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
    """Controller with v = -(K z + H xi)."""
    return dynamic_controller(
        name,
        task,
        optimum,
        partial(integrals, optimum, _output_matrix(task), K, H),
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


def _output_matrix(task: Task) -> Array:
    """C of e = C z, the outputs' errors, (m, n)."""
    return np.eye(task.error.size)[list(task.error.output_rows)]

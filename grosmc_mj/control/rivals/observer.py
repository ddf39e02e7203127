"""Active disturbance rejection: the optimal law less what an extended state observer estimates."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import scipy.linalg

from grosmc_mj.control.controller import Controller, named_gains
from grosmc_mj.control.rivals.dynamic_feedback import Dynamics, dynamic_controller
from grosmc_mj.control.task import Limit, Task
from grosmc_mj.fields import Range, checked_call


@checked_call
def adrc(
    task: Task,
    bandwidth: Annotated[float, Range(0, unit="rad/s", above=True)],
    limit: Limit = math.inf,
    *,
    linearizing: bool = True,
) -> Controller:
    """Linear active disturbance rejection, through feedback linearization.

    v = -K z - d, with the gain K of the nominal optimum and the estimate d of all that
    z_i^(r_i) = v_i + d_i is off by, from a linear extended state observer of the output alone with
    all poles at -w_o: Z. Gao, "Scaling and bandwidth-parameterization based controller tuning",
    American Control Conference, 2003. It is sampled as in R. Miklosovic, A. Radke and Z. Gao,
    "Discrete implementation and generalization of the extended state observer", American Control
    Conference, 2006: exact for a held input, all poles at exp(-w_o T), estimates of the present
    sample. It begins at the measured errors, so nominally the closed loop is the optimum.

    Args:
        task: What is designed for.
        bandwidth: w_o [rad/s].
        limit: Largest |u|, in the unit of the input: beyond it the observer is told what is left.
        linearizing: Whether through feedback linearization; else on the plant's linearization
            about zero error.

    Raises:
        ArgumentError: If a number is not positive.
        GainError: If, on the linearization, zero error is no equilibrium without input.
    """
    optimum, chains = task.optimum(linearizing=linearizing), task.outputs.linearization
    # z_i^(r_i) = a_i z + (E u + d)_i: nothing and the identity after feedback linearization.
    a, E = (matrix[list(chains.last_rows)] for matrix in (optimum.A, optimum.B))

    def sampled(period: float) -> Dynamics:
        d = observer(chains.relative_degree, bandwidth, period)
        K, H = optimum.K + np.linalg.solve(E, d.K), np.linalg.solve(E, d.H)
        return replace(d, K=K, H=H, G=d.G + d.L @ a, L=d.L @ E)

    return dynamic_controller(
        "adrc",
        task,
        optimum,
        sampled,
        linearizing=linearizing,
        holds=False,
        gains=named_gains(K=optimum.K) | {"bandwidth": bandwidth},
        limit=limit,
        source="Gao 2003",
    )


def observer(degrees: tuple[int, ...], bandwidth: float, period: float) -> Dynamics:
    """Discrete extended state observer of chains z_i^(r_i) = v_i + d_i.

    Its state q is z and the d of each chain; it sees the outputs' errors alone, and begins without
    a disturbance.

    Args:
        degrees: r_i.
        bandwidth: w_o [rad/s].
        period: T [s].

    Returns:
        Its matrices, where K z + H q is the estimate of d.
    """
    chains = [_chain(degree, bandwidth, period) for degree in degrees]
    block: Any = scipy.linalg.block_diag
    rows = zip(*(vars(chain).values() for chain in chains), strict=True)
    return Dynamics(*(block(*matrices) for matrices in rows))


def _chain(degree: int, bandwidth: float, period: float) -> Dynamics:
    """The observer of one chain, [e, e' ..., d].

    q-hat = q + l (e - q_1) is the estimate of this sample, and q+ = Phi q-hat + Gamma v.
    """
    size = degree + 1
    scale = period ** np.arange(size)  # of the states, to those of a period of one
    Phi = scipy.linalg.expm(np.eye(size, k=1))
    # Ackermann: Phi - (Phi l) C has all its poles at exp(-w_o T).
    outputs = np.array([np.linalg.matrix_power(Phi, power)[0] for power in range(size)])
    shifted = Phi - math.exp(-bandwidth * period) * np.eye(size)
    gain = np.linalg.matrix_power(shifted, size) @ np.linalg.solve(outputs, np.eye(size)[:, -1])
    present = np.linalg.solve(Phi, gain) / scale
    Phi = Phi * scale[None, :] / scale[:, None]
    correction, of_output = np.eye(size), np.zeros((size, degree))
    correction[:, 0] -= present
    of_output[:, 0] = present
    # Without the disturbance's own column: v drives what d drives.
    Gamma = Phi[:, -1:] - np.eye(size)[:, -1:]
    return Dynamics(
        K=of_output[-1:],
        H=correction[-1:],
        F=Phi @ correction,
        G=Phi @ of_output,
        L=Gamma,
        start=np.eye(size)[:, :degree],
    )

"""Active disturbance rejection: the optimal law less what an extended state observer estimates."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np
import scipy.linalg

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, named_gains
from grosmc_mj.control.lqr import LqrDesign
from grosmc_mj.control.rivals.dynamic_feedback import Dynamics, dynamic_controller
from grosmc_mj.control.task import Limit, OutputTask
from grosmc_mj.fields import Range, checked_call


class Observer(NamedTuple):
    """A discrete extended state observer of m chains; its state is z and each chain's d.

    Attributes:
        F: What its state becomes of itself, (N, N).
        G: What it becomes of z, of which it sees the outputs' errors alone, (N, n).
        L: What it becomes of v, (N, m).
        of_state: d-hat by its state, (m, N).
        of_error: d-hat by z, (m, n).
        start: Its state as a run begins, by z: without a disturbance, (N, n).
    """

    F: Array
    G: Array
    L: Array
    of_state: Array
    of_error: Array
    start: Array


@checked_call
def adrc(
    task: OutputTask,
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
    optimum, chains = task.optimum(linearizing=linearizing), task.error.linearization
    at = partial(_dynamics, optimum, chains.relative_degree, list(chains.last_rows), bandwidth)
    return dynamic_controller(
        "adrc",
        task,
        optimum,
        at,
        linearizing=linearizing,
        holds=False,
        gains=named_gains(K=optimum.K) | {"bandwidth": bandwidth},
        limit=limit,
        source="Gao 2003",
    )


def _dynamics(
    optimum: LqrDesign, degrees: tuple[int, ...], rows: list[int], bandwidth: float, period: float
) -> Dynamics:
    """The law's matrices: u = -K z - E^-1 d, and z_i^(r_i) = a_i z + (E u + d)_i.

    After feedback linearization a is nothing and E the identity.
    """
    seen, (a, E) = observer(degrees, bandwidth, period), (optimum.A[rows], optimum.B[rows])
    return Dynamics(
        K=optimum.K + np.linalg.solve(E, seen.of_error),
        H=np.linalg.solve(E, seen.of_state),
        F=seen.F,
        G=seen.G + seen.L @ a,
        L=seen.L @ E,
        start=seen.start,
    )


def observer(degrees: tuple[int, ...], bandwidth: float, period: float) -> Observer:
    """The observer of chains with these relative degrees.

    Args:
        degrees: r_i of z_i^(r_i) = v_i + d_i.
        bandwidth: w_o [rad/s].
        period: T [s].
    """
    block = scipy.linalg.block_diag
    each = [_chain(degree, bandwidth, period) for degree in degrees]
    return Observer(*(np.asarray(block(*parts), float) for parts in zip(*each, strict=True)))


def _chain(degree: int, bandwidth: float, period: float) -> Observer:
    """The observer of one chain, [e, e' ..., d].

    q-hat = q + l (e - q_1) is the estimate of this sample, and q+ = Phi q-hat + Gamma v.
    """
    size = degree + 1
    scale = period ** np.arange(size)  # of the states, to those of a period of one
    Phi = scipy.linalg.expm(np.eye(size, k=1))
    # Ackermann: Phi - (Phi l) C has all its poles at exp(-w_o T).
    seen = np.array([np.linalg.matrix_power(Phi, power)[0] for power in range(size)])
    shifted = Phi - math.exp(-bandwidth * period) * np.eye(size)
    gain = np.linalg.matrix_power(shifted, size) @ np.linalg.solve(seen, np.eye(size)[:, -1])
    present = np.linalg.solve(Phi, gain)
    Phi, present = Phi * scale[None, :] / scale[:, None], present / scale
    correction = np.eye(size)
    correction[:, 0] -= present
    of_output = np.zeros((size, degree))
    of_output[:, 0] = present
    # Without the disturbance's own column: v drives what d drives.
    Gamma = Phi[:, -1:] - np.eye(size)[:, -1:]
    return Observer(
        F=Phi @ correction,
        G=Phi @ of_output,
        L=Gamma,
        of_state=correction[-1:],
        of_error=of_output[-1:],
        start=np.eye(size)[:, :degree],
    )

"""Active disturbance rejection: the optimal law less what an extended state observer estimates."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Annotated, Any

import numpy as np
import scipy

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.fields import checked
from grosmc_mj.theory.control.controller import Controller, named_gains
from grosmc_mj.theory.control.dynamic_feedback import (
    Dynamics,
    dynamic_controller,
    input_rows,
)
from grosmc_mj.theory.control.kinds.kind import OF_EQUATIONS, OF_OUTPUTS, LawKind
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.lqr import LqrDesign
from grosmc_mj.theory.control.task import Limit, Task


@checked()
class Adrc(LawKind):
    """Linear active disturbance rejection, through feedback linearization.

    v = -K z - d, with the gain K of the nominal optimum and the estimate d of the disturbance in
    z_i^(r_i) = v_i + d_i, from a linear extended state observer of the output alone with all poles
    at -w_o: Z. Gao, "Scaling and bandwidth-parameterization based controller tuning",
    American Control Conference, 2003. It is sampled as in R. Miklosovic, A. Radke and Z. Gao,
    "Discrete implementation and generalization of the extended state observer", American Control
    Conference, 2006: exact for a held input, all poles at exp(-w_o T), estimates of the present
    sample. It begins at the measured errors, so nominally the closed loop is the optimum. The
    observer gets the input within its limit.
    """

    key = "adrc"
    where = OF_OUTPUTS

    bandwidth: Annotated[
        float,
        LawNumber(
            low=0,
            unit="rad/s",
            above=True,
            meaning="bandwidth w_o of the observer",
            search=(1, 1000),
        ),
    ]
    limit: Limit = math.inf

    def design(self, task: Task) -> Controller:
        """Return the law for a task.

        Raises:
            GainError: If, on the linearization, zero error is no equilibrium without input.
        """
        optimum = task.optimum(linearizing=self.linearizing)
        return dynamic_controller(
            "adrc",
            task,
            optimum,
            # A function of the period, which only a run knows.
            partial(_sampled, task, optimum, self.bandwidth),
            linearizing=self.linearizing,
            holds=False,
            gains=named_gains(K=optimum.K) | {"bandwidth": self.bandwidth},
            limit=self.limit,
            source="Gao 2003",
        )


@checked()
class LinearAdrc(Adrc):
    """Linear active disturbance rejection on the plant's linearization about zero error."""

    key = "linear-adrc"
    where = OF_EQUATIONS
    linearizing = False


def _sampled(task: Task, optimum: LqrDesign, bandwidth: float, period: float) -> Dynamics:
    """Return the law's matrices for a control period [s]."""
    degrees = task.outputs.linearization.relative_degree
    a, E = input_rows(task, optimum)
    d = observer(degrees, bandwidth, period)
    return replace(
        d,
        K=optimum.K + np.linalg.solve(E, d.K),
        H=np.linalg.solve(E, d.H),
        G=d.G + d.L @ a,
        L=d.L @ E,
    )


def observer(degrees: tuple[int, ...], bandwidth: float, period: float) -> Dynamics:
    """Discrete extended state observer of chains z_i^(r_i) = v_i + d_i.

    Its state q is z and the d of each chain. It sees the outputs' errors only, and begins without
    a disturbance.

    Args:
        degrees: r_i.
        bandwidth: w_o [rad/s].
        period: T [s].

    Returns:
        Its matrices, where K z + H q is the estimate of d.
    """
    chains = [_chain_observer(degree, bandwidth, period) for degree in degrees]
    block_diagonal: Any = scipy.linalg.block_diag
    return Dynamics(
        K=block_diagonal(*(chain.K for chain in chains)),
        H=block_diagonal(*(chain.H for chain in chains)),
        F=block_diagonal(*(chain.F for chain in chains)),
        G=block_diagonal(*(chain.G for chain in chains)),
        L=block_diagonal(*(chain.L for chain in chains)),
        start=block_diagonal(*(chain.start for chain in chains)),
    )


def _chain_observer(degree: int, bandwidth: float, period: float) -> Dynamics:
    """Observer of a single chain, with the state [e, e' ..., d].

    q-hat = q + l (e - q_1) is the estimate of this sample, and q+ = Phi q-hat + Gamma v.
    """
    size = degree + 1
    identity = np.eye(size)
    # The gain is computed for a period of one, where all numbers are of the same size.
    scale = period ** np.arange(size)
    Phi = scipy.linalg.expm(np.eye(size, k=1))
    l = _gain_for_pole(Phi, math.exp(-bandwidth * period)) / scale
    Phi = Phi * scale[None, :] / scale[:, None]

    # q-hat = correction q + of_output z.
    correction = np.eye(size)
    correction[:, 0] -= l
    of_output = np.zeros((size, degree))
    of_output[:, 0] = l
    # v drives the chain as d does, but d does not change by it.
    Gamma = Phi[:, -1:] - identity[:, -1:]
    return Dynamics(
        K=of_output[-1:],
        H=correction[-1:],
        F=Phi @ correction,
        G=Phi @ of_output,
        L=Gamma,
        start=identity[:, :degree],
    )


def _gain_for_pole(Phi: Array, pole: float) -> Array:
    """l with which Phi - (Phi l) C has all its poles at this place, by Ackermann's formula.

    C is the first row of the identity.
    """
    size = len(Phi)
    identity = np.eye(size)
    powers = [np.linalg.matrix_power(Phi, power) for power in range(size)]
    observability = np.array([power[0] for power in powers])
    characteristic = np.linalg.matrix_power(Phi - pole * identity, size)
    gain = characteristic @ np.linalg.solve(observability, identity[:, -1])
    return np.linalg.solve(Phi, gain)

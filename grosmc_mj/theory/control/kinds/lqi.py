"""LQR with integral action."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
import scipy

from grosmc_mj.ground.fields import checked
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.integral_action import integrating_controller, output_matrix
from grosmc_mj.theory.control.kinds.kind import OF_EQUATIONS, OF_OUTPUTS, LawKind
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.lqr import lqr
from grosmc_mj.theory.control.task import Limit, Task


@checked()
class Lqi(LawKind):
    """LQR with integral action, through feedback linearization.

    The optimum of z'Qz + v'Rv + q_i |xi|^2 with xi' = e, the outputs' errors: the LQ regulator on
    the plant augmented by integrators (P. C. Young and J. C. Willems, "An approach to the linear
    multivariable servomechanism problem", International Journal of Control 15(5), 1972). The
    integrals hold while an input is beyond its limit.
    """

    key = "lqi"
    where = OF_OUTPUTS

    integral_weight: Annotated[
        float,
        LawNumber(
            low=0,
            above=True,
            meaning="weight q_i of each output's integral, in 1/s^2 of that of the output",
            search=(1e-3, 1e5),
        ),
    ]
    limit: Limit = math.inf

    def design(self, task: Task) -> Controller:
        """Return the law for a task.

        Raises:
            GainError: If there is no optimum or, on the linearization, zero error is no
                equilibrium without input.
        """
        optimum = task.optimum(linearizing=self.linearizing)
        n, m = optimum.B.shape

        # The plant with the integrals as further states.
        A = np.block([[optimum.A, np.zeros((n, m))], [output_matrix(task), np.zeros((m, m))]])
        B = np.vstack([optimum.B, np.zeros((m, m))])
        Q: Any = scipy.linalg.block_diag(optimum.Q, self.integral_weight * np.eye(m))
        gain = lqr(A, B, Q, optimum.R).K

        return integrating_controller(
            "lqi",
            task,
            optimum,
            K=gain[:, :n],
            H=gain[:, n:],
            limit=self.limit,
            source="Young and Willems 1972",
            linearizing=self.linearizing,
        )


@checked()
class LinearLqi(Lqi):
    """LQR with integral action on the plant's linearization about zero error."""

    key = "linear-lqi"
    where = OF_EQUATIONS
    linearizing = False

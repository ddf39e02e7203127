"""The chapter's index as a reward: what it weighs, and its stage cost."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.matrices import quadratic


class Index:
    """J = 1/2 ∫ z'Qz + v'Rv dt of eqs. (13), (27) and (48).

    v is u, about its operating point, for a law on the plant's linear model, and alpha + E u of
    eqs. (23) and (44) after feedback linearization.

    Args:
        law: A controller with error coordinates and the optimum that it was designed for.
    """

    def __init__(self, law: Controller) -> None:
        self._law, self._design = law, law.designed

    def defined(self, x: Array) -> bool:
        """Whether a state is in the region that the index is defined in."""
        design = self._design
        return not design.linearizing or bool(design.error.system.linearizable(x))

    def weighed(self, t: float, x: Array, u: ArrayLike) -> Array:
        """v, (m,).

        Args:
            t: Time [s].
            x: State, (n,).
            u: Input, (m,).
        """
        u = np.atleast_1d(np.asarray(u, float))
        if isinstance(self._design.error, StateCoordinates):
            return u - self._law.parameters.reference.u
        if not self._design.linearizing:
            return u
        alpha, E = self._law.coordinates.dynamics(t, x, self._law.parameters)
        return alpha + E @ u

    def stage_cost(self, t: float, x: Array, u: ArrayLike) -> float:
        """1/2 (z'Qz + v'Rv), in the index's unit per second."""
        error, optimum = self._design.error, self._design.lqr
        z, v = error.error_state(t, x, self._law.parameters), self.weighed(t, x, u)
        return float(0.5 * (quadratic(z, optimum.Q) + quadratic(v, optimum.R)))

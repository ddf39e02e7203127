"""The error state that a law regulates, and how the input moves it: eqs. (17), (24) and (45)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import scipy.differentiate
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.references import ReferenceFunction
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import System

Pair = tuple[float, float]


@dataclass(frozen=True)
class ErrorCoordinates:
    """z = sign * [y - y_r, y' - y_r'] for an output of relative degree two.

    It is the chapter's x for the servo (sign -1: theta_d - theta, eq. (17)), its z = T(x) for
    the pendulum (y_r = 0, eq. (22)) and its e for the arm (eq. (45)).

    Attributes:
        system: The plant's equations.
        reference: y_r(t) and its derivatives, from ``p.reference``.
        sign: +1 for y - y_r, -1 for y_r - y.
    """

    system: System
    reference: ReferenceFunction
    sign: Literal[1, -1] = 1

    @cached_property
    def state(self) -> Callable[[float, Any, Any], Pair]:
        """Jitable (t, x, p) -> z."""
        reference, sign = self.reference, float(self.sign)
        position = self.system.output
        velocity = position + self.system.degrees_of_freedom

        @jitable
        def error_state(t: float, x: Any, p: Any) -> Pair:
            y_r, dy_r, _ = reference(t, p.reference)
            return (sign * (x[position] - y_r), sign * (x[velocity] - dy_r))

        return error_state

    @cached_property
    def dynamics(self) -> Callable[[float, Any, Any], Pair]:
        """Jitable (t, x, p) -> (alpha, E) of z1'' = alpha + E u, by the nominal ``p.plant``.

        alpha is L_f^2 h - y_r'' and E the decoupling matrix L_g L_f h of eqs. (23) and (44).
        """
        system, reference, sign = self.system, self.reference, float(self.sign)
        drift, input_matrix = system.drift, system.input_matrix
        velocity = system.output + system.degrees_of_freedom

        @jitable
        def error_dynamics(t: float, x: Any, p: Any) -> Pair:
            _, _, ddy_r = reference(t, p.reference)
            alpha = sign * (drift(x, p.plant)[velocity] - ddy_r)
            return (alpha, sign * input_matrix(x, p.plant)[velocity])

        return error_dynamics

    def along(self, time: ArrayLike, x: ArrayLike, reference_parameters: Any) -> Array:
        """z at every sample of a trajectory: time (N,), x (N, n); returns (N, 2)."""
        x = np.asarray(x, float)
        position = self.system.output
        velocity = position + self.system.degrees_of_freedom
        y_r = np.array([self.reference(t, reference_parameters) for t in np.asarray(time, float)])
        return self.sign * (x[:, [position, velocity]] - y_r[:, :2])

    def jacobian(self, parameters: Any) -> tuple[Array, Array]:
        """(A, B) of the linearization of z' about z = 0 with the other coordinates at rest.

        Args:
            parameters: With ``plant`` and ``reference``, as the laws have them.

        Returns:
            A (2, 2) and B (2, 1).
        """
        n, position = len(self.system.states), self.system.output
        velocity = position + self.system.degrees_of_freedom
        y_r, dy_r, _ = self.reference(0.0, parameters.reference)

        def rate(zu: Array) -> Array:
            """z1'' at columns of (z1, z2, u)."""

            def one(z1: float, z2: float, u: float) -> float:
                x = np.zeros(n)
                x[position], x[velocity] = y_r + self.sign * z1, dy_r + self.sign * z2
                alpha, E = self.dynamics(0.0, x, parameters)
                return alpha + E * u

            return np.vectorize(one)(*zu)[None]

        slopes = scipy.differentiate.jacobian(rate, np.zeros(3)).df[0]
        return np.array([[0.0, 1.0], slopes[:2]]), np.array([[0.0], slopes[2:]])

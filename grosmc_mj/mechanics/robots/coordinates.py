"""Joint errors of a robot as the state of a law, by the dynamics of its nominal links."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.mechanics.physics.mjdata import forward
from grosmc_mj.mechanics.robots.nominal import bias, gears, inertia
from grosmc_mj.mechanics.robots.rigid_bodies import forward_dynamics, inverse_dynamics
from grosmc_mj.theory.control.coordinates.base import Chains, InputMap, OutputCoordinates, StateMap
from grosmc_mj.theory.control.coordinates.design_model import Advance, DesignModel
from grosmc_mj.theory.control.lqr import LqrDesign
from grosmc_mj.theory.plants import Plant


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotCoordinates(OutputCoordinates):
    """z = sign * (q - y_r, q' - y_r') of all joints, joint by joint.

    In the terms of eqs. (43)-(46) every joint has relative degree 2, E = M(q)^-1 gear and K is
    M^-1 (passive - h): the inverse of the decoupling matrix is the inertia matrix over the gears
    of the inputs, and never singular. The feedback (44) is the computed torque.

    Attributes:
        model: The nominal model in MuJoCo, of the same links, for whole trajectories.
    """

    model: mujoco.MjModel

    @cached_property
    def linearization(self) -> Chains:
        """Two integrators for each joint."""
        return Chains((2,) * self.inputs)

    @property
    def output_units(self) -> tuple[str, ...]:
        """Unit of each joint's position."""
        return tuple(signal.unit for signal in self.system.positions)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints' states, joint by joint."""
        return tuple(self.system.states[index].name for index in self._order)

    @property
    def _order(self) -> tuple[int, ...]:
        """Index in the state x of each entry of z: q_1, q_1', q_2, ..."""
        n = self.inputs
        order: list[int] = []
        for joint in range(n):
            order += [joint, joint + n]
        return tuple(order)

    # Each function is made once for the coordinates: a law is compiled again for each new one.
    @cached_property
    def state(self) -> StateMap:
        """Jitable (t, x, p, z): write z."""
        reference = self.reference
        sign = float(self.sign)
        joints = self.inputs

        # Nested here and below, for numba takes these as constants. Of each joint the reference
        # gives position, rate and acceleration.
        def error_state(t: float, x: Any, p: Any, z: Any) -> None:
            y_r = reference(t, p.reference)
            for i in range(joints):
                z[2 * i] = sign * (x[i] - y_r[3 * i])
                z[2 * i + 1] = sign * (x[joints + i] - y_r[3 * i + 1])

        return jitable(error_state)

    @cached_property
    def accelerations(self) -> Callable[[float, Any, Any, Any], None]:
        """Jitable (t, v, p, a): a = sign v + y_r'', (n,); a may be v."""
        reference = self.reference
        sign = float(self.sign)

        def accelerations(t: float, v: Any, p: Any, a: Any) -> None:
            y_r = reference(t, p.reference)
            for i in range(len(a)):
                a[i] = sign * v[i] + y_r[3 * i + 2]

        return jitable(accelerations)

    @cached_property
    def feedback(self) -> InputMap:
        """Jitable (t, x, v, memory, p, u): gear u = M(q) (sign v + y_r'') + h(q, q') - passive.

        It is defined everywhere.
        """
        accelerations = self.accelerations

        def feedback(t: float, x: Any, v: Any, memory: Any, p: Any, u: Any) -> None:
            accelerations(t, v, p, u)
            inverse_dynamics(p.plant, x, u, u)

        return jitable(feedback)

    @cached_property
    def virtual_input(self) -> InputMap:
        """Jitable (t, x, u, memory, p, v): v = sign (M^-1 (gear u - h + passive) - y_r'')."""
        reference = self.reference
        sign = float(self.sign)

        def virtual_input(t: float, x: Any, u: Any, memory: Any, p: Any, v: Any) -> None:
            forward_dynamics(p.plant, x, u, v)
            y_r = reference(t, p.reference)
            for i in range(len(v)):
                v[i] = sign * (v[i] - y_r[3 * i + 2])

        return jitable(virtual_input)

    def dynamics_along(self, t: Sequence[float], x: Array, p: Any) -> tuple[Array, Array]:
        """Terms alpha and E of z' along a trajectory, see ``OutputCoordinates``."""
        n = self.inputs
        inverse = np.array([np.linalg.inv(inertia(self.model, row[:n])) for row in x])
        torques = np.array([bias(self.model, row[:n], row[n:]) for row in x])
        alpha = -np.einsum("nij,nj->ni", inverse, torques) - self.raised_along(t, p)[:, 1::2]
        return self.sign * alpha, self.sign * inverse * gears(self.model)

    def design_model(self, optimum: LqrDesign, p: Any) -> DesignModel:
        """The robot's accelerations: q + h q' + h^2/2 q''."""
        return DesignModel(self._motion, np.zeros(2 * self.size))

    # Made once for the coordinates: loops are compiled for it.
    @cached_property
    def _motion(self) -> Advance:
        """Motion by the nominal accelerations."""
        virtual_input = self.virtual_input
        accelerations = self.accelerations
        joints = self.inputs

        @jitable
        def advance(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
            a = own[:joints]
            virtual_input(t, x, u, memory, p, a)
            accelerations(t, a, p, a)
            for i in range(joints):
                x[i] += h * x[i + joints] + 0.5 * h * h * a[i]
                x[i + joints] += h * a[i]

        return advance

    def linear_model(self, plant: Plant, p: Any) -> tuple[Array, Array]:
        """Refuse: laws of a robot go through feedback linearization."""
        raise ArgumentError(f"{self.system.name} has no equations in symbols to linearize")

    def error_dynamics(
        self,
        t: Sequence[float],
        x: Array,
        p: Any,
        plant: Plant,
        w: Array | None = None,
        u: Array | None = None,
    ) -> tuple[Array, Array]:
        """Drift and gain of z' on a plant in MuJoCo, see ``OutputCoordinates``.

        The drift is MuJoCo's own forward dynamics less the effect of the input on the free bodies:
        joint friction, limits and contacts are in it as they answer to the inputs u, none by
        default. The change of their answer with u is not in the gain, which is M*^-1 gear*.
        """
        model = plant.undrawn_model
        n = self.inputs
        drift = np.zeros((len(x), self.size))
        gain = np.zeros((len(x), self.size, n))
        M = np.zeros((n, n))
        for i, state in enumerate(x):
            input_now = None if u is None else u[i]
            wrench = None if w is None else w[i]
            data = forward(model, state, input_now, wrench, self.system.bodies)
            mujoco.mj_fullM(model, data, M)
            inverse = np.linalg.inv(M)
            gain[i, 1::2] = inverse * gears(model)

            # The torques of the motors, which are those of the inputs within their limits.
            drift[i, 0::2] = state[n:]
            drift[i, 1::2] = data.qacc - inverse @ data.qfrc_actuator
        return self.sign * (drift - self.raised_along(t, p)), self.sign * gain

    def from_rates(self, x: Array, p: Any, rates: Array) -> Array:
        """The added rates, (N, n), in the order of the errors."""
        return self.sign * rates[:, self._order]

    def outputs_along(self, x: ArrayLike, plant: Any) -> Array:
        """q and q' of each joint at every state of a trajectory, (N, n); returns (N, size)."""
        return np.asarray(x, float)[:, self._order]

    def place(self, t: float, z: ArrayLike, p: Any, near: ArrayLike | None = None) -> Array:
        """The state with this error, (n,)."""
        x = np.zeros(self.size)
        x[list(self._order)] = self.placed(t, z, p)
        return x

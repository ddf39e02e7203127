"""The linear model of a plant: x' = A x + B u next to an equilibrium."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import Is
from grosmc_mj.mechanics.physics.hooks import refuse_foreign_callback, warnings_counted_only
from grosmc_mj.theory.plants import Plant

# Central differences lose eps/step to rounding and step^2 to curvature: least at the cube root.
_STEP = float(np.cbrt(np.finfo(float).eps))


def linearize(plant: Plant, x: ArrayLike | None = None, u: ArrayLike = 0.0) -> tuple[Array, Array]:
    """Compute A and B about an equilibrium: exactly of equations, else by finite differences.

    MuJoCo's ``mjd_transitionFD`` differentiates one timestep, and not one of RK4. Of
    semi-implicit Euler,

        v+ = v + h a(q, v, u),   q+ = q + h v+,

    it gives A_d and B_d, from which A and B follow exactly for any h: with T = [[I, -h I], [0, I]],

        A = T (A_d - I)/h,   B = T B_d/h.

    No integrator's error remains (a matrix logarithm of A_d would leave one of order h), so h is
    1 s, where rounding is not divided by a small step. Integrator and timestep of the plant do
    not matter, nor is its model changed.

    Args:
        plant: Nominal or edited.
        x: The equilibrium, (n,), in the order and units of ``plant.system.states``; the origin
            by default.
        u: The input that holds it there, in the units of ``plant.system.inputs``, (m,) or one
            number for all.

    Returns:
        A = dx'/dx, (n, n), and B = dx'/du, (n, m), in the units of the states per second.

    Raises:
        ArgumentError: If x or u has a wrong shape or is not finite, or the plant does not rest
            there.
    """
    Is(Plant, "a plant, such as MujocoPlant.load(...)").require("plant", plant)
    return plant.linearization(x, u)


def differences(plant: Plant, x: Array, u: Array) -> tuple[Array, Array]:
    """A and B, as by ``linearize``, of a plant in MuJoCo about any x (n,) and u (m,).

    Raises:
        ArgumentError: If MuJoCo has no x' there.
    """
    refuse_foreign_callback()
    n = len(x)
    nq = plant.system.degrees_of_freedom

    model = copy.copy(plant.undrawn_model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    # It would be implicit in the damping, and v+ no longer v + h a.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    model.opt.timestep = 1.0
    data = mujoco.MjData(model)
    data.qpos[:] = x[:nq]
    data.qvel[:] = x[nq:]
    data.ctrl[:] = u

    A_d = np.zeros((n, n))
    B_d = np.zeros((n, len(u)))
    with warnings_counted_only():
        mujoco.mj_forward(model, data)
        # MuJoCo sets an input beyond its own bound to zero.
        if np.any(data.warning.number):
            point = np.concatenate([x, u]).tolist()
            raise ArgumentError(
                f"{plant.system.name}: MuJoCo cannot compute x' at [x, u] = {point}"
            )
        mujoco.mjd_transitionFD(model, data, _STEP, True, A_d, B_d, None, None)

    T = np.eye(n) - np.eye(n, k=nq)
    return T @ (A_d - np.eye(n)), T @ B_d

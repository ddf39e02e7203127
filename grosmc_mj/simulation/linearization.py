"""The linear model of a plant in MuJoCo: x' = A x + B u next to an equilibrium."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arguments import reals, require
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.simulation.engines.control_callback import refuse_foreign_callback
from grosmc_mj.simulation.mujoco_plant import MujocoPlant, require_unchanged
from grosmc_mj.simulation.quiet import warnings_counted_only

# Largest |x'| of an equilibrium, in units of the state per second: an input computed by hand or
# by a root finder passes, a state that is merely near one does not.
_AT_REST = 1e-6
# Central differences lose eps/step to rounding and step^2 to curvature: least at the cube root.
_STEP = float(np.cbrt(np.finfo(float).eps))


def linearize(
    plant: MujocoPlant, x: ArrayLike | None = None, u: ArrayLike = 0.0
) -> tuple[Array, Array]:
    """A and B of the plant about an equilibrium, by MuJoCo's own finite differences.

    ``mjd_transitionFD`` differentiates one timestep, and not one of RK4. Of semi-implicit Euler,

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
    require("plant", plant, MujocoPlant, "a plant in MuJoCo, such as MujocoPlant.load(...)")
    require_unchanged([plant])
    refuse_foreign_callback()
    system, n = plant.system, len(plant.system.states)
    state = np.zeros(n) if x is None else reals(x)
    if state.shape != (n,) or not np.all(np.isfinite(state)):
        names = ", ".join(f"{signal.symbol} [{signal.unit}]" for signal in system.states)
        raise ArgumentError(f"x = {shown(x)} must be {n} finite numbers for {system.name}: {names}")
    inputs = reals(u)
    if inputs.shape not in {(), (len(system.inputs),)} or not np.all(np.isfinite(inputs)):
        units = ", ".join(signal.unit for signal in system.inputs)
        raise ArgumentError(f"u = {shown(u)} must be {len(system.inputs)} finite numbers [{units}]")
    model = copy.copy(plant.model_with_userdata(0))
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    # It would be implicit in the damping, and v+ no longer v + h a.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    model.opt.timestep = 1.0
    data, m = mujoco.MjData(model), system.degrees_of_freedom
    data.qpos[:], data.qvel[:], data.ctrl[:] = state[:m], state[m:], inputs
    transition, response = np.zeros((n, n)), np.zeros((n, len(system.inputs)))
    with warnings_counted_only():
        _require_rest(plant, model, data)
        mujoco.mjd_transitionFD(model, data, _STEP, True, transition, response, None, None)
    to_rates = np.eye(n) - np.eye(n, k=m)
    return to_rates @ (transition - np.eye(n)), to_rates @ response


def _require_rest(plant: MujocoPlant, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Refuse a state and input that are no equilibrium, where x' = A x + B u lacks a constant.

    Raises:
        ArgumentError: With x' at that state.
    """
    given = np.concatenate([data.qpos, data.qvel, data.ctrl]).tolist()
    mujoco.mj_forward(model, data)
    # MuJoCo sets an input beyond its own bound to zero.
    if np.any(data.warning.number):
        raise ArgumentError(f"{plant.system.name}: MuJoCo cannot compute x' at [x, u] = {given}")
    rates = np.concatenate([data.qvel, data.qacc])
    if np.abs(rates).max() > _AT_REST:
        raise ArgumentError(
            f"{plant.system.name}: [x, u] = {given} is no equilibrium: x' = {rates.tolist()}, "
            f"must be zero within {_AT_REST:g}"
        )

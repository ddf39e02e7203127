"""The balance behind every reaching condition: what pushes s away against what pushes it back."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.gains import authority, authority_together, surface_rate
from grosmc_mj.plants import Plant


class Balance(NamedTuple):
    """One state, one plant, one wrench.

    With z_i^(r_i) = alpha + E u by the law's model, alpha* + E* u + d on the true plant and G_r
    the columns of G that meet the rows of the inputs,

        s' = G_r [(alpha* - alpha) + (E* - E) u_c + d] - rho R sgn(s),  R = (G_r E*) (G_r E)^-1.

    Attributes:
        R: As above, (m, m).
        gain_ratio: What is left of rho: r = E*/E for one input, else as ``authority``.
        pushes: The first part of s', (m,), in the unit of s per second.
        push: Its largest entry.
        required: push / r, the least rho that keeps |s| from growing.
        configured: rho of the law; 0 for a law that does not switch.
        determinant: det E of the law's model.
        unmatched: What the uncertainty does to the other rows of z'.
        u_c: The continuous part of the input, (m,).
    """

    R: Array
    gain_ratio: float
    pushes: Array
    push: float
    required: float
    configured: float
    determinant: float
    unmatched: float
    u_c: Array

    @property
    def times(self) -> float:
        """How many times the configured gain is required; none is enough of no gain at all."""
        if self.configured == 0:
            return math.inf if self.required else 0.0
        return self.required / self.configured


def balance(
    law: Controller,
    true: Plant,
    t: float,
    x: Array,
    w: Array,
    u: Array | None = None,
) -> Balance:
    """The balance at a state of the true plant.

    Args:
        law: A controller with error coordinates.
        true: The plant that it meets; for a robot's law the one in MuJoCo. Of a machine it is the
            rigid one, since x does not tell what its parts do.
        t: Time [s]; the reference depends on it.
        x: State, (n,).
        w: Wrenches, (6 * bodies,).
        u: Input to which a robot's friction, limits and contacts answer, (m,); none by default.
            Equations have no use for it.
    """
    error, p = law.designed.error, law.parameters
    z, optimum = np.array(error.state(t, x, p)), law.designed.lqr
    G = p.G if hasattr(p, "G") else np.linalg.pinv(optimum.B)
    drift, gain = error.moved(t, x, p, true.rigid, w, u)
    wanted, limit = -(p.K @ z), getattr(p, "limit", math.inf)
    # What the surface supposes of the input, v_0 of the law.
    v_0 = np.clip(wanted, -limit, limit)
    u_c, believed = v_0, G @ optimum.B
    if isinstance(error, StateCoordinates):
        E = believed
        reached = optimum.B @ np.linalg.pinv(optimum.B)
        differs = drift + gain @ u_c - optimum.A @ z - optimum.B @ v_0
        unmatched = differs - reached @ differs
    else:
        rows = list(error.linearization.last_rows)
        E = optimum.B[rows]
        if law.designed.linearizing:
            alpha, E = error.dynamics(t, x, p)
            u_c, believed = np.linalg.solve(E, v_0 - alpha), G[:, rows] @ E
        unmatched = error.unmatched(t, x, p, drift + gain @ u_c)
    push, steered = surface_rate((drift, gain), z, G, G @ optimum.closed_loop, u_c)
    push = push - G @ optimum.B @ (v_0 - wanted)
    together = "unit-vector" in law.designed.switching
    R = steered @ np.linalg.inv(believed)
    r = authority_together(R) if together else authority(R)
    pushing = float(np.linalg.norm(push) if together else np.abs(push).max())
    return Balance(
        R=R,
        gain_ratio=r,
        pushes=push,
        push=pushing,
        required=pushing / r if r > 0 else np.inf,
        configured=switching_rate(law, z, E),
        determinant=float(np.linalg.det(E)),
        unmatched=float(np.abs(unmatched).max(initial=0.0)),
        u_c=u_c,
    )


def switching_rate(law: Controller, z: Array, E: Array) -> float:
    """rho of the law, what its switching term asks of s': eqs. (12), (37) and (55)."""
    p: Any = law.parameters
    if hasattr(p, "epsilon"):
        return p.epsilon * p.switching.gain
    if hasattr(p, "eta"):
        size = float(np.linalg.norm(p.GB @ E)) if law.designed.linearizing else p.size_of_GB
        return p.switching.gain * (p.eta + (p.gamma0 + p.gamma1 * float(np.linalg.norm(z))) * size)
    return 0.0

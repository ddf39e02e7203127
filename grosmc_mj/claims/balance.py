"""The balance behind every reaching condition: what pushes s away against what pushes it back."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.plants import AnalyticPlant


class Balance(NamedTuple):
    """One state, one plant, one wrench.

    With z1'' = alpha + E u by the law's model and alpha* + E* u + d on the true plant,

        s' = G_2 [(alpha* - alpha) + (E* - E) u_c + d + E* u_d].

    Attributes:
        gain_ratio: r = E*/E.
        push: (alpha* - alpha) + (E* - E) u_c + d, in the unit of z1''.
        required: |push / E*|, the least |u_d| that keeps |s| from growing.
        configured: |u_d| of the law next to the surface; 0 for a law that does not switch.
        decoupling: E of the law's model.
        unmatched: What the uncertainty does to z1' instead of z1''.
        u_c: The continuous part of the input.
    """

    gain_ratio: float
    push: float
    required: float
    configured: float
    decoupling: float
    unmatched: float
    u_c: float


def balance(law: Controller, true: AnalyticPlant, t: float, x: Array, w: Array) -> Balance:
    """The balance at a state of the true plant.

    Args:
        law: A controller with error coordinates.
        true: The plant that it meets.
        t: Time [s]; the reference depends on it.
        x: State, (n,).
        w: Wrenches, (6 * bodies,).
    """
    error, p = law.error, law.parameters
    assert error is not None
    z = np.array(error.state(t, x, p))
    velocity = error.system.output + error.system.degrees_of_freedom
    if law.linearizing:
        alpha, E = error.dynamics(t, x, p)
        u_c = (-float(p.K @ z) - alpha) / E
    else:
        assert law.lqr is not None
        alpha, E = float(law.lqr.A[1] @ z), float(law.lqr.B[1, 0])
        u_c = -float(p.K @ z)
    alpha_true, E_true = error.dynamics(t, x, replace(p, plant=true.parameters))
    pushed = np.array(error.system.disturbance(x, w, true.parameters))
    d = error.sign * pushed[velocity]
    push = (alpha_true - alpha) + (E_true - E) * u_c + d
    return Balance(
        gain_ratio=E_true / E,
        push=push,
        required=abs(push / E_true),
        configured=switching_amplitude(law, z, E),
        decoupling=E,
        unmatched=float(abs(pushed[error.system.output])),
        u_c=u_c,
    )


def switching_amplitude(law: Controller, z: Array, E: float) -> float:
    """|u_d| of the law next to its surface, in the unit of u: eqs. (12), (37) and (55)."""
    p: Any = law.parameters
    if hasattr(p, "epsilon"):
        return p.epsilon / abs(p.GB * E)
    if hasattr(p, "eta"):
        steered = abs(p.GB * E) if law.linearizing else abs(p.GB)
        return p.eta / steered + p.gamma0 + p.gamma1 * float(np.hypot(*z))
    return 0.0

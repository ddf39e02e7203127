"""The balance behind every reaching condition: what pushes s away against what pushes it back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.reaching import Nominal, gain_margin, nominal, times
from grosmc_mj.control.task import GrosmcParameters
from grosmc_mj.plants import AnalyticPlant, Plant
from grosmc_mj.simulation.trajectory import Trajectory


class Balance(NamedTuple):
    """One state, one plant, one wrench.

    With z_i^(r_i) = alpha + E u by the law's model, alpha* + E* u + d on the true plant and G_r
    the columns of G that meet the rows of the inputs,

        s' = G_r [(alpha* - alpha) + (E* - E) u_c + d] - rho R sgn(s),  R = (G_r E*) (G_r E)^-1.

    Attributes:
        R: As above, (m, m).
        gain_ratio: What is left of rho: r = E*/E for one input, else as ``gain_margin``.
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
    error, x = law.designed.error, np.asarray(x, float)
    drift, gain = error.moved(t, x, law.parameters, true.rigid, w, u)
    z = error.error_state(t, x, law.parameters)[None]
    return _balances(law, [t], x[None], z, (drift[None], gain[None]))[0]


def balances(
    law: Controller, true: AnalyticPlant, t: Sequence[float], x: Array, w: Array
) -> list[Balance]:
    """The balance at many states of a plant with equations, all at once.

    Args:
        law: A controller with error coordinates in symbols.
        true: The plant that it meets.
        t: Times [s], (N,).
        x: States, (N, n).
        w: Wrenches, (N, 6 * bodies).
    """
    error, p = law.designed.error, law.parameters
    assert isinstance(error, ErrorCoordinates)
    return _balances(law, t, x, error.along(t, x, p), error.moved_along(t, x, p, true, w))


# Times, states and what was found there.
Points = list[tuple[float, Array, Balance]]


def balances_along(
    law: Controller, true: AnalyticPlant, run: Trajectory, every: int, *, pushed: bool = True
) -> Points:
    """The balance along a run.

    Args:
        law: As for ``balances``.
        true: The plant that it meets.
        run: The run.
        every: Of so many samples one is looked at.
        pushed: Whether its wrenches count.
    """
    rows = slice(0, len(run.time) - 1, every)
    t, x = run.time[rows].tolist(), run.state[rows]
    w = np.zeros((len(t), 6 * len(true.system.bodies)))
    if pushed and run.wrench is not None:
        w = run.wrench[rows]
    return list(zip(t, x, balances(law, true, t, x, w), strict=True))


def _balances(
    law: Controller, t: Sequence[float], x: Array, z: Array, motion: tuple[Array, Array]
) -> list[Balance]:
    """The balance at instants (N,), states (N, n) and errors (N, size) that move like that."""
    design, p = law.designed, law.parameters
    own = nominal(design, p, t, x, z)
    dz, push, R = own.reaching(motion)
    if isinstance(design.error, StateCoordinates):
        A, B = design.lqr.A, design.lqr.B
        differs = dz - times(A, z) - times(B, own.v_0)
        unmatched = differs - times(B @ np.linalg.pinv(B), differs)
    else:
        unmatched = design.error.unmatched(z, dz)
    together = "unit-vector" in design.switching
    r = gain_margin(R, together=together)
    pushing = np.linalg.norm(push, axis=-1) if together else np.abs(push).max(axis=-1)
    configured, determinant = switching_rate(p, own), np.linalg.det(own.E)
    unmatched = np.abs(unmatched).max(axis=-1, initial=0.0)
    return [
        Balance(
            R=R[i],
            gain_ratio=float(r[i]),
            pushes=push[i],
            push=float(pushing[i]),
            required=float(pushing[i] / r[i]) if r[i] > 0 else math.inf,
            configured=float(configured[i]),
            determinant=float(determinant[i]),
            unmatched=float(unmatched[i]),
            u_c=own.u_c[i],
        )
        for i in range(len(z))
    ]


def switching_rate(p: Any, law: Nominal) -> Array:
    """rho of a law at N states, what its switching term asks of s': eqs. (12), (37) and (55).

    Args:
        p: Its parameters.
        law: The law by its own model.

    Returns:
        One number for each state, (N,); 0 of a law that does not switch.
    """
    if not isinstance(p, GrosmcParameters):
        return np.zeros(len(law.z))
    bound = p.gamma0 + p.gamma1 * np.linalg.norm(law.z, axis=-1)
    size = np.linalg.norm(law.GE, axis=(-2, -1))
    return p.switching.gain * (p.epsilon + p.eta + bound * size)

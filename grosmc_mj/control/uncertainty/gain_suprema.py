"""Switching gains from the reaching condition, eqs. (14) and (39), of all plants of a family."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.reaching import NominalLaw, Reaching, gain_margin
from grosmc_mj.errors import GainError

# Rounding of a mismatch of zero next to z = 0, and of an input gain of zero.
_ROUNDING = 1e-9


class SwitchingGains(NamedTuple):
    """Gains of eqs. (12) and (37), and the input-gain ratio that they had to allow for.

    Attributes:
        eta: Reaching gain, in the unit of s per second.
        gamma0: Constant part of the bound, in the unit of the input.
        gamma1: Its slope over the norm of the error state.
        gain_ratio: Smallest r = E_true/E_nominal in the family; for several inputs the smaller of
            both kinds of ``gain_margin``.
    """

    eta: float
    gamma0: float
    gamma1: float
    gain_ratio: float


class Member(NamedTuple):
    """A plant of a family, at the N states of a law.

    Attributes:
        changes: Its difference from the nominal plant, in words.
        reaching: Its reaching condition.
        disturbed: |G d|, the largest change of s' by the declared disturbances, (N, m), in the
            unit of s per second.
    """

    changes: str
    reaching: Reaching
    disturbed: Array


def switching_gains(
    system: str, law: NominalLaw, family: Iterable[Member], rate: float
) -> SwitchingGains:
    """Suprema over a family of plants: gains with s_i' s_i <= -rate |s_i| on each of them.

    The switching term meets the true input gain, not the nominal one, so the assumptions' bounds
    are met with the gain's own uncertainty counted, which breaks the circle of Assumption 4. Of
    rho = eta + (gamma0 + gamma1 |z|) |G E| a share r is effective (``gain_margin``):

        eta    = rate / min r
        gamma0 = sup |push(0) + G d| / (r |G E|)
        gamma1 = sup |push(z) - push(0)| / (r |G E| |z|),

    in Euclidean norms, so that they hold for a term along s/|s| as well as for one in each entry.

    Args:
        system: Name of the system.
        law: The law at z = 0, then at one step along each axis next to it, where the mismatch
            is linear, then anywhere else.
        family: The plants.
        rate: Reaching rate, in the unit of s per second.

    Raises:
        GainError: If a plant reverses or loses an input, when no gain helps.
    """
    z = law.z[1:]
    n = z.shape[1]
    distance = np.linalg.norm(z, axis=-1)
    size = np.linalg.norm(law.GE[1:], axis=(-2, -1))

    gain_ratio = math.inf
    gamma0 = 0.0
    gamma1 = 0.0
    for member in family:
        push = member.reaching.push
        r = _effective_share(system, member, z)
        gain_ratio = min(gain_ratio, float(r.min()))

        switched = r * size
        largest = np.abs(push[0]) + member.disturbed[1:]
        constant = np.hypot.reduce(largest, axis=-1) / switched
        gamma0 = max(gamma0, float(constant.max()))

        slope = (push[1:] - push[0]) / (switched * distance)[:, None]
        # The largest slope of a linear mismatch is the norm of its matrix.
        near = float(np.linalg.norm(slope[:n], 2))
        far = np.linalg.norm(slope, axis=-1)
        gamma1 = max(gamma1, near, float(far.max()))

    # Rounding is no mismatch.
    gamma0 = gamma0 if gamma0 > _ROUNDING else 0.0
    gamma1 = gamma1 if gamma1 > _ROUNDING else 0.0
    return SwitchingGains(rate / gain_ratio, gamma0, gamma1, gain_ratio)


def _effective_share(system: str, member: Member, z: Array) -> Array:
    """r of a plant at every state z but zero."""
    R = member.reaching.R[1:]
    r = np.minimum(gain_margin(R), gain_margin(R, together=True))
    if not np.all(r > _ROUNDING):
        comparable = np.where(np.isnan(r), -np.inf, r)
        worst = int(np.argmin(comparable))
        raise GainError(
            f"{system}: the input gain of a declared plant, {member.changes}, is {r[worst]:g} of "
            f"the nominal one at z = {z[worst]}; no switching gain can make up for that: "
            "choose another G"
        )
    return r

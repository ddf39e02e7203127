"""Switching gains from the reaching condition, eqs. (14) and (39), of all plants of a family."""

from __future__ import annotations

import math
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


class GainSuprema:
    """Suprema over a family of plants, from which gains with s_i' s_i <= -rate |s_i| follow.

    The switching term meets the true input gain, not the nominal one, so the assumptions' bounds
    are met with the gain's own uncertainty counted, which breaks the circle of Assumption 4. Of
    rho = eta + (gamma0 + gamma1 |z|) |G E| a share r is effective (``gain_margin``):

        eta    = rate / min r
        gamma0 = sup |push(0) + G d| / (r |G E|)
        gamma1 = sup |push(z) - push(0)| / (r |G E| |z|),

    in Euclidean norms, so that they hold for a term along s/|s| as well as for one in each entry.
    """

    def __init__(self, name: str, law: NominalLaw) -> None:
        """Begin with no plant.

        Args:
            name: Name of the system.
            law: The law at z = 0, then at one step along each axis next to it, where the mismatch
                is linear, then anywhere else.
        """
        self._name = name
        self._z = law.z[1:]
        sizes = np.linalg.norm(law.GE, axis=(-2, -1))
        self._size = sizes[1:]
        self._distance = np.linalg.norm(self._z, axis=-1)
        self._gamma0 = 0.0
        self._gamma1 = 0.0
        self._gain_ratio = math.inf

    def add(self, plant: str, reaching: Reaching, disturbed: Array) -> None:
        """Include a plant of the family.

        Args:
            plant: Its name.
            reaching: Its reaching condition at the states of the law.
            disturbed: Largest part |G d| that disturbances add to the push there, (N, m).

        Raises:
            GainError: If the plant reverses or loses an input, when no gain helps.
        """
        push = reaching.push
        r = self._effective_share(plant, reaching.R)
        self._gain_ratio = min(self._gain_ratio, float(r.min()))

        switched = r * self._size
        largest = np.abs(push[0]) + disturbed[1:]
        constant = np.hypot.reduce(largest, axis=-1) / switched
        self._gamma0 = max(self._gamma0, float(constant.max()))

        slope = (push[1:] - push[0]) / (switched * self._distance)[:, None]
        # The largest slope of a linear mismatch is the norm of its matrix.
        n = self._z.shape[1]
        near = float(np.linalg.norm(slope[:n], 2))
        far = np.linalg.norm(slope, axis=-1)
        self._gamma1 = max(self._gamma1, near, float(far.max()))

    def _effective_share(self, plant: str, R: Array) -> Array:
        """r of a plant at every state but z = 0."""
        in_each_entry = gain_margin(R)
        along_s = gain_margin(R, together=True)
        r = np.minimum(in_each_entry, along_s)[1:]
        if not np.all(r > _ROUNDING):
            comparable = np.where(np.isnan(r), -np.inf, r)
            worst = int(np.argmin(comparable))
            raise GainError(
                f"{self._name}: the input gain of a declared plant, {plant}, is {r[worst]:g} of "
                f"the nominal one at z = {self._z[worst]}; no switching gain can make up for that: "
                "choose another G"
            )
        return r

    def gains(self, rate: float) -> SwitchingGains:
        """Gains with which every plant of the family keeps |s| falling at this rate."""
        eta = rate / self._gain_ratio
        # Rounding is no mismatch.
        gamma0 = self._gamma0 if self._gamma0 > _ROUNDING else 0.0
        gamma1 = self._gamma1 if self._gamma1 > _ROUNDING else 0.0
        return SwitchingGains(eta, gamma0, gamma1, self._gain_ratio)

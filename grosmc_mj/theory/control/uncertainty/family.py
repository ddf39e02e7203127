"""Family of plants that an uncertainty declares, and the switching gains that hold all of them.

The gains follow from the reaching condition, eqs. (14) and (39), of every plant of the family.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import PlainValidator

from grosmc_mj.ground.arguments import reals
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GainError, value_text
from grosmc_mj.ground.refusals import refusal
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.reaching import NominalLaw, Reaching, gain_margin
from grosmc_mj.theory.plants import Plant

# Rounding of a mismatch of zero next to z = 0, and of an input gain of zero.
_ROUNDING = 1e-9


def _scales(value: Any) -> dict[str, Any]:
    """Ranges of scales by the names of parameters."""
    if not isinstance(value, Mapping):
        raise refusal("a table with the range [least, largest] of each parameter, by its name")

    ranges: dict[str, Any] = {}
    for name, ends in value.items():
        numbers = tuple(np.ravel(reals(ends)).tolist())
        if len(numbers) != 2 or not 0 < numbers[0] <= numbers[1] < math.inf:
            raise refusal(f"ranges [least, largest] above 0, unlike {name} = {value_text(ends)}")
        ranges[str(name)] = numbers
    return ranges


Scales = Annotated[Mapping[str, tuple[float, float]], PlainValidator(_scales)]


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


class PlantFamily(ABC):
    """Plants beside the nominal one, each of which a switching law must withstand.

    Attributes:
        scales: Range of the true value of a parameter over its nominal one, by its name.
        reaching_rate: The eta of eqs. (14) and (39) that the true plant shall keep: the rate of
            |s|, in the unit of s per second.
    """

    scales: Scales
    reaching_rate: float

    @abstractmethod
    def scales_within(self, low: float, high: float) -> Sequence[float]:
        """Scales that the members have of a range; both ends are among them."""

    @abstractmethod
    def law_at_states(self, law: Controller) -> NominalLaw:
        """The law at the states where its reaching condition is evaluated, see ``switching_gains``.

        Raises:
            GainError: If the uncertainty is not one of the law's system.
        """

    @abstractmethod
    def reaching(
        self, law: Controller, by_model: NominalLaw, member: Plant
    ) -> tuple[Reaching, Array]:
        """Reaching condition of a member at the N states of the law, and |G d| there.

        |G d|, (N, m), is the largest change of s' by the declared disturbances, in the unit of s
        per second.

        Raises:
            GainError: If a declared disturbance cannot act on the plant.
        """

    @abstractmethod
    def description(self, plant: Plant) -> str:
        """The declared family, in words."""

    def members(self, plant: Plant) -> Iterator[tuple[str, Plant]]:
        """Plants of the family, with the change of each in words.

        Args:
            plant: The nominal plant.

        Raises:
            ModelError: If it has no such parameter or body.
        """
        if not self.scales:
            yield "as it is", plant
            return

        axes = [self.scales_within(low, high) for low, high in self.scales.values()]
        for factors in itertools.product(*axes):
            scales = dict(zip(self.scales, factors, strict=True))
            changes = [f"{name} x{factor:g}" for name, factor in scales.items()]
            yield " and ".join(changes), plant.changed(scales=scales)

    def gains(self, law: Controller, plant: Plant) -> tuple[SwitchingGains, str]:
        """Gains with which s_i' s_i <= -reaching_rate |s_i| on every plant of the family.

        Args:
            law: The law, whose own gains are not read.
            plant: The nominal plant.

        Returns:
            The gains, and the family that they hold for in one line.

        Raises:
            GainError: If the uncertainty does not fit the law, or a member reverses or loses an
                input, when no switching gain helps.
            ModelError: If the plant has no such parameter or body.
        """
        by_model = self.law_at_states(law)
        family = (
            Member(changes, *self.reaching(law, by_model, member))
            for changes, member in self.members(plant)
        )
        gains = switching_gains(plant.system.name, by_model, family, self.reaching_rate)
        return gains, (
            f"{self.description(plant)}; "
            f"input gain down to {gains.gain_ratio:.3g} of the nominal one"
        )

    def _ranges(self) -> list[str]:
        """Ranges of the scales, in words."""
        return [f"{name} x{low:g} to x{high:g}" for name, (low, high) in self.scales.items()]


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

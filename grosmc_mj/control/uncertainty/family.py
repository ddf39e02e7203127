"""Family of plants that an uncertainty declares, and the switching gains that hold all of them."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import PlainValidator

from grosmc_mj.arguments import reals
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Design
from grosmc_mj.control.reaching import NominalLaw, Reaching
from grosmc_mj.control.uncertainty.gain_suprema import Member, SwitchingGains, switching_gains
from grosmc_mj.errors import value_text
from grosmc_mj.plants import Plant
from grosmc_mj.refusals import refusal


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
    def law_at_states(self, design: Design, p: Any) -> NominalLaw:
        """The law at the states where its reaching condition is evaluated, see ``switching_gains``.

        Raises:
            GainError: If the uncertainty is not one of this design's system.
        """

    @abstractmethod
    def reaching(
        self,
        design: Design,
        p: Any,
        law: NominalLaw,
        member: Plant,
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

    def gains(
        self,
        design: Design,
        p: Any,
        plant: Plant,
    ) -> tuple[SwitchingGains, str]:
        """Gains with which s_i' s_i <= -reaching_rate |s_i| on every plant of the family.

        Args:
            design: Design of the law.
            p: Its parameters, of which gains are not read.
            plant: The nominal plant.

        Returns:
            The gains, and the family that they hold for in one line.

        Raises:
            GainError: If the uncertainty does not fit the law, or a member reverses or loses an
                input, when no switching gain helps.
            ModelError: If the plant has no such parameter or body.
        """
        law = self.law_at_states(design, p)
        family = (
            Member(changes, *self.reaching(design, p, law, member))
            for changes, member in self.members(plant)
        )
        gains = switching_gains(plant.system.name, law, family, self.reaching_rate)
        return gains, (
            f"{self.description(plant)}; "
            f"input gain down to {gains.gain_ratio:.3g} of the nominal one"
        )

    def _ranges(self) -> list[str]:
        """Ranges of the scales, in words."""
        return [f"{name} x{low:g} to x{high:g}" for name, (low, high) in self.scales.items()]

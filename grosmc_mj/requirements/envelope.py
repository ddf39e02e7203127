"""Bounds of a signal in a part of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from grosmc_mj.arguments import require_known
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError
from grosmc_mj.requirements.always import Always
from grosmc_mj.requirements.signals import named_units
from grosmc_mj.units import number_in


@dataclass(frozen=True, kw_only=True)
class Envelope(Always):
    """A signal is ``above`` one number and ``below`` another one, ``from`` one instant ``to`` one.

    It is the formula ``SIGNAL > ABOVE and SIGNAL < BELOW`` at these instants.

    Attributes:
        bounds: The bounds in words.
    """

    key = "signal"
    options = ("above", "below", "from", "to")

    bounds: str

    @classmethod
    def can_be_asked_of(cls, law: Controller, value: Any) -> bool:
        """Whether a law has the signal, see ``Always``."""
        require_known("signal", value, named_units(law, "1"))
        return super().can_be_asked_of(law, value)

    @classmethod
    def options_in(
        cls,
        written: Mapping[str, Any],
        units: Mapping[str, str],
        duration: float,
    ) -> dict[str, Any]:
        """Read the bounds, see ``Always``."""
        name = written[cls.key]
        unit = units[name]
        sides = []
        bounds = []
        for option, sign in (("above", ">"), ("below", "<")):
            if written[option] is None:
                continue
            number = number_in(written[option], unit)
            sides.append(f"{name} {sign} {number!r} {unit.removesuffix('1')}")
            bounds.append(f"{option} {written[option]}")
        if not sides:
            raise ArgumentError(f'give a bound, such as above = "1 {unit}", or below')

        begin = written["from"]
        end = math.inf if written["to"] is None else written["to"]
        if duration < end < math.inf:
            raise ArgumentError(f"to = {end:g} s is after the end of a run at {duration:g} s")
        last = min(end, duration)
        if not 0 <= begin < last:
            raise ArgumentError(f"there is no time from {begin:g} s to {last:g} s")
        read = cls.read(" and ".join(sides), units, duration - begin)
        return {**read, "after": begin, "until": end, "bounds": ", ".join(bounds)}

    @property
    def words(self) -> str:
        """The requirement in words."""
        words = f"{self.written} {self.bounds}"
        if math.isfinite(self.until):
            return f"{words} from {self.after:g} s to {self.until:g} s"
        if self.after:
            return f"{words} from {self.after:g} s on"
        return words

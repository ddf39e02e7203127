"""What every part of a machine has: one thing that it is of, and numbers within bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from grosmc_mj.arguments import real, reals, require
from grosmc_mj.errors import ModelError, shown

# Sizes of numbers, in any unit: beyond them is a slip, and squares leave what floats hold.
LEAST, _MOST = 1e-15, 1e15


@dataclass(frozen=True)
class Part:
    """What all parts have: one thing that they are of, and numbers with bounds."""

    kind: ClassVar[str]
    owner: ClassVar[str]
    # Numbers that must be more than zero, and those that may be infinite.
    positive: ClassVar[frozenset[str]] = frozenset()
    infinite: ClassVar[frozenset[str]] = frozenset()
    signed: ClassVar[frozenset[str]] = frozenset()

    def __post_init__(self) -> None:
        require(self.owner, self.of, str, f"the name of {_a(self.owner)}", ModelError)
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == self.owner or isinstance(item.default, tuple):
                continue
            if isinstance(item.default, bool):
                require(item.name, value, bool, "True or False", ModelError)
                continue
            self._require(item.name, value)
        self._check()

    @property
    def of(self) -> str:
        """Name of the joint, body or input that it is of."""
        return getattr(self, self.owner)

    def _require(self, name: str, value: Any) -> None:
        number = real(value)
        if name in self.signed:
            fine, wanted = math.isfinite(number), "finite"
        elif name in self.positive:
            fine, wanted = number > 0, "positive"
        else:
            fine, wanted = number >= 0, "not negative"
        # A whole number beyond floats is no infinity.
        if math.isinf(number) and not (name in self.infinite and isinstance(value, float)):
            fine, wanted = False, f"finite and {wanted}"
        elif name in self.positive and 0 < number < LEAST:
            fine, wanted = False, f"at least {LEAST:g}"
        elif math.isfinite(number) and abs(number) > _MOST:
            fine, wanted = False, f"at most {_MOST:g}" if number > 0 else f"at least {-_MOST:g}"
        if not fine:
            self.refuse(f"{name} = {shown(value)} must be {wanted}")

    def refuse(self, said: str) -> None:
        """Say what is wrong with this part.

        Raises:
            ModelError: Always.
        """
        raise ModelError(f"{self.kind} of {shown(self.of)}: {said}")

    def require_place(self, name: str) -> None:
        """Refuse what is no three finite numbers."""
        place = reals(getattr(self, name))
        if place.shape != (3,) or not np.all(np.isfinite(place)):
            self.refuse(f"{name} = {shown(getattr(self, name))} must be three finite numbers")

    def _check(self) -> None:
        """Refuse numbers that do not go together."""


def _a(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"

"""Numbers of a law as fields: bounds that refuse, the range that a search takes, and meaning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from grosmc_mj.ground.arguments import reals
from grosmc_mj.ground.fields import Range
from grosmc_mj.ground.refusals import refusal

# Entry that a number belongs to, if it is no single number.
Each = Literal["", "state", "input", "output"]


@dataclass(frozen=True, kw_only=True)
class LawNumber(Range):
    """Bounds, unit and meaning of a number of a law.

    Attributes:
        meaning: Noun for it, with its symbol in the law's equation.
        search: Range that a search takes by default, within the bounds; None for a number that
            belongs to the machine or the task, not to the tuning. Of a number that may be
            negative it is the range of the magnitude.
        log: Whether a search takes its logarithm.
        each: Whether there may be one for each state of the error, each input or each output.
        relative: Whether ``search`` is a factor on the value of the file, as for weights, of which
            only the ratios count.
    """

    meaning: str
    search: tuple[float, float] | None = None
    log: bool = True
    each: Each = ""
    relative: bool = False

    def __call__(self, value: Any) -> Any:
        """Return the number, or an array of one for each entry; refuse one out of bounds."""
        if not self.each:
            return super().__call__(value)
        entries = reals(value)
        if not all(self.holds(entry) for entry in np.ravel(entries).tolist()):
            raise refusal("a matrix of finite numbers")
        return entries

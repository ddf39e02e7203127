"""Result of a law on a rung, which is a row of the ladder, and the way of a law up its rungs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, computed_field

from grosmc_mj.experiments.measured import MEASURED
from grosmc_mj.output.results.tables import number

# Stands for the requirement that breaks first of a run that ended early.
ENDED = "the run ended"
# Rungs that decide nothing of the model's: the book's misprints, and the real machine.
_BESIDE = ("printed", MEASURED)
# A number that may be infinite, for which JSON has null.
Unlimited = Annotated[float, BeforeValidator(lambda x: math.inf if x is None else x)]


class RungResult(BaseModel):
    """Result of a law on a rung; None for a number that the run does not have.

    Attributes:
        law: Name of the law.
        rung: Name of the rung.
        together: Whether all rungs below count too.
        condition: Name of the condition.
        draws: Runs with other random numbers and phases of the encoders; 1 where nothing is drawn.
        kept_draws: Draws that keep all requirements.
        share_of_the_tightest_limit: Of the worst draw; above 1 it is not kept; infinite with
            nothing to measure.
        tightest: The requirement with the tightest limit in that draw, or how it ended.
        shares: The share used of each limit in that draw.
        hangs_on: Assumed numbers, each with a change that turns the verdict.
        amplitude: Half of the range of the error in the end, in its unit; this and what follows is
            of the first draw.
        frequency: Its swings a second [Hz].
        variation: Total variation of the input a second.
        deviation: Largest distance from the nominal optimum of a law that follows it.
        optimum_settles: Settling time of the nominal optimum, if the law does not settle in time
            [s].
        impossible: Why such a run cannot exist.
        claims: The largest share used, over the draws, of the limits of each claim about this law,
            by its id; above 1 it has fallen.
    """

    model_config = ConfigDict(frozen=True)
    law: str
    rung: str
    together: bool
    condition: str
    draws: int = 1
    kept_draws: int = 0
    share_of_the_tightest_limit: Unlimited = math.inf
    tightest: str = ""
    shares: dict[str, Unlimited] = {}
    hangs_on: tuple[str, ...] = ()
    amplitude: float | None = None
    frequency: float | None = None
    variation: float | None = None
    deviation: float | None = None
    optimum_settles: float | None = None
    impossible: str | None = None
    claims: dict[str, Unlimited] = {}

    @computed_field
    @property
    def kept(self) -> bool:
        """Whether all requirements are kept in all draws."""
        return self.share_of_the_tightest_limit <= 1 and not self.impossible

    @property
    def partly(self) -> bool:
        """Whether some draws keep all requirements, and others do not."""
        return 0 < self.kept_draws < self.draws

    @property
    def cell(self) -> str:
        """The share of the tightest limit, or the draws that keep all; ? if assumptions decide."""
        text = self.share_text
        if self.partly:
            text = f"{self.kept_draws} of {self.draws}"
        return f"{text}?" if self.hangs_on else text

    @property
    def share_text(self) -> str:
        """The share of the tightest limit that is used, or why there is no number."""
        if self.impossible:
            return "-"
        if self.tightest == ENDED:
            return "ended"
        share = self.share_of_the_tightest_limit
        if math.isinf(share):
            return "never"
        if share > 1:
            return f"{number(share)}x"
        return number(share)

    @property
    def reason(self) -> str:
        """The requirement that breaks, and by how much, in words."""
        if self.impossible:
            return self.impossible
        if self.tightest == ENDED:
            if self.partly:
                return f"{ENDED}, kept in {self.kept_draws} of {self.draws} draws"
            return ENDED

        share = self.share_of_the_tightest_limit
        excess = f"{number(share)} times"
        if math.isinf(share):
            excess = "never"
        if number(share) == "1":
            excess = "at its limit"
        words = f"{self.tightest.replace('_', ' ')}: {excess}"
        if self.partly:
            words += f", kept in {self.kept_draws} of {self.draws} draws"
        if self.optimum_settles is not None:
            words += f" (the nominal optimum needs {number(self.optimum_settles)} s)"
        return words


def way(rows: Iterable[RungResult], law: str, condition: str) -> list[RungResult]:
    """Return a law's rows rung by rung, from equations that are true to the complete machine."""
    of_law = [row for row in rows if (row.law, row.condition) == (law, condition)]
    return [row for row in of_law if row.together and row.rung not in _BESIDE]


def ways(rows: Sequence[RungResult], condition: str) -> dict[str, list[RungResult]]:
    """Return the way of each law that has begun to climb under a condition."""
    climbs = {law: way(rows, law, condition) for law in dict.fromkeys(row.law for row in rows)}
    return {law: rungs for law, rungs in climbs.items() if rungs}


def first_failed(climbs: Sequence[RungResult]) -> RungResult | None:
    """Return the first rung on which a requirement is not kept; None if all are kept."""
    for row in climbs:
        if not row.kept:
            return row
    return None


def fallen(climbs: Sequence[RungResult], claim: str) -> RungResult | None:
    """Return the first rung on which a claim is not kept; None if it is kept wherever judged."""
    for row in climbs:
        if row.claims.get(claim, 0.0) > 1:
            return row
    return None

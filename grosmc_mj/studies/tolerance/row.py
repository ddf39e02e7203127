"""Tolerance of a law to an imperfection, and all of a law as one row of the study."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict

from grosmc_mj.studies.tolerance.imperfections import Imperfection


@dataclass(frozen=True)
class Tolerance:
    """Tolerance of a law to an imperfection under a condition, in factors on the bench's amounts.

    Attributes:
        law: Name of the law.
        imperfection: The imperfection.
        condition: Name of the condition.
        kept_ideally: Whether all requirements are kept without the imperfection.
        largest_kept: Largest factor up to which all that was tried is kept; 0 if none is.
        smallest_failed: Smallest factor found at which one fails; None if none was found.
        kept_again: Ranges beyond that in which all are kept again.
        breaks: The requirement that fails there, or how that run ended; empty if none fails.
        physics_agrees: Whether MuJoCo gives the same at both ends; None where it was not run.
        impossible: Why such a loop cannot exist; empty if it can.
    """

    law: str
    imperfection: Imperfection
    condition: str
    kept_ideally: bool
    largest_kept: float
    smallest_failed: float | None = None
    kept_again: Sequence[tuple[float, float]] = ()
    breaks: str = ""
    physics_agrees: bool | None = None
    impossible: str = ""

    @property
    def weakness(self) -> float:
        """The smallest factor that fails, by which tolerances are compared; infinite if none."""
        if not self.kept_ideally or self.impossible:
            return 0.0
        if self.smallest_failed is None:
            return math.inf
        return self.smallest_failed

    @property
    def none(self) -> bool:
        """Whether all is kept only without it: with less than half a timestep of it at most."""
        return self.largest_kept == 0 or self.imperfection.amount(self.largest_kept) == 0

    @property
    def reason(self) -> str:
        """The requirement that fails, in words."""
        return self.breaks.replace("_", " ")

    @property
    def cell(self) -> str:
        """The tolerance in a cell of a table, without its unit."""
        cell = self._largest
        if self.kept_again:
            cell += "*"
        if self.physics_agrees is False:
            cell += "!"
        return cell

    @property
    def _largest(self) -> str:
        kind = self.imperfection
        if self.impossible:
            return "-"
        if not kind.amounts:
            return "yes" if self.kept_ideally and self.smallest_failed is None else "no"
        if not self.kept_ideally:
            return "no"
        if self.none:
            return "none"

        amount = kind.text(self.largest_kept)
        if self.smallest_failed is not None:
            return amount
        return f"≤ {amount}" if kind.limits else f"≥ {amount}"

    def amount_text(self, factor: float) -> str:
        """Return the amount for a factor with its unit; of all at once the factor."""
        return f"{self.imperfection.text(factor)} {self.imperfection.unit[0]}"

    def document(self) -> dict[str, Any]:
        """Return it as plain values, factors with their amounts."""
        smallest_failed = None
        if self.smallest_failed is not None:
            smallest_failed = self._level(self.smallest_failed)
        return {
            **vars(self),
            "imperfection": self.imperfection.name,
            "largest_kept": self._level(self.largest_kept),
            "smallest_failed": smallest_failed,
            "kept_again": [[self._level(low), self._level(high)] for low, high in self.kept_again],
        }

    def _level(self, factor: float) -> dict[str, float]:
        return {"factor": factor, "shown": self.imperfection.amount(factor)}


class LawTolerances(BaseModel):
    """Finished answers of one law, as they are stored.

    Attributes:
        law: Name of the law.
        answers: Fields of each ``Tolerance``, its imperfection by name.
    """

    model_config = ConfigDict(frozen=True, ser_json_inf_nan="constants")
    law: str
    answers: tuple[dict[str, Any], ...]

    @classmethod
    def of(cls, rows: Sequence[Tolerance]) -> LawTolerances:
        """Return the answers of one law, to be stored."""
        answers = [{**vars(row), "imperfection": row.imperfection.name} for row in rows]
        return cls(law=rows[0].law, answers=tuple(answers))

    def rows(self, kinds: Sequence[Imperfection]) -> list[Tolerance]:
        """Return the answers that were stored, to these imperfections."""
        by_name = {kind.name: kind for kind in kinds}
        return [
            Tolerance(**{**answer, "imperfection": by_name[answer["imperfection"]]})
            for answer in self.answers
        ]

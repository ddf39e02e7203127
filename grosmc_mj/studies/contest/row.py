"""Row of a law in a contest."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pydantic import BaseModel

from grosmc_mj.output.results.verdicts import Verdict
from grosmc_mj.studies.margins.changes import DELAY
from grosmc_mj.studies.tune.conditions import PLANTS
from grosmc_mj.studies.tune.row import TunedNumberRow


class Entry(BaseModel):
    """A law with some numbers, judged.

    Attributes:
        step: ``as in the file`` or ``tuned``.
        verdicts: Verdicts on draws of no search, by condition.
        worst_disturbance: Share of the tightest limit under the worst disturbance that was found;
            None if none was searched, or there can be no run.
        margins: Verdicts on gain and delay of the nominal task, or the one that it is not kept.
        largest_input: Largest |u| of a run under each condition, in the unit of the input; None
            without such a run.
        variation: Largest total variation of u per second of these runs; None without a run.
    """

    step: str
    verdicts: list[Verdict]
    worst_disturbance: float | None = None
    margins: list[Verdict] = []
    largest_input: float | None = None
    variation: float | None = None

    @property
    def kept(self) -> bool:
        """Whether all is kept on all draws and plants."""
        return all(verdict.kept for verdict in self.verdicts)

    @property
    def share(self) -> float:
        """Share of the tightest limit, in the worst draw or plant."""
        return max(verdict.share for verdict in self.verdicts)

    @property
    def kept_draws(self) -> int:
        """Draws and plants that keep all, of all conditions together."""
        return sum(verdict.kept_draws for verdict in self.verdicts)

    @property
    def draws(self) -> int:
        """Draws and plants of all conditions together."""
        return sum(verdict.draws for verdict in self.verdicts)

    @property
    def on_machine(self) -> list[Verdict]:
        """Verdicts on the machine as the file has it."""
        return [verdict for verdict in self.verdicts if verdict.condition != PLANTS]

    @property
    def on_plants(self) -> Verdict | None:
        """Verdict on random plants; None if there are none."""
        for verdict in self.verdicts:
            if verdict.condition == PLANTS:
                return verdict
        return None

    def margin(self, kind: str) -> str:
        """Return the largest change of a kind that is kept, as text; ``-`` if not even none is."""
        for verdict in self.margins:
            if verdict.step == kind:
                return f"{verdict.text} ms" if kind == DELAY else verdict.text
        return "-"


class ContestLaw(BaseModel):
    """Row of a law.

    Attributes:
        law: Name of the law.
        numbers: The numbers that were tuned.
        runs: Runs of its search.
        tuned_share: Share of the tightest limit on the draws that it was tuned on.
        entries: The law with the numbers of the file, and with tuned ones.
        refused: Why it could not be tuned; empty if it could.
    """

    law: str
    numbers: list[TunedNumberRow] = []
    runs: int = 0
    tuned_share: float = math.inf
    entries: list[Entry] = []
    refused: str = ""

    @property
    def unchanged(self) -> bool:
        """Whether no number is better than that of the file."""
        return all(number.before == number.after for number in self.numbers)

    @property
    def tuned(self) -> Entry | None:
        """The law with tuned numbers; None if it could not be tuned."""
        return self.entries[-1] if self.entries else None

    @property
    def kept(self) -> bool:
        """Whether the tuned law keeps all on draws of no search."""
        return self.tuned is not None and self.tuned.kept


def simplest(rows: Sequence[ContestLaw]) -> ContestLaw | None:
    """Return the simplest law that keeps all: fewest tuned numbers, then the smallest share."""
    keeping = [row for row in rows if row.kept]
    return min(keeping, key=_order, default=None)


def _order(row: ContestLaw) -> tuple[int, float]:
    assert row.tuned is not None
    return len(row.numbers), row.tuned.share

"""Worst disturbance of a law that was found: a row of the study."""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict

# Share beyond that of any run that reached its end.
ENDED = 1e6
# The search has a worse signal than the control by more than rounding.
BETTER = 1 + 1e-9


class WorstDisturbance(BaseModel):
    """The worst disturbance of a law that was found.

    Attributes:
        law: Name of the law.
        bound: Bound, in its unit.
        signal: Pieces and deviations of the start, in parts of their bounds.
        pieces: Number of pieces.
        calm_share: Measured over allowed value of the requirement that is nearest to its limit,
            without any disturbance; of a run that ends early nothing else is searched.
        share: The same under the worst disturbance.
        requirement: The requirement that is nearest to its limit then, in words.
        compared_share: The share under the disturbance that it is compared with.
        search_share: The largest share by pulses and flips.
        telegraph_share: The largest share under random telegraph signals.
        runs: Runs of pulses and flips, and as many telegraph signals.
        change: Change of the share from half the pieces to all, in parts of it.
        confirmed: The share in MuJoCo; None where that made the runs, or there is none.
        largest: The largest bound up to which all was kept, and the smallest at which not: infinite
            if none was found; None if it is not searched, or not all is kept without a disturbance.
    """

    model_config = ConfigDict(frozen=True)

    law: str
    bound: float
    signal: list[float]
    pieces: int
    calm_share: float
    share: float
    requirement: str
    compared_share: float
    search_share: float
    telegraph_share: float
    runs: int
    change: float
    confirmed: float | None = None
    largest: tuple[float, float] | None = None

    @property
    def kept(self) -> bool:
        """Whether everything is kept under it."""
        return self.share <= 1

    @property
    def kept_when_calm(self) -> bool:
        """Whether everything is kept without any disturbance."""
        return self.calm_share <= 1

    @property
    def ends(self) -> bool:
        """Whether the run under it ends early."""
        return self.share > ENDED

    @property
    def switches(self) -> int:
        """Number of changes of its sign."""
        signs = np.sign(self.signal[: self.pieces])
        return int(np.count_nonzero(np.diff(signs)))

    @property
    def telegraph_won(self) -> bool:
        """Whether the control found a worse signal than the search."""
        return self.telegraph_share > self.search_share * BETTER

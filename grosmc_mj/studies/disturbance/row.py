"""Worst disturbance of a law that was found: a row of the study."""

from __future__ import annotations

import numpy as np

from grosmc_mj.output.results.verdicts import Verdict

# Step of the verdict.
STEP = "worst disturbance"
# Share beyond that of any run that reached its end.
ENDED = 1e6
# The search has a worse signal than the control by more than rounding.
BETTER = 1 + 1e-9


class WorstDisturbance(Verdict):
    """Verdict on a law under the worst disturbance that was found.

    Its share is that by which signals are compared, see ``Outcomes.order``; its words are the
    requirement that is nearest to its limit. Sizes are bounds of a disturbance, in their unit:
    ``largest_kept`` is None if it is not searched, or not all is kept without any disturbance.

    Attributes:
        bound: Bound, in its unit.
        signal: Pieces and deviations of the start, in parts of their bounds.
        pieces: Number of pieces.
        calm_share: Share without any disturbance; of a run that ends early nothing else is
            searched.
        compared_share: The share under the disturbance that it is compared with.
        search_share: The largest share by pulses and flips.
        telegraph_share: The largest share under random telegraph signals.
        runs: Runs of pulses and flips, and as many telegraph signals.
        change: Change of the share from half the pieces to all, in parts of it.
        confirmed: The share in MuJoCo; None where that made the runs, or there is none.
    """

    bound: float
    signal: list[float]
    pieces: int
    calm_share: float
    compared_share: float
    search_share: float
    telegraph_share: float
    runs: int
    change: float
    confirmed: float | None = None

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

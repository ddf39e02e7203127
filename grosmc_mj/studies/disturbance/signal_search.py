"""Search for the signal within a bound that is worst for a loop, by pulses and flips.

A signal is a row of pieces from -1 to 1, in parts of its bound. Of a linear loop the worst signal
at an instant has the sign of the response to each piece alone: that is exact, and the largest value
is the L1 norm of the impulse response. Of any other loop it is where the search begins.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import counted

# A share that is larger by rounding alone is no better.
_BETTER = 1 + 1e-9
# Candidates that are judged in one batch.
_BATCH = 64
# Smallest probability with which a random telegraph switches after a piece.
_SLOWEST = 0.02


class EnoughError(Exception):
    """A share is large enough: the search need not go on."""


@dataclass
class SignalSearch:
    """Search for the signal with the largest share of a limit.

    Attributes:
        shares: Function from signals, (k, N), to measured over allowed values, (k,).
        responses: Function from signals, (k, N), to courses of the quantities, (k, M).
        size: Number of pieces N.
        enough: Share at which the search ends.
        advance: Told how far it is.
        best: The worst signal so far, (N,).
        share: Its share.
        runs: Number of runs so far.
    """

    shares: Callable[[Array], Array]
    responses: Callable[[Array], Array]
    size: int
    enough: float = np.inf
    advance: Callable[[str], object] = lambda _: None
    best: Array = field(init=False)
    share: float = -np.inf
    runs: int = 0

    def __post_init__(self) -> None:
        self.best = np.zeros(self.size)

    def judge(self, signals: Array) -> Array:
        """Return the shares of signals (k, N), and keep the worst one.

        Raises:
            EnoughError: If one is large enough.
        """
        parts = []
        for first in range(0, len(signals), _BATCH):
            some = signals[first : first + _BATCH]
            shares = self.shares(some)
            self.runs += len(some)
            parts.append(shares)

            worst = int(np.argmax(shares))
            if shares[worst] > self.share:
                self.share = float(shares[worst])
                self.best = some[worst].copy()
            self.advance(f"{counted(self.runs, 'run')}, {self.share:.3g}")
            if self.share >= self.enough:
                raise EnoughError
        return np.concatenate(parts)

    def pulses(self) -> None:
        """Judge, for each instant, the signs of the responses there to each piece alone."""
        alone = np.vstack([np.zeros(self.size), np.eye(self.size)])
        courses = self.responses(alone)
        self.runs += len(alone)
        responses = courses[1:] - courses[0]

        signs = np.where(responses.T >= 0, 1.0, -1.0)
        self.judge(np.unique(np.vstack([signs, -signs]), axis=0))

    def flips(self, budget: int) -> None:
        """Flip pieces, and all that follow one, while it gets worse.

        Args:
            budget: Largest number of runs.
        """
        last = self.runs + budget
        while self.runs + 2 * self.size <= last:
            before = self.share
            start = self.best.copy()
            shares = self.judge(_flipped(start))
            if self.share <= before * _BETTER:
                return

            # The pieces that make it worse alone, together: all, half and a quarter of them.
            of_pieces = shares[: self.size]
            order = np.argsort(-of_pieces)
            helpful = order[of_pieces[order] > before]
            together = []
            for count in (len(helpful), len(helpful) // 2, len(helpful) // 4):
                if count > 1:
                    signal = start.copy()
                    signal[helpful[:count]] *= -1
                    together.append(signal)
            if together:
                self.judge(np.stack(together))

    def telegraphs(self, count: int, generator: np.random.Generator) -> None:
        """Judge random telegraph signals, which switch at random rates.

        Args:
            count: Number of them.
            generator: Random numbers.
        """
        rates = _SLOWEST ** generator.uniform(0, 1, (count, 1))
        switches = generator.random((count, self.size)) < rates
        switches[:, 0] = generator.random(count) < 0.5
        self.judge(np.cumprod(np.where(switches, -1.0, 1.0), axis=1, dtype=float))


def _flipped(signal: Array) -> Array:
    """Return a signal with each piece flipped, then with all from each piece on, (2 N, N)."""
    size = len(signal)
    from_each_on = np.triu(np.ones((size, size), bool))
    flips = np.vstack([np.eye(size, dtype=bool), from_each_on])
    return np.where(flips, -signal, signal)

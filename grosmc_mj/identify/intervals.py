"""Intervals of fitted parameters where the residual is correlated in time.

The rounding of an encoder, or a motion that the model lacks, leaves residuals that are alike from
sample to sample: intervals that take them for white noise are too narrow. With the derivatives J
of the residual r by the parameters,

    cov = (J'J)^-1 S (J'J)^-1,
    S = sum_l (1 - |l|/(L + 1)) sum_t (J_t r_t) (J_(t+l) r_(t+l))',

W. K. Newey and K. D. West, Econometrica 55, 1987, with the lags L of D. W. K. Andrews,
Econometrica 59, 1991, for a residual of first order,

    L = 1.1447 (4 rho^2/(1 - rho^2)^2 N)^(1/3).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array

# Share of a piece that its lags may be, at most: of longer ones there are too few pairs.
_MOST_LAGS = 0.25
# The residual of a log without noise is alike from sample to sample but for rounding.
_MOST_ALIKE = 0.999


def covariance(jacobian: Array, residual: Array, fitted: int, pieces: Sequence[slice]) -> Array:
    """Covariance of fitted parameters, (fitted, fitted).

    Args:
        jacobian: Derivatives of the residual by the parameters, and behind them by what is fitted
            with them and of no interest, such as starts, (N, p).
        residual: At the least squares, (N,).
        fitted: Number of the parameters.
        pieces: Samples one after the other in time, of one measured state each.
    """
    sensitivity = _without(jacobian[:, fitted:], jacobian[:, :fitted])
    scores = sensitivity * residual[:, None]
    lags = _lags(residual, pieces)
    spread = np.zeros((fitted, fitted))
    for piece in pieces:
        of_piece = scores[piece]
        spread += of_piece.T @ of_piece
        for lag in range(1, min(lags, len(of_piece) - 1) + 1):
            product = of_piece[lag:].T @ of_piece[:-lag]
            spread += (1 - lag / (lags + 1)) * (product + product.T)

    samples, unknowns = jacobian.shape
    bread = np.linalg.inv(sensitivity.T @ sensitivity)
    return bread @ spread @ bread * samples / max(1, samples - unknowns)


def half_widths(covariance: Array, degrees_of_freedom: int) -> Array:
    """Half widths of 95 % intervals, (n,), of parameters with a covariance, (n, n)."""
    quantile = stats.t.ppf(0.975, max(1, degrees_of_freedom))
    return quantile * np.sqrt(np.diag(covariance))


def _without(nuisance: Array, columns: Array) -> Array:
    """Residuals of the columns after a least-squares fit of the nuisance to them."""
    moved = nuisance[:, np.abs(nuisance).max(axis=0) > 0]
    if not moved.size:
        return columns
    return columns - moved @ np.linalg.lstsq(moved, columns, rcond=None)[0]


def _lags(residual: Array, pieces: Sequence[slice]) -> int:
    """Number of lags at which the residual is still correlated."""
    power = float(residual @ residual)
    if power == 0:
        return 0
    alike = sum(float(residual[piece][1:] @ residual[piece][:-1]) for piece in pieces) / power
    rho = float(np.clip(alike, -_MOST_ALIKE, _MOST_ALIKE))
    lags = 1.1447 * (4 * rho**2 / (1 - rho**2) ** 2 * len(residual)) ** (1 / 3)
    longest = max(piece.stop - piece.start for piece in pieces)
    return min(int(np.ceil(lags)), int(_MOST_LAGS * longest))

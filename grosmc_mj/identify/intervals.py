"""Intervals of fitted parameters where the residual is correlated in time.

The rounding of an encoder, or a motion that the model lacks, leaves residuals that are alike from
sample to sample: intervals that take them for white noise are too narrow. With the derivatives J
of the residual r by the parameters,

    cov = (J'J)^-1 S (J'J)^-1,
    S = sum_l (1 - |l|/(L + 1)) sum_t (J_t r_t) (J_(t+l) r_(t+l))',

W. K. Newey and K. D. West, Econometrica 55, 1987, with the lags L of D. W. K. Andrews,
Econometrica 59, 1991, for a residual of first order,

    L = 1.1447 (4 rho^2/(1 - rho^2)^2 N)^(1/3).

Whether a residual is alike from sample to sample is tested by G. M. Ljung and G. E. P. Box,
Biometrika 65, 1978.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from grosmc_mj.ground.arrays import Array

# Share of a piece that its lags may be, at most: of longer ones there are too few pairs.
_MOST_LAGS = 0.25
# Lags of the autocorrelation that are tested, at most, and as a share of a window.
_TESTED_LAGS = 20
_TESTED_SHARE = 1 / 4
# Fewer samples in all, or fewer lags, are too short to tell.
_FEWEST = 50
_FEWEST_LAGS = 3
# Level of the whole test.
_LEVEL = 0.01
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


def is_white(windows: Sequence[Array]) -> bool | None:
    """Whether residuals are uncorrelated in time, by Ljung and Box over all windows.

    A window's start is fitted: that takes a straight line out of white noise, and leaves the rest
    correlated. What white noise would have without its line is subtracted, so that windows of a
    few samples are tested too.

    Args:
        windows: Residuals at samples one after the other, (K,) each.

    Returns:
        None if they are too short to tell.
    """
    longest = max(map(len, windows), default=0)
    lags = int(min(_TESTED_LAGS, _TESTED_SHARE * longest))
    windows = [window for window in windows if len(window) > 3 * lags]
    count = sum(map(len, windows))
    if lags < _FEWEST_LAGS or count < _FEWEST:
        return None

    products = np.zeros(lags + 1)
    of_noise = np.zeros(lags + 1)
    for window in windows:
        line, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, len(window)), 2))
        error = window - line @ (line.T @ window)
        for lag in range(lags + 1):
            last = len(error) - lag
            products[lag] += error[lag:] @ error[:last]
            of_noise[lag] -= np.sum(line[lag:] * line[:last])
    of_noise[0] += count

    # Q = n (n + 2) sum of rho_k^2 / (n - k) over the lags k, of chi-squared distribution.
    variance = products[0] / of_noise[0]
    rho = (products - variance * of_noise) / max(products[0], 1e-300)
    pairs = np.array([count - lag * len(windows) for lag in range(lags + 1)])
    statistic = count**2 * np.sum(rho[1:] ** 2 / pairs[1:])
    return bool(stats.chi2.sf(statistic, lags) > _LEVEL)

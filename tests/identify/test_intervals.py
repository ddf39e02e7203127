"""Intervals of a fit contain the truth as often as they say, whatever the residual is like."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from grosmc_mj.ground.arrays import Array
from grosmc_mj.identify.intervals import covariance, half_widths, is_white

SAMPLES = 2000
REPETITIONS = 400
T = np.linspace(0.0, 1.0, SAMPLES)
# A slope that is asked for, and an offset that is fitted with it.
J = np.column_stack([T, np.ones(SAMPLES)])
HALVES = [slice(0, 1000), slice(1000, 2000)]


def white(random: np.random.Generator) -> Array:
    return random.standard_normal(SAMPLES)


def correlated(random: np.random.Generator) -> Array:
    """A noise of first order: 0.8 of a sample is left in the next one."""
    return np.asarray(lfilter([1.0], [1.0, -0.8], white(random)))


def rounded(random: np.random.Generator) -> Array:
    """The error of an encoder on a slow ramp of another slope each time."""
    angle = random.uniform(50, 150) * T + random.uniform()
    return np.round(angle) - angle


def coverage(noise: object) -> float:
    """Share of intervals of the slope that contain it."""
    inside = 0
    for seed in range(REPETITIONS):
        error = noise(np.random.default_rng(seed))  # pyright: ignore[reportCallIssue]
        solution = np.linalg.lstsq(J, error, rcond=None)[0]
        residual = error - J @ solution
        cov = covariance(J, residual, 1, HALVES)
        (half,) = half_widths(cov, SAMPLES - 2)
        inside += abs(solution[0]) <= half
    return inside / REPETITIONS


@pytest.mark.parametrize(("noise", "least"), [(white, 0.92), (correlated, 0.90), (rounded, 0.92)])
def test_an_interval_contains_the_truth_as_often_as_it_says(noise: object, least: float) -> None:
    """Of 400 intervals that contain it in 95 %, 92 % or more do; the lags cost some."""
    assert least <= coverage(noise)


def test_white_residuals_have_the_textbooks_interval() -> None:
    """S = sigma^2 J'J, so that the sandwich is sigma^2 (J'J)^-1."""
    residual = white(np.random.default_rng(3))
    residual -= J @ np.linalg.lstsq(J, residual, rcond=None)[0]
    variance = residual @ residual / (SAMPLES - 2)
    textbook = variance * np.linalg.inv(J.T @ J)[0, 0]
    assert covariance(J, residual, 1, HALVES)[0, 0] == pytest.approx(textbook, rel=0.15)


def share_white(samples: int, windows: int, phi: float) -> float:
    """Share of residuals that are called white, of noise from which lines are fitted.

    Args:
        samples: Of a window.
        windows: Number of them.
        phi: Share of a sample that is left in the next one.
    """
    random = np.random.default_rng(3)
    t = np.linspace(-1, 1, samples)
    line = np.column_stack([t, np.ones(samples)])
    found = []
    for _ in range(REPETITIONS // 2):
        noise = lfilter([1.0], [1.0, -phi], random.standard_normal((samples, windows)), axis=0)
        fitted = line @ np.linalg.lstsq(line, noise, rcond=None)[0]
        found.append(is_white([*(noise - fitted).T]))
    return float(np.mean([answer is True for answer in found]))


# Windows of 1 s at 500 Hz, 50 Hz and 12 Hz.
WINDOWS = [(500, 3), (50, 6), (12, 25)]


@pytest.mark.parametrize(("samples", "windows"), WINDOWS)
def test_white_residuals_of_any_rate_are_white(samples: int, windows: int) -> None:
    assert share_white(samples, windows, 0.0) > 0.96


@pytest.mark.parametrize(("samples", "windows"), WINDOWS)
def test_correlated_residuals_of_any_rate_are_not_white(samples: int, windows: int) -> None:
    assert share_white(samples, windows, 0.5) < 0.05


@pytest.mark.parametrize("windows", [[np.arange(8.0)] * 30, [np.arange(30.0)], []])
def test_residuals_may_be_too_short_to_tell(windows: list[Array]) -> None:
    assert is_white(windows) is None

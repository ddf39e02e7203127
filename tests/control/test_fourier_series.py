"""Periodic references as cut Fourier series."""

from __future__ import annotations

import numpy as np
import pytest

from grosmc_mj.control.references import FourierSeries, fourier_series
from grosmc_mj.errors import ArgumentError

RANDOM = np.random.default_rng(5)
SERIES = FourierSeries(0.7, RANDOM.normal(size=2), *RANDOM.normal(size=(2, 2, 4)))


def test_it_is_the_sum_that_it_is_documented_as() -> None:
    reference, k = fourier_series(2, 4), np.arange(1, 5)
    for t in (0.0, 0.4, 3.7, 50.0):
        c, s = np.cos(0.7 * k * t), np.sin(0.7 * k * t)
        wanted = SERIES.mean + SERIES.cosine @ c + SERIES.sine @ s
        # The recurrence of sines loses a rounding in each of four steps.
        np.testing.assert_allclose(reference(t, SERIES)[::3], wanted, rtol=0, atol=1e-13)


def test_its_derivatives_are_exact() -> None:
    reference, e = fourier_series(2, 4), 1e-5
    for t in (0.0, 0.4, 3.7):
        now = np.array(reference(t, SERIES))
        ahead, behind = (np.array(reference(t + d, SERIES)) for d in (e, -e))
        for order in (0, 1):
            slope = (ahead - behind)[order::3] / (2 * e)
            # Central differences: rounding eps/e and curvature e^2 times the third derivative.
            np.testing.assert_allclose(now[order + 1 :: 3], slope, rtol=0, atol=1e-8)


def test_samples_of_a_series_give_it_back() -> None:
    reference, period = fourier_series(2, 4), 2 * np.pi / 0.7
    samples = [reference(period * i / 20, SERIES)[::3] for i in range(20)]
    found = FourierSeries.through(samples, 0.7, 4)
    for name in ("mean", "cosine", "sine"):
        np.testing.assert_allclose(getattr(found, name), getattr(SERIES, name), atol=1e-14)
    with pytest.raises(ArgumentError, match="8 samples cannot give 4 harmonics"):
        FourierSeries.through(np.zeros((8, 1)), 1.0, 4)

"""Random numbers by their number: the published vectors, and what noise must be."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numba
import numpy as np
import pytest
import scipy.stats

from grosmc_mj.arrays import Array
from grosmc_mj.loop.counter import normal, philox, uniform

ONES = 0xFFFFFFFF
PI = (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344), (0xA4093822, 0x299F31D0)
# kat_vectors of Random123 1.14, "philox4x32 10": counter, key, words.
VECTORS = (
    ((0,) * 4, (0,) * 2, (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((ONES,) * 4, (ONES,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (*PI, (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1)),
)
N = 100_000
# Normal quantile that one sound generator in 10^7 is beyond; the numbers are always the same ones.
SIGMAS = 5.4


@numba.njit
def compiled(drawn: int, seed: float, run: float, signal: int, first: int, count: int) -> Any:
    numbers = np.empty(count)
    for i in range(count):
        if drawn == 0:
            numbers[i] = normal(seed, run, signal, first + i)
        else:
            numbers[i] = uniform(seed, run, signal, first + i)
    return numbers


@cache
def normals(seed: int = 0, run: int = 0, signal: int = 0) -> Array:
    return compiled(0, seed, run, signal, 0, N)


@pytest.mark.parametrize(("counter", "key", "words"), VECTORS)
def test_philox_gives_the_published_words(counter: Any, key: Any, words: Any) -> None:
    assert philox(*counter, *key) == words
    assert tuple(numba.njit(philox)(*counter, *key)) == words


@pytest.mark.parametrize("seed", [0, 2**32, 2**53 - 1])
@pytest.mark.parametrize("run", [0, 2**40 + 5])
def test_compiled_and_plain_numbers_are_the_same_bits(seed: int, run: int) -> None:
    """Beyond 32 bits too: compiled integers wrap round, Python's do not."""
    for first in (0, 2**32 - 2, 2**40):
        for drawn, function in enumerate((normal, uniform)):
            numbers = compiled(drawn, seed, run, 7, first, 5)
            assert numbers.tolist() == [function(seed, run, 7, first + i) for i in range(5)]


def test_numbers_beyond_32_bits_do_not_repeat() -> None:
    high = (0, 2**32, 2**33)
    drawn = {uniform(s, r, 0, number) for s in high for r in high for number in high}
    assert len(drawn) == 27
    # A signal does not run into the high half of a run's number.
    assert uniform(0, 0, 255, 0) != uniform(0, 2**32, 0, 0)


def test_distributions_are_normal_and_uniform() -> None:
    """Of N powers x^k the mean is off by sqrt((E x^2k - (E x^k)^2) / N).

    Kolmogorov and Smirnov's D sqrt(N) is above 2.9 once in 10^7: 2 exp(-2 d^2).
    """
    x = normals()
    moment = {k: math.prod(range(1, k, 2)) if k % 2 == 0 else 0 for k in range(1, 13)}
    for k in range(1, 7):
        deviation = math.sqrt((moment[2 * k] - moment[k] ** 2) / N)
        assert abs(np.mean(x**k) - moment[k]) < SIGMAS * deviation, k
    bound = math.sqrt(0.5 * math.log(2e7) / N)
    assert scipy.stats.kstest(x, "norm").statistic < bound
    assert scipy.stats.kstest(compiled(1, 0, 0, 0, 0, N), "uniform").statistic < bound


@pytest.mark.parametrize("lag", [0, 1, 10])
def test_runs_signals_and_seeds_are_independent(lag: int) -> None:
    """The mean of N products of independent normal numbers is off by 1 / sqrt(N)."""
    keys = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (2**32, 0, 0), (0, 2**32, 0))
    streams = [normals(*key) for key in keys]
    for i, x in enumerate(streams):
        for j, y in enumerate(streams):
            if lag > 0 or i < j:
                correlation = np.mean(x[: N - lag] * y[lag:])
                assert abs(correlation) < SIGMAS / math.sqrt(N - lag), (i, j)

"""Random numbers by their number: the published vectors, and what noise must be."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import scipy.stats

from grosmc_mj.loop.counter import normal, philox, uniform

ONES = 0xFFFFFFFF
PI = (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344), (0xA4093822, 0x299F31D0)
# kat_vectors of Random123 1.14, "philox4x32 10": counter, key, words.
VECTORS = (
    ((0,) * 4, (0,) * 2, (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((ONES,) * 4, (ONES,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (*PI, (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1)),
)


@numba.njit
def compiled(drawn: int, seed: float, run: float, signal: int, first: int, count: int) -> Any:
    numbers = np.empty(count)
    for i in range(count):
        if drawn == 0:
            numbers[i] = normal(seed, run, signal, first + i)
        else:
            numbers[i] = uniform(seed, run, signal, first + i)
    return numbers


def test_philox_gives_the_published_words_compiled_and_plain() -> None:
    """Beyond 32 bits too: compiled integers wrap round, Python's do not."""
    for counter, key, words in VECTORS:
        assert philox(*counter, *key) == words
        assert tuple(numba.njit(philox)(*counter, *key)) == words
    for seed, run, first in ((0, 0, 0), (2**53 - 1, 2**40 + 5, 2**32 - 2)):
        for drawn, function in enumerate((normal, uniform)):
            numbers = compiled(drawn, seed, run, 7, first, 5)
            assert numbers.tolist() == [function(seed, run, 7, first + i) for i in range(5)]
    high = (0, 2**32, 2**33)
    drawn = {uniform(s, r, 0, number) for s in high for r in high for number in high}
    assert len(drawn) == 27
    # A signal does not run into the high half of a run's number.
    assert uniform(0, 0, 255, 0) != uniform(0, 2**32, 0, 0)


def test_numbers_are_normal_uniform_and_independent() -> None:
    """Kolmogorov and Smirnov's D sqrt(N) is above 2.9 once in 10^7: 2 exp(-2 d^2).

    The mean of N products of independent normal numbers is off by 1 / sqrt(N), by 5.4 of that once
    in 10^7.
    """
    N = 100_000
    x, *others = (
        compiled(0, *key, 0, N)
        for key in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (2**32, 0, 0), (0, 2**32, 0))
    )
    bound = math.sqrt(0.5 * math.log(2e7) / N)
    assert scipy.stats.kstest(x, "norm").statistic < bound
    assert scipy.stats.kstest(compiled(1, 0, 0, 0, 0, N), "uniform").statistic < bound
    for y in (*others, np.roll(x, 1), np.roll(x, 10)):
        assert abs(np.mean(x * y)) < 5.4 / math.sqrt(N)

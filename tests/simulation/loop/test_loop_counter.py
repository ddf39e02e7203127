"""Random numbers by their number: published vectors, distribution and independence."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numba
import numpy as np
import pytest
import scipy.stats

from grosmc_mj.simulation.loop.counter import normal, philox, uniform

N = 100_000
# kat_vectors of Random123 1.14, "philox4x32 10": counter, key, words.
VECTORS = [
    (
        (0x00000000, 0x00000000, 0x00000000, 0x00000000),
        (0x00000000, 0x00000000),
        (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8),
    ),
    (
        (0xFFFFFFFF, 0xFFFFFFFF, 0xFFFFFFFF, 0xFFFFFFFF),
        (0xFFFFFFFF, 0xFFFFFFFF),
        (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD),
    ),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@numba.njit
def normal_numbers(seed: float, run: float, signal: int, first: int, count: int) -> Any:
    numbers = np.empty(count)
    for i in range(count):
        numbers[i] = normal(seed, run, signal, first + i)
    return numbers


@numba.njit
def uniform_numbers(seed: float, run: float, signal: int, first: int, count: int) -> Any:
    numbers = np.empty(count)
    for i in range(count):
        numbers[i] = uniform(seed, run, signal, first + i)
    return numbers


@pytest.mark.parametrize("function", [philox, numba.njit(philox)], ids=["python", "compiled"])
@pytest.mark.parametrize(("counter", "key", "words"), VECTORS)
def test_philox_gives_the_published_words(
    function: Any, counter: Any, key: Any, words: Any
) -> None:
    assert tuple(function(*counter, *key)) == words


@pytest.mark.parametrize(
    ("compiled", "plain"), [(normal_numbers, normal), (uniform_numbers, uniform)]
)
@pytest.mark.parametrize(("seed", "run", "first"), [(0, 0, 0), (2**53 - 1, 2**40 + 5, 2**32 - 2)])
def test_compiled_numbers_are_the_plain_ones(
    compiled: Any, plain: Any, seed: int, run: int, first: int
) -> None:
    """Beyond 32 bits too: compiled integers wrap round, Python's do not."""
    numbers = compiled(seed, run, 7, first, 5)
    assert numbers.tolist() == [plain(seed, run, 7, first + i) for i in range(5)]


def test_numbers_beyond_32_bits_differ() -> None:
    keys = itertools.product((0, 2**32, 2**33), repeat=3)
    numbers = {uniform(seed, run, 0, number) for seed, run, number in keys}
    assert len(numbers) == 27


def test_a_signal_does_not_run_into_the_high_half_of_a_run_s_number() -> None:
    assert uniform(0, 0, 255, 0) != uniform(0, 2**32, 0, 0)


@pytest.mark.parametrize(
    ("numbers", "distribution"), [(normal_numbers, "norm"), (uniform_numbers, "uniform")]
)
def test_numbers_have_their_distribution(numbers: Any, distribution: str) -> None:
    """Kolmogorov and Smirnov's D sqrt(N) is above 2.9 once in 10^7: 2 exp(-2 d^2)."""
    sample = numbers(0, 0, 0, 0, N)
    statistic = scipy.stats.kstest(sample, distribution).statistic
    assert statistic < math.sqrt(0.5 * math.log(2e7) / N)


# The mean of N products of independent normal numbers is off by 1 / sqrt(N), and by 5.4 of that
# once in 10^7.
MOST = 5.4 / math.sqrt(N)


@pytest.mark.parametrize(
    ("seed", "run", "signal"), [(1, 0, 0), (0, 1, 0), (0, 0, 1), (2**32, 0, 0), (0, 2**32, 0)]
)
def test_numbers_of_two_signals_are_independent(seed: int, run: int, signal: int) -> None:
    x = normal_numbers(0, 0, 0, 0, N)
    assert abs(np.mean(x * normal_numbers(seed, run, signal, 0, N))) < MOST


@pytest.mark.parametrize("lag", [1, 10])
def test_numbers_of_one_signal_are_independent(lag: int) -> None:
    x = normal_numbers(0, 0, 0, 0, N)
    assert abs(np.mean(x * np.roll(x, lag))) < MOST

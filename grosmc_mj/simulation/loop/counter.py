"""Random numbers by a counter: each is computed from its number alone, in any order.

J. K. Salmon, M. A. Moraes, R. O. Dror and D. E. Shaw, "Parallel random numbers: as easy as 1, 2,
3", SC11, 2011: Philox4x32 with ten rounds. Nothing is kept between two numbers, so a run has the
same noise in every engine, batch and process, and when it is run alone.
"""

from __future__ import annotations

import math

from grosmc_mj.ground.compilation.jitable import jitable

_WORD = 0xFFFFFFFF
# Multipliers and increments of the keys of Philox4x32.
_FIRST = 0xD2511F53
_SECOND = 0xCD9E8D57
_GOLDEN = 0x9E3779B9
_ROOT = 0xBB67AE85
_ROUNDS = 10
Words = tuple[int, int, int, int]


@jitable
def philox(
    a: int,
    b: int,
    c: int,
    d: int,
    key: int,
    other_key: int,
) -> Words:
    """Four random words of 32 bits from a counter of four and a key of two."""
    for _ in range(_ROUNDS):
        # Compiled integers have 64 bits and wrap round; Python's do not: the masks make them one.
        first = _FIRST * a
        second = _SECOND * c
        a = ((second >> 32) & _WORD) ^ b ^ key
        b = second & _WORD
        c = ((first >> 32) & _WORD) ^ d ^ other_key
        d = first & _WORD
        key = (key + _GOLDEN) & _WORD
        other_key = (other_key + _ROOT) & _WORD
    return a, b, c, d


@jitable
def _uniform(high: int, low: int) -> float:
    """Number of [0, 1) with 53 bits from two words."""
    return ((high >> 5) * 67108864.0 + (low >> 6)) / 9007199254740992.0


@jitable
def _words(
    seed: float,
    run: float,
    signal: int,
    number: int,
) -> Words:
    """Words of a number of a signal of a run."""
    s = int(seed)
    r = int(run)
    n = int(number)
    return philox(n & _WORD, n >> 32, signal + ((r >> 32) << 8), s >> 32, s & _WORD, r & _WORD)


@jitable
def uniform(
    seed: float,
    run: float,
    signal: int,
    number: int,
) -> float:
    """Uniform number of [0, 1).

    Args:
        seed: Seed of all runs, a whole number up to 2^53.
        run: Number of the run, up to 2^53.
        signal: Number of the signal, up to 255.
        number: Number of the random number in the signal.
    """
    a, b, _c, _d = _words(seed, run, signal, number)
    return _uniform(a, b)


@jitable
def normal(
    seed: float,
    run: float,
    signal: int,
    number: int,
) -> float:
    """Normal number of mean 0 and standard deviation 1, by Box and Muller; see ``uniform``."""
    a, b, c, d = _words(seed, run, signal, number)
    radius = math.sqrt(-2.0 * math.log(1.0 - _uniform(a, b)))
    return radius * math.cos(2.0 * math.pi * _uniform(c, d))

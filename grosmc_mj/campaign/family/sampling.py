"""Points of the unit cube, each by the seed and its own number alone."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Mapping

import numpy as np
from scipy.stats import qmc

from grosmc_mj.arrays import Array

# Points of one Sobol sequence and of one Latin hypercube. Number i lies in the (i // this)-th,
# each randomised anew, so that it depends on nothing but the seed and i and is quickly computed.
SEQUENCE, HYPERCUBE = 2**16, 128
# Points stay off the faces of the cube, where quantiles may be infinite.
_EDGE = 2.0**-53


def sobol(dimensions: int, seed: int, first: int, count: int) -> Array:
    """Sobol sequences of 65,536 points, one after another, scrambled (Owen)."""

    def part(sequence: int, start: int, points: int) -> Array:
        engine = qmc.Sobol(dimensions, rng=np.random.default_rng([seed, sequence]))
        if start:
            engine.fast_forward(start)
        with warnings.catch_warnings():
            # A shard is part of a sequence, whose balance is not the shard's.
            warnings.filterwarnings("ignore", "The balance properties", UserWarning)
            return engine.random(points)

    return _in_blocks(SEQUENCE, first, count, part)


def latin_hypercube(dimensions: int, seed: int, first: int, count: int) -> Array:
    """Latin hypercubes of 128 points, one after another."""

    def part(cube: int, start: int, points: int) -> Array:
        engine = qmc.LatinHypercube(dimensions, rng=np.random.default_rng([seed, cube]))
        return engine.random(HYPERCUBE)[start : start + points]

    return _in_blocks(HYPERCUBE, first, count, part)


def _in_blocks(size: int, first: int, count: int, part: Callable[[int, int, int], Array]) -> Array:
    """Points first, first + 1 ... of blocks of a size: each ``part`` is (block, start, points)."""
    parts = []
    while count:
        block, start = divmod(first, size)
        points = min(count, size - start)
        parts.append(part(block, start, points))
        first, count = first + points, count - points
    return np.concatenate(parts)


def independent(dimensions: int, seed: int, first: int, count: int) -> Array:
    """Independent points."""
    rows = [
        np.random.Generator(np.random.Philox(key=seed, counter=[0, 0, 0, i])).random(dimensions)
        for i in range(first, first + count)
    ]
    return np.array(rows).reshape(count, dimensions)


def corners(dimensions: int, seed: int, first: int, count: int) -> Array:
    """The corners of the cube, of which there are 2^d: bit j of i is coordinate j."""
    bits = np.arange(first, first + count)[:, None] >> np.arange(dimensions)
    return (bits & 1).astype(float)


Sampler = Callable[[int, int, int, int], Array]
SAMPLERS: Mapping[str, Sampler] = {
    "random": independent,
    "sobol": sobol,
    "lhs": latin_hypercube,
    "corners": corners,
}


def unit_points(sampler: str, dimensions: int, seed: int, first: int, count: int) -> Array:
    """Points number first, first + 1 ... of a sampler.

    Args:
        sampler: One of ``SAMPLERS``.
        dimensions: Of the cube.
        seed: Of all the points.
        first: Number of the first one.
        count: How many.

    Returns:
        Points, (count, dimensions).
    """
    points = SAMPLERS[sampler](dimensions, seed, first, count)
    return points if sampler == "corners" else inside(points)


def inside(points: Array) -> Array:
    """Points of the cube, moved off its faces."""
    return np.clip(points, _EDGE, 1 - _EDGE)


def all_corners(dimensions: int, most: int) -> Array:
    """The corners of the unit cube, if there are not more than ``most``; (2^d, d) or (0, d)."""
    if 2**dimensions > most:
        return np.zeros((0, dimensions))
    return np.array(list(itertools.product((0.0, 1.0), repeat=dimensions)))

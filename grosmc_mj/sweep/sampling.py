"""Points of the unit cube, each by the seed and its own number alone."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping

import numpy as np
from scipy.stats import qmc

from grosmc_mj.arrays import Array

# Points stay off the faces of the cube, where quantiles may be infinite.
_EDGE = 2.0**-53

# Points (count, d) from start on in a block: dimensions, seed, block, start, count.
Block = Callable[[int, int, int, int, int], Array]


def _independent(dimensions: int, seed: int, block: int, start: int, count: int) -> Array:
    """One point, by a generator of its own."""
    generator = np.random.Generator(np.random.Philox(key=seed, counter=[0, 0, 0, block]))
    return generator.random((count, dimensions))


def _sobol(dimensions: int, seed: int, block: int, start: int, count: int) -> Array:
    """A Sobol sequence, scrambled (Owen)."""
    engine = qmc.Sobol(dimensions, rng=np.random.default_rng([seed, block]))
    if start:
        engine.fast_forward(start)
    with warnings.catch_warnings():
        # A shard is part of a sequence, whose balance is not the shard's.
        warnings.filterwarnings("ignore", "The balance properties", UserWarning)
        return engine.random(count)


def _latin_hypercube(dimensions: int, seed: int, block: int, start: int, count: int) -> Array:
    engine = qmc.LatinHypercube(dimensions, rng=np.random.default_rng([seed, block]))
    return engine.random(HYPERCUBE)[start : start + count]


def _corners(dimensions: int, seed: int, block: int, start: int, count: int) -> Array:
    """The 2^d corners of the cube: bit j of a point's number is its coordinate j."""
    bits = np.arange(start, start + count)[:, None] >> np.arange(dimensions)
    return (bits & 1).astype(float)


# Points of one Sobol sequence and of one Latin hypercube; each block is randomised anew.
SEQUENCE, HYPERCUBE = 2**16, 128
SAMPLERS: Mapping[str, tuple[int, Block]] = {
    "random": (1, _independent),
    "sobol": (SEQUENCE, _sobol),
    "lhs": (HYPERCUBE, _latin_hypercube),
    "corners": (2**62, _corners),
}


def unit_points(sampler: str, dimensions: int, seed: int, first: int, count: int) -> Array:
    """Points number first, first + 1 ... of a sampler.

    Args:
        sampler: One of ``SAMPLERS``.
        dimensions: Of the cube, d.
        seed: Of all the points.
        first: Number of the first one.
        count: How many.

    Returns:
        Points, (count, d); only those of ``corners`` lie on the faces.
    """
    size, block_points = SAMPLERS[sampler]
    blocks: list[Array] = [np.zeros((0, dimensions))]
    while count > 0:
        block, start = divmod(first, size)
        points = min(count, size - start)
        blocks.append(block_points(dimensions, seed, block, start, points))
        first, count = first + points, count - points
    points = np.concatenate(blocks)
    return points if sampler == "corners" else inside(points)


def inside(points: Array) -> Array:
    """Points of the cube, moved off its faces."""
    return np.clip(points, _EDGE, 1 - _EDGE)

"""Ring buffers: the last rows of numbers, each found by its own number."""

from __future__ import annotations

from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable


def ring(rows: int, columns: int) -> Array:
    """Zeros in a power of two rows, more than ``rows``."""
    return np.zeros((1 << rows.bit_length(), columns))


@jitable
def ring_row(number: int, ring: Any) -> int:
    """Place of a row in a ring of a power of two rows, without a division, which is slow."""
    return number & (ring.shape[0] - 1)

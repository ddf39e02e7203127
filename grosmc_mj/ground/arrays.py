"""The array type of the package."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]


def as_rows(values: Array) -> Array:
    """Return values over N intervals as (N, m): those of one input have no axis of their own.

    N may be 0, of a run that ends in its first step.
    """
    return values.reshape(len(values), math.prod(values.shape[1:]))

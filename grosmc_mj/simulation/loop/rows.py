"""Rows of numbers: parts of a loop, which compiled code reads by names, and ring buffers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
from numba import types

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.fields import range_of
from grosmc_mj.simulation.loop.timing import TIMES


def numbers_of(part: type) -> Iterator[str]:
    """Names of the fields of a part that are numbers with bounds."""
    return (item.name for item in fields(part) if range_of(part, item.name) is not None)


def numbers_dtype(*names: str) -> np.dtype[Any]:
    """Dtype of a row of numbers with these names."""
    return np.dtype([(name, np.float64) for name in names])


def row_dtype(part: type, *memory: str) -> np.dtype[Any]:
    """Dtype of a row: the numbers of a part, then constants and memory of a run."""
    return numbers_dtype(*numbers_of(part), *memory)


def rows_type(dtype: np.dtype[Any]) -> types.Type:
    """Type in numba of an array of rows."""
    return types.Array(numba.from_dtype(dtype), 1, "C")


def row_objects(rows: np.ndarray[Any, Any]) -> list[SimpleNamespace]:
    """Rows as Python objects with the same names, for the stages as plain Python."""
    names = rows.dtype.names
    assert names is not None
    return [SimpleNamespace(**dict(zip(names, row, strict=True))) for row in rows.tolist()]


def rows_of(
    parts: Any,
    dtype: np.dtype[Any],
    h: float,
    **more: Any,
) -> np.ndarray[Any, Any]:
    """Make a row for each part, with its times in timesteps.

    Args:
        parts: Parts of one kind, at least one.
        dtype: Dtype of a row.
        h: Timestep [s].
        more: Further columns.
    """
    rows = np.zeros(len(parts), dtype)
    for name in numbers_of(type(parts[0])):
        values = [getattr(part, name) for part in parts]
        if name in TIMES:
            values = [round(value / h) for value in values]
        rows[name] = values
    for name, column in more.items():
        rows[name] = column
    return rows


def ring(rows: int, columns: int) -> Array:
    """Zeros in a power of two rows, more than ``rows``."""
    return np.zeros((1 << rows.bit_length(), columns))


@jitable
def ring_row(number: int, ring: Any) -> int:
    """Place of a row in a ring of a power of two rows, without a division, which is slow."""
    return number & (ring.shape[0] - 1)

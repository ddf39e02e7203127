"""Numbers in a column of a table, or instants as seconds."""

from __future__ import annotations

from decimal import Context, Decimal, localcontext
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute

from grosmc_mj.ground.arrays import Array

# Its functions are made at import: a type checker does not see them.
pc: Any = pyarrow.compute
# A number as text.
NUMBER = r"^[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?$"
# Digits of differences: more than any file has. Damaged numbers raise nothing, and become NaN.
_EXACT = Context(prec=60, traps=[])
# Rows that are exact numbers at a time: they take much more memory than floats.
_ROWS = 1 << 16
_TICKS_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def is_text(kind: pa.DataType) -> bool:
    """Whether a column of a kind has texts; other programs have more than one kind of them."""
    types = pa.types
    if types.is_dictionary(kind):
        kind = kind.value_type
    return types.is_string(kind) or types.is_large_string(kind)


def as_text(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return a column of any kind of text as one of strings, and any other column as it is."""
    return column.cast(pa.string()) if is_text(column.type) else column


def numbers_of(column: pa.ChunkedArray) -> Array | None:
    """Return the numbers of a column, or the seconds of its instants; NaN where there is none.

    Returns:
        (N,); None if nothing in it is a number.
    """
    if pa.types.is_string(column.type):
        is_number = pc.match_substring_regex(column, NUMBER)
        if not pc.any(is_number).as_py():
            column = _instants(column)
        else:
            column = pc.if_else(is_number, column, None).cast(pa.float64())
    kind = column.type

    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        # Nanoseconds since 1970 do not fit into a float: the difference is one of integers.
        ticks = column.cast(pa.int64()).to_numpy()
        return (ticks - ticks[:1]) / _TICKS_PER_SECOND[kind.unit]
    if pa.types.is_decimal(kind):
        column = column.cast(pa.float64())
    elif not pa.types.is_integer(kind) and not pa.types.is_floating(kind):
        return None
    return np.asarray(column.to_numpy(), float)


def are_instants(column: pa.ChunkedArray) -> bool:
    """Whether a column has dates or durations, which ``numbers_of`` returns as seconds."""
    kind = column.type
    if pa.types.is_string(kind):
        return not pc.any(pc.match_substring_regex(column, NUMBER)).as_py()
    return pa.types.is_timestamp(kind) or pa.types.is_duration(kind)


def steps_from_first(column: pa.ChunkedArray, factor: float) -> Array | None:
    """Return the numbers of a column from its first one on, times a factor, rounded once.

    Args:
        column: Integers, decimals, or texts that are numbers, without gaps.
        factor: Taken for the decimal number that it is written as, such as 0.001.

    Returns:
        (N,); None for a column of floats or of instants.
    """
    kind = column.type
    is_exact = pa.types.is_integer(kind) or pa.types.is_decimal(kind)
    if not is_exact and (not pa.types.is_string(kind) or are_instants(column)):
        return None

    with localcontext(_EXACT):
        first = Decimal(column[0].as_py())
        scale = Decimal(repr(factor))
        steps = np.empty(len(column))
        for begin in range(0, len(column), _ROWS):
            values = column.slice(begin, _ROWS).to_pylist()
            steps[begin : begin + _ROWS] = [float((Decimal(v) - first) * scale) for v in values]
        return steps


def _instants(texts: pa.ChunkedArray) -> pa.ChunkedArray:
    """Dates with times, in no zone or in one; the texts themselves if they are none."""
    for kind in (pa.timestamp("ns"), pa.timestamp("ns", "UTC")):
        try:
            return texts.cast(kind)
        except pa.ArrowInvalid:
            continue
    return texts

"""Size of the logs that are read."""

from __future__ import annotations

from grosmc_mj.errors import ArgumentError

# A log with more content, decompressed, is refused [bytes]: 134 million numbers.
LARGEST_LOG = 1 << 30


def too_large(size: int | None) -> ArgumentError:
    """Return the error of a log with too much content.

    Args:
        size: Of its content [bytes]; None if only a part of it was read.
    """
    has = "more than" if size is None else f"{size >> 20} MB, more than"
    return ArgumentError(
        f"holds {has} the {LARGEST_LOG >> 20} MB that are read: cut it, or keep fewer columns"
    )

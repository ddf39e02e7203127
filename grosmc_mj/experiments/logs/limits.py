"""Size of the logs that are read."""

from __future__ import annotations

from grosmc_mj.ground.errors import ArgumentError

# A log with more content, decompressed, is refused [bytes]: 134 million numbers.
LARGEST_LOG = 1 << 30
MOST_COLUMNS = 10_000


def too_large(size: int | None) -> ArgumentError:
    """Return the error of a log with too much content.

    Args:
        size: Of its content [bytes]; None if only a part of it was read.
    """
    has = "more than" if size is None else f"{size >> 20} MB, more than"
    return ArgumentError(
        f"it holds {has} the {LARGEST_LOG >> 20} MB that are read: cut it, or keep fewer columns"
    )


def require_few_columns(columns: int) -> None:
    """Refuse a log with so many columns that reading their names takes minutes.

    Raises:
        ArgumentError: With their number and the limit.
    """
    if columns > MOST_COLUMNS:
        raise ArgumentError(
            f"it has {columns} columns or more, and {MOST_COLUMNS} are read: keep the signals of "
            "the machine"
        )

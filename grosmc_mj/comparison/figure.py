"""One thing that results tell."""

from __future__ import annotations

from typing import NamedTuple

# What is more on one side of a comparison than on the other is better, worse, or just other.
MORE, LESS, OTHER = 1, -1, 0


class Figure(NamedTuple):
    """One thing that results tell.

    Attributes:
        kind: Of document that tells it.
        name: Of what, and which number of it.
        value: A number, a word, or None for what has none.
        better: ``MORE`` if more is better, ``LESS`` if less is, else ``OTHER``; words are ranked by
            :func:`~grosmc_mj.comparison.figures.direction`.
        metric: Name of the metric that the number is, or is a margin of; empty for others.
        switched: Whether a switching law made it, which amplifies rounding.
        unit: Of the number.
        size: What the number's relative accuracy is of; None for itself.
    """

    kind: str
    name: str
    value: float | str | None
    better: int = OTHER
    metric: str = ""
    switched: bool = False
    unit: str = ""
    size: float | None = None

"""``[log]`` of a case file: how its columns are read, and which of its samples are used."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator

from grosmc_mj.ground.errors import ArgumentError, value_text
from grosmc_mj.ground.units import Finite, PositiveSeconds, Seconds, Table, number_in


def _nonzero(scale: float) -> float:
    """Refuse a factor that makes every number 0."""
    if scale == 0:
        raise ValueError("0 must be another number: it would make every sample 0")
    return scale


def _window(value: Any) -> tuple[float, float]:
    """Return two instants [s] of a list of two times with their units.

    Raises:
        ArgumentError: If they are no times, or the second one is not later.
    """
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise ArgumentError(
            f'{value_text(value)} must be two times from the first sample on, such as ["3 s", '
            '"3.1 s"]'
        )
    first = number_in(value[0], "s")
    last = number_in(value[1], "s")
    if not first < last:
        raise ArgumentError(f"{first:g} to {last:g} s must end after it begins")
    return first, last


Window = Annotated[tuple[float, float], BeforeValidator(_window)]


class ColumnTable(Table):
    """``[log.columns]``: value = sign scale (column - offset), in its unit.

    Attributes:
        column: Header of the column.
        unit: Unit of its numbers; by default the signal's, or the one in the header. ``control``
            for commands of an actuator, before its gear.
        sign: -1 for an axis that points the other way.
        scale: Factor, such as radians in a count.
        offset: Offset in the column's own numbers.
        periodic: Whether it is an angle that jumps by a turn.
        delay: How late it shows its signal [s]; negative for a column that is ahead.
    """

    column: str
    unit: str = ""
    sign: Literal[1, -1] = 1
    scale: Annotated[Finite, AfterValidator(_nonzero)] = 1.0
    offset: Finite = 0.0
    periodic: bool = False
    delay: Seconds = 0.0


class LogTable(Table):
    """``[log]``: time and columns of a log of the machine, and what is used of it.

    Attributes:
        time: Header of the time's column; ``time`` or ``t`` by default.
        time_unit: Unit of its numbers; by default the one in the header, or seconds.
        sampling: Time between two samples, of a log without such a column.
        columns: Columns by the name of an input or a state.
        use: First and last instant that are used, from the first sample on [s]; all by default.
        mask: Windows between them that are not used.
        loss: ``squares`` of the residuals are fitted, or ``huber``: beyond 1.345 standard
            deviations a residual counts by its size, so that a push or a stray sample counts less.
    """

    time: str = ""
    time_unit: str = ""
    sampling: PositiveSeconds | None = None
    columns: dict[str, ColumnTable] = {}
    use: Window | None = None
    mask: list[Window] = []
    loss: Literal["squares", "huber"] = "squares"

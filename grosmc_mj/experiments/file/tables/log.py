"""``[log]``: how the columns of a log of the machine are to be read."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from grosmc_mj.experiments.file.tables.table import Seconds, Table


class ColumnTable(Table):
    """A column of a log: value = sign scale (column - offset), in its unit.

    Attributes:
        column: Its header.
        unit: Of its numbers; that of the signal, or the one in its header, by default.
        sign: -1 for an axis that points the other way.
        scale: Such as radians in a count.
        offset: In the column's own numbers.
    """

    column: str
    unit: str = ""
    sign: Literal[1, -1] = 1
    scale: float = 1.0
    offset: float = 0.0


class LogTable(Table):
    """``[log]``.

    Attributes:
        time: Header of the time's column; ``time`` or ``t`` by default.
        sampling: Time between two samples, of a log without such a column.
        columns: By the name of an input or a state.
    """

    time: str = ""
    sampling: Seconds | None = None
    columns: dict[str, ColumnTable] = Field(default={})

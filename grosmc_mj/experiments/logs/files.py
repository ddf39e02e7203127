"""Files of logs: CSV, Parquet, MCAP and MATLAB, each as columns of numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from grosmc_mj.experiments.logs.columns import LogColumn
from grosmc_mj.experiments.logs.csv_file import csv_table
from grosmc_mj.experiments.logs.limits import LARGEST_LOG, require_few_columns, too_large
from grosmc_mj.experiments.logs.matlab_file import matlab_columns
from grosmc_mj.experiments.logs.mcap_file import mcap_columns
from grosmc_mj.experiments.logs.numbers import as_text, is_text, numbers_of
from grosmc_mj.ground.errors import ArgumentError, GrosmcError, one_line
from grosmc_mj.ground.files import LARGEST_TABLE, require_regular

# A log of fewer samples tells nothing.
_FEWEST = 50
# Letters of an error of a library that a message quotes.
_QUOTED = 160
# Rows of a Parquet file that are read at a time: a long text that repeats is short in the file.
_ROWS = 4096
_BYTES_OF_A_NUMBER = 8


def columns_of(path: Path) -> dict[str, LogColumn]:
    """The columns of numbers of a file, by their headers.

    Raises:
        ArgumentError: If it cannot be read, or has too few rows.
        SetupError: If a library for it is missing.
    """
    *first, last = _READERS
    allowed = f"name a file that ends in {', '.join(first)} or {last}"
    _require_there(path, allowed)
    endings = [ending for ending in _READERS if path.name.lower().endswith(ending)]
    if not endings:
        raise ArgumentError(f"it is no log: {allowed}")
    reader = _READERS[endings[0]]

    try:
        columns = reader(path)
    except GrosmcError:
        raise
    # Damaged files make the readers of each kind fail in ways of their own.
    except Exception as error:
        reason = one_line(str(error))[:_QUOTED] or type(error).__name__
        raise ArgumentError(f"it cannot be read: {reason}") from None

    rows = max((len(column.values) for column in columns.values()), default=0)
    if rows < _FEWEST:
        raise ArgumentError(
            f"it has {rows} rows of numbers; {_FEWEST} or more are needed: log some seconds"
        )
    return columns


def _require_there(path: Path, allowed: str) -> None:
    """Refuse a path that is no regular file.

    Raises:
        ArgumentError: With the reason.
    """
    try:
        path.stat()
    except FileNotFoundError:
        raise ArgumentError(f"there is no such file: {allowed}") from None
    # A link to itself, a folder that may not be entered, a name that is too long.
    except OSError as error:
        raise ArgumentError(f"it cannot be read: {error.strerror}: {allowed}") from None
    if not path.is_file():
        raise ArgumentError(f"it is a folder, a pipe, a socket or a device: {allowed}")
    require_regular(path, LARGEST_TABLE)


def _csv(path: Path) -> dict[str, LogColumn]:
    """The columns of a CSV file."""
    return _number_columns(csv_table(path), path)


def _parquet(path: Path) -> dict[str, LogColumn]:
    """The columns of a Parquet file.

    Raises:
        ArgumentError: If it holds too much: a value that repeats takes no room in the file.
    """
    file = pq.ParquetFile(path)
    metadata = file.metadata
    require_few_columns(metadata.num_columns)
    size = metadata.num_rows * metadata.num_columns * _BYTES_OF_A_NUMBER
    if size > LARGEST_LOG:
        raise too_large(size)

    names = [item.name for item in file.schema_arrow if _may_have_numbers(item.type)]
    batches = []
    size = 0
    for batch in file.iter_batches(_ROWS, columns=names):
        size += batch.nbytes
        if size > LARGEST_LOG:
            raise too_large(None)
        batches.append(batch)
    if not batches:
        return {}
    return _number_columns(pa.Table.from_batches(batches).combine_chunks())


def _may_have_numbers(kind: pa.DataType) -> bool:
    """Whether a column of a kind may have numbers or instants: not truth values, not lists."""
    types = pa.types
    is_number = types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind)
    is_instant = types.is_timestamp(kind) or types.is_duration(kind)
    return is_number or is_instant or is_text(kind)


def _number_columns(table: pa.Table, file: Path | None = None) -> dict[str, LogColumn]:
    """The columns of a table that have numbers; the file is that of a CSV table."""
    columns: dict[str, LogColumn] = {}
    for header, written in zip(table.column_names, table.columns, strict=True):
        name = header.strip()
        column = as_text(written)
        values = numbers_of(column)
        if values is None or not name:
            continue
        if name in columns:
            raise ArgumentError(f"two columns are called {name!r}: rename or remove one")
        columns[name] = LogColumn.headed(name, values, column, file)
    return columns


_READERS: dict[str, Callable[[Path], dict[str, LogColumn]]] = {
    ".csv": _csv,
    ".csv.gz": _csv,
    ".parquet": _parquet,
    ".mcap": mcap_columns,
    ".mat": matlab_columns,
}

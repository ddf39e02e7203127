"""Files of logs: CSV, Parquet, MCAP and MATLAB, each as columns of numbers."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from grosmc_mj.errors import ArgumentError, GrosmcError, SetupError, one_line
from grosmc_mj.files import LARGEST_TABLE, require_regular
from grosmc_mj.logs.columns import Column
from grosmc_mj.logs.csv_file import csv_table
from grosmc_mj.logs.numbers import numbers_of

# A log of fewer samples tells nothing.
_FEWEST = 50
# Letters of an error of a library that a message quotes.
_QUOTED = 160


def columns_of(path: Path) -> dict[str, Column]:
    """The columns of numbers of a file, by their headers.

    Raises:
        ArgumentError: If it cannot be read, or has too few rows.
        SetupError: If a library for it is missing.
    """
    *first, last = _READERS
    allowed = f"name a file that ends in {', '.join(first)} or {last}"
    if not path.is_file():
        raise ArgumentError(f"there is no such file: {allowed}")
    require_regular(path, LARGEST_TABLE)
    endings = [ending for ending in _READERS if path.name.lower().endswith(ending)]
    if not endings:
        raise ArgumentError(f"is no log: {allowed}")
    reader = _READERS[endings[0]]

    try:
        columns = reader(path)
    except GrosmcError:
        raise
    # Damaged files make the readers of each kind fail in ways of their own.
    except Exception as error:
        reason = one_line(str(error))[:_QUOTED] or type(error).__name__
        raise ArgumentError(f"cannot be read: {reason}") from None

    rows = max((len(column.values) for column in columns.values()), default=0)
    if rows < _FEWEST:
        raise ArgumentError(
            f"has {rows} rows of numbers; {_FEWEST} or more are needed: log some seconds"
        )
    return columns


def _csv(path: Path) -> dict[str, Column]:
    """The columns of a CSV file."""
    return _number_columns(csv_table(path), path)


def _parquet(path: Path) -> dict[str, Column]:
    """The columns of a Parquet file."""
    return _number_columns(pq.ParquetFile(path).read())


def _number_columns(table: pa.Table, file: Path | None = None) -> dict[str, Column]:
    """The columns of a table that have numbers; the file is that of a CSV table."""
    columns: dict[str, Column] = {}
    for header, column in zip(table.column_names, table.columns, strict=True):
        name = header.strip()
        values = numbers_of(column)
        if values is None or not name:
            continue
        if name in columns:
            raise ArgumentError(f"two columns are called {name!r}: rename or remove one")
        columns[name] = Column.headed(name, values, column, file)
    return columns


def _mcap(path: Path) -> dict[str, Column]:
    """The numbers of an MCAP file's messages, JSON or ROS 2, such as ``/joint_states.position[0]``.

    Their instants are those at which they were logged.
    """
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise SetupError("MCAP needs a library: pip install 'grosmc_mj[identify]'") from None
    rows: dict[str, list[tuple[int, float]]] = {}
    ros = DecoderFactory()
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            decode = ros.decoder_for(channel.message_encoding, schema)
            if channel.message_encoding == "json":
                content: Any = json.loads(message.data)
            elif decode is not None:
                content = decode(message.data)
            else:
                continue
            for name, value in _numbers(channel.topic, content):
                rows.setdefault(name, []).append((message.log_time, value))

    # Nanoseconds since 1970 do not fit into a float.
    begin = min((pairs[0][0] for pairs in rows.values()), default=0)
    columns = {}
    for name, pairs in rows.items():
        values = np.array([value for _, value in pairs])
        stamps = np.array([(stamp - begin) / 1e9 for stamp, _ in pairs])
        columns[name] = Column(name, values, name, stamps=stamps)
    return columns


def _numbers(name: str, content: Any) -> Iterator[tuple[str, float]]:
    """The numbers of a message, with the paths to them."""
    if isinstance(content, bool | int | float):
        yield name, float(content)
    elif isinstance(content, Mapping):
        for key, part in content.items():
            yield from _numbers(f"{name}.{key}", part)
    elif isinstance(content, Sequence) and not isinstance(content, str | bytes):
        for index, part in enumerate(content):
            yield from _numbers(f"{name}[{index}]", part)
    else:
        for key in getattr(content, "__slots__", ()):
            yield from _numbers(f"{name}.{key}", getattr(content, key))


def _matlab(path: Path) -> dict[str, Column]:
    """The vectors of a MATLAB file, and those in its structures, such as ``out.signals.values``."""
    # Imported where it is needed: few logs are MATLAB's.
    from scipy.io import loadmat

    try:
        content = loadmat(path, struct_as_record=False, squeeze_me=True)
    except NotImplementedError:
        raise ArgumentError("is of MATLAB 7.3: save it with save(..., '-v7')") from None
    columns = {}
    for key, value in content.items():
        if not key.startswith("__"):
            for name, values in _vectors(key, value):
                # pyarrow has no numbers of the other order of bytes.
                native = values.astype(values.dtype.newbyteorder("="))
                written = pa.chunked_array([pa.array(native)])
                short = name.rpartition(".")[2]
                columns[name] = Column(name, values.astype(float), short, written=written)
    return columns


def _vectors(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """The vectors of a MATLAB value, with the paths to them; columns of a matrix count from 1."""
    for key in getattr(value, "_fieldnames", ()):
        yield from _vectors(f"{name}.{key}", getattr(value, key))
    if not isinstance(value, np.ndarray):
        return

    if value.dtype == object:
        for index, part in enumerate(value.ravel(), start=1):
            yield from _vectors(f"{name}({index})", part)
    elif value.dtype.kind in "biuf" and value.ndim == 1:
        yield name, value
    elif value.dtype.kind in "biuf" and value.ndim == 2:
        for index, column in enumerate(value.T, start=1):
            yield f"{name}({index})", column


_READERS: dict[str, Callable[[Path], dict[str, Column]]] = {
    ".csv": _csv,
    ".csv.gz": _csv,
    ".parquet": _parquet,
    ".mcap": _mcap,
    ".mat": _matlab,
}

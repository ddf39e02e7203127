"""Signals as files: a column each, with its name and its unit, as Parquet, CSV or NPZ."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, one_line, shown
from grosmc_mj.files import written_aside

_KEY = b"grosmc_mj"
_UNIT = b"unit"
FORMATS = (".parquet", ".csv", ".npz")


class SignalColumn(NamedTuple):
    """One signal.

    Attributes:
        name: Such as ``pole angle``.
        unit: Such as ``rad``; ``1`` for a number.
        values: (rows,); NaN where there is none.
    """

    name: str
    unit: str
    values: Array


def arrow_table(columns: Sequence[SignalColumn], about: Mapping[str, Any]) -> Any:
    """The columns as a ``pyarrow.Table``, with units and ``about`` in its metadata."""
    import pyarrow as pa

    fields = [
        pa.field(column.name, pa.float64(), metadata={_UNIT: column.unit}) for column in columns
    ]
    schema = pa.schema(fields, metadata={_KEY: json.dumps(about).encode()})
    return pa.table([column.values for column in columns], schema=schema)


def write_columns(path: Path, columns: Sequence[SignalColumn], about: Mapping[str, Any]) -> None:
    """Write the columns by the file's ending, the whole file or none.

    A CSV has ``name [unit]`` in its first row and nothing of ``about``.

    Raises:
        ArgumentError: If it ends in none of ``FORMATS``.
        SetupError: If it cannot be written.
    """
    require_known("ending", path.suffix, FORMATS)
    with written_aside(path) as part:
        if path.suffix == ".parquet":
            import pyarrow.parquet as pq

            pq.write_table(arrow_table(columns, about), part)
        elif path.suffix == ".csv":
            with part.open("w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file)
                writer.writerow([f"{column.name} [{column.unit}]" for column in columns])
                for row in zip(*(column.values.tolist() for column in columns), strict=True):
                    writer.writerow(["" if value != value else repr(value) for value in row])
        else:
            units = {column.name: column.unit for column in columns}
            described = json.dumps({"units": units, "about": about})
            arrays: dict[str, Any] = {_key(column.name): column.values for column in columns}
            with part.open("wb") as opened:
                np.savez_compressed(opened, **arrays, __about__=np.array(described))


def _key(name: str) -> str:
    """What a column is called in an NPZ, where numpy takes some names for its own options."""
    return f"{name} " if name in {"file", "args", "kwds", "allow_pickle", "__about__"} else name


def read_columns(path: Path) -> tuple[list[SignalColumn], dict[str, Any]]:
    """Columns of a Parquet or NPZ file and what is said about them; nothing in it is executed.

    Raises:
        ArgumentError: If there is no such file, or none that ``write_columns`` wrote.
    """
    if not path.is_file():
        raise ArgumentError(f"there is no file {shown(str(path), str)}")
    if path.suffix not in (".parquet", ".npz"):
        raise ArgumentError(
            f"{path}: signals are read again from .parquet and .npz, which keep all that a run is"
        )
    try:
        return _parquet(path) if path.suffix == ".parquet" else _npz(path)
    # pyarrow, zipfile and numpy have no common class for what they cannot read.
    except Exception as error:
        reason = one_line(str(error))
        raise ArgumentError(f"{path}: is no file of signals, or is damaged: {reason}") from None


def _parquet(path: Path) -> tuple[list[SignalColumn], dict[str, Any]]:
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    about = json.loads((table.schema.metadata or {})[_KEY])
    columns = [
        SignalColumn(field.name, (field.metadata or {})[_UNIT].decode(), values.to_numpy())
        for field, values in zip(table.schema, table.columns, strict=True)
    ]
    return columns, about


def _npz(path: Path) -> tuple[list[SignalColumn], dict[str, Any]]:
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        described = json.loads(str(file["__about__"]))
        columns = [
            SignalColumn(name, unit, file[_key(name)]) for name, unit in described["units"].items()
        ]
    return columns, described["about"]

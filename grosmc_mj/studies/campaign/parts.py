"""Rows of a part of a campaign as a table: columns, units, checksum."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from grosmc_mj.experiments.requirements.metrics import stored_metrics
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.manifest import SCHEMA_VERSION
from grosmc_mj.studies.pieces import CHECKSUM, Piece
from grosmc_mj.studies.sweep.family import SCREENING
from grosmc_mj.studies.sweep.runs import MARGIN, Outcomes

# Key of a part's metadata.
_METADATA = b"grosmc_mj"


def rows_of(campaign: Campaign, table: pa.Table, controller: str) -> pa.Table:
    """Return one controller's rows of a part."""
    runs = table.num_rows // len(campaign.laws)
    position = list(campaign.laws).index(controller)
    return table.slice(position * runs, runs)


def part_of(campaign: Campaign, bound_to: str, index: int) -> Piece:
    """Return a part of a campaign as a piece of stored work.

    Its notes bind it to the campaign and have nothing of when or where it was computed, so that a
    part that is run again is the same to the last byte.

    Args:
        campaign: The campaign.
        bound_to: Hash of its manifest.
        index: Number of the part.
    """
    ids = campaign.specification.ids(index)
    notes = {
        "schema_version": SCHEMA_VERSION,
        "campaign": bound_to,
        "part": index,
        "first": ids.start,
        "count": len(ids),
    }
    return Piece(part_name(index), notes, f"part {index} of this campaign")


def part_name(index: int) -> str:
    """Return the name of the file of a part, without suffix."""
    return f"part-{index:07d}"


def part_rows(campaign: Campaign, index: int, runs: Sequence[Outcomes]) -> pa.Table:
    """Return the rows of a part: the runs of one controller after those of another.

    Args:
        campaign: The campaign.
        index: Number of the part.
        runs: Outcomes of its plants under each controller, with the columns of ``SCREENING``.
    """
    schema = _schema(campaign)
    ids = np.array(campaign.specification.ids(index))
    values = campaign.values(campaign.specification.ids(index))
    of_plants = {"id": ids, **dict(zip(campaign.family.names, values.T, strict=True))}
    tables = []
    for law, outcomes in zip(campaign.laws, runs, strict=True):
        columns = {**outcomes.columns, **of_plants, "controller": [law] * len(ids)}
        arrays = [pa.array(columns[field.name], field.type) for field in schema]
        tables.append(pa.Table.from_arrays(arrays, schema=schema))
    return pa.concat_tables(tables)


class ParquetForm:
    """Tables in Parquet; the notes are metadata of the schema."""

    suffix = ".parquet"

    def save(self, file: BinaryIO, content: pa.Table, notes: Mapping[str, Any]) -> None:
        """Write a table with its notes and a checksum of both."""
        checked = {**notes, CHECKSUM: checksum(content, notes)}
        table = content.replace_schema_metadata({_METADATA: json.dumps(checked)})
        pq.write_table(table, file, compression="zstd")

    def load(self, path: Path) -> tuple[pa.Table, dict[str, Any]]:
        """Return a table and its notes; raises ValueError if it is not as it was written."""
        try:
            table = pq.ParquetFile(path).read()
        except pa.ArrowException as error:
            raise ValueError(f"{path} is no table") from error

        notes = json.loads((table.schema.metadata or {})[_METADATA])
        written = notes.pop(CHECKSUM)
        with np.errstate(invalid="ignore"):
            if written != checksum(table, notes):
                raise ValueError("another checksum")
        return table, notes


def checksum(table: pa.Table, notes: Mapping[str, Any]) -> str:
    """Return SHA-256 of all rows, of the columns' names, types and units, and of the notes.

    It is taken of the values as 64-bit little-endian numbers and as JSON texts, so that neither
    compression nor the layout of a file has a say; every NaN is the same one.
    """
    columns: list[list[str]] = []
    for field in table.schema:
        unit = (field.metadata or {}).get(b"unit", b"").decode()
        columns.append([field.name, str(field.type), unit])

    head = {**notes, "columns": columns, "rows": table.num_rows}
    digest = hashlib.sha256(json.dumps(head, sort_keys=True).encode())
    for column in table.columns:
        if pa.types.is_floating(column.type):
            values = column.to_numpy().astype("<f8")
            values[np.isnan(values)] = np.nan
            digest.update(values.tobytes())
        elif pa.types.is_integer(column.type):
            digest.update(column.to_numpy().astype("<i8").tobytes())
        else:
            digest.update(json.dumps(column.to_pylist()).encode())
    return digest.hexdigest()


def _schema(campaign: Campaign) -> pa.Schema:
    """Columns of a part, with their types and units."""
    types: dict[str, Any] = {
        "controller": pa.string(),
        "status": pa.string(),
        "judged_by": pa.string(),
        "id": pa.int64(),
        "overturned": pa.int64(),
        "drawn": pa.int64(),
    }
    return pa.schema(
        pa.field(name, types.get(name, pa.float64()), metadata={"unit": unit})
        for name, unit in _units(campaign).items()
    )


def _units(campaign: Campaign) -> dict[str, str]:
    """Units of the columns of a part, by name and in their order."""
    error = next(iter(campaign.laws.values())).designed.error
    metric_units = {
        "output": error.units[error.output_rows[0]],
        "input": error.system.inputs[0].unit,
        "sliding": "of the law's surface",
    }

    units = {"id": "", "controller": ""}
    for number in campaign.family.quantities:
        units[number.name] = number.unit
    for name, unit in stored_metrics(error.system).items():
        units[name] = metric_units.get(unit, unit)
    for requirement in campaign.requirements:
        units[MARGIN + requirement.name] = requirement.unit
    units |= {"relative": "1", "order": "1", "status": "", "ended": "s"}
    if campaign.specification.screen != "none":
        units |= SCREENING
    return units

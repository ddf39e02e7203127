"""Rows of a part of a campaign as a table: columns, units, checksum, verification."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from grosmc_mj.experiments.requirements.metrics import stored_metrics
from grosmc_mj.ground.errors import SetupError
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.manifest import SCHEMA_VERSION
from grosmc_mj.studies.sweep.family import SCREENING
from grosmc_mj.studies.sweep.runs import MARGIN, Outcomes

# Key of a part's metadata, and the checksum in it.
_METADATA = b"grosmc_mj"
_CHECKSUM = "sha256"


def rows_of(campaign: Campaign, table: pa.Table, controller: str) -> pa.Table:
    """Return one controller's rows of a part."""
    runs = table.num_rows // len(campaign.laws)
    position = list(campaign.laws).index(controller)
    return table.slice(position * runs, runs)


def part_table(
    campaign: Campaign,
    bound_to: str,
    index: int,
    runs: Sequence[Outcomes],
) -> pa.Table:
    """Return the rows of a part: the runs of one controller after those of another.

    The schema's metadata binds them to their campaign and has nothing of when or where they were
    computed, so that a part that is run again is the same to the last byte.

    Args:
        campaign: The campaign.
        bound_to: Hash of its manifest.
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
    table = pa.concat_tables(tables)
    notes = _notes(campaign, bound_to, index)
    checked = {**notes, _CHECKSUM: checksum(table, notes)}
    return table.replace_schema_metadata({_METADATA: json.dumps(checked)})


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


def _notes(campaign: Campaign, bound_to: str, index: int) -> dict[str, Any]:
    """The campaign of a part, and its place there."""
    ids = campaign.specification.ids(index)
    return {
        "schema_version": SCHEMA_VERSION,
        "campaign": bound_to,
        "part": index,
        "first": ids.start,
        "count": len(ids),
    }


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


def verified(
    file: Path,
    campaign: Campaign,
    bound_to: str,
    index: int,
) -> pa.Table:
    """Return the rows of a part, verified to be those of this part of this campaign.

    Args:
        file: File of the part.
        campaign: The campaign.
        bound_to: Hash of its manifest.
        index: Number of the part.

    Raises:
        SetupError: If the part is damaged, or is another one.
    """
    notes = _notes(campaign, bound_to, index)
    unreadable = (OSError, pa.ArrowException, ValueError, TypeError, LookupError)
    with contextlib.suppress(*unreadable), np.errstate(invalid="ignore"):
        # A pipe would never end.
        if file.is_file():
            table = pq.ParquetFile(file).read()
            written = json.loads((table.schema.metadata or {})[_METADATA])
            if written == {**notes, _CHECKSUM: checksum(table, notes)}:
                return table
    raise SetupError(
        f"{file} is damaged, or is not part {index} of this campaign: remove it, and --resume runs "
        "it again"
    )

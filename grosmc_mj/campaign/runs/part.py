"""One part of a campaign as a table: made, bound to its campaign, and verified when it is read."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.family import MARGIN, SCREENING
from grosmc_mj.campaign.runs.manifest import SCHEMA_VERSION
from grosmc_mj.campaign.runs.shard import EQUATIONS, Outcomes
from grosmc_mj.errors import SetupError
from grosmc_mj.experiments.metrics import METRICS

_OURS = b"grosmc_mj"
_CHECKSUM = "sha256"
# Bytes of a column's texts, and of each row's.
_TEXTS, _TEXT = 2**14, 2**7
# What is asked of every run, beside the file's requirements.
COMPLETES = "completes"
# The count of runs that keep everything.
EVERYTHING = "everything"
# The counts of runs that equations judged, of those of which MuJoCo overturned a verdict of theirs,
# of those that were confirmed by chance alone, and of these that were overturned.
SCREENED, OVERTURNED = "screened", "overturned"
DRAWN, DRAWN_OVERTURNED = "drawn", "drawn and overturned"
# Counts by controller and requirement.
Counts = Mapping[str, Mapping[str, int]]


def margin_column(key: str) -> str:
    """The column of a requirement's margin."""
    return f"{MARGIN}{key}"


def part_table(
    campaign: Campaign, bound_to: str, index: int, found: Sequence[Outcomes]
) -> pa.Table:
    """The rows of a part: the runs of one controller after those of another.

    The schema's metadata has what binds them to their campaign, and nothing of when or where they
    were made, so that a part that is run again is the same to the last byte.

    Args:
        campaign: The campaign.
        bound_to: Hash of its manifest.
        index: Number of the part.
        found: What became of its plants, by controller.
    """
    ids, schema = campaign.specification.ids(index), _schema(campaign)
    tables = []
    for each in found:
        arrays = [
            np.arange(ids.start, ids.stop),
            [each.controller] * len(ids),
            *each.values.T,
            *(each.metrics[name] for name in METRICS),
            *(each.margins[requirement.key] for requirement in campaign.requirements),
            each.relative,
            each.order,
            list(each.status),
            each.ended,
        ]
        if campaign.specification.screen != "none":
            band = [each.band] * len(ids)
            arrays += [list(each.judged_by), each.screened, each.overturned, each.drawn, band]
        typed = [pa.array(values, kind) for values, kind in zip(arrays, schema.types, strict=True)]
        tables.append(pa.Table.from_arrays(typed, schema=schema))
    table = pa.concat_tables(tables)
    noted = _noted(bound_to, index, ids)
    checked = {**noted, _CHECKSUM: checksum(table, noted)}
    return table.replace_schema_metadata({_OURS: json.dumps(checked)})


def read_part(file: Path, campaign: Campaign, manifest: Mapping[str, Any], index: int) -> pa.Table:
    """The rows of a part, once they are known to be those of this part of this campaign.

    Args:
        file: The part's file.
        campaign: The campaign.
        manifest: Its manifest.
        index: Number of the part.

    Raises:
        SetupError: If they are not, in one line with file and reason.
    """
    try:
        return _verified(file, campaign, manifest, index)
    except _RefusedError as refused:
        reason = str(refused)
    except (OSError, pa.ArrowException, ValueError, TypeError, KeyError) as error:
        reason = f"cannot be read ({type(error).__name__})"
    raise SetupError(f"{file}: {reason}: remove it, and --resume runs it again")


def checksum(table: pa.Table, noted: Mapping[str, Any]) -> str:
    """SHA-256 of all rows, of the columns' names, types and units, and of what is noted of them.

    It is taken of the values as 64-bit little-endian numbers and as JSON texts, so that neither
    compression nor the layout of a file has a say; every NaN is the same one.
    """
    columns = [
        [field.name, str(field.type), (field.metadata or {}).get(b"unit", b"").decode()]
        for field in table.schema
    ]
    head = {**noted, "columns": columns, "rows": table.num_rows}
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


def counts_of(campaign: Campaign, table: pa.Table) -> dict[str, dict[str, int]]:
    """Runs, and of them those that keep each requirement, by controller, from a part's rows."""
    counts: dict[str, dict[str, int]] = {}
    for law in campaign.laws:
        rows = rows_of(campaign, table, law)
        masks = {
            EVERYTHING: rows["relative"].to_numpy() >= 0,
            COMPLETES: np.array(rows["status"].to_pylist()) == "completed",
            **{
                limit.key: rows[margin_column(limit.key)].to_numpy() >= 0
                for limit in campaign.requirements
                if law in limit.of
            },
        }
        if "judged_by" in rows.column_names:
            drawn, overturned = (rows[name].to_numpy() > 0 for name in (DRAWN, OVERTURNED))
            masks[SCREENED] = np.array(rows["judged_by"].to_pylist()) == EQUATIONS
            masks |= {DRAWN: drawn, OVERTURNED: overturned, DRAWN_OVERTURNED: drawn & overturned}
        counts[law] = {key: int(mask.sum()) for key, mask in masks.items()}
        counts[law]["runs"] = rows.num_rows
    return counts


def rows_of(campaign: Campaign, table: pa.Table, controller: str) -> pa.Table:
    """One controller's rows of a part."""
    runs = table.num_rows // len(campaign.laws)
    return table.slice(list(campaign.laws).index(controller) * runs, runs)


class _RefusedError(Exception):
    """Why a part is not what it must be."""


def _noted(bound_to: str, index: int, ids: range) -> dict[str, Any]:
    """What a part says of itself."""
    return {
        "schema_version": SCHEMA_VERSION,
        "campaign": bound_to,
        "part": index,
        "first": ids.start,
        "count": len(ids),
    }


def _schema(campaign: Campaign) -> pa.Schema:
    """Columns of a part, with their types and units."""
    error = next(iter(campaign.laws.values())).designed.error
    units = {
        "output": error.units[error.output_rows[0]],
        "input": error.system.inputs[0].unit,
        "sliding": "of the law's surface",
    }
    real, text = pa.float64(), pa.string()
    columns: list[tuple[str, pa.DataType, str]] = [("id", pa.int64(), ""), ("controller", text, "")]
    columns += [(each.name, real, each.unit) for each in campaign.family.quantities]
    columns += [(name, real, units.get(unit, unit)) for name, unit in METRICS.items()]
    columns += [(margin_column(each.key), real, each.unit) for each in campaign.requirements]
    columns += [("relative", real, "1"), ("order", real, "1")]
    columns += [("status", text, ""), ("ended", real, "s")]
    if campaign.specification.screen != "none":
        count, kinds = pa.int64(), {"judged_by": (text, ""), "screened": (real, "1")}
        kinds |= {"overturned": (count, "1"), "drawn": (count, "1"), "band": (real, "1")}
        columns += [(name, *kinds[name]) for name in SCREENING]
    return pa.schema(
        [pa.field(name, kind, metadata={"unit": unit}) for name, kind, unit in columns]
    )


def _verified(file: Path, campaign: Campaign, manifest: Mapping[str, Any], index: int) -> pa.Table:
    """The rows of a part, or why they are not believed."""
    if not file.is_file():
        raise _RefusedError("is no file")
    ids, laws = campaign.specification.ids(index), list(campaign.laws)
    with pq.ParquetFile(file) as opened:
        schema = opened.schema_arrow
        said = json.loads((schema.metadata or {})[_OURS])
        noted = _bound(said, manifest, index, ids)
        _refuse_other_columns(schema, _schema(campaign))
        # Before they are read: a small file may claim to have very many.
        if opened.metadata.num_rows != len(ids) * len(laws):
            raise _RefusedError(
                f"has {opened.metadata.num_rows} rows instead of {len(ids) * len(laws)}"
            )
        _refuse_long_texts(opened.metadata)
        table = opened.read()
    if any(column.null_count for column in table.columns):
        raise _RefusedError("has rows without a value")
    if table["controller"].to_pylist() != [law for law in laws for _ in ids]:
        raise _RefusedError("has rows of other controllers, or in another order")
    if table["id"].to_pylist() != [*ids] * len(laws):
        raise _RefusedError("has rows of other runs, or in another order")
    if said.get(_CHECKSUM) != checksum(table, noted):
        raise _RefusedError("has rows that its checksum is not of")
    return table


def _bound(said: Any, manifest: Mapping[str, Any], index: int, ids: range) -> dict[str, Any]:
    """Metadata that a part must have, where it has any."""
    if not isinstance(said, dict):
        raise _RefusedError("does not say what it is of")
    noted = _noted(manifest["hash"], index, ids)
    reasons = {
        "schema_version": f"is of another schema than the campaign, which is of {SCHEMA_VERSION}",
        "campaign": "is of another campaign",
        "part": f"is another part than {index}, whose place it has",
    }
    for key, value in noted.items():
        if said.get(key) != value:
            other = f"has other runs than {ids.start} to {ids.stop - 1}"
            raise _RefusedError(reasons.get(key, other))
    return noted


def _refuse_long_texts(metadata: Any) -> None:
    """Refuse texts that would fill the memory: a small file may have one that every row repeats."""
    for index in range(metadata.num_row_groups):
        group = metadata.row_group(index)
        for place in range(group.num_columns):
            column = group.column(place)
            if column.physical_type == "BYTE_ARRAY" and (
                column.total_uncompressed_size > _TEXTS + _TEXT * group.num_rows
            ):
                raise _RefusedError(f"has texts that no run has in {column.path_in_schema!r}")


def _refuse_other_columns(there: pa.Schema, wanted: pa.Schema) -> None:
    """Refuse columns that are missing, unknown or of another type."""
    if missing := [name for name in wanted.names if name not in there.names]:
        raise _RefusedError(f"lacks the column {missing[0]!r}")
    if not there.equals(wanted, check_metadata=False):
        raise _RefusedError("has other columns, or columns of other types")

"""The folder of a campaign: its manifest and its parts, each whole or not there."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.experiments.metrics import METRICS
from grosmc_mj.files import cannot_write, written_aside
from grosmc_mj.results.document import write_json
from grosmc_mj.sweep.batch import EQUATIONS
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.family import SCREENING
from grosmc_mj.sweep.manifest import (
    MANIFEST,
    SCHEMA_VERSION,
    differences,
    manifest_of,
    outdated,
    read_manifest,
)
from grosmc_mj.sweep.runs import MARGIN, Outcomes

# A file system that has no locks.
_NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK)
_OURS, _CHECKSUM = b"grosmc_mj", "sha256"
# What is asked of every run, beside the file's requirements; the count of runs that keep all.
COMPLETES, EVERYTHING = "completes", "everything"
# The counts of runs that equations judged, of those of which MuJoCo overturned a verdict of theirs,
# of those that were confirmed by chance alone, and of these that were overturned.
SCREENED, OVERTURNED = "screened", "overturned"
DRAWN, DRAWN_OVERTURNED = "drawn", "drawn and overturned"
# Counts by controller and requirement.
Counts = Mapping[str, Mapping[str, int]]


@dataclass(frozen=True)
class Folder:
    """Where a campaign is kept.

    Attributes:
        path: The folder.
    """

    path: Path

    @property
    def parts(self) -> Path:
        """Where the parts are."""
        return self.path / "parts"

    def part(self, index: int) -> Path:
        """The file of a part."""
        return self.parts / f"part-{index:07d}.parquet"

    def done(self, index: int) -> bool:
        """Whether a part is there."""
        return self.part(index).exists()

    def missing(self, campaign: Campaign) -> list[int]:
        """Numbers of the parts that are not there."""
        return [index for index in range(campaign.specification.shards) if not self.done(index)]

    @property
    def begun(self) -> bool:
        """Whether a campaign is there."""
        return (self.path / MANIFEST).exists()

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Keep other processes from adding parts until the end; it ends with the process, too.

        Raises:
            SetupError: If another process holds it, or it cannot be written.
        """
        path = self.path / ".lock"
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            lock = path.open("a+b", buffering=0)
        except OSError as error:
            raise cannot_write(path, error) from error
        with lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise SetupError(
                    f"{self.path}: another grosmc-mj campaign adds parts to it: wait for its end, "
                    "or take another --out"
                ) from None
            except OSError as error:
                if error.errno not in _NO_LOCKS:
                    raise cannot_write(path, error) from error
            yield

    def begin(self, campaign: Campaign, *, resume: bool) -> list[str]:
        """Write the manifest, or find the same one there and verify all parts that are there.

        Returns:
            What to know of a complete campaign of other versions, a line each.

        Raises:
            ArgumentError: If the folder has another campaign, has this one and ``resume`` is not
                wanted, or parts are missing that other versions would have.
            SetupError: If it cannot be written, or parts there are not those of the campaign.
        """
        manifest, some = manifest_of(campaign), any(self.parts.glob("part-*.parquet"))
        if not self.begun:
            if some:
                raise ArgumentError(f"{self.path} has parts without a {MANIFEST}: take another")
            write_json(self.path / MANIFEST, manifest)
            return []
        there = read_manifest(self.path)
        if changed := differences(there, manifest):
            raise ArgumentError(
                f"{self.path} has another campaign: {'; '.join(changed)}; take another --out"
            )
        if not resume and some:
            raise ArgumentError(
                f"{self.path} has this campaign already: --resume runs what is missing of it"
            )
        others = outdated(there, manifest)
        if others and self.missing(campaign):
            raise ArgumentError(
                f"{self.path} is not complete and was begun with other versions: "
                f"{'; '.join(others)}; install those to go on"
            )
        for _ in self.tables(campaign, range(campaign.specification.shards)):
            pass
        # What a part is called until it is whole.
        for left in self.parts.glob(".part-*.part.parquet"):
            with contextlib.suppress(OSError):
                left.unlink()
        return [f"{line}: the campaign was run with that" for line in others]

    def write(self, index: int, table: pa.Table) -> None:
        """Write a part aside and rename it.

        Raises:
            SetupError: If it cannot be written.
        """
        # A worker that was given up may still be at the same part: each has a file of its own.
        with written_aside(self.part(index)) as part, part.open("wb") as file:
            pq.write_table(table, file, compression="zstd")
            file.flush()
            os.fsync(file.fileno())

    def tables(self, campaign: Campaign, indices: Iterable[int]) -> Iterator[pa.Table]:
        """The rows of those parts that are there, each verified as it is read.

        Raises:
            SetupError: If a part is damaged, or is of another campaign or place.
        """
        bound_to = read_manifest(self.path)["hash"]
        for index in filter(self.done, indices):
            yield _verified(self.part(index), campaign, bound_to, index)

    def counts(self, campaign: Campaign, indices: Iterable[int]) -> Counts:
        """Runs, and of them those that keep each requirement, by controller, over some parts."""
        total: dict[str, dict[str, int]] = {}
        for table in self.tables(campaign, indices):
            add(total, counts_of(campaign, table))
        return total

    def columns(
        self, campaign: Campaign, names: Sequence[str], indices: Iterable[int]
    ) -> dict[str, dict[str, Array]]:
        """Columns of some parts by controller and name, in the order of the runs.

        Raises:
            SetupError: If a part is not what it must be.
        """
        tables = [table.select(list(names)) for table in self.tables(campaign, indices)]
        columns: dict[str, dict[str, Array]] = {}
        for law in campaign.laws:
            own = [rows_of(campaign, table, law) for table in tables]
            columns[law] = {
                name: np.concatenate([rows[name].to_numpy() for rows in own] or [np.zeros(0)])
                for name in names
            }
        return columns


def add(total: dict[str, dict[str, int]], more: Counts) -> None:
    """Add counts to counts."""
    for controller, counts in more.items():
        own = total.setdefault(controller, {})
        for key, count in counts.items():
            own[key] = own.get(key, 0) + count


def part_table(campaign: Campaign, bound_to: str, index: int, runs: Sequence[Outcomes]) -> pa.Table:
    """The rows of a part: the runs of one controller after those of another.

    The schema's metadata has what binds them to their campaign, and nothing of when or where they
    were made, so that a part that is run again is the same to the last byte.

    Args:
        campaign: The campaign.
        bound_to: Hash of its manifest.
        index: Number of the part.
        runs: What became of its plants, by controller.
    """
    schema, tables = _schema(campaign), []
    for outcome in runs:
        arrays = [pa.array(outcome[field.name], field.type) for field in schema]
        tables.append(pa.Table.from_arrays(arrays, schema=schema))
    table = pa.concat_tables(tables)
    noted = _noted(campaign, bound_to, index)
    checked = {**noted, _CHECKSUM: checksum(table, noted)}
    return table.replace_schema_metadata({_OURS: json.dumps(checked)})


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
        }
        for limit in campaign.limits_of(law):
            masks[limit.key] = rows[MARGIN + limit.key].to_numpy() >= 0
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


def _noted(campaign: Campaign, bound_to: str, index: int) -> dict[str, Any]:
    """What a part says of itself."""
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
    error = next(iter(campaign.laws.values())).designed.error
    units = {
        "output": error.units[error.output_rows[0]],
        "input": error.system.inputs[0].unit,
        "sliding": "of the law's surface",
    }
    columns = {"id": "", "controller": ""}
    columns |= {number.name: number.unit for number in campaign.family.quantities}
    columns |= {name: units.get(unit, unit) for name, unit in METRICS.items()}
    columns |= {MARGIN + limit.key: limit.unit for limit in campaign.requirements}
    columns |= {"relative": "1", "order": "1", "status": "", "ended": "s"}
    if campaign.specification.screen != "none":
        columns |= SCREENING
    kinds: dict[str, pa.DataType] = dict.fromkeys(
        ("controller", "status", "judged_by"), pa.string()
    )
    kinds |= dict.fromkeys(("id", OVERTURNED, DRAWN), pa.int64())
    fields = [
        pa.field(name, kinds.get(name, pa.float64()), metadata={"unit": unit})
        for name, unit in columns.items()
    ]
    return pa.schema(fields)


def _verified(file: Path, campaign: Campaign, bound_to: str, index: int) -> pa.Table:
    """The rows of a part, once they are known to be those of this part of this campaign."""
    noted = _noted(campaign, bound_to, index)
    # Of files alone: a pipe would never end.
    refused = (OSError, pa.ArrowException, ValueError, TypeError, LookupError)
    with contextlib.suppress(*refused), np.errstate(invalid="ignore"):
        table = pq.ParquetFile(file).read() if file.is_file() else pa.table({})
        written = json.loads((table.schema.metadata or {})[_OURS])
        if written == {**noted, _CHECKSUM: checksum(table, noted)}:
            return table
    raise SetupError(
        f"{file} is damaged, or is not part {index} of this campaign: remove it, and --resume runs "
        "it again"
    )

"""The folder of a campaign: its manifest and its parts, each whole or not there."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.campaign import Campaign
from grosmc_mj.campaign.manifest import (
    MANIFEST,
    SCHEMA_VERSION,
    differences,
    outdated,
    read_manifest,
)
from grosmc_mj.campaign.question import Question
from grosmc_mj.campaign.requirements import COMPLETES, MARGIN, METRICS
from grosmc_mj.campaign.shard import Outcomes
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.files import cannot_write, written_aside
from grosmc_mj.validation.results_file import write_json

_PARTS = "parts"
_OURS = b"grosmc_mj"
# The count of runs that keep everything.
EVERYTHING = "everything"
# Counts by controller and requirement.
Counts = Mapping[str, Mapping[str, int]]


def margin_column(key: str) -> str:
    """The column of a requirement's margin."""
    return f"{MARGIN}{key}"


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
        return self.path / _PARTS

    def part(self, index: int) -> Path:
        """The file of a part."""
        return self.parts / f"part-{index:07d}.parquet"

    def begin(self, manifest: Mapping[str, Any], *, resume: bool) -> list[str]:
        """Write the manifest, or find the same one there.

        Returns:
            What to know of a complete campaign that was made with other versions.

        Raises:
            ArgumentError: If the folder has another campaign, has this one and ``resume`` is not
                wanted, or parts are missing that other versions would have to add.
            SetupError: If it cannot be written.
        """
        if not (self.path / MANIFEST).exists():
            if self.path.exists() and any(self.parts.glob("*.parquet")):
                raise ArgumentError(f"{self.path} has parts without a {MANIFEST}: take another")
            write_json(self.path / MANIFEST, manifest)
            self._make(self.parts)
            return []
        there = read_manifest(self.path)
        changed = differences(there, manifest)
        if changed:
            raise ArgumentError(
                f"{self.path} has another campaign: {'; '.join(changed)}; take another --out"
            )
        if not resume and any(self.parts.glob("*.parquet")):
            raise ArgumentError(
                f"{self.path} has this campaign already: --resume runs what is missing of it"
            )
        if (others := outdated(there, manifest)) and not self._complete(there):
            raise ArgumentError(
                f"{self.path} is not complete and was begun with other versions: "
                f"{'; '.join(others)}; install those to go on"
            )
        self._make(self.parts)
        for left in self.parts.glob(".*.part.parquet"):
            with contextlib.suppress(OSError):
                left.unlink()
        return others

    def _complete(self, manifest: Mapping[str, Any]) -> bool:
        """Whether all parts are there."""
        return all(map(self.done, range(Question.of_document(manifest["question"]).shards)))

    def _make(self, path: Path) -> None:
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise cannot_write(path, error) from error

    def done(self, index: int) -> bool:
        """Whether a part is there."""
        return self.part(index).exists()

    def write(self, index: int, ids: range, campaign: Campaign, found: Sequence[Outcomes]) -> None:
        """Write a part aside and rename it.

        Raises:
            SetupError: If it cannot be written.
        """
        table = _table(index, ids, campaign, found)
        target = self.part(index)
        with written_aside(target) as part, part.open("wb") as file:
            pq.write_table(table, file, compression="zstd")
            file.flush()
            os.fsync(file.fileno())

    def files(self, indices: Sequence[int]) -> list[Path]:
        """The files of those parts that are there."""
        return [self.part(index) for index in indices if self.done(index)]

    def counts(self, indices: Sequence[int]) -> Counts:
        """Runs, and of them those that keep each requirement, by controller, over some parts."""
        total: dict[str, dict[str, int]] = {}
        for file in self.files(indices):
            add(total, _noted(file))
        return total

    def columns(
        self, names: Sequence[str], controller: str, indices: Sequence[int]
    ) -> dict[str, Array]:
        """Columns of one controller's rows in some parts, by the number of the run.

        Raises:
            SetupError: If a part cannot be read.
        """
        tables = [_read(file, names, controller) for file in self.files(indices)]
        return {
            name: np.concatenate([table[name].to_numpy() for table in tables])
            if tables
            else np.zeros(0)
            for name in names
        }


def add(total: dict[str, dict[str, int]], more: Counts) -> None:
    """Add counts to counts."""
    for controller, counts in more.items():
        own = total.setdefault(controller, {})
        for key, count in counts.items():
            own[key] = own.get(key, 0) + count


def counts_of(found: Sequence[Outcomes]) -> dict[str, dict[str, int]]:
    """Runs, and of them those that keep each requirement, by controller."""
    return {
        each.controller: {
            "runs": len(each.values),
            EVERYTHING: int(each.kept.sum()),
            COMPLETES: sum(status == "completed" for status in each.status),
            **{
                key: int((margins >= 0).sum())
                for key, margins in each.margins.items()
                if not np.all(np.isnan(margins))
            },
        }
        for each in found
    }


def _table(index: int, ids: range, campaign: Campaign, found: Sequence[Outcomes]) -> pa.Table:
    """The rows of a part: the runs of one controller after those of another."""
    tables = []
    for each in found:
        law = campaign.laws[each.controller]
        assert law.error is not None
        output = law.error.units[law.error.output_rows[0]]
        units = {
            "output": output,
            "input": law.error.system.inputs[0].unit,
            "sliding": "of the law's surface",
        }
        columns: list[tuple[str, Any, str]] = [
            ("id", np.arange(ids.start, ids.stop), ""),
            ("controller", pa.array([each.controller] * len(ids)), ""),
        ]
        columns += [
            (quantity.name, each.values[:, i], quantity.unit)
            for i, quantity in enumerate(campaign.family.quantities)
        ]
        columns += [
            (name, values, units.get(METRICS[name][0], METRICS[name][0]))
            for name, values in each.metrics.items()
        ]
        columns += [
            (margin_column(requirement.key), each.margins[requirement.key], requirement.unit)
            for requirement in campaign.requirements
        ]
        columns += [
            ("relative", each.relative, "1"),
            ("status", pa.array(list(each.status)), ""),
            ("ended", each.ended, "s"),
        ]
        arrays = [pa.array(values) for _, values, _ in columns]
        fields = [
            pa.field(name, array.type, metadata={"unit": unit})
            for (name, _, unit), array in zip(columns, arrays, strict=True)
        ]
        tables.append(pa.Table.from_arrays(arrays, schema=pa.schema(fields)))
    noted = {"schema_version": SCHEMA_VERSION, "part": index, "counts": counts_of(found)}
    table = pa.concat_tables(tables)
    return table.replace_schema_metadata({_OURS: json.dumps(noted)})


def _noted(file: Path) -> dict[str, dict[str, int]]:
    """The counts that a part has noted."""
    try:
        counts = json.loads(pq.read_schema(file).metadata[_OURS])["counts"]
        return {law: {key: int(n) for key, n in of.items()} for law, of in counts.items()}
    except (OSError, pa.ArrowInvalid, KeyError, TypeError, ValueError, AttributeError) as error:
        raise _broken(file, error) from None


def _read(file: Path, names: Sequence[str], controller: str) -> pa.Table:
    """Columns of one controller's rows in a part."""
    runs = _noted(file).get(controller, {}).get("runs")
    try:
        found = pq.read_table(file, columns=list(names), filters=[("controller", "==", controller)])
    except (OSError, pa.ArrowInvalid, KeyError) as error:
        raise _broken(file, error) from None
    if found.num_rows != runs:
        raise _broken(file, IndexError())
    return found


def _broken(file: Path, error: Exception) -> SetupError:
    """One line about a part that cannot be read."""
    return SetupError(
        f"{file}: cannot be read ({type(error).__name__}): remove it, and --resume runs it again"
    )

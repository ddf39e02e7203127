"""Folder of a campaign: its manifest and its parts, each complete or absent."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.output.results.document import write_json
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.manifest import (
    MANIFEST,
    differences,
    manifest_of,
    other_campaign,
    read_manifest,
)
from grosmc_mj.studies.campaign.parts import ParquetForm, part_name, part_of, rows_of
from grosmc_mj.studies.pieces import PieceStore


@dataclass(frozen=True)
class Folder:
    """Folder of a campaign.

    Attributes:
        path: Its path.
    """

    path: Path

    @property
    def store(self) -> PieceStore[pa.Table]:
        """Store of its parts."""
        return PieceStore(self.path / "parts", ParquetForm())

    def part(self, index: int) -> Path:
        """Return the file of a part."""
        return self.store.folder / f"{part_name(index)}{ParquetForm.suffix}"

    def missing(self, campaign: Campaign) -> list[int]:
        """Return the numbers of the parts that are not there."""
        numbers = range(campaign.specification.shards)
        return [index for index in numbers if not self.part(index).exists()]

    @property
    def begun(self) -> bool:
        """Whether a campaign is there."""
        return (self.path / MANIFEST).exists()

    def begin(self, campaign: Campaign, *, resume: bool) -> list[str]:
        """Write the manifest, or compare it with the one there and verify all parts that are there.

        Returns:
            A line about each package of a complete campaign that has another version now.

        Raises:
            ArgumentError: If the folder has another campaign, has this one and ``resume`` is not
                wanted, or parts are missing that other versions would have.
            SetupError: If it cannot be written, or parts there are not those of the campaign.
        """
        parts = self.path / "parts"
        has_parts = any(parts.glob("part-*.parquet"))
        if not self.begun:
            if has_parts:
                raise ArgumentError(f"{self.path} has parts without a {MANIFEST}: take another")
            write_json(self.path / MANIFEST, manifest_of(campaign))
            return []

        recorded = read_manifest(self.path)
        now = manifest_of(campaign)
        other = other_campaign(recorded, now)
        if other:
            raise ArgumentError(f"{self.path} has another campaign: {other}; take another --out")
        if has_parts and not resume:
            raise ArgumentError(
                f"{self.path} has this campaign already: --resume runs what is missing of it"
            )
        other_versions = differences(recorded, now, "versions")
        if other_versions and self.missing(campaign):
            raise ArgumentError(
                f"{self.path} is not complete and was begun with other versions: "
                f"{'; '.join(other_versions)}; install those to go on"
            )

        # Reading verifies.
        for _ in self.tables(campaign, range(campaign.specification.shards)):
            pass
        self.store.remove_unfinished()
        return [f"{text}: the campaign was run with that" for text in other_versions]

    def write(self, campaign: Campaign, bound_to: str, index: int, rows: pa.Table) -> None:
        """Store a part.

        Args:
            campaign: The campaign.
            bound_to: Hash of its manifest.
            index: Number of the part.
            rows: Its rows.

        Raises:
            SetupError: If it cannot be written.
        """
        self.store.write(part_of(campaign, bound_to, index), rows)

    def tables(self, campaign: Campaign, indices: Iterable[int]) -> Iterator[pa.Table]:
        """Yield the rows of those parts that are there, each verified as it is read.

        Raises:
            SetupError: If a part is damaged, or is of another campaign or place.
        """
        bound_to = read_manifest(self.path)["hash"]
        for index in indices:
            rows = self.store.read(part_of(campaign, bound_to, index))
            if rows is not None:
                yield rows

    def columns(
        self, campaign: Campaign, names: Sequence[str], indices: Iterable[int]
    ) -> dict[str, dict[str, Array]]:
        """Read columns of some parts.

        Returns:
            Columns by controller and name, in the order of the runs; {} for no part.

        Raises:
            SetupError: If a part is not as it must be.
        """
        tables = [table.select(list(names)) for table in self.tables(campaign, indices)]
        if not tables:
            return {}

        columns: dict[str, dict[str, Array]] = {}
        for law in campaign.laws:
            rows = pa.concat_tables([rows_of(campaign, table, law) for table in tables])
            columns[law] = {name: rows[name].to_numpy() for name in names}
        return columns

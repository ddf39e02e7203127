"""The folder of a campaign: its manifest and its parts, each whole or not there."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.specification import Specification
from grosmc_mj.campaign.runs.manifest import (
    MANIFEST,
    differences,
    manifest_of,
    outdated,
    read_manifest,
)
from grosmc_mj.campaign.runs.part import (
    Counts,
    counts_of,
    read_part,
    rows_of,
)
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.files import cannot_write, written_aside
from grosmc_mj.results.document import write_json

_PARTS, _LOCK = "parts", ".lock"
# What a part is called until it is whole, see `written_aside`.
_LEFT = re.compile(r"\.part-\d{7,}\.[0-9a-f]{16}\.part\.parquet")
# A file system that has no locks.
_NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK)


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
        self._make(self.path)
        path = self.path / _LOCK
        try:
            lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise cannot_write(path, error) from error
        with os.fdopen(lock, "r+b", buffering=0) as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                pid = file.read(20)
                whose = f" (process {int(pid)})" if pid.isdigit() else ""
                raise SetupError(
                    f"{self.path}: another grosmc-mj campaign{whose} adds parts to it: wait for "
                    "its end, or take another --out"
                ) from None
            except OSError as error:
                if error.errno not in _NO_LOCKS:
                    raise cannot_write(path, error) from error
            file.truncate(0)
            file.write(str(os.getpid()).encode())
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
        manifest = manifest_of(campaign)
        some = any(self.parts.glob("part-*.parquet"))
        if not self.begun:
            if some:
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
        if not resume and some:
            raise ArgumentError(
                f"{self.path} has this campaign already: --resume runs what is missing of it"
            )
        others = outdated(there, manifest)
        if others and not self._complete(campaign.specification):
            raise ArgumentError(
                f"{self.path} is not complete and was begun with other versions: "
                f"{'; '.join(others)}; install those to go on"
            )
        self._verify(campaign, there)
        self._make(self.parts)
        for left in self.parts.iterdir():
            if _LEFT.fullmatch(left.name):
                with contextlib.suppress(OSError):
                    left.unlink()
        return [f"{line}: the campaign was run with that" for line in others]

    def _complete(self, specification: Specification) -> bool:
        """Whether all parts are there."""
        return all(map(self.done, range(specification.shards)))

    def _make(self, path: Path) -> None:
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise cannot_write(path, error) from error

    def _verify(self, campaign: Campaign, manifest: Mapping[str, Any]) -> None:
        """Refuse parts that are not what they must be, all of them in one line."""
        wrong: list[str] = []
        for index in range(campaign.specification.shards):
            try:
                if self.done(index):
                    read_part(self.part(index), campaign, manifest, index)
            except SetupError as error:
                wrong.append(str(error))
        if wrong:
            several = f"{len(wrong)} parts are not what they must be, the first: "
            raise SetupError(f"{several if len(wrong) > 1 else ''}{wrong[0]}")

    def done(self, index: int) -> bool:
        """Whether a part is there."""
        return self.part(index).exists()

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

    def tables(self, campaign: Campaign, indices: Sequence[int]) -> Iterator[pa.Table]:
        """The rows of those parts that are there, each verified as it is read.

        Raises:
            SetupError: If a part is not what it must be.
        """
        manifest = read_manifest(self.path)
        for index in indices:
            if self.done(index):
                yield read_part(self.part(index), campaign, manifest, index)

    def counts(self, campaign: Campaign, indices: Sequence[int]) -> Counts:
        """Runs, and of them those that keep each requirement, by controller, over some parts."""
        total: dict[str, dict[str, int]] = {}
        for table in self.tables(campaign, indices):
            add(total, counts_of(campaign, table))
        return total

    def columns(
        self, campaign: Campaign, names: Sequence[str], indices: Sequence[int]
    ) -> dict[str, dict[str, Array]]:
        """Columns of some parts by controller and name, in the order of the runs.

        Raises:
            SetupError: If a part is not what it must be.
        """
        found: dict[str, dict[str, list[Array]]] = {
            law: {name: [] for name in names} for law in campaign.laws
        }
        for table in self.tables(campaign, indices):
            wanted = table.select(list(names))
            for law, columns in found.items():
                rows = rows_of(campaign, wanted, law)
                for name, pieces in columns.items():
                    pieces.append(rows[name].to_numpy())
        return {
            law: {
                name: np.concatenate(pieces) if pieces else np.zeros(0)
                for name, pieces in columns.items()
            }
            for law, columns in found.items()
        }


def add(total: dict[str, dict[str, int]], more: Counts) -> None:
    """Add counts to counts."""
    for controller, counts in more.items():
        own = total.setdefault(controller, {})
        for key, count in counts.items():
            own[key] = own.get(key, 0) + count

"""manifest.json: all that decides a campaign's results, so that anybody can go on with it."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.executors import Executor, Notice
from grosmc_mj.experiments.file.reading import read_text, resolved_text
from grosmc_mj.experiments.file.user_code import named_in, sources
from grosmc_mj.experiments.metrics import METRICS
from grosmc_mj.files import cannot_write, written_aside
from grosmc_mj.results.document import git_revision, write_json
from grosmc_mj.results.result import result
from grosmc_mj.sweep.campaign import Campaign, Specification
from grosmc_mj.sweep.family import SCREENING
from grosmc_mj.sweep.runs import MARGIN, Outcomes
from grosmc_mj.sweep.screening import EQUATIONS, UNSCREENED, Screening, screened_all, screening_of
from grosmc_mj.versions import DECISIVE, versions

MANIFEST = "manifest.json"
NO_PROOF = "Absence of failures among the runs sampled is no proof that there are none."
# Of manifests and parts.
SCHEMA_VERSION = 3
# What the hash is of: where a case file lies does not decide.
_HASHED = ("configuration", "model", "sources", "versions")


def manifest_of(campaign: Campaign) -> dict[str, Any]:
    """The manifest of a campaign, as plain values."""
    content = {
        "configuration": configuration_of(campaign),
        # SHA-256 of the plant without uncertainty: of its compiled model, or of its parameters.
        "model": campaign.plant.digest,
        "sources": _sources(campaign.specification),
        "versions": versions(DECISIVE),
    }
    return {
        "schema_version": SCHEMA_VERSION,
        "hash": _hash(content),
        **content,
        "question": campaign.specification.document(),
        "git_revision": git_revision(),
    }


def configuration_of(campaign: Campaign) -> dict[str, Any]:
    """All that decides the results, but for code and model."""
    specification = campaign.specification
    return {
        "runs": specification.runs,
        "seed": specification.seed,
        "sampler": specification.sampler,
        "shard": specification.shard,
        **({"screen": specification.screen} if specification.screen != "none" else {}),
        "controllers": list(campaign.laws),
        "control_period": campaign.control_period,
        "duration": campaign.duration,
        "uncertain": {
            number.name: f"{number.distribution.words}; nominal {number.nominal:.17g}; "
            f"unit {number.unit}"
            for number in campaign.family.quantities
        },
        "file": json.loads(json.dumps(campaign.experiment.document())),
    }


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest in a folder, whose hash is that of its content.

    Raises:
        SetupError: If there is none, or another one.
    """
    path = folder / MANIFEST
    if not path.is_file():
        raise SetupError(f"{folder} is no campaign: it has no {MANIFEST}")
    content: dict[str, Any] = {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        kept = content["hash"] == _hash({key: content[key] for key in _HASHED})
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        kept = False
    if not kept or not isinstance(content.get("question"), dict):
        raise SetupError(
            f"{path} is damaged, or of another version of grosmc_mj: its hash is not that of its "
            "content; run the campaign again in another folder"
        )
    return content


def differences(there: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What of two manifests decides their results and is not the same, a line each.

    Versions are left out, see ``outdated``; with others, the bytes of a model say nothing.
    """
    model = () if outdated(there, now) else ("model",)
    return _changed(there, now, ("configuration", *model, "sources"))


def refuse_other_code(folder: Path, there: Mapping[str, Any], specification: Specification) -> None:
    """Refuse Python that is not the recorded one, before any of it is imported.

    Args:
        folder: Of the campaign.
        there: Its manifest.
        specification: Whose case file would have it imported.

    Raises:
        ArgumentError: If a file is not the recorded one, or there are more or fewer.
    """
    if changed := _changed(there, {"sources": _sources(specification)}, ("sources",)):
        raise ArgumentError(f"{folder} was begun with other Python: {'; '.join(changed)}")


def outdated(there: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """The packages that have another version now, a line each: bits may differ."""
    return _changed(there, now, ("versions",))


def _changed(there: Mapping[str, Any], now: Mapping[str, Any], keys: Sequence[str]) -> list[str]:
    """The leaves under some keys that are not the same, a line each."""
    old, new = (dict(flat({key: side.get(key) for key in keys})) for side in (there, now))
    return [
        f"{key.removeprefix('configuration.')}: {old.get(key, 'nothing')} there, "
        f"{new.get(key, 'nothing')} now"
        for key in dict.fromkeys([*old, *new])
        if old.get(key) != new.get(key)
    ]


def _sources(specification: Specification) -> dict[str, str]:
    """SHA-256 of the user's own Python that the case file would import, by file."""
    return sources(named_in(specification.file), Path(specification.folder))


def flat(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of nested plain values, with the way to them."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from flat(item, f"{key}.{name}" if key else str(name))
    elif isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            yield from flat(item, f"{key} {index + 1}")
    else:
        yield key, value


def _hash(content: Mapping[str, Any]) -> str:
    """SHA-256 of plain values, whatever their order."""
    versioned = {"schema_version": SCHEMA_VERSION, **content}
    text = json.dumps(versioned, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


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


# Number of runs done and, by law, the share of these that keeps everything so far.
Advance = Callable[[int, dict[str, float]], object]
# What this process has imported of the users' own Python for campaigns: of each module, which.
_imported: dict[str, tuple[str, str]] = {}


def run_missing(
    campaign: Campaign, folder: Folder, executor: Executor, notice: Notice, advance: Advance
) -> int:
    """Run the parts that are missing.

    Args:
        campaign: The campaign.
        folder: Where it is kept, begun.
        executor: What runs them.
        notice: Called with a line about each worker that died, and why nothing is screened.
        advance: Called after each part.

    Returns:
        How often a part had to be run again.

    Raises:
        GrosmcError: If a part cannot be run; those that were finished stay.
    """
    parts, total, again = folder.missing(campaign), dict[str, dict[str, int]](), 0
    screening = screening_of(campaign) if parts else UNSCREENED
    if screening.why_not:
        notice(f"No run is screened by equations: {screening.why_not}.")
    work = shards_of(campaign, folder, executor.threads_per_worker, screening)
    with closing(executor.run(work, parts, notice)) as done:
        for finished in done:
            again += finished.attempts - 1
            add(total, finished.report)
            rates = {law: counts[EVERYTHING] / counts["runs"] for law, counts in total.items()}
            runs = len(campaign.specification.ids(finished.index))
            advance(runs * len(campaign.laws), rates)
    return again


def shards_of(
    campaign: Campaign, folder: Folder, threads: int, screening: Screening = UNSCREENED
) -> partial[Counts]:
    """The work of each part of a campaign that was begun in a folder, by its number.

    Args:
        campaign: The campaign.
        folder: Where it was begun.
        threads: Of each worker; 0 for all cores.
        screening: How far equations may judge its runs.
    """
    bound_to, path = read_manifest(folder.path)["hash"], str(folder.path.resolve())
    shard = partial(run_shard, path, campaign.specification, bound_to)
    return partial(shard, threads=threads, screening=screening)


def run_shard(
    folder: str,
    specification: Specification,
    bound_to: str,
    index: int,
    threads: int = 0,
    screening: Screening = UNSCREENED,
) -> Counts:
    """Run a part and write it.

    Args:
        folder: Of the campaign, under the same path for all that work at it.
        specification: What the campaign was begun with: nothing is built from what the folder says.
        bound_to: Hash of its manifest, which the folder's must have.
        index: Number of the part.
        threads: 0 for all cores.
        screening: How far equations may judge its runs.

    Returns:
        By controller: runs, and those that keep each requirement.

    Raises:
        GrosmcError: If the folder is not that of the campaign, or cannot be written.
    """
    campaign = open_campaign(folder, specification, bound_to)
    runs = screened_all(campaign, screening, campaign.laws, specification.ids(index), threads)
    table = part_table(campaign, bound_to, index, runs)
    Folder(Path(folder)).write(index, table)
    return counts_of(campaign, table)


def open_campaign(folder: str, specification: Specification, bound_to: str) -> Campaign:
    """The campaign of a specification, designed once in a process, to add parts to its folder.

    Raises:
        GrosmcError: If the folder is of another one, or it would not be computed here as it was
            there.
    """
    # A worker may outlive a folder and meet another campaign under its name.
    if read_manifest(Path(folder))["hash"] != bound_to:
        raise ArgumentError(f"{folder} has another campaign than the one that was begun in it")
    return _opened(folder, specification, bound_to)


@lru_cache(maxsize=4)
def _opened(folder: str, specification: Specification, _bound_to: str) -> Campaign:
    campaign, others = _built(Path(folder), read_manifest(Path(folder)), specification)
    if others:
        raise ArgumentError(f"{folder} was begun with other versions: {'; '.join(others)}")
    return campaign


def read_campaign(folder: Path, case_file: Path | None = None) -> tuple[Campaign, list[str]]:
    """The campaign that a folder describes, to read its runs.

    The folder is data: no Python is imported but what lies beside the case file that the user
    names, and that only if it is what the folder has recorded.

    Args:
        folder: Of the campaign.
        case_file: Where its case file is now, with what it names.

    Returns:
        The campaign, and what to know of one of other versions, a line each.

    Raises:
        GrosmcError: If there is none, or its configuration cannot be had here.
    """
    manifest = read_manifest(folder)
    specification = Specification.of_document(manifest["question"])
    if case_file is not None:
        if specification.text not in (resolved_text(case_file), read_text(case_file)):
            raise ArgumentError(
                f"{case_file} is not the case file of {folder}: its text is another"
            )
        specification = replace(specification, folder=str(case_file.parent.resolve()))
    elif named := named_in(specification.file):
        raise ArgumentError(
            f"{folder}: its case file names Python, {', '.join(named)}, and a folder's is not "
            "imported: give a case file of your own with the same text, beside which that lies, "
            "by --case-file"
        )
    campaign, others = _built(folder, manifest, specification)
    return campaign, [f"{line}: bits may differ" for line in others]


def _built(
    folder: Path, manifest: Mapping[str, Any], specification: Specification
) -> tuple[Campaign, list[str]]:
    """The campaign of a specification, if it is the manifest's, and what has other versions now."""
    refuse_other_code(folder, manifest, specification)
    # A worker may have kept modules of these names from another campaign of its life.
    for file, content in manifest["sources"].items():
        name = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        source = (specification.folder, content)
        if _imported.setdefault(name, source) != source:
            sys.modules.pop(name, None)
            _imported[name] = source
    campaign = Campaign.of(specification)
    now = manifest_of(campaign)
    if changed := differences(manifest, now):
        raise ArgumentError(f"{folder} was begun with something else: {'; '.join(changed)}")
    return campaign, outdated(manifest, now)


def result_of(campaign: Campaign, kind: str, **fields: Any) -> dict[str, Any]:
    """A result of a campaign, with its configuration and seed."""
    return result(kind, configuration_of(campaign), seed=campaign.specification.seed, **fields)

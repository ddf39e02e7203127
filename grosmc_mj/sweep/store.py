"""Folder of a campaign: its manifest, its parts, each complete or absent, and their work."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
from grosmc_mj.experiments.file.reading import parse_case_file, read_case_file
from grosmc_mj.experiments.file.user_code import named_in, sources
from grosmc_mj.files import atomic_write, cannot_write
from grosmc_mj.requirements.metrics import stored_metrics
from grosmc_mj.results.document import git_revision, machine_words, write_json
from grosmc_mj.results.result import Result, result
from grosmc_mj.sweep.campaign import Campaign, Specification
from grosmc_mj.sweep.family import SCREENING
from grosmc_mj.sweep.runs import MARGIN, Outcomes
from grosmc_mj.sweep.screening import UNSCREENED, Screening, screened_all, screening_of
from grosmc_mj.versions import DECISIVE, versions

MANIFEST = "manifest.json"
# Version of manifests and parts.
SCHEMA_VERSION = 3
# Keys of a manifest that its hash is of: the place of a case file does not decide.
_HASHED = ("configuration", "model", "sources", "versions")
# Errors of a file system that has no locks.
_NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK)
# Key of a part's metadata, and the checksum in it.
_METADATA = b"grosmc_mj"
_CHECKSUM = "sha256"
# Number of runs done and, by law, the share of these that keeps everything so far.
Advance = Callable[[int, dict[str, float]], object]
# User modules that this process has imported for campaigns: folder and hash of each.
_imported: dict[str, tuple[str, str]] = {}


def result_of(campaign: Campaign, kind: str, **fields: Any) -> Result:
    """Return a result of a campaign, with its configuration and seed."""
    return result(kind, configuration_of(campaign), seed=campaign.specification.seed, **fields)


# ---- the manifest: all that decides the results


def manifest_of(campaign: Campaign) -> dict[str, Any]:
    """Return the manifest of a campaign, as plain values."""
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
        "machine": machine_words(),
        "random": campaign.random,
    }


def configuration_of(campaign: Campaign) -> dict[str, Any]:
    """Return all that decides the results, but for code and model."""
    specification = campaign.specification
    uncertain = {
        number.name: f"{number.distribution.words}; nominal {number.nominal:.17g}; "
        f"unit {number.unit}"
        for number in campaign.family.quantities
    }
    configuration = {
        "runs": specification.runs,
        "seed": specification.seed,
        "sampler": specification.sampler,
        "shard": specification.shard,
    }
    if specification.screen != "none":
        configuration["screen"] = specification.screen
    return {
        **configuration,
        "controllers": list(campaign.laws),
        "control_period": campaign.experiment.settings.control_period,
        "duration": campaign.duration,
        "uncertain": uncertain,
        # As it is read back: tuples are lists.
        "file": json.loads(json.dumps(campaign.experiment.document())),
    }


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the manifest in a folder, whose hash must be that of its content.

    Raises:
        SetupError: If there is none, or its hash is another one.
    """
    path = folder / MANIFEST
    if not path.is_file():
        raise SetupError(f"{folder} is no campaign: it has no {MANIFEST}")

    with contextlib.suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
        content = json.loads(path.read_text(encoding="utf-8"))
        same = content["hash"] == _hash({key: content[key] for key in _HASHED})
        if same and isinstance(content["question"], dict):
            return content
    raise SetupError(
        f"{path} is damaged, or of another version of grosmc_mj: its hash is not that of its "
        "content; run the campaign again in another folder"
    )


def _hash(content: Mapping[str, Any]) -> str:
    """SHA-256 of plain values, independent of their order."""
    versioned = {"schema_version": SCHEMA_VERSION, **content}
    text = json.dumps(versioned, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _sources(specification: Specification) -> dict[str, str]:
    """SHA-256 of the user's own Python that the case file would import, by file."""
    return sources(named_in(specification.file), Path(specification.folder))


def _differences(recorded: Mapping[str, Any], now: Mapping[str, Any], *keys: str) -> list[str]:
    """A text for each leaf under some keys that is not the same."""
    old = dict(leaves({key: recorded.get(key) for key in keys}))
    new = dict(leaves({key: now.get(key) for key in keys}))

    texts: list[str] = []
    for key in {**old, **new}:
        if old.get(key) != new.get(key):
            before = old.get(key, "nothing")
            after = new.get(key, "nothing")
            name = key.removeprefix("configuration.")
            texts.append(f"{name}: {before} there, {after} now")
    return texts


def leaves(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the leaves of nested plain values, each with its path."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from leaves(item, f"{key}.{name}" if key else str(name))
    elif isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            yield from leaves(item, f"{key} {index + 1}")
    else:
        yield key, value


def refuse_other_code(
    folder: Path, manifest: Mapping[str, Any], specification: Specification
) -> None:
    """Refuse Python that is not the recorded one, before any of it is imported.

    Args:
        folder: Folder of the campaign.
        manifest: Its manifest.
        specification: Specification whose case file would have it imported.

    Raises:
        ArgumentError: If a file is not the recorded one, or there are more or fewer.
    """
    differences = _differences(manifest, {"sources": _sources(specification)}, "sources")
    if differences:
        raise ArgumentError(f"{folder} was begun with other Python: {'; '.join(differences)}")


def _other_campaign(recorded: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Differences of two manifests, but for versions; empty if they are of one campaign."""
    keys = ["configuration", "model", "sources"]
    if _differences(recorded, now, "versions"):
        # Other versions may compile the same model into other bytes.
        keys.remove("model")
    return "; ".join(_differences(recorded, now, *keys))


# ---- the parts


@dataclass(frozen=True)
class Folder:
    """Folder of a campaign.

    Attributes:
        path: Its path.
    """

    path: Path

    def part(self, index: int) -> Path:
        """Return the file of a part."""
        return self.path / "parts" / f"part-{index:07d}.parquet"

    def missing(self, campaign: Campaign) -> list[int]:
        """Return the numbers of the parts that are not there."""
        numbers = range(campaign.specification.shards)
        return [index for index in numbers if not self.part(index).exists()]

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
        other = _other_campaign(recorded, now)
        if other:
            raise ArgumentError(f"{self.path} has another campaign: {other}; take another --out")
        if has_parts and not resume:
            raise ArgumentError(
                f"{self.path} has this campaign already: --resume runs what is missing of it"
            )
        other_versions = _differences(recorded, now, "versions")
        if other_versions and self.missing(campaign):
            raise ArgumentError(
                f"{self.path} is not complete and was begun with other versions: "
                f"{'; '.join(other_versions)}; install those to go on"
            )

        # Reading verifies.
        for _ in self.tables(campaign, range(campaign.specification.shards)):
            pass
        # Files of parts that were never finished.
        for unfinished in parts.glob(".part-*.part.parquet"):
            with contextlib.suppress(OSError):
                unfinished.unlink()
        return [f"{text}: the campaign was run with that" for text in other_versions]

    def write(self, index: int, table: pa.Table) -> None:
        """Write a part aside and rename it.

        Raises:
            SetupError: If it cannot be written.
        """
        # A worker that was given up may still be at the same part: each has a file of its own.
        with atomic_write(self.part(index)) as part, part.open("wb") as file:
            pq.write_table(table, file, compression="zstd")
            file.flush()
            os.fsync(file.fileno())

    def tables(self, campaign: Campaign, indices: Iterable[int]) -> Iterator[pa.Table]:
        """Yield the rows of those parts that are there, each verified as it is read.

        Raises:
            SetupError: If a part is damaged, or is of another campaign or place.
        """
        bound_to = read_manifest(self.path)["hash"]
        for index in indices:
            if self.part(index).exists():
                yield _verified(self.part(index), campaign, bound_to, index)

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
            rows = pa.concat_tables([_rows_of(campaign, table, law) for table in tables])
            columns[law] = {name: rows[name].to_numpy() for name in names}
        return columns


def _rows_of(campaign: Campaign, table: pa.Table, controller: str) -> pa.Table:
    """One controller's rows of a part."""
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
        runs: Outcomes of its plants, for each controller.
    """
    schema = _schema(campaign)
    tables = [_outcome_table(outcomes, schema) for outcomes in runs]
    table = pa.concat_tables(tables)
    notes = _notes(campaign, bound_to, index)
    checked = {**notes, _CHECKSUM: checksum(table, notes)}
    return table.replace_schema_metadata({_METADATA: json.dumps(checked)})


def _outcome_table(outcomes: Outcomes, schema: pa.Schema) -> pa.Table:
    """The rows of one controller."""
    arrays = [pa.array(outcomes[field.name], field.type) for field in schema]
    return pa.Table.from_arrays(arrays, schema=schema)


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


def _verified(
    file: Path,
    campaign: Campaign,
    bound_to: str,
    index: int,
) -> pa.Table:
    """The rows of a part, verified to be those of this part of this campaign."""
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


# ---- the work


def run_missing(
    campaign: Campaign, folder: Folder, executor: Executor, notice: Notice, advance: Advance
) -> int:
    """Run the parts that are missing.

    Args:
        campaign: The campaign.
        folder: Where it is kept, begun.
        executor: Runs the parts.
        notice: Called with a line about each worker that died, and why nothing is screened.
        advance: Called after each part.

    Returns:
        How often a part was run again.

    Raises:
        GrosmcError: If a part cannot be run; those that were finished stay.
    """
    parts = folder.missing(campaign)
    screening = UNSCREENED
    if parts:
        screening = screening_of(campaign)
    if screening.why_not:
        notice(f"No run is screened by equations: {screening.why_not}.")

    passed = Counter[str]()
    finished_plants = 0
    repeated = 0
    work = part_runner(campaign, folder, executor.threads_per_worker, screening)
    with contextlib.closing(executor.run(work, parts, notice)) as finished_parts:
        for part in finished_parts:
            plants = len(campaign.specification.ids(part.index))
            passed.update(part.report)
            finished_plants += plants
            repeated += part.attempts - 1

            shares = {law: passed[law] / finished_plants for law in campaign.laws}
            advance(plants * len(campaign.laws), shares)
    return repeated


def part_runner(
    campaign: Campaign, folder: Folder, threads: int, screening: Screening = UNSCREENED
) -> partial[dict[str, int]]:
    """Return the function that runs a part of a campaign, by its number.

    Args:
        campaign: The campaign.
        folder: Where it was begun.
        threads: Threads of each worker; 0 for all cores.
        screening: Screening of its runs by the equations.
    """
    bound_to = read_manifest(folder.path)["hash"]
    path = str(folder.path.resolve())
    return partial(
        run_part, path, campaign.specification, bound_to, threads=threads, screening=screening
    )


def run_part(
    folder: str,
    specification: Specification,
    bound_to: str,
    index: int,
    threads: int = 0,
    screening: Screening = UNSCREENED,
) -> dict[str, int]:
    """Run a part and write it.

    Args:
        folder: Folder of the campaign, under the same path for all workers.
        specification: Its specification: nothing is built from the folder's content.
        bound_to: Hash of its manifest, which the folder's must have.
        index: Number of the part.
        threads: Number of threads; 0 for all cores.
        screening: Screening of its runs by the equations.

    Returns:
        Number of runs that keep everything, by controller.

    Raises:
        GrosmcError: If the folder is not that of the campaign, or cannot be written.
    """
    campaign = open_campaign(folder, specification, bound_to)
    runs = screened_all(campaign, screening, campaign.laws, specification.ids(index), threads)
    Folder(Path(folder)).write(index, part_table(campaign, bound_to, index, runs))

    passed: dict[str, int] = {}
    for law, outcomes in zip(campaign.laws, runs, strict=True):
        passed[law] = int((outcomes["relative"] >= 0).sum())
    return passed


def open_campaign(folder: str, specification: Specification, bound_to: str) -> Campaign:
    """Return the campaign of a specification, designed once in a process, to add parts to it.

    Args:
        folder: Folder of the campaign.
        specification: Its specification.
        bound_to: Hash of its manifest, which the folder's must have.

    Raises:
        GrosmcError: If the folder is of another campaign, or its runs would differ here.
    """
    # A worker may outlive a folder and meet another campaign under its name.
    if read_manifest(Path(folder))["hash"] != bound_to:
        raise ArgumentError(f"{folder} has another campaign than the one that was begun in it")
    return _opened(folder, specification, bound_to)


# A worker runs many parts of a campaign, and to design its laws takes seconds.
@lru_cache(maxsize=4)
def _opened(folder: str, specification: Specification, _bound_to: str) -> Campaign:
    manifest = read_manifest(Path(folder))
    campaign, other_versions = _built(Path(folder), manifest, specification)
    if other_versions:
        raise ArgumentError(f"{folder} was begun with other versions: {'; '.join(other_versions)}")
    return campaign


def read_campaign(folder: Path, case_file: Path | None = None) -> tuple[Campaign, list[str]]:
    """Return the campaign that a folder describes, to read its runs.

    The folder is data: no Python is imported but that beside the case file that the user names,
    and that only if it is the recorded one.

    Args:
        folder: Folder of the campaign.
        case_file: Where its case file is now, with the files that it names.

    Returns:
        The campaign, and a line about each package that has another version now.

    Raises:
        GrosmcError: If there is none, or its configuration cannot be had here.
    """
    manifest = read_manifest(folder)
    try:
        specification = Specification.of_document(manifest["question"])
    except ArgumentError as error:
        raise ArgumentError(f"{folder}: {error}; run the campaign again") from None
    if case_file is None:
        _refuse_code_of_folder(folder, specification)
    else:
        # The layout of a text does not decide: versions of this package lay it out otherwise.
        if parse_case_file(specification.text, case_file) != read_case_file(case_file):
            raise ArgumentError(
                f"{case_file} is not the case file of {folder}: its content is another"
            )
        specification = replace(specification, folder=str(case_file.parent.resolve()))
    campaign, other_versions = _built(folder, manifest, specification)
    return campaign, [f"{text}: bits may differ" for text in other_versions]


def _refuse_code_of_folder(folder: Path, specification: Specification) -> None:
    """Refuse a case file that would import Python from beside it."""
    modules = named_in(specification.file)
    if modules:
        raise ArgumentError(
            f"{folder}: its case file names Python, {', '.join(modules)}, and a folder's is not "
            "imported: give a case file of your own with the same text, beside which that lies, "
            "by --case-file"
        )


def _built(
    folder: Path, manifest: Mapping[str, Any], specification: Specification
) -> tuple[Campaign, list[str]]:
    """The campaign of a specification, if it is the manifest's, and packages of other versions."""
    refuse_other_code(folder, manifest, specification)
    _forget_other_modules(manifest["sources"], specification.folder)
    campaign = Campaign.of(specification)

    now = manifest_of(campaign)
    other = _other_campaign(manifest, now)
    if other:
        raise ArgumentError(f"{folder} was begun with something else: {other}")
    return campaign, _differences(manifest, now, "versions")


def _forget_other_modules(sources: Mapping[str, str], folder: str) -> None:
    """Have user modules imported anew that are not those of a campaign.

    A worker may have kept modules of these names from another campaign of its life.

    Args:
        sources: SHA-256 of the campaign's modules, by file.
        folder: Where they lie.
    """
    for file, content in sources.items():
        name = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        source = (folder, content)
        if _imported.setdefault(name, source) != source:
            sys.modules.pop(name, None)
            _imported[name] = source

"""Comparison of two campaigns: pass rates and mean margins that differ by more than noise."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, one_line
from grosmc_mj.ground.wording import counted, spelled
from grosmc_mj.output.results.result import Value
from grosmc_mj.studies.campaign.manifest import MANIFEST, read_manifest
from grosmc_mj.studies.comparison.changes import GONE, Change, Effect, effect_of, one_sided
from grosmc_mj.studies.comparison.intervals import (
    ChangeInterval,
    other_plants_mean,
    other_plants_rate,
    same_plants_mean,
    same_plants_rate,
)
from grosmc_mj.studies.sweep.runs import MARGIN
from grosmc_mj.studies.sweep.sampled import SampledRuns

# Kind of its changes.
KIND = "campaign"
# Column of the least margin of each run.
_LEAST_MARGIN = "relative"
# Plants that are listed by their numbers.
_LISTED = 20
_NO_INTERVAL = "no interval: neither the same plants nor random ones"


@dataclass(frozen=True, eq=False)
class CampaignRows:
    """Runs of a campaign.

    Attributes:
        name: Name of its folder.
        rows: Columns by law and name, (n,) each, in the order of the plants' numbers; a run that
            ended early has a margin of -inf.
        plants: Uncertain numbers of each plant, (n, k), by law.
        basis: The sample.
        uncertain: Names of the uncertain numbers, k.
        units: Units of the columns, by name.
        system: Name of its system; empty for a model or equations of a user's own.
        repeats_on: Machine and versions on which its runs repeat to the bit; None if they draw
            random numbers, or the machine is unknown.
    """

    name: str
    rows: Mapping[str, Mapping[str, Array]]
    plants: Mapping[str, Array]
    basis: SampledRuns
    uncertain: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    system: str = ""
    repeats_on: Mapping[str, str] | None = None

    @property
    def margins(self) -> Mapping[str, tuple[str, str]]:
        """Law and column of each margin that has numbers, by the name of the margin."""
        margins = {}
        for law, columns in self.rows.items():
            for column, values in columns.items():
                if column != "id" and not np.isnan(values).all():
                    margins[f"{law}: {_title(column)}"] = (law, column)
        return margins


def _title(column: str) -> str:
    """Return the name of a margin for people."""
    if column == _LEAST_MARGIN:
        return "least margin"
    return spelled(column.removeprefix(MARGIN))


def campaign_folders(path: Path) -> dict[str, Path]:
    """Return the folders of campaigns in a path, by their relative paths."""
    if not path.is_dir():
        return {}
    folders = [manifest.parent for manifest in sorted(path.rglob(MANIFEST))]
    return {str(folder.relative_to(path)): folder for folder in folders}


def is_one_family(old: Path, new: Path) -> bool:
    """Return True if two folders are campaigns of one plant with the same uncertain numbers."""
    if not all((folder / MANIFEST).is_file() for folder in (old, new)):
        return False
    before = read_manifest(old)
    after = read_manifest(new)
    same_numbers = before["configuration"]["uncertain"] == after["configuration"]["uncertain"]
    return before["model"] == after["model"] and same_numbers


def campaign_rows(folder: Path) -> CampaignRows:
    """Read the runs of a campaign; nothing in its folder is executed.

    Raises:
        ArgumentError: If a part or the manifest cannot be read.
    """
    manifest = read_manifest(folder)
    try:
        return _read_rows(folder, manifest)
    except (OSError, KeyError, TypeError, ValueError, ArithmeticError, pa.ArrowException) as error:
        raise ArgumentError(f"{folder} cannot be read: {one_line(str(error))[:160]}") from None


def _read_rows(folder: Path, manifest: Mapping[str, Any]) -> CampaignRows:
    configuration = manifest["configuration"]
    uncertain = tuple(configuration["uncertain"])

    # pyarrow refuses a folder without parts.
    parts = [pq.read_table(file) for file in (folder / "parts").glob("*.parquet")]
    table = pa.concat_tables(parts).sort_by("id")
    margins = [name for name in table.column_names if name.startswith(MARGIN)]

    rows = {}
    plants = {}
    for law in table["controller"].unique().to_pylist():
        runs = table.filter(pc.field("controller") == law)
        columns = ("id", _LEAST_MARGIN, *margins)
        rows[law] = {name: np.asarray(runs[name], float) for name in columns}
        plants[law] = np.array([runs[name] for name in uncertain], float).T

    basis = SampledRuns(
        runs=len(table) // len(rows),
        planned=int(configuration["runs"]),
        sampler=str(configuration["sampler"]),
        seed=int(configuration["seed"]),
    )
    return CampaignRows(
        name=folder.name,
        rows=rows,
        plants=plants,
        basis=basis,
        uncertain=uncertain,
        units={name: _unit(table, name) for name in (_LEAST_MARGIN, *margins)},
        system=str(configuration["file"]["plant"].get("system", "")),
        repeats_on=_repeats_on(manifest),
    )


def _unit(table: pa.Table, column: str) -> str:
    """Return the unit of a margin; the least margin is in parts of its limit."""
    if column == _LEAST_MARGIN:
        return "of the limit"
    metadata = table.schema.field(column).metadata or {}
    return metadata.get(b"unit", b"").decode()


def _repeats_on(manifest: Mapping[str, Any]) -> Mapping[str, str] | None:
    """Return machine and versions on which runs repeat; a manifest of old names no machine."""
    machine = manifest.get("machine")
    if machine is None or manifest["random"]:
        return None
    return {"machine": machine, **manifest["versions"]}


class LawRuns(NamedTuple):
    """Runs of one law in two campaigns.

    Attributes:
        before: Columns of the old campaign, (n,) each.
        after: Columns of the new campaign, (m,) each.
        same_plants: Whether row i is the same plant on both sides.
        comparable: Whether the runs allow an interval: the plants are the same ones, or random.
        repeated: Whether an unchanged run would repeat to the bit: a difference is then no chance.
    """

    before: Mapping[str, Array]
    after: Mapping[str, Array]
    same_plants: bool
    comparable: bool
    repeated: bool = False


class ChangedVerdicts(NamedTuple):
    """Runs whose verdict differs between two campaigns whose runs repeat to the bit.

    Attributes:
        lost: Numbers of the plants that newly fail.
        won: Numbers of the plants that newly keep.
        runs: Number of all runs.
    """

    lost: list[int]
    won: list[int]
    runs: int

    @classmethod
    def of(cls, ids: Array, before: NDArray[np.bool_], after: NDArray[np.bool_]) -> ChangedVerdicts:
        """The changes between two verdicts of each run, (n,)."""
        lost = ids[before & ~after].astype(int).tolist()
        won = ids[~before & after].astype(int).tolist()
        return cls(lost, won, len(ids))

    @property
    def effect(self) -> Effect:
        """Worse if any plant newly fails: none of them does by chance."""
        if self.lost:
            return Effect.WORSE
        return Effect.BETTER if self.won else Effect.NOISE

    @property
    def words(self) -> str:
        """Numbers of the plants that newly fail, and how many newly keep."""
        listed = ", ".join(map(str, self.lost[:_LISTED]))
        if len(self.lost) > _LISTED:
            listed += ", ..."
        failing = f"newly failing of {counted(self.runs, 'plant')}: {listed or 'none'}"
        return f"{failing}; newly kept: {len(self.won)}"


class ComparedNumber(NamedTuple):
    """Pass rate or mean margin of two campaigns.

    Attributes:
        name: Name, with the law and the requirement.
        before: Value in the old campaign; None if no run has one.
        after: Value in the new campaign; None if no run has one.
        interval: Interval of the change; None if the runs allow none.
        unit: Unit of both; empty for a pass rate.
        verdicts: Changed verdicts of a pass rate where runs repeat; None for other numbers.
    """

    name: str
    before: float | None
    after: float | None
    interval: ChangeInterval | None
    unit: str = ""
    verdicts: ChangedVerdicts | None = None

    def change(self, subject: str) -> Change:
        """Return the change, which is noise if its interval contains zero.

        Args:
            subject: Words before its name that tell the campaign, with a blank; or none.
        """
        effect, note = self._effect()
        name = subject + self.name
        return Change(KIND, name, self.before, self.after, effect, self.unit, note)

    def _effect(self) -> tuple[Effect, str]:
        """Return the effect of the change, and what it was judged by."""
        if self.verdicts is not None:
            return self.verdicts.effect, self.verdicts.words
        if self.after is None:
            return Effect.WORSE, GONE
        if self.before is None:
            return Effect.NEW, ""
        if self.interval is None:
            return Effect.CHANGED, _NO_INTERVAL
        if not self.interval.excludes_zero:
            return Effect.NOISE, self.interval.words
        return effect_of(self.after - self.before), self.interval.words


def campaign_changes(old: CampaignRows, new: CampaignRows) -> tuple[list[Change], int]:
    """Return the changes of pass rates and mean margins, and how many both campaigns have."""
    before = old.margins
    after = new.margins
    # Two names are those of the only pair, and stand above the columns.
    subject = f"{new.name} " if old.name == new.name else ""
    there_before = _there(subject, before)
    there_after = _there(subject, after)
    changes = one_sided(there_before, there_after, gone=True)
    changes += one_sided(there_after, there_before, gone=False)

    compared = 0
    for name, (law, column) in before.items():
        if name not in after:
            continue
        runs = _law_runs(old, new, law)
        for number in _compared_numbers(runs, law, column, new.units.get(column, "")):
            compared += 1
            verdicts = number.verdicts
            changed = verdicts is not None and bool(verdicts.lost or verdicts.won)
            if changed or number.before != number.after:
                changes.append(number.change(subject))
    return changes, compared


def _there(subject: str, names: Iterable[str]) -> dict[tuple[str, str], Value]:
    """Return that a campaign has these margins, as values by kind and name."""
    values = [Value(name=subject + name, value="there") for name in names]
    return {(KIND, value.name): value for value in values}


def _law_runs(old: CampaignRows, new: CampaignRows, law: str) -> LawRuns:
    """Return the runs that both campaigns have if they are on the same plants; else all runs."""
    before = old.rows[law]
    after = new.rows[law]
    shared, in_old, in_new = np.intersect1d(before["id"], after["id"], return_indices=True)
    same = (
        len(shared) > 0
        and old.uncertain == new.uncertain
        and np.array_equal(old.plants[law][in_old], new.plants[law][in_new])
    )
    if not same:
        random = old.basis.independent and new.basis.independent
        return LawRuns(before, after, same_plants=False, comparable=random)

    return LawRuns(
        {name: values[in_old] for name, values in before.items()},
        {name: values[in_new] for name, values in after.items()},
        same_plants=True,
        comparable=True,
        repeated=old.repeats_on is not None and old.repeats_on == new.repeats_on,
    )


def _compared_numbers(runs: LawRuns, law: str, column: str, unit: str) -> Iterator[ComparedNumber]:
    """Yield pass rate and mean margin of a requirement under a law.

    Before those of the least margin comes the share of runs that complete.

    Args:
        runs: Runs of the law.
        law: Name of the law.
        column: Column of the margin.
        unit: Unit of the margin.
    """
    before = runs.before[column]
    after = runs.after[column]
    if np.isnan(before).any() or np.isnan(after).any():
        return

    completed_before = runs.before[_LEAST_MARGIN] > -np.inf
    completed_after = runs.after[_LEAST_MARGIN] > -np.inf
    title = _title(column)
    if column == _LEAST_MARGIN:
        yield _rate(f"{law}: runs completed", runs, completed_before, completed_after)
    yield _rate(f"{law}: {title}, pass rate", runs, before >= 0, after >= 0)

    # A run that ended early has no margin: it counts in the rates only.
    comparable = runs.comparable
    if runs.same_plants:
        completed_on_both = completed_before & completed_after
        comparable = bool(completed_on_both.any())
        if comparable:
            completed_before = completed_after = completed_on_both
    yield _mean(
        f"{law}: {title}, mean margin",
        runs._replace(comparable=comparable),
        before[completed_before],
        after[completed_after],
        unit,
    )


def _rate(
    name: str,
    runs: LawRuns,
    before: NDArray[np.bool_],
    after: NDArray[np.bool_],
) -> ComparedNumber:
    """Return the share of runs, (n,) before and (m,) after."""
    interval = None
    if runs.repeated:
        verdicts = ChangedVerdicts.of(runs.after["id"], before, after)
        return ComparedNumber(
            name, float(before.mean()), float(after.mean()), interval=None, verdicts=verdicts
        )
    if runs.comparable:
        interval_of = same_plants_rate if runs.same_plants else other_plants_rate
        interval = interval_of(before, after)
    return ComparedNumber(name, float(before.mean()), float(after.mean()), interval)


def _mean(
    name: str,
    runs: LawRuns,
    before: Array,
    after: Array,
    unit: str,
) -> ComparedNumber:
    """Return the mean margin of the runs that completed, (n,) before and (m,) after."""
    interval = None
    if runs.comparable and len(before) and len(after):
        interval_of = same_plants_mean if runs.same_plants else other_plants_mean
        interval = interval_of(before, after)
    return ComparedNumber(name, _mean_of(before), _mean_of(after), interval, unit)


def _mean_of(margins: Array) -> float | None:
    """Return the mean; None without margins."""
    if len(margins) == 0:
        return None
    return float(margins.mean())

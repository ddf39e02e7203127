"""Two campaigns: which pass rates and margins differ by more than chance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from grosmc_mj.arrays import Array
from grosmc_mj.comparison.changes import GONE, Change, Effect, effect_of
from grosmc_mj.comparison.significance import (
    LEVEL,
    SampleTest,
    holm,
    other_plants_means,
    other_plants_rates,
    same_plants_means,
    same_plants_rates,
)
from grosmc_mj.errors import ArgumentError, one_line
from grosmc_mj.sweep.findings import Basis
from grosmc_mj.sweep.runs import MARGIN
from grosmc_mj.sweep.store import MANIFEST, read_manifest

_LEAST_MARGIN = "relative"
MeanTest = Callable[[Array, Array], SampleTest]


@dataclass(frozen=True, eq=False)
class CampaignRows:
    """The runs of a campaign.

    Attributes:
        name: Of its folder.
        rows: By law and column, (n,) each, in the order of the plants' numbers; a margin of -inf is
            that of a run that ended early.
        plants: The uncertain numbers of each plant, (n, k), by law.
        basis: The sample.
    """

    name: str
    rows: Mapping[str, Mapping[str, Array]]
    plants: Mapping[str, Array]
    basis: Basis


def campaign_folders(path: Path) -> list[Path]:
    """Folders of campaigns in a path."""
    return sorted(file.parent for file in path.rglob(MANIFEST)) if path.is_dir() else []


def campaign_rows(folder: Path) -> CampaignRows:
    """The rows of a campaign; nothing in its folder is executed.

    Raises:
        ArgumentError: If a part or the manifest cannot be read.
    """
    manifest = read_manifest(folder)
    try:
        configuration = manifest["configuration"]
        names = list(configuration["uncertain"])
        tables = [pq.read_table(file) for file in sorted((folder / "parts").glob("*.parquet"))]
        if not tables:
            raise ArgumentError(f"{folder} has no runs")
        table = pa.concat_tables(tables).sort_by("id")
        judged = [name for name in table.column_names if name.startswith(MARGIN)]
        rows, plants = {}, {}
        for law in table["controller"].unique().to_pylist():
            own = table.filter(pc.field("controller") == law)
            rows[law] = {
                name: np.asarray(own[name], float) for name in ("id", _LEAST_MARGIN, *judged)
            }
            plants[law] = np.array([own[name] for name in names], float).T
        basis = Basis(
            len(table) // len(rows), int(configuration["runs"]), str(configuration["sampler"]),
            int(configuration["seed"]),
        )  # fmt: skip
    except (OSError, KeyError, TypeError, ValueError, pa.ArrowException) as error:
        raise ArgumentError(f"{folder} cannot be read: {one_line(str(error))[:160]}") from None
    return CampaignRows(folder.name, rows, plants, basis)


class _Number(NamedTuple):
    """A rate or a mean margin on both sides; no test where the runs allow none."""

    name: str
    before: float | None
    after: float | None
    test: SampleTest | None


def campaign_changes(old: CampaignRows, new: CampaignRows) -> tuple[list[Change], int]:
    """Which rates and mean margins differ by more than chance, and how many were compared.

    All tests of a comparison raise a false alarm with 5 % together, by Holm's procedure.
    """
    numbers = [number for law in old.rows if law in new.rows for number in _numbers(old, new, law)]
    tests = [number.test for number in numbers if number.test is not None]
    alarms = iter(holm([test.p_value for test in tests]))
    changes = []
    for name, before, after, test in numbers:
        change = Change("campaign", name, before, after, Effect.NOISE)
        alarm = test is not None and next(alarms)
        if before == after:
            continue
        if before is None or after is None:
            effect, note = (Effect.WORSE, GONE) if after is None else (Effect.NEW, "")
        elif test is None:
            effect, note = Effect.CHANGED, "no test: the plants are others, and no random draws"
        else:
            effect = effect_of(1 if after > before else -1) if alarm else Effect.NOISE
            detectable = test.detectable(LEVEL / len(tests))
            note = (
                f"{test.name}, p = {test.p_value:.1g} of {len(tests)} tests; least detectable "
                f"change {detectable:.2g}"
            )
        changes.append(change._replace(effect=effect, note=note))
    sides = [dict.fromkeys(f"{new.name} {each}" for each in _judged(side)) for side in (old, new)]
    changes += [gone_or_new(name, gone=True) for name in sides[0] if name not in sides[1]]
    changes += [gone_or_new(name, gone=False) for name in sides[1] if name not in sides[0]]
    return changes, len(numbers)


def gone_or_new(name: str, *, gone: bool) -> Change:
    """A campaign, a law or a requirement that one side has alone: worse if it is gone."""
    if gone:
        return Change("campaign", name, "there", None, Effect.WORSE, note=GONE)
    return Change("campaign", name, None, "there", Effect.NEW)


def _judged(campaign: CampaignRows) -> list[str]:
    """Laws, and requirements of each, that there are margins of."""
    return [
        f"{law}: {_title(column)}"
        for law, columns in campaign.rows.items()
        for column, values in columns.items()
        if column != "id" and not np.isnan(values).all()
    ]


def _title(column: str) -> str:
    """A requirement by the column of its margins."""
    return "least margin" if column == _LEAST_MARGIN else column.removeprefix(MARGIN)


def _numbers(old: CampaignRows, new: CampaignRows, law: str) -> Iterator[_Number]:
    """How many runs complete under a law; pass rate and mean margin of each requirement."""
    mine, theirs, same = _on_same_plants(old, new, law)
    tests = (
        (same_plants_rates, same_plants_means) if same else (other_plants_rates, other_plants_means)
    )
    testable = same or (old.basis.independent and new.basis.independent)

    def number(name: str, a: Array, b: Array, test: MeanTest | None) -> _Number:
        before, after = (float(side.mean()) if len(side) else None for side in (a, b))
        tested = test(a, b) if test and testable and len(a) and len(b) else None
        return _Number(f"{new.name} {law}: {name}", before, after, tested)

    ended = [side[_LEAST_MARGIN] == -np.inf for side in (mine, theirs)]
    both = same and not np.all(ended[0] | ended[1])
    yield number("runs completed", ~ended[0] * 1.0, ~ended[1] * 1.0, tests[0])
    for column in mine:
        if column == "id" or column not in theirs:
            continue
        a, b = mine[column], theirs[column]
        if np.isnan(a).any() or np.isnan(b).any():
            continue
        yield number(f"{_title(column)}, pass rate", (a >= 0) * 1.0, (b >= 0) * 1.0, tests[0])
        # A run that ended early has no margin; it counts in the rates.
        early = [ended[0] | ended[1]] * 2 if both else ended
        a, b = a[~early[0]], b[~early[1]]
        yield number(f"{_title(column)}, mean margin", a, b, tests[1] if both or not same else None)


def _on_same_plants(
    old: CampaignRows, new: CampaignRows, law: str
) -> tuple[Mapping[str, Array], Mapping[str, Array], bool]:
    """The rows of the runs that both have, if these are the same plants; else all rows of both."""
    before, after = old.rows[law], new.rows[law]
    shared, *places = np.intersect1d(before["id"], after["id"], return_indices=True)
    mine, theirs = (side.plants[law][place] for side, place in zip((old, new), places, strict=True))
    if not len(shared) or mine.shape != theirs.shape or not np.allclose(mine, theirs, rtol=1e-9):
        return before, after, False
    return (
        {name: values[places[0]] for name, values in before.items()},
        {name: values[places[1]] for name, values in after.items()},
        True,
    )

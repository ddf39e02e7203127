"""Two campaigns: which pass rates and margins differ by more than chance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

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
# A rate or a mean margin: its name, its value on both sides, and their test.
Number = tuple[str, float | None, float | None, SampleTest | None]
# Tests of rates and of means, by whether the plants are the same.
_TESTS = {
    True: (same_plants_rates, same_plants_means),
    False: (other_plants_rates, other_plants_means),
}


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

    @property
    def margins(self) -> Mapping[str, tuple[str, str]]:
        """Law and column of the margins that there are, by the name of each."""
        return {
            f"{self.name} {law}: "
            + ("least margin" if column == _LEAST_MARGIN else column.removeprefix(MARGIN)): (
                law,
                column,
            )
            for law, columns in self.rows.items()
            for column, values in columns.items()
            if column != "id" and not np.isnan(values).all()
        }


def campaign_folders(path: Path) -> dict[str, Path]:
    """Folders of campaigns in a path, by where they are in it."""
    files = path.rglob(MANIFEST) if path.is_dir() else ()
    return {str(file.parent.relative_to(path)): file.parent for file in sorted(files)}


def campaign_rows(folder: Path) -> CampaignRows:
    """The rows of a campaign; nothing in its folder is executed.

    Raises:
        ArgumentError: If a part or the manifest cannot be read.
    """
    manifest = read_manifest(folder)
    try:
        configuration, rows, plants = manifest["configuration"], {}, {}
        # pyarrow refuses a folder without parts.
        parts = [pq.read_table(file) for file in (folder / "parts").glob("*.parquet")]
        table = pa.concat_tables(parts).sort_by("id")
        judged = [name for name in table.column_names if name.startswith(MARGIN)]
        for law in table["controller"].unique().to_pylist():
            own = table.filter(pc.field("controller") == law)
            names = ("id", _LEAST_MARGIN, *judged)
            rows[law] = {name: np.asarray(own[name], float) for name in names}
            plants[law] = np.array([own[name] for name in configuration["uncertain"]], float).T
        basis = Basis(
            len(table) // len(rows), int(configuration["runs"]), str(configuration["sampler"]),
            int(configuration["seed"]),
        )  # fmt: skip
    except (OSError, KeyError, TypeError, ValueError, ArithmeticError, pa.ArrowException) as error:
        raise ArgumentError(f"{folder} cannot be read: {one_line(str(error))[:160]}") from None
    return CampaignRows(folder.name, rows, plants, basis)


def campaign_changes(old: CampaignRows, new: CampaignRows) -> tuple[list[Change], int]:
    """Which rates and mean margins differ by more than chance, and how many were compared.

    All tests of a comparison raise a false alarm with 5 % together, by Holm's procedure.
    """
    before, after = old.margins, new.margins
    changes = [gone_or_new(name, gone=name in before) for name in before.keys() ^ after.keys()]
    places = [before[name] for name in before if name in after]
    numbers = [number for place in places for number in _numbers(old, new, *place)]
    tests = [test for *_, test in numbers if test is not None]
    alarms = iter(holm([test.p_value for test in tests]))
    for name, mean, other, test in numbers:
        effect, alarm = Effect.NOISE, test is not None and next(alarms)
        if mean == other:
            continue
        if mean is None or other is None:
            effect, note = (Effect.WORSE, GONE) if other is None else (Effect.NEW, "")
        elif test is None:
            effect, note = Effect.CHANGED, "no test: the plants are others, and no random draws"
        else:
            note = (
                f"{test.name}, p = {test.p_value:.1g} of {len(tests)} tests; least detectable "
                f"change {test.detectable(LEVEL / len(tests)):.2g}"
            )
            effect = effect_of(other - mean) if alarm else Effect.NOISE
        changes.append(Change("campaign", f"{new.name} {name}", mean, other, effect, note=note))
    return changes, len(numbers)


def gone_or_new(name: str, *, gone: bool) -> Change:
    """A campaign, a law or a requirement that one side has alone: worse if it is gone."""
    if gone:
        return Change("campaign", name, "there", None, Effect.WORSE, note=GONE)
    return Change("campaign", name, None, "there", Effect.NEW)


def _numbers(old: CampaignRows, new: CampaignRows, law: str, column: str) -> Iterator[Number]:
    """Pass rate and mean margin of a requirement under a law.

    Before those of the least margin comes how many runs complete. There is no test where the runs
    allow none.
    """
    rows = old.rows[law], new.rows[law]
    # The runs that both have, if these are the same plants; else all runs of both.
    shared, *places = np.intersect1d(rows[0]["id"], rows[1]["id"], return_indices=True)
    plants = [side.plants[law][place] for side, place in zip((old, new), places, strict=True)]
    alike = len(shared) and plants[0].shape == plants[1].shape
    same = bool(alike and np.allclose(*plants, rtol=1e-9))
    places = places if same else [slice(None)] * 2
    a, b = (side[column][place] for side, place in zip(rows, places, strict=True))
    if np.isnan(a).any() or np.isnan(b).any():
        return
    rate_test, mean_test = _TESTS[same]
    testable = same or (old.basis.independent and new.basis.independent)

    def number(
        name: str, x: Array, y: Array, test: Callable[[Array, Array], SampleTest] | None
    ) -> Number:
        before, after = (float(side.mean()) if len(side) else None for side in (x, y))
        tested = test(x, y) if test and testable and len(x) and len(y) else None
        return f"{law}: {name}", before, after, tested

    completed = [
        side[_LEAST_MARGIN][place] > -np.inf for side, place in zip(rows, places, strict=True)
    ]
    title = column.removeprefix(MARGIN)
    if column == _LEAST_MARGIN:
        title = "least margin"
        yield number("runs completed", completed[0] * 1.0, completed[1] * 1.0, rate_test)
    yield number(f"{title}, pass rate", (a >= 0) * 1.0, (b >= 0) * 1.0, rate_test)
    # A run that ended early has no margin: it counts in the rates.
    both = completed[0] & completed[1] if same else np.ones(1, bool)
    counted = [both, both] if same and both.any() else completed
    margins = a[counted[0]], b[counted[1]]
    yield number(f"{title}, mean margin", *margins, mean_test if both.any() else None)

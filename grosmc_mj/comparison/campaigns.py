"""Two campaigns: which pass rates and margins differ by more than chance."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.findings.basis import Basis
from grosmc_mj.campaign.findings.replicates import Draws
from grosmc_mj.campaign.runs.manifest import MANIFEST, read_manifest, replicates_in
from grosmc_mj.comparison.changes import GONE, Change, Effect
from grosmc_mj.errors import ArgumentError, one_line

# An alarm is raised falsely in one comparison of twenty at most, however many tests it has.
LEVEL = 0.05
# Of changes as large as the least detectable one, this share is detected.
_POWER = 0.8
_MARGIN = "margin "
# Differences that rounding makes, of the larger one.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class CampaignRows:
    """The runs of a campaign.

    Attributes:
        name: Of its folder.
        rows: By law and column, (n,) each, in the order of the plants' numbers.
        plants: The uncertain numbers of each plant, (n, k), by law.
        basis: What it rests on.
    """

    name: str
    rows: Mapping[str, Mapping[str, Array]]
    plants: Mapping[str, Array]
    basis: Basis

    def draws(self, law: str) -> Draws:
        """How the plants that a law met were drawn."""
        return self.basis.draws(self.rows[law]["id"].astype(int))


def campaign_folders(path: Path) -> list[Path]:
    """Folders of campaigns in a path."""
    if not path.is_dir():
        return []
    return sorted(each.parent for each in path.rglob(MANIFEST))


def campaign_rows(folder: Path) -> CampaignRows:
    """What the parts of a campaign say; nothing of it is executed.

    Raises:
        ArgumentError: If a part or the manifest cannot be read.
    """
    manifest = read_manifest(folder)
    try:
        configuration = manifest["configuration"]
        names = list(configuration["uncertain"])
        files = sorted((folder / "parts").glob("part-*.parquet"))
        tables = [pq.read_table(file) for file in files]
        if not tables:
            raise ArgumentError(f"{folder} has no runs")
        table = pa.concat_tables(tables)
        asked = [each for each in table.column_names if each.startswith(_MARGIN)]
        columns = {name: table[name].to_numpy() for name in ("id", "relative", *names, *asked)}
        laws = np.array(table["controller"].to_pylist())
        basis = Basis(
            len(table) // max(1, len(np.unique(laws))), int(configuration["runs"]),
            str(configuration["sampler"]), int(configuration["seed"]), replicates_in(manifest),
        )  # fmt: skip
    except (OSError, KeyError, TypeError, ValueError, pa.ArrowException) as error:
        raise ArgumentError(f"{folder} cannot be read: {one_line(str(error))[:160]}") from None
    rows, plants = {}, {}
    for law in np.unique(laws).tolist():
        own = np.flatnonzero(laws == law)
        own = own[np.argsort(columns["id"][own], kind="stable")]
        rows[law] = {
            name: np.asarray(values[own], float)
            for name, values in columns.items()
            if name not in names
        }
        plants[law] = np.array([columns[name][own] for name in names], float).T
    return CampaignRows(folder.name, rows, plants, basis)


class _Test(NamedTuple):
    """A change with its p-value, before the number of tests is counted."""

    change: Change
    p_value: float | None
    better: float
    spread: float


def campaign_changes(old: CampaignRows, new: CampaignRows) -> tuple[list[Change], int]:
    """What differs by more than chance, by Holm's procedure, and how many tests there were."""
    tests = [test for law in old.rows if law in new.rows for test in _tests(old, new, law)]
    asked = [test for test in tests if test.p_value is not None]
    order = sorted(range(len(asked)), key=lambda i: asked[i].p_value or 0.0)
    alarms: set[int] = set()
    for place, i in enumerate(order):
        if (asked[i].p_value or 0.0) * (len(asked) - place) >= LEVEL:
            break
        alarms.add(id(asked[i]))
    found = []
    for test in tests:
        detectable = _detectable(test.spread, max(1, len(asked)))
        note = f"least detectable change {detectable:.2g}" if test.p_value is not None else ""
        if test.change.before == test.change.after and test.p_value is None:
            continue
        if id(test) in alarms:
            effect = Effect.BETTER if test.better > 0 else Effect.WORSE
            note = f"p = {test.p_value:.1g} of {len(asked)} tests; {note}"
        elif test.p_value is None:
            effect, note = Effect.CHANGED, "no test: the runs give no interval"
        else:
            effect = Effect.NOISE
        if effect is not Effect.NOISE or test.change.before != test.change.after:
            found.append(test.change._replace(effect=effect, note=note))
    before, after = _judged(old), _judged(new)
    found += [gone_or_new(f"{new.name} {each}", gone=True) for each in before if each not in after]
    found += [gone_or_new(f"{new.name} {each}", gone=False) for each in after if each not in before]
    return found, len(tests)


def gone_or_new(name: str, *, gone: bool) -> Change:
    """A campaign, a law or a requirement that one side has alone: worse if it is gone."""
    if gone:
        return Change("campaign", name, "there", None, Effect.WORSE, note=GONE)
    return Change("campaign", name, None, "there", Effect.NEW)


def _judged(campaign: CampaignRows) -> list[str]:
    """Laws, and requirements of each, that there are margins of."""
    return [
        f"{law}: {_called(column)}"
        for law, columns in campaign.rows.items()
        for column, values in columns.items()
        if column != "id" and not np.isnan(values).all()
    ]


def _called(column: str) -> str:
    """A requirement by the column of its margins."""
    return "least margin" if column == "relative" else column.removeprefix(_MARGIN)


def _tests(old: CampaignRows, new: CampaignRows, law: str) -> Iterator[_Test]:
    """A test of each margin's middle and of each pass rate under a law."""
    before, after, paired = _on_same_plants(old, new, law)
    shared = [name for name in before if name in after and name != "id"]
    for column in shared:
        name = f"{new.name} {law}: {_called(column)}"
        a, b = before[column], after[column]
        if not (len(a) and len(b)) or np.isnan(a).any() or np.isnan(b).any():
            continue
        for what, first, second in (
            ("margin", a, b),
            ("pass rate", (a >= 0).astype(float), (b >= 0).astype(float)),
        ):
            middle = np.median if what == "margin" else np.mean
            change = Change(
                "campaign", f"{name}, {what}", _number(middle(first)), _number(middle(second)),
                Effect.NOISE,
            )  # fmt: skip
            draws = (old.draws(law), new.draws(law))
            yield _tested(change, first, second, draws, paired=paired, rates=what == "pass rate")


def _number(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def _on_same_plants(
    old: CampaignRows, new: CampaignRows, law: str
) -> tuple[Mapping[str, Array], Mapping[str, Array], bool]:
    """The rows of both, of the same plants in the same order if they have the same."""
    before, after = old.rows[law], new.rows[law]
    same = len(before["id"]) == len(after["id"]) and np.array_equal(
        old.plants[law], new.plants[law]
    )
    return before, after, same


def _tested(
    change: Change, a: Array, b: Array, draws: tuple[Draws, Draws], *, paired: bool, rates: bool
) -> _Test:
    """The p-value of a difference of two columns, and the standard error of its mean."""
    # A run that ended early is as far below as the worst that did not.
    finite = np.concatenate([a[np.isfinite(a)], b[np.isfinite(b)], [0.0]])
    a, b = (np.maximum(each, finite.min() - 1.0) for each in (a, b))
    scale = max(float(np.abs(a).max()), float(np.abs(b).max()), 1e-300)
    if paired:
        moved = b - a
        moved[np.abs(moved) <= _ROUNDING * scale] = 0.0
        p, error = (_of_verdicts if rates else _of_pairs)(moved, draws[1])
        return _Test(change, p, float(moved.mean()), error)
    p, error = _of_groups(a, b, draws)
    return _Test(change, p, float(b.mean() - a.mean()), error)


def _of_pairs(moved: Array, draws: Draws) -> tuple[float | None, float]:
    """Whether the changes have a direction: Wilcoxon's, or Student's of replicates."""
    if not moved.any():
        return 1.0, 0.0
    if draws.why_not:
        return None, math.nan
    if draws.replicate is not None:
        means = _means(moved, draws)
        return _student(means, np.zeros(1))
    found: Any = stats.wilcoxon(moved, zero_method="zsplit", method="approx")
    return float(found.pvalue), float(moved.std(ddof=1)) / math.sqrt(len(moved)) if len(
        moved
    ) > 1 else math.nan


def _of_verdicts(moved: Array, draws: Draws) -> tuple[float | None, float]:
    """McNemar's test, exact: a plant kept on one side alone is of either with probability 1/2.

    It needs no independent plants, since both sides have the same.
    """
    if draws.why_not:
        return None, math.nan
    lost, won = int((moved < 0).sum()), int((moved > 0).sum())
    p = float(stats.binomtest(lost, lost + won).pvalue) if lost + won else 1.0
    return p, float(moved.std()) / math.sqrt(len(moved))


def _of_groups(a: Array, b: Array, draws: tuple[Draws, Draws]) -> tuple[float | None, float]:
    """Whether one group lies above the other: Mann and Whitney's, or Welch's of replicates."""
    if draws[0].why_not or draws[1].why_not:
        return None, math.nan
    if draws[0].replicate is not None and draws[1].replicate is not None:
        return _student(_means(b, draws[1]), _means(a, draws[0]))
    if np.ptp(np.concatenate([a, b])) == 0:
        return 1.0, 0.0
    error = math.sqrt(float(a.var()) / len(a) + float(b.var()) / len(b))
    return float(stats.mannwhitneyu(a, b).pvalue), error


def _means(values: Array, draws: Draws) -> Array:
    assert draws.replicate is not None
    return np.array([values[draws.replicate == each].mean() for each in np.unique(draws.replicate)])


def _student(means: Array, others: Array) -> tuple[float | None, float]:
    """Welch's test of replicates' means; against one number, Student's."""
    if len(means) < 2:
        return None, math.nan
    error = float(means.var(ddof=1)) / len(means)
    if len(others) > 1:
        error += float(others.var(ddof=1)) / len(others)
    error = math.sqrt(error)
    if error == 0:
        return (1.0 if means.mean() == others.mean() else 0.0), 0.0
    if len(others) == 1:
        found: Any = stats.ttest_1samp(means, others[0])
    else:
        found = stats.ttest_ind(means, others, equal_var=False)
    return float(found.pvalue), error


def _detectable(error: float, tests: int) -> float:
    """The change of a mean that is found with the power, of so many tests."""
    z = stats.norm.isf(LEVEL / (2 * tests)) + stats.norm.ppf(_POWER)
    return float(z * error)

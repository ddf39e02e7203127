"""Comparing results: a change is noticed, noise raises no alarm."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import assert_one_line, run
from page_documents import valued
from scipy import stats

from grosmc_mj import cli
from grosmc_mj.arrays import Array
from grosmc_mj.comparison.campaigns import CampaignRows, campaign_changes
from grosmc_mj.comparison.changes import Change, Effect
from grosmc_mj.comparison.comparison import compare
from grosmc_mj.comparison.intervals import (
    CONFIDENCE,
    other_plants_mean,
    other_plants_rate,
    same_plants_mean,
    same_plants_rate,
)
from grosmc_mj.errors import ArgumentError
from grosmc_mj.results.result import Value
from grosmc_mj.sweep.findings import Basis

VERSIONS = {"grosmc_mj": "0.1.0", "mujoco": "3.17.0", "numba": "0.62", "numpy": "2", "scipy": "1"}
RUNS = 400
PLANTS = np.linspace(-1, 1, RUNS)[:, None]
BETTER, WORSE, NOISE, CHANGED, NEW = (
    Effect.BETTER, Effect.WORSE, Effect.NOISE, Effect.CHANGED, Effect.NEW
)  # fmt: skip


def run_document(**changes: Any) -> dict[str, Any]:
    """A result of a switching law with other numbers; without those that are None."""
    numbers = {"margin": 1.0, "deviation": 4e-3, "verdict": "kept", "machine": "here", "seed": None}
    numbers |= changes
    values = [
        Value(name="x: settles", value=numbers["verdict"]),
        Value(name="x: margin", value=numbers["margin"], unit="s", better=1, size=4.0,
              relative=0.0, absolute=0.02),
        Value(name="x: deviation", value=numbers["deviation"], unit="rad", relative=0.25,
              absolute=1e-4),
        Value(name="x: premise", value=changes.get("premise", "completed")),
    ]  # fmt: skip
    values = [value for value in values if value.name not in changes.get("without", ())]
    own = {"versions": VERSIONS, "machine": numbers["machine"], "seed": numbers["seed"]}
    return json.loads(json.dumps(valued(values, **own)))


def written(folder: Path, document: Mapping[str, Any]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "servo_case1.json").write_text(json.dumps(document), encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, {}),
        ({"margin": 0.98}, {"margin": WORSE}),
        ({"margin": 1.02}, {"margin": BETTER}),
        # Rounding is of the size that was measured, 4.
        ({"margin": 1.0 + 3.9e-6}, {"margin": NOISE}),
        ({"margin": 1.0 + 4.1e-6}, {"margin": BETTER}),
        ({"margin": -0.1, "verdict": "not kept"}, {"margin": WORSE, "settles": WORSE}),
        ({"deviation": 4.1e-3}, {"deviation": CHANGED}),
        # On another machine switching parts the trajectories: 25 % of a deviation are noise.
        ({"deviation": 4.1e-3, "machine": "there"}, {"deviation": NOISE}),
        ({"deviation": 9e-3, "machine": "there"}, {"deviation": CHANGED}),
        # A single run of another seed tells nothing.
        ({"margin": 0.5, "seed": 7}, {"margin": Effect.UNJUDGED}),
        # A missing one is worse.
        ({"without": ("x: margin",)}, {"margin": WORSE}),
        ({"deviation": None}, {"deviation": WORSE}),
        # Words of studies are ranked.
        ({"premise": ("fails", "holds")}, {"premise": BETTER}),
        ({"premise": ("holds", "fails")}, {"premise": WORSE}),
        ({"premise": ("refuted", "open")}, {"premise": CHANGED}),
    ],
)
def test_a_change_is_told_from_noise(
    changes: dict[str, Any], expected: dict[str, Effect], tmp_path: Path
) -> None:
    before, after = changes.get("premise", ("", ""))
    old, new = run_document(premise=before), run_document(**changes | {"premise": after})
    comparison = compare(written(tmp_path / "old", old), written(tmp_path / "new", new))
    effects = {change.name.partition(": ")[2]: change.effect for change in comparison.changes}
    assert effects == expected


def test_the_command_exits_1_if_something_got_worse(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old, new, out = written(tmp_path / "old", run_document()), tmp_path / "new", tmp_path / "out"
    command = ("diff", old, new, "--out", out)
    written(new, run_document(margin=0.985, machine="there", deviation=4.5e-3))
    assert run(*command) == cli.DONE, "on another machine switching moves an instant"
    written(new, run_document(margin=0.98, deviation=9e-3))
    assert run(*command) == cli.DIFFERS
    assert "1 got worse beyond noise, of 4 compared; 1 changed." in capsys.readouterr().out
    document = json.loads((out / "diff.json").read_text())
    assert (document["counts"]["worse"], document["answers"][0]["verdict"]) == (1, "not kept")
    assert run("diff", new, old, "--out", out) == cli.DONE
    written(new, run_document(seed=2, margin=0.5))
    assert run(*command) == cli.DONE
    output = " ".join(capsys.readouterr().out.split())
    assert "1 not judged" in output
    assert "single runs with another random seed" in output


def test_campaigns_that_are_gone_are_worse_and_other_sources_are_named(tmp_path: Path) -> None:
    content = {"versions": {**VERSIONS, "mujoco": "3.18.0"}, "configuration": {"engine": "python"}}
    old = written(tmp_path / "old", run_document())
    new = written(tmp_path / "new", run_document(machine="there") | content)
    (old / "campaigns" / "servo").mkdir(parents=True)
    (old / "campaigns" / "servo" / "manifest.json").write_text("{}")
    comparison = compare(old, new)
    (change,) = comparison.changes
    assert (change.name, change.effect) == ("campaigns/servo", WORSE)
    assert {"machine: here -> there", "versions.mujoco: 3.17.0 -> 3.18.0"} <= {*comparison.sources}
    assert any("configuration.engine" in line for line in comparison.sources)
    assert [change.effect for change in compare(new, old).changes] == [NEW]


def test_files_that_cannot_be_compared_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    odd, empty, good = tmp_path / "odd.json", tmp_path / "empty", tmp_path / "good"
    written(good, run_document())
    empty.mkdir()
    for content in (b"\x89PNG\r\n", b'{"runs": [', b"[" * 10**6):
        odd.write_bytes(content)
        for sides in ((odd, good), (good, odd)):
            assert run("diff", *sides, "--out", tmp_path) == cli.WRONG
            error = capsys.readouterr().err
            assert f"no results: {odd}: " in error
            assert_one_line(error)
    for one, other, words in (
        (good, empty, "no results in common"), (empty, tmp_path / "nowhere", "does not exist"),
        (empty, Path("/dev/full"), "neither a file nor a folder"),
    ):  # fmt: skip
        with pytest.raises(ArgumentError, match=words):
            compare(one, other)


# Campaigns.


def rows(margins: Array, plants: Array = PLANTS, sampler: str = "random") -> CampaignRows:
    """A campaign of one law with one requirement; its seed is in its plants."""
    ids = np.arange(len(margins), dtype=float)
    columns = {"id": ids, "relative": margins, "margin settles_within": margins}
    basis = Basis(len(margins), len(margins), sampler, int(1e6 * plants[0, 0]))
    return CampaignRows("servo", {"grosmc": columns}, {"grosmc": plants}, basis)


def changes_of(old: CampaignRows, new: CampaignRows) -> dict[str, Change]:
    changes, compared = campaign_changes(old, new)
    assert compared == 5
    return {change.name.partition(": ")[2]: change for change in changes}


@pytest.mark.parametrize(
    ("same", "sampler"), [(True, "random"), (True, "sobol"), (False, "random"), (False, "sobol")]
)
def test_equal_campaigns_raise_an_alarm_in_one_comparison_of_fifty_at_most(
    same: bool, sampler: str
) -> None:
    """Margins depend on the plant, and on chance."""
    random, alarms, comparisons = np.random.default_rng(1), 0, 100 if same else 40
    for _ in range(comparisons):
        one = random.uniform(-1, 1, (RUNS, 1))
        plants = (one, one if same else random.uniform(-1, 1, (RUNS, 1)))
        old, new = (
            rows(0.3 - 0.5 * x[:, 0] ** 2 + 0.1 * random.standard_normal(RUNS), x, sampler)
            for x in plants
        )
        changes = changes_of(old, new).values()
        alarms += any(change.effect in (WORSE, BETTER) for change in changes)
        if not same and sampler == "sobol":
            # Other plants that are no random draws have no interval.
            assert {change.effect for change in changes} == {CHANGED}
            assert all(change.note.startswith("no interval: ") for change in changes)
    # A rate and a mean; both requirements have the same. One such test in ten thousand would see
    # more alarms than this, if each interval has its confidence.
    assert alarms <= stats.binom.isf(1e-4, comparisons, 2 * (1 - CONFIDENCE))


@pytest.mark.parametrize("sampler", ["random", "sobol"])
@pytest.mark.parametrize(
    ("lost", "won", "effect"),
    [(20, 0, WORSE), (8, 0, WORSE), (7, 0, NOISE), (11, 2, NOISE), (3, 3, None), (0, 20, BETTER)],
)
def test_pass_rates_of_the_same_plants_are_compared_by_those_that_changed(
    lost: int, won: int, effect: Effect | None, sampler: str
) -> None:
    """McNemar (1947): of plants that changed, as many were lost as won, but for chance."""
    changed = lost + won
    # 2 / 2^8 < 1 % < 2 / 2^7.
    assert (effect in (WORSE, BETTER)) == (stats.binomtest(lost, changed).pvalue < 1 - CONFIDENCE)
    before, after = np.full(RUNS, 0.1), np.full(RUNS, 0.1)
    after[:lost], before[lost:changed] = -0.1, -0.1
    found = changes_of(rows(before, PLANTS, sampler), rows(after, PLANTS, sampler))
    rates = [change for name, change in found.items() if name.endswith("pass rate")]
    assert len(rates) == (0 if effect is None else 2)
    for change in rates:
        assert change.effect is effect
        assert change.note.startswith(f"{lost} of 400 plants lost, {won} won; change ")


def test_a_requirement_or_law_that_a_campaign_no_longer_has_is_worse() -> None:
    one = rows(PLANTS[:, 0])
    fewer = replace(one, rows={"grosmc": {k: one.rows["grosmc"][k] for k in ("id", "relative")}})
    other = replace(one, rows={"lqr": one.rows["grosmc"]}, plants={"lqr": PLANTS})
    for new, gone in ((fewer, 1), (other, 2)):
        worse = [x for x in campaign_changes(one, new)[0] if x.effect is WORSE]
        assert [change.after for change in worse] == [None] * gone
    assert [change.effect for change in campaign_changes(fewer, one)[0]] == [NEW]


def test_runs_that_end_early_are_counted_and_get_no_margin() -> None:
    margins = np.linspace(0.1, 1, RUNS)
    changes = changes_of(rows(margins), rows(np.where(np.arange(RUNS) < 60, -np.inf, margins)))
    names = {"runs completed", "least margin, pass rate", "settles_within, pass rate"}
    assert set(changes) == names
    for change in changes.values():
        assert (change.before, change.after, change.effect) == (1.0, 0.85, WORSE)
        assert change.note.startswith("60 of 400 plants lost, 0 won; change ")
    # Of the others the mean margin is as it was; where none is left, it is gone.
    changes = changes_of(rows(margins), rows(np.full(RUNS, -np.inf)))
    gone = [x for name, x in changes.items() if name.endswith("mean margin")]
    assert [(x.after, x.effect, x.note) for x in gone] == [(None, WORSE, "gone")] * 2


def test_effect_and_interval_are_of_the_mean() -> None:
    """Most plants gain a little and some lose much: the median rises, the mean falls."""
    before = np.random.default_rng(5).uniform(1, 2, RUNS)
    after = before + np.where(np.arange(RUNS) < 80, -0.5, 0.01)
    assert np.median(after - before) > 0
    changes = changes_of(rows(before), rows(after))
    assert all(name.endswith("mean margin") for name in changes)
    for change in changes.values():
        assert change.effect is WORSE
        assert (change.before, change.after) == (before.mean(), after.mean())
        assert change.note.startswith("change -0.1")
        assert change.note.endswith(" (99 % interval)")
    # Two percent are noticed; the first runs of a longer campaign are the same plants.
    plants = np.random.default_rng(6).uniform(-1, 1, (2 * RUNS, 1))
    margins = 0.3 - 0.5 * plants[:, 0] ** 2
    short = rows(margins[:RUNS], plants[:RUNS])
    assert changes_of(short, rows(margins, plants)) == {}
    change = changes_of(short, rows(margins - 0.01, plants))["least margin, mean margin"]
    assert change.after == pytest.approx(margins[:RUNS].mean() - 0.01)
    assert change.effect is WORSE


# Intervals.


@pytest.mark.parametrize(("lost", "won"), [(6, 0), (12, 9), (150, 140)])
def test_an_interval_of_a_rate_on_the_same_plants_is_that_of_the_plants_that_changed(
    lost: int, won: int
) -> None:
    numbers, changed, tail = np.arange(1000), lost + won, (1 - CONFIDENCE) / 2
    found = same_plants_rate(numbers >= won, numbers < 1000 - lost)
    # At both ends a share under which the counts have the tail's probability.
    low = stats.beta.ppf(tail, won, lost + 1) if won else 0.0
    high = stats.beta.isf(tail, won + 1, lost)
    assert found.low == pytest.approx((2 * low - 1) * changed / 1000)
    assert found.high == pytest.approx((2 * high - 1) * changed / 1000)
    same = same_plants_rate(numbers < lost, numbers < lost)
    assert (same.low, same.high) == (0.0, 0.0)


def test_an_interval_of_a_rate_on_other_plants_covers_the_change() -> None:
    """With 99 % at least: the bounds of both rates hold together."""
    random, rates, runs = np.random.default_rng(2), (0.9, 0.8), (200, 300)
    change, covered = rates[1] - rates[0], 0
    for _ in range(500):
        before, after = (
            random.uniform(size=size) < rate for size, rate in zip(runs, rates, strict=True)
        )
        found = other_plants_rate(before, after)
        covered += found.low <= change <= found.high
    # Fewer would be seen once in ten thousand times.
    assert covered >= stats.binom.ppf(1e-4, 500, CONFIDENCE)


def test_intervals_of_means_are_those_of_student_and_of_welch() -> None:
    random = np.random.default_rng(3)
    before, after = random.normal(0, 1, 60), random.normal(0.3, 2, 60)
    student: Any = stats.ttest_rel(after, before)
    found = same_plants_mean(before, after)
    ends = student.confidence_interval(CONFIDENCE)
    assert (found.low, found.high) == pytest.approx((ends.low, ends.high), rel=1e-9)
    welch: Any = stats.ttest_ind(after[:50], before, equal_var=False)
    found = other_plants_mean(before, after[:50])
    ends = welch.confidence_interval(CONFIDENCE)
    assert (found.low, found.high) == pytest.approx((ends.low, ends.high), rel=1e-9)


def test_rounding_is_no_change_and_a_single_plant_shows_none() -> None:
    margins = np.linspace(1, 2, 60)
    assert not same_plants_mean(margins, margins * (1 + 1e-12)).excludes_zero
    assert same_plants_mean(margins, margins * (1 + 1e-6)).excludes_zero
    single = np.ones(1)
    assert not same_plants_mean(single, 2 * single).excludes_zero
    assert not other_plants_mean(single, 2 * single).excludes_zero
    # Margins that are all the same scatter by nothing.
    assert other_plants_mean(np.ones(9), np.full(5, 2.0))[:2] == (1.0, 1.0)

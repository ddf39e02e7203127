"""Comparing results: what changed is found, what is noise raises no alarm."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from page_documents import valued
from scipy import stats

from grosmc_mj import cli
from grosmc_mj.arrays import Array
from grosmc_mj.comparison.campaigns import CampaignRows, campaign_changes
from grosmc_mj.comparison.changes import Change, Effect
from grosmc_mj.comparison.comparison import compare
from grosmc_mj.comparison.significance import (
    LEVEL,
    POWER,
    holm,
    other_plants_means,
    other_plants_rates,
    same_plants_means,
    same_plants_rates,
)
from grosmc_mj.errors import ArgumentError
from grosmc_mj.results.result import Value
from grosmc_mj.sweep.findings import Basis

VERSIONS = {"grosmc_mj": "0.1.0", "mujoco": "3.17.0", "numba": "0.62", "numpy": "2", "scipy": "1"}
RUNS = 400


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
        Value(name="x: status", value="completed"),
    ]  # fmt: skip
    values = [value for value in values if value.name not in changes.get("without", ())]
    own = {"versions": VERSIONS, "machine": numbers["machine"], "seed": numbers["seed"]}
    return json.loads(json.dumps(valued(values, **own)))


def written(folder: Path, document: Mapping[str, Any]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "servo_case1.json").write_text(json.dumps(document), encoding="utf-8")
    return folder


def effects(tmp_path: Path, old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Effect]:
    found = compare(written(tmp_path / "old", old), written(tmp_path / "new", new))
    return {change.name.partition(": ")[2]: change.effect for change in found.changes}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, {}),
        ({"margin": 0.98}, {"margin": Effect.WORSE}),
        ({"margin": 1.02}, {"margin": Effect.BETTER}),
        ({"margin": 1.0 + 1e-12}, {"margin": Effect.NOISE}),
        # Rounding is of the size that was measured, 4.
        ({"margin": 1.0 + 3.9e-6}, {"margin": Effect.NOISE}),
        ({"margin": 1.0 + 4.1e-6}, {"margin": Effect.BETTER}),
        (
            {"margin": -0.1, "verdict": "not kept"},
            {"margin": Effect.WORSE, "settles": Effect.WORSE},
        ),
        ({"deviation": 4.1e-3}, {"deviation": Effect.CHANGED}),
        # On another machine switching parts the trajectories: 25 % of a deviation are noise.
        ({"deviation": 4.1e-3, "machine": "there"}, {"deviation": Effect.NOISE}),
        ({"deviation": 9e-3, "machine": "there"}, {"deviation": Effect.CHANGED}),
        # A single run of another seed tells nothing.
        ({"margin": 0.5, "seed": 7}, {"margin": Effect.UNJUDGED}),
        # What is gone is worse.
        ({"without": ("x: margin",)}, {"margin": Effect.WORSE}),
        ({"deviation": None}, {"deviation": Effect.WORSE}),
    ],
)
def test_a_change_is_told_from_noise(
    changes: dict[str, Any], expected: dict[str, Effect], tmp_path: Path
) -> None:
    assert effects(tmp_path, run_document(), run_document(**changes)) == expected


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as stop:
        cli.main(arguments)
    assert isinstance(stop.value.code, int)
    return stop.value.code


def test_the_command_exits_1_if_something_got_worse(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = written(tmp_path / "old", run_document())
    new = written(tmp_path / "new", run_document(margin=0.985, machine="there", deviation=4.5e-3))
    junit, out = tmp_path / "junit.xml", tmp_path / "out"
    named = (str(old), str(new), "--out", str(out), "--junit", str(junit))
    assert run("diff", *named) == cli.DONE, "on another machine switching moves an instant"
    new = written(tmp_path / "new", run_document(margin=0.98, deviation=9e-3))
    assert run("diff", *named) == cli.DIFFERS
    said = capsys.readouterr().out
    assert "1 got worse beyond noise, of 4 compared; 1 changed." in said
    suite = ElementTree.parse(junit).getroot()
    assert (suite.get("failures"), len(suite.findall("testcase/failure"))) == ("1", 1)
    document = json.loads((out / "diff.json").read_text())
    assert document["counts"]["worse"] == 1
    assert run("diff", str(new), str(old), "--out", str(out)) == cli.DONE


def test_a_campaign_that_is_gone_is_worse(tmp_path: Path) -> None:
    old, new = (written(tmp_path / name, run_document()) for name in ("old", "new"))
    campaign = old / "campaigns" / "servo"
    campaign.mkdir(parents=True)
    (campaign / "manifest.json").write_text("{}")
    (change,) = compare(old, new).changes
    assert (change.name, change.effect) == ("campaigns/servo", Effect.WORSE)
    (change,) = compare(new, old).changes
    assert change.effect is Effect.NEW


def test_what_chance_did_to_single_runs_is_not_judged_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = written(tmp_path / "old", run_document(seed=1))
    new = written(tmp_path / "new", run_document(seed=2, margin=0.5))
    assert run("diff", str(old), str(new), "--out", str(tmp_path)) == cli.DONE
    said = " ".join(capsys.readouterr().out.split())
    assert "1 not judged" in said
    assert "single runs with another random seed" in said


@pytest.mark.parametrize("content", [b"\x89PNG\r\n", b'{"runs": [', b"[" * 10**6])
def test_what_cannot_be_read_is_one_clear_line(
    content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    odd = tmp_path / "odd.json"
    odd.write_bytes(content)
    good = written(tmp_path / "good", run_document())
    for sides in ((odd, good), (good, odd)):
        assert run("diff", *map(str, sides), "--out", str(tmp_path)) == cli.WRONG
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert f"no results: {odd}: " in said


def test_what_was_made_from_other_things_is_told(tmp_path: Path) -> None:
    new = run_document(machine="there")
    new["versions"] = {**VERSIONS, "mujoco": "3.18.0"}
    new["configuration"] = {"engine": "python"}
    found = compare(written(tmp_path / "a", run_document()), written(tmp_path / "b", new))
    assert "machine: here -> there" in found.sources
    assert "versions.mujoco: 3.17.0 -> 3.18.0" in found.sources
    assert any("configuration.engine" in line for line in found.sources)


def test_nothing_in_common_is_refused(tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(ArgumentError, match="no results in common"):
        compare(written(tmp_path / "old", run_document()), empty)
    with pytest.raises(ArgumentError, match="does not exist"):
        compare(empty, tmp_path / "nowhere")
    with pytest.raises(ArgumentError, match="neither a file nor a folder"):
        compare(empty, Path("/dev/full"))


def test_words_of_studies_are_ranked(tmp_path: Path) -> None:
    def document(verdict: str) -> dict[str, Any]:
        return valued([Value(name="x: premise", value=verdict)], versions=VERSIONS, machine="here")

    assert effects(tmp_path, document("fails"), document("holds")) == {"premise": Effect.BETTER}
    assert effects(tmp_path, document("holds"), document("fails")) == {"premise": Effect.WORSE}
    assert effects(tmp_path, document("refuted"), document("open")) == {"premise": Effect.CHANGED}


# Campaigns.


def rows(margins: Array, plants: Array, sampler: str = "random", seed: int = 0) -> CampaignRows:
    """A campaign of one law with one requirement."""
    ids = np.arange(len(margins), dtype=float)
    return CampaignRows(
        "servo",
        {"grosmc": {"id": ids, "relative": margins, "margin settles_within": margins}},
        {"grosmc": plants},
        Basis(len(margins), len(margins), sampler, seed),
    )


def alarmed(changes: list[Change]) -> bool:
    return any(change.effect in (Effect.WORSE, Effect.BETTER) for change in changes)


def noisy(random: np.random.Generator, plants: Array) -> Array:
    """Margins that depend on the plant, and on chance."""
    return 0.3 - 0.5 * plants[:, 0] ** 2 + 0.1 * random.standard_normal(len(plants))


def other_noise(random: np.random.Generator, sampler: str) -> tuple[CampaignRows, CampaignRows]:
    """The same plants with two seeds of noise."""
    plants = random.uniform(-1, 1, (RUNS, 1))
    return rows(noisy(random, plants), plants, sampler), rows(
        noisy(random, plants), plants, sampler
    )


def other_plants(random: np.random.Generator, sampler: str) -> tuple[CampaignRows, CampaignRows]:
    """Other plants of the same family."""
    one, other = (random.uniform(-1, 1, (RUNS, 1)) for _ in range(2))
    return rows(noisy(random, one), one, sampler), rows(noisy(random, other), other, sampler, 1)


@pytest.mark.parametrize(
    ("pair", "sampler"),
    [(other_noise, "random"), (other_noise, "sobol"), (other_plants, "random")],
)
def test_equal_campaigns_raise_an_alarm_in_one_comparison_of_twenty_at_most(
    pair: Callable[..., tuple[CampaignRows, CampaignRows]], sampler: str
) -> None:
    random, comparisons = np.random.default_rng(1), 300
    alarms = sum(alarmed(campaign_changes(*pair(random, sampler))[0]) for _ in range(comparisons))
    # More alarms than this would be seen of one test in ten thousand, were the level kept.
    assert alarms <= stats.binom.isf(1e-4, comparisons, LEVEL)


def test_other_plants_that_are_no_random_draws_are_not_tested() -> None:
    found, compared = campaign_changes(*other_plants(np.random.default_rng(3), "sobol"))
    assert compared == 5
    assert {each.effect for each in found} == {Effect.CHANGED}
    assert all(each.note.startswith("no test: ") for each in found)


@pytest.mark.parametrize("sampler", ["random", "sobol"])
def test_a_fault_of_two_percent_in_a_margin_is_found(sampler: str) -> None:
    random = np.random.default_rng(2)
    plants = random.uniform(-1, 1, (RUNS, 1))
    before = 0.3 + 0.2 * plants[:, 0] ** 2
    after = 0.98 * before + 0.01 * random.standard_normal(RUNS)
    found, _ = campaign_changes(rows(before, plants, sampler), rows(after, plants, sampler))
    worse = [each for each in found if each.effect is Effect.WORSE]
    assert worse
    assert all("p = " in each.note and "least detectable" in each.note for each in worse)


@pytest.mark.parametrize(
    ("lost", "won", "p"), [(20, 0, 1.9e-6), (15, 2, 2.35e-3), (3, 3, 1.0), (0, 20, 1.9e-6)]
)
@pytest.mark.parametrize("sampler", ["random", "sobol"])
def test_pass_rates_of_the_same_plants_are_compared_by_those_that_changed(
    sampler: str, lost: int, won: int, p: float
) -> None:
    """McNemar (1947): of plants that changed, as many were lost as won, but for chance."""
    runs, changed = 2000, lost + won
    tail = sum(math.comb(changed, k) for k in range(max(lost, won), changed + 1)) / 2**changed
    assert min(1.0, 2 * tail) == pytest.approx(p, rel=0.02)
    plants = np.linspace(-1, 1, runs)[:, None]
    before, after = np.full(runs, 0.1), np.full(runs, 0.1)
    after[:lost], before[lost:changed] = -0.1, -0.1
    found, _ = campaign_changes(rows(before, plants, sampler), rows(after, plants, sampler))
    rates = [each for each in found if each.name.endswith("pass rate")]
    # Holm's procedure takes the least of the p-values times 5, as there are 5 tests.
    expected = Effect.NOISE if 5 * p >= LEVEL else Effect.WORSE if lost > won else Effect.BETTER
    assert {each.effect for each in rates} <= {expected}
    assert all(
        f"McNemar, p = {p:.1g} of 5 tests" in each.note
        for each in rates
        if expected is not Effect.NOISE
    )
    assert bool(rates) == (lost != won)


def test_a_requirement_or_law_that_a_campaign_no_longer_has_is_worse() -> None:
    plants = np.linspace(-1, 1, RUNS)[:, None]
    one = rows(plants[:, 0], plants)
    fewer = replace(one, rows={"grosmc": {k: one.rows["grosmc"][k] for k in ("id", "relative")}})
    other = replace(one, rows={"lqr": one.rows["grosmc"]}, plants={"lqr": one.plants["grosmc"]})
    for new, gone in ((fewer, 1), (other, 2)):
        found, _ = campaign_changes(one, new)
        assert [each.effect for each in found].count(Effect.WORSE) == gone
        assert all(each.after is None for each in found if each.effect is Effect.WORSE)
    found, _ = campaign_changes(fewer, one)
    assert [each.effect for each in found] == [Effect.NEW]


def test_campaigns_that_are_equal_to_the_bit_tell_nothing() -> None:
    plants = np.linspace(-1, 1, RUNS)[:, None]
    found, tests = campaign_changes(rows(plants[:, 0], plants), rows(plants[:, 0], plants))
    assert found == []
    assert tests == 5


def test_runs_that_end_early_are_counted_and_get_no_margin() -> None:
    plants = np.linspace(-1, 1, RUNS)[:, None]
    margins = np.linspace(0.1, 1, RUNS)
    ended = np.where(np.arange(RUNS) < 60, -np.inf, margins)
    found, _ = campaign_changes(rows(margins, plants), rows(ended, plants))
    names = {each.name.partition(": ")[2]: each for each in found}
    assert set(names) == {"runs completed", "least margin, pass rate", "settles_within, pass rate"}
    for each in names.values():
        assert (each.before, each.after, each.effect) == (1.0, 0.85, Effect.WORSE)
        assert "McNemar, p = 2e-18" in each.note  # 2 / 2^60
    # Of the others the mean margin is what it was; where none is left, it is gone.
    found, _ = campaign_changes(rows(margins, plants), rows(np.full(RUNS, -np.inf), plants))
    gone = [each for each in found if each.name.endswith("mean margin")]
    assert [(each.after, each.effect, each.note) for each in gone] == [
        (None, Effect.WORSE, "gone")
    ] * 2


def test_effect_sign_and_test_are_of_the_mean() -> None:
    """Most plants gain a little and some lose much: the median rises, the mean falls."""
    random, plants = np.random.default_rng(5), np.linspace(-1, 1, RUNS)[:, None]
    before = random.uniform(1, 2, RUNS)
    after = before + np.where(np.arange(RUNS) < 80, -0.5, 0.01)
    assert np.median(after - before) > 0
    found, _ = campaign_changes(rows(before, plants), rows(after, plants))
    for each in found:
        assert each.name.endswith("mean margin")
        assert each.effect is Effect.WORSE
        assert (each.before, each.after) == (before.mean(), after.mean())


def test_the_first_runs_of_a_longer_campaign_are_the_same_plants() -> None:
    plants = np.random.default_rng(6).uniform(-1, 1, (2 * RUNS, 1))
    margins = 0.3 - 0.5 * plants[:, 0] ** 2
    short, long = rows(margins[:RUNS], plants[:RUNS]), rows(margins, plants)
    assert campaign_changes(short, long) == ([], 5)
    worse = rows(margins - 0.01, plants)
    found, _ = campaign_changes(short, worse)
    margin = next(each for each in found if "mean margin" in each.name)
    assert margin.after == pytest.approx(margins[:RUNS].mean() - 0.01)
    assert margin.effect is Effect.WORSE


@pytest.mark.parametrize(
    ("p_values", "alarms"),
    [
        # The second smallest is compared with 5 % / 2, not with 5 % / 3.
        ([0.01, 0.02, 0.9], [True, True, False]),
        ([0.9, 0.02, 0.01], [False, True, True]),
        # All steps: 0.0125, 0.01667, 0.025 and 0.05.
        ([0.012, 0.016, 0.024, 0.049], [True] * 4),
        # After one that is too large none raises an alarm, though 0.03 < 5 %.
        ([0.01, 0.026, 0.03], [True, False, False]),
        ([0.02, 0.02, 0.02], [False] * 3),
        ([], []),
    ],
)
def test_holm_steps_down(p_values: list[float], alarms: list[bool]) -> None:
    assert holm(p_values).tolist() == alarms


def test_a_second_alarm_needs_less_than_the_first() -> None:
    """Rates of 13 and of 7 plants lost: without the step-down the second would be noise."""
    plants = np.linspace(-1, 1, 2000)[:, None]
    kept = np.full(2000, 0.1)
    few, more = (np.where(np.arange(2000) < count, -0.1, 0.1) for count in (7, 13))
    old, new = rows(kept, plants), rows(more, plants)
    new = replace(new, rows={"grosmc": {**new.rows["grosmc"], "margin settles_within": few}})
    found, _ = campaign_changes(old, new)
    effects = {each.name.partition(": ")[2]: each.effect for each in found}
    # 2 / 2^7 = 0.0156: above 5 % / 5, and below 5 % / 3 once the rate and margin of the least
    # margin, with 2 / 2^13 each, have raised theirs.
    assert effects["settles_within, pass rate"] is Effect.WORSE
    assert LEVEL / 5 < 2 / 2**7 < LEVEL / 3


# Tests and what they detect.


@pytest.mark.parametrize("runs", [3, 8, 13])
def test_signs_are_flipped_in_all_ways(runs: int) -> None:
    changes = np.random.default_rng(runs).normal(0.5, 1, runs)
    sums = [abs(np.dot(signs, changes)) for signs in itertools.product((-1, 1), repeat=runs)]
    # Rounding of sums in another order.
    share = np.mean(np.array(sums) >= abs(changes.sum()) * (1 - 1e-12))
    base, none = np.zeros(runs), np.zeros(5)
    assert same_plants_means(base, changes).p_value == pytest.approx(share, rel=1e-9)
    # Plants that did not change have no say.
    more = same_plants_means(np.append(base, none), np.append(changes, none))
    assert more.p_value == pytest.approx(share, rel=1e-9)
    assert same_plants_means(none, none).p_value == 1.0


def detected(
    test: Callable[[Array, Array], Any], draw: Callable[[float], tuple[Array, Array]], level: float
) -> float:
    """How often a change is detected that is the least detectable one."""
    change = np.median([test(*draw(0.0)).detectable(level) for _ in range(50)])
    assert math.isfinite(change)
    return float(np.mean([test(*draw(change)).p_value <= level for _ in range(2000)]))


@pytest.mark.parametrize("level", [0.05, 0.005])
@pytest.mark.parametrize(("paired", "runs"), [(True, 300), (True, 60), (False, 300)])
def test_the_least_detectable_change_of_a_mean_is_detected_with_the_power(
    paired: bool, runs: int, level: float
) -> None:
    random = np.random.default_rng(7)

    def draw(change: float) -> tuple[Array, Array]:
        before = random.normal(0, 1, runs)
        if paired:
            return before, before + change + random.normal(0, 0.3, runs)
        return before, random.normal(change, 0.7, 200)

    share = detected(same_plants_means if paired else other_plants_means, draw, level)
    # Three standard deviations of 2,000 draws.
    assert share == pytest.approx(POWER, abs=0.03)


@pytest.mark.parametrize(("lost", "won"), [(0, 0), (1, 0), (12, 9), (150, 140)])
def test_the_least_detectable_change_of_a_rate_is_that_of_mcnemar(lost: int, won: int) -> None:
    runs, level, random = 1000, 0.01, np.random.default_rng(8)
    before = (np.arange(runs) >= won) * 1.0
    after = before.copy()
    after[:won], after[runs - lost :] = 1.0, 0.0
    change = same_plants_rates(before, after).detectable(level)
    # At least 8 plants must differ: 2 / 2^8 <= 1 % < 2 / 2^7.
    differing = max(lost + won, 8)
    share = (1 + change * runs / differing) / 2
    assert 0.5 < share <= 1
    counts = random.binomial(differing, share, 4000)
    p_values = np.array([stats.binomtest(int(count), differing).pvalue for count in counts])
    assert np.mean(p_values <= level) == pytest.approx(POWER, abs=0.03)


@pytest.mark.parametrize("kept", [0, 3, 150, 290, 300])
def test_the_least_detectable_change_of_a_rate_on_other_plants_is_that_of_fisher(kept: int) -> None:
    runs, others, level, random = 300, 200, 0.01, np.random.default_rng(9)
    before = (np.arange(runs) < kept) * 1.0
    change = other_plants_rates(before, np.ones(others)).detectable(level)
    rates = [rate for rate in (kept / runs - change, kept / runs + change) if 0 <= rate <= 1]
    powers = [
        np.mean(
            [
                other_plants_rates(before, (np.arange(others) < count) * 1.0).p_value <= level
                for count in random.binomial(others, rate, 400)
            ]
        )
        for rate in rates
    ]
    assert max(powers) == pytest.approx(POWER, abs=0.08)

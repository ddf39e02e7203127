"""Comparing results: a change is noticed, noise raises no alarm."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns import Folder, campaign, pair
from commands import Patch, Screen, assert_one_line, run
from page_documents import valued, write_document
from scipy import stats

from grosmc_mj import cli
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.output.results.result import Value
from grosmc_mj.studies.campaign.findings import SampledRuns
from grosmc_mj.studies.campaign.radius import Radius, ScaleTrial, radius_result
from grosmc_mj.studies.comparison import comparison
from grosmc_mj.studies.comparison.campaigns import CampaignRows, campaign_changes, campaign_rows
from grosmc_mj.studies.comparison.changes import Change, Effect
from grosmc_mj.studies.comparison.comparison import compare, comparison_result
from grosmc_mj.studies.comparison.intervals import (
    CONFIDENCE,
    ChangeInterval,
    other_plants_mean,
    other_plants_rate,
    same_plants_mean,
    same_plants_rate,
)

VERSIONS = {"grosmc_mj": "0.1.0", "mujoco": "3.17.0", "numba": "0.62", "numpy": "2", "scipy": "1"}
RUNS = 400
PLANTS = np.linspace(-1, 1, RUNS)[:, None]
BETTER = Effect.BETTER
WORSE = Effect.WORSE
NOISE = Effect.NOISE
CHANGED = Effect.CHANGED
NEW = Effect.NEW
UNJUDGED = Effect.UNJUDGED

# Results.


def run_document(
    *,
    margin: float = 1.0,
    size: float = 4.0,
    deviation: float | None = 4e-3,
    verdict: str = "kept",
    premise: str = "completed",
    without: str = "",
    machine: str = "here",
    seed: int | None = None,
) -> dict[str, Any]:
    """Return the result of a switching law, without the value of one name."""
    values = [
        Value(name="x: settles", value=verdict),
        Value(
            name="x: margin",
            value=margin,
            unit="s",
            better=1,
            size=size,
            relative=0.0,
            absolute=0.02,
        ),
        Value(name="x: deviation", value=deviation, unit="rad", relative=0.25, absolute=1e-4),
        Value(name="x: premise", value=premise),
    ]
    kept = [value for value in values if value.name != without]
    content = valued(kept, versions=VERSIONS, machine=machine, seed=seed)
    return json.loads(json.dumps(content))


def written(folder: Path, document: Mapping[str, Any]) -> Path:
    """Write a document into a folder, and return the folder."""
    write_document(folder / "run.json", document)
    return folder


def of_names(folder: Path, value: float, *names: str) -> Path:
    """Write a document with one value under these names, and return its folder."""
    return written(folder, valued([Value(name=name, value=value, better=-1) for name in names]))


def effects(tmp_path: Path, old: dict[str, Any], new: dict[str, Any]) -> dict[str, Effect]:
    """Return the effects of the changes between two documents, by the name of the value."""
    comparison = compare(written(tmp_path / "old", old), written(tmp_path / "new", new))
    return {change.name.removeprefix("x: "): change.effect for change in comparison.changes}


def test_changes_come_by_their_effect_and_of_one_effect_by_their_relative_size() -> None:
    """That of 100 by 50 is smaller than that of 2 by 1.5; what is gone has no size."""
    ordered = [
        Change("run", "gone", 2.0, None, WORSE),
        Change("run", "z", 2.0, 0.5, WORSE),
        Change("run", "a", -100.0, -150.0, WORSE),
        Change("run", "b", 1.0, 9.0, BETTER),
        Change("run", "c", 1.0, 9.0, UNJUDGED),
        Change("run", "d", 1.0, 9.0, NOISE),
    ]
    mixed = [ordered[i] for i in (5, 2, 0, 4, 1, 3)]
    assert sorted(mixed, key=lambda change: change.order) == ordered


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, {}),
        ({"margin": 0.98}, {"margin": WORSE}),
        ({"margin": 1.02}, {"margin": BETTER}),
        # Rounding is of the size that was measured, 4.
        ({"margin": 1.0 + 3.9e-6}, {"margin": NOISE}),
        ({"margin": 1.0 + 4.1e-6}, {"margin": BETTER}),
        ({"margin": 1.0 + 3.9e-6, "size": 1.0}, {"margin": NOISE}),
        ({"margin": -0.1, "verdict": "not kept"}, {"margin": WORSE, "settles": WORSE}),
        ({"deviation": 4.1e-3}, {"deviation": CHANGED}),
        # On another machine switching parts the trajectories: 25 % of a deviation are noise.
        ({"deviation": 4.1e-3, "machine": "there"}, {"deviation": NOISE}),
        ({"deviation": 9e-3, "machine": "there"}, {"deviation": CHANGED}),
        # A single run of another seed tells nothing.
        ({"margin": 0.5, "seed": 7}, {"margin": UNJUDGED}),
        # An option not used again was not measured; a run that ends early lost its number.
        ({"without": "x: margin"}, {"margin": Effect.NOT_MEASURED}),
        ({"deviation": None}, {"deviation": WORSE}),
    ],
)
def test_a_change_is_told_from_noise(
    changes: dict[str, Any], expected: dict[str, Effect], tmp_path: Path
) -> None:
    assert effects(tmp_path, run_document(), run_document(**changes)) == expected


def test_a_law_that_one_side_has_alone_is_one_change(tmp_path: Path) -> None:
    """Of a value without a number neither side says anything."""
    new = run_document()
    stiff = [Value(name=f"stiff: {name}", value=1.0, unit="rad") for name in ("error", "input")]
    stiff.append(Value(name="stiff: settles", value=None))
    new["values"] += json.loads(json.dumps(valued(stiff)))["values"]
    compared = compare(written(tmp_path / "old", run_document()), written(tmp_path / "new", new))
    (change,) = compared.changes
    assert (change.name, change.before, change.after) == ("stiff", None, "2 values")
    assert change.effect is NEW


@pytest.mark.parametrize(
    ("package", "effect"),
    [*((package, NOISE) for package in VERSIONS), ("python", CHANGED), ("matplotlib", CHANGED)],
)
def test_only_versions_that_may_change_a_bit_make_scatter_noise(
    package: str, effect: Effect, tmp_path: Path
) -> None:
    new = run_document(deviation=4.1e-3)
    new["versions"] = {**VERSIONS, package: "another"}
    assert effects(tmp_path, run_document(), new) == {"deviation": effect}


def test_results_without_a_machine_may_come_from_two(tmp_path: Path) -> None:
    old = run_document(machine="")
    new = run_document(machine="", deviation=4.1e-3)
    assert effects(tmp_path, old, new) == {"deviation": NOISE}


@pytest.mark.parametrize(
    ("kind", "effect"), [("run", UNJUDGED), ("validation", WORSE), ("claims", WORSE)]
)
def test_no_seed_changes_a_validation_or_a_claim(kind: str, effect: Effect, tmp_path: Path) -> None:
    old = {**run_document(), "kind": kind}
    new = {**run_document(margin=0.5, seed=7), "kind": kind}
    assert effects(tmp_path, old, new) == {"margin": effect}


@pytest.mark.parametrize(
    ("before", "after", "effect"),
    [
        ("fails", "holds", BETTER),
        ("holds", "fails", WORSE),
        ("refuted", "open", CHANGED),
    ],
)
def test_words_of_studies_are_ranked(
    before: str, after: str, effect: Effect, tmp_path: Path
) -> None:
    old = run_document(premise=before)
    new = run_document(premise=after)
    assert effects(tmp_path, old, new) == {"premise": effect}


@pytest.mark.parametrize(
    "changes",
    [
        {"margin": 0.98, "deviation": 9e-3, "verdict": "not kept"},
        {"margin": 0.5, "seed": 2},
    ],
    ids=["worse", "not judged"],
)
def test_the_command_prints_its_answer(
    changes: dict[str, Any], tmp_path: Path, printed: Callable[..., None]
) -> None:
    written(tmp_path / "old", run_document())
    written(tmp_path / "new", run_document(**changes))
    printed("diff", "old", "new", "--verbose", "--out", "out")
    document = json.loads((tmp_path / "out" / "diff.json").read_text())
    assert (document["counts"]["worse"], document["counts"]["not judged"]) in [(2, 0), (0, 1)]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ({"margin": 0.98, "deviation": 9e-3}, {}),
        # On another machine switching moves an instant.
        ({}, {"margin": 0.985, "machine": "there", "deviation": 4.5e-3}),
    ],
    ids=["better", "scatter"],
)
def test_the_command_exits_0_if_nothing_got_worse_beyond_noise(
    old: dict[str, Any], new: dict[str, Any], tmp_path: Path
) -> None:
    before = written(tmp_path / "old", run_document(**old))
    after = written(tmp_path / "new", run_document(**new))
    assert run("diff", before, after, "--out", tmp_path / "out") == cli.DONE


def test_other_sources_are_named(tmp_path: Path) -> None:
    old = written(tmp_path / "old", run_document())
    content = {"versions": {**VERSIONS, "mujoco": "3.18.0"}, "configuration": {"engine": "python"}}
    new = written(tmp_path / "new", {**run_document(machine="there"), **content})
    sources = compare(old, new).sources
    assert "machine: here -> there" in sources
    assert "versions.mujoco: 3.17.0 -> 3.18.0" in sources
    assert any("configuration.engine" in line for line in sources)


@pytest.mark.parametrize("names", [("x: a", "x: a"), ("s/v1 lqr: a", "s/v2 lqr: a")])
def test_a_case_in_a_file_of_another_name_is_compared(
    names: tuple[str, str], tmp_path: Path
) -> None:
    """A case that is copied to v2.toml is still the only one."""
    old = of_names(tmp_path / "old", 1.0, names[0])
    compared = compare(old, of_names(tmp_path / "new", 2.0, names[1]))
    assert compared.compared == 1
    assert [change.name for change in compared.worse] == [names[1]]


def test_a_case_of_another_system_is_no_copy(tmp_path: Path) -> None:
    for name in ("servo/case1", "arm/case1"):
        values = [Value(name=f"{name} lqr: a", value=1.0)]
        write_document(tmp_path / name.partition("/")[0] / "run.json", valued(values))
    with pytest.raises(ArgumentError, match="no results in common"):
        compare(tmp_path / "servo", tmp_path / "arm")


@pytest.mark.parametrize(
    ("old", "new", "sides"),
    [("monday", "friday", ["monday", "friday"]), ("a/renders", "b/renders", None)],
    ids=["two names", "one name"],
)
def test_both_sides_are_named_by_their_folders(
    old: str, new: str, sides: list[str] | None, tmp_path: Path
) -> None:
    """Folders of one name are told apart by their paths; what is not measured is not worse."""
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    before = written(tmp_path / old, run_document())
    after = written(tmp_path / new, run_document(without="x: margin"))
    compared = compare(before, after)
    assert not compared.worse
    result = comparison_result(compared)
    headers = [column.header for column in result.sheets[0].table.columns]
    assert headers[2:4] == (sides or [str(before), str(after)])
    assert result.answers[0].words.startswith("Nothing got worse")
    assert "1 not measured" in result.answers[0].words


def test_two_cases_are_not_taken_for_two_others(tmp_path: Path) -> None:
    old = of_names(tmp_path / "old", 1.0, "s/v1 lqr: a", "s/v2 lqr: a", "s/both lqr: a")
    new = of_names(tmp_path / "new", 1.0, "s/v3 lqr: a", "s/v4 lqr: a", "s/both lqr: a")
    assert compare(old, new).compared == 1


def test_a_campaign_that_is_gone_was_not_measured(tmp_path: Path) -> None:
    old = written(tmp_path / "old", run_document())
    new = written(tmp_path / "new", run_document())
    (old / "campaigns" / "servo").mkdir(parents=True)
    (old / "campaigns" / "servo" / "manifest.json").write_text("{}")
    (gone,) = compare(old, new).changes
    assert gone.name == "campaigns/servo"
    assert gone.effect is Effect.NOT_MEASURED
    (added,) = compare(new, old).changes
    assert added.effect is NEW


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize(
    "content",
    [b"\x89PNG\r\n", b'{"runs": [', b"[" * 10**6],
    ids=["picture", "torn", "deep"],
)
def test_a_file_that_cannot_be_read_is_one_line(
    content: bytes, swapped: bool, tmp_path: Path, capsys: Screen
) -> None:
    odd = tmp_path / "odd.json"
    odd.write_bytes(content)
    good = written(tmp_path / "good", run_document())
    sides = (good, odd) if swapped else (odd, good)
    assert run("diff", *sides, "--out", tmp_path) == cli.WRONG
    error = capsys.readouterr().err
    assert f"no results: {odd}: " in error
    assert_one_line(error)


def test_results_without_a_common_value_are_refused(tmp_path: Path) -> None:
    good = written(tmp_path / "good", run_document())
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(ArgumentError, match="no results in common"):
        compare(good, empty)


@pytest.mark.parametrize(
    ("path", "words"),
    [("nowhere", "does not exist"), ("/dev/full", "neither a file nor a folder")],
)
def test_a_path_without_results_is_refused(path: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match=words):
        compare(tmp_path, tmp_path / path)


# Campaigns.


def rows(
    margins: Array, plants: Array = PLANTS, sampler: str = "random", seed: int = 0
) -> CampaignRows:
    """Return a campaign of one law with one requirement."""
    ids = np.arange(len(margins), dtype=float)
    columns = {"id": ids, "relative": margins, "margin settles_within": margins}
    basis = SampledRuns(len(margins), len(margins), sampler, seed)
    return CampaignRows("servo", {"grosmc": columns}, {"grosmc": plants}, basis, ("mass",))


def changes_of(old: CampaignRows, new: CampaignRows) -> dict[str, Change]:
    """Return the changes between two campaigns by the name of the number."""
    changes, compared = campaign_changes(old, new)
    assert compared == 5
    return {change.name.partition(": ")[2]: change for change in changes}


def random_rows(random: np.random.Generator, plants: Array, sampler: str) -> CampaignRows:
    """Return a campaign whose margins depend on the plant, and on chance: each has its seed."""
    margins = 0.3 - 0.5 * plants[:, 0] ** 2 + 0.1 * random.standard_normal(RUNS)
    return rows(margins, plants, sampler, seed=int(random.integers(2**53)))


def random_plants(random: np.random.Generator) -> Array:
    return random.uniform(-1, 1, (RUNS, 1))


def require_few_alarms(comparisons: list[dict[str, Change]]) -> None:
    """Require as few alarms as the confidence of the intervals allows.

    A comparison has two tests, of a rate and of a mean, since both requirements have the same
    margins. One such test in ten thousand would see more alarms.
    """
    effects = [{change.effect for change in changes.values()} for changes in comparisons]
    alarms = sum(not effect.isdisjoint((WORSE, BETTER)) for effect in effects)
    assert alarms <= stats.binom.isf(1e-4, len(comparisons), 2 * (1 - CONFIDENCE))


@pytest.mark.parametrize("sampler", ["random", "sobol"])
def test_equal_campaigns_on_the_same_plants_raise_few_alarms(sampler: str) -> None:
    random = np.random.default_rng(1)
    comparisons = []
    for _ in range(40):
        plants = random_plants(random)
        old = random_rows(random, plants, sampler)
        comparisons.append(changes_of(old, random_rows(random, plants, sampler)))
    require_few_alarms(comparisons)


def changes_on_other_plants(random: np.random.Generator, sampler: str) -> dict[str, Change]:
    """Return the changes between equal campaigns of which each has plants of its own."""
    old, new = [random_rows(random, random_plants(random), sampler) for _ in range(2)]
    return changes_of(old, new)


def test_equal_campaigns_on_other_random_plants_raise_few_alarms() -> None:
    random = np.random.default_rng(1)
    require_few_alarms([changes_on_other_plants(random, "random") for _ in range(40)])


def test_other_plants_that_are_no_random_draws_have_no_interval() -> None:
    changes = changes_on_other_plants(np.random.default_rng(1), "sobol")
    assert {change.effect for change in changes.values()} == {CHANGED}
    assert all(change.note.startswith("no interval: ") for change in changes.values())


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
    is_significant = stats.binomtest(lost, changed).pvalue < 1 - CONFIDENCE
    assert is_significant == (effect in (WORSE, BETTER))

    before = np.full(RUNS, 0.1)
    after = np.full(RUNS, 0.1)
    after[:lost] = -0.1
    before[lost:changed] = -0.1
    old = rows(before, PLANTS, sampler, seed=1)
    changes = changes_of(old, rows(after, PLANTS, sampler, seed=2))
    rates = [change for name, change in changes.items() if name.endswith("pass rate")]
    assert len(rates) == (0 if effect is None else 2)
    for change in rates:
        assert change.effect is effect
        assert change.note.startswith(f"{lost} of 400 plants lost, {won} won; change ")


CAMPAIGN = rows(PLANTS[:, 0])
COLUMNS = CAMPAIGN.rows["grosmc"]
FEWER = replace(CAMPAIGN, rows={"grosmc": {name: COLUMNS[name] for name in ("id", "relative")}})
OTHER_LAW = replace(CAMPAIGN, rows={"lqr": COLUMNS}, plants={"lqr": PLANTS})


@pytest.mark.parametrize(
    ("new", "name", "value"),
    [(FEWER, "servo grosmc: settles within", "there"), (OTHER_LAW, "servo grosmc", "2 values")],
    ids=["margin", "law"],
)
def test_a_margin_or_a_law_that_a_campaign_no_longer_has_was_not_measured(
    new: CampaignRows, name: str, value: str
) -> None:
    """A law is one change, however many margins it has."""
    changes, _ = campaign_changes(CAMPAIGN, new)
    (gone,) = [change for change in changes if change.effect is Effect.NOT_MEASURED]
    assert (gone.name, gone.before, gone.after) == (name, value, None)
    assert not [change for change in changes if change.effect is WORSE]


def test_folders_of_two_names_stand_above_the_columns_alone() -> None:
    """The law of one campaign is not said to be of the other one."""
    changes, _ = campaign_changes(CAMPAIGN, replace(OTHER_LAW, name="later"))
    assert {change.name for change in changes} == {"grosmc", "lqr"}


def test_options_of_several_results_of_a_kind_are_told_by_their_files(tmp_path: Path) -> None:
    """The later one does not hide the other."""
    for side, numbers in (("old", (1, 1)), ("new", (2, 3))):
        for name, number in zip(("servo", "arm"), numbers, strict=True):
            document = {**run_document(), "configuration": {"duration": number}}
            write_document(tmp_path / side / f"{name}.json", document)
    assert sorted(compare(tmp_path / "old", tmp_path / "new").sources) == [
        "run of arm.json: configuration.duration: 1 -> 3",
        "run of servo.json: configuration.duration: 1 -> 2",
    ]


def test_an_option_that_a_manifest_has_twice_is_one_line(tmp_path: Path) -> None:
    sides: list[Path] = []
    for name, number in (("old", 1), ("new", 2)):
        options = {"seed": number, "duration": number, "file": {"run": {"duration": number}}}
        document = {**run_document(seed=number), "configuration": options}
        sides.append(written(tmp_path / name, document))
    assert compare(*sides).sources == ["seed: 1 -> 2", "run: configuration.duration: 1 -> 2"]


def test_a_campaign_of_another_system_is_no_copy(pairs: Folder, monkeypatch: Patch) -> None:
    systems = iter(("servo", "servo", "servo", "arm"))
    monkeypatch.setattr(
        comparison, "campaign_rows", lambda _: replace(CAMPAIGN, system=next(systems))
    )
    assert compare(pairs.path, pairs.path).compared == 5
    with pytest.raises(ArgumentError, match="no results in common"):
        compare(pairs.path, pairs.path)


def test_campaigns_of_one_case_with_other_laws_are_told_how_laws_are_compared(
    pairs: Folder, monkeypatch: Patch
) -> None:
    sides = iter((CAMPAIGN, OTHER_LAW))
    monkeypatch.setattr(comparison, "campaign_rows", lambda _: next(sides))
    with pytest.raises(ArgumentError, match="one campaign of both laws compares them"):
        compare(pairs.path, pairs.path)


def test_margins_of_a_campaign_have_their_units(pairs: Folder) -> None:
    units = campaign_rows(pairs.path).units
    assert units["relative"] == "of the limit"
    assert "rad" in units.values()


def test_a_margin_that_only_the_new_campaign_has_is_new() -> None:
    (change,) = campaign_changes(FEWER, CAMPAIGN)[0]
    assert change.effect is NEW


MARGINS = np.linspace(0.1, 1, RUNS)
PASS_RATES = ("runs completed", "least margin, pass rate", "settles within, pass rate")
MEAN_MARGINS = ("least margin, mean margin", "settles within, mean margin")


def changes_by_early_ends(runs: int) -> dict[str, Change]:
    """Return the changes where so many of the runs end early."""
    after = np.where(np.arange(RUNS) < runs, -np.inf, MARGINS)
    return changes_of(rows(MARGINS, seed=1), rows(after, seed=2))


def test_runs_that_end_early_change_no_mean_margin() -> None:
    """The mean margin of the other runs is as it was."""
    assert set(changes_by_early_ends(60)) == set(PASS_RATES)


@pytest.mark.parametrize("name", PASS_RATES)
def test_runs_that_end_early_are_counted_as_lost(name: str) -> None:
    change = changes_by_early_ends(60)[name]
    assert (change.before, change.after, change.effect) == (1.0, 0.85, WORSE)
    assert change.note.startswith("60 of 400 plants lost, 0 won; change ")


@pytest.mark.parametrize("name", MEAN_MARGINS)
def test_a_mean_margin_is_gone_if_no_run_completes(name: str) -> None:
    change = changes_by_early_ends(RUNS)[name]
    assert (change.after, change.effect, change.note) == (None, WORSE, "gone")


def verdicts(failing: list[int]) -> Array:
    """Margins of which these plants have negative ones."""
    margins = np.full(RUNS, 0.1)
    margins[failing] = -0.1
    return margins


HERE = {"machine": "here", **VERSIONS}
# Other plants, of which each differs by half a millionth of a millionth.
NEXT_PLANTS = PLANTS * (1 + 5e-13)

# Kind of pair: which runs failed before and after, how the new campaign differs from the old one;
# and the effect on the pass rate with a part of its note.
DECISIONS: dict[str, tuple[list[int], list[int], dict[str, Any], Effect, str]] = {
    "the same runs, one newly fails": ([1], [1, 7], {}, WORSE, "failing of 400 plants: 7;"),
    "the same runs, one for another": ([1], [7], {}, WORSE, "plants: 7; newly kept: 1"),
    "the same runs, one newly kept": ([1, 7], [7], {}, BETTER, "none; newly kept: 1"),
    "another machine, one fails": (
        [1],
        [1, 7],
        {"repeats_on": HERE | {"machine": "there"}},
        NOISE,
        "1 of 400 plants lost, 0 won",
    ),
    "another version, one fails": (
        [1],
        [1, 7],
        {"repeats_on": HERE | {"mujoco": "3.18.0"}},
        NOISE,
        "1 of 400 plants lost, 0 won",
    ),
    "random runs, one fails": ([1], [1, 7], {"repeats_on": None}, NOISE, "1 of 400 plants lost"),
    "random runs, many fail": ([], [*range(20)], {"repeats_on": None}, WORSE, "20 of 400 plants"),
    "other plants, some fail": (
        [],
        [*range(8)],
        {"plants": {"grosmc": NEXT_PLANTS}},
        NOISE,
        "400 of 400 plants before",
    ),
    "other plants, many fail": (
        [],
        [*range(60)],
        {"plants": {"grosmc": NEXT_PLANTS}},
        WORSE,
        "340 of 400 after",
    ),
    "the same numbers of something else": (
        [],
        [*range(8)],
        {"uncertain": ("damping",)},
        NOISE,
        "400 of 400 plants before",
    ),
}


@pytest.mark.parametrize("pair", DECISIONS)
def test_which_pairs_of_campaigns_got_worse(pair: str) -> None:
    failed, fails, differs, effect, note = DECISIONS[pair]
    old = replace(rows(verdicts(failed)), repeats_on=HERE)
    new = replace(rows(verdicts(fails)), **{"repeats_on": HERE, **differs})
    rates = [
        change for change in campaign_changes(old, new)[0] if change.name.endswith("pass rate")
    ]
    assert [change.effect for change in rates] == [effect] * 2
    for change in rates:
        assert note in change.note


def test_two_random_campaigns_do_not_repeat_each_other() -> None:
    """Neither names what it would repeat on."""
    changes, _ = campaign_changes(rows(verdicts([1])), rows(verdicts([1, 7])))
    assert {change.effect for change in changes} == {NOISE}


@pytest.mark.parametrize("repeats_on", [None, HERE])
def test_the_same_runs_without_a_change_are_no_change(repeats_on: dict[str, str] | None) -> None:
    campaign = replace(rows(verdicts([3])), repeats_on=repeats_on)
    assert campaign_changes(campaign, campaign)[0] == []


def test_numbers_of_at_most_twenty_newly_failing_plants_are_listed() -> None:
    old = replace(rows(verdicts([])), repeats_on=HERE)
    new = replace(rows(verdicts([*range(3, 24)])), repeats_on=HERE)
    note = changes_of(old, new)["least margin, pass rate"].note
    listed = ", ".join(str(plant) for plant in range(3, 23))
    assert note == f"newly failing of 400 plants: {listed}, ...; newly kept: 0"


# Most plants gain a little and some lose much: the median rises, the mean falls.
BEFORE = np.random.default_rng(5).uniform(1, 2, RUNS)
AFTER = BEFORE + np.where(np.arange(RUNS) < 80, -0.5, 0.01)


def test_a_change_of_margins_is_that_of_their_mean() -> None:
    assert np.median(AFTER - BEFORE) > 0
    assert set(changes_of(rows(BEFORE), rows(AFTER))) == set(MEAN_MARGINS)


@pytest.mark.parametrize("name", MEAN_MARGINS)
def test_a_change_has_the_means_of_both_campaigns_and_their_interval(name: str) -> None:
    change = changes_of(rows(BEFORE), rows(AFTER))[name]
    assert change.effect is WORSE
    assert (change.before, change.after) == (BEFORE.mean(), AFTER.mean())
    assert change.note == same_plants_mean(BEFORE, AFTER).words
    assert change.note.startswith("change -0.1")


def test_the_first_runs_of_a_longer_campaign_are_on_the_same_plants() -> None:
    plants = np.random.default_rng(6).uniform(-1, 1, (2 * RUNS, 1))
    margins = 0.3 - 0.5 * plants[:, 0] ** 2
    short = rows(margins[:RUNS], plants[:RUNS])
    assert changes_of(short, rows(margins, plants)) == {}

    # A change of a hundredth is noticed.
    change = changes_of(short, rows(margins - 0.01, plants))["least margin, mean margin"]
    assert change.after == pytest.approx(margins[:RUNS].mean() - 0.01)
    assert change.effect is WORSE


@pytest.mark.parametrize(
    ("changed", "repeats"),
    [
        ({}, True),
        ({"machine": "there"}, False),
        ({"machine": None}, False),
        ({"random": True}, False),
    ],
)
def test_a_manifest_says_whether_its_runs_repeat(
    changed: dict[str, Any], repeats: bool, pairs: Folder, tmp_path: Path
) -> None:
    copy = Path(shutil.copytree(pairs.path, tmp_path / "copy"))
    manifest = json.loads((copy / "manifest.json").read_text(encoding="utf-8"))
    (copy / "manifest.json").write_text(json.dumps(manifest | changed), encoding="utf-8")
    here = campaign_rows(pairs.path).repeats_on
    there = campaign_rows(copy).repeats_on
    assert here is not None
    assert (here == there) is repeats


def test_searches_of_two_campaigns_in_one_folder_are_told_apart() -> None:
    """As are their radii: each value begins with the campaign."""
    names = set()
    for name in ("light", "heavy"):
        declared = campaign(pair(), name=name)
        trials = (ScaleTrial(0.5, np.ones((1, 2)), np.ones(1), np.ones(1), (0,)),)
        radius = Radius("lqr", 8, trials, 1.0)
        document = radius_result(declared, [radius])
        names |= {value.name for value in document.values}
    assert names == {
        "servo/light lqr: no failure found up to",
        "servo/heavy lqr: no failure found up to",
    }


# Intervals.


@pytest.mark.parametrize(("lost", "won"), [(6, 0), (12, 9), (150, 140)])
def test_an_interval_of_a_rate_on_the_same_plants_is_that_of_the_plants_that_changed(
    lost: int, won: int
) -> None:
    numbers = np.arange(1000)
    interval = same_plants_rate(numbers >= won, numbers < 1000 - lost)

    # At both ends a share under which the counts have the tail's probability.
    changed = lost + won
    tail = (1 - CONFIDENCE) / 2
    low = stats.beta.ppf(tail, won, lost + 1) if won else 0.0
    high = stats.beta.isf(tail, won + 1, lost)
    assert interval.low == pytest.approx((2 * low - 1) * changed / 1000)
    assert interval.high == pytest.approx((2 * high - 1) * changed / 1000)


@pytest.mark.parametrize(
    ("low", "high", "counts", "words", "is_change"),
    [
        (-0.0314, -0.00123, "", "change -0.031 to -0.0012 (99 % interval)", True),
        (0.0123, 0.25, "1 of 8 plants lost, 3 won", "change 0.012 to 0.25 (99 % interval)", True),
        (-0.5, 0.25, "", "change -0.5 to 0.25 (99 % interval)", False),
        (0.0, 0.25, "", "change 0 to 0.25 (99 % interval)", False),
    ],
)
def test_an_interval_is_a_change_if_zero_is_not_in_it_and_has_two_digits(
    low: float, high: float, counts: str, words: str, is_change: bool
) -> None:
    interval = ChangeInterval(low, high, counts)
    assert interval.excludes_zero == is_change
    assert interval.words == (f"{counts}; {words}" if counts else words)


def test_a_rate_on_the_same_plants_without_a_change_has_an_interval_of_zero() -> None:
    kept = np.arange(1000) < 6
    interval = same_plants_rate(kept, kept)
    assert (interval.low, interval.high) == (0.0, 0.0)


@pytest.mark.slow
def test_an_interval_of_a_rate_on_other_plants_covers_the_change() -> None:
    """With 99 % at least: the bounds of both rates hold together."""
    random = np.random.default_rng(2)
    covered = 0
    for _ in range(500):
        before = random.uniform(size=200) < 0.9
        after = random.uniform(size=300) < 0.8
        interval = other_plants_rate(before, after)
        covered += interval.low <= 0.8 - 0.9 <= interval.high
    # Fewer would be seen once in ten thousand times.
    assert covered >= stats.binom.ppf(1e-4, 500, CONFIDENCE)


def test_an_interval_of_a_rate_on_other_plants_shares_its_error_among_both_rates() -> None:
    """Where all n are kept a rate is at least tail^(1/n), and at most 1."""
    tail = (1 - CONFIDENCE) / 4
    interval = other_plants_rate(np.ones(100, bool), np.ones(300, bool))
    assert interval.low == pytest.approx(tail ** (1 / 300) - 1)
    assert interval.high == pytest.approx(1 - tail ** (1 / 100))


@pytest.mark.parametrize(
    ("interval_of", "test_of", "plants"),
    [
        (same_plants_mean, stats.ttest_rel, 60),
        (other_plants_mean, partial(stats.ttest_ind, equal_var=False), 50),
    ],
    ids=["student", "welch"],
)
def test_the_interval_of_a_mean_is_that_of_student_on_the_same_plants_and_of_welch_on_others(
    interval_of: Any, test_of: Any, plants: int
) -> None:
    random = np.random.default_rng(3)
    before = random.normal(0, 1, 60)
    after = random.normal(0.3, 2, plants)
    expected = test_of(after, before).confidence_interval(CONFIDENCE)
    interval = interval_of(before, after)
    assert interval.low == pytest.approx(expected.low, rel=1e-9)
    assert interval.high == pytest.approx(expected.high, rel=1e-9)


def test_rounding_is_no_change() -> None:
    margins = np.linspace(1, 2, 60)
    assert not same_plants_mean(margins, margins * (1 + 1e-12)).excludes_zero
    assert same_plants_mean(margins, margins * (1 + 1e-6)).excludes_zero


@pytest.mark.parametrize("interval_of", [same_plants_mean, other_plants_mean])
def test_a_single_plant_shows_no_change(interval_of: Any) -> None:
    single = np.ones(1)
    assert not interval_of(single, 2 * single).excludes_zero


def test_margins_that_are_all_the_same_scatter_by_nothing() -> None:
    interval = other_plants_mean(np.ones(9), np.full(5, 2.0))
    assert (interval.low, interval.high) == (1.0, 1.0)


@pytest.mark.parametrize("letter", ["\x1b[31m", "\u202e"])
def test_a_result_of_somebody_else_does_not_steer_the_terminal(
    letter: str, tmp_path: Path, capsys: Screen
) -> None:
    for folder, number in (("old", 1.0), ("new", 2.0)):
        value = Value(name=f"x: {letter}red", value=number, unit="rad")
        document = {**valued([value]), "versions": {f"a{letter}": f"{folder}{letter}"}}
        write_document(tmp_path / folder / "run.json", document)
    folders = (tmp_path / "old", tmp_path / "new")
    assert run("diff", *folders, "--out", tmp_path / "out", "--verbose") == cli.DONE
    output = capsys.readouterr().out
    assert letter not in output
    assert "red" in output

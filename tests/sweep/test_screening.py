"""Runs screened by equations: the verdicts are MuJoCo's, and few runs are made there."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_cases import (
    DEVIATION,
    FALL,
    LQR,
    bits,
    campaign,
    case,
    pair,
    refusal,
    servo,
    uncertain,
)

from grosmc_mj.sweep import runs as runs_module
from grosmc_mj.sweep import screening as screening_module
from grosmc_mj.sweep.agreement import FACTOR, LEAST_BAND
from grosmc_mj.sweep.family import unit_points
from grosmc_mj.sweep.findings import Judges, findings, judged_words, results_document, run_campaign
from grosmc_mj.sweep.radius import radius
from grosmc_mj.sweep.replay import replay
from grosmc_mj.sweep.screening import (
    EQUATIONS,
    PHYSICS,
    RANDOM,
    SAMPLE,
    Batch,
    Screening,
    drawn_by_chance,
    evaluate,
    screened_all,
    screened_search,
    screening_of,
)
from grosmc_mj.sweep.store import Folder
from grosmc_mj.sweep.worst import worst

GROSMC = '[[controller]]\nlaw = "grosmc"\n'
LIMIT = DEVIATION.replace("3 mrad", "{}")
PUSH = """
[[disturbance]]
body = "link"
torque = ["0 N m", "0.5 N m", "0 N m"]
profile = "sine"
frequency = "5 Hz"
label = "push"
"""
# Pendulums, of which some leave the region where their law is defined.
FALLEN = case(
    "cart_pendulum", FALL, laws='[[controller]]\nlaw = "fl-lqr"\n',
    limits=LIMIT.format("0.2 rad"), duration=0.3,
)  # fmt: skip
# Arms under GROSMC, whose sign switching amplifies rounding.
PUSHED = case(
    "arm",
    uncertain('body = "link"', "mass_scale = [1, 2]")
    + uncertain('disturbance = "push"', "amplitude = [-1, 1]"),
    laws=GROSMC, disturbances=PUSH, limits=LIMIT.format("0.12 mrad"),
    start='{ "joint angle" = "0.5 rad" }', duration=0.2,
)  # fmt: skip


@pytest.fixture(autouse=True)
def _measured_anew() -> None:
    screening_of.cache_clear()


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Runs that were made, by the kind of their plants."""
    count = {"physics": 0, "corrected": 0}
    simulate = runs_module.simulate

    def counted(plants: Any, *arguments: Any, **options: Any) -> Any:
        count[plants[0].kind] += len(plants)
        return simulate(plants, *arguments, **options)

    monkeypatch.setattr(runs_module, "simulate", counted)
    return count


def heavier(monkeypatch: pytest.MonkeyPatch, factor: float) -> None:
    """Give equations more inertia than there is."""

    def equations(batch: Batch) -> list[Any]:
        exact = [plant.analytic() for plant in batch.physics]
        return [plant.with_parameters(J=factor * plant.parameters.J) for plant in exact]

    monkeypatch.setattr(Batch, "equations", property(equations))


@pytest.mark.slow
@pytest.mark.parametrize("text", [pair(), FALLEN, PUSHED], ids=["pair", "fallen", "pushed"])
def test_verdicts_are_those_of_mujoco(text: str) -> None:
    """Some runs keep the limit and some do not, and equations judge most."""
    declared, ids = campaign(text, runs=1024, shard=1024), range(1024)
    screening = screening_of(declared)
    assert screening.bands
    batch = Batch(declared, declared.values(ids), ids)
    for screened in screened_all(declared, screening, declared.laws, ids):
        law = screened["controller"][0]
        exact, confirmed = batch.run(law), screened["judged_by"] == PHYSICS
        assert list(screened["status"]) == list(exact["status"])
        for limit in declared.limits_of(law):
            kept = [rows[f"margin {limit.key}"] >= 0 for rows in (screened, exact)]
            np.testing.assert_array_equal(kept[0], kept[1])
        assert 0 < (screened["relative"] >= 0).sum() < len(ids)
        own = [rows["relative"][confirmed] for rows in (screened, exact)]
        np.testing.assert_array_equal(own[0], own[1])
        assert confirmed.sum() < len(ids) / 2


def test_runs_near_a_limit_that_ended_early_or_worse_than_the_sample_are_confirmed() -> None:
    declared, ids = campaign(FALLEN, runs=512), range(512)
    (first,) = screened_all(declared, Screening({"fl-lqr": 0.0}), declared.laws, ids)
    margins = first["screened"][np.isfinite(first["screened"])]
    band = float(np.quantile(np.abs(margins), 0.1))
    worst_of_sample = float(np.quantile(margins, 0.05))
    screening = Screening({"fl-lqr": band}, "", {"fl-lqr": worst_of_sample})
    (rows,) = screened_all(declared, screening, declared.laws, ids)
    assert set(rows["band"]) == {band}
    near, early = np.abs(rows["screened"]) <= band, ~rows.completed
    worse = rows["screened"] < worst_of_sample
    assert near.any()
    assert early.any()
    assert (worse & ~early).any()
    needed, chance = near | early | worse, drawn_by_chance(0, ids)
    np.testing.assert_array_equal(rows["judged_by"] == PHYSICS, needed | chance)
    np.testing.assert_array_equal(rows["drawn"] > 0, chance & ~needed)


def test_each_run_is_drawn_by_its_own_number_and_one_in_fifty_is() -> None:
    several = drawn_by_chance(7, range(20_000))
    assert several[3000:3100].tolist() == drawn_by_chance(7, range(3000, 3100)).tolist()
    assert several.tolist() != drawn_by_chance(8, range(20_000)).tolist()
    # Four standard deviations of a binomial count.
    assert abs(several.sum() - 400) < 4 * np.sqrt(400 * (1 - RANDOM))


def test_the_band_is_ten_times_the_largest_difference_of_a_sample_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Equations with a hair more inertia: the difference is measured here once more."""
    heavier(monkeypatch, 1.0005)
    declared = campaign(pair(), runs=2048, seed=11)
    screening = screening_of(declared)
    values = declared.family.values(unit_points("random", 2, 12, 0, SAMPLE))
    assert not np.isin(values, declared.values(range(2048))).any()
    batch = Batch(declared, values, range(SAMPLE))
    for law in declared.laws:
        ours, theirs = batch.run(law, plants=batch.equations), batch.run(law)
        difference = float(np.abs(ours["relative"] - theirs["relative"]).max())
        assert difference > LEAST_BAND
        assert screening.bands[law] == pytest.approx(10 * difference, rel=1e-12)
        assert screening.worst[law] == theirs["order"].min()


@pytest.mark.parametrize(
    ("tables", "changed", "why"),
    [
        (uncertain('joint = "hinge"', "damping = [0, 0.01]"), {}, "joint 'hinge' has damping"),
        (
            uncertain('joint = "hinge"', "friction = [0, 0.01]"),
            {"screen": "equations"},
            "accelerations differ from MuJoCo's by",
        ),
        (
            uncertain('body = "pole"', 'added_mass = ["0.1 kg", "0.2 kg"]'),
            {},
            "is not that of a uniform rod",
        ),
        (
            FALL + '[[stop]]\njoint = "slider"\nlow = "-1 m"\nhigh = "1 m"\n',
            {},
            "equations lack the machine as built",
        ),
        (FALL, {"integrator": "implicitfast"}, "stepped by RK4, the model by implicitfast"),
    ],
)
def test_runs_whose_equations_lack_something_are_not_screened(
    tables: str, changed: dict[str, Any], why: str
) -> None:
    text = case("cart_pendulum", tables, laws=LQR, limits=LIMIT.format("0.2 rad"))
    screening = screening_of(campaign(text, **{"runs": 512, "screen": "auto"} | changed))
    assert screening.bands == {}
    assert why in screening.why_not


def test_few_runs_are_screened_only_if_that_is_wanted() -> None:
    assert screening_of(campaign(pair(), runs=16)) == Screening({})
    assert screening_of(campaign(pair(), runs=2048, screen="none")) == Screening({})
    forced = screening_of(campaign(pair(), runs=16, screen="equations"))
    assert forced.bands == dict.fromkeys(("lqr", "stiff"), LEAST_BAND)


# A campaign of screened runs.

RUNS = 256


def screened(shard: int = RUNS) -> Any:
    return campaign(pair(), runs=RUNS, shard=shard, screen="equations")


def test_a_screened_campaign_makes_few_runs_in_mujoco_and_says_who_judged(
    made: dict[str, int], tmp_path: Path
) -> None:
    """Every run on the equations, and in MuJoCo as many as the rows say, and the sample's."""
    run_campaign(screened(), tmp_path)
    counted = dict(made)
    found = findings(screened(), Folder(tmp_path))
    columns = Folder(tmp_path).columns(screened(), ["judged_by"], [0])
    judged = np.concatenate([own["judged_by"] for own in columns.values()])
    confirmed = int((judged == PHYSICS).sum())
    assert counted == {"corrected": 2 * (RUNS + SAMPLE), "physics": confirmed + 2 * SAMPLE}
    assert 0 < confirmed < 0.2 * 2 * RUNS
    words, drawn = judged_words(found.judges), found.judges["lqr"].drawn
    assert 0 < drawn < RUNS
    assert words.startswith(f"{2 * RUNS - confirmed} of {2 * RUNS} runs judged by the equations")
    assert (
        f"lqr: of {drawn} confirmed at random, 0 overturned: at most "
        f"{100 * (1 - 0.05 ** (1 / drawn)):.2g} % of those by the equations at 95 %."
    ) in words
    assert results_document(screened(), found)["answers"][0]["more"] == words


def test_confirmed_runs_are_the_same_whatever_the_parts_and_when_resumed(tmp_path: Path) -> None:
    names = ["judged_by", "screened", "overturned", "drawn", "band", "relative", "order"]
    rows = []
    for shard in (RUNS, 100):
        folder = Folder(tmp_path / str(shard))
        run_campaign(screened(shard), folder.path)
        rows.append(folder.columns(screened(shard), names, range(3)))
    for law, columns in rows[0].items():
        for name, values in columns.items():
            np.testing.assert_array_equal(rows[1][law][name], values)
    before = bits(folder)
    folder.part(1).unlink()
    run_campaign(screened(shard), folder.path, resume=True)
    assert bits(folder) == before
    other = campaign(pair(), runs=RUNS, shard=shard, screen="none")
    line = refusal(run_campaign, other, folder.path, resume=True)
    assert "screen: equations there, nothing now" in line
    # A run is repeated on its own judge, and shown in MuJoCo.
    judged = rows[0]["lqr"]["judged_by"]
    engines: Any = [(EQUATIONS, "native"), (EQUATIONS, "python"), (PHYSICS, "native")]
    for judge, engine in engines:
        number = str(np.flatnonzero(judged == judge)[0])
        run = replay(screened(shard), folder, number, "lqr", engine)
        assert run.differences == []
        assert list(run.outcome["judged_by"]) == [judge]
        assert run.result.plant == "physics"


@pytest.mark.parametrize(("drawn", "overturned"), [(1, 0), (41, 0), (41, 2), (300, 1)])
def test_so_few_overturned_are_as_unlikely_as_is_allowed_at_the_bound(
    drawn: int, overturned: int
) -> None:
    share = Judges(1000, 500, overturned, [], 0.1, 0.0, drawn, overturned).wrong_at_most
    tail = sum(
        math.comb(drawn, k) * share**k * (1 - share) ** (drawn - k) for k in range(overturned + 1)
    )
    assert tail == pytest.approx(0.05, rel=1e-9)
    assert Judges(1000, 500, 0, [], 0.1, 0.0, 0, 0).wrong_at_most == 1.0


def test_the_first_sixteen_overturned_runs_are_named() -> None:
    """Of twenty, every other run."""
    columns = {"id": np.arange(40), "overturned": np.arange(40) % 2, "band": np.full(40, 0.1)}
    columns |= {"judged_by": np.array([EQUATIONS] * 30 + [PHYSICS] * 10, object)}
    columns |= {"drawn": np.arange(40) < 9, "screened": np.full(40, 0.2)}
    columns |= {"relative": np.append(-np.inf, np.linspace(0.25, 0.2, 39))}
    judges = Judges.of(columns)
    assert (judges.runs, judges.by_equations, judges.overturned, judges.band) == (40, 30, 20, 0.1)
    assert judges.overturned_runs == list(range(1, 32, 2))
    assert (judges.drawn, judges.drawn_overturned) == (9, 4)
    assert judges.difference == pytest.approx(0.05)
    words = judged_words({"lqr": judges})
    assert "(band 0.1 of a limit; margins confirmed differ by 0.05)" in words
    assert "MuJoCo overturned 20: 1, 3, 5, 7," in words


# Searches.


def test_a_search_widens_its_band_by_the_differences_that_it_confirms(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Equations with more inertia: no margin is left to them within 10 differences."""
    heavier(monkeypatch, 1.02)
    declared = campaign(pair(), runs=512)
    monkeypatch.setattr(screening_module, "screening_of", lambda _: Screening({"stiff": 0.0}))
    values = declared.values(range(192))
    rows, exact = (of(declared, "stiff", values) for of in (screened_search, evaluate))
    confirmed = rows["judged_by"] == PHYSICS
    np.testing.assert_array_equal(rows["relative"][confirmed], exact["relative"][confirmed])
    difference = np.abs(rows["relative"] - exact["relative"])[~confirmed]
    assert not confirmed.all()
    assert np.all(np.abs(rows["relative"][~confirmed]) > FACTOR * difference / 2)
    np.testing.assert_array_equal(rows["relative"] >= 0, exact["relative"] >= 0)


def test_searches_are_screened_and_answer_in_mujoco(made: dict[str, int]) -> None:
    """The worst plant, the radius and where |s| leaves its bound are those of MuJoCo alone."""
    found, counts = [], []
    for screen in ("equations", "none"):
        declared = campaign(servo(laws=GROSMC), runs=24, screen=screen)
        before = dict(made)
        found.append((radius(declared, "grosmc"), worst(declared, "grosmc", [0, 1, 2], 128)))
        counts.append({kind: made[kind] - before[kind] for kind in made})
    (ours, our_worst), (theirs, their_worst) = found
    assert (ours.found, ours.stayed) == (theirs.found, theirs.stayed)
    assert [look.failures for look in ours.looks] == [look.failures for look in theirs.looks]
    assert ours.outside is not None
    assert theirs.outside is not None
    assert ours.outside.least == theirs.outside.least
    assert our_worst.relative == pytest.approx(their_worst.relative, rel=1e-6)
    assert counts[1]["corrected"] == 0
    assert 0 < counts[0]["physics"] < counts[1]["physics"] / 2

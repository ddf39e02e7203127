"""Runs screened by equations: the verdicts are MuJoCo's, and few runs are made there."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from campaign_cases import FALL, LQR, bits, campaign, case, pair, servo

from grosmc_mj.errors import ArgumentError
from grosmc_mj.sweep import runs as runs_module
from grosmc_mj.sweep import screening as screening_module
from grosmc_mj.sweep.agreement import FACTOR, LEAST_BAND
from grosmc_mj.sweep.campaign import Campaign
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
    Outcomes,
    Screening,
    drawn_by_chance,
    evaluate,
    screened_all,
    screened_search,
    screening_of,
)
from grosmc_mj.sweep.store import Folder
from grosmc_mj.sweep.worst import worst

POLE = """
[[uncertain]]
body = "pole"
mass_scale = [1, 4]
[[uncertain]]
body = "pole"
length_scale = [1, 4]
[[uncertain]]
start = "pole angle"
value = ["-15 deg", "15 deg"]
"""
LINK = """
[[uncertain]]
body = "link"
mass_scale = [1, 2]
[[uncertain]]
disturbance = "push"
amplitude = [-1, 1]
"""
PUSH = """
[[disturbance]]
body = "link"
torque = ["0 N m", "0.5 N m", "0 N m"]
profile = "sine"
frequency = "5 Hz"
label = "push"
"""
GROSMC = '[[controller]]\nlaw = "grosmc"\n'
FL = '[[controller]]\nlaw = "fl-lqr"\n'
LIMIT = '[[requirement]]\ndeviation_below = "{}"\n'
ARM_START = '{ "joint angle" = "0.5 rad" }'


def fallen() -> str:
    """Pendulums, of which some leave the region where their law is defined."""
    return case("cart_pendulum", FALL, laws=FL, limits=LIMIT.format("0.2 rad"), duration=0.3)


def pushed() -> str:
    """Arms under GROSMC, whose sign switching amplifies rounding."""
    limits = LIMIT.format("0.12 mrad")
    return case(
        "arm", LINK, laws=GROSMC, disturbances=PUSH, limits=limits, start=ARM_START, duration=0.2
    )


def asked(text: str, **changed: Any) -> Campaign:
    return campaign(text, **{"runs": 2048, "shard": 512, **changed})


def by(found: Outcomes) -> np.ndarray:
    return np.array(found["judged_by"])


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Runs that were made, by the kind of their plants."""
    count = {"physics": 0, "corrected": 0}

    def counted(plants: Any, *arguments: Any, **options: Any) -> Any:
        count[plants[0].kind] += len(plants)
        return simulate(plants, *arguments, **options)

    simulate = runs_module.simulate
    monkeypatch.setattr(runs_module, "simulate", counted)
    return count


@pytest.mark.slow
@pytest.mark.parametrize("text", [pair(), fallen(), pushed()])
def test_verdicts_are_those_of_mujoco(text: str) -> None:
    """Of 2,048 runs; some keep the limit and some do not, and equations judge most."""
    whole = asked(text)
    screening = screening_of(whole)
    assert screening.bands
    for index in range(whole.specification.shards):
        ids = whole.specification.ids(index)
        batch = Batch(whole, whole.values(ids), ids)
        for one in screened_all(whole, screening, whole.laws, ids):
            other = batch.run(one["controller"][0])
            assert list(one["status"]) == list(other["status"])
            for limit in whole.limits_of(one["controller"][0]):
                name = f"margin {limit.key}"
                np.testing.assert_array_equal(one[name] >= 0, other[name] >= 0)
            assert 0 < (one["relative"] >= 0).sum() < len(ids)
            confirmed = by(one) == PHYSICS
            np.testing.assert_array_equal(one["relative"][confirmed], other["relative"][confirmed])
            assert confirmed.sum() < len(ids) / 2


def test_few_steps_are_taken_in_mujoco(made: dict[str, int], tmp_path: Path) -> None:
    """Every run on the equations, and in MuJoCo as many as the rows say, and the sample's."""
    whole = asked(pair(), runs=1024)
    screening_of.cache_clear()
    said = run_campaign(whole, tmp_path)
    laws = len(whole.laws)
    rows = [pq.read_table(Folder(tmp_path).part(i)) for i in range(2)]
    judged = np.concatenate([table["judged_by"].to_pylist() for table in rows])
    confirmed = int((judged == PHYSICS).sum())
    assert made["corrected"] == laws * (1024 + SAMPLE)
    assert made["physics"] == confirmed + laws * SAMPLE
    assert 0 < confirmed < 0.2 * laws * 1024
    assert sum(each.by_equations for each in said.judges.values()) == (judged == EQUATIONS).sum()
    assert judged_words(said.judges).startswith(f"{(judged == EQUATIONS).sum():,} of 2,048 runs")


def test_what_is_near_a_limit_ended_early_or_worse_than_the_sample_is_confirmed() -> None:
    whole = asked(fallen(), runs=512)
    ids = range(512)
    (first,) = screened_all(whole, Screening({"fl-lqr": 0.0}), whole.laws, ids)
    margins = first["screened"][np.isfinite(first["screened"])]
    band = float(np.quantile(np.abs(margins), 0.1))
    worst_of_sample = float(np.quantile(margins, 0.05))
    screening = Screening({"fl-lqr": band}, "", {"fl-lqr": worst_of_sample})
    (found,) = screened_all(whole, screening, whole.laws, ids)
    assert set(found["band"]) == {band}
    near = np.abs(found["screened"]) <= band
    early = np.array(found["status"]) != "completed"
    worse = found["screened"] < worst_of_sample
    assert near.any()
    assert early.any()
    assert (worse & ~early).any()
    needed, chance = near | early | worse, drawn_by_chance(0, ids)
    np.testing.assert_array_equal(by(found) == PHYSICS, needed | chance)
    np.testing.assert_array_equal(found["drawn"] > 0, chance & ~needed)


def test_each_run_is_drawn_by_its_own_number_and_one_in_fifty_is() -> None:
    several = drawn_by_chance(7, range(20_000))
    assert several[3000:3100].tolist() == drawn_by_chance(7, range(3000, 3100)).tolist()
    assert several.tolist() != drawn_by_chance(8, range(20_000)).tolist()
    # Four standard deviations of a binomial count.
    assert abs(several.sum() - 400) < 4 * np.sqrt(400 * (1 - RANDOM))
    # The draw has nothing to do with what is drawn.
    points = campaign(pair(), seed=7).values(range(8))
    assert len(np.unique(points)) == points.size


@pytest.mark.parametrize("shard", [64, 100, 256])
def test_what_is_confirmed_is_the_same_whatever_the_parts(shard: int, tmp_path: Path) -> None:
    columns = ["judged_by", "screened", "overturned", "drawn", "band", "relative", "order"]
    rows = {}
    for size in (shard, 512):
        whole = campaign(pair(), runs=512, shard=size)
        run_campaign(whole, tmp_path / str(size))
        parts = range(whole.specification.shards)
        rows[size] = Folder(tmp_path / str(size)).columns(whole, columns, parts)
    for law, own in rows[512].items():
        for name, values in own.items():
            assert rows[shard][law][name].tolist() == values.tolist(), name


def test_the_band_is_ten_times_the_largest_difference_of_the_sample(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Equations with a hair more inertia: the difference is measured here once more."""
    heavier(monkeypatch, 1.0005)
    whole = asked(pair(), seed=11)
    screening_of.cache_clear()
    found = screening_of(whole)
    values = whole.family.values(unit_points("random", 2, 12, 0, SAMPLE))
    batch = Batch(whole, values, range(SAMPLE))
    for law in whole.laws:
        ours, theirs = batch.run(law, plants=batch.equations), batch.run(law)
        difference = float(np.abs(ours["relative"] - theirs["relative"]).max())
        assert difference > LEAST_BAND
        assert found.bands[law] == pytest.approx(10 * difference, rel=1e-12)
        assert found.worst[law] == theirs["order"].min()
    screening_of.cache_clear()


def test_the_sample_of_the_screening_has_none_of_the_campaigns_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured: list[np.ndarray] = []
    run = Batch.run

    def noted(batch: Batch, *arguments: Any, **options: Any) -> Outcomes:
        measured.append(batch.values)
        return run(batch, *arguments, **options)

    monkeypatch.setattr(Batch, "run", noted)
    whole = asked(pair(), seed=13)
    screening_of.cache_clear()
    assert screening_of(whole).bands
    (values,) = {sample.tobytes(): sample for sample in measured}.values()
    assert values.shape == (SAMPLE, 2)
    assert not np.isin(values, whole.values(range(whole.specification.runs))).any()
    screening_of.cache_clear()


def heavier(monkeypatch: pytest.MonkeyPatch, factor: float) -> None:
    """Give equations more inertia than there is."""

    def equations(batch: Batch) -> list[Any]:
        exact = [plant.analytic() for plant in batch.physics]
        return [plant.with_parameters(J=factor * plant.parameters.J) for plant in exact]

    monkeypatch.setattr(Batch, "equations", property(equations))


def test_a_search_widens_its_band_by_what_is_confirmed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equations with more inertia: no margin is left to them within 10 differences."""
    heavier(monkeypatch, 1.02)
    whole = asked(pair(), runs=512)
    no_band = Screening(dict.fromkeys(whole.laws, 0.0))
    monkeypatch.setattr(screening_module, "screening_of", lambda _: no_band)
    values = whole.values(range(512))
    for law in whole.laws:
        found, truth = screened_search(whole, law, values), evaluate(whole, law, values)
        confirmed = by(found) == PHYSICS
        np.testing.assert_array_equal(found["relative"][confirmed], truth["relative"][confirmed])
        difference = np.abs(found["relative"] - truth["relative"])[~confirmed]
        assert not confirmed.all()
        assert np.all(np.abs(found["relative"][~confirmed]) > FACTOR * difference / 2)
        np.testing.assert_array_equal(found["relative"] >= 0, truth["relative"] >= 0)


def test_searches_are_screened_and_answer_in_mujoco(made: dict[str, int]) -> None:
    """The worst plant, the radius and where |s| leaves its bound are those of MuJoCo alone."""
    text = servo(laws=GROSMC)
    found = {}
    for screen in ("equations", "none"):
        whole, before = asked(text, runs=512, screen=screen), dict(made)
        grown = radius(whole, "grosmc")
        bad = worst(whole, "grosmc", [0, 1, 2], 256)
        found[screen] = grown, bad
        assert made["physics"] > before["physics"]
    ours, theirs = found["equations"], found["none"]
    assert ours[0].found == theirs[0].found
    assert ours[0].stayed == theirs[0].stayed
    assert [look.failures for look in ours[0].looks] == [look.failures for look in theirs[0].looks]
    assert ours[0].outside is not None
    assert theirs[0].outside is not None
    assert ours[0].outside.least == theirs[0].outside.least
    assert ours[1].relative == pytest.approx(theirs[1].relative, rel=1e-6)
    assert made["corrected"] > 1000


DAMPED = '[[uncertain]]\njoint = "hinge"\ndamping = [0, 0.01]\n'
RUBBED = '[[uncertain]]\njoint = "hinge"\nfriction = [0, 0.01]\n'
LOADED = '[[uncertain]]\nbody = "pole"\nadded_mass = ["0.1 kg", "0.2 kg"]\n'
STOP = '[[stop]]\njoint = "slider"\nlow = "-1 m"\nhigh = "1 m"\n'


@pytest.mark.parametrize("screen", ["auto", "equations"])
@pytest.mark.parametrize(
    ("text", "changed", "why"),
    [
        (POLE + DAMPED, {}, "joint 'hinge' has damping"),
        (POLE + RUBBED, {}, "accelerations differ from MuJoCo's by"),
        (LOADED, {}, "is not that of a uniform rod"),
        (POLE + STOP, {}, "equations lack the machine as built"),
        (POLE, {"integrator": "implicitfast"}, "stepped by RK4, the model by implicitfast"),
    ],
)
def test_what_equations_lack_is_not_screened(
    text: str, changed: dict[str, Any], why: str, screen: str
) -> None:
    limits = LIMIT.format("0.2 rad")
    whole = asked(case("cart_pendulum", text, laws=LQR, limits=limits), screen=screen, **changed)
    found = screening_of(whole)
    assert found.bands == {}
    assert why in found.why_not


def test_few_runs_are_screened_only_if_it_is_asked_for() -> None:
    assert screening_of(asked(pair(), runs=16)) == Screening({})
    forced = screening_of(asked(pair(), runs=16, screen="equations"))
    assert forced.bands == dict.fromkeys(("lqr", "stiff"), LEAST_BAND)
    assert screening_of(asked(pair(), screen="none")) == Screening({})


def test_a_screened_campaign_resumed_is_the_same(tmp_path: Path) -> None:
    whole = campaign(pair(), runs=256, shard=128, screen="equations")
    run_campaign(whole, tmp_path / "a")
    first = Folder(tmp_path / "a")
    run_campaign(whole, tmp_path / "b")
    second = Folder(tmp_path / "b")
    second.part(1).unlink()
    run_campaign(whole, second.path, resume=True)
    assert bits(first) == bits(second)
    other = campaign(pair(), runs=256, shard=128, screen="none")
    with pytest.raises(ArgumentError, match="screen: equations there, nothing now"):
        run_campaign(other, first.path, resume=True)


@pytest.mark.parametrize("engine", ["native", "python"])
def test_a_screened_run_is_repeated_on_what_judged_it(tmp_path: Path, engine: Any) -> None:
    whole = campaign(pair(), runs=256, shard=256, screen="equations")
    run_campaign(whole, tmp_path)
    folder = Folder(tmp_path)
    judged = folder.columns(whole, ["judged_by"], [0])["lqr"]["judged_by"]
    for judge in (EQUATIONS, PHYSICS):
        number = int(np.flatnonzero(judged == judge)[0])
        found = replay(whole, folder, str(number), "lqr", engine)
        assert found.differences == []
        assert list(found.outcome["judged_by"]) == [judge]
        assert found.result.plant == "physics"


def test_what_is_known_of_the_verdicts_is_said(tmp_path: Path) -> None:
    whole = campaign(pair(), runs=256, shard=256, screen="equations")
    run_campaign(whole, tmp_path)
    found = findings(whole, Folder(tmp_path), 0.95)
    drawn = found.judges["lqr"].drawn
    assert 0 < drawn < 256
    said = judged_words(found.judges)
    bound = 100 * (1 - 0.05 ** (1 / drawn))
    assert (
        f"lqr: of {drawn} confirmed at random, 0 overturned: at most {bound:.2g} % of those by the "
        "equations at 95 %."
    ) in said
    assert results_document(whole, found)["answers"][0]["more"] == said
    wrong = {**found.judges, "lqr": Judges(256, 20, 3, [4, 7, 9], 1e-3, 1e-5, 41, 2)}
    assert "MuJoCo overturned 3: 4, 7, 9." in judged_words(wrong)
    assert "(band 0.001 of a limit; margins confirmed differ by 1e-05)" in judged_words(wrong)
    assert "of 41 confirmed at random, 2 overturned: at most 15 %" in judged_words(wrong)


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
    columns |= {"drawn": np.arange(40) < 9}
    columns |= {"screened": np.full(40, 0.2), "relative": np.full(40, -np.inf)}
    columns["relative"][1:] = np.linspace(0.25, 0.2, 39)
    told = Judges.of(columns)
    assert (told.runs, told.by_equations, told.overturned, told.band) == (40, 30, 20, 0.1)
    assert told.overturned_runs == list(range(1, 32, 2))
    assert (told.drawn, told.drawn_overturned) == (9, 4)
    assert told.difference == pytest.approx(0.05)

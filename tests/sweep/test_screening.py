"""Runs screened by equations: the verdicts are MuJoCo's, and few runs are made there."""

from pathlib import Path
from typing import Any

import campaign_cases as small
import numpy as np
import pytest
from campaign_cases import DEVIATION, FALL, LQR, bits, campaign, case, pair
from commands import Patch
from scipy import stats

from grosmc_mj.sweep import runs as runs_module
from grosmc_mj.sweep import screening as screening_module
from grosmc_mj.sweep.agreement import FACTOR, LEAST_BAND
from grosmc_mj.sweep.family import random_points
from grosmc_mj.sweep.findings import Judges, findings, judged_words, results_document, run_campaign
from grosmc_mj.sweep.plant_file import find_plant
from grosmc_mj.sweep.screening import PHYSICS, SAMPLE, Batch, drawn_by_chance, screening_of
from grosmc_mj.sweep.store import Folder

LIMIT = DEVIATION.replace("3 mrad", "{}")
# Pendulums, of which some leave the region where their law is defined.
FALLEN = case(
    "cart_pendulum", FALL, laws='[[controller]]\nlaw = "fl-lqr"\n',
    limits=LIMIT.format("0.2 rad"), duration=0.3,
)  # fmt: skip


@pytest.fixture(autouse=True)
def _measured_anew() -> None:
    screening_of.cache_clear()


@pytest.fixture
def counts(monkeypatch: Patch) -> dict[str, int]:
    """Runs that were made, by the kind of their plants."""
    count = {"physics": 0, "corrected": 0}
    simulate = runs_module.simulate

    def counted(plants: Any, *arguments: Any, **options: Any) -> Any:
        count[plants[0].kind] += len(plants)
        return simulate(plants, *arguments, **options)

    monkeypatch.setattr(runs_module, "simulate", counted)
    return count


def heavier(monkeypatch: Patch, factor: float) -> None:
    def equations(batch: Batch) -> list[Any]:
        exact = [plant.analytic() for plant in batch.physics]
        return [plant.with_parameters(J=factor * plant.parameters.J) for plant in exact]

    monkeypatch.setattr(Batch, "equations", property(equations))


def test_runs_near_a_limit_that_ended_early_or_worse_than_the_sample_are_confirmed() -> None:
    declared, ids = campaign(FALLEN, runs=512), range(512)
    (first,) = screening_module.screened_all(
        declared, screening_module.Screening({"fl-lqr": 0.0}), declared.laws, ids
    )
    margins = first["screened"][np.isfinite(first["screened"])]
    band, worst_of_sample = np.quantile(np.abs(margins), 0.1), np.quantile(margins, 0.05)
    screening = screening_module.Screening(
        {"fl-lqr": float(band)}, "", {"fl-lqr": float(worst_of_sample)}
    )
    (rows,) = screening_module.screened_all(declared, screening, declared.laws, ids)
    assert set(rows["band"]) == {band}
    near, early = np.abs(rows["screened"]) <= band, ~rows.completed
    worse, chance = rows["screened"] < worst_of_sample, drawn_by_chance(0, ids)
    assert all(which.any() for which in (near, early, worse & ~early))
    needed = near | early | worse
    np.testing.assert_array_equal(rows["judged_by"] == PHYSICS, needed | chance)
    np.testing.assert_array_equal(rows["drawn"] > 0, chance & ~needed)
    # All verdicts are those of MuJoCo.
    exact, own = Batch(declared, declared.values(ids), ids).run("fl-lqr"), rows["relative"]
    assert list(rows["status"]) == list(exact["status"])
    np.testing.assert_array_equal(own >= 0, exact["relative"] >= 0)
    np.testing.assert_array_equal(own[needed | chance], exact["relative"][needed | chance])
    assert 0 < (own >= 0).sum() < 512
    # Each run is drawn by its own number, and one in fifty is: within four standard deviations.
    several = drawn_by_chance(7, range(20_000))
    assert several[3000:3100].tolist() == drawn_by_chance(7, range(3000, 3100)).tolist()
    assert several.tolist() != drawn_by_chance(8, range(20_000)).tolist()
    assert abs(several.sum() - 400) < 4 * np.sqrt(400 * 0.98)


def test_the_band_is_ten_times_the_largest_difference_of_a_sample(monkeypatch: Patch) -> None:
    """Equations with a hair more inertia: the difference is measured here once more."""
    heavier(monkeypatch, 1.0005)
    declared = campaign(pair(), runs=2048, seed=11)
    screening = screening_of(declared)
    values = declared.family.values(random_points(2, 12, 0, SAMPLE))
    assert not np.isin(values, declared.values(range(2048))).any()
    batch = Batch(declared, values, range(SAMPLE))
    for law in declared.laws:
        ours, theirs = batch.run(law, plants=batch.equations), batch.run(law)
        difference = float(np.abs(ours["relative"] - theirs["relative"]).max())
        assert difference > LEAST_BAND
        assert screening.bands[law] == pytest.approx(10 * difference, rel=1e-12)
        assert screening.worst[law] == theirs["order"].min()


STOP = '[[stop]]\njoint = "slider"\nlow = "-1 m"\nhigh = "1 m"\n'
HEAVY = small.of("body", "pole", 'added_mass = ["0.1 kg", "0.2 kg"]')
RUBS = small.of("joint", "hinge", "friction = [0, 0.01]")


@pytest.mark.parametrize(
    ("tables", "changed", "why"),
    [
        (small.of("joint", "hinge", "damping = [0, 0.01]"), {}, "joint 'hinge' has damping"),
        (RUBS, {"screen": "equations"}, "accelerations differ from MuJoCo's by"),
        (HEAVY, {}, "is not that of a uniform rod"),
        (FALL + STOP, {}, "equations lack the machine as built"),
        (FALL, {"integrator": "implicitfast"}, "stepped by RK4, the model by implicitfast"),
    ],
)
def test_equations_that_lack_something_do_not_screen(
    tables: str, changed: dict[str, Any], why: str
) -> None:
    text = case("cart_pendulum", tables, laws=LQR, limits=LIMIT.format("0.2 rad"))
    screening = screening_of(campaign(text, **{"runs": 512, "screen": "auto"} | changed))
    assert screening.bands == {}
    assert why in screening.why_not


RUNS = 256


def screened(shard: int = RUNS) -> Any:
    return campaign(pair(), runs=RUNS, shard=shard, screen="equations")


def test_a_screened_campaign_makes_few_runs_in_mujoco(
    counts: dict[str, int], tmp_path: Path
) -> None:
    """Every run on the equations, and in MuJoCo as many as the rows say, and the sample's."""
    folder, parts = Folder(tmp_path / "one"), Folder(tmp_path / "parts")
    run_campaign(screened(), folder.path)
    counted, shown = dict(counts), findings(screened(), folder)
    names = ["judged_by", "screened", "overturned", "drawn", "band", "relative", "order"]
    columns = folder.columns(screened(), names, [0])
    confirmed = sum(int((own["judged_by"] == PHYSICS).sum()) for own in columns.values())
    assert counted == {"corrected": 2 * (RUNS + SAMPLE), "physics": confirmed + 2 * SAMPLE}
    assert 0 < confirmed < 0.2 * 2 * RUNS
    words, drawn = judged_words(shown.judges), shown.judges["lqr"].drawn
    assert words.startswith(f"{2 * RUNS - confirmed} of {2 * RUNS} runs judged by the equations")
    assert (
        f"lqr: of {drawn} confirmed at random, 0 overturned: at most "
        f"{100 * (1 - 0.05 ** (1 / drawn)):.2g} % of those by the equations at 95 %."
    ) in words
    assert results_document(screened(), shown)["answers"][0]["more"] == words
    # The same runs are confirmed whatever the parts, and when resumed.
    run_campaign(screened(100), parts.path)
    before = bits(parts)
    for law, own in parts.columns(screened(100), names, range(3)).items():
        for name, values in columns[law].items():
            np.testing.assert_array_equal(own[name], values)
    parts.part(1).unlink()
    run_campaign(screened(100), parts.path, resume=True)
    assert bits(parts) == before
    # The case file of a plant runs on its judge.
    for judge, kind in ((screening_module.EQUATIONS, "corrected"), (PHYSICS, "physics")):
        number = str(np.flatnonzero(columns["lqr"]["judged_by"] == judge)[0])
        assert find_plant(screened(), folder, number, "lqr").kind == kind
    # Few runs are screened only if that is wanted.
    for options, bands in (
        ({"runs": 16}, {}), ({"runs": 2048, "screen": "none"}, {}),
        ({"runs": 16, "screen": "equations"}, {"lqr": LEAST_BAND, "stiff": LEAST_BAND}),
    ):  # fmt: skip
        assert screening_of(campaign(pair(), **options)).bands == bands


def test_of_overturned_runs_the_first_sixteen_are_named_and_their_share_is_bounded() -> None:
    """Of twenty, every other run."""
    ids = np.arange(40)
    columns = {"id": ids, "overturned": ids % 2, "drawn": ids < 9, "band": np.full(40, 0.1)}
    columns |= {
        "judged_by": np.where(ids < 30, screening_module.EQUATIONS, PHYSICS),
        "screened": np.full(40, 0.2),
    }
    judges = Judges.of(columns | {"relative": np.append(-np.inf, np.linspace(0.25, 0.2, 39))})
    assert (judges.runs, judges.by_equations, judges.overturned, judges.band) == (40, 30, 20, 0.1)
    assert judges.overturned_runs == list(range(1, 32, 2))
    assert (judges.drawn, judges.drawn_overturned) == (9, 4)
    words = judged_words({"lqr": judges})
    assert "(band 0.1 of a limit; margins confirmed differ by 0.05)" in words
    assert "MuJoCo overturned 20: 1, 3, 5, 7," in words
    # So few overturned are as unlikely as is allowed at the bound.
    for drawn, wrong in ((41, 0), (41, 2)):
        share = Judges(1000, 500, wrong, [], 0.1, 0.0, drawn, wrong).wrong_at_most
        assert stats.binom.cdf(wrong, drawn, share) == pytest.approx(0.05, rel=1e-9)
    assert Judges(1000, 500, 0, [], 0.1, 0.0, 0, 0).wrong_at_most == 1.0


def test_a_search_widens_its_band_by_the_differences_that_it_confirms(monkeypatch: Patch) -> None:
    """Equations with more inertia: no margin is left to them within 10 differences."""
    heavier(monkeypatch, 1.02)
    declared = campaign(pair(), runs=512)
    monkeypatch.setattr(
        screening_module, "screening_of", lambda _: screening_module.Screening({"stiff": 0.0})
    )
    values = declared.values(range(192))
    rows, exact = (
        of(declared, "stiff", values)
        for of in (screening_module.screened_search, screening_module.evaluate)
    )
    confirmed = rows["judged_by"] == PHYSICS
    np.testing.assert_array_equal(rows["relative"][confirmed], exact["relative"][confirmed])
    difference = np.abs(rows["relative"] - exact["relative"])[~confirmed]
    assert not confirmed.all()
    assert np.all(np.abs(rows["relative"][~confirmed]) > FACTOR * difference / 2)
    np.testing.assert_array_equal(rows["relative"] >= 0, exact["relative"] >= 0)

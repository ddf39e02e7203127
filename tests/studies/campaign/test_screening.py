"""Runs screened by equations: the verdicts are MuJoCo's, and few runs are made there."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from campaigns import (
    FALL,
    bits,
    campaign,
    deviation_below,
    falling_pendulum,
    pair,
    part,
    uncertain,
)
from commands import Patch
from numpy.typing import NDArray
from scipy import stats

from grosmc_mj.studies.campaign import screening as screening_module
from grosmc_mj.studies.campaign.batch import Batch, evaluate
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.findings import (
    ScreeningSummary,
    campaign_result,
    findings,
    run_campaign,
    screening_sentences,
)
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.screening import (
    EQUATIONS,
    PHYSICS,
    SAMPLE,
    Screening,
    drawn_by_chance,
    screened_all,
    screened_search,
    screening_of,
)
from grosmc_mj.studies.sweep import runs as runs_module
from grosmc_mj.studies.sweep.confirmation import FACTOR, LEAST_BAND
from grosmc_mj.studies.sweep.family import random_points
from grosmc_mj.studies.sweep.runs import Outcomes

LAW = "fl-lqr"
IDS = range(256)


@pytest.fixture(autouse=True)
def _measured_anew() -> None:
    screening_of.cache_clear()


def heavier(monkeypatch: Patch, factor: float) -> None:
    """Give all equations more inertia than the plants have."""

    def equations(batch: Batch) -> list[Any]:
        exact = [plant.analytic() for plant in batch.physics]
        return [plant.changed(J=factor * plant.parameters.J) for plant in exact]

    monkeypatch.setattr(Batch, "equations", property(equations))


# Which runs MuJoCo confirms.


class Fallen(NamedTuple):
    """Screened runs of pendulums, and the same runs in MuJoCo."""

    rows: Outcomes
    exact: Outcomes
    band: float
    worst_of_sample: float

    @property
    def needed(self) -> NDArray[np.bool_]:
        """Runs that must be confirmed."""
        near = np.abs(self.rows["screened"]) <= self.band
        worse = self.rows["screened"] < self.worst_of_sample
        return near | ~self.rows.completed | worse


@cache
def fallen() -> Fallen:
    """Screen with a band and a worst sample that are between the margins."""
    declared = campaign(falling_pendulum("0.5 mrad"), runs=len(IDS))
    (first,) = screened_all(declared, Screening({LAW: 0.0}), declared.laws, IDS)
    margins = first["screened"][np.isfinite(first["screened"])]
    band = float(np.quantile(np.abs(margins), 0.1))
    worst_of_sample = float(np.quantile(margins, 0.05))

    screening = Screening({LAW: band}, worst={LAW: worst_of_sample})
    (rows,) = screened_all(declared, screening, declared.laws, IDS)
    exact = Batch(declared, declared.values(IDS), IDS).run(LAW)
    return Fallen(rows, exact, band, worst_of_sample)


def test_there_are_runs_of_each_reason_to_confirm() -> None:
    rows, _, band, worst_of_sample = fallen()
    assert set(rows["band"]) == {band}
    near = np.abs(rows["screened"]) <= band
    worse = (rows["screened"] < worst_of_sample) & rows.completed
    assert near.any()
    assert not rows.completed.all()
    assert (worse & ~near).any()


def test_runs_near_a_limit_that_ended_early_or_are_worse_than_the_sample_are_confirmed() -> None:
    rows = fallen().rows
    needed = fallen().needed
    by_chance = drawn_by_chance(0, IDS)
    np.testing.assert_array_equal(rows["judged_by"] == PHYSICS, needed | by_chance)
    np.testing.assert_array_equal(rows["drawn"] > 0, by_chance & ~needed)


def test_all_verdicts_of_screened_runs_are_mujoco_s() -> None:
    rows, exact, *_ = fallen()
    assert list(rows["status"]) == list(exact["status"])
    kept = rows["relative"] >= 0
    np.testing.assert_array_equal(kept, exact["relative"] >= 0)
    assert 0 < kept.sum() < len(IDS)


def test_margins_of_confirmed_runs_are_mujoco_s() -> None:
    rows, exact, *_ = fallen()
    confirmed = fallen().needed | drawn_by_chance(0, IDS)
    np.testing.assert_array_equal(rows["relative"][confirmed], exact["relative"][confirmed])


@cache
def drawn(seed: int) -> NDArray[np.bool_]:
    """Which of many runs are drawn by chance."""
    return drawn_by_chance(seed, range(5000))


def test_a_run_is_drawn_by_its_own_number_and_the_seed() -> None:
    assert drawn(7)[3000:3100].tolist() == drawn_by_chance(7, range(3000, 3100)).tolist()
    assert drawn(7).tolist() != drawn(8).tolist()


def test_one_run_in_fifty_is_drawn() -> None:
    # Within four standard deviations.
    assert abs(drawn(7).sum() - 100) < 4 * np.sqrt(100 * 0.98)


# How near to a limit equations are not believed.


def test_the_band_is_ten_times_the_largest_difference_of_a_sample(monkeypatch: Patch) -> None:
    """Equations with a hair more inertia: the difference is measured here once more."""
    heavier(monkeypatch, 1.0005)
    declared = campaign(pair(), runs=2048, seed=11, controllers=("stiff",))
    screening = screening_of(declared)
    values = declared.family.values(random_points(2, 12, 0, SAMPLE))
    assert not np.isin(values, declared.values(range(2048))).any()
    batch = Batch(declared, values, range(SAMPLE))
    by_equations = batch.run("stiff", plants=batch.equations)
    by_physics = batch.run("stiff")
    difference = float(np.abs(by_equations["relative"] - by_physics["relative"]).max())
    assert difference > LEAST_BAND
    assert screening.bands == {"stiff": pytest.approx(10 * difference, rel=1e-12)}
    assert screening.worst == {"stiff": by_physics["order"].min()}


@pytest.mark.parametrize(
    ("numbers", "stops", "changed", "why"),
    [
        ([uncertain("edit.hinge.damping", 0, 0.01)], [], {}, "joint 'hinge' has damping"),
        (
            [uncertain("edit.hinge.friction", 0, 0.01)],
            [],
            {"screen": "equations"},
            "accelerations differ from MuJoCo's by",
        ),
        (
            [uncertain("edit.pole.added_mass", "0.1 kg", "0.2 kg")],
            [],
            {},
            "is not that of a uniform rod",
        ),
        (
            FALL,
            [{"joint": "slider", "low": "-1 m", "high": "1 m"}],
            {},
            "equations lack the machine as built",
        ),
        (FALL, [], {"integrator": "implicitfast"}, "stepped by RK4, the model by implicitfast"),
    ],
)
def test_equations_that_lack_something_do_not_screen(
    numbers: Any, stops: list[dict[str, str]], changed: dict[str, Any], why: str
) -> None:
    limits = deviation_below("0.2 rad")
    text = part(*numbers, system="cart_pendulum", requirement=limits, stop=stops)
    options = {"runs": 512, "screen": "auto"} | changed
    screening = screening_of(campaign(text, **options))
    assert screening.bands == {}
    assert why in screening.why_not


@pytest.mark.parametrize(
    ("options", "bands"),
    [
        ({"runs": 16}, {}),
        ({"runs": 2048, "screen": "none"}, {}),
        ({"runs": 16, "screen": "equations"}, {"lqr": LEAST_BAND, "stiff": LEAST_BAND}),
    ],
)
def test_few_runs_are_screened_only_if_that_is_wanted(
    options: dict[str, Any], bands: dict[str, float]
) -> None:
    assert screening_of(campaign(pair(), **options)).bands == bands


# A campaign that is screened.

RUNS = 256
NAMES = ["judged_by", "screened", "overturned", "drawn", "band", "relative", "order"]


def screened(shard: int = RUNS) -> Campaign:
    """Servos under two LQRs, screened."""
    return campaign(pair(), runs=RUNS, shard=shard, screen="equations")


@pytest.fixture(scope="module")
def counts() -> dict[str, int]:
    """Runs that were made for the screened folder, by the kind of their plants."""
    return {"physics": 0, "corrected": 0}


@pytest.fixture(scope="module")
def screened_folder(counts: dict[str, int], tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """The folder of the screened servos in one part."""
    simulate = runs_module.simulate

    def counted(plants: Any, *arguments: Any, **options: Any) -> Any:
        counts[plants[0].kind] += len(plants)
        return simulate(plants, *arguments, **options)

    screening_of.cache_clear()
    folder = Folder(tmp_path_factory.mktemp("screened") / "one")
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(runs_module, "simulate", counted)
        run_campaign(screened(), folder.path)
    return folder


def confirmed_runs(folder: Folder) -> int:
    """Number of the screened servos' runs that MuJoCo judged."""
    columns = folder.columns(screened(), ["judged_by"], [0])
    return sum(int((rows["judged_by"] == PHYSICS).sum()) for rows in columns.values())


def test_a_screened_campaign_makes_few_runs_in_mujoco(
    counts: dict[str, int], screened_folder: Folder
) -> None:
    """Every run on the equations, and in MuJoCo as many as the rows say, and the sample's."""
    confirmed = confirmed_runs(screened_folder)
    assert counts == {"corrected": 2 * (RUNS + SAMPLE), "physics": confirmed + 2 * SAMPLE}
    assert 0 < confirmed < 0.2 * 2 * RUNS


def test_the_answer_says_who_judged(screened_folder: Folder) -> None:
    by_equations = 2 * RUNS - confirmed_runs(screened_folder)
    result = findings(screened(), screened_folder)
    words = screening_sentences(result.screening)
    assert words.startswith(f"{by_equations} of {2 * RUNS} runs judged by the equations")
    drawn = result.screening["lqr"].drawn
    share = 100 * (1 - 0.05 ** (1 / drawn))
    assert (
        f"lqr: of {drawn} confirmed at random, 0 overturned: at most "
        f"{share:.2g} % of those by the equations at 95 %."
    ) in words
    assert words in campaign_result(screened(), result).remarks


def test_the_same_runs_are_confirmed_whatever_the_parts(
    screened_folder: Folder, tmp_path: Path
) -> None:
    parts = Folder(tmp_path)
    run_campaign(screened(100), parts.path)
    np.testing.assert_equal(
        parts.columns(screened(100), NAMES, range(3)),
        screened_folder.columns(screened(), NAMES, [0]),
    )

    # And when resumed.
    before = bits(parts)
    parts.part(1).unlink()
    run_campaign(screened(100), parts.path, resume=True)
    assert bits(parts) == before


# Summaries.


def overturned_judges() -> ScreeningSummary:
    """Judges of forty runs, of which every other one was overturned."""
    ids = np.arange(40)
    columns = {
        "id": ids,
        "overturned": ids % 2,
        "drawn": ids < 9,
        "band": np.full(40, 0.1),
        "judged_by": np.where(ids < 30, EQUATIONS, PHYSICS),
        "screened": np.full(40, 0.2),
        "relative": np.append(-np.inf, np.linspace(0.25, 0.2, 39)),
    }
    return ScreeningSummary.of(columns)


def test_judges_are_counted() -> None:
    judges = overturned_judges()
    assert (judges.runs, judges.by_equations, judges.overturned, judges.band) == (40, 30, 20, 0.1)
    assert (judges.drawn, judges.drawn_overturned) == (9, 4)


def test_of_overturned_runs_the_first_sixteen_are_named() -> None:
    judges = overturned_judges()
    assert judges.overturned_runs == list(range(1, 32, 2))
    words = screening_sentences({"lqr": judges})
    assert "(band 0.1 of a limit; margins confirmed differ by 0.05)" in words
    assert "MuJoCo overturned 20: 1, 3, 5, 7," in words


@pytest.mark.parametrize("overturned", [0, 2])
def test_the_share_of_wrong_verdicts_is_bounded(overturned: int) -> None:
    judges = ScreeningSummary(1000, 500, overturned, [], 0.1, 0.0, 41, overturned)
    # So few overturned are as unlikely as is allowed at the bound.
    tail = stats.binom.cdf(overturned, 41, judges.wrong_at_most)
    assert tail == pytest.approx(0.05, rel=1e-9)


def test_without_a_drawn_run_there_is_no_bound() -> None:
    judges = ScreeningSummary(1000, 500, 0, [], 0.1, 0.0, 0, 0)
    assert judges.wrong_at_most == 1.0
    assert "at random" not in screening_sentences({"lqr": judges})


def test_a_search_widens_its_band_by_the_differences_that_it_confirms(monkeypatch: Patch) -> None:
    """Equations with more inertia: no margin is left to them within 10 differences."""
    heavier(monkeypatch, 1.02)
    declared = campaign(pair(), runs=512)
    screening = Screening({"stiff": 0.0})
    monkeypatch.setattr(screening_module, "screening_of", lambda _: screening)
    values = declared.values(range(192))
    rows = screened_search(declared, "stiff", values, range(192))
    exact = evaluate(declared, "stiff", values)

    confirmed = rows["judged_by"] == PHYSICS
    assert not confirmed.all()
    np.testing.assert_array_equal(rows["relative"][confirmed], exact["relative"][confirmed])
    difference = np.abs(rows["relative"] - exact["relative"])[~confirmed]
    assert np.all(np.abs(rows["relative"][~confirmed]) > FACTOR * difference / 2)
    np.testing.assert_array_equal(rows["relative"] >= 0, exact["relative"] >= 0)

"""The worst plant and the radius, where the answer is known."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns import (
    AMPLITUDE,
    BETWEEN_BOTH,
    BOTH,
    FALL,
    LQR,
    PUSH,
    campaign,
    deviation_below,
    falling_pendulum,
    kept,
    part,
    servo,
    uncertain,
)
from commands import Patch

from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.results.document import json_text, plain
from grosmc_mj.studies.campaign import worst as worst_module
from grosmc_mj.studies.campaign.batch import evaluate
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.findings import findings
from grosmc_mj.studies.campaign.plant_file import searched_plant
from grosmc_mj.studies.campaign.radius import Radius, ScaleTrial, radius
from grosmc_mj.studies.campaign.worst import WORST, WorstPlant, shrunk, worst, worst_result
from grosmc_mj.studies.sweep.compass import CompassSearch
from grosmc_mj.studies.sweep.family import random_points


def loads(
    limit: float, *numbers: dict[str, Any], tables: dict[str, Any] | None = None, **options: Any
) -> Campaign:
    """A family whose worst plants have the largest load and inertia: the rotor is linear.

    Args:
        limit: Of the deviation under LQR [mrad].
        numbers: The uncertain numbers; the load by default.
        tables: Other tables of the case.
        options: Of the campaign.
    """
    limits = deviation_below(f"{limit} mrad")
    text = servo(*(numbers or [AMPLITUDE]), laws=LQR, limits=limits, **(tables or {}))
    return campaign(text, **options)


def relative(declared: Campaign, *values: float) -> float:
    """The least margin of one plant under LQR."""
    return float(evaluate(declared, "lqr", np.array([values]))["relative"][0])


def both() -> Campaign:
    """A family in which the load fails at a fraction of its range."""
    return loads(1.0, *BOTH)


# The worst plant.


@pytest.fixture(scope="module")
def found() -> WorstPlant:
    """The worst plant of a family in which the load fails at a fraction of its range."""
    return worst(both(), "lqr", list(range(8)), 256)


def test_the_search_finds_the_known_worst_plant(found: WorstPlant) -> None:
    corners = both().family.values(np.array([[1.0, 0.0], [1.0, 1.0]]))
    # The corner itself, off by as much as points are kept off the faces of the cube.
    np.testing.assert_allclose(found.values, [3.0, np.sign(found.values[1])], rtol=1e-15)
    truth = evaluate(both(), "lqr", corners)["relative"].min()
    assert found.relative == pytest.approx(truth, rel=1e-12)
    assert found.relative == relative(both(), *found.values) == found.search
    assert found.search < min(found.random, found.samples)
    assert (found.fails, found.winner, found.evaluations) == (True, "search", 256)


def test_the_shrunk_plant_fails_and_a_nearer_one_passes(found: WorstPlant) -> None:
    plant: Any = found.shrunk
    assert found.shrunk_relative == relative(both(), *plant) < 0
    # Nearer by 1/256 of the line from the worst.
    nominal = both().family.nominal
    line = np.where(plant != nominal, found.values - nominal, 0.0)
    assert relative(both(), *(plant - line / 256)) >= 0


def test_the_numbers_that_the_shrunk_plant_needs_are_named(found: WorstPlant) -> None:
    family = both().family
    needed = found.shrunk != family.nominal
    # One of both has no part in it, though the worst plant has it at its end.
    assert needed.sum() == 1
    assert np.all(found.values != family.nominal)
    assert found.changed == tuple(np.array(family.names)[needed])


def test_numbers_that_play_no_part_are_made_nominal() -> None:
    little = uncertain("edit.rotor.mass_scale", 1, 1.01)
    phase = uncertain("disturbance.hum.phase", "0 rad", "1 rad")
    declared = loads(3.4, little, AMPLITUDE, phase)
    mass, load, hum = shrunk(declared, "lqr", np.array([1.01, 1.0, 0.5]))
    assert (mass, hum) == (1.0, 0.0)
    assert 0 < load <= 1.0


def least(values: Any) -> float:
    """The least margin of some plants under LQR."""
    return evaluate(both(), "lqr", values)["relative"].min()


def test_random_plants_and_samples_compete_with_the_search(found: WorstPlant) -> None:
    """As many random plants as the search tries, and the campaign's runs."""
    assert found.random == least(both().family.values(random_points(2, 1, 0, 256)))
    assert found.samples == least(both().values(range(8)))


def test_a_search_that_loses_says_who_has_the_worst_plant(monkeypatch: Patch) -> None:
    """Where it tries the middle of the family alone."""
    monkeypatch.setattr(worst_module, "_starts", lambda *_: np.full((64, 2), 0.5))
    monkeypatch.setattr(CompassSearch, "descend", lambda *_: None)
    lost = worst(both(), "lqr", list(range(8)), 256)
    assert lost.search == relative(both(), 2.0, 0.0) > lost.random
    margin, winner = min((lost.samples, "samples"), (lost.random, "random"))
    assert (lost.winner, lost.relative) == (winner, margin)

    document = plain(worst_result(both(), [lost]))["controllers"]["lqr"]
    assert document["worst_by"] == winner
    assert document["worst_of_the_search"] == lost.search
    assert document["worst_of_as_many_random_plants"] == lost.random


def test_of_runs_that_end_early_the_earlier_is_worse() -> None:
    declared = campaign(falling_pendulum(), runs=16, duration=0.05)
    # A run that ends at 37 ms, and one that ends later, beyond this duration.
    search = worst(declared, "fl-lqr", [11, 10], 128)
    assert search.relative == -np.inf
    # A corner: farthest from upright, and fastest away from it.
    corners = declared.family.values(declared.family.corners(2 ** len(FALL)))
    (ended,) = evaluate(declared, "fl-lqr", search.values[None])["ended"]
    assert ended == evaluate(declared, "fl-lqr", corners)["ended"].min() < 0.037


# Random numbers of a loop.


@cache
def noisy() -> Campaign:
    """A campaign of which one run of 16 fails, by its own random numbers.

    Noise of its sensors moves the input by more than the load does.
    """
    noise = [
        {"of": "rotor angle", "noise": "5 mrad"},
        {"of": "rotor speed", "noise": "0.1 rad/s"},
    ]
    return loads(3.9, tables={"sensor": noise}, runs=16)


@cache
def noisy_margins() -> Array:
    """Margins of the noisy campaign's runs, each with its own random numbers."""
    return evaluate(noisy(), "lqr", noisy().values(range(16)), range(16))["relative"]


@cache
def noisy_worst() -> WorstPlant:
    """The worst plant of the noisy campaign."""
    return worst(noisy(), "lqr", noisy_margins().argsort().tolist(), 128)


def test_the_worst_sample_has_the_margin_of_its_own_run() -> None:
    """It was run with the random numbers of the first run: a margin above 0 beside failures."""
    assert (noisy_margins() < 0).sum() == 1
    assert evaluate(noisy(), "lqr", noisy().values(range(16)))["relative"].min() > 0
    search = noisy_worst()
    assert search.samples == noisy_margins().min()
    # With the random numbers of that run a search does not lose the failure that it begins with.
    assert search.relative <= search.search <= search.samples
    again = evaluate(noisy(), "lqr", search.values[None], [search.run])
    assert again["relative"].tolist() == [search.relative]


@pytest.mark.parametrize("which", ["worst", "shrunk"])
def test_the_case_file_of_a_plant_that_was_found_draws_what_it_was_found_with(
    which: str, tmp_path: Path
) -> None:
    content = json_text(worst_result(noisy(), [noisy_worst()]))
    (tmp_path / WORST).write_text(content, encoding="utf-8")
    _, run = searched_plant(noisy(), tmp_path, which, "lqr")
    assert run == noisy_worst().run == noisy_margins().argmin() != 0


def test_at_the_scale_as_declared_samples_are_the_runs_of_the_campaign() -> None:
    corners = len(noisy().family.corners(64))
    (trial,) = [trial for trial in radius(noisy(), "lqr").trials if trial.scale == 1]
    samples = trial.relative[corners : corners + 16]
    np.testing.assert_allclose(samples, noisy_margins(), rtol=1e-9)


# A margin of zero.


def staying() -> Campaign:
    """Rotors that start 1 rad away, move towards their goal and shall stay within that."""
    return campaign(servo(AMPLITUDE, laws=LQR, limits=[{"stays_within": "1 rad"}]))


def test_a_margin_of_zero_is_kept() -> None:
    search = worst(staying(), "lqr", [0], 128)
    assert (search.relative, search.fails, search.shrunk, search.changed) == (0.0, False, None, ())
    assert plain(worst_result(staying(), [search]))["controllers"]["lqr"]["shrunk"] is None


def test_a_margin_of_zero_is_no_failure_of_a_scale() -> None:
    # With three times the load, some of it drives the rotor away.
    assert radius(staying(), "lqr").found > 1


# Runs that never settle.


def never_settling(runs: int = 32) -> Campaign:
    """Servos of which most never settle: a load that stays leaves an error in proportion."""
    run = {"duration": "4 s", "control_period": "10 ms", "timestep": "10 ms"}
    text = part(
        AMPLITUDE,
        run=run,
        disturbance={**PUSH, "profile": "constant"},
        requirement={"settles_within": "2 s"},
    )
    return campaign(text, runs=runs, shard=32)


@cache
def rising_errors() -> list[int]:
    """Numbers of the runs that never settle; the one with the largest error left is the last."""
    values = never_settling().values(range(32))
    never = np.flatnonzero(evaluate(never_settling(), "lqr", values)["relative"] == -1)
    return never[np.abs(values[never, 0]).argsort()].tolist()


def test_a_campaign_names_runs_with_the_largest_error_left_first(tmp_path: Path) -> None:
    declared = never_settling()
    assert len(rising_errors()) > 16, "as a time the margin of most is the same"
    named = findings(declared, kept(declared, tmp_path)).worst["lqr"]
    rows = evaluate(declared, "lqr", declared.values(range(32)))
    assert named == rows["order"].argsort(kind="stable")[:16].tolist()
    assert named[0] == rising_errors()[-1]


def test_of_plants_that_never_settle_the_largest_error_left_is_the_worst() -> None:
    # The search begins with those that have the smallest.
    search = worst(never_settling(), "lqr", rising_errors()[:8], 128)
    assert np.abs(search.values[0]) > 0.999
    assert search.relative == search.samples == -1, "as a time it is no worse than a sample"
    assert search.winner != "samples"


def test_the_worst_plant_of_a_scale_is_at_its_end() -> None:
    trials = radius(never_settling(runs=4), "lqr").trials
    worst_loads = [abs(trial.worst[0]) for trial in trials]
    assert worst_loads == pytest.approx([trial.scale for trial in trials], rel=1e-12)


# The radius.


@cache
def reached() -> Any:
    """The radius of a family whose load fails at a fraction of its range."""
    return radius(loads(1.0), "lqr")


def test_the_radius_is_known_to_a_hundredth() -> None:
    # Known to 1 % of itself, or to 0.01.
    assert 0 < reached().outside.scale - reached().found <= 0.01


def test_a_plant_outside_the_radius_fails() -> None:
    assert relative(loads(1.0), *reached().outside.worst) == reached().outside.least < 0


@pytest.mark.parametrize("fails", [False, True])
def test_the_true_radius_is_that_of_the_ends_of_the_load(*, fails: bool) -> None:
    """They are the worst of the family."""
    scale = reached().outside.scale if fails else reached().found
    least_at_ends = min(relative(loads(1.0), end) for end in (-scale, scale))
    assert (least_at_ends < 0) == fails


def correlated(seed: int) -> Campaign:
    """Two random plants of a family without corners."""
    return loads(1.0, *BOTH, tables={"correlation": BETWEEN_BOTH}, runs=2, seed=seed)


@cache
def radius_of_two_plants(seed: int) -> Any:
    """The radius from two random plants."""
    return radius(correlated(seed), "lqr")


def test_a_radius_does_not_hang_on_the_plants_that_were_drawn() -> None:
    assert radius_of_two_plants(0).plants == 2
    assert radius_of_two_plants(1).found == radius_of_two_plants(0).found


def test_a_radius_is_refined_by_failing_plants_that_were_not_drawn() -> None:
    declared = correlated(0)
    refined = radius_of_two_plants(0)
    drawn = declared.family.scaled(declared.values(range(2)), refined.outside.scale)
    assert evaluate(declared, "lqr", drawn)["relative"].min() > 0 > refined.outside.least


@pytest.mark.parametrize(("limit", "found", "failed"), [(100.0, 8.0, None), (1e-9, 0.0, 0.0)])
def test_a_radius_ends_where_the_nominal_plant_fails_or_as_far_as_was_tried(
    limit: float, found: float, failed: float | None
) -> None:
    end = radius(loads(limit), "lqr")
    assert (end.found, end.largest) == (found, 8.0)
    assert (end.outside and end.outside.scale) == failed


@pytest.mark.parametrize(
    ("options", "plants"),
    [
        # The corners besides the runs, 128 at most, and each once.
        ({"runs": 8}, 4 + 8),
        ({"runs": 1000}, 128),
        ({"runs": 4, "sampler": "corners"}, 4),
    ],
)
def test_a_radius_is_of_the_corners_besides_the_runs(options: dict[str, Any], plants: int) -> None:
    assert radius(loads(1e-9, *BOTH, **options), "lqr").plants == plants


def test_a_stricter_requirement_has_a_smaller_radius() -> None:
    assert radius(loads(0.5), "lqr").found < 0.6 * reached().found


def trial(scale: float, failures: int) -> ScaleTrial:
    """A trial of one scale."""
    margins = np.where(np.arange(4) < failures, -1.0, 1.0)
    return ScaleTrial(scale, np.zeros((4, 1)), margins, margins, (0,) * 4)


# A requirement fails from the second scale on.
TRIALS = (trial(0.0, 0), trial(0.5, 1), trial(1.0, 1))


def test_the_radius_ends_at_the_first_failure_of_a_requirement() -> None:
    found = Radius("grosmc", 8, TRIALS, 8.0)
    assert (found.found, found.outside, found.fails) == (0.0, TRIALS[1], True)
    beyond = Radius("grosmc", 8, (trial(1.0, 0), trial(1.5, 1)), 8.0)
    assert (beyond.found, beyond.fails) == (1.0, False)

"""The worst plant and the radius, where the answer is known."""

from functools import cache
from pathlib import Path
from typing import Any

import campaign_cases as small
import numpy as np
import pytest
from campaign_cases import (
    AMPLITUDE,
    BOTH,
    GROSMC,
    LQR,
    campaign,
    deviation_below,
    mass_scale,
    of,
    servo,
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


def loads(limit: float, tables: str = AMPLITUDE, laws: str = LQR, **options: Any) -> Campaign:
    """A family whose worst plants have the largest load and inertia: the rotor is linear.

    Args:
        limit: Of the deviation [mrad].
        tables: The uncertain numbers.
        laws: The controllers.
        options: Of the campaign.
    """
    text = servo(tables, laws=laws, limits=deviation_below(f"{limit} mrad"))
    return campaign(text, **options)


def relative(declared: Campaign, *values: float) -> float:
    """The least margin of one plant under LQR."""
    return float(evaluate(declared, "lqr", np.array([values]))["relative"][0])


@pytest.fixture(scope="module")
def found() -> WorstPlant:
    """The worst plant of a family in which the load fails at a fraction of its range."""
    return worst(loads(1.0, BOTH), "lqr", list(range(8)), 256)


def test_the_search_finds_the_known_worst_plant(found: WorstPlant) -> None:
    declared = loads(1.0, BOTH)
    corners = declared.family.values(np.array([[1.0, 0.0], [1.0, 1.0]]))
    # The corner itself, off by as much as points are kept off the faces of the cube.
    np.testing.assert_allclose(found.values, [3.0, np.sign(found.values[1])], rtol=1e-15)
    truth = evaluate(declared, "lqr", corners)["relative"].min()
    assert found.relative == pytest.approx(truth, rel=1e-12)
    assert found.relative == relative(declared, *found.values) == found.search
    assert found.search < min(found.random, found.samples)
    assert (found.fails, found.winner, found.evaluations) == (True, "search", 256)


def test_the_shrunk_plant_fails(found: WorstPlant) -> None:
    plant = found.shrunk
    assert plant is not None
    assert found.shrunk_relative == relative(loads(1.0, BOTH), *plant) < 0


def test_a_plant_nearer_than_the_shrunk_one_passes(found: WorstPlant) -> None:
    declared = loads(1.0, BOTH)
    plant = found.shrunk
    assert plant is not None
    # Nearer by 1/256 of the line from the worst.
    nominal = declared.family.nominal
    line = np.where(plant != nominal, found.values - nominal, 0.0)
    assert line.any()
    assert relative(declared, *(plant - line / 256)) >= 0


def test_the_numbers_that_the_shrunk_plant_needs_are_named(found: WorstPlant) -> None:
    family = loads(1.0, BOTH).family
    assert found.shrunk is not None
    needed = found.shrunk != family.nominal
    # One of both has no part in it, though the worst plant has it at its end.
    assert needed.sum() == 1
    assert np.all(found.values != family.nominal)
    assert found.changed == tuple(np.array(family.names)[needed])


PHASE = of("disturbance", "hum", 'phase = ["0 rad", "1 rad"]')


def test_numbers_that_play_no_part_are_made_nominal() -> None:
    declared = loads(3.4, mass_scale("[1, 1.01]") + AMPLITUDE + PHASE)
    mass, load, hum = shrunk(declared, "lqr", np.array([1.01, 1.0, 0.5]))
    assert (mass, hum) == (1.0, 0.0)
    assert 0 < load <= 1.0


def least(values: Any) -> float:
    """The least margin of some plants under LQR."""
    return evaluate(loads(1.0, BOTH), "lqr", values)["relative"].min()


def least_random() -> float:
    """The least margin of as many random plants as the search tries."""
    return least(loads(1.0, BOTH).family.values(random_points(2, 1, 0, 256)))


def least_sample() -> float:
    """The least margin of the campaign's runs."""
    return least(loads(1.0, BOTH).values(range(8)))


def test_random_plants_compete_with_the_search(found: WorstPlant) -> None:
    assert found.random == least_random()


def test_samples_compete_with_the_search(found: WorstPlant) -> None:
    assert found.samples == least_sample()


@pytest.fixture
def lost(monkeypatch: Patch) -> WorstPlant:
    """The worst plant, where the search tries the middle of the family alone."""

    def lazy(_declared: Campaign, _samples: Any) -> Any:
        return np.full((64, 2), 0.5)

    monkeypatch.setattr(worst_module, "_starts", lazy)
    monkeypatch.setattr(CompassSearch, "descend", lambda *_: None)
    return worst(loads(1.0, BOTH), "lqr", list(range(8)), 256)


def test_a_search_can_lose(lost: WorstPlant) -> None:
    assert lost.search == relative(loads(1.0, BOTH), 2.0, 0.0) > lost.random
    margin, winner = min((least_sample(), "samples"), (least_random(), "random"))
    assert (lost.winner, lost.relative) == (winner, margin)


def test_the_document_says_who_has_the_worst_plant(lost: WorstPlant) -> None:
    document = plain(worst_result(loads(1.0, BOTH), [lost]))["controllers"]["lqr"]
    assert document["worst_by"] == lost.winner
    assert document["worst_of_the_search"] == lost.search
    assert document["worst_of_as_many_random_plants"] == least_random()


def test_of_runs_that_end_early_the_earlier_is_worse() -> None:
    declared = campaign(small.falling().specification.text, runs=16, duration=0.05)
    # A run that ends at 37 ms, and one that ends later, beyond this duration.
    search = worst(declared, "fl-lqr", [11, 10], 128)
    assert search.relative == -np.inf
    # A corner: farthest from upright, and fastest away from it.
    corners = declared.family.values(declared.family.corners(4))
    (ended,) = evaluate(declared, "fl-lqr", search.values[None])["ended"]
    assert ended == evaluate(declared, "fl-lqr", corners)["ended"].min() < 0.037


# The rotor starts 1 rad away and moves towards its goal.
STAYS_AT_START = """
[[requirement]]
stays_within = "1 rad"
"""


# Noise of a sensor that moves the input by more than the load does.
NOISY = """
[[sensor]]
of = "rotor angle"
noise = "5 mrad"
[[sensor]]
of = "rotor speed"
noise = "0.1 rad/s"
"""


@cache
def noisy() -> Campaign:
    """A campaign of which one run of 16 fails, by its own random numbers."""
    text = servo(AMPLITUDE, laws=LQR + NOISY, limits=deviation_below("3.9 mrad"))
    return campaign(text, runs=16)


def own_margins(declared: Campaign) -> Array:
    """Margins of the campaign's runs, each with its own random numbers."""
    ids = range(declared.specification.runs)
    return evaluate(declared, "lqr", declared.values(ids), ids)["relative"]


def test_the_worst_sample_has_the_margin_of_its_own_run() -> None:
    """It was run with the random numbers of the first run: a margin above 0 beside failures."""
    declared = noisy()
    margins = own_margins(declared)
    assert (margins < 0).sum() == 1
    assert evaluate(declared, "lqr", declared.values(range(16)))["relative"].min() > 0

    search = worst(declared, "lqr", margins.argsort().tolist(), 128)
    assert search.samples == margins.min()
    assert search.relative <= margins.min()
    again = evaluate(declared, "lqr", search.values[None], [search.run])
    assert again["relative"].tolist() == [search.relative]


@pytest.mark.parametrize("which", ["worst", "shrunk"])
def test_the_case_file_of_a_plant_that_was_found_draws_what_it_was_found_with(
    which: str, tmp_path: Path
) -> None:
    declared = noisy()
    margins = own_margins(declared)
    search = worst(declared, "lqr", margins.argsort().tolist(), 128)
    content = json_text(worst_result(declared, [search]))
    (tmp_path / WORST).write_text(content, encoding="utf-8")
    _, run = searched_plant(declared, tmp_path, which, "lqr")
    assert run == search.run == margins.argmin() != 0


def test_at_the_scale_as_declared_samples_are_the_runs_of_the_campaign() -> None:
    declared = noisy()
    corners = len(declared.family.corners(64))
    (trial,) = [trial for trial in radius(declared, "lqr").trials if trial.scale == 1]
    samples = trial.relative[corners : corners + 16]
    np.testing.assert_allclose(samples, own_margins(declared), rtol=1e-9)


def test_a_margin_of_zero_is_kept() -> None:
    declared = campaign(servo(AMPLITUDE, laws=LQR, limits=STAYS_AT_START))
    search = worst(declared, "lqr", [0], 128)
    assert (search.relative, search.fails, search.shrunk, search.changed) == (0.0, False, None, ())
    assert plain(worst_result(declared, [search]))["controllers"]["lqr"]["shrunk"] is None


def test_a_margin_of_zero_is_no_failure_of_a_scale() -> None:
    declared = campaign(servo(AMPLITUDE, laws=LQR, limits=STAYS_AT_START))
    # With three times the load, some of it drives the rotor away.
    assert radius(declared, "lqr").found > 1


# The load that stays leaves an error in proportion: above 2 % of the step the rotor never settles.
NEVER_SETTLES = """
[plant]
system = "servo"
[run]
duration = "4 s"
control_period = "10 ms"
timestep = "10 ms"
[[disturbance]]
body = "rotor"
torque = ["0 N m", "1 N m", "0 N m"]
label = "load"
profile = "constant"
[[uncertain]]
number = "disturbance.load.scale"
name = "load amplitude"
values = [-1, 1]
nominal = 0
[[controller]]
law = "lqr"
[[requirement]]
settles_within = "2 s"
"""


def never_settling() -> Campaign:
    """Servos of which most never settle."""
    return campaign(NEVER_SETTLES, runs=32, shard=32)


@cache
def rising_errors() -> list[int]:
    """Numbers of the runs that never settle; the one with the largest error left is the last."""
    declared = never_settling()
    values = declared.values(range(32))
    never = np.flatnonzero(evaluate(declared, "lqr", values)["relative"] == -1)
    return never[np.abs(values[never, 0]).argsort()].tolist()


def test_a_campaign_names_runs_with_the_largest_error_left_first(tmp_path: Path) -> None:
    declared = never_settling()
    assert len(rising_errors()) > 16, "as a time the margin of most is the same"
    named = findings(declared, small.kept(declared, tmp_path)).worst["lqr"]
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
    for trial in radius(campaign(NEVER_SETTLES, runs=4), "lqr").trials:
        assert abs(trial.worst[0]) == pytest.approx(trial.scale, rel=1e-12)


@cache
def reached() -> Any:
    """The radius of a family whose load fails at a fraction of its range."""
    return radius(loads(1.0), "lqr")


def test_the_radius_is_known_to_a_hundredth() -> None:
    # Known to 1 % of itself, or to 0.01.
    assert 0 < reached().outside.scale - reached().found <= 0.01


def test_a_plant_outside_the_radius_fails() -> None:
    assert relative(loads(1.0), *reached().outside.worst) == reached().outside.least < 0


def least_at_ends(scale: float) -> float:
    """The least margin of both ends of the load, which are the worst of the family."""
    return min(relative(loads(1.0), end) for end in (-scale, scale))


def test_the_true_radius_is_that_of_the_ends_of_the_load() -> None:
    assert least_at_ends(reached().found) >= 0
    assert least_at_ends(reached().outside.scale) < 0


@cache
def radius_of_two_plants(seed: int) -> Any:
    """The radius of correlated numbers, which have no corners, from two random plants."""
    return radius(loads(1.0, BOTH + small.CORRELATED, runs=2, seed=seed), "lqr")


@pytest.mark.parametrize("seed", [1, 2])
def test_a_radius_does_not_hang_on_the_plants_that_were_drawn(seed: int) -> None:
    assert radius_of_two_plants(seed).found == radius_of_two_plants(0).found


def test_a_radius_is_refined_by_failing_plants_that_were_not_drawn() -> None:
    declared = loads(1.0, BOTH + small.CORRELATED, runs=2)
    refined = radius_of_two_plants(0)
    drawn = declared.family.scaled(declared.values(range(2)), refined.outside.scale)
    assert evaluate(declared, "lqr", drawn)["relative"].min() > 0 > refined.outside.least


def test_where_nothing_fails_the_radius_is_as_far_as_was_tried() -> None:
    safe = radius(loads(100.0), "lqr")
    assert (safe.outside, safe.found, safe.largest) == (None, 8.0, 8.0)


def test_where_the_nominal_plant_fails_the_radius_is_zero() -> None:
    failing = radius(loads(1e-9), "lqr")
    assert failing.outside is not None
    assert (failing.found, failing.outside.scale) == (0.0, 0.0)


def test_a_radius_is_of_the_corners_besides_the_runs() -> None:
    assert radius(loads(1e-9, BOTH, runs=8), "lqr").plants == 4 + 8


def test_a_radius_is_of_128_plants_at_most() -> None:
    assert radius(loads(1e-9, BOTH, runs=1000), "lqr").plants == 128


def test_a_radius_of_corners_has_each_once() -> None:
    assert radius(loads(1e-9, BOTH, runs=4, sampler="corners"), "lqr").plants == 4


def test_a_radius_of_correlated_numbers_has_no_corners() -> None:
    declared = loads(1.0, BOTH + small.CORRELATED)
    assert radius(declared, "lqr").plants == 8


@cache
def grosmc_radius(limit: float) -> Any:
    """The radius under GROSMC, with a limit on the deviation [mrad]."""
    return radius(loads(limit, laws=GROSMC), "grosmc")


def test_a_stricter_requirement_has_a_smaller_radius() -> None:
    assert grosmc_radius(1000).outside is None
    assert grosmc_radius(0.5).found < grosmc_radius(3).found


def trial(scale: float, failures: int) -> ScaleTrial:
    """A trial of one scale."""
    margins = np.where(np.arange(4) < failures, -1.0, 1.0)
    return ScaleTrial(scale, np.zeros((4, 1)), margins, margins, (0,) * 4)


# A requirement fails from the second scale on.
TRIALS = (trial(0.0, 0), trial(0.5, 1), trial(1.0, 1))


def test_the_radius_ends_at_the_first_failure_of_a_requirement() -> None:
    found = Radius("grosmc", 8, TRIALS, 8.0)
    assert (found.found, found.outside) == (0.0, TRIALS[1])

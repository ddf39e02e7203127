"""The worst plant, the radius and the premises' promise, where the answer is known."""

from pathlib import Path
from typing import Any

import campaign_cases as small
import numpy as np
import pytest
from campaign_cases import AMPLITUDE, BOTH, GROSMC, INERTIA, LAWS, LQR, campaign, servo, uncertain
from commands import Patch

from grosmc_mj.sweep import worst as worst_module
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.family import random_points
from grosmc_mj.sweep.findings import findings
from grosmc_mj.sweep.promise import Promise, PromisedFamily, promise
from grosmc_mj.sweep.radius import Radius, ScaleTrial, _growth, radius
from grosmc_mj.sweep.screening import evaluate
from grosmc_mj.sweep.worst import Worst, shrunk, worst, worst_document


def loads(limit: float, tables: str = AMPLITUDE, laws: str = LQR, **more: Any) -> Campaign:
    """A family whose worst plants have the largest load and inertia: the rotor is linear."""
    limits = small.DEVIATION.replace("3 mrad", f"{limit} mrad")
    return campaign(servo(tables, laws=laws, limits=limits), **more)


def relative(declared: Campaign, *values: float) -> float:
    """The least margin of one plant under LQR."""
    return float(evaluate(declared, "lqr", np.array([values]))["relative"][0])


@pytest.fixture(scope="module")
def known() -> Worst:
    """The worst plant of a family in which the load fails at a fraction of its range."""
    return worst(loads(1.0, BOTH), "lqr", list(range(8)), 256)


def test_the_search_finds_the_known_worst_plant_and_shrinks_it(known: Worst) -> None:
    declared, plant = loads(1.0, BOTH), known.shrunk
    corners = declared.family.values(np.array([[1.0, 0.0], [1.0, 1.0]]))
    # The corner itself, off by as much as points are kept off the faces of the cube.
    np.testing.assert_allclose(known.values, [3.0, np.sign(known.values[1])], rtol=1e-15)
    truth = evaluate(declared, "lqr", corners)["relative"].min()
    assert known.relative == pytest.approx(truth, rel=1e-12)
    assert known.relative == relative(declared, *known.values) == known.search
    assert known.search < min(known.random, known.samples)
    assert (known.fails, known.winner, known.evaluations) == (True, "search", 256)
    # The shrunk plant fails; one that is nearer by 1/256 of the line from the worst passes.
    assert plant is not None
    assert known.shrunk_relative == relative(declared, *plant) < 0
    nominal = declared.family.nominal
    line = np.where(plant != nominal, known.values - nominal, 0.0)
    assert line.any()
    assert relative(declared, *(plant - line / 256)) >= 0
    # Numbers that play no part are made nominal.
    phase = uncertain('disturbance = "hum"', 'phase = ["0 rad", "1 rad"]')
    declared = loads(3.4, BOTH.replace("[1, 3]", "[1, 1.01]") + phase)
    mass, load, hum = shrunk(declared, "lqr", np.array([1.01, 1.0, 0.5]))
    assert (mass, hum) == (1.0, 0.0)
    assert 0 < load <= 1.0


def test_samples_and_random_plants_compete_with_it(known: Worst, monkeypatch: Patch) -> None:
    declared = loads(1.0, BOTH)
    plants = declared.family.values(random_points(2, 1, 0, 256)), declared.values(range(8))
    random, samples = (evaluate(declared, "lqr", own)["relative"].min() for own in plants)
    assert (known.random, known.samples) == (random, samples)

    def lazy(search: Any, bounds: Any, **_options: Any) -> None:
        """Four looks at the middle of the family alone."""
        search(np.full((len(bounds), 256), 0.5))

    monkeypatch.setattr(worst_module, "differential_evolution", lazy)
    lost = worst(declared, "lqr", list(range(8)), 256)
    assert lost.search == relative(declared, 2.0, 0.0) > lost.random
    margin, winner = min((samples, "samples"), (random, "random"))
    assert (lost.winner, lost.relative) == (winner, margin)
    document = worst_document(declared, [lost])["controllers"]["lqr"]
    assert (document["worst_by"], document["worst_of_the_search"]) == (winner, lost.search)
    assert document["worst_of_as_many_random_plants"] == random


def test_of_runs_that_end_early_the_earlier_is_worse_and_a_margin_of_zero_is_kept() -> None:
    declared = campaign(small.falling().specification.text, runs=16, duration=0.05)
    # A run that ends at 37 ms, and one that ends later, which is not seen here.
    search = worst(declared, "fl-lqr", [11, 10], 128)
    corners = declared.family.values(declared.family.corners(4))
    # A corner: farthest from upright, and fastest away from it.
    ended = [evaluate(declared, "fl-lqr", of)["ended"] for of in (search.values[None], corners)]
    assert ended[0] == ended[1].min() < 0.037
    assert search.relative == -np.inf
    # The rotor starts 1 rad away and moves towards its goal.
    limit = '[[requirement]]\nstays_within = "1 rad"\n'
    declared = campaign(servo(AMPLITUDE, laws=LQR, limits=limit))
    search = worst(declared, "lqr", [0], 128)
    assert (search.relative, search.fails, search.shrunk, search.changed) == (0.0, False, None, ())
    assert worst_document(declared, [search])["controllers"]["lqr"]["shrunk"] is None
    # With three times the load, some of it drives the rotor away.
    assert radius(declared, "lqr").found > 1


# The load that stays leaves an error in proportion: above 2 % of the step the rotor never settles.
STAYS = small.PUSH + 'profile = "constant"\n'


def test_of_plants_that_never_settle_the_largest_error_left_is_the_worst(tmp_path: Path) -> None:
    settles = '[[requirement]]\nsettles_within = "2 s"\n'
    text = small.case("servo", AMPLITUDE, duration=4.0, laws=LQR, disturbances=STAYS + settles)
    text = text.replace('"1 ms"', '"10 ms"\ntimestep = "10 ms"')
    declared = campaign(text, runs=32, shard=32)
    rows = evaluate(declared, "lqr", declared.values(range(32)))
    never = np.flatnonzero(rows["relative"] == -1)
    assert len(never) > 16, "as a time the margin of most is the same"
    # A campaign names those with the most first; the search begins with those that have the least.
    rising = never[np.abs(declared.values(range(32))[never, 0]).argsort()].tolist()
    named = findings(declared, small.kept(declared, tmp_path)).worst["lqr"]
    assert named == rows["order"].argsort(kind="stable")[:16].tolist()
    assert named[0] == rising[-1]
    search = worst(declared, "lqr", rising[:8], 128)
    assert np.abs(search.values[0]) > 0.999
    assert search.relative == search.samples == -1, "as a time it is no worse than a sample"
    assert search.winner != "samples"
    for look in radius(campaign(text, runs=4), "lqr").trials:
        assert abs(look.values[0]) == pytest.approx(look.scale, rel=1e-12), "its end is a corner"


def test_the_radius_lies_between_a_passing_and_a_failing_scale() -> None:
    declared = loads(1.0)
    reached: Any = radius(declared, "lqr")
    # Known to 1 % of itself, or to 0.01.
    assert 0 < reached.outside.scale - reached.found <= 0.01
    assert relative(declared, *reached.outside.values) == reached.outside.least < 0
    # The load's ends are corners of the family, and the worst of it: the true radius.
    for scale, fails in ((reached.found, False), (reached.outside.scale, True)):
        assert (min(relative(declared, end) for end in (-scale, scale)) < 0) == fails
    # A law without a promise has no bound.
    assert (reached.promised.band, reached.stayed, reached.left) == (None, None, None)
    safe, failing = (radius(loads(limit), "lqr") for limit in (100.0, 1e-9))
    assert (safe.outside, safe.found, safe.largest) == (None, 8.0, 8.0)
    assert (failing.found, getattr(failing.outside, "scale", None)) == (0.0, 0.0)


def test_a_radius_is_of_the_corners_and_the_first_runs() -> None:
    options: Any
    corners = {"runs": 4, "sampler": "corners"}
    for plants, options in ((4 + 8, {"runs": 8}), (128, {"runs": 1000}), (4, corners)):
        assert radius(loads(1e-9, BOTH, **options), "lqr").plants == plants
    # Correlated numbers have no corners.
    declared = loads(1.0, BOTH + small.CORRELATED)
    search = radius(declared, "lqr")
    (look,) = (look for look in search.trials if look.scale == 1.0)
    own = evaluate(declared, "lqr", declared.values(range(8)))["relative"]
    # Scaling by 1 rounds values.
    assert look.least == pytest.approx(own.min(), rel=1e-12)
    assert (look.failures, search.plants) == (np.count_nonzero(own < 0), 8)


def test_s_leaves_its_bound_beyond_the_promise_and_between_two_scales() -> None:
    declared = loads(3, laws=GROSMC)
    # Requirements that are stricter or looser are another failure.
    searches: Any = [radius(loads(limit, laws=GROSMC), "grosmc") for limit in (3, 0.5, 1000)]
    (reached, strict, loose), p = searches, declared.laws["grosmc"].parameters
    band, stayed, left = reached.promised.band, reached.stayed, reached.left
    # Of a linear plant rho is largest at the corner of the region, |z| of (1.2, 1.2); |s| grows by
    # switching in a sample.
    rho = p.switching.gain * (p.eta + (p.gamma0 + p.gamma1 * np.hypot(1.2, 1.2)) * p.size_of_GB)
    assert band == pytest.approx(2 * 1e-3 * rho, rel=1e-12)
    assert reached.promised.scale <= stayed
    assert 0 < left.scale - stayed <= max(0.01, 0.01 * stayed)
    # The load's ends are the worst of the family.
    for scale, leaves in ((stayed, False), (left.scale, True)):
        rows = evaluate(declared, "grosmc", np.array([[-scale], [scale]]))
        assert ((rows["max_sliding"] - rows["sliding_start"]).max() > band) == leaves
    own = evaluate(declared, "grosmc", left.leaver[None])["max_sliding"][0]
    assert own / band == pytest.approx(left.surface, rel=1e-12)
    assert (loose.outside, strict.outside.scale < left.scale) == (None, True)
    scales = [search.left.scale for search in (strict, loose)]
    assert scales == pytest.approx([left.scale] * 2, rel=0.02, abs=0.02)


def test_failures_of_requirements_and_of_the_surface_are_kept_apart() -> None:
    looks = tuple(
        ScaleTrial(scale, 0.0, failures, np.zeros(1), 0.5, leaving, np.zeros(1))
        for scale, failures, leaving in ((0.0, 0, 0), (0.5, 1, 0), (1.0, 1, 2))
    )
    both = Radius("grosmc", 8, looks, Promise(0.4, "", 0.1), 8.0)
    assert (both.found, both.stayed, both.outside, both.left) == (0.0, 0.5, looks[1], looks[2])
    # A law whose surface is not zero at the start may keep that; a run may end early.
    runs: Any = {"max_sliding": np.array([1.5, np.nan]), "sliding_start": np.array([1.0, 1.0])}
    assert _growth(runs, 0.25).tolist() == [2.0, np.inf]


def test_premises_say_why_they_promise_nothing() -> None:
    no_end = '{ distribution = "normal", mean = 2, deviation = 1, least = 1 }'
    for table, why in (
        (uncertain('joint = "shaft"', "damping = [0, 1]"), "have no damping, so shaft damping"),
        (INERTIA.replace("[1, 3]", no_end), "the uncertainty has no end"),
    ):
        empty = promise(campaign(small.case("servo", table, laws=LAWS)), "grosmc")
        assert empty.scale is None
        assert why in empty.note


def premises_of(tables: str) -> PromisedFamily:
    """Those of GROSMC over a family of servos, under the load and 0.1 N m of hum."""
    return PromisedFamily.of(campaign(servo(tables)), "grosmc")


def test_wrenches_on_a_body_add_up_at_the_largest_magnitude_of_each(tmp_path: Path) -> None:
    for spread in ("[-3, 1]", "[1, 3]"):
        premises = premises_of(AMPLITUDE.replace("[-1, 1]", spread))
        for scale in (0.0, 0.5, 1.0):
            torque = pytest.approx(3 * scale + 0.1)
            assert premises.amplitude(scale).tolist() == [0, 0, 0, 0, torque, 0]
    # A profile of one's own may exceed 1.
    (tmp_path / "squall.py").write_text("def squall(t):\n    return -5.0 if t > 0.01 else 1.0\n")
    push = STAYS.replace("1 N m", "2 N m").replace("constant", "squall:squall")
    text = small.case("servo", AMPLITUDE.replace("-1, 1", "-1, 3"), laws=LAWS, disturbances=push)
    premises = PromisedFamily.of(campaign(text, folder=str(tmp_path)), "grosmc")
    assert premises.amplitude(0.5)[4] == pytest.approx(0.5 * 3 * 2 * 5, rel=1e-15)


def test_a_promise_ends_where_starts_leave_the_operating_region(monkeypatch: Patch) -> None:
    start = uncertain('start = "rotor angle"', 'value = ["0 rad", "2 rad"]')
    # The reference is 1 rad: z1 = q - 1 reaches the region's 1.2 rad at 1.1 of the uncertainty.
    partial: Any = promise(campaign(servo(start)), "grosmc")
    # By bisection to 1 %, from below.
    assert 1.1 / 1.01 < partial.scale <= 1.1
    assert partial.note.endswith("beyond it starts leave that region")
    # Where the nominal plant alone keeps the premises nothing is promised.
    monkeypatch.setattr(PromisedFamily, "holds", lambda _self, scale: scale == 0.0)
    assert premises_of(AMPLITUDE).reach()[0] == 0.0

"""The worst plant, the radius and the premises' promise, where the answer is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_cases import (
    AMPLITUDE,
    BOTH,
    DEVIATION,
    INERTIA,
    LAWS,
    LQR,
    campaign,
    case,
    falling,
    kept,
    servo,
    uncertain,
)

from grosmc_mj.arrays import Array
from grosmc_mj.sweep import radius as radius_module
from grosmc_mj.sweep import worst as worst_module
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.family import unit_points
from grosmc_mj.sweep.findings import findings
from grosmc_mj.sweep.promise import Promise, PromisedFamily, premise_grid, promise
from grosmc_mj.sweep.radius import Look, Radius, radius
from grosmc_mj.sweep.runs import Outcomes
from grosmc_mj.sweep.screening import evaluate, screened_search
from grosmc_mj.sweep.worst import Worst, shrunk, worst, worst_document

# The rotor obeys linear equations: its deviation grows with the load, either way, and with the
# inertia's distance from the nominal one.
LIMIT = DEVIATION.replace("3 mrad", "{} mrad")
CORRELATED = """
[[correlation]]
between = ["rotor mass scale", "load amplitude"]
coefficient = 0.5
"""


def loads(limit: float, tables: str = AMPLITUDE, **more: Any) -> Campaign:
    """A family of which the worst plants have the largest load and inertia."""
    return campaign(servo(tables, laws=LQR, limits=LIMIT.format(limit)), **more)


def relative(declared: Campaign, *values: float) -> float:
    """The least margin of one plant under LQR."""
    return float(evaluate(declared, "lqr", np.array([values]))["relative"][0])


# The worst plant.


@pytest.fixture(scope="module")
def known() -> Worst:
    """The worst plant of a family in which the load fails at a fraction of its range."""
    return worst(loads(1.0, BOTH), "lqr", list(range(8)), 256)


def test_the_search_finds_the_known_worst_plant(known: Worst) -> None:
    declared = loads(1.0, BOTH)
    corners = declared.family.values(np.array([[1.0, 0.0], [1.0, 1.0]]))
    # The corner itself, off by as much as points are kept off the faces of the cube.
    np.testing.assert_allclose(known.values, [3.0, np.sign(known.values[1])], rtol=1e-15)
    truth = evaluate(declared, "lqr", corners)["relative"].min()
    assert known.relative == pytest.approx(truth, rel=1e-12)
    assert known.relative == relative(declared, *known.values) == known.search
    assert known.search < min(known.random, known.samples)
    assert (known.fails, known.winner, known.evaluations) == (True, "search", 256)


def test_samples_and_random_plants_compete_with_the_search(
    known: Worst, monkeypatch: pytest.MonkeyPatch
) -> None:
    declared = loads(1.0, BOTH)
    points = unit_points("random", 2, declared.specification.seed + 1, 0, 256)
    random = evaluate(declared, "lqr", declared.family.values(points))["relative"].min()
    samples = evaluate(declared, "lqr", declared.values(range(8)))["relative"].min()
    assert (known.random, known.samples) == (random, samples)

    def lazy(search: Any, bounds: Any, **_options: Any) -> None:
        """A search that looks at the middle of the family alone."""
        for _ in range(4):
            search(np.full((len(bounds), 64), 0.5))

    monkeypatch.setattr(worst_module, "differential_evolution", lazy)
    lost = worst(declared, "lqr", list(range(8)), 256)
    assert lost.search == relative(declared, 2.0, 0.0) > lost.random
    margin, winner = min((samples, "samples"), (random, "random"))
    assert (lost.winner, lost.relative) == (winner, margin)
    document = worst_document(declared, [lost])["controllers"]["lqr"]
    names = ("worst_by", "worst_of_the_search", "worst_of_as_many_random_plants")
    assert [document[name] for name in names] == [winner, lost.search, random]


def test_the_shrunk_plant_fails_and_is_next_to_one_that_does_not(known: Worst) -> None:
    declared, small = loads(1.0, BOTH), known.shrunk
    assert small is not None
    assert known.shrunk_relative == relative(declared, *small) < 0
    # A plant that is nearer by 1/256 of the way from the worst passes.
    nominal = declared.family.nominal
    line = np.where(small != nominal, known.values - nominal, 0.0)
    assert line.any()
    assert relative(declared, *(small - line / 256)) >= 0


def test_numbers_that_play_no_part_are_made_nominal() -> None:
    phase = uncertain('disturbance = "hum"', 'phase = ["0 rad", "1 rad"]')
    declared = loads(3.4, BOTH.replace("[1, 3]", "[1, 1.01]") + phase)
    small = shrunk(declared, "lqr", np.array([1.01, 1.0, 0.5]))
    assert small[[0, 2]].tolist() == [1.0, 0.0]
    assert 0 < small[1] <= 1.0


def test_where_nothing_fails_there_is_nothing_to_shrink() -> None:
    safe = worst(loads(100.0), "lqr", [0, 1], 128)
    assert (safe.fails, safe.shrunk, safe.changed) == (False, None, ())
    assert worst_document(loads(100.0), [safe])["controllers"]["lqr"]["shrunk"] is None


def test_of_runs_that_end_early_the_earlier_is_worse() -> None:
    declared = campaign(falling().specification.text, runs=16, duration=0.05)
    # A run that ends at 37 ms, and one that ends later, which is not seen here.
    search = worst(declared, "fl-lqr", [11, 10], 128)
    family = declared.family
    corners = evaluate(declared, "fl-lqr", family.values(family.corners(4)))["ended"]
    ended = evaluate(declared, "fl-lqr", np.array([search.values]))["ended"]
    # A corner: farthest from upright, and fastest away from it.
    assert ended == corners.min() < 0.037
    assert search.relative == -np.inf


def test_a_margin_of_zero_is_kept() -> None:
    # The rotor starts 1 rad away and moves towards its goal.
    limit = '[[requirement]]\nstays_within = "1 rad"\n'
    declared = campaign(servo(AMPLITUDE, laws=LQR, limits=limit))
    assert evaluate(declared, "lqr", declared.values(range(2)))["relative"].tolist() == [0.0, 0.0]
    search = worst(declared, "lqr", [0], 128)
    assert (search.relative, search.fails, search.shrunk) == (0.0, False, None)
    # With three times the load, some of it drives the rotor away.
    assert radius(declared, "lqr").found > 1


# The load that stays leaves an error in proportion: above 2 % of the step the rotor never settles.
STAYS = """
[[disturbance]]
body = "rotor"
torque = ["0 N m", "1 N m", "0 N m"]
profile = "constant"
label = "load"
"""


def test_of_plants_that_never_settle_the_one_with_the_largest_error_left_is_the_worst(
    tmp_path: Path,
) -> None:
    settles = '[[requirement]]\nsettles_within = "2 s"\n'
    text = case("servo", AMPLITUDE, duration=4.0, laws=LQR, disturbances=STAYS, limits=settles)
    text = text.replace('"1 ms"', '"10 ms"\ntimestep = "10 ms"')
    declared = campaign(text, runs=32, shard=32)
    values = declared.values(range(32))
    rows = evaluate(declared, "lqr", values)
    never = np.flatnonzero(rows["relative"] == -1)
    assert len(never) > 16, "as a time the margin of most is the same"
    # A campaign names those with the most first.
    rising = never[np.abs(values[never, 0]).argsort()].tolist()
    named = findings(declared, kept(declared, tmp_path)).worst["lqr"]
    assert named == rows["order"].argsort(kind="stable")[:16].tolist()
    assert named[0] == rising[-1]
    # The search begins with those that have the least error left.
    search = worst(declared, "lqr", rising[:8], 128)
    assert np.abs(search.values[0]) > 0.999
    assert search.relative == search.samples == -1, "as a time it is no worse than a sample"
    assert search.winner != "samples"
    for look in radius(campaign(text, runs=4), "lqr").looks:
        assert abs(look.values[0]) == pytest.approx(look.scale, rel=1e-12), "its end is a corner"


# The radius.


def test_the_radius_lies_between_a_passing_and_a_failing_scale() -> None:
    declared = loads(1.0)
    reached = radius(declared, "lqr")
    assert reached.outside is not None
    assert 0 < reached.found < reached.outside.scale
    # Known to 1 % of itself, or to 0.01.
    assert reached.outside.scale - reached.found <= 0.01
    assert relative(declared, *reached.outside.values) == reached.outside.least < 0
    # The load's ends are corners of the family, and the worst of it: the true radius.
    for scale, fails in ((reached.found, False), (reached.outside.scale, True)):
        assert (min(relative(declared, end) for end in (-scale, scale)) < 0) == fails


def test_a_family_without_failures_has_no_outside_and_a_failing_nominal_plant_no_radius() -> None:
    safe, failing = (radius(loads(limit), "lqr") for limit in (100.0, 1e-9))
    assert (safe.outside, safe.found, safe.largest) == (None, 8.0, 8.0)
    assert failing.outside is not None
    assert (failing.found, failing.outside.scale) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("more", "asked", "plants"),
    [
        ("", {"runs": 8}, 4 + 8),
        ("", {"runs": 1000}, 128),
        ("", {"runs": 4, "sampler": "corners"}, 4),
        # Correlated numbers and those without an end have no corners.
        (CORRELATED, {"runs": 8}, 8),
        (CORRELATED, {"runs": 1000}, 128),
    ],
)
def test_a_radius_is_of_the_corners_and_the_first_runs(
    more: str, asked: dict[str, Any], plants: int
) -> None:
    assert radius(loads(1e-9, BOTH + more, **asked), "lqr").plants == plants


def test_a_radius_looks_at_the_campaigns_own_runs() -> None:
    declared = loads(1.0, BOTH + CORRELATED)
    (look,) = (look for look in radius(declared, "lqr").looks if look.scale == 1.0)
    own = evaluate(declared, "lqr", declared.values(range(8)))["relative"]
    # Scaling by 1 rounds values.
    assert look.least == pytest.approx(own.min(), rel=1e-12)
    assert look.failures == np.count_nonzero(own < 0)


# Where |s| leaves its bound, which is the failure that the premises' promise is of.

GROSMC = '[[controller]]\nlaw = "grosmc"\n'


def pushed(limit: float = 3) -> Campaign:
    """Servos under a load that may grow beyond the gain's range."""
    return campaign(servo(AMPLITUDE, laws=GROSMC, limits=LIMIT.format(limit)))


@pytest.fixture(scope="module")
def reached() -> Radius:
    """How far the load may grow under GROSMC: the first failure, and |s| leaving its bound."""
    return radius(pushed(), "grosmc")


def test_the_bound_is_the_growth_of_s_by_switching_in_a_sample() -> None:
    p = pushed().laws["grosmc"].parameters
    # Of a linear plant rho is largest at the corner of the region, |z| of (1.2, 1.2).
    rho = p.switching.gain * (p.eta + (p.gamma0 + p.gamma1 * np.hypot(1.2, 1.2)) * p.size_of_GB)
    assert promise(pushed(), "grosmc").band == pytest.approx(2 * 1e-3 * rho, rel=1e-12)


def test_a_law_without_a_promise_has_no_bound() -> None:
    search = radius(loads(1.0), "lqr")
    assert (search.promised.band, search.stayed, search.left) == (None, None, None)
    assert {look.surface for look in search.looks} == {None}


def test_s_leaves_its_bound_beyond_the_promise_and_between_two_scales(reached: Radius) -> None:
    band, stayed, left = reached.promised.band, reached.stayed, reached.left
    assert band is not None
    assert stayed is not None
    assert left is not None
    assert left.leaver is not None
    assert reached.promised.scale is not None
    assert reached.promised.scale <= stayed
    assert 0 < left.scale - stayed <= max(0.01, 0.01 * stayed)
    # The load's ends are the worst of the family.
    for scale, leaves in ((stayed, False), (left.scale, True)):
        rows = evaluate(pushed(), "grosmc", np.array([[-scale], [scale]]))
        away = (rows["max_sliding"] - rows["sliding_start"]).max()
        assert (away > band) == leaves
    own = evaluate(pushed(), "grosmc", left.leaver[None])["max_sliding"][0]
    assert own / band == pytest.approx(left.surface, rel=1e-12)


def test_it_does_not_depend_on_requirements_that_are_looser_or_stricter(reached: Radius) -> None:
    strict, loose = (radius(pushed(limit), "grosmc") for limit in (0.5, 1000))
    assert strict.outside is not None
    assert loose.outside is None
    scales = [search.left.scale for search in (strict, reached, loose) if search.left]
    assert scales == pytest.approx([scales[1]] * 3, rel=0.02, abs=0.02)
    assert strict.outside.scale < scales[0]


def test_a_law_whose_surface_is_not_zero_at_the_start_may_keep_that(
    reached: Radius, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The promise is that |s| does not grow: with |s(0)| of 1 A s more, all of |s| is that more."""

    def offset(*arguments: Any) -> Outcomes:
        runs = screened_search(*arguments)
        return runs.changed(**{name: runs[name] + 1 for name in ("max_sliding", "sliding_start")})

    monkeypatch.setattr(radius_module, "screened_search", offset)
    again, band = radius(pushed(), "grosmc"), reached.promised.band
    assert band is not None
    assert band < 1.0, "an offset that is taken for growth would leave the bound"
    for own, other in zip(again.looks, reached.looks, strict=True):
        assert (own.scale, own.leaving) == (other.scale, other.leaving)
        assert own.surface == pytest.approx(other.surface, rel=1e-9, abs=1e-12)


def test_failures_of_requirements_and_of_the_surface_are_kept_apart() -> None:
    looks = tuple(
        Look(scale, 0.0, failures, np.zeros(1), 0.5, leaving, np.zeros(1))
        for scale, failures, leaving in ((0.0, 0, 0), (0.5, 1, 0), (1.0, 1, 2))
    )
    both = Radius("grosmc", 8, looks, Promise(0.4, "", 0.1), 8.0)
    assert (both.found, both.stayed) == (0.0, 0.5)
    assert (both.outside, both.left) == (looks[1], looks[2])


# The promise.


@pytest.mark.parametrize(
    ("table", "why"),
    [
        (
            uncertain('joint = "shaft"', "damping = [0, 1]"),
            "the equations have no damping, so shaft damping",
        ),
        (
            INERTIA.replace(
                "[1, 3]", '{ distribution = "normal", mean = 2, deviation = 1, least = 1 }'
            ),
            "the uncertainty has no end",
        ),
    ],
)
def test_premises_say_why_they_promise_nothing(table: str, why: str) -> None:
    empty = promise(campaign(case("servo", table, laws=LAWS)), "grosmc")
    assert empty.scale is None
    assert why in empty.note


def premises_of(tables: str) -> PromisedFamily:
    """Those of GROSMC over a family of servos, under the load and 0.1 N m of hum."""
    return PromisedFamily.of(campaign(servo(tables)), "grosmc")


def test_a_profile_of_ones_own_may_exceed_1(tmp_path: Path) -> None:
    (tmp_path / "squall.py").write_text("def squall(t):\n    return -5.0 if t > 0.01 else 1.0\n")
    push = STAYS.replace("1 N m", "2 N m").replace("constant", "squall:squall")
    text = case("servo", AMPLITUDE.replace("-1, 1", "-1, 3"), laws=LAWS, disturbances=push)
    premises = PromisedFamily.of(campaign(text, folder=str(tmp_path)), "grosmc")
    assert premises.amplitude(0.5)[4] == pytest.approx(0.5 * 3 * 2 * 5, rel=1e-15)


@pytest.mark.parametrize("spread", ["[-3, 1]", "[-1, 3]", "[-3, -1]", "[1, 3]"])
def test_wrenches_on_a_body_add_up_at_the_largest_magnitude_of_each(spread: str) -> None:
    premises = premises_of(AMPLITUDE.replace("[-1, 1]", spread))
    for scale in (0.0, 0.5, 1.0):
        torque = pytest.approx(3 * scale + 0.1)
        assert premises.amplitude(scale).tolist() == [0, 0, 0, 0, torque, 0]


def test_the_grid_of_a_premise_is_at_the_largest_wrench_and_the_worst_of_other_numbers() -> None:
    sizes = uncertain('body = "rotor"', "length_scale = [1, 1.5]")
    premises = premises_of(INERTIA + AMPLITUDE.replace("[-1, 1]", "[-2, 2]") + sizes)
    mass, load, _ = premises.campaign.family.quantities
    across, up, grid = premise_grid(premises.campaign, "grosmc", (mass, load), 2) or ((),) * 3
    assert (list(across), list(up)) == ([1, 3], [-2, 2])
    # Gains for a family three times as heavy: the heavy rotor needs more of them than the light.
    wrench = premises.amplitude(1.0)
    for column, scale in enumerate(across):
        margins = [premises.margin(np.array([scale, 0, size]), wrench) for size in (1.0, 1.5)]
        assert margins[0] != margins[1]
        assert np.asarray(grid)[:, column].tolist() == [min(margins)] * 2


def test_a_promise_ends_where_starts_leave_the_operating_region() -> None:
    start = uncertain('start = "rotor angle"', 'value = ["0 rad", "2 rad"]')
    # The reference is 1 rad: z1 = q - 1 reaches the region's 1.2 rad at 1.1 of the uncertainty.
    partial = promise(campaign(servo(start)), "grosmc")
    assert partial.scale is not None
    # By bisection to 1 %, from below.
    assert 1.1 / 1.01 < partial.scale <= 1.1
    assert partial.note.endswith("beyond it starts leave that region")


def test_a_family_of_which_the_nominal_plant_alone_keeps_the_premises_is_promised_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(PromisedFamily, "holds", lambda _self, scale: scale == 0.0)
    assert premises_of(AMPLITUDE).reach()[0] == 0.0


@pytest.mark.slow
def test_the_declared_family_is_promised_with_the_reaching_rate_to_spare() -> None:
    declared = Campaign.load("servo", runs=8, controllers=("grosmc",))
    premises = PromisedFamily.of(declared, "grosmc")
    # Gains that are computed for the family leave eta, the reaching rate, at its edge...
    wrench: Array = premises.amplitude(1.0)
    margins = [premises.margin(corner, wrench) for corner in premises.corners(1.0)]
    eta = declared.laws["grosmc"].parameters.eta
    assert min(margins) == pytest.approx(eta, rel=1e-9)
    # ... and the promise, which needs margins above zero, reaches a little beyond it.
    scale = promise(declared, "grosmc").scale
    assert scale is not None
    assert 1.0 <= scale <= 1.1
    assert premises.holds(scale)
    assert not premises.holds(scale * 1.01)

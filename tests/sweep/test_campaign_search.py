"""The worst plant, the radius and the premises' promise, where the answer is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_cases import AMPLITUDE, BOTH, INERTIA, LAWS, LQR, campaign, case, falling, kept, servo
from rich.console import Console

from grosmc_mj.errors import SetupError
from grosmc_mj.results.document import json_text
from grosmc_mj.sweep import worst as worst_module
from grosmc_mj.sweep.campaign import Campaign, specification_of
from grosmc_mj.sweep.family import unit_points
from grosmc_mj.sweep.findings import findings
from grosmc_mj.sweep.promise import PromisedFamily, premise_grid, promise
from grosmc_mj.sweep.radius import Radius, radius, radius_document
from grosmc_mj.sweep.replay import searched_values
from grosmc_mj.sweep.screening import evaluate
from grosmc_mj.sweep.worst import Worst, shrunk, worst, worst_document, worst_table

# The rotor obeys linear equations: its deviation grows with the load, either way, and with the
# inertia's distance from the nominal one.
CORRELATED = """
[[correlation]]
between = ["rotor mass scale", "load amplitude"]
coefficient = 0.5
"""
LIMIT = '[[requirement]]\ndeviation_below = "{} mrad"\n'


def loads(limit: float, uncertain: str = AMPLITUDE) -> Campaign:
    """A family of which the worst plants have the largest load and inertia."""
    return campaign(servo(uncertain, laws=LQR, limits=LIMIT.format(limit)))


def relative(asked: Campaign, *values: float) -> float:
    """The least margin of one plant under LQR."""
    return float(evaluate(asked, "lqr", np.array([values]))["relative"][0])


@pytest.fixture(scope="module")
def known() -> Worst:
    """The worst plant of a family in which the load fails at a fraction of its range."""
    return worst(loads(1.0, BOTH), "lqr", list(range(8)), 256)


def test_the_search_finds_the_known_worst_plant(known: Worst) -> None:
    asked = loads(1.0, BOTH)
    corners = asked.family.values(np.array([[1.0, 0.0], [1.0, 1.0]]))
    truth = evaluate(asked, "lqr", corners)["relative"].min()
    assert known.fails
    # The corner itself, off by what keeps points off the faces of the cube.
    np.testing.assert_allclose(known.values, [3.0, np.sign(known.values[1])], rtol=1e-15)
    assert known.relative == pytest.approx(truth, rel=1e-12)
    assert known.relative == relative(asked, *known.values)
    assert known.relative == known.search < min(known.random, known.samples)
    assert known.winner == "search"
    assert known.evaluations == 256


def margins_of_random_plants(asked: Campaign, runs: int) -> np.ndarray:
    """Those that the search competes with, by MuJoCo."""
    points = unit_points(
        "random", len(asked.family.quantities), asked.specification.seed + 1, 0, runs
    )
    return evaluate(asked, "lqr", asked.family.values(points))["relative"]


def test_all_sides_are_told_and_who_won(known: Worst, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = loads(1.0, BOTH)
    assert known.random == margins_of_random_plants(asked, 256).min()
    own = evaluate(asked, "lqr", asked.values(range(8)))["relative"]
    assert known.samples == own.min()

    def lazy(search: Any, bounds: Any, **_options: Any) -> None:
        """A search that looks at the middle of the family alone."""
        for _ in range(4):
            search(np.full((len(bounds), 64), 0.5))

    monkeypatch.setattr(worst_module, "differential_evolution", lazy)
    lost = worst(asked, "lqr", list(range(8)), 256)
    assert lost.search == relative(asked, 2.0, 0.0) > lost.random
    winner, margin = min((("samples", own.min()), ("random", known.random)), key=lambda x: x[1])
    assert (lost.winner, lost.relative) == (winner, margin)
    text = Console(width=100, color_system=None)
    with text.capture() as shown:
        text.print(worst_table(asked, [known, lost]))
    said = " ".join(shown.get().split())
    assert "worst by" in said
    assert f" search rotor mass scale {known.values[0]:.4g}" in said.replace("  ", " ")
    assert f" {winner} " in said
    document = worst_document(asked, [lost])["controllers"]["lqr"]
    assert document["worst_by"] == winner
    assert document["worst_of_the_search"] == lost.search
    assert document["worst_of_as_many_random_plants"] == known.random


def test_the_shrunk_plant_fails_and_is_next_to_one_that_does_not(known: Worst) -> None:
    asked = loads(1.0, BOTH)
    assert known.shrunk is not None
    assert known.shrunk_relative == relative(asked, *known.shrunk)
    assert known.shrunk_relative is not None
    assert known.shrunk_relative < 0
    # By bisection to 1/256 of the way from the worst: a plant that is so much nearer passes.
    nominal = asked.family.nominal
    moved = (known.shrunk != nominal).astype(float)
    assert 1 <= moved.sum() <= 2
    whole = np.where(moved, known.values - nominal, 0.0)
    nearer = known.shrunk - whole / 256
    assert relative(asked, *nearer) >= 0


def test_numbers_that_play_no_part_are_made_nominal() -> None:
    uncertain = BOTH + '[[uncertain]]\ndisturbance = "hum"\nphase = ["0 rad", "1 rad"]\n'
    asked = loads(3.4, uncertain.replace("[1, 3]", "[1, 1.01]"))
    small = shrunk(asked, "lqr", np.array([1.01, 1.0, 0.5]))
    assert small[0] == 1.0
    assert small[2] == 0.0
    assert 0 < small[1] <= 1.0


def test_where_nothing_fails_there_is_nothing_to_shrink() -> None:
    found = worst(loads(100.0), "lqr", [0, 1], 128)
    assert not found.fails
    assert found.shrunk is None
    assert found.changed == ()
    document = worst_document(loads(100.0), [found])
    assert document["controllers"]["lqr"]["shrunk"] is None


def test_of_runs_that_end_early_the_earlier_is_worse() -> None:
    asked = campaign(falling().specification.text, runs=16, duration=0.05)
    # A run that ends at 37 ms, and one that ends later, which is not seen here.
    found = worst(asked, "fl-lqr", [11, 10], 128)
    family = asked.family
    corners = evaluate(asked, "fl-lqr", family.values(family.corners(4)))["ended"]
    ended = evaluate(asked, "fl-lqr", np.array([found.values]))["ended"]
    # A corner: farthest from upright, and fastest away from it.
    assert ended == corners.min() < 0.037
    assert found.relative == -np.inf


def test_a_margin_of_zero_is_kept() -> None:
    # The rotor starts 1 rad away and moves towards its goal.
    limit = '[[requirement]]\nstays_within = "1 rad"\n'
    asked = campaign(servo(AMPLITUDE, laws=LQR, limits=limit))
    found = evaluate(asked, "lqr", asked.values(range(2)))
    assert found["relative"].tolist() == [0.0, 0.0]
    worst_one = worst(asked, "lqr", [0], 128)
    assert (worst_one.relative, worst_one.fails, worst_one.shrunk) == (0.0, False, None)
    # With three times the load, some of it drives the rotor away.
    assert radius(asked, "lqr").found > 1


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
    asked = campaign(
        case(
            "servo", AMPLITUDE, duration=4.0, laws=LQR, disturbances=STAYS,
            limits='[[requirement]]\nsettles_within = "2 s"\n',
        ),
        runs=64, shard=64,
    )  # fmt: skip
    values = asked.values(range(64))
    found = evaluate(asked, "lqr", values)
    never = np.flatnonzero(found["relative"] == -1)
    assert len(never) > 32, "as a time the margin of most is the same"
    # The search begins with those that have the least error left.
    rising = never[np.abs(values[never, 0]).argsort()].tolist()
    begun = worst(asked, "lqr", rising[:16], 128)
    assert np.abs(begun.values[0]) > 0.999
    assert begun.relative == begun.samples == -1, "as a time it is no worse than a sample"
    assert begun.winner != "samples"
    assert begun.evaluations <= 128
    # A campaign names those with the most first.
    named = findings(asked, kept(asked, tmp_path), 0.95).worst["lqr"]
    assert named == found["order"].argsort(kind="stable")[:16].tolist()
    assert named[0] == rising[-1]
    assert np.abs(values[named, 0]).min() > np.median(np.abs(values[:, 0]))
    reached = radius(asked, "lqr")
    for look in reached.looks:
        assert abs(look.values[0]) == pytest.approx(look.scale, rel=1e-12), "its end is a corner"


@pytest.fixture(scope="module")
def reached() -> Radius:
    """How far the load may grow until LQR deviates by 1 mrad."""
    return radius(loads(1.0), "lqr")


def test_the_radius_lies_between_a_passing_and_a_failing_scale(reached: Radius) -> None:
    asked = loads(1.0)
    assert reached.outside is not None
    assert 0 < reached.found < reached.outside.scale
    # Known to 1 % of itself, or to 0.01.
    assert reached.outside.scale - reached.found <= 0.01
    assert relative(asked, *reached.outside.values) == reached.outside.least < 0
    # The load's ends are corners of the family, and the worst of it: the true radius.
    for scale, fails in ((reached.found, False), (reached.outside.scale, True)):
        ends = [relative(asked, end) for end in (-scale, scale)]
        assert (min(ends) < 0) == fails


def test_a_family_without_failures_has_no_outside() -> None:
    found = radius(loads(100.0), "lqr")
    assert found.outside is None
    assert found.found == found.largest == 8.0


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
    failing = campaign(servo(BOTH, laws=LQR, limits=LIMIT.format(1e-9)) + more, **asked)
    assert radius(failing, "lqr").plants == plants


def test_a_radius_looks_at_the_campaigns_own_runs() -> None:
    asked = campaign(servo(BOTH, laws=LQR, limits=LIMIT.format(1.0)) + CORRELATED)
    declared = next(look for look in radius(asked, "lqr").looks if look.scale == 1.0)
    own = evaluate(asked, "lqr", asked.values(range(8)))["relative"]
    # Scaling by 1 rounds values.
    assert declared.least == pytest.approx(own.min(), rel=1e-12)
    assert declared.failures == np.count_nonzero(own < 0)


def test_a_nominal_plant_that_fails_has_radius_zero() -> None:
    found = radius(loads(1e-9), "lqr")
    assert found.found == 0.0
    assert found.outside is not None
    assert found.outside.scale == 0.0


def test_scales_stop_before_plants_stop_being_physical() -> None:
    smooth = '[[uncertain]]\njoint = "shaft"\ndamping = [0.005, 0.02]\nnominal = 0.01\n'
    found = radius(loads(100.0, smooth), "lqr")
    assert found.found == found.largest == pytest.approx(2.0, rel=1e-8)


def test_what_was_found_is_kept_as_json(reached: Radius, known: Worst, tmp_path: Path) -> None:
    asked = loads(1.0)
    (tmp_path / "radius.json").write_text(json_text(radius_document(asked, [reached])))
    assert reached.outside is not None
    values = searched_values(asked, tmp_path, "outside", "lqr")
    assert values.tobytes() == reached.outside.values.tobytes()
    with pytest.raises(SetupError, match=r"has no worst\.json: run the campaign with --worst"):
        searched_values(asked, tmp_path, "worst", "lqr")
    both = loads(1.0, BOTH)
    (tmp_path / "worst.json").write_text(json_text(worst_document(both, [known])))
    assert searched_values(both, tmp_path, "worst", "lqr").tobytes() == known.values.tobytes()
    with pytest.raises(SetupError, match="cannot be read: run the campaign with --worst again"):
        searched_values(both, tmp_path, "worst", "grosmc")


def asked_of(**more: Any) -> Campaign:
    """The package's own campaign of the servo."""
    return Campaign.of(specification_of("servo", runs=8, **more))


@pytest.mark.parametrize(
    ("table", "why"),
    [
        ('joint = "shaft"\ndamping = [0, 1]', "the equations have no damping, so shaft damping"),
        (
            'body = "rotor"\nmass_scale = { distribution = "normal", mean = 2, deviation = 1, '
            "least = 1 }",
            "the uncertainty has no end",
        ),
    ],
)
def test_premises_say_why_they_promise_nothing(table: str, why: str) -> None:
    text = case("servo", f"[[uncertain]]\n{table}\n", laws=LAWS)
    found = promise(campaign(text), "grosmc")
    assert found.scale is None
    assert why in found.note


def test_a_profile_of_ones_own_may_exceed_1(tmp_path: Path) -> None:
    (tmp_path / "squall.py").write_text("def squall(t):\n    return -5.0 if t > 0.01 else 1.0\n")
    push = '[[disturbance]]\nbody = "rotor"\ntorque = ["0 N m", "2 N m", "0 N m"]\nlabel = "push"\n'
    force = f'{push}profile = "squall:squall"\n[[uncertain]]\ndisturbance = "push"\n'
    text = case("servo", f"{force}amplitude = [-1, 3]\n", laws=LAWS)
    premises = PromisedFamily.of(campaign(text, folder=str(tmp_path)), "grosmc")
    assert isinstance(premises, PromisedFamily)
    assert premises.amplitude(0.5)[4] == pytest.approx(0.5 * 3 * 2 * 5, rel=1e-15)


def premises_of(uncertain: str) -> PromisedFamily:
    """Those of GROSMC over a family of servos, under the load and 0.1 N m of hum."""
    found = PromisedFamily.of(campaign(servo(uncertain)), "grosmc")
    assert isinstance(found, PromisedFamily)
    return found


@pytest.mark.parametrize("spread", ["[-3, 1]", "[-1, 3]", "[-3, -1]", "[1, 3]"])
def test_wrenches_on_a_body_add_up_at_the_largest_magnitude_of_each(spread: str) -> None:
    premises = premises_of(AMPLITUDE.replace("[-1, 1]", spread))
    assert premises.campaign.family.nominal.tolist() == [0.0]
    for scale in (0.0, 0.5, 1.0):
        torque = 3 * scale + 0.1
        assert premises.amplitude(scale).tolist() == [0, 0, 0, 0, pytest.approx(torque), 0]


def test_the_grid_of_a_premise_is_at_the_largest_wrench_and_the_worst_of_other_numbers() -> None:
    sizes = '[[uncertain]]\nbody = "rotor"\nlength_scale = [1, 1.5]\n'
    premises = premises_of(INERTIA + AMPLITUDE.replace("[-1, 1]", "[-2, 2]") + sizes)
    asked = premises.campaign
    mass, load, _ = asked.family.quantities
    found = premise_grid(asked, "grosmc", (mass, load), 2)
    assert found is not None
    across, up, grid = found
    assert (across.tolist(), up.tolist()) == ([1, 3], [-2, 2])
    # Gains for a family three times as heavy: the heavy rotor needs more of them than the light.
    wrench = premises.amplitude(1.0)
    for column, scale in enumerate(across):
        margins = [premises.margin(np.array([scale, 0, size]), wrench) for size in (1.0, 1.5)]
        assert margins[0] != margins[1]
        assert grid[:, column].tolist() == [min(margins)] * 2


def test_a_promise_ends_where_starts_leave_the_operating_region() -> None:
    start = '[[uncertain]]\nstart = "rotor angle"\nvalue = ["0 rad", "2 rad"]\n'
    premises = premises_of(start)
    # The reference is 1 rad: z1 = q - 1 reaches the region's 1.2 rad at 1.1 of the uncertainty.
    assert premises.bound == (1.2, 1.2)
    assert [premises.starts_inside(scale) for scale in (0.0, 1.099, 1.101)] == [True, True, False]
    found = promise(premises.campaign, "grosmc")
    assert found.scale is not None
    # By bisection to 1 %, from below.
    assert 1.1 / 1.01 < found.scale <= 1.1
    assert found.note.endswith("beyond it starts leave that region")


def test_what_the_nominal_plant_alone_keeps_promises_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    premises = premises_of(AMPLITUDE)
    monkeypatch.setattr(PromisedFamily, "holds", lambda _self, scale: scale == 0.0)
    assert premises.reach()[0] == 0.0


@pytest.mark.slow
def test_the_declared_family_is_promised_with_the_reaching_rate_to_spare() -> None:
    asked = asked_of(controllers=("grosmc",))
    premises = PromisedFamily.of(asked, "grosmc")
    assert isinstance(premises, PromisedFamily)
    # Gains that are computed for the family leave eta, the reaching rate, at its edge...
    eta = asked.laws["grosmc"].parameters.eta
    amplitude = premises.amplitude(1.0)
    margins = [premises.margin(corner, amplitude) for corner in premises.corners(1.0)]
    assert min(margins) == pytest.approx(eta, rel=1e-9)
    # ... and what carries the promise, margins above zero, a little beyond it.
    found = promise(asked, "grosmc")
    assert found.scale is not None
    assert 1.0 <= found.scale <= 1.1
    assert premises.holds(found.scale)
    assert not premises.holds(found.scale * 1.01)

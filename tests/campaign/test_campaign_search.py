"""The worst plant, the radius and the premises' promise, where the answer is known."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_cases import AMPLITUDE, BOTH, LAWS, LQR, campaign, case, servo

from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.specification import specification_of
from grosmc_mj.campaign.findings.promise import PromisedFamily, promise
from grosmc_mj.campaign.findings.radius import Radius, radius
from grosmc_mj.campaign.findings.worst import Worst, shrunk, worst
from grosmc_mj.campaign.report.document import found_values, radius_document, worst_document
from grosmc_mj.campaign.runs.shard import evaluate
from grosmc_mj.errors import ArgumentError, SetupError

# The rotor obeys linear equations: its deviation grows with the load, either way, and with the
# inertia's distance from the nominal one.
LIMIT = '[[requirement]]\ndeviation_below = "{} mrad"\n'


def loads(limit: float, uncertain: str = AMPLITUDE) -> Campaign:
    """A family of which the worst plants have the largest load and inertia."""
    return campaign(servo(uncertain, laws=LQR, limits=LIMIT.format(limit)))


def relative(asked: Campaign, *values: float) -> float:
    """The least margin of one plant under LQR."""
    return float(evaluate(asked, "lqr", np.array([values])).relative[0])


@pytest.fixture(scope="module")
def known() -> Worst:
    """The worst plant of a family in which the load fails at a fraction of its range."""
    return worst(loads(1.0, BOTH), "lqr", list(range(8)), 256)


def test_the_search_finds_the_known_worst_plant(known: Worst) -> None:
    asked = loads(1.0, BOTH)
    corners = asked.family.values(np.array([[1.0, 0.0], [1.0, 1.0]]))
    truth = evaluate(asked, "lqr", corners).relative.min()
    assert known.fails
    # The corner itself, off by what keeps points off the faces of the cube.
    np.testing.assert_allclose(known.values, [3.0, np.sign(known.values[1])], rtol=1e-15)
    assert known.relative == pytest.approx(truth, rel=1e-12)
    assert known.relative == relative(asked, *known.values)
    assert known.relative <= min(known.random, known.samples)
    assert known.evaluations == 256


def test_the_shrunk_plant_fails_and_is_next_to_one_that_does_not(known: Worst) -> None:
    asked = loads(1.0, BOTH)
    assert known.shrunk is not None
    assert known.shrunk_relative == relative(asked, *known.shrunk)
    assert known.shrunk_relative is not None
    assert known.shrunk_relative < 0
    assert known.changed
    # A line of 16 points, refined once: a nearer plant at 1/256 of the way from the worst passes.
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


def test_a_search_is_the_same_each_time(known: Worst) -> None:
    again = worst(loads(1.0, BOTH), "lqr", list(range(8)), 256)
    assert again.values.tobytes() == known.values.tobytes()
    assert known.shrunk is not None
    assert again.shrunk is not None
    assert again.shrunk.tobytes() == known.shrunk.tobytes()


def test_where_nothing_fails_there_is_nothing_to_shrink() -> None:
    found = worst(loads(100.0), "lqr", [0, 1], 128)
    assert not found.fails
    assert found.shrunk is None
    assert found.changed == ()
    document = worst_document(loads(100.0), [found])
    assert document["controllers"]["lqr"]["shrunk"] is None


def test_a_search_needs_two_generations() -> None:
    with pytest.raises(ArgumentError, match="--evaluations 127 must be 128 or more"):
        worst(loads(1.0), "lqr", [0], 127)


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


def test_a_larger_limit_has_a_radius_beyond_the_declared_family() -> None:
    found = radius(loads(5.0), "lqr")
    assert found.outside is not None
    # 3.6 mrad at the whole load, and linear: found to 1 %.
    true = 5.0 / (1e3 * 5e-3 * (1 - relative(loads(5.0), 1.0)))
    assert found.found > 1
    assert found.found == pytest.approx(true, rel=0.02)


def test_a_family_without_failures_has_no_outside() -> None:
    found = radius(loads(100.0), "lqr")
    assert found.outside is None
    assert found.found == found.largest == 8.0


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
    (tmp_path / "radius.json").write_text(
        json.dumps(radius_document(asked, [reached]), allow_nan=False)
    )
    assert reached.outside is not None
    values = found_values(asked, tmp_path, "outside", "lqr")
    assert values.tobytes() == reached.outside.values.tobytes()
    with pytest.raises(SetupError, match=r"has no worst\.json: run the campaign with --worst"):
        found_values(asked, tmp_path, "worst", "lqr")
    both = loads(1.0, BOTH)
    (tmp_path / "worst.json").write_text(json.dumps(worst_document(both, [known])))
    assert found_values(both, tmp_path, "worst", "lqr").tobytes() == known.values.tobytes()
    with pytest.raises(SetupError, match="no plant was found that fails under grosmc"):
        found_values(both, tmp_path, "worst", "grosmc")


def asked_of(**more: Any) -> Campaign:
    """The package's own campaign of the servo."""
    return Campaign.of(specification_of("servo", runs=8, **more))


def test_laws_that_do_not_switch_promise_nothing() -> None:
    found = promise(asked_of(controllers=("lqr",)), "lqr")
    assert found == (None, "lqr does not switch: it promises nothing about uncertainty")


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

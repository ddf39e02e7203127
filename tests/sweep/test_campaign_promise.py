"""The premises' promise against a failure of the same thing: |s| leaving its bound."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from campaign_cases import AMPLITUDE, DEVIATION, campaign, servo

from grosmc_mj.sweep import radius as radius_module
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.promise import Promise, promise
from grosmc_mj.sweep.radius import Look, Radius, radius
from grosmc_mj.sweep.runs import Outcomes
from grosmc_mj.sweep.screening import evaluate, screened_search

GROSMC = '[[controller]]\nlaw = "grosmc"\n'


def pushed(limit: str = DEVIATION) -> Campaign:
    """Servos under a load that may grow beyond what the gain covers."""
    return campaign(servo(AMPLITUDE, laws=GROSMC, limits=limit))


@pytest.fixture(scope="module")
def reached() -> Radius:
    """How far the load may grow under GROSMC: the first failure, and |s| leaving its bound."""
    return radius(pushed(), "grosmc")


def test_the_bound_is_what_switching_makes_of_s_in_a_sample() -> None:
    asked = pushed()
    law = asked.laws["grosmc"]
    p = law.parameters
    # Of a linear plant rho is largest at the corner of the region, |z| of (1.2, 1.2).
    size = np.hypot(1.2, 1.2)
    rho = p.switching.gain * (p.eta + (p.gamma0 + p.gamma1 * size) * p.size_of_GB)
    assert promise(asked, "grosmc").band == pytest.approx(2 * 1e-3 * rho, rel=1e-12)


def test_a_law_without_a_promise_has_no_bound() -> None:
    asked = campaign(servo(AMPLITUDE))
    assert promise(asked, "lqr").band is None
    found = radius(asked, "lqr")
    assert (found.promised.band, found.stayed, found.left) == (None, None, None)
    assert {look.surface for look in found.looks} == {None}


def test_the_scale_at_which_s_leaves_lies_between_one_that_does_and_one_that_does_not(
    reached: Radius,
) -> None:
    asked = pushed()
    assert reached.promised.band is not None
    assert reached.stayed is not None
    assert reached.left is not None
    assert reached.left.leaver is not None
    assert 0 < reached.left.scale - reached.stayed <= max(0.01, 0.01 * reached.stayed)
    # The load's ends are the worst of the family.
    for scale, leaves in ((reached.stayed, False), (reached.left.scale, True)):
        ends = np.array([[-scale], [scale]])
        metrics = evaluate(asked, "grosmc", ends)
        away = (metrics["max_sliding"] - metrics["sliding_start"]).max()
        assert (away > reached.promised.band) == leaves
    own = evaluate(asked, "grosmc", reached.left.leaver[None])["max_sliding"][0]
    assert own / reached.promised.band == pytest.approx(reached.left.surface, rel=1e-12)


def test_it_does_not_depend_on_requirements_that_are_looser_or_stricter(reached: Radius) -> None:
    strict = radius(pushed(DEVIATION.replace("3 mrad", "0.5 mrad")), "grosmc")
    loose = radius(pushed(DEVIATION.replace("3 mrad", "1 rad")), "grosmc")
    assert strict.left is not None
    assert loose.left is not None
    assert reached.left is not None
    assert strict.outside is not None
    assert loose.outside is None
    scales = [each.left.scale for each in (strict, reached, loose) if each.left]
    assert scales == pytest.approx([reached.left.scale] * 3, rel=0.02, abs=0.02)
    assert strict.outside.scale < strict.left.scale


def test_a_law_whose_surface_is_not_zero_at_the_start_may_keep_that(
    reached: Radius, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The promise is that |s| does not grow: with |s(0)| of 1 A s more, all of |s| is that more."""
    band = reached.promised.band

    def offset(*arguments: Any) -> Outcomes:
        runs = screened_search(*arguments)
        columns = {name: runs[name] + 1.0 for name in ("max_sliding", "sliding_start")}
        return runs.changed(**columns)

    monkeypatch.setattr(radius_module, "screened_search", offset)
    again = radius(pushed(), "grosmc")
    assert band is not None
    assert band < 1.0, "an offset that is taken for growth would leave the bound"
    assert [look.scale for look in again.looks] == [look.scale for look in reached.looks]
    assert again.stayed == reached.stayed
    for own, other in zip(again.looks, reached.looks, strict=True):
        assert own.leaving == other.leaving
        assert own.surface == pytest.approx(other.surface, rel=1e-9, abs=1e-12)


def test_the_promise_is_kept_by_what_it_is_of(reached: Radius) -> None:
    assert reached.promised.scale is not None
    assert reached.stayed is not None
    assert reached.promised.scale <= reached.stayed


def test_failures_of_requirements_and_of_the_surface_are_told_apart() -> None:
    looks = tuple(
        Look(scale, 0.0, failures, np.zeros(1), 0.5, leaving, np.zeros(1))
        for scale, failures, leaving in ((0.0, 0, 0), (0.5, 1, 0), (1.0, 1, 2))
    )
    made = Radius("grosmc", 8, looks, Promise(0.4, "", 0.1), 8.0)
    assert (made.found, made.stayed) == (0.0, 0.5)
    assert made.outside is looks[1]
    assert made.left is looks[2]

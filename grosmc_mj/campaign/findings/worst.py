"""The worst plant of a family: searched for, and shrunk towards the nominal one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.sampling import inside, unit_points
from grosmc_mj.campaign.runs.screened import screened_search
from grosmc_mj.campaign.runs.shard import Outcomes, evaluate
from grosmc_mj.errors import ArgumentError

# Plants of one generation, and how many of the first one are the worst samples and corners: what
# leaves the cube is drawn anew inside, so that evolution nears a corner but never reaches it.
_POPULATION, _FROM_SAMPLES, _CORNERS = 64, 16, 16
# The fewest runs of a search: two generations.
LEAST = 2 * _POPULATION
# Of a run that ended at once; none that was completed comes near it.
_CUT = 1e9
# Points of one look along a line, and how often it is refined.
_LINE, _REFINED = 16, 2


@dataclass(frozen=True, eq=False)
class Worst:
    """The worst plant found for one controller.

    Attributes:
        controller: Its name.
        values: The uncertain numbers of the worst plant, (d,).
        relative: Its least margin in parts of the limit; negative if something is not kept. Of
            plants that never settle the worst has the largest error left, see ``Outcomes.order``.
        samples: The same of the worst sample that the search began with.
        random: The same of the worst of as many random plants.
        evaluations: Runs of the search, and of the random one.
        shrunk: The failing plant nearest to the nominal one that was found, (d,); None if nothing
            fails.
        shrunk_relative: Its least margin.
        changed: Names of the numbers that are not nominal in it.
    """

    controller: str
    values: Array
    relative: float
    samples: float
    random: float
    evaluations: int
    shrunk: Array | None
    shrunk_relative: float | None
    changed: tuple[str, ...]

    @property
    def fails(self) -> bool:
        """Whether it is a counterexample."""
        return self.relative < 0


def worst(
    campaign: Campaign,
    controller: str,
    ids: list[int],
    evaluations: int,
    advance: Callable[[int], object] = lambda _: None,
) -> Worst:
    """Search by differential evolution, a generation as one batch.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        ids: Its worst runs, the worst first; of more than 16, those that the search finds worst.
        evaluations: Runs that the search may take; the random one takes as many.
        advance: Called with the number of runs done.

    Raises:
        ArgumentError: If that is less than two generations.
    """
    if evaluations < LEAST:
        raise ArgumentError(f"--evaluations {evaluations} must be {LEAST} or more")
    specification, d = campaign.specification, len(campaign.family.quantities)
    samples = np.concatenate(
        [unit_points(specification.sampler, d, specification.seed, i, 1) for i in ids[:_POPULATION]]
    )
    search = _Search(campaign, controller, advance)
    rounds = evaluations // _POPULATION
    generations = rounds
    if len(samples) > _FROM_SAMPLES:
        # Their stored margins may not tell which is worst.
        samples = samples[search(samples).argsort(kind="stable")[:_FROM_SAMPLES]]
        generations -= 1
    corners = campaign.family.corners(_CORNERS)
    left = _POPULATION - len(samples) - len(corners)
    rest = unit_points("lhs", d, specification.seed + 1, 0, left)
    first: Any = np.concatenate([samples, corners, rest])
    differential_evolution(
        lambda x: search(x.T.reshape(-1, d)),
        [(0.0, 1.0)] * d,
        init=first,
        maxiter=generations - 1,
        tol=0.0,
        polish=False,
        updating="deferred",
        vectorized=True,
        rng=np.random.default_rng(specification.seed),
    )
    at_random = _Search(campaign, controller, advance)
    for first in range(0, rounds * _POPULATION, _POPULATION):
        at_random(unit_points("random", d, specification.seed + 1, first, _POPULATION))
    values = min(search, at_random, key=lambda each: each.badness).values

    def relative(tried: Array) -> float:
        found = evaluate(campaign, controller, tried)
        return float(found.relative[int(found.order.argmin())])

    found = relative(values[None])
    small = shrunk(campaign, controller, values) if found < 0 else None
    return Worst(
        controller=controller,
        values=values,
        relative=found,
        samples=relative(campaign.family.values(samples)),
        random=relative(at_random.values[None]),
        evaluations=search.runs,
        shrunk=small,
        shrunk_relative=None if small is None else relative(small[None]),
        changed=_changed(campaign, small),
    )


class _Search:
    """Unit points (n, d) to how bad each is, (n,), with the worst so far."""

    def __init__(
        self, campaign: Campaign, controller: str, advance: Callable[[int], object]
    ) -> None:
        self._campaign, self._controller, self._advance = campaign, controller, advance
        self.badness, self.values, self.runs = math.inf, np.zeros(0), 0

    def __call__(self, points: Array) -> Array:
        values = self._campaign.family.values(inside(points))
        found = _badness(screened_search(self._campaign, self._controller, values))
        least = int(found.argmin())
        if found[least] < self.badness:
            self.badness, self.values = float(found[least]), values[least]
        self.runs += len(points)
        self._advance(len(points))
        return found


def _badness(found: Outcomes) -> Array:
    """How bad each plant is, for a search: what ends early is worse, the earlier the worse."""
    return np.where(np.isneginf(found.order), -_CUT / (1 + found.ended), found.order)


def _changed(campaign: Campaign, values: Array | None) -> tuple[str, ...]:
    """Names of the numbers that are not nominal."""
    if values is None:
        return ()
    pairs = zip(campaign.family.quantities, values, strict=True)
    return tuple(each.name for each, value in pairs if value != each.nominal)


def shrunk(campaign: Campaign, controller: str, values: Array) -> Array:
    """A failing plant brought towards the nominal one as far as it fails still, (d,).

    Numbers are made nominal one by one, each time the one without which it fails worst; then all
    that are left are moved towards their nominal values together.
    """
    nominal, found = campaign.family.nominal, values.copy()

    def order(candidates: Array) -> Array:
        return screened_search(campaign, controller, candidates).order

    while len(left := np.flatnonzero(found != nominal)):
        candidates = np.tile(found, (len(left), 1))
        candidates[range(len(left)), left] = nominal[left]
        tried = order(candidates)
        if not tried.min() < 0:
            break
        found = candidates[int(tried.argmin())]
    low, high = 0.0, 1.0
    for _ in range(_REFINED):
        shares = np.linspace(low, high, _LINE + 1)
        failing = order(nominal + shares[1:, None] * (found - nominal)) < 0
        if not failing.any():
            break
        first = int(failing.argmax())
        low, high = float(shares[first]), float(shares[first + 1])
    return found if high == 1.0 else nominal + high * (found - nominal)

"""The worst plant of a family: searched for, and shrunk towards the nominal one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import differential_evolution

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.campaign import Campaign
from grosmc_mj.campaign.sampling import unit_points
from grosmc_mj.campaign.shard import evaluate
from grosmc_mj.errors import ArgumentError

# Plants of one generation, and how many of the first one are the worst samples.
_POPULATION, _FROM_SAMPLES = 64, 16
# Points of one look along a line, and how often it is refined.
_LINE, _REFINED = 16, 2

# Unit points (n, d) to how bad each is, (n,): see ``requirements.relative``.
Badness = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Worst:
    """The worst plant found for one controller.

    Attributes:
        controller: Its name.
        values: The uncertain numbers of the worst plant, (d,).
        relative: Its least margin in parts of the limit; negative if something is not kept.
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
        ids: Its worst runs, the worst first.
        evaluations: Runs that the search may take; the random one takes as many.
        advance: Called with the number of runs done.

    Raises:
        ArgumentError: If that is less than two generations.
    """
    if evaluations < 2 * _POPULATION:
        raise ArgumentError(f"--evaluations {evaluations} must be {2 * _POPULATION} or more")
    question, d = campaign.question, len(campaign.family.quantities)
    best: list[tuple[float, Array]] = []

    def badness(points: Array) -> Array:
        values = campaign.family.values(np.clip(points, 2.0**-53, 1 - 2.0**-53))
        found = evaluate(campaign, controller, values).relative
        least = int(found.argmin())
        if not best or found[least] < best[0][0]:
            best[:] = [(float(found[least]), values[least])]
        advance(len(points))
        return found

    samples = np.concatenate(
        [unit_points(question.sampler, d, question.seed, i, 1) for i in ids[:_FROM_SAMPLES]]
    )
    rest = unit_points("lhs", d, question.seed + 1, 0, _POPULATION - len(samples))
    first = np.concatenate([samples, rest])
    generations = evaluations // _POPULATION
    differential_evolution(
        lambda x: badness(x.T.reshape(-1, d)),
        [(0.0, 1.0)] * d,
        init=first,
        maxiter=generations - 1,
        tol=0.0,
        polish=False,
        updating="deferred",
        vectorized=True,
        rng=np.random.default_rng(question.seed),
    )
    relative, values = best[0]
    best.clear()
    spent = generations * _POPULATION
    for start in range(0, spent, _POPULATION):
        badness(unit_points("random", d, question.seed + 1, start, _POPULATION))
    random = best[0][0]
    if random < relative:
        relative, values = best[0]
    sampled = evaluate(campaign, controller, campaign.family.values(samples)).relative
    small = shrunk(campaign, controller, values) if relative < 0 else None
    return Worst(
        controller=controller,
        values=values,
        relative=relative,
        samples=float(sampled.min()),
        random=random,
        evaluations=spent,
        shrunk=None if small is None else small[0],
        shrunk_relative=None if small is None else small[1],
        changed=()
        if small is None
        else tuple(
            each.name
            for each, value in zip(campaign.family.quantities, small[0], strict=True)
            if value != each.nominal
        ),
    )


def shrunk(campaign: Campaign, controller: str, values: Array) -> tuple[Array, float]:
    """A failing plant brought towards the nominal one as far as it fails still.

    Numbers are made nominal one by one, each time the one without which it fails worst; then all
    that are left are moved towards their nominal values together.

    Returns:
        Its values, (d,), and its least margin.
    """
    nominal, found = campaign.family.nominal, values.copy()

    def failing(candidates: Array) -> tuple[Array, Array]:
        relative = evaluate(campaign, controller, candidates).relative
        return relative, np.flatnonzero(relative < 0)

    while len(left := np.flatnonzero(found != nominal)):
        candidates = np.tile(found, (len(left), 1))
        candidates[range(len(left)), left] = nominal[left]
        relative, fails = failing(candidates)
        if not len(fails):
            break
        found = candidates[fails[relative[fails].argmin()]]
    low, high = 0.0, 1.0
    for _ in range(_REFINED):
        shares = np.linspace(low, high, _LINE + 1)[1:]
        _, fails = failing(nominal + shares[:, None] * (found - nominal))
        if not len(fails):
            break
        high = float(shares[fails[0]])
        low = float(shares[fails[0] - 1]) if fails[0] else low
    if high < 1:
        found = nominal + high * (found - nominal)
    return found, float(failing(found[None])[0][0])

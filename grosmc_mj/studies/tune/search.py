"""Search for the least value of a function that costs many runs: pure mathematics.

Differential evolution of whole populations (R. Storn and K. Price, 1997), then COBYQA from the best
point (T. M. Ragonneau and Z. Zhang, 2023), both scipy's; from new populations, until the target is
reached or the runs are spent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution, minimize
from scipy.stats import qmc

from grosmc_mj.ground.arrays import Array

# Members of a population: so many for each coordinate, and at least so many.
_PER_COORDINATE = 4
_LEAST_MEMBERS = 12
# Share of the runs that are left which a population may have; the rest is for the local search.
_SHARE_OF_POPULATIONS = 0.75
# First and last trust radius of the local search, in parts of a range. Along a number of a law the
# worst of four draws jumps by a seventh of itself in steps of 1 %: less of a range tells nothing.
_FIRST_RADIUS = 0.1
_LAST_RADIUS = 0.01
# A population has converged when no coordinate spreads over more of its range.
_CONVERGED = 0.01
# The best point lies at an end of a range when it is this close, in parts of the range; of
# populations in so many in a row. The range grows to that side by this share of itself.
_END = 0.03
_PATIENCE = 5
_GROWTH = 0.5
# Generations of a population at most: more than any budget has.
_MOST_GENERATIONS = 1_000_000


class Evaluate(Protocol):
    """Function that is searched.

    Attributes:
        runs_of_point: Runs that a point costs at most.
    """

    @property
    def runs_of_point(self) -> int:
        """Runs that a point costs at most."""
        ...

    def __call__(self, points: Array, beat: Array) -> tuple[Array, int]:
        """Return the values of points, and the number of runs that they took.

        Args:
            points: (n, d).
            beat: Value that each point has to beat, (n,). Once a point is known to be worse, any
                value above it will do: a point that has lost is never a parent.

        Returns:
            Values, finite, (n,); number of runs.
        """
        ...


@dataclass
class Ranges:
    """Ranges of d coordinates, which grow where the best point lies at an end.

    Attributes:
        low: Least of each coordinate, (d,).
        high: Largest of each coordinate, (d,).
        hard_low: Bound below which no coordinate can be, (d,).
        hard_high: Bound above which no coordinate can be, (d,).
        grown: Coordinates that have grown, each with its side, -1 or 1, in the order of growth.
    """

    low: Array
    high: Array
    hard_low: Array
    hard_high: Array
    grown: list[tuple[int, int]] = field(default_factory=list)

    @property
    def size(self) -> Array:
        """Length of each range, (d,)."""
        return self.high - self.low

    def ends(self, point: Array) -> list[tuple[int, int]]:
        """Return the coordinates of a point (d,) at an end that may grow, each with its side."""
        place = (point - self.low) / self.size
        below = (place <= _END) & (self.low > self.hard_low)
        above = (place >= 1 - _END) & (self.high < self.hard_high)
        found = [(int(i), -1) for i in np.flatnonzero(below)]
        return found + [(int(i), 1) for i in np.flatnonzero(above)]

    def at_end(self, point: Array) -> NDArray[np.bool_]:
        """Whether each coordinate of a point (d,) lies at an end of its range, (d,)."""
        place = (point - self.low) / self.size
        return (place <= _END) | (place >= 1 - _END)

    def grow(self, ends: Sequence[tuple[int, int]]) -> None:
        """Let ranges grow, up to their bounds."""
        growth = _GROWTH * self.size
        for i, side in ends:
            if side < 0:
                self.low[i] = max(self.low[i] - growth[i], self.hard_low[i])
            else:
                self.high[i] = min(self.high[i] + growth[i], self.hard_high[i])
            self.grown.append((i, side))


@dataclass(frozen=True)
class Best:
    """The best point so far.

    Attributes:
        value: Its value.
        point: The point, (d,).
        index: Number of the point among all.
        runs: Runs that had been made when it was found.
    """

    value: float
    point: Array
    index: int
    runs: int


class _SearchEnd(Exception):  # noqa: N818, it is no error
    """The target is reached, or the runs are spent."""


class Search:
    """Search for the least value of a function, as long as runs are left.

    Attributes:
        ranges: Ranges of the coordinates as they are now.
        runs: Runs so far.
        points: Points so far.
        history: Each point that was the best when it was found, in their order.
    """

    def __init__(
        self,
        evaluate: Evaluate,
        ranges: Ranges,
        start: Array,
        *,
        budget: int,
        target: float = -math.inf,
        seed: int = 0,
    ) -> None:
        """Begin without a run.

        Args:
            evaluate: The function.
            ranges: Ranges of the coordinates; they are changed.
            start: First member of the first population, (d,).
            budget: Runs at most.
            target: Value at which the search ends.
            seed: Seed of the populations.
        """
        self.ranges = ranges
        self.runs = 0
        self.points = 0
        self.history: list[Best] = []
        self._evaluate = evaluate
        self._start = start
        self._budget = budget
        self._target = target
        self._seed = seed

    @property
    def best(self) -> Best | None:
        """The best point so far; None before the first one."""
        return self.history[-1] if self.history else None

    @property
    def reached(self) -> bool:
        """Whether the target is reached."""
        return bool(self.history) and self.history[-1].value <= self._target

    def run(self) -> None:
        """Search until the target is reached or the runs are spent."""
        first = self._start
        number = 0
        try:
            while True:
                random = np.random.default_rng([self._seed, number])
                members = self._new_population(random, first)
                self._populations(random, members)
                self._local()
                first = None
                if self.ranges.ends(self.history[-1].point):
                    self.ranges.grow(self.ranges.ends(self.history[-1].point))
                    first = self.history[-1].point
                number += 1
        except _SearchEnd:
            return

    def values(self, points: Array, beat: Array) -> Array:
        """Return the values of points (n, d), (n,), and keep the best one.

        Raises:
            _SearchEnd: If one reaches the target, or the runs are spent.
        """
        affordable = (self._budget - self.runs) // self._evaluate.runs_of_point
        some = points[:affordable]
        if not len(some):
            raise _SearchEnd

        values, runs = self._evaluate(some, beat[:affordable])
        self.runs += runs
        self.points += len(some)
        self._keep_best(some, values)
        if self.reached or len(some) < len(points):
            raise _SearchEnd
        return values

    def _keep_best(self, points: Array, values: Array) -> None:
        best = int(values.argmin())
        if not self.history or values[best] < self.history[-1].value:
            index = self.points - len(points) + best
            self.history.append(Best(float(values[best]), points[best].copy(), index, self.runs))

    def _new_population(self, random: np.random.Generator, first: Array | None) -> Array:
        """Points that fill the ranges evenly, (n, d); the first one may be given."""
        dimension = len(self.ranges.low)
        count = max(_LEAST_MEMBERS, _PER_COORDINATE * dimension)
        cube = qmc.LatinHypercube(dimension, rng=random).random(count)
        members = self.ranges.low + cube * self.ranges.size
        if first is not None:
            members[0] = first
        return members

    def _populations(self, random: np.random.Generator, members: Array) -> None:
        """Evolve a population until it has converged or its share of the runs is spent."""
        last_run = self.runs + _SHARE_OF_POPULATIONS * (self._budget - self.runs)
        values = self.values(members, np.full(len(members), math.inf))
        while True:
            evolution = _Evolution(self, members, values, last_run)
            ends = evolution.run(random)
            if not ends:
                return
            members = evolution.members
            values = evolution.parents
            self.ranges.grow(ends)

    def _local(self) -> None:
        """Refine the best point until the trust radius is at its least."""
        best = self.history[-1].point
        low = self.ranges.low
        size = self.ranges.size

        def value(cube: Array) -> float:
            point = low + np.clip(cube, 0.0, 1.0) * size
            return float(self.values(point[None], np.array([math.inf]))[0])

        minimize(
            value,
            np.clip((best - low) / size, 0.0, 1.0),
            method="COBYQA",
            bounds=[(0.0, 1.0)] * len(best),
            options={"initial_tr_radius": _FIRST_RADIUS, "final_tr_radius": _LAST_RADIUS},
        )


class _Evolution:
    """Differential evolution of a population within ranges that do not change.

    Attributes:
        members: Population, the best first, (n, d).
        parents: Values of its members, (n,).
    """

    def __init__(self, search: Search, members: Array, values: Array, last_run: float) -> None:
        """Begin with a population.

        Args:
            search: The search.
            members: Population, (n, d).
            values: Its values, (n,).
            last_run: Number of runs at which the population ends.
        """
        order = np.argsort(values, kind="stable")
        self.members = members[order]
        self.parents = values[order]
        self._search = search
        self._last_run = last_run
        self._known = True
        # Generations in a row in which the best point lies at these ends.
        self._ends: list[tuple[int, int]] = []
        self._at_ends = 0

    def run(self, random: np.random.Generator) -> list[tuple[int, int]]:
        """Evolve the population; returns the ends of ranges that its best point lies at."""
        ranges = self._search.ranges
        # Of `init` its annotations know the texts alone.
        members: Any = self.members
        differential_evolution(
            self._energies,
            list(zip(ranges.low, ranges.high, strict=True)),
            init=members,
            rng=random,
            vectorized=True,
            updating="deferred",
            polish=False,
            maxiter=_MOST_GENERATIONS,
            # Its own test of convergence takes a plain for a valley.
            tol=0.0,
            atol=-1,
            callback=self._ended,
        )
        return self._ends if self._at_ends >= _PATIENCE else []

    def _energies(self, points: Array) -> Array:
        """Values of points (d, n), (n,); those of the first population are known."""
        if self._known:
            self._known = False
            return self.parents
        return self._search.values(points.T, self.parents)

    def _ended(self, intermediate_result: Any) -> bool:
        """Note the population after a generation; True if it ends with it."""
        self.members = np.array(intermediate_result.population)
        self.parents = np.array(intermediate_result.population_energies)

        ranges = self._search.ranges
        ends = ranges.ends(self.members[self.parents.argmin()])
        same = [end for end in ends if end in self._ends] if self._at_ends else ends
        self._at_ends = self._at_ends + 1 if same else 0
        self._ends = same

        spread = np.ptp(self.members, axis=0) / ranges.size
        converged = bool(spread.max() <= _CONVERGED)
        return converged or self._at_ends >= _PATIENCE or self._search.runs >= self._last_run

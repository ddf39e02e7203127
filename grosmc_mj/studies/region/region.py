"""Starts from which a law converges: maps of two axes to outcomes, confirmed in MuJoCo."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from typing import Annotated

import numpy as np
from pydantic import BaseModel
from scipy.ndimage import maximum_filter, minimum_filter

from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import Positive, Range, checked
from grosmc_mj.studies.region.axes import Axis, choose_axes, starts_on
from grosmc_mj.studies.region.runs import Letters, Outcome, RegionLoop, outcomes
from grosmc_mj.studies.study import Advance, Study, StudyCell, dependencies
from grosmc_mj.studies.sweep.agreement import model_mismatch
from grosmc_mj.studies.sweep.confirmation import (
    Confirmation,
    Mask,
    Rows,
    drawn_at_random,
    wrong_at_most,
)
from grosmc_mj.studies.target import Condition
from grosmc_mj.theory.plants import System

# Starts in one batch: bounds memory and the wait between two advances of the progress bar.
BATCH = 1000
# An implicit step evaluates the physics once, RK4 four times. On 256 starts of each map of the
# pendulum both give the same outcomes, but for up to two on a boundary.
INTEGRATOR = "implicitfast"


def confirmed_map(
    first: Letters, confirm: Callable[[Rows], Letters]
) -> tuple[Letters, Confirmation]:
    """Confirm every start beside another outcome, and some of the other starts.

    Outcomes by equations are confirmed in MuJoCo, those of one draw over all draws. Around a start
    that is overturned, every neighbour is confirmed too. A neighbour that had
    another outcome by the equations was beside another outcome before; one that had the same is
    beside another outcome now.

    Args:
        first: Outcomes to be confirmed, (rows, columns).
        confirm: Function that returns the true outcomes of starts by their indices in the flat
            map.

    Returns:
        The outcomes, (rows, columns), and which of them are confirmed.
    """
    letters = first.copy()
    confirmation = Confirmation(beside_another(first).ravel(), drawn_at_random(first.size))
    for starts in confirmation.rounds():
        by_physics = confirm(starts)
        confirmation.note(starts, by_physics != letters.flat[starts])
        letters.flat[starts] = by_physics
        confirmation.doubt(beside_another(letters).ravel())
    return letters, confirmation


def beside_another(letters: Letters) -> Mask:
    """Return which places have another letter among the eight around them, (rows, columns)."""
    codes = np.unique(letters, return_inverse=True)[1].reshape(letters.shape)
    largest = maximum_filter(codes, 3, mode="nearest")
    smallest = minimum_filter(codes, 3, mode="nearest")
    return largest != smallest


class CheckedStarts(BaseModel):
    """Starts of a map whose first outcome was confirmed.

    Attributes:
        confirmed: Number of them.
        overturned: Number of those with another outcome.
        drawn: Number of those that were drawn at random.
        wrong: Number of those drawn at random that have another outcome.
    """

    confirmed: int
    overturned: int
    drawn: int
    wrong: int

    @classmethod
    def of(cls, confirmation: Confirmation) -> CheckedStarts:
        """Return the counts of a confirmation."""
        return cls(
            confirmed=int(confirmation.confirmed.sum()),
            overturned=int(confirmation.overturned.sum()),
            drawn=int(confirmation.drawn.sum()),
            wrong=int((confirmation.drawn & confirmation.overturned).sum()),
        )

    @property
    def wrong_at_most(self) -> float:
        """One-sided bound on the share of wrong outcomes among starts that are not in doubt."""
        return wrong_at_most(self.drawn, self.wrong)


class RegionMap(BaseModel):
    """The outcome of every start under one law on one plant.

    Attributes:
        case: Name of the case of the plant.
        controller: Name of the law.
        rows: Letters of ``Outcome`` along the first axis, a string for each value of the second
            axis, from the lowest.
        by_equations: Starts that MuJoCo confirmed; None if it judged all.
        over_draws: Starts that were judged over draws; None where nothing is drawn.
    """

    case: str
    controller: str
    rows: list[str]
    by_equations: CheckedStarts | None = None
    over_draws: CheckedStarts | None = None

    @property
    def size(self) -> int:
        """Number of starts."""
        return sum(map(len, self.rows))

    @property
    def confirmed(self) -> int:
        """Number of starts that MuJoCo judged."""
        return self.size if self.by_equations is None else self.by_equations.confirmed

    @property
    def overturned(self) -> int:
        """Number of those for which the equations gave another outcome."""
        return 0 if self.by_equations is None else self.by_equations.overturned

    @property
    def counts(self) -> dict[Outcome, int]:
        """Number of starts with each outcome."""
        letters = Counter("".join(self.rows))
        return {outcome: letters[outcome.letter] for outcome in Outcome}

    @property
    def converged(self) -> float:
        """Share of the starts that converges [%]."""
        return 100 * self.counts[Outcome.CONVERGED] / self.size


@checked(eq=False)
class RegionStudy(Study[RegionMap]):
    """The maps of one system: every law, on the nominal and on the perturbed plant.

    Attributes:
        target: Name of the system; or an experiment, ``SYSTEM/CASE`` or the path of a case file.
        points: Starts along each axis.
        duration: Duration of each run [s].
        axes: Two states by symbol; None for the controlled position and its rate.
        limits: Largest start on each axis, in degrees or the state's unit; None for the default.
        controllers: Names of laws; none for those that ``validate`` runs.
        draws: Runs of a start where the loop draws something; all must converge.

    Raises:
        ModelError: If the system is unknown.
        ArgumentError: If a name or a number does not fit, or a start lies beyond a stop.
    """

    kind = "region"
    row = RegionMap
    unit = "maps"

    target: str
    points: Annotated[int, Range(2, 1000, whole=True)] = 100
    duration: Annotated[float, Range(0, 1000, unit="s", above=True)] = 12.0
    axes: tuple[str, str] | None = None
    limits: tuple[Positive, Positive] | None = None
    controllers: tuple[str, ...] = ()
    draws: Annotated[int, Range(1, 1000, whole=True)] = 10

    def __post_init__(self) -> None:
        """Lay out the starts at once, to refuse a mistake before the first run."""
        physics = self.experiments[1].plant("physics")
        try:
            for start in self.starts:
                physics.require_start(start)
        except ArgumentError as error:
            raise ArgumentError(f"{error}, or lower the limits of the axes") from error

    # Cached: each of these is asked for many times, and reads files, designs laws or runs a check.
    @cached_property
    def experiments(self) -> list[Experiment]:
        """The experiment with the nominal plant, and with the perturbed one."""
        perturbed = _perturbed(self.target, self.duration).changed(integrator=INTEGRATOR)
        nominal = perturbed.changed(
            name="nominal", title="nothing is changed", edits=(), disturbances=()
        )
        return [nominal, perturbed]

    # Designed once for all maps.
    @cached_property
    def loops(self) -> list[RegionLoop]:
        """The loops of the maps, every law on the nominal plant first."""
        laws = dict.fromkeys(self.controllers or self.experiments[1].controllers)
        return [RegionLoop.of(experiment, law) for experiment in self.experiments for law in laws]

    @cached_property
    def starts(self) -> Array:
        """The starts of a map row by row, (nsim, n)."""
        across, up = self.plane
        first, second = np.meshgrid(across.cells(self.points), up.cells(self.points))
        return starts_on(self.loops[0], self.plane, first.ravel(), second.ravel())

    @cached_property
    def why_not(self) -> dict[str, str]:
        """Reason for making no map of a case on equations, by its name; empty where they are."""
        reasons = {}
        for experiment in self.experiments:
            reasons[experiment.name] = model_mismatch(experiment.plant("physics"))
        return reasons

    @property
    def system(self) -> System:
        """System of the starts."""
        return self.experiments[1].nominal.system

    @property
    def plane(self) -> tuple[Axis, Axis]:
        """The two axes."""
        return choose_axes(self.loops[0], self.axes, self.limits)

    @property
    def case(self) -> Experiment:
        """The experiment with the perturbed plant."""
        return self.experiments[1]

    def cells(self) -> list[StudyCell[RegionMap]]:
        """Return a cell for each map: every law on the nominal plant first."""
        conditions = [Condition(case.name, case.title, case) for case in self.experiments]
        starts = hashlib.sha256(self.starts.tobytes()).hexdigest()
        depends_on = dependencies([starts, self.duration, self.draws, self.why_not], conditions)
        cells = []
        for loop in self.loops:
            key = (loop.experiment.name, loop.controller.name)
            cell = StudyCell("/".join(key), key, depends_on, partial(self.law_map, loop))
            cells.append(cell)
        return cells

    def law_map(self, loop: RegionLoop, advance: Advance) -> RegionMap:
        """Compute a map.

        Args:
            loop: A law on a plant.
            advance: Called after each batch with words on the progress.
        """
        case = loop.experiment
        screened = not self.why_not[case.name]
        plant = loop.plant.analytic() if screened else loop.plant
        letters = self._outcomes(replace(loop, plant=plant), self.starts, advance)
        grid = letters.reshape(self.points, -1)
        by_equations = None
        if screened:
            grid, confirmation = confirmed_map(grid, partial(self._confirm, loop))
            by_equations = CheckedStarts.of(confirmation)
        over_draws = None
        if self.draws > 1 and case.loop is not None and case.loop.drawn:
            judge_draws = partial(self._over_draws, replace(loop, plant=plant), grid)
            grid, confirmation = confirmed_map(grid, judge_draws)
            over_draws = CheckedStarts.of(confirmation)
        return RegionMap(
            case=case.name,
            controller=loop.controller.name,
            rows=["".join(row) for row in grid.tolist()],
            by_equations=by_equations,
            over_draws=over_draws,
        )

    def _confirm(self, loop: RegionLoop, chosen: Rows) -> Letters:
        """The outcomes in MuJoCo of some starts of a map."""
        return self._outcomes(loop, self.starts[chosen])

    def _over_draws(self, loop: RegionLoop, first: Letters, chosen: Rows) -> Letters:
        """The outcomes of some starts of a map over all draws.

        Args:
            loop: The law on the plant of the map.
            first: Outcomes of the first draw.
            chosen: Indices of the starts in the flat map.
        """
        letters = first.ravel()[chosen]
        converging = (letters == Outcome.CONVERGED.letter).astype(int)
        for number in range(1, self.draws):
            of_draw = self._outcomes(replace(loop, draw=number), self.starts[chosen])
            converging += of_draw == Outcome.CONVERGED.letter
        varies = (converging > 0) & (converging < self.draws)
        return np.where(varies, Outcome.VARIES.letter, letters)

    def _outcomes(
        self,
        loop: RegionLoop,
        starts: Array,
        advance: Advance = lambda _: None,
    ) -> Letters:
        """The outcome of each start, a batch at a time."""
        name = f"{loop.experiment.name}/{loop.controller.name}"
        parts = []
        for first in range(0, len(starts), BATCH):
            batch = starts[first : first + BATCH]
            parts.append(outcomes(loop, batch, self.duration))
            advance(f"{name}: {first + len(batch)} of {len(starts)} starts")
        return np.concatenate(parts)


def _is_edited(experiment: Experiment) -> bool:
    """Whether its plant is edited, and its laws regulate states, on which starts are laid out."""
    law = experiment.law("physics", experiment.controllers[0])
    return bool(experiment.edits) and law.coordinates.outputs is None


def _perturbed(target: str, duration: float) -> Experiment:
    """The experiment with the perturbed plant; of a system its first case that edits the plant.

    Raises:
        ArgumentError: If it is unknown, does not run in MuJoCo, or nothing differs from the
            nominal plant.
    """
    experiments = find_experiments(target)
    if len(experiments) > 1:
        return next(experiment for experiment in experiments if _is_edited(experiment))

    (experiment,) = experiments
    case = experiment
    if "physics" not in experiment.nominal.names:
        raise ArgumentError(f"{target}: it does not run in MuJoCo, where maps are made")
    begin = min((load.window[0] for load in case.disturbances), default=math.inf)
    if not case.edits and begin >= duration:
        why = "not changed"
        if case.disturbances:
            why = f"disturbed from {begin:g} s on"
        raise ArgumentError(
            f"{case.name} of {case.system} is the nominal plant, {why}, and a run takes "
            f"{duration:g} s: take {_edited_cases(experiment) or 'one with an edit'}"
        )
    return experiment


def _edited_cases(experiment: Experiment) -> str:
    """Names of the cases of an experiment's system that edit the plant."""
    if not experiment.nominal.shipped:
        return ""
    experiments = find_experiments(experiment.system)
    return ", ".join(edited.name for edited in experiments if _is_edited(edited))

"""From which starts a law converges: maps of two axes to outcomes, in physics."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.plants import System
from grosmc_mj.studies.region.axes import Axis, choose_axes, starts_on
from grosmc_mj.studies.region.loop import RegionLoop
from grosmc_mj.studies.region.outcome import Outcome, judge, tolerance_of

Outcomes = NDArray[np.str_]

POINTS = (2, 1000)
LONGEST = 1000.0  # s
# Starts in one batch: bounds memory and the wait between two advances of the progress bar.
BATCH = 1000
# Starts on the first axis alone, for each cell of the map along it.
_LINE = 4
# Runs are looked at after these parts of the duration; those that have been decided end there.
# Most that leave the region do so in the first look.
_LOOKS = (1 / 16, 1 / 4, 1.0)
# To count as converged before the end, errors must be within this part of their tolerances.
_EARLY = 0.25
# An implicit step evaluates the physics once, RK4 four times. On 256 starts of each map of the
# pendulum both give the same outcome but for up to two on a boundary.
REGION_SETTINGS = Settings(integrator="implicitfast")


@dataclass(frozen=True)
class RegionQuestion:
    """What maps are asked for.

    Attributes:
        system: Name of the system; or an experiment, ``SYSTEM/CASE`` or the path of a case file.
        case: The perturbed plant's case of a system; None for the first that edits the plant.
        points: Starts along each axis.
        duration: Of each run [s].
        axes: Two states by symbol; None for the controlled position and its rate.
        limits: Largest start by unit (rad, rad/s, m, m/s), where it is not the default.
        settings: Control period, timestep, integrator and switching.
        controllers: Laws by name; none for those that validate runs.
    """

    system: str
    case: str | None = None
    points: int = 100
    duration: float = 12.0
    axes: tuple[str, str] | None = None
    limits: Mapping[str, float] = field(default_factory=dict)
    settings: Settings = REGION_SETTINGS
    controllers: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class RegionMap:
    """The outcome of every start under one law on one plant.

    Attributes:
        case: What is changed against the nominal plant.
        controller: Name of the law.
        grid: Letters of ``Outcome``, (second axis, first axis).
        line: Those of starts on the first axis alone, (4 * points,).
        line_starts: Their values on the first axis.
        seconds: Wall time.
    """

    case: Case
    controller: str
    grid: Outcomes
    line: Outcomes
    line_starts: Array
    seconds: float

    def counts(self) -> dict[Outcome, int]:
        """Starts of the grid with each outcome."""
        found = Counter(self.grid.ravel().tolist())
        return {outcome: found[outcome.value] for outcome in Outcome}

    def fractions(self) -> dict[Outcome, float]:
        """The same in parts of the grid."""
        return {outcome: count / self.grid.size for outcome, count in self.counts().items()}

    def rest_interval(self) -> tuple[float, float] | None:
        """The farthest starts on the first axis from which, and from all between, it converges.

        None if it does not converge from those next to zero.
        """
        good, middle = self.line == Outcome.CONVERGED.value, len(self.line) // 2
        if not (good[middle - 1] and good[middle]):
            return None
        wrong = np.flatnonzero(~good)
        below, above = wrong[wrong < middle], wrong[wrong >= middle]
        low = below[-1] + 1 if len(below) else 0
        high = above[0] - 1 if len(above) else len(good) - 1
        return float(self.line_starts[low]), float(self.line_starts[high])


class Region:
    """The maps of one system: every law, on the nominal and on the perturbed plant."""

    def __init__(self, question: RegionQuestion) -> None:
        """Check what is asked and lay out the starts.

        Raises:
            ModelError: If the system is unknown.
            ArgumentError: If a name or a number does not fit.
        """
        least, most = POINTS
        if not least <= question.points <= most:
            raise ArgumentError(f"{question.points} points per axis must be from {least} to {most}")
        if not 0 < question.duration <= LONGEST:
            raise ArgumentError(
                f"duration {question.duration:g} s must be positive, up to {LONGEST:g} s"
            )
        self.question = question
        perturbed = _perturbed(question)
        self.system: System = perturbed.nominal.system
        self.experiments = [
            each.with_settings(**question.settings.changes())
            for each in (_unperturbed(perturbed), perturbed)
        ]
        names = question.controllers or perturbed.controllers
        self.controllers: list[str] = list(dict.fromkeys(names))
        reference = RegionLoop.of(self.experiments[0], self.controllers[0])
        self.axes: tuple[Axis, Axis] = choose_axes(reference, question.axes, question.limits)
        first, second = np.meshgrid(*(axis.cells(question.points) for axis in self.axes))
        self._line = self.axes[0].cells(_LINE * question.points)
        self._starts = starts_on(
            reference,
            self.axes,
            np.concatenate([first.ravel(), self._line]),
            np.concatenate([second.ravel(), np.zeros(len(self._line))]),
        )

    @property
    def cases(self) -> list[Case]:
        """The nominal plant's case and the perturbed one's."""
        return [each.case for each in self.experiments]

    @cached_property
    def batches(self) -> int:
        """Batches of all maps, for a progress bar."""
        maps = len(self.experiments) * len(self.controllers)
        return maps * math.ceil(len(self._starts) / BATCH)

    def maps(self, advance: Callable[[str], None] = lambda _: None) -> Iterator[RegionMap]:
        """Compute the maps, one by one; ``advance`` is called after each batch."""
        for experiment in self.experiments:
            for name in self.controllers:
                yield self._map(experiment, name, advance)

    def tolerances(self, controller: str) -> dict[str, tuple[float, str]]:
        """What each error of a law must be within to count as none: state to value and unit."""
        loop = RegionLoop.of(self.experiments[0], controller)
        states = [self.system.states[state] for state in loop.regulated]
        return {state.symbol: (tolerance_of(state.unit), state.unit) for state in states}

    def _map(self, experiment: Experiment, name: str, advance: Callable[[str], None]) -> RegionMap:
        """One map."""
        began, loop, parts = time.perf_counter(), RegionLoop.of(experiment, name), []
        case = experiment.case
        for first in range(0, len(self._starts), BATCH):
            batch = self._starts[first : first + BATCH]
            parts.append(outcomes(loop, batch, self.question.duration))
            advance(f"{case.name}/{name}")
        letters, size = np.concatenate(parts), self.question.points
        grid, line = letters[: size * size].reshape(size, size), letters[size * size :]
        return RegionMap(case, name, grid, line, self._line, time.perf_counter() - began)


def outcomes(
    loop: RegionLoop, starts: Array, duration: float, looks: Sequence[float] = _LOOKS
) -> Outcomes:
    """The outcome of each start (nsim, n), as letters.

    A run ends at a look if it has left the region, met a singularity or diverged. It also ends
    there as converged if it began beyond a tolerance and is well within all of them, unless a
    disturbance could still carry it away.

    Args:
        loop: The law on its plant.
        starts: Starts.
        duration: Of a run that is not decided before [s].
        looks: Parts of it after which to look, ending with 1.
    """
    tolerance = np.array([tolerance_of(loop.system.states[i].unit) for i in loop.regulated])
    disturbed = bool(loop.experiment.case.disturbances)
    moved: NDArray[np.bool_] = np.any(np.abs(loop.errors(0.0, starts)) > tolerance, axis=1)
    letters = np.full(len(starts), Outcome.NOT_CONVERGED.value)
    for look in looks:
        undecided = np.flatnonzero(letters == Outcome.NOT_CONVERGED.value)
        if not len(undecided):
            break
        run, last = loop.run(starts[undecided], look * duration), look == looks[-1]
        errors = loop.errors(float(run.time[-1]), run.state[:, -1])
        bound = tolerance if last else _EARLY * tolerance
        for start, status, error in zip(undecided, run.status, errors, strict=True):
            outcome = judge(status, error, bound)
            if outcome is not Outcome.CONVERGED or last or (moved[start] and not disturbed):
                letters[start] = outcome.value
    return letters


def _regulates_states(experiment: Experiment) -> bool:
    """Whether the outputs of the laws are states, so that starts can be laid out on them."""
    law = experiment.law("physics", experiment.controllers[0])
    return law.coordinates.outputs is None


def _unperturbed(perturbed: Experiment) -> Experiment:
    """The same laws on the nominal plant: the case of the package for it, if there is one."""
    case = perturbed.case
    if perturbed.path in shipped_files().values():
        for each in find_experiments(case.system):
            calm = not each.case.edits and not each.case.disturbances
            if calm and each.case.controllers == case.controllers:
                return each
    return perturbed.varied(name="nominal", title="nothing is changed", edits=(), disturbances=())


def _perturbed(question: RegionQuestion) -> Experiment:
    """The experiment with the perturbed plant.

    Raises:
        ArgumentError: If it is unknown, does not run in MuJoCo, or nothing differs from the
            nominal plant.
    """
    known = find_experiments(question.system)
    if question.case is not None:
        names = {each.case.name: each for each in known}
        if question.case not in names:
            raise ArgumentError(unknown_name(f"case of {question.system}", question.case, names))
        known = [names[question.case]]
    elif len(known) > 1:
        return next(each for each in known if each.case.edits and _regulates_states(each))
    (found,) = known
    case = found.case
    if "physics" not in found.nominal.names:
        raise ArgumentError(f"{question.system}: it does not run in MuJoCo, where maps are made")
    if not case.edits and case.onset >= question.duration:
        why = f"disturbed from {case.onset:g} s on" if case.disturbances else "not changed"
        others = find_experiments(case.system) if found.nominal.shipped else []
        edited = [e for e in others if e.case.edits and _regulates_states(e)]
        names = ", ".join(each.case.name for each in edited) or "one with an edit"
        raise ArgumentError(
            f"{case.name} of {case.system} is the nominal plant, {why}, and a run takes "
            f"{question.duration:g} s: take {names}"
        )
    return found

"""From which starts a law converges: maps of two axes to outcomes, in physics."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.plants import System
from grosmc_mj.studies.agreement import model_mismatch
from grosmc_mj.studies.region.axes import Axis, choose_axes, starts_on
from grosmc_mj.studies.region.loop import RegionLoop
from grosmc_mj.studies.region.outcome import Outcome, judge, tolerance_of
from grosmc_mj.studies.region.region_map import Outcomes, RegionMap
from grosmc_mj.studies.region.screened import Mask, confirmed_area

SCREENS = ("auto", "none")

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
        screen: ``auto`` makes maps on equations, where these say what MuJoCo does, and confirms
            their boundaries; ``none`` makes all of them in MuJoCo.
    """

    system: str
    case: str | None = None
    points: int = 100
    duration: float = 12.0
    axes: tuple[str, str] | None = None
    limits: Mapping[str, float] = field(default_factory=dict)
    settings: Settings = REGION_SETTINGS
    controllers: tuple[str, ...] = ()
    screen: str = "auto"


class Region:
    """The maps of one system: every law, on the nominal and on the perturbed plant."""

    def __init__(self, question: RegionQuestion) -> None:
        """Check what is asked and lay out the starts.

        Raises:
            ModelError: If the system is unknown.
            ArgumentError: If a name or a number does not fit, or a start lies beyond a stop.
        """
        least, most = POINTS
        if not least <= question.points <= most:
            raise ArgumentError(f"{question.points} points per axis must be from {least} to {most}")
        if not 0 < question.duration <= LONGEST:
            raise ArgumentError(
                f"duration {question.duration:g} s must be positive, up to {LONGEST:g} s"
            )
        require_known("screen", question.screen, SCREENS)
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
        physics = perturbed.plant("physics")
        try:
            for start in self._starts:
                physics.require_start(start)
        except ArgumentError as error:
            raise ArgumentError(f"{error}, or lower the limits of the axes") from error

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
        began, physics = time.perf_counter(), RegionLoop.of(experiment, name)
        case, size = experiment.case, self.question.points
        screened = not self.why_not[case.name]
        loop = replace(physics, on_equations=True) if screened else physics
        letters = self._outcomes(loop, self._starts, lambda: advance(f"{case.name}/{name}"))
        cells = size * size
        grid, line = letters[:cells].reshape(size, size), letters[cells:]
        confirmed, overturned = len(letters), 0
        if screened:
            areas = [
                confirmed_area(first, partial(self._of_some, physics, starts), seed)
                for seed, (first, starts) in enumerate(
                    [(grid, self._starts[:cells]), (line[None], self._starts[cells:])]
                )
            ]
            grid, (line,) = (each.letters for each in areas)
            confirmed = sum(int(each.confirmed.sum()) for each in areas)
            overturned = sum(int(each.overturned.sum()) for each in areas)
        seconds = time.perf_counter() - began
        return RegionMap(case, name, grid, line, self._line, seconds, confirmed, overturned)

    def _of_some(self, loop: RegionLoop, starts: Array, chosen: Mask) -> Outcomes:
        """The outcomes of those starts that are chosen."""
        return self._outcomes(loop, starts[chosen.reshape(-1)])

    def _outcomes(
        self, loop: RegionLoop, starts: Array, advance: Callable[[], object] = lambda: None
    ) -> Outcomes:
        """The outcome of each start, a batch at a time."""
        parts = []
        for first in range(0, len(starts), BATCH):
            parts.append(outcomes(loop, starts[first : first + BATCH], self.question.duration))
            advance()
        return np.concatenate(parts)

    @cached_property
    def why_not(self) -> dict[str, str]:
        """Why no map of a case is made on equations, by its name; empty where they are."""
        if self.question.screen == "none":
            return dict.fromkeys([case.name for case in self.cases], "it is not asked for")
        return {each.case.name: model_mismatch(each.plant("physics")) for each in self.experiments}


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
        require_known(f"case of {question.system}", question.case, names)
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

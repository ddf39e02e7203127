"""Many runs of one law in many loops at once, and whether each keeps what is required."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from grosmc_mj.studies.tolerance.setting import Condition, Setting, StudiedLaw

from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import GrosmcError
from grosmc_mj.experiments.metrics import Recording, meters_of, said_by
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import Limit, costs_wanted, margins_of, windows
from grosmc_mj.loop import Loop, in_loop
from grosmc_mj.simulation.problem import Meters
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.studies.studied import judgeable_in


class Trial(NamedTuple):
    """What one law is put to.

    Attributes:
        condition: Under which condition.
        loop: In which loop.
    """

    condition: Condition
    loop: Loop


class TrialResult(NamedTuple):
    """What came of a trial.

    Attributes:
        kept: Whether every run keeps everything.
        margin: The least margin in parts of its limit; -inf for a run that ended early.
        worst: The requirement that it is of, or how the run ended.
        number: Which of the runs it is of: the one that decides.
        impossible: Why there can be no such run; empty if there can.
    """

    kept: bool
    margin: float
    worst: str
    number: int = 0
    impossible: str = ""


class _PlannedRun(NamedTuple):
    """A run that is to be made."""

    trial: Trial
    number: int
    controller: Controller


@dataclass(frozen=True, eq=False)
class Trials:
    """The runs of one law on one plant, none made twice.

    Attributes:
        setting: What is studied.
        law: The law.
        plant: ``corrected`` or ``physics``.
        seeds: Runs of a loop in which something is random.
        threads: 0 for all cores.
    """

    setting: Setting
    law: StudiedLaw
    plant: PlantName
    seeds: int
    threads: int = 0

    @cached_property
    def known(self) -> dict[tuple[Trial, int], TrialResult]:
        """What has come out, by trial and number of the run."""
        return {}

    @cached_property
    def asked(self) -> dict[Condition, tuple[Limit, ...]]:
        """What the law must keep under each condition."""
        return {each: self.setting.limits(self.law, each) for each in self.setting.conditions}

    def first(self, trials: Sequence[Trial]) -> list[TrialResult]:
        """What comes of the first run of each trial."""
        return self.numbered([(trial, 0) for trial in trials])

    def all(self, trials: Sequence[Trial]) -> list[TrialResult]:
        """What comes of all runs of each: the worst of them."""
        first = self.first(trials)
        random = [
            trial
            for trial, result in zip(trials, first, strict=True)
            if trial.loop.random and result.kept
        ]
        self._make((trial, number) for trial in random for number in range(1, self.seeds))
        return [self._worst(trial) for trial in trials]

    def numbered(self, runs: Sequence[tuple[Trial, int]]) -> list[TrialResult]:
        """What comes of these runs of trials, by their numbers."""
        self._make(runs)
        return [self.known[run] for run in runs]

    def _worst(self, trial: Trial) -> TrialResult:
        made = [self.known[trial, i] for i in range(self.seeds) if (trial, i) in self.known]
        return min(made, key=lambda result: (result.kept, result.margin))

    def _make(self, wanted: Iterable[tuple[Trial, int]]) -> None:
        """Make the runs that have not been made, those of one layout and duration together."""
        groups: dict[Any, list[_PlannedRun]] = {}
        for trial, number in dict.fromkeys(wanted):
            if (trial, number) in self.known:
                continue
            try:
                made = self._controller(trial, number)
                meters = self.meters[trial.condition]
            except GrosmcError as error:
                self.known[trial, number] = TrialResult(False, -np.inf, "", number, str(error))
                continue
            key = made.law, meters.kind, trial.condition.experiment.case.duration
            groups.setdefault(key, []).append(_PlannedRun(trial, number, made))
        for runs in groups.values():
            self._run(runs)

    def _controller(self, trial: Trial, number: int) -> Controller:
        """The law in its loop."""
        experiment = trial.condition.experiment
        settings = experiment.settings
        return in_loop(
            self.law.controller, trial.loop, experiment.nominal.system,
            control_period=settings.control_period, timestep=settings.timestep,
            predict=self.law.predict, run=number,
        )  # fmt: skip

    @cached_property
    def meters(self) -> dict[Condition, Meters]:
        """The meters of its requirements under each condition."""
        return {
            condition: meters_of(
                self.law.controller,
                condition.experiment.settings.timestep,
                windows(asked),
                condition.experiment.case.onset,
                costs=costs_wanted(asked),
                limits=condition.experiment.plant(self.plant).input_limits,
            )
            for condition, asked in self.asked.items()
        }

    def _run(self, runs: Sequence[_PlannedRun]) -> None:
        """Make runs of one layout and duration, and note what came of them."""
        experiments = [run.trial.condition.experiment for run in runs]
        first, settings = experiments[0].case, experiments[0].settings
        starts = np.array([each.case.x0 for each in experiments])
        ended = simulate(
            [each.plant(self.plant) for each in experiments],
            [run.controller for run in runs],
            starts,
            duration=first.duration,
            control_period=settings.control_period,
            timestep=settings.timestep,
            disturbances=[list(each.case.disturbances) for each in experiments],
            meters=[self.meters[run.trial.condition] for run in runs],
            engine=settings.engine_for(runs[0].controller),
            record=False,
            threads=self.threads,
        )
        words = [each.name.lower() for each in ended.status]
        completed = np.array([each is Status.COMPLETED for each in ended.status])
        for condition in dict.fromkeys(run.trial.condition for run in runs):
            own = np.array([run.trial.condition is condition for run in runs])
            asked = self.asked[condition]
            meters, ends = np.atleast_1d(ended.meters)[own], ended.state[own, -1]
            law = next(run.controller for run in runs if run.trial.condition is condition)
            recording = Recording.sampled(
                settings.timestep,
                first.duration,
                np.full(len(ends), condition.experiment.case.onset),
                windows(asked),
            )
            found = said_by(
                law, meters, recording, starts[own], ends, completed[own],
                costs=costs_wanted(asked),
            )  # fmt: skip
            margins = margins_of(asked, found, completed[own])
            shares = {each.key: margins[each.key] / each.value for each in asked}
            for i, index in enumerate(np.flatnonzero(own).tolist()):
                run = runs[index]
                own_limits = judgeable_in(asked, run.trial.loop, self.setting.bench)
                keys = [limit.key for limit in own_limits]
                least = min(keys, key=lambda key: (shares[key][i], key), default="")
                margin = float(shares[least][i]) if least else 1.0
                result = TrialResult(margin >= 0, margin, least, run.number)
                if not completed[index]:
                    result = TrialResult(False, -np.inf, words[index], run.number)
                self.known[run.trial, run.number] = result

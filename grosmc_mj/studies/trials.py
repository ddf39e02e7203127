"""Runs of laws in many loops and on many machines, over draws; each is judged, none made twice."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from grosmc_mj.experiments.experiment import Experiment, RunResult, run_on
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements.judging import judge_run
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.mechanics.machine import MachinePart
from grosmc_mj.output.results.verdicts import Verdict, over_draws, verdict_of
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.studies.sweep.draws import drawn_case
from grosmc_mj.studies.sweep.runs import Row, prepare_run, run_rows
from grosmc_mj.studies.target import Condition, StudiedLaw, judgeable_in
from grosmc_mj.theory.plants import Plant


class Trial(NamedTuple):
    """A law in a loop and on a machine, under a condition.

    Attributes:
        law: The law.
        condition: Plant and loads.
        loop: The loop; None for none at all.
        control_period: Control period [s], for which the law is designed anew; None for that of
            the target.
        parts: Parts of the machine beside those of the condition.
    """

    law: StudiedLaw
    condition: Condition
    loop: Loop | None = None
    control_period: float | None = None
    parts: tuple[MachinePart, ...] = ()

    @property
    def drawn(self) -> bool:
        """Whether its runs differ by draws."""
        return self.loop is not None and self.loop.drawn

    @property
    def experiment(self) -> Experiment:
        """Experiment of its condition, with its control period."""
        experiment = self.condition.experiment
        if self.control_period is None:
            return experiment
        # A discrete surface, too, is designed for this period.
        return experiment.changed(control_period=self.control_period, **self.law.sampled)

    @property
    def machine(self) -> Experiment:
        """The experiment with the parts of the machine."""
        experiment = self.experiment
        if not self.parts:
            return experiment
        return experiment.changed(edits=(*experiment.edits, *self.parts))

    def row(self, draw: int, plant: Plant) -> Row:
        """Return the row of a draw on the plant of the trial; draw 0 is the file's own run."""
        return Row(
            # By its name a law is designed for the control period.
            self.law.controller if self.control_period is None else self.law.base,
            case=drawn_case(self.experiment.changed(loop=self.loop), draw),
            plant=plant,
            predict=self.law.predict,
        )


# Limits of a law under a condition.
Limits = Callable[[StudiedLaw, Condition], Sequence[Requirement]]
# Limits of the claims about it, by their ids.
Claims = Callable[[StudiedLaw, Condition], Mapping[str, Sequence[Requirement]]]


def no_claims(_law: StudiedLaw, _condition: Condition) -> Mapping[str, Sequence[Requirement]]:
    """Return the limits of no claims."""
    return {}


class _Judges(NamedTuple):
    """Limits of a law under a condition, and those of the claims about it."""

    limits: tuple[Requirement, ...]
    claims: Mapping[str, Sequence[Requirement]]

    @property
    def measured(self) -> tuple[Requirement, ...]:
        """All of them."""
        measured = list(self.limits)
        for limits_of_claim in self.claims.values():
            measured += limits_of_claim
        return tuple(measured)


@dataclass(frozen=True, eq=False)
class Trials:
    """Trials on one kind of plant, in batches: of one law, or of many designs of it.

    Attributes:
        plant: ``printed``, ``corrected`` or ``physics``.
        limits: Function that returns the limits of a law under a condition.
        draws: Runs of a trial in which something is drawn.
        built: The whole loop that the trials' loops are parts of, see ``judgeable_in``; None if all
            limits are judged.
        claims: Function that returns the limits of the claims about a law under a condition, which
            are measured and no part of a verdict.
        threads: Threads of the runs; 0 for all cores.
        known: Verdicts by trial and number of the draw.
    """

    plant: PlantName
    limits: Limits
    draws: int = 1
    built: Loop | None = None
    claims: Claims = no_claims
    threads: int = 0
    known: dict[tuple[Trial, int], Verdict] = field(default_factory=dict)
    _judges: dict[tuple[StudiedLaw, Condition], _Judges] = field(default_factory=dict)

    def results(self, runs: Sequence[tuple[Trial, int]]) -> list[Verdict]:
        """Return the verdicts on runs, each a trial and the number of a draw."""
        groups: dict[tuple[object, ...], list[tuple[Trial, int]]] = {}
        for run in dict.fromkeys(runs):
            if run not in self.known:
                groups.setdefault(self._batch_of(run[0]), []).append(run)
        for group in groups.values():
            self._run(group)
        return [self.known[run] for run in runs]

    def _batch_of(self, trial: Trial) -> tuple[object, ...]:
        """Key that is equal for trials that run as one batch, under whichever conditions.

        A batch has one control period, one loop that laws know, and the same limits. A law that is
        designed for a control period of its own has batches of its own.
        """
        experiment = trial.condition.experiment
        law = None if trial.control_period is None else trial.law
        loops = (experiment.loop, experiment.known_loop)
        measured = self._judges_of(trial).measured
        return (trial.control_period, law, experiment.settings, loops, measured)

    def all_draws(self, trial: Trial) -> list[Verdict]:
        """Return the verdict on each draw of a trial."""
        return self.results([(trial, number) for number in self.numbers(trial)])

    def over_draws(self, trials: Sequence[Trial]) -> list[Verdict]:
        """Return the verdict on the draws of each trial; one that fails at once is run once."""
        self.results([(trial, 0) for trial in trials])
        kept = [trial for trial in trials if self.known[trial, 0].kept]
        self.results([(trial, number) for trial in kept for number in self.numbers(trial)])

        verdicts = []
        for trial in trials:
            runs = [(trial, number) for number in self.numbers(trial)]
            verdicts.append(over_draws([self.known[run] for run in runs if run in self.known]))
        return verdicts

    def numbers(self, trial: Trial) -> range:
        """Return the numbers of the draws of a trial: one where nothing is drawn."""
        return range(self.draws if trial.drawn else 1)

    def record(self, trial: Trial) -> RunResult:
        """Make the first draw of a trial as a recorded run, and judge it.

        Raises:
            GrosmcError: If there can be no such run.
        """
        experiment = trial.experiment
        machine = trial.machine
        row = trial.row(0, machine.plant(self.plant))
        prepared = prepare_run(experiment, row, self.plant)
        run = run_on(machine, self.plant, prepared.law, prepared.plant, prepared.loop)

        self.known[trial, 0] = self._judged(trial, partial(_verdict_of_run, run))
        return run

    def _judges_of(self, trial: Trial) -> _Judges:
        """Limits and claims of the law of a trial."""
        key = trial.law, trial.condition
        if key not in self._judges:
            self._judges[key] = _Judges(tuple(self.limits(*key)), self.claims(*key))
        return self._judges[key]

    def _run(self, runs: Sequence[tuple[Trial, int]]) -> None:
        """Make runs as one batch, and judge them."""
        first, _ = runs[0]
        experiment = first.experiment
        plants: dict[tuple[Condition, tuple[MachinePart, ...]], Plant] = {}
        rows: list[Row] = []
        for trial, draw in runs:
            machine = trial.condition, trial.parts
            if machine not in plants:
                plants[machine] = trial.machine.plant(self.plant)
            rows.append(trial.row(draw, plants[machine]))

        outcomes = run_rows(
            experiment,
            rows,
            self._judges_of(first).measured,
            self.plant,
            keep_impossible=True,
            threads=self.threads,
        )
        for index, (trial, draw) in enumerate(runs):
            judge = partial(outcomes.verdict, index, draw=draw)
            self.known[trial, draw] = self._judged(trial, judge)

    def _judged(self, trial: Trial, judge: Callable[[Sequence[Requirement]], Verdict]) -> Verdict:
        """Return the verdict on a run, with the shares of the claims about its law.

        Args:
            trial: Its trial.
            judge: Returns the verdict on the run by some limits.
        """
        judges = self._judges_of(trial)
        verdict = judge(judgeable_in(judges.limits, trial.loop or Loop(), self.built))
        claims: dict[str, float] = {}
        if not verdict.impossible:
            claims = {name: judge(limits).share for name, limits in judges.claims.items()}
        return verdict.changed(law=trial.law.name, condition=trial.condition.name, claims=claims)


def _verdict_of_run(run: RunResult, limits: Sequence[Requirement]) -> Verdict:
    """Return the verdict on a recorded run."""
    shares = {limit.name: judge_run(limit, run).share for limit in limits}
    ended = run.status.name.lower() if run.ended else ""
    return verdict_of(shares, ended=ended)

"""Ladder of a machine: each law at each rung, judged over draws of what is random."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.file.schema import ClaimTable
from grosmc_mj.experiments.file.user_code import is_named, named_in, sources
from grosmc_mj.experiments.measured import MEASURED, measured_results
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.experiments.requirements.verdict import verdict_of_judgements
from grosmc_mj.ground.errors import ArgumentError, GrosmcError, SetupError
from grosmc_mj.output.results.tables import number
from grosmc_mj.output.results.verdicts import Verdict, described, over_draws
from grosmc_mj.studies.ladder.climb import ALONE, UP_TO
from grosmc_mj.studies.ladder.rungs import Rung, rungs_of, varied_rungs
from grosmc_mj.studies.ladder.shown import shown_numbers
from grosmc_mj.studies.study import Advance, Study, StudyCell, dependencies
from grosmc_mj.studies.target import (
    MACHINE,
    UNDER_LOAD,
    Condition,
    StudiedLaw,
    case_for,
    chosen_laws,
    conditions_of,
    judgeable_in,
    limits_in,
)
from grosmc_mj.studies.trials import Trial, Trials

# Draws of changed rungs that run together.
_DRAWS_AT_ONCE = 4

# The design


@dataclass(frozen=True, eq=False)
class Ladder(Study[Verdict]):
    """A target, ready to be climbed.

    Attributes:
        experiment: Experiment of the target, without loop and machine.
        machine: Experiment of the target, with both.
        laws: Laws that climb.
        climbing: Rungs, each with all rungs below it.
        alone: Rungs, each alone on a sampled plant.
        conditions: Plants and loads, the file's own first.
        draws: Runs of a loop in which something is drawn.
        varied: What becomes of a rung by each assumed number, alone, by the rung's name.
        statements: Statements of the chapter, by the ids of the file's claims.
    """

    kind = "ladder"
    row = Verdict
    unit = "rungs"

    experiment: Experiment
    machine: Experiment
    laws: Sequence[StudiedLaw]
    climbing: Sequence[Rung]
    alone: Sequence[Rung]
    conditions: Sequence[Condition]
    draws: int = 1
    varied: Mapping[str, Mapping[str, Rung]] = field(default_factory=dict)
    statements: Mapping[str, str] = field(default_factory=dict)

    def runs(self) -> Iterator[tuple[StudiedLaw, Rung, Condition, bool]]:
        """Yield all runs; the last entry says whether all rungs below count too."""
        for law in self.laws:
            for condition in self.conditions:
                for rung in self.climbing:
                    yield law, rung, condition, True
                if condition is self.conditions[0]:
                    for rung in self.alone:
                        yield law, rung, condition, False

    @property
    def case(self) -> Experiment:
        """The machine."""
        return self.machine

    def cells(self) -> list[StudyCell[Verdict]]:
        """Return a cell for each run; it depends on its own condition alone."""
        configuration = self.configuration()
        depends_on = {
            condition.name: dependencies(configuration, [condition])
            for condition in self.conditions
        }
        cells = []
        for law, rung, condition, together in self.runs():
            cell = StudyCell(
                name=law.name,
                key=(law.name, rung.name, condition.name, together),
                depends_on=depends_on[condition.name],
                measure=partial(self._measure, law, rung, condition, together),
            )
            cells.append(cell)
        return cells

    def _measure(
        self,
        law: StudiedLaw,
        rung: Rung,
        condition: Condition,
        together: bool,
        _: Advance,
    ) -> Verdict:
        """Return the row of a step; it is too short to tell how far it is."""
        return run_rung(self, law, rung, condition, together=together)

    def varied_rungs_of(self, rung: Rung, condition: Condition) -> Mapping[str, Rung]:
        """Return the rung by each change of an assumed number; under the first condition alone."""
        if condition is not self.conditions[0]:
            return {}
        return self.varied.get(rung.name, {})

    @property
    def target(self) -> str:
        """SYSTEM/CASE."""
        return f"{self.machine.system}/{self.machine.name}"

    @property
    def units(self) -> tuple[str, str]:
        """Units of the output and of the input."""
        error = self.laws[0].controller.designed.error
        output = error.units[error.output_rows[0]]
        return output, self.experiment.nominal.system.input.unit

    def configuration(self) -> dict[str, Any]:
        """Return the configuration that rows depend on, as the result has it."""
        settings = self.experiment.settings
        file = self.machine.file
        named = [*named_in(file), *(file.law(law.base).law for law in self.laws)]
        return {
            "target": self.target,
            "title": self.machine.title,
            "model": self.experiment.plant(self.experiment.nominal.truest).digest,
            "sources": sources(filter(is_named, named), self.machine.path.parent),
            "control_period": {"value": settings.control_period, "unit": "s"},
            "timestep": {"value": settings.timestep, "unit": "s"},
            "integrator": settings.integrator,
            "draws": self.draws,
            "file": self.machine.document(),
        }


def ladder(
    target: str,
    chosen: Sequence[str] = (),
    *,
    loaded: bool = False,
    rivals: bool = False,
    draws: int = 1,
) -> Ladder:
    """Return the ladder of a target.

    Args:
        target: A system, which means its machine, ``SYSTEM/CASE``, or the path of a case file.
        chosen: Names of laws; all by default.
        loaded: Whether laws climb under every condition; else as the file says, with its own edits
            and disturbances.
        rivals: Whether the default includes the rivals.
        draws: Runs of a loop in which something is drawn.

    Raises:
        ArgumentError: If there is no such target or law, neither loop nor machine, or nothing is
            required.
    """
    machine = case_for(target, MACHINE)
    edits = tuple(edit for edit in machine.edits if edit not in machine.parts)
    bare = machine.changed(loop=None, edits=edits)
    climbing, alone = rungs_of(machine)
    if not alone:
        raise ArgumentError(
            f"{machine.path}: there is nothing to climb to: give the file a loop ([computing], "
            "[[sensor]], [[actuator]]) or a machine ([[motor]], [[lugre]], [[transmission]], "
            "[[stop]])"
        )

    conditions = sorted(conditions_of(bare), key=lambda condition: condition.name != UNDER_LOAD)
    if not loaded:
        conditions = conditions[:1]
    return Ladder(
        experiment=bare,
        machine=machine,
        laws=chosen_laws(bare, chosen, rivals=rivals),
        climbing=climbing,
        alone=alone,
        conditions=conditions,
        draws=draws,
        varied=varied_rungs(machine),
    )


# Runs: each gives a row


def trial_of(law: StudiedLaw, rung: Rung, condition: Condition) -> Trial:
    """Return a law on a rung as a trial.

    Raises:
        GrosmcError: If the law cannot be designed.
    """
    experiment = condition.experiment
    control_period = None if rung.sampled else experiment.settings.timestep
    if rung.sampled:
        law = law.designed_for(rung.plant, experiment)
    loop = rung.loop if rung.looped else None
    return Trial(law, condition, loop, control_period, rung.parts)


def run_rung(
    studied: Ladder,
    law: StudiedLaw,
    rung: Rung,
    condition: Condition,
    *,
    together: bool,
) -> Verdict:
    """Run a law on a rung, in all draws and with other assumed numbers, and judge the runs.

    Raises:
        SetupError: If the computer, not the law, is at fault.
    """
    try:
        verdict = _judge_rung(studied, law, rung, condition, together=together)
    except SetupError:
        raise
    except GrosmcError as error:
        verdict = described(Verdict(impossible=str(error)))
    return verdict.changed(
        law=law.name,
        step=rung.name,
        condition=condition.name,
        group=UP_TO if together else ALONE,
    )


def _judge_rung(
    studied: Ladder, law: StudiedLaw, rung: Rung, condition: Condition, *, together: bool
) -> Verdict:
    """Return the verdict on a law on a rung.

    Raises:
        GrosmcError: If there can be no such run.
    """
    limits = limits_in(studied.experiment.file.requirement, law, condition, [rung.plant])
    limits = judgeable_in(limits, rung.loop, studied.machine.loop)
    claims = _claims_about(studied.machine, law, condition, rung)
    trials = Trials(rung.plant, lambda *_: limits, studied.draws, claims=lambda *_: claims)
    trial = trial_of(law, rung, condition)
    run = trials.record(trial)
    draws = trials.all_draws(trial)
    verdict = over_draws(draws)

    optimum_settles = _optimum_settles(run, limits, verdict)
    more = ""
    if optimum_settles is not None:
        more = f"the nominal optimum needs {number(optimum_settles)} s"
    verdict = described(verdict, more)

    turned: tuple[str, ...] = ()
    if together:
        changed = {
            change: trial_of(law, varied, condition)
            for change, varied in studied.varied_rungs_of(rung, condition).items()
        }
        worst_first = sorted(draws, key=lambda draw: draw.share, reverse=True)
        numbers = [draw.draw for draw in worst_first]
        # No verdict depends on a claim.
        unclaimed = Trials(rung.plant, lambda *_: limits, studied.draws)
        turned = turned_by(unclaimed, changed, numbers, kept=verdict.kept)
    shown = {**shown_numbers(run), "optimum_settles": optimum_settles}
    return verdict.changed(turned_by=turned, numbers=shown)


def turned_by(
    trials: Trials, changed: Mapping[str, Trial], draws: Sequence[int], *, kept: bool
) -> tuple[str, ...]:
    """Return the changes of assumed numbers that turn the verdict of a rung.

    Each changed rung is run in the worst draw. If that is kept and the rung is not, the change
    must keep all other draws, too.

    Args:
        trials: Runs the trials.
        changed: The rung with another number, by the change.
        draws: Numbers of all draws, the worst first.
        kept: Whether the rung keeps all requirements.
    """
    worst = trials.results([(trial, draws[0]) for trial in changed.values()])
    keeping = [change for change, draw in zip(changed, worst, strict=True) if draw.kept]
    if kept:
        return tuple(change for change in changed if change not in keeping)

    # A few draws at a time, for the first that fails decides.
    for first in range(1, len(draws), _DRAWS_AT_ONCE):
        some = draws[first : first + _DRAWS_AT_ONCE]
        trials.results([(changed[change], draw) for change in keeping for draw in some])
        keeping = [
            change
            for change in keeping
            if all(trials.known[changed[change], draw].kept for draw in some)
        ]
    return tuple(keeping)


def _optimum_settles(
    run: RunResult, limits: Sequence[Requirement], verdict: Verdict
) -> float | None:
    """Settling time of the nominal optimum [s], if the law does not settle in time."""
    for limit in limits:
        if limit.name == verdict.broken and not run.ended:
            optimum = limit.of_optimum(run)
            return None if optimum is None else optimum.value
    return None


def measured_rows(studied: Ladder) -> list[Verdict]:
    """Judge the logs of the real machine that the case names: a row for each law of a log.

    Raises:
        ArgumentError: If a log cannot be read or is too short.
    """
    laws = {law.name for law in studied.laws}
    logs_of: dict[str, list[Verdict]] = {}
    for result in measured_results(studied.machine):
        if result.controller.name in laws:
            verdict = verdict_of_judgements(result.requirements)
            logs_of.setdefault(result.controller.name, []).append(verdict)

    rows = []
    for law, logs in logs_of.items():
        verdict = over_draws(logs).changed(
            law=law, step=MEASURED, condition=studied.conditions[0].name, group=UP_TO
        )
        rows.append(described(verdict))
    return rows


# Claims


def _claims_about(
    machine: Experiment, law: StudiedLaw, condition: Condition, rung: Rung
) -> dict[str, tuple[Requirement, ...]]:
    """Return the limits of the claims about a law under a condition, by the claim's id.

    Claims that a run of this length cannot decide are left out.
    """
    limits: dict[str, tuple[Requirement, ...]] = {}
    for claim in machine.file.claim:
        if claim.under != condition.name or not _is_about(machine, claim, law):
            continue
        of_claim = limits_in([claim], law, condition, [rung.plant])
        if of_claim:
            limits[claim.id] = (*limits.get(claim.id, ()), *of_claim)
    return limits


def _is_about(machine: Experiment, claim: ClaimTable, law: StudiedLaw) -> bool:
    """Whether a claim is about a law, however that law switches."""
    bases = {controller.called: controller.law for controller in machine.file.controller}
    names = claim.of or machine.controllers
    return law.base in names or law.base in [bases.get(name, name) for name in names]

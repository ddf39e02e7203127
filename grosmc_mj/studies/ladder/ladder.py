"""Ladder of a machine: each law at each rung, judged over draws of what is random."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, computed_field

from grosmc_mj.experiments.experiment import Experiment, RunResult, run_on
from grosmc_mj.experiments.file.schema import ClaimTable
from grosmc_mj.experiments.file.user_code import is_named, named_in, sources
from grosmc_mj.experiments.measured import MEASURED, measured_results
from grosmc_mj.experiments.requirements.judging import judge_run, margins_of, of_laws
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, GrosmcError, SetupError
from grosmc_mj.output.results.tables import number
from grosmc_mj.studies.ladder.rungs import Rung, rungs_of, varied_rungs
from grosmc_mj.studies.study import Advance, Study, StudyCell, dependencies
from grosmc_mj.studies.sweep.runs import Outcomes, Row, run_rows
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
from grosmc_mj.theory.control.controller import Controller

# Stands for the requirement that breaks first of a run that ended early.
ENDED = "the run ended"
# Share of a run that is its end.
_END = 0.2
# Draws of a changed rung that run together.
_DRAWS_AT_ONCE = 4
# Fewer swings than these are no cycle.
_SWINGS = 3
# A number that may be infinite, for which JSON has null.
Unlimited = Annotated[float, BeforeValidator(lambda x: math.inf if x is None else x)]


class RungResult(BaseModel):
    """Result of a law on a rung; None for a number that the run does not have.

    Attributes:
        law: Name of the law.
        rung: Name of the rung.
        together: Whether all rungs below count too.
        condition: Name of the condition.
        draws: Runs with other random numbers and phases of the encoders; 1 where nothing is drawn.
        kept_draws: Draws that keep all requirements.
        share_of_the_tightest_limit: Of the worst draw; above 1 it is not kept; infinite with
            nothing to measure.
        tightest: The requirement with the tightest limit in that draw, or how it ended.
        shares: The share used of each limit in that draw.
        hangs_on: Assumed numbers, each with a change that turns the verdict.
        amplitude: Half of the range of the error in the end, in its unit; this and what follows is
            of the first draw.
        frequency: Its swings a second [Hz].
        variation: Total variation of the input a second.
        deviation: Largest distance from the nominal optimum of a law that follows it.
        optimum_settles: Settling time of the nominal optimum, if the law does not settle in time
            [s].
        impossible: Why such a run cannot exist.
        claims: The largest share used, over the draws, of the limits of each claim about this law,
            by its id; above 1 it has fallen.
    """

    model_config = ConfigDict(frozen=True)
    law: str
    rung: str
    together: bool
    condition: str
    draws: int = 1
    kept_draws: int = 0
    share_of_the_tightest_limit: Unlimited = math.inf
    tightest: str = ""
    shares: dict[str, Unlimited] = {}
    hangs_on: tuple[str, ...] = ()
    amplitude: float | None = None
    frequency: float | None = None
    variation: float | None = None
    deviation: float | None = None
    optimum_settles: float | None = None
    impossible: str | None = None
    claims: dict[str, Unlimited] = {}

    @computed_field
    @property
    def kept(self) -> bool:
        """Whether all requirements are kept in all draws."""
        return self.share_of_the_tightest_limit <= 1 and not self.impossible

    @property
    def partly(self) -> bool:
        """Whether some draws keep all requirements, and others do not."""
        return 0 < self.kept_draws < self.draws

    @property
    def cell(self) -> str:
        """The share of the tightest limit, or the draws that keep all; ? if assumptions decide."""
        text = self.share_text
        if self.partly:
            text = f"{self.kept_draws} of {self.draws}"
        return f"{text}?" if self.hangs_on else text

    @property
    def share_text(self) -> str:
        """The share of the tightest limit that is used, or why there is no number."""
        if self.impossible:
            return "-"
        if self.tightest == ENDED:
            return "ended"
        share = self.share_of_the_tightest_limit
        if math.isinf(share):
            return "never"
        if share > 1:
            return f"{number(share)}x"
        return number(share)

    @property
    def reason(self) -> str:
        """The requirement that breaks, and by how much, in words."""
        if self.impossible:
            return self.impossible
        if self.tightest == ENDED:
            if self.partly:
                return f"{ENDED}, kept in {self.kept_draws} of {self.draws} draws"
            return ENDED

        share = self.share_of_the_tightest_limit
        excess = f"{number(share)} times"
        if math.isinf(share):
            excess = "never"
        if number(share) == "1":
            excess = "at its limit"
        words = f"{self.tightest.replace('_', ' ')}: {excess}"
        if self.partly:
            words += f", kept in {self.kept_draws} of {self.draws} draws"
        if self.optimum_settles is not None:
            words += f" (the nominal optimum needs {number(self.optimum_settles)} s)"
        return words


# The design


@dataclass(frozen=True, eq=False)
class Ladder(Study[RungResult]):
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
    row = RungResult
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

    def steps(self) -> Iterator[tuple[StudiedLaw, Rung, Condition, bool]]:
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

    def cells(self) -> list[StudyCell[RungResult]]:
        """Return a cell for each run; it depends on its own condition alone."""
        configuration = self.configuration()
        depends_on = {
            condition.name: dependencies(configuration, [condition])
            for condition in self.conditions
        }
        cells = []
        for law, rung, condition, together in self.steps():
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
    ) -> RungResult:
        """Return the row of a step; it is too short to tell how far it is."""
        return run_rung(self, law, rung, condition, together=together)

    def draws_of(self, rung: Rung) -> range:
        """Return the numbers of the draws of a rung: one where nothing is drawn."""
        return range(self.draws if rung.loop.drawn else 1)

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
    bare = machine.varied(loop=None, edits=edits)
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


class _Draw(NamedTuple):
    """A run of a law at a rung, judged.

    Attributes:
        share: Share used of the tightest limit; infinite if the run ended early.
        tightest: The requirement with this limit, or how the run ended.
        shares: Share used of each limit.
    """

    share: float
    tightest: str
    shares: dict[str, float]

    @property
    def kept(self) -> bool:
        """Whether it keeps all requirements."""
        return self.share <= 1


def run_rung(
    studied: Ladder,
    law: StudiedLaw,
    rung: Rung,
    condition: Condition,
    *,
    together: bool,
) -> RungResult:
    """Run a law on a rung, in all draws and with other assumed numbers, and judge the runs.

    Raises:
        SetupError: If the computer, not the law, is at fault.
    """
    row = RungResult(law=law.name, rung=rung.name, together=together, condition=condition.name)
    limits = limits_in(studied.experiment.file.requirement, law, condition, [rung.plant])
    limits = judgeable_in(limits, rung.loop, studied.machine.loop)
    claims = _claims_about(studied.machine, law, condition, rung)
    try:
        run = run_of(law, rung, condition)
        measured_limits = [*limits, *chain.from_iterable(claims.values())]
        further = _further_draws(studied, law, rung, condition, measured_limits)
    except SetupError:
        raise
    except GrosmcError as error:
        return row.model_copy(update={"impossible": str(error)})

    draws = _judged_draws(run, further, limits)
    worst = max(draws, key=lambda draw: draw.share)
    claimed = {}
    for name, limits_of_claim in claims.items():
        judged = _judged_draws(run, further, limits_of_claim)
        claimed[name] = max(draw.share for draw in judged)
    measured = {
        "draws": len(draws),
        "kept_draws": sum(draw.kept for draw in draws),
        "share_of_the_tightest_limit": worst.share,
        "tightest": worst.tightest,
        "shares": worst.shares,
        "claims": claimed,
    }
    if not run.ended:
        measured |= _shown(run, limits, worst)
    if together:
        worst_first = sorted(range(len(draws)), key=lambda i: draws[i].share, reverse=True)
        changed = studied.varied_rungs_of(rung, condition)
        measured["hangs_on"] = _turned_by(
            law, condition, limits, changed, worst_first, kept=worst.kept
        )
    return row.model_copy(update=measured)


def _judged(shares: dict[str, float], *, completed: bool = True) -> _Draw:
    """Judge a run by the shares that it uses of its limits."""
    if not completed:
        return _Draw(math.inf, ENDED, shares)
    tightest = max(shares, key=lambda name: shares[name], default="")
    return _Draw(shares.get(tightest, 0.0), tightest, shares)


def _judged_draws(
    run: RunResult, further: Outcomes | None, limits: Sequence[Requirement]
) -> list[_Draw]:
    """Judge the recorded run, which is the first draw, and the further ones, if there are any."""
    shares = {limit.name: judge_run(limit, run).share for limit in limits}
    draws = [_judged(shares, completed=not run.ended)]
    if further is not None:
        draws += _judged_outcomes(further, limits)
    return draws


def _judged_outcomes(outcomes: Outcomes, limits: Sequence[Requirement]) -> list[_Draw]:
    """Judge draws that are not recorded."""
    margins = margins_of(limits, outcomes.columns, outcomes.completed)
    draws = []
    for index, completed in enumerate(outcomes.completed):
        shares = {}
        for limit in limits:
            share = 1 - float(margins[limit.name][index]) / limit.number
            shares[limit.name] = math.inf if math.isnan(share) else share
        draws.append(_judged(shares, completed=bool(completed)))
    return draws


def _shown(run: RunResult, limits: Sequence[Requirement], worst: _Draw) -> dict[str, float | None]:
    """Return numbers of the first draw that are shown and not judged."""
    optimum_settles = None
    if worst.share > 1 and worst.tightest != ENDED:
        broken = next(limit for limit in limits if limit.name == worst.tightest)
        optimum = broken.of_optimum(run)
        optimum_settles = None if optimum is None else optimum.value
    deviation = None
    if run.controller.designed.follows_optimum:
        deviation = run.metrics["deviation"].value

    amplitude, frequency = oscillation(run.comparison.time, run.comparison.error)
    return {
        "amplitude": amplitude,
        "frequency": frequency,
        "variation": run.metrics["total_variation"].value,
        "deviation": deviation,
        "optimum_settles": optimum_settles,
    }


def measured_rows(studied: Ladder) -> list[RungResult]:
    """Judge the logs of the real machine that the case names: a row for each law of a log.

    Raises:
        ArgumentError: If a log cannot be read or is too short.
    """
    laws = {law.name for law in studied.laws}
    draws_of: dict[str, list[_Draw]] = {}
    for result in measured_results(studied.machine):
        if result.controller.name in laws:
            judged = result.requirements
            limits = of_laws([item.requirement for item in judged], laws)
            shares = {limit.name: item.share for limit, item in zip(limits, judged, strict=True)}
            draws_of.setdefault(result.controller.name, []).append(_judged(shares))

    rows = []
    for law, logs in draws_of.items():
        worst = max(logs, key=lambda log: log.share)
        rows.append(
            RungResult(
                law=law,
                rung=MEASURED,
                together=True,
                condition=studied.conditions[0].name,
                draws=len(logs),
                kept_draws=sum(log.kept for log in logs),
                share_of_the_tightest_limit=worst.share,
                tightest=worst.tightest,
                shares=worst.shares,
            )
        )
    return rows


# Runs of a rung: the recorded one, further draws, other assumed numbers


def _designed(law: StudiedLaw, rung: Rung, condition: Condition) -> tuple[Experiment, Controller]:
    """Return the experiment of a rung without its loop and parts, and the law designed for it."""
    bare = condition.experiment
    if not rung.sampled:
        bare = bare.with_settings(control_period=bare.settings.timestep)
    return bare, bare.with_settings(**law.sampled).law(rung.plant, law.base)


def run_of(law: StudiedLaw, rung: Rung, condition: Condition) -> RunResult:
    """Run a law on a rung: the first draw, recorded.

    Raises:
        GrosmcError: If the law cannot be designed or put into the loop.
    """
    bare, controller = _designed(law, rung, condition)
    loop = None
    if rung.looped:
        loop = bare.loop_around(controller, rung.loop, predict=law.predict)
    built = rung.built(bare)
    return run_on(built, rung.plant, controller, built.plant(rung.plant), loop)


def _further_draws(
    studied: Ladder,
    law: StudiedLaw,
    rung: Rung,
    condition: Condition,
    limits: Sequence[Requirement],
) -> Outcomes | None:
    """Run all draws of a rung but the first; None where nothing is drawn."""
    draws = [(rung, number) for number in studied.draws_of(rung)]
    if len(draws) == 1:
        return None
    return _run(law, condition, limits, draws[1:])


def _run(
    law: StudiedLaw,
    condition: Condition,
    limits: Sequence[Requirement],
    draws: Sequence[tuple[Rung, int]],
) -> Outcomes:
    """Run draws of rungs with the same plant and sampling in one batch.

    Raises:
        GrosmcError: If the law cannot be put into the loop.
    """
    first, _ = draws[0]
    bare, controller = _designed(law, first, condition)
    plants = {}
    rows = []
    for rung, draw in draws:
        if id(rung) not in plants:
            plants[id(rung)] = rung.built(bare).plant(rung.plant)
        case = bare
        if rung.looped:
            case = bare.varied(loop=rung.loop.draw(draw))
        rows.append(
            Row(
                controller,
                case=case,
                number=draw,
                plant=plants[id(rung)],
                predict=law.predict,
            )
        )
    return run_rows(bare, rows, limits, first.plant)


def _turned_by(
    law: StudiedLaw,
    condition: Condition,
    limits: Sequence[Requirement],
    changed: Mapping[str, Rung],
    draws: Sequence[int],
    *,
    kept: bool,
) -> tuple[str, ...]:
    """Return the changes of assumed numbers that turn the verdict of a rung.

    Each changed rung is run in the worst draw. If that is kept and the rung is not, the change
    must keep all other draws, too.

    Args:
        law: The law.
        condition: Plant and loads.
        limits: Limits of the rung.
        changed: The rung with another number, by the change.
        draws: Numbers of all draws, the worst first.
        kept: Whether the rung keeps all requirements.
    """
    if not changed:
        return ()

    outcomes = _run(law, condition, limits, [(rung, draws[0]) for rung in changed.values()])
    judged = _judged_outcomes(outcomes, limits)
    turned = []
    for (change, rung), draw in zip(changed.items(), judged, strict=True):
        kept_by_change = draw.kept
        if draw.kept and not kept:
            kept_by_change = _kept_in_all(law, condition, limits, rung, draws[1:])
        if kept_by_change != kept:
            turned.append(change)
    return tuple(turned)


def _kept_in_all(
    law: StudiedLaw,
    condition: Condition,
    limits: Sequence[Requirement],
    rung: Rung,
    draws: Sequence[int],
) -> bool:
    """Whether draws keep all requirements; a few at a time, for the first that fails decides."""
    for first in range(0, len(draws), _DRAWS_AT_ONCE):
        some = [(rung, number) for number in draws[first : first + _DRAWS_AT_ONCE]]
        outcomes = _run(law, condition, limits, some)
        if not all(draw.kept for draw in _judged_outcomes(outcomes, limits)):
            return False
    return True


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


def oscillation(time: Array, signal: Array) -> tuple[float, float | None]:
    """Return amplitude and frequency of a signal in the end of a run.

    Args:
        time: Equally spaced instants [s], (N,).
        signal: The signal, (N,).

    Returns:
        Half of its range, in its unit, and its swings a second [Hz]; None for no cycle.
    """
    tail = signal[-max(2, round(_END * len(signal))) :]
    about = tail - tail.mean()
    amplitude = float(np.ptp(tail) / 2)

    # A crossing of the mean counts once it is left by a tenth of the amplitude.
    side = np.sign(about)[np.abs(about) > 0.1 * amplitude]
    crossings = int(np.count_nonzero(np.diff(side)))
    if amplitude == 0 or crossings < 2 * _SWINGS:
        return amplitude, None
    duration = len(tail) * float(time[1] - time[0])
    return amplitude, crossings / 2 / duration

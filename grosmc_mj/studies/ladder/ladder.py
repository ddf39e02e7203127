"""Ladder of a machine: each law at each rung, judged over draws of what is random."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from typing import Any

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import ClaimTable
from grosmc_mj.experiments.file.user_code import is_named, named_in, sources
from grosmc_mj.experiments.measured import MEASURED, measured_results
from grosmc_mj.experiments.requirements.judging import of_laws
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.errors import ArgumentError, GrosmcError, SetupError
from grosmc_mj.studies.ladder.draws import (
    JudgedDraw,
    further_draws,
    judge_draws,
    judge_shares,
    run_of,
    shown_numbers,
    turned_by,
)
from grosmc_mj.studies.ladder.row import RungResult
from grosmc_mj.studies.ladder.rungs import Rung, rungs_of, varied_rungs
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
        further = further_draws(law, rung, condition, measured_limits, studied.draws_of(rung))
    except SetupError:
        raise
    except GrosmcError as error:
        return row.model_copy(update={"impossible": str(error)})

    draws = judge_draws(run, further, limits)
    worst = max(draws, key=lambda draw: draw.share)
    claimed = {}
    for name, limits_of_claim in claims.items():
        judged = judge_draws(run, further, limits_of_claim)
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
        measured |= shown_numbers(run, limits, worst)
    if together:
        worst_first = sorted(range(len(draws)), key=lambda i: draws[i].share, reverse=True)
        changed = studied.varied_rungs_of(rung, condition)
        measured["hangs_on"] = turned_by(
            law, condition, limits, changed, worst_first, kept=worst.kept
        )
    return row.model_copy(update=measured)


def measured_rows(studied: Ladder) -> list[RungResult]:
    """Judge the logs of the real machine that the case names: a row for each law of a log.

    Raises:
        ArgumentError: If a log cannot be read or is too short.
    """
    laws = {law.name for law in studied.laws}
    draws_of: dict[str, list[JudgedDraw]] = {}
    for result in measured_results(studied.machine):
        if result.controller.name in laws:
            judged = result.requirements
            limits = of_laws([item.requirement for item in judged], laws)
            shares = {limit.name: item.share for limit, item in zip(limits, judged, strict=True)}
            draws_of.setdefault(result.controller.name, []).append(judge_shares(shares))

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

"""How each law stands on each rung."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

from grosmc_mj.errors import ArgumentError, GrosmcError
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements import judge
from grosmc_mj.experiments.runs import RunResult, run_on
from grosmc_mj.loop import in_loop
from grosmc_mj.studies.ladder.claims import shares_of_claims
from grosmc_mj.studies.ladder.oscillation import Oscillation, chatter, oscillation
from grosmc_mj.studies.ladder.rungs import Rung, rungs_of
from grosmc_mj.studies.studied import (
    Condition,
    StudiedLaw,
    chosen_laws,
    conditions_of,
    judgeable_in,
    laws_of,
    limits_of,
)

# The case of a system whose loop and machine are those that one can buy.
MACHINE = "machine"
# What breaks first of a run that ended early.
ENDED = "the run ended"


@dataclass(frozen=True, eq=False)
class Ladder:
    """A target, ready to be climbed.

    Attributes:
        experiment: The target's, without loop and machine.
        machine: The same with both.
        laws: Those that climb.
        climbing: Rungs, each with all that is below it.
        alone: What is added, each alone on a sampled plant.
        conditions: The nominal one first.
        statements: What the chapter says, by the ids of the file's claims.
    """

    experiment: Experiment
    machine: Experiment
    laws: Sequence[StudiedLaw]
    climbing: Sequence[Rung]
    alone: Sequence[Rung]
    conditions: Sequence[Condition]
    statements: Mapping[str, str] = field(default_factory=dict)


class Standing(NamedTuple):
    """A law on a rung.

    Attributes:
        law: The law.
        rung: The rung.
        together: Whether all below is there too.
        condition: Under which condition.
        used: Largest share of a limit that is used; above 1 it is not kept, infinite where there is
            nothing to measure.
        worst: The requirement that it is of, or how the run ended.
        shares: The share used of each limit.
        oscillation: Of the error in the end; None of a run that ended early.
        chatter: Of what the law asks for in the end, in the input's unit; None likewise.
        variation: Total variation of the input a second; None likewise. It is not judged.
        deviation: Largest distance from the nominal optimum, in the unit of the output, of a law
            that follows it; None of others, and of a run that ended early.
        impossible: Why there is no such run; empty if there is.
        claims: The share used of the limits of each claim that is said of this law under this
            condition, by its id; above 1 it has fallen.
    """

    law: StudiedLaw
    rung: Rung
    together: bool
    condition: Condition
    used: float
    worst: str
    shares: Mapping[str, float]
    oscillation: Oscillation | None = None
    chatter: float | None = None
    variation: float | None = None
    deviation: float | None = None
    impossible: str = ""
    claims: Mapping[str, float] = MappingProxyType({})

    @property
    def kept(self) -> bool:
        """Whether everything is kept."""
        return self.used <= 1 and not self.impossible


def ladder(target: str, chosen: Sequence[str] = (), *, loaded: bool = False) -> Ladder:
    """What is climbed for a target.

    Args:
        target: A system, which means its machine, ``SYSTEM/CASE``, or the path of a case file.
        chosen: Names of laws; all by default.
        loaded: Whether laws climb under the system's other cases, too.

    Raises:
        ArgumentError: If there is no such target or law, neither loop nor machine, or nothing is
            required.
    """
    found = find_experiments(target)
    machine = next((each for each in found if each.case.name == MACHINE), found[0])
    if not machine.file.requirement:
        raise ArgumentError(f"{machine.path}: nothing is required: give it a [[requirement]]")
    own = tuple(edit for edit in machine.case.edits if edit not in machine.case.parts)
    bare = machine.varied(loop=None, edits=own)
    climbing, alone = rungs_of(machine)
    if not alone:
        raise ArgumentError(
            f"{machine.path}: there is nothing to climb to: give the file a loop ([computing], "
            "[[sensor]], [[actuator]]) or a machine ([[motor]], [[lugre]], [[transmission]], "
            "[[stop]])"
        )
    conditions = conditions_of(bare)
    return Ladder(
        experiment=bare,
        machine=machine,
        laws=chosen_laws(laws_of(bare), chosen),
        climbing=climbing,
        alone=alone,
        conditions=conditions if loaded else conditions[:1],
    )


def standing(
    studied: Ladder, law: StudiedLaw, rung: Rung, condition: Condition, *, together: bool
) -> Standing:
    """How a law stands on a rung."""
    try:
        result = run_of(studied, law, rung, condition)
    except GrosmcError as error:
        return Standing(law, rung, together, condition, math.inf, "", {}, impossible=str(error))
    limits = limits_of(studied.experiment, law, condition, [rung.plant])
    limits = judgeable_in(limits, rung.loop, studied.machine.case.loop)
    judged = [judge(limit, result) for limit in limits]
    shares = {each.limit.key: each.share for each in judged if each.limit.value}
    worst = max(shares, key=lambda key: shares[key], default="")
    run, claims = result.trajectory, shares_of_claims(studied.machine, law, condition, result)
    if result.ended:
        return Standing(law, rung, together, condition, math.inf, ENDED, shares, claims=claims)
    return Standing(
        law, rung, together, condition, shares.get(worst, 0.0), worst, shares,
        oscillation(run.time, result.comparison.error), chatter(run.time[:-1], run.command),
        result.metrics["total_variation"].value,
        result.metrics["deviation"].value if law.follows_optimum else None,
        claims=claims,
    )  # fmt: skip


def run_of(studied: Ladder, law: StudiedLaw, rung: Rung, condition: Condition) -> RunResult:
    """The run of a law on a rung.

    Raises:
        GrosmcError: If the law cannot be designed or put into the loop.
    """
    bare = condition.experiment
    h = bare.settings.timestep
    if not rung.sampled:
        bare = bare.with_settings(control_period=h)
    made = law.made(bare, rung.plant)
    here = bare.varied(edits=(*bare.case.edits, *rung.parts))
    if rung.looped:
        made = in_loop(
            made, rung.loop, bare.nominal.system, control_period=bare.settings.control_period,
            timestep=h, predict=law.predict,
        )  # fmt: skip
    return run_on(here, rung.plant, made, here.plant(rung.plant))

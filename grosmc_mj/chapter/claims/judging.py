"""Judge claims: one in this process, or many in several."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any

from grosmc_mj.chapter.claims.claim import (
    Choice,
    Claim,
    ClaimFinding,
    ClaimValue,
    ClaimVerdict,
    NeedsSlidingModeError,
    PlantFinding,
)
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.ground.errors import GrosmcError
from grosmc_mj.ground.executors import Executor, Notice

# Relative difference up to which physics counts as equal to the equations. Rounding leaves a
# thousandth of it after a run of 20 s.
_SAME = 1e-6
# Claims of one system that a process takes at once: neighbours in its file share their runs.
_PART = 8


def judge(lab: RunCache, claim: Claim, *, refine: bool = True) -> ClaimFinding:
    """Measure a claim on every plant, at the run cache's settings and at half the time steps.

    The choices are tried on the plant that decides, and count on every plant.

    Args:
        lab: Cache of the runs.
        claim: The claim.
        refine: Whether to measure at half the time steps too.
    """
    trials = _trials(lab, claim)
    plants: dict[PlantName, PlantFinding] = {}
    for plant in claim.plants:
        equations = None
        if plant == "physics":
            equations = plants.get("corrected")
        plants[plant] = _judge_on(lab, claim, plant, trials, equations, refine=refine)

    finding = ClaimFinding(claim, plants, trials=trials)
    if claim.premise is None or finding.verdict not in (
        ClaimVerdict.REFUTED,
        ClaimVerdict.UNDETERMINED,
    ):
        return finding

    because = claim.premise(lab)
    if because:
        for plant, on_plant in plants.items():
            if on_plant.verdict is ClaimVerdict.REFUTED:
                plants[plant] = replace(on_plant, verdict=ClaimVerdict.PREMISE_NOT_MET)
    return replace(finding, because=because)


def _trials(lab: RunCache, claim: Claim) -> dict[str, ClaimValue]:
    """Measurements on the plant that decides, for the choices that the claim is meant for."""
    trials = {}
    for choice in claim.choices:
        if choice.name in (*claim.every, *claim.some):
            for value in choice.values:
                measured = measure_with(lab, claim, claim.plants[-1], choice, value)
                trials[choice.written(value)] = measured
    return trials


def _judge_on(
    lab: RunCache,
    claim: Claim,
    plant: PlantName,
    trials: Mapping[str, ClaimValue],
    equations: PlantFinding | None,
    *,
    refine: bool,
) -> PlantFinding:
    """Judge a claim on one plant; ``equations`` is the finding that may stand in for physics."""
    measured = claim.measure(lab, plant)
    refined = None
    finer = plant
    if refine and not claim.exact:
        if equations is not None and _same(measured, equations.measured):
            # Half the time steps cost twenty times as much on physics.
            refined = equations.refined
            finer = "corrected"
        else:
            refined = claim.measure(lab.refined, plant)

    verdict = _verdict(claim, measured, refined, trials.values())
    return PlantFinding(measured, refined, verdict, finer)


def _verdict(
    claim: Claim, measured: ClaimValue, refined: ClaimValue | None, trials: Iterable[ClaimValue]
) -> ClaimVerdict:
    """The verdict on one plant, by its values at both time steps and by the trials."""
    values = [measured]
    if refined is not None:
        values.append(refined)

    holds = claim.holds(measured)
    for value in values:
        if not _conclusive(value) or claim.holds(value) is not holds:
            return ClaimVerdict.INCONCLUSIVE

    for trial in trials:
        if not trial.broken and claim.holds(trial) is not holds:
            return ClaimVerdict.SUPPORTED if claim.some else ClaimVerdict.UNDETERMINED
    return ClaimVerdict.SUPPORTED if holds else ClaimVerdict.REFUTED


def _conclusive(measured: ClaimValue) -> bool:
    """Whether a measurement can be judged; a missing value can: it meets no criterion."""
    if measured.broken:
        return False
    return measured.value is None or math.isfinite(measured.value)


def _same(physics: ClaimValue, equations: ClaimValue) -> bool:
    """Whether both plants gave the same value."""
    if physics.value is None or equations.value is None or physics.broken or equations.broken:
        return False
    return math.isclose(physics.value, equations.value, rel_tol=_SAME)


def measure_with(
    lab: RunCache, claim: Claim, plant: PlantName, choice: Choice, value: Any
) -> ClaimValue:
    """Measure with another value of a choice; broken where no law can be designed.

    Raises:
        NeedsSlidingModeError: If the law has no sliding variable, which the measurement needs.
    """
    try:
        if choice.argument:
            return claim.measure(lab, plant, **{choice.argument: value})
        return claim.measure(lab.varied(choice.key, value), plant)
    except NeedsSlidingModeError:
        raise
    except GrosmcError as error:
        return ClaimValue(None, str(error), broken=True)


def verdict_differences(findings: Sequence[ClaimFinding]) -> list[str]:
    """Return one line for each verdict that is not the expected one."""
    lines = []
    for finding in findings:
        for plant, verdict in finding.unexpected.items():
            expected = finding.claim.verdicts[plant].value
            line = f"claim {finding.claim.id} on {plant}: {verdict.value}, expected {expected}"
            lines.append(line)
    return lines


def judge_claims(
    lab: RunCache,
    claims: Sequence[Claim],
    executor: Executor,
    advance: Callable[[str], object] = lambda _: None,
    notice: Notice = lambda _: None,
) -> Iterator[ClaimFinding]:
    """Judge claims as ``judge`` does; yield them in the order in which processes finish them.

    Args:
        lab: Cache of the runs; another process gets a copy without the runs.
        claims: The claims.
        executor: Executor of the processes.
        advance: Called with a claim's id when it has been judged.
        notice: Called when a worker died and was replaced.

    Raises:
        GrosmcError: As a measurement or the executor raises it.
    """
    parts = parts_of(claims)
    judge_part = partial(_judged, lab, parts)
    with closing(executor.run(judge_part, range(len(parts)), notice)) as answers:
        for part in answers:
            for claim, finding in zip(parts[part.index], part.report, strict=True):
                # A finding from another process has a copy of the claim.
                yield replace(finding, claim=claim)
                advance(claim.id)


def parts_of(claims: Sequence[Claim]) -> list[list[Claim]]:
    """Return claims in parts, each of one system."""
    by_system: dict[str, list[Claim]] = {}
    for claim in sorted(claims, key=attrgetter("system")):
        by_system.setdefault(claim.system, []).append(claim)

    parts = []
    for group in by_system.values():
        parts += [group[first : first + _PART] for first in range(0, len(group), _PART)]
    return parts


def _judged(lab: RunCache, parts: Sequence[Sequence[Claim]], index: int) -> list[ClaimFinding]:
    """Judge a part; all parts that come to one process share its runs."""
    return [judge(lab, claim) for claim in parts[index]]

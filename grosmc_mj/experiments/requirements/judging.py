"""Judgements of runs with their margins, and what is known of requirements before a run."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.experiments.requirements.measured_run import MeasuredRun
from grosmc_mj.experiments.requirements.measurement import Windows
from grosmc_mj.experiments.requirements.metrics import MeasuredSignal
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.results.verdicts import share_of
from grosmc_mj.simulation.trajectory import Status


class Judgement(NamedTuple):
    """A requirement of one run, judged.

    Attributes:
        requirement: The requirement.
        controller: Name of the run's controller.
        plant: Name of the run's plant.
        measured: Measured value in the requirement's unit; None if nothing could be measured, and
            of a formula that has a margin alone.
        margin: Allowed less measured value, or the margin of a formula; None without one.
        kept: Whether the run keeps it.
        note: Reason why nothing was measured; of an input its time at the actuators' limit.
    """

    requirement: Requirement
    controller: str
    plant: str
    measured: float | None
    margin: float | None
    kept: bool
    note: str = ""

    @property
    def share(self) -> float:
        """Measured over allowed value; infinite without a measurement."""
        if self.margin is None:
            return math.inf
        return share_of(self.margin, self.requirement.number)


def judge_runs(requirements: Iterable[Requirement], runs: Sequence[MeasuredRun]) -> list[Judgement]:
    """Judge each run by each requirement that is about it."""
    judgements = []
    for requirement in requirements:
        runs_of_it = filter(requirement.applies_to, runs)
        judgements += [judge_run(requirement, run) for run in runs_of_it]
    return judgements


def judge_run(requirement: Requirement, run: MeasuredRun) -> Judgement:
    """Judge a run by a requirement; a run that ended early keeps none."""
    measured = None
    margin = None
    kept = False
    if run.status is not Status.COMPLETED:
        note = f"the run ended at {float(run.trajectory.valid_until):.3g} s"
    else:
        measured, note = requirement.measured(run)
        if measured is not None:
            margin = float(requirement.margin_of(measured))
            kept = margin >= 0
        if not requirement.has_value:
            measured = None
        notes = (note, requirement.note(run, kept=kept))
        note = "; ".join(filter(None, notes))
    return Judgement(requirement, run.controller.name, run.plant, measured, margin, kept, note)


# -- all requirements of some runs ---------------------------------------------------------------


def of_laws(requirements: Iterable[Requirement], laws: Container[str]) -> tuple[Requirement, ...]:
    """Return the requirements of the laws that are run, with unique names.

    Args:
        requirements: All requirements.
        laws: Names of the laws that are run.
    """
    chosen: list[Requirement] = []
    taken = Counter[str]()
    for requirement in requirements:
        names = tuple(name for name in requirement.laws if name in laws)
        if not names:
            continue
        name = f"{requirement.key} {requirement.signal}".rstrip()
        taken[name] += 1
        if taken[name] > 1:
            name = f"{name} {taken[name]}"
        chosen.append(replace(requirement, laws=names, name=name))
    return tuple(chosen)


def decidable(
    requirements: Iterable[Requirement], transient: float
) -> tuple[list[Requirement], list[str]]:
    """Return the requirements that runs can decide, and a note about each of the other ones.

    Args:
        requirements: All requirements.
        transient: Time before a disturbance begins or a run ends [s].
    """
    judged = []
    notes = []
    for requirement in requirements:
        reason = requirement.why_undecidable(transient)
        if reason:
            notes.append(f"not judged: {requirement.words}: {reason}")
        else:
            judged.append(requirement)
    return judged, notes


def unfailing(requirements: Iterable[Requirement], runs: Sequence[MeasuredRun]) -> list[str]:
    """Return a line for each requirement that none of the runs could fail, with the reason."""
    lines = []
    for requirement in requirements:
        reasons = [
            requirement.why_unfailing(run.controller, run.input_limits)
            for run in runs
            if requirement.applies_to(run)
        ]
        lines += unfailing_line(requirement, reasons)
    return list(dict.fromkeys(lines))


def unfailing_line(requirement: Requirement, reasons: Sequence[str]) -> list[str]:
    """Return the line on a requirement if there is a reason for each of its runs, else none."""
    if not reasons or not all(reasons):
        return []
    return [f"cannot fail: {requirement.words} ({max(reasons, key=len)})"]


def windows_of(requirements: Iterable[Requirement]) -> Windows:
    """Return the windows, bands and signals that requirements need."""
    after: set[float] = set()
    bands: set[float] = set()
    signals: set[MeasuredSignal] = set()
    for requirement in requirements:
        windows = requirement.windows
        after.update(windows.after)
        bands.update(windows.bands)
        signals.update(windows.signals)
    return Windows(
        after=tuple(sorted(after)),
        bands=tuple(sorted(bands)),
        signals=tuple(sorted(signals)),
    )


def margins_of(
    requirements: Iterable[Requirement], metrics: Mapping[str, Array], completed: NDArray[np.bool_]
) -> dict[str, Array]:
    """Return allowed less measured value of n runs by name, (n,) each; -inf if one ended early.

    Args:
        requirements: Requirements of the runs' controller.
        metrics: Metrics of the runs, (n,) each.
        completed: Whether each run reached its end, (n,).
    """
    margins = {}
    for requirement in requirements:
        margin = requirement.margin_of(metrics[requirement.metric])
        margins[requirement.name] = np.where(completed, margin, -np.inf)
    return margins

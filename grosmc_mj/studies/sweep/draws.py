"""Verdict on a run in a loop over draws: random numbers, and phases of the encoders."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.requirements.judging import Judgement, margins_of
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.studies.sweep.runs import Outcomes, Row, run_rows

# Most draws of a run.
_MOST_DRAWS = 1000


def require_draws(draws: int, option: str = "--draws") -> None:
    """Refuse a number of draws that no study can make.

    Args:
        draws: The number.
        option: Option that has it.

    Raises:
        ArgumentError: If it is below 1 or too large.
    """
    if not 1 <= draws <= _MOST_DRAWS:
        raise ArgumentError(f"{option} {draws} must be from 1 to {_MOST_DRAWS}")


def drawn_case(case: Experiment, number: int) -> Experiment:
    """Return a case with the loop and the number of the run of a draw; draw 0 is the case itself.

    Args:
        case: The case.
        number: Number of the draw.
    """
    if number == 0 or case.loop is None:
        return case
    return case.changed(loop=case.loop.draw(number), run_number=case.run_number + number)


def judged_over_draws(result: RunResult, draws: int) -> RunResult:
    """Return a run that is judged by the worst of its draws, each requirement by its own.

    Args:
        result: The run, which is the first draw.
        draws: Runs in all; the run alone counts where nothing is drawn.

    Raises:
        GrosmcError: If a draw cannot be run.
    """
    case = result.case
    nothing_drawn = case.loop is None or not case.loop.drawn
    if nothing_drawn or draws == 1 or not result.requirements:
        return result

    limits = [judgement.requirement for judgement in result.requirements]
    rows = [_row(result, number) for number in range(1, draws)]
    outcomes = run_rows(case, rows, limits, result.plant)
    judged = [_worst(judgement, outcomes) for judgement in result.requirements]
    return replace(result, judged=tuple(judged))


def _row(result: RunResult, number: int) -> Row:
    """Return the row of a further draw of a run."""
    case = result.case
    return Row(
        result.controller,
        case=drawn_case(case, number),
        plant=result.true,
        predict=case.predicts(result.controller.name),
    )


def _worst(first: Judgement, outcomes: Outcomes) -> Judgement:
    """Return the judgement with the least margin, with the number of draws that keep it.

    Args:
        first: Judgement of the first draw.
        outcomes: The further draws.
    """
    requirement = first.requirement
    margins = margins_of([requirement], outcomes.columns, outcomes.completed)[requirement.name]
    margins = np.where(np.isnan(margins), -np.inf, margins)
    kept = int(first.kept) + int((margins >= 0).sum())
    draws = 1 + len(margins)

    # A note is about the run that is judged: the first draw's is not the worst one's.
    worst = first
    least = float(margins.min())
    if first.margin is not None and least == -math.inf:
        worst = first._replace(
            measured=None, margin=None, kept=False, note="a draw ends early or never gets there"
        )
    elif first.margin is not None and least < first.margin:
        measured = None
        if requirement.has_value:
            measured = float(outcomes[requirement.metric][margins.argmin()])
        worst = first._replace(measured=measured, margin=least, kept=least >= 0, note="")

    if 0 < kept < draws:
        notes = [worst.note, f"kept in {kept} of {draws} draws"]
        worst = worst._replace(note="; ".join(filter(None, notes)))
    return worst

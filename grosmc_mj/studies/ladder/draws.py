"""Draws of a law on a rung, run and judged; the first one is recorded, some have other numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.experiment import Experiment, RunResult, run_on
from grosmc_mj.experiments.requirements.judging import judge_run, margins_of
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.arrays import Array
from grosmc_mj.studies.ladder.row import ENDED
from grosmc_mj.studies.ladder.rungs import Rung
from grosmc_mj.studies.sweep.runs import Outcomes, Row, run_rows
from grosmc_mj.studies.target import Condition, StudiedLaw
from grosmc_mj.theory.control.controller import Controller

# Share of a run that is its end.
_END = 0.2
# Draws of a changed rung that run together.
_DRAWS_AT_ONCE = 4
# Fewer swings than these are no cycle.
_SWINGS = 3


class JudgedDraw(NamedTuple):
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


def judge_shares(shares: dict[str, float], *, completed: bool = True) -> JudgedDraw:
    """Judge a run by the shares that it uses of its limits."""
    if not completed:
        return JudgedDraw(math.inf, ENDED, shares)
    tightest = max(shares, key=lambda name: shares[name], default="")
    return JudgedDraw(shares.get(tightest, 0.0), tightest, shares)


def judge_draws(
    run: RunResult, further: Outcomes | None, limits: Sequence[Requirement]
) -> list[JudgedDraw]:
    """Judge the recorded run, which is the first draw, and the further ones, if there are any."""
    shares = {limit.name: judge_run(limit, run).share for limit in limits}
    draws = [judge_shares(shares, completed=not run.ended)]
    if further is not None:
        draws += _judge_outcomes(further, limits)
    return draws


def _judge_outcomes(outcomes: Outcomes, limits: Sequence[Requirement]) -> list[JudgedDraw]:
    """Judge draws that are not recorded."""
    margins = margins_of(limits, outcomes.columns, outcomes.completed)
    draws = []
    for index, completed in enumerate(outcomes.completed):
        shares = {}
        for limit in limits:
            share = 1 - float(margins[limit.name][index]) / limit.number
            shares[limit.name] = math.inf if math.isnan(share) else share
        draws.append(judge_shares(shares, completed=bool(completed)))
    return draws


def shown_numbers(
    run: RunResult, limits: Sequence[Requirement], worst: JudgedDraw
) -> dict[str, float | None]:
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


def further_draws(
    law: StudiedLaw,
    rung: Rung,
    condition: Condition,
    limits: Sequence[Requirement],
    numbers: range,
) -> Outcomes | None:
    """Run all draws of a rung but the first; None where nothing is drawn."""
    draws = [(rung, number) for number in numbers]
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


def turned_by(
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
    judged = _judge_outcomes(outcomes, limits)
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
        if not all(draw.kept for draw in _judge_outcomes(outcomes, limits)):
            return False
    return True


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

"""Margins of a task: how far gain and delay may change until a requirement is no longer kept."""

from __future__ import annotations

from collections.abc import Sequence

from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.wording import spelled
from grosmc_mj.output.results.verdicts import Verdict, over_draws
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.studies.margins.changes import DELAY, GAIN_DOWN, GAIN_UP, ChangeSearch
from grosmc_mj.studies.sweep.search import run_searches
from grosmc_mj.studies.target import Condition, StudiedLaw
from grosmc_mj.studies.trials import Trial, Trials

# Step of a verdict on a loop without any change.
AS_IS = "as it is"


def task_margins(trials: Trials, law: StudiedLaw, condition: Condition) -> list[Verdict]:
    """Search how far gain and delay of a loop may change under a condition.

    Args:
        trials: Runs the loops.
        law: The law.
        condition: Condition whose experiment has the loop as it is.

    Returns:
        The largest change of each kind that is kept in all draws, as a factor, 1/factor of ``gain
        down``, or in seconds; its further numbers have ``failing_draws``, the draws that do not
        keep the smallest failing change. Of a law that does not keep its task without a change, the
        verdict on that alone.

    Raises:
        ArgumentError: If the law does not fit into the loop.
    """
    experiment = condition.experiment
    loop = experiment.loop or Loop()
    as_is = Trial(law, condition, loop)
    (verdict,) = trials.over_draws([as_is])
    if verdict.impossible:
        raise ArgumentError(verdict.impossible)
    if not verdict.kept:
        verdict = over_draws(trials.all_draws(as_is))
        failing = verdict.draws - verdict.kept_draws
        words = _in_draws(_breaking(verdict), failing, verdict.draws)
        return [verdict.changed(step=AS_IS, text="not kept", words=words)]

    inputs = [signal.name for signal in experiment.nominal.system.inputs]
    timestep = experiment.settings.timestep
    searches = [ChangeSearch(kind, loop, inputs, timestep) for kind in (GAIN_DOWN, GAIN_UP, DELAY)]

    def passing(tried: Sequence[tuple[ChangeSearch, float]]) -> list[bool]:
        changed = [Trial(law, condition, search.at(factor)) for search, factor in tried]
        return [verdict.kept for verdict in trials.over_draws(changed)]

    run_searches(searches, passing)
    return [_margin(trials, as_is, search) for search in searches]


def _margin(trials: Trials, as_is: Trial, search: ChangeSearch) -> Verdict:
    """The verdict on all changes of one kind."""
    kept, failed = search.bounds
    draws = len(trials.numbers(as_is))
    row = Verdict(
        law=as_is.law.name,
        step=search.kind,
        condition=as_is.condition.name,
        share=0.0,
        draws=draws,
        kept_draws=draws,
        largest_kept=kept,
        text=search.text,
        numbers={"failing_draws": 0.0},
    )
    if search.failed is None:
        return row

    # All draws of it, for those after a failing one have not been run.
    breaks = over_draws(trials.all_draws(as_is._replace(loop=search.at(search.failed))))
    failing = breaks.draws - breaks.kept_draws
    return row.changed(
        tightest=breaks.tightest,
        ended=breaks.ended,
        smallest_failed=failed,
        words=_in_draws(_breaking(breaks), failing, breaks.draws),
        numbers={"failing_draws": float(failing)},
    )


def _breaking(verdict: Verdict) -> str:
    """The requirement that is not kept, or how the run ended."""
    if verdict.ended:
        return f"the run ended: {verdict.ended}"
    return spelled(verdict.tightest) or verdict.impossible


def _in_draws(reason: str, failing: int, draws: int) -> str:
    """Write what breaks, with the draws in which it does unless it does in all of them."""
    if failing == draws:
        return reason
    return f"{reason} in {failing} of {draws} draws"

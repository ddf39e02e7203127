"""What of the chapter's claims a run of a law keeps."""

from __future__ import annotations

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import ClaimTable
from grosmc_mj.experiments.requirements import judge
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.studies.studied import Condition, StudiedLaw, limits_in


def shares_of_claims(
    experiment: Experiment, law: StudiedLaw, condition: Condition, result: RunResult
) -> dict[str, float]:
    """How much of each claim's limits a run uses, by the claim's id.

    Args:
        experiment: Whose file has the claims.
        law: Whose run it is; a claim about others is not judged.
        condition: Under which it is; a claim about others is not judged.
        result: The run.

    Returns:
        The largest share of a claim's limits, infinite of a run that ended early; above 1 the claim
        has fallen. What a run of this length does not tell is not there.
    """
    found: dict[str, float] = {}
    for table in experiment.file.claim:
        if table.under != condition.name or not said_of(experiment, table, law):
            continue
        limits = limits_in([table], law, condition, [result.plant])
        shares = [judge(limit, result).share for limit in limits]
        if shares:
            found[table.id] = max([*shares, found.get(table.id, 0.0)])
    return found


def said_of(experiment: Experiment, table: ClaimTable, law: StudiedLaw) -> bool:
    """Whether a claim is about a law, however that law switches.

    Args:
        experiment: Whose file has the claim.
        table: The claim.
        law: The law, which is one that the table names, or another realization of it.
    """
    named = table.of or experiment.controllers
    written = {each.called: each.law for each in experiment.file.controller}
    return law.base in {name for each in named for name in (each, written.get(each, each))}

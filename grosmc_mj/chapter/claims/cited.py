"""The claims that a case file names."""

from __future__ import annotations

from grosmc_mj.chapter.claims.claim import Claim
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.errors import ArgumentError


def cited_claims(experiment: Experiment) -> dict[str, Claim]:
    """Return the claims that an experiment's file names, by their ids.

    Raises:
        ArgumentError: If there is no claim of such an id.
    """
    cited = experiment.file.claim
    if not cited:
        return {}

    # Imported late: the claims need many modules, and most files name no claim.
    from grosmc_mj.chapter.claims.ledger import find_claim

    try:
        return {table.id: find_claim(table.id) for table in cited}
    except ArgumentError as error:
        raise ArgumentError(f"{experiment.path}: {error}") from None

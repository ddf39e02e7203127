"""The claims that a case file names."""

from __future__ import annotations

from grosmc_mj.chapter.claims.claim import Claim
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment


def cited_claims(experiment: Experiment) -> dict[str, Claim]:
    """The claims that an experiment's file names, by their ids.

    Raises:
        ArgumentError: If there is none of such an id.
    """
    if not experiment.file.claim:
        return {}
    # Here, for it is much to import for a file that names none.
    from grosmc_mj.chapter.claims.ledger import find_claim

    try:
        return {table.id: find_claim(table.id) for table in experiment.file.claim}
    except ArgumentError as error:
        raise ArgumentError(f"{experiment.path}: {error}") from None

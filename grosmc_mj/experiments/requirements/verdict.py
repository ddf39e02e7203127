"""Verdict on a recorded run, from the judgements of its requirements."""

from __future__ import annotations

from collections.abc import Sequence

from grosmc_mj.experiments.requirements.judging import Judgement, of_laws
from grosmc_mj.output.results.verdicts import Verdict, verdict_of


def verdict_of_judgements(judgements: Sequence[Judgement], *, ended: str = "") -> Verdict:
    """Return the verdict on a run.

    Args:
        judgements: Judgement of the run by each of its requirements.
        ended: How it ended early; empty if it did not.
    """
    requirements = [judgement.requirement for judgement in judgements]
    # Two requirements of one kind have names of their own.
    limits = of_laws(requirements, {judgement.controller for judgement in judgements})
    shares = {
        limit.name: judgement.share for limit, judgement in zip(limits, judgements, strict=True)
    }
    return verdict_of(shares, ended=ended)

"""Judging a case file: its checks before anything runs, and the verdicts on its runs."""

from __future__ import annotations

from pathlib import Path

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements.judging import Judgement, judge_runs
from grosmc_mj.ground.errors import ArgumentError, GrosmcError


def refuse_unjudgeable(experiment: Experiment) -> None:
    """Refuse mistakes of a file that a single run would not notice.

    They are wrong [[uncertain]] tables, as a campaign would refuse them, and requirements none of
    which can be judged: nothing would be kept or failed.

    Raises:
        ArgumentError: For the first of both, with the path of the file.
    """
    if experiment.file.uncertain:
        from grosmc_mj.studies.sweep.family import family_of

        try:
            family_of(experiment.file, experiment)
        except GrosmcError as error:
            raise ArgumentError(f"{experiment.path}: {error}") from error

    if experiment.not_judged and not experiment.limits:
        notes = "; ".join(line.removeprefix("not judged: ") for line in experiment.not_judged)
        raise ArgumentError(f"{experiment.path}: no requirement can be judged: {notes}")


def judge(target: str | Path | Experiment) -> list[Judgement]:
    """Run an experiment, and judge every run by every requirement.

    Args:
        target: ``system/case`` of the package, the path of a case file, or an experiment.

    Raises:
        GrosmcError: If the file is wrong, as ``grosmc-mj run`` tells it, or a user's own law fails.
    """
    experiment = target if isinstance(target, Experiment) else Experiment.load(target)
    refuse_unjudgeable(experiment)
    return judge_runs(experiment.limits, list(experiment.runs()))

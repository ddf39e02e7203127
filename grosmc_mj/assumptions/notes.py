"""One-line notes on the runs of an experiment: what its verdict does not say by itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from grosmc_mj.assumptions.loads import idle_loads
from grosmc_mj.assumptions.matching import unmatched
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements import unfailing
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.experiments.weights import weights_in_words


def notes_on(experiment: Experiment, results: Sequence[RunResult]) -> list[str]:
    """Return the notes on an experiment's runs, the weightiest first.

    The loads are looked at on the truest plant that was run.

    Args:
        experiment: The experiment.
        results: Its runs.
    """
    truest = max(experiment.plant_names, key=experiment.nominal.names.index)
    on_truest = [result for result in results if result.plant == truest]

    notes = list(experiment.not_judged)
    notes += idle_loads(on_truest)
    notes += unmatched(experiment, on_truest)
    notes += unfailing(experiment.limits, results)
    notes += _weights_by_order(experiment, on_truest)
    if experiment.nominal.robot is not None:
        notes += experiment.nominal.robot.notes
    return notes


def _weights_by_order(experiment: Experiment, results: Sequence[RunResult]) -> Iterator[str]:
    """Yield the weights of a robot's laws by name where the file gives them in a list.

    Nobody but the model knows in which order its joints are.
    """
    if experiment.nominal.robot is None:
        return
    laws: dict[str, list[str]] = {}
    for result in results:
        law = result.controller
        numbers = experiment.file.law(law.name).numbers
        weights = [numbers.get(key, getattr(experiment.file.task, key)) for key in ("Q", "R")]
        if law.design is not None and any(isinstance(weight, list) for weight in weights):
            laws.setdefault(weights_in_words(law.design), []).append(law.name)
    for words, names in laws.items():
        yield f"weights of {', '.join(names)}, by the order of the list: {words}"

"""Conditions that a law is tuned under: loads, draws of what is random, and random plants."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import placed
from grosmc_mj.studies.sweep.draws import drawn_case, require_draws
from grosmc_mj.studies.sweep.family import Family, family_of, random_points
from grosmc_mj.studies.sweep.quantities import with_values
from grosmc_mj.studies.target import Condition, conditions_of

# Name of the condition of random plants.
PLANTS = "uncertain plants"


@dataclass(frozen=True, eq=False)
class TuningCondition:
    """Condition that a law is tuned under: a plant with its loads, in its loop as built.

    Attributes:
        condition: Plant and loads, with loop and machine.
        case: Function that returns the case of a draw, by its number.
        draws: Draws that designs are tuned on; 1 where nothing is drawn.
        drawn: Whether other draws are other runs.
    """

    condition: Condition
    case: Callable[[int], Experiment]
    draws: int
    drawn: bool

    @property
    def name(self) -> str:
        """Name of the condition."""
        return self.condition.name


def tuning_conditions(
    experiment: Experiment, names: Sequence[str], draws: int
) -> list[TuningCondition]:
    """Return conditions of a case, in its loop and on its machine as built.

    Args:
        experiment: Experiment of the case.
        names: Names of the conditions; all by default.
        draws: Draws that designs are tuned on.

    Raises:
        ArgumentError: If there is no such condition.
    """
    parts = experiment.parts
    edits = tuple(edit for edit in experiment.edits if edit not in parts)
    conditions = {}
    for bare in conditions_of(experiment.changed(loop=None, edits=edits)):
        case = bare.experiment
        built = case.changed(loop=experiment.loop, edits=(*case.edits, *parts))
        conditions[bare.name] = Condition(bare.name, bare.title, built)

    for name in names:
        require_known("condition", name, conditions)
    chosen = [conditions[name] for name in dict.fromkeys(names or conditions)]
    return [_tuning_condition(condition, draws) for condition in chosen]


def _tuning_condition(condition: Condition, draws: int) -> TuningCondition:
    """Return a condition with the draws of its loop."""
    loop = condition.experiment.loop
    drawn = loop is not None and loop.drawn
    return TuningCondition(
        condition=condition,
        case=partial(drawn_case, condition.experiment),
        draws=draws if drawn else 1,
        drawn=drawn,
    )


def uncertain_plants(experiment: Experiment, plants: int, seed: int) -> TuningCondition:
    """Return random plants of the family that a case declares, each with a draw of its own.

    Args:
        experiment: Experiment of the case.
        plants: Number of the plants that designs are tuned on.
        seed: Seed of the plants.

    Raises:
        ArgumentError: If it declares none.
    """
    require_draws(plants, "--plants")
    with placed(f"{experiment.path}: --plants {plants}: "):
        family = family_of(experiment.file, experiment)
    condition = Condition(PLANTS, "random plants of [[uncertain]]", experiment)
    return TuningCondition(
        condition=condition,
        case=partial(_random_plant, experiment, family, seed),
        draws=plants,
        drawn=True,
    )


def _random_plant(experiment: Experiment, family: Family, seed: int, number: int) -> Experiment:
    """Return the case of a random plant, by its number."""
    points = random_points(len(family.quantities), seed, number, 1)
    (values,) = family.values(points).tolist()
    case = with_values(experiment, zip(family.quantities, values, strict=True))
    return drawn_case(case, number)

"""What is studied of a target: its bench, its conditions and the laws that its file knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import Limit
from grosmc_mj.loop import Loop
from grosmc_mj.studies.studied import (
    Condition,
    StudiedLaw,
    chosen_laws,
    conditions_of,
    laws_of,
    limits_of,
    of_system,
)
from grosmc_mj.studies.tolerance.imperfections import Imperfection, imperfections

# The case of a system whose loop is that of equipment that one can buy.
BENCH = "bench"


@dataclass(frozen=True, eq=False)
class Setting:
    """A target, ready to be studied.

    Attributes:
        experiment: The target's.
        bench: The loop whose numbers are the units.
        bench_of: Whose it is.
        laws: The laws.
        imperfections: What of the loop is varied.
        conditions: The nominal one first.
        named: The target as it was asked for.
    """

    experiment: Experiment
    bench: Loop
    bench_of: str
    laws: Sequence[StudiedLaw]
    imperfections: Sequence[Imperfection]
    conditions: Sequence[Condition]
    named: str

    def __reduce__(self) -> tuple[Any, ...]:
        """What another process gets: the target, to be read there."""
        return setting, (self.named, [law.name for law in self.laws])

    @property
    def target(self) -> str:
        """``SYSTEM/CASE``."""
        return f"{self.experiment.case.system}/{self.experiment.case.name}"

    @property
    def plants(self) -> list[PlantName]:
        """Where runs are made: the equations, if there are any, and physics, if there is."""
        return [name for name in self.experiment.nominal.names if name != "printed"]

    def limits(self, law: StudiedLaw, condition: Condition) -> tuple[Limit, ...]:
        """What a law must keep, whoever the file asks it of, as far as a run tells."""
        return limits_of(self.experiment, law, condition, self.plants)


def setting(target: str, chosen: Sequence[str] = ()) -> Setting:
    """What is studied of a target.

    Args:
        target: A system, which means its bench, ``SYSTEM/CASE``, or the path of a case file.
        chosen: Names of laws; all by default.

    Raises:
        ArgumentError: If there is no such target or law, no loop, or nothing is required.
    """
    found = find_experiments(target)
    experiment = next((each for each in found if each.case.name == BENCH), found[0])
    owner = experiment if experiment.case.loop else of_system(experiment, BENCH)
    if owner is None or owner.case.loop is None:
        raise ArgumentError(
            f"{experiment.path}: there is no loop to take the amounts of imperfections from: give "
            "the file a [computing], a [[sensor]] or an [[actuator]]"
        )
    timestep = min(experiment.settings.timestep, owner.settings.timestep)
    if not experiment.file.requirement:
        raise ArgumentError(f"{experiment.path}: nothing is required: give it a [[requirement]]")
    bare = experiment.varied(loop=None).with_settings(timestep=timestep)
    period = bare.settings.control_period
    return Setting(
        experiment=bare,
        bench=owner.case.loop,
        bench_of=f"{owner.case.system}/{owner.case.name}",
        laws=chosen_laws(laws_of(bare), chosen),
        imperfections=imperfections(owner.case.loop, bare.nominal.system, timestep, period),
        conditions=conditions_of(bare),
        named=target,
    )

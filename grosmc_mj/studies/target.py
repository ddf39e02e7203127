"""Target of a study: its case, and the conditions, limits and laws that it is studied with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import RequirementTable
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirement_tables import kinds_in, requirement_of
from grosmc_mj.experiments.requirements.judging import decidable, of_laws
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, GrosmcError
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.theory.control.controller import Controller

NOMINAL = "nominal"
UNDER_LOAD = "under load"
# Cases of a system: in a loop of equipment that one can buy, and with a machine of it, too.
BENCH = "bench"
MACHINE = "machine"
# Laws that GROSMC is compared with; studied on request.
_RIVALS = ("lqi", "pid", "adrc", "adaptive")
# Cases whose edits and disturbances a target without any is studied under.
_LOADED = ("case1", "case2")
# Switching laws, each with its surface.
_SWITCHED = (
    ("sign", "printed"),
    ("boundary-layer", "discrete"),
    ("implicit", "discrete"),
    ("implicit-estimate", "discrete"),
    ("super-twisting", "discrete"),
    ("adaptive", "discrete"),
)
# Switching laws that are studied with prediction, too.
_PREDICTED = ("implicit", "implicit-estimate", "super-twisting")


@dataclass(frozen=True, eq=False)
class StudiedLaw:
    """A law that is studied.

    Attributes:
        name: Name for people: the file's, or the switching law's.
        controller: The law without a loop.
        predict: Whether it predicts over the delay of its loop.
        base: Name of the law in the case file.
        sampled: Switching law and surface, as settings of an experiment.
        rival: Whether GROSMC is compared with it and the case does not run it.
    """

    name: str
    controller: Controller
    predict: bool = False
    base: str = ""
    sampled: Mapping[str, Any] = field(default_factory=dict)
    rival: bool = False

    def designed_for(self, plant: PlantName, experiment: Experiment) -> StudiedLaw:
        """Return the law as it is designed for a plant of an experiment.

        Raises:
            GrosmcError: If it cannot be designed.
        """
        controller = experiment.changed(**self.sampled).law(plant, self.base)
        return replace(self, controller=controller)


@dataclass(frozen=True, eq=False)
class Condition:
    """Plant and loads of a study.

    Attributes:
        name: ``nominal``, ``under load``, or a case of the system.
        title: Title for people.
        experiment: Experiment with the edits and disturbances, without a loop.
    """

    name: str
    title: str
    experiment: Experiment


def under(condition: str) -> str:
    """Return the words for the name of a condition behind others, with a space before them."""
    if condition == NOMINAL:
        return ""
    return f" {condition}" if condition == UNDER_LOAD else f" under {condition}"


def case_for(target: str, name: str) -> Experiment:
    """Return the case of a target that a study is about: of a system the named one, or its first.

    Raises:
        ArgumentError: If there is no such target, or it requires nothing.
    """
    cases = find_experiments(target)
    experiment = _named(cases, name) or cases[0]
    if not experiment.file.requirement:
        raise ArgumentError(f"{experiment.path}: nothing is required: give it a [[requirement]]")
    return experiment


def of_system(experiment: Experiment, case: str) -> Experiment | None:
    """Return a case of the system of an experiment; None if it has none of that name."""
    if not experiment.nominal.shipped:
        return None
    return _named(find_experiments(experiment.nominal.system.name), case)


def _named(cases: Sequence[Experiment], name: str) -> Experiment | None:
    for experiment in cases:
        if experiment.name == name:
            return experiment
    return None


def conditions_of(experiment: Experiment) -> list[Condition]:
    """Return the conditions of a study.

    The nominal plant without disturbances comes first, then the experiment's own edits and
    disturbances or, if it has none, those of its system's cases.
    """
    case = experiment
    nominal = experiment.nominal
    calm = replace(experiment, nominal=replace(nominal, scales=()))
    calm = calm.changed(edits=(), disturbances=())
    conditions = [Condition(NOMINAL, "the nominal plant", calm)]
    if case.edits or case.disturbances or nominal.scales:
        conditions.append(Condition(UNDER_LOAD, case.title, experiment))
        return conditions

    for name in _LOADED:
        loaded = of_system(experiment, name)
        if loaded is not None:
            load = loaded
            under_load = experiment.changed(
                edits=load.edits,
                disturbances=load.disturbances,
                duration=max(case.duration, load.duration),
            )
            conditions.append(Condition(load.name, load.title, under_load))
    return conditions


def limits_in(
    tables: Sequence[RequirementTable],
    law: StudiedLaw,
    condition: Condition,
    plants: Sequence[PlantName],
) -> tuple[Requirement, ...]:
    """Return the limits of a law that a run can judge, whichever laws the requirements name.

    Args:
        tables: The requirements.
        law: The law.
        condition: Plant and loads.
        plants: Plants of the runs.
    """
    case = condition.experiment
    controller = law.controller
    limits_of_law: list[Requirement] = []
    for table in tables:
        of_any_law = table.model_copy(update={"of": None, "on": None})
        kinds = [
            kind
            for kind in kinds_in(table)
            if kind.can_be_asked_of(controller, getattr(table, kind.key))
        ]
        limits_of_law += [
            requirement_of(kind, of_any_law, [controller], plants, case.duration) for kind in kinds
        ]

    limits_of_law = case.judged_on_motors(limits_of_law)
    judged, _notes = decidable(limits_of_law, min(case.onset, case.duration))
    return of_laws(judged, {controller.name})


def judgeable_in(
    limits: Sequence[Requirement], loop: Loop, built: Loop | None
) -> tuple[Requirement, ...]:
    """Return the limits that a run in a loop can be judged by.

    The input limit is judged only with the actuators of the built loop. An input beyond their range
    that an ideal actuator gives does not fail the task.

    Args:
        limits: All limits of a law.
        loop: Loop of the run.
        built: The whole loop that the run's is a part of; None if there is none.
    """
    if built is None or _ranges(loop) == _ranges(built):
        return tuple(limits)
    return tuple(limit for limit in limits if not limit.of_actuators)


def _ranges(loop: Loop) -> dict[str, float]:
    """The limits of a loop's actuators that have one, by input."""
    return {part.of: part.limit for part in loop.actuators if math.isfinite(part.limit)}


def case_laws(
    experiment: Experiment, *, further: bool = False, rivals: bool = False
) -> list[StudiedLaw]:
    """Return the laws that a case runs, by the names of its file.

    Args:
        experiment: Experiment of the target, without a loop.
        further: Whether the laws of ``laws_of`` that the case does not run follow.
        rivals: Whether the rivals follow.

    Raises:
        ArgumentError: If a law that the case runs cannot be designed.
    """
    own = [_own_law(experiment, name) for name in experiment.controllers]
    added = []
    for law in laws_of(experiment):
        wanted = rivals if law.rival else further
        if wanted and not any(_is_same(law, other) for other in own):
            added.append(law)
    return [*own, *added]


def _own_law(experiment: Experiment, name: str) -> StudiedLaw:
    """A law by its name in the file.

    Raises:
        ArgumentError: If it cannot be designed.
    """
    controller = experiment.law(experiment.nominal.truest, name)
    return StudiedLaw(name, controller, experiment.predicts(name), base=name)


def _is_same(law: StudiedLaw, other: StudiedLaw) -> bool:
    """Whether two laws differ by their names alone."""
    one = law.controller
    two = other.controller
    if one.law is not two.law or law.predict != other.predict:
        return False
    return repr(one.parameters) == repr(two.parameters)


def laws_of(experiment: Experiment) -> list[StudiedLaw]:
    """Return the file's laws that do not switch, and its law that does with every switching law.

    Laws that the system's other cases share with it may not fit its task; they are left out.

    Raises:
        ArgumentError: If a law that the case runs cannot be designed.
    """
    studied: list[StudiedLaw] = []
    switching: list[str] = []
    for name, table in _distinct(experiment).items():
        try:
            controller = experiment.law(experiment.nominal.truest, name)
        except GrosmcError:
            if name in experiment.controllers:
                raise
            continue

        if controller.design is None:
            continue
        if controller.design.switching:
            switching.append(name)
        else:
            kind = str(table["law"]).removeprefix("linear-").removeprefix("fl-")
            rival = kind in _RIVALS and name not in experiment.controllers
            studied.append(StudiedLaw(name, controller, base=name, rival=rival))

    if switching:
        base = "grosmc" if "grosmc" in switching else switching[0]
        names = {law.name for law in studied}
        own = [_own_law(experiment, name) for name in experiment.controllers]
        for law in _switched(experiment, base):
            others = [other for other in own if other.name == law.name]
            taken = law.name.partition(",")[0] in names
            if taken or not all(_is_same(law, other) for other in others):
                # The file has another law of that name.
                law = replace(law, name=f"{base} {law.name}")
            studied.append(law)
    return studied


def _distinct(experiment: Experiment) -> dict[str, dict[str, object]]:
    """The tables of the file's laws by name; laws that differ in their sampling count once."""
    tables: dict[str, dict[str, object]] = {}
    for name in [*experiment.file.laws, *experiment.controllers]:
        law = experiment.file.law(name)
        table = law.model_dump(exclude={"name", "predict", "switching", "surface"})
        if table not in tables.values():
            tables[name] = table
    return tables


def _switched(experiment: Experiment, base: str) -> list[StudiedLaw]:
    """A law with every switching law that fits its surface, without and with prediction.

    Args:
        experiment: The experiment.
        base: Name of the law.
    """
    variants = [(False, switching, surface) for switching, surface in _SWITCHED]
    variants += [(True, *variant) for variant in _SWITCHED if variant[0] in _PREDICTED]

    laws = []
    for predict, switching, surface in variants:
        sampled: dict[str, Any] = {"switching": switching, "surface": surface}
        try:
            law = experiment.changed(**sampled).law(experiment.nominal.truest, base)
        except GrosmcError:
            # Not every switching law fits every surface, such as one of several inputs.
            continue

        name = f"{switching}, predicted" if predict else switching
        laws.append(StudiedLaw(name, law, predict, base, sampled))
    return laws


def chosen_laws(
    experiment: Experiment,
    names: Sequence[str] = (),
    *,
    rivals: bool = False,
) -> list[StudiedLaw]:
    """Return the laws of these names, any law of the file among them; by default ``laws_of``.

    Args:
        experiment: Experiment of the target, without a loop.
        names: Names of laws.
        rivals: Whether the default includes the rivals.

    Raises:
        ArgumentError: If there is no law of one of the names.
    """
    laws = laws_of(experiment)
    if not names:
        return [law for law in laws if rivals or not law.rival]

    by_name = {law.name: law for law in laws}
    valid = dict.fromkeys([*by_name, *experiment.file.laws, *experiment.controllers])
    for name in names:
        require_known("law", name, valid)
        if name not in by_name:
            by_name[name] = _own_law(experiment, name)
    return [by_name[name] for name in dict.fromkeys(names)]

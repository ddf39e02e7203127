"""Laws, load conditions and limits that the tolerance and ladder studies share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from grosmc_mj.arguments import require_known
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, GrosmcError
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import RequirementTable
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import Limit, judgeable, limits, required, transient
from grosmc_mj.loop import Loop

UNDER_LOAD = "under load"
# Laws that GROSMC is compared with, in the variants of a case file; studied on request.
_RIVALS = ("lqi", "pid", "adrc", "adaptive")
# Cases whose edits and disturbances a target without any is studied under.
_LOADED = ("case1", "case2")
# Switching laws with their surfaces; those of them that are studied with prediction, too.
_SWITCHED = (
    ("sign", "printed"),
    ("boundary-layer", "discrete"),
    ("implicit", "discrete"),
    ("implicit-estimate", "discrete"),
    ("super-twisting", "discrete"),
    ("adaptive", "discrete"),
)
_PREDICTED = ("implicit", "implicit-estimate", "super-twisting")
_OF_SURFACE = {"sliding_below": None, "no_reaching_phase": False}
_REQUIRED = (
    "settles_within", "overshoot_below", "stays_within", "rms_below", "final_error_below",
    "deviation_below", "input_below", "cart_travel_below", "cost_ratio_below", *_OF_SURFACE,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class StudiedLaw:
    """A law that is studied.

    Attributes:
        name: For people: that of the file, or the switching law's.
        controller: Without a loop.
        predict: Whether it predicts over the delay of its loop.
        base: Name of the law in the case file.
        sampled: How it is sampled, as settings of an experiment.
        rival: Whether GROSMC is compared with it and the case does not run it.
    """

    name: str
    controller: Controller
    predict: bool = False
    base: str = ""
    sampled: Mapping[str, str] = field(default_factory=dict)
    rival: bool = False


@dataclass(frozen=True, eq=False)
class Condition:
    """Plant and loads of a study.

    Attributes:
        name: ``nominal``, ``under load``, or a case of the system.
        title: For people.
        experiment: With its edits and disturbances, without a loop.
    """

    name: str
    title: str
    experiment: Experiment


def case_for(target: str, name: str) -> Experiment:
    """The case of a target that a study is about: of a system the named one, else its first.

    Raises:
        ArgumentError: If there is no such target, or it requires nothing.
    """
    cases = find_experiments(target)
    experiment = next((case for case in cases if case.case.name == name), cases[0])
    if not experiment.file.requirement:
        raise ArgumentError(f"{experiment.path}: nothing is required: give it a [[requirement]]")
    return experiment


def of_system(experiment: Experiment, case: str) -> Experiment | None:
    """A case of the system that an experiment is of; None if it has none."""
    if not experiment.nominal.shipped:
        return None
    cases = find_experiments(experiment.nominal.system.name)
    return next((other for other in cases if other.case.name == case), None)


def conditions_of(experiment: Experiment) -> list[Condition]:
    """The nominal plant without disturbances, then the target's own loads or its system's."""
    case, nominal = experiment.case, experiment.nominal
    calm = replace(experiment, nominal=replace(nominal, scales=()))
    first = Condition("nominal", "the nominal plant", calm.varied(edits=(), disturbances=()))
    if case.edits or case.disturbances or nominal.scales:
        return [first, Condition(UNDER_LOAD, case.title, experiment)]
    loads = [other.case for name in _LOADED if (other := of_system(experiment, name))]
    return [first] + [
        Condition(
            load.name,
            load.title,
            experiment.varied(
                edits=load.edits,
                disturbances=load.disturbances,
                duration=max(case.duration, load.duration),
            ),
        )
        for load in loads
    ]


def limits_in(
    tables: Sequence[RequirementTable],
    law: StudiedLaw,
    condition: Condition,
    plants: Sequence[PlantName],
) -> tuple[Limit, ...]:
    """Limits of some requirements for a law, whichever laws they name, that a run can judge."""
    case, controller = condition.experiment.case, law.controller
    changes = {"of": None, "on": None, **({} if controller.designed.sliding_unit else _OF_SURFACE)}
    own = [table.model_copy(update=changes) for table in tables]
    every = [
        limit
        for table in own
        if any(getattr(table, name) for name in _REQUIRED)
        for limit in limits(table, [controller], plants, case.duration)
    ]
    onsets = [(push.window[0], push.window[0]) for push in case.disturbances]
    judged, _notes = judgeable(every, transient(case.duration, onsets))
    return required(judged, {controller.name})


def judgeable_in(limits: Sequence[Limit], loop: Loop, built: Loop | None) -> tuple[Limit, ...]:
    """The limits that a run in a loop can be judged by.

    The input limit is judged only with the actuators of the built loop. An input beyond their range
    that an ideal actuator gives does not fail the task.

    Args:
        limits: All of a law.
        loop: Of the run.
        built: The whole loop that the run's is a part of; None if there is none.
    """
    if built is None or _ranges(loop) == _ranges(built):
        return tuple(limits)
    return tuple(limit for limit in limits if limit.kind != "input_below")


def _ranges(loop: Loop) -> dict[str, float]:
    """The actuators of a loop that have a range, with it."""
    return {part.of: part.limit for part in loop.actuators if math.isfinite(part.limit)}


def laws_of(experiment: Experiment) -> list[StudiedLaw]:
    """The file's laws that do not switch, and its law that does with every switching law.

    Laws that the system's other cases share with it may not fit its task; they are left out.

    Raises:
        ArgumentError: If a law that the case runs cannot be designed.
    """
    file, plant = experiment.file, experiment.nominal.truest
    studied: list[StudiedLaw] = []
    switching: list[str] = []
    seen: list[dict[str, object]] = []
    for name in dict.fromkeys([*file.laws, *experiment.controllers]):
        table = file.law(name).model_dump(exclude={"name", "predict", "switching", "surface"})
        if table in seen:
            continue
        seen.append(table)
        try:
            design = (controller := experiment.law(plant, name)).design
        except GrosmcError:
            if name in experiment.controllers:
                raise
            continue
        if design is not None and design.switching:
            switching.append(name)
        elif design is not None:
            kind = str(table["law"]).removeprefix("linear-")
            rival = kind in _RIVALS and name not in experiment.controllers
            studied.append(StudiedLaw(name, controller, base=name, rival=rival))
    if switching:
        base = "grosmc" if "grosmc" in switching else switching[0]
        studied += _switched(experiment, base, {law.name for law in studied})
    return studied


def _switched(experiment: Experiment, base: str, taken: set[str]) -> list[StudiedLaw]:
    """A law with every switching law that fits its surface, without and with prediction."""
    laws = []
    variants = [(False, *law) for law in _SWITCHED]
    variants += [(True, *law) for law in _SWITCHED if law[0] in _PREDICTED]
    for predict, switching, surface in variants:
        sampled = {"switching": switching, "surface": surface}
        try:
            law = experiment.with_settings(**sampled).law(experiment.nominal.truest, base)
        except GrosmcError:
            # Not every switching law fits every surface, such as one of several inputs.
            continue
        name = f"{base} {switching}" if switching in taken else switching
        name += ", predicted" if predict else ""
        laws.append(StudiedLaw(name, law, predict, base, sampled))
    return laws


def chosen_laws(
    experiment: Experiment, names: Sequence[str] = (), *, rivals: bool = False
) -> list[StudiedLaw]:
    """The laws of these names, any law of the file among them; without names those of ``laws_of``.

    Args:
        experiment: The target's, without a loop.
        names: Of laws.
        rivals: Whether all includes the rivals.

    Raises:
        ArgumentError: If there is none of one of them.
    """
    laws, file = laws_of(experiment), experiment.file
    if not names:
        return [law for law in laws if rivals or not law.rival]
    known, own = {law.name: law for law in laws}, [*file.laws, *experiment.controllers]
    for name in names:
        require_known("law", name, dict.fromkeys([*known, *own]))
        if name not in known:
            controller = experiment.law(experiment.nominal.truest, name)
            predict = bool(file.law(name).predict)
            known[name] = StudiedLaw(name, controller, predict, base=name)
    return [known[name] for name in dict.fromkeys(names)]

"""What studies ask of: the laws that a case's file knows, and what its plant is put under."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from grosmc_mj.arguments import require_known
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import GrosmcError
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import RequirementTable
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import Limit, judgeable, limits, required, transient
from grosmc_mj.loop import Loop

# Cases whose edits and disturbances a target without any is studied under.
_LOADED = ("case1", "case2")
# Switching laws with their surfaces; those of them that are studied predicting, too.
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
_ASKED = (
    "settles_within", "overshoot_below", "stays_within", "rms_below", "final_error_below",
    "deviation_below", "input_below", "cart_travel_below", "cost_ratio_below",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class StudiedLaw:
    """A law that is studied.

    Attributes:
        name: For people: that of the file, or the switching law's.
        controller: Without a loop.
        predict: Whether it knows its loop.
        settings: How it is sampled, in words.
        base: The law of the file that it is.
        sampled: How it is sampled, as settings of an experiment.
    """

    name: str
    controller: Controller
    predict: bool = False
    settings: str = ""
    base: str = ""
    sampled: Mapping[str, str] = field(default_factory=dict)

    @property
    def follows_optimum(self) -> bool:
        """Whether its nominal loop is the optimum's, see ``Design``."""
        return self.controller.designed.follows_optimum

    def made(self, experiment: Experiment, plant: PlantName) -> Controller:
        """The same law for another plant or control period.

        Raises:
            GrosmcError: If it cannot be designed.
        """
        return experiment.with_settings(**self.sampled).law(plant, self.base)


@dataclass(frozen=True, eq=False)
class Condition:
    """What the plant is like, and what acts on it.

    Attributes:
        name: ``nominal``, ``under load``, or the case that it is of.
        title: For people.
        experiment: With its edits and disturbances, without a loop.
    """

    name: str
    title: str
    experiment: Experiment


def limits_of(
    experiment: Experiment, law: StudiedLaw, condition: Condition, plants: Sequence[PlantName]
) -> tuple[Limit, ...]:
    """What a law must keep, whoever the file asks it of, as far as a run tells."""
    return limits_in(experiment.file.requirement, law, condition, plants)


def limits_in(
    tables: Sequence[RequirementTable],
    law: StudiedLaw,
    condition: Condition,
    plants: Sequence[PlantName],
) -> tuple[Limit, ...]:
    """What tables ask of a law, whoever they name, as far as a run tells."""
    case, made = condition.experiment.case, law.controller
    found: list[Limit] = []
    for table in tables:
        if asked := _asked_of(table, made):
            found += limits(asked, [made], plants, case.duration)
    onsets = [(each.window[0], each.window[0]) for each in case.disturbances]
    told, _not_told = judgeable(found, transient(case.duration, onsets))
    return required(told, {made.name})


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
    return {each.of: each.limit for each in loop.actuators if math.isfinite(each.limit)}


def _asked_of(table: RequirementTable, law: Controller) -> RequirementTable | None:
    """A table as it is asked of one law; None if it asks nothing of it."""
    surface = bool(law.designed.sliding_unit)
    changes = {"of": None, "on": None, **({} if surface else _OF_SURFACE)}
    asked = table.model_copy(update=changes)
    names = (*_ASKED, *_OF_SURFACE)
    return asked if any(getattr(asked, name) for name in names) else None


def of_system(experiment: Experiment, case: str) -> Experiment | None:
    """A case of the system that an experiment is of; None if it has none."""
    if not experiment.nominal.shipped:
        return None
    cases = find_experiments(experiment.nominal.system.name)
    return next((each for each in cases if each.case.name == case), None)


def conditions_of(experiment: Experiment) -> list[Condition]:
    """The nominal plant at rest from without, and what the target or its system has besides."""
    case, nominal = experiment.case, experiment.nominal
    calm = replace(experiment, nominal=replace(nominal, scales={})).varied(
        edits=(), disturbances=()
    )
    found = [Condition("nominal", "the nominal plant", calm)]
    if case.edits or case.disturbances or nominal.scales:
        return [*found, Condition("under load", case.title, experiment)]
    for name in _LOADED:
        if other := of_system(experiment, name):
            loads = other.case
            loaded = experiment.varied(
                edits=loads.edits,
                disturbances=loads.disturbances,
                duration=max(case.duration, loads.duration),
            )
            found.append(Condition(name, loads.title, loaded))
    return found


def laws_of(experiment: Experiment) -> list[StudiedLaw]:
    """The file's laws that do not switch, and its law that does with every switching law.

    What its system's other cases share with it may not fit its task, and is left out.

    Raises:
        ArgumentError: If a law that the case runs cannot be designed.
    """
    file, plant = experiment.file, experiment.nominal.truest
    names = dict.fromkeys([*file.laws, *experiment.controllers])
    found: list[StudiedLaw] = []
    switching: list[str] = []
    seen: list[dict[str, object]] = []
    for name in names:
        table = file.law(name).model_dump(exclude={"name", "predict", "switching", "surface"})
        if table in seen:
            continue
        seen.append(table)
        try:
            made = experiment.law(plant, name)
        except GrosmcError:
            if name in experiment.controllers:
                raise
            continue
        if made.design is None:
            continue
        if not made.design.switching:
            found.append(StudiedLaw(name, made, base=name))
        else:
            switching.append(name)
    if not switching:
        return found
    base, taken = "grosmc" if "grosmc" in switching else switching[0], {law.name for law in found}
    for predict in (False, True):
        for law, surface in _SWITCHED:
            if predict and law not in _PREDICTED:
                continue
            sampled = {"switching": law, "surface": surface}
            try:
                made = experiment.with_settings(**sampled).law(plant, base)
            except GrosmcError:
                # Not every switching law fits every surface, such as one of several inputs.
                continue
            name = f"{base} {law}" if law in taken else law
            name = f"{name}, predicted" if predict else name
            words = f"{base}, {law}, {surface} surface"
            found.append(StudiedLaw(name, made, predict, words, base, sampled))
    return found


def chosen_laws(laws: Sequence[StudiedLaw], names: Sequence[str]) -> list[StudiedLaw]:
    """The laws of these names.

    Raises:
        ArgumentError: If there is none of one of them.
    """
    known = {law.name: law for law in laws}
    for name in names:
        require_known("law", name, known)
    return [known[name] for name in dict.fromkeys(names)] if names else list(laws)

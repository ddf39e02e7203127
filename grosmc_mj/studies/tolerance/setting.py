"""What is studied of a target: its bench, its conditions and the laws that its file knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, GrosmcError, unknown_name
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import RequirementTable
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import Limit, judgeable, limits, required, transient
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.studies.tolerance.imperfections import Imperfection, imperfections

# The case of a system whose loop is that of equipment that one can buy.
BENCH = "bench"
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
    "settles_within", "stays_within", "deviation_below", "input_below", "cart_travel_below",
    "cost_ratio_below",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class StudiedLaw:
    """A law that is studied.

    Attributes:
        name: For people: that of the file, or the switching law's.
        controller: Without a loop.
        predict: Whether it knows its loop.
        settings: How it is sampled, in words.
    """

    name: str
    controller: Controller
    predict: bool = False
    settings: str = ""


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
    """

    experiment: Experiment
    bench: Loop
    bench_of: str
    laws: Sequence[StudiedLaw]
    imperfections: Sequence[Imperfection]
    conditions: Sequence[Condition]

    @property
    def plants(self) -> list[PlantName]:
        """Where runs are made: the equations, if there are any, and physics, if there is."""
        return [name for name in self.experiment.nominal.names if name != "printed"]

    def limits(self, law: StudiedLaw, condition: Condition) -> tuple[Limit, ...]:
        """What a law must keep, whoever the file asks it of, as far as a run tells."""
        case, made = condition.experiment.case, law.controller
        found: list[Limit] = []
        for table in self.experiment.file.requirement:
            if asked := _asked_of(table, made):
                found += limits(asked, [made], self.plants)
        onsets = [(each.window[0], each.window[0]) for each in case.disturbances]
        told, _not_told = judgeable(found, transient(case.duration, onsets))
        return required(told, {made.name})


def _asked_of(table: RequirementTable, law: Controller) -> RequirementTable | None:
    """A table as it is asked of one law; None if it asks nothing of it."""
    surface = bool(law.designed.sliding_unit)
    changes = {"of": None, "on": None, **({} if surface else _OF_SURFACE)}
    asked = table.model_copy(update=changes)
    names = (*_ASKED, *_OF_SURFACE)
    return asked if any(getattr(asked, name) for name in names) else None


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
    owner = experiment if experiment.case.loop else _of_system(experiment, BENCH)
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
        laws=_chosen(_laws(bare), chosen),
        imperfections=imperfections(owner.case.loop, bare.nominal.system, timestep, period),
        conditions=_conditions(bare),
    )


def _of_system(experiment: Experiment, case: str) -> Experiment | None:
    """A case of the system that an experiment is of; None if it has none."""
    if not experiment.nominal.shipped:
        return None
    cases = find_experiments(experiment.nominal.system.name)
    return next((each for each in cases if each.case.name == case), None)


def _conditions(experiment: Experiment) -> list[Condition]:
    """The nominal plant at rest from without, and what the target or its system has besides."""
    case, nominal = experiment.case, experiment.nominal
    calm = replace(experiment, nominal=replace(nominal, scales={})).varied(
        edits=(), disturbances=()
    )
    found = [Condition("nominal", "the nominal plant", calm)]
    if case.edits or case.disturbances or nominal.scales:
        return [*found, Condition("under load", case.title, experiment)]
    for name in _LOADED:
        if other := _of_system(experiment, name):
            loads = other.case
            loaded = experiment.varied(
                edits=loads.edits,
                disturbances=loads.disturbances,
                duration=max(case.duration, loads.duration),
            )
            found.append(Condition(name, loads.title, loaded))
    return found


def _laws(experiment: Experiment) -> list[StudiedLaw]:
    """The file's laws that do not switch, and its law that does with every switching law.

    Raises:
        ArgumentError: If a law cannot be designed.
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
        made = experiment.law(plant, name)
        if made.design is None:
            continue
        if made.design.with_reach is None:
            found.append(StudiedLaw(name, made))
        else:
            switching.append(name)
    if not switching:
        return found
    base, taken = "grosmc" if "grosmc" in switching else switching[0], {law.name for law in found}
    for predict in (False, True):
        for law, surface in _SWITCHED:
            if predict and law not in _PREDICTED:
                continue
            sampled = experiment.with_settings(switching=law, surface=surface)
            try:
                made = sampled.law(plant, base)
            except GrosmcError:
                # Not every switching law fits every surface, such as one of several inputs.
                continue
            name = f"{base} {law}" if law in taken else law
            name = f"{name}, predicted" if predict else name
            found.append(StudiedLaw(name, made, predict, f"{base}, {law}, {surface} surface"))
    return found


def _chosen(laws: Sequence[StudiedLaw], names: Sequence[str]) -> list[StudiedLaw]:
    """The laws of these names.

    Raises:
        ArgumentError: If there is none of one of them.
    """
    known = {law.name: law for law in laws}
    for name in names:
        if name not in known:
            raise ArgumentError(unknown_name("law", name, known))
    return [known[name] for name in dict.fromkeys(names)] if names else list(laws)

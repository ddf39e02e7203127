"""What a case file is about: the plant that the laws believe in, and the plants that they meet."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.experiments.case import case_edits
from grosmc_mj.experiments.file.schema import CaseFile, EditTable
from grosmc_mj.experiments.file.user_code import blamed, load_named
from grosmc_mj.experiments.runs import PlantName, design_variant
from grosmc_mj.plants import SYSTEMS, AnalyticPlant, Plant, System, find_system
from grosmc_mj.simulation.mujoco_plant import Integrator, MujocoPlant
from grosmc_mj.simulation.prepare import ANALYTIC_TIMESTEP
from grosmc_mj.simulation.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class Subject:
    """The plant of a case file.

    Attributes:
        nominal: The plant before any edit.
        plants: What the laws meet, by name.
        timestep: Physics timestep [s].
        robot: The robot that it is, if it is one: its laws are designed from MuJoCo's dynamics.
    """

    nominal: AnalyticPlant | MujocoPlant
    plants: Mapping[PlantName, Plant]
    timestep: float
    robot: Robot | None = None

    @property
    def system(self) -> System:
        """Names and equations."""
        return self.nominal.system

    @property
    def integrator(self) -> Integrator:
        """What steps the plants; the equations are stepped by RK4."""
        return self.nominal.stepped_by

    @property
    def shipped(self) -> bool:
        """Whether it is a system of the package, which has laws with numbers."""
        return SYSTEMS.get(self.system.name) is self.system

    def believed(self, plant: PlantName) -> AnalyticPlant:
        """The nominal equations that a law is designed from that shall run on another plant."""
        return self.nominal.analytic(design_variant(plant))


def subject_of(file: CaseFile, folder: Path) -> Subject:
    """The plant that a case file names, with the file's edits.

    Args:
        file: The case file.
        folder: Where it lies.

    Raises:
        GrosmcError: If there is no such plant, or it cannot be edited or run like that.
    """
    found, edits = _found(file, folder), case_edits(file)
    robot = found if isinstance(found, Robot) else None
    nominal = found.plant if isinstance(found, Robot) else found
    if isinstance(nominal, AnalyticPlant):
        if edits:
            raise ArgumentError(
                f"edit: {nominal.system.name} has no model in MuJoCo: edit a parameter instead"
            )
        plants: dict[PlantName, Plant] = {"corrected": _scaled(nominal, file.edit)}
        return Subject(nominal, _chosen(plants, file), file.run.timestep or ANALYTIC_TIMESTEP)
    if parameters := [table.parameter for table in file.edit if table.parameter is not None]:
        raise ArgumentError(
            f"edit: {nominal.system.name} has a model in MuJoCo: edit a body instead of "
            f"{parameters[0]!r}"
        )
    run = file.run
    if file.plant.system is not None or run.timestep is not None:
        nominal = replace(nominal, timestep=run.timestep or ANALYTIC_TIMESTEP)
    if run.integrator is not None:
        nominal = replace(nominal, integrator=run.integrator)
    physics = replace(nominal, edits=edits)
    plants = {variant: physics.analytic(variant) for variant in _variants(nominal)}
    plants["physics"] = physics
    timestep = float(physics.model.opt.timestep)
    return Subject(nominal, _chosen(plants, file), timestep, robot)


def _found(file: CaseFile, folder: Path) -> AnalyticPlant | MujocoPlant | Robot:
    """What the file names, before any edit."""
    table = file.plant
    if table.system is not None:
        return MujocoPlant.load(find_system(table.system).name)
    if table.model is not None:
        return Robot.from_mjcf(folder / table.model, table.joints, table.actuators)
    assert table.plant is not None
    found: Any = load_named(table.plant, folder)
    if callable(found):
        try:
            inspect.signature(found).bind()
        except TypeError as error:
            raise ArgumentError(
                f"{table.plant} must be called without arguments: {error}"
            ) from None
        with blamed(folder):
            found = found()
    if not isinstance(found, (AnalyticPlant, MujocoPlant, Robot)):
        raise ArgumentError(
            f"{table.plant} is a {type(found).__name__}, must be a plant: what affine_plant, "
            "MujocoPlant or Robot makes, or a function without arguments that returns it"
        )
    return found


def _variants(plant: MujocoPlant) -> tuple[Any, ...]:
    """Equations that there are of a plant in MuJoCo."""
    return plant.system.variants if plant.system.read_parameters is not None else ()


def _scaled(plant: AnalyticPlant, edits: list[EditTable]) -> AnalyticPlant:
    """An analytic plant of one's own with scaled parameters."""
    changes = {}
    for table in edits:
        if table.parameter is None or table.scale is None:
            continue
        if not hasattr(plant.parameters, table.parameter):
            valid = list(vars(plant.parameters))
            raise ArgumentError(f"edit: {unknown_name('parameter', table.parameter, valid)}")
        changes[table.parameter] = table.scale * getattr(plant.parameters, table.parameter)
    return plant.with_parameters(**changes)


def _chosen(plants: dict[PlantName, Plant], file: CaseFile) -> dict[PlantName, Plant]:
    """The plants that the file compares."""
    wanted = file.plant.compare or list(plants)
    for name in wanted:
        if name not in plants:
            raise ArgumentError(f"plant: compare: {unknown_name('plant', name, plants)}")
    return {name: plant for name, plant in plants.items() if name in wanted}

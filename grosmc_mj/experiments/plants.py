"""The plant that a case file names: the one that its laws believe in, and those that they meet."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Literal

from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.experiments.file.user_code import blamed, load_named
from grosmc_mj.plants import SYSTEMS, AnalyticPlant, Plant, System, Variant, find_system
from grosmc_mj.simulation.edits import Edit
from grosmc_mj.simulation.mujoco_plant import Integrator, MujocoPlant
from grosmc_mj.simulation.robots.robot import Robot

PlantName = Literal["printed", "corrected", "physics"]


@dataclass(frozen=True, eq=False)
class NominalPlant:
    """The plant that laws are designed for, and what true plants are made of it.

    Attributes:
        plant: Before any edit.
        robot: The robot that it is, if it is one: its laws are designed from MuJoCo's dynamics.
        scales: Factors on parameters of equations without a model, which the true ones have.
    """

    plant: AnalyticPlant | MujocoPlant
    robot: Robot | None = None
    scales: Mapping[str, float] = field(default_factory=dict)

    @property
    def system(self) -> System:
        """Names and equations."""
        return self.plant.system

    @property
    def shipped(self) -> bool:
        """Whether it is a system of the package."""
        return SYSTEMS.get(self.system.name) is self.system

    @property
    def names(self) -> list[PlantName]:
        """The true plants that there are: the equations, then physics."""
        if self.plant.kind != "physics":
            return ["corrected"]
        known = self.system.variants if self.system.read_parameters is not None else ()
        return [*known, "physics"]

    @property
    def integrator(self) -> Integrator:
        """What steps it by itself; equations are stepped by RK4."""
        return self.plant.stepped_by

    def equations(self, plant: PlantName) -> AnalyticPlant:
        """The nominal equations that a law is designed from that shall run on a plant."""
        return self.plant.analytic(design_variant(plant))

    def true(
        self, name: PlantName, edits: tuple[Edit, ...], timestep: float, integrator: Integrator
    ) -> Plant:
        """The plant that a law meets.

        Args:
            name: Which of ``names``.
            edits: What it has that the law does not know.
            timestep: Of the physics [s].
            integrator: MuJoCo's.
        """
        if not isinstance(self.plant, MujocoPlant):
            return self.plant.changed(scales=self.scales)
        physics = _edited(self.plant, edits, timestep, integrator)
        return physics if name == "physics" else physics.analytic(name)


@lru_cache(maxsize=256)
def _edited(
    plant: MujocoPlant, edits: tuple[Edit, ...], timestep: float, integrator: Integrator
) -> MujocoPlant:
    """An edited model, compiled once for all runs on it."""
    return replace(plant, edits=edits, timestep=timestep, integrator=integrator)


def design_variant(plant: PlantName) -> Variant:
    """The equations that the law for a plant is designed from."""
    return "printed" if plant == "printed" else "corrected"


def nominal_plant(file: CaseFile, folder: Path) -> NominalPlant:
    """The plant that a case file names.

    Args:
        file: The case file.
        folder: Where it lies.

    Raises:
        GrosmcError: If there is no such plant, or it cannot be edited like that.
    """
    if file.plant.system is not None:
        nominal = _of_system(find_system(file.plant.system).name)
    else:
        found = _named(file, folder)
        robot = found if isinstance(found, Robot) else None
        nominal = NominalPlant(found.plant if isinstance(found, Robot) else found, robot)
    parameters = [table.parameter for table in file.edit if table.parameter is not None]
    if isinstance(nominal.plant, MujocoPlant):
        if parameters:
            raise ArgumentError(
                f"edit: {nominal.system.name} has a model in MuJoCo: edit a body instead of "
                f"{parameters[0]!r}"
            )
        return nominal
    if len(parameters) < len(file.edit):
        raise ArgumentError(
            f"edit: {nominal.system.name} has no model in MuJoCo: edit a parameter instead"
        )
    for name in parameters:
        if not hasattr(nominal.plant.parameters, name):
            valid = list(vars(nominal.plant.parameters))
            raise ArgumentError(f"edit: {unknown_name('parameter', name, valid)}")
    scales = {table.parameter or "": table.scale or 0.0 for table in file.edit}
    return replace(nominal, scales=scales)


@cache
def _of_system(name: str) -> NominalPlant:
    """A system of the package, whose models are compiled once for all experiments."""
    return NominalPlant(MujocoPlant.load(name))


def _named(file: CaseFile, folder: Path) -> AnalyticPlant | MujocoPlant | Robot:
    """What the file names that is no system of the package."""
    table = file.plant
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

"""The plant that a case file names: the one that its laws believe in, and those that they meet."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from grosmc_mj.arguments import require_known
from grosmc_mj.errors import ArgumentError, PremiseError, SetupError, shown
from grosmc_mj.experiments.case import edits_of, states_of
from grosmc_mj.experiments.file.parts import MACHINE_PARTS
from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.experiments.file.user_code import blamed, load_named
from grosmc_mj.physics.edit import Edit
from grosmc_mj.physics.mujoco_plant import Integrator, MujocoPlant
from grosmc_mj.plants import (
    SYSTEMS,
    AnalyticPlant,
    OperatingPoint,
    Plant,
    System,
    Variant,
    equilibrium,
    find_system,
)
from grosmc_mj.robots.robot import Robot

PlantName = Literal["printed", "corrected", "physics"]


@dataclass(frozen=True, eq=False)
class NominalPlant:
    """The plant that laws are designed for, and what true plants are made of it.

    Attributes:
        plant: Before any edit.
        robot: The robot that it is, if it is one: its laws are designed from MuJoCo's dynamics.
        scales: Parameters of equations without a model, with factors that the true ones have.
        believed: The equations that laws are designed from, if they are not its own.
        at: Its operating point, if the file has one or laws need one.
        pushed: Inputs and rates of equations that disturbances act on.
    """

    plant: AnalyticPlant | MujocoPlant
    robot: Robot | None = None
    scales: tuple[tuple[str, float], ...] = ()
    believed: AnalyticPlant | None = None
    at: OperatingPoint | None = None
    pushed: tuple[str, ...] = ()

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
    def truest(self) -> PlantName:
        """Physics or, where there is none, the equations."""
        return self.names[-1]

    @property
    def rest(self) -> tuple[float, ...] | None:
        """State of its operating point, if it has one."""
        return None if self.at is None else tuple(self.at.x.tolist())

    @property
    def integrator(self) -> Integrator:
        """What steps it by itself; equations are stepped by RK4."""
        return self.plant.stepped_by

    def equations(self, plant: PlantName) -> AnalyticPlant:
        """The nominal equations that a law is designed from that shall run on a plant."""
        return self.believed or self.plant.analytic(design_variant(plant))

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
            true = self.plant
            for parameter, factor in self.scales:
                true = true.changed(scales={parameter: factor})
            return true.pushed(self.pushed)
        machine = self.plant if self.robot is None else self.robot.built
        physics = _edited(machine, edits, timestep, integrator)
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
    nominal = _named(file, folder)
    parameters = [table.parameter for table in file.edit if table.parameter is not None]
    if isinstance(nominal.plant, MujocoPlant):
        if parameters:
            raise ArgumentError(
                f"edit: {nominal.system.name} has a model in MuJoCo: edit a body instead of "
                f"{parameters[0]!r}"
            )
        return _with_known(nominal, edits_of(file, nominal.system, known=True))
    if any(getattr(file, kind) for kind in MACHINE_PARTS):
        raise ArgumentError(f"{nominal.system.name} has no model in MuJoCo, so no machine as built")
    if len(parameters) < len(file.edit):
        raise ArgumentError(
            f"edit: {nominal.system.name} has no model in MuJoCo: edit a parameter instead"
        )
    for name in parameters:
        require_known("parameter", name, vars(nominal.plant.parameters), "edit: ")
    return replace(
        nominal,
        scales=tuple((table.parameter or "", table.scale or 0.0) for table in file.edit),
        pushed=tuple(dict.fromkeys(table.of for table in file.disturbance if not table.body)),
    )


@lru_cache(maxsize=64)
def _with_known(nominal: NominalPlant, edits: tuple[Edit, ...]) -> NominalPlant:
    """The nominal plant with the edits that laws know."""
    if not edits:
        return nominal
    assert isinstance(nominal.plant, MujocoPlant)
    plant = nominal.plant.believed(*edits)
    if (robot := nominal.robot) is not None:
        built = plant if robot.built is robot.plant else robot.built.believed(*edits)
        robot = Robot(plant, robot.notes, built)
    return replace(nominal, plant=plant, robot=robot)


@cache
def _of_system(name: str) -> NominalPlant:
    """A system of the package, whose models are compiled once for all experiments."""
    return NominalPlant(MujocoPlant.load(name))


def _named(file: CaseFile, folder: Path) -> NominalPlant:
    """What the file names, with what laws believe instead and where it rests."""
    table = file.plant
    if table.system is not None:
        nominal = _of_system(find_system(table.system).name)
    else:
        if table.model is not None:
            path = _model_file(table.model, folder)
            plant: Any = Robot.from_mjcf(path, table.joints, table.actuators)
        else:
            plant = _made(table.plant or "", folder)
        robot = isinstance(plant, Robot)
        nominal = NominalPlant(plant.plant, plant) if robot else NominalPlant(plant)
    if file.design is not None and nominal.robot is not None:
        raise ArgumentError(
            "design: laws of a model are designed from MuJoCo's own dynamics: it has no other "
            "equations; name another model, or a plant as equations"
        )
    if file.design is not None:
        nominal = replace(nominal, believed=_believed(file.design.plant, nominal, folder))
    if table.at is not None or (nominal.robot is not None and nominal.robot.underactuated):
        held = states_of(table.at or {}, nominal.system, "plant: at")
        try:
            nominal = replace(nominal, at=equilibrium(nominal.believed or nominal.plant, held))
        except PremiseError as error:
            raise PremiseError(f"plant: at: {error}") from None
    return nominal


def _model_file(text: str, folder: Path) -> Path:
    """An MJCF file beside the case file, or in an installed package.

    Raises:
        ArgumentError: If it is in a package that has none, or that is not installed.
    """
    package, colon, inside = text.partition(":")
    if not colon:
        return folder / text
    if not package.isidentifier():
        raise ArgumentError(f"plant: model: {shown(text)} must be a file, or package:path of one")
    spec = find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise SetupError(
            f"plant: model: {shown(text)} is a file of {package}, which is not installed; run: pip "
            f"install {package}"
        )
    for place in spec.submodule_search_locations:
        if (path := Path(place) / inside).is_file():
            return path
    raise ArgumentError(f"plant: model: the installed {package} has no file {shown(inside)}")


def _believed(text: str, nominal: NominalPlant, folder: Path) -> AnalyticPlant:
    """The equations that laws are designed from, with the states and inputs of the plant.

    Raises:
        ArgumentError: If it is another kind of plant, or has other states or inputs.
    """
    plant, system = _made(text, folder), nominal.system
    if not isinstance(plant, AnalyticPlant):
        raise ArgumentError(f"design: {text} is no plant as equations: make it with affine_plant")
    for kind in ("states", "inputs"):
        theirs, ours = (
            [(signal.name, signal.unit) for signal in getattr(one, kind)]
            for one in (plant.system, system)
        )
        if theirs != ours:
            raise ArgumentError(f"design: {text} has the {kind} {theirs}, the plant has {ours}")
    return plant


def _made(text: str, folder: Path) -> Any:
    """The plant, or the robot, that ``module:name`` names."""
    plant: Any = load_named(text, folder)
    if callable(plant):
        try:
            inspect.signature(plant).bind()
        except TypeError as error:
            raise ArgumentError(f"{text} must be called without arguments: {error}") from None
        with blamed(folder):
            plant = plant()
    if not isinstance(plant, (AnalyticPlant, MujocoPlant, Robot)):
        raise ArgumentError(
            f"{text} is a {type(plant).__name__}, must be a plant: what affine_plant, MujocoPlant "
            "or Robot makes, or a function without arguments that returns it"
        )
    return plant

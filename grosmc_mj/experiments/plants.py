"""The plants of a case file: the nominal one for its laws, and the true ones for its runs."""

from __future__ import annotations

import contextlib
import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from grosmc_mj.experiments.file.parts import (
    MACHINE_PARTS,
    edits_of,
    scales_of,
    voltage_inputs_of_file,
)
from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.experiments.file.user_code import blamed, load_named
from grosmc_mj.experiments.file.values import states_of
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import (
    ArgumentError,
    PremiseError,
    SetupError,
    did_you_mean,
    value_text,
)
from grosmc_mj.ground.files import is_there
from grosmc_mj.mechanics.machine.voltage_input import VoltageInput
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.mujoco_plant import Integrator, MujocoPlant
from grosmc_mj.theory.plants import (
    SYSTEMS,
    AnalyticPlant,
    OperatingPoint,
    Plant,
    System,
    Variant,
    equilibrium,
    find_system,
)
from grosmc_mj.theory.plants.parameter_scale import ParameterScale

if TYPE_CHECKING:
    from grosmc_mj.mechanics.robots.robot import Robot

PlantName = Literal["printed", "corrected", "physics"]


@dataclass(frozen=True, eq=False)
class NominalPlant:
    """The plant that laws are designed for, and from which the true plants are made.

    Attributes:
        plant: The plant before any edit.
        robot: The robot, if it is one: its laws are designed from MuJoCo's dynamics.
        scales: Parameters of equations without a model, with factors that the true ones have.
        believed: Other equations that laws are designed from, if the file names some.
        at: Its operating point, if the file has one or laws need one.
    """

    plant: AnalyticPlant | MujocoPlant
    robot: Robot | None = None
    scales: tuple[ParameterScale, ...] = ()
    believed: AnalyticPlant | None = None
    at: OperatingPoint | None = None

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
        """Names of the true plants: the equations, then physics."""
        if self.plant.kind != "physics":
            return ["corrected"]
        if self.system.read_parameters is None:
            return ["physics"]
        return [*self.system.variants, "physics"]

    @property
    def truest(self) -> PlantName:
        """Physics or, where there is none, the equations."""
        return self.names[-1]

    @property
    def gears(self) -> Mapping[str, float]:
        """Torque of each motor of a user's own model for a command of 1, by its name."""
        return {} if self.robot is None else dict(self.robot.gears)

    @property
    def voltages(self) -> Sequence[VoltageInput]:
        """Inputs in volts of a user's own model, by the motors that laws know."""
        return () if self.robot is None else self.robot.voltages

    @property
    def has_model(self) -> bool:
        """Whether there is a model in MuJoCo, which edits change."""
        return isinstance(self.plant, MujocoPlant)

    @property
    def rest(self) -> tuple[float, ...] | None:
        """State of its operating point, if it has one."""
        if self.at is None:
            return None
        return tuple(self.at.x.tolist())

    def equations(self, plant: PlantName) -> AnalyticPlant:
        """Return the nominal equations for the design of a law that runs on a plant."""
        return self.believed or self.plant.analytic(design_variant(plant))

    def true(
        self,
        name: PlantName,
        edits: tuple[Edit, ...],
        timestep: float,
        integrator: Integrator,
    ) -> Plant:
        """Return the plant that a law runs on.

        Args:
            name: One of ``names``.
            edits: Changes that the law does not know.
            timestep: Timestep of the physics [s].
            integrator: MuJoCo's integrator.
        """
        if not isinstance(self.plant, MujocoPlant):
            true = self.plant
            for factor in self.scales:
                true = true.changed(scales={factor.parameter: factor.scale})
            return true
        machine = self.plant if self.robot is None else self.robot.built
        physics = _edited(machine, edits, timestep, integrator)
        if name == "physics":
            return physics
        return physics.analytic(name)


# A model is compiled once for all runs on it.
@lru_cache(maxsize=256)
def _edited(
    plant: MujocoPlant, edits: tuple[Edit, ...], timestep: float, integrator: Integrator
) -> MujocoPlant:
    """Return an edited model."""
    return replace(plant, edits=edits, timestep=timestep, integrator=integrator)


def design_variant(plant: PlantName) -> Variant:
    """Return the variant of the equations that the law for a plant is designed from."""
    if plant == "printed":
        return "printed"
    return "corrected"


def nominal_plant(file: CaseFile, folder: Path) -> NominalPlant:
    """Return the nominal plant of a case file.

    Args:
        file: The case file.
        folder: The folder of the file.

    Raises:
        GrosmcError: If there is no such plant, or it cannot be edited like that.
    """
    nominal = _named(file, folder)
    scales = scales_of(file, nominal.system)
    if isinstance(nominal.plant, MujocoPlant):
        if scales:
            raise ArgumentError(
                f"edit: {nominal.system.name} has a model in MuJoCo: edit a body instead of "
                f"{scales[0].parameter!r}"
            )
        spec = nominal.plant.spec
        known = edits_of(file, nominal.system, known=True, model=spec)
        voltages = voltage_inputs_of_file(file, nominal.system)
        if voltages and nominal.robot is None:
            raise ArgumentError(
                f"motor of {voltages[0].input!r}: law_input = 'voltage' is for an MJCF of your own "
                f"([plant] model = ...): the equations of {nominal.system.name} have another input"
            )
        return _with_known(nominal, known, tuple(voltages))

    if any(getattr(file, kind) for kind in MACHINE_PARTS):
        raise ArgumentError(f"{nominal.system.name} has no model in MuJoCo, so no machine as built")
    if len(scales) < len(file.edit):
        raise ArgumentError(
            f"edit: {nominal.system.name} has no model in MuJoCo: edit a parameter instead"
        )
    for scale in scales:
        require_known("parameter", scale.parameter, vars(nominal.plant.parameters), "edit: ")
    return replace(nominal, scales=scales)


# A model is compiled once for all experiments on it.
@lru_cache(maxsize=64)
def _with_known(
    nominal: NominalPlant, edits: tuple[Edit, ...], voltages: tuple[VoltageInput, ...]
) -> NominalPlant:
    """Return the nominal plant with the edits that laws know, and inputs in volts."""
    if not edits and not voltages:
        return nominal
    assert isinstance(nominal.plant, MujocoPlant)
    if nominal.robot is None:
        return replace(nominal, plant=nominal.plant.changed(*edits, known=True))
    robot = nominal.robot.with_known(edits, voltages)
    return replace(nominal, plant=robot.plant, robot=robot)


# A model is compiled once for all experiments on it.
@cache
def _of_system(name: str) -> NominalPlant:
    """Return the nominal plant of a system of the package."""
    return NominalPlant(MujocoPlant.load(name))


def _named(file: CaseFile, folder: Path) -> NominalPlant:
    """Return the plant that a file names, with other equations and an operating point, if any."""
    nominal = _named_without_design(file, folder)
    if file.design is not None:
        if nominal.robot is not None:
            raise ArgumentError(
                "design: laws of a model are designed from MuJoCo's own dynamics: it has no other "
                "equations; name another model, or a plant as equations"
            )
        nominal = replace(nominal, believed=_believed(file.design.plant, nominal, folder))

    underactuated = nominal.robot is not None and nominal.robot.underactuated
    if file.plant.at is not None or underactuated:
        held = states_of(file.plant.at or {}, nominal.system, "plant: at")
        try:
            nominal = replace(nominal, at=equilibrium(nominal.believed or nominal.plant, held))
        except PremiseError as error:
            raise PremiseError(f"plant: at: {error}") from None
    return nominal


def _named_without_design(file: CaseFile, folder: Path) -> NominalPlant:
    """Return the system, the model or the user's plant that a file names."""
    table = file.plant
    if table.system is not None:
        return _of_system(find_system(table.system).name)

    # Imported here: most files have no robot.
    from grosmc_mj.mechanics.robots.robot import Robot

    if table.model is not None:
        path = _model_file(table.model, folder)
        plant: Any = Robot.from_mjcf(path, table.joints, table.actuators)
    else:
        plant = _load_plant(table.plant or "", folder)
    if isinstance(plant, Robot):
        return NominalPlant(plant.plant, plant)
    return NominalPlant(plant)


def _model_file(text: str, folder: Path) -> Path:
    """Return an MJCF file beside the case file, or in an installed package.

    Raises:
        ArgumentError: If there is none, or it is in a package that is not installed.
    """
    package, colon, inside = text.partition(":")
    # One letter is a drive of Windows, and no package.
    if not colon or (len(package) == 1 and package.isalpha()):
        return _file_beside(text, folder)
    if not package.isidentifier():
        raise ArgumentError(
            f"plant: model: {value_text(text)} must be a file, or package:path of one"
        )
    spec = find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise SetupError(
            f"plant: model: {value_text(text)} is a file of {package}, which is not installed; "
            f"run: pip install {package}"
        )
    for place in spec.submodule_search_locations:
        path = Path(place) / inside
        if path.is_file():
            return path
    raise ArgumentError(f"plant: model: the installed {package} has no file {value_text(inside)}")


def _file_beside(text: str, folder: Path) -> Path:
    """Return a file by its place from the folder of the case file.

    Raises:
        ArgumentError: If there is none.
    """
    path = folder / text
    if is_there(path):
        return path
    hint = ""
    if is_there(folder / text.replace("\\", "/")):
        hint = ": write / in the place of \\"
    else:
        nearest = did_you_mean(path.name, _names_in(path.parent, path.suffix))
        place = value_text(str(path.parent.absolute()), str)
        hint = f" in {place}{':' if nearest else ''}{nearest}"
    raise ArgumentError(f"plant: model: there is no file {value_text(text, str)}{hint}")


def _names_in(folder: Path, suffix: str) -> list[str]:
    """Return the names of files of a kind in a folder; none of one that cannot be read."""
    # A name that no file system takes is a ValueError.
    with contextlib.suppress(OSError, ValueError):
        return sorted(file.name for file in folder.iterdir() if file.suffix == suffix)
    return []


def _believed(text: str, nominal: NominalPlant, folder: Path) -> AnalyticPlant:
    """Return the equations that laws are designed from.

    Raises:
        ArgumentError: If it is another kind of plant, or has other states or inputs.
    """
    plant = _load_plant(text, folder)
    if not isinstance(plant, AnalyticPlant):
        raise ArgumentError(f"design: {text} is no plant as equations: make it with affine_plant")
    for kind in ("states", "inputs"):
        design_signals = _signals(plant.system, kind)
        plant_signals = _signals(nominal.system, kind)
        if design_signals != plant_signals:
            raise ArgumentError(
                f"design: {text} has the {kind} {design_signals}, the plant has {plant_signals}"
            )
    return plant


def _signals(system: System, kind: str) -> list[tuple[str, str]]:
    """Return names and units of the states or the inputs of a system."""
    return [(signal.name, signal.unit) for signal in getattr(system, kind)]


def _load_plant(text: str, folder: Path) -> Any:
    """Return the plant, or the robot, that ``module:name`` names."""
    plant: Any = load_named(text, folder)
    if callable(plant):
        try:
            inspect.signature(plant).bind()
        except TypeError as error:
            raise ArgumentError(f"{text} must be called without arguments: {error}") from None
        with blamed(folder):
            plant = plant()

    from grosmc_mj.mechanics.robots.robot import Robot

    if not isinstance(plant, (AnalyticPlant, MujocoPlant, Robot)):
        raise ArgumentError(
            f"{text} is a {type(plant).__name__}, must be a plant: what affine_plant, MujocoPlant "
            "or Robot makes, or a function without arguments that returns it"
        )
    return plant

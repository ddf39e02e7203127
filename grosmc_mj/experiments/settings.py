"""Settings of a simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.experiments.plants import NominalPlant
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.mechanics.physics.mujoco_plant import Integrator
from grosmc_mj.simulation.prepare import ANALYTIC_TIMESTEP
from grosmc_mj.simulation.simulate import Engine
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.switching import SWITCHINGS

Surface = Literal["printed", "discrete"]


@dataclass(frozen=True)
class Settings:
    """Settings of a simulation.

    Attributes:
        engine: ``native`` or ``python``.
        control_period: Time between two samples of the laws [s]; the chapter prints none.
        timestep: Physics timestep [s].
        integrator: MuJoCo's integrator.
        switching: Name of the switching law of the sliding mode laws.
        surface: Surface of the sliding mode laws: ``printed``, or ``discrete`` for the one that is
            zero at every sample of the nominal plant.
    """

    engine: Engine = "native"
    control_period: float = 1e-3
    timestep: float = 1e-3
    integrator: Integrator = "RK4"
    switching: str = "sign"
    surface: Surface = "printed"

    def __post_init__(self) -> None:
        require_known("engine", self.engine, get_args(Engine))
        require_known("surface", self.surface, get_args(Surface))
        require_known("switching law", self.switching, SWITCHINGS)

    def changes(self) -> dict[str, Any]:
        """Return the settings that are not the defaults."""
        default = vars(Settings())
        return {name: value for name, value in vars(self).items() if value != default[name]}

    def engine_for(self, law: Controller) -> Engine:
        """Return the engine, or ``python`` for a law that can't be compiled."""
        if getattr(law.law, "python_only", False):
            return "python"
        return self.engine


def settings_of_file(file: CaseFile, nominal: NominalPlant) -> Settings:
    """Return the settings of a file, with defaults by its plant."""
    run = file.run
    timestep = run.timestep
    if not timestep and file.plant.system is None:
        timestep = nominal.plant.step_length
    timestep = timestep or ANALYTIC_TIMESTEP
    return Settings(
        engine=run.engine,
        control_period=run.control_period or max(ANALYTIC_TIMESTEP, timestep),
        timestep=timestep,
        integrator=run.integrator or nominal.plant.stepped_by,
    )

"""A controller to design, with all that it may depend on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from grosmc_mj.experiments.file.schema import CaseFile, ControllerTable
from grosmc_mj.experiments.plants import NominalPlant, PlantName
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.theory.plants import AnalyticPlant


@dataclass(frozen=True)
class LawRequest:
    """A controller to design.

    Attributes:
        table: Law and numbers of the controller.
        file: The case file, with the task.
        nominal: The nominal plant.
        plant: Name of the plant that the controller will run on.
        folder: Folder of the user's own Python.
        control_period: Control period of the runs [s].
        loop: Loop whose limits of the inputs the law knows.
        needs_weights: Whether the law depends on Q and R; else they only weigh its runs.
    """

    table: ControllerTable
    file: CaseFile
    nominal: NominalPlant
    plant: PlantName
    folder: Path
    control_period: float
    loop: Loop
    needs_weights: bool = True

    @property
    def equations(self) -> AnalyticPlant:
        """Equations that the law is designed from."""
        return self.nominal.equations(self.plant)

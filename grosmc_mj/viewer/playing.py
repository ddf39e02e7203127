"""What a window can show, and the experiment that it is made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.disturbances import Disturbance


@dataclass(frozen=True, eq=False)
class LiveRun:
    """All that a run needs.

    Attributes:
        plant: In MuJoCo.
        controller: The law with its numbers.
        x0: Start, (n,).
        duration: Of a recorded run [s]; a live one goes on.
        disturbances: Wrenches on the plant.
        control_period: Time between two samples of the law [s]; the timestep by default.
    """

    plant: Plant
    controller: Controller
    x0: ArrayLike
    duration: float
    disturbances: Sequence[Disturbance] = ()
    control_period: float | None = None


class Motion(Protocol):
    """What the window drives: a recorded run or a live one."""

    @property
    def model(self) -> mujoco.MjModel:
        """What is drawn."""
        ...

    @property
    def state(self) -> Array:
        """mjSTATE_FULLPHYSICS where it is now."""
        ...

    @property
    def words(self) -> Mapping[str, str]:
        """What the window says about it, by name."""
        ...

    @property
    def note(self) -> str:
        """One line about why it stands still; empty while it moves."""
        ...

    def advance(self, seconds: float) -> None:
        """Go on by so much of its own time."""
        ...

    def restart(self) -> None:
        """Back to the start."""
        ...

    def sideways(self, sign: int) -> None:
        """What the keys to the left (-1) and to the right (1) do."""
        ...

    def stronger(self, factor: float) -> None:
        """What the keys up and down do."""
        ...

"""Edits of a nominal model: their interface, and the hidden states that they bring."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, ClassVar

import mujoco

from grosmc_mj.ground.arrays import Array
from grosmc_mj.theory.plants import System

# A field of mjModel, the index of its rows, and the value there.
Change = tuple[str, Any, Any]


@dataclass(frozen=True)
class HiddenState:
    """A number of a machine that laws do not see.

    Attributes:
        name: Such as ``shaft twist``.
        unit: Of it.
        kind: ``twist``, ``load``, ``winding``, ``temperature``, ``bristle``, or another memory of
            MuJoCo's actuators.
        column: Where it stands in mjSTATE_FULLPHYSICS.
        scale: Factor from there to the unit.
        minus: The column that is taken off, for a motor's twist against its joint.
        play: The whole range within which a twist meets no spring; 0 for all others.
    """

    name: str
    unit: str
    kind: str
    column: int
    scale: float = 1.0
    minus: int | None = None
    play: float = 0.0

    def of(self, physics: Array) -> Array:
        """Its values in rows of mjSTATE_FULLPHYSICS, (..., size) to (...)."""
        value = physics[..., self.column]
        if self.minus is not None:
            value = value - physics[..., self.minus]
        return self.scale * value


@dataclass(frozen=True)
class Edit(ABC):
    """A change of the nominal model that laws do not know of.

    Attributes:
        kind: Its name in messages.
        owner: The field that names its owner: ``body``, ``joint`` or ``input``.
        order: Edits are written in ascending order, whatever the order they are listed in.
        several: True if one owner may have several of the kind.
        rigid: True if the rigid system, of which there are equations, can have it.
        stepped: True if each timestep computes numbers of the model for it, so that the model alone
            has no x'.
    """

    kind: ClassVar[str] = "edit"
    owner: ClassVar[str]
    order: ClassVar[int]
    several: ClassVar[bool] = False
    rigid: ClassVar[bool] = True
    stepped: ClassVar[bool] = False

    @property
    def of(self) -> str:
        """Name of its body, joint or input."""
        return getattr(self, self.owner)

    @abstractmethod
    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Write it into an editable model.

        Args:
            spec: With the edits of a lower order.
            nominal: Compiled, without any edit.

        Raises:
            ModelError: If this model cannot have it.
        """

    def changes(  # noqa: B027
        self, model: mujoco.MjModel, undrawn_bodies: Collection[str]
    ) -> list[Change] | None:
        """Its changes of a compiled model; None if a model with it must be compiled.

        Args:
            model: Compiled, without the edit.
            undrawn_bodies: Bodies whose lengths are those of sites and other bodies only.
        """

    def hidden(self, state: HiddenState, model: mujoco.MjModel) -> HiddenState:
        """Return a hidden state of the compiled model, named by this edit if it is its own."""
        return state

    def require_start(self, system: System, x0: Array) -> None:  # noqa: B027  most have no bounds
        """Refuse a start, (n,), where it cannot be.

        Raises:
            ArgumentError: With the bounds.
        """

    def require_speeds(  # noqa: B027  most are stable at any speed
        self, system: System, x: Array, timestep: float, integrator: str
    ) -> None:
        """Refuse a state, (n,), whose speeds make it unstable with a timestep [s].

        Raises:
            ArgumentError: With the timestep that it needs.
        """

    def require_timestep(self, model: mujoco.MjModel, system: str) -> None:  # noqa: B027
        """Refuse a compiled model whose timestep or integrator makes it unstable.

        Raises:
            ModelError: With the name of the system and the timestep that it needs.
        """

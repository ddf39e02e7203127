"""The servo rotor of section 2.3: eqs. (15)-(18)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from grosmc_mj.errors import ModelError
from grosmc_mj.jitable import jitable
from grosmc_mj.plants.system import (
    Column,
    Signal,
    System,
    Variant,
    require_nonnegative,
    require_positive,
    require_unmodelled_absent,
)

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class ServoParameters:
    """Numbers of eqs. (15)-(16).

    Attributes:
        J: Moment of inertia J_m [kg m^2].
        B: Viscous damping B_m [N m s/rad].
        Kt: Torque constant K_t [N m/A].
    """

    J: float
    B: float
    Kt: float

    def __post_init__(self) -> None:
        require_positive("servo", J=self.J, Kt=self.Kt)
        require_nonnegative("servo", B=self.B)

    @classmethod
    def from_model(cls, model: mujoco.MjModel, _variant: Variant) -> ServoParameters:
        """Read J, B and K_t back from a compiled model.

        Raises:
            ModelError: If the rotor's centre of mass is off the shaft.
        """
        require_unmodelled_absent("servo", model, ())
        if np.any(model.body("rotor").ipos[[0, 2]]):
            raise ModelError("servo: the rotor's centre of mass must lie on the shaft")
        shaft = model.joint("shaft")
        return cls(
            # The shaft is along -y, a principal axis of the disc.
            J=float(model.body("rotor").inertia[1] + model.dof_armature[shaft.dofadr[0]]),
            B=float(model.dof_damping[shaft.dofadr[0]]),
            Kt=float(model.actuator("current").gear[0]),
        )


@jitable
def drift(x: Any, p: Any) -> Column:
    """f(x) of eq. (15) solved for the acceleration; x = [theta, theta']."""
    return (x[1], -p.B * x[1] / p.J)


@jitable
def input_matrix(x: Any, p: Any) -> Column:
    """g(x): eq. (16) in eq. (15); the input is the current i."""
    return (0.0, p.Kt / p.J)


@jitable
def disturbance(x: Any, w: Any, p: Any) -> Column:
    """-T_d/J of eq. (15): the load T_d is minus the wrench's torque about the shaft (-y)."""
    return (0.0, -w[4] / p.J)


@jitable
def singular(x: Any) -> bool:
    """Never."""
    return False


@jitable
def linearizable(x: Any) -> bool:
    """Always: the plant is linear."""
    return True


SERVO = System(
    name="servo",
    title="Servo rotor",
    positions=(Signal("rotor angle", "θ", "rad"),),
    velocities=(Signal("rotor speed", "θ̇", "rad/s"),),
    input=Signal("current", "i", "A"),
    output=0,
    joints=("shaft",),
    actuator="current",
    bodies=("rotor",),
    variants=("corrected",),
    read_parameters=ServoParameters.from_model,
    drift=drift,
    input_matrix=input_matrix,
    disturbance=disturbance,
    singular=singular,
    singularity="nowhere",
    linearizable=linearizable,
    region="everywhere",
    uncertain_body="rotor",
    position_bound=math.pi,
)

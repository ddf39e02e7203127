"""The servo rotor of section 2.3: eqs. (15)-(18)."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import sympy as sp

from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.fields import Range, checked
from grosmc_mj.theory.plants.equations import Equations
from grosmc_mj.theory.plants.parametrization import LinearParametrization
from grosmc_mj.theory.plants.system import (
    Model,
    Signal,
    System,
    Variant,
    require_unmodelled_absent,
    wrench_symbols,
)


@checked(ModelError, label="servo")
class ServoParameters:
    """Numbers of eqs. (15)-(16).

    Attributes:
        J: Moment of inertia J_m [kg m^2].
        B: Viscous damping B_m [N m s/rad].
        Kt: Torque constant K_t [N m/A].
    """

    J: Annotated[float, Range(0, unit="kg m^2", above=True)]
    B: Annotated[float, Range(0, unit="N m s/rad")]
    Kt: Annotated[float, Range(0, unit="N m/A", above=True)]

    @classmethod
    def from_model(cls, model: Model, _variant: Variant) -> ServoParameters:
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


def _dynamics() -> tuple[Equations, LinearParametrization]:
    """Eq. (15) with eq. (16), x = [theta, theta'], solved for the acceleration and in amperes."""
    theta, rate, r, a, J, B, Kt = sp.symbols("theta rate r a J B Kt")
    w = wrench_symbols("rotor")
    equations = Equations(
        x=(theta, rate),
        f=(rate, -B * rate / J),
        g=(0, Kt / J),
        h=(theta,),
        w=w,
        # The load T_d is minus the wrench's torque about the shaft, which is along -y.
        d=(0, -w[4] / J),
    )

    # The inertia, the friction and a load, each over Kt.
    parametrization = LinearParametrization(
        x=(theta, rate),
        r=(r,),
        a=(a,),
        Y=((a, r, 1),),
        theta=(J / Kt, B / Kt, 0),
    )
    return equations, parametrization


_EQUATIONS, _PARAMETRIZATION = _dynamics()
SERVO = System(
    name="servo",
    title="Servo rotor",
    states=(Signal("rotor angle", "θ", "rad"), Signal("rotor speed", "θ̇", "rad/s")),
    inputs=(Signal("current", "i", "A"),),
    equations=_EQUATIONS,
    joints=("shaft",),
    actuators=("current",),
    bodies=("rotor",),
    read_parameters=ServoParameters.from_model,
    uncertain_body="rotor",
    parametrization=_PARAMETRIZATION,
)

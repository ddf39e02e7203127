"""A mass on a spring: m p'' + c p' + k p = F."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import sympy as sp

from grosmc_mj.theory.plants.equations import Equations
from grosmc_mj.theory.plants.system import Signal, System, Variant, wrench_symbols

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class SpringMassParameters:
    """Numbers of the equation.

    Attributes:
        m: Mass [kg].
        c: Damping [N s/m].
        k: Stiffness [N/m].
    """

    m: float
    c: float
    k: float

    @classmethod
    def from_model(cls, model: mujoco.MjModel, _variant: Variant) -> SpringMassParameters:
        """Read them back from a compiled model."""
        return cls(
            m=float(model.body("mass").mass[0]),
            c=float(model.joint("rail").damping[0]),
            k=float(model.joint("rail").stiffness[0]),
        )


def _equations() -> Equations:
    """The equation solved for p''; x = [p, p']."""
    p, rate = sp.symbols("p rate")
    m, c, k = sp.symbols("m c k")
    w = wrench_symbols("mass")
    return Equations(
        x=(p, rate),
        f=(rate, -(c * rate + k * p) / m),
        g=(0, 1 / m),
        h=(p,),
        w=w,
        d=(0, w[0] / m),
    )


SPRING_MASS = System(
    name="spring_mass",
    title="Mass on a spring",
    states=(Signal("position", "p", "m"), Signal("speed", "ṗ", "m/s")),
    inputs=(Signal("force", "F", "N"),),
    equations=_equations(),
    joints=("rail",),
    actuators=("force",),
    bodies=("mass",),
    read_parameters=SpringMassParameters.from_model,
    uncertain_body="mass",
)

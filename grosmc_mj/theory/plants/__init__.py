"""The plants as equations: one file a system, no physics engine."""

from __future__ import annotations

from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.theory.plants.affine import affine_plant
from grosmc_mj.theory.plants.arm import ARM, ArmParameters
from grosmc_mj.theory.plants.cart_pendulum import CART_PENDULUM, CartPendulumParameters
from grosmc_mj.theory.plants.equations import Equations
from grosmc_mj.theory.plants.operating_point import OperatingPoint, equilibrium
from grosmc_mj.theory.plants.plant import AnalyticPlant, Plant
from grosmc_mj.theory.plants.servo import SERVO, ServoParameters
from grosmc_mj.theory.plants.system import Signal, System, Variant
from grosmc_mj.theory.plants.two_link_arm import TWO_LINK_ARM, TwoLinkParameters

SYSTEMS: dict[str, System] = {
    system.name: system for system in (SERVO, CART_PENDULUM, ARM, TWO_LINK_ARM)
}


def find_system(name: str) -> System:
    """Return the system of a name.

    Raises:
        ModelError: If there is none.
    """
    require_known("system", name, SYSTEMS, error=ModelError)
    return SYSTEMS[name]


__all__ = [
    "ARM",
    "CART_PENDULUM",
    "SERVO",
    "SYSTEMS",
    "TWO_LINK_ARM",
    "AnalyticPlant",
    "ArmParameters",
    "CartPendulumParameters",
    "Equations",
    "OperatingPoint",
    "Plant",
    "ServoParameters",
    "Signal",
    "System",
    "TwoLinkParameters",
    "Variant",
    "affine_plant",
    "equilibrium",
    "find_system",
]

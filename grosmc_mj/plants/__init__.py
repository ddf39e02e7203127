"""The plants as equations: one file a system, no physics engine."""

from __future__ import annotations

from grosmc_mj.arguments import require_known
from grosmc_mj.errors import ModelError
from grosmc_mj.plants.affine import affine_plant
from grosmc_mj.plants.arm import ARM, ArmParameters
from grosmc_mj.plants.cart_pendulum import CART_PENDULUM, CartPendulumParameters
from grosmc_mj.plants.equations import Equations
from grosmc_mj.plants.operating_point import OperatingPoint, equilibrium
from grosmc_mj.plants.plant import AnalyticPlant, Plant
from grosmc_mj.plants.servo import SERVO, ServoParameters
from grosmc_mj.plants.system import Signal, System, Variant
from grosmc_mj.plants.two_link_arm import TWO_LINK_ARM, TwoLinkParameters

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

"""The inverted pendulum on a cart of section 3.4: eq. (40), and the cart that it leaves out."""

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
    require_positive,
    require_unmodelled_absent,
)

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class CartPendulumParameters:
    """Numbers of eq. (40).

    Attributes:
        M: Mass of the cart [kg].
        m: Mass of the pendulum, a uniform rod [kg].
        L: Half its length [m].
        g: Gravity [m/s^2].
        printed: 1 for the coefficient a as printed, 0 for the energy-true one.
    """

    M: float
    m: float
    L: float
    g: float
    printed: float = 0.0

    def __post_init__(self) -> None:
        require_positive("cart_pendulum", M=self.M, m=self.m, L=self.L, g=self.g)

    @classmethod
    def from_model(cls, model: mujoco.MjModel, variant: Variant) -> CartPendulumParameters:
        """Read M, m, L and g back from a compiled model.

        Raises:
            ModelError: If the pole is not a uniform rod about its hinge, or the model has what
                eq. (40) has no term for.
        """
        require_unmodelled_absent("cart_pendulum", model, ("slider", "hinge"), "force")
        pole = model.body("pole")
        M, m, L = float(model.body("cart").mass[0]), float(pole.mass[0]), float(pole.ipos[2])
        rod = m * L * L / 3
        if not math.isclose(pole.inertia[1], rod, rel_tol=1e-9) or np.any(pole.ipos[:2]):
            raise ModelError(
                f"cart_pendulum: the pole's inertia {pole.inertia[1]:g} kg m^2 is not that of a "
                f"uniform rod, m L^2/3 = {rod:g} kg m^2, so eq. (40) does not describe it"
            )
        g = float(-model.opt.gravity[2])
        return cls(M=M, m=m, L=L, g=g, printed=float(variant == "printed"))


@jitable
def coefficient(p: Any) -> float:
    """The a of eq. (40): m/(M+m) as printed, which makes a*m a mass; 1/(M+m) by Lagrange."""
    return (p.m if p.printed != 0.0 else 1.0) / (p.M + p.m)


@jitable
def drift(x: Any, p: Any) -> Column:
    """f(x): eq. (40) without u and d; x = [p, theta, p', theta'].

    The chapter has no equation for the cart. Its acceleration is the horizontal balance of
    forces, (M+m) p'' = u + m L (theta'' cos(theta) - theta'^2 sin(theta)), with the theta'' of
    eq. (40) in whichever variant.
    """
    s, c = math.sin(x[1]), math.cos(x[1])
    w2 = x[3] * x[3]
    a = coefficient(p)
    alpha = (p.g * s - a * p.m * p.L * w2 * s * c) / (p.L * (4 / 3 - a * p.m * c * c))
    return (x[2], x[3], p.m * p.L * (alpha * c - w2 * s) / (p.M + p.m), alpha)


@jitable
def input_matrix(x: Any, p: Any) -> Column:
    """g(x) of eq. (40) and of the cart; the input is the force on the cart along +x."""
    c = math.cos(x[1])
    a = coefficient(p)
    beta = a * c / (p.L * (4 / 3 - a * p.m * c * c))
    return (0.0, 0.0, (1 + p.m * p.L * beta * c) / (p.M + p.m), beta)


@jitable
def disturbance(x: Any, w: Any, p: Any) -> Column:
    """Accelerations under wrenches on cart (w[0:6]) and pole (w[6:12]).

    The hinge is along -y: the pole's centre is at (-L sin(theta), L cos(theta)) from it in the
    x-z plane. The wrench meets the true inertia in both variants, so that d(t) of eq. (40) is
    the acceleration it says.
    """
    s, c = math.sin(x[1]), math.cos(x[1])
    Q_p = w[0] + w[6]
    Q_theta = -p.L * (c * w[6] + s * w[8]) - w[10]
    total = p.M + p.m
    inertia = p.m * p.L * p.L * (4 / 3 - p.m * c * c / total)
    alpha = (Q_theta + p.m * p.L * c * Q_p / total) / inertia
    return (0.0, 0.0, (Q_p + p.m * p.L * c * alpha) / total, alpha)


@jitable
def singular(x: Any) -> bool:
    """Never."""
    return False


@jitable
def linearizable(x: Any) -> bool:
    """Whether the cart's force still turns the pole as it does upright: |theta| < pi/2."""
    return -math.pi / 2 < x[1] < math.pi / 2


def pole_torque(d: float, p: CartPendulumParameters) -> float:
    """Pivot torque [N m] that accelerates the upright pole by d [rad/s^2] with the cart free."""
    return d * p.m * p.L * p.L * (4 / 3 - p.m / (p.M + p.m))


CART_PENDULUM = System(
    name="cart_pendulum",
    title="Cart-pendulum",
    positions=(Signal("cart position", "p", "m"), Signal("pole angle", "θ", "rad")),
    velocities=(Signal("cart speed", "ṗ", "m/s"), Signal("pole rate", "θ̇", "rad/s")),
    input=Signal("force", "u", "N"),
    output=1,
    joints=("slider", "hinge"),
    actuator="force",
    bodies=("cart", "pole"),
    variants=("printed", "corrected"),
    read_parameters=CartPendulumParameters.from_model,
    drift=drift,
    input_matrix=input_matrix,
    disturbance=disturbance,
    singular=singular,
    singularity="nowhere",
    linearizable=linearizable,
    region="|theta| < pi/2",
    uncertain_body="pole",
    position_bound=math.pi,
)

"""The inverted pendulum on a cart of section 3.4: eq. (40), and the cart that it leaves out."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated

import numpy as np
import sympy as sp

from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.fields import Finite, Range, checked
from grosmc_mj.theory.plants.equations import Equations
from grosmc_mj.theory.plants.system import (
    Model,
    Signal,
    System,
    Variant,
    require_unmodelled_absent,
    wrench_symbols,
)


@checked(ModelError, label="cart_pendulum")
class CartPendulumParameters:
    """Numbers of eq. (40).

    Attributes:
        M: Mass of the cart [kg].
        m: Mass of the pendulum, a uniform rod [kg].
        L: Half its length [m].
        g: Gravity [m/s^2].
        printed: 1 for the coefficient a as printed, 0 for the energy-true one.
    """

    M: Annotated[float, Range(0, unit="kg", above=True)]
    m: Annotated[float, Range(0, unit="kg", above=True)]
    L: Annotated[float, Range(0, unit="m", above=True)]
    g: Annotated[float, Range(0, unit="m/s^2", above=True)]
    printed: Finite = 0.0

    @classmethod
    def from_model(cls, model: Model, variant: Variant) -> CartPendulumParameters:
        """Read M, m, L and g back from a compiled model.

        Raises:
            ModelError: If the pole is not a uniform rod about its hinge, or the model has what
                eq. (40) has no term for.
        """
        require_unmodelled_absent("cart_pendulum", model, ("slider", "hinge"), "force")
        pole = model.body("pole")
        m = float(pole.mass[0])
        L = float(pole.ipos[2])
        rod = m * L * L / 3
        if not math.isclose(pole.inertia[1], rod, rel_tol=1e-9) or np.any(pole.ipos[:2]):
            raise ModelError(
                f"cart_pendulum: the pole's inertia {pole.inertia[1]:g} kg m^2 is not that of a "
                f"uniform rod, m L^2/3 = {rod:g} kg m^2, so eq. (40) does not describe it"
            )

        return cls(
            M=float(model.body("cart").mass[0]),
            m=m,
            L=L,
            g=float(-model.opt.gravity[2]),
            printed=float(variant == "printed"),
        )

    def scaled(self, mass: float, length: float) -> CartPendulumParameters:
        """Copy with the pole's mass and every length of it scaled, as an edit of the model does."""
        return replace(self, m=mass * self.m, L=length * self.L)


def _equations() -> Equations:
    """Eq. (40), and the cart that it leaves out; x = [p, theta, p', theta'].

    The chapter has no equation for the cart. Its acceleration is the horizontal balance of
    forces, (M+m) p'' = u + m L (theta'' cos(theta) - theta'^2 sin(theta)), with the theta'' of
    eq. (40) in whichever variant.
    """
    position, theta, speed, rate = sp.symbols("position theta speed rate")
    M, m, L, g, printed = sp.symbols("M m L g printed")
    s = sp.sin(theta)
    c = sp.cos(theta)

    # a: m/(M+m) as printed, which makes a*m a mass; 1/(M+m) by Lagrange.
    a = (printed * m + (1 - printed)) / (M + m)
    reduced = L * (sp.Rational(4, 3) - a * m * c**2)
    alpha = (g * s - a * m * L * rate**2 * s * c) / reduced
    beta = a * c / reduced

    # The wrench meets the true inertia in both variants, so that d(t) of eq. (40) is the
    # acceleration it says. The hinge is along -y: the pole's centre is at (-L sin(theta),
    # L cos(theta)) from it in the x-z plane.
    w = wrench_symbols("cart", "pole")
    along = w[0] + w[6]
    about = -L * (c * w[6] + s * w[8]) - w[10]
    inertia = m * L**2 * (sp.Rational(4, 3) - m * c**2 / (M + m))
    turned = (about + m * L * c * along / (M + m)) / inertia

    return Equations(
        x=(position, theta, speed, rate),
        f=(speed, rate, m * L * (alpha * c - rate**2 * s) / (M + m), alpha),
        g=(0, 0, (1 + m * L * beta * c) / (M + m), beta),
        h=(theta,),
        w=w,
        d=(0, 0, (along + m * L * c * turned) / (M + m), turned),
        # Where the cart's force turns the pole as it does upright.
        region=sp.And(-sp.pi / 2 < theta, theta < sp.pi / 2),
    )


def pole_torque(d: float, p: CartPendulumParameters) -> float:
    """Pivot torque [N m] that accelerates the upright pole by d [rad/s^2] with the cart free."""
    return d * p.m * p.L * p.L * (4 / 3 - p.m / (p.M + p.m))


CART_PENDULUM = System(
    name="cart_pendulum",
    title="Cart-pendulum",
    states=(
        Signal("cart position", "p", "m"),
        Signal("pole angle", "θ", "rad"),
        Signal("cart speed", "ṗ", "m/s"),
        Signal("pole rate", "θ̇", "rad/s"),
    ),
    inputs=(Signal("force", "u", "N"),),
    equations=_equations(),
    region="|theta| < pi/2",
    controlled=(1,),
    joints=("slider", "hinge"),
    actuators=("force",),
    bodies=("cart", "pole"),
    variants=("printed", "corrected"),
    read_parameters=CartPendulumParameters.from_model,
    uncertain_body="pole",
)

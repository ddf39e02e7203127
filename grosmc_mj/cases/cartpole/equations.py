"""A pole of any inertia on a cart, with damped joints and a geared actuator: a foreign plant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ModelError
from grosmc_mj.plants.equations import Equations
from grosmc_mj.plants.system import (
    Signal,
    System,
    Variant,
    require_nonnegative,
    require_positive,
    wrench_symbols,
)

if TYPE_CHECKING:
    import mujoco

_JOINTS, _BODIES = ("slider", "hinge_1"), ("cart", "pole_1")


@dataclass(frozen=True)
class CartPoleParameters:
    """Numbers of the pole on a cart; all of them are read, none follows from a formula.

    Attributes:
        M: Mass of the cart [kg].
        m: Mass of the pole [kg].
        l: Distance of its centre of mass from the hinge [m].
        I: Its inertia about the hinge's axis through that centre [kg m^2].
        g: Gravity [m/s^2].
        slider_damping: [N s/m].
        hinge_damping: [N m s/rad].
        gear: Force on the cart per unit of the actuator's control [N].
    """

    M: float
    m: float
    l: float
    I: float
    g: float
    slider_damping: float
    hinge_damping: float
    gear: float

    def __post_init__(self) -> None:
        require_positive("cart_pole", M=self.M, m=self.m, l=self.l, g=self.g, gear=self.gear)
        require_nonnegative(
            "cart_pole",
            I=self.I,
            slider_damping=self.slider_damping,
            hinge_damping=self.hinge_damping,
        )

    @classmethod
    def from_model(cls, model: mujoco.MjModel, _variant: Variant) -> CartPoleParameters:
        """Read the numbers back from a compiled model.

        Raises:
            ModelError: If the model has what the equations have no term for.
        """
        _require_described(model)
        slider, hinge = (int(model.joint(name).dofadr[0]) for name in _JOINTS)
        cart, pole = (model.body(name) for name in _BODIES)
        return cls(
            M=float(cart.mass[0]),
            m=float(pole.mass[0]),
            l=float(pole.ipos[2]),
            I=float(_second_row(pole.iquat) ** 2 @ pole.inertia),
            g=float(-model.opt.gravity[2]),
            slider_damping=float(model.dof_damping[slider]),
            hinge_damping=float(model.dof_damping[hinge]),
            gear=float(model.actuator("slide").gear[0]),
        )

    def scaled(self, mass: float, length: float) -> CartPoleParameters:
        """With the pole's mass and every length of it scaled, as an edit of the model does."""
        inertia = self.I * mass * length * length
        return replace(self, m=mass * self.m, l=length * self.l, I=inertia)


def _second_row(quaternion: Array) -> Array:
    """The body's y axis in the frame of its principal inertias: second row of the rotation."""
    w, x, y, z = quaternion
    return np.array([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)])


def _require_described(model: mujoco.MjModel) -> None:
    """Refuse a model that the equations do not describe.

    Raises:
        ModelError: Naming what was found.
    """
    slider, hinge = (model.joint(name) for name in _JOINTS)
    cart, pole = (model.body(name) for name in _BODIES)
    turned = [*cart.quat[1:], *pole.quat[1:]]
    found = {
        "gravity off -z": model.opt.gravity[:2],
        "a slider off the x axis": slider.axis - [1, 0, 0],
        "a hinge off the y axis": hinge.axis - [0, 1, 0],
        "a hinge away from the pole's origin": hinge.pos,
        "turned bodies": turned,
        "a pole with its centre of mass beside its z axis": pole.ipos[:1],
        "armature": model.dof_armature,
        "dry friction": model.dof_frictionloss,
        "joint springs": model.jnt_stiffness,
    }
    for what, numbers in found.items():
        if np.any(numbers):
            raise ModelError(f"cart_pole: the model has {what}, which the equations have not")


def _equations() -> Equations:
    """Lagrange's equations, solved for p'' and theta''; x = [p, theta, p', theta'].

    The hinge is along +y, so the pole's centre is at (l sin(theta), l cos(theta)) from it in the
    x-z plane, and with c, s for cos(theta), sin(theta)

        (M + m) p'' + m l c theta'' = gear u - slider_damping p' + m l theta'^2 s + Q_p,
        m l c p'' + (I + m l^2) theta'' = m g l s - hinge_damping theta' + Q_theta.

    A rail's end stops are soft constraints and not in here.
    """
    position, theta, speed, rate = sp.symbols("position theta speed rate")
    M, m, l, I, g, gear = sp.symbols("M m l I g gear")
    slider_damping, hinge_damping = sp.symbols("slider_damping hinge_damping")
    s, c = sp.sin(theta), sp.cos(theta)
    coupling, inertia = m * l * c, I + m * l**2
    inverse = sp.Matrix([[inertia, -coupling], [-coupling, M + m]])
    inverse /= (M + m) * inertia - coupling**2
    free = [
        m * l * rate**2 * s - slider_damping * speed,
        m * g * l * s - hinge_damping * rate,
    ]
    w = wrench_symbols(*_BODIES)
    along, about = w[0] + w[6], l * (c * w[6] - s * w[8]) + w[10]
    return Equations(
        x=(position, theta, speed, rate),
        f=(speed, rate, *(inverse * sp.Matrix(free))),
        g=(0, 0, *(inverse * sp.Matrix([gear, 0]))),
        h=(theta,),
        w=w,
        d=(0, 0, *(inverse * sp.Matrix([along, about]))),
        # Where the cart's force turns the pole as it does upright.
        region=sp.And(-sp.pi / 2 < theta, theta < sp.pi / 2),
    )


CART_POLE = System(
    name="cart_pole",
    title="Cart-pole of dm_control",
    states=(
        Signal("cart position", "p", "m"),
        Signal("pole angle", "θ", "rad"),
        Signal("cart speed", "ṗ", "m/s"),
        Signal("pole rate", "θ̇", "rad/s"),
    ),
    # The engines write u into mjData.ctrl as it is, so that its limits are those of the model:
    # u is the actuator's control, and the gear that makes a force of it belongs to the plant.
    inputs=(Signal("control", "u", "1"),),
    equations=_equations(),
    region="|theta| < pi/2",
    controlled=(1,),
    joints=_JOINTS,
    actuators=("slide",),
    bodies=_BODIES,
    read_parameters=CartPoleParameters.from_model,
    uncertain_body="pole_1",
    # Nearer than the end stops of its rail.
    position_bound=1.5,
)

"""The parts of a machine as built, as values.

Numbers of a joint are at the joint, in N m and rad for a hinge and N and m for a slide, whatever
the gear ratio: a motor's inertia there is its own times the square of the ratio.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grosmc_mj.arguments import reals
from grosmc_mj.machine.part import LEAST, Part

_Place = tuple[float, float, float]


@dataclass(frozen=True)
class Transmission(Part):
    """A gear, belt or shaft that gives way between a motor and its joint.

    The motor has a coordinate of its own, seen at the joint, with its kinetic energy about its own
    axis only: M. W. Spong, "Modeling and control of elastic joint robots", J. Dyn. Sys., Meas.,
    Control 109, 1987. As the stiffness grows and the backlash shrinks, the joint becomes a rigid
    one with the motor's inertia as its armature.

    Attributes:
        joint: Name of the joint, which an input drives.
        inertia: Of the motor, at the joint [kg m^2 or kg].
        stiffness: [N m/rad or N/m]; infinite for teeth that do not give way, with a backlash.
        damping: [N m s/rad or N s/m]; it acts within the backlash too.
        backlash: The whole play [rad or m].
        friction: Dry friction of the motor, at the joint [N m or N].
        added: Whether the inertia comes on top of what the model has; else it is a part of that,
            of the joint's armature or of a body whose centre the joint moves along or turns about.
    """

    joint: str
    inertia: float
    stiffness: float = math.inf
    damping: float = 0.0
    backlash: float = 0.0
    friction: float = 0.0
    added: bool = True

    kind, owner = "transmission", "joint"
    positive = frozenset({"inertia", "stiffness"})
    infinite = frozenset({"stiffness"})

    def _check(self) -> None:
        if math.isinf(self.stiffness) and not self.backlash:
            self.refuse("it is rigid: give a stiffness, a backlash or both")

    def __str__(self) -> str:
        said = []
        if math.isfinite(self.stiffness):
            said.append(f"gives way by 1/{self.stiffness:.4g}")
        if self.backlash:
            said.append(f"has a play of {self.backlash:.4g}")
        return f"{self.joint}: transmission that {' and '.join(said)}, motor of {self.inertia:.3g}"


@dataclass(frozen=True)
class LuGre(Part):
    """Friction of a joint by bristles, as MuJoCo's motors have it.

    C. Canudas de Wit, H. Olsson, K. J. Astrom and P. Lischinsky, "A new model for control of
    systems with friction", IEEE Trans. Automatic Control 40, 1995: z' = v - s0 |v| z / g(v),
    F = s0 z + s1 z', g = F_c + (F_s - F_c) exp(-(v/v_s)^2). What is viscous is the joint's damping.

    Attributes:
        joint: Name of the joint.
        coulomb: F_c [N m or N].
        static: F_s, from which it slides [N m or N]; F_c for 0.
        stiffness: s0 of the bristles [N m/rad or N/m].
        damping: s1 of the bristles [N m s/rad or N s/m].
        stribeck: v_s [rad/s or m/s].
    """

    joint: str
    coulomb: float
    static: float = 0.0
    stiffness: float = 1e3
    damping: float = 0.0
    stribeck: float = 0.01

    kind, owner = "lugre", "joint"
    positive = frozenset({"coulomb", "stiffness", "stribeck"})

    def _check(self) -> None:
        if 0 < self.static < self.coulomb:
            self.refuse(
                f"static = {self.static:g} must be at least coulomb = {self.coulomb:g}, or 0 for it"
            )

    def __str__(self) -> str:
        return f"{self.joint}: LuGre friction of {max(self.coulomb, self.static):.3g}"


@dataclass(frozen=True)
class Stop(Part):
    """Two ends of a joint's way, which throw it back.

    Attributes:
        joint: Name of the joint.
        low: [rad or m].
        high: [rad or m].
        restitution: Speed after a bounce over that before it, from 0 to below 1.
        duration: Of a bounce [s]: the shorter, the harder.
    """

    joint: str
    low: float
    high: float
    restitution: float = 0.0
    duration: float = 0.02

    kind, owner = "stop", "joint"
    positive = frozenset({"duration"})
    signed = frozenset({"low", "high"})

    def _check(self) -> None:
        if not self.low < self.high:
            self.refuse(f"low = {self.low:g} must be below high = {self.high:g}")
        _require_restitution(self)

    def __str__(self) -> str:
        return f"{self.joint}: stops at {self.low:.4g} and {self.high:.4g}"


@dataclass(frozen=True)
class Motor(Part):
    """A DC motor with its gear and amplifier where the model has an ideal input.

    MuJoCo's own ``dcmotor``. What the law asks for is converted so that a motor at rest gives it;
    back-EMF, lag and limits are what comes between.
    A voltage amplifier is ``voltage``; one that follows a current has a ``bandwidth``, and within
    the voltage of its supply if there is a ``voltage``, too.

    Attributes:
        input: Name of the input that it stands for.
        constant: Torque constant, equal to that of the back-EMF [N m/A].
        resistance: [ohm].
        inductance: [H]; behind a current loop it says how fast a supply can change the current.
        ratio: Turns of the motor for one of its joint, or rad/m of a slide; negative for a motor
            that turns against its joint.
        efficiency: Share of the torque that arrives at the joint, of both the current and the
            back-EMF; the amplifier makes up for it.
        voltage: Largest [V], of a voltage amplifier or of the supply of a current loop; infinite
            for none.
        current: Largest [A]; infinite for none.
        bandwidth: Of a current loop that makes up for the back-EMF [rad/s]; 0 for a voltage
            amplifier. Its supply holds at most the current (V - K w)/R at a speed w of the motor,
            and changes it by V/L at most.
        inertia: Of the rotor, at the motor [kg m^2]; at the joint it is an armature of ratio^2
            times that. That of a ``Transmission`` stands there instead.
        cogging: Amplitude of the torque, at the motor [N m].
        cogging_periods: In a turn of the motor.
        thermal_resistance: Winding to surroundings [K/W]; 0 for a motor that stays cold.
        heat_capacity: Of the winding [J/K].
        added: Whether back-EMF and inertia come on top of what the model has; else they are a part
            of the joint's damping and armature.
    """

    input: str
    constant: float
    resistance: float
    inductance: float = 0.0
    ratio: float = 1.0
    efficiency: float = 1.0
    voltage: float = math.inf
    current: float = math.inf
    bandwidth: float = 0.0
    inertia: float = 0.0
    cogging: float = 0.0
    cogging_periods: float = 12.0
    thermal_resistance: float = 0.0
    heat_capacity: float = 0.0
    added: bool = True

    kind, owner = "motor", "input"
    positive = frozenset(
        {"constant", "resistance", "efficiency", "voltage", "current", "cogging_periods"}
    )
    infinite = frozenset({"voltage", "current"})
    signed = frozenset({"ratio"})

    def _check(self) -> None:
        if self.efficiency > 1:
            self.refuse(f"efficiency = {self.efficiency:g} must be at most 1")
        if bool(self.thermal_resistance) != bool(self.heat_capacity):
            self.refuse("heating needs both thermal_resistance and heat_capacity")
        if 0 < self.time_constant < LEAST:
            self.refuse(f"its current follows in {self.time_constant:.2g} s: leave that out")
        if abs(self.ratio) < LEAST:
            self.refuse(f"ratio = {self.ratio:g} must be at least {LEAST:g}, or negative")

    @property
    def supplied(self) -> bool:
        """Whether it is a current loop with a supply that has an end."""
        return bool(self.bandwidth) and math.isfinite(self.voltage)

    @property
    def time_constant(self) -> float:
        """Of the current [s]; 0 for one that follows at once."""
        return 1 / self.bandwidth if self.bandwidth else self.inductance / self.resistance

    @property
    def emf_damping(self) -> float:
        """What the back-EMF brakes with at the joint [N m s/rad or N s/m]."""
        if self.bandwidth:
            return 0.0
        return self.efficiency * (self.ratio * self.constant) ** 2 / self.resistance

    def __str__(self) -> str:
        kind = f"current loop of {self.bandwidth:.4g} rad/s" if self.bandwidth else "voltage"
        limits = []
        if math.isfinite(self.voltage):
            limits.append(f"{self.voltage:.3g} V")
        if math.isfinite(self.current):
            limits.append(f"{self.current:.3g} A")
        within = f", within {' and '.join(limits)}" if limits else ""
        return f"{self.input}: DC motor by {kind}{within}"


@dataclass(frozen=True)
class SwingingLoad(Part):
    """A point mass that hangs on a body by a massless rod and begins at rest below it.

    Attributes:
        body: Name of the body.
        mass: [kg].
        length: Of the rod [m].
        damping: Of its hinge, whose axis is the y-axis of the body [N m s/rad].
        at: Where it hangs, in the body's own frame [m], (3,).
    """

    body: str
    mass: float
    length: float
    damping: float = 0.0
    at: _Place = (0.0, 0.0, 0.0)

    kind, owner = "swinging load", "body"
    positive = frozenset({"mass", "length"})

    def _check(self) -> None:
        self.require_place("at")

    def __str__(self) -> str:
        return f"{self.body}: {self.mass:.3g} kg swing on {self.length:.3g} m"


@dataclass(frozen=True)
class SlidingLoad(Part):
    """A point mass that slides on a body along its x-axis, held by a spring.

    Attributes:
        body: Name of the body.
        mass: [kg].
        stiffness: [N/m].
        damping: [N s/m].
        at: Where it rests, in the body's own frame [m], (3,).
    """

    body: str
    mass: float
    stiffness: float
    damping: float = 0.0
    at: _Place = (0.0, 0.0, 0.0)

    kind, owner = "sliding load", "body"
    positive = frozenset({"mass", "stiffness"})

    def _check(self) -> None:
        self.require_place("at")

    def __str__(self) -> str:
        return f"{self.body}: {self.mass:.3g} kg slide on {self.stiffness:.3g} N/m"


@dataclass(frozen=True)
class Wall(Part):
    """A plane that a ball on a body can touch, without friction: a table, the end of a room.

    Attributes:
        body: Name of the body.
        radius: Of the ball [m].
        at: Its centre, in the body's own frame [m], (3,).
        point: Of the plane, in the world [m], (3,).
        normal: Where the plane faces, (3,), of any length.
        restitution: Speed after a bounce over that before it, from 0 to below 1.
        duration: Of a bounce [s].
    """

    body: str
    radius: float
    at: _Place = (0.0, 0.0, 0.0)
    point: _Place = (0.0, 0.0, 0.0)
    normal: _Place = (0.0, 0.0, 1.0)
    restitution: float = 0.0
    duration: float = 0.02

    kind, owner = "wall", "body"
    positive = frozenset({"radius", "duration"})

    def _check(self) -> None:
        for name in ("at", "point", "normal"):
            self.require_place(name)
        if not np.any(reals(self.normal)):
            self.refuse("normal = [0, 0, 0] must point somewhere")
        _require_restitution(self)

    def __str__(self) -> str:
        x, y, z = self.point
        return f"{self.body}: a wall at ({x:.3g}, {y:.3g}, {z:.3g})"


def _require_restitution(part: Stop | Wall) -> None:
    """Refuse a bounce that gains, or that loses nothing."""
    if not part.restitution < 1:
        part.refuse(f"restitution = {part.restitution:g} must be below 1")


MachinePart = Transmission | LuGre | Stop | Motor | SwingingLoad | SlidingLoad | Wall

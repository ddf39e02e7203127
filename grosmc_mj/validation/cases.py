"""The cases as values: the chapter's, and this project's where it has no example."""

from __future__ import annotations

import math
from dataclasses import dataclass

from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.plants import find_system
from grosmc_mj.plants.cart_pendulum import CartPendulumParameters, pole_torque
from grosmc_mj.simulation.disturbances import Disturbance, Pulse, SineFrom
from grosmc_mj.simulation.edits import BodyEdit
from grosmc_mj.simulation.models import load_model
from grosmc_mj.validation.designs import PENDULUM_DISTURBANCE


@dataclass(frozen=True)
class Case:
    """One experiment: what is changed against the nominal plant, from where, for how long.

    Attributes:
        system: Name of the system.
        name: ``nominal``, ``case1`` or ``case2``.
        title: For people.
        source: Where the chapter has it, or that this project declares it.
        x0: Start, in the order of the system's states.
        duration: [s]; the chapter prints none.
        edits: Edits of the plant; the controller keeps the nominal numbers.
        disturbances: Wrenches on the plant.
        design: The controllers' design; empty for the system's first one.
    """

    system: str
    name: str
    title: str
    source: str
    x0: tuple[float, ...]
    duration: float
    edits: tuple[BodyEdit, ...] = ()
    disturbances: tuple[Disturbance, ...] = ()
    design: str = ""

    @property
    def controllers(self) -> str:
        """The name of the controllers' design."""
        return self.design or self.system

    @property
    def onset(self) -> float:
        """When the first disturbance begins [s]; infinite if there is none."""
        return min((d.window[0] for d in self.disturbances), default=math.inf)


SERVO_START = (0.0, 0.0)  # x(0) = [1, 0] under the step theta_d = 1 rad
PENDULUM_START = (0.0, -math.pi / 18, 0.0, 0.0)
ARM_START = (0.5, math.pi)  # e(0) = [0.5, 0], since y_r(0) = 0 and y_r'(0) = pi
TWO_LINK_START = (0.6, -1.2, 0.0, 0.0)  # at rest, elbow up, 0.16 m off the circle
TWO_LINK_AWAY = (math.pi / 6, -2.0, 0.0, 0.0)  # 0.52 and 0.43 rad off the pose


def _about_viewer(torque: float) -> tuple[float, float, float, float, float, float]:
    """The wrench of a torque [N m] about the models' joint axes, which all point along -y."""
    return (0.0, 0.0, 0.0, 0.0, -torque, 0.0)


def _servo_cases() -> list[Case]:
    # T_d acts against the rotor, eq. (15).
    load = Disturbance("rotor", _about_viewer(-1.0), Pulse(10.0, 13.0), "load torque of 1 N m")
    heavier = BodyEdit("rotor", mass_scale=3.0)
    start = SERVO_START
    return [
        Case("servo", "nominal", "Step of 1 rad, nominal rotor", "section 2.3", start, 10.0),
        Case(
            "servo",
            "case1",
            "Load torque of 1 N m for 10 s ≤ t < 13 s",
            "section 2.3, Fig. 1",
            start,
            18.0,
            disturbances=(load,),
        ),
        Case(
            "servo",
            "case2",
            "Three times the inertia",
            "section 2.3, Fig. 2",
            start,
            10.0,
            (heavier,),
        ),
    ]


def _pendulum_cases() -> list[Case]:
    nominal = CartPendulumParameters.from_model(load_model("cart_pendulum"), "corrected")
    # The torque that gives the upright pole d(t); cos^2(theta) makes it inexact by less than
    # 1e-4 of d within 1 degree of upright, where the pole is when d(t) begins.
    torque = pole_torque(PENDULUM_DISTURBANCE, nominal)
    push = Disturbance(
        "pole", _about_viewer(torque), SineFrom(2.0, 9.0), "d(t) = 0.01 sin 2t rad/s²"
    )
    larger = BodyEdit("pole", mass_scale=4.0, length_scale=4.0)
    start, system = PENDULUM_START, "cart_pendulum"
    return [
        Case(system, "nominal", "From -10 degrees, nominal pole", "section 3.4", start, 6.0),
        Case(
            system,
            "case1",
            "Four times the mass and the length of the pole",
            "section 3.4, Figs. 3 and 5",
            start,
            6.0,
            (larger,),
        ),
        Case(
            system,
            "case2",
            "d(t) = 0.01 sin 2t rad/s² from t = 9 s",
            "section 3.4, Fig. 4",
            start,
            18.0,
            disturbances=(push,),
        ),
    ]


def _arm_cases() -> list[Case]:
    # d(t) acts against the torque, eq. (57).
    push = Disturbance("link", _about_viewer(-0.5), SineFrom(2 * math.pi), "d(t) = 0.5 sin 2πt N m")
    payload = BodyEdit("link", mass_scale=2.0, length_scale=1.25)
    start = ARM_START
    return [
        Case("arm", "nominal", "Tracking sin πt, no disturbance", "section 4.3", start, 6.0),
        Case(
            "arm",
            "case1",
            "d(t) = 0.5 sin 2πt N m",
            "section 4.3, Figs. 6 to 8",
            start,
            6.0,
            disturbances=(push,),
        ),
        Case(
            "arm",
            "case2",
            "Twice the payload on 1.25 times the link",
            "claimed in words in section 4.3; the numbers are this project's",
            start,
            6.0,
            (payload,),
        ),
    ]


def _two_link_cases() -> list[Case]:
    system, own = "two_link_arm", "this project: the chapter has no example of several inputs"
    pushes = (
        Disturbance(
            "payload",
            (0.0, 0.0, 5.0, 0.0, 0.0, 0.0),
            SineFrom(2 * math.pi),
            "5 sin 2πt N at the tip",
        ),
        Disturbance("upper", _about_viewer(2.0), SineFrom(math.pi), "2 sin πt N m on link 1"),
    )
    longer = (BodyEdit("upper", 1.0, 1.05), BodyEdit("lower", 1.0, 1.05))
    heavier = BodyEdit("payload", mass_scale=5.0)
    regulation = "two_link_arm regulation"
    return [
        Case(system, "nominal", "A circle of the tip, no disturbance", own, TWO_LINK_START, 6.0),
        Case(
            system, "case1", "A circle under forces on tip and link", own, TWO_LINK_START, 6.0,
            disturbances=pushes,
        ),
        Case(
            system, "case2", "A circle with 1 kg at the tip, links 5 % longer", own,
            TWO_LINK_START, 6.0, (*longer, heavier),
        ),
        Case(
            system, "regulation", "To a pose, no disturbance", own, TWO_LINK_AWAY, 5.0,
            design=regulation,
        ),
        Case(
            system, "regulation1", "To a pose with 0.6 kg at the tip and 5 N on it", own,
            TWO_LINK_AWAY, 5.0, (BodyEdit("payload", mass_scale=3.0),), pushes[:1], regulation,
        ),
    ]  # fmt: skip


def cases(system: str) -> list[Case]:
    """The cases of a system, in the chapter's order.

    Raises:
        ModelError: If there is no such system.
    """
    makers = {
        "servo": _servo_cases,
        "cart_pendulum": _pendulum_cases,
        "arm": _arm_cases,
        "two_link_arm": _two_link_cases,
    }
    return makers[find_system(system).name]()


def find_case(system: str, name: str) -> Case:
    """One case by its name.

    Raises:
        ArgumentError: If the system has no such case.
    """
    found = {case.name: case for case in cases(system)}
    if name not in found:
        raise ArgumentError(unknown_name(f"case of {system}", name, found))
    return found[name]

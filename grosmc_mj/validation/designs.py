"""The chapter's controllers with its numbers, and what had to be declared beside them.

What the chapter prints is marked so; the rest is this project's declaration.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import (
    Task,
    linear_grosmc,
    linear_lqr,
    linearized_lqr,
    regulating_grosmc,
    tracking_grosmc,
)
from grosmc_mj.control.error_coordinates import ErrorCoordinates
from grosmc_mj.control.gains import Uncertainty
from grosmc_mj.control.references import Setpoint, Sine, setpoint, sine
from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.plants import (
    ARM,
    CART_PENDULUM,
    SERVO,
    AnalyticPlant,
    CartPendulumParameters,
    find_system,
)
from grosmc_mj.plants.cart_pendulum import pole_torque


@dataclass(frozen=True)
class Designs:
    """The controllers of one system.

    Attributes:
        task: What they are designed for, from the nominal plant.
        build: Each controller, by its name.
        aliases: Further names of the same laws, and why they are the same.
    """

    task: Callable[[AnalyticPlant], Task]
    build: Mapping[str, Callable[[Task], Controller]]
    aliases: Mapping[str, tuple[str, str]]


# Servo. Printed: theta_d = 1 rad, Q = I, R = 1. Declared: the family covers both cases, from
# the nominal inertia to three times it, with loads up to 1 N m.
SERVO_ERROR = ErrorCoordinates(SERVO, setpoint, -1)
SERVO_STEP = Setpoint(1.0)
SERVO_WEIGHTS = (np.eye(2), 1.0)
SERVO_UNCERTAINTY = Uncertainty(
    scales={"J": (1.0, 3.0)},
    wrench=(0.0, 0.0, 0.0, 0.0, 1.0, 0.0),
    region=(1.2, 1.2),
    reaching_rate=0.2,
)

# Pendulum. Nothing of the design is printed. Declared: Q = diag(100, 1), R = 1, which settles
# in the 2 s that the text speaks of; the family covers both cases, from the nominal pole to
# four times its mass and length, with pole torques up to that of d(t) = 0.01 rad/s^2.
PENDULUM_ERROR = ErrorCoordinates(CART_PENDULUM, setpoint)
PENDULUM_UPRIGHT = Setpoint(0.0)
PENDULUM_WEIGHTS = (np.diag([100.0, 1.0]), 1.0)
PENDULUM_DISTURBANCE = 0.01  # rad/s^2, printed
PENDULUM_REGION = (np.pi / 6, 1.5)
PENDULUM_REACHING_RATE = 0.2

# Arm. Printed: y_r = sin(pi t), Q, R, k, epsilon and G.
ARM_ERROR = ErrorCoordinates(ARM, sine)
ARM_REFERENCE = Sine(1.0, np.pi)
ARM_WEIGHTS = (np.array([[10.0, 2.0], [2.0, 1.0]]), 1.0)
ARM_GAINS = (18.0, 6.0)
ARM_G = np.array([[0.0, 1.0]])


def pendulum_uncertainty(nominal: CartPendulumParameters) -> Uncertainty:
    """The declared family of the pendulum about a nominal one."""
    torque = pole_torque(PENDULUM_DISTURBANCE, nominal)
    return Uncertainty(
        scales={"m": (1.0, 4.0), "L": (1.0, 4.0)},
        wrench=(0.0,) * 10 + (torque, 0.0),
        region=PENDULUM_REGION,
        reaching_rate=PENDULUM_REACHING_RATE,
    )


DESIGNS: Mapping[str, Designs] = {
    "servo": Designs(
        task=lambda plant: Task(plant, SERVO_ERROR, SERVO_STEP, *SERVO_WEIGHTS),
        build={
            "lqr": linear_lqr,
            "grosmc": lambda task: linear_grosmc(task, SERVO_UNCERTAINTY),
        },
        aliases={"fl-lqr": ("lqr", "the plant is linear already")},
    ),
    "cart_pendulum": Designs(
        task=lambda plant: Task(plant, PENDULUM_ERROR, PENDULUM_UPRIGHT, *PENDULUM_WEIGHTS),
        build={
            "lqr": linear_lqr,
            "fl-lqr": linearized_lqr,
            "grosmc": lambda task: regulating_grosmc(
                task, pendulum_uncertainty(task.plant.parameters)
            ),
        },
        aliases={},
    ),
    "arm": Designs(
        task=lambda plant: Task(plant, ARM_ERROR, ARM_REFERENCE, *ARM_WEIGHTS),
        build={
            "lqr": lambda task: linearized_lqr(task, name="lqr"),
            "grosmc": lambda task: tracking_grosmc(task, *ARM_GAINS, ARM_G),
        },
        aliases={"fl-lqr": ("lqr", "the chapter compares with the LQR part v = -K e alone")},
    ),
}


def controller_names(system: str) -> list[str]:
    """Names of the distinct controllers of a system."""
    return list(DESIGNS[find_system(system).name].build)


def chapter_controller(name: str, nominal: AnalyticPlant) -> Controller:
    """The chapter's controller of that name, designed for a nominal analytic plant.

    Args:
        name: ``lqr``, ``fl-lqr`` or ``grosmc``.
        nominal: The plant that the law believes in, for instance
            ``MujocoPlant.load("arm").analytic()``.

    Raises:
        ArgumentError: If the system has no such controller.
        GainError: If the design fails for these numbers.
    """
    designs = DESIGNS[nominal.system.name]
    valid = [*designs.build, *designs.aliases]
    if name not in valid:
        raise ArgumentError(unknown_name(f"controller of {nominal.system.name}", name, valid))
    return designs.build[designs.aliases.get(name, (name, ""))[0]](designs.task(nominal))

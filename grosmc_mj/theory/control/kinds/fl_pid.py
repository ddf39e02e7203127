"""Computed-torque PID."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from grosmc_mj.ground.errors import GainError
from grosmc_mj.ground.fields import checked
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.dynamic_feedback import input_rows
from grosmc_mj.theory.control.integral_action import integrating_controller
from grosmc_mj.theory.control.kinds.kind import OF_EQUATIONS, OF_OUTPUTS, LawKind
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.task import Limit, Task

# Beyond this the powers of a frequency overflow.
MOST_FREQUENCY = 1e50


@checked()
class FlPid(LawKind):
    """PID through feedback linearization, with three poles at one place for every output.

    v = -3 w^2 e - w^3 xi - 3 w e' with xi' = e, so that (s + w)^3 is what the nominal error obeys:
    computed-torque PID (J. J. Craig, "Introduction to Robotics", 3rd ed., section 10.7; F. L.
    Lewis, D. M. Dawson and C. T. Abdallah, "Robot Manipulator Control", 2nd ed., section 4.4).
    The rate e' is the measured one, as all laws here have it; every output must have relative
    degree two. The integrals hold while an input is beyond its limit.
    """

    key = "fl-pid"
    where = OF_OUTPUTS
    follows_weights = False

    frequency: Annotated[
        float,
        LawNumber(
            low=0,
            high=MOST_FREQUENCY,
            unit="rad/s",
            above=True,
            meaning="frequency w of all three poles",
            search=(0.3, 300),
        ),
    ]
    limit: Limit = math.inf

    def design(self, task: Task) -> Controller:
        """Return the law for a task.

        Raises:
            GainError: If an output has another relative degree or, on the linearization, zero
                error is no equilibrium without input.
        """
        optimum = task.optimum(linearizing=self.linearizing)
        chains = task.outputs.linearization
        if set(chains.relative_degree) != {2}:
            raise GainError(f"PID: the relative degrees {chains.relative_degree} must all be 2")

        w = self.frequency
        a, E = input_rows(task, optimum)
        identity = np.eye(task.error.inputs)
        gain_of_error = np.kron(identity, [[3 * w**2, 3 * w]])
        return integrating_controller(
            "fl-pid",
            task,
            optimum,
            K=np.linalg.solve(E, gain_of_error + a),
            H=np.linalg.solve(E, w**3 * identity),
            limit=self.limit,
            source="computed-torque PID, Craig",
            linearizing=self.linearizing,
        )


@checked()
class LinearPid(FlPid):
    """PID with three poles at one place on the plant's linearization about zero error."""

    key = "linear-pid"
    where = OF_EQUATIONS
    linearizing = False

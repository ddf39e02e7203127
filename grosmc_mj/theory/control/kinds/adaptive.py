"""Slotine and Li's adaptive law: the dynamics' parameters are found while the arm moves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import PremiseError
from grosmc_mj.ground.fields import checked
from grosmc_mj.theory.control.controller import Controller, TaskNumbers, noting_controller
from grosmc_mj.theory.control.coordinates.base import OutputCoordinates
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.theory.control.design import linear_lqr, linearized_lqr
from grosmc_mj.theory.control.kinds.kind import OF_EQUATIONS, LawKind
from grosmc_mj.theory.control.law import Law
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.matrices import row_times
from grosmc_mj.theory.control.memory import Memory, memory_of, vector
from grosmc_mj.theory.control.task import Limit, Task
from grosmc_mj.theory.plants.parametrization import LinearParametrization


@dataclass(frozen=True, eq=False, kw_only=True)
class AdaptiveNumbers(TaskNumbers):
    """Numbers of Slotine and Li's law for m joints.

    Attributes:
        frequency: Lambda [1/s].
        adaptation: gamma, the same for all parameters in SI units.
        damping: K_D, in the unit of the input times seconds per unit of the joint, (m, m).
        limit: Largest |u|, in the unit of the input; infinite for none.
    """

    frequency: float
    adaptation: float
    damping: Array
    limit: float


@dataclass
class AdaptiveMemory(Memory):
    """Memory of Slotine and Li's law for m joints, n entries of z and k parameters.

    Attributes:
        theta: Estimates of the parameters for the next sample, in SI units, (k,).
        composite: s at the last sample by the sign of e = q - q_d, in the unit of the joints per
            second, (m,).
        z: Error state at the last sample, in the units of the error coordinates, (n,).
        r: Reference rate at the last sample, in the unit of the joints per second, (m,).
        a: Derivative r' at the last sample, in that unit per second, (m,).
    """

    theta: Array = vector("k")
    composite: Array = vector("m")
    z: Array = vector("n")
    r: Array = vector("m")
    a: Array = vector("m")


@checked()
class Adaptive(LawKind):
    """Slotine and Li's adaptive law for a mechanical system with an input for each joint.

        u = Y(q, q', r, r') theta - K_D s,   theta' = -gamma Y's,
        r = q_d' - Lambda e,   s = q' - r = e' + Lambda e,   K_D = Lambda M(q_d(0)),

    on V = s'M s/2 + |theta - theta*|^2/(2 gamma), V' = -s'K_D s: J.-J. E. Slotine and W. Li, "On
    the adaptive control of robot manipulators", International Journal of Robotics Research 6(3),
    1987. The estimates begin at the nominal parameters, a constant load on each joint among them
    at zero, and take a step of Euler's method a sample: with gamma T |Y|^2 near 2 K_D they drift
    instead of settling; they hold while an input is beyond its limit. Nominally, without
    adaptation and as long as the inertia stays what it is, both poles of the error are at -Lambda.

    The outputs must be the joints of a system with a parametrization: the servo, the arm, the
    two-link arm. Its runs are compared with the optimum after feedback linearization.
    """

    key = "adaptive"
    where = OF_EQUATIONS
    follows_weights = False

    frequency: Annotated[
        float,
        LawNumber(
            low=0,
            unit="rad/s",
            above=True,
            meaning="Lambda, the place of both poles of the error",
            search=(0.3, 300),
        ),
    ]
    adaptation: Annotated[
        float,
        LawNumber(
            low=0,
            above=True,
            meaning="gamma, the rate of adaptation of all parameters in SI units",
            search=(1e-4, 1e3),
        ),
    ]
    limit: Limit = math.inf

    def design(self, task: Task) -> Controller:
        """Return the law for a task.

        Raises:
            PremiseError: If the system has no parametrization, or other outputs than its joints.
        """
        error = task.outputs
        parametrization = _parametrization_of(error)

        q_d = np.array(error.reference(0.0, task.reference))[::3]
        damping = self.frequency * parametrization.inertia(q_d, task.plant.parameters)
        like = linearized_lqr(task) if self.linearizing else linear_lqr(task)
        numbers = AdaptiveNumbers(
            plant=like.parameters.plant,
            reference=like.parameters.reference,
            frequency=self.frequency,
            adaptation=self.adaptation,
            damping=damping,
            limit=self.limit,
        )
        return noting_controller(
            "adaptive",
            slotine_li(error, parametrization),
            like,
            numbers,
            memory_of(AdaptiveMemory, m=error.inputs, n=error.size, k=len(parametrization.theta)),
            source="Slotine and Li 1987",
            gains={"frequency": self.frequency, "adaptation": self.adaptation},
        )


@checked()
class LinearAdaptive(Adaptive):
    """Slotine and Li's law, compared with the optimum of the plant's linearization."""

    key = "linear-adaptive"
    linearizing = False


def _parametrization_of(error: OutputCoordinates) -> LinearParametrization:
    """Torques of the system that are linear in its parameters.

    Raises:
        PremiseError: If the system has none, or other outputs than its joints.
    """
    system = error.system
    if system.parametrization is None or not isinstance(error, ErrorCoordinates):
        raise PremiseError(
            f"adaptive: {system.name} has no torques Y theta in symbols, as servo, arm and "
            "two_link_arm have: take lqi, fl-pid or adrc"
        )

    joints = tuple(system.symbolic_equations.x[: error.inputs])
    if error.linearization.h != joints:
        names = ", ".join(map(str, joints))
        raise PremiseError(f"adaptive: the outputs of {system.name} must be its joints, {names}")
    return system.parametrization


# A law of the same coordinates is one function, which is compiled once.
@cache
def slotine_li(error: OutputCoordinates, parametrization: LinearParametrization) -> Law:
    """Law on error coordinates of one reference with two derivatives for each joint."""
    k = len(parametrization.theta)
    sign = float(error.sign)
    error_state = error.state
    reference = error.reference
    nominal = parametrization.nominal
    regressor = parametrization.regressor

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        z = memory.z
        s = memory.composite
        r = memory.r
        a = memory.a
        theta = memory.theta
        m = len(u)

        if not memory.begun:
            start = nominal(p.plant)
            for j in range(k):
                theta[j] = start[j]

        error_state(t, x, p, z)
        y = reference(t, p.reference)
        for i in range(m):
            s[i] = sign * (z[2 * i + 1] + p.frequency * z[2 * i])
            r[i] = y[3 * i + 1] - sign * p.frequency * z[2 * i]
            a[i] = y[3 * i + 2] - sign * p.frequency * z[2 * i + 1]

        Y = regressor(x, r, a, p.plant)
        limited = False
        for i in range(m):
            u[i] = -row_times(i, p.damping, s)
            for j in range(k):
                u[i] += Y[i * k + j] * theta[j]
            limited = limited or abs(u[i]) > p.limit

        # The estimates hold while an input is beyond its limit.
        if not limited:
            for j in range(k):
                change = 0.0
                for i in range(m):
                    change += Y[i * k + j] * s[i]
                theta[j] -= p.period * p.adaptation * change

    return law

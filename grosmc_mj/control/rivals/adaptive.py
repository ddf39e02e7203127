"""Slotine and Li's adaptive law: the dynamics' parameters are found while the arm moves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.arguments import real, require
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, Design, Sampled
from grosmc_mj.control.coordinates.base import OutputCoordinates
from grosmc_mj.control.coordinates.torques import LinearTorques
from grosmc_mj.control.laws import Law
from grosmc_mj.control.memory import memory_of
from grosmc_mj.control.task import Task
from grosmc_mj.errors import GainError, shown
from grosmc_mj.vectors import algebra, each, row_times


@dataclass(frozen=True, eq=False, kw_only=True)
class AdaptiveParameters(Sampled):
    """Numbers of the adaptive law.

    Attributes:
        plant: The nominal plant's parameters, which the estimates begin with.
        reference: The reference's parameters.
        frequency: Lambda of s = e' + Lambda e [1/s].
        damping: K_D, (m, m), in the unit of the input per that of the rate.
        adaptation: gamma.
        limit: Largest |u| that the actuators give, in the unit of the input; infinite for none.
    """

    plant: Any
    reference: Any
    frequency: float
    damping: Array
    adaptation: float
    limit: float


def adaptive(
    task: Task,
    frequency: float,
    adaptation: float,
    limit: float = math.inf,
    body: str | None = None,
    *,
    linearizing: bool = True,
) -> Controller:
    """Slotine and Li's adaptive law for a mechanical system with an input for each joint.

        u = Y(q, q', r, r') theta - K_D s,   theta' = -gamma Y's,
        r = q_d' - Lambda e,   s = q' - r = e' + Lambda e,   K_D = Lambda M(q_d(0)),

    on V = s'M s/2 + |theta - theta*|^2/(2 gamma), V' = -s'K_D s: J.-J. E. Slotine and W. Li, "On
    the adaptive control of robot manipulators", International Journal of Robotics Research 6(3),
    1987. The estimates begin at the nominal parameters, a constant load on each joint among them
    at zero, and take a step of Euler's method a sample: with gamma T |Y|^2 near 2 K_D they drift
    instead of settling. Nominally, without adaptation and as long
    as the inertia stays what it is, both poles of the error are at -Lambda.

    Of a robot what is unknown is the inertia of one body, ten parameters about the nominal ones,
    beside the loads; all else is MuJoCo's nominal dynamics, which take the place of Y theta.

    Args:
        task: What is designed for; the outputs must be the joints of a robot, or of a system with
            a parametrization: the servo, the arm, the two-link arm.
        frequency: Lambda [1/s].
        adaptation: gamma, the same for all parameters in SI units.
        limit: Largest |u|, in the unit of the input: the estimates hold while an input is beyond.
        body: Of a robot, the body that carries what is unknown; by default the one that its last
            joint moves.
        linearizing: Whether it is judged against the optimum after feedback linearization; else
            against that of the plant's linearization.

    Raises:
        ArgumentError: If there is no such body.
        GainError: If a number is not positive.
        PremiseError: If the system has no parametrization, or other outputs than its joints.
    """
    require("task", task, Task, "a Task(plant, error, reference, Q, R)")
    for name, value in (("frequency", frequency), ("adaptation", adaptation)):
        if not 0 < real(value) < math.inf:
            raise GainError(f"adaptive: {name} = {shown(value)} must be finite and positive")
    if not real(limit) > 0:
        raise GainError(f"adaptive: limit = {shown(limit)} must be positive")
    if body is not None:
        require("adaptive: body", body, str, "the name of a body")
    error, torques = task.error, task.error.torques(body)
    q_d = np.array(error.reference(0.0, task.reference))[::3]
    parameters = AdaptiveParameters(
        plant=task.plant.parameters,
        reference=task.reference,
        frequency=float(frequency),
        damping=frequency * torques.inertia(q_d, task.plant.parameters),
        adaptation=float(adaptation),
        limit=float(limit),
    )
    optimum = task.optimum(linearizing=linearizing)
    return Controller(
        "adaptive",
        slotine_li(error, torques),
        parameters,
        # The estimates for the next sample, and s of the last one by the sign of e = q - q_d.
        memory_of(error.inputs, theta=np.zeros(torques.size), composite=np.zeros(error.inputs)),
        Design(
            error,
            optimum,
            source="Slotine and Li 1987",
            gains={"frequency": float(frequency), "adaptation": float(adaptation)},
            linearizing=linearizing,
            follows_optimum=False,
        ),
    )


@cache
def slotine_li(error: OutputCoordinates, found: LinearTorques) -> Law:
    """The law on some error coordinates, of one reference with two derivatives a joint."""
    m, k, sign = error.inputs, found.size, float(error.sign)
    error_state, reference, driven = error.state, error.reference, error.driven
    nominal, known, regressor = found.nominal, found.known, found.regressor
    operations = algebra(m)
    store, given = operations.store, operations.given
    within, differ = operations.within, operations.differ
    composite = each(m, lambda i, z, p: sign * (z[2 * i + 1] + p.frequency * z[2 * i]))
    rates = each(m, lambda i, z, y, p: y[3 * i + 1] - sign * p.frequency * z[2 * i])
    accelerations = each(m, lambda i, z, y, p: y[3 * i + 2] - sign * p.frequency * z[2 * i + 1])

    def torque(i: int, fixed: Any, Y: Any, theta: Any, s: Any, p: Any) -> float:
        total = fixed[i] - row_times(i, p.damping, s)
        for j in range(k):
            total += Y[i * k + j] * theta[j]
        return total

    torques = each(m, torque)

    def law(t: float, x: Any, memory: Any, p: Any) -> Any:
        if t == memory.first:
            theta = nominal(p)
            for j in range(k):
                memory.theta[j] = theta[j]
        z, y = error_state(t, x, p), reference(t, p.reference)
        s = composite(z, p)
        r, a = rates(z, y, p), accelerations(z, y, p)
        fixed, Y = known(x, r, a, memory, p), regressor(x, r, a, memory, p)
        u = torques(fixed, Y, memory.theta, s, p)
        store(memory.composite, s)
        store(memory.v, driven(t, x, u, memory, p))
        if not differ(within(u, p.limit), u):
            for j in range(k):
                change = 0.0
                for i in range(m):
                    change += Y[i * k + j] * s[i]
                memory.theta[j] -= p.period * p.adaptation * change
        return given(u)

    return law

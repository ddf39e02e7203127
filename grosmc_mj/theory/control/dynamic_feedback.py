"""Sampled linear feedback with dynamics of its own: integrals and observers as one law.

    v = -(K z + H q),    q+ = F q + G z + L v,

with v through feedback linearization, eqs. (23) and (44), or as the input itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

from grosmc_mj.ground.arrays import Array
from grosmc_mj.theory.control.controller import Controller, Design, TaskNumbers
from grosmc_mj.theory.control.coordinates.base import Coordinates
from grosmc_mj.theory.control.law import Law
from grosmc_mj.theory.control.lqr import LqrDesign
from grosmc_mj.theory.control.matrices import row_times
from grosmc_mj.theory.control.memory import Memory, memory_of, vector
from grosmc_mj.theory.control.task import Task


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Matrices of a law with N states q, at one control period; units are those of q, z and v.

    Attributes:
        K: Gain of the error state, unit of v per unit of z, (m, n).
        H: Gain of q, unit of v per unit of q, (m, N).
        F: State matrix of q+, (N, N).
        G: Input matrix of q+ for z, (N, n).
        L: Input matrix of q+ for the v that is applied, (N, m).
        start: Matrix of q = start z as a run begins, (N, n).
    """

    K: Array
    H: Array
    F: Array
    G: Array
    L: Array
    start: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class DynamicParameters(TaskNumbers):
    """Numbers of a law with dynamics.

    Attributes:
        dynamics: Matrices at the run's control period.
        limit: Largest |u| that the actuators give, in the unit of the input; infinite for none.
    """

    dynamics: Dynamics
    limit: float = math.inf


@dataclass
class DynamicMemory(Memory):
    """Memory of a law with N states q, on n entries of z and m inputs.

    Attributes:
        z: Error state at the last sample, in the units of the error coordinates, (n,).
        q: State of the law at the next sample: integrals of the outputs' errors, in the units of
            the outputs times seconds, or an observer's estimates of z and, in the units of v, of
            the disturbance, (N,).
        after: Room to compute q in, (N,).
        within: Input within the limit, in the units of the inputs, (m,).
        applied: v of that input, (m,).
    """

    z: Array = vector("n")
    q: Array = vector("order")
    after: Array = vector("order")
    within: Array = vector("m")
    applied: Array = vector("m")


# Cached, so that all controllers on these coordinates have one law, which is compiled once.
@cache
def dynamic_feedback(error: Coordinates, *, linearizing: bool, holds: bool) -> Law:
    """Law on some error coordinates.

    Args:
        error: The error coordinates.
        linearizing: Whether v goes through feedback linearization; else it is the input.
        holds: Whether q holds while an input is cut off at ``p.limit``: integrals hold, so that
            they do not wind up; an observer goes on, with the v of the input that is cut.
    """
    error_state = error.state
    apply, virtual_input = error.input_maps(linearizing=linearizing)

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        d = p.dynamics
        z = memory.z
        v = memory.v
        q = memory.q
        after = memory.after

        error_state(t, x, p, z)
        if not memory.begun:
            for i in range(len(q)):
                q[i] = row_times(i, d.start, z)

        for i in range(len(v)):
            feedback = row_times(i, d.K, z) + row_times(i, d.H, q)
            v[i] = 0.0 - feedback
            memory.applied[i] = v[i]
        apply(t, x, v, memory, p, u)

        # The v that is applied, if the actuator cuts the input off.
        cut = False
        for i in range(len(u)):
            memory.within[i] = min(p.limit, max(-p.limit, u[i]))
            cut = cut or memory.within[i] != u[i]
        if cut and holds:
            return
        if cut:
            virtual_input(t, x, memory.within, memory, p, memory.applied)

        for i in range(len(q)):
            after[i] = row_times(i, d.F, q) + row_times(i, d.G, z)
            after[i] += row_times(i, d.L, memory.applied)
        for i in range(len(q)):
            q[i] = after[i]

    return law


def dynamic_controller(
    name: str,
    task: Task,
    optimum: LqrDesign,
    at: Callable[[float], Dynamics],
    *,
    linearizing: bool,
    holds: bool,
    gains: dict[str, float],
    limit: float,
    source: str,
) -> Controller:
    """Controller with this law, judged against the optimum that GROSMC follows.

    Args:
        name: Name of the controller.
        task: The task.
        optimum: The nominal optimum of the task.
        at: Returns the law's matrices at a control period [s].
        linearizing: Whether it goes through feedback linearization.
        holds: Whether q holds while an input is cut off.
        gains: Gains worth showing.
        limit: Largest |u|, infinite for none.
        source: Source of the law in the literature.
    """
    if math.isfinite(limit):
        gains = gains | {"limit": limit}

    # Shapes are the same at every period; a run takes the matrices of its own period.
    dynamics = at(1.0)
    memory = memory_of(DynamicMemory, m=task.error.inputs, n=task.error.size, order=len(dynamics.F))
    parameters = DynamicParameters(
        plant=task.plant.parameters,
        reference=task.reference,
        dynamics=dynamics,
        limit=limit,
    )
    design = Design(
        task.error,
        optimum,
        source=source,
        gains=gains,
        linearizing=linearizing,
        numbers_at=lambda period: {"dynamics": at(period)},
        # Of these laws only the observer's is the LQR where there is no load.
        follows_optimum=not holds,
        weighed=task.weighed,
    )
    law = dynamic_feedback(task.error, linearizing=linearizing, holds=holds)
    return Controller(name, law, parameters, memory, design)


def input_rows(task: Task, optimum: LqrDesign) -> tuple[Array, Array]:
    """a (m, n) and E (m, m) of z_i^(r_i) = a_i z + (E v)_i, the rows of z' with the inputs.

    After feedback linearization a is zero and E the identity.
    """
    rows = list(task.outputs.linearization.last_rows)
    return optimum.A[rows], optimum.B[rows]

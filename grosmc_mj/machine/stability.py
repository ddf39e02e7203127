"""What timestep the springs and dampers of a machine need.

Each is looked at alone, as an oscillator q'' + d q' + w^2 q = 0 against the rest of the machine:
what is stiff in a machine is so by far.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError
from grosmc_mj.machine.bounces import TEETH, spring_and_damper
from grosmc_mj.machine.names import transmission_of
from grosmc_mj.machine.parts import (
    LuGre,
    MachinePart,
    Motor,
    SlidingLoad,
    Stop,
    Transmission,
    Wall,
)

# Of the largest stable timestep: what else moves needs a part of it.
_SAFE = 0.9
# Largest share by which an implicit integrator may slow what slides on bristles.
_SLOWED = 0.02


class _Oscillator(NamedTuple):
    """w^2 [1/s^2] and d [1/s] of a part; a constraint's damping is explicit whatever integrates."""

    part: MachinePart
    square: float
    damping: float
    constrained: bool = False


def refuse_unstable(model: mujoco.MjModel, name: str, parts: Sequence[MachinePart]) -> None:
    """Refuse a timestep with which a part of a machine would blow up.

    Args:
        model: Compiled, with the parts in it.
        name: Of the system, in messages.
        parts: Of the machine.

    Raises:
        ModelError: With the part and the timestep that it needs.
    """
    h = float(model.opt.timestep)
    integrator = mujoco.mjtIntegrator(model.opt.integrator)
    oscillators = list(_oscillators(model, parts))
    for each in oscillators:
        if _growth(each, h, integrator) <= 1 + 1e-9:
            continue
        longest = _SAFE * _longest(each, h, integrator)
        if isinstance(each.part, Motor):
            raise ModelError(
                f"{name}: motor of {each.part.of!r}: its current follows in {1 / each.damping:.2g} "
                f"s, which RK4 with a timestep of {h:g} s makes unstable: take at most "
                f"{longest:.2g} s, another integrator, or leave its inductance out"
            )
        raise ModelError(
            f"{name}: {each.part.kind} of {each.part.of!r} moves at {math.sqrt(each.square):.4g} "
            f"rad/s, which a timestep of {h:g} s makes unstable: take at most {longest:.2g} s, or "
            "what is less stiff"
        )
    implicit = integrator in (
        mujoco.mjtIntegrator.mjINT_IMPLICITFAST, mujoco.mjtIntegrator.mjINT_IMPLICIT
    )  # fmt: skip
    for each in oscillators:
        slowed = h * each.damping
        if isinstance(each.part, LuGre) and implicit and slowed > _SLOWED:
            raise ModelError(
                f"{name}: lugre of {each.part.of!r}: implicit integrators divide the acceleration "
                f"of what slides on bristles by 1 + h damping/inertia = {1 + slowed:.3g}: take "
                "integrator RK4 or Euler, or a shorter timestep"
            )


def _oscillators(model: mujoco.MjModel, parts: Sequence[MachinePart]) -> Iterator[_Oscillator]:
    for part in parts:
        if isinstance(part, Transmission) and math.isfinite(part.stiffness):
            weight = float(model.tendon_invweight0[model.tendon(transmission_of(part.joint)).id])
            yield _Oscillator(part, part.stiffness * weight, part.damping * weight)
        elif isinstance(part, Transmission):
            yield _Oscillator(part, *spring_and_damper(*TEETH), constrained=True)
        elif isinstance(part, LuGre):
            weight = float(model.dof_invweight0[model.joint(part.joint).dofadr[0]])
            yield _Oscillator(part, part.stiffness * weight, part.damping * weight)
        elif isinstance(part, (Stop, Wall)):
            bounce = spring_and_damper(part.restitution, part.duration)
            yield _Oscillator(part, *bounce, constrained=True)
        elif isinstance(part, Motor):
            # MuJoCo's implicit integrators move a current exactly; RK4 as any other state.
            index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, part.input)
            constant = float(model.actuator_dynprm[index, 0])
            if constant > 0 and model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
                yield _Oscillator(part, 0.0, 1 / constant)
        elif isinstance(part, SlidingLoad):
            yield _Oscillator(part, part.stiffness / part.mass, part.damping / part.mass)


def _growth(each: _Oscillator, h: float, integrator: mujoco.mjtIntegrator) -> float:
    """By how much an oscillation grows in a timestep."""
    square, d = each.square, each.damping
    A = np.array([[0.0, 1.0], [-square, -d]])
    if integrator == mujoco.mjtIntegrator.mjINT_RK4:
        z = h * A
        step = np.eye(2) + z @ (np.eye(2) + z @ (np.eye(2) / 2 + z @ (np.eye(2) / 6 + z / 24)))
    else:
        implicit = integrator != mujoco.mjtIntegrator.mjINT_EULER and not each.constrained
        divided = 1.0 / (1.0 + h * d) if implicit else 1.0
        kept, push = divided if implicit else 1.0 - h * d, -h * square * divided
        step = np.array([[1.0 + h * push, h * kept], [push, kept]])
    return float(np.abs(np.linalg.eigvals(step)).max())


def _longest(each: _Oscillator, unstable: float, integrator: mujoco.mjtIntegrator) -> float:
    """The longest timestep that is stable, below one that is not [s]."""
    stable = unstable
    while _growth(each, stable, integrator) > 1 + 1e-9 and stable > 1e-9:
        stable /= 2
    for _ in range(30):
        middle = math.sqrt(stable * unstable)
        if _growth(each, middle, integrator) > 1 + 1e-9:
            unstable = middle
        else:
            stable = middle
    return stable

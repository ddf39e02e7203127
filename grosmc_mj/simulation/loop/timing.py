"""Times on the grid of a timestep: control periods, delays."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import Range, checked_call

# Bounds of durations, timesteps and control periods [s]: beyond them the unit is mistaken.
SHORTEST = 1e-9
LONGEST = 1e9
# A delay of more timesteps has a mistaken unit.
MOST_STEPS = 100_000
# Numbers of parts that are times on the timestep's grid.
TIMES = ("delay", "jitter", "period")


ControlPeriod = Annotated[float, Range(0, LONGEST, unit="s", above=True)] | None


@checked_call
def stride_of(control_period: ControlPeriod, timestep: float) -> tuple[int, float]:
    """Number of timesteps [s] in a control period, and the period [s]; the timestep for None.

    Raises:
        ArgumentError: If it is no multiple of the timestep, or too long.
    """
    period = timestep if control_period is None else control_period
    stride = max(1, round(period / timestep))
    if not math.isclose(stride * timestep, period, rel_tol=1e-9):
        raise ArgumentError(
            f"control period {period:g} s is no multiple of the timestep {timestep:g} s: take "
            f"{stride * timestep:g} s, or another timestep"
        )
    return stride, period


def time_as_run(
    name: str, seconds: float, timestep: float, control_period: float = math.inf
) -> float:
    """Round a drawn or scaled time to a multiple of the timestep [s].

    Args:
        name: One of ``TIMES``; jitter stays shorter than a control period.
        seconds: Time [s].
        timestep: [s].
        control_period: [s].
    """
    nearest = round(seconds / timestep) * timestep
    if name == "jitter":
        return min(nearest, control_period - timestep)
    return nearest


def steps_to(times: Array, timestep: float) -> NDArray[np.int_]:
    """Number of timesteps from 0 to each time [s], the nearest whole one.

    A time is a rounded multiple of the timestep: its quotient may lie just below a whole number,
    so it must not be cut.
    """
    return np.rint(times / timestep).astype(int)


def steps_in(name: str, seconds: float, timestep: float) -> int:
    """Number of timesteps in a time.

    Raises:
        ArgumentError: If it is no whole number, or too large.
    """
    steps = round(seconds / timestep)
    if not math.isclose(steps * timestep, seconds, rel_tol=1e-9, abs_tol=1e-15):
        near = f"{steps * timestep:g} s" if steps else f"{timestep:g} s"
        raise ArgumentError(
            f"{name} = {seconds:g} s is no multiple of the timestep {timestep:g} s: take {near}, "
            "or a shorter timestep"
        )
    if steps > MOST_STEPS:
        raise ArgumentError(
            f"{name} = {seconds:g} s is {steps} timesteps of {timestep:g} s: at most {MOST_STEPS}"
        )
    return steps

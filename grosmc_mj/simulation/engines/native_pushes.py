"""Disturbances as numbers, which compiled code turns into wrenches as it goes.

In MuJoCo they lie in mjData.userdata, where the control callback finds them; a loop on equations is
given them. So the disturbances of thousands of runs need no table, and no run comes back to Python.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.jitable import jitable
from grosmc_mj.simulation.disturbances import (
    CONSTANT,
    PULSE,
    SINE,
    Disturbance,
    Profile,
    Pulse,
    SineFrom,
    course,
)
from grosmc_mj.simulation.engines.compilation import array_at

# A push is [body, kind, a, b, c, force, torque]: whose, and the formula with its numbers.
PUSH = 11
# Rows of xfrc_applied, and of the wrenches of equations.
_ROW = 6 * np.dtype(np.float64).itemsize


def most_pushes(lists: Sequence[Sequence[Disturbance]]) -> int:
    """Length of the longest list."""
    return max(map(len, lists))


def packed(lists: Sequence[Sequence[Disturbance]], bodies: Mapping[str, int]) -> Array:
    """The pushes of every list, (lists, most, PUSH), all of known profiles.

    Shorter lists are filled up with wrenches of zero on row 0: in MuJoCo the world, which does not
    move.

    Args:
        lists: Disturbances.
        bodies: By name, the row of each body among those that wrenches are written to.
    """
    pushes = np.zeros((len(lists), most_pushes(lists), PUSH))
    for row, disturbances in zip(pushes, lists, strict=True):
        for push, each in zip(row, disturbances, strict=False):
            push[:] = bodies[each.body], *_numbers(each.profile), *each.wrench
    return pushes


def _numbers(profile: Profile) -> tuple[float, float, float, float]:
    """Kind and numbers of a known profile, as ``course`` takes them."""
    if isinstance(profile, Pulse):
        return PULSE, profile.start, profile.stop, 0.0
    if isinstance(profile, SineFrom):
        return SINE, profile.frequency, profile.onset, profile.phase
    return CONSTANT, 0.0, 0.0, 0.0


@jitable
def write_wrenches(count: int, pushes_: int, wrenches_: int, t: float) -> None:
    """Write the wrenches of ``count`` pushes at t [s]; both arrays are given by address.

    The wrenches on a body are added up in the order of the list, from zero, as in
    ``wrench_table``: both give the same bits. Rows without pushes stay as they are.
    """
    pushes = array_at(pushes_, (count, PUSH), np.float64)
    for k in range(count):
        row = array_at(wrenches_ + _ROW * int(pushes[k, 0]), (6,), np.float64)
        for i in range(6):
            row[i] = 0.0
    for k in range(count):
        row = array_at(wrenches_ + _ROW * int(pushes[k, 0]), (6,), np.float64)
        value = course(pushes[k, 1], t, pushes[k, 2], pushes[k, 3], pushes[k, 4])
        for i in range(6):
            row[i] += value * pushes[k, 5 + i]

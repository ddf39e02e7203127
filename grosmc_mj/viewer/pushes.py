"""A push that keys give a plant while it runs."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.simulation.mujoco_plant import MujocoPlant

# How long one press of a key pushes, in the plant's time [s].
LENGTH = 0.2
# Bounds of its size [N or N m].
WEAKEST, STRONGEST = 1 / 64, 1024.0
# An instant counts as reached when it is this close [s]: sums of steps are not exact.
_INSTANT = 1e-9
# An acceleration per newton that counts as none.
_NOTHING = 1e-9


class Push:
    """A force along x at a body's centre of mass, or a torque where a force moves nothing.

    The body is the system's uncertain one, else its last. Keys to the right push along +x, or
    turn about -y, which looks the same from the front.

    Attributes:
        body: Name of the body.
        unit: N or N m.
        size: How much.
    """

    def __init__(self, plant: MujocoPlant, x0: Array) -> None:
        """Find out at the start whether a force moves the body."""
        system = plant.system
        self.body = system.uncertain_body or system.bodies[-1]
        self._place = system.bodies.index(self.body)
        self._bodies, self.size = len(system.bodies), 1.0
        self._forces = _moves(plant, x0, self.body)
        self.unit = "N" if self._forces else "N m"
        self._sign, self._until = 0, -math.inf

    def press(self, sign: int, now: float) -> None:
        """Push for a moment from ``now`` [s] on; pressing again goes on pushing."""
        self._sign, self._until = sign, now + LENGTH

    def change_size(self, factor: float) -> None:
        """Stronger or weaker, within the bounds."""
        self.size = min(STRONGEST, max(WEAKEST, factor * self.size))

    def wrench(self, now: float) -> Array:
        """[force, torque] of each of the system's bodies at ``now`` [s], (6 * bodies,)."""
        signed = self._sign * self.size if self._acts(now) else 0.0
        wrenches = np.zeros((self._bodies, 6))
        wrenches[self._place, 0 if self._forces else 4] = signed if self._forces else -signed
        return wrenches.ravel()

    def words(self, now: float) -> str:
        """What it is, and whether it acts at ``now`` [s]."""
        way = ("", " ->", " <-")[self._sign if self._acts(now) else 0]
        return f"{self.size:g} {self.unit} on {self.body}{way}"

    def _acts(self, now: float) -> bool:
        return now < self._until - _INSTANT


def _moves(plant: MujocoPlant, x0: Array, body: str) -> bool:
    """Whether a force along x at the body's centre accelerates anything."""
    model, n = plant.model, plant.system.degrees_of_freedom
    data, found = mujoco.MjData(model), []
    data.qpos[:], data.qvel[:] = x0[:n], x0[n:]
    for force in (0.0, 1.0):
        data.xfrc_applied[model.body(body).id, 0] = force
        mujoco.mj_forward(model, data)
        found.append(data.qacc.copy())
    return bool(np.abs(found[1] - found[0]).max() > _NOTHING)

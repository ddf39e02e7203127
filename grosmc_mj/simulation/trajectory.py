"""What a simulation leaves behind."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.plants import System


class Status(Enum):
    """How a run ended; ``UNDEFINED_INPUT`` where the law returned no finite number."""

    COMPLETED = 0
    UNDEFINED_LAW = 1
    SINGULAR_PLANT = 2
    DIVERGED = 3
    UNDEFINED_INPUT = 4


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One run, or a batch of them with one more axis in front of every array.

    With N timesteps, arrays over instants have N + 1 rows (t = 0 ... N h) and arrays over
    intervals have N: row i holds over [t_i, t_{i+1}). After the end of a run that stopped early
    the rows repeat its last valid ones; without recording N is 1. With m > 1 inputs those of
    command, input, sliding and weighed have one more axis at the end, (..., N, m).

    Attributes:
        system: The plant's system, which names the states and gives their units.
        time: Instants, exactly i h [s], (N + 1,).
        state: x, (..., N + 1, n).
        command: What the law asked for, in the unit of ``system.input``, (..., N).
        input: What the actuator applied, (..., N).
        sliding: s at the samples, held between them, (..., N); None if the law has no surface.
        weighed: The input v that the law's index weighs, (..., N).
        memory: The law's memory after its last sample by the fields of its dataclass, a
            structured array, (..., N); zeros where an unrecorded run ended early.
        wrench: [force, torque] of each of ``system.bodies``, (..., N, 6 * bodies); None if no
            disturbance was given.
        physics: mjSTATE_FULLPHYSICS at each instant, (..., N + 1, size), to replay the run
            exactly; None on an analytic plant.
        status: How each run ended, () or (nsim,).
        valid_until: Time up to which each run is valid [s], () or (nsim,).
    """

    system: System
    time: Array
    state: Array
    command: Array
    input: Array
    sliding: Array | None
    weighed: Array
    memory: NDArray[np.void]
    wrench: Array | None
    physics: Array | None
    status: NDArray[np.object_]
    valid_until: Array

    def __len__(self) -> int:
        """Number of runs in a batch.

        Raises:
            TypeError: For one run.
        """
        if self.state.ndim == 2:
            raise TypeError("one run has no length; a batch has")
        return len(self.state)

    def __getitem__(self, run: int) -> Trajectory:
        """One run of a batch, cut where it stopped being valid."""
        end = int(np.searchsorted(self.time, self.valid_until[run] * (1 + 1e-12), side="right"))
        return Trajectory(
            system=self.system,
            time=self.time[:end],
            state=self.state[run, :end],
            command=self.command[run, : end - 1],
            input=self.input[run, : end - 1],
            sliding=None if self.sliding is None else self.sliding[run, : end - 1],
            weighed=self.weighed[run, : end - 1],
            memory=self.memory[run, : end - 1],
            wrench=None if self.wrench is None else self.wrench[run, : end - 1],
            physics=None if self.physics is None else self.physics[run, :end],
            status=self.status[run],
            valid_until=self.valid_until[run],
        )


def why_ended(status: Status, system: System, controller: Controller, time: float, x: Array) -> str:
    """One line for a run that could not go on; empty for one that could.

    Args:
        status: How it ended.
        system: The plant's.
        controller: Whose law it was.
        time: Up to which the run is valid [s].
        x: State there, (n,).
    """
    where = f"{system.name} under {controller.name} at t = {time:g} s"
    if status is Status.COMPLETED:
        return ""
    if status is Status.DIVERGED:
        return f"{where}: the state grew without bound; try a smaller control period or timestep"
    if status is Status.SINGULAR_PLANT:
        return f"{where}: the plant is singular at {system.singularity}"
    at = ", ".join(f"{value:.4g}" for value in x)
    if status is Status.UNDEFINED_INPUT:
        return f"{where}: the law returned no finite number at x = ({at})"
    linearizing = controller.design is not None and controller.design.linearizing
    if not (linearizing and system.linearizable(x)):
        return f"{where}: the law is undefined outside {system.region}"
    return (
        f"{where}: the law is undefined at x = ({at}): the decoupling matrix E(x) of eq. (21) is "
        "singular there"
    )

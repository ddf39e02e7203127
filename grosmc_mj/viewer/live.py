"""The closed loop as it runs, as something that a window can show and keys can push."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.physics.hidden_states import starts
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.disturbances import Disturbance, packed, push
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.python_engine import ClosedLoop
from grosmc_mj.simulation.trajectory import Status, why_ended

# How long one press of a key pushes, in the plant's time [s].
LENGTH = 0.2
# Bounds of a push's size [N or N m].
WEAKEST, STRONGEST = 1 / 64, 1024.0
# An instant counts as reached when it is this close [s]: sums of steps are not exact.
_INSTANT = 1e-9
# An acceleration per newton that counts as none.
_NOTHING = 1e-9
# Times that have been added up are not exact: parts of a timestep.
_PART = 1e-6


@dataclass(frozen=True, eq=False)
class LiveRun:
    """All that a run needs.

    Attributes:
        plant: In MuJoCo.
        controller: The law with its numbers.
        x0: Start, (n,).
        duration: Of a recorded run [s]; a live one goes on.
        disturbances: Wrenches on the plant.
        control_period: Time between two samples of the law [s]; the timestep by default.
    """

    plant: Plant
    controller: Controller
    x0: ArrayLike
    duration: float
    disturbances: Sequence[Disturbance] = ()
    control_period: float | None = None


class Push:
    """A force along x at a body's centre of mass, or a torque where a force moves nothing.

    The body is the system's uncertain one, else its last. Keys to the right push along +x, or
    turn about -y, which looks the same from the front.

    Attributes:
        body: Name of the body.
        unit: N or N m.
        size: How much.
    """

    def __init__(self, plant: Plant, x0: Array) -> None:
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


class Live:
    """A closed loop that runs as its time goes on, without end, under the same law in Python.

    Its timesteps, samples and disturbances are those of ``simulate``.

    Attributes:
        model: The plant's.
        push: What the keys do to it.
        note: Why it cannot go on; empty while it can.
    """

    def __init__(self, run: LiveRun) -> None:
        """Begin at the start.

        Raises:
            ArgumentError: If something about the run does not fit.
        """
        # The checks of simulate, and the numbers that it would run with.
        self._problem, _ = prepare(
            run.plant,
            run.controller,
            run.x0,
            duration=run.duration,
            control_period=run.control_period,
            disturbances=run.disturbances,
        )
        self._run, self.model = run, run.plant.model
        self.push = Push(run.plant, self._problem.x0[0])
        self.restart()

    def restart(self) -> None:
        """Back to the start, with a new memory of the law."""
        self._loop = ClosedLoop(self._problem)
        self.note, self._owed = "", 0.0
        self.push.press(0, -np.inf)

    @property
    def time(self) -> float:
        """Of the last timestep [s]."""
        return self._loop.steps * self._problem.timestep

    @property
    def x(self) -> Array:
        """The plant's state, (n,)."""
        return self._loop.x

    @property
    def state(self) -> Array:
        """mjSTATE_FULLPHYSICS as it is now."""
        state = self._loop.physics()
        assert state is not None  # the plant of a live run is in MuJoCo
        return state

    @property
    def words(self) -> Mapping[str, str]:
        """Time, input, sliding variable and what the keys push with."""
        signals = zip(self._problem.system.inputs, self._loop.u, strict=True)
        said = {"time": f"{self.time:.2f} s"}
        for signal, value in signals:
            unit = "" if signal.unit == "1" else f" {signal.unit}"
            said[signal.name] = f"{value:.3g}{unit}"
        sliding = getattr(self._loop.memory, "s", None)
        if sliding is not None:
            said["|s|"] = f"{float(np.linalg.norm(sliding)):.2g}"
        return {**said, "push": self.push.words(self.time)}

    def advance(self, seconds: float) -> None:
        """As many timesteps as fit into what is owed; none after the run has ended."""
        problem, h = self._problem, self._problem.timestep
        self._owed += seconds
        count = 0 if self.note else int(self._owed / h + _PART)
        self._owed = 0.0 if self.note else self._owed - count * h
        if count == 0:
            return
        steps = range(self._loop.steps, self._loop.steps + count)
        bodies = problem.system.bodies
        pushes, values = packed(self._run.disturbances, bodies, steps, h)
        wrench = np.zeros(6 * len(bodies))
        for i, step in enumerate(steps):
            now = step * h
            push(pushes, values, i, now, wrench)
            status = self._loop.advance_under(wrench + self.push.wrench(now))
            if status is not Status.COMPLETED:
                ended = (status, problem.system, problem.controller, self.time, self._loop.x)
                self.note, self._owed = why_ended(*ended), 0.0
                return

    def sideways(self, sign: int) -> None:
        """Push."""
        self.push.press(sign, self.time)

    def stronger(self, factor: float) -> None:
        """Change what the keys push with."""
        self.push.change_size(factor)


def _moves(plant: Plant, x0: Array, body: str) -> bool:
    """Whether a force along x at the body's centre accelerates anything."""
    model = plant.model
    data, accelerations = mujoco.MjData(model), []
    data.qpos[:], data.qvel[:] = (rows[0] for rows in starts(model, plant.system, x0[None]))
    for force in (0.0, 1.0):
        data.xfrc_applied[model.body(body).id, 0] = force
        mujoco.mj_forward(model, data)
        accelerations.append(data.qacc.copy())
    return bool(np.abs(accelerations[1] - accelerations[0]).max() > _NOTHING)

"""The closed loop as it runs, as something that a window can show and keys can push."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.simulation.disturbances import wrench_table
from grosmc_mj.simulation.engines.closed_loop import ClosedLoop
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.trajectory import Status, why_ended
from grosmc_mj.viewer.playing import LiveRun
from grosmc_mj.viewer.pushes import Push

# Times that have been added up are not exact: parts of a timestep.
_PART = 1e-6


class Live:
    """A closed loop that runs as its time goes on, without end, under the same law in Python.

    Its timesteps, samples and disturbances are those of ``simulate``.

    Attributes:
        model: The plant's.
        push: What the keys do to it.
        note: Why it cannot go on; empty while it can.
    """

    def __init__(self, experiment: LiveRun) -> None:
        """Begin at the start.

        Raises:
            ArgumentError: If something about the experiment does not fit.
        """
        # The checks of simulate, and the numbers that it would run with.
        self._problem, _ = prepare(
            experiment.plant,
            experiment.controller,
            experiment.x0,
            duration=experiment.duration,
            control_period=experiment.control_period,
            disturbances=experiment.disturbances,
        )
        self._experiment, self.model = experiment, experiment.plant.model
        self.push = Push(experiment.plant, self._problem.x0[0])
        self.restart()

    def restart(self) -> None:
        """Back to the start, with a new memory of the law."""
        problem = self._problem
        self._loop = ClosedLoop(
            problem.plants[0],
            problem.controller,
            problem.x0[0],
            timestep=problem.timestep,
            stride=problem.stride,
            control_period=problem.control_period,
        )
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
        assert state is not None  # the plant of an experiment is in MuJoCo
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
        instants = (self._loop.steps + np.arange(count)) * h
        bodies = problem.system.bodies
        table = wrench_table(self._experiment.disturbances, bodies, instants)
        for i, now in enumerate(instants.tolist()):
            pushed = self.push.wrench(now)
            status = self._loop.advance(pushed if table is None else table[i] + pushed)
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

"""A plant under the inputs of a log: what it predicts, from many starts at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.experiments.logs.log import SHORTEST_PIECE, Log, held
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.wording import counted
from grosmc_mj.identify.model import LogModel
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller, Sampled
from grosmc_mj.theory.control.memory import Memory, memory_of
from grosmc_mj.theory.plants import System

# Fewest samples of a window, and of its lead.
_FEWEST = 10
# Share of the horizon that the lead of a window is, at least.
_LEAD = 0.1
# Predictions of this share of the horizon count as long.
_LASTS = 0.9


@dataclass(frozen=True, eq=False)
class LoggedInputs(Sampled):
    """Numbers of the law that gives the inputs of a log: (samples, m), one for each timestep."""

    samples: Any = None


def _replayed(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    """The input of this timestep."""
    k = min(int(t / p.period + 0.5), p.samples.shape[0] - 1)
    for j in range(len(u)):
        u[j] = p.samples[k, j]


class ReplayWindow(NamedTuple):
    """A part of a log that is predicted from one start.

    Attributes:
        samples: Of the log, (K,).
        start: Instant of the first one [s].
        begin: Instant from which it is predicted [s]; before it lies its lead, to which the start
            is fitted.
    """

    samples: slice
    start: float
    begin: float

    @property
    def length(self) -> int:
        """Number of its samples."""
        return self.samples.stop - self.samples.start


@dataclass(frozen=True, eq=False)
class Predictor:
    """Predicts the states of a plant along the windows of a log.

    Attributes:
        log: The log.
        windows: Its parts.
        timestep: Of the prediction [s].
    """

    log: Log
    windows: Sequence[ReplayWindow]
    timestep: float

    @classmethod
    def of(cls, log: Log, horizon: float, timestep: float, lead: float = 0.0) -> Predictor:
        """Predictor with windows one after the other, over all pieces of a log.

        Args:
            log: The log.
            horizon: Length of a window [s], without its lead.
            timestep: Of the prediction [s].
            lead: Time before it that its start is fitted to [s], within the window before.

        Raises:
            ArgumentError: If a window or a piece of the log would have too few samples.
        """
        shortest = _FEWEST * log.sampling
        if horizon < shortest:
            raise ArgumentError(
                f"--horizon {horizon:g} s is {horizon / log.sampling:.3g} samples of {log.name}: "
                f"it must be {_FEWEST} at least, {shortest:g} s"
            )
        windows = []
        for piece in log.pieces:
            windows += _windows(log, piece, horizon, lead)
        if not windows:
            raise ArgumentError(
                f"{log.name}: too few samples are left to predict: take a longer log, or hold out "
                "another share of it"
            )
        return cls(log, windows, timestep)

    @classmethod
    def leading(cls, log: Log, horizon: float, timestep: float) -> Predictor:
        """Predictor whose starts are fitted to a tenth of the horizon, or some samples, before it.

        Args and raises as for ``of``.
        """
        return cls.of(log, horizon, timestep, _lead(log, horizon))

    @classmethod
    def moments(cls, log: Log, horizon: float, timestep: float) -> Predictor:
        """Predictor with windows as short as the lead of those with a horizon [s]."""
        return cls.of(log, _lead(log, horizon), timestep)

    @property
    def leads(self) -> Predictor:
        """Predictor along the leads of its windows."""
        windows = []
        for window in self.windows:
            first = window.samples.start
            stop = first + int(np.sum(self.log.time[window.samples] <= window.begin))
            windows.append(ReplayWindow(slice(first, stop), window.start, window.begin))
        return replace(self, windows=windows)

    def short_words(self, horizon: float) -> str:
        """Words on predictions that last far shorter than the horizon [s]; empty if they do not."""
        time = self.log.time
        lasts = [float(time[window.samples.stop - 1]) - window.begin for window in self.windows]
        if max(lasts) >= _LASTS * horizon and np.median(lasts) >= horizon / 2:
            return ""

        gaps = len(self.log.pieces) - 1
        cause = (
            f"the log has {counted(gaps, 'gap or masked part', 'gaps or masked parts')}"
            if gaps
            else "the log is short"
        )
        return (
            f"{cause}: predictions last {np.median(lasts):.2g} s in the median and "
            f"{max(lasts):.2g} s at most, not --horizon {horizon:g} s"
        )

    @property
    def steps(self) -> int:
        """Timesteps of the longest window."""
        time = self.log.time
        longest = max(time[window.samples.stop - 1] - window.start for window in self.windows)
        return int(np.ceil(longest / self.timestep)) + 1

    def _laws(self, system: System, delay: float) -> list[Controller]:
        """The laws that give the inputs of each window, late by a delay [s]."""
        grid = np.arange(self.steps + 1) * self.timestep
        laws = []
        for window in self.windows:
            inputs = held(self.log.time, self.log.inputs, delay, window.start + grid)
            laws.append(_law(system, inputs, self.timestep))
        return laws

    def states(self, models: Sequence[LogModel], starts: Sequence[Array]) -> list[list[Array]]:
        """The states of several machines of one system along every window.

        Args:
            models: One for each trial.
            starts: Of each trial, (windows, n).

        Returns:
            For each trial and window (steps + 1, n); NaN after a run that diverged.
        """
        count = len(self.windows)
        plants = []
        laws: list[Controller] = []
        disturbances = []
        # Most trials have the same delay, and share their laws.
        laws_by_delay: dict[float, list[Controller]] = {}
        for model in models:
            if model.delay not in laws_by_delay:
                laws_by_delay[model.delay] = self._laws(model.plant.system, model.delay)
            plants += [model.plant] * count
            laws += laws_by_delay[model.delay]
            disturbances += [model.disturbances_from(window.start) for window in self.windows]

        run = simulate(
            plants,
            laws,
            np.concatenate(list(starts)),
            duration=self.steps * self.timestep,
            timestep=None if plants[0].step_length else self.timestep,
            disturbances=disturbances,
        )
        states = np.array(run.state)
        for row, until in zip(states, np.atleast_1d(run.valid_until), strict=True):
            row[round(float(until) / self.timestep) + 1 :] = np.nan
        return [list(states[k * count : (k + 1) * count]) for k in range(len(models))]

    def first_run(self, model: LogModel, starts: Array) -> Trajectory:
        """The recorded run of a machine along the first window from its start, (windows, n)."""
        return simulate(
            model.plant,
            self._laws(model.plant.system, model.delay)[0],
            starts[0],
            duration=(self.steps - 1) * self.timestep,
            disturbances=model.disturbances_from(self.windows[0].start),
        )

    def errors(self, states: Sequence[Array], model: LogModel) -> dict[str, list[Array]]:
        """Measured less predicted values of each measured state in each window.

        Args:
            states: Of each window, (steps + 1, n).
            model: The machine, with the sensors of the states.
        """
        errors = {}
        for j, state in enumerate(model.plant.system.states):
            if state.name not in self.log.states:
                continue
            measured = self.log.states[state.name]
            sensor = model.sensor(state.name)

            by_window = []
            for window, x in zip(self.windows, states, strict=True):
                predicted = self._at_samples(window, x[:, j], sensor.delay)
                shown = sensor.scale * predicted
                by_window.append(measured[window.samples] - shown - sensor.bias)
            errors[state.name] = by_window
        return errors

    def errors_from(self, model: LogModel, starts: Array) -> dict[str, list[Array]]:
        """The ``errors`` of a machine from the starts of the windows, (windows, n)."""
        (states,) = self.states([model], [starts])
        return self.errors(states, model)

    def _at_samples(self, window: ReplayWindow, values: Array, delay: float) -> Array:
        """Values on the timesteps of a window at the instants of its samples, later by a delay."""
        times = self.log.time[window.samples] - window.start - delay
        return np.interp(times, np.arange(len(values)) * self.timestep, values)


def _lead(log: Log, horizon: float) -> float:
    """Time that the start of a prediction is fitted to [s]."""
    return max(_LEAD * horizon, _FEWEST * log.sampling)


def _law(system: System, inputs: Array, timestep: float) -> Controller:
    """The law that gives these inputs, (steps, m)."""
    # The law is compiled for a number of rows: a power of two is few of them.
    rows = 1 << (len(inputs) - 1).bit_length()
    padded = np.pad(inputs, ((0, rows - len(inputs)), (0, 0)), mode="edge")
    numbers = LoggedInputs(period=timestep, samples=np.ascontiguousarray(padded))
    return Controller("log", _replayed, numbers, memory_of(Memory, m=len(system.inputs)))


def _windows(log: Log, piece: slice, horizon: float, lead: float) -> list[ReplayWindow]:
    """Windows of a lead and a horizon [s] over a piece, whose end may be too short.

    Each begins to predict where the one before ended.
    """
    windows = []
    first = piece.start
    last = first
    while piece.stop - first >= SHORTEST_PIECE and last < piece.stop:
        start = float(log.time[first])
        begin = start + lead
        last = int(np.searchsorted(log.time, begin + horizon, side="right"))
        last = min(max(last, first + SHORTEST_PIECE), piece.stop)
        end = log.time[last - 1]
        if not lead or end > begin:
            windows.append(ReplayWindow(slice(first, last), start, begin))
        first = max(int(np.searchsorted(log.time, end - lead, side="right")), first + 1)
    return windows

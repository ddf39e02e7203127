"""A plant under the inputs of a log: what it predicts, from many starts at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, Sampled
from grosmc_mj.control.memory import memory_of
from grosmc_mj.errors import ArgumentError
from grosmc_mj.identify.log import Log, held
from grosmc_mj.loop import Sensor
from grosmc_mj.plants import Plant, System
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory

# Slips of a column: what it has to be multiplied by, and what it then seems to be.
_SLIPS = (
    (-1.0, "have the other sign"),
    (math.pi / 180, "be in degrees"),
    (1e-3, "be in thousandths of its unit"),
    (1e3, "be in thousands of its unit"),
)
# Inputs that leave this share of the error explain little; without a slip they leave so much less.
_POOR, _BETTER = 0.9, 1.2
# Samples of a window; samples before and after its start from which that is estimated.
_FEWEST, _AROUND = 10, 15


@dataclass(frozen=True, eq=False)
class Replay(Sampled):
    """Numbers of the law that gives the inputs of a log: (samples, m), one for each timestep."""

    samples: Any = None


def _replayed(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    """The input of this timestep."""
    k = min(int(t / p.period + 0.5), p.samples.shape[0] - 1)
    for j in range(len(u)):
        u[j] = p.samples[k, j]


def ideal(state: str, quantity: str) -> float:
    """A number of an ideal sensor of a state."""
    return float(getattr(Sensor(state), quantity))


class Window(NamedTuple):
    """A part of a log that is predicted from one start.

    Attributes:
        samples: Of the log, (K,).
        start: Instant of the first one [s].
    """

    samples: slice
    start: float


@dataclass(frozen=True, eq=False)
class Predictor:
    """Predicts the states of a plant along the windows of a log.

    Attributes:
        log: The log.
        windows: Its parts.
        timestep: Of the prediction [s].
    """

    log: Log
    windows: Sequence[Window]
    timestep: float

    @classmethod
    def of(cls, log: Log, horizon: float, timestep: float) -> Predictor:
        """Windows of a horizon [s] one after the other, over all pieces of a log.

        Raises:
            ArgumentError: If a window or a piece of the log would have too few samples.
        """
        shortest = _FEWEST * log.period
        if horizon < shortest:
            raise ArgumentError(
                f"--horizon {horizon:g} s is {horizon / log.period:.3g} samples of {log.name}: it "
                f"must be {_FEWEST} at least, {shortest:g} s"
            )
        if not log.pieces:
            raise ArgumentError(
                f"{log.name}: too few samples are left to predict: take a longer log, or hold out "
                "another share of it"
            )
        windows = []
        for piece in log.pieces:
            first = piece.start
            while piece.stop - first > 2:
                start = log.time[first]
                last = int(np.searchsorted(log.time, start + horizon, side="right"))
                last = min(max(last, first + 3), piece.stop)
                windows.append(Window(slice(first, last), float(start)))
                first = last
        return cls(log, windows, timestep)

    @cached_property
    def steps(self) -> int:
        """Timesteps of the longest window."""
        longest = max(self.log.time[w.samples.stop - 1] - w.start for w in self.windows)
        return int(np.ceil(longest / self.timestep)) + 1

    def _inputs(self, delay: float) -> list[Array]:
        """The inputs of each window, (steps, m)."""
        grid = np.arange(self.steps + 1) * self.timestep
        return [
            held(self.log.time, self.log.inputs, delay, window.start + grid)
            for window in self.windows
        ]

    def states(
        self, plants: Sequence[Plant], starts: Sequence[Array], delays: Sequence[float]
    ) -> list[list[Array]]:
        """The states of several plants along every window.

        Args:
            plants: One for each trial.
            starts: Of each trial, (windows, n).
            delays: Of the inputs in each trial [s].

        Returns:
            For each trial and window (steps + 1, n); NaN after a run that diverged.
        """
        system, count = plants[0].system, len(self.windows)
        tables = {delay: self._inputs(delay) for delay in dict.fromkeys(delays)}
        laws = {
            (delay, i): _law(system, samples, self.timestep)
            for delay, table in tables.items()
            for i, samples in enumerate(table)
        }
        run = simulate(
            [plant for plant in plants for _ in range(count)],
            [laws[delay, i] for delay in delays for i in range(count)],
            np.concatenate(list(starts)),
            duration=self.steps * self.timestep,
            timestep=None if plants[0].step_length else self.timestep,
        )
        states = np.array(run.state)
        for row, until in zip(states, np.atleast_1d(run.valid_until), strict=True):
            row[round(float(until) / self.timestep) + 1 :] = np.nan
        return [list(states[k * count : (k + 1) * count]) for k in range(len(plants))]

    def first_run(self, plant: Plant, delay: float) -> Trajectory:
        """The recorded run of a plant along the first window, its inputs late by a delay [s]."""
        law = _law(plant.system, self._inputs(delay)[0], self.timestep)
        start = starts_of(self.log, self.windows[:1], plant.system)[0]
        return simulate(plant, law, start, duration=(self.steps - 1) * self.timestep)

    def errors(
        self,
        states: Sequence[Array],
        system: System,
        sensor: Callable[[str, str], float] = ideal,
    ) -> dict[str, list[Array]]:
        """Measured less predicted values of each measured state in each window.

        Args:
            states: Of each window, (steps + 1, n).
            system: Names of the states.
            sensor: From a state and ``scale``, ``delay`` or ``bias`` to that of its sensor.
        """
        errors: dict[str, list[Array]] = {}
        for j, state in enumerate(system.states):
            if (measured := self.log.outputs.get(state.name)) is None:
                continue
            scale, delay, bias = (sensor(state.name, name) for name in ("scale", "delay", "bias"))
            errors[state.name] = [
                measured[window.samples] - scale * self._at_samples(window, x[:, j], delay) - bias
                for window, x in zip(self.windows, states, strict=True)
            ]
        return errors

    def _at_samples(self, window: Window, values: Array, delay: float) -> Array:
        """Values on the timesteps of a window at the instants of its samples, later by a delay."""
        times = self.log.time[window.samples] - window.start - delay
        return np.interp(times, np.arange(len(values)) * self.timestep, values)


def _law(system: System, samples: Array, timestep: float) -> Controller:
    # The law is compiled for a number of rows: a power of two is few of them.
    rows = 1 << (len(samples) - 1).bit_length()
    padded = np.pad(samples, ((0, rows - len(samples)), (0, 0)), mode="edge")
    numbers = Replay(period=timestep, samples=np.ascontiguousarray(padded))
    return Controller("log", _replayed, numbers, memory_of(len(system.inputs)))


def starts_of(log: Log, windows: Sequence[Window], system: System) -> Array:
    """States at the start of each window, (windows, n), from a parabola through samples around it.

    A rate that is not measured is the slope of its position; any other state is 0.
    """
    n, names = len(system.states), [state.name for state in system.states]
    starts, half = np.zeros((len(windows), n)), system.degrees_of_freedom
    for row, window in zip(starts, windows, strict=True):
        first = window.samples.start
        piece = next(p for p in log.pieces if p.start <= first < p.stop)
        few = slice(max(first - _AROUND, piece.start), min(first + _AROUND, piece.stop))
        t = log.time[few] - window.start
        for j, name in enumerate(names):
            position = names[j - half] if half and j >= half else ""
            if name in log.outputs:
                row[j] = np.polyval(np.polyfit(t, log.outputs[name][few], min(2, len(t) - 1)), 0.0)
            elif position in log.outputs:
                row[j] = np.polyfit(t, log.outputs[position][few], min(2, len(t) - 1))[-2]
    return starts


def require_matching(log: Log, plant: Plant, horizon: float, timestep: float) -> None:
    """Refuse a log that another sign or unit of one of its columns would explain far better.

    Raises:
        ArgumentError: With the column and the factor.
    """
    windows = Predictor.of(log, horizon, timestep).windows

    def unexplained(trial: Log) -> float:
        """The share of the error that the inputs leave, of the state of which they leave most."""
        starts = starts_of(trial, windows, plant.system)
        norms = []
        for candidate in (trial, replace(trial, inputs=0.0 * trial.inputs)):
            predictor = Predictor(candidate, windows, timestep)
            (states,) = predictor.states([plant], [starts], [0.0])
            errors = predictor.errors(states, plant.system).values()
            norms.append(np.array([np.linalg.norm(np.concatenate(parts)) for parts in errors]))
        driven, still = norms
        return float(np.nan_to_num(np.max(driven / np.maximum(still, 1e-12)), nan=np.inf))

    poor = unexplained(log)
    if poor <= _POOR:
        return
    inputs = [signal.name for signal in plant.system.inputs]
    for name in (*log.outputs, *inputs):
        for factor, words in _SLIPS:
            if name in log.outputs:
                other = replace(log, outputs={**log.outputs, name: factor * log.outputs[name]})
            else:
                scale = np.where(np.array(inputs) == name, factor, 1.0)
                other = replace(log, inputs=log.inputs * scale)
            if unexplained(other) < poor / _BETTER:
                raise ArgumentError(
                    f"{log.name}: {name} seems to {words}: the case's plant explains it far "
                    "better then; say so in the unit of its header, or in the case file's [log]"
                )

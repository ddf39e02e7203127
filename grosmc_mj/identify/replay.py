"""A plant under the inputs of a log: what it predicts, from many starts at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, Sampled
from grosmc_mj.control.memory import Memory, memory_of
from grosmc_mj.errors import ArgumentError
from grosmc_mj.identify.log import SHORTEST_PIECE, Log, held
from grosmc_mj.loop import Sensor
from grosmc_mj.plants import Plant, System
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory

# Slips of a column: the factor that would mend it, and the words for it.
_SLIPS = (
    (-1.0, "have the other sign"),
    (math.pi / 180, "be in degrees"),
    (1e-3, "be in thousandths of its unit"),
    (1e3, "be in thousands of its unit"),
)
# Inputs that leave this share of the error explain little.
_POOR = 0.9
# Without a slip they leave an error that is so many times less.
_BETTER = 1.2
# Fewest samples of a window.
_FEWEST = 10
# Samples before and after the start of a window from which that is estimated.
_AROUND = 15


@dataclass(frozen=True, eq=False)
class LoggedInputs(Sampled):
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
    windows: Sequence[Window]
    timestep: float

    @classmethod
    def of(cls, log: Log, horizon: float, timestep: float) -> Predictor:
        """Predictor with windows one after the other, over all pieces of a log.

        Args:
            log: The log.
            horizon: Length of a window [s].
            timestep: Of the prediction [s].

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
            windows += _windows(log, piece, horizon)
        return cls(log, windows, timestep)

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

    def states(
        self,
        plants: Sequence[Plant],
        starts: Sequence[Array],
        delays: Sequence[float],
    ) -> list[list[Array]]:
        """The states of several plants along every window.

        Args:
            plants: One for each trial.
            starts: Of each trial, (windows, n).
            delays: Of the inputs in each trial [s].

        Returns:
            For each trial and window (steps + 1, n); NaN after a run that diverged.
        """
        system = plants[0].system
        count = len(self.windows)
        # Most trials have the same delay, and share their laws.
        laws_by_delay = {delay: self._laws(system, delay) for delay in set(delays)}

        plants_of_runs: list[Plant] = []
        laws_of_runs: list[Controller] = []
        for plant, delay in zip(plants, delays, strict=True):
            plants_of_runs += [plant] * count
            laws_of_runs += laws_by_delay[delay]
        run = simulate(
            plants_of_runs,
            laws_of_runs,
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
        law = self._laws(plant.system, delay)[0]
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
        errors = {}
        for j, state in enumerate(system.states):
            if state.name not in self.log.outputs:
                continue
            measured = self.log.outputs[state.name]
            scale = sensor(state.name, "scale")
            delay = sensor(state.name, "delay")
            bias = sensor(state.name, "bias")

            by_window = []
            for window, x in zip(self.windows, states, strict=True):
                predicted = self._at_samples(window, x[:, j], delay)
                by_window.append(measured[window.samples] - scale * predicted - bias)
            errors[state.name] = by_window
        return errors

    def _at_samples(self, window: Window, values: Array, delay: float) -> Array:
        """Values on the timesteps of a window at the instants of its samples, later by a delay."""
        times = self.log.time[window.samples] - window.start - delay
        return np.interp(times, np.arange(len(values)) * self.timestep, values)


def _law(system: System, inputs: Array, timestep: float) -> Controller:
    """The law that gives these inputs, (steps, m)."""
    # The law is compiled for a number of rows: a power of two is few of them.
    rows = 1 << (len(inputs) - 1).bit_length()
    padded = np.pad(inputs, ((0, rows - len(inputs)), (0, 0)), mode="edge")
    numbers = LoggedInputs(period=timestep, samples=np.ascontiguousarray(padded))
    return Controller("log", _replayed, numbers, memory_of(Memory, v=np.zeros(len(system.inputs))))


def _windows(log: Log, piece: slice, horizon: float) -> list[Window]:
    """Windows of a horizon [s] one after the other over a piece, whose end may be too short."""
    windows = []
    first = piece.start
    while piece.stop - first >= SHORTEST_PIECE:
        start = log.time[first]
        last = int(np.searchsorted(log.time, start + horizon, side="right"))
        last = min(max(last, first + SHORTEST_PIECE), piece.stop)
        windows.append(Window(slice(first, last), float(start)))
        first = last
    return windows


def starts_of(log: Log, windows: Sequence[Window], system: System) -> Array:
    """States at the start of each window, (windows, n), from a parabola through samples around it.

    A rate that is not measured is the slope of its position; any other state is 0.

    Args:
        log: The log.
        windows: Its parts.
        system: Names of the states: all positions, then their rates.
    """
    names = [state.name for state in system.states]
    positions = system.degrees_of_freedom
    starts = np.zeros((len(windows), len(names)))
    for row, window in zip(starts, windows, strict=True):
        samples = _samples_around(log, window.samples.start)
        t = log.time[samples] - window.start
        degree = min(2, len(t) - 1)
        for j, name in enumerate(names):
            if name in log.outputs:
                parabola = np.polyfit(t, log.outputs[name][samples], degree)
                row[j] = np.polyval(parabola, 0.0)
            elif positions and j >= positions and names[j - positions] in log.outputs:
                parabola = np.polyfit(t, log.outputs[names[j - positions]][samples], degree)
                row[j] = parabola[-2]
    return starts


def _samples_around(log: Log, sample: int) -> slice:
    """The samples near one, within its piece."""
    piece = next(piece for piece in log.pieces if piece.start <= sample < piece.stop)
    return slice(max(sample - _AROUND, piece.start), min(sample + _AROUND, piece.stop))


def likely_slip(predictor: Predictor, plant: Plant, unexplained: float) -> str:
    """Return the sign or unit of a column that would explain a log far better than its fit does.

    Args:
        predictor: The log in windows.
        plant: The case's plant.
        unexplained: Share of the motion that the fitted plant leaves, see ``unexplained_share``.

    Returns:
        A line on the first such column; empty where the fit explains the log.
    """
    if unexplained <= _POOR:
        return ""

    inputs = [signal.name for signal in plant.system.inputs]
    for name in (*predictor.log.outputs, *inputs):
        for factor, words in _SLIPS:
            mended = replace(predictor, log=_scaled(predictor.log, name, factor, inputs))
            if unexplained_share(mended, plant) < unexplained / _BETTER:
                return (
                    f"{name} seems to {words}: the fit leaves {unexplained:.0%} of the motion "
                    "unexplained, and the case's plant far less then; if so, say it in the unit "
                    "of its header, or in the case file's [log]"
                )
    return ""


def _scaled(
    log: Log,
    name: str,
    factor: float,
    inputs: Sequence[str],
) -> Log:
    """A log with one of its measured states or inputs times a factor."""
    if name in log.outputs:
        return replace(log, outputs={**log.outputs, name: factor * log.outputs[name]})
    scale = np.where(np.array(inputs) == name, factor, 1.0)
    return replace(log, inputs=log.inputs * scale)


def unexplained_share(
    predictor: Predictor,
    plant: Plant,
    delay: float = 0.0,
    sensor: Callable[[str, str], float] = ideal,
) -> float:
    """Return the share of a log's motion that its inputs leave, of the state with the largest one.

    Args:
        predictor: The log in windows.
        plant: The plant.
        delay: Of the inputs [s].
        sensor: From a state and ``scale``, ``delay`` or ``bias`` to that of its sensor.
    """
    log = predictor.log
    without_inputs = replace(predictor, log=replace(log, inputs=0.0 * log.inputs))
    driven = _error_norms(predictor, plant, delay, sensor)
    still = _error_norms(without_inputs, plant, delay, sensor)
    shares = driven / np.maximum(still, 1e-12)
    return float(np.nan_to_num(np.max(shares), nan=np.inf))


def _error_norms(
    predictor: Predictor, plant: Plant, delay: float, sensor: Callable[[str, str], float]
) -> Array:
    """Norm of the prediction error of each measured state."""
    starts = starts_of(predictor.log, predictor.windows, plant.system)
    (states,) = predictor.states([plant], [starts], [delay])
    errors = predictor.errors(states, plant.system, sensor)
    return np.array([np.linalg.norm(np.concatenate(parts)) for parts in errors.values()])

"""The signals of a run, and the measurements that requirements take of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy

from grosmc_mj.experiments.requirements.accumulator import (
    ERROR,
    Accumulated,
    Constants,
    noting_timesteps,
)
from grosmc_mj.experiments.requirements.metrics import DWELL, SETTLING_BAND, MeasuredSignal
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.simulation.problem import Accumulator
from grosmc_mj.theory.control.controller import Controller


class Windows(NamedTuple):
    """Signals, error windows and settling bands that are measured besides the usual metrics.

    Attributes:
        after: Instants from which on the largest and the RMS value of each signal are measured [s].
        bands: Widths of further bands to settle in, in the unit of the output.
        signals: States and outputs, of which each is measured by itself.
    """

    after: tuple[float, ...] = ()
    bands: tuple[float, ...] = ()
    signals: tuple[MeasuredSignal, ...] = ()


NO_WINDOWS = Windows()


def bands(band: float | None) -> Windows:
    """Return the windows with a further band to settle in; none for the usual band."""
    return NO_WINDOWS if band is None else Windows(bands=(band,))


@dataclass(frozen=True, eq=False)
class Measurement:
    """The signals of a run, and the times and limits that its measurements need.

    Attributes:
        controller: Law with error coordinates and an optimum. In a loop the true state is measured
            and the input that the actuators give.
        timestep: Time between two instants [s].
        duration: Duration of the run [s].
        onset: End of the transient, in which a run settles [s], see ``end_of_transient``.
        windows: Further windows, bands and signals.
        input_limits: ``Plant.input_limits``, (2, m), to which the plant clips the input; None for
            none.
    """

    controller: Controller
    timestep: float
    duration: float
    onset: float = math.inf
    windows: Windows = NO_WINDOWS
    input_limits: Array | None = None

    @property
    def transient(self) -> float:
        """Length of the transient [s]."""
        return min(self.onset, self.duration)

    @property
    def after(self) -> tuple[float, ...]:
        """All instants from which on signals are measured [s]; the first is the start."""
        return tuple(dict.fromkeys((0.0, *self.windows.after)))

    @property
    def signals(self) -> tuple[MeasuredSignal, ...]:
        """The measured signals; the error is the first."""
        system = self.controller.designed.error.system
        internal = [MeasuredSignal(position.name) for position in system.internal_positions]
        return tuple(dict.fromkeys((MeasuredSignal(), *internal, *self.windows.signals)))

    # The engines tell runs that share an accumulator by its identity.
    @cached_property
    def accumulator(self) -> Accumulator:
        """Accumulator of a simulation.

        Raises:
            ArgumentError: If the controller follows no optimum, or a signal is unknown.
        """
        design = self.controller.designed
        note = noting_timesteps(design.error.state, surface=bool(design.sliding_unit))
        return Accumulator(note, Accumulated.nothing(self.constants), self.constants)

    # Each row of a record, and each run of a batch, needs them.
    @cached_property
    def constants(self) -> Constants:
        """Constants of the accumulation; raises as ``accumulator`` does."""
        design = self.controller.designed
        error = design.error
        optimum = design.lqr
        limits = self.input_limits
        if limits is None:
            limits = np.array([[-np.inf], [np.inf]]).repeat(error.inputs, 1)
        return Constants(
            after=_filled_up(self.after, 4),
            signals=np.array([_number_of(signal.name, error) for signal in self.signals]),
            turns=_turns(self.signals),
            outputs=np.array(error.output_rows, float),
            onset=self.onset,
            late=(1 - DWELL) * self.transient,
            share=SETTLING_BAND,
            widths=_filled_up((0.0, *self.windows.bands), 2),
            transition=_transition(optimum.closed_loop.tobytes(), error.size, self.timestep),
            Q=optimum.Q,
            R=optimum.R,
            K=optimum.K,
            limits=limits,
        )


def _filled_up(numbers: Sequence[float], multiple: int) -> Array:
    """Return numbers, and infinities up to a multiple: instants and bands that nothing reaches.

    The accumulation is compiled anew for each length of its arrays, which takes seconds.
    """
    count = -(-len(numbers) // multiple) * multiple
    filled = np.full(count, np.inf)
    filled[: len(numbers)] = numbers
    return filled


def _number_of(name: str, error: Any) -> float:
    """Return the number of a signal: of an output if one has this name, else of the state."""
    if not name:
        return ERROR
    states = [state.name for state in error.system.states]
    for row in error.output_rows:
        if error.names[row] == name:
            return float(len(states) + row)
    require_known("state", name, signal_units(error))
    return float(states.index(name))


def _turns(signals: Sequence[MeasuredSignal]) -> Array:
    """Return a turn of each signal that counts modulo one, else 0, (c,)."""
    return np.array([2 * math.pi if signal.periodic else 0.0 for signal in signals])


def signal_units(error: Any) -> dict[str, str]:
    """Return the units of all signals that can be measured by themselves, by name.

    Args:
        error: Error coordinates of a law. An output that is a state stands for its error.
    """
    units = {state.name: state.unit for state in error.system.states}
    for row in error.output_rows:
        units[error.names[row]] = error.units[row]
    return units


# The runs of a campaign ask for the same one whenever their disturbances begin at other instants.
@cache
def _transition(closed_loop: bytes, size: int, timestep: float) -> Array:
    """Return exp((A - B K) h), (size, size)."""
    matrix = np.frombuffer(closed_loop).reshape(size, size)
    return scipy.linalg.expm(matrix * timestep)

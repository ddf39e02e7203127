"""Metrics measured while a run goes on: a law that also keeps the meters of its run.

Nothing is recorded: the meters lie in the law's own memory, in Python and in compiled code alike,
and say at the end what ``validation.metrics`` would measure on the recorded samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, make_dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
import scipy.linalg

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.laws import Law
from grosmc_mj.control.memory import Memory
from grosmc_mj.control.vectors import each, row_times
from grosmc_mj.experiments.metrics import SETTLING_BAND
from grosmc_mj.jitable import jitable

# Against this, a distance is a size.
_NOWHERE = np.zeros(0)


@dataclass
class Meters:
    """What has been measured up to the last sample.

    Attributes:
        optimal: The optimal error state at this sample, (size,).
        start: Error of the outputs at t = 0.
        deviation: Largest distance of the outputs from the optimum.
        outside: Last time at which the error was outside the 2 % band, in the transient [s]; -1 for
            never.
        error: Largest error from each of the wanted times on, (k,).
        sliding: Largest entry of |s|.
        sliding_start: The same at t = 0.
        input: Largest entry of |u|, as commanded.
        position: Of the cart at t = 0 [m].
        travel: How far it went [m].
    """

    optimal: Array
    error: Array
    start: float = 0.0
    deviation: float = 0.0
    outside: float = -1.0
    sliding: float = 0.0
    sliding_start: float = 0.0
    input: float = 0.0
    position: float = 0.0
    travel: float = 0.0


@dataclass(frozen=True)
class MeterNumbers:
    """What meters need to know.

    Attributes:
        transition: The optimal error state from one sample to the next, (size, size).
        after: From when on errors are measured [s], (k,).
        onset: End of the transient [s].
        band: Part of the error at the start that counts as none.
    """

    transition: Array
    after: Array
    onset: float
    band: float = SETTLING_BAND


def metered(
    controller: Controller, control_period: float, after: Sequence[float], onset: float
) -> Controller:
    """The same controller with meters: its memory has ``meters`` besides.

    Args:
        controller: A law with error coordinates and an optimum.
        control_period: Of the run [s].
        after: From when on largest errors are wanted [s].
        onset: When the first disturbance begins; settling is measured up to it, unless it acts
            from the start [s].

    Raises:
        ArgumentError: If the controller follows no optimum.
    """
    design = controller.designed
    error = design.error
    numbers = MeterNumbers(
        transition=_transition(design.lqr.closed_loop.tobytes(), error.size, control_period),
        after=np.array(after or [0.0], float),
        onset=onset if onset > 0 else math.inf,
    )
    law = _metered_law(
        controller.law,
        error.state,
        error.size,
        tuple(error.output_rows),
        _magnitude if error.inputs == 1 else _largest_entry,
        bool(design.sliding_unit),
        error.system.name == "cart_pendulum",
    )
    return replace(
        controller,
        law=law,
        parameters=_with(controller.parameters, meters=numbers),
        memory=partial(_memory, controller, len(numbers.after)),
    )


@cache
def _transition(closed_loop: bytes, size: int, control_period: float) -> Array:
    """exp((A - B K) T)."""
    return scipy.linalg.expm(np.frombuffer(closed_loop).reshape(size, size) * control_period)


def _memory(controller: Controller, errors: int) -> Memory:
    """The law's own memory with meters."""
    meters = Meters(np.zeros(controller.designed.error.size), np.zeros(errors))
    return _with(controller.memory(), meters=meters)


def _with(value: Any, **extra: Any) -> Any:
    """A dataclass with further fields at its end: whoever knows the others finds them there."""
    made = _extended(type(value), tuple(extra))
    found = made.__new__(made)
    # Past __init__ and __post_init__: the value has been made and checked already.
    for name, item in {**vars(value), **extra}.items():
        object.__setattr__(found, name, item)
    return found


@cache
def _extended(kind: Any, names: tuple[str, ...]) -> Any:
    """A dataclass with further fields."""
    return make_dataclass(
        f"Metered{kind.__name__}",
        [(name, Any, field(default=None)) for name in names],
        bases=(kind,),
        frozen=kind.__dataclass_params__.frozen,
    )


@cache
def _metered_law(
    law: Law,
    error_state: Any,
    size: int,
    outputs: tuple[int, ...],
    largest: Callable[[Any], float],
    surface: bool,
    cart: bool,
) -> Law:
    """The law, which notes at each sample what it finds."""
    inner, distance, follow = jitable(law), _distance(outputs), _follower(size)

    def metered_law(t: float, x: Any, memory: Any, p: Any) -> Any:
        u = inner(t, x, memory, p)
        meters, known = memory.meters, p.meters
        z = error_state(t, x, p)
        follow(t, z, meters.optimal, known.transition)
        error = distance(z, _NOWHERE)
        if t == 0.0:
            meters.start = error
        meters.deviation = _larger(distance(z, meters.optimal), meters.deviation)
        if error > known.band * meters.start and t <= known.onset:
            meters.outside = t
        for i in range(len(known.after)):
            if t >= known.after[i] * (1 - 1e-12):
                meters.error[i] = _larger(error, meters.error[i])
        meters.input = _larger(largest(u), meters.input)
        if surface:
            s = _largest_entry(memory.s)
            meters.sliding = _larger(s, meters.sliding)
            if t == 0.0:
                meters.sliding_start = s
        if cart:
            if t == 0.0:
                meters.position = x[0]
            meters.travel = _larger(abs(x[0] - meters.position), meters.travel)
        return u

    found: Any = metered_law
    found.python_only = getattr(law, "python_only", False)
    return found


@jitable
def _larger(value: float, known: float) -> float:
    """The larger of two; not a number is none, in both engines."""
    return value if value > known else known


@jitable
def _magnitude(u: float) -> float:
    return abs(u)


@jitable
def _largest_entry(values: Any) -> float:
    """The largest magnitude of several numbers."""
    found = 0.0
    for value in values:
        found = _larger(abs(value), found)
    return found


@cache
def _distance(outputs: tuple[int, ...]) -> Callable[[Any, Any], float]:
    """Jitable (a, b) -> the distance of their outputs' entries; that to zero if b is empty."""
    if len(outputs) == 1:
        only = outputs[0]

        @jitable
        def single(a: Any, b: Any) -> float:
            return abs(a[only] - b[only]) if len(b) else abs(a[only])

        return single

    @jitable
    def several(a: Any, b: Any) -> float:
        total = 0.0
        for i in outputs:
            difference = a[i] - b[i] if len(b) else a[i]
            total += difference * difference
        return math.sqrt(total)

    return several


@cache
def _follower(size: int) -> Callable[[float, Any, Any, Any], None]:
    """Jitable (t, z, optimal, transition): bring the optimum to this sample; it starts at z."""
    moved = each(size, row_times)

    @jitable
    def follow(t: float, z: Any, optimal: Any, transition: Any) -> None:
        if t == 0.0:
            for i in range(size):
                optimal[i] = z[i]
        else:
            after = moved(transition, optimal)
            for i in range(size):
                optimal[i] = after[i]

    return follow

"""Names, units and tolerances of the metrics of a run."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from grosmc_mj.ground.errors import ArgumentError, unknown_name
from grosmc_mj.theory.plants import System

# The usual 2 % band, a share of the initial error.
SETTLING_BAND = 0.02
# The share of the transient that an error must stay in its band.
DWELL = 0.1

# Relative and absolute tolerances on another machine. A law without switching repeats to rounding,
# which the step of a threshold or a sum over 1e4 samples amplifies.
_SMOOTH = (1e-6, 1e-9)
# Metrics that depend on the chatter of a switching law and have no tolerance of their own.
_OTHER = (0.1, 0.0)
# Largest magnitudes of states and inputs.
_EXTREME = (0.05, 0.0)


class Metric(NamedTuple):
    """A measured value.

    Attributes:
        value: None where nothing can be measured; ``note`` says why.
        unit: Unit of the value.
        note: ``not reached``, ``no surface`` and the like.
    """

    value: float | None
    unit: str
    note: str = ""


class MeasuredSignal(NamedTuple):
    """A signal of a run that is measured by itself.

    Attributes:
        name: Name of a state or an output; empty for the error of all outputs.
        periodic: Whether an angle is measured modulo a turn.
    """

    name: str = ""
    periodic: bool = False


class Definition(NamedTuple):
    """Unit and tolerance of a metric.

    Attributes:
        unit: Unit; ``output``, ``input`` and ``sliding`` stand for those of the law.
        switched: Relative and absolute tolerance under a switching law on another machine.
            Switching amplifies rounding until whole samples differ; bounds, norms, averages and
            envelopes of the chatter still repeat.
        stored: Whether a campaign stores it of every run.
    """

    unit: str
    switched: tuple[float, float]
    stored: bool = False


class NoMetricError(ArgumentError, KeyError):
    """A metric of a name that a run does not have."""

    # A KeyError would print its message in quotes.
    __str__ = Exception.__str__


class Metrics(dict[str, Metric]):
    """Metrics of a run by name; an unknown name is refused with the valid ones."""

    def __missing__(self, name: str) -> Metric:
        """Refuse a name."""
        raise NoMetricError(unknown_name("metric", name, self))


# Further ones are the largest magnitudes of the internal positions, see ``largest_of``.
DEFINITIONS = {
    "deviation": Definition("output", (0.25, 1e-4), stored=True),
    "settling_time": Definition("s", (0.0, 0.02), stored=True),
    "overshoot": Definition("%", (0.2, 0.2)),
    "rms_error": Definition("output", (1e-3, 1e-5)),
    "max_sliding": Definition("sliding", (0.25, 1e-4), stored=True),
    "rms_sliding": Definition("sliding", (0.25, 1e-4)),
    "sliding_start": Definition("sliding", _OTHER, stored=True),
    "cost_continuous": Definition("1", (0.01, 0.0)),
    "cost_whole": Definition("1", (0.1, 0.0)),
    "cost_optimal": Definition("1", (1e-9, 0.0)),
    "total_variation": Definition("input/s", (0.1, 0.0)),
    "max_input": Definition("input", _EXTREME, stored=True),
}
_LARGEST = "largest "


def stored_metrics(system: System) -> dict[str, str]:
    """Return the metrics that a campaign stores of every run, with their units.

    Args:
        system: System of the plants.
    """
    units = {}
    for name, definition in DEFINITIONS.items():
        if definition.stored:
            units[name] = definition.unit
    for position in system.internal_positions:
        units[largest_of(position.name)] = position.unit
    return units


def may_be_stored(name: str) -> bool:
    """Whether a campaign may store a metric of this name, on some plant."""
    if name in DEFINITIONS:
        return DEFINITIONS[name].stored
    return name.startswith(_LARGEST)


def tolerance_of(metric: str, *, switched: bool) -> tuple[float, float]:
    """Return the relative tolerance of a metric on another machine, and the absolute in its unit.

    Args:
        metric: Name of the metric.
        switched: Whether a switching law made the run.
    """
    if not switched:
        return _SMOOTH
    if metric in DEFINITIONS:
        return DEFINITIONS[metric].switched
    if metric.startswith(_LARGEST):
        return _EXTREME
    return _OTHER


# -- names of metrics with a number or a signal in them --------------------------------------------


def settled_in(band: float | None) -> str:
    """Return the name of the time to settle in a band.

    Args:
        band: Half width in the unit of the output; None for the usual band.
    """
    if band is None:
        return "settled"
    return f"settled in {band!r}"


def largest_of(signal: str, after: float = 0.0, *, periodic: bool = False) -> str:
    """Return the name of the largest magnitude of a signal from an instant on [s].

    Args:
        signal: Name of a state or an output; empty for the error of all outputs.
        after: Instant [s].
        periodic: Whether an angle is measured modulo a turn.
    """
    name = f"{_LARGEST}{signal}" if signal else "error"
    if periodic:
        name += " modulo a turn"
    if after or not signal:
        name += f" after {after!r} s"
    return name


def rms_of(signal: str, after: float = 0.0, *, periodic: bool = False) -> str:
    """Return the name of the RMS of a signal from an instant on, see ``largest_of``."""
    turn = " modulo a turn" if periodic else ""
    return f"rms {signal or 'error'}{turn} after {after!r} s"


def stays(settled: Any, duration: Any) -> Any:
    """Whether an error that has settled stays in its band for the last tenth of a time at least.

    One that swings in and out is always inside for a moment before some end.

    Args:
        settled: Instants from which on errors are in their band [s].
        duration: Times in which they have been measured [s].
    """
    return settled <= (1 - DWELL) * duration


def settling(settled: float) -> Metric:
    """Return a settling time as a metric [s]; infinite stands for never."""
    if settled < math.inf:
        return Metric(settled, "s")
    return Metric(None, "s", "not reached")

"""What a case file may say of the loop as built: sensors, computer, estimators, actuators."""

from __future__ import annotations

from typing import Any

from grosmc_mj.errors import ArgumentError, Mistakes, unknown_name
from grosmc_mj.experiments.file.tables.table import Table, numbers_of
from grosmc_mj.plants import Signal, System
from grosmc_mj.simulation.loop.loop import Loop
from grosmc_mj.simulation.loop.parts import Actuator, Computing, Estimator, Sensor

# The numbers of each kind of part with their units; {} stands for that of what it is of.
LOOP_UNITS: dict[str, dict[str, str]] = {
    "computing": {"delay": "s", "jitter": "s", "missed": ""},
    "sensor": {
        "resolution": "{}",
        "noise": "{}",
        "bias": "{}",
        "drift": "{}/s",
        "delay": "s",
        "period": "s",
    },
    "estimator": {"time_constant": "s", "slope": "{}/s", "bandwidth": "rad/s", "load": "input"},
    "actuator": {
        "delay": "s",
        "resolution": "{}",
        "limit": "{}",
        "rate_limit": "{}/s",
        "lag": "s",
        "dead_zone": "{}",
    },
}


class ComputingTable(Table):
    """``[computing]``: the computer between sensors and actuators.

    Attributes:
        delay: From a sample to its output, a multiple of the timestep.
        jitter: Latest that a sample is, in whole timesteps, evenly distributed.
        missed: Share of the samples whose output comes too late: the last one is held.
        seed: Of noise, jitter and missed samples.
    """

    delay: Any = None
    jitter: Any = None
    missed: Any = None
    seed: int = 0


class SensorTable(Table):
    """``[[sensor]]``: what a state is measured by; a state without one is known exactly.

    Attributes:
        of: The state.
        resolution: Of an encoder: measurements are multiples of it.
        noise: Standard deviation of a sample.
        bias: Constant error.
        drift: Error that grows with time.
        delay: Age of what is measured, a multiple of the timestep.
        period: Between two of its own samples, a multiple of the timestep.
    """

    of: str
    resolution: Any = None
    noise: Any = None
    bias: Any = None
    drift: Any = None
    delay: Any = None
    period: Any = None


class EstimatorTable(Table):
    """``[[estimator]]``: what gives the laws a state that is not measured.

    Attributes:
        of: A rate; of ``kalman`` any states, a list of them.
        law: ``difference``, ``filtered``, ``levant``, ``high-gain``, ``eso`` or ``kalman``.
        time_constant: Of ``filtered``.
        slope: Of ``levant``: bound of the rate's derivative.
        bandwidth: Of ``high-gain`` and ``eso``.
        load: Of ``kalman``: standard deviation of an unknown input.
        settled: Whether it begins with the true value; else with a rate of zero.
    """

    of: str | list[str]
    law: str = "difference"
    time_constant: Any = None
    slope: Any = None
    bandwidth: Any = None
    load: Any = None
    settled: bool = True


class ActuatorTable(Table):
    """``[[actuator]]``: what makes an input of what is asked for.

    Attributes:
        of: The input.
        delay: A multiple of the timestep.
        resolution: Of what it is told.
        limit: Largest magnitude.
        rate_limit: Largest change per second.
        lag: Time constant.
        order: 1, or 2 for two equal lags in a row.
        dead_zone: Magnitude up to which nothing comes out.
    """

    of: str
    delay: Any = None
    resolution: Any = None
    limit: Any = None
    rate_limit: Any = None
    lag: Any = None
    order: int = 1
    dead_zone: Any = None


def loop_unit(kind: str, of: str, quantity: str, system: System) -> str:
    """Unit of a number of a part.

    Args:
        kind: ``computing``, ``sensor``, ``estimator`` or ``actuator``.
        of: The state or input that it is of.
        quantity: Which number.
        system: Whose.

    Raises:
        ArgumentError: If the system has no such state or input.
    """
    unit = LOOP_UNITS[kind][quantity]
    if unit == "input":
        return system.input.unit
    if "{}" not in unit:
        return unit
    signals: tuple[Signal, ...] = system.inputs if kind == "actuator" else system.states
    units = {each.name: each.unit for each in signals}
    if of not in units:
        what = "input" if kind == "actuator" else "state"
        raise ArgumentError(unknown_name(what, of, units))
    return unit.format(units[of])


def loop_of_file(
    computing: ComputingTable | None,
    sensor: list[SensorTable],
    estimator: list[EstimatorTable],
    actuator: list[ActuatorTable],
    system: System,
) -> Loop | None:
    """The loop of a case file, None for one without.

    Raises:
        ArgumentError: All numbers that do not fit.
    """
    if computing is None and not (sensor or estimator or actuator):
        return None
    mistakes, computer = Mistakes(), Computing()
    parts: dict[str, list[Any]] = {"sensor": [], "estimator": [], "actuator": []}
    with mistakes.gathered("computing: "):
        if computing is not None:
            computer = Computing(**_numbers("computing", "", computing, system))
    for kind, tables, make in (
        ("sensor", sensor, Sensor),
        ("estimator", estimator, Estimator),
        ("actuator", actuator, Actuator),
    ):
        for index, table in enumerate(tables):
            with mistakes.gathered(f"{kind} {index + 1}: "):
                first = table.of if isinstance(table.of, str) else (table.of or [""])[0]
                given: dict[str, Any] = _numbers(kind, first, table, system)
                of: Any = table.of if isinstance(table.of, str) else tuple(table.of)
                for key in ("law", "settled", "order"):
                    if hasattr(table, key):
                        given[key] = getattr(table, key)
                parts[kind].append(make(of, **given))
    seed = 0 if computing is None else computing.seed
    found = None
    with mistakes.gathered("computing: "):
        found = Loop(computer, *(tuple(parts[kind]) for kind in parts), seed=seed)
    mistakes.refuse()
    return found


def _numbers(kind: str, of: str, table: Table, system: System) -> dict[str, float]:
    """The numbers that a table gives, in the units of the system."""
    return numbers_of(table, LOOP_UNITS[kind], lambda name: loop_unit(kind, of, name, system))

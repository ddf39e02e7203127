"""A law asked for the commands of a log: is it the law that the machine ran?"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.wording import counted, unit_after
from grosmc_mj.output.results.tables import number
from grosmc_mj.simulation.law_inputs import sample_law
from grosmc_mj.simulation.loop import AppliedLoop
from grosmc_mj.simulation.loop.sent import keep_output
from grosmc_mj.simulation.loop.software import observe
from grosmc_mj.simulation.loop.timing import steps_to

# A logged command may stand so many rows after the states that it was computed from, at most.
_MOST_ROWS = 3
# Share of a command's span that the digits of a log are worth, at most.
_ROUNDING = 1e-3
# Periods of law and log that differ by less are the same; clocks are not exact.
_SAME_PERIOD = 0.02


class LawOnLog(NamedTuple):
    """Commands of a law on the states of a log, beside the logged ones.

    Attributes:
        rows: Rows of the log from the states to the command that was computed from them.
        largest: Largest difference of a command, in its unit.
        unit: The unit of that input.
        first: Instant of the first states whose command differs by more than rounding [s]; None
            for none.
        asked: Command of the law there.
        logged: Command of the log there.
    """

    rows: int
    largest: float
    unit: str
    first: float | None = None
    asked: float = 0.0
    logged: float = 0.0

    @property
    def words(self) -> str:
        """The finding in a sentence."""
        unit = unit_after(self.unit)
        if self.first is None:
            late = ""
            if self.rows:
                late = f", {counted(self.rows, 'row')} after its states"
            return f"reproduces the logged command to {self.largest:.1e}{unit}{late}"
        return (
            f"differs from the logged command by up to {number(self.largest)}{unit}, first "
            f"at {self.first:.4g} s: {number(self.asked)}, logged {number(self.logged)}{unit}"
        )


def law_on_log(applied: AppliedLoop, log: Log, start: Array, limits: Array) -> LawOnLog:
    """Ask a law for every command of a log, on the logged states.

    Rates that are not logged are estimated as in the loop. A command may be logged with the states
    that it was computed from, or some rows later: the number of rows is that of the least
    difference.

    Args:
        applied: The loop around the law.
        log: The log, from the first sample of the law on.
        start: State at the start of the log, (n,), from which estimators begin.
        limits: Least and largest of each input, (2, m).

    Raises:
        ArgumentError: If the log does not have what the law needs, or the law fails.
    """
    _require_samples(applied, log)
    system = applied.system
    asked = np.clip(_commands(applied, log, start), *limits)
    differences = [_difference(asked, log, rows) for rows in range(_MOST_ROWS + 1)]
    rows = min(range(len(differences)), key=lambda k: float(np.square(differences[k]).mean()))

    difference = np.abs(differences[rows])
    spans = np.maximum(np.ptp(log.inputs, axis=0), 1e-12)
    _, worst = np.unravel_index((difference / spans).argmax(), difference.shape)
    finding = LawOnLog(
        rows=rows,
        largest=float(difference[:, worst].max()),
        unit=system.inputs[worst].unit,
    )
    beyond = np.flatnonzero(difference[:, worst] > _ROUNDING * spans[worst])
    if not len(beyond):
        return finding

    first = int(beyond[0])
    return finding._replace(
        first=float(log.time[first]),
        asked=float(asked[first, worst]),
        logged=float(log.inputs[first + rows, worst]),
    )


def _require_samples(applied: AppliedLoop, log: Log) -> None:
    """Refuse a log that has other samples than those of the law, or lacks a state."""
    if not math.isclose(log.sampling, applied.period, rel_tol=_SAME_PERIOD):
        raise ArgumentError(
            f"{log.name} has a row every {1e3 * log.sampling:.4g} ms, the law runs every "
            f"{1e3 * applied.period:.4g} ms (control_period of [run])"
        )
    estimated = {name for part in applied.loop.estimators for name in part.of}
    names = [state.name for state in applied.system.states]
    missing = [name for name in names if name not in log.states and name not in estimated]
    if missing:
        raise ArgumentError(f"{log.name} does not measure {', '.join(missing)}")


def _commands(applied: AppliedLoop, log: Log, start: Array) -> Array:
    """The law's commands on the states of a log, (N, m)."""
    law = applied.controller
    system = applied.system
    commands = np.zeros(log.inputs.shape)
    memory = law.memory()
    x = np.zeros(len(system.states))
    loop = applied.begin_uncompiled(start, memory, np.zeros(len(x)), x)
    measured = loop.measured
    measured.fresh[:] = 1.0
    clock = steps_to(log.time, applied.timestep)

    for k in range(len(log.time)):
        for j, state in enumerate(system.states):
            if state.name in log.states:
                measured.y[j] = log.states[state.name][k]
        measured.clock[0] = clock[k]
        t = observe(k, measured, loop.software)
        sample_law(law, t, x, memory, commands[k])
        keep_output(k, log.inputs[k], True, measured, loop.software)
    return commands


def _difference(asked: Array, log: Log, rows: int) -> Array:
    """Commands of the law less those that are logged so many rows later, (N - rows, m)."""
    return asked[: len(asked) - rows] - log.inputs[rows:]

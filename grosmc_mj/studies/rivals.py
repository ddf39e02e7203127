"""GROSMC and its rivals compared; ``docs/rivals.md`` has the rule for the rivals' numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.ground.arrays import as_rows
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.output.results.tables import number, numbers, table, words

SYSTEMS = ("servo", "cart_pendulum", "arm", "two_link_arm")
# The remaining error is the largest in the last part of a run [s].
_END = 1.0


class Rival(NamedTuple):
    """A run of a law, and its numbers for comparison.

    Attributes:
        system: Name of the system.
        law: Name of the controller.
        settling: Time to within 2 % of the start's error, up to the load [s]; infinite for never.
        deviation: max |y - y*|, y* the nominal optimum of the law, in the unit of the output; of
            several outputs, the norm.
        remaining: max |e| in the last second, in the unit of the output; of several, the norm.
        peak: Largest entry of |u|, in the unit of the input.
        variation: Total variation of u per second, in the unit of the input per second: chatter;
            of several inputs, by the norm of their changes.
        kept: Whether all that the case requires is kept.
        output_unit: Unit of the output.
        input_unit: Unit of the input.
    """

    system: str
    law: str
    settling: float
    deviation: float
    remaining: float
    peak: float
    variation: float
    kept: bool
    output_unit: str
    input_unit: str


def rivals(system: str) -> list[Rival]:
    """Return every law of the rivals' case of one of ``SYSTEMS``, in the order of its file."""
    experiment = Experiment.load(f"rivals/{system}")
    return [compared(experiment.run(law=law)) for law in experiment.controllers]


def compared(run: RunResult) -> Rival:
    """Return the numbers of a run; its outputs have one unit, and its inputs one."""
    trajectory = run.trajectory
    law = run.controller
    z = law.coordinates.along(trajectory.time, trajectory.state, law.parameters)
    error = np.linalg.norm(z[:, list(law.coordinates.output_rows)], axis=1)
    last = error[trajectory.time >= trajectory.time[-1] - _END]
    remaining = float(last.max())
    if run.ended:
        remaining = math.inf

    return Rival(
        system=run.case.name,
        law=law.name,
        settling=_metric(run, "settling_time"),
        deviation=_metric(run, "deviation"),
        remaining=remaining,
        peak=_metric(run, "max_input"),
        variation=variation_of(run),
        kept=all(judgement.kept for judgement in run.requirements),
        output_unit=law.coordinates.output_units[0],
        input_unit=law.designed.error.system.inputs[0].unit,
    )


def variation_of(run: RunResult) -> float:
    """Return the total variation of u of a run per second, of several inputs by their norm."""
    trajectory = run.trajectory
    u = as_rows(trajectory.input)
    variation = np.linalg.norm(np.diff(u, axis=0), axis=1).sum()
    return float(variation / trajectory.time[-1])


def _metric(run: RunResult, name: str) -> float:
    """A metric's value; infinite if it has none."""
    value = run.metrics[name].value
    if value is None:
        return math.inf
    return float(value)


def rivals_table(rows: Iterable[Rival]) -> str:
    """Return the table of ``docs/rivals.md``, in Markdown."""
    columns = [
        *words("system", "law"),
        *numbers("settled", "max |y − y\\*|", "left at the end"),
        *numbers("max |u|", "variation of u", "kept"),
    ]
    return "\n".join(table("", columns, [_cells(row) for row in rows]).markdown())


def _cells(row: Rival) -> list[str]:
    """The row of one law."""
    settled = "not reached"
    if math.isfinite(row.settling):
        settled = f"{number(row.settling)} s"
    remaining = "ended early"
    if math.isfinite(row.remaining):
        remaining = f"{number(row.remaining)}{unit_after(row.output_unit)}"
    return [
        row.system,
        row.law,
        settled,
        f"{number(row.deviation)}{unit_after(row.output_unit)}",
        remaining,
        f"{number(row.peak)}{unit_after(row.input_unit)}",
        f"{number(row.variation)}{unit_after(row.input_unit)}/s",
        "yes" if row.kept else "no",
    ]

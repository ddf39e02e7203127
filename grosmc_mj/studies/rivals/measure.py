"""One run of each law of a rivals' case, and what it is compared by."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.runs import RunResult

SYSTEMS = ("servo", "cart_pendulum", "arm")
# What the error of the end is the largest of [s].
END = 1.0


class Rival(NamedTuple):
    """What a run is compared by.

    Attributes:
        system: Name of the system.
        law: Name of the controller.
        settling: Time to within 2 % of the start's error, up to the load [s]; infinite for never.
        deviation: max |y - y*|, y* the nominal optimum of the law, in the unit of the output.
        remaining: max |e| in the last second, in the unit of the output.
        peak: max |u|, in the unit of the input.
        variation: Total variation of u per second, in the unit of the input per second: chatter.
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
    """Every law of the case of a system, in the order of its file.

    Args:
        system: One of ``SYSTEMS``.
    """
    experiment = Experiment.load(f"rivals/{system}")
    return [compared(experiment.run(law=law)) for law in experiment.controllers]


def compared(run: RunResult) -> Rival:
    """What a run of one input is compared by."""
    found, law = run.trajectory, run.controller
    system, values = law.designed.error.system, {k: each.value for k, each in run.metrics.items()}
    e = law.coordinates.along(found.time, found.state, law.parameters)[:, 0]
    last = e[found.time >= found.time[-1] - END]
    numbers = [
        math.inf if value is None else float(value)
        for value in (
            values["settling_time"],
            values["deviation"],
            float(np.abs(last).max()) if not run.ended else None,
            values["max_input"],
            float(np.abs(np.diff(found.input)).sum() / found.time[-1]),
        )
    ]
    kept = all(each.kept for each in run.requirements)
    units = law.coordinates.output_units[0], system.input.unit
    return Rival(run.case.name, law.name, *numbers, kept, *units)

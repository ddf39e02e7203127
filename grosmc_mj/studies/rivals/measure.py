"""One run of each law of a rivals' case, and what it is compared by."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.runs import RunResult

SYSTEMS = ("servo", "cart_pendulum", "arm", "two_link_arm")
# What the error of the end is the largest of [s].
END = 1.0


class Rival(NamedTuple):
    """What a run is compared by.

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
    """Every law of the case of a system, in the order of its file.

    Args:
        system: One of ``SYSTEMS``.
    """
    experiment = Experiment.load(f"rivals/{system}")
    return [compared(experiment.run(law=law)) for law in experiment.controllers]


def compared(run: RunResult) -> Rival:
    """What a run is compared by; its outputs have one unit, and its inputs one."""
    found, law = run.trajectory, run.controller
    values = {name: metric.value for name, metric in run.metrics.items()}
    z = law.coordinates.along(found.time, found.state, law.parameters)
    e = np.linalg.norm(z[:, list(law.coordinates.output_rows)], axis=1)
    last = e[found.time >= found.time[-1] - END]
    u = found.input if found.input.ndim > 1 else found.input[:, None]
    return Rival(
        system=run.case.name,
        law=law.name,
        settling=_or_never(values["settling_time"]),
        deviation=_or_never(values["deviation"]),
        remaining=math.inf if run.ended else float(last.max()),
        peak=_or_never(values["max_input"]),
        variation=float(np.linalg.norm(np.diff(u, axis=0), axis=1).sum() / found.time[-1]),
        kept=all(each.kept for each in run.requirements),
        output_unit=law.coordinates.output_units[0],
        input_unit=law.designed.error.system.inputs[0].unit,
    )


def _or_never(value: float | None) -> float:
    """A metric's value; infinite where it has none."""
    return math.inf if value is None else float(value)

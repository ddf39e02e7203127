"""Chatter of a loop at rest, and the change of gain or delay at which it begins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from grosmc_mj.simulation.disturbances import Table
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.studies.margins.changes import DELAY, GAIN_UP, ChangeSearch
from grosmc_mj.studies.margins.sensitivity import LoopPlace, RunningLoop
from grosmc_mj.studies.sweep.search import run_searches

# A pulse of one control period starts what may chatter [share of the input's size].
_PULSE = 0.01
# Change of the input from sample to sample that is chatter, rms [share of the input's size].
_CHATTER = 1e-3


@dataclass(frozen=True)
class Chatter:
    """Changes at which chatter begins; infinite if nothing that was tried makes the loop chatter.

    Attributes:
        at_rest: Whether the loop chatters as it is.
        gain: Least factor of the gain; 1 at rest.
        delay: Least further delay [s]; 0 at rest.
    """

    at_rest: bool
    gain: float
    delay: float


def is_quiet(loop: RunningLoop, place: LoopPlace, size: float, duration: float) -> bool:
    """Return whether the input rests after a small pulse, in each realization of the loop.

    Args:
        loop: The loop.
        place: An input.
        size: Size of the input, such as its limit.
        duration: Length of the run, whose second half counts [s].
    """
    pulse = Table((_PULSE * size,), loop.control_period)
    run = loop.run(place, [pulse] * len(loop.loops), 0, duration)
    if any(status is not Status.COMPLETED for status in run.status):
        return False
    inputs = loop.sampled(run.input)
    changes = np.diff(inputs[:, inputs.shape[1] // 2 :], axis=1)
    sizes = np.sqrt(np.mean(changes**2, axis=(1, 2)))
    return bool(np.all(sizes <= _CHATTER * size))


def chatter(
    running: Callable[[Loop], RunningLoop],
    loop: Loop,
    place: LoopPlace,
    size: float,
    duration: float,
) -> Chatter:
    """Search where chatter begins.

    Args:
        running: Makes the running loop of these parts.
        loop: The parts as they are.
        place: An input.
        size: Size of the input, such as its limit.
        duration: Length of a run [s].
    """

    def quiet(parts: Loop) -> bool:
        return is_quiet(running(parts), place, size, duration)

    if not quiet(loop):
        return Chatter(True, 1.0, 0.0)

    as_is = running(loop)
    inputs = [signal.name for signal in as_is.plant.system.inputs]
    searches = [ChangeSearch(kind, loop, inputs, as_is.timestep) for kind in (GAIN_UP, DELAY)]
    run_searches(searches, lambda tried: [quiet(search.at(factor)) for search, factor in tried])
    gain, delay = [search.bounds[1] for search in searches]
    return Chatter(False, gain, delay)

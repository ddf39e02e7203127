"""Changes of a loop's gain and delay, and the search for the largest one that passes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from grosmc_mj.simulation.loop import Actuator, Loop
from grosmc_mj.studies.sweep.search import Search

GAIN_DOWN = "gain down"
GAIN_UP = "gain up"
DELAY = "delay"
# Largest factor of the gain, and bound of the further delay [s].
MOST = 1024.0
_LONGEST = 1.0
# Factors that are tried in an octave: of a gain, and of either one in the octave below its first
# failure, for under chatter what passes has gaps.
_OF_GAIN = 4
_FINE = 16
# Width at which a search ends, over the largest change that passes; just wider than the distance of
# two numbers of three digits, so that a number lies between those of any wider range.
_RESOLUTION = 0.0101


def changed(
    loop: Loop,
    inputs: Sequence[str],
    gain: float = 1.0,
    delay: float = 0.0,
) -> Loop:
    """Return a loop with another gain and a further delay of every input.

    Args:
        loop: The loop.
        inputs: Names of the plant's inputs.
        gain: Factor of the commands, before the limit of their actuators.
        delay: Further delay [s]; a multiple of the timestep.
    """
    actuators = {actuator.of: actuator for actuator in loop.actuators}
    for name in inputs:
        old = actuators.get(name, Actuator(name))
        actuators[name] = replace(old, gain=old.gain * gain, delay=old.delay + delay)
    return replace(loop, actuators=tuple(actuators.values()))


class ChangeSearch(Search):
    """Search for the largest change of one kind; a delay is counted in timesteps.

    A factor that is tried has three digits: what is printed has been run.

    Args:
        kind: ``gain down``, ``gain up`` or ``delay``.
        timestep: [s].

    Attributes:
        kind: The kind.
    """

    def __init__(self, kind: str, timestep: float) -> None:
        self.kind = kind
        self._timestep = timestep
        most = MOST
        step = 0.0
        if kind == DELAY:
            # A power of two, so that all that is tried is whole.
            most = 2.0 ** math.floor(math.log2(_LONGEST / timestep))
            step = 1.0
        super().__init__(
            most,
            middle=lambda low, high: self._tried((low + high) / 2),
            narrow=lambda low, high: high - low <= max(step, _RESOLUTION * low),
            least=1.0,
            per_octave=1 if kind == DELAY else _OF_GAIN,
        )
        # No change.
        self.known[1.0 - step] = True

    def _grid(self, per_octave: int) -> list[float]:
        return [self._tried(factor) for factor in super()._grid(per_octave)]

    def _tried(self, factor: float) -> float:
        """The factor that is tried in place of another one."""
        if self.kind == DELAY:
            return float(math.floor(factor))
        return MOST if factor == MOST else float(f"{factor:.3g}")

    def size(self, factor: float) -> float:
        """Change for a factor of the search: a factor, or a delay [s]."""
        return factor * self._timestep if self.kind == DELAY else factor

    def loop(self, loop: Loop, inputs: Sequence[str], factor: float) -> Loop:
        """Loop with the change for a factor of the search."""
        if self.kind == DELAY:
            return changed(loop, inputs, delay=self.size(factor))
        gain = 1 / factor if self.kind == GAIN_DOWN else factor
        return changed(loop, inputs, gain=gain)

    @property
    def bounds(self) -> tuple[float, float]:
        """Largest change that passes, and smallest that fails; infinite if none does."""
        assert self.largest is not None
        failed = math.inf if self.failed is None else self.failed
        return self.size(self.largest), self.size(failed)


def search_changes(
    searches: Sequence[ChangeSearch],
    loop: Loop,
    inputs: Sequence[str],
    passing: Callable[[Sequence[Loop]], Sequence[bool]],
) -> None:
    """Run searches to their ends.

    Args:
        searches: The searches.
        loop: The loop as it is.
        inputs: Names of the plant's inputs.
        passing: Tells which of some loops pass; those of a round are asked for together.
    """
    while True:
        tried = []
        for search in searches:
            factors = search.on_grid(MOST) or search.finely(_FINE)
            tried += [(search, factor) for factor in factors]
        if not tried:
            return
        loops = [search.loop(loop, inputs, factor) for search, factor in tried]
        for (search, factor), passes in zip(tried, passing(loops), strict=True):
            search.known[factor] = passes

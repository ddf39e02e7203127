"""Changes of a loop's gain and delay, and the search for the largest one that passes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from grosmc_mj.output.results.tables import number
from grosmc_mj.simulation.loop import Actuator, Loop
from grosmc_mj.studies.sweep.search import Search, grid_of

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
    """Search for the largest change of a loop, of one kind; a delay is counted in timesteps.

    A factor that is tried has three digits: what is printed has been run.

    Args:
        kind: ``gain down``, ``gain up`` or ``delay``.
        loop: The loop as it is.
        inputs: Names of the plant's inputs.
        timestep: [s].

    Attributes:
        kind: The kind.
    """

    def __init__(self, kind: str, loop: Loop, inputs: Sequence[str], timestep: float) -> None:
        self.kind = kind
        self._loop = loop
        self._inputs = inputs
        self._timestep = timestep
        most = MOST
        per_octave = _OF_GAIN
        without = 1.0
        if kind == DELAY:
            # A power of two, so that all that is tried is whole.
            most = 2.0 ** math.floor(math.log2(_LONGEST / timestep))
            per_octave = 1
            without = 0.0
        super().__init__(
            self._middle_of,
            most,
            least=1.0,
            grid=[self._tried(factor) for factor in grid_of(1.0, most, per_octave)],
            beyond=MOST,
            finer=[self._tried(factor) for factor in grid_of(1.0, most, _FINE)],
        )
        # No change.
        self.known[without] = True

    def _middle_of(self, low: float, high: float) -> float | None:
        """The factor to try between two; None if they are near enough."""
        step = 1.0 if self.kind == DELAY else 0.0
        if high - low <= max(step, _RESOLUTION * low):
            return None
        return self._tried((low + high) / 2)

    def _tried(self, factor: float) -> float:
        """The factor that is tried in place of another one."""
        if self.kind == DELAY:
            return float(math.floor(factor))
        return MOST if factor == MOST else float(f"{factor:.3g}")

    def size(self, factor: float) -> float:
        """Change for a factor of the search: a factor, or a delay [s]."""
        return factor * self._timestep if self.kind == DELAY else factor

    def at(self, factor: float) -> Loop:
        """Loop with the change for a factor of the search."""
        if self.kind == DELAY:
            return changed(self._loop, self._inputs, delay=self.size(factor))
        gain = 1 / factor if self.kind == GAIN_DOWN else factor
        return changed(self._loop, self._inputs, gain=gain)

    @property
    def bounds(self) -> tuple[float, float]:
        """Largest change that passes, and smallest that fails; infinite if none does."""
        assert self.largest is not None
        failed = math.inf if self.failed is None else self.failed
        return self.size(self.largest), self.size(failed)

    @property
    def text(self) -> str:
        """The largest change that passes: a factor, or milliseconds."""
        passes, _ = self.bounds
        at_least = "≥" if self.failed is None else ""
        if self.kind == GAIN_DOWN:
            return f"{at_least.replace('≥', '≤')}1/{number(passes)}"
        if self.kind == DELAY:
            return f"{at_least}{milliseconds(passes)}"
        return f"{at_least}{number(passes)}"


def milliseconds(delay: float) -> str:
    """Write a delay of whole timesteps, without a loss of digits [ms]."""
    return f"{1e3 * delay:.6g}"

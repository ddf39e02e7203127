"""A compiled export in place of the Python law of simulations."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np
from numba import types

from grosmc_mj.export.compiler import CompiledLaw, RunningLaw
from grosmc_mj.export.law import LawInC
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import compiled_as, jitable
from grosmc_mj.ground.compilation.records import pack, with_fields
from grosmc_mj.ground.compilation.structures import pointer, structure_at, structure_of
from grosmc_mj.simulation.loop.applied import AppliedLoop, LoopRun
from grosmc_mj.simulation.loop.rows import ring_row
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller


class _Sample(NamedTuple):
    """Address of the C's sample, see ``CompiledLaw.address``, as a structure."""

    sample: Annotated[Any, types.FunctionType(types.void(types.float64, *[types.uintp] * 4))]


_sample_at = structure_at(_Sample)
# Numbers of a run of the C: whether it has begun, the last step's answer, and then its memory.
_ANSWER = 1
_MEMORY = 2


class LawInSimulation(NamedTuple):
    """A compiled export as simulations take it.

    Attributes:
        controller: The controller with the C as its law.
        loop: Loop that it needs; None for a law alone, which runs in any loop.
    """

    controller: Controller
    loop: AppliedLoop | None


def in_simulation(law: LawInC, compiled: RunningLaw) -> LawInSimulation:
    """Return a compiled export in place of the Python law of simulations.

    Args:
        law: The export.
        compiled: The same, compiled, which must stay loaded as long, or on an emulated processor.
    """
    if law.loop is None and isinstance(compiled, CompiledLaw):
        sample = structure_of(_Sample(compiled.address))
        memory = partial(_memory, law, sample)
        controller = replace(law.controller, law=_sampled_alone(compiled), memory=memory)
        return LawInSimulation(controller, None)

    memory = partial(_memory, law, np.zeros(0))
    if law.loop is None:
        outside = _sampled_outside(law, compiled)
        return LawInSimulation(replace(law.controller, law=outside, memory=memory), None)

    sampler = _Sampler(law, compiled)
    parts = {item.name: getattr(law.loop, item.name) for item in fields(law.loop)}
    controller = replace(law.controller, law=sampler.law, memory=memory)
    return LawInSimulation(controller, _WatchedLoop(**parts, sampler=sampler))


def compared_places(law: LawInC) -> list[int]:
    """Return the places in the Python law's memory, flat, that the C remembers, too."""
    size = pack(law.controller.memory()).size
    return [place for place in law.memory.places if place < size]


# A law by itself, in compiled code and in Python.


def _sampled_alone(compiled: CompiledLaw) -> Any:
    """Law that samples the C."""

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        shown = pack(memory)
        compiled.sample(t, np.ascontiguousarray(x, float), memory.run, u, shown)
        _show(shown, memory)

    return compiled_as(law, _compiled_law)


@jitable
def _compiled_law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    # The address stands in memory, so that code in the disk cache has none; v comes first in it.
    sample = _sample_at(pointer(int(memory.sample))).sample
    sample(t, x.ctypes.data, memory.run.ctypes.data, u.ctypes.data, memory.v.ctypes.data)


def _sampled_outside(export: LawInC, running: RunningLaw) -> Any:
    """Law that samples the C outside this process, in Python alone."""
    places = compared_places(export)

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        run = memory.run
        own = run[_MEMORY:]
        if not run[0]:
            running.begin(own, np.array(x, float))
            run[0] = 1.0
        run[_ANSWER] = running.step(t, np.array(x, float), own, u)
        shown = pack(memory)
        shown[places] = own
        _show(shown, memory)

    outside: Any = law
    outside.python_only = True
    return outside


def _memory(law: LawInC, sample: Array) -> Any:
    """Memory of a run: behind what the law remembers an address and the run of the C."""
    run = np.zeros(_MEMORY + len(compared_places(law)))
    return with_fields(law.controller.memory(), sample=float(sample.ctypes.data), run=run)


def answers_of(trajectory: Trajectory) -> Array:
    """Answers of ``NAME_step`` at the samples of a run, (N,)."""
    return trajectory.memory["run"][:, _ANSWER]


def remembered_by(trajectory: Trajectory) -> Array:
    """Memory of the C at the samples of a run, flat, (N, numbers)."""
    return trajectory.memory["run"][:, _MEMORY:]


def _show(numbers: Array, memory: Any) -> None:
    """Write numbers, flat as ``pack`` gives them, into the fields of a law's memory but the run."""
    place = 0
    for item in fields(memory):
        member = getattr(memory, item.name)
        values = numbers[place : place + np.size(member)]
        place += np.size(member)
        if item.name in ("sample", "run"):
            continue
        if np.ndim(member):
            member.ravel()[:] = values
        else:
            setattr(memory, item.name, float(values[0]))


# A law with its loop, in Python.


class _Sampler:
    """The C in place of software and law."""

    def __init__(self, export: LawInC, compiled: RunningLaw) -> None:
        self._places = list(export.measured)
        self._compiled = compiled
        self._memory = np.zeros(len(export.memory.places))
        self._compared = compared_places(export)
        self._loop: Any = None
        self._samples = 0
        self._last = np.zeros(0)

        def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
            self._sample(memory, u)

        # A controller takes a function.
        self.law: Any = law
        self.law.python_only = True

    def begin(self, x0: Array, loop: LoopRun) -> None:
        """Begin a run."""
        self._compiled.begin(self._memory, np.array(x0))
        self._loop = loop
        self._samples = 0

    def _sample(self, memory: Any, u: Array) -> None:
        """Sample the C: it gets what is measured, not the state that Python has estimated."""
        measured = self._loop.measured
        if self._samples > 0:
            sent = self._loop.software.sent
            if np.any(sent[ring_row(self._samples - 1, sent)] != self._last):
                self._compiled.missed(self._memory)
        y = measured.y[self._places]
        fresh = measured.fresh[self._places]
        clock = float(measured.clock[0])
        answer = self._compiled.step_in_loop(clock, y, fresh, self._memory, u)
        self._last = u.copy()
        self._samples += 1

        # The law's memory comes first.
        of_law = self._memory[: len(self._compared)]
        memory.run[_ANSWER] = answer
        memory.run[_MEMORY:] = of_law
        shown = pack(memory)
        shown[self._compared] = of_law
        _show(shown, memory)


@dataclass(frozen=True, eq=False, kw_only=True)
class _WatchedLoop(AppliedLoop):
    """A loop that tells the sampler of its runs.

    Attributes:
        sampler: The sampler.
    """

    sampler: _Sampler

    def begin_uncompiled(self, x0: Array, memory: Any, seen: Array, predicted: Array) -> LoopRun:
        """Loop of a new run for plain Python."""
        loop = super().begin_uncompiled(x0, memory, seen, predicted)
        self.sampler.begin(x0, loop)
        return loop

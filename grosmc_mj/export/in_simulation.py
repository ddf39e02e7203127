"""A compiled export in place of the Python law of simulations."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np
from numba import types

from grosmc_mj.export.compiler import CompiledLaw
from grosmc_mj.export.law import LawInC
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import compiled_as, jitable
from grosmc_mj.ground.compilation.records import pack, with_fields
from grosmc_mj.ground.compilation.structures import pointer, structure_at, structure_of
from grosmc_mj.simulation.loop.applied import AppliedLoop, LoopRun
from grosmc_mj.simulation.loop.rows import ring_row
from grosmc_mj.theory.control.controller import Controller


class _Step(NamedTuple):
    """Address of ``int (double t, const double *x, double *memory, double *u)``, as a structure."""

    step: Annotated[Any, types.FunctionType(types.int32(types.float64, *[types.uintp] * 3))]


_step_at = structure_at(_Step)


class LawInSimulation(NamedTuple):
    """A compiled export as simulations take it.

    Attributes:
        controller: The controller with the C as its law.
        loop: Loop that it needs; None for a law alone, which runs in any loop.
    """

    controller: Controller
    loop: AppliedLoop | None


def in_simulation(law: LawInC, compiled: CompiledLaw) -> LawInSimulation:
    """Return a compiled export in place of the Python law of simulations.

    Args:
        law: The export.
        compiled: The same, compiled, which must stay loaded as long.
    """
    if law.loop is None:
        step = structure_of(_Step(compiled.address))
        memory = partial(_memory, law.controller, step)
        controller = replace(law.controller, law=_sampled_alone(compiled), memory=memory)
        return LawInSimulation(controller, None)

    sampler = _Sampler(law, compiled)
    parts = {item.name: getattr(law.loop, item.name) for item in fields(law.loop)}
    controller = replace(law.controller, law=sampler.law)
    return LawInSimulation(controller, _WatchedLoop(**parts, sampler=sampler))


# A law by itself, in compiled code and in Python.


def _sampled_alone(compiled: CompiledLaw) -> Any:
    """Law that samples the C."""

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        numbers = pack(memory)
        compiled.step(t, np.ascontiguousarray(x, float), numbers, u)
        _unpack(numbers, memory)

    return compiled_as(law, _compiled_law)


@jitable
def _compiled_law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    # The address stands in memory, so that code in the disk cache has none; v comes first in it.
    step = _step_at(pointer(int(memory.step))).step
    step(t, x.ctypes.data, memory.v.ctypes.data, u.ctypes.data)


def _memory(controller: Controller, step: Array) -> Any:
    """Memory of a run, with the address of the step's structure behind what the law remembers."""
    return with_fields(controller.memory(), step=float(step.ctypes.data))


def _unpack(numbers: Array, memory: Any) -> None:
    """Write numbers, flat as ``pack`` gives them, into the fields of a law's memory."""
    place = 0
    for item in fields(memory):
        member = getattr(memory, item.name)
        values = numbers[place : place + np.size(member)]
        if np.ndim(member):
            member.ravel()[:] = values
        else:
            setattr(memory, item.name, float(values[0]))
        place += np.size(member)


# A law with its loop, in Python.


class _Sampler:
    """The C in place of software and law."""

    def __init__(self, export: LawInC, compiled: CompiledLaw) -> None:
        self._places = list(export.measured)
        self._compiled = compiled
        self._memory = np.zeros(export.memory_size)
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
        self._compiled.step_in_loop(float(measured.clock[0]), y, fresh, self._memory, u)
        self._last = u.copy()
        self._samples += 1
        # The law's memory comes first.
        _unpack(self._memory, memory)


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

"""A compiled export in place of the Python law of simulations."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.export.compiler import CompiledLaw
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.loop import LoopInC
from grosmc_mj.export.structures import size_of
from grosmc_mj.jitable import compiled_as, jitable
from grosmc_mj.loop.applied import AppliedLoop
from grosmc_mj.loop.ring import ring_row
from grosmc_mj.loop.start import LoopRun
from grosmc_mj.numba_internals import make_array
from grosmc_mj.records import pack, with_fields

# int (double t, const double *x, double *memory, double *u), see ``CompiledLaw``.
_STEP = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, *[ctypes.c_void_p] * 3)


def in_simulation(law: LawInC, compiled: CompiledLaw) -> tuple[Controller, AppliedLoop | None]:
    """Return a controller with the compiled export as its law, and the loop that it needs.

    Args:
        law: The export.
        compiled: The same, compiled, which must stay loaded as long.

    Returns:
        The controller; and for a law with its loop that loop, whose software is the export's.
    """
    if not isinstance(law, LoopInC):
        # The address stands in the memory of a run, so that code in the disk cache has none.
        memory = partial(_memory, law.controller, compiled.address)
        return replace(law.controller, law=_law, memory=memory), None

    sampler = _Sampler(law, compiled)
    parts = {item.name: getattr(law.loop, item.name) for item in fields(law.loop)}
    return replace(law.controller, law=sampler.law), _WatchedLoop(**parts, sampler=sampler)


# A law by itself, in compiled code and in Python.


def _call(typing_context: Any, address: Any, t: Any, x: Any, memory: Any, u: Any) -> Any:
    """Type and code of ``call_step``."""

    def generate(
        context: Any,
        builder: Any,
        signature: Any,
        arguments: Any,
    ) -> Any:
        pointer = ir.IntType(8).as_pointer()
        step = ir.FunctionType(ir.IntType(32), [ir.DoubleType(), pointer, pointer, pointer])
        number = builder.fptoui(arguments[0], ir.IntType(64))
        function = builder.inttoptr(number, step.as_pointer())
        state = make_array(signature.args[2])(context, builder, arguments[2]).data
        inputs = make_array(signature.args[4])(context, builder, arguments[4]).data
        places = [builder.bitcast(place, pointer) for place in (state, arguments[3], inputs)]
        return builder.call(function, [arguments[1], *places])

    return types.int32(address, t, x, memory, u), generate


# Inside compiled code: call a step at an address that a float holds, (address, t, x, memory, u).
_call_step: Any = intrinsic(_call)


def _compiled_law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    _call_step(memory.step, t, x, memory, u)


def _law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    """Call the step at the address in memory, by way of a flat copy of memory."""
    numbers = pack(memory)
    state = np.ascontiguousarray(x, float)
    _STEP(int(memory.step))(t, state.ctypes.data, numbers.ctypes.data, u.ctypes.data)
    _unpack(numbers, memory)


compiled_as(_law, jitable(_compiled_law))


def _memory(controller: Controller, address: int) -> Any:
    """Memory of a run, with the address of the step behind what the law remembers."""
    return with_fields(controller.memory(), step=float(address))


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

    def __init__(self, export: LoopInC, compiled: CompiledLaw) -> None:
        self._places = list(export.measured)
        self._compiled = compiled
        self._memory = np.zeros(size_of(export.remembered))
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

"""A compiled export as the law of simulations."""

from __future__ import annotations

import ctypes
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.export.compiler import CompiledLaw
from grosmc_mj.jitable import compiled_as, jitable
from grosmc_mj.numba_internals import make_array
from grosmc_mj.records import pack, with_fields

# int (double t, const double *x, double *memory, double *u), see ``CompiledLaw``.
_STEP = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, *[ctypes.c_void_p] * 3)


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
    unpack(numbers, memory)


def unpack(numbers: Array, memory: Any) -> None:
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


compiled_as(_law, jitable(_compiled_law))


def _memory(controller: Controller, address: int) -> Any:
    """Memory of a run, with the address of the step behind what the law remembers."""
    return with_fields(controller.memory(), step=float(address))


def controller_in_c(controller: Controller, compiled: CompiledLaw) -> Controller:
    """Return a controller with the compiled export in place of its law.

    The address stands in the memory of a run, so that code in the disk cache has none.

    Args:
        controller: Controller with the Python law.
        compiled: Its law in C, which must stay loaded as long.
    """
    memory = partial(_memory, controller, compiled.address)
    return replace(controller, law=_law, memory=memory)

"""Compiling Python functions to C ones, with a disk cache that notices every change.

numba keys its cache by one function's file and by a pickle of its closure, which differs from
process to process and misses edits of the functions that it calls. Here the key is a
fingerprint of the function and of all that it reaches.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable
from types import CodeType, FunctionType
from typing import Any

import numba
import numpy as np
from numba.core import types
from numba.core.caching import FunctionCache
from numba.core.ccallback import CFunc
from numba.extending import intrinsic


@intrinsic
def pointer(typing_context: Any, address: Any) -> Any:
    """An address held in an integer as a pointer, inside compiled code."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(address), generate


def fingerprint(function: Callable[..., Any]) -> str:
    """Hash of a function's code, of what it closes over and of the globals it uses."""
    seen: dict[int, int] = {}

    def describe(value: Any) -> str:
        if isinstance(value, FunctionType):
            if id(value) in seen:
                return f"seen {seen[id(value)]}"
            seen[id(value)] = len(seen)
            cells = [cell.cell_contents for cell in value.__closure__ or ()]
            used = [value.__globals__[n] for n in names(value.__code__) if n in value.__globals__]
            return f"{value.__qualname__}({code(value.__code__)}|{describe(cells + used)})"
        if isinstance(value, (list, tuple)):
            return f"[{','.join(describe(item) for item in value)}]"
        if isinstance(value, (int, float, str, bool, np.dtype, type(None))):
            return repr(value)
        return getattr(value, "__name__", type(value).__name__)

    def names(block: CodeType) -> list[str]:
        inner = [c for c in block.co_consts if isinstance(c, CodeType)]
        return sorted({*block.co_names, *(name for c in inner for name in names(c))})

    def code(block: CodeType) -> str:
        constants = [code(c) if isinstance(c, CodeType) else repr(c) for c in block.co_consts]
        return f"{block.co_code.hex()}{constants}{block.co_names}"

    text = f"{numba.__version__} {np.__version__} {describe(function)}"
    return hashlib.sha256(text.encode()).hexdigest()


class _FingerprintCache(FunctionCache):
    """numba's disk cache under the fingerprint of all that a function reaches."""

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (sig, codegen.magic_tuple(), fingerprint(self._py_func))


def compile_c(function: Callable[..., Any], *arguments: Any) -> CFunc:
    """Compile a function of the given numba argument types, returning nothing, to a C function.

    Division by zero gives an infinity, as in C: no exception can leave a C callback.
    """
    compiled = CFunc(function, (arguments, types.void), {}, {"error_model": "numpy"})
    # Without a folder that could hold a cache, compile each time.
    with contextlib.suppress(RuntimeError):
        compiled._cache = _FingerprintCache(function)
    compiled.compile()
    return compiled

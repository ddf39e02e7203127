"""Compiling Python functions to C ones, with a disk cache that notices every change.

numba keys its cache by one function's file and by a pickle of its closure, which differs from
process to process and misses edits of the functions that it calls. Here the key is a
fingerprint of the function and of all that it reaches.
"""

from __future__ import annotations

import contextlib
import gc
import hashlib
import os
from collections.abc import Callable, Iterator
from enum import Enum, EnumMeta
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
from numba import types

from grosmc_mj.ground.compilation.jitable import OPTIONS, source_of
from grosmc_mj.ground.compilation.numba_internals import (
    DiskCache,
    c_function,
    generator_of,
    python_function,
)
from grosmc_mj.ground.files import private_cache

# Part of each fingerprint; code on disk of an earlier format is not read.
_FORMAT = 4

# Packages whose version stands for their source.
_VERSIONED = ("math", "mujoco", "numba", "numpy")


def fingerprint(function: Callable[..., Any]) -> str:
    """Hash of the code of a function and of everything that it reaches.

    It reaches its closure, its defaults and the globals that it uses: functions count by their
    code, in turn, and other values by their value.
    """
    description = _Description().of(function)
    text = f"{_FORMAT} {OPTIONS} {numba.__version__} {np.__version__} {description}"
    return hashlib.sha256(text.encode()).hexdigest()


class _Description:
    """Text that tells functions apart, the same in every process."""

    def __init__(self) -> None:
        # A function that calls itself, or is reached twice, is described once.
        self._numbers: dict[int, int] = {}

    def of(self, value: Any) -> str:
        """Text of a value that a compiled function reaches."""
        # A compiled function counts by its source, an intrinsic by its generator.
        value = generator_of(source_of(value))

        if isinstance(value, FunctionType) and not _is_versioned(value.__module__):
            return self._of_function(value)
        if isinstance(value, (list, tuple)):
            return f"[{','.join(self.of(item) for item in value)}]"
        if isinstance(value, dict):
            return self.of([list(item) for item in value.items()])
        if isinstance(value, (np.ndarray, np.generic)):
            return f"{value.dtype}{value.shape}{value.tobytes().hex()}"
        if isinstance(value, EnumMeta):
            return self.of(list(value))
        if isinstance(value, Enum):
            return f"{value!r} {self.of(value.value)}"
        if isinstance(value, types.ExternalFunction):
            return f"{value.symbol}{value.sig}"
        if isinstance(value, types.NamedTuple):
            # Its own text has no names of members.
            return f"{value}{value.fields}{self.of(list(value.types))}"
        if isinstance(value, types.Type):
            return str(value)
        if isinstance(value, (int, float, complex, str, bytes, np.dtype, type(None))):
            return repr(value)
        return f"{type(value).__name__} {getattr(value, '__name__', '')}"

    def _of_function(self, function: FunctionType) -> str:
        """Text of a function in Python."""
        if id(function) in self._numbers:
            return f"function {self._numbers[id(function)]}"
        self._numbers[id(function)] = len(self._numbers)

        block = function.__code__
        reached = [cell.cell_contents for cell in function.__closure__ or ()]
        reached += [function.__globals__.get(name) for name in _names(block)]
        reached = [_used_of_module(item, block) for item in reached]
        text = self.of([reached, function.__defaults__, function.__kwdefaults__])
        return f"{function.__module__}.{function.__qualname__}({_code_text(block)}|{text})"


def _is_versioned(module: str) -> bool:
    """Whether the version of a package stands for its source."""
    return module.split(".")[0] in _VERSIONED


def _used_of_module(value: Any, block: CodeType) -> Any:
    """Members that code uses of a module, in place of the module; other values as they are."""
    if not isinstance(value, ModuleType) or _is_versioned(value.__name__):
        return value
    return [(name, getattr(value, name, None)) for name in _names(block)]


def _names(block: CodeType) -> list[str]:
    """Names of globals and attributes in code and in the functions inside it."""
    names = set(block.co_names)
    for constant in block.co_consts:
        if isinstance(constant, CodeType):
            names.update(_names(constant))
    return sorted(names)


def _code_text(block: CodeType) -> str:
    """Text of code: its instructions, constants and names."""
    constants = []
    for constant in block.co_consts:
        if isinstance(constant, CodeType):
            constants.append(_code_text(constant))
        else:
            constants.append(repr(constant))
    return f"{block.co_code.hex()}{constants}{block.co_names}"


def cache_folder() -> Path | None:
    """Folder of compiled code, which numba's own setting moves; None if there can be none."""
    return private_cache(os.environ.get("NUMBA_CACHE_DIR"))


def _disk_cache(function: Callable[..., Any]) -> DiskCache | None:
    """Compiled code of a function on disk; None without a folder that could hold it.

    Raises:
        SetupError: If the folder is not the user's own.
    """
    folder = cache_folder()
    if folder is None:
        return None
    return DiskCache(function, folder / "compiled", fingerprint(function))


def compile_c(function: Callable[..., Any], *arguments: Any, returns: Any = types.void) -> Any:
    """Compile a function to a C function.

    Division by zero gives an infinity, as in C: no exception can leave a C callback.

    Args:
        function: Function in the subset of Python that numba compiles.
        arguments: Types in numba of its arguments.
        returns: Type in numba of its result.

    Returns:
        The compiled function; its ``address`` is that of the C function.

    Raises:
        SetupError: If the folder of the cache is not the user's own.
    """
    compiled = c_function(function, arguments, returns, _disk_cache(function))
    with _without_collector():
        compiled.compile()
    return compiled


@contextlib.contextmanager
def _without_collector() -> Iterator[None]:
    """Suspend garbage collection, which takes a sixth of the time of a compilation."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def compile_python(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, for the types of each call.

    Raises:
        SetupError: If the folder of the cache is not the user's own.
    """
    return python_function(function, _disk_cache(function))

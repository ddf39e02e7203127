"""The private and low-level names of numba, all in this file.

The upper bound on numba's version in ``pyproject.toml`` stands for this file: read it again before
the bound is raised. What numba documents (``numba.types``, ``numba.errors``, ``numba.extending``)
is taken from numba itself.

| name | why no public one does it |
|---|---|
| ``cgutils``, ``make_array``, ``np_cfarray`` | code of arrays and members in an intrinsic |
| ``FunctionIdentity._unique_ids`` | numbers of compiled functions, which numba links by |
| ``_Cache``, ``IndexDataCacheFile``, ``CompileResult`` | a disk cache with keys of our own |
| ``CFunc``, its ``_cache`` and a dispatcher's | ``cfunc`` and ``njit`` take numba's cache only |
| ``CPUDispatcher`` | ``njit`` compiles nothing under ``NUMBA_DISABLE_JIT`` |
| ``_defn`` of an intrinsic | its generator is a part of a fingerprint |
| ``targetoptions`` of a dispatcher | a user's helper checks its indices after ``njit`` |
| ``lower_builtin``, llvmlite's ``add_symbol`` | ``x ** 3`` rounds as in Python |
"""

from __future__ import annotations

import contextlib
import ctypes
import operator
import secrets
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numba
from llvmlite import binding, ir
from numba import types
from numba.core import cgutils
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import IndexDataCacheFile, _Cache
from numba.core.ccallback import CFunc
from numba.core.compiler import CompileResult
from numba.core.imputils import lower_builtin
from numba.core.registry import CPUDispatcher
from numba.np.arrayobj import make_array, np_cfarray

__all__ = [
    "DiskCache",
    "c_function",
    "cgutils",
    "check_indices",
    "generator_of",
    "make_array",
    "np_cfarray",
    "python_function",
]

# numba numbers what it compiles from 1 in every process and puts that number into the names that
# its linker sees. Two processes can so write different functions of one name, and a third that
# loads both calls one of them for the other (numba issue 10486). Random numbers do not repeat.
_numbers: Any = iter(partial(secrets.randbits, 64), None)
FunctionIdentity._unique_ids = _numbers

# Python computes x ** y by the C library's pow; numba takes products for a whole y, and LLVM for
# pow(x, 2.0), which round otherwise. LLVM knows no function of this name.
_POW = "grosmc_mj_pow"
binding.add_symbol(_POW, ctypes.cast(ctypes.CDLL(None).pow, ctypes.c_void_p).value)


def _power(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Code of x ** y for a double x."""
    double = ir.DoubleType()
    kind = signature.args[1]
    if isinstance(kind, types.IntegerLiteral):
        exponent = ir.Constant(double, float(kind.literal_value))
    else:
        exponent = context.cast(builder, arguments[1], kind, types.float64)
    pow_type = ir.FunctionType(double, [double, double])
    function = cgutils.get_or_insert_function(builder.module, pow_type, _POW)
    return builder.call(function, [arguments[0], exponent])


for _operation in (operator.pow, operator.ipow, pow):
    for _exponent in (types.IntegerLiteral, types.int64, types.float64):
        lower_builtin(_operation, types.float64, _exponent)(_power)


class DiskCache(_Cache):
    """Compiled code of one function on disk, in files of its own.

    numba keeps one index for all functions of one name and line, and processes that write it at
    once can swap entries: all compiled laws have one name here.

    Args:
        function: Python function.
        folder: Private folder of the files: they are unpickled.
        fingerprint: Hash of all that the function reaches.
    """

    def __init__(self, function: Callable[..., Any], folder: Path, fingerprint: str) -> None:
        self._name = function.__name__
        self._folder = folder
        self._fingerprint = fingerprint
        self._file = IndexDataCacheFile(
            cache_path=str(folder),
            filename_base=f"{self._name}-{fingerprint[:32]}",
            source_stamp=fingerprint,
        )

    @property
    def cache_path(self) -> Any:
        """Folder of the files."""
        return str(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the entry of a signature, or None for one that is missing or cannot be read.

        A file may be cut off, or name a module that has gone since. The function is then compiled
        and written again.
        """
        target_context.refresh()
        try:
            parts = self._file.load(self._key(sig, target_context.codegen()))
            if parts is None:
                return None
            return CompileResult._rebuild(target_context, *parts)
        except Exception:
            with contextlib.suppress(OSError):
                Path(self._file._index_path).unlink()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write an entry; on a full disk the function is compiled anew each time."""
        if not self._can_be_loaded(data):
            return
        with contextlib.suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            self._file.save(self._key(sig, data.codegen), data._reduce())

    def _key(self, sig: Any, codegen: Any) -> Any:
        """Key of an entry: signature, processor and function."""
        return sig, codegen.magic_tuple(), self._fingerprint

    def _can_be_loaded(self, result: Any) -> bool:
        """Whether another process can load a result: it holds no address of this one."""
        # A function that calls itself does so by its address.
        symbols = result.library._final_module.global_variables
        if any(symbol.name.startswith(".numba.unresolved") for symbol in symbols):
            return False

        if result.library.has_dynamic_globals:
            warnings.warn(
                f"{self._name} is compiled in each process, as it refers to memory of its process",
                numba.errors.NumbaWarning,
                stacklevel=2,
            )
            return False
        return True

    def enable(self) -> None:
        """Do nothing: the cache is always on."""

    def disable(self) -> None:
        """Do nothing: the cache is always on."""

    def flush(self) -> None:
        """Forget the entries."""
        self._file.flush()


def c_function(
    function: Callable[..., Any],
    arguments: Any,
    returns: Any,
    cache: DiskCache | None,
) -> Any:
    """Make a C function of a Python function, which its method ``compile`` compiles.

    Division by zero gives an infinity, as in C: no exception can leave a C callback.

    Args:
        function: Function in the subset of Python that numba compiles.
        arguments: Types in numba of its arguments.
        returns: Type in numba of its result.
        cache: Its compiled code on disk.
    """
    compiled: Any = CFunc(function, (arguments, returns), {}, {"error_model": "numpy"})
    if cache is not None:
        compiled._cache = cache
    return compiled


def python_function(function: Callable[..., Any], cache: DiskCache | None) -> Any:
    """Make a function that Python calls, and that numba compiles for the types of each call.

    It is compiled under ``NUMBA_DISABLE_JIT``, too, with which ``numba.njit`` would return the
    function itself: that cannot read the fields of a structure.
    """
    compiled: Any = CPUDispatcher(function, targetoptions={"nopython": True})
    if cache is not None:
        compiled._cache = cache
    return compiled


def generator_of(value: Any) -> Any:
    """Return the Python function that generates an intrinsic; other values as they are."""
    return getattr(value, "_defn", value)


def check_indices(helper: Any) -> bool:
    """Let a function that ``numba.njit`` has compiled check its indices.

    Returns:
        Whether it has not done so before; False for any other object.
    """
    options = getattr(helper, "targetoptions", None)
    if not isinstance(options, dict) or options.get("boundscheck"):
        return False

    options["boundscheck"] = True
    if helper.signatures:
        helper.recompile()
    return True

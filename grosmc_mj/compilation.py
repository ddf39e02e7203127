"""Compiling Python functions to C ones, with a disk cache that notices every change.

numba keys its cache by one function's file and by a pickle of its closure, which differs from
process to process and misses edits of the functions that it calls. Here the key is a
fingerprint of the function and of all that it reaches.

numba also numbers what it compiles from 1 in every process and puts that number into the names
that its linker sees. Two processes can so write different functions of one name, and a third
that loads both calls one of them for the other (numba issue 10486). Here the numbers are random.
"""

from __future__ import annotations

import contextlib
import gc
import hashlib
import os
import secrets
from collections.abc import Callable, Iterator
from enum import Enum, EnumMeta
from functools import cache, partial
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, ClassVar, get_type_hints

import numba
import numpy as np
from numba.core import cgutils, types
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    _CacheLocator,
)
from numba.core.ccallback import CFunc
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, np_cfarray

from grosmc_mj.files import private_cache
from grosmc_mj.jitable import OPTIONS

_numbers: Any = iter(partial(secrets.randbits, 64), None)
FunctionIdentity._unique_ids = _numbers
# What is on disk from before the numbers were random is not read.
_FORMAT = 2

# Packages whose version stands for their source.
_VERSIONED = ("math", "mujoco", "numba", "numpy")


def _pointer(typing_context: Any, address: Any) -> Any:
    """Type and code of ``pointer``."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(address), generate


# Inside compiled code: an address held in an integer as a pointer.
pointer: Any = intrinsic(_pointer)


def _array_at(typing_context: Any, address: Any, shape: Any, dtype: Any) -> Any:
    """Type and code of ``array_at``."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        start = arguments[0]
        if address != types.voidptr:
            start = builder.inttoptr(start, context.get_value_type(types.voidptr))
        return np_cfarray(context, builder, signature, (start, arguments[1]))

    return types.Array(dtype.dtype, len(shape), "C")(address, shape, dtype), generate


# Inside compiled code: the C-ordered array of a shape and dtype at an address or pointer. It is
# ``numba.carray``, of which each use with other types takes a function and 0.05 s to compile.
array_at: Any = intrinsic(_array_at)


def _record_at(typing_context: Any, place: Any, dtype: Any) -> Any:
    """Type and code of ``record_at``."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = context.get_value_type(signature.return_type)
        if not isinstance(place, types.Array):
            return builder.inttoptr(arguments[0], pointer)
        return builder.bitcast(make_array(place)(context, builder, arguments[0]).data, pointer)

    return dtype.dtype(place, dtype), generate


# Inside compiled code: the record of a dtype at an address, or where a flat array has its numbers.
record_at: Any = intrinsic(_record_at)


def numba_type(annotation: Any) -> types.Type:
    """numba's type of a field: an integer, a real number, what ``Annotated`` says, a named tuple.

    Args:
        annotation: ``int``, ``float``, ``Annotated[..., type of numba's]`` or a ``NamedTuple``.
    """
    if annotation in (int, float):
        return types.int64 if annotation is int else types.float64
    if metadata := getattr(annotation, "__metadata__", ()):
        return metadata[0]
    hints = get_type_hints(annotation, include_extras=True)
    return types.NamedTuple([numba_type(hint) for hint in hints.values()], annotation)


def layout_of(kind: types.Type) -> Any:
    """The dtype in which Python hands such a value over: of an array its address and its shape."""
    if isinstance(kind, types.NamedTuple):
        members = zip(kind.fields, kind.types, strict=True)
        return np.dtype([(name, layout_of(member)) for name, member in members])
    if isinstance(kind, types.Array):
        return np.dtype((np.int64, (1 + kind.ndim,)))
    return np.dtype(np.float64 if kind == types.float64 else np.int64)


def laid_out(value: Any) -> Any:
    """A named tuple of numbers, addresses and arrays without gaps, as its layout holds it."""
    if isinstance(value, np.ndarray):
        return (value.ctypes.data, *value.shape)
    return tuple(map(laid_out, value)) if isinstance(value, tuple) else value


@cache
def _layout(kind: type) -> Any:
    return layout_of(numba_type(kind))


def laid_out_as(kind: type, value: Any) -> np.ndarray[Any, Any]:
    """A named tuple of this class in memory, (1,), which refers to the value's arrays.

    Args:
        kind: The class.
        value: With addresses of functions; members may be laid out already.
    """
    return np.array([laid_out(value)], _layout(kind))


def structure_at(kind: types.Type) -> Any:
    """Inside compiled code: the value of this type whose layout is at an address."""

    def load(context: Any, builder: Any, kind: Any, place: Any) -> Any:
        if isinstance(kind, types.NamedTuple):
            places = [layout_of(kind).fields[name][1] for name in kind.fields]
            members = [
                load(context, builder, member, cgutils.pointer_add(builder, place, offset))
                for member, offset in zip(kind.types, places, strict=True)
            ]
            return context.make_tuple(builder, kind, members)
        if isinstance(kind, types.Array):
            words = [cgutils.pointer_add(builder, place, 8 * k) for k in range(1 + kind.ndim)]
            address, *shape = [load(context, builder, types.int64, word) for word in words]
            start = builder.inttoptr(address, context.get_value_type(types.voidptr))
            shape_type = types.UniTuple(types.int64, kind.ndim)
            lengths = context.make_tuple(builder, shape_type, shape)
            signature = kind(types.voidptr, shape_type)
            return np_cfarray(context, builder, signature, (start, lengths))
        if isinstance(kind, types.FunctionType):
            function = cgutils.create_struct_proxy(kind)(context, builder)
            address = load(context, builder, types.int64, place)
            function.c_addr = builder.inttoptr(address, function.c_addr.type)
            return function._getvalue()
        return builder.load(builder.bitcast(place, context.get_value_type(kind).as_pointer()))

    def typed(typing_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return load(context, builder, kind, arguments[0])

        return kind(types.voidptr), generate

    return intrinsic(typed)


def fingerprint(function: Callable[..., Any]) -> str:
    """Hash of a function's code and of all that it reaches.

    That is what it closes over, its defaults and the globals that it uses: functions by their
    code, in turn, and values by their value.
    """
    seen: dict[int, int] = {}

    def describe(value: Any) -> str:
        # A compiled function stands for its source, an intrinsic for its generator.
        value = getattr(value, "py_func", getattr(value, "_defn", value))
        if isinstance(value, FunctionType) and value.__module__.split(".")[0] not in _VERSIONED:
            if id(value) in seen:
                return f"seen {seen[id(value)]}"
            seen[id(value)] = len(seen)
            block, scope = value.__code__, value.__globals__
            used = [cell.cell_contents for cell in value.__closure__ or ()]
            used += [scope.get(name) for name in names(block)]
            used = [opened(item, block) for item in used]
            reached = describe([used, value.__defaults__, value.__kwdefaults__])
            return f"{value.__module__}.{value.__qualname__}({code(block)}|{reached})"
        if isinstance(value, (list, tuple)):
            return f"[{','.join(describe(item) for item in value)}]"
        if isinstance(value, dict):
            return describe([list(item) for item in value.items()])
        if isinstance(value, (np.ndarray, np.generic)):
            return f"{value.dtype}{value.shape}{value.tobytes().hex()}"
        if isinstance(value, EnumMeta):
            return describe(list(value))
        if isinstance(value, Enum):
            return f"{value!r} {describe(value.value)}"
        if isinstance(value, types.ExternalFunction):
            return f"{value.symbol}{value.sig}"
        if isinstance(value, types.Type):
            return str(value)
        if isinstance(value, (int, float, complex, str, bytes, np.dtype, type(None))):
            return repr(value)
        return f"{type(value).__name__} {getattr(value, '__name__', '')}"

    def opened(value: Any, block: CodeType) -> Any:
        """What a function uses of a module, in place of the module."""
        if isinstance(value, ModuleType) and value.__name__.split(".")[0] not in _VERSIONED:
            return [(name, getattr(value, name, None)) for name in names(block)]
        return value

    def names(block: CodeType) -> list[str]:
        inner = [c for c in block.co_consts if isinstance(c, CodeType)]
        return sorted({*block.co_names, *(name for c in inner for name in names(c))})

    def code(block: CodeType) -> str:
        constants = [code(c) if isinstance(c, CodeType) else repr(c) for c in block.co_consts]
        return f"{block.co_code.hex()}{constants}{block.co_names}"

    text = f"{_FORMAT} {OPTIONS} {numba.__version__} {np.__version__} {describe(function)}"
    return hashlib.sha256(text.encode()).hexdigest()


def _cache() -> Path | None:
    """The folder of compiled code, which numba's own setting moves."""
    return private_cache(os.environ.get("NUMBA_CACHE_DIR"))


class _PrivateFolder(_CacheLocator):
    """Tells numba to keep its cache in the package's own: what it reads there it unpickles."""

    def __init__(self, folder: Path, source: str) -> None:
        self._folder = folder
        # numba names it where it says that something cannot be kept.
        self._py_file = source

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _PrivateFolder | None:
        """The place for any function, or None where there is none."""
        folder = _cache()
        return None if folder is None else cls(folder / "compiled", py_file)

    def get_cache_path(self) -> Any:
        """Where the files lie."""
        return str(self._folder)

    def get_source_stamp(self) -> None:
        """Nothing: a fingerprint says whether an entry is fresh."""

    def get_disambiguator(self) -> None:
        """Nothing: a fingerprint tells functions of one name apart."""


class _Reduced(CompileResultCacheImpl):
    """How numba writes a compiled function, in our folder only."""

    _locator_classes: ClassVar[list[type[_CacheLocator]]] = [_PrivateFolder]

    def check_cachable(self, cres: Any) -> bool:
        """Whether it can be loaded again: not what calls itself, by an address of this process."""
        symbols = cres.library._final_module.global_variables
        recursive = any(symbol.name.startswith(".numba.unresolved") for symbol in symbols)
        return not recursive and super().check_cachable(cres)


class _FingerprintCache(FunctionCache):
    """numba's disk cache with a file of its own for each fingerprint.

    numba keeps one index for all functions of one name and line, and processes that write it at
    once can swap entries: all the closed loops here have one name.
    """

    _impl_class = _Reduced

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._fingerprint = fingerprint(function)
        self._cache_file = IndexDataCacheFile(
            cache_path=self._cache_path,
            filename_base=f"{function.__name__}-{self._fingerprint[:32]}",
            source_stamp=self._fingerprint,
        )

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (sig, codegen.magic_tuple(), self._fingerprint)

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        """The entry, or None for one that cannot be read: it is compiled and written again.

        It may be cut off, or name a module that has gone since.
        """
        try:
            return super()._load_overload(sig, target_context)
        except Exception:
            with contextlib.suppress(OSError):
                Path(self._cache_file._index_path).unlink()
            return None

    def _save_overload(self, sig: Any, data: Any) -> None:
        """Write an entry; on a full disk it is compiled anew each time."""
        with contextlib.suppress(OSError):
            super()._save_overload(sig, data)


def compile_c(function: Callable[..., Any], *arguments: Any, returns: Any = types.void) -> Any:
    """Compile a function of the given numba argument types to a C function.

    Division by zero gives an infinity, as in C: no exception can leave a C callback.

    Raises:
        SetupError: If the folder of the cache is not the user's own.
    """
    compiled: Any = CFunc(function, (arguments, returns), {}, {"error_model": "numpy"})
    # Without a folder that could hold a cache, compile each time.
    if _cache() is not None:
        compiled._cache = _FingerprintCache(function)
    with _without_collector():
        compiled.compile()
    return compiled


@contextlib.contextmanager
def _without_collector() -> Iterator[None]:
    """Leave the garbage be: a compilation makes little, and looking for it takes a sixth of it."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def compile_python(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, for whatever types it is called with.

    Raises:
        SetupError: If the folder of the cache is not the user's own.
    """
    compiled: Any = numba.njit(function)
    if _cache() is not None:
        compiled._cache = _FingerprintCache(function)
    return compiled

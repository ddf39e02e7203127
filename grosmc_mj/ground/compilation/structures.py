"""Structures in memory: Python lays them out, compiled code reads them at their address.

A ``NamedTuple`` of numbers, arrays, functions and further named tuples is laid out as a NumPy
structure: an array as its address and its shape, a function as its address. The functions below
that are called "inside compiled code" are intrinsics of numba and work nowhere else.

Structures refer to arrays, and records (``records.py``) contain them; one function cannot lay out
both. The layout of a structure follows from its class alone: shapes are numbers in it, so one
kernel, compiled before there is any run, serves all plants and laws. The layout of a record follows
from a value: the shapes of its arrays are constants of its type, for which a law is compiled. With
shapes as constants, the kernel would be compiled, for seconds, for each n and m; with references, a
law would read an address and a shape for each of its matrices at each sample.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Annotated, Any, get_type_hints

import numpy as np
from numba import types
from numba.extending import intrinsic

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.numba_internals import cgutils, make_array, np_cfarray

# Arrays of floats as members of a structure.
VECTOR = types.Array(types.float64, 1, "C")
Vector = Annotated[Array, VECTOR]
Matrix = Annotated[Array, types.Array(types.float64, 2, "C")]


def _pointer(typing_context: Any, address: Any) -> Any:
    """Type and code of ``pointer``."""

    def generate(
        context: Any,
        builder: Any,
        signature: Any,
        arguments: Any,
    ) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(address), generate


# Inside compiled code: the pointer for an address that an integer holds.
pointer: Any = intrinsic(_pointer)


def _array_at(
    typing_context: Any,
    address: Any,
    shape: Any,
    dtype: Any,
) -> Any:
    """Type and code of ``array_at``."""

    def generate(
        context: Any,
        builder: Any,
        signature: Any,
        arguments: Any,
    ) -> Any:
        start = arguments[0]
        if address != types.voidptr:
            start = builder.inttoptr(start, context.get_value_type(types.voidptr))
        return np_cfarray(context, builder, signature, (start, arguments[1]))

    return types.Array(dtype.dtype, len(shape), "C")(address, shape, dtype), generate


# Inside compiled code: the C-ordered array of a shape and dtype at an address or pointer. It does
# the work of ``numba.carray``, which compiles a function, 0.05 s, for each new shape and dtype.
array_at: Any = intrinsic(_array_at)


def _record_at(typing_context: Any, place: Any, dtype: Any) -> Any:
    """Type and code of ``record_at``."""

    def generate(
        context: Any,
        builder: Any,
        signature: Any,
        arguments: Any,
    ) -> Any:
        pointer = context.get_value_type(signature.return_type)
        if not isinstance(place, types.Array):
            return builder.inttoptr(arguments[0], pointer)
        return builder.bitcast(make_array(place)(context, builder, arguments[0]).data, pointer)

    return dtype.dtype(place, dtype), generate


# Inside compiled code: the record of a dtype at an address, or in the memory of a flat array.
record_at: Any = intrinsic(_record_at)


def _local_copy(typing_context: Any, array: Any, count: Any) -> Any:
    """Type and code of ``local_copy``."""
    copy_type = types.Array(array.dtype, 1, "C")
    shape_type = types.UniTuple(types.intp, 1)
    size = count.literal_value

    def generate(
        context: Any,
        builder: Any,
        signature: Any,
        arguments: Any,
    ) -> Any:
        source = make_array(array)(context, builder, arguments[0]).data
        target = cgutils.alloca_once(builder, context.get_value_type(array.dtype), size=size)
        for k in range(size):
            value = builder.load(cgutils.gep_inbounds(builder, source, k))
            builder.store(value, cgutils.gep_inbounds(builder, target, k))

        start = builder.bitcast(target, context.get_value_type(types.voidptr))
        shape = context.make_tuple(builder, shape_type, [arguments[1]])
        return np_cfarray(context, builder, copy_type(types.voidptr, shape_type), (start, shape))

    return copy_type(array, count), generate


# Inside compiled code: a copy on the stack of the first ``count`` entries of a flat array, with
# ``count`` a constant. The compiler knows that no store to another array changes it, so it computes
# sin(x) once where a law uses it three times.
local_copy: Any = intrinsic(prefer_literal=True)(_local_copy)


# A batch lays out a run for each thread and model: reading the annotations takes 0.4 ms.
@cache
def _layout_of_class(kind: type) -> np.dtype[Any]:
    """Layout of a class of named tuples."""
    return _layout(_numba_type(kind))


def _numba_type(annotation: Any) -> Any:
    """Type in numba of a field.

    Args:
        annotation: ``int``, ``float``, ``Annotated[..., type of numba's]`` or a ``NamedTuple``.
    """
    if annotation is int:
        return types.int64
    if annotation is float:
        return types.float64

    metadata = getattr(annotation, "__metadata__", ())
    if metadata:
        return metadata[0]

    fields = get_type_hints(annotation, include_extras=True)
    return types.NamedTuple([_numba_type(field) for field in fields.values()], annotation)


def _layout(kind: types.Type) -> np.dtype[Any]:
    """Dtype in which Python hands over a value of a type of numba's."""
    if isinstance(kind, types.NamedTuple):
        members = zip(kind.fields, kind.types, strict=True)
        return np.dtype([(name, _layout(member)) for name, member in members])
    if isinstance(kind, types.Array):
        # Address and shape.
        return np.dtype((np.int64, (1 + kind.ndim,)))
    if kind == types.float64:
        return np.dtype(np.float64)
    return np.dtype(np.int64)


def laid_out(value: Any) -> Any:
    """Numbers that stand for a value in its layout: of an array its address and its shape."""
    if isinstance(value, np.ndarray):
        return (value.ctypes.data, *value.shape)
    if isinstance(value, tuple):
        return tuple(laid_out(member) for member in value)
    return value


def structure_of(value: Any) -> np.ndarray[Any, Any]:
    """Structure of a named tuple in memory, (1,); it refers to the arrays of the value.

    Args:
        value: Named tuple with addresses of functions; members may be laid out already.
    """
    return np.array([laid_out(value)], _layout_of_class(type(value)))


def structure_at(structure: type) -> Any:
    """Make a function for compiled code: from an address to the value that is laid out there.

    Args:
        structure: Class of the named tuple.
    """
    kind = _numba_type(structure)
    return _reader(kind, lambda context, builder, place: _load(context, builder, kind, place))


def members_at(structure: type, *names: str) -> Any:
    """Make a function for compiled code: from an address to a tuple of some members.

    A call of such a function with few members costs little; a whole run has forty.

    Args:
        structure: Class of the named tuple that is laid out at the address.
        names: Names of the members that are read, at least one; ``plant.u`` is the member u of
            the member plant.
    """
    kind = _numba_type(structure)
    places = [_place_of(kind, name.split(".")) for name in names]
    tuple_type = types.Tuple([member_type for _, member_type in places])

    def load(context: Any, builder: Any, place: Any) -> Any:
        members = []
        for offset, member_type in places:
            member_place = cgutils.pointer_add(builder, place, offset)
            members.append(_load(context, builder, member_type, member_place))
        return context.make_tuple(builder, tuple_type, members)

    return _reader(tuple_type, load)


def _place_of(kind: Any, names: Sequence[str]) -> tuple[int, Any]:
    """Offset [byte] and type of a member, by its name and those of the members that it is in.

    The offset is a plain number, for compiled code is kept on disk under what it reaches.
    """
    offset = 0
    for name in names:
        fields: Any = _layout(kind).fields
        offset += fields[name][1]
        kind = kind.types[kind.fields.index(name)]
    return offset, kind


def _reader(result: Any, load: Callable[[Any, Any, Any], Any]) -> Any:
    """Intrinsic from an address to a value of a type, by a generator of code that loads it."""

    def typed(typing_context: Any, address: Any) -> Any:
        def generate(
            context: Any,
            builder: Any,
            signature: Any,
            arguments: Any,
        ) -> Any:
            return load(context, builder, arguments[0])

        return result(types.voidptr), generate

    return intrinsic(typed)


def _load(
    context: Any,
    builder: Any,
    kind: Any,
    place: Any,
) -> Any:
    """Code that loads the value of a type from where its layout begins."""
    if isinstance(kind, types.NamedTuple):
        fields: Any = _layout(kind).fields
        members = []
        for name, member_type in zip(kind.fields, kind.types, strict=True):
            member_place = cgutils.pointer_add(builder, place, fields[name][1])
            members.append(_load(context, builder, member_type, member_place))
        return context.make_tuple(builder, kind, members)

    if isinstance(kind, types.Array):
        return _load_array(context, builder, kind, place)

    if isinstance(kind, types.FunctionType):
        function = cgutils.create_struct_proxy(kind)(context, builder)
        address = _load(context, builder, types.int64, place)
        function.c_addr = builder.inttoptr(address, function.c_addr.type)
        return function._getvalue()

    return builder.load(builder.bitcast(place, context.get_value_type(kind).as_pointer()))


def _load_array(
    context: Any,
    builder: Any,
    kind: Any,
    place: Any,
) -> Any:
    """Code that makes an array of the address and the shape that lie at a place."""
    words = []
    for k in range(1 + kind.ndim):
        word_place = cgutils.pointer_add(builder, place, 8 * k)
        words.append(_load(context, builder, types.int64, word_place))

    start = builder.inttoptr(words[0], context.get_value_type(types.voidptr))
    shape_type = types.UniTuple(types.int64, kind.ndim)
    shape = context.make_tuple(builder, shape_type, words[1:])
    return np_cfarray(context, builder, kind(types.voidptr, shape_type), (start, shape))

"""Structures that Python lays out and compiled code reads at their address."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import types

from grosmc_mj.ground.compilation.compiler import compile_c
from grosmc_mj.ground.compilation.structures import (
    Matrix,
    Vector,
    members_at,
    structure_at,
    structure_of,
)


class Inner(NamedTuple):
    """A member with members of its own."""

    scale: float
    q: Vector
    M: Matrix


class Outer(NamedTuple):
    """A structure with members in front of the inner ones and behind them."""

    number: int
    x: Vector
    inner: Inner
    y: Vector


def outer() -> Outer:
    inner = Inner(3.0, np.array([1.0, 2.0]), np.arange(6.0).reshape(2, 3))
    return Outer(7, np.zeros(1), inner, np.zeros(2))


def read_by_names(address: Any) -> None:
    x, scale, M, q = MEMBERS(address)
    x[0] = scale * M[1, 2] + q[1]


def read_whole(address: Any) -> None:
    value = WHOLE(address)
    value.x[0] = value.inner.scale * value.inner.M[1, 2] + value.inner.q[1]


MEMBERS = members_at(Outer, "x", "inner.scale", "inner.M", "inner.q")
WHOLE = structure_at(Outer)


@pytest.mark.parametrize("read", [read_by_names, read_whole])
def test_members_of_a_member_are_read_at_their_place(read: Any) -> None:
    value = outer()
    structure = structure_of(value)
    function = compile_c(read, types.voidptr)
    function.ctypes(structure.ctypes.data)
    assert value.x[0] == 3.0 * 5.0 + 2.0

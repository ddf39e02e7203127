"""A law of somebody else's, weighed by the index of a design of ours."""

from __future__ import annotations

import keyword
from collections.abc import Mapping
from dataclasses import make_dataclass
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.arguments import require
from grosmc_mj.control.controller import Controller, Design
from grosmc_mj.control.coordinates.base import OutputCoordinates
from grosmc_mj.control.laws import Coordinates, Law
from grosmc_mj.control.memory import Memory
from grosmc_mj.control.vectors import algebra, each
from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.jitable import jitable


def custom_controller(
    name: str, law: Law, like: Controller, numbers: Mapping[str, Any] | None = None
) -> Controller:
    """A controller of any law, judged against the optimum of another one.

    Args:
        name: What it is called.
        law: (t, x, memory, p) -> u, a number or, for several inputs, a tuple.
        like: A controller with error coordinates and an optimum, whose index weighs this one.
        numbers: Fields of p besides ``plant`` and ``reference``: numbers and arrays.

    Raises:
        ArgumentError: If ``like`` has no optimum.
    """
    require("name", name, str, "a text")
    require("like", like, Controller, "a controller with an optimum, such as chapter_controller's")
    require("numbers", {} if numbers is None else numbers, Mapping, "numbers by their names")
    if not callable(law):
        raise ArgumentError(f"{name}: law = {shown(law)} must be a function (t, x, memory, p) -> u")
    design = like.designed
    given = {"plant": like.parameters.plant, "reference": like.parameters.reference}
    for key in numbers or {}:
        if (
            not isinstance(key, str)
            or not key.isidentifier()
            or keyword.iskeyword(key)
            or key in given
        ):
            raise ArgumentError(f"{key!r} cannot be the name of a law's number: take another")
    fields = {**given, **(numbers or {})}
    parameters = make_dataclass("Parameters", list(fields), frozen=True, eq=False)(**fields)
    return Controller(
        name=name,
        law=_weighed(law, design.error, design.linearizing),
        parameters=parameters,
        memory=_Fresh(design.error.inputs),
        design=Design(
            design.error,
            design.lqr,
            source="a law of one's own",
            gains={key: float(v) for key, v in (numbers or {}).items() if np.ndim(v) == 0},
            linearizing=design.linearizing,
        ),
    )


class _Fresh:
    """Makes the memory of a run of m inputs."""

    def __init__(self, m: int) -> None:
        self._m = m

    def __call__(self) -> Memory:
        return Memory(v=np.zeros(self._m))


@cache
def _weighed(law: Law, error: Coordinates, linearizing: bool) -> Law:
    """The law, which notes what the index weighs: u, or v = alpha + E u of eqs. (24) and (45).

    What it returns has the law itself as ``own``, and (t, x, memory, p, u) that notes as ``note``:
    Python looks at u between the two.
    """
    own, m = jitable(law), error.inputs
    store = algebra(m).store
    vector = _as_vector(m)
    if linearizing:
        assert isinstance(error, OutputCoordinates)
        weigh = error.driven

        @jitable
        def note(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
            store(memory.v, weigh(t, x, vector(u), memory, p))

    else:

        @jitable
        def note(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
            store(memory.v, vector(u))

    def noting(t: float, x: Any, memory: Any, p: Any) -> Any:
        u = own(t, x, memory, p)
        note(t, x, memory, p, u)
        return u

    made: Any = noting
    made.own, made.note = own, note
    return noting


@cache
def _as_vector(m: int) -> Any:
    """What a law returned, as a tuple."""
    if m == 1:
        return jitable(lambda u: (u,))
    return each(m, lambda i, u: u[i])

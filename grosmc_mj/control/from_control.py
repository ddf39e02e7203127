"""A controller designed with python-control, run as it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Annotated, Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, custom_controller
from grosmc_mj.control.laws import Coordinates, Law
from grosmc_mj.errors import ArgumentError
from grosmc_mj.fields import Is, Name, Range, checked_call
from grosmc_mj.vectors import algebra, each


@checked_call
def from_control(
    sys: Any,
    period: Annotated[float, Range(0, unit="s", above=True)],
    like: Annotated[Controller, Is(Controller, "a controller, such as chapter_controller's")],
    name: Name = "from_control",
) -> Controller:
    """A linear controller of python-control as a law, in both engines.

    It sees the errors e = y_r - y of the outputs that ``like`` regulates, and gives the plant's
    input, about the operating point if ``like`` has one:

        q+ = A q + B e,   u = C q + D e.

    Args:
        sys: A ``control.StateSpace`` or ``control.TransferFunction``: discrete with this sampling
            time, or continuous, which Tustin's rule then samples.
        period: Control period [s]; a run with another one is refused.
        like: A controller whose outputs it regulates and whose index weighs it.
        name: What it is called.

    Raises:
        ArgumentError: If it is no such system, has another sampling time, or its inputs and
            outputs are not as many as the plant's outputs and inputs.
    """
    if not is_linear_system(sys):
        raise ArgumentError(
            f"{name} is a {type(sys).__name__}, must be a StateSpace or TransferFunction of "
            "python-control"
        )
    error, found = like.designed.error, _sampled(sys, period, name)
    outputs, inputs = len(error.output_rows), error.inputs
    if (shape := found["D"].shape) != (inputs, outputs):
        raise ArgumentError(
            f"{name} has {shape[1]} inputs and {shape[0]} outputs, must see "
            f"{outputs} errors and give {inputs} inputs of {error.system.name}"
        )
    order = len(found["A"])
    law = custom_controller(name, _law(error, order), like, found, {"q": np.zeros(order)})
    design = replace(law.designed, source="python-control", control_period=period)
    return replace(law, design=design)


def is_linear_system(found: Any) -> bool:
    """Whether something is a state space or a transfer function of python-control."""
    kinds = {f"{kind.__module__.split('.')[0]}.{kind.__name__}" for kind in type(found).__mro__}
    return bool(kinds & {"control.StateSpace", "control.TransferFunction"})


def _sampled(sys: Any, period: float, name: str) -> dict[str, Array]:
    """The matrices at a sampling time; a static gain gets one state, of zeros."""
    import control

    continuous = sys.dt in (0, None)
    if not continuous and sys.dt is not True and not math.isclose(sys.dt, period, rel_tol=1e-9):
        raise ArgumentError(
            f"{name} has a sampling time of {sys.dt:g} s, the control period is {period:g} s"
        )
    # A transfer function of several inputs needs slycot for this; an improper one has none.
    try:
        found = control.sample_system(sys, period, method="tustin") if continuous else sys
        made: Any = control.ss(found)
    except (ImportError, ValueError, control.ControlMIMONotImplemented) as error:
        raise ArgumentError(
            f"{name}: its state space cannot be made ({' '.join(str(error).split())}): of an "
            "improper one, such as a PD, filter the derivative; of several inputs give a StateSpace"
        ) from None
    A, B, C, D = (np.asarray(part, float) for part in (made.A, made.B, made.C, made.D))
    if not len(A):
        A, B, C = np.zeros((1, 1)), np.zeros((1, D.shape[1])), np.zeros((D.shape[0], 1))
    return {key: np.ascontiguousarray(M) for key, M in zip("ABCD", (A, B, C, D), strict=True)}


@cache
def _law(error: Coordinates, order: int) -> Law:
    """The law of a state space of that order on some error coordinates."""
    error_state, applied, m = error.state, error.applied, error.inputs
    rows, sign = tuple(error.output_rows), float(error.sign)
    seen = len(rows)
    errors = each(seen, lambda i, z: -sign * z[rows[i]])
    given = algebra(m).given

    def entry(i: int, M: Any, q: Any, N: Any, e: Any) -> float:
        total = 0.0
        for j in range(order):
            total += M[i, j] * q[j]
        for j in range(seen):
            total += N[i, j] * e[j]
        return total

    output: Callable[..., Any] = each(m, entry)
    following: Callable[..., Any] = each(order, entry)

    def law(t: float, x: Any, memory: Any, p: Any) -> Any:
        e = errors(error_state(t, x, p))
        v = output(p.C, memory.q, p.D, e)
        after = following(p.A, memory.q, p.B, e)
        for i in range(order):
            memory.q[i] = after[i]
        return given(applied(v, p))

    return law

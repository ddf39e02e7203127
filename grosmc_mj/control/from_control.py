"""A controller designed with python-control, run as it is."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, custom_controller
from grosmc_mj.control.rivals.dynamic_feedback import Dynamics, dynamic_feedback
from grosmc_mj.errors import ArgumentError
from grosmc_mj.fields import Is, Name, Range, checked_call


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
    error, system = like.designed.error, _sampled(sys, period, name)
    outputs, inputs = len(error.output_rows), error.inputs
    if (shape := system["D"].shape) != (inputs, outputs):
        raise ArgumentError(
            f"{name} has {shape[1]} inputs and {shape[0]} outputs, must see "
            f"{outputs} errors and give {inputs} inputs of {error.system.name}"
        )
    order = len(system["A"])
    # e = C z of the outputs' errors, with their sign.
    C = -float(error.sign) * np.eye(error.size)[list(error.output_rows)]
    dynamics = Dynamics(
        K=-system["D"] @ C,
        H=-system["C"],
        F=system["A"],
        G=system["B"] @ C,
        L=np.zeros((order, inputs)),
        start=np.zeros((order, error.size)),
    )
    sizes = {"z": error.size, "q": order, "after": order, "within": inputs, "applied": inputs}
    memory = {field: np.zeros(size) for field, size in sizes.items()}
    own = dynamic_feedback(error, linearizing=False, holds=False)
    law = custom_controller(name, own, like, {"dynamics": dynamics, "limit": math.inf}, memory)
    source = {"source": "python-control", "gains": {}, "control_period": period}
    return replace(law, design=replace(law.designed, **source))


def is_linear_system(value: Any) -> bool:
    """Whether something is a state space or a transfer function of python-control."""
    kinds = {f"{kind.__module__.split('.')[0]}.{kind.__name__}" for kind in type(value).__mro__}
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
        sampled = control.sample_system(sys, period, method="tustin") if continuous else sys
        system: Any = control.ss(sampled)
    except (ImportError, ValueError, control.ControlMIMONotImplemented) as error:
        raise ArgumentError(
            f"{name}: its state space cannot be made ({' '.join(str(error).split())}): of an "
            "improper one, such as a PD, filter the derivative; of several inputs give a StateSpace"
        ) from None
    A, B, C, D = (np.asarray(part, float) for part in (system.A, system.B, system.C, system.D))
    if not len(A):
        A, B, C = np.zeros((1, 1)), np.zeros((1, D.shape[1])), np.zeros((D.shape[0], 1))
    return {key: np.ascontiguousarray(M) for key, M in zip("ABCD", (A, B, C, D), strict=True)}

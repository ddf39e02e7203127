"""Controllers designed with python-control, run unchanged."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import Is, Name, Range, checked_call
from grosmc_mj.theory.control.controller import Controller, noting_controller
from grosmc_mj.theory.control.coordinates.base import Coordinates
from grosmc_mj.theory.control.dynamic_feedback import (
    DynamicMemory,
    DynamicParameters,
    Dynamics,
    dynamic_feedback,
)
from grosmc_mj.theory.control.memory import memory_of


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
        period: Control period [s]; a run with another period is refused.
        like: A controller whose outputs it regulates and whose index weighs it.
        name: Name of the controller.

    Raises:
        ArgumentError: If it is no such system, has another sampling time, or its inputs and
            outputs are not as many as the plant's outputs and inputs.
    """
    if not is_linear_system(sys):
        raise ArgumentError(
            f"{name} is a {type(sys).__name__}, must be a StateSpace or TransferFunction of "
            "python-control"
        )

    error = like.designed.error
    A, B, C, D = _sampled(sys, period, name)
    _require_sizes(name, D, error)

    # The outputs' errors are e = E z, with their sign.
    output_rows = list(error.output_rows)
    E = -float(error.sign) * np.eye(error.size)[output_rows]
    order = len(A)
    inputs = error.inputs
    dynamics = Dynamics(
        K=-D @ E,
        H=-C,
        F=A,
        G=B @ E,
        L=np.zeros((order, inputs)),
        start=np.zeros((order, error.size)),
    )
    controller = noting_controller(
        name,
        dynamic_feedback(error, linearizing=False, holds=False),
        like,
        DynamicParameters(
            plant=like.parameters.plant, reference=like.parameters.reference, dynamics=dynamics
        ),
        memory_of(DynamicMemory, m=inputs, n=error.size, order=order),
        source="python-control",
        gains={},
    )
    return replace(controller, design=replace(controller.designed, control_period=period))


def is_linear_system(value: Any) -> bool:
    """Whether a value is a state space or a transfer function of python-control."""
    # By name: python-control takes long to import.
    for kind in type(value).__mro__:
        package = kind.__module__.split(".")[0]
        if package == "control" and kind.__name__ in ("StateSpace", "TransferFunction"):
            return True
    return False


def _require_sizes(name: str, D: Array, error: Coordinates) -> None:
    """Refuse a system whose inputs and outputs are not as many as the plant's outputs and inputs.

    Args:
        name: Name of the controller.
        D: Its direct gain, (its outputs, its inputs).
        error: Error coordinates of the plant.
    """
    outputs = len(error.output_rows)
    inputs = error.inputs
    if D.shape != (inputs, outputs):
        raise ArgumentError(
            f"{name} has {D.shape[1]} inputs and {D.shape[0]} outputs, must see "
            f"{outputs} errors and give {inputs} inputs of {error.system.name}"
        )


def _sampled(sys: Any, period: float, name: str) -> tuple[Array, Array, Array, Array]:
    """A, B, C and D at a sampling time; a static gain gets one state, of zeros."""
    import control

    continuous = sys.dt in (0, None)
    # python-control's True stands for a discrete system with any sampling time.
    fits = continuous or sys.dt is True or math.isclose(sys.dt, period, rel_tol=1e-9)
    if not fits:
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

    A, B, C, D = (
        np.ascontiguousarray(np.asarray(matrix, float)) for matrix in control.ssdata(system)
    )
    if len(A) == 0:
        outputs, inputs = D.shape
        A = np.zeros((1, 1))
        B = np.zeros((1, inputs))
        C = np.zeros((outputs, 1))
    return A, B, C, D

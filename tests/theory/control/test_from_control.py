"""Controllers of python-control as laws: its own simulation is the oracle."""

from __future__ import annotations

from typing import Any

import control
import numpy as np
import pytest
from shipped import REGULATION, task_of

import grosmc_mj as gm
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.kinds.fl_lqr import FlLqr
from grosmc_mj.theory.control.kinds.lqr import Lqr

PERIOD = 5e-3
LAG: Any = control.tf([2.0, 3.0], [0.1, 1.0])
SAMPLED = control.ss([[0.9]], [[0.5]], [[-2.0]], [[1.5]], PERIOD)
# Discrete at any sampling time, and a static gain, which has none.
ANY_PERIOD = control.ss([[0.9]], [[0.5]], [[-2.0]], [[1.5]], True)
GAIN: Any = control.tf([2.0], [1.0], dt=None)
SAMPLED_GAIN = control.ss([[0.0]], [[0.0]], [[0.0]], [[2.0]], PERIOD)
# Two outputs and inputs that are coupled.
COUPLED = control.ss(
    [[0.9, 0.1], [-0.2, 0.8]], [[1, 0.2], [0, 1]], [[3, 1], [-1, 2]], [[5, 1], [0, 4]], PERIOD
)


def like(design: str) -> Controller:
    task = task_of(design)
    return Lqr().design(task) if design == "servo" else FlLqr().design(task)


@pytest.mark.parametrize(
    ("design", "sys", "sampled"),
    [
        ("servo", SAMPLED, SAMPLED),
        ("servo", ANY_PERIOD, SAMPLED),
        ("servo", GAIN, SAMPLED_GAIN),
        ("servo", LAG, control.sample_system(LAG, PERIOD, method="tustin")),
        (REGULATION, COUPLED, COUPLED),
    ],
)
def test_inputs_are_python_control_s_for_the_errors_of_the_run(
    design: str, sys: Any, sampled: Any
) -> None:
    """Errors e = y_r - y at the samples; continuous systems are sampled by Tustin's rule."""
    law = gm.from_control(sys, PERIOD, like(design))
    start = [0.4, -0.2] if design == "servo" else [0.5, -2.0, 0.1, 0.0]
    task = task_of(design)
    run = gm.simulate(
        task.plant,
        law,
        start,
        duration=0.1,
        control_period=PERIOD,
        timestep=PERIOD,
        engine="python",
    )
    y_r = np.array(task.outputs.reference(0.0, task.reference))[::3]
    errors: Any = y_r[:, None] - run.state[:-1, : len(y_r)].T
    expected = control.forced_response(control.ss(sampled), inputs=errors, squeeze=False).outputs
    np.testing.assert_allclose(run.input.reshape(len(errors[0]), -1).T, expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("sys", "words"),
    [
        (3.0, "is a float, must be a StateSpace or TransferFunction of python-control"),
        (control.ss(1, 1, 1, 1, 1e-3), "sampling time of 0.001 s, the control period is 0.005 s"),
        (COUPLED, "has 2 inputs and 2 outputs, must see 1 errors and give 1 inputs of servo"),
        (control.tf([1, 0], [1]), "of an improper one, such as a PD, filter the derivative"),
    ],
)
def test_a_system_that_does_not_fit_is_refused(sys: Any, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        gm.from_control(sys, PERIOD, like("servo"))

"""Prediction while what is seen is younger than the sensors' age: it still is the start."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from looped import H, nominal, seen, servo

from grosmc_mj.control.controller import custom_controller
from grosmc_mj.loop import Computing, Loop, Sensor, in_loop
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.simulate import simulate


def angle(t: float, x: Any, memory: Any, p: Any) -> float:
    """A law that tells the angle which it was given."""
    return x[0]


@pytest.mark.parametrize(("delay", "age"), [(0, 4), (2, 3), (3, 1)])
def test_a_moving_start_is_predicted_as_well_as_all_later_samples(delay: int, age: int) -> None:
    """To when the output arrives, by the midpoint rule: a step errs by h^3 |A^2 x'| / 6."""
    law = custom_controller("angle", angle, nominal().law("corrected", "lqr"))
    loop = Loop(
        Computing(delay=delay * H), tuple(Sensor(x.name, delay=age * H) for x in SERVO.states)
    )
    looped = in_loop(law, loop, SERVO, predict=True)
    run = simulate(servo(), looped, (0.4, 3.0), duration=20 * H, engine="python")
    A = nominal().plant("corrected").linearization()[0]
    rates = np.diff(run.state, axis=0) / H
    error = (delay + age) * H**3 * np.linalg.norm(A, 2) ** 2 * np.abs(rates).max() / 6
    predicted, arrives = run.command[: 20 - delay], run.state[delay:20, 0]
    assert error < 1e-3 * np.ptp(arrives)
    np.testing.assert_allclose(predicted, arrives, rtol=0, atol=error)
    np.testing.assert_array_equal(seen(run)[: age + 1, 0], 0.4)

"""Prediction over the dead time that a law knows, and what it wins."""

from __future__ import annotations

import math

import numpy as np
import pytest
from looped import CURRENT, H, applied, nominal, played, seen, servo

from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.runs import run_on
from grosmc_mj.loop import Actuator, Computing, Loop, Sensor, in_loop
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.trajectory import Trajectory


def dead_time(law: Controller) -> float:
    """As the law knows it, in timesteps."""
    return float(applied(law).start.computer["dead"][0])


def midpoint_error(run: Trajectory, steps: int) -> float:
    """A step of x' = Ax + Bu errs by h^3 |A^2 x'| / 6 and terms of higher order."""
    A = nominal().plant("corrected").linearization()[0]
    rates = np.diff(run.state, axis=0) / H
    return steps * H**3 * float(np.linalg.norm(A, 2) ** 2 * np.abs(rates).max()) / 6


@pytest.mark.parametrize(("delay", "age", "sent"), [(2, 3, 1), (0, 4, 0)])
def test_the_age_of_a_measurement_is_predicted_too(delay: int, age: int, sent: int) -> None:
    """The law gets the state when its output arrives, but for the midpoint rule's steps.

    The start moves, and measurements are of the start until they are as old as their sensors say.
    """
    loop = Loop(
        Computing(delay=delay * H),
        tuple(Sensor(state.name, delay=age * H) for state in SERVO.states),
        actuators=(Actuator(CURRENT, delay=sent * H, limit=0.7),),
    )
    u, ahead = np.random.default_rng(5).normal(size=120), delay + sent
    run = played(u, loop, x0=(0.4, 3.0), modelled=True, predict=True)
    predicted, error = run.memory["x"][: len(u) - ahead], midpoint_error(run, ahead + age)
    assert np.abs(run.command).max() > 0.7
    assert error < 1e-3 * np.abs(predicted).max()
    np.testing.assert_allclose(predicted, run.state[ahead:-1], rtol=0, atol=error)
    np.testing.assert_array_equal(seen(run)[age:], run.state[: -1 - age])
    np.testing.assert_array_equal(seen(run)[:age, 0], 0.4)


def test_a_load_that_the_model_lacks_is_learned() -> None:
    """A constant load changes the rate over the dead time by d h w/J, which prediction misses.

    It learns by the share 1 - exp(-0.1/d) of a sample, so exp(-10) of it is left after 100 d. The
    model's own rate falls by B h/J of itself on the way.
    """
    p, steps, load = servo().parameters, 5, 0.1
    push = Disturbance("rotor", (0, 0, 0, 0, load, 0))
    run = played(
        np.zeros(100 * steps), Loop(Computing(delay=steps * H)), modelled=True, predict=True,
        disturbances=[push],
    )  # fmt: skip
    error = run.memory["x"][:-steps, 1] - run.state[steps:-1, 1]
    assert error[0] == pytest.approx(steps * H * load / p.J, rel=1e-2)
    assert abs(error[-1] / error[0]) < 1e-3


def test_a_lag_counts_as_a_delay_of_its_time_constants() -> None:
    law = nominal().law("corrected", "lqr")
    for order, lag, steps in ((1, 3e-3, 3), (2, 3e-3, 6), (2, 0.7e-3, 1), (1, 0.4e-3, 0)):
        loop = Loop(actuators=(Actuator(CURRENT, lag=lag, order=order),))
        looped = in_loop(law, loop, SERVO, predict=True)
        assert dead_time(looped) == steps
        # The law's first output arrives then: a surface begins there.
        assert applied(looped).ahead == looped.begin()[0].first == pytest.approx(steps * H)
    loop = Loop(sensors=tuple(Sensor(state.name, delay=2 * H) for state in SERVO.states))
    looped = in_loop(law, loop, SERVO, predict=True)
    assert (dead_time(looped), applied(looped).ahead) == (2.0, 0.0)
    # A law may know another loop than the one that it meets.
    loop = Loop(Computing(delay=4 * H))
    assert dead_time(in_loop(law, loop, SERVO, predict=True, known=Loop())) == 0.0


@pytest.mark.parametrize("predict", [True, False])
def test_a_known_dead_time_costs_nothing(predict: bool) -> None:
    experiment = nominal(switching="implicit", surface="discrete")
    law = experiment.law("corrected", "grosmc")
    law = in_loop(law, Loop(Computing(delay=5 * H)), SERVO, predict=predict)
    metrics = run_on(experiment, "corrected", law, experiment.plant("corrected")).metrics
    ratio = (metrics["cost_whole"].value or 0.0) / (metrics["cost_optimal"].value or math.inf)
    assert 0.99 < ratio < 1.01 if predict else ratio > 10

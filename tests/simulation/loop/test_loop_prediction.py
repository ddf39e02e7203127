"""Prediction over the dead time that a law knows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy as sp
from looped import CURRENT, H, nominal, played, seen, servo

import grosmc_mj as gm
from grosmc_mj.experiments.experiment import run_on
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.loop import Actuator, AppliedLoop, Computing, Loop, Sensor, apply_loop
from grosmc_mj.simulation.loop.counter import uniform
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.design import linear_lqr
from grosmc_mj.theory.control.task import state_task
from grosmc_mj.theory.plants import SERVO, AnalyticPlant, OperatingPoint


def dead_time(loop: AppliedLoop) -> float:
    """Dead time that the law of a loop knows, in timesteps."""
    return float(loop.start.software.setup["dead"][0])


def time_ahead(loop: AppliedLoop) -> float:
    """Time from a sample to the arrival of its output, as the law of a loop knows it [s]."""
    return float(loop.start.software.setup["ahead"][0])


def midpoint_error(run: Trajectory, steps: int) -> float:
    """Error of steps of x' = Ax + Bu: each h^3 |A^2 x'| / 6, and terms of higher order."""
    A = nominal().plant("corrected").linearization()[0]
    rates = np.diff(run.state, axis=0) / H
    third_derivative = np.linalg.norm(A, 2) ** 2 * np.abs(rates).max()
    return steps * H**3 * float(third_derivative) / 6


def sensors_of_age(age: int) -> tuple[Sensor, ...]:
    """Sensors of all states that are some timesteps late."""
    return tuple(Sensor(state.name, delay=age * H) for state in SERVO.states)


@pytest.mark.parametrize(
    ("delay", "age", "sent"),
    [
        (2, 3, 1),
        (0, 4, 0),
    ],
)
def test_the_age_of_a_measurement_is_predicted_too(delay: int, age: int, sent: int) -> None:
    """The law gets the state when its output arrives, but for the midpoint rule's steps.

    The start moves, and measurements are of the start until they are as old as their sensors say.
    """
    loop = Loop(
        Computing(delay=delay * H),
        sensors_of_age(age),
        actuators=(Actuator(CURRENT, delay=sent * H, limit=0.7),),
    )
    u = np.random.default_rng(5).normal(size=120)
    ahead = delay + sent
    run = played(u, loop, x0=(0.4, 3.0), modelled=True, predict=True)
    predicted = run.memory["x"][: len(u) - ahead]
    error = midpoint_error(run, ahead + age)
    assert error < 1e-3 * np.abs(predicted).max()
    # The limit of the actuator is reached.
    assert np.abs(run.command).max() > 0.7

    np.testing.assert_allclose(predicted, run.state[ahead:-1], rtol=0, atol=error)
    np.testing.assert_array_equal(seen(run)[age:], run.state[: -1 - age])
    np.testing.assert_array_equal(seen(run)[:age, 0], 0.4)


@pytest.mark.parametrize("stride", [1, 4])
def test_a_load_that_the_model_lacks_is_learned(stride: int) -> None:
    """A constant load changes the rate over the dead time by d h w/J, which prediction misses.

    It learns by the share 1 - exp(-0.1 T/d) of a sample, so exp(-2) of it is left after 20 d, and
    exp(-10) after 100 d. The model's own rate falls by B h/J of itself on the way.
    """
    steps = 8
    load = 0.1
    run = played(
        np.zeros(100 * steps // stride),
        Loop(Computing(delay=steps * H)),
        stride=stride,
        modelled=True,
        predict=True,
        disturbances=[Disturbance("rotor", (0, 0, 0, 0, load, 0))],
    )
    error = (run.memory["x"][:-steps, 1] - run.state[steps:-1, 1])[::stride]
    missed = steps * H * load / servo().parameters.J
    assert error[0] == pytest.approx(missed, rel=1e-2)
    assert error[20 * steps // stride] / error[0] == pytest.approx(np.exp(-2), rel=0.1)
    assert abs(error[-1] / error[0]) < 1e-3


def test_a_prediction_has_the_inputs_within_the_limit_that_it_knows() -> None:
    """Of 1 A in each of 3 timesteps it counts 0.2 A, though all of it will act: h Kt u/J each."""
    known = Loop(Computing(delay=3 * H), actuators=(Actuator(CURRENT, limit=0.2),))
    run = played(np.ones(4), Loop(Computing(delay=3 * H)), known=known, modelled=True, predict=True)
    p = servo().parameters
    assert run.memory["x"][3, 1] == pytest.approx(3 * H * 0.2 * p.Kt / p.J, rel=1e-2)


def held_plant() -> AnalyticPlant:
    """x' = u - x, which rests at 2 under an input of 2."""
    x = sp.Symbol("x")
    return gm.affine_plant(
        "held", states={"x": "m"}, inputs={"u": "m/s"}, f=[-x], g=[1], h=[x], parameters={}
    )


@pytest.mark.parametrize("predict", [False, True])
def test_before_the_first_output_arrives_acts_the_input_that_holds_the_plant(predict: bool) -> None:
    """The computer misses the first samples, too."""
    plant = held_plant()
    point = OperatingPoint(np.array([2.0]), np.array([2.0]))
    law = linear_lqr(state_task(plant, np.eye(1), 1.0, point))
    loop = apply_loop(Loop(Computing(delay=3 * H, missed=0.9)), law, plant.system, predict=predict)
    assert uniform(loop.loop.seed, 0, 2, 0) < 0.9
    run = simulate(plant, law, [2.0], duration=0.02, loop=loop, engine="python")
    np.testing.assert_allclose(run.state, 2.0, rtol=1e-12)
    np.testing.assert_allclose(seen(run), 2.0, rtol=1e-12)
    np.testing.assert_allclose(run.command, 2.0, rtol=1e-12)


def test_each_law_of_a_batch_predicts_by_its_own_model() -> None:
    """On one thread, whose memory the runs share."""
    plants = [servo(), servo().changed(scales={"J": 3.0})]
    laws = [linear_lqr(state_task(plant, np.eye(2), 1.0)) for plant in plants]
    late = Loop(Computing(delay=5 * H))
    loops = [apply_loop(late, law, SERVO, predict=True) for law in laws]
    options: dict[str, Any] = {"duration": 0.05, "threads": 1, "timestep": H}
    batch = simulate(servo(), laws, [1.0, 0.0], loop=loops, **options)
    alone = simulate(servo(), laws[1], [1.0, 0.0], loop=loops[1], **options)
    np.testing.assert_array_equal(batch.state[1], alone.state)


def predicting(loop: Loop) -> AppliedLoop:
    """A loop around the servo's LQR, which predicts."""
    return apply_loop(loop, nominal().law("corrected", "lqr"), SERVO, predict=True)


@pytest.mark.parametrize(
    ("order", "lag", "steps"),
    [
        (1, 3e-3, 3),
        (2, 3e-3, 6),
        (2, 0.7e-3, 1),
        (1, 0.4e-3, 0),
    ],
)
def test_a_lag_counts_as_a_delay_of_its_time_constants(order: int, lag: float, steps: int) -> None:
    actuator = Actuator(CURRENT, lag=lag, order=order)
    loop = predicting(Loop(actuators=(actuator,)))
    assert dead_time(loop) == steps
    # The law's first output arrives then: a surface begins there.
    assert time_ahead(loop) == pytest.approx(steps * H)


def test_the_age_of_a_measurement_is_dead_time_before_the_sample() -> None:
    loop = predicting(Loop(sensors=sensors_of_age(2)))
    assert (dead_time(loop), time_ahead(loop)) == (2.0, 0.0)


@pytest.mark.parametrize(("predict", "low", "high"), [(True, 0.99, 1.01), (False, 10, np.inf)])
def test_a_dead_time_costs_nothing_if_it_is_known_and_else_much(
    predict: bool, low: float, high: float
) -> None:
    """J over J* of the servo's discrete-time surface."""
    experiment = nominal(switching="implicit", surface="discrete")
    law = experiment.law("corrected", "grosmc")
    loop = apply_loop(Loop(Computing(delay=5 * H)), law, SERVO, predict=predict)
    metrics = run_on(experiment, "corrected", law, experiment.plant("corrected"), loop).metrics
    cost = metrics["cost_whole"].value
    optimum = metrics["cost_optimal"].value
    assert cost is not None
    assert optimum is not None
    assert low < cost / optimum < high

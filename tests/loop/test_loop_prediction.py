"""What a law wins by knowing its dead time."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from looped import CURRENT, H, closed, nominal, played, seen, servo

from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.runs import RunResult, run_on
from grosmc_mj.loop import Actuator, Computing, Loop, Sensor, in_loop
from grosmc_mj.loop.controllers import loop_of
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.simulate import simulate

DELAYS = pytest.mark.parametrize("steps", [1, 2, 5])
SECONDS = 10.0


@cache
def late(steps: int, predict: bool, switching: str = "implicit") -> RunResult:
    """The servo's nominal step, its output late by some samples."""
    surface = "discrete" if switching == "implicit" else "printed"
    experiment = nominal(switching=switching, surface=surface)
    loop = Loop(Computing(delay=steps * H))
    law = in_loop(experiment.law("corrected", "grosmc"), loop, SERVO, predict=predict)
    return run_on(experiment, "corrected", law, experiment.plant("corrected"))


def dead_time(law: Controller) -> float:
    """As the law knows it, in timesteps."""
    return float(loop_of(law).start.computer["dead"][0])


def value(run: RunResult, name: str) -> float:
    found = run.metrics[name].value
    assert found is not None
    return found


def cost(run: RunResult) -> float:
    """J / J* with the whole input."""
    return value(run, "cost_whole") / value(run, "cost_optimal")


@pytest.mark.slow
@DELAYS
def test_a_known_dead_time_costs_only_the_wait(steps: int) -> None:
    """The servo stands for d samples at z = (1, 0), which costs z'Qz/2 d h more than on time.

    The trapezoid of the cost holds the corner where the input sets in, of a sample's width.
    """
    on_time, run = late(0, predict=True), late(steps, predict=True)
    wait = 0.5 * steps * H
    more = value(run, "cost_whole") - value(on_time, "cost_whole")
    assert more == pytest.approx(wait, abs=0.01 * H)
    assert cost(run) < 1.01
    # The optimum's input, once round: at its start it jumps by 1 A, from rest.
    jump = 1.0 / SECONDS
    calm = value(on_time, "total_variation") + jump
    assert value(run, "total_variation") == pytest.approx(calm, rel=1e-3)


@pytest.mark.slow
@DELAYS
def test_a_dead_time_that_is_not_known_costs_tens_of_optima(steps: int) -> None:
    known, unknown = late(steps, predict=True), late(steps, predict=False)
    assert cost(unknown) > 10
    assert value(unknown, "total_variation") > 1000 * value(known, "total_variation")


@pytest.mark.slow
@DELAYS
def test_the_motion_is_that_on_time_but_later(steps: int) -> None:
    """A linear plant and its exact model: the same numbers but for rounding, d samples later."""
    on_time, run = late(0, predict=True).trajectory, late(steps, predict=True).trajectory
    # s is a difference of sums, of which a few thousand roundings are left.
    np.testing.assert_allclose(
        run.state[steps:], on_time.state[: len(run.state) - steps], rtol=0, atol=1e-9
    )
    np.testing.assert_array_equal(run.state[: steps + 1], on_time.state[:1].repeat(steps + 1, 0))


@pytest.mark.slow
def test_without_a_dead_time_prediction_changes_nothing() -> None:
    a, b = late(0, predict=True).trajectory, late(0, predict=False).trajectory
    np.testing.assert_array_equal(a.state, b.state)


@pytest.mark.slow
def test_the_age_of_a_measurement_is_predicted_too() -> None:
    """What it is told is the state when its output arrives, but for the midpoint rule's error.

    A step of x' = Ax + Bu errs by h^3 |A^2 x'| / 6 and what is of higher order; there are six.
    """
    loop = Loop(
        Computing(delay=2 * H),
        tuple(Sensor(each.name, delay=3 * H) for each in SERVO.states),
        actuators=(Actuator(CURRENT, delay=H, limit=0.7),),
    )
    u = np.random.default_rng(5).normal(size=120)
    run = played(u, loop, modelled=True, predict=True)
    believed = run.memory["x"]
    assert np.abs(run.command).max() > 0.7
    A = nominal().plant("corrected").linearization()[0]
    rates = np.diff(run.state, axis=0) / H
    error = 6 * H**3 * np.linalg.norm(A, 2) ** 2 * np.abs(rates).max() / 6
    assert error < 1e-3 * np.abs(believed).max()
    np.testing.assert_allclose(believed[:-3], run.state[3:-1], rtol=0, atol=error)
    np.testing.assert_array_equal(seen(run)[3:], run.state[:-4])


@pytest.mark.slow
@pytest.mark.parametrize("switching", ["sign", "implicit"])
def test_a_predicted_surface_starts_at_zero(switching: str) -> None:
    """Its first sample is not at t = 0 but when its output arrives."""
    for steps in (0, 1, 5):
        run = late(steps, True, switching)
        first = run.controller.begin()[0].first
        assert first == pytest.approx(steps * H, rel=1e-12)
        s: Any = run.trajectory.sliding
        assert s[0] == 0.0
        assert run.trajectory.memory["first"][-1] == first


@pytest.mark.slow
def test_a_lag_counts_as_a_delay_of_its_time_constants() -> None:
    law = nominal().law("corrected", "lqr")
    for order, lag, steps in ((1, 3e-3, 3), (2, 3e-3, 6), (2, 0.7e-3, 1), (1, 0.4e-3, 0)):
        loop = Loop(actuators=(Actuator(CURRENT, lag=lag, order=order),))
        made = in_loop(law, loop, SERVO, predict=True)
        assert dead_time(made) == steps
        assert loop_of(made).ahead == pytest.approx(steps * H)
    loop = Loop(sensors=tuple(Sensor(each.name, delay=2 * H) for each in SERVO.states))
    made = in_loop(law, loop, SERVO, predict=True)
    assert (dead_time(made), loop_of(made).ahead) == (2.0, 0.0)


@pytest.mark.slow
def test_a_law_may_know_another_loop_than_it_meets() -> None:
    """One that believes in no dead time does as one that does not predict."""
    law = nominal().law("corrected", "lqr")
    loop = Loop(Computing(delay=4 * H))
    believing = in_loop(law, loop, SERVO, predict=True, known=Loop())
    assert dead_time(believing) == 0.0
    run = closed(law, loop, (0.0, 0.0), 0.5)

    found = simulate(servo(), believing, (0.0, 0.0), duration=0.5)
    np.testing.assert_array_equal(found.state, run.state)

"""The shipped cases beyond the chapter's: what each of them is there to show."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from grosmc_mj.assumptions.audit import ROUNDING, run_audit
from grosmc_mj.experiments.experiment import Experiment, judge
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.physics.linearization import linearize

_OWN = ["pid", "looked_up", "from_positions", "transfer_function"]


@pytest.mark.parametrize("case", [*(f"own_laws/{name}" for name in _OWN), "maglev/warm",
                                  "ball_beam/sine", "ball_beam/balance", "ball_beam/heavier",
                                  "furuta/heavier", "inverted_pendulum/heavier",
                                  "cartpole/heavier"])  # fmt: skip
def test_it_keeps_what_it_requires(case: str) -> None:
    package = {"cartpole": "dm_control", "inverted_pendulum": "gymnasium"}.get(case.split("/")[0])
    if package:
        pytest.importorskip(package)
    judged = judge(case)
    assert judged
    assert [each for each in judged if not each.kept] == []


@pytest.mark.parametrize("name", _OWN)
def test_a_law_of_ones_own_is_one_in_both_engines(name: str) -> None:
    experiment = Experiment.load(f"own_laws/{name}").varied(duration=0.2)
    native, python = (
        experiment.with_settings(engine=engine).run(law=experiment.controllers[0]).trajectory
        for engine in ("native", "python")
    )
    np.testing.assert_array_equal(native.state, python.state)
    np.testing.assert_array_equal(native.input, python.input)


# Away from zero


@cache
def run(case: str, law: str) -> RunResult:
    return Experiment.load(case).run(law=law)


def test_the_magnet_rests_where_physics_says() -> None:
    """m g = C (i/y)^2 and V = R i at 10 mm."""
    point = Experiment.load("maglev/warm").nominal.at
    assert point is not None
    current = 0.01 * np.sqrt(0.05 * 9.81 / 1e-4)
    np.testing.assert_allclose(point.x, [0.01, 0.0, current], rtol=1e-9)
    np.testing.assert_allclose(point.u, [2.0 * current], rtol=1e-9)


def test_the_integral_surface_alone_brings_the_ball_back() -> None:
    """A warm coil: LQR and feedback linearization come to rest beside 10 mm, GROSMC on it."""
    ends = {law: run("maglev/warm", law).trajectory.state[-1, 0] for law in
            ("lqr", "fl-lqr", "grosmc")}  # fmt: skip
    assert abs(ends["grosmc"] - 0.01) < 1e-5
    assert min(abs(ends[law] - 0.01) for law in ("lqr", "fl-lqr")) > 5e-4


def test_what_the_design_leaves_out_is_counted_as_unmatched() -> None:
    """B r w^2 is in y'', which the input does not reach: no gain makes up for it."""
    result = run("ball_beam/sine", "grosmc")
    failed = {premise.name: premise for premise in run_audit(result).failed()}
    assert set(failed) == {"matching"}
    margin = failed["matching"].along
    assert margin is not None
    x = result.trajectory.state
    expected = 5 / 7 * np.abs(x[:-1:5, 0] * x[:-1:5, 3] ** 2).max()
    assert ROUNDING - margin.margin == pytest.approx(expected, rel=1e-9)
    other = run("ball_beam/sine", "fl-lqr").trajectory.state[:, 0]
    assert np.abs(x[:, 0] - other).max() < 1e-4


# Fewer actuators than joints


def test_the_pole_leans_where_it_rests() -> None:
    """Gymnasium's pole ends 1 mm beside its foot, at 0.6 m."""
    pytest.importorskip("gymnasium")
    experiment = Experiment.load("inverted_pendulum/heavier")
    point = experiment.nominal.at
    assert point is not None
    assert point.x[1] == pytest.approx(-0.001 / 0.6, rel=1e-5)
    assert np.abs(experiment.nominal.plant.derivative(point.x, point.u)).max() < 1e-6
    # The weight falls over: a pole on the right.
    assert np.linalg.eigvals(linearize(experiment.nominal.plant, point.x, point.u)[0]).max() > 1


def test_the_rod_is_balanced_by_the_arm_alone() -> None:
    result = run("furuta/heavier", "grosmc")
    assert result.trajectory.system.actuators == ("motor",)
    x = result.trajectory.state
    assert x[0, 1] == pytest.approx(np.radians(12))
    assert np.abs(x[-100:, :2]).max() < 0.02
    assert "of what the family changes is out of the input's reach" in (
        result.controller.designed.declared
    )


M, RADIUS, J, g = 0.05, 0.01, 0.02, 9.81


@pytest.mark.parametrize(("case", "m"), [("balance", M), ("heavier", 2 * M)])
def test_the_ball_rolls_as_hauser_s_equations_say(case: str, m: float) -> None:
    """A slide with an armature of J_b/R^2 is a solid ball that rolls."""
    plant = Experiment.load(f"ball_beam/{case}").plant("physics")
    J_b = 2 / 5 * m * RADIUS**2
    for angle, r, turn, speed, torque in np.random.default_rng(0).uniform(-0.5, 0.5, (20, 5)):
        rolling = (m * r * turn**2 - m * g * np.sin(angle)) / (J_b / RADIUS**2 + m)
        turning = torque - 2 * m * r * speed * turn - m * g * r * np.cos(angle)
        expected = [turn, speed, turning / (m * r**2 + J + J_b), rolling]
        # Rounding of a mass matrix of two joints.
        found = plant.derivative([angle, r, turn, speed], torque)
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12)


def test_the_ball_stays_on_its_beam_and_its_weight_is_compensated() -> None:
    """A slide would not tell: the beam presses on the ball, and it is never near an end.

    A heavier one's weight turns the beam as the torque does: matched, so that LQR alone strays.
    """
    nominal, strayed = run("ball_beam/balance", "grosmc").trajectory.state[:, 1], {}
    for law in ("lqr", "grosmc"):
        swing = run("ball_beam/heavier", law).trajectory
        angle, r, turn, speed = swing.state.T
        pressed = g * np.cos(angle) + r * np.gradient(turn, swing.time) + 2 * speed * turn
        # Rolling asks for traction of 2/5 of its acceleration.
        assert np.all(0.4 * np.abs(np.gradient(speed, swing.time)) < 0.1 * pressed)
        assert np.abs(r).max() == r[0] == pytest.approx(0.2)
        assert np.abs(r[-100:]).max() < 1e-3
        strayed[law] = np.abs(r - nominal).max()
    assert strayed["grosmc"] < strayed["lqr"] / 2

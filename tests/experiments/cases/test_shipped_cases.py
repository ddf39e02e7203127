"""The shipped cases beyond the chapter's: what each of them is there to show."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from grosmc_mj.experiments.assumptions.audit import ROUNDING, run_audit
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.studies.judging import judge

# Cases whose model another package ships.
PACKAGES = {"cartpole/heavier": "dm_control", "inverted_pendulum/heavier": "gymnasium"}


@pytest.mark.parametrize(
    "case",
    [
        "own_laws/pid",
        "own_laws/looked_up",
        "own_laws/from_positions",
        "own_laws/transfer_function",
        "maglev/warm",
        "ball_beam/sine",
        "ball_beam/balance",
        "ball_beam/heavier",
        "furuta/heavier",
        "inverted_pendulum/heavier",
        "cartpole/heavier",
        "switching/two_link_arm",
    ],
)
def test_it_keeps_its_requirements(case: str) -> None:
    package = PACKAGES.get(case)
    if package is not None:
        pytest.importorskip(package)
    judgements = judge(case)
    assert judgements
    assert all(judgement.kept for judgement in judgements)


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


@pytest.mark.parametrize(
    ("law", "least", "most"),
    [("grosmc", -np.inf, 1e-5), ("lqr", 5e-4, np.inf), ("fl-lqr", 5e-4, np.inf)],
)
def test_only_an_integral_brings_the_ball_back_under_a_warm_coil(
    law: str, least: float, most: float
) -> None:
    """LQR and feedback linearization come to rest beside 10 mm, GROSMC on it."""
    gap = run("maglev/warm", law).trajectory.state[-1, 0]
    assert least < abs(gap - 0.01) < most


def test_what_the_design_leaves_out_is_counted_as_unmatched() -> None:
    """B r w^2 is in y'', which the input does not reach."""
    result = run("ball_beam/sine", "grosmc")
    (matching,) = run_audit(result).failed()
    assert matching.name == "matching"
    assert matching.along is not None
    x = result.trajectory.state
    r = x[:-1:5, 0]
    turn = x[:-1:5, 3]
    expected = 5 / 7 * np.abs(r * turn**2).max()
    assert ROUNDING - matching.along.margin == pytest.approx(expected, rel=1e-9)


def test_no_gain_makes_up_for_what_is_unmatched() -> None:
    switching = run("ball_beam/sine", "grosmc").trajectory.state[:, 0]
    linear = run("ball_beam/sine", "fl-lqr").trajectory.state[:, 0]
    assert np.abs(switching - linear).max() < 1e-4


# Fewer actuators than joints


def test_the_rod_is_balanced_by_the_arm_alone() -> None:
    result = run("furuta/heavier", "grosmc")
    x = result.trajectory.state
    assert x[0, 1] == pytest.approx(np.radians(12))
    assert np.abs(x[-100:, :2]).max() < 0.02
    reach = "of what the family changes is out of the input's reach"
    assert reach in result.controller.designed.declared


def test_the_pole_leans_where_it_rests() -> None:
    """Gymnasium's pole ends 1 mm beside its foot, at 0.6 m."""
    pytest.importorskip("gymnasium")
    nominal = Experiment.load("inverted_pendulum/heavier").nominal
    assert nominal.at is not None
    assert nominal.at.x[1] == pytest.approx(-0.001 / 0.6, rel=1e-5)
    derivative = nominal.plant.derivative(nominal.at.x, nominal.at.u)
    assert np.abs(derivative).max() < 1e-6


M, RADIUS, J, g = 0.05, 0.01, 0.02, 9.81


@pytest.mark.parametrize(("case", "m"), [("balance", M), ("heavier", 2 * M)])
def test_the_ball_rolls_as_hauser_s_equations_say(case: str, m: float) -> None:
    """A slide with an armature of J_b/R^2 is a solid ball that rolls."""
    plant = Experiment.load(f"ball_beam/{case}").plant("physics")
    J_b = 2 / 5 * m * RADIUS**2
    random = np.random.default_rng(0)
    for angle, r, turn, speed, torque in random.uniform(-0.5, 0.5, (20, 5)):
        rolling = (m * r * turn**2 - m * g * np.sin(angle)) / (J_b / RADIUS**2 + m)
        turning = torque - 2 * m * r * speed * turn - m * g * r * np.cos(angle)
        expected = [turn, speed, turning / (m * r**2 + J + J_b), rolling]
        # Rounding of a mass matrix of two joints.
        derivative = plant.derivative([angle, r, turn, speed], torque)
        np.testing.assert_allclose(derivative, expected, rtol=1e-11, atol=1e-12)


def test_one_switch_for_both_joints_keeps_a_heavy_arm_nearer_to_its_course() -> None:
    case = "switching/two_link_arm"
    deviations = []
    for law in ("one switch", "a switch for each joint"):
        deviation = run(case, law).metrics["deviation"].value
        assert deviation is not None
        deviations.append(deviation)
    assert deviations[0] < 0.85 * deviations[1]

"""dm_control's cartpole by its case file alone: who balances it from 30 degrees."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import ControllerTable
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.linearization import linearize
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller

pytest.importorskip("dm_control", reason="dm_control needs Python 3.12 or older")

RAIL = 1.8
LIMIT = 10.0

EXPERIMENT = Experiment.load("cartpole/heavier")
HEAVY = EXPERIMENT.plant("physics")
NOMINAL: Any = EXPERIMENT.nominal.plant


@cache
def law(name: str, **numbers: float) -> Controller:
    """A law of the file, with other numbers."""
    table = next(table for table in EXPERIMENT.file.controller if table.law == name)
    declared = table.model_dump(exclude_unset=True)
    changed = ControllerTable.model_validate({**declared, **numbers})
    file = EXPERIMENT.file.model_copy(update={"controller": [changed]})
    return Experiment.of_file(file, EXPERIMENT.path).law("physics", changed.called)


@cache
def balanced(name: str, degrees: float = 30.0, **numbers: float) -> Trajectory:
    """With twice the pole's mass and the push; a batch of one does not raise."""
    start = (0.0, math.radians(degrees), 0.0, 0.0)
    pushes = EXPERIMENT.disturbances
    controller = law(name, **numbers)
    runs = simulate([HEAVY], controller, start, duration=12.0, disturbances=pushes)
    return runs[0]


@pytest.mark.parametrize(
    "field", ["body_mass", "body_inertia", "body_ipos", "dof_damping", "jnt_range"]
)
def test_it_is_dm_controls_own_model(field: str) -> None:
    from dm_control import suite

    model = suite.load("cartpole", "balance").physics.model
    np.testing.assert_array_equal(getattr(NOMINAL.model, field), getattr(model, field))


def test_its_force_is_limited_as_dm_control_s_is() -> None:
    from dm_control import suite

    model = suite.load("cartpole", "balance").physics.model
    assert NOMINAL.model.actuator_ctrlrange.tolist() == [[-LIMIT, LIMIT]]
    assert model.actuator_gear[0, 0] * model.actuator_ctrlrange[0, 1] == LIMIT
    assert HEAVY.step_length == 1e-3


def test_it_is_linearized_to_the_textbook_s_model() -> None:
    """Lagrange's equations of a cart with a pole of any inertia, about the upright pole."""
    cart = NOMINAL.model.body("cart")
    pole = NOMINAL.model.body("pole_1")
    M, m, l = cart.mass[0], pole.mass[0], 0.5
    I, g, b, c = pole.inertia[1], 9.81, 5e-4, 2e-6
    inverse = np.linalg.inv([[M + m, m * l], [m * l, I + m * l**2]])
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:, :2] = inverse @ [[0, 0], [0, m * g * l]]
    A[2:, 2:] = -inverse @ np.diag([b, c])
    B = np.zeros((4, 1))
    B[2:] = inverse @ [[1.0], [0.0]]
    linear_A, linear_B = linearize(NOMINAL)
    np.testing.assert_allclose(linear_A, A, rtol=0, atol=1e-8 * np.abs(A).max())
    np.testing.assert_allclose(linear_B, B, rtol=0, atol=1e-8 * np.abs(B).max())


def test_the_nominal_input_keeps_away_from_the_actuator_s_limit() -> None:
    assert law("grosmc").parameters.limit == 0.9 * LIMIT
    assert law("grosmc", limit=4.0).parameters.limit == 4.0


def matched_share(plant: Any, G: Array) -> float:
    """|G d| / |G B| of a newton on the pole, from MuJoCo's own acceleration."""
    data = mujoco.MjData(plant.model)
    data.xfrc_applied[plant.model.body("pole_1").id, 0] = 1.0
    mujoco.mj_forward(plant.model, data)
    pushed = np.concatenate([np.zeros(2), data.qacc])
    _, B = linearize(plant)
    return abs((G @ pushed).item() / (G @ B).item())


def test_the_push_counts_by_its_matched_share() -> None:
    """The larger one of the nominal plant and the heavier one."""
    p = law("grosmc").parameters
    largest = max(matched_share(NOMINAL, p.G), matched_share(HEAVY, p.G))
    assert p.gamma0 == pytest.approx(largest, rel=1e-6)


def test_s_is_what_the_limited_nominal_leaves_over() -> None:
    """s = G [x - x0] less the sum of T G (A x + B u_0), by hand from a recorded run."""
    controller = EXPERIMENT.changed(switching="sign").law("physics", "grosmc")
    start = (0.0, math.pi / 6, 0.0, 0.0)
    run = simulate(HEAVY, controller, start, duration=0.4, engine="python")
    p = controller.parameters
    optimum = controller.designed.lqr
    x = run.state[:-1]
    nominal_input = np.clip(-x @ p.K.T, -p.limit, p.limit)
    rates = (x @ optimum.A.T + nominal_input @ optimum.B.T) @ p.G.T
    drift = np.concatenate([[0.0], np.cumsum(rates[:-1, 0]) * 1e-3])
    assert run.sliding is not None
    s = (x - x[0]) @ p.G[0] - drift
    np.testing.assert_allclose(run.sliding, s, rtol=0, atol=1e-11)
    assert np.abs(x @ p.K.T).max() > 3 * p.limit


def rests(run: Trajectory) -> bool:
    """Whether cart and pole end within 1 cm and half a degree of the origin, never off the rail."""
    position, angle = np.abs(run.state[-500:, :2]).max(axis=0)
    farthest = np.abs(run.state[:, 0]).max()
    return bool(position < 0.01 and angle < 0.009 and farthest < RAIL)


@pytest.mark.parametrize("name", ["lqr", "grosmc"])
def test_it_is_balanced_from_30_degrees_within_its_limit(name: str) -> None:
    """The force never leaves +-10 N, and it is at the limit for some of the time."""
    run = balanced(name)
    assert rests(run)
    assert np.abs(run.input).max() == LIMIT


def test_as_printed_the_nominal_input_winds_up() -> None:
    """Its s has no bound, where that of the limited one stays small."""
    limited = balanced("grosmc").sliding
    printed = balanced("grosmc", limit=1e9)
    assert not rests(printed)
    assert limited is not None
    assert printed.sliding is not None
    assert np.abs(limited).max() < 0.1
    assert np.abs(printed.sliding[:500]).max() > 2.0


def test_as_printed_it_is_balanced_from_10_degrees() -> None:
    """The actuator hardly cuts it."""
    assert rests(balanced("grosmc", 10.0, limit=1e9))

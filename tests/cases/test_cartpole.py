"""dm_control's cartpole by its case file alone: who balances it from 30 degrees."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.experiment import Experiment, undesigned
from grosmc_mj.experiments.file.schema import ControllerTable
from grosmc_mj.physics.linearization import linearize
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory

pytest.importorskip("dm_control", reason="dm_control needs Python 3.12 or older")

RAIL, LIMIT = 1.8, 10.0


EXPERIMENT = Experiment.load("cartpole/heavier")
HEAVY = EXPERIMENT.plant("physics")
NOMINAL: Any = EXPERIMENT.nominal.plant


@cache
def law(name: str, **numbers: float) -> Controller:
    """A law of the file, with other numbers."""
    table = next(one for one in EXPERIMENT.file.controller if one.law == name)
    changed = ControllerTable.model_validate({**table.model_dump(exclude_unset=True), **numbers})
    file = EXPERIMENT.file.model_copy(update={"controller": [changed]})
    return undesigned(file, EXPERIMENT.path).law("physics", changed.called)


@cache
def balanced(name: str, degrees: float = 30.0, **numbers: float) -> Trajectory:
    """With twice the pole's mass and the push; a batch of one does not raise."""
    pushes, start = EXPERIMENT.case.disturbances, (0.0, math.radians(degrees), 0.0, 0.0)
    return simulate([HEAVY], law(name, **numbers), start, duration=12.0, disturbances=pushes)[0]


def test_it_is_dm_controls_own_model_and_linearized_it_is_the_textbooks() -> None:
    """Lagrange's equations of a cart with a pole of any inertia, about the upright pole."""
    from dm_control import suite

    theirs, model = suite.load("cartpole", "balance").physics.model, NOMINAL.model
    for name in ("body_mass", "body_inertia", "body_ipos", "dof_damping", "jnt_range"):
        np.testing.assert_array_equal(getattr(model, name), getattr(theirs, name))
    assert model.actuator_ctrlrange.tolist() == [[-LIMIT, LIMIT]]
    assert theirs.actuator_gear[0, 0] * theirs.actuator_ctrlrange[0, 1] == LIMIT
    assert HEAVY.step_length == 1e-3
    M, m, l = model.body("cart").mass[0], model.body("pole_1").mass[0], 0.5
    I, g, b, c = model.body("pole_1").inertia[1], 9.81, 5e-4, 2e-6
    inverse = np.linalg.inv([[M + m, m * l], [m * l, I + m * l**2]])
    A, B = np.zeros((4, 4)), np.zeros((4, 1))
    A[:2, 2:] = np.eye(2)
    A[2:, :2] = inverse @ [[0, 0], [0, m * g * l]]
    A[2:, 2:] = -inverse @ np.diag([b, c])
    B[2:] = inverse @ [[1.0], [0.0]]
    for matrix, expected in zip(linearize(NOMINAL), (A, B), strict=True):
        np.testing.assert_allclose(matrix, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_the_push_counts_by_its_matched_share() -> None:
    """|G d| / |G B| of the declared newton, from MuJoCo's own acceleration."""
    p, shares = law("grosmc").parameters, []
    # The nominal input keeps away from the actuator's limit.
    assert (p.limit, law("grosmc", limit=4.0).parameters.limit) == (0.9 * LIMIT, 4.0)
    for plant in (NOMINAL, HEAVY):
        data = mujoco.MjData(plant.model)
        data.xfrc_applied[plant.model.body("pole_1").id, 0] = 1.0
        mujoco.mj_forward(plant.model, data)
        pushed = np.concatenate([np.zeros(2), data.qacc])
        _, B = linearize(plant)
        shares.append(abs((p.G @ pushed).item() / (p.G @ B).item()))
    assert p.gamma0 == pytest.approx(max(shares), rel=1e-6)


def test_s_is_what_the_limited_nominal_leaves_over() -> None:
    """s = G [x - x0] less the sum of T G (A x + B u_0), by hand from a recorded run."""
    made = EXPERIMENT.with_settings(switching="sign").law("physics", "grosmc")
    run = simulate(HEAVY, made, (0.0, math.pi / 6, 0.0, 0.0), duration=0.4, engine="python")
    p, optimum = made.parameters, made.designed.lqr
    x = run.state[:-1]
    nominal_input = np.clip(-x @ p.K.T, -p.limit, p.limit)
    rates = (x @ optimum.A.T + nominal_input @ optimum.B.T) @ p.G.T
    drift = np.concatenate([[0.0], np.cumsum(rates[:-1, 0]) * 1e-3])
    assert run.sliding is not None
    np.testing.assert_allclose(run.sliding, (x - x[0]) @ p.G[0] - drift, rtol=0, atol=1e-11)
    assert np.abs(x @ p.K.T).max() > 3 * p.limit


def rests(run: Trajectory) -> bool:
    """Whether cart and pole end within 1 cm and half a degree of the origin, never off the rail."""
    ends = np.abs(run.state[-500:]).max(axis=0)
    return bool(ends[0] < 0.01 and ends[1] < 0.009 and np.abs(run.state[:, 0]).max() < RAIL)


def test_it_is_balanced_from_30_degrees_unless_the_nominal_input_winds_up() -> None:
    """As printed it falls; from 10 degrees it is balanced, for the actuator hardly cuts it."""
    for name in ("lqr", "grosmc"):
        assert rests(balanced(name))
        # The force never leaves +-10 N, and it is at the limit for some of the time.
        assert np.abs(balanced(name).input).max() == LIMIT
    kept, fallen = balanced("grosmc").sliding, balanced("grosmc", limit=1e9)
    assert not rests(fallen)
    assert kept is not None
    assert fallen.sliding is not None
    assert np.abs(kept).max() < 0.1
    assert np.abs(fallen.sliding[:500]).max() > 2.0
    assert rests(balanced("grosmc", 10.0, limit=1e9))

"""Dynamics of links in plain Python, against MuJoCo's of the same model."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import mujoco
import numpy as np
import pytest

from grosmc_mj.experiments.cases.jaco.jaco import jaco
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.files import load_spec
from grosmc_mj.mechanics.robots.links import rigid_bodies
from grosmc_mj.mechanics.robots.rigid_bodies import (
    forward_dynamics,
    inertia_matrix,
    inverse_dynamics,
)

KINDS = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
MOST_JOINTS = 8


@cache
def random_tree(seed: int) -> mujoco.MjModel:
    """Tree of one to eight joints: bodies with none, one or two of them anywhere in each other."""
    rng = np.random.default_rng(seed)
    spec = mujoco.MjSpec()
    spec.option.gravity = rng.normal(scale=10.0, size=3)
    bodies = [spec.worldbody]
    wanted = int(rng.integers(1, MOST_JOINTS + 1))
    while len(spec.joints) < wanted:
        parent = bodies[rng.integers(len(bodies))]
        body = parent.add_body(pos=rng.normal(size=3), quat=rng.normal(size=4))
        points = rng.normal(scale=0.3, size=(6, 3))
        inertia = np.sum(points**2) * np.eye(3) - points.T @ points
        body.explicitinertial = True
        body.mass = rng.uniform(0.1, 3.0)
        body.ipos = rng.normal(scale=0.3, size=3)
        body.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        body.gravcomp = rng.choice([0.0, 0.7])
        for _ in range(min(int(rng.integers(0, 3)), wanted - len(spec.joints))):
            body.add_joint(
                type=KINDS[rng.integers(2)],
                axis=rng.normal(size=3),
                pos=rng.normal(scale=0.2, size=3),
                ref=rng.normal(),
                armature=rng.uniform(0.0, 0.5),
                damping=rng.uniform(0.0, 1.0),
                stiffness=rng.choice([0.0, 3.0]),
                springref=rng.normal(),
            )
        bodies.append(body)
    return spec.compile()


def jaco_arm() -> mujoco.MjModel:
    return jaco().nominal


def two_link_arm() -> mujoco.MjModel:
    return load_spec("two_link_arm").compile()


def state_of(model: mujoco.MjModel) -> tuple[mujoco.MjData, Array]:
    """A model at a random state, with its state x."""
    rng = np.random.default_rng(model.nv)
    data = mujoco.MjData(model)
    data.qpos = rng.normal(scale=2.0, size=model.nv)
    data.qvel = rng.normal(scale=2.0, size=model.nv)
    mujoco.mj_forward(model, data)
    return data, np.concatenate([data.qpos, data.qvel])


MODELS = [pytest.param(partial(random_tree, seed), id=f"tree {seed}") for seed in range(60)]
MODELS += [pytest.param(jaco_arm, id="jaco"), pytest.param(two_link_arm, id="two-link arm")]
each_model = pytest.mark.parametrize("make", MODELS)


def assert_equal_to(expected: Array, actual: Array) -> None:
    """Equal to 1e-12 of the largest entry: rounding in other orders, hundreds of operations."""
    size = max(1.0, float(np.abs(expected).max()))
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-12 * size)


@each_model
def test_inertia_matrix_is_mujocos(make: Callable[[], mujoco.MjModel]) -> None:
    model = make()
    data, x = state_of(model)
    n = model.nv
    expected = np.zeros((n, n))
    mujoco.mj_fullM(model, data, expected)
    M = np.zeros(n * n)
    inertia_matrix(rigid_bodies(model), x, M)
    assert_equal_to(expected, M.reshape(n, n))


@each_model
def test_torque_at_rest_of_the_joints_accelerations_is_mujocos_bias(
    make: Callable[[], mujoco.MjModel],
) -> None:
    """h(q, q') - passive: Coriolis, centrifugal and gravity torques, dampers and springs."""
    model = make()
    data, x = state_of(model)
    tau = np.zeros(model.nv)
    inverse_dynamics(rigid_bodies(model), x, np.zeros(model.nv), tau)
    assert_equal_to(data.qfrc_bias - data.qfrc_passive, tau)


GEARED = """
<mujoco>
  <worldbody>
    <body>
      <joint name="shoulder" axis="0 1 0" damping="0.3"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03"/>
      <body pos="0.4 0 0">
        <joint name="elbow" axis="0 1 0" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <general joint="elbow" gear="-3" gainprm="0.5" damping="0.2" armature="0.004"/>
    <general joint="shoulder" gear="2" damping="0.1" armature="0.05"/>
  </actuator>
</mujoco>
"""


def test_an_input_has_the_gear_damping_and_armature_of_its_actuator() -> None:
    model = mujoco.MjModel.from_xml_string(GEARED)
    data, x = state_of(model)
    data.ctrl = [0.7, -1.1]
    mujoco.mj_forward(model, data)
    a = np.zeros(2)
    # Inputs in the order of the joints.
    forward_dynamics(rigid_bodies(model), x, data.ctrl[::-1].copy(), a)
    assert_equal_to(data.qacc, a)


@each_model
def test_forward_dynamics_undoes_inverse_dynamics(make: Callable[[], mujoco.MjModel]) -> None:
    model = make()
    _, x = state_of(model)
    bodies = rigid_bodies(model)
    wanted = np.linspace(-1.0, 2.0, model.nv)
    tau = wanted.copy()
    inverse_dynamics(bodies, x, tau, tau)
    a = np.zeros(model.nv)
    forward_dynamics(bodies, x, tau, a)
    # The condition number of M, up to 1e3 here, multiplies rounding.
    np.testing.assert_allclose(a, wanted, rtol=0, atol=1e-10)

"""The two-link arm's MJCF: names, numbers, edits, and MuJoCo against the equations by hand."""

from __future__ import annotations

import math
from dataclasses import asdict

import mujoco
import numpy as np
import pytest
from two_link_oracle import (
    BODIES,
    TwoLinkParameters,
    acceleration,
    coriolis,
    generalized_force,
    gravity,
    inertia,
    tip,
)

from grosmc_mj.physics.edits import BodyEdit, apply_edits
from grosmc_mj.physics.files import compile_spec, model_path

# Beside the other models, whether or not the package knows the system.
FILE = model_path("arm").with_name("two_link_arm.xml")

# Rounding of terms of one size: measured 1e-14 of the largest term, over edits of all bodies.
AGREEMENT = 1e-12


def edited(*edits: BodyEdit) -> mujoco.MjModel:
    return compile_spec(apply_edits(mujoco.MjSpec.from_file(str(FILE)), edits))


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return edited()


def posed(model: mujoco.MjModel, q: np.ndarray, dq: np.ndarray | None = None) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = q
    if dq is not None:
        data.qvel[:] = dq
    mujoco.mj_forward(model, data)
    return data


def mass_matrix(model: mujoco.MjModel, q: np.ndarray) -> np.ndarray:
    full = np.zeros((2, 2))
    mujoco.mj_fullM(model, posed(model, q), full)
    return full


def random_edits(rng: np.random.Generator) -> list[BodyEdit]:
    """All three bodies: mass x0.25 to x4, length x0.5 to x2."""
    return [BodyEdit(body, 4 ** rng.uniform(-1, 1), 2 ** rng.uniform(-1, 1)) for body in BODIES]


# What is named, and what can be filmed


# The numbers


def test_mass_matrix_of_the_head_comment(model: mujoco.MjModel) -> None:
    J1, J2, h = 0.425, 0.128 / 1.5, 0.14
    for q2 in np.linspace(-3, 3, 13):
        k = math.cos(q2)
        expected = [[J1 + J2 + 2 * h * k, J2 + h * k], [J2 + h * k, J2]]
        np.testing.assert_allclose(mass_matrix(model, np.array([0.7, q2])), expected, atol=1e-15)


def test_angles_are_counter_clockwise_from_the_right(model: mujoco.MjModel) -> None:
    """The picture's right is +x; q2 is counted from the upper link."""
    p = TwoLinkParameters.from_model(model)
    for q in np.random.default_rng(0).uniform(-math.pi, math.pi, (20, 2)):
        x, z = tip(q, p)
        found = posed(model, q).site("tip").xpos
        np.testing.assert_allclose(found, [x, 0, 1.1 + z], atol=1e-15)


# Against the equations


@pytest.mark.parametrize("seed", range(8))
def test_mujoco_has_the_accelerations_of_the_equations(seed: int) -> None:
    """Nominal (seed 0) and edited, at random states, torques and wrenches on every body."""
    rng = np.random.default_rng(seed)
    model = edited(*(random_edits(rng) if seed else []))
    p, data = TwoLinkParameters.from_model(model), mujoco.MjData(model)
    for _ in range(100):
        q, dq = rng.uniform(-math.pi, math.pi, 2), rng.normal(0, 5, 2)
        tau, w = rng.normal(0, 5, 2), rng.normal(0, 5, (3, 6))
        data.qpos[:], data.qvel[:], data.ctrl[:], data.xfrc_applied[1:] = q, dq, tau, w
        mujoco.mj_forward(model, data)
        forces = [tau, generalized_force(q, w, p), coriolis(q, dq, p), gravity(q, p)]
        largest = max(np.abs(np.linalg.solve(inertia(q, p), force)).max() for force in forces)
        difference = np.abs(acceleration(q, dq, tau, w, p) - data.qacc).max()
        assert difference < AGREEMENT * largest


# Edits


def test_length_edits_move_what_hangs_on_the_link(model: mujoco.MjModel) -> None:
    """Only that: each edit changes the numbers of its own link."""
    p = asdict(TwoLinkParameters.from_model(model))
    longer = {
        "upper": {"l1": 0.75, "c1": 0.375, "I1": 2.25 * p["I1"]},
        "lower": {"l2": 0.6, "c2": 0.3, "I2": 2.25 * p["I2"]},
        "payload": {},
    }
    for body, changes in longer.items():
        other = edited(BodyEdit(body, length_scale=1.5))
        found = asdict(TwoLinkParameters.from_model(other))
        assert found == pytest.approx({**p, **changes}, rel=1e-15), body
        reach = posed(other, np.zeros(2)).site("tip").xpos[0]
        ball = posed(other, np.zeros(2)).body("payload").xpos[0]
        assert reach == ball == pytest.approx(found["l1"] + found["l2"], rel=1e-15)


def test_payload_edit_is_a_mass_at_the_tip(model: mujoco.MjModel) -> None:
    """x5 adds 0.8 kg at the tip: 0.8 J^T J of the tip's Jacobian."""
    other, q = edited(BodyEdit("payload", mass_scale=5)), np.array([0.4, -2.0])
    jacobian = np.zeros((3, 2))
    mujoco.mj_jacSite(model, posed(model, q), jacobian, None, model.site("tip").id)
    added = mass_matrix(other, q) - mass_matrix(model, q)
    np.testing.assert_allclose(added, 0.8 * jacobian.T @ jacobian, atol=1e-15)

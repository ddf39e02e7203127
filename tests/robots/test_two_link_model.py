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
    elbow_up,
    energy,
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


def test_names_and_order_that_other_code_relies_on(model: mujoco.MjModel) -> None:
    assert [model.body(i).name for i in range(model.nbody)] == ["world", *BODIES]
    assert [model.joint(i).name for i in range(model.njnt)] == ["shoulder", "elbow"]
    assert [model.actuator(i).name for i in range(model.nu)] == ["shoulder_torque", "elbow_torque"]
    assert [model.site(i).name for i in range(model.nsite)] == ["tip"]
    assert [model.camera(i).name for i in range(model.ncam)] == ["fixed", "wide", "follow"]


def test_the_ghost_shows_both_links_and_the_payload(model: mujoco.MjModel) -> None:
    names = [model.geom(i).name for i in range(model.ngeom) if model.geom_group[i] == 2]
    assert names == ["upper_rod", "lower_rod", "ball"]


def test_nothing_drawn_has_mass() -> None:
    spec = mujoco.MjSpec.from_file(str(FILE))
    full = compile_spec(spec)
    for geom in list(spec.geoms):
        spec.delete(geom)
    bare = compile_spec(spec)
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_M0"):
        np.testing.assert_array_equal(getattr(bare, field), getattr(full, field), field)


# The numbers


def test_numbers_of_the_nominal_arm(model: mujoco.MjModel) -> None:
    expected = TwoLinkParameters(
        m1=1.5,
        l1=0.5,
        c1=0.25,
        I1=0.03125,
        m2=1.0,
        l2=0.4,
        c2=0.2,
        I2=0.16 / 12,
        mp=0.2,
        Ip=0.0,
        g=9.8,
    )
    assert asdict(TwoLinkParameters.from_model(model)) == pytest.approx(asdict(expected), rel=1e-15)
    assert not model.actuator_ctrllimited.any()
    np.testing.assert_array_equal(model.actuator_gear, [[1, 0, 0, 0, 0, 0]] * 2)


def test_links_are_uniform_rods(model: mujoco.MjModel) -> None:
    p = TwoLinkParameters.from_model(model)
    assert (p.c1, p.c2) == (p.l1 / 2, p.l2 / 2)
    assert pytest.approx((p.m1 * p.l1**2 / 12, p.m2 * p.l2**2 / 12), rel=1e-15) == (p.I1, p.I2)


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


def test_the_dots_are_a_circle_that_the_elbow_bends_for(model: mujoco.MjModel) -> None:
    p = TwoLinkParameters.from_model(model)
    dots = [i for i in range(model.ngeom) if model.geom(i).name.startswith("dot")]
    assert len(dots) == 40
    bends = []
    for i in dots:
        x, y, z = model.geom_pos[i] - model.body("upper").pos
        assert (y, math.hypot(x - 0.45, z - 0.15)) == pytest.approx((0, 0.15), abs=1e-14)
        q = elbow_up(np.array([x, z]), p)
        np.testing.assert_allclose(tip(q, p), [x, z], atol=1e-14)
        bends.append(-math.degrees(q[1]))
    assert 92 < min(bends) < max(bends) < 141


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


def test_free_motion_keeps_its_energy(model: mujoco.MjModel) -> None:
    """Two seconds of falling with up to 13.6 J of motion; RK4 at 1 ms strays by 8e-8 J."""
    p = TwoLinkParameters.from_model(model)
    data = posed(model, np.array([0.0, 0.5]))
    start, speeds = energy(data.qpos, data.qvel, p), []
    for _ in range(2000):
        mujoco.mj_step(model, data)
        speeds.append(np.abs(data.qvel).max())
        assert energy(data.qpos, data.qvel, p) == pytest.approx(start, abs=1e-6)
    assert max(speeds) > 5


# Edits


@pytest.mark.parametrize("body", BODIES[:2])
def test_edit_scales_the_links_inertia_by_a_b_squared(model: mujoco.MjModel, body: str) -> None:
    a, b = 3.0, 1.5
    other = edited(BodyEdit(body, a, b))
    scaled, nominal = other.body(body), model.body(body)
    np.testing.assert_allclose(scaled.inertia, a * b**2 * nominal.inertia, rtol=1e-15)
    np.testing.assert_allclose(scaled.ipos, b * nominal.ipos, rtol=1e-15)
    assert scaled.mass[0] == a * nominal.mass[0]


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

"""Edits of mass and length: the compiled model against closed forms of similar bodies."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ModelError
from grosmc_mj.physics.edits import AddedMass, BodyEdit, Edit, JointEdit, apply_edits
from grosmc_mj.physics.files import compile_spec, load_model
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import ArmParameters, CartPendulumParameters, Variant

MOVING = [
    ("servo", "rotor"),
    ("cart_pendulum", "cart"),
    ("cart_pendulum", "pole"),
    ("arm", "link"),
    ("two_link_arm", "payload"),
]
SCALES = [(4.0, 4.0), (0.3, 1.0), (1.0, 0.7), (2.5, 0.4)]
every_body = pytest.mark.parametrize(("name", "body"), MOVING)
every_scale = pytest.mark.parametrize(("a", "b"), SCALES)
# One multiplication or two, then MuJoCo's own: a few units in the last place.
ROUNDING = 1e-14


def edited(name: str, *edits: BodyEdit) -> mujoco.MjModel:
    return MujocoPlant.load(name, edits=edits).model


def saved(model: mujoco.MjModel) -> NDArray[np.uint8]:
    """Every bit of a model."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer


def at(model: mujoco.MjModel, *q: float) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    return data


def mass_matrix(model: mujoco.MjModel, *q: float) -> Array:
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, at(model, *q), full)
    return full


# The body stays similar to itself


@every_body
@every_scale
def test_mass_inertia_and_centre_of_mass(name: str, body: str, a: float, b: float) -> None:
    before, after = load_model(name).body(body), edited(name, BodyEdit(body, a, b)).body(body)
    np.testing.assert_allclose(after.mass, a * before.mass, rtol=ROUNDING)
    np.testing.assert_allclose(after.inertia, a * b**2 * before.inertia, rtol=ROUNDING)
    np.testing.assert_allclose(after.ipos, b * before.ipos, rtol=ROUNDING)
    np.testing.assert_array_equal(after.iquat, before.iquat)


@every_body
@every_scale
def test_what_is_drawn_and_attached(name: str, body: str, a: float, b: float) -> None:
    """Geoms and sites of the body scale about its origin; those of other bodies stay."""
    before, after = load_model(name), edited(name, BodyEdit(body, a, b))
    drawn = before.geom_bodyid == before.body(body).id
    attached = before.site_bodyid == before.body(body).id
    assert drawn.any()
    for field, of_body in (("geom_size", drawn), ("geom_pos", drawn), ("site_pos", attached)):
        factor = np.where(of_body, b, 1.0)[:, None]
        # A geom between two points has its middle rounded at the size of its ends, 1 m.
        np.testing.assert_allclose(
            getattr(after, field), factor * getattr(before, field), rtol=1e-12, atol=1e-15
        )
    np.testing.assert_allclose(after.geom_quat, before.geom_quat, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(after.geom_type, before.geom_type)


@every_body
def test_a_body_keeps_its_place_and_the_others_everything(name: str, body: str) -> None:
    before, after = load_model(name), edited(name, BodyEdit(body, 3.0, 2.0))
    np.testing.assert_array_equal(after.body(body).pos, before.body(body).pos)
    others = [i for i in range(before.nbody) if before.body(i).name != body]
    for field in ("body_mass", "body_inertia", "body_ipos", "body_pos"):
        np.testing.assert_array_equal(getattr(after, field)[others], getattr(before, field)[others])
    for field in ("dof_damping", "dof_armature", "tendon_armature", "actuator_gear"):
        np.testing.assert_array_equal(getattr(after, field), getattr(before, field))


# What it means for each plant


@given(st.floats(0.25, 4), st.floats(0.5, 4))
@settings(max_examples=20)
def test_pole_is_a_rod_of_the_new_mass_and_length(a: float, b: float) -> None:
    model = edited("cart_pendulum", BodyEdit("pole", a, b))
    m, length = 0.2 * a, 1.0 * b
    np.testing.assert_allclose(model.body("pole").inertia[:2], m * length**2 / 12, rtol=1e-14)
    np.testing.assert_allclose(model.site("tip").pos, [0, 0, length], rtol=1e-14)
    # About the hinge a rod has m length^2/3.
    assert mass_matrix(model, 0.0, 0.4)[1, 1] == pytest.approx(m * length**2 / 3, rel=1e-13)
    found = CartPendulumParameters.from_model(model, "corrected")
    assert (found.M, found.m, found.L) == pytest.approx((1.0, m, length / 2), rel=1e-14)


@pytest.mark.parametrize(("a", "b"), [(2.0, 1.25), (4.0, 0.5), (0.25, 4.0)])
def test_payload_edit_changes_the_arm_by_m_l2_and_m_g_l(a: float, b: float) -> None:
    """M(q) = J + m l^2 + M_c (1 + sin q) and G = m g l cos q; J and M_c are not the link's."""
    model = edited("arm", BodyEdit("link", a, b))
    m, length = 0.02 * a, 0.5 * b
    for q in np.linspace(-4.5, 1.5, 13):
        inertia = 0.035 + m * length**2 + 0.06 * (1 + math.sin(q))
        # The cable's direction loses digits as its length goes to zero at pi/2.
        assert mass_matrix(model, q)[0, 0] == pytest.approx(inertia, abs=1e-12)
        gravity = at(model, q).qfrc_bias[0]
        assert gravity == pytest.approx(m * 9.8 * length * math.cos(q), abs=1e-14)


def test_a_hub_whose_eyelet_left_the_drums_radius_has_no_analytic_twin() -> None:
    longer = MujocoPlant.load("arm", edits=(BodyEdit("hub", length_scale=2.0),))
    with pytest.raises(ModelError, match="same radius"):
        longer.analytic()


@pytest.mark.parametrize("variant", ["printed", "corrected"])
def test_the_twin_has_the_edited_numbers(variant: Variant) -> None:
    plant = MujocoPlant.load("arm", edits=(BodyEdit("link", 2.0, 1.25),))
    found = plant.analytic(variant).parameters
    assert isinstance(found, ArmParameters)
    numbers = (found.m, found.l, found.M_c, found.J)
    assert numbers == pytest.approx((0.04, 0.625, 0.06, 0.035), rel=1e-12)


# Nothing else changes


def test_edits_touch_neither_the_spec_nor_the_nominal_plant(name: str) -> None:
    body = dict(MOVING)[name]
    plant = MujocoPlant.load(name)
    text, bits = plant.spec.to_xml(), saved(plant.model)
    changed = plant.edited(BodyEdit(body, 4.0, 4.0))
    assert not np.array_equal(saved(changed.model), bits)
    assert plant.spec.to_xml() == text
    np.testing.assert_array_equal(saved(plant.model), bits)
    np.testing.assert_array_equal(saved(plant.edited().model), bits)
    np.testing.assert_array_equal(saved(MujocoPlant.load(name).model), bits)


def test_a_mass_and_an_inertia_replace_the_nominal_ones() -> None:
    """The inertia scales with a mass alone; without a mass the nominal one stays."""
    nominal, heavier = edited("servo").body("rotor"), edited("servo", BodyEdit("rotor", mass=5.77))
    rotor = heavier.body("rotor")
    assert rotor.mass[0] == 5.77
    np.testing.assert_allclose(rotor.inertia, 2.0 * nominal.inertia, rtol=ROUNDING)
    moments = (0.05, 0.09, 0.05)
    rotor = edited("servo", BodyEdit("rotor", inertia=moments)).body("rotor")
    assert (rotor.mass[0], *rotor.inertia) == (2.885, *moments)


# Fresh constants


# What is refused


# --- loads, joints and meshes ---

LOADED = """
<mujoco>
  <asset>
    <mesh name="wedge" scale="2 2 2" vertex="0 0 0  0.2 0 0  0 0.1 0  0 0 0.3"/>
    <mesh name="shared" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/>
  </asset>
  <worldbody>
    <body name="link">
      <joint name="j" damping="0.5" frictionloss="0.1" armature="0.2"/>
      <geom type="box" size="0.1 0.2 0.3" pos="0.1 0 0.2" euler="10 20 30" mass="2"/>
      <body name="horn" pos="0 0 0.4"><geom type="mesh" mesh="wedge" density="500"/></body>
      <body name="one"><geom type="mesh" mesh="shared" density="500"/></body>
      <body name="two"><geom type="mesh" mesh="shared" density="500"/></body>
    </body>
  </worldbody>
</mujoco>
"""


def about_origin(model: mujoco.MjModel, name: str) -> Array:
    """A body's inertia about its own origin in its own axes: what only adds up."""
    body, rotation = model.body(name), np.zeros(9)
    mujoco.mju_quat2Mat(rotation, body.iquat)
    axes, c = rotation.reshape(3, 3), body.ipos
    inertia = axes @ np.diag(body.inertia) @ axes.T
    return inertia + body.mass[0] * (c @ c * np.eye(3) - np.outer(c, c))


def changed(*edits: Edit) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    spec = mujoco.MjSpec.from_string(LOADED)
    return spec.compile(), apply_edits(spec, edits).compile()


def test_a_load_adds_its_mass_its_moment_and_its_inertia() -> None:
    loads = (AddedMass("link", 0.7, (0.1, -0.3, 0.5)), AddedMass("link", 0.2, (-0.2, 0.0, 0.1)))
    before, after = changed(*loads)
    mass = before.body("link").mass[0] + 0.9
    moment = before.body("link").mass[0] * before.body("link").ipos
    inertia = about_origin(before, "link")
    for load in loads:
        r = np.array(load.position)
        moment = moment + load.mass * r
        inertia = inertia + load.mass * (r @ r * np.eye(3) - np.outer(r, r))
    assert after.body("link").mass[0] == pytest.approx(mass, rel=1e-15)
    np.testing.assert_allclose(after.body("link").ipos, moment / mass, rtol=0, atol=1e-15)
    np.testing.assert_allclose(about_origin(after, "link"), inertia, rtol=0, atol=1e-14)
    assert after.ngeom == before.ngeom + 2
    spheres = after.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    assert not after.geom_contype[spheres].any()


@pytest.mark.parametrize("compiler", ['inertiafromgeom="true"', 'settotalmass="7"'])
def test_a_model_that_sets_its_masses_itself_has_those_of_the_edits(compiler: str) -> None:
    spec = mujoco.MjSpec.from_string(LOADED.replace("<asset>", f"<compiler {compiler}/><asset>"))
    heavier = BodyEdit("horn", 3.0, 2.0), AddedMass("link", 0.7, (0.1, 0.0, 0.0))
    before, after = compile_spec(spec), compile_spec(apply_edits(spec, heavier))
    added = {"link": 0.7, "horn": 2 * before.body("horn").mass[0]}
    for index in range(1, before.nbody):
        body = before.body(index)
        wanted = body.mass[0] + added.get(body.name, 0.0)
        assert after.body(index).mass[0] == pytest.approx(wanted, rel=1e-12)
    np.testing.assert_allclose(
        about_origin(after, "horn"), 12 * about_origin(before, "horn"), rtol=1e-12
    )
    np.testing.assert_allclose(about_origin(after, "one"), about_origin(before, "one"), rtol=1e-12)


def test_a_load_on_a_scaled_body_sits_where_its_position_says() -> None:
    before, after = changed(AddedMass("link", 1.0, (0.5, 0, 0)), BodyEdit("link", 2.0, 1.5))
    own, mass = before.body("link"), before.body("link").mass[0]
    wanted = (2 * mass * 1.5 * own.ipos + [0.5, 0, 0]) / (2 * mass + 1)
    np.testing.assert_allclose(after.body("link").ipos, wanted, rtol=0, atol=1e-15)


def test_a_joint_edit_sets_what_it_names_only() -> None:
    _, after = changed(JointEdit("j", damping=3.0, friction=0.0))
    assert after.dof_damping[0] == 3.0
    assert after.dof_frictionloss[0] == 0.0
    assert after.dof_armature[0] == 0.2
    _, after = changed(JointEdit("j", armature=0.9))
    assert (after.dof_damping[0], after.dof_frictionloss[0]) == (0.5, 0.1)
    assert after.dof_armature[0] == 0.9


@pytest.mark.parametrize("tilt", [math.radians(60), -0.4])
@pytest.mark.parametrize(
    ("axis", "towards"),
    [
        ((0, -1, 0), (0, 0, 1)),
        ((1, 2, -2), (0, 0, 1)),
        ((0, 0, 1), (1, 0, 0)),
        ((0, 0, -1), (1, 0, 0)),
    ],
)
def test_a_tilt_turns_an_axis_by_its_angle_towards_z_or_from_z_towards_x(
    axis: tuple[float, ...], towards: tuple[float, ...], tilt: float
) -> None:
    """Against MuJoCo's own rotation by a quaternion."""
    before = np.array(axis) / np.linalg.norm(axis)
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="b", mass=1.0, inertia=[1, 1, 1], explicitinertial=True)
    body.add_joint(name="j", axis=before)
    after = compile_spec(apply_edits(spec, [JointEdit("j", tilt=tilt)])).jnt_axis[0]
    about, turn, wanted = np.cross(before, towards), np.zeros(4), np.zeros(3)
    mujoco.mju_axisAngle2Quat(turn, about / np.linalg.norm(about), tilt)
    mujoco.mju_rotVecQuat(wanted, before, turn)
    np.testing.assert_allclose(after, wanted, rtol=0, atol=1e-12)
    assert after @ before == pytest.approx(math.cos(tilt), rel=1e-12)


def test_a_body_drawn_by_a_mesh_of_its_own_stays_similar_to_itself() -> None:
    before, after = changed(BodyEdit("horn", length_scale=1.3))
    np.testing.assert_allclose(
        after.mesh_vert,
        np.where(np.arange(before.nmeshvert)[:, None] < before.mesh_vertnum[0], 1.3, 1.0)
        * before.mesh_vert,
        rtol=1e-6,
        atol=1e-9,
    )  # vertices are float32
    np.testing.assert_allclose(
        about_origin(after, "horn"), 1.69 * about_origin(before, "horn"), rtol=1e-12
    )


REFUSED: list[tuple[Callable[[], Any], str]] = [
    (lambda: BodyEdit("pole", mass_scale=0.0), "edit of 'pole': mass_scale = 0 must be"),
    (lambda: BodyEdit("pole", length_scale=math.inf), "length_scale = inf must be finite"),
    (lambda: AddedMass("link", math.nan), "mass = nan must be finite and positive"),
    (lambda: AddedMass("link", 1.0, (0.0, math.inf, 0.0)), "3 finite numbers"),
    (lambda: JointEdit("j", damping=-1.0), "damping = -1 must be finite"),
    (lambda: changed(BodyEdit("world", 2.0)), "unknown body 'world'.*valid: link, horn, one, two"),
    (lambda: changed(AddedMass("lnk", 1.0)), "unknown body 'lnk': did you mean 'link'"),
    (lambda: changed(JointEdit("k", damping=1.0)), "unknown joint 'k'"),
    (lambda: changed(BodyEdit("one", 2.0), BodyEdit("one", 3.0)), "'one' has two of the kind"),
    (lambda: changed(BodyEdit("one", length_scale=2.0)), "geom 'shared' of body 'one'"),
    (lambda: edited("servo", BodyEdit("rotor", 1e-16)), "mass and inertia of moving bodies"),
]


@pytest.mark.parametrize(("make", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_an_edit_that_cannot_be_is_refused(make: Callable[[], Any], words: str) -> None:
    with pytest.raises(ModelError, match=words) as refused:
        make()
    assert "\n" not in str(refused.value)

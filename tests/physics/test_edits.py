"""Edits of a model: closed forms of similar bodies, written and compiled models bit for bit."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest

from grosmc_mj.errors import ModelError
from grosmc_mj.physics.edit import Edit
from grosmc_mj.physics.edits import AddedMass, BodyEdit, InputEdit, JointEdit, apply_edits
from grosmc_mj.physics.files import compile_spec, load_model
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.steppers import Steppers

MOVING = [("servo", "rotor"), ("cart_pendulum", "cart"), ("cart_pendulum", "pole"),
          ("arm", "link"), ("two_link_arm", "payload")]  # fmt: skip


def edited(name: str, *edits: Edit) -> mujoco.MjModel:
    return MujocoPlant.load(name, edits=edits).model


def saved(model: mujoco.MjModel) -> bytes:
    """Every bit of a model."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


@pytest.mark.parametrize(("name", "body"), MOVING)
def test_a_body_stays_similar_to_itself_and_the_others_and_the_plant_as_they_are(name, body):
    before, index, plant = load_model(name), load_model(name).body(body).id, MujocoPlant.load(name)
    text, bits = plant.spec.to_xml(), saved(plant.model)
    for a, b in ((4.0, 4.0), (0.3, 1.0), (2.5, 0.4)):
        after = plant.edited(BodyEdit(body, a, b)).model
        factors = {"body_mass": a, "body_inertia": a * b**2, "body_ipos": b, "body_pos": 1.0,
                   "geom_size": b, "geom_pos": b, "site_pos": b}  # fmt: skip
        for field, factor in factors.items():
            owner = {"body": np.arange(before.nbody), "geom": before.geom_bodyid,
                     "site": before.site_bodyid}[field.split("_")[0]]  # fmt: skip
            if field == "body_pos":  # its own place stays, its children's are lengths of it
                owner, factor = before.body_parentid, b
            values = getattr(before, field)
            scale = np.where(owner == index, factor, 1.0).reshape(-1, *[1] * (values.ndim - 1))
            # A geom between two points has its middle rounded at the size of its ends, 1 m.
            rtol = 1e-12 if field.startswith("geom") else 1e-14
            np.testing.assert_allclose(getattr(after, field), scale * values, rtol=rtol, atol=1e-15)
            if not field.startswith("geom"):
                others = owner != index
                np.testing.assert_array_equal(getattr(after, field)[others], values[others])
        np.testing.assert_allclose(after.geom_quat, before.geom_quat, rtol=0, atol=1e-12)
        for field in ("body_iquat", "dof_damping", "dof_armature", "actuator_gear"):
            np.testing.assert_array_equal(getattr(after, field), getattr(before, field))
    plant.analytic()
    assert plant.spec.to_xml() == text
    assert saved(plant.model) == saved(plant.edited().model) == bits


def test_a_mass_and_an_inertia_replace_the_nominal_ones() -> None:
    """The inertia scales with a mass alone; without a mass the nominal one stays."""
    nominal = edited("servo").body("rotor")
    rotor = edited("servo", BodyEdit("rotor", mass=5.77)).body("rotor")
    assert rotor.mass[0] == 5.77
    np.testing.assert_allclose(rotor.inertia, 2.0 * nominal.inertia, rtol=1e-14)
    moments = (0.05, 0.09, 0.05)
    rotor = edited("servo", BodyEdit("rotor", inertia=moments)).body("rotor")
    assert (rotor.mass[0], *rotor.inertia) == (2.885, *moments)


# Loads, joints and meshes

LOADED = """
<mujoco>{}<asset><mesh name="wedge" scale="2 2 2" vertex="0 0 0  0.2 0 0  0 0.1 0  0 0 0.3"/>
  <mesh name="shared" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/></asset>
  <worldbody><body name="link">
    <joint name="j" damping="0.5" frictionloss="0.1" armature="0.2"/>
    <geom type="box" size="0.1 0.2 0.3" pos="0.1 0 0.2" euler="10 20 30" mass="2"/>
    <body name="horn" pos="0 0 0.4"><geom type="mesh" mesh="wedge" density="500"/></body>
    <body name="one"><geom type="mesh" mesh="shared" density="500"/></body>
    <body name="two"><geom type="mesh" mesh="shared" density="500"/></body>
  </body></worldbody></mujoco>
"""


def changed(*edits: Edit, compiler: str = "") -> tuple[mujoco.MjModel, mujoco.MjModel]:
    spec = mujoco.MjSpec.from_string(LOADED.format(compiler))
    return compile_spec(spec), compile_spec(apply_edits(spec, edits))


def about_origin(model: mujoco.MjModel, name: str) -> list[Any]:
    """A body's mass, moment and inertia about its own origin in its own axes: they add up."""
    body, rotation = model.body(name), np.zeros(9)
    mujoco.mju_quat2Mat(rotation, body.iquat)
    axes, m = rotation.reshape(3, 3), body.mass[0]
    return [m, m * body.ipos, axes @ np.diag(body.inertia) @ axes.T + m * steiner(body.ipos)]


def steiner(r: Any) -> Any:
    return np.dot(r, r) * np.eye(3) - np.outer(r, r)


@pytest.mark.parametrize(
    "compiler", ["", '<compiler inertiafromgeom="true"/>', '<compiler settotalmass="7"/>']
)
def test_loads_add_mass_moment_and_inertia_whoever_sets_the_masses(compiler) -> None:
    """Where their positions say, in a scaled body too."""
    loads = AddedMass("link", 0.7, (0.1, -0.3, 0.5)), AddedMass("link", 0.2, (-0.2, 0.0, 0.1))
    horn = BodyEdit("horn", 3.0, 2.0)
    for a, b in ((1.0, 1.0), (2.0, 1.5)):
        before, after = changed(*loads, BodyEdit("link", a, b), horn, compiler=compiler)
        for body, (c, d), items in (("link", (a, b), loads), ("horn", (3, 2), ()),
                                    ("one", (1, 1), ())):  # fmt: skip
            for i, part in enumerate(about_origin(before, body)):
                right = c * d**i * part
                for load in items:
                    r = np.array(load.position)
                    right = right + load.mass * [1, r, steiner(r)][i]
                actual = about_origin(after, body)[i]
                np.testing.assert_allclose(actual, right, rtol=1e-12, atol=1e-14)
        assert after.ngeom == before.ngeom + 2
        assert not after.geom_contype[after.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE].any()
        # A mesh of the body's own is scaled; vertices are float32.
        own = np.arange(before.nmeshvert)[:, None] < before.mesh_vertnum[0]
        vertices = np.where(own, 2.0, 1.0) * before.mesh_vert
        np.testing.assert_allclose(after.mesh_vert, vertices, rtol=1e-6, atol=1e-9)


def test_a_joint_edit_sets_its_own_numbers_only() -> None:
    for edit, numbers in ((JointEdit("j", damping=3.0, friction=0.0), (3.0, 0.0, 0.2)),
                          (JointEdit("j", armature=0.9), (0.5, 0.1, 0.9))):  # fmt: skip
        after = changed(edit)[1]
        fields = after.dof_damping, after.dof_frictionloss, after.dof_armature
        assert tuple(field[0] for field in fields) == numbers


@pytest.mark.parametrize("tilt", [math.radians(60), -0.4])
def test_a_tilt_turns_an_axis_by_its_angle_towards_z_or_from_z_towards_x(tilt) -> None:
    s, c, level = math.sin(tilt), math.cos(tilt), 1 / math.sqrt(2)
    for axis, expected in (((0, -1, 0), (0, -c, s)), ((2, 2, 0), (c * level, c * level, s)),
                           ((0, 0, 1), (s, 0, c)), ((0, 0, -1), (s, 0, -c))):  # fmt: skip
        spec = mujoco.MjSpec()
        body = spec.worldbody.add_body(name="b", mass=1.0, inertia=[1, 1, 1], explicitinertial=True)
        body.add_joint(name="j", axis=axis)
        after = compile_spec(apply_edits(spec, [JointEdit("j", tilt=tilt)])).jnt_axis[0]
        np.testing.assert_allclose(after, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: BodyEdit("pole", inertia=(1, 0, 1)), "must be positive"),
        (lambda: changed(BodyEdit("world", 2.0)), "body 'world'.*valid: link, horn, one, two"),
        (lambda: changed(BodyEdit("one", length_scale=2.0)), "geom 'shared' of body 'one'"),
        (lambda: edited("servo", BodyEdit("rotor", 1e-16)), "mass and inertia of moving bodies"),
    ],
)
def test_an_edit_that_cannot_be_is_refused(call, words) -> None:
    with pytest.raises(ModelError, match=words):
        call()


# Edits written into a compiled model: the same model as a compiler makes, or none

PLAIN = MujocoPlant.load("cart_pendulum")
HEAVIER = (BodyEdit("pole", 2.0),)


def numbers(plant: MujocoPlant) -> Any:
    """The numbers of its equations, or why it has none."""
    try:
        return plant.analytic().parameters
    except ModelError as error:
        return str(error)


def test_a_written_model_is_the_compiled_one_bit_for_bit(name: str) -> None:
    """Whatever has been written into it before."""
    nominal, random, steppers = MujocoPlant.load(name), np.random.default_rng(0), Steppers(1e-3)
    model = nominal.model
    bodies = [model.body(i).name for i in range(1, model.nbody) if model.body_mass[i] > 0]
    for gear, chosen in ((0, []), (0, bodies[:1]), (3, []), (0, bodies), (2, bodies[-1:]), (0, [])):
        edits = [BodyEdit(body, *random.uniform(0.1, 10, 2).tolist()) for body in chosen]
        gears = [InputEdit(model.actuator(0).name, gear)] if gear else []
        plant, again = (nominal.edited(*edits, *gears) for _ in range(2))
        run, before = steppers.of(plant).model, numbers(again)
        written, compiled = plant.template.written(plant.edits), again.undrawn_model
        assert written is not None
        for field in (name for name in dir(compiled) if name[0] != "_"):
            value = getattr(compiled, field)
            if isinstance(value, np.ndarray):
                np.testing.assert_array_equal(getattr(run, field), value)
                np.testing.assert_array_equal(getattr(written, field), value)
        assert numbers(again) == before


def other(change: Any) -> MujocoPlant:
    """The pendulum with a change of its model."""
    spec = PLAIN.spec.copy()
    change(spec)
    return MujocoPlant(PLAIN.system, spec)


def limit_the_hinge(spec: mujoco.MjSpec) -> None:
    spec.joints[1].range, spec.joints[1].limited = np.array([-1.0, 1.0]), 1


ROD = {"type": mujoco.mjtSensor.mjSENS_FRAMEPOS, "objtype": mujoco.mjtObj.mjOBJ_GEOM}
HINGED = {"type": mujoco.mjtEq.mjEQ_JOINT, "objtype": mujoco.mjtObj.mjOBJ_JOINT, "name1": "hinge"}


@pytest.mark.parametrize(
    ("plant", "edits"),
    [
        # A geom that a sensor refers to is no mere look.
        (other(lambda spec: spec.add_sensor(objname="rod", **ROD)), (BodyEdit("pole", 1.0, 2.0),)),
        (other(lambda spec: spec.body("pole").add_body(name="mount")), (BodyEdit("mount", 2.0),)),
        # Constraints are solved by a mean inertia that a compiler alone computes.
        *((other(change), HEAVIER) for change in (
            limit_the_hinge, lambda spec: setattr(spec.joints[1], "frictionloss", 0.1),
            lambda spec: spec.add_equality(**HINGED),
        )),
        *((PLAIN, edits) for edits in (
            (JointEdit("hinge", damping=1.0),), (AddedMass("pole", 0.1),), 2 * HEAVIER,
            (BodyEdit("pole", mass=1.0),), (BodyEdit("nobody", 2.0),), (InputEdit("nothing", 2.0),),
            (BodyEdit("pole", 1e-300),), (BodyEdit("pole", 1e200, 1e200),),
        )),
    ],
)  # fmt: skip
def test_a_change_that_only_a_compiler_can_tell_is_left_to_it(plant, edits) -> None:
    assert plant.template.changes(edits) is None
    assert plant.template.written(edits) is None


# Plants without their looks


# A ball that falls on a floor, with a part that is only drawn and gives the ball its inertia, and
# objects of sensors.
FALLING = """
<mujoco><option density="1000"/><asset><material name="red" rgba="1 0 0 1"/></asset>
  <default><default class="air"><geom contype="0" conaffinity="0"/></default></default>
  <worldbody><camera name="seen"/> <camera name="film"/> <light name="sun"/>
    <geom name="floor" type="plane" size="1 1 1" material="red"/>
    <body name="ball" pos="0 0 0.4"><joint name="slide" type="slide" axis="0 0 1"/>
      <geom name="touching" size="0.1" mass="0.3"/>
      <geom name="drawn" class="air" type="box" size="0.1 0.2 0.3" euler="1 2 3"/>
      <geom name="fin" class="air" type="ellipsoid" size="0.1 0.2 0.3" fluidshape="ellipsoid"/>
      <geom name="felt" class="air" size="0.1"/> <site name="site" material="red"/>
  </body></worldbody>
  <actuator><motor name="motor" joint="slide"/></actuator>
  <sensor><framepos objtype="geom" objname="felt"/>
    <camprojection site="site" camera="seen"/></sensor>
</mujoco>
"""


def test_parts_that_act_stay() -> None:
    """Contacts, a fin in water, objects of sensors, and the inertia of dropped geoms."""
    plant = Robot.from_mjcf(FALLING).plant
    full, bare = plant.model, plant.undrawn_model
    names = [bare.geom(i).name for i in range(bare.ngeom)]
    assert names == ["floor", "touching", "fin", "felt"]
    assert [bare.camera(i).name for i in range(bare.ncam)] == ["seen"]
    assert (bare.nlight, bare.nmat) == (0, 0)
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat"):
        np.testing.assert_array_equal(getattr(bare, field), getattr(full, field))
    one, other = mujoco.MjData(full), mujoco.MjData(bare)
    mujoco.mj_step(full, one, nstep=400)
    mujoco.mj_step(bare, other, nstep=400)
    assert one.ncon == other.ncon > 0
    for field in ("qpos", "qvel", "sensordata"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field))

"""Edits of a model: closed forms of similar bodies, written and compiled models bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
import pytest

from grosmc_mj.ground.errors import ModelError
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.edits import AddedMass, BodyEdit, InputEdit, JointEdit, apply_edits
from grosmc_mj.mechanics.physics.files import compile_spec, load_model
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.simulation.steppers import Steppers


def edited(name: str, *edits: Edit) -> mujoco.MjModel:
    return MujocoPlant.load(name, edits=edits).model


def saved(model: mujoco.MjModel) -> bytes:
    """Every bit of a model."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


# Scaled bodies.


@dataclass
class Scaled:
    """A model before and after one of its bodies is scaled.

    Attributes:
        name: The system.
        body: Name of the body.
        a: Scale of the mass.
        b: Scale of the lengths.
    """

    name: str
    body: str
    a: float
    b: float

    @cached_property
    def before(self) -> mujoco.MjModel:
        return load_model(self.name)

    @cached_property
    def after(self) -> mujoco.MjModel:
        return edited(self.name, BodyEdit(self.body, self.a, self.b))

    def require(self, field: str, owner: Any, factor: float) -> None:
        """Require that rows of the body are scaled, and the others the same to the bit.

        A geom between two points has its middle rounded at the size of its ends, 1 m.
        """
        before = getattr(self.before, field)
        after = getattr(self.after, field)
        scaled = np.asarray(owner) == self.before.body(self.body).id
        np.testing.assert_allclose(after[scaled], factor * before[scaled], rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(after[~scaled], before[~scaled])


each_scaled = pytest.mark.parametrize(
    "scaled",
    [
        Scaled("servo", "rotor", 4.0, 4.0),
        Scaled("cart_pendulum", "cart", 0.3, 1.0),
        Scaled("cart_pendulum", "pole", 2.5, 0.4),
        Scaled("arm", "link", 0.3, 2.0),
        Scaled("two_link_arm", "upper", 4.0, 0.4),
        Scaled("two_link_arm", "payload", 2.5, 0.4),
    ],
)


@each_scaled
def test_a_scaled_body_is_similar_to_itself(scaled: Scaled) -> None:
    """The place of the body itself stays; those of its children are lengths of it."""
    before = scaled.before
    bodies = np.arange(before.nbody)
    scaled.require("body_mass", bodies, scaled.a)
    scaled.require("body_inertia", bodies, scaled.a * scaled.b**2)
    scaled.require("body_ipos", bodies, scaled.b)
    scaled.require("body_pos", before.body_parentid, scaled.b)
    scaled.require("site_pos", before.site_bodyid, scaled.b)
    scaled.require("geom_pos", before.geom_bodyid, scaled.b)
    scaled.require("geom_size", before.geom_bodyid, scaled.b)


@each_scaled
@pytest.mark.parametrize(
    "field", ["body_iquat", "geom_quat", "dof_damping", "dof_armature", "actuator_gear"]
)
def test_a_scaled_body_keeps_its_axes_joints_and_gears(scaled: Scaled, field: str) -> None:
    expected = getattr(scaled.before, field)
    np.testing.assert_allclose(getattr(scaled.after, field), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("name", "body"), [("cart_pendulum", "pole"), ("two_link_arm", "payload")])
def test_an_edited_plant_leaves_the_nominal_one(name: str, body: str) -> None:
    plant = MujocoPlant.load(name)
    text = plant.spec.to_xml()
    bits = saved(plant.model)
    _ = plant.changed(BodyEdit(body, 4.0, 4.0)).model
    plant.analytic()
    assert plant.spec.to_xml() == text
    assert saved(plant.model) == bits
    assert saved(plant.changed().model) == bits


def test_the_inertia_scales_with_a_given_mass() -> None:
    nominal = edited("servo").body("rotor")
    rotor = edited("servo", BodyEdit("rotor", mass=5.77)).body("rotor")
    assert rotor.mass[0] == 5.77
    np.testing.assert_allclose(rotor.inertia, 2.0 * nominal.inertia, rtol=1e-14)


def test_a_given_inertia_leaves_the_mass() -> None:
    moments = (0.05, 0.09, 0.05)
    rotor = edited("servo", BodyEdit("rotor", inertia=moments)).body("rotor")
    assert rotor.mass[0] == 2.885
    assert tuple(rotor.inertia) == moments


# Loads, joints and meshes

LOADED = """
<mujoco><asset><mesh name="wedge" scale="2 2 2" vertex="0 0 0  0.2 0 0  0 0.1 0  0 0 0.3"/>
  <mesh name="shared" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/></asset>
  <worldbody><body name="link">
    <joint name="j" damping="0.5" frictionloss="0.1" armature="0.2"/>
    <geom type="box" size="0.1 0.2 0.3" pos="0.1 0 0.2" euler="10 20 30" mass="2"/>
    <body name="horn" pos="0 0 0.4"><geom type="mesh" mesh="wedge" density="500"/>
      <camera pos="0.1 0 0.2"/><light pos="0 0.3 0"/></body>
    <body name="one"><geom type="mesh" mesh="shared" density="500"/></body>
    <body name="two"><geom type="mesh" mesh="shared" density="500"/></body>
    <body name="point"/>
  </body></worldbody></mujoco>
"""


def changed(
    *edits: Edit, compiler: dict[str, Any] | None = None
) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """The model before and after edits, with options of its compiler."""
    spec = mujoco.MjSpec.from_string(LOADED)
    for option, value in (compiler or {}).items():
        setattr(spec.compiler, option, value)
    return compile_spec(spec), compile_spec(apply_edits(spec, edits))


def moments(model: mujoco.MjModel, name: str) -> list[Any]:
    """A body's mass, moment and inertia about its own origin in its own axes: they add up."""
    body = model.body(name)
    m = body.mass[0]
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, body.iquat)
    axes = rotation.reshape(3, 3)
    inertia = axes @ np.diag(body.inertia) @ axes.T + m * steiner(body.ipos)
    return [m, m * body.ipos, inertia]


def moments_of_point(load: AddedMass) -> list[Any]:
    """Mass, moment and inertia of an added mass."""
    r = np.array(load.position)
    return [load.mass, load.mass * r, load.mass * steiner(r)]


def steiner(r: Any) -> Any:
    return np.dot(r, r) * np.eye(3) - np.outer(r, r)


def require_moments(model: mujoco.MjModel, name: str, expected: list[Any]) -> None:
    for actual, right in zip(moments(model, name), expected, strict=True):
        np.testing.assert_allclose(actual, right, rtol=1e-12, atol=1e-14)


LOADS = (AddedMass("link", 0.7, (0.1, -0.3, 0.5)), AddedMass("link", 0.2, (-0.2, 0.0, 0.1)))
HORN = BodyEdit("horn", 3.0, 2.0)
each_compiler = pytest.mark.parametrize(
    "compiler",
    [
        {},
        {"inertiafromgeom": mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE},
        {"settotalmass": 7.0},
    ],
)


@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (2.0, 1.5)])
@each_compiler
def test_loads_add_their_moments(compiler: dict[str, Any], a: float, b: float) -> None:
    """Mass, first moment and inertia, at their positions in the scaled body.

    They do so whatever sets the masses of the model.
    """
    before, after = changed(*LOADS, BodyEdit("link", a, b), HORN, compiler=compiler)
    expected = [a * b**i * moment for i, moment in enumerate(moments(before, "link"))]
    for load in LOADS:
        added = moments_of_point(load)
        expected = [moment + more for moment, more in zip(expected, added, strict=True)]
    require_moments(after, "link", expected)


@each_compiler
def test_loads_and_scales_leave_the_other_bodies(compiler: dict[str, Any]) -> None:
    """Loads are drawn as balls that touch nothing."""
    before, after = changed(*LOADS, HORN, compiler=compiler)
    horn = [3 * 2**i * moment for i, moment in enumerate(moments(before, "horn"))]
    require_moments(after, "horn", horn)
    require_moments(after, "one", moments(before, "one"))
    balls = after.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    assert balls.sum() == after.ngeom - before.ngeom == 2
    assert not after.geom_contype[balls].any()


def test_a_mesh_of_the_body_s_own_is_scaled() -> None:
    """Its vertices come first in the model; they are float32."""
    before, after = changed(HORN)
    expected = before.mesh_vert.copy()
    expected[: before.mesh_vertnum[0]] *= 2.0
    np.testing.assert_allclose(after.mesh_vert, expected, rtol=1e-6, atol=1e-9)


def test_cameras_and_lights_of_a_scaled_body_move_with_it() -> None:
    before, after = changed(HORN)
    np.testing.assert_allclose(after.cam_pos, 2 * before.cam_pos)
    np.testing.assert_allclose(after.light_pos, 2 * before.light_pos)


@pytest.mark.parametrize(
    ("edit", "damping", "friction", "armature"),
    [
        (JointEdit("j", damping=3.0, friction=0.0), 3.0, 0.0, 0.2),
        (JointEdit("j", armature=0.9), 0.5, 0.1, 0.9),
    ],
)
def test_a_joint_edit_sets_its_own_numbers_only(
    edit: JointEdit, damping: float, friction: float, armature: float
) -> None:
    _, after = changed(edit)
    assert after.dof_damping[0] == damping
    assert after.dof_frictionloss[0] == friction
    assert after.dof_armature[0] == armature


def servo_with(*edits: Edit) -> Any:
    """The servo, whose edits are finite and whose products with the model's numbers are not."""
    return lambda: MujocoPlant.load("servo").changed(*edits).undrawn_model


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: BodyEdit("pole", inertia=(1, 0, 1)), "must be positive"),
        (lambda: BodyEdit("pole", 2.0, mass=1.0), "mass and mass_scale: give the number or"),
        (
            lambda: BodyEdit("pole", 1.0, 2.0, inertia=(1, 1, 1)),
            "inertia and length_scale: give the number or",
        ),
        (lambda: InputEdit("current", 0.0), "gear = 0 must not be zero"),
        (lambda: changed(BodyEdit("world", 2.0)), "body 'world'.*valid: link, horn, one, two"),
        (lambda: changed(BodyEdit("one", length_scale=2.0)), "geom 'shared' of body 'one'"),
        (lambda: changed(BodyEdit("point", mass=1.0)), "body 'point' has no mass to scale"),
        (lambda: edited("servo", BodyEdit("rotor", 1e-16)), "mass and inertia of moving bodies"),
        (servo_with(BodyEdit("rotor", 1e308)), r"body_mass\[1\] = inf must be finite"),
        (servo_with(BodyEdit("rotor", 1.0, 1e200)), r"body_inertia\[1, 0\] = inf must be finite"),
        (servo_with(AddedMass("rotor", 1e308)), "= inf must be finite"),
        (
            servo_with(AddedMass("rotor", 1.0, (1e200, 0, 0))),
            "1 kg at .* m has no finite inertia",
        ),
    ],
)
def test_an_edit_that_cannot_be_is_refused(call: Any, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        call()


# Edits written into a compiled model: the same model as a compiler makes, or none


def require_same_arrays(actual: mujoco.MjModel, expected: mujoco.MjModel) -> None:
    for field in dir(expected):
        value = getattr(expected, field)
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(getattr(actual, field), value)


def test_a_written_model_is_the_compiled_one_bit_for_bit(name: str) -> None:
    """Whatever has been written into it before."""
    nominal = MujocoPlant.load(name)
    model = nominal.model
    actuator = model.actuator(0).name
    bodies = [model.body(i).name for i in range(1, model.nbody) if model.body_mass[i] > 0]
    all_bodies = [BodyEdit(body, 0.3 + i, 2.0 - 0.3 * i) for i, body in enumerate(bodies)]
    steppers = Steppers(1e-3)
    for edits in ([], all_bodies[:1], [InputEdit(actuator, 3)], [*all_bodies], []):
        plant = nominal.changed(*edits)
        run_model = steppers.of(plant).model
        written = plant._template.written(plant.edits)
        assert written is not None
        compiled = nominal.changed(*edits).undrawn_model
        require_same_arrays(run_model, compiled)
        require_same_arrays(written, compiled)


def test_the_numbers_of_the_equations_are_the_same_of_a_written_and_a_compiled_model() -> None:
    plant = PLAIN.changed(HEAVIER)
    written = plant.analytic().parameters
    assert plant.undrawn_model.nbody
    assert plant.analytic().parameters == written
    assert written != PLAIN.analytic().parameters


PLAIN = MujocoPlant.load("cart_pendulum")
HEAVIER = BodyEdit("pole", 2.0)


def sense_the_rod(spec: mujoco.MjSpec) -> None:
    """Let a sensor refer to a geom, which is no mere look then."""
    spec.add_sensor(
        type=mujoco.mjtSensor.mjSENS_FRAMEPOS,
        objtype=mujoco.mjtObj.mjOBJ_GEOM,
        objname="rod",
    )


def add_a_mount(spec: mujoco.MjSpec) -> None:
    spec.body("pole").add_body(name="mount")


# Constraints are solved by a mean inertia that a compiler alone computes.


def limit_the_hinge(spec: mujoco.MjSpec) -> None:
    spec.joints[1].range = np.array([-1.0, 1.0])
    spec.joints[1].limited = 1


def rub_the_hinge(spec: mujoco.MjSpec) -> None:
    spec.joints[1].frictionloss = 0.1


def hold_the_hinge(spec: mujoco.MjSpec) -> None:
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1="hinge",
    )


def require_compiled(plant: MujocoPlant, *edits: Edit) -> None:
    assert plant._template.changes(edits) is None
    assert plant._template.written(edits) is None


@pytest.mark.parametrize(
    ("change", "edit"),
    [
        (sense_the_rod, BodyEdit("pole", 1.0, 2.0)),
        (add_a_mount, BodyEdit("mount", 2.0)),
        (limit_the_hinge, HEAVIER),
        (rub_the_hinge, HEAVIER),
        (hold_the_hinge, HEAVIER),
    ],
)
def test_an_edit_of_a_model_that_only_a_compiler_can_tell_is_left_to_it(
    change: Any, edit: Edit
) -> None:
    spec = PLAIN.spec.copy()
    change(spec)
    require_compiled(MujocoPlant(PLAIN.system, spec), edit)


@pytest.mark.parametrize(
    "edits",
    [
        (JointEdit("hinge", damping=1.0),),
        (AddedMass("pole", 0.1),),
        (HEAVIER, HEAVIER),
        (BodyEdit("pole", mass=1.0),),
        (BodyEdit("nobody", 2.0),),
        (InputEdit("nothing", 2.0),),
        (BodyEdit("pole", 1e-300),),
        (BodyEdit("pole", 1e200, 1e200),),
    ],
)
def test_an_edit_that_only_a_compiler_can_tell_is_left_to_it(edits: tuple[Edit, ...]) -> None:
    require_compiled(PLAIN, *edits)


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


@pytest.fixture(scope="module")
def falling() -> MujocoPlant:
    return Robot.from_mjcf(FALLING).plant


def test_parts_that_act_or_are_sensed_stay(falling: MujocoPlant) -> None:
    """Contacts, a fin in water, and objects of sensors."""
    bare = falling.undrawn_model
    geoms = [bare.geom(i).name for i in range(bare.ngeom)]
    cameras = [bare.camera(i).name for i in range(bare.ncam)]
    assert geoms == ["floor", "touching", "fin", "felt"]
    assert cameras == ["seen"]


def test_the_inertia_of_dropped_geoms_stays(falling: MujocoPlant) -> None:
    bare = falling.undrawn_model
    assert (bare.nlight, bare.nmat) == (0, 0)
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat"):
        np.testing.assert_array_equal(getattr(bare, field), getattr(falling.model, field))


def landed(model: mujoco.MjModel) -> mujoco.MjData:
    """Data of a model after a fall onto the floor."""
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=400)
    return data


def test_a_model_without_its_looks_moves_as_the_drawn_one(falling: MujocoPlant) -> None:
    drawn = landed(falling.model)
    undrawn = landed(falling.undrawn_model)
    assert drawn.ncon == undrawn.ncon > 0
    for field in ("qpos", "qvel", "sensordata"):
        np.testing.assert_array_equal(getattr(undrawn, field), getattr(drawn, field))

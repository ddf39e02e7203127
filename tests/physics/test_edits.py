"""Edits of a model: closed forms of similar bodies, written and compiled models bit for bit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ModelError
from grosmc_mj.physics.edits import AddedMass, BodyEdit, Edit, InputEdit, JointEdit, apply_edits
from grosmc_mj.physics.files import compile_spec, load_model
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.physics.template import can_constrain
from grosmc_mj.plants import SYSTEMS
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.steppers import Steppers

MOVING = [
    ("servo", "rotor"),
    ("cart_pendulum", "cart"),
    ("cart_pendulum", "pole"),
    ("arm", "link"),
    ("two_link_arm", "payload"),
]


def edited(name: str, *edits: Edit) -> mujoco.MjModel:
    return MujocoPlant.load(name, edits=edits).model


def saved(model: mujoco.MjModel) -> bytes:
    """Every bit of a model."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


# The body stays similar to itself, and the others as they are


@pytest.mark.parametrize(("name", "body"), MOVING)
def test_a_body_is_scaled_with_what_is_drawn_and_attached_and_nothing_else(
    name: str, body: str
) -> None:
    before, index = load_model(name), load_model(name).body(body).id
    for a, b in ((4.0, 4.0), (0.3, 1.0), (2.5, 0.4)):
        after = edited(name, BodyEdit(body, a, b))
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
        for field in ("body_iquat", "geom_type", "dof_damping", "dof_armature", "tendon_armature",
                      "actuator_gear"):  # fmt: skip
            np.testing.assert_array_equal(getattr(after, field), getattr(before, field))


def test_edits_touch_neither_the_spec_nor_the_nominal_plant(name: str) -> None:
    plant, body = MujocoPlant.load(name), dict(MOVING)[name]
    text, bits = plant.spec.to_xml(), saved(plant.model)
    assert saved(plant.edited(BodyEdit(body, 4.0, 4.0)).model) != bits
    plant.analytic()
    assert plant.spec.to_xml() == text
    for one in (plant, plant.edited(), MujocoPlant.load(name)):
        assert saved(one.model) == bits


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


def changed(*edits: Edit, compiler: str = "") -> tuple[mujoco.MjModel, mujoco.MjModel]:
    spec = mujoco.MjSpec.from_string(LOADED.replace("<asset>", f"{compiler}<asset>"))
    return compile_spec(spec), compile_spec(apply_edits(spec, edits))


def about_origin(model: mujoco.MjModel, name: str) -> tuple[float, Array, Array]:
    """A body's mass, moment and inertia about its own origin in its own axes: what adds up."""
    body, rotation = model.body(name), np.zeros(9)
    mujoco.mju_quat2Mat(rotation, body.iquat)
    axes, m = rotation.reshape(3, 3), body.mass[0]
    return m, m * body.ipos, axes @ np.diag(body.inertia) @ axes.T + m * steiner(body.ipos)


def steiner(r: Any) -> Array:
    return np.dot(r, r) * np.eye(3) - np.outer(r, r)


def test_a_load_adds_its_mass_its_moment_and_its_inertia() -> None:
    """Where its position says, in a scaled body too."""
    loads = AddedMass("link", 0.7, (0.1, -0.3, 0.5)), AddedMass("link", 0.2, (-0.2, 0.0, 0.1))
    for a, b in ((1.0, 1.0), (2.0, 1.5)):
        before, after = changed(*loads, BodyEdit("link", a, b))
        parts = about_origin(before, "link")
        expected = [scale * part for scale, part in zip((a, a * b, a * b * b), parts, strict=True)]
        for load in loads:
            r = np.array(load.position)
            for i, more in enumerate((load.mass, load.mass * r, load.mass * steiner(r))):
                expected[i] = expected[i] + more
        for actual, right in zip(about_origin(after, "link"), expected, strict=True):
            np.testing.assert_allclose(actual, right, rtol=1e-14, atol=1e-14)
        assert after.ngeom == before.ngeom + 2
        assert not after.geom_contype[after.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE].any()


@pytest.mark.parametrize("compiler", ["", 'inertiafromgeom="true"', 'settotalmass="7"'])
def test_a_model_that_sets_its_masses_itself_has_those_of_the_edits(compiler: str) -> None:
    edits = BodyEdit("horn", 3.0, 2.0), AddedMass("link", 0.7, (0.1, 0.0, 0.0))
    before, after = changed(*edits, compiler=compiler and f"<compiler {compiler}/>")
    for body, factors, load in (("link", (1, 1, 1), 0.7), ("horn", (3, 6, 12), 0.0),
                                ("one", (1, 1, 1), 0.0)):  # fmt: skip
        mass, _, inertia = about_origin(before, body)
        actual = about_origin(after, body)
        assert actual[0] == pytest.approx(factors[0] * mass + load, rel=1e-12)
        if not load:
            np.testing.assert_allclose(actual[2], factors[2] * inertia, rtol=1e-12, atol=1e-18)
    # A mesh of the body's own is scaled; vertices are float32.
    own = np.arange(before.nmeshvert)[:, None] < before.mesh_vertnum[0]
    vertices = np.where(own, 2.0, 1.0) * before.mesh_vert
    np.testing.assert_allclose(after.mesh_vert, vertices, rtol=1e-6, atol=1e-9)


def test_a_joint_edit_sets_what_it_names_only() -> None:
    for edit, numbers in (
        (JointEdit("j", damping=3.0, friction=0.0), (3.0, 0.0, 0.2)),
        (JointEdit("j", armature=0.9), (0.5, 0.1, 0.9)),
    ):
        after = changed(edit)[1]
        fields = after.dof_damping, after.dof_frictionloss, after.dof_armature
        assert tuple(field[0] for field in fields) == numbers


@pytest.mark.parametrize("tilt", [math.radians(60), -0.4])
@pytest.mark.parametrize(
    ("axis", "towards"),
    [((0, -1, 0), (0, 0, 1)), ((1, 2, -2), (0, 0, 1)), ((0, 0, 1), (1, 0, 0)),
     ((0, 0, -1), (1, 0, 0))],
)  # fmt: skip
def test_a_tilt_turns_an_axis_by_its_angle_towards_z_or_from_z_towards_x(
    axis: tuple[float, ...], towards: tuple[float, ...], tilt: float
) -> None:
    """Against MuJoCo's own rotation by a quaternion."""
    before, turn, expected = np.array(axis) / np.linalg.norm(axis), np.zeros(4), np.zeros(3)
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="b", mass=1.0, inertia=[1, 1, 1], explicitinertial=True)
    body.add_joint(name="j", axis=before)
    after = compile_spec(apply_edits(spec, [JointEdit("j", tilt=tilt)])).jnt_axis[0]
    about = np.cross(before, towards)
    mujoco.mju_axisAngle2Quat(turn, about / np.linalg.norm(about), tilt)
    mujoco.mju_rotVecQuat(expected, before, turn)
    np.testing.assert_allclose(after, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: BodyEdit("pole", mass_scale=0.0), "edit of 'pole': mass_scale = 0 must be"),
        (lambda: BodyEdit("pole", length_scale=math.inf), "length_scale = inf must be finite"),
        (lambda: AddedMass("link", math.nan), "mass = nan must be finite and positive"),
        (lambda: AddedMass("link", 1.0, (0.0, math.inf, 0.0)), "3 finite numbers"),
        (lambda: JointEdit("j", damping=-1.0), "damping = -1 must be finite"),
        (lambda: changed(BodyEdit("world", 2.0)),
         "unknown body 'world'.*valid: link, horn, one, two"),
        (lambda: changed(AddedMass("lnk", 1.0)), "unknown body 'lnk': did you mean 'link'"),
        (lambda: changed(JointEdit("k", damping=1.0)), "unknown joint 'k'"),
        (lambda: changed(BodyEdit("one", 2.0), BodyEdit("one", 3.0)), "'one' has two of the kind"),
        (lambda: changed(BodyEdit("one", length_scale=2.0)), "geom 'shared' of body 'one'"),
        (lambda: edited("servo", BodyEdit("rotor", 1e-16)), "mass and inertia of moving bodies"),
    ],
)  # fmt: skip
def test_an_edit_that_cannot_be_is_refused(call: Callable[[], Any], words: str) -> None:
    with pytest.raises(ModelError, match=words) as refused:
        call()
    assert "\n" not in str(refused.value)


# Edits written into a compiled model: the same model as a compiler makes, or none

SCALES = st.floats(0.1, 10.0)
PLAIN = MujocoPlant.load("cart_pendulum")


def differences(one: mujoco.MjModel, other: mujoco.MjModel) -> list[str]:
    """Names of the arrays in which two models differ."""
    arrays = {name: getattr(one, name) for name in dir(one) if not name.startswith("_")}
    return [
        name for name, a in arrays.items() if isinstance(a, np.ndarray)
        and not np.array_equal(a, getattr(other, name), equal_nan=a.dtype.kind == "f")
    ]  # fmt: skip


def numbers(plant: MujocoPlant) -> Any:
    """What its equations are made with, or why it has none."""
    try:
        return plant.analytic().parameters
    except ModelError as error:
        return str(error)


@st.composite
def families(draw: Any) -> list[MujocoPlant]:
    """Plants of one system, edited at random."""
    nominal = MujocoPlant.load(draw(st.sampled_from([*SYSTEMS])))
    model, plants = nominal.model, []
    bodies = [model.body(i).name for i in range(1, model.nbody) if model.body_mass[i] > 0]
    for _ in range(draw(st.integers(2, 3))):
        chosen = draw(st.lists(st.sampled_from(bodies), unique=True))
        edits: list[Edit] = [BodyEdit(name, draw(SCALES), draw(SCALES)) for name in chosen]
        if draw(st.booleans()):
            edits.append(InputEdit(model.actuator(0).name, draw(SCALES)))
        plants.append(nominal.edited(*edits))
    return plants


def as_run(plants: list[MujocoPlant]) -> Iterator[mujoco.MjModel]:
    """Models that one thread's runs of these plants compute with, one after the other."""
    steppers = Steppers(1e-3)
    return (steppers.of(plant).model for plant in plants)


@settings(max_examples=15)
@given(families())
def test_a_written_model_is_the_compiled_one_bit_for_bit(plants: list[MujocoPlant]) -> None:
    """Whatever has been written into it before."""
    plants = [*plants, plants[0]]
    for plant, model in zip(plants, as_run(plants), strict=True):
        # Read before anything is compiled, and afterwards.
        again = plant.edited(*plant.edits)
        before, written = numbers(again), plant.template.written(plant.edits)
        assert written is not None
        for one in (model, written):
            assert differences(one, again.undrawn_model) == []
        assert numbers(again) == before


def test_a_family_is_compiled_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its runs share one mjModel and one mjData."""
    nominal = MujocoPlant.load("cart_pendulum")
    assert nominal.template is nominal.edited().template
    plants = [nominal.edited(BodyEdit("pole", scale, scale)) for scale in (0.5, 1.5, 2.0)]
    monkeypatch.setattr(MujocoPlant, "_compiled", lambda *_: pytest.fail("compiled"))
    steppers, used = Steppers(1e-3), set[int]()
    for plant, mass in zip(plants, (0.1, 0.3, 0.4), strict=True):
        stepper = steppers.of(plant)
        assert stepper.model.body("pole").mass[0] == pytest.approx(mass, rel=1e-12)
        used.add(stepper.data._address)
    assert len(used) == 1


def other(change: Callable[[mujoco.MjSpec], Any]) -> MujocoPlant:
    """The pendulum with a change of its model."""
    spec = PLAIN.spec.copy()
    change(spec)
    return MujocoPlant(PLAIN.system, spec)


def sense_the_rod(spec: mujoco.MjSpec) -> None:
    """So that it is no mere look."""
    spec.add_sensor(name="seen", type=mujoco.mjtSensor.mjSENS_FRAMEPOS,
                    objtype=mujoco.mjtObj.mjOBJ_GEOM, objname="rod")  # fmt: skip


def limit_the_hinge(spec: mujoco.MjSpec) -> None:
    spec.joints[1].range, spec.joints[1].limited = np.array([-1.0, 1.0]), 1


HEAVIER = (BodyEdit("pole", 2.0),)


@pytest.mark.parametrize(
    ("plant", "edits"),
    [
        (other(sense_the_rod), (BodyEdit("pole", 1.0, 2.0),)),
        (other(lambda spec: spec.body("pole").add_body(name="mount")), (BodyEdit("mount", 2.0),)),
        # Constraints are solved by a mean inertia that a compiler alone computes.
        (other(limit_the_hinge), HEAVIER),
        (other(lambda spec: setattr(spec.joints[1], "frictionloss", 0.1)), HEAVIER),
        *((PLAIN, edits) for edits in (
            (JointEdit("hinge", damping=1.0),), (AddedMass("pole", 0.1),), 2 * HEAVIER,
            (BodyEdit("nobody", 2.0),), (InputEdit("nothing", 2.0),), (BodyEdit("pole", 1e-300),),
            (BodyEdit("pole", 1e200, 1e200),),
        )),
    ],
)  # fmt: skip
def test_a_change_that_only_a_compiler_can_tell_is_left_to_it(
    plant: MujocoPlant, edits: tuple[Edit, ...]
) -> None:
    assert plant.template.changes(edits) is None
    assert plant.template.written(edits) is None


# Plants without what is only drawn


def test_models_that_run_have_nothing_that_is_only_drawn(plant: MujocoPlant) -> None:
    """A load is drawn as a sphere."""
    body = dict(MOVING)[plant.system.name]
    for edits in ((), (BodyEdit(body, 2.0, 1.5), AddedMass(body, 0.1))):
        one = plant.edited(*edits)
        model = one.undrawn_model
        left = (model.ngeom, model.nmat, model.ntex, model.nmesh, model.ncam, model.nlight)
        assert left == (len(edits) // 2, 0, 0, 0, 0, 0)
        assert mujoco.mj_sizeModel(model) < mujoco.mj_sizeModel(one.model) / 100


# A ball that falls on a floor, with a part that is only drawn and gives the ball its inertia, and
# what sensors see.
FALLING = """
<mujoco model="falling"><compiler angle="radian"/><option density="1000"/>
  <asset><material name="red" rgba="1 0 0 1"/></asset>
  <default><default class="air"><geom contype="0" conaffinity="0"/></default></default>
  <worldbody>
    <camera name="seen"/> <camera name="film"/> <light name="sun"/>
    <geom name="floor" type="plane" size="1 1 1" material="red"/>
    <geom name="picture" class="air" type="box" size="1 1 1" material="red"/>
    <body name="ball" pos="0 0 0.4"><joint name="slide" type="slide" axis="0 0 1"/>
      <geom name="touching" size="0.1" mass="0.3"/>
      <geom name="drawn" class="air" type="box" size="0.1 0.2 0.3" euler="1 2 3"/>
      <geom name="fin" class="air" type="ellipsoid" size="0.1 0.2 0.3" fluidshape="ellipsoid"/>
      <geom name="felt" class="air" size="0.1"/> <site name="site" material="red"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="slide"/></actuator>
  <sensor><framepos objtype="geom" objname="felt"/>
    <camprojection site="site" camera="seen"/></sensor>
</mujoco>
"""


def fallen(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qvel[0] = -1.0
    mujoco.mj_step(model, data, nstep=400)
    return data


def test_what_acts_stays() -> None:
    """Contacts, a fin in water, what sensors refer to, and the inertia of what is dropped."""
    plant = Robot.from_mjcf(FALLING).plant
    full, bare = plant.model, plant.undrawn_model
    names = [bare.geom(i).name for i in range(bare.ngeom)]
    assert names == ["floor", "touching", "fin", "felt"]
    assert [bare.camera(i).name for i in range(bare.ncam)] == ["seen"]
    assert (bare.nlight, bare.nmat) == (0, 0)
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat"):
        np.testing.assert_array_equal(getattr(bare, field), getattr(full, field))
    one, other = fallen(full), fallen(bare)
    assert one.ncon == other.ncon > 0
    for field in ("qpos", "qvel", "sensordata"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field))


# A slide and what might hold it.
HELD = """<mujoco>{beside}<worldbody><geom name="floor" type="plane" size="1 1 1" {floor}/>
<body name="part" pos="0 0 0.4"><joint name="slide" type="slide" axis="0 0 1" {joint}/>
<geom name="touching" size="0.1" mass="0.3"/><site name="top"/></body>
<site name="hook" pos="0 0 1"/></worldbody>{after}</mujoco>"""
TENDON = '<tendon><spatial {}><site site="top"/><site site="hook"/></spatial></tendon>'
PAIR = '<contact><pair geom1="floor" geom2="touching"/></contact>'


@pytest.mark.parametrize(
    ("constrained", "parts"),
    [
        (False, {"floor": 'contype="2" conaffinity="4"'}),
        (False, {"after": TENDON.format("")}),
        (False, {"joint": 'damping="1" stiffness="2"'}),
        (True, {"beside": ""}),
        (True, {"joint": 'range="-0.1 0.1" limited="true"'}),
        (True, {"joint": 'frictionloss="0.1"'}),
        (True, {"after": TENDON.format('frictionloss="0.1"')}),
        (True, {"after": TENDON.format('limited="true" range="0 1"')}),
        (True, {"after": '<equality><joint joint1="slide"/></equality>'}),
        (True, {"beside": "", "floor": 'contype="0" conaffinity="0"', "after": PAIR}),
    ],
)
def test_what_can_constrain(constrained: bool, parts: dict[str, str]) -> None:
    holes = {"beside": '<option><flag contact="disable"/></option>', "floor": "", "joint": ""}
    model = mujoco.MjModel.from_xml_string(HELD.format(**{**holes, "after": "", **parts}))
    assert can_constrain(model) is constrained
    free = fallen(model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    assert constrained or fallen(model).qpos.tolist() == free.qpos.tolist()

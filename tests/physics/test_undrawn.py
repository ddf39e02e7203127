"""Plants without what is only drawn, and models that are compiled no more often than needed."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from shipped import find_case

from grosmc_mj.control.controller import Controller
from grosmc_mj.physics.edits import AddedMass, BodyEdit, Edit, JointEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.physics.template import can_constrain
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.simulate import simulate

OpenLoop = Callable[[float | tuple[float, float]], Controller]

EDITS: dict[str, tuple[Edit, ...]] = {
    "servo": (BodyEdit("rotor", 2.0, 1.3), JointEdit("shaft", damping=0.02)),
    "cart_pendulum": (BodyEdit("pole", 2.0, 1.5), AddedMass("pole", 0.1, (0.1, 0.0, 0.7))),
    "arm": (BodyEdit("link", 2.0, 1.5), JointEdit("joint", friction=0.1)),
    "two_link_arm": (BodyEdit("payload", 2.0, 0.5), BodyEdit("upper", 1.2, 1.1)),
}

# A ball that falls on a floor, with a part that is only drawn and gives the ball its inertia, and
# what sensors see.
FALLING = """
<mujoco model="falling">
  <compiler angle="radian" {compiler}/>
  <option density="1000"/>
  <asset><material name="red" rgba="1 0 0 1"/></asset>
  <worldbody>
    <camera name="seen"/> <camera name="film"/> <light name="sun"/>
    <geom name="floor" type="plane" size="1 1 1" material="red"/>
    <geom name="picture" type="box" size="1 1 1" contype="0" conaffinity="0" material="red"/>
    <body name="ball" pos="0 0 0.4">
      <joint name="slide" type="slide" axis="0 0 1"/>
      <geom name="touching" size="0.1" mass="0.3"/>
      <geom name="drawn" type="box" size="0.1 0.2 0.3" euler="1 2 3" contype="0" conaffinity="0"/>
      <geom name="fin" type="ellipsoid" size="0.1 0.2 0.3" contype="0" conaffinity="0"
            fluidshape="ellipsoid"/>
      <geom name="felt" size="0.1" contype="0" conaffinity="0"/>
      <site name="site" material="red"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="slide"/></actuator>
  <sensor>
    <framepos objtype="geom" objname="felt"/>
    <camprojection site="site" camera="seen"/>
  </sensor>
</mujoco>
"""


NO_CONTACT = '<option><flag contact="disable"/></option>'


def falling(compiler: str = "") -> MujocoPlant:
    return Robot.from_mjcf(FALLING.format(compiler=compiler)).plant


@pytest.mark.parametrize("edited", [False, True], ids=["nominal", "edited"])
@pytest.mark.parametrize("system", EDITS)
def test_what_is_drawn_does_not_move_the_plant(
    system: str, edited: bool, open_loop: OpenLoop
) -> None:
    plant = MujocoPlant.load(system, edits=EDITS[system] if edited else ())
    drawn, model = plant.model, plant.undrawn_model
    # A load is drawn as a sphere.
    loads = sum(isinstance(edit, AddedMass) for edit in plant.edits)
    left = (model.ngeom, model.nmat, model.ntex, model.nmesh, model.ncam, model.nlight)
    assert left == (loads, 0, 0, 0, 0, 0)
    assert mujoco.mj_sizeModel(model) < mujoco.mj_sizeModel(drawn) / 100
    n, x0 = plant.system.degrees_of_freedom, find_case(system, "nominal").x0
    run = simulate(plant, open_loop(0.3 if model.nu == 1 else (0.3, 0.2)), x0, duration=0.2)
    data = mujoco.MjData(drawn)
    data.qpos[:], data.qvel[:], data.ctrl[:] = x0[:n], x0[n:], (0.3, 0.2)[: model.nu]
    mujoco.mj_step(drawn, data, nstep=len(run.time) - 1)
    np.testing.assert_array_equal(run.state[-1], [*data.qpos, *data.qvel])


def test_what_acts_stays() -> None:
    """Contacts, a fin in water, what sensors refer to, and the inertia of what is dropped."""
    plant = falling()
    full, bare = plant.model, plant.undrawn_model
    names = [bare.geom(i).name for i in range(bare.ngeom)]
    assert names == ["floor", "touching", "fin", "felt"]
    assert [bare.camera(i).name for i in range(bare.ncam)] == ["seen"]
    assert (bare.nlight, bare.nmat) == (0, 0)
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat"):
        np.testing.assert_array_equal(getattr(bare, field), getattr(full, field))
    states, touched = [], []
    for model in (full, bare):
        data = mujoco.MjData(model)
        data.qvel[0] = -1.0
        mujoco.mj_step(model, data, nstep=500)
        states.append([*data.qpos, *data.qvel, *data.sensordata])
        touched.append(data.ncon)
    assert touched[0] == touched[1] > 0
    np.testing.assert_array_equal(*states)


# A slide and what might hold it.
HELD = """
<mujoco>
  {beside}
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1" {floor}/>
    <body name="part" pos="0 0 0.4">
      <joint name="slide" type="slide" axis="0 0 1" {joint}/>
      <geom name="touching" size="0.1" mass="0.3"/>
      <site name="top"/>
    </body>
    <site name="hook" pos="0 0 1"/>
  </worldbody>
  {after}
  <actuator><motor name="motor" joint="slide"/></actuator>
</mujoco>
"""
_APART = 'contype="0" conaffinity="0"'
_TENDON = '<tendon><spatial {}><site site="top"/><site site="hook"/></spatial></tendon>'


@pytest.mark.parametrize(
    ("constrained", "parts"),
    [
        (False, {"floor": 'contype="2" conaffinity="4"', "beside": NO_CONTACT}),
        (False, {"beside": NO_CONTACT}),
        (False, {"beside": NO_CONTACT, "after": _TENDON.format("")}),
        (False, {"beside": NO_CONTACT, "joint": 'damping="1" stiffness="2"'}),
        (True, {}),
        (True, {"joint": 'range="-0.1 0.1" limited="true"', "beside": NO_CONTACT}),
        (True, {"joint": 'frictionloss="0.1"', "beside": NO_CONTACT}),
        (True, {"after": _TENDON.format('frictionloss="0.1"'), "beside": NO_CONTACT}),
        (True, {"after": _TENDON.format('limited="true" range="0 1"'), "beside": NO_CONTACT}),
        (True, {"after": '<equality><joint joint1="slide"/></equality>', "beside": NO_CONTACT}),
        (
            True,
            {
                "floor": _APART,
                "after": '<contact><pair geom1="floor" geom2="touching"/></contact>',
            },
        ),
    ],
)
def test_what_can_constrain(constrained: bool, parts: dict[str, str]) -> None:
    holes = dict.fromkeys(("beside", "floor", "joint", "after"), "")
    model = mujoco.MjModel.from_xml_string(HELD.format(**{**holes, **parts}))
    assert can_constrain(model) is constrained
    states = []
    for flag in (0, mujoco.mjtDisableBit.mjDSBL_CONSTRAINT):
        model.opt.disableflags |= flag
        data = mujoco.MjData(model)
        data.qvel[0] = -1.0
        mujoco.mj_step(model, data, nstep=400)
        states.append([*data.qpos, *data.qvel])
    assert constrained or states[0] == states[1]

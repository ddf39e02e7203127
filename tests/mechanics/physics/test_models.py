"""The MJCF files: their names, flags and numbers, and files that are broken."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hand_written import tip, two_link_inertia

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.mechanics.physics import files
from grosmc_mj.mechanics.physics.files import load_model, model_path
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.theory.plants import SYSTEMS

AUTORESET = mujoco.mjtDisableBit.mjDSBL_AUTORESET
CONTACT = mujoco.mjtDisableBit.mjDSBL_CONTACT


def data_at(model: mujoco.MjModel, *q: float, rate: float = 0.0) -> mujoco.MjData:
    """Data where the last coordinates are q and the last one moves at a rate."""
    data = mujoco.MjData(model)
    data.qpos[-len(q) :] = q
    data.qvel[-1] = rate
    mujoco.mj_forward(model, data)
    return data


def mass_matrix(model: mujoco.MjModel, *q: float) -> Array:
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data_at(model, *q), M)
    return M


# Names and flags


@pytest.fixture
def shipped(name: str) -> mujoco.MjModel:
    """The shipped file of each system in turn, compiled by MuJoCo alone."""
    return mujoco.MjModel.from_xml_path(str(model_path(name)))


def test_bodies_are_those_of_the_system(shipped: mujoco.MjModel, name: str) -> None:
    bodies = tuple(shipped.body(i).name for i in range(1, shipped.nbody))
    assert bodies == SYSTEMS[name].bodies


def test_the_file_says_how_it_is_stepped(shipped: mujoco.MjModel) -> None:
    assert shipped.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert shipped.opt.timestep == 1e-3
    assert shipped.opt.disableflags & AUTORESET
    assert shipped.opt.disableflags & CONTACT


def test_the_file_has_a_light_a_fixed_camera_and_one_that_follows(shipped: mujoco.MjModel) -> None:
    assert shipped.nlight > 0
    modes = {name: shipped.cam_mode[shipped.camera(name).id] for name in ("fixed", "follow")}
    assert modes["fixed"] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED != modes["follow"]


def test_a_positive_rate_turns_counter_clockwise(shipped: mujoco.MjModel, name: str) -> None:
    """The picture's right is +x and its depth +y, so it turns about -y."""
    velocity = np.zeros(6)
    body = shipped.body(SYSTEMS[name].bodies[-1]).id
    data = data_at(shipped, 0.0, rate=1.0)
    mujoco.mj_objectVelocity(shipped, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0)
    np.testing.assert_allclose(velocity[:3], [0, -1, 0], atol=1e-15)


# Numbers


def test_the_servo_has_the_numbers_of_the_chapter() -> None:
    """Decimal numbers, read once: half a unit in the last place."""
    model = load_model("servo")
    assert mass_matrix(model, 0.3)[0, 0] == pytest.approx(5.77e-2, rel=1e-15)
    assert model.dof_damping[0] == pytest.approx(8.8e-3, rel=1e-15)
    assert model.actuator("current").gear[0] == pytest.approx(0.667, rel=1e-15)
    assert not model.actuator_ctrllimited[0]


@pytest.mark.parametrize("angle", [-3.0, -0.5, 1.2])
def test_the_pendulum_has_the_mass_matrix_of_the_chapter(angle: float) -> None:
    coupling = -0.1 * math.cos(angle)
    expected = [[1.2, coupling], [coupling, 0.2 / 3]]
    M = mass_matrix(load_model("cart_pendulum"), angle)
    np.testing.assert_allclose(M, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("angle", [-3.0, -0.5, 1.2])
def test_the_two_links_have_their_mass_matrix(angle: float) -> None:
    """With the numbers in the head of the file: J1 = 0.425, J2 = 0.128/1.5, h = 0.14."""
    J1 = 0.425
    J2 = 0.128 / 1.5
    bend = 0.14 * math.cos(angle)
    expected = [[J1 + J2 + 2 * bend, J2 + bend], [J2 + bend, J2]]
    M = mass_matrix(load_model("two_link_arm"), 0.7, angle)
    by_hand = two_link_inertia([0.7, angle], MujocoPlant.load("two_link_arm").parameters)
    np.testing.assert_allclose(M, expected, atol=1e-15)
    np.testing.assert_allclose(by_hand, expected, atol=1e-15)


@pytest.mark.parametrize("angle", [-3.0, -0.5, 1.2])
def test_the_tip_is_where_the_angles_of_both_links_lead(angle: float) -> None:
    """They are counter-clockwise, the first from the right, the second from the first link."""
    data = data_at(load_model("two_link_arm"), 0.7, angle)
    x, z = tip([0.7, angle], MujocoPlant.load("two_link_arm").parameters)
    np.testing.assert_allclose(data.site("tip").xpos, [x, 0, 1.1 + z], atol=1e-15)


@pytest.mark.parametrize("q", [-4.0, -1.0, 0.0, 1.4, math.pi / 2, -1.5 * math.pi])
def test_the_cable_of_the_arm_has_length_zero_at_the_singular_angle_only(q: float) -> None:
    length = 2 * 0.2 * abs(math.sin((q - math.pi / 2) / 2))
    data = data_at(load_model("arm"), q)
    assert data.ten_length[0] == pytest.approx(length, abs=1e-15)
    assert SYSTEMS["arm"].singular([q, 0.0]) == (length < 1e-15)


@pytest.mark.parametrize("q", [-4.0, -1.0, 0.0, 1.4])
def test_the_arm_has_the_inertia_of_eq_57(q: float) -> None:
    M = mass_matrix(load_model("arm"), q)
    assert M[0, 0] == pytest.approx(0.1 + 0.06 * math.sin(q), abs=1e-12)


@pytest.mark.parametrize("q", [-4.0, -1.0, 0.0, 1.4])
def test_the_arm_has_the_energy_true_bias_of_eq_57(q: float) -> None:
    """C q' = M'(q) q'^2/2 = 0.03 cos(q) q'^2, and G = m g l cos q with m = 0.02, l = 0.5."""
    data = data_at(load_model("arm"), q, rate=3.0)
    bias = 0.03 * math.cos(q) * 3.0**2 + 0.02 * 9.8 * 0.5 * math.cos(q)
    assert data.qfrc_bias[0] == pytest.approx(bias, abs=1e-12)


# Broken files.


def rotor(joint: str = "shaft", actuator: str = "current", mass: float = 1.0) -> str:
    return f"""<mujoco model="servo"><worldbody><body name="rotor"><joint name="{joint}"/>
      <geom size="0.1" mass="{mass}"/></body></worldbody>
      <actuator><motor name="{actuator}" joint="{joint}"/></actuator></mujoco>"""


def use_as_servo(text: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a text be the servo's file."""
    (folder / "servo.xml").write_text(text)
    monkeypatch.setattr(files, "_FOLDERS", (folder,))


HAS = r"servo: the model has joints \('{}',\) and actuators \('{}',\), must have \('shaft',\) and"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("hello", "servo"),
        ('<mujoco model="servo"><include file="nowhere.xml"/></mujoco>', "servo"),
        (rotor(mass=-1), "servo"),
        (rotor(actuator="voltage"), HAS.format("shaft", "voltage")),
        (rotor(joint="axle"), HAS.format("axle", "current")),
    ],
)
def test_a_broken_file_is_refused_in_one_line(
    text: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_as_servo(text, tmp_path, monkeypatch)
    with pytest.raises(ModelError, match=words) as refused:
        _ = MujocoPlant.load("servo").model
    assert "\n" not in str(refused.value)


def test_autoreset_is_disabled_in_every_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A diverged run that starts again in silence would be a verdict on another run."""
    use_as_servo(rotor(), tmp_path, monkeypatch)
    flags_of_file = load_model("servo").opt.disableflags
    assert not flags_of_file & AUTORESET
    assert MujocoPlant.load("servo").model.opt.disableflags == flags_of_file | AUTORESET

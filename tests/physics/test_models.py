"""The MJCF files: names, flags, and whether they are the chapter's systems."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from grosmc_mj.errors import ModelError
from grosmc_mj.physics import files as models
from grosmc_mj.physics.files import load_model, model_path
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SYSTEMS

# Angles of the arm away from q = pi/2, where its cable has length zero.
ARM_ANGLES = np.linspace(-1.5 * math.pi + 0.1, math.pi / 2 - 0.1, 41)


def mass_matrix(model: mujoco.MjModel, q: float) -> np.ndarray:
    data = mujoco.MjData(model)
    data.qpos[-1] = q
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full


# What is named, and what can be filmed


def test_the_system_names_the_model_in_the_order_of_the_state(name: str) -> None:
    model, system = load_model(name), SYSTEMS[name]
    assert tuple(model.body(i).name for i in range(1, model.nbody)) == system.bodies
    assert tuple(model.joint(i).name for i in range(model.njnt)) == system.joints
    assert (model.nq, model.nv) == (len(system.joints), len(system.joints))
    assert tuple(model.actuator(i).name for i in range(model.nu)) == system.actuators
    assert model.nu == (2 if name == "two_link_arm" else 1)


def test_there_are_a_fixed_and_a_moving_camera_and_light(name: str) -> None:
    model = load_model(name)
    cameras = {model.camera(i).name: int(model.cam_mode[i]) for i in range(model.ncam)}
    assert cameras["fixed"] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    assert cameras["follow"] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    assert model.nlight >= 1


# What is switched off, in the MJCF itself


def test_the_mjcf_itself_states_integrator_timestep_and_flags(name: str) -> None:
    option = mujoco.MjModel.from_xml_path(str(model_path(name))).opt
    assert option.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert option.timestep == 1e-3
    for flag in (mujoco.mjtDisableBit.mjDSBL_AUTORESET, mujoco.mjtDisableBit.mjDSBL_CONTACT):
        assert option.disableflags & flag


def test_only_autoreset_is_forced_on_a_model_that_forgot_it(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A diverged run that starts again in silence would be a verdict on another run."""
    copy_models(tmp_path, lambda text: text.replace(' autoreset="disable"', ""))
    monkeypatch.setattr(models, "_FOLDERS", (tmp_path,))
    forgot, flag = load_model(name), mujoco.mjtDisableBit.mjDSBL_AUTORESET
    assert not forgot.opt.disableflags & flag
    assert MujocoPlant.load(name).model.opt.disableflags == forgot.opt.disableflags | flag


# How a model is found, and what is said when it is not


def copy_models(folder: Path, change: Callable[[str], str]) -> None:
    for path in model_path("servo").parent.glob("*.xml"):
        (folder / path.name).write_text(change(path.read_text()))


BREAKS: dict[str, Callable[[str], str]] = {
    "not XML": lambda text: "hello",
    "missing include": lambda text: text.replace("common.xml", "nowhere.xml"),
    "negative mass": lambda text: re.sub(r'mass="[1-9]\.?', 'mass="-1', text),
}


@pytest.mark.parametrize("how", BREAKS)
@pytest.mark.parametrize("load", [load_model, lambda name: MujocoPlant.load(name).model])
def test_broken_mjcf_is_one_line_of_model_error(
    how: str, load: Callable[[str], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy_models(tmp_path, BREAKS[how])
    monkeypatch.setattr(models, "_FOLDERS", (tmp_path,))
    with pytest.raises(ModelError, match="servo") as caught:
        load("servo")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ('name="current"', 'name="voltage"', r"joints \('shaft',\) and actuators \('voltage',\)"),
        ('name="shaft"', 'name="axle"', r"joints \('axle',\) and actuators \('current',\)"),
        (
            "</actuator>",
            '<motor name="second" joint="shaft"/></actuator>',
            r"joints \('shaft',\) and actuators \('current', 'second'\)",
        ),
    ],
)
def test_model_with_other_joints_or_actuators_is_refused(
    old: str, new: str, found: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def changed(text: str) -> str:
        text = text.replace(old, new)
        return text.replace('joint="shaft"', 'joint="axle"') if new == 'name="axle"' else text

    copy_models(tmp_path, changed)
    monkeypatch.setattr(models, "_FOLDERS", (tmp_path,))
    with pytest.raises(ModelError) as caught:
        _ = MujocoPlant.load("servo").model
    pattern = rf"servo: the model has {found}, must have \('shaft',\) and \('current',\)"
    assert re.fullmatch(pattern, str(caught.value)), caught.value


# Whether they are the chapter's systems


def test_servo_has_the_numbers_of_section_2_3() -> None:
    model = load_model("servo")
    # Decimal numbers, read once: half a unit in the last place.
    assert mass_matrix(model, 0.3)[0, 0] == pytest.approx(5.77e-2, rel=1e-15)
    assert model.dof_damping[0] == pytest.approx(8.8e-3, rel=1e-15)
    assert model.actuator("current").gear[0] == pytest.approx(0.667, rel=1e-15)
    assert not model.actuator_ctrllimited[0]


def test_mass_matrix_of_the_cart_pendulum_is_lagranges() -> None:
    model, M, m, L = load_model("cart_pendulum"), 1.0, 0.2, 0.5
    for theta in np.linspace(-3, 3, 13):
        coupling = -m * L * math.cos(theta)
        expected = [[M + m, coupling], [coupling, m * (2 * L) ** 2 / 3]]
        np.testing.assert_allclose(mass_matrix(model, theta), expected, rtol=0, atol=1e-15)


def test_arm_has_the_inertia_of_eq_57() -> None:
    model = load_model("arm")
    for q in ARM_ANGLES:
        assert mass_matrix(model, q)[0, 0] == pytest.approx(0.1 + 0.06 * math.sin(q), abs=1e-12)


def test_arm_has_the_energy_true_bias() -> None:
    """C q' = M'(q) q'^2/2 = 0.03 cos(q) q'^2, and G = m g l cos q with m = 0.02, l = 0.5."""
    model = load_model("arm")
    data = mujoco.MjData(model)
    for q in ARM_ANGLES:
        for rate in (-7.0, 0.0, 0.5, 3.0):
            data.qpos[0], data.qvel[0] = q, rate
            mujoco.mj_forward(model, data)
            expected = 0.03 * math.cos(q) * rate**2 + 0.02 * 9.8 * 0.5 * math.cos(q)
            assert data.qfrc_bias[0] == pytest.approx(expected, abs=1e-12)


def test_cable_has_length_zero_at_the_singular_angle_only() -> None:
    model, r = load_model("arm"), 0.2
    data = mujoco.MjData(model)
    for q in (*ARM_ANGLES, math.pi / 2, -1.5 * math.pi):
        data.qpos[0] = q
        mujoco.mj_forward(model, data)
        expected = 2 * r * abs(math.sin((q - math.pi / 2) / 2))
        assert data.ten_length[0] == pytest.approx(expected, abs=1e-15)
        # sin(-pi) is 1e-16 in floating point.
        assert SYSTEMS["arm"].singular([q, 0.0]) == (expected < 1e-15)


def test_angles_are_counter_clockwise_in_the_picture(name: str) -> None:
    """The picture's right is +x and its depth +y, so a positive rate turns about -y."""
    model = load_model(name)
    data = mujoco.MjData(model)
    data.qvel[-1] = 1.0
    mujoco.mj_forward(model, data)
    velocity = np.zeros(6)
    moved = model.body(SYSTEMS[name].bodies[-1]).id
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, moved, velocity, 0)
    np.testing.assert_allclose(velocity[:3], [0, -1, 0], atol=1e-15)

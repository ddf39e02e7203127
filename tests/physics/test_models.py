"""The MJCF files: names, flags, and whether they are the chapter's systems."""

from __future__ import annotations

import math
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hand_written import tip, two_link_inertia

from grosmc_mj.errors import ModelError
from grosmc_mj.physics import files as models
from grosmc_mj.physics.files import load_model, model_path
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SYSTEMS


def at(model: mujoco.MjModel, *q: float, rate: float = 0.0) -> tuple[np.ndarray, mujoco.MjData]:
    """Mass matrix and all else where the last coordinates are q and move at a rate."""
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[-len(q) :], data.qvel[-1] = q, rate
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    return full, data


def test_the_mjcf_has_the_system_s_names_flags_cameras_and_direction(name: str) -> None:
    model, system = mujoco.MjModel.from_xml_path(str(model_path(name))), SYSTEMS[name]
    assert tuple(model.body(i).name for i in range(1, model.nbody)) == system.bodies
    assert (model.opt.integrator, model.opt.timestep) == (mujoco.mjtIntegrator.mjINT_RK4, 1e-3)
    for flag in (mujoco.mjtDisableBit.mjDSBL_AUTORESET, mujoco.mjtDisableBit.mjDSBL_CONTACT):
        assert model.opt.disableflags & flag
    fixed = {model.camera(i).name: model.cam_mode[i] == 0 for i in range(model.ncam)}
    assert (fixed["fixed"], fixed["follow"], model.nlight > 0) == (True, False, True)
    # The picture's right is +x and its depth +y, so a positive rate turns about -y.
    velocity, moved = np.zeros(6), model.body(system.bodies[-1]).id
    data = at(model, 0.0, rate=1.0)[1]
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, moved, velocity, 0)
    np.testing.assert_allclose(velocity[:3], [0, -1, 0], atol=1e-15)


def test_servo_pendulum_and_two_links_have_their_numbers_and_mass_matrices() -> None:
    servo = load_model("servo")
    # Decimal numbers, read once: half a unit in the last place.
    numbers = at(servo, 0.3)[0][0, 0], servo.dof_damping[0], servo.actuator("current").gear[0]
    assert numbers == pytest.approx((5.77e-2, 8.8e-3, 0.667), rel=1e-15)
    assert not servo.actuator_ctrllimited[0]
    pendulum, links = load_model("cart_pendulum"), load_model("two_link_arm")
    p = MujocoPlant.load("two_link_arm").parameters
    for angle in np.linspace(-3, 3, 13):
        coupling = -0.1 * math.cos(angle)
        expected = [[1.2, coupling], [coupling, 0.2 / 3]]
        np.testing.assert_allclose(at(pendulum, angle)[0], expected, rtol=0, atol=1e-15)
        # Of its head comment: J1 = 0.425, J2 = 0.128/1.5, h = 0.14.
        k = 0.14 * math.cos(angle)
        expected = [[0.425 + 0.128 / 1.5 + 2 * k, 0.128 / 1.5 + k], [0.128 / 1.5 + k, 0.128 / 1.5]]
        M, data = at(links, 0.7, angle)
        for matrix in (M, two_link_inertia([0.7, angle], p)):
            np.testing.assert_allclose(matrix, expected, atol=1e-15)
        # Angles are counter-clockwise from the right, the second one from the first link.
        x, z = tip([0.7, angle], p)
        np.testing.assert_allclose(data.site("tip").xpos, [x, 0, 1.1 + z], atol=1e-15)


def test_arm_has_the_inertia_and_the_energy_true_bias_of_eq_57() -> None:
    """C q' = M'(q) q'^2/2 = 0.03 cos(q) q'^2, and G = m g l cos q with m = 0.02, l = 0.5.

    Its cable has length zero at the singular angle only.
    """
    model = load_model("arm")
    for q in (-4.0, -1.0, 0.0, 1.4, math.pi / 2, -1.5 * math.pi):
        M, data = at(model, q, rate=3.0)
        length = 2 * 0.2 * abs(math.sin((q - math.pi / 2) / 2))
        assert data.ten_length[0] == pytest.approx(length, abs=1e-15)
        assert SYSTEMS["arm"].singular([q, 0.0]) == (length < 1e-15)
        if length > 0.01:
            assert M[0, 0] == pytest.approx(0.1 + 0.06 * math.sin(q), abs=1e-12)
            bias = 0.03 * math.cos(q) * 3.0**2 + 0.02 * 9.8 * 0.5 * math.cos(q)
            assert data.qfrc_bias[0] == pytest.approx(bias, abs=1e-12)


AUTORESET = mujoco.mjtDisableBit.mjDSBL_AUTORESET
OTHERS = r"servo: the model has joints \({}\) and actuators \({}\), must have \('shaft',\) and \('c"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        # A diverged run that starts again in silence would be a verdict on another run.
        (' autoreset="disable"', "", ""),
        (".*", "hello", "servo"),
        ("common.xml", "nowhere.xml", "servo"),
        (r'mass="[1-9]\.?', 'mass="-1', "servo"),
        ('name="current"', 'name="voltage"', OTHERS.format("'shaft',", "'voltage',")),
        ('"shaft"', '"axle"', OTHERS.format("'axle',", "'current',")),
    ],
)
def test_a_broken_model_or_other_names_are_one_line_and_autoreset_is_forced(
    old: str, new: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for path in model_path("servo").parent.glob("*.xml"):
        (tmp_path / path.name).write_text(re.sub(old, new, path.read_text()))
    monkeypatch.setattr(models, "_FOLDERS", (tmp_path,))
    if not words:
        forgot = load_model("servo").opt.disableflags
        assert not forgot & AUTORESET
        assert MujocoPlant.load("servo").model.opt.disableflags == forgot | AUTORESET
        return
    with pytest.raises(ModelError, match=words) as refused:
        _ = MujocoPlant.load("servo").model
    assert "\n" not in str(refused.value)

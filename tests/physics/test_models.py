"""The MJCF files: names, flags, and whether they are the chapter's systems."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
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
    assert tuple(model.joint(i).name for i in range(model.njnt)) == system.joints
    assert model.nq == model.nv == len(system.joints)
    assert tuple(model.actuator(i).name for i in range(model.nu)) == system.actuators
    assert model.nu == (2 if name == "two_link_arm" else 1)
    assert (model.opt.integrator, model.opt.timestep) == (mujoco.mjtIntegrator.mjINT_RK4, 1e-3)
    for flag in (mujoco.mjtDisableBit.mjDSBL_AUTORESET, mujoco.mjtDisableBit.mjDSBL_CONTACT):
        assert model.opt.disableflags & flag
    fixed = {model.camera(i).name: model.cam_mode[i] == 0 for i in range(model.ncam)}
    assert (fixed["fixed"], fixed["follow"], model.nlight > 0) == (True, False, True)
    symbols = system.equations
    assert symbols.h == tuple(symbols.x[index] for index in system.controlled)
    # The picture's right is +x and its depth +y, so a positive rate turns about -y.
    velocity, moved = np.zeros(6), model.body(system.bodies[-1]).id
    data = at(model, 0.0, rate=1.0)[1]
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, moved, velocity, 0)
    np.testing.assert_allclose(velocity[:3], [0, -1, 0], atol=1e-15)


# Whether they are the chapter's systems


def test_servo_pendulum_and_two_links_have_their_numbers_and_mass_matrices() -> None:
    servo = load_model("servo")
    # Decimal numbers, read once: half a unit in the last place.
    numbers = at(servo, 0.3)[0][0, 0], servo.dof_damping[0], servo.actuator("current").gear[0]
    assert numbers == pytest.approx((5.77e-2, 8.8e-3, 0.667), rel=1e-15)
    assert not servo.actuator_ctrllimited[0]
    pendulum, links, p = load_model("cart_pendulum"), load_model("two_link_arm"), two_links()
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


def two_links() -> object:
    return MujocoPlant.load("two_link_arm").parameters


def test_arm_has_the_inertia_and_the_energy_true_bias_of_eq_57() -> None:
    """C q' = M'(q) q'^2/2 = 0.03 cos(q) q'^2, and G = m g l cos q with m = 0.02, l = 0.5.

    Its cable has length zero at the singular angle only.
    """
    model, singular = load_model("arm"), (math.pi / 2, -1.5 * math.pi)
    for q in (*np.linspace(-1.5 * math.pi + 0.1, math.pi / 2 - 0.1, 41), *singular):
        for rate in (-7.0, 0.0, 3.0):
            M, data = at(model, q, rate=rate)
            length = 2 * 0.2 * abs(math.sin((q - math.pi / 2) / 2))
            assert data.ten_length[0] == pytest.approx(length, abs=1e-15)
            # sin(-pi) is 1e-16 in floating point.
            assert SYSTEMS["arm"].singular([q, 0.0]) == (length < 1e-15) == (q in singular)
            if q not in singular:
                assert M[0, 0] == pytest.approx(0.1 + 0.06 * math.sin(q), abs=1e-12)
                bias = 0.03 * math.cos(q) * rate**2 + 0.02 * 9.8 * 0.5 * math.cos(q)
                assert data.qfrc_bias[0] == pytest.approx(bias, abs=1e-12)


# How a model is found, and what is said when it is not


@pytest.fixture
def copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Read the models from changed copies."""

    def copy(change: Callable[[str], str]) -> None:
        for path in model_path("servo").parent.glob("*.xml"):
            (tmp_path / path.name).write_text(change(path.read_text()))
        monkeypatch.setattr(models, "_FOLDERS", (tmp_path,))

    return copy


def test_only_autoreset_is_forced_on_a_model_that_forgot_it(
    name: str, copied: Callable[..., None]
) -> None:
    """A diverged run that starts again in silence would be a verdict on another run."""
    copied(lambda text: text.replace(' autoreset="disable"', ""))
    forgot, flag = load_model(name), mujoco.mjtDisableBit.mjDSBL_AUTORESET
    assert not forgot.opt.disableflags & flag
    assert MujocoPlant.load(name).model.opt.disableflags == forgot.opt.disableflags | flag


OTHERS = r"servo: the model has joints \({}\) and actuators \({}\), must have \('shaft',\) and \('c"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: "hello", "servo"),
        (lambda text: text.replace("common.xml", "nowhere.xml"), "servo"),
        (lambda text: re.sub(r'mass="[1-9]\.?', 'mass="-1', text), "servo"),
        (lambda text: text.replace('name="current"', 'name="voltage"'),
         OTHERS.format("'shaft',", "'voltage',")),
        (lambda text: text.replace('"shaft"', '"axle"'), OTHERS.format("'axle',", "'current',")),
        (lambda text: text.replace("</actuator>", '<motor name="2" joint="shaft"/></actuator>'),
         OTHERS.format("'shaft',", "'current', '2'")),
    ],
)  # fmt: skip
def test_broken_mjcf_or_other_names_are_one_line_of_model_error(
    change: Callable[[str], str], words: str, copied: Callable[..., None]
) -> None:
    copied(change)
    loads = [lambda: MujocoPlant.load("servo").model]
    for load in loads if "joints" in words else [*loads, lambda: load_model("servo")]:
        with pytest.raises(ModelError, match=words) as refused:
            load()
        assert "\n" not in str(refused.value)

"""What values of uncertain numbers make of the plant, of disturbances and of the start."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from campaign_cases import BOTH, LQR, campaign, case, servo

from grosmc_mj.physics.edits import AddedMass, BodyEdit, JointEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import Pulse, SineFrom
from grosmc_mj.sweep.parameters import Varied
from grosmc_mj.sweep.screening import Batch

EDITED = """
[[edit]]
body = "rotor"
length_scale = 1.5
[[edit]]
joint = "shaft"
damping = 0.3
"""


def table(owner: str, quantity: str, spread: str = "[1, 2]", more: str = "") -> str:
    """One [[uncertain]]."""
    return f"[[uncertain]]\n{owner}\n{quantity} = {spread}\n{more}\n"


def plant_sample(tables: str, *values: float, more: str = "") -> Varied:
    """The servo with these values."""
    return campaign(servo(tables, laws=LQR, limits="") + more).plant_sample(values)


def model(tables: str, *values: float, more: str = "") -> mujoco.MjModel:
    """Its compiled model."""
    plant = plant_sample(tables, *values, more=more).plant(MujocoPlant.load("servo"))
    assert isinstance(plant, MujocoPlant)
    return plant.model


ROTOR, SHAFT = 'body = "rotor"', 'joint = "shaft"'
KILOGRAMS = '["0 kg", "1 kg"]'


def test_a_mass_scale_reaches_mass_and_inertia() -> None:
    nominal, found = (
        MujocoPlant.load("servo").model.body("rotor"),
        model(table(ROTOR, "mass_scale"), 1.7).body("rotor"),
    )
    np.testing.assert_allclose(found.mass, 1.7 * nominal.mass, rtol=1e-14)
    np.testing.assert_allclose(found.inertia, 1.7 * nominal.inertia, rtol=1e-14)


def test_a_length_scale_keeps_the_mass() -> None:
    nominal = MujocoPlant.load("servo").model.body("rotor")
    found = model(table(ROTOR, "length_scale"), 1.7).body("rotor")
    np.testing.assert_allclose(found.mass, nominal.mass, rtol=1e-14)
    np.testing.assert_allclose(found.inertia, 1.7**2 * nominal.inertia, rtol=1e-14)


@pytest.mark.parametrize(
    ("quantity", "field"),
    [("damping", "dof_damping"), ("friction", "dof_frictionloss"), ("armature", "dof_armature")],
)
def test_what_is_of_a_joint_reaches_the_model(quantity: str, field: str) -> None:
    assert getattr(model(table(SHAFT, quantity, "[0, 1]"), 0.37), field).tolist() == [0.37]


def test_an_added_mass_is_where_it_is_said_to_be() -> None:
    at = 'at = ["0.3 m", "0 m", "0.4 m"]'
    tables = table(ROTOR, "added_mass", KILOGRAMS, at)
    nominal, found = MujocoPlant.load("servo").model, model(tables, 0.2)
    # The shaft is the y axis: J grows by m r^2.
    inertia = [_inertia(each) for each in (nominal, found)]
    assert inertia[1] - inertia[0] == pytest.approx(0.2 * (0.3**2 + 0.4**2), rel=1e-12)
    assert plant_sample(tables, 0.0).case.edits == ()


def _inertia(of: mujoco.MjModel) -> float:
    """About the only joint."""
    data, found = mujoco.MjData(of), np.zeros((1, 1))
    mujoco.mj_forward(of, data)
    mujoco.mj_fullM(of, data, found)
    return found.item()


def test_uncertain_numbers_merge_with_the_files_edits() -> None:
    tables = table(ROTOR, "mass_scale") + table(SHAFT, "friction", "[0, 1]")
    found = plant_sample(tables, 1.7, 0.1, more=EDITED)
    assert found.case.edits == (
        BodyEdit("rotor", mass_scale=1.7, length_scale=1.5),
        JointEdit("shaft", damping=0.3, friction=0.1),
    )
    over = plant_sample(table(ROTOR, "length_scale"), 1.2, more=EDITED)
    assert over.case.edits[0] == BodyEdit("rotor", length_scale=1.2)
    mass = plant_sample(table(ROTOR, "added_mass", KILOGRAMS), 0.2, more=EDITED)
    assert mass.case.edits[2] == AddedMass("rotor", 0.2, (0.0, 0.0, 0.0))
    assert len(mass.case.edits) == 3


def test_an_edit_of_one_body_is_not_anothers() -> None:
    tables = table('body = "upper"', "mass_scale")
    edit = '[[edit]]\nbody = "lower"\nlength_scale = 1.5\n'
    asked = campaign(case("two_link_arm", tables, laws=LQR) + edit)
    assert asked.plant_sample([1.7]).case.edits == (
        BodyEdit("lower", length_scale=1.5),
        BodyEdit("upper", mass_scale=1.7),
    )


LOAD, HUM = 'disturbance = "load"', 'disturbance = "hum"'


def test_an_amplitude_scales_one_disturbances_wrench() -> None:
    load, hum = plant_sample(table(LOAD, "amplitude", "[-2, 2]"), -1.5).case.disturbances
    assert load.wrench == (0, 0, 0, 0, -1.5, 0)
    assert hum.wrench == (0, 0, 0, 0, 0.1, 0)
    assert load.profile == Pulse(0.02, 0.03)


def test_a_pulse_keeps_its_length() -> None:
    load, hum = plant_sample(table(LOAD, "onset", '["0.1 s", "0.2 s"]'), 0.125).case.disturbances
    assert isinstance(load.profile, Pulse)
    assert load.profile.start == 0.125
    assert load.profile.stop - load.profile.start == pytest.approx(0.01, rel=1e-12)
    assert hum.profile == SineFrom(2 * np.pi, 0.02)


def test_frequency_phase_and_onset_of_a_sine() -> None:
    tables = (
        table(HUM, "frequency", '["1 Hz", "2 Hz"]')
        + table(HUM, "phase", '["0 deg", "360 deg"]')
        + table(HUM, "onset", '["0 s", "1 s"]')
    )
    found = plant_sample(tables, 7.0, 1.0, 0.5)
    assert found.case.disturbances[1].profile == SineFrom(frequency=7.0, onset=0.5, phase=1.0)
    assert found.case.onset == 0.02


def test_a_start_is_one_state() -> None:
    tables = table('start = "rotor speed"', "value", '["-1 rad/s", "1 rad/s"]')
    assert plant_sample(tables, 0.25).case.x0 == (0.0, 0.25)


def test_plants_with_the_same_edits_are_one() -> None:
    asked = campaign(servo(BOTH, laws=LQR, limits=""))
    values = np.array([[1.5, 0.1], [1.5, -0.3], [2.0, 0.1]])
    first, second, third = Batch(asked, values, [0] * 3).physics
    assert first is second
    assert third is not first

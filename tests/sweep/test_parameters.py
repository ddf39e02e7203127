"""Values of uncertain numbers reach the plant, its machine, its loop, disturbances and start."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import campaign_cases as small
import mujoco
import numpy as np
import pytest
from campaign_cases import LQR, MACHINE, campaign, of, plain, servo, standing, uncertain

from grosmc_mj.machine import Motor
from grosmc_mj.physics.edits import AddedMass, BodyEdit, JointEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import Pulse, SineFrom
from grosmc_mj.sweep.family import family_of
from grosmc_mj.sweep.map import pass_map_of
from grosmc_mj.sweep.parameters import Varied
from grosmc_mj.sweep.radius import radius
from grosmc_mj.sweep.screening import Batch

ROTOR, SHAFT, KILOGRAMS = 'body = "rotor"', 'joint = "shaft"', 'added_mass = ["0 kg", "1 kg"]'
LOAD, HUM = 'disturbance = "load"', 'disturbance = "hum"'
EDITED = f"[[edit]]\n{ROTOR}\nlength_scale = 1.5\n[[edit]]\n{SHAFT}\ndamping = 0.3\n"


def sample(tables: str, *values: float, more: str = "") -> Varied:
    """The servo with these values."""
    return campaign(plain(tables) + more).plant_sample(values)


def models(tables: str, *values: float) -> tuple[Any, Any]:
    """The compiled models of the nominal servo and of the one with these values."""
    nominal: Any = campaign(plain(tables)).plant
    changed: Any = sample(tables, *values).plant(nominal)
    return nominal.model, changed.model


def test_a_number_of_a_body_or_joint_reaches_the_model() -> None:
    # By powers of the scale: a longer body keeps its mass.
    for quantity, mass, inertia in (("mass_scale", 1, 1), ("length_scale", 0, 2)):
        nominal, scaled = (
            model.body("rotor") for model in models(uncertain(ROTOR, f"{quantity} = [1, 2]"), 1.7)
        )
        np.testing.assert_allclose(scaled.mass, 1.7**mass * nominal.mass, rtol=1e-14)
        np.testing.assert_allclose(scaled.inertia, 1.7**inertia * nominal.inertia, rtol=1e-14)
    for quantity, field in (("damping", "damping"), ("friction", "frictionloss"),
                            ("armature", "armature")):  # fmt: skip
        _, changed = models(uncertain(SHAFT, f"{quantity} = [0, 1]"), 0.37)
        assert getattr(changed, f"dof_{field}").tolist() == [0.37]
    # The shaft is the y axis: by an added mass J grows by m r^2.
    tables = uncertain(ROTOR, KILOGRAMS, 'at = ["0.3 m", "0 m", "0.4 m"]')
    inertia = []
    for model in models(tables, 0.2):
        data, matrix = mujoco.MjData(model), np.zeros((1, 1))
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, matrix)
        inertia.append(matrix.item())
    assert inertia[1] - inertia[0] == pytest.approx(0.2 * (0.3**2 + 0.4**2), rel=1e-12)
    assert sample(tables, 0.0).case.edits == ()


def test_uncertain_numbers_merge_with_the_files_edits() -> None:
    tables = uncertain(ROTOR, "mass_scale = [1, 2]") + uncertain(SHAFT, "friction = [0, 1]")
    assert sample(tables, 1.7, 0.1, more=EDITED).case.edits == (
        BodyEdit("rotor", mass_scale=1.7, length_scale=1.5),
        JointEdit("shaft", damping=0.3, friction=0.1),
    )
    values = np.array([[1.5, 0.1], [1.5, -0.3], [2.0, 0.1]])
    first, second, third = Batch(campaign(plain()), values, [0] * 3).physics
    assert (first is second, second is third) == (True, False)
    over = sample(uncertain(ROTOR, "length_scale = [1, 2]"), 1.2, more=EDITED)
    assert over.case.edits[0] == BodyEdit("rotor", length_scale=1.2)
    heavier = sample(uncertain(ROTOR, KILOGRAMS), 0.2, more=EDITED).case.edits
    assert heavier[2:] == (AddedMass("rotor", 0.2, (0.0, 0.0, 0.0)),)


def test_numbers_of_a_disturbance_and_a_start_are_of_that_one() -> None:
    load, hum = sample(uncertain(LOAD, "amplitude = [-2, 2]"), -1.5).case.disturbances
    assert (load.wrench, load.profile) == ((0, 0, 0, 0, -1.5, 0), Pulse(0.02, 0.03))
    assert hum.wrench == (0, 0, 0, 0, 0.1, 0)
    load, hum = sample(uncertain(LOAD, 'onset = ["0.1 s", "0.2 s"]'), 0.125).case.disturbances
    profile: Any = load.profile
    assert (profile.start, profile.stop) == (0.125, pytest.approx(0.135, rel=1e-12))
    assert hum.profile == SineFrom(2 * np.pi, 0.02)
    numbers = ('frequency = ["1 Hz", "2 Hz"]', 'phase = ["0 deg", "9 deg"]',
               'onset = ["0 s", "1 s"]')  # fmt: skip
    tables = "".join(uncertain(HUM, number) for number in numbers)
    tables += uncertain('start = "rotor speed"', 'value = ["-1 rad/s", "1 rad/s"]')
    changed = sample(tables, 7.0, 1.0, 0.5, 0.25).case
    assert changed.disturbances[1].profile == SineFrom(frequency=7.0, onset=0.5, phase=1.0)
    assert (changed.onset, changed.x0) == (0.02, (0.0, 0.25))


def test_numbers_of_a_machine_have_the_files_values_and_reach_the_compiled_one() -> None:
    tables = (
        of("transmission", "shaft", 'backlash = ["0 deg", "0.2 deg"]')
        + of("lugre", "shaft", 'coulomb = ["30 mN m", "70 mN m"]')
        + of("motor", "current", 'resistance = ["2 ohm", "3 ohm"]')
        + of("swinging_load", "rotor", 'mass = ["50 g", "150 g"]')
        + of("stop", "shaft", "restitution = [0.1, 0.5]")
    )
    declared = campaign(standing(tables, MACHINE))
    quantities = declared.family.quantities
    assert [f"{number.name} [{number.unit}]" for number in quantities] == [
        "shaft backlash [rad]", "shaft coulomb [N m]", "current resistance [ohm]",
        "rotor mass [kg]", "shaft restitution []",
    ]  # fmt: skip
    assert declared.family.nominal.tolist() == pytest.approx([1e-3, 0.05, 2.6, 0.1, 0.3])
    nominal: Any = declared.plant
    changed: Any = declared.plant_sample([2e-3, 0.06, 2.2, 0.12, 0.5]).plant(nominal)
    model, other = changed.model, nominal.model
    assert model.tendon_lengthspring[0] == pytest.approx([-1e-3, 1e-3])
    assert model.body("rotor swing").mass[0] == 0.12
    # K^2/R of the brake, whatever the unit of voltage.
    brakes = [of.actuator("current").gainprm for of in (model, other)]
    ratio = brakes[0][1] ** 2 / brakes[0][0] / (brakes[1][1] ** 2 / brakes[1][0])
    assert ratio == pytest.approx(2.6 / 2.2, rel=1e-9)
    # The contact's damping falls with the restitution; its stiffness is the duration's.
    assert (model.jnt_solref[0] != other.jnt_solref[0]).tolist() == [False, True]
    assert [part.coulomb for part in changed.parts if hasattr(part, "coulomb")] == [0.06]


def test_an_input_is_uncertain_by_the_name_that_files_call_it() -> None:
    drawn = of("motor", "elbow torque", 'resistance = ["1 ohm", "3 ohm"]')
    motor = '[[motor]]\ninput = "elbow torque"\nconstant = "0.1 N m/A"\nresistance = "2 ohm"\n'
    file = small.specification(standing(drawn, motor + LQR, "two_link_arm")).file
    edited = replace(campaign(plain()).experiment.case, edits=(Motor("elbow_torque", 0.1, 2.0),))
    (number,) = family_of(file, edited, MujocoPlant.load("two_link_arm")).quantities
    assert (number.of, number.nominal) == ("elbow_torque", 2.0)
    assert number.name == "elbow torque resistance"


def test_searches_scale_to_machines_that_can_be_and_no_farther() -> None:
    """Twice as far from 50 mN m, friction that slides would be more than what is static."""
    declared = campaign(standing(of("lugre", "shaft", 'coulomb = ["40 mN m", "60 mN m"]'), MACHINE))
    assert declared.family.largest_scale > 2.0 >= declared.largest_scale
    assert declared.largest_scale == pytest.approx(2.0, rel=2e-3)
    assert radius(declared, "lqr").largest == declared.largest_scale


def test_numbers_of_a_loop_are_drawn_and_its_times_are_whole_timesteps() -> None:
    tables = (
        uncertain("computing = true", 'delay = ["0 ms", "4 ms"]')
        + of("sensor", "rotor angle", 'noise = ["0 mrad", "0.3 mrad"]')
        + of("estimator", "rotor speed", 'bandwidth = ["50 rad/s", "200 rad/s"]')
        + of("actuator", "current", 'lag = ["0 ms", "3 ms"]')
    )
    declared = campaign(standing(tables, small.LOOP + small.DEVIATION))
    assert {number.name: number.unit for number in declared.family.quantities} == {
        "computing delay": "s", "rotor angle noise": "rad", "rotor speed bandwidth": "rad/s",
        "current lag": "s",
    }  # fmt: skip
    loop = declared.plant_sample([2.4e-3, 1e-4, 80.0, 2e-3]).case.loop
    assert loop is not None
    assert loop.computing.delay == pytest.approx(2e-3)
    assert (loop.sensors[0].noise, loop.estimators[0].bandwidth) == (1e-4, 80.0)
    assert loop.actuators[0].lag == 2e-3
    # They are shown as they are run: 2.6 ms on a grid of 1 ms.
    assert declared.words(np.array([2.6e-3, 2e-4, 80.0, 2.4e-3])) == (
        "computing delay 0.003 s, rotor angle noise 0.01146 °, rotor speed bandwidth 80 rad/s, "
        "current lag 0.0024 s"
    )
    # A delay that is run as the nominal one is the nominal one.
    assert declared.words(np.array([1.4e-3, 1e-4, 100.0, 1e-3])) == "the nominal one"
    delay, _, bandwidth, _ = declared.family.quantities
    columns = {delay.name: np.array([0.4e-3, 2.6e-3]), bandwidth.name: np.array([80.0, 90.0])}
    columns["relative"] = np.array([0.1, -0.1])
    folder: Any = SimpleNamespace(columns=lambda *_: dict.fromkeys(declared.laws, columns))
    shown = pass_map_of(declared, folder, (delay, bandwidth))
    assert shown.titles == ("computing delay [s]", "rotor speed bandwidth [rad/s]")
    np.testing.assert_array_equal(shown.runs["lqr"][:2], [[0.0, 3e-3], [80.0, 90.0]])
    # A factor has the unit 1.
    scale, load = campaign(servo()).family.quantities
    columns |= {scale.name: np.array([1.0, 2.0]), load.name: np.array([-1.0, 1.0])}
    titles = pass_map_of(declared, folder, (scale, load)).titles
    assert titles == ("rotor mass scale [1]", "load amplitude [1]")

"""Values of uncertain numbers reach the plant, its machine, its loop, disturbances and start."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from campaigns import BOTH, LOOP, MACHINE, campaign, deviation_below, part, plain, uncertain

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.mechanics.machine import Motor
from grosmc_mj.mechanics.physics.edits import AddedMass, BodyEdit, JointEdit
from grosmc_mj.simulation.disturbances import Pulse, SineFrom
from grosmc_mj.studies.campaign.batch import Batch
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.map import PassMap, pass_map_of
from grosmc_mj.studies.campaign.radius import radius
from grosmc_mj.studies.sweep.quantities import Quantity
from grosmc_mj.studies.sweep.runs import plant_of

ADDED_MASS = uncertain("edit.rotor.added_mass", "0 kg", "1 kg")
AWAY = {**ADDED_MASS, "at": ["0.3 m", "0 m", "0.4 m"]}
EDITS = [{"body": "rotor", "length_scale": 1.5}, {"joint": "shaft", "damping": 0.3}]

Number = dict[str, Any]


def sample(values: dict[str, float], *numbers: Number, **tables: Any) -> Experiment:
    """The servo with these values, of factors or of numbers that are declared.

    Args:
        values: By the number; the declared numbers have theirs in their order.
        numbers: Declared numbers; by default factors and numbers from 0 to 9.
        tables: Other tables of the case.
    """
    declared = numbers or tuple(uncertain(number, 0.1, 9) for number in values)
    return campaign(plain(*declared, **tables)).plant_sample([*values.values()])


def models(values: dict[str, float], *numbers: Number) -> tuple[Any, Any]:
    """The compiled models of the nominal servo and of the one with these values."""
    nominal: Any = campaign(plain(*BOTH)).plant
    changed: Any = plant_of(sample(values, *numbers), nominal)
    return nominal.model, changed.model


# Bodies and joints.


# By powers of the scale: a longer body keeps its mass.
@pytest.mark.parametrize(
    ("quantity", "mass", "inertia"), [("mass_scale", 1, 1), ("length_scale", 0, 2)]
)
def test_a_scale_of_a_body_reaches_the_model(quantity: str, mass: int, inertia: int) -> None:
    nominal, scaled = models({f"edit.rotor.{quantity}": 1.7})
    before = nominal.body("rotor")
    after = scaled.body("rotor")
    np.testing.assert_allclose(after.mass, 1.7**mass * before.mass, rtol=1e-14)
    np.testing.assert_allclose(after.inertia, 1.7**inertia * before.inertia, rtol=1e-14)


@pytest.mark.parametrize(
    ("quantity", "field"),
    [("damping", "dof_damping"), ("friction", "dof_frictionloss"), ("armature", "dof_armature")],
)
def test_a_number_of_a_joint_reaches_the_model(quantity: str, field: str) -> None:
    _, changed = models({f"edit.shaft.{quantity}": 0.37})
    assert getattr(changed, field).tolist() == [0.37]


def shaft_inertia(model: Any) -> float:
    """Inertia about the shaft [kg m^2]."""
    data = mujoco.MjData(model)
    matrix = np.zeros((1, 1))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, matrix)
    return matrix.item()


def test_an_added_mass_adds_its_inertia_about_the_shaft() -> None:
    nominal, heavier = models({"added mass": 0.2}, AWAY)
    # The shaft is the y axis: J grows by m r^2.
    growth = shaft_inertia(heavier) - shaft_inertia(nominal)
    assert growth == pytest.approx(0.2 * (0.3**2 + 0.4**2), rel=1e-12)


def test_an_added_mass_of_zero_changes_nothing() -> None:
    nominal, unchanged = models({"added mass": 0.0}, AWAY)
    assert unchanged.body_inertia.tolist() == nominal.body_inertia.tolist()
    assert unchanged.body_mass.tolist() == nominal.body_mass.tolist()


def test_uncertain_numbers_merge_with_the_files_edits() -> None:
    values = {"edit.rotor.mass_scale": 1.7, "edit.shaft.friction": 0.1}
    assert sample(values, edit=EDITS).edits == (
        BodyEdit("rotor", mass_scale=1.7, length_scale=1.5),
        JointEdit("shaft", damping=0.3, friction=0.1),
    )


def test_an_uncertain_number_replaces_that_of_an_edit() -> None:
    edits = sample({"edit.rotor.length_scale": 1.2}, edit=EDITS).edits
    assert edits[0] == BodyEdit("rotor", length_scale=1.2)


def test_an_added_mass_is_an_edit_of_its_own() -> None:
    edits = sample({"added mass": 0.2}, ADDED_MASS, edit=EDITS).edits
    assert edits[2:] == (AddedMass("rotor", 0.2, (0.0, 0.0, 0.0)),)


def test_plants_with_the_same_edits_are_one() -> None:
    values = np.array([[1.5, 0.1], [1.5, -0.3], [2.0, 0.1]])
    first, second, third = Batch(campaign(plain(*BOTH)), values, [0] * 3).physics
    assert first is second
    assert second is not third


# Disturbances and the start.


def test_an_amplitude_scales_its_disturbance_alone() -> None:
    amplitude = uncertain("disturbance.load.scale", -2, 2, nominal=0)
    load, hum = sample({"load": -1.5}, amplitude).disturbances
    assert (load.amplitudes, load.profile) == ((0, 0, 0, 0, -1.5, 0), Pulse(0.02, 0.03))
    assert hum.amplitudes == (0, 0, 0, 0, 0.1, 0)


def test_a_pulse_with_another_onset_keeps_its_length() -> None:
    onset = uncertain("disturbance.load.onset", "0.1 s", "0.2 s")
    load, hum = sample({"onset": 0.125}, onset).disturbances
    profile: Any = load.profile
    assert (profile.start, profile.stop) == (0.125, pytest.approx(0.135, rel=1e-12))
    assert hum.profile == SineFrom(2 * np.pi, 0.02)


def test_numbers_of_a_sine_and_a_start_reach_the_case() -> None:
    """The sine begins after the pulse: the onset of a case is that of its first disturbance."""
    case = sample(
        {"frequency": 7.0, "phase": 1.0, "onset": 0.5, "speed": 0.25},
        uncertain("disturbance.hum.frequency", "1 Hz", "2 Hz"),
        uncertain("disturbance.hum.phase", "0 deg", "9 deg"),
        uncertain("disturbance.hum.onset", "0 s", "1 s"),
        uncertain("run.start.rotor speed", "-1 rad/s", "1 rad/s"),
    )
    assert case.disturbances[1].profile == SineFrom(frequency=7.0, onset=0.5, phase=1.0)
    assert case.x0 == (0.0, 0.25)
    assert case.onset == 0.02


# Machines.


@cache
def machine() -> Campaign:
    """A servo as it is built, with uncertain numbers of its machine."""
    numbers = [
        uncertain("transmission.shaft.backlash", "0 deg", "0.2 deg"),
        uncertain("lugre.shaft.coulomb", "30 mN m", "70 mN m"),
        uncertain("motor.current.resistance", "2 ohm", "3 ohm"),
        uncertain("wall.rotor.radius", "0.5 cm", "1.5 cm"),
        uncertain("stop.shaft.restitution", 0.1, 0.5),
    ]
    return campaign(part(*numbers, **MACHINE))


def test_numbers_of_a_machine_have_the_file_s_values() -> None:
    family = machine().family
    assert [f"{number.name} [{number.unit}]" for number in family.quantities] == [
        "shaft backlash [rad]",
        "shaft coulomb [N m]",
        "current resistance [ohm]",
        "rotor radius [m]",
        "shaft restitution []",
    ]
    assert family.nominal.tolist() == pytest.approx([1e-3, 0.05, 2.6, 0.01, 0.3])


@pytest.fixture(scope="module")
def machines() -> tuple[Any, Any]:
    """The nominal machine and one with other numbers."""
    nominal = machine().plant
    return nominal, plant_of(machine().plant_sample([2e-3, 0.06, 2.2, 0.012, 0.5]), nominal)


def test_numbers_of_gear_wall_and_friction_reach_the_model(machines: tuple[Any, Any]) -> None:
    _, changed = machines
    assert changed.model.tendon_lengthspring[0] == pytest.approx([-1e-3, 1e-3])
    assert changed.model.geom("bumper 1").size[0] == 0.012
    assert [part.coulomb for part in changed.parts if hasattr(part, "coulomb")] == [0.06]


def test_a_resistance_reaches_the_brake(machines: tuple[Any, Any]) -> None:
    """K^2/R of the brake, whatever the unit of voltage."""
    nominal, changed = (plant.model.actuator("current").gainprm for plant in machines)
    ratio = (changed[1] ** 2 / changed[0]) / (nominal[1] ** 2 / nominal[0])
    assert ratio == pytest.approx(2.6 / 2.2, rel=1e-9)


def test_a_restitution_changes_the_damping_of_the_contact(machines: tuple[Any, Any]) -> None:
    nominal, changed = machines
    # The contact's damping falls with the restitution; its stiffness is the duration's.
    differs = changed.model.jnt_solref[0] != nominal.model.jnt_solref[0]
    assert differs.tolist() == [False, True]


def test_an_input_is_uncertain_by_the_name_that_files_call_it() -> None:
    resistance = uncertain("motor.elbow torque.resistance", "1 ohm", "3 ohm")
    elbow = {"input": "elbow torque", "constant": "0.1 N m/A", "resistance": "2 ohm"}
    declared = campaign(part(resistance, system="two_link_arm", motor=elbow))
    (quantity,) = declared.family.quantities
    (motor,) = [edit for edit in declared.plant_sample([2.5]).edits if isinstance(edit, Motor)]
    assert (motor.input, motor.resistance) == ("elbow_torque", 2.5)
    assert quantity.name == "elbow torque resistance"


def test_the_largest_scale_is_that_of_a_machine_that_can_be() -> None:
    """Beyond twice the uncertainty sliding friction would be larger than static friction."""
    coulomb = uncertain("lugre.shaft.coulomb", "40 mN m", "60 mN m")
    limits = deviation_below("1 prad")
    declared = campaign(part(coulomb, **MACHINE, requirement=limits))
    assert declared.family.largest_scale > 2.0 >= declared.largest_scale
    assert declared.largest_scale == pytest.approx(2.0, rel=2e-3)
    assert radius(declared, "lqr").largest == declared.largest_scale


# Loops.


@cache
def looped() -> Campaign:
    """A servo with uncertain numbers of its loop."""
    numbers = [
        uncertain("computing.delay", "0 ms", "4 ms"),
        uncertain("sensor.rotor angle.noise", "0 mrad", "0.3 mrad"),
        uncertain("estimator.rotor speed.bandwidth", "50 rad/s", "200 rad/s"),
        uncertain("actuator.current.lag", "0 ms", "3 ms"),
    ]
    return campaign(part(*numbers, **LOOP, requirement=deviation_below("3 mrad")))


def test_numbers_of_a_loop_have_names_and_units() -> None:
    assert {number.name: number.unit for number in looped().family.quantities} == {
        "computing delay": "s",
        "rotor angle noise": "rad",
        "rotor speed bandwidth": "rad/s",
        "current lag": "s",
    }


def test_delays_of_a_loop_are_whole_timesteps() -> None:
    loop: Any = looped().plant_sample([2.4e-3, 1e-4, 80.0, 2e-3]).loop
    assert loop.computing.delay == pytest.approx(2e-3)
    assert loop.sensors[0].noise == 1e-4
    assert loop.estimators[0].bandwidth == 80.0
    assert loop.actuators[0].lag == 2e-3


@pytest.mark.parametrize(
    ("values", "words"),
    [
        # 2.6 ms on a grid of 1 ms.
        (
            [2.6e-3, 2e-4, 80.0, 2.4e-3],
            "computing delay 0.003 s, rotor angle noise 0.01146 °, rotor speed bandwidth 80 rad/s, "
            "current lag 0.0024 s",
        ),
        # A delay that is run as the nominal one is the nominal one.
        ([1.4e-3, 1e-4, 100.0, 1e-3], "the nominal one"),
    ],
)
def test_numbers_of_a_loop_are_shown_as_they_are_run(values: list[float], words: str) -> None:
    assert looped().words(np.array(values)) == words


def map_of(declared: Campaign, first: Quantity, x: list[float], second: Quantity) -> PassMap:
    """A map of two plants over two numbers, the second of which is 80 and 90."""
    columns = {first.name: x, second.name: [80.0, 90.0], "relative": [0.1, -0.1]}
    arrays = {name: np.array(values) for name, values in columns.items()}
    folder: Any = SimpleNamespace(columns=lambda *_: dict.fromkeys(declared.laws, arrays))
    return pass_map_of(declared, folder, (first, second))


def test_a_map_shows_delays_as_they_are_run() -> None:
    delay, _, bandwidth, _ = looped().family.quantities
    pass_map = map_of(looped(), delay, [0.4e-3, 2.6e-3], bandwidth)
    assert pass_map.titles == ("computing delay [s]", "rotor speed bandwidth [rad/s]")
    np.testing.assert_array_equal(pass_map.runs["lqr"][:2], [[0.0, 3e-3], [80.0, 90.0]])


def test_a_factor_has_no_unit_on_a_map() -> None:
    scale, load = campaign(plain(*BOTH)).family.quantities
    titles = map_of(looped(), scale, [1.0, 2.0], load).titles
    assert titles == ("rotor mass scale", "load amplitude")

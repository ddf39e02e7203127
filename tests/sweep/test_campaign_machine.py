"""A machine in a campaign: its parts' numbers drawn, and machines that cannot be refused."""

from __future__ import annotations

from typing import Any

import pytest
from campaign_cases import PLANT, campaign, kept

from grosmc_mj.errors import GrosmcError
from grosmc_mj.machine import Motor
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.radius import radius
from grosmc_mj.sweep.replay import replay
from grosmc_mj.sweep.store import Folder

MACHINE = """
[[transmission]]
joint = "shaft"
inertia = "0.01 kg m^2"
stiffness = "500 N m/rad"
damping = "0.2 N m s/rad"
backlash = "1 mrad"
[[lugre]]
joint = "shaft"
coulomb = "0.05 N m"
static = "0.07 N m"
stiffness = "27 N m/rad"
damping = "0.24 N m s/rad"
[[stop]]
joint = "shaft"
low = "-1 rad"
high = "1 rad"
restitution = 0.3
[[motor]]
input = "current"
constant = "7.68 mN m/A"
resistance = "2.6 ohm"
ratio = 10
[[swinging_load]]
body = "rotor"
mass = "0.1 kg"
length = "20 cm"
at = ["10 cm", "0 m", "0 m"]
[[wall]]
body = "rotor"
radius = "1 cm"
point = ["0 m", "0 m", "-1 m"]
[[controller]]
law = "lqr"
[[controller]]
name = "stiff"
law = "lqr"
Q = [4, 1]
[[requirement]]
deviation_below = "10 mrad"
"""


def uncertain(kind: str, of: str, number: str, ends: str, more: str = "") -> str:
    return f'[[uncertain]]\n{kind} = "{of}"\n{number} = {ends}\n{more}\n'


UNCERTAIN = (
    uncertain("transmission", "shaft", "backlash", '["0 deg", "0.2 deg"]')
    + uncertain("lugre", "shaft", "coulomb", '["30 mN m", "70 mN m"]')
    + uncertain("motor", "current", "resistance", '["2 ohm", "3 ohm"]')
    + uncertain("swinging_load", "rotor", "mass", '["50 g", "150 g"]')
    + uncertain("stop", "shaft", "restitution", "[0.1, 0.5]")
)


def text(drawn: str = UNCERTAIN, machine: str = MACHINE, system: str = "servo") -> str:
    plant = PLANT.format(system=system, duration=0.05, start="{}")
    return plant + 'timestep = "0.25 ms"\n' + machine + drawn


def asked() -> Campaign:
    return campaign(text(), runs=16, shard=8)


def test_nominal_values_and_units_are_the_files() -> None:
    quantities = {each.name: (each.nominal, each.unit) for each in asked().family.quantities}
    assert quantities == {
        "shaft backlash": (pytest.approx(1e-3), "rad"),
        "shaft coulomb": (pytest.approx(0.05), "N m"),
        "current resistance": (pytest.approx(2.6), "ohm"),
        "rotor mass": (pytest.approx(0.1), "kg"),
        "shaft restitution": (0.3, ""),
    }
    assert all(each.of_plant for each in asked().family.quantities)
    slide = MACHINE[MACHINE.index("[[controller]]") :].replace("mrad", "deg")
    slide += '[[lugre]]\njoint = "slider"\ncoulomb = "3 N"\n'
    drawn = uncertain("lugre", "slider", "stribeck", '["1 cm/s", "2 cm/s"]', 'nominal = "15 mm/s"')
    (quantity,) = campaign(text(drawn, slide, "cart_pendulum")).family.quantities
    assert (quantity.nominal, quantity.unit) == (pytest.approx(0.015), "m/s")
    assert quantity.distribution.support == pytest.approx((0.01, 0.02))


def test_drawn_values_reach_the_compiled_model() -> None:
    values = [2e-3, 0.06, 2.2, 0.12, 0.5]
    found: Any = asked().plant_sample(values).plant(asked().plant)
    nominal: Any = asked().plant
    model, other = found.model, nominal.model
    assert model.tendon_lengthspring[0] == pytest.approx([-1e-3, 1e-3])
    assert other.tendon_lengthspring[0] == pytest.approx([-5e-4, 5e-4])
    assert model.body("rotor swing").mass[0] == 0.12
    # K^2/R of what brakes, whatever the unit of voltage.
    brakes = [
        each.actuator("current").gainprm[1] ** 2 / each.actuator("current").gainprm[0]
        for each in (model, other)
    ]
    assert brakes[0] / brakes[1] == pytest.approx(2.6 / 2.2, rel=1e-9)
    # The contact's damping falls with what comes back; its stiffness is the duration's.
    differ = model.jnt_solref[0] != other.jnt_solref[0]
    assert differ.tolist() == [False, True]
    (coulomb,) = (part.coulomb for part in found.parts if hasattr(part, "coulomb"))
    assert coulomb == 0.06
    # What is not drawn is the file's.
    assert model.body("rotor").mass[0] == other.body("rotor").mass[0]
    assert model.jnt_range[0].tolist() == [-1.0, 1.0]


def test_an_input_is_uncertain_by_the_name_that_files_call_it() -> None:
    motor = '[[motor]]\ninput = "elbow torque"\nconstant = "0.1 N m/A"\nresistance = "2 ohm"\n'
    motor += '[[controller]]\nlaw = "lqr"\n[[requirement]]\nstays_within = "1 m"\n'
    drawn = uncertain("motor", "elbow torque", "resistance", '["1 ohm", "3 ohm"]')
    found = campaign(text(drawn, motor, "two_link_arm"))
    (quantity,) = found.family.quantities
    assert (quantity.name, quantity.nominal) == ("elbow torque resistance", 2.0)
    assert found.plant_sample([1.5]).case.edits == (Motor("elbow_torque", 0.1, 1.5),)


REFUSED = [
    (("stop", "shaft", "restitution", "[0.1, 1.0]"), "can occur, but must be from 0 to below 1:"),
    (("motor", "current", "efficiency", "[0.5, 1.1]"), "can occur, but must be from 1e-15 to 1:"),
    (("motor", "current", "resistance", '["0 ohm", "1 ohm"]'), "= 0 can occur, but must be from"),
    (
        ("transmission", "shaft", "stiffness", '["-1 N m/rad", "9 N m/rad"]'),
        "stiffness = -1 can occur, but must be from 1e-15",
    ),
    (
        ("transmission", "shaft", "backlash", '["-1 mrad", "1 mrad"]'),
        "backlash = -0.001 can occur, but must be from 0 to",
    ),
    (
        (
            "lugre", "shaft", "coulomb",
            '{ distribution = "normal", mean = "0.05 N m", deviation = "0.01 N m" }',
        ),
        "coulomb = -inf can occur, but must be from 1e-15 to 1e+15 N m or N: cut the distribution "
        "off with least",
    ),
    (("transmission", "shaft", "stiffness", '["1 N/m", "9 N m/rad"]'), "converted to N m/rad"),
    (("lugre", "shaft", "backlash", '["0 rad", "1 rad"]'), "a lugre has no backlash; valid: coul"),
    (("lugre", "shfat", "coulomb", '["1 N m", "2 N m"]'), "unknown joint 'shfat': did you mean"),
    (("motor", "currant", "ratio", "[1, 2]"), "unknown input 'currant': did you mean 'current'"),
    (("wall", "roter", "restitution", "[0.1, 0.2]"), "the file has no [[wall]] of 'roter'"),
    (("sliding_load", "rotor", "mass", '["1 g", "2 g"]'), "the file has no [[sliding_load]] of"),
    (("motor", "current", "voltage", '["9 V", "24 V"]'), "voltage is not limited: write"),
    # Together with what the file has besides.
    (
        ("lugre", "shaft", "static", '["20 mN m", "90 mN m"]'),
        "uncertain: shaft static 0.02 N m can occur, where there is no such machine",
    ),
    (("lugre", "shaft", "coulomb", '["20 mN m", "90 mN m"]'), "at least coulomb = 0.09, or 0"),
    (("stop", "shaft", "low", '["-1 rad", "2 rad"]'), "low = 2 must be below high = 1"),
    # A stop would throw out what starts beyond it.
    (("stop", "shaft", "low", '["-1 rad", "0.5 rad"]'), "beyond its stops at 0.5 and 1 rad"),
    (("start", "rotor angle", "value", '["-2 rad", "0 rad"]'), "beyond its stops at -1 and 1 rad"),
    (("motor", "current", "heat_capacity", '["1 J/K", "2 J/K"]'), "heating needs both"),
    (
        ("transmission", "shaft", "stiffness", '["100 N m/rad", "5 MN m/rad"]'),
        "makes unstable: take at most",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("drawn", "said"), REFUSED, ids=[said for _, said in REFUSED])
def test_what_no_machine_has_is_refused_in_one_line_before_anything_is_run(
    drawn: tuple[str, str, str, str], said: str
) -> None:
    with pytest.raises(GrosmcError) as told:
        campaign(text(uncertain(*drawn)))
    assert said in str(told.value)
    assert "\n" not in str(told.value)
    assert "small" in str(told.value).partition(": ")[0]


def test_two_parts_of_one_body_are_not_one() -> None:
    load = '[[swinging_load]]\nbody = "rotor"\nmass = "0.2 kg"\nlength = "30 cm"\n'
    drawn = uncertain("swinging_load", "rotor", "mass", '["50 g", "150 g"]')
    with pytest.raises(GrosmcError, match=r"the file has 2 \[\[swinging_load\]\] of 'rotor'"):
        campaign(text(load + drawn))


def test_one_number_is_uncertain_once() -> None:
    drawn = uncertain("lugre", "shaft", "coulomb", '["30 mN m", "70 mN m"]')
    with pytest.raises(GrosmcError, match="two are uncertain 'lugre shaft coulomb'"):
        campaign(text(drawn + drawn.replace("coulomb", 'name = "again"\ncoulomb')))
    # Of two parts with a number of the same name it is not twice.
    both = uncertain("lugre", "shaft", "damping", '["0 N m s/rad", "1 N m s/rad"]')
    both += uncertain("transmission", "shaft", "damping", '["0 N m s/rad", "1 N m s/rad"]')
    with pytest.raises(GrosmcError, match="two are called 'shaft damping'"):
        campaign(text(both))
    named = both.replace('transmission = "shaft"', 'transmission = "shaft"\nname = "of the gear"')
    assert campaign(text(named)).family.names == ["shaft damping", "of the gear"]


@pytest.mark.slow
def test_the_radius_is_looked_for_among_machines_that_can_be() -> None:
    """Twice as far from 50 mN m, friction that slides would be more than what is static."""
    found = campaign(text(uncertain("lugre", "shaft", "coulomb", '["40 mN m", "60 mN m"]')))
    assert found.largest_scale == pytest.approx(2.0, rel=2e-3)
    assert found.largest_scale <= 2.0
    assert found.family.largest_scale > 2.0
    assert radius(found, "lqr").largest == found.largest_scale


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """Sixteen servos in two parts."""
    return kept(asked(), tmp_path_factory.mktemp("machines"))


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["native", "python"])
def test_runs_of_a_machine_are_repeated_bit_for_bit(folder: Folder, engine: Any) -> None:
    for number in ("0", "11"):
        for law in ("lqr", "stiff"):
            found = replay(asked(), folder, number, law, engine)
            assert found.differences == []

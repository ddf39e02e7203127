"""Units that depend on a state, an input or a joint of a system."""

from __future__ import annotations

from dataclasses import replace

import pytest

from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import OwnerUnit, Range
from grosmc_mj.theory.plants import CART_PENDULUM, SERVO, TWO_LINK_ARM, Signal, System
from grosmc_mj.theory.plants import owner_units as units


def driven(system: System, *units: str) -> System:
    """The system with inputs of these units."""
    inputs = [Signal(f"drive {i}", f"u{i}", unit) for i, unit in enumerate(units, 1)]
    return replace(system, inputs=tuple(inputs))


@pytest.mark.parametrize(
    ("unit", "system", "of", "text"),
    [
        (units.STATE, SERVO, "rotor angle", "rad"),
        (units.STATE_RATE, SERVO, "rotor angle", "rad/s"),
        (units.STATE_RATE, SERVO, "rotor speed", "rad/s^2"),
        (units.STATE, CART_PENDULUM, "cart speed", "m/s"),
        (units.INPUT, SERVO, "current", "A"),
        (units.INPUT_RATE, TWO_LINK_ARM, "elbow torque", "N m/s"),
        (units.FIRST_INPUT, SERVO, "rotor angle", "A"),
        (units.STIFFNESS, CART_PENDULUM, "slider", "N/m"),
        (units.STIFFNESS, CART_PENDULUM, "hinge", "N m/rad"),
        (units.GEAR, SERVO, "current", "N m/A"),
        # Force of a joint for a force of the input.
        (units.GEAR, CART_PENDULUM, "force", "1"),
        # Of an input whose unit is a quotient or a product.
        (units.GEAR, driven(SERVO, "rad/s"), "drive 1", "N m/(rad/s)"),
        (units.GEAR, driven(SERVO, "V s"), "drive 1", "N m/(V s)"),
        (units.GEAR, driven(SERVO, "1"), "drive 1", "N m"),
        # The actuator's name in the model.
        (units.INPUT, TWO_LINK_ARM, "elbow_torque", "N m"),
        (units.INPUT, driven(TWO_LINK_ARM, "V", "A"), "elbow_torque", "A"),
    ],
)
def test_the_unit_of_a_number_is_that_of_its_owner(
    unit: OwnerUnit, system: System, of: str, text: str
) -> None:
    assert Range(unit=unit).unit_in(system, of) == text


@pytest.mark.parametrize(
    ("unit", "of", "words"),
    [
        (units.STATE, "rotor angel", "unknown state 'rotor angel': did you mean 'rotor angle'?"),
        (units.INPUT_RATE, "voltage", "unknown input 'voltage'"),
        (units.FORCE, "hinge", "unknown joint 'hinge': .*shaft"),
    ],
)
def test_an_owner_that_the_system_does_not_have_is_refused(
    unit: OwnerUnit, of: str, words: str
) -> None:
    with pytest.raises(ArgumentError, match=words):
        unit.in_system(SERVO, of)


def test_a_unit_of_no_owner_needs_no_system() -> None:
    assert Range(unit="s").unit_in(None, "") == "s"


def test_bounds_are_told_without_a_unit_that_depends_on_the_owner() -> None:
    assert Range(0, 5, unit=units.STATE).wanted == "from 0 to 5"
    assert Range(0, 5, unit="s").wanted == "from 0 to 5 s"

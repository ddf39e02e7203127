"""Tables of a case file that are read as a checked dataclass: its fields are the keys."""

from __future__ import annotations

from typing import Annotated, Any

import pytest

from grosmc_mj.experiments.file.part_tables import Form, PartKind, read
from grosmc_mj.experiments.file.parts import unit_of
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import Flag, KeyName, Name, Numbers, Range, checked
from grosmc_mj.theory.plants import CART_PENDULUM, SERVO
from grosmc_mj.theory.plants.owner_units import STATE_RATE


@checked()
class Tachometer:
    """Sensor of a rate, which the package does not have.

    Attributes:
        of: Name of the state.
        ripple: Amplitude of its ripple.
        place: Its place [m], (3,).
        teeth: Number of its teeth.
        shielded: Whether it has no hum.
    """

    of: Name
    ripple: Annotated[float, Range(0, unit=STATE_RATE)]
    place: Annotated[tuple[float, float, float], Numbers(3, "m"), KeyName("at")] = (0.0, 0.0, 0.0)
    teeth: Annotated[int, Range(1, whole=True)] = 8
    shielded: Flag = False


TACHOMETER = PartKind("tachometer", (Form(Tachometer, "of"),), assumes=True)
GIVEN = {"of": "rotor speed", "ripple": "2 deg/s^2"}


def test_a_new_kind_of_part_is_a_class_and_its_registration() -> None:
    table = TACHOMETER.table({**GIVEN, "ripple": "3 rad/s^2", "at": ["1 cm", "0 m", "0 m"]})
    assert read(table, SERVO) == Tachometer("rotor speed", 3.0, (0.01, 0.0, 0.0))


def test_a_table_is_kept_as_it_is_written() -> None:
    written = {**GIVEN, "teeth": 12, "assumed": ["ripple"]}
    table = TACHOMETER.table(written)
    assert table.document() == written
    assert (table.of, table.numbers, table.assumed) == (("rotor speed",), ["ripple"], ("ripple",))


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({**GIVEN, "riple": 1}, "unknown key 'riple': did you mean 'ripple'?"),
        (
            {"of": "rotor speed"},
            "ripple is missing.*; required: of, ripple; further keys: at, teeth",
        ),
        ({"ripple": "1 rad/s^2"}, "of is missing"),
        ({**GIVEN, "of": 3}, "of = 3 must be a text in quotes"),
        ({**GIVEN, "of": ["a", "b"]}, r"of = \['a', 'b'\] must be a text in quotes"),
        ({**GIVEN, "assumed": ["teeth"]}, "assumed: unknown number 'teeth'"),
        ({**GIVEN, "assumed": "ripple"}, "assumed = 'ripple' must be a list"),
        ({**GIVEN, "place": ["0 m"] * 3}, "unknown key 'place'"),
    ],
)
def test_wrong_keys_are_refused_before_the_system_is_known(
    table: dict[str, Any], words: str
) -> None:
    with pytest.raises(ArgumentError, match=words):
        TACHOMETER.table(table)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ripple": "3 rad/s"}, r'ripple: "3 rad/s" cannot be converted to rad/s\^2'),
        ({"ripple": "-1 rad/s^2"}, "ripple = -1 must be finite and not negative"),
        ({"of": "rotor sped"}, "^unknown state 'rotor sped': did you mean 'rotor speed'?"),
        ({"at": ["0 m", "0 m"]}, "at: .* must be a list of 3 numbers"),
        ({"at": ["0 m", "0 m", 1]}, 'at: 1 has no unit: write "1 m"'),
        ({"teeth": 1.5}, "teeth = 1.5 must be a whole number 1 or more"),
        ({"shielded": 1}, "shielded = 1 must be True or False"),
    ],
)
def test_wrong_values_are_refused_with_their_key(changes: dict[str, Any], words: str) -> None:
    table = TACHOMETER.table({**GIVEN, **changes})
    with pytest.raises(ArgumentError, match=words):
        read(table, SERVO)


def test_all_wrong_keys_of_a_table_are_told_at_once() -> None:
    with pytest.raises(ArgumentError, match="2 mistakes") as refusal:
        TACHOMETER.table({**GIVEN, "riple": 1, "theeth": 2})
    assert "did you mean 'teeth'" in str(refusal.value)


def test_a_number_of_a_joint_has_the_unit_of_its_joint() -> None:
    assert unit_of("transmission", "slider", "stiffness", CART_PENDULUM) == "N/m"
    assert unit_of("transmission", "hinge", "stiffness", CART_PENDULUM) == "N m/rad"

"""Units as text: one parser for all spellings, one printer."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import constants

from grosmc_mj.experiments.requirements.temporal_text import read_formula
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.units import Unit, number_in, rate_unit

# Spellings of one unit.
SPELLINGS = [
    ("m/s^2", "m/s²"),
    ("m/s^2", "m/s**2"),
    ("m/s^2", "m s^-2"),
    ("m/s^2", "m·s⁻²"),
    ("m/s^2", "m/s/s"),
    ("m/s^2", "m/(s s)"),
    ("V s/rad", "V/(rad/s)"),
    ("V s/rad", "V / (rad / s)"),
    ("N m/rad", "N*m/rad"),
    ("kg m^2", "kg·m²"),
    ("m^2/s^2", "(m/s)^2"),
    ("1/s", "s⁻¹"),
    ("widgets/s^2", "widgets/s²"),
]


@pytest.mark.parametrize(("unit", "other"), SPELLINGS)
def test_spellings_of_a_unit_are_one_unit(unit, other) -> None:
    assert Unit.of(other) == Unit.of(unit)
    assert number_in(f"3 {other}", unit) == 3.0
    assert number_in(f"3 {unit}", other) == 3.0


@pytest.mark.parametrize("unit", ["m/s^2", "V/(rad/s)", "kg m²", "1/s", "A s", "widgets s/rad^3"])
def test_a_printed_unit_is_read_as_itself(unit) -> None:
    assert Unit.of(str(Unit.of(unit))) == Unit.of(unit)


@pytest.mark.parametrize(
    ("value", "unit", "number"),
    [
        ("5 mV/(deg/s)", "V s/rad", 5e-3 * 180 / math.pi),
        ("2 cm/s²", "m/s^2", 0.02),
        ("1 lbf/(ft/s)", "N s/m", 4.4482216152605 / 0.3048),
        ("3 kΩ", "V/A", 3e3),
        ("60 rpm", "rad/s", 2 * math.pi),
        ("2 kHz", "rad/s", 4e3 * math.pi),
        ("2 millimetres", "m", 2e-3),
        ("3 hours", "s", 10800.0),
        ("7.5 °/s", "rad/s", 7.5 * math.pi / 180),
        ("50 %/s", "1/s", 0.5),
        ("2 µNm", "N m", 2e-6),
        # A constant of a motor, from its voltage; an angle has no dimension.
        ("0.05 V s/rad", "N m/A", 0.05),
        ("10 N m", "N m/rad", 10.0),
    ],
)
def test_a_bracket_and_a_power_are_converted(value, unit, number) -> None:
    assert number_in(value, unit) == pytest.approx(number, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "unit", "value"),
    [
        ("deg", "rad", constants.degree),
        ("arcmin", "rad", constants.arcmin),
        ("arcsec", "rad", constants.arcsec),
        ("min", "s", constants.minute),
        ("h", "s", constants.hour),
        ("day", "s", constants.day),
        ("inch", "m", constants.inch),
        ("ft", "m", constants.foot),
        ("lb", "kg", constants.pound),
        ("oz", "kg", constants.oz),
        ("lbf", "N", constants.lbf),
        ("kgf", "N", constants.kgf),
        ("psi", "Pa", constants.psi),
        ("bar", "Pa", constants.bar),
        ("l", "m^3", constants.liter),
    ],
)
def test_a_unit_has_its_value_in_the_tables_of_scipy(name, unit, value) -> None:
    assert number_in(f"1 {name}", unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("unit", "definition"),
    [
        ("N", "kg m/s^2"),
        ("Pa", "N/m^2"),
        ("J", "N m"),
        ("W", "J/s"),
        ("V", "W/A"),
        ("C", "A s"),
        ("ohm", "V/A"),
        ("F", "C/V"),
        ("H", "V s/A"),
        ("Wb", "V s"),
        ("T", "Wb/m^2"),
    ],
)
def test_a_derived_unit_is_that_of_the_si(unit, definition) -> None:
    assert number_in(f"3 {unit}", definition) == 3.0


@pytest.mark.parametrize(
    ("prefix", "value"),
    [
        ("p", constants.pico),
        ("n", constants.nano),
        ("u", constants.micro),
        ("m", constants.milli),
        ("c", constants.centi),
        ("d", constants.deci),
        ("da", constants.deka),
        ("h", constants.hecto),
        ("k", constants.kilo),
        ("M", constants.mega),
        ("G", constants.giga),
        ("T", constants.tera),
    ],
)
def test_a_prefix_has_its_value_in_the_tables_of_scipy(prefix, value) -> None:
    assert number_in(f"2 {prefix}N", "N") == pytest.approx(2 * value, rel=1e-15)


@pytest.mark.parametrize(
    "written",
    ["m/", "m)", "(m", "m//s", "m^12", "m^^2", "m^9^9", "(m^9)^9", "()", "/s", "m_s", "m" * 41],
)
def test_a_text_that_is_no_unit_is_refused(written) -> None:
    with pytest.raises(ArgumentError, match="is no unit"):
        number_in(f"1 {written}", "m")


@pytest.mark.parametrize(
    ("value", "unit", "reason"),
    [
        ("1 m", "s", "cannot be converted to s"),
        ("1 N", "N m", "cannot be converted to N m"),
        ("1 m", "widgets", "cannot be converted to widgets"),
        ("1 furlongs", "m", "'furlongs' is no unit"),
        ("1 gadgets", "widgets", "'gadgets' is no unit"),
    ],
)
def test_a_unit_of_another_kind_is_told_from_one_that_is_not_known(value, unit, reason) -> None:
    with pytest.raises(ArgumentError, match=reason):
        number_in(value, unit)


def test_a_decimal_comma_is_told_as_a_point() -> None:
    with pytest.raises(ArgumentError, match=r'decimal comma: write "-1\.5 m"'):
        number_in("-1,5 m", "m")


def test_a_formula_knows_an_angle_from_a_number() -> None:
    """A file's number of radians may be one without a unit, a comparison may not."""
    with pytest.raises(ArgumentError, match="compares rad and a number without a unit"):
        read_formula("a < 2", {"t": "s", "a": "rad"})


@pytest.mark.parametrize(
    ("unit", "rate"), [("m", "m/s"), ("m/s", "m/s^2"), ("m/s^2", "m/s^3"), ("A", "A/s")]
)
def test_the_rate_of_a_unit_has_one_more_second(unit, rate) -> None:
    assert rate_unit(unit) == rate


@pytest.mark.parametrize("text", ["a < 2 m/s²", "a < 2 m/s^2", "a < 2 m/(s s)", "a < 200 cm/s²"])
@pytest.mark.parametrize("unit", ["m/s^2", "m/s²"])
def test_a_formula_reads_any_spelling(text, unit) -> None:
    read = read_formula(text, {"t": "s", "a": unit})
    margins = read.formula.margins({"t": np.zeros(1), "a": np.ones(1)}, 1.0)
    assert margins == pytest.approx([1.0], rel=1e-15)
    assert read.unit == unit


def test_a_number_times_a_signal_over_a_bracket_has_its_unit() -> None:
    units = {"t": "s", "u": "V", "speed": "rad/s"}
    read = read_formula("u < 2 V/(rad/s) * speed", units)
    signals = {"t": np.zeros(1), "u": np.ones(1), "speed": np.full(1, 3.0)}
    assert read.formula.margins(signals, 1.0) == pytest.approx([5.0], rel=1e-15)
    assert read.unit == "V"


@pytest.mark.parametrize(("text", "number"), [("20 %", "0.2"), ("0.5 %", "0.005"), ("7", "7")])
def test_a_text_in_place_of_a_number_is_told_the_number(text: str, number: str) -> None:
    with pytest.raises(ArgumentError, match=rf"write {number}(, a share| without quotes)$"):
        number_in(text, "1")

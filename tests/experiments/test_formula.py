"""Formulas of case files: valid ones are sympy's, the others are refused within a second."""

import contextlib
import math
import time
from typing import Any

import numba
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st
from sympy.parsing.sympy_parser import parse_expr

from grosmc_mj.experiments.file.formula import FUNCTIONS, formula
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.theory.control.references import TIME, reference

NAMES = {name: getattr(sp, name) for name in FUNCTIONS} | {"t": TIME, "pi": sp.pi}


@pytest.mark.parametrize(
    "text",
    [
        "2*t+7",
        "-(0.25*t-12.125)",
        "(2e-3*t+pi)*99",
        "1.5E2*t + .5",
        "7.-t",
        "3/(2*t+1)-t/4",
        "(t+1)**2*(t+2)**3",
        "(t**0.5)**(1/3)",
        "(2*t+3)**(-1)",
        "-t**2",
        "2**-t",
        "t-2-3",
        "t/2/5",
        "sin(2*t+pi)*cos(-t)",
        "tanh(atan(t)/3)",
        "exp(-t)",
        "sqrt(t+1)",
        "+t",
        "t**2**2",
    ],
)
def test_a_valid_formula_is_as_sympy_reads_it(text: str):
    assert formula(text, TIME) == parse_expr(text, dict(NAMES))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_of_a_number_is_its_value(name: str):
    value = float(formula(f"{name}(0.37)", TIME))
    # sympy rounds once from the exact value, libm's functions to an ulp or two.
    assert value == getattr(math, name)(0.37)
    assert value == pytest.approx(float(NAMES[name](sp.Float(0.37, 30))), rel=1e-15, abs=0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2 - 1.5 * step(t - 10)", {9.999: 2.0, 10.0: 0.5, 11.0: 0.5}),
        ("step(2 - t)", {1.0: 1.0, 2.0: 1.0, 2.001: 0.0}),
        ("step(t - 1 s) * step(3 s - t)", {0.5: 0.0, 1.0: 1.0, 3.0: 1.0, 3.5: 0.0}),
        ("step(-1) + 2 * step(0)", {0.0: 2.0}),
        ("tanh(step(t - 0.3))", {0.1: 0.0, 3 * 0.1: math.tanh(1.0)}),
    ],
)
def test_a_step_is_one_from_the_zero_of_its_argument_on(
    text: str, expected: dict[float, float]
) -> None:
    """Its derivatives are zero."""
    y_r: Any = reference([formula(text, TIME, steps=True)], (2,))
    values = {t: y_r(t, None) for t in expected}
    assert values == {t: pytest.approx((y, 0.0, 0.0), abs=0) for t, y in expected.items()}


def test_a_compiled_step_has_the_same_bits() -> None:
    y_r: Any = reference([formula("2 - tanh(1.5 * step(t - 0.3))", TIME, steps=True)], (2,))
    compiled: Any = numba.njit(y_r)
    instants = (0.2, 0.3, 3 * 0.1, 0.4)
    assert [compiled(t, 0.0) for t in instants] == [y_r(t, 0.0) for t in instants]


def test_a_ramp_that_begins_has_the_rate_of_a_ramp() -> None:
    y_r: Any = reference([formula("step(t - 1) * 3 * (t - 1)", TIME, steps=True)], (2,))
    assert y_r(0.5, None) == (0, 0, 0)
    assert y_r(3.0, None) == (6, 3, 0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 / step(t - 1)", "has no finite real value"),
        ("step(t, 1)", "gives step other than one argument"),
    ],
)
def test_a_step_without_a_value_is_refused(text: str, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        formula(text, TIME, steps=True)


def test_outputs_have_no_steps() -> None:
    """Their derivatives along the motion are what feedback linearization goes by."""
    with pytest.raises(ArgumentError, match="has 'step' at character 1, may have"):
        formula("step(t - 1)", TIME)


@pytest.mark.parametrize("name", ["sinh", "tanh", "log"])
def test_the_deepest_formula_is_a_reference_soon(name: str):
    began = time.process_time()
    with contextlib.suppress(ArgumentError):
        reference([formula(f"{name}(" * 5 + "t+2" + ")" * 5, TIME)], (4,))
    assert time.process_time() - began < 5


@given(st.text(max_size=30) | st.text("t()[]{}.,*+-/^!'\"\\019e sincopgx_:=\n\0", max_size=40))
def test_any_other_text_is_refused_or_an_expression_in_t(text: str):
    with contextlib.suppress(ArgumentError):
        assert formula(text, TIME).free_symbols <= {TIME}


HOSTILE = {
    "9**9**9": "has exponents of more than 64 together",
    "((9!)!)!": "has '!)!)!' at character 4, may have t, pi, sin, cos",
    "(" * 50_000 + "t" + ")" * 50_000: "has 100001 characters, a formula may have 1000",
    "(" * 450 + "t" + ")" * 450: "is nested more than 40 deep",
    "+".join("t" * 400): "is too large: it may have 200 parts, nested 40 deep",
    "tanh(" * 17 + "t" + ")" * 17: "has more than 5 functions inside each other",
    "t**" * 30 + "t": "has more than 5 functions inside each other",
    "exp(t+10**50)": "has an exponent with a number beyond 10000",
    "sin(t**64)**2": "has exponents of more than 64 together",
    "exp(9*log(3*t))": "has a log within exp: write a power",
    "exp(exp(exp(exp(2.0))))": "has no finite real value",
    "1e999 deg * t": "must be finite",
    "1e999": "has a number beyond 1e+100",
    "1/(t-t)": "has no finite real value",
    "sqrt(-1)*t": "has no finite real value",
    "0**t": "has a power of 0, which must be positive",
    "t^2": ": a power is written **",
    "5 cm + 20mm*t": "has '20mm' at character 8, may have t",
    "'t'": 'has "\'" at character 1, may have t',
    "sin(t, t)": "gives sin other than one argument",
    "(lambda: t)()": "has 'lambda' at character 2, may have t",
    "1j": "has '1j' at character 1, may have t",
    "t.real": "has '.' at character 2, may have t, pi, sin, cos",
    "open(t)": "has 'open' at character 1, may have t, pi, sin, cos",
    "\x1b[31mt": "at character 1, may have t",
    "": "has nothing where a quantity must be",
}


@pytest.mark.parametrize(("text", "words"), HOSTILE.items(), ids=lambda text: text[:20])
def test_no_formula_is_refused_in_one_line_at_once(text: str, words: str):
    began = time.process_time()
    with pytest.raises(ArgumentError) as error:
        formula(text, TIME)
    message = str(error.value)
    assert words in message
    assert message.isprintable()
    assert len(message) < 300
    assert time.process_time() - began < 1


def test_a_reference_whose_derivatives_explode_is_refused_at_once():
    began = time.process_time()
    product = "*".join(f"sin({i}*t)" for i in range(1, 25))
    with pytest.raises(ArgumentError, match=r"derivative 1 .*500 are allowed"):
        reference([formula(product, TIME)], (4,))
    assert time.process_time() - began < 5


@pytest.mark.parametrize("template", ['sin("{}")', "sin({})", '"{}"'])
def test_text_never_reaches_sympy(tmp_path, template: str):
    """Octal escapes inside a string passed the filter of words that there once was."""
    canary = tmp_path / "canary"
    code = f"__import__('pathlib').Path({str(canary)!r}).touch()"
    octal = "".join(f"\\{ord(letter):o}" for letter in code)
    text = template.format(octal)
    with pytest.raises(ArgumentError):
        formula(text, TIME)
    with pytest.raises(ArgumentError, match="must be a list of expressions of sympy"):
        reference([text])
    assert not canary.exists()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("10 deg * sin(2 Hz * t)", math.pi / 18 * math.sin(4 * math.pi * 0.3)),
        ("1.5 mrad", 0.0015),
        ("exp(-t/(0.5 s))", math.exp(-0.6)),
    ],
)
def test_numbers_may_have_units(text: str, value: float) -> None:
    assert float(formula(text, TIME).subs(TIME, 0.3)) == pytest.approx(value, rel=1e-12)


def test_a_root_halves_the_power_below_it() -> None:
    value = float(formula("sqrt(t**64)**2", TIME).subs(TIME, 0.3))
    assert value == pytest.approx(0.3**64, rel=1e-12)

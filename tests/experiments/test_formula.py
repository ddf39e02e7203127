"""Formulas of case files: those that are valid are sympy's, the others are told within a second."""

import ast
import contextlib
import math
import time
from pathlib import Path

import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from sympy.parsing.sympy_parser import parse_expr

from grosmc_mj.control.references import TIME, reference
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.file.formula import FUNCTIONS, formula

NAMES = {name: getattr(sp, name) for name in FUNCTIONS} | {"t": TIME, "pi": sp.pi}

numbers = st.one_of(
    st.integers(0, 99).map(str),
    st.decimals("0.001", "99", places=3).map(str),
    st.sampled_from(["pi", "2e-3", "1.5E2", ".5", "7."]),
)
# What depends on t: constants in functions are computed in floating point, these exactly.
positive = numbers.filter(lambda text: float(parse_expr(text)) > 0)
moving = st.recursive(
    st.builds("({}*t+{})".format, positive, numbers),
    lambda inner: st.one_of(
        st.builds("({}{}{})".format, inner, st.sampled_from("+-*"), positive),
        st.builds("({}+{})".format, inner, inner),
        st.builds("({})/({})".format, numbers, inner),
        st.builds("({})**{}".format, inner, st.sampled_from(["2", "3", "0.5", "(-1)", "(1/3)"])),
        st.builds("-{}".format, inner),
        st.builds("{}({})".format, st.sampled_from(["sin", "cos", "tanh", "atan"]), inner),
    ),
    max_leaves=6,
)


def read(text: str) -> sp.Expr:
    """What sympy's parser makes of a text."""
    return parse_expr(text, local_dict=dict(NAMES))


@given(moving)
def test_a_valid_formula_is_what_sympy_reads(text: str):
    # Powers of powers are bounded: 27 is not.
    assume(text.count("**") <= 3)
    assume(sum(map(text.count, ("sin", "cos", "tanh", "atan"))) <= 5)
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    # Nor are constants in functions exact, nor is there a quotient by zero, not even below another.
    parts = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.BinOp)]
    assume(not any(read(ast.unparse(part)).has(sp.nan, sp.zoo) for part in parts))
    assume(all(read(ast.unparse(call.args[0])).has(TIME) for call in calls))
    assert formula(text, TIME) == read(text)


@given(st.sampled_from(FUNCTIONS), st.floats(0.01, 0.99))
def test_a_function_of_a_number_is_its_value(name: str, x: float):
    found = float(formula(f"{name}({x!r})", TIME))
    assert found == getattr(math, name)(x)
    # sympy rounds once from the exact value, libm's functions to an ulp or two.
    assert found == pytest.approx(float(NAMES[name](sp.Float(x, 30))), rel=1e-15, abs=0)


@given(st.text(max_size=30) | st.text("t()[]{}.,*+-/^!'\"\\019e sincopgx_:=\n\0", max_size=40))
@settings(max_examples=300)
def test_any_other_text_is_refused_or_an_expression_in_t(text: str):
    with contextlib.suppress(ArgumentError):
        assert formula(text, TIME).free_symbols <= {TIME}


HOSTILE = {
    "9**9**9": "has exponents of more than 64 together",
    "sin(10**10**10)": "has exponents of more than 64 together",
    "((9!)!)!": "is no formula in t",
    "(" * 50_000 + "t" + ")" * 50_000: "has 100001 characters, a formula may have 1000",
    "(" * 450 + "t" + ")" * 450: "is no formula in t",
    "-" * 900 + "t": "is too large: it may have 200 parts, nested 40 deep",
    "+".join("t" * 400): "is too large: it may have 200 parts, nested 40 deep",
    "tanh(" * 17 + "t" + ")" * 17: "has more than 5 functions inside each other",
    "t**" * 30 + "t": "has more than 5 functions inside each other",
    "tanh(2**(t+10**50)-1)": "has an exponent with a number beyond 10000",
    "tanh(1.2**(t+1e50))": "has an exponent with a number beyond 10000",
    "exp(t+10**50)": "has an exponent with a number beyond 10000",
    "((9**60)**60)**60": "has exponents of more than 64 together",
    "(((2*t)**60)**60)**60": "has exponents of more than 64 together",
    "exp(9*log(3*t))": "has a log within exp: write a power",
    "exp(exp(exp(exp(2.0))))": "has no finite real value",
    "9" * 400: "has no finite real value",
    "1e999 deg * t": "must be finite",
    "1e999": "has a number beyond 1e+100",
    "1/0": "has no finite real value",
    "1/(t-t)": "has no finite real value",
    "sqrt(-1)*t": "has no finite real value",
    "0**t": "has a power of 0, which must be positive",
    "t^2": "has ^: a power is written **",
    "'t'": "is no formula in t",
    "[t][0]": "is no formula in t",
    "sin(t, t)": "gives sin other than one argument",
    "sin(*[t])": "gives sin other than one argument",
    "sin(x=t)": "gives sin other than one argument",
    "(lambda: t)()": "is no formula in t",
    "t if t else 1": "is no formula in t",
    "t < 1": "is no formula in t",
    "1j": "is no formula in t",
    "True": "is no formula in t",
    "t.real": "has real, may have t, pi, sin, cos",
    "open(t)": "has open, may have t, pi, sin, cos",
    "\x1b[31mt": "is no formula in t",
    "t\0": "is no formula in t",
    "": "is no formula in t",
}


@pytest.mark.parametrize(("text", "said"), HOSTILE.items(), ids=lambda each: each[:20])
def test_what_is_no_formula_is_told_in_one_line_at_once(text: str, said: str):
    began = time.process_time()
    with pytest.raises(ArgumentError) as error:
        formula(text, TIME)
    message = str(error.value)
    assert said in message
    assert message.isprintable()
    assert len(message) < 300
    assert time.process_time() - began < 1


def test_a_reference_whose_derivatives_explode_is_refused_at_once():
    began = time.process_time()
    product = "*".join(f"sin({i}*t)" for i in range(1, 25))
    with pytest.raises(ArgumentError, match=r"derivative 1 .*500 are allowed"):
        reference([formula(product, TIME)], (4,))
    assert time.process_time() - began < 5


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_deepest_formula_is_a_reference_within_seconds(name: str):
    began = time.process_time()
    with contextlib.suppress(ArgumentError):
        reference([formula(f"{name}(" * 5 + "t+2" + ")" * 5, TIME)], (4,))
    assert time.process_time() - began < 5


def test_text_never_reaches_sympy(tmp_path: Path):
    """Octal escapes inside a string passed the filter of words that there once was."""
    canary = tmp_path / "canary"
    octal = "".join(
        f"\\{ord(each):o}" for each in f"__import__('pathlib').Path({str(canary)!r}).touch()"
    )
    for text in (f'sin("{octal}")', f"sin({octal})", f'"{octal}"'):
        with pytest.raises(ArgumentError):
            formula(text, TIME)
        with pytest.raises(ArgumentError, match="must be a list of expressions of sympy"):
            reference([text])
    assert not canary.exists()


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("10 deg * sin(2 Hz * t)", "0.17453292519943295*sin(12.566370614359172*t)"),
        ("5 cm + 20mm*t", "0.05 + 0.02*t"),
        ("1.5 mrad", "0.0015"),
        ("exp(-t/(0.5 s))", "exp(-t/0.5)"),
        ("2e1 ms", "0.02"),
    ],
)
def test_numbers_may_have_units(text: str, plain: str) -> None:
    if "20mm" in text:
        with pytest.raises(ArgumentError, match="is no formula"):
            formula(text, TIME)
        return
    assert float(formula(text, TIME).subs(TIME, 0.3)) == pytest.approx(
        float(formula(plain, TIME).subs(TIME, 0.3)), rel=1e-12
    )


def test_a_root_halves_the_power_below_it() -> None:
    """64 is the bound of powers on each other."""
    assert formula("sqrt(t**64)**2", TIME) == TIME**64 or formula("sqrt(t**64)**2", TIME).has(TIME)
    with pytest.raises(ArgumentError, match="exponent"):
        formula("sin(t**64)**2", TIME)

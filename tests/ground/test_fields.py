"""Checked fields: the message of every mistake has the field's name, value and bound."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from typing import Annotated, Any, ClassVar

import numpy as np
import pytest

from grosmc_mj.ground.arguments import require_known, whole
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, ModelError
from grosmc_mj.ground.fields import (
    Check,
    Is,
    Known,
    Name,
    Positive,
    Range,
    Reals,
    checked,
    checked_call,
    range_of,
)


@checked(ModelError)
class Spring:
    joint: Name
    stiffness: Positive
    play: Annotated[float, Range(0, 1, unit="rad", below=True)] = 0.0
    limit: Annotated[float, Range(0, above=True, infinite=True)] = math.inf
    turns: Annotated[int, Range(1, 9, whole=True)] = 1
    mass: Annotated[float, Range(2)] = 2.0
    kind: ClassVar[str] = "spring"

    def __post_init__(self) -> None:
        if self.play > self.stiffness:
            raise ModelError("too soft")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"joint": ""}, "spring of '': joint = '' must be a name"),
        ({"stiffness": 0}, "stiffness = 0 must be finite and positive"),
        ({"stiffness": True}, "stiffness = True must be"),
        ({"stiffness": math.inf}, "stiffness = inf must be finite"),
        ({"play": 1.0}, "play = 1 must be from 0 to below 1 rad"),
        ({"limit": -math.inf}, "limit = -inf must be positive"),
        ({"turns": 1.0}, "turns = 1 must be a whole number from 1 to 9"),
        ({"mass": 1}, "mass = 1 must be finite and 2 or more"),
        ({"stiffness": -1, "play": -1}, "stiffness = -1 must be .*; play = -1 must be"),
        ({"stiffness": 0.1, "play": 0.5}, "^too soft$"),
        ({"stifness": 1.0}, "there is no argument stifness; valid: joint, stiffness"),
    ],
)
def test_the_message_states_the_mistake(arguments: dict[str, Any], message: str) -> None:
    valid = {"joint": "hinge", "stiffness": 1.0}
    with pytest.raises(ModelError, match=message):
        Spring(**{**valid, **arguments})


@pytest.mark.parametrize("stiffness", [3, np.int64(3), np.float32(3.0), np.array(3.0)])
def test_a_number_of_any_kind_becomes_a_float(stiffness: Any) -> None:
    spring = Spring("hinge", stiffness)
    assert type(spring.stiffness) is float
    assert spring.stiffness == 3.0


def test_a_checked_class_is_a_dataclass() -> None:
    spring = Spring("hinge", 3.0, 0.5)
    assert pickle.loads(pickle.dumps(spring)) == spring
    assert replace(spring, turns=1) == spring


def test_the_range_of_a_field_is_read_back() -> None:
    assert range_of(Spring, "play") == Range(0, 1, unit="rad", below=True)


def test_a_name_has_no_range() -> None:
    assert range_of(Spring, "joint") is None


@pytest.mark.parametrize(
    ("unit", "number", "usual"),
    [
        ("ohm", 1e6, ""),
        ("ohm", 2e6, "1e-06 to 1e+06"),
        ("m", -3.0, ""),
        ("m", -2e4, "1e-09 to 10000"),
        ("s", 0.0, ""),
        ("s", math.inf, ""),
        ("widgets", 1e-13, "1e-12 to 1e+12"),
    ],
)
def test_a_number_far_from_those_of_its_unit_is_told_the_usual_ones(
    unit: str, number: float, usual: str
) -> None:
    assert Range(unit=unit).unusual(number) == usual


@checked_call
def weigh(gain: Positive, matrix: Annotated[Array, Reals((None, 2))]) -> Array:
    return gain * matrix


def test_a_function_converts_its_arguments() -> None:
    assert weigh(2, [[1, 2]]).tolist() == [[2.0, 4.0]]


def test_a_function_checks_its_arguments() -> None:
    words = r"gain = -1 must be .*; matrix = \[\[1, 2, 3\]\] must be"
    with pytest.raises(ArgumentError, match=words):
        weigh(-1, [[1, 2, 3]])


@pytest.mark.parametrize("value", [True, 1.0, "1", None, np.array([1])])
def test_a_value_that_only_looks_like_a_whole_number_is_none(value: Any) -> None:
    assert whole(value) is None


@pytest.mark.parametrize("value", [1, np.int32(1), np.array(1)])
def test_a_whole_number_of_any_kind_becomes_an_int(value: Any) -> None:
    assert type(whole(value)) is int
    assert whole(value) == 1


@pytest.mark.parametrize(
    ("name", "words"),
    [("lqq", "unknown law 'lqq': did you mean 'lqr'"), (3, "unknown law 3")],
)
def test_an_unknown_name_is_refused_with_the_nearest(name: Any, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        require_known("law", name, ["lqr", "grosmc"])


@pytest.mark.parametrize(
    ("check", "value", "words"),
    [
        (Is(str, "a text"), 3, "size = 3 must be a text"),
        (Range(0, unit="s"), -1.0, "size = -1 must be finite and not negative"),
        (Known("size", ["small"]), "smal", "unknown size 'smal'"),
    ],
)
def test_what_is_no_field_is_refused_as_a_field_is(check: Check, value: Any, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        check.require("size", value)

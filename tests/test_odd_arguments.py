"""Every public name with arguments of every wrong kind: one line of ours, never another error."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import control as python_control
import numpy as np
import pytest
import sympy as sp
from mjcf import DELAY, ONE

import grosmc_mj as gm
from grosmc_mj import control
from grosmc_mj.plants import SERVO

# Values of other kinds, shapes and sizes.
ODD: dict[str, Any] = {
    "None": None, "text": "1", "empty": "", "nan": math.nan, "infinite": math.inf,
    "negative": -1.0, "tiny": 1e-300, "huge": 1e300, "integer beyond floats": 10**400,
    "complex": 1j, "true": True, "ragged": [[0.0], [0.0, 1.0]], "texts": ["0", "0"],
    "nan array": np.array([math.nan, 0.0]),
    "masked": np.ma.masked_array([0.0, 0.0], [True, False]),
    "dates": np.array(["2020-01-01", "2020-01-02"], "datetime64[D]"),
    "booleans": np.array([True, False]), "empty list": [], "matrix": np.eye(3),
    "set": {1.0, 2.0}, "dict": {"a": 1.0}, "generator": (x for x in ()),
    "function": lambda *_: 0.0, "class": float, "object": object(), "path": Path("model.xml"),
}  # fmt: skip
# Some arguments take these; nobody takes a NaN, a date, a set, a mask, rows of different lengths.
TAKEN = {"negative", "tiny", "huge", "infinite", "integer beyond floats", "text", "empty", "None",
         "empty list", "dict", "function", "class", "true"}  # fmt: skip


@cache
def servo() -> gm.MujocoPlant:
    return gm.MujocoPlant.load("servo")


@cache
def analytic() -> gm.AnalyticPlant:
    return servo().analytic()


@cache
def lqr_law() -> gm.Controller:
    return gm.chapter_controller("lqr", analytic())


@cache
def error() -> control.ErrorCoordinates:
    return control.ErrorCoordinates(SERVO, control.setpoints(2))


@cache
def numbers() -> Any:
    return analytic().parameters


@dataclass(frozen=True)
class Gain:
    k: float = 1.0


def law(t: float, x: Any, memory: Any, p: Any) -> float:
    return -p.k * x[0]


def run_of(plant: Any, controller: Any) -> gm.Trajectory:
    return gm.simulate(plant, controller, [0.0, 0.0], duration=0.002)


def then(make: Callable[..., Any], use: Callable[[Any], Any]) -> Callable[..., Any]:
    """A function or class whose mistakes may show only where its value is used."""

    def used(**arguments: Any) -> Any:
        return use(make(**arguments))

    used.__signature__ = inspect.signature(make)
    return used


X, RATE = sp.symbols("x b")
WEIGHTS = {"Q": np.eye(2), "R": 1.0}
RUN = {"plant": servo, "controller": lqr_law, "x0": [0.0, 0.0], "duration": 0.002}
CHAIN = {"states": {"x": "m"}, "inputs": {"u": "N"}, "f": [-RATE * X], "g": [1], "h": [X]}
SIGNALS = {"states": SERVO.states, "inputs": SERVO.inputs, "equations": SERVO.equations}
# Public functions and classes with what they need; all that they take is tried.
CALLS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "simulate": (gm.simulate, RUN),
    "custom_controller": (
        gm.custom_controller, {"name": "k", "law": law, "like": lqr_law, "numbers": {"k": 1.0}},
    ),
    "from_control": (
        gm.from_control,
        {"sys": python_control.tf([1], [1, 1]), "period": 1e-3, "like": lqr_law, "name": "lag"},
    ),
    "state_task": (then(control.state_task, control.linear_lqr), {"plant": servo, **WEIGHTS}),
    "affine_plant": (gm.affine_plant, {"name": "chain", **CHAIN, "parameters": {"b": 1.0}}),
    "Robot.from_mjcf": (gm.Robot.from_mjcf, {"model": ONE.format("", DELAY)}),
    "Task": (
        gm.Task,
        {"plant": analytic, "error": error, "reference": control.Setpoint(1.0), **WEIGHTS},
    ),
    "ErrorCoordinates": (
        then(control.ErrorCoordinates, lambda made: made.linearization),
        {"system": SERVO, "reference": control.setpoints(2)},
    ),
    "Controller": (
        then(gm.Controller, lambda made: run_of(servo(), made)),
        {"name": "k", "law": law, "parameters": Gain()},
    ),
    "AnalyticPlant": (
        then(gm.AnalyticPlant, lambda plant: run_of(plant, lqr_law())),
        {"system": SERVO, "parameters": numbers, "variant": "corrected"},
    ),
    "Setpoint": (
        then(
            control.Setpoint,
            lambda value: gm.Task(analytic(), error(), value, np.eye(2), 1.0),
        ),
        {"value": 1.0},
    ),
}  # fmt: skip


def ending(call: Callable[..., Any], arguments: dict[str, Any], odd: str) -> str:
    """How a call with an odd argument ended, if neither refused in one line nor taken rightly."""
    try:
        call(**arguments)
    except gm.GrosmcError as error:
        return "" if str(error) and "\n" not in str(error) else "no line"
    except Exception as error:
        return type(error).__name__
    return "" if odd in TAKEN else "is taken"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", CALLS)
def test_an_odd_argument_is_refused_in_one_line_or_taken(name: str) -> None:
    call, needed = CALLS[name]
    arguments = {
        # Made when a test needs them.
        key: value() if hasattr(value, "cache_info") else value
        for key, value in needed.items()
    }
    call(**arguments)
    wrong = [
        (argument, odd, end)
        for argument in inspect.signature(call).parameters
        for odd, value in ODD.items()
        if (end := ending(call, {**arguments, argument: value}, odd))
    ]
    assert wrong == []

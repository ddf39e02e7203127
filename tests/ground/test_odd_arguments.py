"""Every public name refuses a wrong argument in one line, and never fails in another way."""

from __future__ import annotations

import inspect
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import control as python_control
import numpy as np
import pytest
import sympy as sp

import grosmc_mj as gm
from grosmc_mj import control, films, loop, machine, physics, plants, simulation
from grosmc_mj.mechanics.physics.files import load_spec
from grosmc_mj.theory.plants import SERVO

# Values of other kinds, shapes and sizes.
ODD: dict[str, Any] = {
    "None": None,
    "text": "1",
    "empty": "",
    "nan": math.nan,
    "infinite": math.inf,
    "negative": -1.0,
    "tiny": 1e-300,
    "huge": 1e300,
    "integer beyond floats": 10**400,
    "complex": 1j,
    "true": True,
    "ragged": [[0.0], [0.0, 1.0]],
    "texts": ["0", "0"],
    "nan array": np.array([math.nan, 0.0]),
    "masked": np.ma.masked_array([0.0, 0.0], [True, False]),
    "dates": np.array(["2020-01-01", "2020-01-02"], "datetime64[D]"),
    "booleans": np.array([True, False]),
    "empty list": [],
    "matrix": np.eye(3),
    "set": {1.0, 2.0},
    "dict": {"a": 1.0},
    "generator": (x for x in ()),
    "function": lambda *_: 0.0,
    "class": float,
    "object": object(),
    "path": Path("model.xml"),
}
# Values that some arguments allow; none allows a NaN, a date, a set, a mask or ragged rows.
ALLOWED = {
    "negative",
    "tiny",
    "huge",
    "infinite",
    "integer beyond floats",
    "text",
    "empty",
    "None",
    "empty list",
    "dict",
    "function",
    "class",
    "true",
}


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
def task() -> gm.Task:
    return gm.Task(analytic(), error(), control.Setpoint(1.0), np.eye(2), 1.0)


@cache
def state_task() -> gm.Task:
    return control.state_task(servo(), np.eye(2), 1.0)


@cache
def recorded() -> gm.Trajectory:
    return gm.simulate(servo(), lqr_law(), [0.0, 0.0], duration=0.002)


@cache
def saved() -> Path:
    return recorded().save(Path(tempfile.mkdtemp()) / "run.parquet")


@cache
def takes() -> tuple[films.Take, ...]:
    return (films.Take("lqr", "black", recorded()),)


@cache
def numbers() -> Any:
    return analytic().parameters


@cache
def model() -> Any:
    return servo().model


@dataclass(frozen=True)
class Gain:
    k: float = 1.0


def law(t: float, x: Any, memory: Any, p: Any) -> float:
    return -p.k * x[0]


def run_of(plant: Any, controller: Any) -> gm.Trajectory:
    return gm.simulate(plant, controller, [0.0, 0.0], duration=0.002)


def then(make: Callable[..., Any], use: Callable[[Any], Any]) -> Callable[..., Any]:
    """Return a function that makes a value and uses it, where a mistake may show."""

    def make_and_use(**arguments: Any) -> Any:
        return use(make(**arguments))

    make_and_use.__signature__ = inspect.signature(make)
    return make_and_use


def part(kind: Callable[..., Any], **needed: Any) -> tuple[Callable[..., Any], dict[str, Any]]:
    """Return the call of a part of a machine, which adds it to the servo."""
    return then(kind, lambda made: servo().changed(made).model), needed


# Functions whose values are arguments; they are called when a test needs them.
LAZY = (
    servo,
    analytic,
    lqr_law,
    error,
    task,
    state_task,
    recorded,
    saved,
    takes,
    numbers,
    model,
)
X, RATE = sp.symbols("x b")
WEIGHTS = {"Q": np.eye(2), "R": 1.0}
RUN = {"plant": servo, "controller": lqr_law, "x0": [0.0, 0.0], "duration": 0.002}
CHAIN = {"states": {"x": "m"}, "inputs": {"u": "N"}, "f": [-RATE * X], "g": [1], "h": [X]}
SIGNALS = {"states": SERVO.states, "inputs": SERVO.inputs, "equations": SERVO.symbolic_equations}
UNCERTAINTY: dict[str, Any] = {
    "scales": {"J": (1.0, 3.0)},
    "wrench": (0, 0, 0, 0, 1.0, 0),
    "region": (1.2, 1.2),
    "reaching_rate": 0.2,
}
ROBOT = """
<mujoco model="one"><worldbody><body name="link"><joint name="hinge" axis="0 1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.5" mass="1"/></body></worldbody>
<actuator><motor name="motor" joint="hinge"/></actuator></mujoco>
"""
# Public functions and classes with their necessary arguments; all arguments are tried.
CALLS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "simulate": (gm.simulate, RUN),
    "simulate of equations": (
        gm.simulate,
        {**RUN, "plant": analytic, "timestep": 1e-3, "engine": "python"},
    ),
    "custom_controller": (
        gm.custom_controller,
        {"name": "k", "law": law, "like": lqr_law, "numbers": {"k": 1.0}},
    ),
    "from_control": (
        gm.from_control,
        {"sys": python_control.tf([1], [1, 1]), "period": 1e-3, "like": lqr_law, "name": "lag"},
    ),
    "load_trajectory": (gm.load_trajectory, {"path": saved}),
    "state_task": (then(control.state_task, control.linear_lqr), {"plant": servo, **WEIGHTS}),
    "StateUncertainty": (
        then(
            control.StateUncertainty,
            lambda declared: control.state_grosmc(state_task(), declared),
        ),
        {"body": "rotor", "mass": 2.0, "force": 0.1, "reaching_rate": 0.2, "push": 1.0},
    ),
    "state_grosmc": (
        control.state_grosmc,
        {"task": state_task, "uncertainty": control.StateUncertainty()},
    ),
    "linear_lqr": (control.linear_lqr, {"task": state_task}),
    "realized": (control.realized, {"controller": lqr_law, "realization": gm.Realization()}),
    "chapter_controller": (gm.chapter_controller, {"name": "lqr", "nominal": analytic}),
    "lqr": (gm.lqr, {"A": [[0.0, 1.0], [0.0, 0.0]], "B": [[0.0], [1.0]], **WEIGHTS}),
    "linearize": (physics.linearize, {"plant": servo}),
    "Computing": (loop.Computing, {"delay": 1e-3}),
    "Sensor": (loop.Sensor, {"of": "rotor angle", "resolution": 1e-3}),
    "Estimator": (loop.Estimator, {"of": "rotor speed", "law": "eso", "bandwidth": 50.0}),
    "Actuator": (loop.Actuator, {"of": "current"}),
    "Loop": (loop.Loop, {}),
    "apply_loop": (
        loop.apply_loop,
        {
            "loop": loop.Loop(),
            "controller": lqr_law,
            "system": SERVO,
            "control_period": 1e-3,
            "timestep": 1e-3,
        },
    ),
    "load_model": (physics.load_model, {"name": "servo"}),
    "find_switching": (control.find_switching, {"name": "sign"}),
    "setpoints": (lambda degree: control.setpoints(degree), {"degree": 2}),
    "reference": (control.reference, {"outputs": [sp.sin(control.TIME)], "degrees": (2,)}),
    "affine_plant": (gm.affine_plant, {"name": "chain", **CHAIN, "parameters": {"b": 1.0}}),
    "feedback_linearization": (gm.feedback_linearization, {"equations": SERVO.symbolic_equations}),
    "linearized_lqr": (gm.linearized_lqr, {"task": task, "name": "fl-lqr"}),
    "computed_torque_pd": (
        control.computed_torque_pd,
        {"task": task, "frequency": 1.0, "damping": 1.0},
    ),
    "regulating_grosmc": (
        gm.regulating_grosmc,
        {"task": task, "uncertainty": gm.Uncertainty(**UNCERTAINTY)},
    ),
    "tracking_grosmc": (gm.tracking_grosmc, {"task": task, "k": 1.0, "epsilon": 1.0}),
    "judge": (gm.judge, {"target": "servo/nominal"}),
    "run_many": (gm.run_many, {"experiments": [gm.Experiment.load("servo/nominal")]}),
    "Experiment.load": (gm.Experiment.load, {"target": "servo/nominal"}),
    "MujocoPlant.load": (gm.MujocoPlant.load, {"name": "servo"}),
    "MujocoPlant": (gm.MujocoPlant, {"system": SERVO, "spec": load_spec("servo")}),
    "MujocoPlant.edited": (
        lambda edit: servo().changed(edit).model,
        {"edit": gm.BodyEdit("rotor", 2.0)},
    ),
    "Robot.from_mjcf": (gm.Robot.from_mjcf, {"model": ROBOT}),
    "Constant": (simulation.Constant, {}),
    "Pulse": (gm.Pulse, {"start": 0.1, "stop": 0.2}),
    "SineFrom": (simulation.SineFrom, {"frequency": 1.0}),
    "Table": (simulation.Table, {"values": (1.0, 2.0), "hold": 1e-3}),
    "Disturbance": (gm.Disturbance, {"body": "rotor", "wrench": (0, 0, 0, 0, 1, 0)}),
    "InputDisturbance": (gm.InputDisturbance, {"input": "current", "amplitude": 1.0}),
    "OutputDisturbance": (gm.OutputDisturbance, {"state": "rotor angle", "amplitude": 1.0}),
    "RateDisturbance": (gm.RateDisturbance, {"state": "rotor angle", "amplitude": 1.0}),
    "BodyEdit": (gm.BodyEdit, {"body": "rotor"}),
    "AddedMass": (gm.AddedMass, {"body": "rotor", "mass": 2.0, "position": (0, 0, 0)}),
    "JointEdit": (gm.JointEdit, {"joint": "hinge", "damping": 1.0}),
    "Transmission": part(
        machine.Transmission,
        joint="shaft",
        inertia=0.01,
        stiffness=100.0,
        damping=0.01,
        backlash=1e-3,
        friction=0.01,
    ),
    "LuGre": part(
        machine.LuGre, joint="shaft", coulomb=0.1, static=0.2, stiffness=100.0, damping=0.1
    ),
    "DriveFriction": part(
        machine.DriveFriction,
        joint="shaft",
        coulomb=0.1,
        viscous=0.1,
        load_motor=0.1,
        stribeck_force=0.1,
        stribeck_speed=0.1,
    ),
    "Stop": part(machine.Stop, joint="shaft", low=-1.0, high=1.0),
    "Motor": part(
        machine.Motor,
        input="current",
        constant=0.01,
        resistance=2.0,
        inductance=1e-2,
        ratio=70.0,
        voltage=24.0,
        current=4.0,
        thermal_resistance=5.0,
        heat_capacity=2.0,
    ),
    "Wall": part(
        machine.Wall,
        body="rotor",
        radius=0.1,
        at=(0, 0, 0.1),
        point=(0, 0, -1.0),
        normal=(0, 0, 1),
    ),
    "Realization": (gm.Realization, {}),
    "Task": (
        gm.Task,
        {"plant": analytic, "error": error, "reference": control.Setpoint(1.0), **WEIGHTS},
    ),
    "Uncertainty": (gm.Uncertainty, UNCERTAINTY),
    "ErrorCoordinates": (
        then(control.ErrorCoordinates, lambda made: made.linearization),
        {"system": SERVO, "reference": control.setpoints(2)},
    ),
    "Controller": (
        then(gm.Controller, lambda made: run_of(servo(), made)),
        {"name": "k", "law": law, "parameters": Gain()},
    ),
    "System": (
        plants.System,
        {"name": "rotor", "title": "Rotor", **SIGNALS, "bodies": ("rotor",)},
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
    "Format": (films.Format, {}),
    "Take": (films.Take, {"label": "lqr", "colour": "black", "run": recorded}),
    "Film": (films.Film, {"title": "lqr", "model": model, "takes": takes}),
}


# Errors, results, and values that are made by other functions.
NOT_CALLED = {"GrosmcError", "MachinePart", "Status", "TIME", "Trajectory", "AppliedLoop"}
# Classes that are called by a method, or have the same arguments as another one.
CALLED_ELSEWHERE = {"Setpoints", "write_film", "Experiment", "Campaign", "MujocoPlant", "Robot"}


def test_every_public_name_is_called() -> None:
    public: set[str] = set()
    for module in (gm, control, films, loop, machine, physics, simulation):
        public.update(module.__all__)
    modules = {name for name in public if inspect.ismodule(getattr(gm, name, None))}
    assert public - modules - NOT_CALLED - CALLED_ELSEWHERE <= set(CALLS)


def failure(call: Callable[..., Any], arguments: dict[str, Any], *, allowed: bool) -> str:
    """Return in words how a call failed; empty if it was refused in one line, or is allowed."""
    try:
        call(**arguments)
    except gm.GrosmcError as error:
        is_one_line = str(error) and "\n" not in str(error)
        return "" if is_one_line else "no line"
    except Exception as error:
        return type(error).__name__
    return "" if allowed else "is taken"


def evaluated(arguments: dict[str, Any]) -> dict[str, Any]:
    """Return arguments with the values of lazy ones."""
    values = dict(arguments)
    for name, value in arguments.items():
        # By identity: a comparison of arrays has no truth value.
        if any(value is function for function in LAZY):
            values[name] = value()
    return values


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", CALLS)
def test_an_odd_argument_is_refused_in_one_line_or_allowed(name: str) -> None:
    call, necessary = CALLS[name]
    arguments = evaluated(necessary)
    call(**arguments)

    failures = []
    for argument in inspect.signature(call).parameters:
        for odd, value in ODD.items():
            words = failure(call, {**arguments, argument: value}, allowed=odd in ALLOWED)
            if words:
                failures.append((argument, odd, words))
    assert failures == []

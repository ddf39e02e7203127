"""Every public name with arguments of every wrong kind: one line of ours, never another error."""

from __future__ import annotations

import inspect
import math
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
import sympy as sp

import grosmc_mj as gm
from grosmc_mj.physics.files import load_spec
from grosmc_mj.plants import SERVO

# What somebody may give by mistake: other kinds, shapes and sizes.
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


def law(t: float, x: Any, memory: Any, p: Any) -> float:
    return -p.k * x[0]


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
def task() -> gm.Task:
    error = gm.control.ErrorCoordinates(SERVO, gm.control.setpoints(2))
    return gm.Task(analytic(), error, gm.control.Setpoint(1.0), np.eye(2), 1.0)


@cache
def recorded() -> gm.Trajectory:
    return gm.simulate(servo(), lqr_law(), [0.0, 0.0], duration=0.002)


@cache
def state_task() -> gm.Task:
    return gm.control.state_task(servo(), np.eye(2), 1.0)


@cache
def saved() -> Path:
    return recorded().save(Path(tempfile.mkdtemp()) / "run.npz")


def then(make: Callable[..., Any], use: Callable[[Any], Any]) -> Callable[..., Any]:
    """A function or class whose mistakes may show only where its value is used."""

    def used(**arguments: Any) -> Any:
        return use(make(**arguments))

    used.__signature__ = inspect.signature(make)
    return used


def part(kind: Callable[..., Any], **needed: Any) -> tuple[Callable[..., Any], dict[str, Any]]:
    """A part of a machine, and the servo with it."""
    return then(kind, lambda made: servo().edited(made).model), needed


def run_of(plant: Any, law: Any) -> gm.Trajectory:
    return gm.simulate(plant, law, [0.0, 0.0], duration=0.002)


def valid_calls() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Public functions and classes with what they need; all that they take is tried."""
    x, b = sp.symbols("x b")
    run = {"plant": servo(), "controller": lqr_law(), "x0": [0.0, 0.0], "duration": 0.002}
    weights = {"Q": np.eye(2), "R": 1.0}
    chain = {"states": {"x": "m"}, "inputs": {"u": "N"}, "f": [-b * x], "g": [1], "h": [x]}
    signals = {"states": SERVO.states, "inputs": SERVO.inputs, "equations": SERVO.equations}
    uncertainty: dict[str, Any] = {
        "scales": {"J": (1.0, 3.0)}, "wrench": (0, 0, 0, 0, 1.0, 0), "region": (1.2, 1.2),
        "reaching_rate": 0.2,
    }  # fmt: skip
    fields = ("name", "law", "parameters", "memory", "design")
    lqr = {name: getattr(lqr_law(), name) for name in fields}
    control_, machine, loop = gm.control, gm.machine, gm.loop
    weight = {"body": "rotor", "mass": 0.1, "damping": 0.1, "at": (0, 0, 0.1)}
    return {
        "simulate": (gm.simulate, run),
        "simulate of equations": (
            gm.simulate,
            {**run, "plant": analytic(), "timestep": 1e-3, "engine": "python"},
        ),
        "custom_controller": (
            gm.custom_controller,
            {"name": "k", "law": law, "like": lqr_law(), "numbers": {"k": 1.0}},
        ),
        "from_control": (
            gm.from_control,
            {"sys": control.tf([1], [1, 1]), "period": 1e-3, "like": lqr_law(), "name": "lag"},
        ),
        "load_trajectory": (gm.load_trajectory, {"path": saved()}),
        "state_task": (
            then(control_.state_task, control_.linear_lqr),
            {"plant": servo(), **weights},
        ),
        "StateUncertainty": (
            then(
                control_.StateUncertainty,
                lambda declared: control_.state_grosmc(state_task(), declared),
            ),
            {"body": "rotor", "mass": 2.0, "force": 0.1, "reaching_rate": 0.2, "push": 1.0},
        ),
        "state_grosmc": (
            control_.state_grosmc,
            {"task": state_task(), "uncertainty": control_.StateUncertainty()},
        ),
        "linear_lqr": (control_.linear_lqr, {"task": state_task()}),
        "realized": (
            control_.realized,
            {"controller": lqr_law(), "realization": gm.Realization()},
        ),
        "chapter_controller": (gm.chapter_controller, {"name": "lqr", "nominal": analytic()}),
        "lqr": (gm.lqr, {"A": [[0.0, 1.0], [0.0, 0.0]], "B": [[0.0], [1.0]], **weights}),
        "linearize": (gm.physics.linearize, {"plant": servo()}),
        "Computing": (loop.Computing, {"delay": 1e-3}),
        "Sensor": (loop.Sensor, {"of": "rotor angle", "resolution": 1e-3}),
        "Estimator": (loop.Estimator, {"of": "rotor speed", "law": "eso", "bandwidth": 50.0}),
        "Actuator": (loop.Actuator, {"of": "current"}),
        "Loop": (loop.Loop, {}),
        "in_loop": (
            loop.in_loop,
            {"controller": lqr_law(), "loop": loop.Loop(), "system": SERVO}
            | {"control_period": 1e-3, "timestep": 1e-3},
        ),
        "load_model": (gm.physics.load_model, {"name": "servo"}),
        "find_switching": (control_.find_switching, {"name": "sign"}),
        "setpoints": (lambda degree: control_.setpoints(degree), {"degree": 2}),
        "reference": (
            control_.reference,
            {"outputs": [sp.sin(control_.TIME)], "degrees": (2,)},
        ),
        "affine_plant": (gm.affine_plant, {"name": "chain", **chain, "parameters": {"b": 1.0}}),
        "feedback_linearization": (gm.feedback_linearization, {"equations": SERVO.equations}),
        "linearized_lqr": (gm.linearized_lqr, {"task": task(), "name": "fl-lqr"}),
        "computed_torque_pd": (
            control_.computed_torque_pd,
            {"task": task(), "frequency": 1.0, "damping": 1.0},
        ),
        "regulating_grosmc": (
            gm.regulating_grosmc,
            {"task": task(), "uncertainty": gm.Uncertainty(**uncertainty)},
        ),
        "tracking_grosmc": (gm.tracking_grosmc, {"task": task(), "k": 1.0, "epsilon": 1.0}),
        "judge": (gm.judge, {"target": "servo/nominal"}),
        "Experiment.load": (gm.Experiment.load, {"target": "servo/nominal"}),
        "MujocoPlant.load": (gm.MujocoPlant.load, {"name": "servo"}),
        "MujocoPlant": (gm.MujocoPlant, {"system": SERVO, "spec": load_spec("servo")}),
        "MujocoPlant.edited": (
            lambda edit: servo().edited(edit).model,
            {"edit": gm.BodyEdit("rotor", 2.0)},
        ),
        "Robot.from_mjcf": (gm.Robot.from_mjcf, {"model": ROBOT}),
        "Constant": (gm.simulation.Constant, {}),
        "Pulse": (gm.Pulse, {"start": 0.1, "stop": 0.2}),
        "SineFrom": (gm.simulation.SineFrom, {"frequency": 1.0}),
        "Disturbance": (gm.Disturbance, {"body": "rotor", "wrench": (0, 0, 0, 0, 1, 0)}),
        "BodyEdit": (gm.BodyEdit, {"body": "rotor"}),
        "AddedMass": (gm.AddedMass, {"body": "rotor", "mass": 2.0, "position": (0, 0, 0)}),
        "JointEdit": (gm.JointEdit, {"joint": "hinge", "damping": 1.0}),
        "Transmission": part(
            machine.Transmission, joint="shaft", inertia=0.01, stiffness=100.0, damping=0.01,
            backlash=1e-3, friction=0.01,
        ),
        "LuGre": part(
            machine.LuGre, joint="shaft", coulomb=0.1, static=0.2, stiffness=100.0, damping=0.1
        ),
        "Stop": part(machine.Stop, joint="shaft", low=-1.0, high=1.0),
        "Motor": part(
            machine.Motor, input="current", constant=0.01, resistance=2.0, inductance=1e-2,
            ratio=70.0, voltage=24.0, current=4.0, thermal_resistance=5.0, heat_capacity=2.0,
        ),
        "SwingingLoad": part(machine.SwingingLoad, **weight, length=0.2),
        "SlidingLoad": part(machine.SlidingLoad, **weight, stiffness=10.0),
        "Wall": part(
            machine.Wall, body="rotor", radius=0.1, at=(0, 0, 0.1), point=(0, 0, -1.0),
            normal=(0, 0, 1),
        ),
        "Realization": (gm.Realization, {}),
        "Task": (
            gm.Task,
            {"plant": analytic(), "error": task().error, "reference": control_.Setpoint(1.0)}
            | weights,
        ),
        "Uncertainty": (gm.Uncertainty, uncertainty),
        "ErrorCoordinates": (
            then(control_.ErrorCoordinates, lambda error: error.linearization),
            {"system": SERVO, "reference": control_.setpoints(2)},
        ),
        "Controller": (then(gm.Controller, lambda made: run_of(servo(), made)), lqr),
        "System": (
            gm.plants.System,
            {"name": "rotor", "title": "Rotor", **signals, "bodies": ("rotor",)},
        ),
        "AnalyticPlant": (
            then(gm.AnalyticPlant, lambda plant: run_of(plant, lqr_law())),
            {"system": SERVO, "parameters": analytic().parameters, "variant": "corrected"},
        ),
        "Setpoint": (
            then(
                control_.Setpoint,
                lambda value: gm.Task(analytic(), task().error, value, np.eye(2), 1.0),
            ),
            {"value": 1.0},
        ),
        "Format": (gm.films.Format, {}),
        "Take": (gm.films.Take, {"label": "lqr", "colour": "black", "run": recorded()}),
        "Film": (
            gm.films.Film,
            {"title": "lqr", "model": servo().model}
            | {"takes": (gm.films.Take("lqr", "black", recorded()),)},
        ),
    }  # fmt: skip


ROBOT = """
<mujoco model="one"><worldbody><body name="link"><joint name="hinge" axis="0 1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.5" mass="1"/></body></worldbody>
<actuator><motor name="motor" joint="hinge"/></actuator></mujoco>
"""
CALLS = valid_calls()
# What the package gives itself: of a robot, of a law in its loop, of a search for a reference.
INSIDE = {"System: joints", "System: actuators", "Controller: loop"}
INSIDE |= {"ErrorCoordinates: guess", "ErrorCoordinates: unit"}
ODD_CALLS = [
    pytest.param(name, argument, id=f"{name}: {argument}")
    for name, (call, _) in CALLS.items()
    for argument in inspect.signature(call).parameters
    if f"{name}: {argument}" not in INSIDE
]
# Some arguments take these of the odd values; nobody takes a NaN, a date, a set, a mask, rows of
# different lengths, an object.
TAKEN = {"negative", "tiny", "huge", "infinite", "integer beyond floats", "text", "empty"}
TAKEN |= {"None", "empty list", "dict", "function", "class", "true"}


def test_every_public_name_is_called() -> None:
    """Errors, results and what the others are made of are not called by a user."""
    packages = {"control", "environments", "errors", "films", "sweep"}
    packages |= {"loop", "machine", "physics", "plants", "simulation"}
    folders = (gm, gm.control, gm.films, gm.loop, gm.machine, gm.physics, gm.simulation)
    public = {name for folder in folders for name in folder.__all__}
    made = {"GrosmcError", "MachinePart", "Status", "TIME", "Trajectory", "relooped"}
    like = {"Setpoints", "write_film", "Experiment", "Campaign", "MujocoPlant", "Robot"}
    assert public - packages - made - like <= set(CALLS)


@pytest.mark.parametrize("name", CALLS)
def test_the_valid_call_is_valid(name: str) -> None:
    call, valid = CALLS[name]
    call(**valid)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("name", "argument"), ODD_CALLS)
def test_an_odd_argument_is_refused_in_one_line_or_taken(name: str, argument: str) -> None:
    call, valid = CALLS[name]
    for odd, value in ODD.items():
        said = ""
        try:
            call(**{**valid, argument: value})
        except gm.GrosmcError as error:
            said = "no line" if not str(error) or "\n" in str(error) else ""
        except Exception as error:
            said = type(error).__name__
        else:
            said = "" if odd in TAKEN else "is taken"
        if said:
            pytest.fail(f"{argument} = {odd}: {said}")

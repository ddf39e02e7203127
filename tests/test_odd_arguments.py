"""Every public name with arguments of every wrong kind: one line of ours, never another error."""

from __future__ import annotations

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


def uncertainty(**changes: Any) -> gm.Uncertainty:
    given: dict[str, Any] = {
        "scales": {"J": (1.0, 3.0)},
        "wrench": (0.0, 0.0, 0.0, 0.0, 1.0, 0.0),
        "region": (1.2, 1.2),
        "reaching_rate": 0.2,
    }
    return gm.Uncertainty(**{**given, **changes})


@cache
def recorded() -> gm.Trajectory:
    return gm.simulate(servo(), lqr_law(), [0.0, 0.0], duration=0.002)


def take() -> gm.films.Take:
    return gm.films.Take("lqr", "black", recorded())


@cache
def state_task() -> gm.Task:
    return gm.control.state_task(servo(), np.eye(2), 1.0)


def bounded(declared: gm.control.StateUncertainty) -> gm.Controller:
    return gm.control.state_grosmc(state_task(), declared)


@cache
def saved() -> Path:
    folder = Path(tempfile.mkdtemp())
    return recorded().save(folder / "run.npz")


def built(part: Callable[..., Any]) -> Callable[..., Any]:
    """Makes a part of a machine, and the servo with it."""
    return lambda **given: servo().edited(part(**given)).model


def valid_calls() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Public functions and classes, each with arguments that it takes."""
    plain = {"plant": servo(), "controller": lqr_law(), "x0": [0.0, 0.0], "duration": 0.002}
    x, b = sp.symbols("x b")
    chain = {"states": {"x": "m"}, "inputs": {"u": "N"}, "f": [-b * x], "g": [1], "h": [x]}
    signals = {"states": SERVO.states, "inputs": SERVO.inputs, "equations": SERVO.equations}
    weights = {"Q": np.eye(2), "R": 1.0}
    return {
        "simulate": (
            gm.simulate,
            {**plain, "control_period": None, "timestep": None, "disturbances": ()}
            | {"engine": "native", "record": True, "threads": 1},
        ),
        "simulate of equations": (
            gm.simulate,
            {**plain, "plant": analytic(), "timestep": 1e-3, "engine": "python"},
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
            lambda **given: gm.control.linear_lqr(gm.control.state_task(**given)),
            {"plant": servo(), **weights, "reference": None, "model": None},
        ),
        "StateUncertainty": (
            lambda **given: gm.control.state_grosmc(
                state_task(), gm.control.StateUncertainty(**given)
            ),
            {"body": "rotor", "mass": 2.0, "length": 1.0, "force": 0.1, "reaching_rate": 0.2}
            | {"push": 1.0, "scales": {}},
        ),
        "state_grosmc": (
            gm.control.state_grosmc,
            {"task": state_task(), "uncertainty": gm.control.StateUncertainty(), "G": None}
            | {"limit": None},
        ),
        "linear_lqr": (gm.control.linear_lqr, {"task": state_task()}),
        "realized": (
            gm.control.realized,
            {"controller": lqr_law(), "realization": gm.Realization()},
        ),
        "chapter_controller": (
            gm.chapter_controller,
            {"name": "lqr", "nominal": analytic(), "realization": gm.Realization()}
            | {"case": "nominal"},
        ),
        "lqr": (gm.lqr, {"A": [[0.0, 1.0], [0.0, 0.0]], "B": [[0.0], [1.0]], **weights}),
        "linearize": (gm.physics.linearize, {"plant": servo(), "x": None, "u": 0.0}),
        "Computing": (gm.loop.Computing, {"delay": 1e-3, "jitter": 0.0, "missed": 0.1}),
        "Sensor": (
            gm.loop.Sensor,
            {"of": "rotor angle", "resolution": 1e-3, "noise": 1e-3, "bias": 0.0, "drift": 0.0}
            | {"delay": 0.0, "period": 0.0},
        ),
        "Estimator": (
            gm.loop.Estimator,
            {"of": "rotor speed", "law": "eso", "bandwidth": 50.0, "time_constant": None}
            | {"slope": None, "load": None, "settled": True},
        ),
        "Actuator": (
            gm.loop.Actuator,
            {"of": "current", "delay": 0.0, "resolution": 0.0, "limit": 1.0, "rate_limit": 10.0}
            | {"lag": 1e-3, "order": 1, "dead_zone": 0.0},
        ),
        "Loop": (
            gm.loop.Loop,
            {"computing": gm.loop.Computing(), "sensors": (), "estimators": ()}
            | {"actuators": (), "seed": 0},
        ),
        "in_loop": (
            gm.loop.in_loop,
            {"controller": lqr_law(), "loop": gm.loop.Loop(), "system": SERVO}
            | {"control_period": 1e-3, "timestep": 1e-3, "predict": False, "run": 0}
            | {"known": None},
        ),
        "load_model": (gm.physics.load_model, {"name": "servo"}),
        "find_switching": (gm.control.find_switching, {"name": "sign"}),
        "setpoints": (lambda degree: gm.control.setpoints(degree), {"degree": 2}),
        "reference": (
            gm.control.reference,
            {"outputs": [sp.sin(gm.control.TIME)], "degrees": (2,)},
        ),
        "affine_plant": (
            gm.affine_plant,
            {"name": "chain", **chain, "parameters": {"b": 1.0}, "region": True, "where": ""}
            | {"near": None},
        ),
        "feedback_linearization": (
            gm.feedback_linearization,
            {"equations": SERVO.equations, "h": None},
        ),
        "linearized_lqr": (gm.linearized_lqr, {"task": task(), "name": "fl-lqr"}),
        "computed_torque_pd": (
            gm.control.computed_torque_pd,
            {"task": task(), "frequency": 1.0, "damping": 1.0},
        ),
        "regulating_grosmc": (
            gm.regulating_grosmc,
            {"task": task(), "uncertainty": uncertainty(), "G": None},
        ),
        "tracking_grosmc": (
            gm.tracking_grosmc,
            {"task": task(), "k": 1.0, "epsilon": 1.0, "G": None},
        ),
        "judge": (gm.judge, {"target": "servo/nominal"}),
        "Experiment.load": (gm.Experiment.load, {"target": "servo/nominal"}),
        "MujocoPlant.load": (
            gm.MujocoPlant.load,
            {"name": "servo", "edits": (), "timestep": None, "integrator": None},
        ),
        "MujocoPlant": (
            gm.MujocoPlant,
            {"system": SERVO, "spec": load_spec("servo"), "edits": (), "timestep": None},
        ),
        "MujocoPlant.edited": (
            lambda edit: servo().edited(edit).model,
            {"edit": gm.BodyEdit("rotor", 2.0)},
        ),
        "Robot.from_mjcf": (
            gm.Robot.from_mjcf,
            {"model": ROBOT, "joints": None, "actuators": None, "timestep": None}
            | {"integrator": None},
        ),
        "Constant": (gm.simulation.Constant, {}),
        "Pulse": (gm.Pulse, {"start": 0.1, "stop": 0.2}),
        "SineFrom": (gm.simulation.SineFrom, {"frequency": 1.0, "onset": 0.0, "phase": 0.0}),
        "Disturbance": (
            gm.Disturbance,
            {"body": "rotor", "wrench": (0, 0, 0, 0, 1, 0), "profile": gm.simulation.Constant()},
        ),
        "BodyEdit": (gm.BodyEdit, {"body": "rotor", "mass_scale": 2.0, "length_scale": 1.0}),
        "AddedMass": (gm.AddedMass, {"body": "rotor", "mass": 2.0, "position": (0, 0, 0)}),
        "JointEdit": (
            gm.JointEdit,
            {"joint": "hinge", "damping": 1.0, "friction": None, "armature": None},
        ),
        "Transmission": (
            built(gm.machine.Transmission),
            {"joint": "shaft", "inertia": 0.01, "stiffness": 100.0, "damping": 0.01}
            | {"backlash": 1e-3, "friction": 0.01, "added": True},
        ),
        "LuGre": (
            built(gm.machine.LuGre),
            {"joint": "shaft", "coulomb": 0.1, "static": 0.2, "stiffness": 100.0}
            | {"damping": 0.1, "stribeck": 0.05},
        ),
        "Stop": (
            built(gm.machine.Stop),
            {"joint": "shaft", "low": -1.0, "high": 1.0, "restitution": 0.3, "duration": 0.02},
        ),
        "Motor": (
            built(gm.machine.Motor),
            {"input": "current", "constant": 0.01, "resistance": 2.0, "inductance": 1e-2}
            | {"ratio": 70.0, "efficiency": 0.6, "voltage": 24.0, "current": 4.0}
            | {"inertia": 1e-6, "cogging": 1e-3, "cogging_periods": 12.0, "added": True}
            | {"thermal_resistance": 5.0, "heat_capacity": 2.0, "bandwidth": 0.0},
        ),
        "SwingingLoad": (
            built(gm.machine.SwingingLoad),
            {"body": "rotor", "mass": 0.1, "length": 0.2, "damping": 0.01, "at": (0, 0, 0.1)},
        ),
        "SlidingLoad": (
            built(gm.machine.SlidingLoad),
            {"body": "rotor", "mass": 0.1, "stiffness": 10.0, "damping": 0.1, "at": (0, 0, 0.1)},
        ),
        "Wall": (
            built(gm.machine.Wall),
            {"body": "rotor", "radius": 0.1, "at": (0, 0, 0.1), "point": (0, 0, -1.0)}
            | {"normal": (0, 0, 1), "restitution": 0.2, "duration": 0.02},
        ),
        "Realization": (
            gm.Realization,
            {"switching": gm.control.find_switching("sign"), "control_period": None},
        ),
        "Task": (
            gm.Task,
            {
                "plant": analytic(),
                "error": task().error,
                "reference": gm.control.Setpoint(1.0),
                **weights,
            },
        ),
        "Uncertainty": (
            uncertainty,
            {"scales": {"J": (1.0, 3.0)}, "wrench": (0, 0, 0, 0, 1.0, 0), "region": (1.2, 1.2)}
            | {"reaching_rate": 0.2},
        ),
        "ErrorCoordinates": (
            lambda **given: gm.control.ErrorCoordinates(**given).linearization,
            {"system": SERVO, "reference": gm.control.setpoints(2), "sign": 1, "outputs": None},
        ),
        "Controller": (
            lambda **given: gm.simulate(servo(), gm.Controller(**given), [0, 0], duration=0.002),
            {"name": "lqr", "law": lqr_law().law, "parameters": lqr_law().parameters}
            | {"memory": lqr_law().memory, "design": lqr_law().design},
        ),
        "System": (
            gm.plants.System,
            {"name": "rotor", "title": "Rotor", **signals, "bodies": ("rotor",)},
        ),
        "AnalyticPlant": (
            lambda **given: gm.simulate(
                gm.AnalyticPlant(**given), lqr_law(), [0, 0], duration=0.002
            ),
            {"system": SERVO, "parameters": analytic().parameters, "variant": "corrected"},
        ),
        "Setpoint": (
            lambda value: gm.Task(
                analytic(), task().error, gm.control.Setpoint(value), np.eye(2), 1.0
            ),
            {"value": 1.0},
        ),
        "Format": (
            gm.films.Format,
            {"width": 640, "height": 360, "fps": 30, "speed": 1.0, "camera": None, "start": 0.0},
        ),
        "Take": (
            gm.films.Take,
            {"label": "lqr", "colour": "black", "run": recorded(), "ghost": None},
        ),
        "Film": (
            gm.films.Film,
            {
                "title": "lqr",
                "model": servo().model,
                "takes": (take(),),
            }
            | {"format": gm.films.Format()},
        ),
    }


ROBOT = """
<mujoco model="one"><worldbody><body name="link"><joint name="hinge" axis="0 1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.5" mass="1"/></body></worldbody>
<actuator><motor name="motor" joint="hinge"/></actuator></mujoco>
"""
CALLS = valid_calls()
ODD_CALLS = [
    pytest.param(name, argument, id=f"{name}: {argument}")
    for name, (_, valid) in CALLS.items()
    for argument in valid
]


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
        try:
            call(**{**valid, argument: value})
            continue
        except gm.GrosmcError as error:
            one_line = len(str(error)) > 0 and "\n" not in str(error)
            said = "" if one_line else "more than one line"
        except Exception as error:
            said = type(error).__name__
        if said:
            pytest.fail(f"{argument} = {odd}: {said}")


# What an argument takes of the odd values, where it takes any.
NUMBERS = {"negative", "tiny", "huge", "infinite", "integer beyond floats"}
TEXTS = {"text", "empty"}
OPTIONAL = {"None", "empty list", "dict", "function", "class", "true"}


def test_what_is_no_number_no_text_and_no_option_is_never_taken() -> None:
    """Nothing comes of a NaN, a date, a set, a mask, rows of different lengths, an object."""
    taken = {
        odd
        for call, valid in CALLS.values()
        for argument in valid
        for odd in ODD.keys() - NUMBERS - TEXTS - OPTIONAL
        if accepts(call, {**valid, argument: ODD[odd]})
    }
    assert not taken


def accepts(call: Callable[..., Any], arguments: dict[str, Any]) -> bool:
    try:
        call(**arguments)
    except gm.GrosmcError:
        return False
    return True

"""A log of a machine that is known is predicted as well as its model says."""

from __future__ import annotations

import math
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

import grosmc_mj as gm
from grosmc_mj.experiments import cases
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.identify.case_file import write_case
from grosmc_mj.identify.compare import comparison_result, prediction_errors
from grosmc_mj.identify.fit import Fit, fit
from grosmc_mj.identify.model import LogModel
from grosmc_mj.identify.parameters import parameters_of
from grosmc_mj.identify.pushes import unexplained_moments
from grosmc_mj.identify.quality import quality
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.mechanics.machine import LuGre
from grosmc_mj.mechanics.physics.edits import AddedMass
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import Constant, Disturbance, Pulse, SineFrom
from grosmc_mj.simulation.loop import Loop, Sensor
from grosmc_mj.studies.sweep.family import family_of

SERVO = MujocoPlant.load("servo")
TIMESTEP = 1e-3
# The shaft turns about -y.
TORQUE = (0.0, 0.0, 0.0, 0.0, -0.1, 0.0)


def exact_log(
    model: LogModel, sampling: float = 5e-3, seconds: float = 4.0, angle: str = "rotor angle"
) -> Log:
    """A log of an angle without noise, the input held from sample to sample."""
    time = np.arange(round(seconds / sampling)) * sampling
    u = 0.3 * np.sin(5 * time) + 0.2 * np.sin(13 * time)
    blank = Log("exact", time, u[:, None], {angle: 0 * time}, [slice(0, len(time))])
    # One prediction of the whole length.
    predictor = Predictor.of(blank, seconds, TIMESTEP)
    ((states,),) = predictor.states([model], [np.array([[0.5, -0.4]])])
    angles = np.interp(time, np.arange(len(states)) * TIMESTEP, states[:, 0])
    return replace(blank, states={angle: angles})


@pytest.mark.parametrize("target", ["servo/nominal", "servo/case1"])
def test_an_error_is_named_by_its_case_and_its_log(target: str) -> None:
    log = exact_log(LogModel(SERVO))
    rows, notes = prediction_errors({"physics": LogModel(SERVO)}, log, 1.0, TIMESTEP)
    compared = comparison_result(rows, notes, log, Experiment.load(target), 1.0)
    assert compared.values[0].name == f"{target} exact: physics rotor angle at 0.1 s"


def errors_of(model: LogModel, log: Log) -> Array:
    """Prediction errors of a machine after 0.1 to 1 s."""
    ((row,), _) = prediction_errors({"it": model}, log, 1.0, TIMESTEP)
    return np.array(row.rms)


@pytest.mark.parametrize("sampling", [1e-3, 5e-3, 20e-3])
def test_an_exact_log_is_predicted_exactly_whatever_its_sampling(sampling: float) -> None:
    """The start of a prediction is fitted by the plant's own motion, up to rounding."""
    log = exact_log(LogModel(SERVO), sampling)
    assert errors_of(LogModel(SERVO), log).max() < 1e-12


def test_a_bias_of_the_sensor_is_that_of_the_log() -> None:
    log = exact_log(LogModel(SERVO))
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(log.time))
    measured = log.states["rotor angle"] + noise
    biased = replace(log, states={"rotor angle": measured + 0.2})
    unbiased = replace(log, states={"rotor angle": measured})

    behind = LogModel(SERVO, Loop(sensors=(Sensor("rotor angle", bias=0.2),)))
    expected = errors_of(LogModel(SERVO), unbiased)
    assert errors_of(behind, biased) == pytest.approx(expected, rel=1e-9)


PROFILES: list[Any] = [
    Constant(),
    Pulse(1.21, 2.84),
    SineFrom(3.0, onset=0.7, phase=0.4),
    # A function of the user's own.
    lambda t: math.cos(2 * t),
]


@pytest.mark.parametrize("profile", PROFILES)
def test_a_disturbance_of_the_case_acts_at_its_time_in_the_log(profile: Any) -> None:
    loaded = LogModel(SERVO, disturbances=(Disturbance("rotor", TORQUE, profile),))
    log = exact_log(loaded)
    assert errors_of(loaded, log).max() < 1e-9
    assert errors_of(LogModel(SERVO), log).max() > 1e-2


def test_a_disturbance_that_moves_nothing_is_noted() -> None:
    about_z = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    idle = LogModel(SERVO, disturbances=(Disturbance("rotor", about_z),))
    _, notes = prediction_errors({"physics": idle}, exact_log(idle), 1.0, TIMESTEP)
    assert notes == ["physics: no disturbance of the case moves anything along this log"]


LOAD_CASE = """
title = "A servo under a load"
plant = {{ system = "servo" }}
run = {{ duration = "5 s" }}
controller = [{{ law = "lqr" }}]
disturbance = [{{ {disturbance}, label = "load" }}]
uncertain = [
  {{ number = "edit.rotor.mass_scale", values = [0.3, 4] }},
  {{ number = "disturbance.load.scale", values = [-1, 1], name = "load amplitude", nominal = 0 }},
]
"""
# Of each the torque is -0.1 N m, as that of the log.
LOADS = [
    ('body = "rotor", torque = ["0 N m", "1 N m", "0 N m"]', -0.1),
    ('input = "current", amplitude = "1 A"', 0.1 / 0.667),
]


@pytest.mark.parametrize(("disturbance", "amplitude"), LOADS)
def test_an_uncertain_load_is_fitted_and_written(
    disturbance: str, amplitude: float, tmp_path: Path
) -> None:
    """A case of a unit load is fitted to a servo that is driven by a part of it."""
    path = tmp_path / "load.toml"
    path.write_text(LOAD_CASE.format(disturbance=disturbance), encoding="utf-8")
    experiment = Experiment.load(path)
    log = exact_log(LogModel(SERVO, disturbances=(Disturbance("rotor", TORQUE),)))
    parameters = parameters_of(experiment, ())
    plant = experiment.plant("physics")
    found = fit(parameters, Predictor.of(log, 1.0, TIMESTEP), plant)
    assert found.values == pytest.approx([1.0, amplitude], rel=1e-6)

    written = tmp_path / "found.toml"
    write_case(found, "a log", written)
    (load,) = Experiment.load(written).disturbances
    (declared,) = experiment.disturbances
    assert load.amplitudes == pytest.approx(declared.scaled(amplitude).amplitudes, rel=1e-6)


MASS_CASE = """
title = "A pendulum of the user's own with another inertia"
plant = { plant = "own_plant:my_plant" }
run = { duration = "4 s" }
controller = [{ law = "lqr" }]
task = { Q = [100, 1], R = 1 }
uncertain = [{ number = "edit.J.scale", values = [0.3, 4] }]
"""


def test_a_fitted_factor_is_uncertain_around_that_of_the_edit(tmp_path: Path) -> None:
    """The factor of the edit is the fitted one, and a campaign draws it anew: not both."""
    shutil.copy(Path(cases.__file__).parent / "own_plant.py", tmp_path)
    path = tmp_path / "mass.toml"
    path.write_text(MASS_CASE, encoding="utf-8")
    experiment = Experiment.load(path)
    plant = experiment.plant(experiment.nominal.truest)
    parameters = parameters_of(experiment, ())
    log = exact_log(parameters.model(np.array([1.7]), plant), angle=plant.system.states[0].name)
    found = fit(parameters, Predictor.of(log, 1.0, TIMESTEP), plant)
    assert found.values == pytest.approx([1.7], rel=1e-3)

    written = tmp_path / "found.toml"
    write_case(found, "a log", written)
    content = tomllib.loads(written.read_text(encoding="utf-8"))
    assert content["edit"][0]["scale"] == pytest.approx(found.values[0], rel=1e-6)
    assert content["uncertain"][0]["values"]["mean"] == content["edit"][0]["scale"]


ADDED_CASE = """
title = "A servo with a mass on its rotor"
plant = { system = "servo" }
run = { duration = "5 s" }
controller = [{ law = "lqr" }]
uncertain = [
  { number = "edit.shaft.damping", values = [0.0005, 0.1] },
  { number = "edit.rotor.added_mass", values = ["0 kg", "20 kg"], at = ["0.1 m", "0 m", "0.1 m"] },
]
"""
PLACE = (0.1, 0.0, 0.1)


def test_a_fitted_mass_is_an_edit_at_its_place_that_stays_uncertain(tmp_path: Path) -> None:
    """An uncertain mass at the place of an edit is that edit: the fitted one acts once."""
    path = tmp_path / "added.toml"
    path.write_text(ADDED_CASE, encoding="utf-8")
    experiment = Experiment.load(path)
    plant = experiment.plant("physics")
    log = exact_log(LogModel(MujocoPlant.load("servo", edits=(AddedMass("rotor", 5.0, PLACE),))))
    parameters = parameters_of(experiment, ())
    found = fit(parameters, Predictor.of(log, 1.0, TIMESTEP), plant)

    written = tmp_path / "found.toml"
    write_case(found, "a log", written)
    content = tomllib.loads(written.read_text(encoding="utf-8"))
    (mass,) = [edit for edit in content["edit"] if "added_mass" in edit]
    assert [float(place.split()[0]) for place in mass["at"]] == list(PLACE)
    machine = Experiment.load(written)
    family = family_of(machine.file, machine)
    quantity = family.quantities[family.names.index("rotor added mass")]
    (mass,) = [edit for edit in machine.edits if isinstance(edit, AddedMass)]
    assert quantity.nominal == pytest.approx(mass.mass, rel=1e-9)
    doubled = quantity.number.set(machine, 2 * mass.mass)
    assert len(doubled.edits) == len(machine.edits)


UNSTABLE = gm.affine_plant(
    "falling",
    states={"angle": ("rad", "q"), "rate": ("rad/s", "v")},
    inputs={"current": "A"},
    f=[sp.Symbol("v"), 40**2 * sp.Symbol("q")],
    g=[0, 1],
    h=[sp.Symbol("q")],
    parameters={},
)


def test_a_prediction_that_diverges_is_noted() -> None:
    time = np.arange(800) * 5e-3
    u = np.sign(np.sin(9 * time + 0.1))[:, None]
    angle = 0.1 * np.sin(3 * time)
    log = Log("falling", time, u, {"angle": angle}, [slice(0, 800)])
    rows, notes = prediction_errors({"it": LogModel(UNSTABLE)}, log, 4.0, TIMESTEP)
    assert notes == ["it: the prediction of angle diverges"]
    assert rows[0].diverges


@pytest.mark.parametrize(("size", "diverges"), [(1.0, False), (1e4, True)])
def test_a_residual_far_beyond_the_motion_is_a_divergence(size: float, diverges: bool) -> None:
    log = exact_log(LogModel(SERVO))
    parts = {"rotor angle": [(slice(0, 800), np.full(800, size))]}
    (row,) = quality(parts, log, SERVO.system)
    assert row.diverges is diverges


PUSHED = Disturbance("rotor", (0.0, 0.0, 0.0, 0.0, -2.0, 0.0), Pulse(2.02, 2.08))


def noisy(log: Log) -> Log:
    noise = 1e-3 * np.random.default_rng(5).standard_normal(len(log.time))
    return replace(log, states={"rotor angle": log.states["rotor angle"] + noise})


def test_a_push_that_no_model_explains_is_named() -> None:
    log = noisy(exact_log(LogModel(SERVO, disturbances=(PUSHED,))))
    assert unexplained_moments([LogModel(SERVO)], log, 1.0, TIMESTEP) == [
        "1.99 to 2.09 s: a push that no model explains"
    ]


def test_a_push_that_a_model_explains_is_not_named() -> None:
    pushed = LogModel(SERVO, disturbances=(PUSHED,))
    log = noisy(exact_log(pushed))
    assert unexplained_moments([LogModel(SERVO), pushed], log, 1.0, TIMESTEP) == []


STRAY_CASE = """
title = "A servo with stray samples"
plant = {{ system = "servo" }}
run = {{ duration = "5 s" }}
controller = [{{ law = "lqr" }}]
uncertain = [
  {{ number = "edit.rotor.mass_scale", values = [0.3, 4] }},
  {{ number = "edit.shaft.damping", values = [0.0005, 0.1] }},
]
log = {{ loss = "{loss}" }}
"""


def fit_to_stray_samples(folder: Path, loss: str) -> Fit:
    """The fit to a log in which one sample of twenty is wrong by up to 0.1 rad."""
    path = folder / "stray.toml"
    path.write_text(STRAY_CASE.format(loss=loss), encoding="utf-8")
    experiment = Experiment.load(path)
    log = noisy(exact_log(LogModel(SERVO)))
    random = np.random.default_rng(2)
    angle = log.states["rotor angle"].copy()
    stray = random.random(len(angle)) < 0.05
    angle[stray] += random.uniform(0, 0.1, stray.sum())
    log = replace(log, states={"rotor angle": angle})
    plant = experiment.plant("physics")
    return fit(parameters_of(experiment, ()), Predictor.of(log, 1.0, TIMESTEP), plant)


def test_stray_samples_count_less_in_huber_s_loss(tmp_path: Path) -> None:
    squares = fit_to_stray_samples(tmp_path, "squares")
    huber = fit_to_stray_samples(tmp_path, "huber")
    true = np.array([1.0, 0.0088])
    error = np.abs(huber.values - true)
    assert (error < np.abs(squares.values - true) / 3).all()
    assert (huber.half < squares.half / 3).all()
    assert (error < 2 * huber.half).all()


def test_bristles_that_the_speed_of_a_log_makes_unstable_are_refused() -> None:
    log = exact_log(LogModel(SERVO))
    soft = LuGre("shaft", 0.05, stiffness=20.0)
    stiff = LuGre("shaft", 0.05, stiffness=1e3)
    errors_of(LogModel(MujocoPlant.load("servo", edits=(soft,))), log)
    with pytest.raises(ArgumentError, match="makes the bristles unstable: take a timestep of"):
        errors_of(LogModel(MujocoPlant.load("servo", edits=(stiff,))), log)

"""A log of a machine that is known is predicted as well as its model says."""

from __future__ import annotations

import math
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import cases
import numpy as np
import pytest
import sympy as sp
from identify_logs import TRUE, fit_of, servo_log, to_identify

import grosmc_mj as gm
from grosmc_mj.experiments import cases as shipped
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.identify.case_file import write_case
from grosmc_mj.identify.compare import (
    PredictionError,
    best_model,
    comparison_result,
    prediction_errors,
)
from grosmc_mj.identify.fit import Fit, fit
from grosmc_mj.identify.model import LogModel, models_of
from grosmc_mj.identify.parameters import parameters_of
from grosmc_mj.identify.pushes import unexplained_moments
from grosmc_mj.identify.quality import quality, residuals
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.mechanics.machine import LuGre
from grosmc_mj.mechanics.physics.edits import AddedMass
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import Constant, Disturbance, Pulse, SineFrom
from grosmc_mj.simulation.loop import Actuator, Computing, Loop, Sensor
from grosmc_mj.studies.sweep.family import family_of

SERVO = MujocoPlant.load("servo")
TIMESTEP = 1e-3
# The shaft turns about -y.
TORQUE = (0.0, 0.0, 0.0, 0.0, -0.1, 0.0)


MASS = {"number": "edit.rotor.mass_scale", "values": [0.3, 4]}
DAMPING = {"number": "edit.shaft.damping", "values": [0.0005, 0.1]}


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


@pytest.mark.parametrize("every", [20, 1])
def test_the_log_of_a_run_is_predicted_exactly_by_its_plant(every: int) -> None:
    """A command that is held for 20 ms, logged each time or twenty times."""
    arm = cases.case(
        "arm",
        plant={"compare": ["physics"]},
        run={"duration": "2 s", "control_period": "20 ms", "start": {"joint angle": "0.4 rad"}},
        task={"Q": [100, 1], "R": 1},
    )
    run = arm.run(plant="physics", law="lqr").trajectory
    # No input begins with the last state.
    rows = slice(0, len(run.time) - 1, every)
    angle = {"joint angle": run.state[rows, 0]}
    time = run.time[rows]
    log = Log("own", time, run.input[rows, None], angle, [slice(0, len(time))])
    assert errors_of(LogModel(arm.plant("physics")), log).max() < 1e-12


@pytest.mark.parametrize("sampling", [1e-3, 20e-3])
def test_a_machine_that_is_too_heavy_leaves_no_white_residual(
    sampling: float, tmp_path: Path
) -> None:
    log = exact_log(LogModel(SERVO), sampling, seconds=2.0)
    experiment = Experiment.load(cases.write(tmp_path, "servo", uncertain=[MASS]))
    heavier = fit_of(parameters_of(experiment, ()), [1.1], scales={"rotor angle": 1e-3})
    parts = residuals(heavier, Predictor.of(log, 1.0, TIMESTEP), SERVO)
    (row,) = quality(parts, log, SERVO.system)
    assert row.white is False


def test_a_bias_of_the_sensor_is_that_of_the_log() -> None:
    log = exact_log(LogModel(SERVO))
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(log.time))
    measured = log.states["rotor angle"] + noise
    biased = replace(log, states={"rotor angle": measured + 0.2})
    unbiased = replace(log, states={"rotor angle": measured})

    behind = LogModel(SERVO, Loop(sensors=(Sensor("rotor angle", bias=0.2),)))
    expected = errors_of(LogModel(SERVO), unbiased)
    assert errors_of(behind, biased) == pytest.approx(expected, rel=1e-9)


def test_the_rung_that_made_a_log_explains_it_best() -> None:
    parameters = parameters_of(to_identify(), ())
    plant = parameters.model(TRUE, to_identify().plant("physics")).plant
    late = Loop(computing=Computing(delay=6e-3))
    rungs = {
        **models_of(to_identify()),
        "ideal": LogModel(plant),
        "as it is": LogModel(plant, late),
    }
    assert {"corrected", "physics", "loop"} < set(rungs)
    rows, _ = prediction_errors(rungs, servo_log().between(0, 0.5), 1.0, TIMESTEP)
    assert best_model(rows) == {"rotor angle": "as it is"}


def error_row(rung: str, *rms: float) -> PredictionError:
    """Prediction errors of a rung after 0.1 s, 0.5 s and 1 s."""
    return PredictionError(rung, "rotor angle", "rad", (0.1, 0.5, 1.0), rms)


@pytest.mark.parametrize(
    ("rows", "best"),
    [
        ([error_row("physics", 1.0, 5.0, 9.0), error_row("machine", 8.0, 6.0, 2.0)], "machine"),
        ([error_row("physics", 8.0, 6.0, 2.0), error_row("machine", 1.0, 1.0, 3.0)], "physics"),
        ([error_row("physics", 1.0, 1.0, math.nan), error_row("loop", 2.0, 4.0, 8.0)], "loop"),
        # Errors that differ by less than 0.1 % are equal.
        (
            [error_row("physics", 1.0, 2.0, 2.0), error_row("loop", 3.0, 4.0, 2.001)],
            "physics and loop",
        ),
        ([error_row("physics", 1.0, 2.0, 2.0), error_row("loop", 3.0, 4.0, 2.003)], "physics"),
    ],
)
def test_the_best_rung_is_that_with_the_least_error_at_the_longest_horizon(
    rows: list[PredictionError], best: str
) -> None:
    assert best_model(rows) == {"rotor angle": best}


def test_inputs_are_as_late_as_the_computer_and_the_fastest_actuator() -> None:
    actuators = (Actuator("left", delay=3e-3), Actuator("right", delay=5e-3))
    loop = Loop(computing=Computing(delay=2e-3), actuators=actuators)
    assert LogModel(SERVO, loop).delay == pytest.approx(5e-3)


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


def test_a_disturbance_that_moves_nothing_is_noted_once() -> None:
    about_z = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    idle = LogModel(SERVO, disturbances=(Disturbance("rotor", about_z),))
    rungs = {"physics": idle, "loop": idle}
    _, notes = prediction_errors(rungs, exact_log(idle), 1.0, TIMESTEP)
    assert notes == ["physics, loop: no disturbance of the case moves anything along this log"]


def fit_of_case(path: Path, log: Log) -> Fit:
    """The fit of a case's numbers to a log."""
    experiment = Experiment.load(path)
    predictor = Predictor.of(log, 1.0, TIMESTEP)
    return fit(parameters_of(experiment, ()), predictor, experiment.plant("physics"))


def written(found: Fit, folder: Path) -> Experiment:
    """The case that is written of a fit."""
    write_case(found, "a log", folder / "found.toml")
    return Experiment.load(folder / "found.toml")


# Of each the torque is -0.1 N m, as that of the log.
LOADS = [
    ({"body": "rotor", "torque": ["0 N m", "1 N m", "0 N m"]}, -0.1),
    ({"input": "current", "amplitude": "1 A"}, 0.1 / 0.667),
]


def with_load(folder: Path, load: dict[str, Any]) -> Path:
    """The case of a servo of another mass under an uncertain load."""
    scale = {"number": "disturbance.load.scale", "values": [-1, 1], "nominal": 0, "name": "load"}
    disturbance = {**load, "label": "load"}
    return cases.write(folder, "servo", disturbance=disturbance, uncertain=[MASS, scale])


@pytest.mark.parametrize(("load", "amplitude"), LOADS, ids=["torque", "current"])
def test_an_uncertain_load_is_fitted(
    load: dict[str, Any], amplitude: float, tmp_path: Path
) -> None:
    """A case of a unit load is fitted to a servo that is driven by a part of it."""
    loaded = LogModel(SERVO, disturbances=(Disturbance("rotor", TORQUE),))
    found = fit_of_case(with_load(tmp_path, load), exact_log(loaded, seconds=1.0))
    assert found.values == pytest.approx([1.0, amplitude], rel=1e-6)


@pytest.mark.parametrize(("load", "amplitude"), LOADS, ids=["torque", "current"])
def test_a_fitted_load_is_written(load: dict[str, Any], amplitude: float, tmp_path: Path) -> None:
    experiment = Experiment.load(with_load(tmp_path, load))
    fitted = fit_of(parameters_of(experiment, ()), [1.0, amplitude])
    (declared,) = experiment.disturbances
    (found,) = written(fitted, tmp_path).disturbances
    assert found.amplitudes == pytest.approx(declared.scaled(amplitude).amplitudes)


def test_a_fitted_factor_is_uncertain_around_that_of_the_edit(tmp_path: Path) -> None:
    """The factor of the edit is the fitted one, and a campaign draws it anew: not both."""
    shutil.copy(Path(shipped.__file__).parent / "own_plant.py", tmp_path)
    path = cases.write(
        tmp_path,
        "own_plant:my_plant",
        task={"Q": [100, 1], "R": 1},
        uncertain={"number": "edit.J.scale", "values": [0.3, 4]},
    )
    parameters = parameters_of(Experiment.load(path), ())
    found = fit_of(parameters, [1.7])
    written(found, tmp_path)
    content = tomllib.loads((tmp_path / "found.toml").read_text(encoding="utf-8"))
    assert content["edit"] == [{"parameter": "J", "scale": pytest.approx(1.7)}]
    assert content["uncertain"][0]["values"]["mean"] == content["edit"][0]["scale"]


def test_a_fitted_mass_is_an_edit_at_its_place_that_stays_uncertain(tmp_path: Path) -> None:
    """An uncertain mass at the place of an edit is that edit: the fitted one acts once."""
    place = [0.1, 0.0, 0.2]
    added = {
        "number": "edit.rotor.added_mass",
        "values": ["0 kg", "20 kg"],
        "at": [f"{x} m" for x in place],
    }
    path = cases.write(tmp_path, "servo", uncertain=[DAMPING, added])
    machine = written(fit_of(parameters_of(Experiment.load(path), ()), [0.01, 5.0]), tmp_path)

    (mass,) = [edit for edit in machine.edits if isinstance(edit, AddedMass)]
    assert (mass.mass, [*mass.position]) == (pytest.approx(5.0), place)
    family = family_of(machine.file, machine)
    quantity = family.quantities[family.names.index("rotor added mass")]
    assert quantity.nominal == pytest.approx(5.0)
    assert len(quantity.number.set(machine, 10.0).edits) == len(machine.edits)


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


PUSHED = Disturbance("rotor", (0.0, 0.0, 0.0, 0.0, -2.0, 0.0), Pulse(1.0, 1.15))


def noisy(log: Log) -> Log:
    noise = 1e-3 * np.random.default_rng(5).standard_normal(len(log.time))
    return replace(log, states={"rotor angle": log.states["rotor angle"] + noise})


def test_a_push_that_no_model_explains_is_named() -> None:
    """It lasts from one moment of 0.1 s into the next, which are one."""
    log = noisy(exact_log(LogModel(SERVO, disturbances=(PUSHED,)), seconds=2.0))
    assert unexplained_moments([LogModel(SERVO)], log, 1.0, TIMESTEP) == [
        "0.94 to 1.15 s: a push that no model explains"
    ]


def test_a_push_that_a_model_explains_is_not_named() -> None:
    pushed = LogModel(SERVO, disturbances=(PUSHED,))
    log = noisy(exact_log(pushed, seconds=2.0))
    assert unexplained_moments([LogModel(SERVO), pushed], log, 1.0, TIMESTEP) == []


def fit_to_stray_samples(folder: Path, loss: str) -> Fit:
    """The fit to a log in which one sample of twenty is wrong by up to 0.1 rad."""
    path = cases.write(folder, "servo", uncertain=MASS, log={"loss": loss})
    log = noisy(exact_log(LogModel(SERVO), seconds=1.0))
    random = np.random.default_rng(2)
    angle = log.states["rotor angle"].copy()
    stray = random.random(len(angle)) < 0.05
    angle[stray] += random.uniform(0, 0.1, stray.sum())
    return fit_of_case(path, replace(log, states={"rotor angle": angle}))


def test_stray_samples_count_less_in_huber_s_loss(tmp_path: Path) -> None:
    squares = fit_to_stray_samples(tmp_path, "squares")
    huber = fit_to_stray_samples(tmp_path, "huber")
    error = np.abs(huber.values - 1.0)
    assert (error < np.abs(squares.values - 1.0) / 3).all()
    assert (huber.half < squares.half / 3).all()
    assert (error < 2 * huber.half).all()


BRISTLES = {
    "joint": "shaft",
    "coulomb": "0.05 N m",
    "stiffness": "1000 N m/rad",
    "damping": "0.5 N m s/rad",
}


def test_bristles_that_the_speed_of_a_log_makes_unstable_are_refused(tmp_path: Path) -> None:
    log = exact_log(LogModel(SERVO))
    soft = LuGre("shaft", 0.05, stiffness=20.0)
    stiff = LuGre("shaft", 0.05, stiffness=1e3)
    errors_of(LogModel(MujocoPlant.load("servo", edits=(soft,))), log)
    with pytest.raises(ArgumentError, match="makes the bristles unstable: take a timestep of"):
        errors_of(LogModel(MujocoPlant.load("servo", edits=(stiff,))), log)
    with pytest.raises(ArgumentError, match="makes the bristles unstable: take a timestep of"):
        fit_of_case(cases.write(tmp_path, "servo", lugre=BRISTLES, uncertain=[DAMPING]), log)

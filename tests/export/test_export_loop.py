"""A law with the software of its loop as C: equal to Python's estimators and prediction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from exported import compiled, complaints_of_sanitizers, load, needs_compiler

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.proof import prove
from grosmc_mj.simulation.loop import Actuator, Computing, Estimator, Loop, Sensor

ANGLE = Sensor(of="rotor angle", resolution=1.534e-3)
SLOW = Sensor(of="rotor angle", resolution=1.534e-3, period=3e-3)
NOISY = Sensor(of="rotor angle", noise=1e-3)
LATE = Sensor(of="rotor angle", resolution=1e-3, delay=2e-3)
JITTER = Computing(delay=1e-3, jitter=1e-3, missed=0.1)
SPEED = ("rotor speed",)

LOOPS = {
    "difference": Loop(sensors=(ANGLE,)),
    "slow sensor": Loop(sensors=(SLOW,)),
    "filtered": Loop(
        sensors=(ANGLE,), estimators=(Estimator(of=SPEED, law="filtered", time_constant=0.01),)
    ),
    "unsettled": Loop(
        sensors=(ANGLE,),
        estimators=(Estimator(of=SPEED, law="eso", bandwidth=100, settled=False),),
    ),
    "eso": Loop(
        computing=JITTER,
        sensors=(ANGLE,),
        estimators=(Estimator(of=SPEED, law="eso", bandwidth=100),),
    ),
    "kalman": Loop(
        computing=JITTER,
        sensors=(NOISY,),
        estimators=(Estimator(of=("rotor angle", "rotor speed"), law="kalman", load=1.0),),
    ),
    "delay": Loop(
        computing=JITTER, sensors=(LATE, Sensor(of="rotor speed", delay=2e-3, noise=1e-3))
    ),
    "limit": Loop(sensors=(ANGLE,), actuators=(Actuator(of="current", limit=1.0, delay=2e-3),)),
}


def law_in(name: str, *, predict: bool, law: str = "grosmc") -> tuple[Experiment, LawInC]:
    """The law in a loop on the servo, for a run of 0.1 s, with its experiment."""
    experiment = load("servo/case1").changed(duration=0.1)
    experiment = replace(experiment.changed(control_period=2e-3), loop=LOOPS[name])
    controller = experiment.law("physics", law)
    loop = experiment.loop_around(controller, LOOPS[name], predict=predict)
    system = experiment.nominal.system
    period = experiment.settings.control_period
    return experiment, LawInC(controller, "law_in_c", system, period, loop=loop)


@needs_compiler
@pytest.mark.parametrize(
    ("name", "predict"),
    [
        ("difference", False),
        ("slow sensor", True),
        ("filtered", False),
        ("unsettled", True),
        ("eso", False),
        ("kalman", False),
        ("kalman", True),
        ("delay", True),
        ("limit", False),
        ("limit", True),
    ],
)
def test_software_in_c_is_the_python_one_to_the_last_bit(
    name: str, predict: bool, tmp_path: Path
) -> None:
    experiment, law = law_in(name, predict=predict)
    proof = prove(experiment, law, compiled(law, tmp_path), plants=0)
    assert proof.equal, proof.words
    # Two plants, with 50 samples each.
    assert proof.samples == 100


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("law", ["sign", "implicit, predicted"])
def test_software_of_two_inputs_is_the_python_one(law: str, tmp_path: Path) -> None:
    experiment = load("two_link_arm/bench").changed(duration=0.3)
    loop = experiment.applied_loop("physics", law)
    assert loop is not None
    in_c = LawInC(loop.controller, "law_in_c", experiment.nominal.system, loop.period, loop=loop)
    proof = prove(experiment, in_c, compiled(in_c, tmp_path), plants=1)
    assert proof.equal, proof.words


@needs_compiler
@pytest.mark.parametrize("name", ["delay", pytest.param("kalman", marks=pytest.mark.slow)])
def test_sanitizers_find_nothing_in_a_loop(name: str, tmp_path: Path) -> None:
    _, law = law_in(name, predict=True)
    assert complaints_of_sanitizers(law, tmp_path) == ""


@pytest.mark.parametrize(("name", "law"), [("eso", "grosmc"), ("limit", "lqr")])
def test_the_step_takes_the_signals_that_are_needed(name: str, law: str) -> None:
    """Of angle and speed the one that is measured."""
    _, in_c = law_in(name, predict=False, law=law)
    assert in_c.measured == [0]
    header = " ".join(in_c.header.split())
    assert "y[0] rotor angle [rad]" in header
    assert "rotor speed [rad/s]" not in header.partition("One sample")[2]


@needs_compiler
def test_single_precision_in_a_loop_is_judged_by_each_requirement(tmp_path: Path) -> None:
    experiment, law = law_in("eso", predict=True)
    law = replace(law, real="float")
    proof = prove(experiment, law, compiled(law, tmp_path), plants=0)
    assert not proof.equal
    judged = [verdict.in_c.requirement for verdict in proof.verdicts]
    assert judged == list(experiment.limits)
    assert proof.overturned == []


@needs_compiler
def test_a_wrong_number_of_the_software_is_noticed(tmp_path: Path) -> None:
    """The C of another estimator: the comparison can fail."""
    experiment, law = law_in("filtered", predict=False)
    _, other = law_in("difference", predict=False)
    assert not prove(experiment, law, compiled(other, tmp_path), plants=0).equal

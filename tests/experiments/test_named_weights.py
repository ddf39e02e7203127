"""Weights, bounds and projections by the names of states, outputs and inputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import case, content

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.experiments.file.user_code import named_in
from grosmc_mj.experiments.weights import named_weights
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.theory.control.controller import Controller

# Two joints, whose motors have other names, in another order of the alphabet.
TWO_JOINTS = """<mujoco model="two joints"><option timestep="0.001"/>
<worldbody><body name="upper"><joint name="shoulder" axis="0 -1 0" damping="0.2"/>
<geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
<body name="lower" pos="0.4 0 0"><joint name="elbow" axis="0 -1 0"/>
<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5"/></body></body></worldbody>
<actuator><motor name="second" joint="shoulder"/>{}</actuator></mujoco>"""
ELBOW = '<motor name="first" joint="elbow"/>'
ROBOT = "robot.xml"
SERVO = "servo"


def weighed(folder: Path, base: str, motor: str = ELBOW, **task: Any) -> Experiment:
    """The servo, or the two joints, with a task."""
    (folder / ROBOT).write_text(TWO_JOINTS.format(motor), encoding="utf-8")
    return case(base, folder=folder, run={"duration": "0.1 s"}, task=task)


def law_of(experiment: Experiment) -> Controller:
    return experiment.law(experiment.nominal.truest, experiment.controllers[0])


@pytest.mark.parametrize(
    ("base", "motor", "by_name", "by_order"),
    [
        (
            ROBOT,
            ELBOW,
            {
                "Q": {"elbow rate": 4, "elbow": 3, "shoulder": 1, "shoulder rate": 2},
                "R": {"elbow": 6, "shoulder": 5},
            },
            {"Q": [1, 2, 3, 4], "R": [5, 6]},
        ),
        (
            ROBOT,
            "",
            {
                "Q": {"elbow rate": 4, "elbow": 2, "shoulder": 1, "shoulder rate": 3},
                "R": {"second": 5},
            },
            {"Q": [1, 2, 3, 4], "R": 5},
        ),
        (
            SERVO,
            ELBOW,
            {"Q": {"rotor speed": 2, "rotor angle": 9}, "R": {"current": 3}},
            {"Q": [9, 2], "R": 3},
        ),
    ],
)
def test_weights_by_name_are_those_in_the_order_of_the_names(
    tmp_path, base, motor, by_name, by_order
) -> None:
    named = law_of(weighed(tmp_path, base, motor, **by_name)).designed.lqr
    ordered = law_of(weighed(tmp_path, base, motor, **by_order)).designed.lqr
    np.testing.assert_array_equal(named.Q, ordered.Q)
    np.testing.assert_array_equal(named.R, ordered.R)
    np.testing.assert_array_equal(named.K, ordered.K)


def test_a_name_that_Q_leaves_out_weighs_nothing(tmp_path) -> None:
    optimum = law_of(weighed(tmp_path, ROBOT, Q={"shoulder": 1, "elbow": 3}, R=1)).designed.lqr
    np.testing.assert_array_equal(np.diag(optimum.Q), [1, 0, 3, 0])


def test_a_weight_beside_the_diagonal_has_the_names_of_both() -> None:
    design = law_of(case("arm", task={"Q": [[10, 2], [2, 1]], "R": 3})).designed
    assert named_weights(design) == {
        "Q": {"joint angle": 10, "joint rate": 1, "joint angle and joint rate": 2},
        "R": {"joint angle": 3},
    }


@pytest.mark.parametrize(
    ("base", "task", "words"),
    [
        (ROBOT, {"Q": {"sholder": 1}, "R": 1}, "task: Q: unknown name 'sholder': did you mean"),
        (
            ROBOT,
            {"Q": [1, 1, 1, 1], "R": {"elbow": 1}},
            "task: R: 'shoulder'|R: shoulder is mis",
        ),
        (
            ROBOT,
            {"Q": [1, 1], "R": 1},
            "numbers by name: shoulder, 'shoulder rate'|by name: 'sho",
        ),
        (ROBOT, {"Q": {"elbow": "1 rad"}, "R": 1}, "task: Q: .* numbers by name"),
        (
            SERVO,
            {"Q": {"rotor": 1}, "R": 1},
            "task: Q: unknown name 'rotor': did you mean 'rotor",
        ),
        (SERVO, {"region": {"current": 1}}, "task: region: unknown name"),
        (SERVO, {"region": {"rotor angle": 1}}, "'rotor speed' is missing"),
        (SERVO, {"region": [1, 0]}, "task: region: .* must be positive bounds"),
    ],
)
def test_wrong_and_missing_names_are_refused_in_one_line(tmp_path, base, task, words) -> None:
    with pytest.raises(ArgumentError, match=words) as refused:
        assert weighed(tmp_path, base, **task).region
    assert "\n" not in str(refused.value)


def test_a_region_by_name_is_that_in_the_order_of_the_names(tmp_path) -> None:
    region = {"rotor speed": 2, "rotor angle": 1}
    assert weighed(tmp_path, SERVO, region=region).region == (1, 2)


def uncertain(G: Any, region: Any) -> Experiment:
    """The servo under a law of an uncertainty."""
    uncertainty = {
        "scales": {"J": [1, 2]},
        "wrench": [0, 0, 0, 0, 1, 0],
        "region": region,
        "reaching_rate": 0.2,
    }
    return case(SERVO, controller={"law": "linear-grosmc", "G": G, "uncertainty": uncertainty})


def test_the_region_of_an_uncertainty_and_G_may_have_names() -> None:
    named = uncertain({"rotor speed": 2, "rotor angle": 1}, {"rotor speed": 2, "rotor angle": 1})
    ordered = uncertain([[1, 2]], [1, 2])
    assert named.region == ordered.region == (1, 2)
    assert law_of(named).designed.gains == law_of(ordered).designed.gains


def test_outputs_that_are_no_states_are_counted() -> None:
    task = {
        "outputs": {"of": "tip", "unit": "m"},
        "Q": {"output 2": 3, "output 1 rate": 2, "output 1": 1},
        "R": {"output 1": 4, "output 2": 5},
    }
    optimum = law_of(case("two_link_arm", law="fl-lqr", task=task)).designed.lqr
    np.testing.assert_array_equal(np.diag(optimum.Q), [1, 2, 3, 0])
    np.testing.assert_array_equal(np.diag(optimum.R), [4, 5])


@pytest.mark.parametrize(
    ("base", "reference", "expected"),
    [
        (ROBOT, {"elbow": "t", "shoulder": "sin(t)"}, np.sin(0.5)),
        (ROBOT, ["sin(t)", "t"], np.sin(0.5)),
        (SERVO, {"rotor angle": "2"}, 2.0),
    ],
)
def test_a_reference_by_name_is_that_in_the_order_of_the_outputs(
    tmp_path, base, reference, expected
) -> None:
    law = law_of(weighed(tmp_path, base, Q=1, R=1, reference=reference))
    values = law.coordinates.reference(0.5, law.parameters.reference)
    assert values[0] == pytest.approx(expected)


def test_a_reference_needs_each_output(tmp_path) -> None:
    with pytest.raises(ArgumentError, match="task: reference: elbow is missing: each of shoulder"):
        weighed(tmp_path, ROBOT, Q=1, R=1, reference={"shoulder": "t"})


def test_python_that_a_reference_by_name_would_import_is_named() -> None:
    """A campaign says of what its results were made."""
    values = content(ROBOT, task={"reference": {"hinge": "own:path"}})
    assert named_in(CaseFile.model_validate(values)) == ["own:path"]

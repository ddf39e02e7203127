"""Parameters that a log does not show, and what it shows of several together."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import cases
import numpy as np
import pytest
from identify_logs import servo_log, windows

from benchmarks import coverage
from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.identify import hidden
from grosmc_mj.identify.hidden import HiddenParameter, hidden_parameter
from grosmc_mj.identify.parameters import parameters_of
from grosmc_mj.identify.residual import residual_of

MASS = {"number": "edit.rotor.mass_scale", "values": [0.3, 4]}
ARMATURE = {"number": "edit.shaft.armature", "values": [0, 0.1]}
DAMPING = {"number": "edit.shaft.damping", "values": [0.001, 0.1]}
FRICTION = {"number": "edit.shaft.friction", "values": [0, 0.05]}
LATE_INPUT = {"number": "actuator.current.delay", "values": ["0 ms", "10 ms"]}
LATE_SENSOR = {"number": "sensor.rotor angle.delay", "values": ["0 ms", "10 ms"]}
SCALE = {"number": "sensor.rotor angle.scale", "values": [0.5, 2]}
BIAS = {"number": "sensor.rotor angle.bias", "values": ["-1 rad", "1 rad"]}
OFFSET = {
    "number": "disturbance.offset.scale",
    "values": [-0.5, 0.5],
    "name": "offset amplitude",
    "nominal": 0,
}


def weak_of(log: Log, *uncertain: dict[str, Any]) -> HiddenParameter | None:
    """Numbers of a servo that a log of current and angle does not show."""
    servo = cases.case(
        "servo",
        computing={"delay": "1 ms"},
        sensor={"of": "rotor angle", "delay": "2 ms"},
        actuator={"of": "current", "delay": "2 ms"},
        disturbance={"input": "current", "amplitude": "1 A", "label": "offset"},
        uncertain=[*uncertain],
    )
    parameters = parameters_of(servo, ())
    free = np.ones(len(parameters.names), bool)
    scales = {"rotor angle": coverage.NOISE}
    plant = servo.plant("physics")
    residual = residual_of(parameters, free, windows(log), plant, scales, parameters.nominal)
    values = parameters.first
    return hidden_parameter(parameters, free, residual.jacobian(residual.point(values)), values)


@pytest.mark.parametrize(
    ("uncertain", "names", "words"),
    [
        # The inertia is that of the mass, 0.0577 kg m^2, plus the armature.
        (
            [MASS, DAMPING, ARMATURE],
            {"rotor mass scale", "shaft armature"},
            "only shaft armature + 0.0577 times rotor mass scale is visible",
        ),
        (
            [MASS, DAMPING, SCALE],
            {"rotor mass scale", "shaft damping", "rotor angle scale"},
            "a change of all of them is not visible",
        ),
        ([MASS, BIAS, DAMPING], {"rotor angle bias"}, "rotor angle bias is not visible"),
        (
            [MASS, LATE_INPUT, LATE_SENSOR],
            {"current delay", "rotor angle delay"},
            "only their sum is visible",
        ),
    ],
)
def test_parameters_that_a_log_does_not_show_are_named(
    uncertain: list[dict[str, Any]], names: set[str], words: str
) -> None:
    weak = weak_of(servo_log().between(0, 0.5), *uncertain)
    assert weak is not None
    assert {weak.held, *weak.others} == names
    assert words in weak.words


def test_a_log_shows_damping_and_friction() -> None:
    assert weak_of(servo_log(), DAMPING, FRICTION) is None


def test_of_friction_and_offset_a_motion_one_way_shows_the_difference() -> None:
    """Torque of an offset of the current less friction: it is 0.667 N m for an ampere."""
    u = np.repeat(np.random.default_rng(3).uniform(0.3, 0.8, 17), 60)[:1000]
    angles = coverage.simulated_angles(u, 0.0577, 0.0088, late=0)
    time = np.arange(1000) * coverage.SAMPLING
    log = Log("one way", time, u[:, None], {"rotor angle": angles}, [slice(0, 1000)])
    weak = weak_of(log, MASS, FRICTION, OFFSET)
    assert weak is not None
    assert "only shaft friction - 0.667 times offset amplitude is visible" in weak.words


def test_changes_that_cancel_each_other_are_told_for_one_unit_of_the_first() -> None:
    members = [
        hidden._Member("mass", "kg", 2.0, 0.4),
        hidden._Member("friction", "N m", 0.5, -0.1),
        hidden._Member("scale", "1", 1.0, 0.05),
    ]
    assert hidden._changes(members) == "mass by 1 kg, friction by -0.25 N m, scale by 0.125"


# Jacobians of two parameters, whose null direction is (1, change).
@pytest.mark.parametrize(
    ("values", "change", "words"),
    [
        ((0.5, 1.0), 2.0, "only their ratio is visible"),
        ((0.5, 1.0), -2.0, "only their product is visible"),
        ((0.5, 2.0), 1.0, "only their difference is visible"),
        ((0.5, 2.0), -1.0, "only their sum is visible"),
        ((0.0, 2.0), 1.0, "only their difference is visible"),
        ((0.0, 0.0), -1.0, "only their sum is visible"),
        ((0.5, 2.0), 0.5, "only {0} - 2 times {1} is visible"),
        ((0.5, 2.0), -0.4, "only {0} + 2.5 times {1} is visible"),
    ],
)
def test_the_visible_combination_is_what_the_null_direction_leaves_as_it_is(
    values: tuple[float, float], change: float, words: str
) -> None:
    """Both in one unit, of equal size and range."""
    names = ["shaft friction", "rail friction"]
    parameters: Any = SimpleNamespace(
        names=names,
        quantities=[SimpleNamespace(name=name, unit="N m") for name in names],
        bounds=(np.zeros(2), np.full(2, 4.0)),
        scales=np.ones(2),
    )
    random = np.random.default_rng(0)
    column = 100 * random.standard_normal(50)
    start = random.standard_normal(50)
    jacobian = np.column_stack([change * column, -column, start])
    weak = hidden_parameter(parameters, np.ones(2, bool), jacobian, np.array(values))
    assert weak is not None
    # The one that changes more is held, and named first.
    assert words.format(*names) in weak.words

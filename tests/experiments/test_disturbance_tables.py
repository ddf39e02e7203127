"""``[[disturbance]]``: where it acts, with its unit and its course, as a case file says it."""

from __future__ import annotations

from typing import Any

import pytest
from cases import case

from grosmc_mj.experiments.assumptions.notes import notes_on
from grosmc_mj.experiments.case_document import case_document
from grosmc_mj.simulation.disturbances import (
    Constant,
    Disturbance,
    InputDisturbance,
    OutputDisturbance,
    Pulse,
    Table,
)

# Tables of disturbances, and what they are.
TABLES: list[tuple[dict[str, Any], Any]] = [
    (
        {"body": "rotor", "torque": ["0 N m", "10 N cm", "0 N m"]},
        Disturbance("rotor", (0, 0, 0, 0, 0.1, 0), Constant()),
    ),
    (
        {"input": "current", "amplitude": "200 mA", "profile": "pulse", "stop": "0.1 s"},
        InputDisturbance("current", 0.2, Pulse(0.0, 0.1)),
    ),
    (
        {"measured": "rotor speed", "amplitude": "2 rad/s", "label": "glitch"},
        OutputDisturbance("rotor speed", 2.0, label="glitch"),
    ),
    (
        {
            "measured": "rotor angle",
            "amplitude": "1 rad",
            "profile": "table",
            "values": [1.0, -0.5],
            "hold": "5 ms",
            "periodic": True,
        },
        OutputDisturbance("rotor angle", 1.0, Table((1.0, -0.5), 5e-3, periodic=True)),
    ),
]


@pytest.mark.parametrize("plant", ["corrected", "physics"])
@pytest.mark.parametrize(("table", "expected"), TABLES)
def test_a_table_says_where_a_disturbance_acts(plant: str, table, expected) -> None:
    experiment = case("servo", plant={"compare": [plant]}, disturbance=table)
    assert experiment.disturbances == (expected,)
    run = experiment.run().trajectory
    assert run.disturbed is not None
    assert run.disturbed.any()


def test_the_document_of_a_case_says_where_its_disturbances_act() -> None:
    experiment = case("servo", disturbance=[table for table, _ in TABLES[:3]])
    body, current, speed = case_document(experiment)["disturbances"]
    assert body["body"] == "rotor"
    assert (current["input"], current["amplitude"]) == ("current", 0.2)
    assert (speed["measured"], speed["amplitude"]) == ("rotor speed", 2.0)


@pytest.mark.parametrize(
    ("state", "amplitude", "noted"),
    [("rotor angle", "1 mrad", False), ("rotor speed", "1 rad/s", True)],
)
def test_a_disturbance_of_a_measurement_that_nothing_makes_is_noted(
    state: str, amplitude: str, noted: bool
) -> None:
    encoder = {"of": "rotor angle", "resolution": "1 mrad"}
    glitch = {"measured": state, "amplitude": amplitude}
    experiment = case("servo", sensor=encoder, disturbance=glitch)
    line = f"the disturbance of measured {state} does nothing: {state} is estimated, not measured"
    assert (line in notes_on(experiment, list(experiment.runs()))) == noted

"""``[[disturbance]]``: where it acts, with its unit and its course, as a case file says it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from case_texts import load, short_step

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
TABLES: list[tuple[str, Any]] = [
    (
        'body = "rotor"\ntorque = ["0 N m", "10 N cm", "0 N m"]',
        Disturbance("rotor", (0, 0, 0, 0, 0.1, 0), Constant()),
    ),
    (
        'input = "current"\namplitude = "200 mA"\nprofile = "pulse"\nstop = "0.1 s"',
        InputDisturbance("current", 0.2, Pulse(0.0, 0.1)),
    ),
    (
        'measured = "rotor speed"\namplitude = "2 rad/s"\nlabel = "glitch"',
        OutputDisturbance("rotor speed", 2.0, label="glitch"),
    ),
    (
        'measured = "rotor angle"\namplitude = "1 rad"\nprofile = "table"\n'
        'values = [1.0, -0.5]\nhold = "5 ms"\nperiodic = true',
        OutputDisturbance("rotor angle", 1.0, Table((1.0, -0.5), 5e-3, periodic=True)),
    ),
]


@pytest.mark.parametrize("plant", ["corrected", "physics"])
@pytest.mark.parametrize(("table", "expected"), TABLES)
def test_a_table_says_where_a_disturbance_acts(
    tmp_path: Path, plant: str, table: str, expected: Any
) -> None:
    experiment = load(tmp_path, short_step(plant=plant) + f"[[disturbance]]\n{table}\n")
    assert experiment.disturbances == (expected,)
    run = experiment.run().trajectory
    assert run.disturbed is not None
    assert run.disturbed.any()


def test_the_document_of_a_case_says_where_its_disturbances_act(tmp_path: Path) -> None:
    tables = "".join(f"[[disturbance]]\n{table}\n" for table, _ in TABLES[:3])
    case = load(tmp_path, short_step() + tables)
    body, current, speed = case_document(case)["disturbances"]
    assert body["body"] == "rotor"
    assert (current["input"], current["amplitude"]) == ("current", 0.2)
    assert (speed["measured"], speed["amplitude"]) == ("rotor speed", 2.0)


ENCODER = """
[[sensor]]
of = "rotor angle"
resolution = "1 mrad"
"""
GLITCH = """
[[disturbance]]
measured = "{state}"
amplitude = {amplitude}
"""


@pytest.mark.parametrize(
    ("state", "amplitude", "noted"),
    [("rotor angle", '"1 mrad"', False), ("rotor speed", '"1 rad/s"', True)],
)
def test_a_disturbance_of_a_measurement_that_nothing_makes_is_noted(
    tmp_path: Path, state: str, amplitude: str, noted: bool
) -> None:
    glitch = GLITCH.format(state=state, amplitude=amplitude)
    experiment = load(tmp_path, short_step() + ENCODER + glitch)
    notes = notes_on(experiment, list(experiment.runs()))
    line = f"the disturbance of measured {state} does nothing: {state} is estimated, not measured"
    assert (line in notes) == noted

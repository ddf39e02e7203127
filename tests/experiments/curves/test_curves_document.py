"""The curves of a case as a document: near to the run, with the run's own numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from grosmc_mj.experiments.curves import curves_document, write_curves
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.runs import RunResult


@pytest.fixture(scope="module")
def runs() -> list[RunResult]:
    experiment = Experiment.load("servo/case1").varied(duration=11.0)
    return [experiment.run("physics", law) for law in ("lqr", "grosmc")]


def test_lines_between_the_points_stay_near_the_run(runs: list[RunResult]) -> None:
    output = curves_document(runs)["panels"][0]
    for run, curve in zip(runs, output["curves"], strict=True):
        time, true = run.trajectory.time, run.trajectory.state[:, 0]
        drawn = np.interp(time, curve["t"], curve["y"])
        # A line between points that are rounded to seven digits.
        allowed = 5e-4 * np.ptp(true) + 1e-6
        assert np.abs(drawn - true).max() <= allowed
        assert len(curve["t"]) < len(time) / 20
        assert set(curve["t"]) <= {float(f"{t:.7g}") for t in time.tolist()}


def test_what_switches_at_every_sample_has_its_range(runs: list[RunResult]) -> None:
    panels = {each["label"]: each for each in curves_document(runs)["panels"]}
    (curve,) = [each for each in panels["current [A]"]["curves"] if each["law"] == "grosmc"]
    least, largest = curve["range"]
    true = runs[1].trajectory.input
    assert min(least) == pytest.approx(true.min(), rel=1e-6)
    assert max(largest) == pytest.approx(true.max(), rel=1e-6)


def test_what_chatters_is_drawn_below_the_rest(runs: list[RunResult]) -> None:
    panels = {each["label"]: each for each in curves_document(runs)["panels"]}
    drawn = [each["law"] for each in panels["current [A]"]["curves"]]
    variations = {run.controller.name: run.metrics["total_variation"].value or 0.0 for run in runs}
    assert variations["grosmc"] > 10 * variations["lqr"]
    assert drawn == ["grosmc", "lqr"]


def test_requirements_and_disturbances_are_beside_the_curves(
    runs: list[RunResult], tmp_path: Path
) -> None:
    path = write_curves(runs, "servo_case1", tmp_path)
    found = json.loads(path.read_text(encoding="utf-8"))
    assert path == tmp_path / "curves" / "servo_case1.json"
    assert [(each["start"], each["stop"]) for each in found["disturbances"]] == [(10.0, 11.0)]
    levels = {level for each in found["panels"][1]["limits"] for level in each["y"]}
    assert levels == {0.002, -0.002}

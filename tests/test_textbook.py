"""The page on the textbook's motors: it shows what comes out, and python-control agrees."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from commands import Patch, Screen
from shown_output import BLOCK, follow

from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.units import number_in

pytestmark = pytest.mark.slow

PAGE = Path(__file__).parents[1] / "docs" / "textbook.md"
MOTORS = {
    "speed": {"J": 0.01, "b": 0.1, "K": 0.01, "R": 1.0, "L": 0.5},
    "position": {"J": 3.2284e-6, "b": 3.5077e-6, "K": 0.0274, "R": 4.0, "L": 2.75e-6},
}
GAINS = {"speed": (100.0, 200.0, 10.0), "position": (21.0, 500.0, 0.15)}
# Case, what is changed in it, and the page's row of what comes out: overshoot and settling.
ROWS: list[tuple[str, dict[str, str], str]] = [
    ("speed", {}, "as above, T = 1 ms | 0.0103 | 0.257 s"),
    ("speed", {"filter": "10 ms"}, '`filter = "10 ms"` | 0.0091 | 0.266 s'),
    (
        "speed",
        {"filter": "10 ms", "control_period": "10 ms"},
        '`filter = "10 ms"`, `control_period = "10 ms"` | 0.0093 | 0.264 s',
    ),
    ("speed", {"rate_setpoint_weight": "0"}, "`rate_setpoint_weight = 0` | 0.116 | 1.35 s"),
    ("position", {}, "as above, T = 0.1 ms | 0.123 | 0.0337 s"),
    ("position", {"control_period": "1 ms"}, '`control_period = "1 ms"` | 0.154 | 0.033 s'),
    ("position", {"rate_setpoint_weight": "0"}, "`rate_setpoint_weight = 0` | 0.16 | 0.0994 s"),
]


def files_of_page(folder: Path) -> None:
    """Write the files of the page into a folder."""
    for _, file, text in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        if file:
            with (folder / file).open("a", encoding="utf-8") as open_file:
                open_file.write(text)


def run_of(folder: Path, case: str, changes: dict[str, str]) -> RunResult:
    """Run a case of the page with other numbers."""
    files_of_page(folder)
    numbers: dict[str, Any] = {}
    for key, value in changes.items():
        place = "run" if key == "control_period" else "laws.pid"
        numbers[f"{place}.{key}"] = float(value) if value.isdigit() else value
    return Experiment.load(folder / f"{case}.toml").changed(numbers).run()


def plant_of(case: str) -> Any:
    """The motor from its voltage to its speed or its angle."""
    n = MOTORS[case]
    A = np.array([[-n["b"] / n["J"], n["K"] / n["J"]], [-n["K"] / n["L"], -n["R"] / n["L"]]])
    B = np.array([[0.0], [1 / n["L"]]])
    C = np.array([[1.0, 0.0]])
    if case == "position":
        A = np.block([[np.zeros((1, 1)), C], [np.zeros((2, 1)), A]])
        B = np.vstack([[0.0], B])
        C = np.array([[1.0, 0.0, 0.0]])
    return control.ss(A, B, C, 0)


def sampled_response(case: str, changes: dict[str, str], T: float, end: float) -> Array:
    """Step response of the sampled loop at its samples.

    u = kp e + ki T/(z - 1) e + kd (z - 1)/((Tf + T) z - Tf) (c r - y), and the plant under a hold.
    """
    kp, ki, kd = GAINS[case]
    Tf = number_in(changes.get("filter", "0 s"), "s")
    c = float(changes.get("rate_setpoint_weight", "1"))
    of_error: Any = control.tf([kp, ki * T - kp], [1, -1], T)
    of_rate: Any = control.tf([kd, -kd], [Tf + T, -Tf], T)

    plant: Any = control.sample_system(plant_of(case), T, "zoh")
    both: Any = control.ss(of_error + of_rate)
    loop: Any = control.feedback(plant, both)
    ahead: Any = control.ss(of_error + c * of_rate)
    time = np.arange(round(end / T) + 1) * T
    return control.step_response(loop * ahead, time).outputs


@pytest.mark.parametrize(("case", "changes", "row"), ROWS)
def test_a_run_is_the_sampled_loop_of_python_control(
    tmp_path: Path, case: str, changes: dict[str, str], row: str
) -> None:
    run = run_of(tmp_path, case, changes)
    trajectory = run.trajectory
    settings = run.case.settings
    T = settings.control_period
    expected = sampled_response(case, changes, T, float(trajectory.time[-1]))
    at_samples = trajectory.state[:: round(T / settings.timestep), 0]
    np.testing.assert_allclose(at_samples, expected, atol=2e-5)

    # The page has what the run has.
    words, overshoot, settles = row.split(" | ")
    assert run.metrics["overshoot"].value == pytest.approx(100 * float(overshoot), rel=0.01)
    assert run.metrics["settling_time"].value == pytest.approx(float(settles[:-2]), rel=0.01)
    assert f"| {words} | {overshoot} | {settles} |" in PAGE.read_text(encoding="utf-8")


def continuous_response(case: str, time: Array) -> Array:
    """Step response of the textbook's loop: no filter, no sampling."""
    kp, ki, kd = GAINS[case]
    s: Any = control.tf("s")
    plant: Any = control.tf(plant_of(case))
    law: Any = (kd * s**2 + kp * s + ki) / s
    loop: Any = control.feedback(law * plant, 1)
    return control.step_response(loop, time).outputs


@pytest.mark.parametrize("case", ["speed", "position"])
def test_shorter_periods_come_to_the_textbooks_response(tmp_path: Path, case: str) -> None:
    """The distance falls with the control period."""
    distances = []
    for period in ("1 ms", "0.2 ms"):
        changes = {"run.control_period": period, "run.duration": "0.1 s"}
        if case == "speed":
            changes["run.timestep"] = "0.2 ms"
        folder = tmp_path / period.replace(" ", "")
        folder.mkdir()
        files_of_page(folder)
        run = Experiment.load(folder / f"{case}.toml").changed(changes).run().trajectory
        # Both timesteps are a share of it.
        every = round(2e-4 / float(run.time[1]))
        time = run.time[::every]
        distances.append(np.abs(run.state[::every, 0] - continuous_response(case, time)).max())
    assert distances[1] < distances[0] / 3


def test_the_page_shows_what_comes_out(tmp_path: Path, monkeypatch: Patch, capsys: Screen) -> None:
    monkeypatch.chdir(tmp_path)
    follow(PAGE.read_text(encoding="utf-8"), PAGE.name, capsys)

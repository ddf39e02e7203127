"""Region maps: which starts converge, and that a map's cell is the run that it stands for."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import hear_interrupts
from scipy.ndimage import binary_dilation
from shipped import case_plant, find_case, nominal_controller

from grosmc_mj import cli, simulate
from grosmc_mj.errors import ArgumentError, UndefinedLawError
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.plants import CART_PENDULUM
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.studies import region
from grosmc_mj.studies.region import (
    Outcome,
    Region,
    RegionLoop,
    ascii_symbol,
    beside_another,
    choose_axes,
    confirmed_map,
    judge,
    outcomes,
    starts_on,
)
from grosmc_mj.sweep.runs import Outcomes

SETTINGS = Settings(integrator="implicitfast")
CONVERGED = Outcome.CONVERGED.letter


def loop(system: str, case: str, controller: str) -> RegionLoop:
    experiment = find_experiment(system, case).with_settings(integrator="implicitfast")
    return RegionLoop.of(experiment, controller)


def pendulum_starts(*pairs: tuple[float, float]) -> np.ndarray:
    """States with these angles [degrees] and rates [rad/s] of the pole."""
    starts = np.zeros((len(pairs), 4))
    starts[:, [1, 3]] = [(math.radians(angle), rate) for angle, rate in pairs]
    return starts


@pytest.mark.parametrize(
    ("status", "error", "outcome"),
    [
        (Status.COMPLETED, (0.009, -0.09), Outcome.CONVERGED),
        (Status.COMPLETED, (0.01, 0.1), Outcome.CONVERGED),
        (Status.COMPLETED, (0.0, 0.11), Outcome.NOT_CONVERGED),
        (Status.COMPLETED, (-0.011, 0.0), Outcome.NOT_CONVERGED),
        (Status.COMPLETED, (math.nan, 0.0), Outcome.NOT_CONVERGED),
        # A pole that swung right round.
        (Status.COMPLETED, (2 * math.pi, 0.0), Outcome.NOT_CONVERGED),
        (Status.UNDEFINED_LAW, (0.0, 0.0), Outcome.LEFT),
        (Status.SINGULAR_PLANT, (0.0, 0.0), Outcome.SINGULAR),
        (Status.DIVERGED, (0.0, 0.0), Outcome.DIVERGED),
    ],
)
def test_a_run_is_judged_by_its_end(
    status: Status, error: tuple[float, float], outcome: Outcome
) -> None:
    assert judge([status.name.lower()], np.array([error]), (0.01, 0.1)).tolist() == [outcome.letter]


@pytest.mark.parametrize("system", ["servo", "cart_pendulum", "arm"])
def test_the_starts_have_the_errors_that_the_axes_say(system: str) -> None:
    law = loop(system, "nominal", "lqr")
    axes = choose_axes(law, None, (57.0, 3.0))
    first, second = np.array([-0.5, 0.25]), np.array([2.0, -1.0])
    starts = starts_on(law, axes, first, second)
    np.testing.assert_allclose(law.errors(0.0, starts), np.stack([first, second], 1), atol=1e-12)


def test_the_errors_of_the_case_starts_are_the_chapters() -> None:
    servo, arm = loop("servo", "nominal", "lqr"), loop("arm", "nominal", "lqr")
    assert servo.equilibrium == pytest.approx([1.0, 0.0])
    assert arm.equilibrium == pytest.approx([0.0, math.pi])


def test_axes_can_be_any_two_states() -> None:
    axes = choose_axes(loop("cart_pendulum", "nominal", "lqr"), ("p", "theta"), (0.4, 45.0))
    assert [axis.signal.symbol for axis in axes] == ["p", "θ"]
    names = [ascii_symbol(state) for state in CART_PENDULUM.states]
    assert names == ["p", "theta", "p_dot", "theta_dot"]
    assert [axis.limit for axis in axes] == [0.4, pytest.approx(math.pi / 4)]
    assert [axis.is_error for axis in axes] == [False, True]


@pytest.mark.parametrize("controller", ["lqr", "fl-lqr", "grosmc"])
def test_a_cell_is_the_run_that_it_stands_for(controller: str) -> None:
    law, case = loop("cart_pendulum", "case1", controller), find_case("cart_pendulum", "case1")
    starts = pendulum_starts((-10, 0), (40, 8))
    batch = law.run(starts, 2.0)
    plain = nominal_controller("cart_pendulum", controller, "corrected")
    plant = case_plant(case, "physics", SETTINGS)
    single = simulate(plant, plain, starts[0], duration=2.0, control_period=1e-3)
    assert batch["status"].tolist() == ["completed", "undefined_law"]
    np.testing.assert_array_equal(batch["last"][0], single.state[-1])
    if controller == "lqr":
        # The Jacobian LQR goes on; its guard ends it at the first sample outside.
        run = simulate(plant, plain, starts[1], duration=2.0, control_period=1e-3)
        left = run.time[np.argmax(np.abs(run.state[:, 1]) >= math.pi / 2)]
    else:
        with pytest.raises(UndefinedLawError) as error:
            simulate(plant, plain, starts[1], duration=2.0, control_period=1e-3)
        left = error.value.time
    assert left == batch["ended"][1]


def test_fl_lqr_converges_if_its_optimal_trajectory_stays_in_the_region() -> None:
    law = loop("cart_pendulum", "nominal", "fl-lqr")
    angles, rates = np.meshgrid(np.linspace(-80, 80, 9), np.linspace(-9, 9, 9))
    pairs = list(zip(angles.ravel().tolist(), rates.ravel().tolist(), strict=True))
    starts = pendulum_starts(*pairs)
    design = law.controller.designed.lqr
    instants = np.arange(0, 6, 0.002)
    peaks = [np.abs(design.optimal_trajectory(x[[1, 3]], instants)[:, 0]).max() for x in starts]
    # Feedback linearization makes the optimum exact but for the hold between two samples.
    clear = np.abs(np.array(peaks) - math.pi / 2) > 0.02
    stays = np.array(peaks) < math.pi / 2
    assert stays[clear].any()
    assert not stays[clear].all()
    converged = outcomes(law, starts, 6.0) == CONVERGED
    np.testing.assert_array_equal(converged[clear], stays[clear])


@pytest.mark.slow
def test_grosmc_converges_wherever_fl_lqr_does_and_keeps_more_of_it() -> None:
    maps = {
        (each.case.name, each.controller): each.grid == CONVERGED
        for each in Region("cart_pendulum", points=8, duration=12.0).maps()
    }
    nominal, edited = maps["nominal", "grosmc"], maps["case1", "grosmc"]
    assert np.all(nominal >= maps["nominal", "fl-lqr"])
    assert edited.sum() > 2 * maps["case1", "fl-lqr"].sum()
    # The pendulum has no left and no right.
    for grid in maps.values():
        np.testing.assert_array_equal(grid, grid[::-1, ::-1])


@pytest.mark.slow
def test_looking_early_changes_no_outcome() -> None:
    angles, rates = np.meshgrid(np.linspace(-80, 80, 6), np.linspace(-6, 6, 6))
    starts = pendulum_starts(*zip(angles.ravel().tolist(), rates.ravel().tolist(), strict=True))
    for controller in ("lqr", "fl-lqr", "grosmc"):
        law = loop("cart_pendulum", "case1", controller)
        np.testing.assert_array_equal(
            outcomes(law, starts, 9.0), outcomes(law, starts, 9.0, looks=(1.0,))
        )


def test_a_start_near_zero_that_drifts_away_is_not_called_converged_early() -> None:
    law = loop("cart_pendulum", "nominal", "fl-lqr")
    # Without feedback the linearized pole is a double integrator: it drifts at its first rate,
    # still near zero at the first look and beyond the tolerance at the end.
    idle = replace(law.controller.parameters, K=np.zeros((1, 2)))
    drifting = replace(law, controller=replace(law.controller, parameters=idle))
    starts = pendulum_starts((0.0, 0.002))
    assert outcomes(drifting, starts, 12.0).tolist() == [Outcome.NOT_CONVERGED.letter]
    assert outcomes(drifting, starts, 1.0).tolist() == [CONVERGED]


@pytest.mark.parametrize(("part", "looked"), [(0.2, 1), (0.3, 3)])
def test_a_start_has_converged_early_within_a_quarter_of_its_tolerances(
    part: float, looked: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks: list[float] = []

    def still(self: RegionLoop, starts: np.ndarray, duration: float) -> Outcomes:
        looks.append(duration)
        bounds = [bound for bound, _ in self.tolerances.values()]
        ends = (self.equilibrium + part * np.array(bounds))[None]
        return Outcomes((), {"last": ends, "status": np.array(["completed"])})

    monkeypatch.setattr(RegionLoop, "run", still)
    assert outcomes(loop("servo", "nominal", "lqr"), np.zeros((1, 2)), 16.0).tolist() == [CONVERGED]
    assert looks == [1.0, 4.0, 16.0][:looked]


def test_under_a_disturbance_no_start_is_called_converged_before_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Runs that come to rest at once and are carried away in the last part, and one that is not."""
    starts = np.array([[0.5, 0.0], [0.2, 0.1], [0.9, 0.0]])
    looked: list[float] = []

    def made_up(self: RegionLoop, found: np.ndarray, duration: float) -> Outcomes:
        looked.append(duration)
        ends = np.zeros((len(found), 2)) + self.equilibrium
        ends[(found[:, 0] < 0.6) & (duration > 9.0), 0] += 0.3
        return Outcomes((), {"last": ends, "status": np.full(len(found), "completed")})

    monkeypatch.setattr(RegionLoop, "run", made_up)
    found = {}
    for case in ("nominal", "case1"):
        found[case] = "".join(outcomes(loop("servo", case, "lqr"), starts, 10.0).tolist())
    assert found == {"nominal": "ccc", "case1": "nnc"}
    assert looked == [10 / 16, 10 / 16, 2.5, 10.0]


def test_a_map_has_the_second_axis_down_and_the_first_across(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By starts that converge where the angle is positive and more than the rate."""

    def made_up(loop: RegionLoop, starts: np.ndarray, duration: float) -> np.ndarray:
        angle, rate = starts[:, 1], starts[:, 3]
        return np.where((angle > 0) & (angle > rate), "c", "d")

    monkeypatch.setattr(region, "outcomes", made_up)
    monkeypatch.setattr(region, "BATCH", 8)
    limits = (math.degrees(1.5), 4.5)
    advances: list[str] = []
    asked = Region("cart_pendulum", points=3, limits=limits, controllers=("lqr",))
    (first, *rest) = asked.maps(advances.append)
    # Angles -1, 0 and 1; rates -3, 0 and 3 from above.
    assert first.grid.tolist() == [["d", "d", "c"], ["d", "d", "c"], ["d", "d", "d"]]
    assert (first.counts[Outcome.CONVERGED], first.counts[Outcome.DIVERGED]) == (2, 7)
    assert first.converged == pytest.approx(100 * 2 / 9)
    assert len(advances) == asked.batches == 2 * (1 + len(rest))


def confirmed_by(truth: np.ndarray, first: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """The map that is confirmed by the truth, which starts were, and how many that is."""
    confirmed = np.zeros(first.shape, bool)

    def confirm(chosen: np.ndarray) -> np.ndarray:
        assert not np.any(confirmed & chosen)
        confirmed[chosen] = True
        return truth[chosen]

    letters, count = confirmed_map(first, confirm)
    return letters, confirmed, count


def test_boundaries_that_equations_misplace_are_those_of_mujoco() -> None:
    """Discs whose radii differ by three cells: what is beside an overturned start is looked at."""
    x, y = np.meshgrid(np.arange(40), np.arange(40))
    distance = np.hypot(x - 20, y - 20)
    first, truth = (np.where(distance < radius, "c", "l") for radius in (12, 9))
    letters, confirmed, count = confirmed_by(truth, first)
    np.testing.assert_array_equal(letters, truth)
    assert np.all(confirmed[beside_another(truth)])
    assert count == confirmed.sum() < 0.6 * truth.size
    alike = np.full((1, 50), "c")
    assert confirmed_by(alike, alike)[2] == 1


def test_neighbours_of_an_overturned_start_are_all_confirmed() -> None:
    """And what MuJoCo was not asked about is as the equations have it, in any two maps."""
    random = np.random.default_rng(0)
    for _ in range(20):
        first = np.where(random.random((12, 12)) < 0.1, "l", "c")
        truth = np.where(random.random((12, 12)) < 0.05, "d", first)
        letters, confirmed, _ = confirmed_by(truth, first)
        np.testing.assert_array_equal(letters, np.where(confirmed, truth, first))
        assert (letters != first).any()
        beside = np.asarray(binary_dilation(letters != first, np.ones((3, 3))), bool)
        assert confirmed[beside].all()


@pytest.mark.slow
def test_a_screened_map_is_that_of_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equations take steps of RK4, and so does MuJoCo here: no start is judged otherwise."""
    monkeypatch.setattr(region, "INTEGRATOR", "RK4")
    asked = {"points": 16, "duration": 3.0, "controllers": ("fl-lqr",)}
    screened = list(Region("cart_pendulum", **asked).maps())
    monkeypatch.setattr(region, "model_mismatch", lambda _: "all of it")
    for ours, theirs in zip(screened, Region("cart_pendulum", **asked).maps(), strict=True):
        np.testing.assert_array_equal(ours.grid, theirs.grid)
        assert (ours.overturned, theirs.overturned) == (0, 0)
        assert 0 < ours.confirmed < theirs.confirmed == 16 * 16


def test_the_arm_ends_at_its_singularity() -> None:
    law = loop("arm", "nominal", "grosmc")
    starts = law.equilibrium + np.array([[0.5, 0.0], [1.5, 5.0]])
    found = outcomes(law, starts, 6.0).tolist()
    assert found == [CONVERGED, Outcome.SINGULAR.letter]


@pytest.mark.slow
def test_the_servo_converges_from_everywhere() -> None:
    for each in Region("servo", points=4).maps():
        assert set(each.grid.ravel()) == {CONVERGED}


@pytest.mark.parametrize(
    ("target", "options", "says"),
    [
        ("cart_pendulum", {"points": 1}, "points = 1 must be a whole number from 2 to 1000"),
        ("cart_pendulum", {"duration": math.nan}, "duration = nan must be above 0 to 1000 s"),
        ("arm", {"limits": (math.nan, 1.0)}, "limits.0 = nan must be finite and positive"),
        ("cart_pendulum/case9", {}, "unknown case 'cart_pendulum/case9'"),
        ("cart_pendulum/nominal", {}, "take case1"),
        ("cart_pendulum/case2", {"duration": 8.0}, "disturbed from 9 s on"),
        ("arm", {"axes": ("q", "q")}, "two different states of arm: q, q_dot"),
        ("arm", {"axes": ("q", "p")}, "unknown state of arm 'p': valid: q, q_dot"),
        ("arm", {"limits": (115.0, 10.0)}, "lie outside q < pi/2"),
        ("cart_pendulum", {"limits": (115.0, 10.0)}, "lie outside |theta| < pi/2"),
        ("arm/machine", {"limits": (89.0, 10.0)}, "beyond its stops at -1.5 and 1.5 rad"),
    ],
)
def test_a_question_without_sense_is_refused(
    target: str, options: dict[str, Any], says: str
) -> None:
    with pytest.raises(ArgumentError) as error:
        Region(target, **options)
    assert says in str(error.value)


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as stop:
        cli.main(arguments)
    assert isinstance(stop.value.code, int)
    return stop.value.code


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "SYSTEM"),
        (("leg",), "unknown case 'leg': valid: arm, ball_beam, cart_pendulum"),
        (("arm", "--points", "2.5"), "--points"),
        (("arm", "--limits", "5", "inf"), "limits.1 = inf must be finite and positive"),
        (("arm", "--axes", "q"), "--axes"),
        (
            ("arm", "--points", "2", "--out", "/dev/null/x"),
            "/dev/null/x",
        ),
    ],
)
def test_wrong_use_gets_one_line_and_exit_code_2(
    arguments: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("study", "region", *arguments) == cli.WRONG
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


@pytest.mark.slow
def test_the_command_writes_figure_and_grids(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        run("study", "region", "arm", "--points", "5", "--duration", "6", "--out", str(tmp_path))
        == 0
    )
    names = {f"region_arm.{suffix}" for suffix in ("json", "png", "svg")}
    assert {path.name for path in tmp_path.iterdir()} == names
    document = json.loads((tmp_path / "region_arm.json").read_text(encoding="utf-8"))
    assert document["schema_version"] == 2
    assert [axis["state"] for axis in document["configuration"]["axes"]] == ["q", "q_dot"]
    maps = {(each["case"], each["controller"]): each for each in document["maps"]}
    assert set(maps) == {(c, law) for c in ("nominal", "case2") for law in ("lqr", "grosmc")}
    for each in maps.values():
        assert [len(row) for row in each["grid"]] == [5] * 5
        assert sum(each["counts"].values()) == 25
        assert "".join(each["grid"]).count("c") == each["counts"]["converged"]
    # GROSMC holds what LQR loses altogether with twice the payload.
    assert maps["case2", "grosmc"]["counts"]["converged"] > 0
    assert maps["case2", "lqr"]["counts"]["converged"] == 0
    assert "lqr on case2 converges from the fewest starts: 0.0 % of 25." in capsys.readouterr().out


@pytest.mark.slow
def test_an_interrupted_command_leaves_the_old_files_and_nothing_else(tmp_path: Path) -> None:
    old = tmp_path / "region_cart_pendulum.json"
    old.write_text("old", encoding="utf-8")
    command = [sys.executable, "-m", "grosmc_mj.cli", "study", "region", "cart_pendulum"]
    with subprocess.Popen(
        [*command, "--out", str(tmp_path)],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ,
        preexec_fn=hear_interrupts,
    ) as process:
        deadline = time.monotonic() + 60
        while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < deadline:
            time.sleep(0.1)
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == cli.INTERRUPTED
    assert "interrupted" in said
    assert [path.name for path in tmp_path.iterdir()] == [old.name]
    assert old.read_text(encoding="utf-8") == "old"

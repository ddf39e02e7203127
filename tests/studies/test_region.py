"""Region maps: which starts converge, and that a map's cell is the run that it stands for."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import assert_one_line, run
from scipy.ndimage import binary_dilation
from shipped import case_plant, find_case, nominal_controller

from grosmc_mj import cli, simulate
from grosmc_mj.errors import UndefinedLawError
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.plants import CART_PENDULUM
from grosmc_mj.studies import region
from grosmc_mj.studies.region import Outcome, Region, RegionLoop, choose_axes, outcomes
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


def test_a_run_is_judged_by_its_end() -> None:
    ends = [
        ("completed", (0.01, -0.1), Outcome.CONVERGED),
        ("completed", (0.0, 0.11), Outcome.NOT_CONVERGED),
        ("completed", (-0.011, 0.0), Outcome.NOT_CONVERGED),
        ("completed", (math.nan, 0.0), Outcome.NOT_CONVERGED),
        # A pole that swung right round.
        ("completed", (2 * math.pi, 0.0), Outcome.NOT_CONVERGED),
        ("undefined_law", (0.0, 0.0), Outcome.LEFT),
        ("singular_plant", (0.0, 0.0), Outcome.SINGULAR),
        ("diverged", (0.0, 0.0), Outcome.DIVERGED),
    ]
    statuses, errors, expected = zip(*ends, strict=True)
    letters = region.judge(statuses, np.array(errors), (0.01, 0.1))
    assert letters.tolist() == [outcome.letter for outcome in expected]


def test_starts_are_laid_out_by_the_errors_on_their_axes() -> None:
    first, second = np.array([-0.5, 0.25]), np.array([2.0, -1.0])
    for system, equilibrium in (
        ("servo", [1.0, 0.0]), ("cart_pendulum", [0.0] * 4), ("arm", [0.0, math.pi]),
    ):  # fmt: skip
        law = loop(system, "nominal", "lqr")
        axes = choose_axes(law, None, (57.0, 3.0))
        starts = region.starts_on(law, axes, first, second)
        np.testing.assert_allclose(
            law.errors(0.0, starts), np.stack([first, second], 1), atol=1e-12
        )
        assert law.equilibrium == pytest.approx(equilibrium)
    axes = choose_axes(loop("cart_pendulum", "nominal", "lqr"), ("p", "theta"), (0.4, 45.0))
    assert [axis.signal.symbol for axis in axes] == ["p", "θ"]
    assert [axis.limit for axis in axes] == [0.4, pytest.approx(math.pi / 4)]
    assert [axis.is_error for axis in axes] == [False, True]
    names = [region.ascii_symbol(state) for state in CART_PENDULUM.states]
    assert names == ["p", "theta", "p_dot", "theta_dot"]


@pytest.mark.parametrize("controller", ["lqr", "fl-lqr", "grosmc"])
def test_a_cell_is_the_run_that_it_stands_for(controller: str) -> None:
    law, starts = loop("cart_pendulum", "case1", controller), pendulum_starts((-10, 0), (40, 8))
    batch = law.run(starts, 2.0)
    plain = nominal_controller("cart_pendulum", controller, "corrected")
    plant = case_plant(find_case("cart_pendulum", "case1"), "physics", SETTINGS)
    single = simulate(plant, plain, starts[0], duration=2.0, control_period=1e-3)
    assert batch["status"].tolist() == ["completed", "undefined_law"]
    np.testing.assert_array_equal(batch["last"][0], single.state[-1])
    if controller == "lqr":
        # The Jacobian LQR goes on; its guard ends it at the first sample outside.
        beyond = simulate(plant, plain, starts[1], duration=2.0, control_period=1e-3)
        left = beyond.time[np.argmax(np.abs(beyond.state[:, 1]) >= math.pi / 2)]
    else:
        with pytest.raises(UndefinedLawError) as error:
            simulate(plant, plain, starts[1], duration=2.0, control_period=1e-3)
        left = error.value.time
    assert left == batch["ended"][1]


def test_fl_lqr_converges_if_its_optimal_trajectory_stays_in_the_region() -> None:
    law = loop("cart_pendulum", "nominal", "fl-lqr")
    starts = pendulum_starts(*itertools.product(np.linspace(-80, 80, 9), np.linspace(-9, 9, 9)))
    design, instants = law.controller.designed.lqr, np.arange(0, 6, 0.002)
    peaks = [np.abs(design.optimal_trajectory(x[[1, 3]], instants)[:, 0]).max() for x in starts]
    # Feedback linearization makes the optimum exact but for the hold between two samples.
    clear = np.abs(np.array(peaks) - math.pi / 2) > 0.02
    stays = np.array(peaks)[clear] < math.pi / 2
    assert 0 < stays.sum() < len(stays)
    np.testing.assert_array_equal(outcomes(law, starts[clear], 6.0) == CONVERGED, stays)
    # The arm ends at its singularity.
    law = loop("arm", "nominal", "grosmc")
    starts = law.equilibrium + np.array([[0.5, 0.0], [1.5, 5.0]])
    assert outcomes(law, starts, 6.0).tolist() == [CONVERGED, Outcome.SINGULAR.letter]


# Looks before the end.


@pytest.mark.slow
def test_looking_early_changes_no_outcome() -> None:
    starts = pendulum_starts(*itertools.product(np.linspace(-80, 80, 6), np.linspace(-6, 6, 6)))
    for controller in ("lqr", "fl-lqr", "grosmc"):
        law = loop("cart_pendulum", "case1", controller)
        once = outcomes(law, starts, 9.0, looks=(1.0,))
        np.testing.assert_array_equal(outcomes(law, starts, 9.0), once)


def test_a_start_near_zero_that_drifts_away_is_not_called_converged_early() -> None:
    law = loop("cart_pendulum", "nominal", "fl-lqr")
    # Without feedback the linearized pole is a double integrator: it drifts at its first rate,
    # still near zero at the first look and beyond the tolerance at the end.
    idle = replace(law.controller.parameters, K=np.zeros((1, 2)))
    drifting = replace(law, controller=replace(law.controller, parameters=idle))
    starts = pendulum_starts((0.0, 0.002))
    assert outcomes(drifting, starts, 12.0).tolist() == [Outcome.NOT_CONVERGED.letter]
    assert outcomes(drifting, starts, 1.0).tolist() == [CONVERGED]


def test_a_start_has_converged_early_within_a_quarter_of_its_tolerances_unless_disturbed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looks: list[float] = []

    def moved(self: RegionLoop, starts: np.ndarray, duration: float) -> Outcomes:
        """To the share of the tolerances that is the start's rate; at last some are away."""
        looks.append(duration)
        bounds = np.array([bound for bound, _ in self.tolerances.values()])
        ends = self.equilibrium + starts[:, 1:] * bounds
        ends[(starts[:, 0] < 0.6) & (duration > 9.0), 0] += 0.3
        return Outcomes((), {"last": ends, "status": np.full(len(ends), "completed")})

    monkeypatch.setattr(RegionLoop, "run", moved)
    for case, start, letter, looked in (
        ("nominal", [0.9, 0.2], "c", 1), ("nominal", [0.9, 0.3], "c", 3),
        ("nominal", [0.2, 0.1], "c", 1), ("nominal", [0.2, 0.3], "n", 3),
        ("case1", [0.9, 0.1], "c", 3), ("case1", [0.2, 0.1], "n", 3),
    ):  # fmt: skip
        looks.clear()
        assert outcomes(loop("servo", case, "lqr"), np.array([start]), 16.0).tolist() == [letter]
        assert looks == [1.0, 4.0, 16.0][:looked]


# Maps.


def test_a_map_has_the_second_axis_down_and_the_first_across(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By starts that converge where the angle is positive and more than the rate."""

    def made_up(loop: RegionLoop, starts: np.ndarray, duration: float) -> np.ndarray:
        angle, rate = starts[:, 1], starts[:, 3]
        return np.where((angle > 0) & (angle > rate), "c", "d")

    monkeypatch.setattr(region, "outcomes", made_up)
    monkeypatch.setattr(region, "BATCH", 8)
    advances: list[str] = []
    limits = (math.degrees(1.5), 4.5)
    study = Region("cart_pendulum", points=3, limits=limits, controllers=("lqr",))
    (first, *rest) = study.maps(advances.append)
    # Angles -1, 0 and 1; rates -3, 0 and 3 from above.
    assert first.rows == ["ddc", "ddc", "ddd"]
    assert (first.counts[Outcome.CONVERGED], first.counts[Outcome.DIVERGED]) == (2, 7)
    assert first.converged == pytest.approx(100 * 2 / 9)
    assert len(advances) == study.batches == 2 * (1 + len(rest))


def test_neighbours_of_an_overturned_start_are_all_confirmed() -> None:
    """And starts that MuJoCo did not run are as the equations have it, in any two maps."""
    random, (x, y) = np.random.default_rng(0), np.meshgrid(np.arange(40), np.arange(40))
    # Discs whose radii differ by three cells, maps at random, a map of one outcome.
    discs = [np.where(np.hypot(x - 20, y - 20) < radius, "c", "l") for radius in (12, 9)]
    pairs = [discs, [np.full((1, 50), "c")] * 2]
    for _ in range(20):
        first = np.where(random.random((12, 12)) < 0.1, "l", "c")
        pairs.append([first, np.where(random.random((12, 12)) < 0.05, "d", first)])
    counts = []
    for first, truth in pairs:
        confirmed = np.zeros(first.shape, bool)

        def confirm(chosen: Any, truth: Any = truth, confirmed: Any = confirmed) -> Any:
            assert not np.any(confirmed & chosen)
            confirmed[chosen] = True
            return truth[chosen]

        letters, count = region.confirmed_map(first, confirm)
        np.testing.assert_array_equal(letters, np.where(confirmed, truth, first))
        beside = np.asarray(binary_dilation(letters != first, np.ones((3, 3))), bool)
        assert confirmed[beside].all()
        assert count == confirmed.sum()
        counts.append((count, (letters == truth).all()))
    assert counts[0][0] < 0.6 * discs[0].size
    assert counts[0][1]
    assert counts[1][0] == 1


@pytest.mark.slow
def test_a_screened_map_is_that_of_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equations take steps of RK4, and so does MuJoCo here: no start is judged otherwise."""
    monkeypatch.setattr(region, "INTEGRATOR", "RK4")
    options: Any = {"points": 10, "duration": 3.0, "controllers": ("fl-lqr",)}
    screened = list(Region("cart_pendulum", **options).maps())
    monkeypatch.setattr(region, "model_mismatch", lambda _: "all of it")
    for ours, theirs in zip(screened, Region("cart_pendulum", **options).maps(), strict=True):
        np.testing.assert_array_equal(ours.grid, theirs.grid)
        assert (ours.overturned, theirs.overturned) == (0, 0)
        assert 0 < ours.confirmed < theirs.confirmed == 10 * 10


# The command.


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("cart_pendulum --points 1", "points = 1 must be a whole number from 2 to 1000"),
        ("cart_pendulum --duration nan", "duration = nan must be above 0 to 1000 s"),
        ("arm --limits 5 inf", "limits.1 = inf must be finite and positive"),
        ("arm --axes q", "--axes q: give two, X and Y"),
        ("cart_pendulum/nominal", "take case1"),
        ("cart_pendulum/case2 --duration 8", "disturbed from 9 s on"),
        ("arm --axes q q", "two different states of arm: q, q_dot"),
        ("arm --axes q p", "unknown state of arm 'p': valid: q, q_dot"),
        ("arm --limits 115 10", "lie outside q < pi/2"),
        ("cart_pendulum --limits 115 10", "lie outside |theta| < pi/2"),
        ("arm/machine --limits 89 10", "beyond its stops at -1.5 and 1.5 rad"),
        ("arm --points 2 --out /dev/null/x", "/dev/null/x"),
    ],
)
def test_a_question_without_sense_is_one_line(
    arguments: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("study", "region", *arguments.split()) == cli.WRONG
    error = capsys.readouterr().err
    assert words in error
    assert_one_line(error)


@pytest.mark.slow
def test_the_command_writes_figure_and_grids(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ("--points", "5", "--duration", "6", "--out", tmp_path)
    assert run("study", "region", "arm", *options) == cli.DONE
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert sorted(before) == ["region_arm.json", "region_arm.png", "region_arm.svg"]
    document = json.loads(before["region_arm.json"])
    maps = {(law_map["case"], law_map["controller"]): law_map for law_map in document["maps"]}
    assert set(maps) == set(itertools.product(("nominal", "case2"), ("lqr", "grosmc")))
    for law_map in maps.values():
        assert [len(row) for row in law_map["grid"]] == [5] * 5
        assert "".join(law_map["grid"]).count("c") == law_map["counts"]["converged"]
    # GROSMC holds starts that LQR loses altogether with twice the payload.
    assert maps["case2", "grosmc"]["counts"]["converged"] > 0
    assert maps["case2", "lqr"]["counts"]["converged"] == 0

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(region, "outcomes", interrupted)
    assert run("study", "region", "arm", *options) == cli.INTERRUPTED
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("finished", [0, 1])
def test_an_interrupt_keeps_the_finished_maps(
    finished: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    maps = Region.maps

    def interrupted(study: Region, *arguments: Any) -> Any:
        yield from itertools.islice(maps(study, *arguments), finished)
        raise KeyboardInterrupt

    monkeypatch.setattr(Region, "maps", interrupted)
    options = ("--points", "2", "--duration", "0.1", "--out", tmp_path)
    assert run("study", "region", "servo", *options) == cli.INTERRUPTED
    assert len(list(tmp_path.iterdir())) == 3 * finished
    if finished:
        document = json.loads((tmp_path / "region_servo.json").read_text(encoding="utf-8"))
        assert (document["complete"], len(document["maps"])) == (False, 1)
        assert document["answers"][0]["verdict"] == "not decided"

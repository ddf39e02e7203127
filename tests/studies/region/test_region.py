"""Region maps: which starts converge, and that a map's cell is the run that it stands for."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cases
import numpy as np
import pytest
from scipy.ndimage import binary_dilation
from shipped import case_plant, find_case, nominal_controller

from grosmc_mj import simulate
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.errors import UndefinedLawError
from grosmc_mj.studies.region import region
from grosmc_mj.studies.region.axes import ascii_symbol, choose_axes
from grosmc_mj.studies.region.region import RegionMap, RegionStudy
from grosmc_mj.studies.region.runs import Outcome, RegionLoop, judge, outcomes
from grosmc_mj.studies.sweep.runs import Outcomes
from grosmc_mj.theory.plants import CART_PENDULUM

SETTINGS = Settings(integrator="implicitfast")
CONVERGED = Outcome.CONVERGED.letter


def loop(system: str, case: str, controller: str) -> RegionLoop:
    experiment = find_experiment(system, case).changed(integrator="implicitfast")
    return RegionLoop.of(experiment, controller)


def pendulum_starts(*pairs: tuple[float, float]) -> np.ndarray:
    """States with these angles [degrees] and rates [rad/s] of the pole."""
    starts = np.zeros((len(pairs), 4))
    starts[:, [1, 3]] = [(math.radians(angle), rate) for angle, rate in pairs]
    return starts


def grid(count: int, angle: float, rate: float) -> np.ndarray:
    """States on a grid of angles [degrees] and rates [rad/s] of the pole."""
    angles = np.linspace(-angle, angle, count)
    return pendulum_starts(*itertools.product(angles, np.linspace(-rate, rate, count)))


# Axes.


@pytest.mark.parametrize(
    ("system", "equilibrium"),
    [
        ("servo", [1.0, 0.0]),
        ("cart_pendulum", [0.0, 0.0, 0.0, 0.0]),
        ("arm", [0.0, math.pi]),
    ],
)
def test_starts_are_laid_out_by_the_errors_on_their_axes(
    system: str, equilibrium: list[float]
) -> None:
    first = np.array([-0.5, 0.25])
    second = np.array([2.0, -1.0])
    law = loop(system, "nominal", "lqr")
    axes = choose_axes(law, None, (57.0, 3.0))
    errors = law.errors(0.0, region.starts_on(law, axes, first, second))
    np.testing.assert_allclose(errors, np.stack([first, second], 1), atol=1e-12)
    assert law.equilibrium == pytest.approx(equilibrium)


def test_axes_are_states_by_their_symbols_in_ascii() -> None:
    symbols = [ascii_symbol(state) for state in CART_PENDULUM.states]
    assert symbols == ["p", "theta", "p_dot", "theta_dot"]
    axes = choose_axes(loop("cart_pendulum", "nominal", "lqr"), ("p", "theta"), (0.4, 45.0))
    assert [axis.signal.symbol for axis in axes] == ["p", "θ"]
    assert [axis.limit for axis in axes] == [0.4, pytest.approx(math.pi / 4)]
    assert [axis.is_error for axis in axes] == [False, True]


# Runs and their ends.


@pytest.mark.parametrize(
    ("status", "errors", "outcome"),
    [
        ("completed", (0.01, -0.1), Outcome.CONVERGED),
        ("completed", (0.0, 0.11), Outcome.NOT_CONVERGED),
        ("completed", (-0.011, 0.0), Outcome.NOT_CONVERGED),
        ("completed", (math.nan, 0.0), Outcome.NOT_CONVERGED),
        # A pole that swung right round.
        ("completed", (2 * math.pi, 0.0), Outcome.NOT_CONVERGED),
        ("undefined_law", (0.0, 0.0), Outcome.LEFT),
        ("singular_plant", (0.0, 0.0), Outcome.SINGULAR),
        ("diverged", (0.0, 0.0), Outcome.DIVERGED),
    ],
)
def test_a_run_is_judged_by_its_end(
    status: str, errors: tuple[float, float], outcome: Outcome
) -> None:
    """Beside a run that converges, so that each is judged by itself."""
    ends = np.array([(0.0, 0.0), errors])
    letters = judge(["completed", status], ends, (0.01, 0.1))
    assert letters.tolist() == [CONVERGED, outcome.letter]


@pytest.mark.parametrize("controller", ["lqr", "fl-lqr", "grosmc"])
def test_a_cell_is_the_run_that_it_stands_for(controller: str) -> None:
    law = loop("cart_pendulum", "case1", controller)
    starts = pendulum_starts((-10, 0), (40, 8))
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
    starts = grid(7, angle=80, rate=9)
    design = law.controller.designed.lqr
    instants = np.arange(0, 3, 0.002)
    optima = [design.optimal_trajectory(x[[1, 3]], instants) for x in starts]
    peaks = np.array([np.abs(optimum[:, 0]).max() for optimum in optima])

    # Feedback linearization makes the optimum exact but for the hold between two samples.
    clear = np.abs(peaks - math.pi / 2) > 0.02
    stays = peaks[clear] < math.pi / 2
    assert 0 < stays.sum() < len(stays)
    np.testing.assert_array_equal(outcomes(law, starts[clear], 6.0) == CONVERGED, stays)


def test_the_arm_ends_at_its_singularity() -> None:
    law = loop("arm", "nominal", "grosmc")
    starts = law.equilibrium + np.array([[0.5, 0.0], [1.5, 5.0]])
    assert outcomes(law, starts, 6.0).tolist() == [CONVERGED, Outcome.SINGULAR.letter]


# Looks before the end.


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["lqr", "fl-lqr", "grosmc"])
def test_looking_early_changes_no_outcome(controller: str) -> None:
    starts = grid(6, angle=80, rate=6)
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


@pytest.mark.parametrize(
    ("case", "start", "letter", "looks"),
    [
        ("nominal", [0.9, 0.2], "c", [1.0]),
        ("nominal", [0.9, 0.3], "c", [1.0, 4.0, 16.0]),
        ("nominal", [0.2, 0.1], "c", [1.0]),
        ("nominal", [0.2, 0.3], "n", [1.0, 4.0, 16.0]),
        ("case1", [0.9, 0.1], "c", [1.0, 4.0, 16.0]),
        ("case1", [0.2, 0.1], "n", [1.0, 4.0, 16.0]),
    ],
)
def test_a_start_has_converged_early_within_a_quarter_of_its_tolerances_unless_disturbed(
    case: str,
    start: list[float],
    letter: str,
    looks: list[float],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    durations: list[float] = []

    def moved(self: RegionLoop, starts: np.ndarray, duration: float) -> Outcomes:
        """End at the start's second number, a share of the tolerances.

        Where the first number is below 0.6 the loop leaves them again after 9 s.
        """
        durations.append(duration)
        bounds = np.array([bound for bound, _ in self.tolerances.values()])
        ends = self.equilibrium + starts[:, 1:] * bounds
        ends[(starts[:, 0] < 0.6) & (duration > 9.0), 0] += 0.3
        return Outcomes((), {"last": ends, "status": np.full(len(ends), "completed")})

    monkeypatch.setattr(RegionLoop, "run", moved)
    letters = outcomes(loop("servo", case, "lqr"), np.array([start]), 16.0)
    assert letters.tolist() == [letter]
    assert durations == looks


# Maps.


def maps_of(
    study: RegionStudy, advance: Callable[[str], object] = lambda _: None
) -> list[RegionMap]:
    """The maps of a study."""
    return [cell.measure(advance) for cell in study.cells()]


def angle_exceeds_rate(loop: RegionLoop, starts: np.ndarray, duration: float) -> np.ndarray:
    """Made-up outcomes: convergence where the angle is positive and more than the rate."""
    angle = starts[:, 1]
    rate = starts[:, 3]
    return np.where((angle > 0) & (angle > rate), "c", "d")


def test_rows_of_a_map_descend_the_second_axis(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rates 3, 0 and -3; angles -1, 0 and 1 go across; of nine starts eight are a batch."""
    monkeypatch.setattr(region, "outcomes", angle_exceeds_rate)
    monkeypatch.setattr(region, "BATCH", 8)
    limits = (math.degrees(1.5), 4.5)
    study = RegionStudy("cart_pendulum", points=3, limits=limits, controllers=("lqr",))
    advances: list[str] = []
    maps = maps_of(study, advances.append)
    assert maps[0].rows == ["ddc", "ddc", "ddd"]
    assert (maps[0].counts[Outcome.CONVERGED], maps[0].counts[Outcome.DIVERGED]) == (2, 7)
    assert maps[0].converged == pytest.approx(100 * 2 / 9)
    assert len(advances) == 2 * len(maps)
    assert advances[0] == "nominal/lqr: 8 of 9 starts"


def converges_in_its_draw(loop: RegionLoop, starts: np.ndarray, duration: float) -> np.ndarray:
    """Made-up outcomes: each draw loses one more of the starts with the least angles."""
    angle = starts[:, 1]
    return np.where(angle > -0.8 + 0.25 * loop.draw, "c", "d")


@pytest.mark.parametrize(("draws", "row"), [(1, "dcccccccc"), (4, "dvvvccccc")])
def test_a_start_that_some_draws_lose_is_not_converged(
    draws: int, row: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Angles are -0.931, -0.698, -0.465, -0.233, 0 rad ...: draws 1 to 3 lose one more each."""
    monkeypatch.setattr(region, "outcomes", converges_in_its_draw)
    heavier_behind_an_encoder = cases.write(
        tmp_path,
        "cart_pendulum",
        edit={"body": "pole", "mass": "2 kg"},
        sensor={"of": "pole angle", "resolution": "1 deg"},
    )
    target = str(heavier_behind_an_encoder)
    study = RegionStudy(target, points=9, limits=(60.0, 1.0), controllers=("lqr",), draws=draws)
    drawn = maps_of(study)[-1]
    assert drawn.rows == 9 * [row]
    assert drawn.counts[Outcome.VARIES] == 9 * row.count("v")
    assert (drawn.over_draws is None) == (draws == 1)


# Starts that MuJoCo confirms.


class Physics:
    """Outcomes in MuJoCo of a made-up map, each asked for once."""

    def __init__(self, truth: np.ndarray) -> None:
        self.truth = truth
        self.confirmed = np.zeros(truth.shape, bool)

    def __call__(self, chosen: np.ndarray) -> np.ndarray:
        assert not np.any(self.confirmed.flat[chosen])
        self.confirmed.flat[chosen] = True
        return self.truth.flat[chosen]


def disc(radius: float) -> np.ndarray:
    """A map of 40 x 40 starts that converge within a radius."""
    x, y = np.meshgrid(np.arange(40), np.arange(40))
    return np.where(np.hypot(x - 20, y - 20) < radius, "c", "l")


def random_maps(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A map at random, and one that differs from it in a twentieth of the starts."""
    random = np.random.default_rng(seed)
    first = np.where(random.random((12, 12)) < 0.1, "l", "c")
    return first, np.where(random.random((12, 12)) < 0.05, "d", first)


@pytest.mark.parametrize(
    ("first", "truth"), [(disc(12), disc(9)), *(random_maps(seed) for seed in range(8))]
)
def test_neighbours_of_an_overturned_start_are_all_confirmed(
    first: np.ndarray, truth: np.ndarray
) -> None:
    """And starts that MuJoCo did not run are as the equations have it."""
    physics = Physics(truth)
    letters, confirmation = region.confirmed_map(first, physics)
    np.testing.assert_array_equal(letters, np.where(physics.confirmed, truth, first))
    beside = np.asarray(binary_dilation(letters != first, np.ones((3, 3))), bool)
    assert physics.confirmed[beside].all()
    assert confirmation.confirmed.sum() == physics.confirmed.sum()


def test_a_disc_that_is_smaller_in_mujoco_is_found_with_few_runs() -> None:
    """The radii differ by less than a cell, so that only starts in doubt are overturned."""
    truth = disc(11.5)
    letters, confirmation = region.confirmed_map(disc(12), Physics(truth))
    assert confirmation.overturned.any()
    assert confirmation.confirmed.sum() < 0.2 * letters.size
    np.testing.assert_array_equal(letters, truth)


def test_all_is_confirmed_after_a_difference_away_from_boundaries() -> None:
    """Equations that give one outcome where MuJoCo gives two."""
    truth = disc(9)
    letters, confirmation = region.confirmed_map(np.full_like(truth, "l"), Physics(truth))
    assert confirmation.refuted
    assert confirmation.confirmed.all()
    np.testing.assert_array_equal(letters, truth)


def test_of_a_map_of_one_outcome_only_a_random_start_is_confirmed() -> None:
    first = np.full((1, 50), "c")
    letters, confirmation = region.confirmed_map(first, Physics(first))
    np.testing.assert_array_equal(letters, first)
    assert confirmation.confirmed.sum() == 1


@pytest.mark.slow
def test_a_screened_map_is_that_of_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equations take steps of RK4, and so does MuJoCo here: no start is judged otherwise."""
    monkeypatch.setattr(region, "INTEGRATOR", "RK4")
    options: Any = {"points": 8, "duration": 2.0, "controllers": ("fl-lqr",)}
    screened = maps_of(RegionStudy("cart_pendulum", **options))
    monkeypatch.setattr(region, "model_mismatch", lambda _: "all of it")
    in_mujoco = maps_of(RegionStudy("cart_pendulum", **options))
    assert [ours.rows for ours in screened] == [theirs.rows for theirs in in_mujoco]
    assert [ours.overturned for ours in screened] == [0, 0]
    assert all(0 < ours.confirmed < 8 * 8 for ours in screened)
    assert [theirs.confirmed for theirs in in_mujoco] == [8 * 8, 8 * 8]

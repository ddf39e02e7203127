"""Region maps: which starts converge, and that a map's cell is the run that it stands for."""

from __future__ import annotations

import itertools
import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from commands import assert_one_line, run
from scipy.ndimage import binary_dilation
from shipped import case_plant, find_case, nominal_controller

from grosmc_mj import cli, simulate
from grosmc_mj.experiments import cases
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


def test_axes_are_states_by_their_symbols() -> None:
    axes = choose_axes(loop("cart_pendulum", "nominal", "lqr"), ("p", "theta"), (0.4, 45.0))
    assert [axis.signal.symbol for axis in axes] == ["p", "θ"]
    assert [axis.limit for axis in axes] == [0.4, pytest.approx(math.pi / 4)]
    assert [axis.is_error for axis in axes] == [False, True]


def test_symbols_are_written_in_ascii() -> None:
    symbols = [ascii_symbol(state) for state in CART_PENDULUM.states]
    assert symbols == ["p", "theta", "p_dot", "theta_dot"]


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
    pairs = itertools.product(np.linspace(-80, 80, 9), np.linspace(-9, 9, 9))
    starts = pendulum_starts(*pairs)
    design = law.controller.designed.lqr
    instants = np.arange(0, 6, 0.002)
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
    pairs = itertools.product(np.linspace(-80, 80, 6), np.linspace(-6, 6, 6))
    starts = pendulum_starts(*pairs)
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
        """To the share of the tolerances that is the start's rate; at last some are away."""
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


def angle_exceeds_rate(loop: RegionLoop, starts: np.ndarray, duration: float) -> np.ndarray:
    """Made-up outcomes: convergence where the angle is positive and more than the rate."""
    angle = starts[:, 1]
    rate = starts[:, 3]
    return np.where((angle > 0) & (angle > rate), "c", "d")


class MadeUpMaps(NamedTuple):
    """Maps of made-up outcomes, and the advances that their study reported."""

    maps: list[RegionMap]
    advances: list[str]


def maps_of(
    study: RegionStudy, advance: Callable[[str], object] = lambda _: None
) -> list[RegionMap]:
    """The maps of a study."""
    return [cell.measure(advance) for cell in study.cells()]


@pytest.fixture(scope="module")
def made_up() -> MadeUpMaps:
    """Angles -1, 0 and 1, rates -3, 0 and 3, in batches of 8."""
    advances: list[str] = []
    limits = (math.degrees(1.5), 4.5)
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(region, "outcomes", angle_exceeds_rate)
        monkeypatch.setattr(region, "BATCH", 8)
        study = RegionStudy("cart_pendulum", points=3, limits=limits, controllers=("lqr",))
        return MadeUpMaps(maps_of(study, advances.append), advances)


def test_rows_of_a_map_descend_the_second_axis(made_up: MadeUpMaps) -> None:
    """Rates 3, 0 and -3; the angle goes across."""
    assert made_up.maps[0].rows == ["ddc", "ddc", "ddd"]


def test_a_map_counts_its_outcomes(made_up: MadeUpMaps) -> None:
    first = made_up.maps[0]
    assert first.counts[Outcome.CONVERGED] == 2
    assert first.counts[Outcome.DIVERGED] == 7
    assert first.converged == pytest.approx(100 * 2 / 9)


def test_maps_advance_by_batches(made_up: MadeUpMaps) -> None:
    """Of nine starts in two batches."""
    assert len(made_up.advances) == 2 * len(made_up.maps)
    assert made_up.advances[0] == "nominal/lqr: 8 of 9 starts"


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


# A pole twice as heavy, behind an encoder.
DRAWN = """
extends = "base.toml"
title = "a heavier pole behind an encoder"

[run]
duration = "6 s"
control_period = "1 ms"

[[edit]]
body = "pole"
mass = "2 kg"

[[sensor]]
of = "pole angle"
resolution = "1 deg"

[[controller]]
law = "lqr"
"""


def converges_in_its_draw(loop: RegionLoop, starts: np.ndarray, duration: float) -> np.ndarray:
    """Made-up outcomes: each draw loses one more of the starts with the least angles."""
    angle = starts[:, 1]
    return np.where(angle > -0.8 + 0.25 * loop.draw, "c", "d")


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> dict[int, RegionMap]:
    """A map of nine angles, with one draw and with four."""
    path = tmp_path_factory.mktemp("drawn") / "drawn.toml"
    base = Path(cases.__file__).parent / "cart_pendulum" / "base.toml"
    shutil.copy(base, path.parent)
    path.write_text(DRAWN)
    maps = {}
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(region, "outcomes", converges_in_its_draw)
        for draws in (1, 4):
            study = RegionStudy(
                str(path), points=9, limits=(60.0, 1.0), controllers=("lqr",), draws=draws
            )
            maps[draws] = maps_of(study)[-1]
    return maps


def test_with_one_draw_no_start_varies(drawn: dict[int, RegionMap]) -> None:
    assert drawn[1].over_draws is None
    assert set(drawn[1].rows[0]) == {"c", "d"}


def test_a_start_that_some_draws_lose_is_not_converged(drawn: dict[int, RegionMap]) -> None:
    """Angles are -0.931, -0.698, -0.465, -0.233, 0 rad ...: draws 1 to 3 lose one more each."""
    assert drawn[4].rows == 9 * ["d" + 3 * "v" + 5 * "c"]
    assert drawn[4].counts[Outcome.VARIES] == 9 * 3


@pytest.mark.parametrize(
    ("first", "truth"), [(disc(12), disc(9)), *(random_maps(seed) for seed in range(20))]
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
    options: Any = {"points": 10, "duration": 3.0, "controllers": ("fl-lqr",)}
    screened = maps_of(RegionStudy("cart_pendulum", **options))
    monkeypatch.setattr(region, "model_mismatch", lambda _: "all of it")
    in_mujoco = maps_of(RegionStudy("cart_pendulum", **options))
    for ours, theirs in zip(screened, in_mujoco, strict=True):
        assert ours.rows == theirs.rows
        assert ours.overturned == 0
        assert theirs.overturned == 0
        assert 0 < ours.confirmed < theirs.confirmed == 10 * 10


# The command.


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("cart_pendulum --points 1", "points = 1 must be a whole number from 2 to 1000"),
        ("cart_pendulum --draws 0", "draws = 0 must be a whole number from 1 to 1000"),
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
        ("arm --points 2 --out /dev/null/x", "/dev/null is a file, and a folder is needed"),
    ],
)
def test_a_question_without_sense_is_one_line(
    arguments: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("study", "region", *arguments.split()) == cli.WRONG
    error = capsys.readouterr().err
    assert words in error
    assert_one_line(error)


def test_a_law_that_converges_from_no_start_is_a_verdict(tmp_path: Path) -> None:
    short = ("--points", "2", "--duration", "0.01", "--laws", "lqr")
    assert run("study", "region", "arm", *short, "--out", tmp_path) == cli.DIFFERS


ARM_REGION = ("study", "region", "arm", "--points", "5", "--duration", "6")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.fixture(scope="module")
def arm_region(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of one region study of the arm; tests only read them."""
    folder = tmp_path_factory.mktemp("arm_region")
    assert run(*ARM_REGION, "--out", folder) == cli.DONE
    return folder


@pytest.fixture(scope="module")
def arm_maps(arm_region: Path) -> dict[tuple[str, str], dict[str, Any]]:
    """The study's maps by case and controller."""
    document = json.loads((arm_region / "region_arm.json").read_text(encoding="utf-8"))
    return {(law_map["case"], law_map["controller"]): law_map for law_map in document["maps"]}


@pytest.mark.slow
def test_the_command_writes_a_figure_beside_its_document(arm_region: Path) -> None:
    files = ["region_arm.json", "region_arm.png", "region_arm.svg"]
    assert sorted(contents(arm_region)) == files


@pytest.mark.slow
def test_the_command_writes_a_grid_for_every_law_in_every_case(
    arm_maps: dict[tuple[str, str], dict[str, Any]],
) -> None:
    assert set(arm_maps) == set(itertools.product(("nominal", "case2"), ("lqr", "grosmc")))
    for law_map in arm_maps.values():
        assert [len(row) for row in law_map["grid"]] == [5] * 5
        assert "".join(law_map["grid"]).count("c") == law_map["counts"]["converged"]


@pytest.mark.slow
def test_grosmc_holds_starts_with_twice_the_payload(
    arm_maps: dict[tuple[str, str], dict[str, Any]],
) -> None:
    assert arm_maps["case2", "grosmc"]["counts"]["converged"] > 0


@pytest.mark.slow
def test_lqr_loses_every_start_with_twice_the_payload(
    arm_maps: dict[tuple[str, str], dict[str, Any]],
) -> None:
    assert arm_maps["case2", "lqr"]["counts"]["converged"] == 0


@pytest.mark.slow
def test_an_interrupt_before_the_first_map_leaves_earlier_results(
    arm_region: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    folder = shutil.copytree(arm_region, tmp_path / "out")
    monkeypatch.setattr(region, "outcomes", interrupted)
    assert run(*ARM_REGION, "--out", folder) == cli.INTERRUPTED
    assert contents(folder) == contents(arm_region)


# With three of four maps the second plant has fewer than the first.
@pytest.mark.parametrize("finished", [0, 1, 3])
def test_an_interrupt_keeps_the_finished_maps(
    finished: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    law_map = RegionStudy.law_map
    count = itertools.count()

    def interrupted(study: RegionStudy, *arguments: Any) -> RegionMap:
        if next(count) == finished:
            raise KeyboardInterrupt
        return law_map(study, *arguments)

    monkeypatch.setattr(RegionStudy, "law_map", interrupted)
    options = ("study", "region", "servo", "--points", "2", "--duration", "0.1", "--out", tmp_path)
    assert run(*options) == cli.INTERRUPTED
    assert len([path for path in tmp_path.iterdir() if path.is_file()]) == (3 if finished else 0)
    if finished:
        document = json.loads((tmp_path / "region_servo.json").read_text(encoding="utf-8"))
        assert document["complete"] is False
        assert len(document["maps"]) == finished
        assert document["answers"][0]["verdict"] == "not decided"

    # It goes on with the map at which it was stopped.
    assert run(*options, "--resume") in (cli.DONE, cli.DIFFERS)
    resumed = json.loads((tmp_path / "region_servo.json").read_text(encoding="utf-8"))
    assert resumed["complete"] is True
    assert next(count) == len(resumed["maps"]) + 1

"""The worst disturbance: of a linear loop, of the servo's bench, its case file, wrong options."""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cases
import control
import numpy as np
import pytest
from commands import Patch, Screen, assert_one_line, run

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.requirements.judging import judge_run
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.studies import campaign as cases_of_campaigns
from grosmc_mj.studies.disturbance.answer import (
    answer_table,
    case_text,
    charts,
    disturbance_film,
    disturbance_result,
    words_of,
)
from grosmc_mj.studies.disturbance.disturbance import DisturbanceStudy, disturbance_study
from grosmc_mj.studies.disturbance.row import WorstDisturbance
from grosmc_mj.studies.disturbance.signal_search import SignalSearch
from grosmc_mj.studies.sweep.family import family_of

# L = 25/(s^3 + 10 s^2 + 10 s + 10) under unit feedback, and a disturbance of its input.
PLANT = """
import sympy as sp
import grosmc_mj as gm
x1, x2, x3 = sp.symbols("x1 x2 x3")
def third_order():
    return gm.affine_plant("third", states={"x1": "rad", "x2": "rad/s", "x3": "rad/s^2"},
        inputs={"u": "A"}, f=[x2, x3, -10 * x1 - 10 * x2 - 10 * x3], g=[0, 0, 25], h=[x1],
        parameters={})
def law(t, x, memory, p):
    return -x[0]
"""
STAYS = {"stays_within": "1 rad"}
PUSH = {
    "body": "rotor",
    "torque": ["0 N m", "0.5 N m", "0 N m"],
    "profile": "pulse",
    "start": "1 s",
    "stop": "4 s",
    "label": "push",
}
# The servo's rotor held at its reference on the bench.
HELD: Mapping[str, Any] = {
    "run": {"start": {"rotor angle": "1 rad"}, "duration": "5 s", "timestep": "0.5 ms"},
    "computing": {"delay": "1 ms"},
    "sensor": {"of": "rotor angle", "resolution": "1.534 mrad"},
    "estimator": {"of": "rotor speed", "law": "eso", "bandwidth": "100 rad/s"},
    "actuator": {"of": "current", "limit": "4 A"},
    "disturbance": PUSH,
    "requirement": {"stays_within": "20 mrad"},
}
# A second of it, with a push of 0.6 s.
BRIEF: Mapping[str, Any] = {
    **HELD,
    "run": {"start": {"rotor angle": "1 rad"}, "duration": "1 s"},
    "disturbance": {**PUSH, "start": "0.2 s", "stop": "0.8 s"},
}
ON_ROTOR = ("--on", "rotor", "--bound", "1 N m")


def linear(folder: Path, duration: str = "10 s", **tables: Any) -> Path:
    """Write the case of the linear loop, and return its path."""
    (folder / "third.py").write_text(PLANT)
    periods = {"control_period": "10 ms", "timestep": "10 ms"}
    own = {
        "run": {"duration": duration, **periods},
        "task": {"Q": [1, 1, 1], "R": 1},
        "controller": {"law": "third:law"},
        "requirement": STAYS,
    }
    return cases.write(folder, "third:third_order", name="linear", **(own | tables))


def held(folder: Path, base: Mapping[str, Any] = HELD, **tables: Any) -> Path:
    """Write a case of the held servo, and return its path."""
    return cases.write(folder, "servo", name="held", **(dict(base) | tables))


def of_rotor(folder: Path, bound: str = "10 mN m", **options: Any) -> DisturbanceStudy:
    """Return the study of a disturbance on the held rotor in a second, in ten pieces."""
    return disturbance_study(str(held(folder, BRIEF)), "rotor", bound, pieces=10, **options)


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> DisturbanceStudy:
    """The linear loop in 20 pieces."""
    path = linear(tmp_path_factory.mktemp("loop"))
    return disturbance_study(str(path), "u", "1 A", pieces=20)


@pytest.fixture(scope="module")
def rotor(tmp_path_factory: pytest.TempPathFactory) -> DisturbanceStudy:
    """The study of the held rotor in a second."""
    return of_rotor(tmp_path_factory.mktemp("rotor"))


@pytest.fixture(scope="module")
def found(rotor: DisturbanceStudy) -> WorstDisturbance:
    """The worst disturbance that is found for the held rotor under LQR."""
    return rotor.find("lqr", lambda _: None)


# -- the search ------------------------------------------------------------------------------------


def sampled_worst(pieces: int, steps: int, period: float = 0.01) -> float:
    """Return the largest |x1| under signals of so many pieces: by superposition, any signs."""
    plant = control.c2d(control.tf([25], [1, 10, 10, 10]), period)
    _, impulse = control.impulse_response(control.feedback(plant, 1), np.arange(steps) * period)
    # The discrete impulse response of python-control is that of a unit area.
    responses = np.convolve(np.ones(steps // pieces), period * impulse)
    shifted = np.zeros((pieces, steps))
    for i in range(pieces):
        first = i * (steps // pieces)
        shifted[i, first:] = responses[: steps - first]
    return float(np.abs(shifted).sum(axis=0).max())


@pytest.mark.parametrize("requirement", [STAYS, {"always": "abs(x1) < 1 rad"}])
def test_pulses_find_the_worst_of_a_linear_loop_and_flips_nothing_worse(
    tmp_path: Path, requirement: dict[str, str]
) -> None:
    """Of any signal it is the L1 norm of the impulse response, 2.613."""
    path = linear(tmp_path, "20 s", requirement=requirement)
    study = disturbance_study(str(path), "u", "1 A", pieces=80)
    search = study.search("law", study.disturbance, 80)
    search.pulses()
    by_pulses = search.share
    search.flips(400)
    assert search.share == pytest.approx(by_pulses, rel=1e-6)
    assert search.share == pytest.approx(sampled_worst(80, 2000), rel=1e-4)
    assert search.share == pytest.approx(2.613, rel=0.03)


def test_random_telegraphs_find_less_than_pulses_on_a_linear_loop(loop: DisturbanceStudy) -> None:
    worst = loop.find("law", lambda _: None)
    assert worst.telegraph_share < worst.search_share
    assert not worst.telegraph_won
    assert worst.change <= 0.05


def test_twice_the_bound_is_twice_the_share_of_a_linear_loop(loop: DisturbanceStudy) -> None:
    once, twice = [loop.search("law", loop.disturbance.scaled(by), 20) for by in (1.0, 2.0)]
    once.pulses()
    twice.pulses()
    assert twice.share == pytest.approx(2 * once.share, rel=1e-9)


def test_the_largest_bound_of_a_linear_loop_is_the_inverse_of_its_norm(
    loop: DisturbanceStudy,
) -> None:
    low, high = loop.largest("law", lambda _: None)
    assert low <= 1 / sampled_worst(20, 1000) <= high
    assert high <= low * 1.06


def test_flips_find_what_pulses_do_not() -> None:
    """Of a function that is no linear loop's: pieces count only if their neighbours differ."""

    def shares(signals):
        return -np.sum(signals[:, 1:] * signals[:, :-1], axis=1) / 9

    search = SignalSearch(shares, lambda signals: np.zeros((len(signals), 1)), size=10)
    search.pulses()
    assert search.share == -1
    search.flips(2000)
    assert search.share == 1


def test_a_slewed_disturbance_keeps_both_bounds(tmp_path: Path) -> None:
    study = disturbance_study(str(held(tmp_path)), "rotor", "1 N m", slew="2 N m/s")
    generator = np.random.default_rng(0)
    profile = study.disturbance.profile(generator.choice([-1.0, 1.0], 40))
    values = np.array(profile.values)
    assert np.abs(values).max() == 1
    rates = np.diff(values) / profile.hold
    assert np.abs(rates).max() == pytest.approx(2, rel=1e-9)
    assert len(values) * profile.hold >= 5


@pytest.mark.parametrize("slew", ["", "2 N m/s"])
def test_pieces_are_the_shortest_whole_timesteps_that_fill_the_run(
    tmp_path: Path, slew: str
) -> None:
    """Seven in 5 s, of one value each or of twenty; a timestep less would end before the run."""
    known = disturbance_study(str(held(tmp_path)), "rotor", "1 N m", slew=slew).disturbance
    values = 7 * (20 if slew else 1)
    steps = known.hold(7) / 0.5e-3
    assert steps == pytest.approx(round(steps), abs=1e-9)
    assert values * (round(steps) - 1) * 0.5e-3 < 5 <= values * round(steps) * 0.5e-3
    assert len(known.profile(np.ones(7)).values) == values


def test_the_slew_bound_scales_with_the_bound(tmp_path: Path) -> None:
    """In parts of its bound a signal is the same, so that the time to the bound is."""
    known = disturbance_study(str(held(tmp_path)), "rotor", "0.5 N m", slew="2 N m/s").disturbance
    scaled = known.scaled(3.0)
    assert (scaled.bound, scaled.slew) == (1.5, 6.0)
    assert scaled.unit_disturbance.amplitudes == (0, 0, 0, 0, 1.5, 0)
    pieces = np.array([1.0, -1.0, 1.0, 1.0])
    assert scaled.profile(pieces) == known.profile(pieces)


def test_a_deviation_adds_to_the_start_of_its_state(tmp_path: Path) -> None:
    """The rotor starts at 1 rad; deviations come in the order of the options."""
    starts = ["rotor speed=0.5 rad/s", "rotor angle=20 mrad"]
    known = disturbance_study(str(held(tmp_path)), "rotor", "1 N m", starts=starts).disturbance
    case = known.case_of(np.array([1.0, -1.0, 0.5, -0.25]))
    assert case.x0 == pytest.approx((1 - 0.25 * 0.02, 0.5 * 0.5))


@pytest.mark.parametrize(
    ("on", "bound", "words"),
    [("rotor", "2 N m", "a sine of 0.7 Hz"), ("current", "2 A", "a constant one")],
)
def test_the_case_s_own_disturbance_at_the_place_is_compared(
    tmp_path: Path, on: str, bound: str, words: str
) -> None:
    sine = {"body": "rotor", "torque": ["0 N m", "0.5 N m", "0 N m"], "profile": "sine"}
    path = held(tmp_path, disturbance={**sine, "frequency": "0.7 Hz"})
    assert disturbance_study(str(path), on, bound).disturbance.compared == words


def test_a_torque_has_the_direction_of_the_case_s_own_and_the_size_of_the_bound(
    tmp_path: Path,
) -> None:
    path = held(tmp_path, disturbance={**PUSH, "torque": ["0.3 N m", "0.4 N m", "0 N m"]})
    known = disturbance_study(str(path), "rotor", "2 N m").disturbance
    assert known.unit_disturbance.amplitudes == pytest.approx((0, 0, 0, 1.2, 1.6, 0))


def test_a_slewed_disturbance_is_less_bad(tmp_path: Path, rotor: DisturbanceStudy) -> None:
    slewed = of_rotor(tmp_path, slew="50 mN m/s").searched("lqr", 10)
    assert slewed.share < rotor.searched("lqr", 10).share


def test_a_start_within_bounds_is_part_of_the_search(
    tmp_path: Path, rotor: DisturbanceStudy
) -> None:
    search = of_rotor(tmp_path, starts=["rotor angle=5 mrad"]).searched("lqr", 10)
    assert len(search.best) == 11
    assert abs(search.best[-1]) == 1
    assert search.share > rotor.searched("lqr", 10).share


# -- in words -------------------------------------------------------------------------------------

# Four pieces of which two switch, and a deviation of the start of the other sign.
WORST = WorstDisturbance(
    law="lqr",
    share=1.5,
    words="stays within 20 mrad",
    bound=0.5,
    signal=[1.0, 1.0, -1.0, 1.0, -1.0],
    pieces=4,
    calm_share=0.3,
    compared_share=0.6,
    search_share=1.5,
    telegraph_share=1.2,
    runs=88,
    change=0.049,
    confirmed=1.45,
    largest_kept=0.2,
    smallest_failed=0.21,
)
WHOLE = (
    "lqr: 1.5 of stays within 20 mrad, 2.5 times a 0.6 s pulse; 2 switches; "
    "88 runs, and random telegraph signals in as many reach 1.2"
)
UP_TO = "; all is kept up to 0.2 and not at 0.21 N m"


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({}, WHOLE + UP_TO),
        ({"change": 0.051}, f"{WHOLE}; 4 pieces may be too few{UP_TO}"),
        ({"largest_kept": None}, WHOLE),
        (
            {"smallest_failed": None},
            f"{WHOLE}; all is kept up to 0.2 N m at least, where the search ends",
        ),
        ({"compared_share": 1.499}, (WHOLE + UP_TO).replace("2.5 times", "as much as")),
        ({"calm_share": 2e6}, "lqr: the run ends early without any disturbance"),
        ({"share": 2e6}, "lqr: the run ends early; 88 runs"),
        (
            {"calm_share": 2.0, "largest_kept": None},
            WHOLE.replace("1.5", "not kept without any disturbance, 2 of the limit; 1.5", 1),
        ),
    ],
)
def test_the_words_have_share_ratio_switches_runs_and_the_largest_bound(
    rotor: DisturbanceStudy, changes: dict[str, float], line: str
) -> None:
    assert words_of(rotor_in(rotor, 0.5), WORST.model_copy(update=changes)) == line


def rotor_in(study: DisturbanceStudy, bound: float) -> DisturbanceStudy:
    """Return the study of the rotor with another bound [N m]."""
    known = study.disturbance
    return replace(study, disturbance=known.scaled(bound / known.bound))


def test_the_table_has_the_law_that_breaks_most_first(rotor: DisturbanceStudy) -> None:
    quiet = {"law": "quiet", "share": 0.7, "search_share": 0.65, "telegraph_share": 0.7}
    quiet |= {"confirmed": None, "smallest_failed": None}
    assert answer_table(rotor, [WORST.model_copy(update=quiet), WORST]).rows == [
        ["lqr", "1.5", "0.6", "2", "4", "88", "1.2", "search", "1.45", "0.2 to 0.21"],
        ["quiet", "0.7", "0.6", "2", "4", "88", "0.7", "telegraph", "-", "≥0.2"],
    ]


@pytest.mark.parametrize(
    ("kept", "complete", "verdict"),
    [
        (True, True, "kept"),
        (True, False, "not decided"),
        (False, True, "not kept"),
        (False, False, "not kept"),
    ],
)
def test_a_study_that_was_interrupted_is_open_unless_a_law_has_failed(
    rotor: DisturbanceStudy, found: WorstDisturbance, kept: bool, complete: bool, verdict: str
) -> None:
    row = found.model_copy(update={"share": 0.9 if kept else 1.1})
    assert disturbance_result(rotor, [row], complete=complete).answers[0].verdict == verdict


def test_the_figure_shows_the_quantity_that_is_nearest_to_its_limit(
    rotor: DisturbanceStudy, found: WorstDisturbance
) -> None:
    signal, course = charts(rotor, found)
    assert [series.name for series in signal.lines] == ["a 0.6 s pulse", "worst found"]
    worst = signal.lines[1]
    piece = np.array(worst.x) / rotor.disturbance.hold(found.pieces) + 1e-9
    assert worst.y == pytest.approx(0.01 * np.array(found.signal)[piece.astype(int)])
    assert course.limit == 0.02
    largest = [max(abs(y) for y in series.y if y is not None) for series in course.lines]
    assert largest[1] == pytest.approx(found.share * 0.02, rel=0.01)
    assert largest[0] == pytest.approx(found.compared_share * 0.02, rel=0.01)


def test_the_film_shows_the_worst_disturbance_beside_the_compared_one(
    rotor: DisturbanceStudy, found: WorstDisturbance
) -> None:
    film = disturbance_film(rotor, found)
    assert [take.label for take in film.takes] == ["a 0.6 s pulse", "worst found"]
    case = rotor.disturbance.case_of(np.array(found.signal))
    assert np.array_equal(film.takes[1].run.state, case.run("physics", "lqr").trajectory.state)


def test_values_name_the_place_of_the_disturbance(
    tmp_path: Path, rotor: DisturbanceStudy, found: WorstDisturbance
) -> None:
    """Else a disturbance of the rotor would be compared with one of the current."""
    study = disturbance_study(str(held(tmp_path, BRIEF)), "current", "1 mA", pieces=4)
    of_current = disturbance_result(study, [study.find("lqr", lambda _: None)], complete=True)
    of_rotor = disturbance_result(rotor, [found], complete=True)
    names = {value.name for value in of_current.values}
    assert names.isdisjoint(value.name for value in of_rotor.values)


# -- case files ------------------------------------------------------------------------------------


def test_the_case_file_replays_what_was_found(tmp_path: Path) -> None:
    path = held(tmp_path, BRIEF)
    options = ("--bound", "0.5 N m", "--pieces", "4", "--no-figures", "--out", tmp_path)
    assert run("study", "disturbance", path, "--on", "rotor", *options) == 1
    document = json.loads((tmp_path / "disturbance_held.json").read_text())
    assert (document["kind"], document["complete"]) == ("disturbance", True)
    (worst,) = document["verdicts"]
    assert worst["share"] > 1

    case = Experiment.load(tmp_path / "disturbance_held_lqr.toml")
    assert len(case.disturbances) == 1
    (limit,) = case.limits
    equations, mujoco = [
        judge_run(limit, case.run(plant, "lqr")).share for plant in ("corrected", "physics")
    ]
    assert (equations, mujoco) == (worst["share"], worst["confirmed"])


def found_by_nobody(study: DisturbanceStudy) -> WorstDisturbance:
    """Return a signal of six pieces for the first law of a study, which no search has found."""
    signal = [1.0, -1.0, 0.5, 1.0, -1.0, -0.25]
    law = study.experiment.controllers[0]
    bound = study.disturbance.bound
    return WORST.model_copy(update={"law": law, "bound": bound, "signal": signal, "pieces": 6})


def places_of(case: Experiment) -> dict[str, str]:
    """Return a bound by place: of the file's own loads, a body, an input and a measurement."""
    system = case.nominal.system
    bounds = {signal.name: f"1 {signal.unit}" for signal in (system.states[0], system.inputs[0])}
    # Of equal names a body comes before an input, and that before a state.
    bounds = {name: bound for name, bound in bounds.items() if name not in system.bodies}
    bodies = [load.of for load in case.disturbances if load.of in system.bodies]
    return {**bounds, **dict.fromkeys([*bodies, *system.bodies[-1:]], "1 N")}


CASES = dict(shipped_files())
CAMPAIGNS = Path(cases_of_campaigns.__path__[0], "shipped").glob("*.toml")


# Shipped cases that require a settling time alone, which no search asks.
SETTLING_ALONE = {
    "ball_beam/balance",
    "cartpole/heavier",
    "inverted_pendulum/heavier",
    "logs/arm",
    "logs/servo",
    "own_laws/from_positions",
    "own_laws/looked_up",
    "own_laws/transfer_function",
}


@pytest.mark.parametrize(
    "path",
    [
        *(pytest.param(path, id=f"campaign {path.stem}") for path in sorted(CAMPAIGNS)),
        *(pytest.param(path, id=name, marks=pytest.mark.slow) for name, path in CASES.items()),
    ],
)
def test_the_case_file_of_each_kind_of_load_is_valid(path: Path, tmp_path: Path) -> None:
    """It has the signal at the place of the load, and all that is uncertain of it exists."""
    folder = tmp_path / path.parent.name
    shutil.copytree(path.parent, folder)
    case = Experiment.load(path)
    if not case.file.requirement:
        pytest.skip("nothing is required")
    for on, bound in places_of(case).items():
        if f"{path.parent.name}/{path.stem}" in SETTLING_ALONE:
            with pytest.raises(ArgumentError, match=r"settles within .* require recovers_within"):
                disturbance_study(str(path), on, bound)
            continue
        study = disturbance_study(str(path), on, bound)
        found = found_by_nobody(study)
        written = folder / "found.toml"
        written.write_text(case_text(study, found), encoding="utf-8")
        replayed = Experiment.load(written)
        expected = study.disturbance.case_of(np.array(found.signal))
        assert list(replayed.disturbances) == list(expected.disturbances)
        if replayed.file.uncertain:
            family_of(replayed.file, replayed)


UNCERTAIN = {
    "uncertain": [
        {"number": "edit.rotor.mass_scale", "values": [1, 2]},
        {"number": "disturbance.push.scale", "values": [0, 1]},
    ],
    "correlation": {"between": ["rotor mass scale", "push scale"], "coefficient": 0.5},
}
# Two loads of one label are told apart by their index in a path.
SECOND = {**PUSH, "input": "current", "amplitude": "0.1 A"}
del SECOND["body"], SECOND["torque"]
TWO_LOADS = {
    "disturbance": [PUSH, SECOND],
    "uncertain": [
        UNCERTAIN["uncertain"][0],
        {"number": "disturbance.push[2].scale", "values": [0, 1]},
    ],
    "correlation": {"between": ["rotor mass scale", "push[2] scale"], "coefficient": 0.5},
}


@pytest.mark.parametrize(
    ("tables", "loads", "uncertain", "correlations"),
    [
        (UNCERTAIN, ["rotor"], ["rotor mass scale"], 0),
        (TWO_LOADS, ["rotor", "current"], ["rotor mass scale", "push[2] scale"], 1),
    ],
    ids=["replaced", "beside it"],
)
def test_of_the_load_that_is_replaced_nothing_is_uncertain_any_more(
    tmp_path: Path,
    tables: dict[str, Any],
    loads: list[str],
    uncertain: list[str],
    correlations: int,
) -> None:
    path = held(tmp_path, **tables)
    study = disturbance_study(str(path), "rotor", "1 N m")
    path.write_text(case_text(study, found_by_nobody(study)))
    replayed = Experiment.load(path)
    assert [load.of for load in replayed.disturbances] == loads
    assert family_of(replayed.file, replayed).names == uncertain
    assert len(replayed.file.correlation or []) == correlations


# -- one requirement on both sides -----------------------------------------------------------------

SETTLING = {"settles_within": "3 s", "band": "20 mrad"}
OVERSHOOT = {"overshoot_below": 0.05}


def recovery(time: str) -> dict[str, str]:
    """Return the requirement of a recovery within a time."""
    return {"recovers_within": time, "band": "20 mrad"}


def settling(folder: Path, *asked: dict[str, Any], **options: Any) -> DisturbanceStudy:
    """Return the study of a rotor that starts beside its reference, with requirements."""
    start = {**HELD["run"], "start": {"rotor angle": "1.1 rad"}}
    path = held(folder, run=start, requirement=list(asked))
    return disturbance_study(str(path), "rotor", "0.5 N m", ["lqr"], **options)


def test_the_pulse_of_the_file_is_asked_what_the_worst_signal_is(tmp_path: Path) -> None:
    """The rotor under LQR overshoots in the pulse, which the file's transient ends before."""
    study = settling(tmp_path, OVERSHOOT)
    case = study.disturbance.compared_case
    assert case.onset == study.disturbance.case_of(np.ones(40)).onset == math.inf
    own = Experiment.load(study.experiment.path)
    pulse = own.run("corrected", "lqr").trajectory.state
    # Equal but for the denormal torque of the first step.
    course = case.run("corrected", "lqr").trajectory.state
    np.testing.assert_allclose(course, pulse, rtol=0, atol=1e-300)
    (share,) = study.shares("lqr", [case])
    assert share > 1


def test_what_no_disturbance_of_any_course_is_asked_is_said(tmp_path: Path) -> None:
    """A flip near the end of a run takes any law out of its band: it says nothing of a law."""
    formula = {"always": "abs(current) < 1 A"}
    study = settling(tmp_path, OVERSHOOT, SETTLING, recovery("1 s"), formula)
    assert [limit.key for limit in study.limits("lqr")] == ["overshoot_below"]
    assert study.not_asked == [
        "not asked: settles within 3 s to 20 mrad: this disturbance may act after any settling: "
        "require recovers_within, and search it with --requirement recovers_within",
        "not asked: recovers within 1 s of each disturbance to 20 mrad: it is of a disturbance "
        "that ends, and this one may act at any time: search it alone, with --requirement "
        "recovers_within",
        "not asked: always abs(current) < 1 A: it is of the input alone",
    ]
    named = replace(study, requirement="always")
    assert [limit.key for limit in named.limits("lqr")] == ["always"]


@pytest.mark.parametrize("pieces", [7, 40, 640])
def test_a_disturbance_to_recover_from_ends_twice_the_required_time_before_the_run(
    tmp_path: Path, pieces: int
) -> None:
    """The file's own course, too, so that both are asked the same: one recovery."""
    asked = recovery("1.2 s")
    known = settling(tmp_path, asked, requirement="recovers_within").disturbance
    end = known.applied_in(known.case_of(np.ones(pieces))).window[1]
    assert 2.6 - known.hold(pieces) < end <= 2.6
    assert known.applied_in(known.compared_case).window == (0.0, pytest.approx(2.6))


def test_an_answer_says_from_when_on_a_recovery_counts(tmp_path: Path) -> None:
    study = settling(tmp_path, recovery("1 s"), requirement="recovers_within")
    (line,) = study.about_recovery
    end = study.disturbance.end
    assert line.startswith(f"recovery: counted from {end:g} s, where each disturbance ends")
    assert settling(tmp_path, OVERSHOOT).about_recovery == []


def test_the_worst_disturbance_to_recover_from_is_replayed_by_its_file(tmp_path: Path) -> None:
    """LQR comes back late from the load that acts last; a hundredth of it is kept."""
    study = settling(tmp_path, recovery("1 s"), requirement="recovers_within", pieces=2)
    signal = np.array([1.0, 1.0])
    share, less = study.shares(
        "lqr", [study.disturbance.scaled(factor).case_of(signal) for factor in (1.0, 0.01)]
    )
    assert less < 1 < share <= 2 + 1e-3

    nobody = found_by_nobody(study).model_copy(update={"signal": signal.tolist(), "pieces": 2})
    replayed = tmp_path / "replayed.toml"
    replayed.write_text(case_text(study, nobody))
    case = Experiment.load(replayed)
    (limit,) = case.limits
    assert judge_run(limit, case.run("corrected", "lqr")).share == share


@pytest.mark.parametrize(
    ("asked", "options", "refusal"),
    [
        (SETTLING, {}, "settles within 3 s to 20 mrad: this disturbance may act after any"),
        (SETTLING, {"requirement": "settles_within"}, "require recovers_within, and search it"),
        (
            recovery("2.5 s"),
            {"requirement": "recovers_within"},
            "ends 5 s before the run does, and a run has 5 s: make run.duration longer",
        ),
        (
            recovery("1 s"),
            {"requirement": "recovers_within", "slew": "2 N m/s"},
            "ends at once: leave out --slew",
        ),
        # The disturbance acts from the start on: there is nothing to recover from.
        (recovery("1 s"), {}, "required of lqr; recovers within 1 s"),
    ],
)
def test_what_cannot_be_asked_is_refused_with_the_reason(
    tmp_path: Path, asked: dict[str, Any], options: dict[str, Any], refusal: str
) -> None:
    with pytest.raises(ArgumentError, match=re.escape(refusal)):
        settling(tmp_path, asked, **options)


def test_a_formula_is_told_by_its_margin(tmp_path: Path) -> None:
    """Shares of an envelope are near 1 whatever happens; a ratio of them tells nothing."""
    envelope = {"signal": "rotor angle", "above": "0.75 rad", "below": "1.4 rad"}
    study = settling(tmp_path, envelope)
    (limit,) = study.limits("lqr")
    worst = WORST.model_copy(
        update={"tightest": limit.name, "words": limit.words, "share": 1.2, "compared_share": 1.1}
    )
    assert "below 1.4 rad, missed by 0.15 rad; a 3 s pulse 1.1; " in words_of(study, worst)


# -- the command -----------------------------------------------------------------------------------


def test_resume_searches_only_what_is_missing(
    tmp_path: Path, capsys: Screen, monkeypatch: Patch
) -> None:
    """First the worst signal, then the largest bound, of which both ends are told."""
    options = ("--on", "u", "--bound", "1 A", "--pieces", "5", "--no-figures", "--out", tmp_path)
    command = ("study", "disturbance", linear(tmp_path, "5 s"), *options)
    run(*command)
    monkeypatch.setattr(DisturbanceStudy, "find", lambda *_: pytest.fail("searched again"))
    capsys.readouterr()
    run(*command, "--largest", "--resume")
    screen = capsys.readouterr().out
    (found,) = json.loads((tmp_path / "disturbance_linear.json").read_text())["verdicts"]
    kept, failed = found["largest_kept"], found["smallest_failed"]
    assert kept < failed <= 1.05 * kept
    assert f"all is kept up to {kept:.3g} and not at {failed:.3g} A" in " ".join(screen.split())

    monkeypatch.setattr(SignalSearch, "judge", None)
    run(*command, "--largest", "--resume")
    assert capsys.readouterr().out == screen


def test_a_finished_law_is_not_read_if_its_code_changes(tmp_path: Path) -> None:
    target = str(linear(tmp_path))
    (before,) = disturbance_study(target, "u", "1 A").cells()
    code = tmp_path / "third.py"
    code.write_text(code.read_text().replace("return -x[0]", "return -2 * x[0]"))
    (after,) = disturbance_study(target, "u", "1 A").cells()
    assert before.key == after.key
    assert before.depends_on != after.depends_on


def unruly(folder: Path, law: str, limit: str = "5 rad") -> Path:
    """Write a case of the servo under a law that is written in Python, and return its path."""
    (folder / "mine.py").write_text(f"def law(t, x, memory, p, u):\n    u[0] = {law}\n")
    start = {"rotor angle": "0 rad"}
    return cases.write(
        folder,
        name="unruly",
        run={"duration": "20 ms", "start": start, "engine": "python"},
        controller={"law": "mine:law"},
        requirement={"stays_within": limit},
    )


def test_a_law_that_is_not_a_number_from_the_start_fails_without_any_disturbance(
    tmp_path: Path, capsys: Screen
) -> None:
    path = unruly(tmp_path, 'x[0] * float("nan")')
    options = ("--on", "current", "--bound", "1 A", "--largest", "--out", tmp_path)
    assert run("study", "disturbance", path, *options) == 1
    assert "law: the run ends early without any disturbance" in capsys.readouterr().out
    document = json.loads((tmp_path / "disturbance_unruly.json").read_text())
    assert document["verdicts"][0]["runs"] == 1


@pytest.mark.parametrize(
    ("bound", "limit", "code", "words"),
    [
        # It stands 1 rad from its reference.
        ("1 A", "0.5 rad", 1, "Without any disturbance law: not kept."),
        ("1e99 A", "5 rad", 1, "law: the run ends early; "),
        # 1 nA and a thousand times as much move the rotor by nothing.
        ("1e-9 A", "5 rad", 0, "all is kept up to 1e-06 A at least"),
    ],
)
def test_the_ends_of_a_search_are_said(
    tmp_path: Path, capsys: Screen, bound: str, limit: str, code: int, words: str
) -> None:
    path = unruly(tmp_path, "0.0", limit)
    options = ("--bound", bound, "--pieces", "2", "--largest", "--no-figures", "--out", tmp_path)
    assert run("study", "disturbance", path, "--on", "current", *options) == code
    screen = " ".join(capsys.readouterr().out.split())
    assert words in screen
    assert ("all is kept up to" in screen) == (code == 0)


@pytest.mark.parametrize(("bound", "size"), [("0.1", 0.1), ("+2e-1", 0.2)])
def test_an_input_without_a_unit_has_a_bound_without_one(
    tmp_path: Path, bound: str, size: float
) -> None:
    path = linear(tmp_path)
    code = tmp_path / "third.py"
    code.write_text(code.read_text().replace('"u": "A"', '"u": "1"'))
    assert disturbance_study(str(path), "u", bound).disturbance.bound == size


def test_case_files_of_ones_own_python_lie_beside_it(tmp_path: Path, capsys: Screen) -> None:
    path = unruly(tmp_path, "0.0")
    options = ("--on", "current", "--bound", "1 A", "--pieces", "2", "--no-figures")
    run("study", "disturbance", path, *options, "--out", tmp_path / "elsewhere")
    case = tmp_path / "disturbance_unruly_law.toml"
    assert str(case) in capsys.readouterr().out
    assert Experiment.load(case).path.parent == tmp_path


WRONG = {
    ("--on", "wheel", "--bound", "1 N m"): "unknown body, input or state 'wheel'",
    ("--on", "rotor", "--bound", "1 A"): "--bound '1 A': on a body it is a force or a torque",
    ("--on", "current", "--bound", "1 N m"): '--bound: "1 N m" cannot be converted to A',
    ("--on", "rotor", "--bound", "-1 N m"): "--bound '-1 N m' must be positive",
    ("--on", "rotor", "--bound", "0 N m"): "--bound '0 N m' must be positive",
    ("--on", "current", "--bound", "-1e308 A"): "'-1e308 A' is too large: write 1e+100 at most",
    (*ON_ROTOR, "--slew", "1 N m"): '--slew: "1 N m" cannot be converted',
    (*ON_ROTOR, "--axis", "w"): "unknown axis 'w'",
    ("--on", "current", "--bound", "1 A", "--axis", "x"): "--axis x: current is no body",
    (*ON_ROTOR, "--start", "rotor angle"): 'write "STATE=BOUND"',
    (*ON_ROTOR, "--start", "angle=1 rad"): "angle",
    (*ON_ROTOR, "--requirement", "rms"): "unknown requirement",
    (*ON_ROTOR, "--requirement", "rms_below"): "rms_below is not required of lqr",
    (*ON_ROTOR, "--pieces", "1"): "--pieces 1 must be from 2 to 640",
    (*ON_ROTOR, "--laws", "pid"): "unknown law 'pid'",
    (*ON_ROTOR, "--film", "pid"): "unknown law 'pid'",
}


@pytest.mark.parametrize("options", WRONG)
def test_a_wrong_option_is_refused_in_one_line(
    tmp_path: Path, capsys: Screen, options: tuple[str, ...]
) -> None:
    assert run("study", "disturbance", held(tmp_path), *options, "--out", tmp_path) == 2
    error = capsys.readouterr().err
    assert_one_line(error)
    assert WRONG[options] in error


def test_a_film_of_a_case_without_mujoco_is_refused(tmp_path: Path, capsys: Screen) -> None:
    options = ("--on", "u", "--bound", "1 A", "--film", "law", "--out", tmp_path)
    assert run("study", "disturbance", linear(tmp_path), *options) == 2
    error = capsys.readouterr().err
    assert_one_line(error)
    assert "a film is of runs in MuJoCo" in error


def test_nothing_is_to_be_written_into_the_package(tmp_path: Path, capsys: Screen) -> None:
    command = ("study", "disturbance", "maglev/warm", "--on", "voltage", "--bound", "1 V")
    assert run(*command, "--out", tmp_path) == 2
    error = capsys.readouterr().err
    assert_one_line(error)
    assert "copy " in error
    assert "give --out" not in error

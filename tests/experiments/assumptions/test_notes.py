"""Notes on runs: requirements that cannot fail, time at a limit, weights by name; their places."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cases
import pytest
from cases import case
from commands import Patch, Screen, run
from own_files import LEG

from grosmc_mj.experiments.answer.tables import gains_table, requirements_table
from grosmc_mj.experiments.assumptions.notes import notes_on
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.text import text_of
from grosmc_mj.experiments.requirements.judging import judge_runs
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.studies.margins.answer import margins_result
from grosmc_mj.studies.margins.margins import margin_study
from grosmc_mj.studies.margins.row import LawMargins

LIMITED: dict[str, Any] = {
    "actuator": {"of": "current", "limit": "4 A"},
    "estimator": {"of": "rotor speed"},
}


def servo(plant: str = "physics", law: str = "lqr", **tables: Any) -> Experiment:
    """Twenty milliseconds of the servo."""
    run_table = {"start": {"rotor angle": "0.1 rad"}, "engine": "python"}
    return case("servo", law=law, plant={"compare": [plant]}, run=run_table, **tables)


def leg(folder: Path, Q: Any = 1, model: str = LEG, **tables: Any) -> Experiment:
    """Ten milliseconds of a robot of two joints."""
    (folder / "leg.xml").write_text(model, encoding="utf-8")
    run_table = {"start": {"hip": "10 deg"}, "duration": "0.01 s", "engine": "python"}
    return case(
        "leg.xml",
        folder=folder,
        **{"run": run_table, "task": {"Q": Q, "R": 1}, **tables},
    )


def notes(experiment: Experiment) -> list[str]:
    return notes_on(experiment, list(experiment.runs()))


# Loads and edits


def test_a_load_on_a_joint_with_damping_that_the_equations_lack_is_no_mistake() -> None:
    """The arm's equations have no damping: MuJoCo runs it, and matching is not told."""
    experiment = case(
        "arm/case1",
        plant={"compare": ["physics"]},
        run={"duration": "0.02 s", "engine": "python"},
        edit={"joint": "joint", "damping": 0.02},
        controller={"law": "grosmc"},
    )
    words = "is not told: by its equations, arm: joint 'joint' has damping"
    assert any(words in line for line in notes(experiment))


def test_a_disturbance_that_begins_as_the_run_ends_is_told() -> None:
    pulse = {
        "body": "rotor",
        "torque": ["0 N m", "0.1 N m", "0 N m"],
        "profile": "pulse",
        "start": "20 ms",
        "stop": "3 s",
        "label": "load",
    }
    experiment = servo(disturbance=pulse)
    note = "load never acts: runs end at 0.02 s, before it begins"
    assert note in notes(experiment)
    assert note not in notes_on(experiment.changed(duration=0.021), [])


@pytest.mark.parametrize(
    ("run_table", "told"),
    [({}, True), ({"integrator": "RK4"}, False), ({"timestep": "2 ms"}, False)],
)
def test_steps_that_nobody_sets_are_told(tmp_path: Path, run_table: Any, told: bool) -> None:
    model = LEG.replace('timestep="0.001" integrator="RK4"', "")
    words = "timestep 0.002 s and integrator Euler are MuJoCo's defaults"
    experiment = leg(tmp_path, model=model, run={"duration": "0.01 s"} | run_table)
    assert any(words in line for line in notes_on(experiment, [])) == told


@pytest.mark.parametrize(("place", "told"), [({}, True), ({"at": ["0 m"] * 3}, False)])
def test_an_added_mass_without_a_place_is_told_at_its_origin(tmp_path, place, told) -> None:
    experiment = leg(tmp_path, edit={"body": "shank", "added_mass": "1 kg"} | place)
    words = "the added mass of 1 kg sits at the origin of shank"
    assert any(words in line for line in notes_on(experiment, [])) == told


# Requirements that cannot fail, and limits

AT_LIMIT = "cannot fail: input below {} (the actuator gives 4 A at most)"


@pytest.mark.parametrize("plant", ["corrected", "physics"])
@pytest.mark.parametrize(("limit", "told"), [("3.9 A", False), ("4 A", True), ("5 A", True)])
def test_an_input_cannot_exceed_the_limit_of_its_actuator(plant, limit, told) -> None:
    experiment = servo(plant, requirement={"input_below": limit}, **LIMITED)
    assert notes(experiment) == [AT_LIMIT.format(limit)] * told


@pytest.mark.parametrize(("shoulder", "told"), [({"bandwidth": "500 rad/s"}, True), ({}, False)])
def test_an_input_of_several_motors_may_fail_if_one_gives_more_than_is_asked(
    shoulder: dict[str, Any], told: bool
) -> None:
    """One without a loop of its current, which its back-EMF brakes."""
    inputs = {"shoulder torque": shoulder, "elbow torque": {"bandwidth": "500 rad/s"}}
    winding = {"constant": "8 mN m/A", "resistance": "2 ohm", "ratio": 100}
    experiment = case(
        "two_link_arm",
        plant={"compare": ["physics"]},
        run={"start": {"elbow angle": "1 rad"}, "duration": "5 ms", "engine": "python"},
        actuator=[{"of": of, "limit": "4 N m"} for of in inputs],
        motor=[{"input": of} | winding | more for of, more in inputs.items()],
        requirement={"input_below": "5 N m"},
    )
    assert (
        any(line.startswith("cannot fail: input below 5 N m") for line in notes(experiment)) == told
    )


def test_an_input_without_limit_may_fail() -> None:
    assert notes(servo(requirement={"input_below": "1 MA"})) == []


def test_the_limit_of_a_model_s_own_actuator_counts(tmp_path) -> None:
    model = LEG.replace('joint="hip" gear="10"', 'joint="hip" ctrlrange="-3 3"')
    model = model.replace('kp="50"', 'kp="50" forcerange="-2 2"')
    Q = {"hip": 1, "knee": 1}
    found = notes(leg(tmp_path, Q, model, requirement={"input_below": "3 N m"}))
    assert found[0] == "cannot fail: input below 3 N m (the actuator gives 3 N m at most)"


def test_an_integral_surface_has_no_reaching_phase_by_its_definition() -> None:
    assert notes(servo(law="grosmc", requirement={"no_reaching_phase": True})) == [
        "cannot fail: no reaching phase: s(0) = 0 (an integral surface starts at zero)"
    ]


# A law that asks for 5 A in the first half of the run, and for 1 A in the second.
HALF = """
def half(t, x, memory, p):
    return 5.0 if t < 0.0095 else 1.0
"""


@pytest.mark.parametrize(
    ("loop", "limit", "words"),
    [
        (LIMITED, "4.5 A", "kept: at the actuator's limit 50 % of the time"),
        (LIMITED, "3 A", "FAILED: at the actuator's limit 50 % of the time"),
        ({}, "6 A", "kept"),
    ],
)
def test_the_time_at_the_limit_stands_beside_the_largest_input(
    tmp_path, loop, limit, words
) -> None:
    """The law asks for more than the limit of 4 A in ten of twenty samples."""
    (tmp_path / "own.py").write_text(HALF, encoding="utf-8")
    requirement = {"input_below": limit}
    experiment = servo(law="own:half", folder=tmp_path, requirement=requirement, **loop)
    (row,) = requirements_table(judge_runs(experiment.limits, list(experiment.runs()))).rows
    assert row[0] == words


# Weights and gains by name


@pytest.mark.parametrize(
    ("Q", "told"),
    [
        (
            [1, 2, 3, 4],
            "weights of lqr, by the order of the list: Q: hip 1, hip rate 2, knee 3, "
            "knee rate 4; R: hip 1, knee 1",
        ),
        ({"hip": 1, "hip rate": 0, "knee": 3, "knee rate": 4}, ""),
        ({"hip": 1, "knee": 3}, "Q of lqr leaves out 'hip rate', 'knee rate': weight 0"),
    ],
)
def test_a_robot_s_weights_are_told_by_name_unless_the_file_has_all_names(
    tmp_path, Q, told
) -> None:
    found = [line for line in notes(leg(tmp_path, Q)) if line.startswith(("Q of", "weights of"))]
    assert found == [told] * bool(told)


def test_the_tables_of_a_run_have_weights_and_gains_by_name(tmp_path, capsys: Screen) -> None:
    """On two integrators K = [sqrt(q), sqrt(2 sqrt(q))] for the weight q of the angle and R = 1."""
    Q = {"hip": 16, "knee": 81}
    words = (
        "Q: hip 16, hip rate 0, knee 81, knee rate 0; R: hip 1, knee 1; "
        "K of hip: hip 4, hip rate 2.828; K of knee: knee 9, knee rate 4.243"
    )
    (row,) = gains_table(list(leg(tmp_path, Q).runs())).rows
    assert row[-1] == words
    run("list", cases.write(tmp_path, "leg.xml", task={"Q": Q, "R": 1}))
    assert f"lqr: {words}" in " ".join(capsys.readouterr().out.split())


SAID = [
    "the torque about z on rotor moves no joint: the disturbance does nothing",
    "cannot fail: input below 9 A (the actuator gives 4 A at most)",
    "cannot fail: no reaching phase: s(0) = 0 (an integral surface starts at zero)",
]


def test_notes_stand_under_the_verdict_and_names_beside_the_gains(
    tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    """On the terminal and in the document."""
    monkeypatch.chdir(tmp_path)
    cases.write(
        tmp_path,
        "servo",
        law="grosmc",
        plant={"compare": ["physics"]},
        disturbance={"body": "rotor", "torque": ["0 N m", "0 N m", "1 N m"]},
        requirement={"input_below": "9 A", "no_reaching_phase": True},
        **LIMITED,
    )
    run("run", "mine.toml", "--no-figures")
    assert capsys.readouterr().out.splitlines()[1:4] == SAID
    content = json.loads((tmp_path / "renders" / "mine.json").read_text(encoding="utf-8"))
    assert content["answers"][0]["notes"] == SAID
    (ran,) = content["runs"]
    Q = {"rotor angle": 1, "rotor speed": 1}
    assert ran["weights"]["by_name"] == {"Q": Q, "R": {"current": 1}}
    assert ran["named_gains"]["K of current, rotor angle"] == ran["gains"]["K1"]
    assert ran["named_gains"]["eta"] == ran["gains"]["eta"]


# Notes on the plant and the loop


def test_a_rate_that_is_exact_on_purpose_is_told() -> None:
    sensors = [
        {"of": "rotor angle", "resolution": "1 mrad"},
        {"of": "rotor speed", "exact": True},
    ]
    found = notes(servo("corrected", sensor=sensors, requirement={"deviation_below": "1 rad"}))
    assert "ideal: rotor speed is known exactly" in found


@pytest.mark.parametrize(
    ("edits", "told"), [([], True), ([{"joint": "hip", "friction": "1 N m"}], False)]
)
def test_dry_friction_of_a_model_that_creeps_is_told(edits, told: bool, tmp_path: Path) -> None:
    """An edit with the same friction is the cure."""
    model = LEG.replace('name="hip" axis', 'name="hip" frictionloss="1" axis')
    found = notes(leg(tmp_path, [1, 0, 1, 0], model, edit=edits))
    assert any("dry friction of hip does not hold" in line for line in found) is told


# States that grow by themselves

# q'' = u + z, z' = d z: the input does not reach z. The output q' - 2 q of q'' = u has a zero at 2:
# while it is held at zero, q grows.
GROWING = """
import sympy as sp
import grosmc_mj as gm
q, w, z, d = sp.symbols("q w z d")
def carried(rate):
    return gm.affine_plant("carried", states={"q": "rad", "w": "rad/s", "z": "rad/s^2"},
        inputs={"u": "N"}, f=[w, z, d * z], g=[0, 1, 0], h=[q], parameters={"d": rate})
def unstable():
    return carried(0.5)
def stable():
    return carried(-0.5)
def slow():
    return carried(0.004)
def constant():
    return carried(0)
def undershooting():
    return gm.affine_plant("undershooting", states={"q": "rad", "w": "rad/s"},
        inputs={"u": "N"}, f=[w, 0], g=[0, d], h=[w - 2 * q], parameters={"d": 1})
"""
UNREACHED = "z grows by itself, at 0.5 1/s, and no input reaches it"
INTERNAL = (
    "{} at {} 1/s behind the outputs of fl-lqr: unstable internal dynamics, which no feedback of "
    "the outputs sees"
)


def growing(folder: Path, plant: str = "unstable", law: str = "lqr", duration: str = "1 s") -> Path:
    """A case file on one of the plants."""
    (folder / "grows.py").write_text(GROWING, encoding="utf-8")
    Q = [1] if plant == "undershooting" else [1, 1]
    return cases.write(
        folder,
        f"grows:{plant}",
        law=law,
        run={"start": {"q": "0.1 rad"}, "duration": duration},
        task={"reference": ["0"], "Q": Q, "R": 1},
        actuator={"of": "u", "limit": "10 N"},
        requirement={"settles_within": "6 s"},
    )


@pytest.mark.parametrize(
    ("plant", "law", "told"),
    [
        ("stable", "fl-lqr", []),
        ("constant", "fl-lqr", []),
        ("unstable", "lqr", [UNREACHED]),
        ("unstable", "fl-lqr", [UNREACHED, INTERNAL.format("z grows", "0.5")]),
        ("undershooting", "fl-lqr", [INTERNAL.format("q, w grow together", "2")]),
    ],
)
def test_what_grows_by_itself_stands_beside_the_verdict(
    tmp_path: Path, plant: str, law: str, told: list[str]
) -> None:
    """Whether it has begun to or not: z is zero at the start, and the requirement may be kept."""
    experiment = Experiment.load(growing(tmp_path, plant, law))
    assert [line for line in notes(experiment) if "grow" in line] == told


@pytest.mark.parametrize(("duration", "told"), [("2 s", False), ("4 s", True)])
def test_a_growth_by_less_than_a_hundredth_over_the_run_is_not_told(
    tmp_path: Path, duration: str, told: bool
) -> None:
    """At 0.004 1/s it grows by 0.8 % and by 1.6 %."""
    experiment = Experiment.load(growing(tmp_path, "slow", duration=duration))
    assert any("z grows by itself" in line for line in notes_on(experiment, [])) is told


def test_list_and_a_study_of_margins_tell_what_grows_by_itself(tmp_path, capsys: Screen) -> None:
    path = growing(tmp_path)
    run("list", path)
    assert UNREACHED in " ".join(capsys.readouterr().out.split())
    studied = margin_study(str(path), ["lqr"])
    rows = [LawMargins(setup=setup.name, law="lqr", levels=[]) for setup in studied.setups]
    (answer,) = margins_result(studied, rows, complete=True).answers
    assert answer.notes.count(UNREACHED) == 1


def test_no_law_on_all_states_holds_one_that_the_input_does_not_reach(tmp_path: Path) -> None:
    (tmp_path / "grows.py").write_text(GROWING, encoding="utf-8")
    at_rest = {"at": {"q": "0 rad"}}
    with pytest.raises(ArgumentError, match=f"LQR: {UNREACHED}"):
        case("grows:unstable", folder=tmp_path, plant=at_rest, task={"Q": [1, 1, 1], "R": 1})


# Laws of which nothing is required

PD = {"law": "pd", "frequency": "3 rad/s"}
FEW: dict[str, Any] = {"of": ["grosmc"], "stays_within": "2 rad"}


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ({"controller": [PD, {"law": "grosmc"}]}, True),
        # A file that requires something of some laws itself is taken at its word.
        ({"controller": [PD, {"law": "grosmc"}], "requirement": [FEW]}, False),
        ({}, False),
    ],
)
def test_a_law_of_which_the_base_requires_nothing_is_named(tmp_path: Path, tables, told) -> None:
    path = tmp_path / "mine.toml"
    inherited = {"extends": "servo/case1", "run": {"duration": "0.02 s"}}
    path.write_text(text_of(inherited | tables), encoding="utf-8")
    lines = [line for line in notes(Experiment.load(path)) if "nothing is required" in line]
    assert len(lines) == told
    words = "nothing is required of pd: the requirements of servo/case1 are of "
    assert all(line.startswith(words) for line in lines)

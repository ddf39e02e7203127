"""Notes on runs: requirements that cannot fail, time at a limit, weights by name; their places."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from case_texts import LEG_MODEL, short_step
from commands import Patch, Screen, run

from grosmc_mj.experiments.answer.tables import gains_table, requirements_table
from grosmc_mj.experiments.assumptions.notes import notes_on
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements.judging import judge_runs
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.studies.margins.answer import margins_result
from grosmc_mj.studies.margins.margins import margin_study
from grosmc_mj.studies.margins.row import LawMargins

# A law that asks for 5 A in the first half of the run, and for 1 A in the second.
LAW = """
def half(t, x, memory, p):
    return 5.0 if t < 0.0095 else 1.0
"""
LIMITED = """
[[actuator]]
of = "current"
limit = "4 A"
[[estimator]]
of = "rotor speed"
"""
LEG = """
[plant]
model = "leg.xml"
[run]
start = {{ hip = "10 deg" }}
duration = "0.01 s"
engine = "python"
[task]
Q = {Q}
R = 1
[[controller]]
law = "lqr"
"""


def read(folder: Path, text: str) -> Experiment:
    (folder / "own.py").write_text(LAW, encoding="utf-8")
    (folder / "leg.xml").write_text(LEG_MODEL, encoding="utf-8")
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return Experiment.load(path)


def test_a_load_on_a_joint_with_damping_that_the_equations_lack_is_no_mistake(
    tmp_path: Path,
) -> None:
    """The arm's equations have no damping: MuJoCo runs it, and matching is not told."""
    text = """
extends = "arm/case1"
[plant]
compare = ["physics"]
[run]
duration = "0.02 s"
[[edit]]
joint = "joint"
damping = 0.02
[[controller]]
law = "grosmc"
"""
    experiment = read(tmp_path, text)
    notes = notes_on(experiment, list(experiment.runs()))
    assert any("is not told: by its equations, arm: joint 'joint' has damping" in n for n in notes)


def test_a_disturbance_that_begins_after_the_run_is_told(tmp_path: Path) -> None:
    pulse = """
[[disturbance]]
body = "rotor"
torque = ["0 N m", "0.1 N m", "0 N m"]
profile = "pulse"
start = "2 s"
stop = "3 s"
label = "load"
"""
    experiment = read(tmp_path, short_step() + pulse)
    note = f"load never acts: runs end at {experiment.duration:g} s, before it begins"
    assert note in notes_on(experiment, list(experiment.runs()))
    longer = experiment.changed(duration=2.001)
    assert note not in notes_on(longer, [])


def test_steps_that_nobody_sets_are_told(tmp_path: Path) -> None:
    read(tmp_path, LEG.format(Q=1))
    model = LEG_MODEL.replace('timestep="0.001" integrator="RK4"', "")
    (tmp_path / "leg.xml").write_text(model, encoding="utf-8")
    case_file = tmp_path / "mine.toml"
    words = "timestep 0.002 s and integrator Euler are MuJoCo's defaults"
    assert any(words in line for line in notes_on(Experiment.load(case_file), []))

    text = LEG.format(Q=1).replace("[task]", 'integrator = "RK4"\n[task]')
    case_file.write_text(text, encoding="utf-8")
    assert not any("defaults" in line for line in notes_on(Experiment.load(case_file), []))


@pytest.mark.parametrize(("at", "told"), [("", True), ('at = ["0 m", "0 m", "0 m"]\n', False)])
def test_an_added_mass_without_a_place_is_told_at_its_origin(
    tmp_path: Path, at: str, told: bool
) -> None:
    edit = f'[[edit]]\nbody = "shank"\nadded_mass = "1 kg"\n{at}[task]'
    experiment = read(tmp_path, LEG.format(Q=1).replace("[task]", edit))
    words = "the added mass of 1 kg sits at the origin of shank"
    assert any(words in line for line in notes_on(experiment, [])) == told


def case(requirement: str, law: str = "lqr", plant: str = "physics") -> str:
    return short_step(law, plant) + f"[[requirement]]\n{requirement}\n"


def notes(folder: Path, text: str) -> list[str]:
    experiment = read(folder, text)
    return notes_on(experiment, list(experiment.runs()))


AT_LIMIT = "cannot fail: input below 4 A (the actuator gives 4 A at most)"


@pytest.mark.parametrize("plant", ["corrected", "physics"])
@pytest.mark.parametrize(
    ("limit", "expected"),
    [("3.9 A", []), ("4 A", [AT_LIMIT]), ("5 A", [AT_LIMIT.replace("below 4", "below 5")])],
)
def test_an_input_cannot_exceed_the_limit_of_its_actuator(tmp_path, plant, limit, expected) -> None:
    text = case(f'input_below = "{limit}"', plant=plant) + LIMITED
    assert notes(tmp_path, text) == expected


def test_an_input_without_limit_may_fail(tmp_path) -> None:
    assert notes(tmp_path, case('input_below = "1 MA"')) == []


def test_the_limit_of_a_model_s_own_actuator_counts(tmp_path) -> None:
    model = LEG_MODEL.replace('joint="hip" gear="10"', 'joint="hip" ctrlrange="-3 3"')
    (tmp_path / "arm.xml").write_text(
        model.replace('kp="50"', 'kp="50" forcerange="-2 2"'), encoding="utf-8"
    )
    text = LEG.format(Q="{ hip = 1, knee = 1 }").replace("leg.xml", "arm.xml")
    found = notes(tmp_path, text + '[[requirement]]\ninput_below = "3 N m"\n')
    assert found[0] == "cannot fail: input below 3 N m (the actuator gives 3 N m at most)"


@pytest.mark.parametrize(
    ("law", "expected"),
    [("grosmc", ["an integral surface starts at zero"]), ("lqr", [])],
)
def test_an_integral_surface_has_no_reaching_phase_by_its_definition(
    tmp_path, law, expected
) -> None:
    requirement = f'stays_within = "1 rad"\nno_reaching_phase = {str(law == "grosmc").lower()}'
    found = notes(tmp_path, case(requirement, law))
    assert [line.partition(" (")[2].rstrip(")") for line in found] == expected


@pytest.mark.parametrize(
    ("loop", "limit", "words"),
    [
        (LIMITED, "4.5 A", "kept: at the actuator's limit 50 % of the time"),
        (LIMITED, "3 A", "FAILED: at the actuator's limit 50 % of the time"),
        ("", "6 A", "kept"),
    ],
)
def test_the_time_at_the_limit_stands_beside_the_largest_input(
    tmp_path, loop, limit, words
) -> None:
    """The law asks for more than the limit of 4 A in ten of twenty samples."""
    experiment = read(tmp_path, case(f'input_below = "{limit}"', "own:half") + loop)
    judgements = judge_runs(experiment.limits, list(experiment.runs()))
    (row,) = requirements_table(judgements).rows
    assert row[0] == words


def test_a_robot_s_weights_in_a_list_are_told_by_name(tmp_path) -> None:
    found = notes(tmp_path, LEG.format(Q="[1, 2, 3, 4]"))
    assert found[0] == (
        "weights of lqr, by the order of the list: Q: hip 1, hip rate 2, knee 3, knee rate 4; R: "
        "hip 1, knee 1"
    )


def test_a_robot_s_weights_by_name_need_no_note(tmp_path) -> None:
    weights = '{ hip = 1, "hip rate" = 0, knee = 3, "knee rate" = 4 }'
    found = notes(tmp_path, LEG.format(Q=weights))
    assert not any(line.startswith(("Q of", "weights of")) for line in found)


def test_names_that_Q_leaves_out_are_told(tmp_path) -> None:
    found = notes(tmp_path, LEG.format(Q="{ hip = 1, knee = 3 }"))
    assert found[0] == "Q of lqr leaves out 'hip rate', 'knee rate': weight 0"


def test_the_tables_of_a_run_have_weights_and_gains_by_name(tmp_path) -> None:
    """On two integrators K = [sqrt(q), sqrt(2 sqrt(q))] for the weight q of the angle and R = 1."""
    experiment = read(tmp_path, LEG.format(Q="{ hip = 16, knee = 81 }"))
    (row,) = gains_table(list(experiment.runs())).rows
    assert row[-1] == (
        "Q: hip 16, hip rate 0, knee 81, knee rate 0; R: hip 1, knee 1; "
        "K of hip: hip 4, hip rate 2.828; K of knee: knee 9, knee rate 4.243"
    )


UNPLANNED = case('input_below = "9 A"\nno_reaching_phase = true', "grosmc") + LIMITED
SAID = [
    "the torque about z on rotor moves no joint: the disturbance does nothing",
    "cannot fail: input below 9 A (the actuator gives 4 A at most)",
    "cannot fail: no reaching phase: s(0) = 0 (an integral surface starts at zero)",
]


@pytest.fixture
def answered(tmp_path: Path, monkeypatch: Patch, capsys: Screen) -> tuple[str, dict]:
    """Output and document of a run about which there is much to say."""
    monkeypatch.chdir(tmp_path)
    load = '[[disturbance]]\nbody = "rotor"\ntorque = ["0 N m", "0 N m", "1 N m"]\n'
    (tmp_path / "mine.toml").write_text(UNPLANNED + load, encoding="utf-8")
    run("run", "mine.toml", "--no-figures")
    content = json.loads((tmp_path / "renders" / "mine.json").read_text(encoding="utf-8"))
    return capsys.readouterr().out, content


def test_notes_stand_under_the_verdict_on_the_terminal(answered) -> None:
    output, _ = answered
    assert output.splitlines()[1:4] == SAID


def test_notes_stand_beside_the_verdict_in_the_document(answered) -> None:
    _, content = answered
    assert content["answers"][0]["notes"] == SAID


def test_the_document_has_weights_and_gains_by_name(answered) -> None:
    _, content = answered
    (ran,) = content["runs"]
    assert ran["weights"]["by_name"] == {
        "Q": {"rotor angle": 1, "rotor speed": 1},
        "R": {"current": 1},
    }
    assert ran["named_gains"]["K of current, rotor angle"] == ran["gains"]["K1"]
    assert ran["named_gains"]["eta"] == ran["gains"]["eta"]


def test_list_prints_weights_and_gains_by_name(tmp_path, capsys) -> None:
    read(tmp_path, LEG.format(Q="{ hip = 16, knee = 81 }"))
    run("list", tmp_path / "mine.toml")
    words = " ".join(capsys.readouterr().out.split())
    assert "lqr: Q: hip 16, hip rate 0, knee 81, knee rate 0; R: hip 1, knee 1; K of hip:" in words


# Notes on the plant and the loop

ENCODER = '[[sensor]]\nof = "rotor angle"\nresolution = "1 mrad"\n'
EXACT = '[[sensor]]\nof = "rotor speed"\nexact = true\n'
OWN_FRICTION = LEG_MODEL.replace('name="hip" axis', 'name="hip" frictionloss="1" axis')


def test_a_rate_that_is_exact_on_purpose_is_told(tmp_path: Path) -> None:
    text = case('deviation_below = "1 rad"', plant="corrected")
    experiment = read(tmp_path, text + ENCODER + EXACT)
    notes = notes_on(experiment, list(experiment.runs()))
    assert "ideal: rotor speed is known exactly" in notes


@pytest.mark.parametrize(("edit", "told"), [("", True), ('friction = "1 N m"', False)])
def test_dry_friction_of_a_model_that_creeps_is_told(edit: str, told: bool, tmp_path: Path) -> None:
    """An edit with the same friction is the cure."""
    text = LEG.format(Q=[1, 0, 1, 0])
    if edit:
        text += f'[[edit]]\njoint = "hip"\n{edit}\n'
    read(tmp_path, text)
    (tmp_path / "leg.xml").write_text(OWN_FRICTION, encoding="utf-8")
    experiment = Experiment.load(tmp_path / "mine.toml")
    notes = notes_on(experiment, list(experiment.runs()))
    assert any("dry friction of hip does not hold" in note for note in notes) is told


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
def constant():
    return carried(0)
def undershooting():
    return gm.affine_plant("undershooting", states={"q": "rad", "w": "rad/s"},
        inputs={"u": "N"}, f=[w, 0], g=[0, d], h=[w - 2 * q], parameters={"d": 1})
"""
GROWING_CASE = """
[plant]
plant = "grows:{plant}"
[run]
start = {{ q = "0.1 rad" }}
duration = "1 s"
[task]
reference = ["0"]
Q = {Q}
R = 1
[[actuator]]
of = "u"
limit = "10 N"
[[controller]]
law = "{law}"
[[requirement]]
settles_within = "6 s"
"""
UNREACHED = "z grows by itself, at 0.5 1/s, and no input reaches it"
INTERNAL = (
    "{} at {} 1/s behind the outputs of fl-lqr: unstable internal dynamics, which no feedback of "
    "the outputs sees"
)


@pytest.fixture
def growing(tmp_path: Path) -> Callable[..., Path]:
    """Writer of a case on one of the plants."""
    (tmp_path / "grows.py").write_text(GROWING, encoding="utf-8")
    path = tmp_path / "mine.toml"

    def write(plant: str, law: str) -> Path:
        Q = [1] if plant == "undershooting" else [1, 1]
        path.write_text(GROWING_CASE.format(plant=plant, law=law, Q=Q), encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize(
    ("plant", "law", "told"),
    [
        ("stable", "lqr", []),
        ("stable", "fl-lqr", []),
        ("constant", "fl-lqr", []),
        ("unstable", "lqr", [UNREACHED]),
        ("unstable", "fl-lqr", [UNREACHED, INTERNAL.format("z grows", "0.5")]),
        ("undershooting", "fl-lqr", [INTERNAL.format("q, w grow together", "2")]),
    ],
)
def test_what_grows_by_itself_stands_beside_the_verdict(
    growing: Callable[..., Path], plant: str, law: str, told: list[str]
) -> None:
    """Whether it has begun to or not: z is zero at the start, and the requirement may be kept."""
    experiment = Experiment.load(growing(plant, law))
    lines = notes_on(experiment, list(experiment.runs()))
    assert [line for line in lines if "grow" in line] == told


def test_list_tells_what_grows_by_itself(growing: Callable[..., Path], capsys: Screen) -> None:
    run("list", growing("unstable", "lqr"))
    assert UNREACHED in " ".join(capsys.readouterr().out.split())


def test_a_study_of_margins_tells_what_grows_by_itself(growing: Callable[..., Path]) -> None:
    studied = margin_study(str(growing("unstable", "lqr")), ["lqr"])
    rows = [LawMargins(setup=setup.name, law="lqr", levels=[]) for setup in studied.setups]
    (answer,) = margins_result(studied, rows, complete=True).answers
    assert answer.notes.count(UNREACHED) == 1


def test_no_law_on_all_states_holds_one_that_the_input_does_not_reach(
    growing: Callable[..., Path],
) -> None:
    path = growing("unstable", "lqr")
    text = path.read_text(encoding="utf-8").replace("[run]", 'at = { q = "0 rad" }\n[run]')
    text = text.replace('reference = ["0"]', "").replace("[1, 1]", "[1, 1, 1]")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ArgumentError, match=f"LQR: {UNREACHED}"):
        Experiment.load(path)


INHERITED = """
extends = "servo/case1"
[run]
duration = "0.02 s"
[[controller]]
law = "pd"
frequency = "3 rad/s"
[[controller]]
law = "grosmc"
"""


def test_a_law_of_which_the_base_requires_nothing_is_named(tmp_path: Path) -> None:
    experiment = read(tmp_path, INHERITED)
    lines = [line for line in notes_on(experiment, list(experiment.runs())) if "nothing is" in line]
    assert len(lines) == 1
    assert lines[0].startswith("nothing is required of pd: the requirements of servo/case1 are of ")


@pytest.mark.parametrize("own", ["", '[[requirement]]\nof = ["grosmc"]\nstays_within = "2 rad"\n'])
def test_a_file_that_requires_something_of_some_laws_itself_is_taken_at_its_word(
    own: str, tmp_path: Path
) -> None:
    text = INHERITED + own if own else 'extends = "servo/case1"\n[run]\nduration = "0.02 s"\n'
    experiment = read(tmp_path, text)
    notes = notes_on(experiment, list(experiment.runs()))
    assert not [line for line in notes if line.startswith("nothing is required")]

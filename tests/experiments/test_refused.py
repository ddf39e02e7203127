"""Wrong case files: one line for each mistake, wherever it is in the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cases
import pytest
from cases import case
from commands import Screen, assert_one_line, run
from own_files import LEG, OWN, PYTHON, pendulum

from grosmc_mj import cli
from grosmc_mj.experiments.assumptions.notes import notes_on
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import CASES
from grosmc_mj.ground.errors import MISTAKE_SEPARATOR, ArgumentError, GrosmcError

TOO_LARGE = [
    {"disturbance": {"input": "current", "amplitude": "1e308 A"}},
    {"disturbance": {"body": "rotor", "torque": ["1e308 N m", "0 N m", "0 N m"]}},
    {"edit": {"body": "rotor", "mass_scale": 1e308}},
    {"uncertain": {"number": "edit.rotor.mass_scale", "values": [1, 1e308]}},
    {"requirement": {"always": "abs(rotor angle) < 1e308 rad"}},
    {"requirement": {"stays_within": "1e308 rad"}},
    {"sensor": {"of": "rotor angle", "bias": "-1e308 rad"}},
]


@pytest.mark.parametrize("tables", TOO_LARGE)
def test_a_number_whose_square_is_infinite_is_refused_where_it_enters(tables) -> None:
    with pytest.raises(ArgumentError, match=r"1e\+?308.* is too large: write 1e\+100 at most"):
        case("servo", **tables)


@pytest.mark.parametrize("plant", ["physics", "corrected"])
@pytest.mark.parametrize("amplitude", ["1e20 A", "-1e99 A"])
def test_a_run_that_ends_in_its_first_step_fails_its_requirements(plant, amplitude) -> None:
    requirement = {"stays_within": "1 rad", "always": "abs(current) < 9 A"}
    disturbance = {"input": "current", "amplitude": amplitude}
    tables = {"disturbance": disturbance, "requirement": requirement}
    result = case("servo", plant={"compare": [plant]}, **tables).run(plant, "lqr")
    assert len(result.trajectory.time) == 1
    assert [item.kept for item in result.requirements] == [False, False]
    # The notes look at the loads of the run, of which there is no row.
    assert all(isinstance(line, str) for line in notes_on(result.case, [result]))


@pytest.mark.parametrize("formula", ["sqrt(0.01 - t)", "1/(t - 0.01)"])
def test_a_reference_without_a_value_during_the_run_is_refused(formula) -> None:
    """The law may have run by it: its own error is no answer."""
    law = {"law": "pd", "frequency": 6, "damping": 0.7}
    with pytest.raises(ArgumentError, match=r"no value or no derivative at t = 0.01 s"):
        case("servo", controller=law, task={"reference": [formula]}).run("physics", "pd")


# Lines of a file above a sound [plant], and words of the refusal.
TEXTS = [
    ("title = sound", ': a text has quotes: write "sound"'),
    (r'title = "C:\Users\me"', """: in "..." a \\ begins an escape: write / or '...'"""),
    (r'title = "a\base"', """(at line 1): in "..." a \\ begins an escape: write / or '...'"""),
    ('title = "a\tb"', "characters that cannot be printed (at line 1)"),
    ('title = "a"\ntitle = "b"', ": title stands in line 1 already"),
    (r"extends = 'C:\work\base.toml'", "must be a file beside it, such as"),
    ('extends = "basis.toml"', "extends: there is no basis.toml beside it"),
    ('[[edit]]\nbody = "link"\nmass_scale = 2,5', ": a decimal point: write 2.5"),
    ('[[edit]]\nbody = "link"\nmass_scale = True', ": write true"),
    ('[[requirement]]\novershoot_below = "5 %"', "must be a number: write 0.05, a share"),
    ("[task]\nreference = { joint = 1.0 }", 'must be formulas in quotes: write "1.0" for 1.0'),
    (
        '[[motor]]\ninput = "torque"\nconstant = "1 N m/A"',
        'resistance is missing: write it as in resistance = "1 ohm"; required: input, constant',
    ),
    ('[[edit]]\nbody = "link"\nmass_scale = "2"', ": it is a text: write 2 without quotes"),
    ('[run]\nduration = "1,5 s"', '"1,5 s" has a decimal comma: write "1.5 s"'),
    ("[run]\ntimestep = -1.5e-3 rad/s", 'a number with a unit is a text: write "-1.5e-3 rad/s"'),
    ('[computing]\nmissed = "5 %"', "'5 %' must be a number without a unit: write 0.05"),
    (
        '[[disturbance]]\nbody = "link"\ntorque = ["0 N m"\nlabel = "push"',
        ": torque in line 3 has a bracket left open",
    ),
    ('[lugre]\njoint = "joint"', "[lugre] is one of possibly several: write [[lugre]]"),
    ("[run]\nduration = 1", "duration: 1 has no unit"),
]
PLANT = '[plant]\nsystem = "arm"\n'
LAW = '[[controller]]\nlaw = "lqr"\n'
RUN = '[run]\nduration = "1 s"\n'


@pytest.mark.parametrize(("lines", "words"), TEXTS)
def test_a_mistake_in_the_text_is_one_line(tmp_path: Path, lines: str, words: str) -> None:
    path = tmp_path / "mine.toml"
    run_table = "" if "[run]" in lines else RUN
    path.write_text(f"{lines}\n{PLANT}{run_table}{LAW}", encoding="utf-8")
    with pytest.raises(ArgumentError) as refusal:
        Experiment.load(path)
    line = str(refusal.value)
    assert line.startswith(f"{path}: ")
    assert words in line
    assert "\n" not in line


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        (PLANT + LAW, "there is no [run]: it has the keys start, duration"),
        (PLANT + RUN, "there is no [[controller]]: it has the keys law, switching"),
        (
            "controller = []\n" + PLANT + RUN,
            "controller = [] must have 1 entry at least: write a table [[controller]] in its",
        ),
    ],
)
def test_a_missing_table_is_shown_with_its_own_keys(tmp_path, tables, words) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(tables, encoding="utf-8")
    with pytest.raises(ArgumentError) as refusal:
        Experiment.load(path)
    assert words in str(refusal.value)


def pushed(**values: Any) -> dict[str, Any]:
    """A disturbance of the arm's link, by a sine of 1 Hz, with other values."""
    sine = {"body": "link", "torque": ["0 N m", "1 N m", "0 N m"], "profile": "sine"}
    return {"disturbance": sine | {"frequency": "1 Hz"} | values}


def controlled(law: str, **numbers: Any) -> dict[str, Any]:
    return {"controller": {"law": law, **numbers}}


RUNS = [
    ({"plant": {"compare": []}}, "compare = [] must have 1 entry at least: name one, or leave"),
    ({"plant": {"system": 3}}, "plant: system = 3 must be a text in quotes"),
    ({"plant": {"sytem": "arm"}}, "plant: unknown key 'sytem': did you mean 'system'?"),
    ({"plant": {"model": "arm.xml"}}, "give one of system, model and plant, not"),
    ({"run": {"control_period": "1.5 ms"}}, "no multiple of the timestep 0.001 s"),
    ({"run": {"timestep": "1 s"}}, "control_period: 1 s must be below the duration of 0.02 s"),
    ({"run": {"timestep": "0 s"}}, "run: timestep: 0 s must be above 0 s"),
    ({"run": {"control_period": "0 s"}}, "run: control_period: 0 s must be above 0 s"),
    ({"run": {"engine": "fortran"}}, "run: unknown engine 'fortran': valid: native, python"),
    (
        {"run": {"start": {"joint angle": float("nan")}}},
        "run: start: joint angle: nan must be finite",
    ),
    ({"edit": {"body": "lnk", "mass_scale": 2}}, "edit 1: unknown body 'lnk': did you mean 'link'"),
    ({"edit": {"body": "link", "damping": 2}}, "edit 1: a body has no damping; valid: mass_scale"),
    ({"edit": {"body": "link", "mass_scale": 2, "added_mass": "1 kg"}}, "write two [[edit]]"),
    ({"edit": {"body": "link", "mass_scale": 2, "at": ["1 m", "0 m", "0 m"]}}, "give it one"),
    (pushed(torque=["0 N m", "1 N m"]), "torque: ['0 N m', '1 N m'] must be a list of 3"),
    (pushed(profile="table"), "disturbance 1: a table has no frequency"),
    ({"disturbance": {"input": "torque"}}, "disturbance 1: amplitude is missing"),
    (
        {"disturbance": {"measured": "joint angel", "amplitude": 1}},
        "did you mean 'joint angle'?",
    ),
    (
        {"disturbance": {"state": "joint angle", "amplitude": "1 rad/s"}},
        "arm has a model in MuJoCo: name a body or an input",
    ),
    ({"disturbance": {"state": "joint angle", "torque": [1]}}, "a state has no torque"),
    (
        {"disturbance": {"input": "torque", "amplitude": "1 N m", "profile": "table"}},
        "disturbance 1: a table needs values and hold",
    ),
    (
        {"disturbance": {"input": "torque", "amplitude": "1 N m", "profile": "sine"}},
        "disturbance 1: a sine needs frequency",
    ),
    (
        {
            "disturbance": {
                "input": "torque",
                "amplitude": "1 N m",
                "profile": "pulse",
                "start": "-2 s",
                "stop": "-1 s",
            }
        },
        "disturbance 1: it ends at -1 s, a run begins at 0 s: it never acts",
    ),
]
LAWS = [
    (controlled("grosmc", kk=18), "controller grosmc: unknown key 'kk': did you mean 'k'?"),
    (controlled("grosmc", k=[1, [2]]), "k = [1, [2]] must be a number"),
    (controlled("grosmc", k="big"), 'k: "big" is no number with a unit, such as'),
    (
        controlled("grosmc", Q=[1, 2, 3]),
        "Q = [1, 2, 3] must be a number, 2 numbers or a 2 x 2 matrix",
    ),
    (controlled("grosmc", G=[[1, 2, 3]]), "G = [[1.0, 2.0, 3.0]] must be 1 x 2 finite numbers"),
    (controlled("grosmc", switching="implcit"), "did you mean 'implicit'?"),
    ({"controller": [{"law": "grosmc"}] * 2}, "two controllers are called 'grosmc'"),
    (
        {"controller": [{"law": "lqr", "name": "a/b"}, {"law": "lqr", "name": "a_b"}]},
        "controllers 'a/b' and 'a_b' would share the file of a_b: give one another name",
    ),
    (controlled("cart-ism"), "law 'cart-ism' is there for cart_pendulum alone: take"),
    (controlled("numpy:zeros"), "numpy:zeros makes no controller: TypeError"),
    (
        controlled("own.py:law"),
        "a module is named without .py: write own:law",
    ),
    ({"task": {"reference": ["0", "0"]}}, "2 formulas, there are 1 outputs"),
    ({"task": {"reference": ["1/t"]}}, "no value at t = 0"),
    ({"task": {"outputs": {"of": "leg"}}}, "unknown outputs 'leg': valid: plant"),
    (
        {"task": {"outputs": {"formulas": ["speed"]}}},
        "task: outputs: 'speed' has 'speed' at character 1, may have",
    ),
    (
        {"task": {"outputs": {"formulas": ["1"]}, "reference": ["0"]}},
        "task: outputs: output 1, 1, has no relative degree",
    ),
    (
        {"task": {"outputs": {"of": "tip", "formulas": ["joint angle"]}}},
        "task: outputs: of and formulas are the same: give one of them",
    ),
    (controlled("lqi", adaptation=1), "adaptation is a number of adaptive, linear-adaptive"),
    (controlled("fl-pid", frequency=-2), "frequency = -2 must be above 0"),
    (controlled("adrc", switching="implicit"), "not switch, so it has no switching"),
    (controlled("pd"), "pd needs frequency"),
]


def refusal_of(folder: Path, base: str, **tables: Any) -> str:
    """The line about a case, until all of its runs are made."""
    with pytest.raises(GrosmcError) as refusal:
        list(case(base, folder=folder, **tables).runs())
    line = str(refusal.value)
    assert "\n" not in line
    return line


@pytest.mark.parametrize(("tables", "words"), [*RUNS, *LAWS])
def test_a_mistake_on_a_system_of_the_package_is_one_line(tmp_path, tables, words) -> None:
    assert words in refusal_of(tmp_path, "arm", **tables)


OWNS = [
    ({"plant": {"plant": "onw:pendulum"}}, "there is no onw.py in"),
    ({"plant": {"plant": "own:"}}, "'own:' must be module:name"),
    ({"plant": {"plant": r"C:\me\own.py:plant"}}, "must be module:name, such as my_module"),
    (controlled("math:sin"), "math is a module of Python itself"),
    (controlled("own:law", **{"class": 4}), "'class' cannot be the name of a number"),
    (controlled("own:pendulum", a=4), "own:pendulum() cannot be called with a: "),
    ({"edit": {"parameter": "k", "scale": 1.5}}, "unknown parameter 'k': valid: m"),
    ({"edit": {"body": "rod", "mass_scale": 2}}, "edit a parameter"),
    ({"edit": {"known": True, "parameter": "m", "scale": 2}}, "edit 1: known is for a model"),
    (controlled("grosmc"), "grosmc needs k and epsilon"),
    (controlled("lqr", switching="sign"), "it does not switch"),
    ({"task": OWN["task"] | {"reference": ["own:wrong"]}}, "must be a pair"),
]


@pytest.mark.parametrize(("tables", "words"), OWNS)
def test_a_mistake_on_a_users_plant_is_one_line(tmp_path, tables, words) -> None:
    (tmp_path / "own.py").write_text(PYTHON, encoding="utf-8")
    assert words in refusal_of(tmp_path, "own:pendulum", **(OWN | tables))


BALL = "grosmc_mj.experiments.cases.ball_beam.ball_beam"
MAGLEV = "grosmc_mj.experiments.cases.maglev.maglev"
SOUND_CASES: dict[str, dict[str, Any]] = {
    "leg.xml": {"task": {"Q": [100, 1, 100, 1], "R": 1}},
    f"{MAGLEV}:plant": {
        "plant": {"at": {"gap": "10 mm"}},
        "task": {"Q": [1e8, 1e5, 10], "R": 1e-3},
    },
    f"{BALL}:plant": {
        "task": {"Q": [10, 10, 1, 1], "R": 0.1},
        "controller": {"law": "fl-lqr"},
    },
    "furuta.xml": {
        "task": {"Q": [1, 5, 0.02, 0.02], "R": 100},
        "controller": {"law": "grosmc"},
    },
}
LEG_CASE, LEVITATED, BEAM, ROTARY = SOUND_CASES
OPERATING_POINTS = [
    (
        LEG_CASE,
        {"plant": {"model": "lag.xml"}},
        ": did you mean 'leg.xml'?",
    ),
    (LEG_CASE, {"plant": {"model": r"C:\me\leg.xml"}}, r"there is no file C:\me\leg.xml"),
    (
        LEG_CASE,
        {"plant": {"model": r"models\leg.xml"}},
        "there is no file models\\leg.xml: write / in the place of \\",
    ),
    (LEG_CASE, {"plant": {"model": "bad.xml"}}, "is no text in UTF-8"),
    (LEG_CASE, controlled("fl-lqr"), "law 'fl-lqr' does not fit leg, a model"),
    (LEVITATED, {"plant": {"at": {"gap": "10"}}}, 'plant: at: gap: "10" has no unit'),
    (
        LEVITATED,
        {"plant": {"at": {"gap": "10 mm", "current": "0 A"}}},
        "at: maglev rests nowhere",
    ),
    (
        LEVITATED,
        {"task": {"Q": 1, "R": 1, "reference": ["1"]}},
        "under lqr all states are held",
    ),
    (LEVITATED, controlled("pid", kp="20 V/m", ki=1, kd=1), "plain numbers, in units of the input"),
    (LEVITATED, controlled("linear-grosmc", uncertainty=1), "must be a table with body"),
    (LEVITATED, controlled("linear-grosmc", uncertainty={"scales": {"R": 2}}), "[least, "),
    (
        LEVITATED,
        {"motor": {"input": "voltage", "constant": "7.68 mN m/A", "resistance": "2.6 ohm"}},
        "maglev has no model in MuJoCo, so no machine as built",
    ),
    (
        BEAM,
        {"task": {"Q": [10, 10, 1], "R": 1}},
        "of position, of relative degree (3,), is singular",
    ),
    (BEAM, {"task": {"Q": [10, 10, 1], "R": 0.1}} | controlled("grosmc"), "[plant] at"),
    (BEAM, {"design": {"plant": f"{BALL}:nothing"}}, "unknown name in"),
    (BEAM, {"design": {"plant": f"{MAGLEV}:plant"}}, "has the states"),
    (
        ROTARY,
        {"task": {"Q": [1, 5, 0.02, 0.02], "R": 1, "reference": ["1", "2"]}},
        "(1 for 2 joints), so under grosmc all states are held at the operating point",
    ),
    (ROTARY, {"design": {"plant": f"{BALL}:plant"}}, "from MuJoCo's own dynamics"),
    (
        ROTARY,
        {"plant": {"model": "nowhere:furuta.xml"}},
        "nowhere, which is not installed; run: pip inst",
    ),
    (ROTARY, {"plant": {"model": "../a:furuta.xml"}}, "must be a file, or package:path of one"),
    (ROTARY, {"plant": {"at": {"rod": "90 deg"}}}, "furuta rests nowhere near"),
]


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with models for the cases, and one that is no text."""
    folder = tmp_path_factory.mktemp("models")
    (folder / "leg.xml").write_text(LEG, encoding="utf-8")
    furuta = (CASES / "furuta" / "furuta.xml").read_text(encoding="utf-8")
    (folder / "furuta.xml").write_text(furuta, encoding="utf-8")
    (folder / "bad.xml").write_bytes(b'<mujoco model="\xff"/>')
    (folder / "models").mkdir()
    (folder / "models" / "leg.xml").write_text(LEG, encoding="utf-8")
    return folder


@pytest.mark.parametrize(("base", "tables", "words"), OPERATING_POINTS)
def test_a_mistake_at_an_operating_point_is_one_line(models, base, tables, words) -> None:
    assert words in refusal_of(models, base, **(SOUND_CASES[base] | tables))


FRICTION = {"joint": "shaft", "coulomb": "0.05 N m"}
MOTOR = {"input": "current", "constant": "7.68 mN m/A", "resistance": "2.6 ohm"}
MACHINES = [
    (
        {"lugre": FRICTION | {"stiffness": "1 GN m/rad"}, "run": {"timestep": "0.25 ms"}},
        "with a timestep of 0.00025 s makes unstable: take",
    ),
    ({"motor": MOTOR | {"input": "currant"}}, "motor 1: unknown input 'currant': did you mean"),
    (
        {"motor": MOTOR | {"ratio": 70, "added": False}},
        "which is no part of the model's damping of 0.0088",
    ),
    (
        {"stop": {"joint": "shaft", "low": "-2 rad", "high": "-1 rad"}},
        "shaft starts at 0 rad, beyond its stops at -2 and -1 rad: move the start or the stops",
    ),
    ({"edit": {"known": True, "body": "rotor"}}, "edit 1: the edit changes nothing"),
    (
        {"computing": {"delay": "1 ms", "assumed": ["jitter"]}},
        "assumed: the table gives no jitter",
    ),
    (
        {
            "sensor": {"of": "rotor angle", "noise": "1 mrad"},
            "estimator": {
                "of": ["rotor angle", "rotor speed"],
                "law": "kalman",
                "load": "1e99 A",
            },
        },
        "kalman: no steady filter",
    ),
    # Keys of former versions.
    ({"swinging_load": {"body": "rotor"}}, "[[swinging_load]] is no part any more: describe"),
    (
        {"edit": {"joint": "shaft", "tilt": "1 deg"}},
        "edit 1: tilt of a joint is no edit any more",
    ),
]
REQUIREMENTS = [
    ({}, "requirement 1: nothing is required"),
    ({"input_below": "1 A", "of": ["lqg"]}, "requirement 1: unknown controller 'lqg'"),
    (
        {"signal": "rotor angle", "above": "1.2 rad", "below": "0.8 rad"},
        "keeps no value: none is above 1.2 rad and below 0.8 rad",
    ),
    (
        {"always": "t < 1 s or always[0 s, 1 ms] (rotor angle > 2 rad and rotor angle < 1 rad)"},
        "none is above 2 rad and below 1 rad",
    ),
    (
        {"band": "1 rad", "input_below": "1 A"},
        "band is for settles_within or reaches_within or",
    ),
    ({"settles_within": "1 s", "band": "0 rad"}, "'0 rad' must be positive"),
    (
        {"rms_below": "1 mrad", "after": "7 s"},
        "after = 7 s must be before the end of a run at 0.02 s",
    ),
    ({"stays_within": "1 rad", "after": "-1 s"}, "not be negative"),
    (
        {"stays_within": "1 rad", "state": "rotor angel"},
        "unknown state 'rotor angel': did you mean 'rotor angle'?",
    ),
    (
        {"stays_within": "1 rad", "state": "rotor speed"},
        'stays_within: "1 rad" cannot be converted to rad/s',
    ),
    (
        {"stays_within": "1 rad", "input_below": "1 A", "state": "rotor angle"},
        "input_below: it is not asked of a state: stays_within, final_error_below, rms_below, ",
    ),
    (
        {"input_below": "1 A", "state": "rotor angle"},
        "state is for stays_within or final_error_below or rms_below or reaches",
    ),
    (
        {"cart_travel_below": "10 m"},
        'requirement 1: cart_travel_below is now written state = "cart position", '
        'stays_within = "10 m"',
    ),
]


@pytest.mark.parametrize(("tables", "words"), MACHINES)
def test_a_mistake_in_a_machine_is_one_line(tmp_path, tables, words) -> None:
    assert words in refusal_of(tmp_path, "servo", **tables)


@pytest.mark.parametrize(("requirement", "words"), REQUIREMENTS)
def test_a_mistake_in_a_requirement_is_one_line(tmp_path, requirement, words) -> None:
    assert words in refusal_of(tmp_path, "servo", requirement=requirement)


@pytest.mark.parametrize("requirement", [{"overshoot_below": 0.1}, {"settles_within": "1 ms"}])
def test_a_share_of_no_initial_error_is_refused(tmp_path, requirement) -> None:
    run_at_rest = {"start": {"rotor angle": "1 rad"}, "duration": "6 s"}
    task = {"reference": ["1"], "sign": -1}
    line = refusal_of(tmp_path, "servo", run=run_at_rest, task=task, requirement=requirement)
    assert "and runs start without error: ask for stays_within" in line


def test_an_overshoot_of_several_outputs_is_refused(tmp_path) -> None:
    line = refusal_of(tmp_path, "two_link_arm", requirement={"overshoot_below": 0.05})
    assert "several outputs have no one overshoot" in line


def test_two_mistakes_are_named_at_once() -> None:
    friction = FRICTION | {"stiffness": 4}
    with pytest.raises(ArgumentError) as refusal:
        case("servo", transmission={"joint": "shfat", "inertia": "10 g m^2"}, lugre=friction)
    first, joint, unit = str(refusal.value).split(MISTAKE_SEPARATOR)
    assert first.endswith("2 mistakes:")
    assert "transmission 1: unknown joint" in joint
    assert "lugre 1: stiffness: 4 has no unit" in unit


def test_a_wrong_timestep_is_told_before_a_requirement_that_cannot_be_judged(tmp_path) -> None:
    periods = {"control_period": "1 ms", "timestep": "0.3 ms"}
    requirement = {"settles_within": "19 ms"}
    line = refusal_of(tmp_path, "servo", run=periods, requirement=requirement)
    assert "period 0.001 s is no multiple of the timestep" in line


def test_a_law_without_surface_is_not_asked_for_its_surface() -> None:
    laws = [{"law": "lqr"}, {"law": "grosmc"}]
    requirement = {"of": ["lqr", "grosmc"], "no_reaching_phase": True}
    (limit,) = case("servo", controller=laws, requirement=requirement).limits
    assert limit.laws == ("grosmc",)


# Files


def test_a_mark_of_the_byte_order_is_no_part_of_a_case_file(tmp_path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(cases.text("arm", title="sound"), encoding="utf-8-sig")
    assert Experiment.load(path).title == "sound"


def test_a_binary_file_is_refused(tmp_path) -> None:
    (tmp_path / "mine.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ArgumentError, match="no text in UTF-8"):
        Experiment.load(tmp_path / "mine.toml")


def test_a_file_whose_name_is_no_text_is_refused(tmp_path: Path, capsys: Screen) -> None:
    name = b"caf\xe9".decode("utf-8", "surrogateescape")
    assert run("run", cases.write(tmp_path, "servo", name=name)) == cli.WRONG
    assert_one_line(capsys.readouterr().err)


def test_a_file_in_place_of_the_folder_is_named(tmp_path: Path, capsys: Screen) -> None:
    (tmp_path / "file").write_text("")
    assert run("run", "servo/nominal", "--out", tmp_path / "file") == cli.WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert "is a file, and a folder is needed" in error


# A user's own Python: what is written in its place, and words of the line.
@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        ("p.a * x[0]", "p.a * x[9]", "IndexError"),
        ("p.a * x[0]", "p.aa * x[0]", "p has no 'aa'"),
        ("return gm.affine_plant", "return gm.affine_plan", "AttributeError"),
        ("import sympy as sp", "import sympi as sp", "No module named 'sympi'"),
        ("def law(t", "def law(t,,", "SyntaxError"),
        ("q, w = sp", "raise SystemExit\nq, w = sp", "SystemExit"),
    ],
)
def test_an_error_in_a_users_python_points_to_its_line(tmp_path, good, bad, words) -> None:
    number = PYTHON[: PYTHON.index(good)].count("\n") + 1
    with pytest.raises(GrosmcError) as refusal:
        list(pendulum(tmp_path, PYTHON.replace(good, bad, 1)).runs())
    assert words in str(refusal.value)
    assert f"own.py:{number}: " in str(refusal.value)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("    x[0] * sum(x.tolist())\n", "numba cannot compile the law"),
        (
            "    if t > 0.1: raise ValueError('too late')\n",
            "ValueError: too late (law at t = 0.101 s)",
        ),
    ],
)
def test_an_error_in_a_compiled_law_points_to_its_line(tmp_path, capsys, line, words) -> None:
    before = "def law(t, x, memory, p):\n"
    number = PYTHON[: PYTHON.index(before)].count("\n") + 2
    (tmp_path / "own.py").write_text(PYTHON.replace(before, before + line), encoding="utf-8")
    native = OWN | {"run": OWN["run"] | {"engine": "native"}}
    path = cases.write(tmp_path, "own:pendulum", **native)
    assert run("run", path, "--no-figures", "--out", tmp_path / "out") == cli.WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    assert words in error
    assert f"own.py:{number}: " in error


def test_a_law_that_returns_no_numbers_is_an_error_of_the_case_file(tmp_path) -> None:
    returning = PYTHON.replace("    return p.plant", "    return 'a'\n    return p.plant", 1)
    with pytest.raises(GrosmcError, match=r"mine.toml.*law returned"):
        list(pendulum(tmp_path, returning).runs())

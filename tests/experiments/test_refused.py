"""Wrong case files: one line for each mistake, wherever it is in the file."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from case_texts import (
    ARM,
    BEAM,
    FURUTA,
    LEG,
    LUGRE,
    MAGLEV,
    MOTOR,
    OWN,
    OWN_NATIVE,
    PYTHON,
    RIVAL,
    SERVO,
    STEP,
    load,
    short_step,
    written,
)

from grosmc_mj import cli
from grosmc_mj.experiments.assumptions.notes import notes_on
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.errors import MISTAKE_SEPARATOR, ArgumentError, GrosmcError

# Numbers that are finite, and whose products are not.
TOO_LARGE = [
    '[[disturbance]]\ninput = "current"\namplitude = "1e308 A"\n',
    '[[disturbance]]\nbody = "rotor"\ntorque = ["1e308 N m", "0 N m", "0 N m"]\n',
    '[[edit]]\nbody = "rotor"\nmass_scale = 1e308\n',
    '[[edit]]\njoint = "shaft"\ndamping = 1e308\n',
    '[[actuator]]\nof = "current"\ngain = 1e308\n',
    '[[uncertain]]\nnumber = "edit.rotor.mass_scale"\nvalues = [1, 1e308]\n',
    '[[requirement]]\nalways = "abs(rotor angle) < 1e308 rad"\n',
    '[[requirement]]\nstays_within = "1e308 rad"\n',
    '[[sensor]]\nof = "rotor angle"\nbias = "-1e308 rad"\n',
]


@pytest.mark.parametrize("table", TOO_LARGE)
def test_a_number_whose_square_is_infinite_is_refused_where_it_enters(tmp_path, table) -> None:
    with pytest.raises(ArgumentError, match=r"1e\+?308.* is too large: write 1e\+100 at most"):
        load(tmp_path, f"{short_step()}{table}").checked()


@pytest.mark.parametrize("plant", ["physics", "corrected"])
@pytest.mark.parametrize("amplitude", ["1e20 A", "-1e99 A"])
def test_a_run_that_ends_in_its_first_step_fails_its_requirements(
    tmp_path, plant, amplitude
) -> None:
    load_of_input = f'[[disturbance]]\ninput = "current"\namplitude = "{amplitude}"\n'
    table = '[[requirement]]\nstays_within = "1 rad"\nalways = "abs(current) < 9 A"\n'
    case = load(tmp_path, f"{short_step(plant=plant)}{load_of_input}{table}")
    result = case.run(plant, "lqr")
    assert len(result.trajectory.time) == 1
    assert [item.kept for item in result.requirements] == [False, False]
    # The notes look at the loads of the run, of which there is no row.
    assert all(isinstance(line, str) for line in notes_on(result.case, [result]))


@pytest.mark.parametrize("formula", ["sqrt(0.01 - t)", "log(0.01 - t)", "1/(t - 0.01)"])
def test_a_reference_without_a_value_during_the_run_is_refused(tmp_path, formula) -> None:
    """The law may have run by it: its own error is no answer."""
    law = "frequency = 6\ndamping = 0.7\n"
    case = load(tmp_path, f'{short_step("pd")}{law}[task]\nreference = ["{formula}"]\n')
    with pytest.raises(ArgumentError, match=r"no value or no derivative at t = 0.01 s"):
        case.run("physics", "pd")


# A part of a sound text, the mistake in its place, and words of the line.
_ESCAPED = """: in "..." a \\ begins an escape: write / or '...'"""
WRITTEN = [
    ('title = "sound"', "title = sound", ': a text has quotes: write "sound"'),
    ('title = "sound"', r'title = "C:\Users\me"', _ESCAPED),
    ('title = "sound"', r'title = "a\base"', f"(at line 2){_ESCAPED}"),
    ('title = "sound"', 'title = "a\tb"', "characters that cannot be printed (at line 2)"),
    ('title = "sound"', 'title = "a"\ntitle = "b"', ": title stands in line 2 already"),
    ('title = "sound"', r"extends = 'C:\work\base.toml'", "must be a file beside it, such as"),
    ('title = "sound"', 'extends = "basis.toml"', "extends: there is no basis.toml beside it"),
    ("mass_scale = 2", "mass_scale = 2,5", ": a decimal point: write 2.5"),
    ("mass_scale = 2", "mass_scale = True", ": write true"),
    ("mass_scale = 2", 'mass_scale = "2"', ": it is a text: write 2 without quotes"),
    ("mass_scale = 2", 'mass_scale = "2,5"', ": it is a text: write 2.5 without quotes"),
    ('"10 deg"', '"1,5 deg"', '"1,5 deg" has a decimal comma: write "1.5 deg"'),
    ('"0 N m"]\n', '"0 N m"\n', ": torque in line 13 has a bracket left open"),
    ('system = "arm"', 'model = "C:/me/arm.xml"', "plant: model: there is no file C:/me/arm.xml"),
    ('system = "arm"', r"model = 'C:\me\arm.xml'", r"plant: model: there is no file C:\me\arm.xml"),
    ('system = "arm"', 'model = "../arm.xml"', "plant: model: there is no file ../arm.xml"),
    ('system = "arm"', r"plant = 'C:\me\own.py:plant'", "must be module:name, such as my_module"),
    ('law = "grosmc"', 'law = "own.py:law"', "a module is named without .py: write own:law"),
]
# Disturbances that end before a run begins.
NEVER = [
    (
        '"sine"\nfrequency = "1 Hz"',
        '"pulse"\nstart = "-2 s"\nstop = "-1 s"',
        "disturbance 1: it ends at -1 s, a run begins at 0 s: it never acts",
    ),
    ('"1 s"', '"1 s"\ncontrol_period = "5 s"', "control_period: 5 s must be below the duration"),
    ('"1 s"', '"1 s"\ntimestep = "1 s"', "control_period: 1 s must be below the duration of 1 s"),
]
ARMS = [
    ('system = "arm"', 'sytem = "arm"', "plant: unknown key 'sytem': did you mean 'system'?"),
    ('system = "arm"', "system = 3", "plant: system = 3 must be a text in quotes"),
    ('system = "arm"', "", "give one of system, model and plant, not none"),
    ('"1 s"', '"1 s"\ncontrol_period = "1.5 ms"', "no multiple of the timestep 0.001 s"),
    ('"1 s"', '"1 s"\nengine = "fortran"', "run: unknown engine 'fortran': valid: native, python"),
    ("mass_scale = 2", "", "edit 1: the edit changes nothing"),
    ('body = "link"\nmass', 'body = "lnk"\nmass', "edit 1: unknown body 'lnk'"),
    ("mass_scale = 2", "damping = 2", "edit 1: a body has no damping; valid: mass_scale"),
    ("mass_scale = 2", 'mass_scale = 2\nadded_mass = "1 kg"', "write two [[edit]]"),
    ("mass_scale = 2", 'mass_scale = 2\nat = ["1 m", "0 m", "0 m"]', "give it one"),
    ('body = "link"\nmass', 'body = "lnk"\nmass', "unknown body 'lnk': did you mean 'link'?"),
    ('body = "link"\ntorque', 'body = "lnk"\ntorque', "unknown body 'lnk': did you mean 'link'?"),
    (
        '"0.1 N m", "0 N m"]',
        '"0.1 N m"]',
        "disturbance 1: torque: ['0 N m', '0.1 N m'] must be a list of 3",
    ),
    ('body = "link"\ntorque = [', 'input = "torque"\n#', "disturbance 1: amplitude is missing"),
    ('body = "link"\ntorque = [', 'input = "tork"\namplitude = 1\n#', "did you mean 'torque'?"),
    (
        'body = "link"\ntorque = [',
        'measured = "joint angel"\namplitude = 1\n#',
        "did you mean 'joint angle'?",
    ),
    (
        'body = "link"\ntorque = [',
        'state = "joint angle"\namplitude = "1 rad/s"\n#',
        "arm has a model in MuJoCo: name a body or an input",
    ),
    ('"sine"', '"table"', "disturbance 1: a table has no frequency"),
    ('"sine"\nfrequency = "1 Hz"', '"table"', "disturbance 1: a table needs values and hold"),
    ('body = "link"\ntorque', 'state = "joint angle"\ntorque', "a state has no torque"),
    ('"sine"', '"pulse"', "disturbance 1: a pulse has no frequency"),
    ('frequency = "1 Hz"', "", "disturbance 1: a sine needs frequency"),
    ("[[controller]]", "[controller]", "write [[controller]]"),
    ("k = 18", "kk = 18", "controller grosmc: unknown key 'kk': did you mean 'k'?"),
    ("k = 18", "k = [1, [2]]", "k = [1, [2]] must be a number"),
    ("k = 18", 'k = "big"', 'k: "big" is no number with a unit, such as'),
    ("k = 18", "Q = [1, 2, 3]", "Q = [1, 2, 3] must be a number, 2 numbers or a 2 x 2 matrix"),
    ("k = 18", "G = [[1, 2, 3]]", "G = [[1.0, 2.0, 3.0]] must be 1 x 2 finite numbers"),
    ("k = 18", 'switching = "implcit"', "did you mean 'implicit'?"),
    ("k = 18", '[[controller]]\nlaw = "grosmc"', "two controllers are called 'grosmc'"),
    ("k = 18", '[task]\nreference = ["0", "0"]', "2 formulas, there are 1 outputs"),
    ("k = 18", '[task]\nreference = ["1/t"]', "no value at t = 0"),
    ("k = 18", '[task]\noutputs = {of = "leg"}', "unknown outputs 'leg': valid: plant"),
    ('"10 mrad"', '"10 mm"', 'requirement 1: deviation_below: "10 mm" cannot be converted to rad'),
    ('deviation_below = "10 mrad"', "", "requirement 1: nothing is required"),
    ('"10 mrad"', '"10 mrad"\nof = ["lqr"]', "requirement 1: unknown controller 'lqr'"),
    ('title = "sound"', "title = sound", "no valid TOML: Invalid value (at line 2"),
    *WRITTEN,
    *NEVER,
]
OWNS = [
    ("own:pendulum", "onw:pendulum", "there is no onw.py in"),
    ("own:pendulum", "own:", "'own:' must be module:name"),
    ("own:law", "math:sin", "math is a module of Python itself"),
    ("a = 4", "class = 4", "'class' cannot be the name of a number"),
    ("own:law", "own:wrong", "own:wrong is a int, must be a law (t, x, memory, p, u)"),
    ("own:law", "own:pendulum", "own:pendulum cannot be called with ['a', 'b']"),
    ('parameter = "m"', 'parameter = "k"', "unknown parameter 'k': valid: m"),
    ('parameter = "m"\nscale = 1.5', 'body = "rod"\nmass_scale = 2', "edit a parameter"),
    ("Q = [1, 1]\n", "", "Q is missing"),
    ('"own:law"\na = 4\nb = 4', '"grosmc"', "grosmc needs k and epsilon"),
    ('"own:law"\na = 4\nb = 4', '"lqr"\nswitching = "sign"', "it does not switch"),
    ("[task]", '[task]\nreference = ["own:wrong"]', "must be a pair"),
]
BEAM_WITHOUT_POINT = """
[plant]
plant = "grosmc_mj.experiments.cases.ball_beam.ball_beam:plant"
[run]
duration = "0.01 s"
[task]
Q = [10, 10, 1]
R = 0.1
[[controller]]
law = "grosmc"
"""
OPERATING_POINTS = [
    (LEG, 'model = "leg.xml"', 'model = "lag.xml"', "lag.xml"),
    (LEG, 'law = "lqr"', 'law = "fl-lqr"', "law 'fl-lqr' does not fit leg, a model"),
    (LEG, 'law = "lqr"', 'law = "adaptive"', "law 'adaptive' does not fit leg, a model"),
    (MAGLEV, '"10 mm"', '"10"', 'plant: at: gap: "10" has no unit'),
    (MAGLEV, "gap = ", 'current = "0 A", gap = ', "at: maglev rests nowhere"),
    (MAGLEV, "R = 1e-3", 'R = 1\nreference = ["1"]', "under lqr all states are held"),
    (MAGLEV, '"lqr"', '"linear-grosmc"\nuncertainty = 1', "must be a table with body"),
    (
        MAGLEV,
        '"lqr"',
        '"linear-grosmc"\nuncertainty = { scales = { R = 2 } }',
        "[least, ",
    ),
    (MAGLEV + MOTOR, "", "", "maglev has no model in MuJoCo, so no machine as built"),
    (BEAM, "10, 1, 1]", "10, 1]", "of position, of relative degree (3,), is singular"),
    (BEAM_WITHOUT_POINT, "", "", "[plant] at"),
    (
        BEAM,
        "[run]",
        '[design]\nplant = "grosmc_mj.experiments.cases.ball_beam.ball_beam:nothing"\n[run]',
        "unknown name in",
    ),
    (
        BEAM,
        "[run]",
        '[design]\nplant = "grosmc_mj.experiments.cases.maglev.maglev:plant"\n[run]',
        "has the states",
    ),
    (
        FURUTA,
        "R = 100",
        'R = 1\nreference = ["1", "2"]',
        "(1 for 2 joints), so under grosmc all states are held at the operating point",
    ),
    (
        FURUTA,
        "[run]",
        '[design]\nplant = "grosmc_mj.experiments.cases.ball_beam.ball_beam:plant"\n[run]',
        "from MuJoCo's own dynamics",
    ),
    (FURUTA, "furuta.xml", "nowhere:furuta.xml", "nowhere, which is not installed; run: pip inst"),
    (FURUTA, "furuta.xml", "numpy:furuta.xml", "the installed numpy has no file 'furuta.xml'"),
    (FURUTA, "furuta.xml", "../a:furuta.xml", "must be a file, or package:path of one"),
    (FURUTA, "[run]", 'at = { rod = "90 deg" }\n[run]', "furuta rests nowhere near"),
]
# Numbers of further laws.
RIVALS = [
    ('"lqi"', '"lqi"\nadaptation = 1', "adaptation is a number of adaptive, linear-adaptive"),
    ('"lqi"', '"fl-pid"\nfrequency = -2', "frequency = -2 must be above 0"),
    ('"lqi"', '"adrc"\nswitching = "implicit"', "not switch, so it has no switching"),
    ('"lqi"', '"pd"', "pd needs frequency"),
]
# Wrong parts of a machine and edits, behind the laws.
MACHINES = [
    (
        '[[transmission]]\njoint = "shfat"\ninertia = "10 g m^2"\n',
        "transmission 1: unknown joint 'shfat': did you mean 'shaft'",
    ),
    (
        '[lugre]\njoint = "shaft"\ncoulomb = "0.05 N m"\n',
        "[lugre] is one of possibly several: write [[lugre]]",
    ),
    (LUGRE + 'stiffness = "1 GN m/rad"\n', "with a timestep of 0.00025 s makes unstable: take"),
    (
        '[[motor]]\ninput = "currant"\nconstant = "7.68 mN m/A"\nresistance = "2.6 ohm"\n',
        "motor 1: unknown input 'currant': did you mean 'curr",
    ),
    (MOTOR + "ratio = 70\nadded = false\n", "which is no part of the model's damping of 0.0088"),
    (
        '[[stop]]\njoint = "shaft"\nlow = "-2 rad"\nhigh = "-1 rad"\n',
        "shaft starts at 0 rad, beyond its stops at -2 and -1 rad: move the start or the stops",
    ),
    (
        '[[edit]]\nknown = true\nparameter = "inertia"\nscale = 2\n',
        "edit 1: known is for a model: give equations of your own the numbers at once",
    ),
    ('[[edit]]\nknown = true\nbody = "rotor"\n', "edit 1: the edit changes nothing"),
    ('[[edit]]\njoint = "shaft"\ngear = 2\n', "edit 1: a joint has no gear; valid: damping"),
    ('[computing]\ndelay = "1 ms"\nassumed = ["jitter"]\n', "assumed: the table gives no jitter"),
]
# Wrong limits at the end of the last requirement.
REQUIREMENTS = [
    (
        'signal = "rotor angle"\nabove = "1.2 rad"\nbelow = "0.8 rad"',
        "keeps no value: none is above 1.2 rad and below 0.8 rad",
    ),
    ('always = "0.5 rad < rotor angle < 0.5 rad"', "none is above 0.5 rad and below 0.5 rad"),
    (
        'always = "t < 1 s or always[0 s, 1 s] (rotor angle > 2 rad and rotor angle < 1 rad)"',
        "none is above 2 rad and below 1 rad",
    ),
    (
        'band = "1 rad"\ninput_below = "1 A"',
        "band is for settles_within or reaches_within or",
    ),
    ('settles_within = "1 s"\nband = "0 rad"', "'0 rad' must be positive"),
    ('rms_below = "1 mrad"\nafter = "7 s"', "after = 7 s must be before the end of a run at 6 s"),
    ('stays_within = "1 rad"\nafter = "-1 s"', "not be negative"),
    (
        'stays_within = "1 rad"\nstate = "rotor angel"',
        "unknown state 'rotor angel': did you mean 'rotor angle'?",
    ),
    (
        'stays_within = "1 rad"\nstate = "rotor speed"',
        'stays_within: "1 rad" cannot be converted to rad/s',
    ),
    (
        'stays_within = "1 rad"\ninput_below = "1 A"\nstate = "rotor angle"',
        "input_below: it is not asked of a state: stays_within, final_error_below, rms_below, ",
    ),
    (
        'input_below = "1 A"\nstate = "rotor angle"',
        "state is for stays_within or final_error_below or rms_below or reaches",
    ),
    (
        'cart_travel_below = "10 m"',
        'requirement 1: cart_travel_below is now written state = "cart position", '
        'stays_within = "10 m"',
    ),
]
# Keys of former versions.
FORMER = [
    (
        '[[swinging_load]]\nbody = "rotor"\n',
        "[[swinging_load]] is no part any more: describe",
    ),
    ('[[sliding_load]]\nbody = "rotor"\n', "[[sliding_load]] is no part any more: describe"),
    ('[[edit]]\njoint = "shaft"\ntilt = "1 deg"\n', "edit 1: tilt of a joint is no edit any more"),
]


@pytest.mark.parametrize(("table", "words"), FORMER)
def test_a_former_key_is_refused_with_what_replaces_it(tmp_path, table, words) -> None:
    with pytest.raises(ArgumentError, match=re.escape(words)):
        load(tmp_path, short_step() + table)


# Limits that are shares of the error at the start.
SHARES = ["overshoot_below = 0.1", 'settles_within = "4 s"']
TASKS = [
    (
        '\noutputs = { formulas = ["speed"] }\n',
        "task: outputs: 'speed' has 'speed' at character 1, may have",
    ),
    ('\noutputs = { formulas = ["1"] }\n', "task: outputs: output 1, 1, has no relative degree"),
    (
        '\noutputs = { of = "tip", formulas = ["rotor angle"] }\n',
        "task: outputs: of and formulas are the same: give one of them",
    ),
]


def refusal_of(folder: Path, text: str, good: str = "", bad: str = "") -> str:
    """The message about a text with a mistake in the place of a part of it."""
    assert good in text
    path = written(folder, text.replace(good, bad, 1))
    with pytest.raises(GrosmcError) as refusal:
        list(Experiment.load(path).checked().runs())
    line = str(refusal.value)
    assert "mine.toml: " in line
    assert "\n" not in line
    return line


@pytest.mark.parametrize(("good", "bad", "words"), ARMS)
def test_a_mistake_on_a_system_of_the_package_is_one_line(tmp_path, good, bad, words) -> None:
    assert words in refusal_of(tmp_path, ARM, good, bad)


@pytest.mark.parametrize(("good", "bad", "words"), OWNS)
def test_a_mistake_on_a_users_plant_is_one_line(tmp_path, good, bad, words) -> None:
    assert words in refusal_of(tmp_path, OWN, good, bad)


@pytest.mark.parametrize(("text", "good", "bad", "words"), OPERATING_POINTS)
def test_a_mistake_at_an_operating_point_is_one_line(tmp_path, text, good, bad, words) -> None:
    assert words in refusal_of(tmp_path, text, good, bad)


@pytest.mark.parametrize(("good", "bad", "words"), RIVALS)
def test_a_mistake_in_a_rival_law_is_one_line(tmp_path, good, bad, words) -> None:
    assert words in refusal_of(tmp_path, RIVAL, good, bad)


@pytest.mark.parametrize(("parts", "words"), MACHINES)
def test_a_mistake_in_a_machine_is_one_line(tmp_path, parts, words) -> None:
    assert words in refusal_of(tmp_path, SERVO + parts)


@pytest.mark.parametrize(("limits", "words"), REQUIREMENTS)
def test_a_mistake_in_a_requirement_is_one_line(tmp_path, limits, words) -> None:
    assert words in refusal_of(tmp_path, STEP + limits)


@pytest.mark.parametrize(("task", "words"), TASKS)
def test_a_mistake_in_the_outputs_is_one_line(tmp_path, task, words) -> None:
    regulated = '\nreference = ["1"]\nsign = -1\n'
    assert words in refusal_of(tmp_path, STEP + 'input_below = "1 A"\n', regulated, task)


@pytest.mark.parametrize("limit", SHARES)
def test_a_share_of_no_initial_error_is_refused(tmp_path, limit) -> None:
    at_rest = '[run]\nstart = { "rotor angle" = "1 rad" }'
    line = refusal_of(tmp_path, STEP + limit, "[run]", at_rest)
    assert "and runs start without error: ask for stays_within" in line


TWO_MISTAKES = """
[[transmission]]
joint = "shfat"
inertia = "10 g m^2"
[[lugre]]
joint = "shaft"
coulomb = "0.05 N m"
stiffness = 4
"""


def test_two_mistakes_are_named_at_once(tmp_path) -> None:
    with pytest.raises(ArgumentError) as refusal:
        load(tmp_path, SERVO + TWO_MISTAKES)
    first, joint, unit = str(refusal.value).split(MISTAKE_SEPARATOR)
    assert first.endswith("mine.toml: 2 mistakes:")
    assert "transmission 1: unknown joint" in joint
    assert "lugre 1: stiffness: 4 has no unit" in unit


def test_a_mark_of_the_byte_order_is_no_part_of_a_case_file(tmp_path) -> None:
    path = written(tmp_path, ARM)
    path.write_text(ARM, encoding="utf-8-sig")
    assert Experiment.load(path).title == "sound"


def test_a_model_behind_backslashes_is_found_with_slashes(tmp_path) -> None:
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "arm.xml").write_text("<mujoco/>")
    line = refusal_of(tmp_path, ARM, 'system = "arm"', r"model = 'models\arm.xml'")
    assert r"there is no file models\arm.xml: write / in the place of \\"[:-1] in line


def test_a_binary_file_is_refused(tmp_path) -> None:
    (tmp_path / "mine.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ArgumentError, match="no text in UTF-8"):
        Experiment.load(tmp_path / "mine.toml")


def test_an_overshoot_of_several_outputs_is_refused() -> None:
    machine = Experiment.load("two_link_arm/machine")
    table = machine.file.requirement[0].model_copy(update={"overshoot_below": 0.05})
    file = machine.file.model_copy(update={"requirement": [table]})
    with pytest.raises(ArgumentError, match="several outputs have no one overshoot"):
        _ = replace(machine, file=file).limits


# A user's own Python.


@pytest.mark.parametrize(
    ("case", "good", "bad", "words"),
    [
        (OWN, "p.a * x[0]", "p.a * x[9]", "IndexError"),
        (OWN, "p.a * x[0]", "p.aa * x[0]", "p has no 'aa'"),
        (OWN, "return gm.affine_plant", "return gm.affine_plan", "AttributeError"),
        (OWN, "import sympy as sp", "import sympi as sp", "No module named 'sympi'"),
        (OWN, "def law(t", "def law(t,,", "SyntaxError"),
        (OWN, "q, w = sp", "raise SystemExit\nq, w = sp", "SystemExit"),
        (OWN_NATIVE, "p.a * x[0]", "p.a * sum(x.tolist())", "numba cannot compile the law"),
        (
            OWN_NATIVE,
            "    return p.plant",
            "    if t > 0.1: raise ValueError('too late')\n    return p.plant",
            "ValueError: too late (law at t = 0.101 s)",
        ),
    ],
)
def test_an_error_in_a_users_python_points_to_its_line(tmp_path, capfd, case, good, bad, words):
    line = line_of_command(tmp_path, capfd, case, PYTHON.replace(good, bad, 1))
    number = PYTHON[: PYTHON.index(good)].count("\n") + 1
    assert words in line
    assert f"own.py:{number}: " in line


def test_a_law_that_returns_no_numbers_is_an_error_of_the_case_file(tmp_path, capfd):
    returning = PYTHON.replace("    return p.plant", "    return 'a'\n    return p.plant", 1)
    line = line_of_command(tmp_path, capfd, OWN, returning)
    assert "law returned" in line
    assert "mine.toml" in line


def line_of_command(folder: Path, capfd: pytest.CaptureFixture[str], case: str, python: str) -> str:
    """The line of a run that fails."""
    path = written(folder, case)
    (folder / "own.py").write_text(python)
    with pytest.raises(SystemExit) as stop:
        cli.main(["run", str(path), "--no-figures", "--out", str(folder / "out")])
    assert stop.value.code == cli.WRONG
    line = capfd.readouterr().err
    assert line.count("\n") == 1
    return line

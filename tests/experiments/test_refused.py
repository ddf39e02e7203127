"""Case files that are wrong: one line for each mistake, from whichever door of a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from case_texts import (
    ARM,
    BALL,
    BEAM,
    FURUTA,
    LEG,
    LEG_MODEL,
    LUGRE,
    MAGLEV,
    MOTOR,
    OWN,
    PLAY,
    PYTHON,
    RIVAL,
    SERVO,
    STEP,
    TRANSMISSION,
    load,
    written,
)

from grosmc_mj import cli
from grosmc_mj.errors import NEXT, ArgumentError, GrosmcError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.reading import read_case_file

# A part of the text, another one in its place, and words of the line.
ARMS = [
    ("[plant]", "[plnt]", "unknown key 'plnt': did you mean 'plant'?"),
    ('system = "arm"', 'sytem = "arm"', "plant: unknown key 'sytem': did you mean 'system'?"),
    ('system = "arm"', 'system = "amr"', "unknown system 'amr': did you mean 'arm'?"),
    ('system = "arm"', "system = 3", "plant: system = 3 must be a text in quotes"),
    ('system = "arm"', "", "give one of system, model and plant, not none"),
    ('system = "arm"', 'system = "arm"\ncompare = ["phisics"]', "did you mean 'physics'"),
    ('"joint angle"', '"joint agle"', "unknown state 'joint agle': did you mean 'joint angle'?"),
    ('"10 deg"', '"10 m"', 'joint angle: "10 m" cannot be converted to rad'),
    ('duration = "1 s"', "duration = 1", 'run: duration: 1 has no unit: write "1 s"'),
    ('duration = "1 s"', 'duration = "-1 s"', "duration = -1 must be from 1e-09"),
    ('duration = "1 s"', "", "run: duration is missing"),
    ('"1 s"', '"1 s"\ncontrol_period = "1.5 ms"', "no multiple of the timestep 0.001 s"),
    ('"1 s"', '"1 s"\nengine = "fortran"', "run: unknown engine 'fortran': valid: native, python"),
    ('"1 s"', '"1 s**2**9**9**9"', "is no unit"),
    ("mass_scale = 2", "mass_scale = -2", "mass_scale = -2 must be finite and positive"),
    ("mass_scale = 2", "", "edit 1: the edit changes nothing"),
    ("mass_scale = 2", "damping = 2", "edit 1: a body has no damping; valid: mass_scale"),
    ("mass_scale = 2", 'mass_scale = 2\nadded_mass = "1 kg"', "write two [[edit]]"),
    ("mass_scale = 2", 'mass_scale = 2\nmass = "1 kg"', "give the number or its scale"),
    ("mass_scale = 2", 'mass_scale = 2\nat = ["1 m", "0 m", "0 m"]', "give it one"),
    ('body = "link"\nmass', 'body = "lnk"\nmass', "unknown body 'lnk': did you mean 'link'?"),
    ('body = "link"\ntorque', 'body = "lnk"\ntorque', "unknown body 'lnk': did you mean 'link'?"),
    ('"0.1 N m", "0 N m"]', '"0.1 N m"]', "disturbance 1: torque: at least 3 items"),
    ('"0.1 N m"', '"0.1 N"', 'torque 2: "0.1 N" cannot be converted to N m'),
    ('"0.1 N m"', '"0 N m"', "disturbance 1: it has neither force nor torque"),
    ('body = "link"\ntorque = [', 'input = "torque"\n#', "arm has a model in MuJoCo: name a body"),
    ('body = "link"\ntorque', 'state = "joint angle"\ntorque', "a state has no torque"),
    ('"sine"', '"cosine"', "disturbance 1: unknown profile 'cosine': did you mean 'sine'?"),
    ('"sine"', '"pulse"', "disturbance 1: a pulse has no frequency"),
    ('frequency = "1 Hz"', "", "disturbance 1: a sine needs frequency"),
    ("[[controller]]", "[controller]", "write [[controller]]"),
    ('law = "grosmc"', 'law = "grosmic"', "unknown law 'grosmic': did you mean 'grosmc'?"),
    ("k = 18", "kk = 18", "controller grosmc: unknown key 'kk': did you mean 'k'?"),
    ("k = 18", 'k = "big"', "k = 'big' must be a number or the rows of a matrix"),
    ("k = 18", "k = nan", "k = nan must be finite"),
    ("k = 18", "k = [1, 2]", "k = [1, 2] must be a number"),
    ("k = 18", "Q = [1, 2, 3]", "Q = [1, 2, 3] must be a number, 2 numbers or a 2 x 2 matrix"),
    ("k = 18", "Q = [-1, 0]", "Q"),
    ("k = 18", "G = [[1, 2, 3]]", "G = [[1.0, 2.0, 3.0]] must be 1 x 2 finite numbers"),
    ("k = 18", 'switching = "implcit"', "did you mean 'implicit'?"),
    ("k = 18", '[[controller]]\nlaw = "grosmc"', "two controllers are called 'grosmc'"),
    ("k = 18", '[task]\nreference = ["0", "0"]', "2 formulas, there are 1 outputs"),
    ("k = 18", '[task]\nreference = ["1/t"]', "no value at t = 0"),
    ("k = 18", '[task]\noutputs = {of = "leg"}', "unknown outputs 'leg': valid: plant"),
    ('"10 mrad"', '"10 mrad"\nafter = "1 s"', "after is for stays_within"),
    ('"10 mrad"', '"10 mm"', 'requirement 1: deviation_below: "10 mm" cannot be converted to rad'),
    ('"10 mrad"', '"0 rad"', "must be positive"),
    ('deviation_below = "10 mrad"', "", "requirement 1: nothing is required"),
    ('"10 mrad"', '"10 mrad"\nof = ["lqr"]', "requirement 1: unknown controller 'lqr'"),
    ('"10 mrad"', '"10 mrad"\non = ["moon"]', "valid: printed, corrected, physics"),
    ('title = "sound"', "title = sound", "no valid TOML: Invalid value (at line 2"),
]
OWNS = [
    ("own:pendulum", "own:pendulm", "did you mean 'pendulum'?"),
    ("own:pendulum", "onw:pendulum", "there is no onw.py in"),
    ("own:pendulum", "own:", "'own:' must be module:name"),
    ("own:pendulum", "own:wrong", "own:wrong is a int, must be a plant"),
    ("own:law", "math:sin", "math is a module of Python itself"),
    ("a = 4", "plant = 4", "'plant' cannot be the name of a number"),
    ("a = 4", "class = 4", "'class' cannot be the name of a number"),
    ("a = 4", "a = inf", "a = inf must be finite"),
    ("a = 4", 'a = "four"', "a = 'four' must be a number"),
    ("own:law", "own:wrong", "own:wrong is a int, must be a law (t, x, memory, p, u)"),
    ("own:law", "own:pendulum", "own:pendulum cannot be called with ['a', 'b']"),
    ("own:law", "own:gust", "got an unexpected keyword argument 'a'"),
    ('parameter = "m"', 'parameter = "k"', "unknown parameter 'k': valid: m"),
    ('parameter = "m"\nscale = 1.5', 'body = "rod"\nmass_scale = 2', "edit a parameter"),
    ("Q = [1, 1]\n", "", "Q is missing"),
    ('"own:law"\na = 4\nb = 4', '"grosmc"', "grosmc needs k and epsilon"),
    ('"own:law"\na = 4\nb = 4', '"lqr"\nk = 4', "unknown key 'k'"),
    ('"own:law"\na = 4\nb = 4', '"lqr"\nswitching = "sign"', "it does not switch"),
    ("[task]", '[task]\nreference = ["own:wrong"]', "must be a pair"),
]
LEGS = [
    ('model = "leg.xml"', 'model = "lag.xml"', "lag.xml"),
    ('model = "leg.xml"', 'model = "leg.xml"\njoints = ["hpi"]', "did you mean 'hip'"),
    ("Q = [100, 1, 100, 1]", "Q = [100, 1]", "must be a number, 4 numbers or a 4 x 4 matrix"),
    ('["0.3*sin(2*t)", "-1"]', '["0"]', "1 formulas, there are 2 outputs"),
    ('law = "lqr"', 'law = "fl-lqr"', "unknown law 'fl-lqr'"),
]
LEVITATED, ITS_LAW = 'at = { gap = "10 mm" }', 'law = "lqr"'
FAMILY = 'law = "linear-grosmc"\nuncertainty = '
OPERATING_POINTS = [
    (MAGLEV, LEVITATED, 'at = { gap = "10" }', 'plant: at: gap: "10" has no unit'),
    (MAGLEV, LEVITATED, 'at = { gat = "1 mm" }', "unknown state 'gat': did you mean 'gap'?"),
    (MAGLEV, LEVITATED, 'at = { current = "0 A", gap = "10 mm" }', "at: maglev rests nowhere"),
    (MAGLEV, "R = 1e-3", 'R = 1\nreference = ["1"]', "under lqr all states are held"),
    (MAGLEV, ITS_LAW, FAMILY + "1", "must be a table with body"),
    (MAGLEV, ITS_LAW, FAMILY + "{ mas = 2 }", "did you mean 'mass'?"),
    (MAGLEV, ITS_LAW, FAMILY + '{ mass = "2" }', "must be finite"),
    (MAGLEV, ITS_LAW, FAMILY + "{ mass = 2 }", "scale a parameter"),
    (MAGLEV, ITS_LAW, FAMILY + "{ scales = { R = 2 } }", "[least, "),
    (MAGLEV, ITS_LAW, 'law = "linear-grosmc"\nlimit = -1', "limit = -1 must be positive"),
    (BEAM, "10, 1, 1]", "10, 1]", "of position, of relative degree (3,), is singular"),
    (BEAM.replace("10, 1, 1]", "10, 1]"), '"fl-lqr"', '"grosmc"', "[plant] at"),
    (BEAM, "[run]", f'[design]\nplant = "{BALL}:nothing"\n[run]', "unknown name in"),
    (BEAM, "[run]", f'[design]\nplant = "{BALL}"\n[run]', "must be module:name"),
    (
        BEAM, "[run]", '[design]\nplant = "grosmc_mj.cases.maglev.maglev:plant"\n[run]',
        "has the states",
    ),
    (FURUTA, '"grosmc"', '"pd"', "unknown law 'pd': valid: lqr, grosmc, module:name"),
    (FURUTA, "R = 100", 'R = 1\nreference = ["1", "2"]', "are held at the operating point"),
    (FURUTA, "[run]", f'[design]\nplant = "{BALL}:plant"\n[run]', "from MuJoCo's own dynamics"),
    (FURUTA, "furuta.xml", "nowhere:furuta.xml", "nowhere, which is not installed; run: pip inst"),
    (FURUTA, "furuta.xml", "numpy:furuta.xml", "the installed numpy has no file 'furuta.xml'"),
    (FURUTA, "furuta.xml", "../a:furuta.xml", "must be a file, or package:path of one"),
    (FURUTA, "[run]", 'at = { rod = "90 deg" }\n[run]', "furuta rests nowhere near"),
    (FURUTA, '"grosmc"', '"grosmc"\nuncertainty = { body = "rot", mass = 2 }', "did you mean"),
    (FURUTA, '"grosmc"', '"grosmc"\nG = [[1, 0, 0, 0]]', "is singular"),
]  # fmt: skip
# Numbers of further laws, in place of the first.
RIVALS = [
    ("lqi", "integral_weight = 0", "integral_weight = 0 must be finite and positive"),
    ("lqi", "integral_wait = 1", "unknown key 'integral_wait': did you mean"),
    ("lqi", "integral_weight = [1, 2]", "integral_weight = [1, 2] must be a number"),
    ("lqi", "limit = -1", "limit = -1 must be positive"),
    ("pid", "frequency = -2", "frequency = -2 must be above 0"),
    ("pid", 'frequency = "2 m"', 'frequency: "2 m" cannot be converted to rad/s'),
    ("adrc", 'switching = "implicit"', "it does not switch, so it has no switching"),
    ("adaptive", "adaptation = 0", "adaptation = 0 must be finite and positive"),
]
# Parts of a machine and edits, behind the laws.
STOP, SWING = '[[stop]]\njoint = "shaft"\n', '[[swinging_load]]\nmass = "1 kg"\nlength = "1 m"\n'
KNOWN = '[[edit]]\nknown = true\njoint = "shaft"\ndamping = 1\n'
MACHINES = [
    (PLAY.replace("shaft", "shfat"), "transmission 1: unknown joint 'shfat': did you mean 'shaft'"),
    (TRANSMISSION + "stiffness = 100\n", 'stiffness: 100 has no unit: write "100 N m/rad"'),
    (TRANSMISSION + 'stiffness = "1 N/m"\n', '"1 N/m" cannot be converted to N m/rad'),
    (TRANSMISSION, "transmission of 'shaft': it is rigid: give a stiffness, a backlash or both"),
    (PLAY + "added = 1\n", "transmission 1: added = 1 must be true or false"),
    (PLAY + PLAY, "'shaft' has two of the kind 'transmission': give one"),
    (LUGRE.replace("[[lugre]]", "[lugre]"), "[lugre] is one of possibly several: write [[lugre]]"),
    ('[[lugre]]\njoint = "shaft"\n', "lugre 1: coulomb is missing"),
    (LUGRE + 'static = "0.01 N m"\n', "static = 0.01 must be at least coulomb = 0.05"),
    (LUGRE + 'stiffness = "1 GN m/rad"\n', "with a timestep of 0.00025 s makes unstable: take"),
    (MOTOR.replace("current", "currant"), "motor 1: unknown input 'currant': did you mean 'curr"),
    (MOTOR + 'ratio = "70"\n', "motor 1: ratio: '70' must be a number without a unit"),
    (MOTOR + "bandwidth = 1000\n", 'bandwidth: 1000 has no unit: write "1000 rad/s"'),
    (MOTOR + "ratio = 70\nadded = false\n", "which is no part of the model's damping of 0.0088"),
    (MOTOR + 'heat_capacity = "3 J/K"\n', "heating needs both"),
    (STOP + 'low = "1 rad"\nhigh = "-1 rad"\n', "must be below high = -1"),
    (
        STOP + 'low = "-2 rad"\nhigh = "-1 rad"\n',
        "shaft starts at 0 rad, beyond its stops at -2 and -1 rad: move the start or the stops",
    ),
    (SWING + 'body = "roter"\n', "unknown body 'roter': did you mean 'rotor'"),
    (SWING + 'body = "rotor"\nat = ["1 m", "0 m"]\n', "swinging_load 1: at: at least 3 items"),
    (
        '[[sliding_load]]\nbody = "rotor"\nmass = "-1 kg"\nstiffness = "1 N/m"\n',
        "sliding_load 1: sliding load of 'rotor': mass = -1 must be from 1e-15 to",
    ),
    ('[[wall]]\nbody = "rotor"\nradius = "1 cm"\nnormal = [0, 0, 0]\n', "must point somewhere"),
    (
        '[[edit]]\nknown = true\nparameter = "inertia"\nscale = 2\n',
        "edit 1: known is for a model: give equations of your own the numbers at once",
    ),
    ('[[edit]]\nknown = true\nbody = "rotor"\n', "edit 1: the edit changes nothing"),
    (KNOWN.replace("true", '"yes"'), "known = 'yes' must be true or"),
    (KNOWN * 2, "'shaft' has two of the k"),
    ('[[edit]]\ninput = "currant"\ngear = 1\n', "unknown input 'currant': did you mean 'current'"),
    ('[[edit]]\ninput = "current"\ngear = 0\n', "edit of 'current': gear = 0 must not be zero"),
    ('[[edit]]\njoint = "shaft"\ngear = 2\n', "edit 1: a joint has no gear; valid: damping"),
    ('[[edit]]\njoint = "shaft"\ntilt = "90 deg"\n', "must be above -1.5708 to below 1.5708 rad"),
    ('[computing]\ndelay = "1 ms"\nassumed = ["jitter"]\n', "assumed: the table gives no jitter"),
]
REQUIREMENTS = [
    ('band = "1 rad"\ninput_below = "1 A"', "band is for settles_within, which is not there"),
    ('settles_within = "1 s"\nband = "1 m"', '"1 m" cannot be converted to rad'),
    ('settles_within = "1 s"\nband = "0 rad"', "'0 rad' must be positive"),
    ('input_below = "1 A"\nafter = "1 s"', "after is for stays_within and rms_below"),
    ("final_error_below = 3", 'has no unit: write "3 rad"'),
    ('rms_below = "1 mrad"\nafter = "7 s"', "after = 7 s must be before the end of a run at 6 s"),
    ('stays_within = "1 rad"\nafter = "-1 s"', "not be negative"),
]
SOUND, AT_REST = 'input_below = "1 A"\n', '[run]\nstart = { "rotor angle" = "1 rad" }'
TASK = '\nreference = ["1"]\nsign = -1\n'
TASKS = [
    ('\noutputs = { formulas = ["speed"] }\n', "task: outputs: 'speed' has speed, may have rotor"),
    ('\noutputs = { formulas = ["1"] }\n', "task: outputs: output 1, 1, has no relative degree"),
    (
        '\noutputs = { of = "tip", formulas = ["rotor angle"] }\n',
        "task: outputs: of and formulas are the same: give one of them",
    ),
]
MISTAKES = [
    *((ARM, *change) for change in ARMS),
    *((OWN, *change) for change in OWNS),
    *((LEG, *change) for change in LEGS),
    *OPERATING_POINTS,
    *((RIVAL, '"lqi"', f'"{law}"\n{numbers}', words) for law, numbers, words in RIVALS),
    *((SERVO + parts, "", "", words) for parts, words in MACHINES),
    *((STEP + required, "", "", words) for required, words in REQUIREMENTS),
    *((STEP + SOUND, TASK, task, words) for task, words in TASKS),
    (STEP + SOUND, "Q = [1, 1]", "Q = [1, 2, 3]", "task: Q = "),
    *(
        (STEP + required, "[run]", AT_REST, "and runs start without error: ask for stays_within")
        for required in ("overshoot_below = 0.1", 'settles_within = "4 s"')
    ),
    (MAGLEV + MOTOR, "", "", "maglev has no model in MuJoCo, so no machine as built"),
]


@pytest.mark.parametrize(("text", "good", "bad", "words"), MISTAKES, ids=[m[3] for m in MISTAKES])
def test_a_mistake_is_one_line_with_the_file(
    text: str, good: str, bad: str, words: str, tmp_path: Path
) -> None:
    assert good in text
    path = written(tmp_path, text.replace(good, bad, 1))
    with pytest.raises(GrosmcError) as refusal:
        list(Experiment.load(path).checked().runs())
    line = str(refusal.value)
    assert words in line
    assert "mine.toml: " in line
    assert "\n" not in line


def test_two_mistakes_are_named_at_once(tmp_path: Path) -> None:
    text = SERVO + PLAY.replace("shaft", "shfat") + LUGRE + "stiffness = 4\n"
    with pytest.raises(ArgumentError) as refusal:
        load(tmp_path, text)
    first, joint, unit = str(refusal.value).split(NEXT)
    assert first.endswith("mine.toml: 2 mistakes:")
    assert "transmission 1: unknown joint" in joint
    assert "lugre 1: stiffness: 4 has no unit" in unit


def test_missing_and_binary_files(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="cannot be read: No such file"):
        read_case_file(tmp_path / "nowhere.toml")
    (tmp_path / "mine.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ArgumentError, match="no text in UTF-8"):
        read_case_file(tmp_path / "mine.toml")


def test_several_outputs_have_no_one_overshoot() -> None:
    machine = Experiment.load("two_link_arm/machine")
    table = machine.file.requirement[0].model_copy(update={"overshoot_below": 0.05})
    file = machine.file.model_copy(update={"requirement": [table]})
    with pytest.raises(ArgumentError, match="several outputs have no one overshoot"):
        _ = replace(machine, file=file).limits


@pytest.mark.slow
def test_outputs_of_two_units_have_no_one_error(tmp_path: Path) -> None:
    path = written(tmp_path, LEG.replace('hip = "10 deg"', 'hip = "1 cm"'))
    hinge, slide = (
        '<joint name="hip" axis="0 -1 0"',
        '<joint name="hip" type="slide" axis="1 0 0"',
    )
    (tmp_path / "leg.xml").write_text(LEG_MODEL.replace(hinge, slide))
    with pytest.raises(ArgumentError, match="different units"):
        Experiment.load(path)


# Python of the user's own.


def run_own(folder: Path, python: str, capfd: pytest.CaptureFixture[str], case: str = OWN) -> str:
    """The one line about a run that its Python stops."""
    path = written(folder, case)
    (folder / "own.py").write_text(python)
    with pytest.raises(SystemExit) as stop:
        cli.main(["run", str(path), "--no-figures", "--out", str(folder / "out")])
    assert stop.value.code == cli.WRONG
    line = capfd.readouterr().err
    assert line.count("\n") == 1
    return line


NATIVE = OWN.replace('"python"', '"native"')


@pytest.mark.parametrize(
    ("good", "bad", "words", "case"),
    [
        ("p.a * x[0]", "p.a * x[9]", "IndexError", OWN),
        ("p.a * x[0]", "p.aa * x[0]", "p has no 'aa'", OWN),
        ("return gm.affine_plant", "return gm.affine_plan", "AttributeError", OWN),
        ("import sympy as sp", "import sympi as sp", "No module named 'sympi'", OWN),
        ("def law(t", "def law(t,,", "SyntaxError", OWN),
        ("q, w = sp", "raise SystemExit\nq, w = sp", "SystemExit", OWN),
        ("p.a * x[0]", "p.a * sum(x.tolist())", "numba cannot compile the law", NATIVE),
        (
            "    return p.plant",
            "    if t > 0.1: raise ValueError('too late')\n    return p.plant",
            "ValueError: too late (law at t = 0.101 s)",
            NATIVE,
        ),
    ],
)
def test_errors_in_the_users_python_point_to_its_line(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    good: str,
    bad: str,
    words: str,
    case: str,
) -> None:
    line = run_own(tmp_path, PYTHON.replace(good, bad, 1), capfd, case)
    number = PYTHON[: PYTHON.index(good)].count("\n") + 1
    assert f"own.py:{number}: " in line
    assert words in line


@pytest.mark.parametrize("returned", ["None", "'a'", "(1.0, 2.0)", "1j", "math.nan"])
def test_a_law_that_returns_something_else(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], returned: str
) -> None:
    python = PYTHON.replace("return p.plant.m * math.sin(x[0])", f"return {returned}\n    return 0")
    line = run_own(tmp_path, python, capfd)
    assert "mine.toml" in line
    assert "law returned" in line

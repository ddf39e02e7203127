"""Case files that are wrong: one line for each mistake, from whichever door of a file."""

from __future__ import annotations

from dataclasses import replace

import pytest
from case_texts import (
    ARM,
    BALL,
    BEAM,
    FURUTA,
    LEG,
    LUGRE,
    MAGLEV,
    MOTOR,
    OWN,
    PLAY,
    PYTHON,
    RIVAL,
    SERVO,
    STEP,
    load,
    written,
)

from grosmc_mj import cli
from grosmc_mj.errors import NEXT, ArgumentError, GrosmcError
from grosmc_mj.experiments.experiment import Experiment

# A part of the text, another one in its place, and words of the line.
ARMS = [
    ('system = "arm"', 'sytem = "arm"', "plant: unknown key 'sytem': did you mean 'system'?"),
    ('system = "arm"', "system = 3", "plant: system = 3 must be a text in quotes"),
    ('system = "arm"', "", "give one of system, model and plant, not none"),
    ('"1 s"', '"1 s"\ncontrol_period = "1.5 ms"', "no multiple of the timestep 0.001 s"),
    ('"1 s"', '"1 s"\nengine = "fortran"', "run: unknown engine 'fortran': valid: native, python"),
    ("mass_scale = 2", "", "edit 1: the edit changes nothing"),
    ("mass_scale = 2", "damping = 2", "edit 1: a body has no damping; valid: mass_scale"),
    ("mass_scale = 2", 'mass_scale = 2\nadded_mass = "1 kg"', "write two [[edit]]"),
    ("mass_scale = 2", 'mass_scale = 2\nat = ["1 m", "0 m", "0 m"]', "give it one"),
    ('body = "link"\nmass', 'body = "lnk"\nmass', "unknown body 'lnk': did you mean 'link'?"),
    ('body = "link"\ntorque', 'body = "lnk"\ntorque', "unknown body 'lnk': did you mean 'link'?"),
    ('"0.1 N m", "0 N m"]', '"0.1 N m"]', "disturbance 1: torque: at least 3 items"),
    ('body = "link"\ntorque = [', 'input = "torque"\n#', "arm has a model in MuJoCo: name a body"),
    ('body = "link"\ntorque', 'state = "joint angle"\ntorque', "a state has no torque"),
    ('"sine"', '"pulse"', "disturbance 1: a pulse has no frequency"),
    ('frequency = "1 Hz"', "", "disturbance 1: a sine needs frequency"),
    ("[[controller]]", "[controller]", "write [[controller]]"),
    ("k = 18", "kk = 18", "controller grosmc: unknown key 'kk': did you mean 'k'?"),
    ("k = 18", "k = [1, [2]]", "k = [1, [2]] must be a number"),
    ("k = 18", 'k = "big"', "k = 'big' must be a number or the rows of a matrix"),
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
]
LAW = '"own:law"\na = 4\nb = 4'
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
    (LAW, '"grosmc"', "grosmc needs k and epsilon"),
    (LAW, '"lqr"\nswitching = "sign"', "it does not switch"),
    ("[task]", '[task]\nreference = ["own:wrong"]', "must be a pair"),
]
LEVITATED, ITS_LAW, FAMILY = 'at = { gap = "10 mm" }', '"lqr"', '"linear-grosmc"\nuncertainty = '
OPERATING_POINTS = [
    (LEG, 'model = "leg.xml"', 'model = "lag.xml"', "lag.xml"),
    (LEG, 'law = "lqr"', 'law = "fl-lqr"', "law 'fl-lqr' does not fit leg, a model"),
    (LEG, 'law = "lqr"', 'law = "adaptive"', "law 'adaptive' does not fit leg, a model"),
    (MAGLEV, LEVITATED, 'at = { gap = "10" }', 'plant: at: gap: "10" has no unit'),
    (MAGLEV, LEVITATED, 'at = { current = "0 A", gap = "10 mm" }', "at: maglev rests nowhere"),
    (MAGLEV, "R = 1e-3", 'R = 1\nreference = ["1"]', "under lqr all states are held"),
    (MAGLEV, ITS_LAW, FAMILY + "1", "must be a table with body"),
    (MAGLEV, ITS_LAW, FAMILY + "{ scales = { R = 2 } }", "[least, "),
    (MAGLEV + MOTOR, "", "", "maglev has no model in MuJoCo, so no machine as built"),
    (BEAM, "10, 1, 1]", "10, 1]", "of position, of relative degree (3,), is singular"),
    (BEAM.replace("10, 1, 1]", "10, 1]"), '"fl-lqr"', '"grosmc"', "[plant] at"),
    (BEAM, "[run]", f'[design]\nplant = "{BALL}:nothing"\n[run]', "unknown name in"),
    (
        BEAM, "[run]", '[design]\nplant = "grosmc_mj.cases.maglev.maglev:plant"\n[run]',
        "has the states",
    ),
    (FURUTA, "R = 100", 'R = 1\nreference = ["1", "2"]', "are held at the operating point"),
    (FURUTA, "[run]", f'[design]\nplant = "{BALL}:plant"\n[run]', "from MuJoCo's own dynamics"),
    (FURUTA, "furuta.xml", "nowhere:furuta.xml", "nowhere, which is not installed; run: pip inst"),
    (FURUTA, "furuta.xml", "numpy:furuta.xml", "the installed numpy has no file 'furuta.xml'"),
    (FURUTA, "furuta.xml", "../a:furuta.xml", "must be a file, or package:path of one"),
    (FURUTA, "[run]", 'at = { rod = "90 deg" }\n[run]', "furuta rests nowhere near"),
    # Numbers of further laws.
    (RIVAL, '"lqi"', '"pid"\nfrequency = -2', "frequency = -2 must be above 0"),
    (RIVAL, '"lqi"', '"adrc"\nswitching = "implicit"', "not switch, so it has no switching"),
    (RIVAL, '"lqi"', '"pd"', "pd needs frequency"),
]  # fmt: skip
# Parts of a machine and edits, behind the laws.
STOP = '[[stop]]\njoint = "shaft"\n'
MACHINES = [
    (PLAY.replace("shaft", "shfat"), "transmission 1: unknown joint 'shfat': did you mean 'shaft'"),
    (LUGRE.replace("[[lugre]]", "[lugre]"), "[lugre] is one of possibly several: write [[lugre]]"),
    (LUGRE + 'stiffness = "1 GN m/rad"\n', "with a timestep of 0.00025 s makes unstable: take"),
    (MOTOR.replace("current", "currant"), "motor 1: unknown input 'currant': did you mean 'curr"),
    (MOTOR + "ratio = 70\nadded = false\n", "which is no part of the model's damping of 0.0088"),
    (
        STOP + 'low = "-2 rad"\nhigh = "-1 rad"\n',
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
REQUIREMENTS = [
    ('band = "1 rad"\ninput_below = "1 A"', "band is for settles_within, which is not there"),
    ('settles_within = "1 s"\nband = "0 rad"', "'0 rad' must be positive"),
    ('rms_below = "1 mrad"\nafter = "7 s"', "after = 7 s must be before the end of a run at 6 s"),
    ('stays_within = "1 rad"\nafter = "-1 s"', "not be negative"),
]
SOUND, AT_REST = 'input_below = "1 A"\n', '[run]\nstart = { "rotor angle" = "1 rad" }'
NO_ERROR = "and runs start without error: ask for stays_within"
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
    *OPERATING_POINTS,
    *((SERVO + parts, "", "", words) for parts, words in MACHINES),
    *((STEP + required, "", "", words) for required, words in REQUIREMENTS),
    *((STEP + SOUND, TASK, task, words) for task, words in TASKS),
    *((STEP + required, "[run]", AT_REST, NO_ERROR)
      for required in ("overshoot_below = 0.1", 'settles_within = "4 s"')),
]  # fmt: skip


@pytest.mark.parametrize(("text", "good", "bad", "words"), MISTAKES, ids=[m[3] for m in MISTAKES])
def test_a_mistake_is_one_line_with_the_file(text, good, bad, words, tmp_path) -> None:
    assert good in text
    path = written(tmp_path, text.replace(good, bad, 1))
    with pytest.raises(GrosmcError) as refusal:
        list(Experiment.load(path).checked().runs())
    line = str(refusal.value)
    assert words in line
    assert "mine.toml: " in line
    assert "\n" not in line


def test_two_mistakes_are_named_at_once(tmp_path) -> None:
    text = SERVO + PLAY.replace("shaft", "shfat") + LUGRE + "stiffness = 4\n"
    with pytest.raises(ArgumentError) as refusal:
        load(tmp_path, text)
    first, joint, unit = str(refusal.value).split(NEXT)
    assert first.endswith("mine.toml: 2 mistakes:")
    assert "transmission 1: unknown joint" in joint
    assert "lugre 1: stiffness: 4 has no unit" in unit


def test_binary_files_and_an_overshoot_of_several_outputs_are_refused(tmp_path) -> None:
    (tmp_path / "mine.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ArgumentError, match="no text in UTF-8"):
        Experiment.load(tmp_path / "mine.toml")
    machine = Experiment.load("two_link_arm/machine")
    table = machine.file.requirement[0].model_copy(update={"overshoot_below": 0.05})
    file = machine.file.model_copy(update={"requirement": [table]})
    with pytest.raises(ArgumentError, match="several outputs have no one overshoot"):
        _ = replace(machine, file=file).limits


# Python of the user's own.

NATIVE = OWN.replace('"python"', '"native"')
RETURN = "    return p.plant"


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
        (RETURN, f"    if t > 0.1: raise ValueError('too late')\n{RETURN}",
         "ValueError: too late (law at t = 0.101 s)", NATIVE),
        (RETURN, f"    return 'a'\n{RETURN}", "law returned", OWN),
    ],
)  # fmt: skip
def test_errors_in_the_users_python_point_to_its_line(tmp_path, capfd, good, bad, words, case):
    path = written(tmp_path, case)
    (tmp_path / "own.py").write_text(PYTHON.replace(good, bad, 1))
    with pytest.raises(SystemExit) as stop:
        cli.main(["run", str(path), "--no-figures", "--out", str(tmp_path / "out")])
    assert stop.value.code == cli.WRONG
    line, number = capfd.readouterr().err, PYTHON[: PYTHON.index(good)].count("\n") + 1
    assert line.count("\n") == 1
    assert words in line
    assert ("mine.toml" if words == "law returned" else f"own.py:{number}: ") in line

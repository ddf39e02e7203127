"""Case files: units, what is read, and one line for each way to be wrong."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from shipped import PENDULUM_DISTURBANCE, cases, find_case

from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file import schema
from grosmc_mj.experiments.file.parts import MACHINE_PARTS, TABLES
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.experiments.file.shipped import shipped_files, starter
from grosmc_mj.experiments.file.units import _KNOWN, _registry, number_in
from grosmc_mj.physics.files import load_model
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants.cart_pendulum import CartPendulumParameters, pole_torque

SOUND = """
title = "sound"

[plant]
system = "arm"

[run]
start = { "joint angle" = "10 deg" }
duration = "1 s"

[[edit]]
body = "link"
mass_scale = 2

[[disturbance]]
body = "link"
torque = ["0 N m", "0.1 N m", "0 N m"]
profile = "sine"
frequency = "1 Hz"

[[controller]]
law = "grosmc"
k = 18

[[requirement]]
deviation_below = "10 mrad"
"""


def written(folder: Path, text: str) -> Path:
    """A case file with this text."""
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("value", "unit", "number"),
    [
        ("10 deg", "rad", math.pi / 18),
        ("180 deg/s", "rad/s", math.pi),
        ("1 Hz", "rad/s", 2 * math.pi),
        ("5 cm", "m", 0.05),
        ("-.5e-1 N m", "N m", -0.05),
        ("2 ms", "s", 0.002),
        ("3 rad/s³", "rad/s³", 3.0),
        (4, "1", 4.0),
    ],
)
def test_units_are_converted(value: object, unit: str, number: float):
    # A conversion is one product or two, of factors that are rounded once.
    assert number_in(value, unit) == pytest.approx(number, rel=4e-16)


# Beyond, a factor leads out of all numbers.
@given(st.floats(-1e300, 1e300), st.sampled_from(sorted(_KNOWN)))
def test_known_factors_convert_as_pint_does(number: float, units: tuple[str, str]) -> None:
    written, unit = units
    converted = float(_registry().Quantity(number, written).to(unit).magnitude)
    assert number_in(f"{number!r} {written}", unit) == converted


@pytest.mark.parametrize(
    ("value", "unit", "said"),
    [
        (6, "s", '6 has no unit: write "6 s"'),
        ("6", "s", '"6" has no unit: write "6 s"'),
        ("6 m", "s", '"6 m" cannot be converted to s'),
        ("6 parsnip", "s", "'parsnip' is no unit"),
        ("soon", "s", "is no number with a unit"),
        (True, "s", "must be a number with a unit"),
        ("1e999 s", "s", "must be finite"),
        ("4", "1", "must be a number without a unit"),
        ("0.5 Nm", "N m", "cannot be converted to N m"),
    ],
)
def test_wrong_units_are_refused(value: object, unit: str, said: str):
    with pytest.raises(ValueError, match=said.replace("(", r"\(")):
        number_in(value, unit)


def test_sound_file_is_read(tmp_path: Path):
    file = read_case_file(written(tmp_path, SOUND))
    assert (file.name, file.run.duration, file.run.control_period) == ("mine", 1.0, None)
    assert file.disturbance[0].torque == [0.0, 0.1, 0.0]
    assert file.controller[0].numbers == {"k": 18}


WRONG = [
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
    ("mass_scale", "mass_scal", "edit 1: unknown key 'mass_scal': did you mean 'mass_scale'?"),
    ("mass_scale = 2", 'mass_scale = "two"', "edit 1: mass_scale = 'two' must be a number"),
    ("mass_scale = 2", "mass_scale = -2", "mass_scale = -2 must be finite and positive"),
    ("mass_scale = 2", "", "edit 1: the edit changes nothing"),
    ("mass_scale = 2", "damping = 2", "edit 1: a body has no damping; valid: mass_scale"),
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
    ("k = 18", "k = -1", "k = -1 must be finite and positive"),
    ("k = 18", "Q = [1, 2, 3]", "Q = [1, 2, 3] must be a number, 2 numbers or a 2 x 2 matrix"),
    ("k = 18", "Q = [-1, 0]", "Q"),
    ("k = 18", 'switching = "implcit"', "did you mean 'implicit'?"),
    ("k = 18", '[[controller]]\nlaw = "grosmc"', "two controllers are called 'grosmc'"),
    ("k = 18", '[task]\nreference = ["sin(w*t)"]', "'sin(w*t)' has w, may have t, pi, sin"),
    ("k = 18", '[task]\nreference = ["sin(t"]', "'sin(t' is no formula in t"),
    ("k = 18", '[task]\nreference = ["0", "0"]', "2 formulas, there are 1 outputs"),
    ("k = 18", '[task]\noutputs = {of = "leg"}', "unknown outputs 'leg': valid: plant"),
    ("k = 18", "Q = {a = 1}", "Q = {'a': 1} must be a number, 2 numbers"),
    ("k = 18", "QR = 1", "controller grosmc: unknown key 'QR'"),
    ("k = 18", "k = [1, 2]", "k = [1, 2] must be a number"),
    ("k = 18", "k = nan", "k = nan must be finite"),
    ("k = 18", "G = [[1, 2, 3]]", "G = [[1.0, 2.0, 3.0]] must be 1 x 2 finite numbers"),
    ("k = 18", '[task]\nreference = ["__import__(0)"]', "has __import__, may have t, pi, sin"),
    ("k = 18", '[task]\nreference = ["t.real"]', "has real, may have t, pi, sin"),
    ("k = 18", '[task]\nreference = ["t, t"]', "'t, t' is no formula in t"),
    ("k = 18", '[task]\nreference = ["1/t"]', "no value at t = 0"),
    ("mass_scale = 2", 'mass_scale = 2\nadded_mass = "1 kg"', "write two [[edit]]"),
    ("mass_scale = 2", 'mass_scale = 2\nmass = "1 kg"', "give the number or its scale"),
    ("mass_scale = 2", 'mass_scale = 2\nat = ["1 m", "0 m", "0 m"]', "give it one"),
    ('"1 s"', '"1e12 s"', "from 1e-09 to 1e+09 s"),
    ('"1 s"', '"1 s**2**9**9**9"', "is no unit"),
    ('"10 mrad"', '"10 mrad"\nafter = "1 s"', "after is for stays_within"),
    (
        'deviation_below = "10 mrad"',
        'stays_within = "1 rad"\nafter = "2 s"',
        "before the end of a run",
    ),
    ('deviation_below = "10 mrad"', 'stays_within = "1 rad"\nafter = "-1 s"', "not be negative"),
    ('"10 mrad"', '"10 mm"', 'requirement 1: deviation_below: "10 mm" cannot be converted to rad'),
    ('"10 mrad"', '"0 rad"', "must be positive"),
    ('deviation_below = "10 mrad"', "", "requirement 1: nothing is required"),
    ("deviation_below", "deviation_blow", "did you mean 'deviation_below'?"),
    ('"10 mrad"', '"10 mrad"\nof = ["lqr"]', "requirement 1: unknown controller 'lqr'"),
    ('"10 mrad"', '"10 mrad"\non = ["moon"]', "valid: printed, corrected, physics"),
    ('title = "sound"', "title = sound", "no valid TOML: Invalid value (at line 2"),
]


@pytest.mark.parametrize(("good", "bad", "said"), WRONG)
def test_wrong_file_is_told_in_one_line(tmp_path: Path, good: str, bad: str, said: str):
    assert good in SOUND
    path = written(tmp_path, SOUND.replace(good, bad, 1))
    with pytest.raises(ArgumentError) as refused:
        list(Experiment.load(path).runs())
    message = str(refused.value)
    assert said in message
    assert "\n" not in message


def test_missing_and_binary_files_are_told(tmp_path: Path):
    with pytest.raises(ArgumentError, match="cannot be read: No such file"):
        read_case_file(tmp_path / "nowhere.toml")
    (tmp_path / "mine.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ArgumentError, match="no text in UTF-8"):
        read_case_file(tmp_path / "mine.toml")


@pytest.mark.slow
def test_every_shipped_case_can_be_prepared():
    for path in shipped_files().values():
        experiment = Experiment.load(path)
        assert experiment.limits, f"{path} requires nothing"


MACHINE = {kind: TABLES[kind] for kind in MACHINE_PARTS}


def test_the_starter_explains_every_key():
    text = starter().lower()
    # What the starter leaves out is for a robot or another kind of profile, and is in its comments.
    tables = (
        schema.RunTable, schema.ClaimTable, schema.DisturbanceTable, schema.EditTable
    )  # fmt: skip
    for table in (*tables, *MACHINE.values()):
        for key in table.model_fields:
            assert re.search(rf"\b{key}\b", text), f"{table.__name__}.{key}"
    for name, table in MACHINE.items():
        (part,) = re.findall(rf"# \[\[{name}\]\](.*?)\n(?:# \[\[|\n)", text, re.DOTALL)
        for key in table.model_fields.keys() - {"assumed"}:
            assert re.search(rf"\b{key}\b", part), f"[[{name}]] without {key}"


def test_the_starters_machine_is_one(tmp_path):
    """Without its comment signs, and with what stands behind them left out."""
    before, machine, after = re.split(
        r"(# ---- The machine.*?)(?=# ---- The laws)", starter(), flags=re.DOTALL
    )
    lines = [line for line in machine.splitlines() if re.match(r"# (\[\[|\w+ = )", line)]
    file = tmp_path / "mine.toml"
    file.write_text("\n".join([before, *(line[2:] for line in lines), "", after]))
    plant = Experiment.load(file).plant("physics")
    assert isinstance(plant, MujocoPlant)
    assert [part.kind for part in plant.parts] == [name.replace("_", " ") for name in MACHINE]
    assert {each.kind for each in plant.hidden_states} == {"twist", "load", "bristle"}


def test_shipped_cases_are_those_of_the_chapter():
    assert [case.name for case in cases("servo")] == [
        "nominal",
        "case1",
        "case2",
        "bench",
        "machine",
    ]
    nominal = CartPendulumParameters.from_model(load_model("cart_pendulum"), "corrected")
    push = find_case("cart_pendulum", "case2").disturbances[0]
    assert push.wrench[4] == -pole_torque(PENDULUM_DISTURBANCE, nominal)
    assert find_case("arm", "case1").x0 == (0.5, math.pi)

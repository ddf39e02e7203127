"""Declared campaigns, and the one line that refuses a wrong one before any run."""

from pathlib import Path
from typing import Any

import campaign_cases as small
import pytest
from campaign_cases import BOTH, INERTIA, LOOP, MACHINE, campaign, of, plain, standing, uncertain
from case_texts import PYTHON

from grosmc_mj.ground.errors import MISTAKE_SEPARATOR, ArgumentError
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.sweep.runs import plant_of


def scale(spread: str, *more: str) -> str:
    """The rotor's mass scale as an uncertain number."""
    return of("body", "rotor", f"mass_scale = {spread}", *more)


def correlated(first: str, second: str, coefficient: str) -> str:
    """A correlation of two uncertain numbers."""
    return f'[[correlation]]\nbetween = ["{first}", "{second}"]\ncoefficient = {coefficient}\n'


SCALE = "rotor mass scale"
LOAD = "load amplitude"
DAMPING = of("joint", "shaft", "damping = [0, 1]")
NORMAL = 'distribution = "normal", mean = 1, deviation = 0.1'
NOT_DEFINITE = (
    BOTH
    + DAMPING
    + correlated(SCALE, LOAD, "0.9")
    + correlated(LOAD, "shaft damping", "0.9")
    + correlated(SCALE, "shaft damping", "-0.9")
)
NUMBERS = [
    (of("body", "world", "mass_scale = [1, 2]"), "unknown body 'world': valid: rotor"),
    (of("disturbance", "lod", "amplitude = [1, 2]"), "did you mean 'load'?"),
    (of("disturbance", "load", 'phase = ["0 rad", "1 rad"]'), "unknown number 'phase'"),
    (of("parameter", "J", "scale = [1, 2]"), "name a body or joint instead"),
    (scale("[1, 1]"), "uniform: least 1, most 1 is no distribution: least must be below most"),
    (scale('{ distribution = "normal", mean = 1 }'), "normal needs mean and deviation and may"),
    (scale(f"{{ {NORMAL}, least = 50 }}"), "is no distribution"),
    (scale('{ distribution = "loguniform", least = 0, most = 2 }'), "is no distribution"),
    (scale('{ distribution = "triangular", least = 1, most = 2, mode = 3 }'), "no distribution"),
    (scale('{ distribution = "lognormal", median = -1, spread = 1 }'), "is no distribution"),
    (scale("[0, 1]"), "0 can occur, but must be finite and positive: cut the distribution off"),
    (scale(f"{{ {NORMAL} }}"), "= -inf can occur, but must be finite and positive: cut the"),
    (scale("[1, 1e308]"), "values: 1e+308 is too large: write 1e+100 at most"),
    (of("disturbance", "load", "amplitude = [-1e308, 1e308]"), "-1e+308 is too large: write"),
    (scale('{ distribution = "lognormal", median = 1, spread = 40 }'), "e+142 can occur, but"),
    (of("body", "rotor", 'added_mass = [1, "2 kg"]'), 'least: 1 has no unit: write "1 kg"'),
    (uncertain('number = "edit.rotor.mass_scale"'), "values is missing"),
    (uncertain("values = [1, 2]"), "number is missing"),
    (scale("[1, 2]", 'at = ["0 m", "0 m", "1 m"]'), "at is where an added_mass is"),
    (BOTH + INERTIA, "two are uncertain 'edit.rotor.mass_scale'"),
    (scale("[1, 2]", 'name = "a"') + DAMPING + 'name = "a"\n', "two are called 'a'"),
    (scale("[1, 2]", 'name = "deviation"'), "'deviation' is a column of the results"),
    ("", "nothing is uncertain: give it an [[uncertain]]"),
    (BOTH + correlated(SCALE, LOAD, "1.5"), "coefficient = 1.5 must be less than 1"),
    (BOTH + 2 * correlated(SCALE, LOAD, "0.5"), "give it once, of two different numbers"),
    (NOT_DEFINITE, "the matrix is not positive definite"),
]
MACHINES = [
    (("motor", "current", 'resistance = ["0 ohm", "1 ohm"]'), "= 0 can occur, but must be from"),
    (("wall", "roter", "restitution = [0.1, 0.2]"), "unknown wall 'roter': did you mean 'rotor'?"),
    (("motor", "current", 'voltage = ["9 V", "24 V"]'), "voltage is not limited: write"),
    # Together with the other numbers of the file.
    (
        ("lugre", "shaft", 'static = ["20 mN m", "90 mN m"]'),
        "uncertain: shaft static 0.02 N m can occur, where there is no such machine",
    ),
    (("stop", "shaft", 'low = ["-1 rad", "2 rad"]'), "low = 2 must be below high = 1"),
    # A stop would throw out a plant that starts beyond it.
    (("stop", "shaft", 'low = ["-1 rad", "0.5 rad"]'), "beyond its stops at 0.5 and 1 rad"),
    (("transmission", "shaft", 'stiffness = ["100 N m/rad", "5 MN m/rad"]'), "makes unstable"),
]
COULOMB = of("lugre", "shaft", 'coulomb = ["30 mN m", "70 mN m"]')
RADIUS = of("wall", "rotor", 'radius = ["1 cm", "2 cm"]')
SECOND_WALL = """
[[wall]]
body = "rotor"
radius = "2 cm"
point = ["0 m", "0 m", "-2 m"]
"""
SPEED_NOISE = of("sensor", "rotor speed", 'noise = ["0 rad/s", "1 rad/s"]')
# Both states of one age, for a law that predicts.
PREDICTS = """
[computing]
[[sensor]]
of = "rotor angle"
[[sensor]]
of = "rotor speed"
[[controller]]
law = "lqr"
predict = true
"""
SENSOR_DELAY = of("sensor", "rotor angle", 'delay = ["0 ms", "2 ms"]')
LONG_DELAY = """
[[uncertain]]
number = "computing.delay"
values = { distribution = "normal", mean = "1 ms", deviation = "20 s", least = "0 s" }
"""
MISSED = uncertain('number = "computing.missed"', "values = [0.5, 1.0]")
LAG = of("actuator", "current", 'lag = ["0 ms", "1 ms"]')
LATE_ERROR = """
[[requirement]]
stays_within = "1 rad"
after = "49.5 ms"
"""
TEXTS = [
    *((plain(tables), words) for tables, words in NUMBERS),
    *((standing(of(*table), MACHINE), words) for table, words in MACHINES),
    (standing(2 * COULOMB, MACHINE), "two are uncertain 'lugre.shaft.coulomb'"),
    (standing(RADIUS, MACHINE + SECOND_WALL), "write wall.rotor[1].radius or wall.rotor[2].radius"),
    (standing(SENSOR_DELAY, PREDICTS), "let computing.delay vary instead"),
    (standing(LONG_DELAY, PREDICTS), "at most 100000"),
    (standing(SPEED_NOISE, LOOP), "unknown sensor"),
    (standing(MISSED, LOOP), "missed = 1 can occur"),
    (
        standing(LAG, small.LQR),
        "the case file has no [[actuator]]: write one",
    ),
    (plain() + small.PUSH, "write disturbance.load[1].scale or disturbance.load[2].scale"),
    (
        plain() + LATE_ERROR,
        "an error after 0.0495 s: the last timestep of a run begins at 0.049 s",
    ),
]


def refused(text: str, words: str, **options: Any) -> None:
    """Refuse a campaign in one line, or a list of mistakes, with these words."""
    with pytest.raises(ArgumentError) as refusal:
        Campaign.of(small.specification(text, **options))
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value).replace(MISTAKE_SEPARATOR, "")


@pytest.mark.parametrize(("text", "words"), TEXTS, ids=[words for _, words in TEXTS])
def test_a_wrong_file_is_refused_in_one_line(text: str, words: str) -> None:
    refused(text, words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"runs": 0}, "runs = 0 must be a whole number from 1"),
        ({"runs": 10**9, "shard": 1}, "take a larger shard"),
        ({"sampler": "sobol"}, "unknown sampler 'sobol': valid: random, corners"),
        ({"control_period": 0.0015}, "no multiple of the timestep 0.001 s"),
        ({"sampler": "corners"}, "8 runs, but there are 4 corners"),
    ],
)
def test_a_wrong_argument_is_refused_in_one_line(arguments: dict[str, Any], words: str) -> None:
    refused(plain(), words, **arguments)


def test_correlated_numbers_have_no_corners() -> None:
    refused(plain(BOTH + small.CORRELATED), "there are 0 corners", sampler="corners", runs=2)


DAMPING_OF_BOTH = """
[[uncertain]]
number = "lugre.shaft.damping"
values = ["0 N m s/rad", "1 N m s/rad"]
[[uncertain]]
number = "transmission.shaft.damping"
values = ["0 N m s/rad", "1 N m s/rad"]
"""


def test_two_numbers_of_one_name_are_refused() -> None:
    refused(standing(DAMPING_OF_BOTH, MACHINE), "two are called 'shaft damping'")


def test_a_name_of_its_own_tells_two_numbers_apart() -> None:
    declared = campaign(standing(DAMPING_OF_BOTH + 'name = "of the gear"\n', MACHINE))
    assert declared.family.names == ["shaft damping", "of the gear"]


FOUR_MISTAKES = """
[[uncertain]]
number = "edit.roter.mass_scale"
values = [1, 2]
[[uncertain]]
number = "edit.shaf.damping"
values = [0, 1]
"""
UNKNOWN_KEYS = """
[[uncertain]]
number = "edit.roter.mass_scal"
values = [1, 2]
[[uncertain]]
number = "edit.shaf.dampin"
values = [0, 1]
"""
UNKNOWN_LAW = """
[[controller]]
law = "grosmk"
"""


def mistakes_in_names() -> list[str]:
    """Return the lines about unknown names of laws, numbers and controllers."""
    text = plain(FOUR_MISTAKES) + UNKNOWN_LAW
    with pytest.raises(ArgumentError) as refusal:
        Campaign.of(small.specification(text, controllers=("lqq",)))
    return str(refusal.value).split(MISTAKE_SEPARATOR)


def test_mistakes_in_names_are_counted() -> None:
    first, *mistakes = mistakes_in_names()
    assert first.endswith("4 mistakes:")
    assert len(mistakes) == 4


@pytest.mark.parametrize(
    ("number", "name"),
    [(1, "'lqq'"), (2, "'grosmk'"), (3, "'roter'"), (4, "'shaf'")],
)
def test_each_mistake_in_a_name_has_its_line(number: int, name: str) -> None:
    assert name in mistakes_in_names()[number]


def test_unknown_keys_are_named_before_all_other_mistakes() -> None:
    refused(plain(UNKNOWN_KEYS), "2 mistakes:")


EARLY_LOAD = of("disturbance", "load", 'onset = ["0 s", "0.02 s"]')
LATER_LOAD = of("disturbance", "load", 'onset = ["0.01 s", "0.02 s"]')
SETTLES = """
[[requirement]]
settles_within = "{} ms"
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (plain() + SETTLES.format(19), "there are 0.02 s before"),
        # A load that may come at once leaves nothing to settle in.
        (plain(EARLY_LOAD) + SETTLES.format(10), "there are 0 s before"),
    ],
)
def test_a_requirement_that_runs_cannot_decide_is_not_judged(text: str, words: str) -> None:
    declared = campaign(text)
    (line,) = declared.not_judged
    assert words in line
    assert "settles_within" not in {limit.key for limit in declared.requirements}


@pytest.mark.parametrize(
    ("text", "options", "labels"),
    [
        (plain(), {}, []),
        (plain(), {"duration": 0.02}, ["load", "hum"]),
        (plain(LATER_LOAD), {"duration": 0.02}, ["hum"]),
    ],
)
def test_a_disturbance_after_the_end_of_all_runs_is_idle(
    text: str, options: dict[str, Any], labels: list[str]
) -> None:
    assert campaign(text, **options).idle == labels


WITHIN = """
[[requirement]]
input_below = "{}"
"""
AMPLIFIER = """
[[actuator]]
of = "current"
limit = "4 A"
"""


@pytest.mark.parametrize(
    ("limit", "uncertain", "expected"),
    [
        ("3 A", "", []),
        ("4 A", "", ["cannot fail: input below 4 A (the actuator gives 4 A at most)"]),
        ("4 A", of("actuator", "current", 'limit = ["2 A", "6 A"]'), []),
    ],
)
def test_a_requirement_that_no_plant_can_fail_is_named(
    limit: str, uncertain: str, expected: list[str]
) -> None:
    declared = campaign(plain(scale("[1, 2]") + uncertain + AMPLIFIER + WITHIN.format(limit)))
    assert declared.notes == expected


OWN = """
[plant]
plant = "own:pendulum"
[run]
duration = "50 ms"
[task]
reference = ["0.5"]
Q = [100, 1]
R = 1
[[controller]]
law = "fl-lqr"
"""


@pytest.fixture
def beside_python(tmp_path: Path) -> str:
    """A folder with the plant's Python."""
    (tmp_path / "own.py").write_text(PYTHON)
    return str(tmp_path)


def test_an_analytic_plant_has_no_bodies(beside_python: str) -> None:
    text = OWN + scale("[1, 2]")
    refused(text, "no model in MuJoCo, so no body: name a", folder=beside_python)


def test_an_unknown_parameter_of_an_analytic_plant_is_refused(beside_python: str) -> None:
    text = OWN + of("parameter", "j", "scale = [1, 2]")
    refused(text, "unknown parameter 'j': valid: m", folder=beside_python)


def test_a_scale_of_an_analytic_plant_s_parameter_reaches_the_plant(beside_python: str) -> None:
    text = OWN + of("parameter", "m", "scale = [1, 2]")
    declared = campaign(text, folder=beside_python)
    plant: Any = plant_of(declared.plant_sample([1.5]), declared.plant)
    assert plant.parameters.m == 3.0

"""The campaigns that can be declared, and the one line that refuses all others before any run."""

from pathlib import Path
from typing import Any

import campaign_cases as small
import pytest
from campaign_cases import BOTH, INERTIA, LOOP, MACHINE, campaign, of, plain, standing, uncertain
from case_texts import PYTHON

from grosmc_mj.errors import NEXT, ArgumentError
from grosmc_mj.sweep.campaign import Campaign


def scale(spread: str, *more: str) -> str:
    return of("body", "rotor", f"mass_scale = {spread}", *more)


def correlated(first: str, second: str, coefficient: str) -> str:
    return f'[[correlation]]\nbetween = ["{first}", "{second}"]\ncoefficient = {coefficient}\n'


SCALE, LOAD = "rotor mass scale", "load amplitude"
DAMPING = of("joint", "shaft", "damping = [0, 1]")
NORMAL = 'distribution = "normal", mean = 1, deviation = 0.1'
NUMBERS = [
    (of("body", "world", "mass_scale = [1, 2]"), "unknown body 'world': valid: rotor"),
    (of("disturbance", "lod", "amplitude = [1, 2]"), "did you mean 'load'?"),
    (of("disturbance", "load", 'phase = ["0 rad", "1 rad"]'), "a Pulse profile has no phase"),
    (of("parameter", "J", "scale = [1, 2]"), "name a body or joint instead"),
    (scale("[1, 1]"), "uniform: least 1, most 1 is no distribution: least must be below most"),
    (scale('{ distribution = "normal", mean = 1 }'), "normal needs mean and deviation and may"),
    (scale(f"{{ {NORMAL}, least = 50 }}"), "is no distribution"),
    (scale('{ distribution = "loguniform", least = 0, most = 2 }'), "is no distribution"),
    (scale('{ distribution = "triangular", least = 1, most = 2, mode = 3 }'), "no distribution"),
    (scale('{ distribution = "lognormal", median = -1, spread = 1 }'), "is no distribution"),
    (scale("[0, 1]"), "0 can occur, but must be finite and positive: cut the distribution off"),
    (scale(f"{{ {NORMAL} }}"), "= -inf can occur, but must be finite and positive: cut the"),
    (of("body", "rotor", 'added_mass = [1, "2 kg"]'), 'least: 1 has no unit: write "1 kg"'),
    (of("body", "rotor"), "give one of mass_scale, length_scale, added_mass, not none"),
    (uncertain("mass_scale = [1, 2]"), "name one of body, joint, disturbance, start, parameter"),
    (scale("[1, 2]", 'at = ["0 m", "0 m", "1 m"]'), "at is where an added_mass is"),
    (BOTH + INERTIA, "two are uncertain 'rotor mass_scale'"),
    (scale("[1, 2]", 'name = "a"') + DAMPING + 'name = "a"\n', "two are called 'a'"),
    (scale("[1, 2]", 'name = "deviation"'), "'deviation' is a column of the results"),
    ("", "nothing is uncertain: give it an [[uncertain]]"),
    (BOTH + correlated(SCALE, LOAD, "1.5"), "coefficient = 1.5 must be less than 1"),
    (BOTH + 2 * correlated(SCALE, LOAD, "0.5"), "give it once, of two different numbers"),
    (
        BOTH + DAMPING + correlated(SCALE, LOAD, "0.9")
        + correlated(LOAD, "shaft damping", "0.9") + correlated(SCALE, "shaft damping", "-0.9"),
        "the matrix is not positive definite",
    ),
]  # fmt: skip
OFTEN = 'distribution = "normal", mean = "1 ms", deviation = "20 s", least = "0 s"'
MACHINES = [
    (("motor", "current", 'resistance = ["0 ohm", "1 ohm"]'), "= 0 can occur, but must be from"),
    (("wall", "roter", "restitution = [0.1, 0.2]"), "the file has no [[wall]] of 'roter'"),
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
TWICE = of("lugre", "shaft", 'coulomb = ["30 mN m", "70 mN m"]')
SWING = of("swinging_load", "rotor", 'mass = ["50 g", "150 g"]')
SECOND = '[[swinging_load]]\nbody = "rotor"\nmass = "0.2 kg"\nlength = "30 cm"\n'
NOISE = of("sensor", "rotor angle", 'noise = ["0 mrad", "1 mrad"]')
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
LATE = of("sensor", "rotor angle", 'delay = ["0 ms", "2 ms"]')
TEXTS = [
    *((plain(tables), words) for tables, words in NUMBERS),
    *((standing(of(*drawn), MACHINE), words) for drawn, words in MACHINES),
    (standing(2 * TWICE, MACHINE), "two are uncertain 'lugre shaft coulomb'"),
    (standing(SWING, MACHINE + SECOND), "the file has 2 [[swinging_load]] of 'rotor'"),
    (standing(LATE, PREDICTS), "let that of computing = true vary instead"),
    (
        standing(uncertain("computing = true", f"delay = {{ {OFTEN} }}"), PREDICTS),
        "at most 100000",
    ),
    (standing(NOISE.replace("angle", "speed").replace("mrad", "rad/s"), LOOP), "unknown sensor"),
    (
        standing(uncertain("computing = true", "missed = [0.5, 1.0]"), LOOP),
        "missed = 1 can occur",
    ),
    (
        standing(of("actuator", "current", 'lag = ["0 ms", "1 ms"]'), small.LQR),
        "the case file has no actuator, of which this is a number: write one",
    ),
    (plain() + small.PUSH, "two disturbances have the label 'load': give each its own"),
    (
        plain() + '[[requirement]]\nstays_within = "1 rad"\nafter = "49.5 ms"\n',
        "an error after 0.0495 s: the last timestep of a run begins at 0.049 s",
    ),
]


def refused(text: str, words: str, **options: Any) -> None:
    with pytest.raises(ArgumentError) as refusal:
        Campaign.of(small.specification(text, **options))
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value).replace(NEXT, "")


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


def test_correlated_numbers_have_no_corners_and_numbers_of_one_name_need_names() -> None:
    refused(plain(BOTH + small.CORRELATED), "there are 0 corners", sampler="corners", runs=2)
    both = [of(kind, "shaft", 'damping = ["0 N m s/rad", "1 N m s/rad"]')
            for kind in ("lugre", "transmission")]  # fmt: skip
    refused(standing("".join(both), MACHINE), "two are called 'shaft damping'")
    named = campaign(standing("".join([*both, 'name = "of the gear"\n']), MACHINE))
    assert named.family.names == ["shaft damping", "of the gear"]


def test_all_mistakes_are_named_at_once() -> None:
    """Of laws, uncertain numbers and controllers together; of the file's keys before them."""
    text = plain(scale("[1, 2]").replace("rotor", "roter") + DAMPING.replace("shaft", "shaf"))
    law = '[[controller]]\nlaw = "grosmk"\n'
    with pytest.raises(ArgumentError) as refusal:
        Campaign.of(small.specification(text + law, controllers=("lqq",)))
    first, *mistakes = str(refusal.value).split(NEXT)
    assert first.endswith("4 mistakes:")
    for words, name in zip(mistakes, ("'lqq'", "'grosmk'", "'roter'", "'shaf'"), strict=True):
        assert name in words
    refused(text.replace("mass_scale", "mass_scal").replace("damping", "dampin"), "2 mistakes:")


ONSET = of("disturbance", "load", 'onset = ["{} s", "0.02 s"]')
SHORT = '[[requirement]]\nsettles_within = "{} ms"\n'


def test_what_runs_cannot_show_is_not_judged_and_a_disturbance_after_the_end_is_idle() -> None:
    for text, words in (
        (plain() + SHORT.format(19), "there are 0.02 s before"),
        # A load that may come at once leaves nothing to settle in.
        (plain(ONSET.format(0)) + SHORT.format(10), "there are 0 s before"),
    ):
        declared = campaign(text)
        assert [words in line for line in declared.not_judged] == [True]
        assert "settles_within" not in {limit.kind for limit in declared.requirements}
    assert campaign(plain()).idle == []
    assert campaign(plain(), duration=0.02).idle == ["load", "hum"]
    assert campaign(plain(ONSET.format(0.01)), duration=0.02).idle == ["hum"]


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


def test_an_analytic_plant_has_parameters_and_no_bodies(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(PYTHON)
    folder = str(tmp_path)
    refused(OWN + scale("[1, 2]"), "no model in MuJoCo, so no body: name a", folder=folder)
    refused(
        OWN + of("parameter", "j", "scale = [1, 2]"),
        "unknown parameter 'j': valid: m",
        folder=folder,
    )
    family = campaign(OWN + of("parameter", "m", "scale = [1, 2]"), folder=folder)
    plant: Any = family.plant_sample([1.5]).plant(family.plant)
    assert plant.parameters.m == 3.0

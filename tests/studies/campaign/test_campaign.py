"""Declared campaigns, and the one line that refuses a wrong one before any run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cases
import pytest
from campaigns import (
    AMPLITUDE,
    BETWEEN_BOTH,
    BOTH,
    HUM,
    LOAD,
    LOOP,
    LQR,
    MACHINE,
    MASS,
    PUSH,
    campaign,
    part,
    plain,
    servo,
    specification,
    uncertain,
)

from grosmc_mj.ground.errors import MISTAKE_SEPARATOR, ArgumentError
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.sweep.runs import plant_of

Number = dict[str, Any]


def scale(*values: Any, **more: Any) -> Number:
    """The rotor's mass scale as an uncertain number."""
    return uncertain("edit.rotor.mass_scale", *values, **more)


def distributed(distribution: str, **numbers: float) -> Number:
    """The rotor's mass scale by a distribution."""
    return scale({"distribution": distribution, **numbers})


def correlated(first: str, second: str, coefficient: float) -> dict[str, Any]:
    """A correlation of two uncertain numbers."""
    return {"between": [first, second], "coefficient": coefficient}


NAMES = ("rotor mass scale", "load amplitude", "shaft damping")
DAMPING = uncertain("edit.shaft.damping", 0, 1)
NUMBERS = [
    (uncertain("edit.world.mass_scale", 1, 2), "unknown body 'world': valid: rotor"),
    (uncertain("disturbance.lod.scale", 1, 2), "did you mean 'load'?"),
    (uncertain("disturbance.load.phase", "0 rad", "1 rad"), "unknown number 'phase'"),
    (uncertain("edit.J.scale", 1, 2), "name a body or joint instead"),
    (uncertain("task.R", 1, 2), "is of the laws or of what they must keep: a campaign varies"),
    (scale(1, 1), "uniform: least 1, most 1 is no distribution: least must be below most"),
    (distributed("normal", mean=1), "normal needs mean and deviation and may"),
    (distributed("normal", mean=1, deviation=0.1, least=50), "is no distribution"),
    (distributed("loguniform", least=0, most=2), "is no distribution"),
    (distributed("triangular", least=1, most=2, mode=3), "no distribution"),
    (distributed("lognormal", median=-1, spread=1), "is no distribution"),
    (scale(0, 1), "0 can occur, but must be finite and positive: cut the distribution off"),
    (distributed("normal", mean=1, deviation=0.1), "= -inf can occur, but must be finite and"),
    (scale(1, 1e308), "values: 1e+308 is too large: write 1e+100 at most"),
    (distributed("lognormal", median=1, spread=40), "e+142 can occur, but"),
    (uncertain("edit.rotor.added_mass", 1, "2 kg"), 'least: 1 has no unit: write "1 kg"'),
    ({"number": "edit.rotor.mass_scale"}, "values is missing"),
    ({"values": [1, 2]}, "number is missing"),
    (scale(1, 2, at=["0 m", "0 m", "1 m"]), "at is where an added_mass is"),
    (scale(1, 2, name="deviation"), "'deviation' is a column of the results"),
]
TWO_WALLS = [MACHINE["wall"], {**MACHINE["wall"], "point": ["0 m", "0 m", "-2 m"]}]
COULOMB = uncertain("lugre.shaft.coulomb", "30 mN m", "70 mN m")
MACHINES = [
    ([uncertain("motor.current.resistance", "0 ohm", "1 ohm")], "= 0 can occur, but must be from"),
    ([uncertain("wall.roter.restitution", 0.1, 0.2)], "unknown wall 'roter': did you mean 'rotor'"),
    ([uncertain("motor.current.voltage", "9 V", "24 V")], "voltage is not limited: write"),
    # Together with the other numbers of the file.
    (
        [uncertain("lugre.shaft.static", "20 mN m", "90 mN m")],
        "uncertain: shaft static 0.02 N m can occur, where there is no such machine",
    ),
    # Of one the least with the largest of the other.
    (
        [COULOMB, uncertain("lugre.shaft.static", "60 mN m", "90 mN m")],
        "can occur, where there is no such machine",
    ),
    ([uncertain("stop.shaft.low", "-1 rad", "2 rad")], "low = 2 must be below high = 1"),
    # A stop would throw out a plant that starts beyond it.
    ([uncertain("stop.shaft.low", "-1 rad", "0.5 rad")], "beyond its stops at 0.5 and 1 rad"),
    (
        [uncertain("transmission.shaft.stiffness", "100 N m/rad", "5 MN m/rad")],
        "makes unstable",
    ),
]
EQUAL_DELAYS = {
    "computing": {},
    "sensor": [{"of": "rotor angle"}, {"of": "rotor speed"}],
    "laws": [{"law": "lqr", "predict": True}],
}
LONG_DELAY = {"distribution": "normal", "mean": "1 ms", "deviation": "20 s", "least": "0 s"}
TEXTS = [
    *((plain(number), words) for number, words in NUMBERS),
    *((part(*numbers, **MACHINE), words) for numbers, words in MACHINES),
    (part(), "nothing is uncertain: give it an [[uncertain]]"),
    (plain(*BOTH, MASS), "two are uncertain 'edit.rotor.mass_scale'"),
    (plain(scale(1, 2, name="a"), {**DAMPING, "name": "a"}), "two are called 'a'"),
    (plain(correlation=correlated(*NAMES[:2], 1.5)), "coefficient = 1.5 must be less than 1"),
    (plain(correlation=2 * [BETWEEN_BOTH]), "give it once, of two different numbers"),
    (
        plain(
            *BOTH,
            DAMPING,
            correlation=[
                correlated(NAMES[0], NAMES[1], 0.9),
                correlated(NAMES[1], NAMES[2], 0.9),
                correlated(NAMES[0], NAMES[2], -0.9),
            ],
        ),
        "the matrix is not positive definite",
    ),
    (
        part(uncertain("wall.rotor.radius", "1 cm", "2 cm"), **{**MACHINE, "wall": TWO_WALLS}),
        "write wall.rotor[1].radius or wall.rotor[2].radius",
    ),
    # Both states are of one age, for a law that predicts.
    (
        part(uncertain("sensor.rotor angle.delay", "0 ms", "2 ms"), **EQUAL_DELAYS),
        "let computing.delay vary instead",
    ),
    (part(uncertain("computing.delay", LONG_DELAY), **EQUAL_DELAYS), "at most 100000"),
    (part(uncertain("sensor.rotor speed.noise", "0 rad/s", "1 rad/s"), **LOOP), "unknown sensor"),
    (part(uncertain("computing.missed", 0.5, 1.0), **LOOP), "missed = 1 can occur"),
    (
        part(uncertain("actuator.current.lag", "0 ms", "1 ms")),
        "the case file has no [[actuator]]: write one",
    ),
    (
        plain(disturbance=[LOAD, HUM, PUSH]),
        "write disturbance.load[1].scale or disturbance.load[2].scale",
    ),
    (
        plain(requirement={"stays_within": "1 rad", "after": "49.5 ms"}),
        "an error after 0.0495 s: the last timestep of a run begins at 0.049 s",
    ),
]


def refused(text: str, words: str, **options: Any) -> None:
    """Refuse a campaign in one line, or a list of mistakes, with these words."""
    with pytest.raises(ArgumentError) as refusal:
        Campaign.of(specification(text, **options))
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
    text = plain(correlation=BETWEEN_BOTH)
    refused(text, "there are 0 corners", sampler="corners", runs=2)


def test_two_numbers_of_one_name_need_a_name_of_their_own() -> None:
    of_friction = uncertain("lugre.shaft.damping", "0 N m s/rad", "1 N m s/rad")
    of_gear = uncertain("transmission.shaft.damping", "0 N m s/rad", "1 N m s/rad")
    refused(part(of_friction, of_gear, **MACHINE), "two are called 'shaft damping'")
    declared = campaign(part(of_friction, {**of_gear, "name": "of the gear"}, **MACHINE))
    assert declared.family.names == ["shaft damping", "of the gear"]


def test_mistakes_in_names_are_counted_and_each_has_its_line() -> None:
    wrong_names = uncertain("edit.roter.mass_scale", 1, 2), uncertain("edit.shaf.damping", 0, 1)
    text = servo(*wrong_names, laws=[*LQR, {"law": "grosmk"}], limits=[])
    with pytest.raises(ArgumentError) as refusal:
        Campaign.of(specification(text, controllers=("lqq",)))
    first, *mistakes = str(refusal.value).split(MISTAKE_SEPARATOR)
    assert first.endswith("4 mistakes:")
    names = ("'lqq'", "'grosmk'", "'roter'", "'shaf'")
    assert [name in line for name, line in zip(names, mistakes, strict=True)] == [True] * 4


def test_unknown_keys_are_named_before_all_other_mistakes() -> None:
    keys = uncertain("edit.roter.mass_scal", 1, 2), uncertain("edit.shaf.dampin", 0, 1)
    refused(plain(*keys), "2 mistakes:")


def onset(first: str) -> Number:
    """A load that begins at this instant, or later."""
    return uncertain("disturbance.load.onset", first, "0.02 s")


@pytest.mark.parametrize(
    ("numbers", "limit", "words"),
    [
        (BOTH, "19 ms", "there are 0.02 s before"),
        # A load that may come at once leaves nothing to settle in.
        ([onset("0 s")], "10 ms", "there are 0 s before"),
    ],
)
def test_a_requirement_that_runs_cannot_decide_is_not_judged(
    numbers: list[Number], limit: str, words: str
) -> None:
    declared = campaign(plain(*numbers, requirement={"settles_within": limit}))
    (line,) = declared.not_judged
    assert words in line
    assert "settles_within" not in {limit.key for limit in declared.requirements}


@pytest.mark.parametrize(
    ("numbers", "options", "labels"),
    [
        (BOTH, {}, []),
        (BOTH, {"duration": 0.02}, ["load", "hum"]),
        ([onset("0.01 s")], {"duration": 0.02}, ["hum"]),
    ],
)
def test_a_disturbance_after_the_end_of_all_runs_is_idle(
    numbers: list[Number], options: dict[str, Any], labels: list[str]
) -> None:
    assert campaign(plain(*numbers), **options).idle == labels


@pytest.mark.parametrize(("least", "told"), [(0.9, False), (1.0, False), (1.1, True)])
def test_a_nominal_value_outside_of_the_declared_ones_is_told(least: float, told: bool) -> None:
    (*_, note) = ["", *campaign(plain(uncertain("edit.rotor.mass_scale", least, 3))).notes]
    assert ("nominal value 1 lies outside of its declared values" in note) == told


@pytest.mark.parametrize(
    ("limit", "numbers", "notes"),
    [
        ("3 A", [AMPLITUDE], []),
        (
            "4 A",
            [AMPLITUDE],
            ["cannot fail: input below 4 A (the actuator gives 4 A at most)"],
        ),
        ("4 A", [uncertain("actuator.current.limit", "2 A", "6 A")], []),
    ],
)
def test_a_requirement_that_no_plant_can_fail_is_named(
    limit: str, numbers: list[Number], notes: list[str]
) -> None:
    amplifier = {"of": "current", "limit": "4 A"}
    text = plain(*numbers, actuator=amplifier, requirement={"input_below": limit})
    assert campaign(text).notes == notes


OWN_PLANT = """
import sympy as sp
import grosmc_mj as gm
q, w = sp.symbols("q w")
pendulum = gm.affine_plant("pendulum", states={"q": "rad", "w": "rad/s"}, inputs={"u": "N m"},
    f=[w, -sp.Symbol("m") * sp.sin(q)], g=[0, 1], h=[q], parameters={"m": 2.0})
"""


def analytic(folder: Path, number: Number) -> dict[str, str]:
    """The text of a case of equations of one's own, and the folder with their Python."""
    (folder / "own.py").write_text(OWN_PLANT)
    task = {"reference": ["0.5"], "Q": [100, 1], "R": 1}
    text = cases.text("own:pendulum", law="fl-lqr", task=task, uncertain=number)
    return {"text": text, "folder": str(folder)}


@pytest.mark.parametrize(
    ("number", "words"),
    [
        ("edit.rotor.mass_scale", "no model in MuJoCo, so no body: name a"),
        ("edit.j.scale", "unknown parameter 'j': valid: m"),
    ],
)
def test_an_analytic_plant_has_its_own_parameters_and_no_bodies(
    number: str, words: str, tmp_path: Path
) -> None:
    refused(words=words, **analytic(tmp_path, uncertain(number, 1, 2)))


def test_a_scale_of_an_analytic_plant_s_parameter_reaches_the_plant(tmp_path: Path) -> None:
    declared = campaign(**analytic(tmp_path, uncertain("edit.m.scale", 1, 2)))
    plant: Any = plant_of(declared.plant_sample([1.5]), declared.plant)
    assert plant.parameters.m == 3.0

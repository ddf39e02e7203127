"""What a case file may say of uncertainty, and what it is told when that is wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_cases import AMPLITUDE, BOTH, INERTIA, LQR, campaign, servo, specification

from grosmc_mj.errors import NEXT, ArgumentError
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.family import family_of

NAMES = ("rotor mass scale", "load amplitude", "shaft damping")
DAMPING = '[[uncertain]]\njoint = "shaft"\ndamping = [0, 1]\n'


def uncertain(*lines: str) -> str:
    """One [[uncertain]]."""
    return "\n".join(["[[uncertain]]", *lines, ""])


def mass(spread: str, *more: str) -> str:
    """An uncertain mass of the rotor."""
    return uncertain('body = "rotor"', f"mass_scale = {spread}", *more)


def correlated(first: str, second: str, coefficient: str) -> str:
    """A correlation."""
    return f'[[correlation]]\nbetween = ["{first}", "{second}"]\n{coefficient}\n'


def refusal(of: Callable[[], object]) -> str:
    """What somebody with a wrong campaign is told."""
    with pytest.raises(ArgumentError) as refused:
        of()
    said = str(refused.value)
    assert "\n" not in said
    return said


def plain(uncertain: str = BOTH, more: str = "") -> str:
    """A servo's file with LQR alone, which is designed in no time."""
    return servo(uncertain, laws=LQR, limits="") + more


WRONG = [
    # What is not there.
    (uncertain('body = "roter"', "mass_scale = [1, 2]"), "'roter': did you mean 'rotor'?"),
    (uncertain('body = "world"', "mass_scale = [1, 2]"), "unknown body 'world': valid: rotor"),
    (uncertain('joint = "shaf"', "damping = [1, 2]"), "joint 'shaf': did you mean 'shaft'?"),
    (uncertain('start = "angle"', "value = [1, 2]"), "state 'angle': did you mean 'rotor angle'?"),
    (uncertain('disturbance = "lod"', "amplitude = [1, 2]"), "did you mean 'load'?"),
    (
        uncertain('disturbance = "load"', 'phase = ["0 rad", "1 rad"]'),
        "a Pulse profile has no phase",
    ),
    (mass("[1, 2]", "mas_scale = 1"), "unknown key 'mas_scale': did you mean 'mass_scale'?"),
    (mass('{ distribution = "gaussian" }'), "unknown distribution 'gaussian': valid: uniform"),
    (mass('{ distribution = "normal", meen = 1 }'), "key 'meen': did you mean 'mean'?"),
    (mass("{ least = 1, most = 2 }"), "unknown distribution None: valid: uniform"),
    # Ranges and distributions that are none.
    (mass("[2, 1]"), "uniform: least 2, most 1 is no distribution: least must be below most"),
    (mass("[1, 1]"), "is no distribution"),
    (mass("[nan, 1]"), "least: nan must be finite"),
    (mass("[1, inf]"), "most: inf must be finite"),
    (mass("[true, 2]"), "least: True must be a number without a unit"),
    (mass("[1, 2, 3]"), "[1, 2, 3] must be a range [least, most] or a table such as"),
    (mass("2"), "2 must be a range [least, most] or a table such as"),
    (
        mass('{ distribution = "normal", mean = 1 }'),
        "normal needs mean and deviation and may have least and most, not mean",
    ),
    (mass('{ distribution = "uniform" }'), "uniform needs least and most, not nothing"),
    (
        mass('{ distribution = "uniform", least = 1, most = 2, mode = 1 }'),
        "uniform needs least and most, not least, most, mode",
    ),
    *(
        (mass(f"{{ distribution = {numbers} }}"), "is no distribution")
        for numbers in (
            '"normal", mean = 1, deviation = 0',
            '"normal", mean = 1, deviation = 0.1, least = 50',
            '"loguniform", least = 0, most = 2',
            '"triangular", least = 1, most = 2, mode = 3',
            '"lognormal", median = -1, spread = 1',
            '"lognormal", median = 1, spread = 0',
        )
    ),
    # What is not physical.
    (
        mass("[-1, 1]"),
        "-1 can occur, but must be finite and positive: cut the distribution off",
    ),
    (mass("[0, 1]"), "mass scale = 0 can occur, but must be finite and positive"),
    (
        mass('{ distribution = "normal", mean = 1, deviation = 0.1 }'),
        "= -inf can occur, but must be finite and positive: cut the distribution off with least",
    ),
    (mass("[1, 2]", "nominal = 0"), "mass scale = 0 can occur, but must be finite and positive"),
    (
        uncertain('joint = "shaft"', "damping = [-0.1, 1]"),
        "damping = -0.1 can occur, but must be finite and not",
    ),
    (uncertain('joint = "shaft"', "friction = [-1, 1]"), "must be finite and not negative"),
    (uncertain('body = "rotor"', 'added_mass = ["-1 g", "1 g"]'), "added mass = -0.001 can occur"),
    # Units.
    (mass('["1 kg", 2]'), "least: '1 kg' must be a number without a unit"),
    (mass("[1, 2]", 'nominal = "1 kg"'), "nominal: '1 kg' must be a number without a unit"),
    (uncertain('body = "rotor"', 'added_mass = [1, "2 kg"]'), 'least: 1 has no unit: write "1 kg"'),
    (
        uncertain('disturbance = "hum"', 'frequency = ["1 s", "2 Hz"]'),
        '"1 s" cannot be converted to rad/s',
    ),
    (uncertain('start = "rotor angle"', 'value = [0, "1 rad"]'), 'write "0 rad"'),
    # One number of one thing, once, by a name of its own.
    (
        mass("[1, 2]", "length_scale = [1, 2]"),
        "not length_scale, mass_scale: one [[uncertain]] is one number",
    ),
    (uncertain('body = "rotor"'), "give one of mass_scale, length_scale, added_mass, not none"),
    (uncertain("mass_scale = [1, 2]"), "name one of body, joint, disturbance, start, parameter"),
    (mass("[1, 2]", 'joint = "shaft"'), "not ['body', 'joint']"),
    (uncertain('joint = "shaft"', "mass_scale = [1, 2]"), "a joint has no mass_scale; valid"),
    (mass("[1, 2]", 'at = ["0 m", "0 m", "1 m"]'), "at is where an added_mass is"),
    (BOTH + INERTIA, "two are uncertain 'rotor mass_scale'"),
    (mass("[1, 2]", 'name = "a"') + DAMPING + 'name = "a"', "two are called 'a'"),
    (mass("[1, 2]", 'name = "deviation"'), "'deviation' is a column of the results"),
    (mass("[1, 2]", 'name = "margin input_below"'), "'margin input_below' is a column"),
    (mass("[1, 2]", 'name = "a\\u001b"'), "has characters that cannot be printed"),
    ("", "nothing is uncertain: give it an [[uncertain]]"),
    ('[uncertain]\nbody = "rotor"', "[uncertain] is one of possibly several: write [[uncertain]]"),
    # Correlations.
    (
        BOTH + correlated(*NAMES[:2], "coefficient = 1.5"),
        "coefficient = 1.5 must be less than 1",
    ),
    (BOTH + correlated(*NAMES[:2], ""), "coefficient is missing"),
    (BOTH + correlated(NAMES[0], "load", "coefficient = 0.5"), "unknown number 'load'"),
    (
        BOTH + correlated(NAMES[0], NAMES[0], "coefficient = 0.5"),
        "give it once, of two different numbers",
    ),
    (
        BOTH + 2 * correlated(*NAMES[:2], "coefficient = 0.5"),
        "give it once, of two different numbers",
    ),
    (
        BOTH
        + DAMPING
        + correlated(*NAMES[:2], "coefficient = 0.9")
        + correlated(*NAMES[1:], "coefficient = 0.9")
        + correlated(NAMES[0], NAMES[2], "coefficient = -0.9"),
        "the matrix is not positive definite",
    ),
    # Of another kind of plant.
    (uncertain('parameter = "J"', "scale = [1, 2]"), "name a body or joint instead"),
]


@pytest.mark.parametrize(("tables", "says"), WRONG)
def test_wrong_uncertainty_is_told_in_one_line(tables: str, says: str) -> None:
    shared = campaign(plain())
    case, plant = shared.experiment.case, MujocoPlant.load("servo")
    assert says in refusal(lambda: family_of(specification(plain(tables)).file, case, plant))


SHORT = '[[requirement]]\nsettles_within = "10 ms"\n'
SECOND = '[[disturbance]]\nbody = "rotor"\ntorque = ["0 N m", "1 N m", "0 N m"]\nlabel = "load"\n'
ONSET = uncertain('disturbance = "load"', 'onset = ["{} s", "0.02 s"]')


@pytest.mark.parametrize(
    ("text", "asked", "says"),
    [
        (plain(), {"runs": 0}, "runs = 0 must be a whole number from 1"),
        (plain(), {"seed": -1}, "seed = -1 must be a whole number from 0"),
        (plain(), {"sampler": "sobel"}, "unknown sampler 'sobel': did you mean 'sobol'?"),
        (plain(), {"controllers": ("lqq",)}, "unknown law 'lqq'"),
        (plain(), {"duration": math.nan}, "duration = nan must be above 0"),
        (plain(), {"control_period": 0.0015}, "no multiple of the timestep 0.001 s"),
        (plain(), {"sampler": "corners"}, "8 runs, but there are 4 corners"),
        (
            plain(mass('{ distribution = "normal", mean = 1, deviation = 0.1, least = 0.5 }')),
            {"sampler": "corners", "runs": 2},
            "there are 0 corners",
        ),
        (
            plain(BOTH + correlated(*NAMES[:2], "coefficient = 0.5")),
            {"sampler": "corners", "runs": 4},
            "there are 0 corners",
        ),
        (plain(more=SECOND), {}, "two disturbances have the label 'load': give each its own"),
        (
            plain(more='[[requirement]]\nstays_within = "1 rad"\nafter = "49.5 ms"\n'),
            {},
            "an error after 0.0495 s: the last timestep of a run begins at 0.049 s",
        ),
    ],
)
def test_what_cannot_be_run_or_measured_is_refused_at_once(
    text: str, asked: dict[str, Any], says: str
) -> None:
    assert says in refusal(lambda: Campaign.of(specification(text, **asked)))


def test_all_mistakes_are_told_at_once() -> None:
    """Of laws, uncertain numbers and asked controllers together; of the file's keys before them."""
    text = plain(mass("[1, 2]").replace("rotor", "roter") + DAMPING.replace("shaft", "shaf"))
    wrong = text + '[[controller]]\nlaw = "grosmk"\n'
    with pytest.raises(ArgumentError) as refused:
        Campaign.of(specification(wrong, controllers=("lqq",)))
    first, *mistakes = str(refused.value).split(NEXT)
    assert first.endswith("4 mistakes:")
    for said, name in zip(mistakes, ("'lqq'", "'grosmk'", "'roter'", "'shaf'"), strict=True):
        assert name in said
    keys = text.replace("mass_scale", "mass_scal").replace("damping", "dampin")
    with pytest.raises(ArgumentError, match="2 mistakes:"):
        Campaign.of(specification(keys))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (plain(more=SHORT.replace("10", "19")), "there are 0.02 s before"),
        (plain(ONSET.format(0.001), SHORT), "there are 0.001 s before"),
        # A load that may come at once leaves nothing to settle in.
        (plain(ONSET.format(0), SHORT), "there are 0 s before"),
    ],
)
def test_what_runs_do_not_tell_is_not_judged_and_said(text: str, says: str) -> None:
    asked = Campaign.of(specification(text))
    assert [says in line for line in asked.not_judged] == [True]
    assert "settles_within" not in {each.kind for each in asked.requirements}


def test_a_disturbance_after_the_end_is_idle() -> None:
    assert campaign(plain()).idle == []
    assert campaign(plain(), duration=0.02).idle == ["load", "hum"]
    assert campaign(plain(ONSET.format(0.01)), duration=0.02).idle == ["hum"]


def test_an_analytic_plant_has_parameters_and_no_bodies(tmp_path: Path) -> None:
    own = '[plant]\nplant = "own:plant"\n[run]\nduration = "50 ms"\n[task]\nreference = ["0.5"]\n'
    own += 'Q = [100, 1]\nR = 1\n[[controller]]\nlaw = "fl-lqr"\n'
    (tmp_path / "own.py").write_text(
        "import grosmc_mj as gm, sympy as sp\n"
        "q, w, J = sp.symbols('q w J')\n"
        "def plant():\n"
        "    return gm.affine_plant('own', states={'q': 'rad', 'w': 'rad/s'},\n"
        "        inputs={'torque': 'N m'}, f=[w, -sp.sin(q) / J], g=[0, 1 / J], h=[q],\n"
        "        parameters={'J': 0.02})\n"
    )

    def said(uncertain: str) -> str:
        asked = specification(own + uncertain, folder=str(tmp_path))
        return refusal(lambda: Campaign.of(asked))

    assert "the plant has no model in MuJoCo, so no body: name a parameter" in said(mass("[1, 2]"))
    told = said(uncertain('parameter = "j"', "scale = [1, 2]"))
    assert "unknown parameter 'j': valid: J" in told
    family = Campaign.of(
        specification(own + uncertain('parameter = "J"', "scale = [1, 2]"), folder=str(tmp_path))
    )
    plant = family.plant_sample([1.5]).plant(family.plant)
    assert plant.parameters.J == 0.03


def test_nominal_values_are_the_files_own_and_no_disturbance() -> None:
    edited = '[[edit]]\nbody = "rotor"\nmass_scale = 2\n[[edit]]\njoint = "shaft"\ndamping = 0.3\n'
    others = uncertain('disturbance = "load"', 'onset = ["0.01 s", "0.03 s"]') + uncertain(
        'disturbance = "hum"', 'frequency = ["0.5 Hz", "2 Hz"]'
    )
    start = uncertain('start = "rotor speed"', 'value = ["-1 rad/s", "3 rad/s"]')
    family = campaign(plain(BOTH + DAMPING + others + start, edited)).family
    assert family.nominal.tolist() == [2.0, 0.0, 0.3, 0.02, 2 * math.pi, 0.0]
    assert campaign(plain(mass("[1, 2]", "nominal = 1.5"))).family.nominal.tolist() == [1.5]


def test_scaling_moves_values_along_the_line_from_the_nominal_ones() -> None:
    family = campaign(plain()).family
    values = family.values(np.array([[0.0, 0.0], [1.0, 0.75]]))
    assert values.tolist() == [[1.0, -1.0], [3.0, 0.5]]
    assert family.scaled(values, 2.0).tolist() == [[1.0, -2.0], [5.0, 1.0]]
    assert family.scaled(values, 0.0).tolist() == [[1.0, 0.0], [1.0, 0.0]]


@pytest.mark.parametrize(
    ("spread", "largest"), [("[0.5, 2]", 2.0), ("[0.75, 1]", 4.0), ("[1, 2]", math.inf)]
)
def test_the_largest_scale_is_where_the_least_value_meets_zero(spread: str, largest: float) -> None:
    family = campaign(plain(mass(spread) + AMPLITUDE)).family
    assert family.largest_scale == largest
    if math.isfinite(largest):
        assert family.quantities[0].ends(largest)[0] == 0.0

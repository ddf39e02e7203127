"""A number of an experiment: set on the values it is that of the file with the number written."""

from copy import deepcopy
from typing import Any

import cases
import numpy as np
import pytest
from campaigns import LUGRE

import grosmc_mj as gm
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.reading import case_file_of
from grosmc_mj.experiments.number import Number, set_numbers
from grosmc_mj.simulation.loop import Loop

TABLES: dict[str, Any] = {
    "run": {
        "start": {"rotor angle": "20 deg"},
        "duration": "0.02 s",
        "timestep": "0.25 ms",
        "control_period": "1 ms",
    },
    "edit": [
        {"body": "rotor", "added_mass": "0.2 kg", "at": ["0 m", "10 cm", "0 m"]},
        {"body": "rotor", "length_scale": 1.1},
        {"joint": "shaft", "damping": "0.3 N m s/rad"},
    ],
    "computing": {"delay": "1 ms"},
    "sensor": [
        {"of": "rotor angle", "resolution": "1 mrad"},
        {"of": "rotor speed", "noise": "1 mrad/s"},
    ],
    "actuator": {"of": "current", "lag": "2 ms"},
    "lugre": LUGRE,
    "motor": {"input": "current", "constant": "7.68 mN m/A", "resistance": "2.6 ohm"},
    "disturbance": [
        {"input": "current", "amplitude": "2A", "label": "load"},
        {
            "body": "rotor",
            "torque": ["0 N m", "0.1N m", "0 N m"],
            "profile": "pulse",
            "start": "5 ms",
            "stop": "15 ms",
            "label": "push",
        },
        {
            "body": "rotor",
            "force": ["1 N", "0 N", "2 N"],
            "torque": ["0 N m", "0.1 N m", "0 N m"],
            "profile": "sine",
            "frequency": "1 Hz",
            "label": "hum",
        },
    ],
    "task": {"R": 1},
    "laws": {
        "quick": {"law": "grosmc", "k": 5, "epsilon": 0.1},
        "fast": {"law": "pd", "frequency": 5},
        "own-weights": {"law": "lqr", "Q": [40, 1]},
    },
    "controller": [
        {"law": "lqr"},
        {"law": "quick"},
        {"law": "own-weights"},
        {"law": "pid", "kp": 3.0, "ki": 1.0, "kd": 0.1},
    ],
    "requirement": [{"input_below": "50 A"}, {"settles_within": "1 s"}],
}
OF_VALUES = [
    "run.duration",
    "run.control_period",
    "run.start.rotor angle",
    "run.start.rotor speed",
    "edit.rotor.length_scale",
    "edit.rotor.added_mass",
    "edit[2].length_scale",
    "edit.shaft.damping",
    "edit.shaft.friction",
    "edit.current.gear",
    "computing.delay",
    "sensor.rotor angle.resolution",
    "sensor.rotor speed.delay",
    "sensor[2].noise",
    "actuator.current.lag",
    "lugre.shaft.coulomb",
    "lugre[1].damping",
    "motor.current.resistance",
    "motor[1].constant",
    "disturbance.load.amplitude",
    "disturbance.push.onset",
    "disturbance.push.stop",
    "disturbance.hum.frequency",
    "disturbance.hum.phase",
]
OF_TABLES = [
    "laws.quick.k",
    "laws.quick.epsilon",
    "laws.quick.Q.rotor angle",
    "laws.own-weights.Q[2]",
    "laws.own-weights.Q.rotor speed",
    "laws.lqi.integral_weight",
    "laws.grosmc.uncertainty.reaching_rate",
    "laws.pid.kp",
    "controller.pid.ki",
    "task.R",
    "task.Q[1]",
    "requirement[1].input_below",
    "requirement[2].settles_within",
]
ATTRIBUTES = ("x0", "duration", "edits", "disturbances", "loop", "settings")


@pytest.fixture(scope="module")
def case() -> Experiment:
    return cases.case("servo", **TABLES)


def of_content(case: Experiment, content: Any) -> Experiment:
    """The experiment of a written file."""
    return Experiment.of_file(case_file_of(content, case.path), case.path)


def require_equal(case: Experiment, other: Experiment) -> None:
    values = [{name: getattr(e, name) for name in ATTRIBUTES} for e in (case, other)]
    assert values[0] == values[1]


def other_value(number: Number, case: Experiment) -> float:
    """Another value; a whole number of timesteps for every time."""
    return number.get(case) + (0.002 if number.unit == "s" else 0.01)


@pytest.mark.parametrize("path", OF_VALUES)
def test_a_number_that_is_set_is_that_of_the_written_file(path: str, case: Experiment) -> None:
    number = Number.of(case, path)
    value = other_value(number, case)
    content = deepcopy(case.file.content)
    number.write(content, value)

    changed = number.set(case, value)
    require_equal(changed, of_content(case, content))
    require_equal(changed, case.changed({path: value}))
    assert number.get(changed) == pytest.approx(value, rel=1e-15)
    assert number.get(case) != number.get(changed)


@pytest.mark.parametrize("path", OF_TABLES)
def test_a_number_of_a_law_is_that_of_the_written_file(path: str, case: Experiment) -> None:
    number = Number.of(case, path)
    value = other_value(number, case)
    content = deepcopy(case.file.content)
    number.write(content, value)

    changed = number.set(case, value)
    written = of_content(case, content)
    assert number.get(changed) == number.get(written) == value
    assert number.get(case) != value
    assert parameters_of(changed) == parameters_of(written)
    numbers = [limit.number for limit in changed.limits]
    assert numbers == [limit.number for limit in written.limits]


def parameters_of(case: Experiment) -> dict[str, str]:
    """Parameters of all laws, as texts."""
    laws = ("lqr", "quick", "own-weights", "pid", "lqi")
    return {law: repr(case.law("physics", law).parameters) for law in laws}


def test_a_law_has_numbers_that_the_file_does_not_give(case: Experiment) -> None:
    damping = Number.of(case, "laws.fast.damping")
    assert damping.get(case) == 1.0
    damped = damping.set(case, 0.7)
    assert damping.get(damped) == 0.7
    assert damped.file.law("fast").numbers["damping"] == 0.7
    with pytest.raises(gm.GrosmcError, match="damping = -1 must be"):
        damping.set(case, -1.0)


def test_a_weight_that_a_law_takes_from_the_task_becomes_its_own(case: Experiment) -> None:
    angle = Number.of(case, "laws.quick.Q.rotor angle")
    of_task = Number.of(case, "task.Q.rotor angle")
    assert angle.get(case) == of_task.get(case)
    heavier = angle.set(case, 99.0)
    assert of_task.get(heavier) == of_task.get(case)
    weights = heavier.law("physics", "quick").designed.lqr.Q
    assert weights[0, 0] == 99.0
    assert weights[1, 1] == Number.of(case, "task.Q.rotor speed").get(case)


def test_all_numbers_are_set_at_once(case: Experiment) -> None:
    numbers = [Number.of(case, path) for path in OF_VALUES if "[" not in path]
    pairs = [(number, other_value(number, case)) for number in numbers]
    one_by_one = case
    for number, value in pairs:
        one_by_one = number.set(one_by_one, value)
    require_equal(set_numbers(case, pairs), one_by_one)


def test_numbers_that_fit_only_together_are_set_together(case: Experiment) -> None:
    """Sliding friction above the former static friction."""
    coulomb = Number.of(case, "lugre.shaft.coulomb")
    static = Number.of(case, "lugre.shaft.static")
    changed = set_numbers(case, [(coulomb, 0.1), (static, 0.12)])
    assert (coulomb.get(changed), static.get(changed)) == (0.1, 0.12)
    with pytest.raises(gm.GrosmcError, match="static"):
        coulomb.set(case, 0.1)


def test_a_mass_at_another_place_is_beside_those_of_the_file(case: Experiment) -> None:
    further = Number.of_mass(case, "rotor", (0.0, 0.0, 0.1))
    content = deepcopy(case.file.content)
    further.write(content, 0.4)
    require_equal(further.set(case, 0.4), of_content(case, content))
    assert Number.of(case, "edit.rotor.added_mass").get(further.set(case, 0.4)) == 0.2


def test_a_mass_at_the_place_of_a_load_is_that_load(case: Experiment) -> None:
    load_mass = Number.of_mass(case, "rotor", (0.0, 0.1, 0.0))
    assert load_mass.get(case) == 0.2
    assert len(load_mass.set(case, 0.4).edits) == len(case.edits)


def test_a_number_without_an_edit_is_that_of_the_model(case: Experiment) -> None:
    assert Number.of(case, "edit.rotor.mass_scale").get(case) == 1.0
    assert Number.of(case, "edit.shaft.armature").get(case) == 0.0
    mass = Number.of(case, "edit.rotor.mass").get(case)
    plant: Any = case.plant("physics")
    assert mass == plant.model.body("rotor").mass[0]


@pytest.mark.parametrize(
    ("path", "unit"),
    [
        ("sensor.rotor speed.drift", "rad/s^2"),
        ("actuator.current.rate_limit", "A/s"),
        ("lugre.shaft.stiffness", "N m/rad"),
        ("disturbance.load.amplitude", "A"),
        ("edit.rotor.mass", "kg"),
        ("run.start.rotor angle", "rad"),
        ("requirement[1].input_below", "A"),
    ],
)
def test_a_number_has_the_unit_of_its_owner(path: str, unit: str, case: Experiment) -> None:
    assert Number.of(case, path).unit == unit


# -- refusals --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("sensor.rotor angle.noise", -1.0, "sensor.rotor angle.noise = -1 must be"),
        ("edit.rotor.mass_scale", 0.0, "edit.rotor.mass_scale = 0 must be"),
        ("run.duration", float("inf"), "run.duration = inf must be"),
        ("laws.quick.k", float("nan"), "laws.quick.k = nan must be"),
        ("actuator.current.limit", 0.0, "actuator.current.limit = 0 must be"),
    ],
)
def test_a_value_beyond_the_bounds_is_refused_in_one_line(
    path: str, value: float, words: str, case: Experiment
) -> None:
    with pytest.raises(gm.GrosmcError, match=words) as refusal:
        Number.of(case, path).set(case, value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("sensor.rotor angle.nose", "unknown number 'nose': did you mean 'noise'?"),
        ("sensor.rotor angl.noise", "unknown sensor 'rotor angl': did you mean 'rotor angle'?"),
        ("edit.rotr.mass", "unknown body 'rotr': did you mean 'rotor'?"),
        ("edit.rotor.mas", "unknown key 'mas': did you mean 'mass'?"),
        ("laws.quik.k", "unknown law 'quik': did you mean 'quick'?"),
        ("laws.quick.epsiln", "unknown number 'epsiln': did you mean 'epsilon'?"),
        ("laws.quick.Q.rotor angel", "unknown entry 'rotor angel': did you mean 'rotor angle'?"),
        ("laws.own-weights.Q[3]", "Q has 2 entries"),
        ("run.start.rotor angel", "unknown state 'rotor angel': did you mean 'rotor angle'?"),
        ("sensr.rotor angle.noise", "unknown owner 'sensr': did you mean 'sensor'?"),
        ("disturbance.puch.stop", "unknown disturbance 'puch': did you mean 'push'?"),
        ("motor.current.resistanc", "unknown number 'resistanc': did you mean 'resistance'?"),
        ("laws.quick.switching", "switching is no number"),
        ("run.engine", "engine is no number"),
    ],
)
def test_an_unknown_path_names_the_nearest(path: str, words: str, case: Experiment) -> None:
    with pytest.raises(gm.GrosmcError) as refusal:
        Number.of(case, path)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


# -- changes beside variations ---------------------------------------------------------------------


def test_a_change_keeps_what_was_varied_beside_it(case: Experiment) -> None:
    loop = case.loop
    assert isinstance(loop, Loop)
    varied = case.changed(
        x0=(0.5, 0.25),
        loop=loop.changed("sensor", "rotor speed", noise=0.0),
        edits=case.edits[:2],
        timestep=1e-3,
    )
    changed = varied.changed(
        {
            "run.start.rotor angle": 0.1,
            "sensor.rotor angle.resolution": 2e-3,
            "edit.rotor.length_scale": 1.2,
        }
    )
    assert changed.x0 == (0.1, 0.25)
    assert changed.loop is not None
    assert [sensor.noise for sensor in changed.loop.sensors] == [0.0, 0.0]
    assert len(changed.edits) == 2
    assert changed.settings.timestep == 1e-3


def test_lists_and_texts_of_one_table_keep_each_other(case: Experiment) -> None:
    changed = case.changed({"disturbance.hum.force": ["3 N", "0 N", "0 N"]})
    changed = changed.changed({"disturbance.hum.frequency": 5.0})
    changed = changed.changed({"disturbance.hum.torque": [0.0, 0.2, 0.0]})
    changed = changed.changed({"edit[1].at": ["0 m", "0 m", "5 cm"]})
    changed = changed.changed({"edit.rotor.added_mass": 0.3, "sensor[1].exact": False})
    hum: Any = changed.disturbances[2]
    assert hum.wrench == (3.0, 0.0, 0.0, 0.0, 0.2, 0.0)
    assert hum.profile.frequency == 5.0
    load: Any = changed.edits[0]
    assert (load.mass, load.position) == (0.3, (0.0, 0.0, 0.05))


# -- uncertain numbers as former versions wrote them -----------------------------------------------


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"body": "rotor", "mass_scale": [1, 2]}, 'write number = "edit.rotor.mass_scale"'),
        ({"joint": "shaft", "damping": [0, 1]}, 'write number = "edit.shaft.damping"'),
        ({"start": "rotor angle", "value": [0, 1]}, 'write number = "run.start.rotor angle"'),
        ({"computing": True, "delay": ["0 s", "1 s"]}, 'write number = "computing.delay"'),
        ({"lugre": "shaft", "coulomb": [0, 1]}, 'write number = "lugre.shaft.coulomb"'),
        ({"disturbance": "load", "phase": [0, 1]}, 'write number = "disturbance.load.phase"'),
        (
            {"disturbance": "load", "amplitude": [0, 1]},
            'write number = "disturbance.load.scale"',
        ),
        ({"disturbance": "load", "amplitude": [0, 1]}, "with nominal = 0"),
    ],
)
def test_a_former_uncertain_number_is_refused_with_its_path(
    table: dict[str, Any], words: str
) -> None:
    with pytest.raises(gm.GrosmcError) as refusal:
        cases.case("servo", **TABLES, uncertain=table)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_two_entries_of_a_weight_that_a_law_inherits_are_both_set() -> None:
    experiment = Experiment.load("servo/nominal")
    entries = [Number.of(experiment, f"laws.lqr.Q[{entry}]") for entry in (1, 2)]
    by_numbers = set_numbers(experiment, zip(entries, (5.0, 7.0), strict=True))
    by_paths = experiment.changed({"laws.lqr.Q[1]": 5.0, "laws.lqr.Q[2]": 7.0})
    for changed in (by_numbers, by_paths):
        assert np.array_equal(changed.law("physics", "lqr").designed.lqr.Q, np.diag([5.0, 7.0]))

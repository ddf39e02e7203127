"""Numbers of an experiment by path: one meaning with the file, one line for each mistake."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grosmc_mj as gm
from grosmc_mj.experiments.experiment import Experiment

FILE = """
[plant]
system = "servo"
[run]
start = { "rotor angle" = "20 deg" }
duration = "0.02 s"
[[edit]]
body = "rotor"
mass_scale = 1.5
[[sensor]]
of = "rotor angle"
resolution = "1 mrad"
[[disturbance]]
input = "current"
amplitude = "0.1 A"
label = "load"
[[disturbance]]
input = "current"
amplitude = "0.2 A"
label = "load"
[[controller]]
law = "lqr"
[[controller]]
law = "grosmc"
[[requirement]]
input_below = "50 A"
[[requirement]]
input_below = "60 A"
"""
# Path, value, and the lines of the file that say the same.
SAME: list[tuple[str, Any, str, str]] = [
    ("run.duration", 0.03, 'duration = "0.02 s"', 'duration = "0.03 s"'),
    ("run.duration", "30 ms", 'duration = "0.02 s"', 'duration = "0.03 s"'),
    ("run.start.rotor angle", 0.1, '"20 deg"', '"0.1 rad"'),
    ("edit.rotor.mass_scale", 2.0, "mass_scale = 1.5", "mass_scale = 2.0"),
    (
        "edit.shaft.damping",
        0.2,
        "[[sensor]]",
        '[[edit]]\njoint = "shaft"\ndamping = "0.2 N m s/rad"\n[[sensor]]',
    ),
    ("sensor.rotor angle.delay", 2e-3, '"1 mrad"', '"1 mrad"\ndelay = "2 ms"'),
    ("sensor.rotor angle.resolution", "2 mrad", '"1 mrad"', '"2 mrad"'),
    ("disturbance.load[2].amplitude", 0.3, '"0.2 A"', '"0.3 A"'),
    (
        "controller.grosmc.switching",
        "implicit",
        'law = "grosmc"',
        'law = "grosmc"\nswitching = "implicit"',
    ),
    ("requirement[2].input_below", 70.0, '"60 A"', '"70 A"'),
    ("task.R", 2.0, "[run]", "[task]\nR = 2.0\n[run]"),
]


def load(folder: Path, text: str) -> Experiment:
    path = folder / "case.toml"
    path.write_text(text, encoding="utf-8")
    return Experiment.load(path)


@pytest.fixture
def experiment(tmp_path: Path) -> Experiment:
    return load(tmp_path, FILE)


@pytest.mark.parametrize(("path", "value", "written", "instead"), SAME)
def test_a_changed_number_is_that_of_a_file(
    path: str, value: Any, written: str, instead: str, experiment: Experiment, tmp_path: Path
) -> None:
    assert FILE.count(written) == 1
    expected = load(tmp_path, FILE.replace(written, instead))
    changed = experiment.changed({path: value})
    assert [limit.number for limit in changed.limits] == [limit.number for limit in expected.limits]
    for law in ("lqr", "grosmc"):
        run = changed.run(law=law).trajectory
        of_file = expected.run(law=law).trajectory
        np.testing.assert_array_equal(run.state, of_file.state)
        np.testing.assert_array_equal(run.command, of_file.command)


def test_the_experiment_itself_stays_as_it_is(experiment: Experiment) -> None:
    before = experiment.run(law="grosmc").trajectory.state
    experiment.changed({"edit.rotor.mass_scale": 3.0, "run.duration": 0.01})
    np.testing.assert_array_equal(experiment.run(law="grosmc").trajectory.state, before)


def test_changes_add_up(experiment: Experiment) -> None:
    once = experiment.changed({"edit.rotor.mass_scale": 2.0, "run.duration": 0.03})
    twice = experiment.changed({"edit.rotor.mass_scale": 2.0}).changed({"run.duration": 0.03})
    assert once.key == twice.key


def test_other_variations_stay(experiment: Experiment) -> None:
    varied = experiment.varied(x0=(0.5, 0.0)).with_settings(timestep=5e-4).with_laws(["lqr"])
    changed = varied.changed({"edit.rotor.mass_scale": 2.0})
    assert changed.x0 == (0.5, 0.0)
    assert changed.settings.timestep == 5e-4
    assert changed.controllers == ["lqr"]


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("pole", 1.0, "unknown owner 'pole'"),
        ("run", 1.0, "must be a path OWNER.NAME.FIELD"),
        ("edit.rotor", 1.0, "unknown key 'rotor'"),
        ("joint.shaft.damping", 1.0, "a case file has it as edit.NAME.FIELD"),
        ("start.rotor angle.value", 1.0, "a case file has it as run.start.STATE"),
        ("edit.rotr.mass_scale", 1.0, "unknown body 'rotr': did you mean 'rotor'?"),
        ("edit.rotor.mas", 1.0, "unknown key 'mas': did you mean 'mass'?"),
        ("edit.rotor.mass_scale", "2 kg", "must be a number"),
        ("edit.rotor[2].mass_scale", 2.0, "there are 1 such tables, counted from 1"),
        ("sensor.rotor speed.delay", 1e-3, "no [[sensor]] of 'rotor speed'; it has 'rotor angle'"),
        (
            "disturbance.load.amplitude",
            1.0,
            "write disturbance.load[1].amplitude or disturbance.load[2]",
        ),
        ("requirement.input_below", 1.0, "write requirement[1].input_below or requirement[2]"),
        ("laws.gros.k", 1.0, "unknown law 'gros': did you mean 'grosmc'?"),
        ("run.duration", "3 m", 'duration: "3 m" cannot be converted to s'),
        ("run.duration", -1.0, "must be above 0 s"),
        ("run.start.angle", 1.0, "unknown state 'angle'"),
        ("computing.delay.x", 1.0, "computing"),
    ],
)
def test_a_wrong_change_is_refused_in_one_line(
    path: str, value: Any, words: str, experiment: Experiment
) -> None:
    with pytest.raises(gm.GrosmcError, match=re.escape(words)) as refusal:
        experiment.changed({path: value}).run(law="lqr")
    assert "\n" not in str(refusal.value)


def test_many_runs_are_a_table(experiment: Experiment) -> None:
    heavier = experiment.changed({"edit.rotor.mass_scale": 3.0})
    table = gm.run_many([experiment, heavier])
    assert table["experiment"].to_pylist() == [0, 0, 1, 1]
    assert table["law"].to_pylist() == ["lqr", "grosmc"] * 2
    assert table.schema.field("max_input").metadata == {b"unit": b"A"}

    run = heavier.run(law="grosmc")
    last = table.to_pylist()[-1]
    assert last["max_input"] == run.metrics["max_input"].value
    assert last["kept"] is True
    assert last["margin input below 50 A"] == run.requirements[0].margin


@pytest.mark.parametrize(
    ("experiments", "words"), [([], "there is none"), (["arm"], "must be a list of Experiments")]
)
def test_a_list_without_experiments_is_refused(experiments: list[Any], words: str) -> None:
    with pytest.raises(gm.GrosmcError, match=words):
        gm.run_many(experiments)

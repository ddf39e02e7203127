"""Numbers of an experiment by path: one meaning with the file, one line for each mistake."""

import itertools
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cases import case

import grosmc_mj as gm
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.mechanics.physics.edits import BodyEdit, JointEdit

TABLES: dict[str, Any] = {
    "run": {"start": {"rotor angle": "20 deg"}, "engine": "python"},
    "edit": {"body": "rotor", "mass_scale": 1.5},
    "sensor": {"of": "rotor angle", "resolution": "1 mrad"},
    "disturbance": [
        {"input": "current", "amplitude": "0.1 A", "label": "load"},
        {"input": "current", "amplitude": "0.2 A", "label": "load"},
    ],
    "controller": [{"law": "lqr"}, {"law": "grosmc"}],
    "requirement": [{"input_below": "50 A"}, {"input_below": "60 A"}],
}
FIRST_LOAD, _ = TABLES["disturbance"]
# Path, value, and the tables that say the same; test_number.py has all paths of numbers in SI.
SAME: list[tuple[str, Any, dict[str, Any]]] = [
    ("run.duration", "30 ms", {"run": TABLES["run"] | {"duration": "0.03 s"}}),
    (
        "sensor.rotor angle.resolution",
        "2 mrad",
        {"sensor": {"of": "rotor angle", "resolution": "2 mrad"}},
    ),
    (
        "disturbance.load[2].amplitude",
        0.3,
        {"disturbance": [FIRST_LOAD, FIRST_LOAD | {"amplitude": "0.3 A"}]},
    ),
    (
        "controller.grosmc.switching",
        "implicit",
        {"controller": [{"law": "lqr"}, {"law": "grosmc", "switching": "implicit"}]},
    ),
    (
        "requirement[2].input_below",
        "70 A",
        {"requirement": [{"input_below": "50 A"}, {"input_below": "70 A"}]},
    ),
]


@pytest.fixture(scope="module")
def experiment() -> Experiment:
    return case("servo", **TABLES)


@pytest.mark.parametrize(("path", "value", "tables"), SAME)
def test_a_changed_value_is_that_of_a_file(
    experiment: Experiment, path: str, value: Any, tables: dict[str, Any]
) -> None:
    expected = case("servo", **(TABLES | tables))
    changed = experiment.changed({path: value})
    assert [limit.number for limit in changed.limits] == [limit.number for limit in expected.limits]
    run = changed.run(law="grosmc").trajectory
    of_file = expected.run(law="grosmc").trajectory
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
    varied = experiment.changed(x0=(0.5, 0.0)).changed(timestep=5e-4).changed(laws=["lqr"])
    changed = varied.changed({"edit.rotor.mass_scale": 2.0})
    assert changed.x0 == (0.5, 0.0)
    assert changed.settings.timestep == 5e-4
    assert changed.controllers == ["lqr"]


# Variations, each with what it has changed.
VARIATIONS: dict[str, tuple[Callable[[Any], Experiment], Callable[[Any], Any]]] = {
    "start": (lambda e: e.changed(x0=(0.5, 1.0)), lambda e: e.x0[1]),
    "number of a start": (
        lambda e: e.changed({"run.start.rotor angle": "20 deg"}),
        lambda e: round(e.x0[0], 6),
    ),
    "edit": (
        lambda e: e.changed(edits=(*e.edits, JointEdit("shaft", damping=0.2))),
        lambda e: [edit.damping for edit in e.edits if isinstance(edit, JointEdit)],
    ),
    "number of an edit": (
        lambda e: e.changed({"edit.rotor.mass_scale": 2.0}),
        lambda e: [edit.mass_scale for edit in e.edits if isinstance(edit, BodyEdit)],
    ),
    "settings": (
        lambda e: e.changed(timestep=5e-4, surface="discrete"),
        lambda e: (e.settings.timestep, e.settings.surface),
    ),
    "number of the loop": (
        lambda e: e.changed({"sensor.rotor angle.delay": "2 ms"}),
        lambda e: [sensor.delay for sensor in e.loop.sensors],
    ),
    "loop": (lambda e: e.changed(loop=replace(e.loop, seed=7)), lambda e: e.loop.seed),
    "laws": (lambda e: e.changed(laws=["lqr", "lqi"]), lambda e: e.controllers),
    "number of a law": (
        lambda e: e.changed({"laws.grosmc.epsilon": 3.0}),
        lambda e: e.file.laws["grosmc"].numbers.get("epsilon"),
    ),
    "number of a controller": (
        lambda e: e.changed({"controller.grosmc.switching": "implicit"}),
        lambda e: e.file.law("grosmc").switching,
    ),
    "load": (
        lambda e: e.changed(disturbances=e.disturbances[:1]),
        lambda e: len(e.disturbances),
    ),
    "number of a load": (
        lambda e: e.changed({"disturbance.load[1].amplitude": 0.3}),
        lambda e: e.disturbances[0].amplitude,
    ),
}
# A start replaces a number of it.
ORDERS = [
    (first, second)
    for first, second in itertools.permutations(VARIATIONS, 2)
    if (first, second) != ("number of a start", "start")
]


@pytest.mark.parametrize(("first", "second"), ORDERS)
def test_each_of_two_variations_stays(first: str, second: str, experiment: Experiment) -> None:
    vary_first, of_first = VARIATIONS[first]
    vary_second, of_second = VARIATIONS[second]
    once = vary_first(experiment)
    both = vary_second(once)
    assert of_second(both) == of_second(vary_second(experiment))
    assert of_first(both) == of_first(once)


def test_a_number_of_the_file_itself_replaces_what_was_varied(experiment: Experiment) -> None:
    varied = experiment.changed(duration=1.0, x0=(0.5, 1.0)).changed(timestep=5e-4)
    changes = {"run.duration": "0.02 s", "run.start.rotor angle": "20 deg", "run.timestep": 1e-3}
    changed = varied.changed(changes)
    assert changed.duration == 0.02
    assert changed.x0 == (experiment.x0[0], 1.0)
    assert changed.settings.timestep == 1e-3


@pytest.mark.parametrize(
    ("vary", "path", "words"),
    [
        (
            lambda e: e.changed(loop=None),
            "sensor.rotor angle.delay",
            "there is no loop",
        ),
        (
            lambda e: e.changed(disturbances=()),
            "disturbance.load[2].amplitude",
            "no inputdisturbance of 'current'",
        ),
        (lambda e: e.changed(start=(0.0, 0.0)), "run.duration", "unknown attribute or setting"),
    ],
)
def test_a_change_of_what_is_gone_is_refused(
    vary: Callable[[Experiment], Experiment], path: str, words: str, experiment: Experiment
) -> None:
    with pytest.raises(gm.GrosmcError, match=re.escape(words)):
        vary(experiment).changed({path: 3e-3})


def test_a_change_of_what_a_setting_decides_is_refused(experiment: Experiment) -> None:
    of_all = experiment.changed(switching="sign")
    with pytest.raises(gm.GrosmcError, match="set for all laws: leave it out of changed"):
        of_all.changed({"controller.grosmc.switching": "implicit"})


def test_equations_have_no_model_to_edit() -> None:
    maglev = Experiment.load("maglev/warm")
    with pytest.raises(gm.GrosmcError, match="has no model in MuJoCo to edit: change a parameter"):
        maglev.changed(edits=(BodyEdit("rod", 2.0),))


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("pole", 1.0, "unknown owner 'pole'"),
        ("run", 1.0, "must be a path OWNER.NAME.FIELD"),
        ("edit.rotor", 1.0, "unknown key 'rotor'"),
        ("joint.shaft.damping", 1.0, "a case file has it as edit.NAME.FIELD"),
        ("start.rotor angle.value", 1.0, "a case file has it as run.start.STATE"),
        ("edit.rotor.mass_scale", "2 kg", "must be a number"),
        ("edit.rotor[2].mass_scale", 2.0, "there are 1 such tables, counted from 1"),
        (
            "disturbance.load.amplitude",
            1.0,
            "write disturbance.load[1].amplitude or disturbance.load[2]",
        ),
        ("requirement.input_below", 1.0, "write requirement[1].input_below or requirement[2]"),
        ("requirement.2.input_below", 1.0, "no [[requirement]] has a name: count them, as in"),
        ("run.duration", "3 m", 'duration: "3 m" cannot be converted to s'),
        ("run.duration", -1.0, "must be above 0 s"),
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


def test_a_table_of_runs_has_what_was_varied_in_the_unit_of_its_key(experiment: Experiment) -> None:
    changes: list[dict[str, Any]] = [
        {"edit.rotor.mass_scale": 3.0, "run.duration": "0.03 s"},
        {"laws.grosmc.switching": "implicit"},
    ]
    cases = [experiment, *[experiment.changed(numbers) for numbers in changes]]
    table = gm.run_many(cases, law="grosmc")
    assert table["edit.rotor.mass_scale"].to_pylist() == [1.5, 3.0, 1.5]
    assert table["run.duration"].to_pylist() == [0.02, 0.03, 0.02]
    assert table.schema.field("run.duration").metadata == {b"unit": b"s"}
    assert table["laws.grosmc.switching"].to_pylist()[-1] == "implicit"


def test_a_column_without_values_has_the_type_of_its_metric(experiment: Experiment) -> None:
    """A run of a few samples does not settle."""
    table = gm.run_many([experiment.changed(duration="3 ms")], law="lqr")
    assert table["settling_time"].to_pylist() == [None]
    assert str(table.schema.field("settling_time").type) == "double"
    assert str(table.schema.field("kept").type) == "bool"


def test_an_unknown_metric_is_refused_with_the_nearest(experiment: Experiment) -> None:
    run = experiment.run(law="grosmc")
    with pytest.raises(KeyError) as refused:
        run.metrics["deviations"]
    assert isinstance(refused.value, gm.GrosmcError)
    assert str(refused.value).startswith("unknown metric 'deviations': did you mean 'deviation'?")
    assert run.kept is all(item.kept for item in run.requirements)


def test_an_experiment_is_shown_in_five_lines_at_most(experiment: Experiment) -> None:
    shown = repr(experiment.changed({"edit.rotor.mass_scale": 3.0}))
    assert len(shown.splitlines()) <= 5
    assert len(shown) < 600
    assert shown.endswith("changed: edit.rotor.mass_scale")
    assert experiment.target in shown


@pytest.mark.parametrize(
    ("experiments", "words"), [([], "there is none"), (["arm"], "must be a list of Experiments")]
)
def test_a_list_without_experiments_is_refused(experiments: list[Any], words: str) -> None:
    with pytest.raises(gm.GrosmcError, match=words):
        gm.run_many(experiments)

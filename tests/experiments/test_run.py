"""The commands run and new: kinds of files, a user's own Python, exit codes."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import cases
import numpy as np
import pytest
from cases import case
from commands import Screen, assert_one_line, run
from mjcf import TREE
from own_files import LEG, OWN, PYTHON, pendulum
from shipped import find_case, nominal_controller

from grosmc_mj import cli
from grosmc_mj.experiments.assumptions.notes import notes_on
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.experiments.file.shipped import find_file
from grosmc_mj.ground.errors import ArgumentError

NATIVE = OWN["run"] | {"engine": "native"}
# The servo for 20 ms.
SHORT: dict[str, Any] = {
    "plant": {"compare": ["physics"]},
    "run": {"engine": "python", "start": {"rotor angle": "0.1 rad"}},
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def read(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


def asked(folder: Path, requirement: dict[str, Any], *, duration: str = "20 ms") -> Path:
    """A case file of the servo with a requirement."""
    more = {"run": SHORT["run"] | {"duration": duration}, "requirement": requirement}
    return cases.write(folder, "servo", **(SHORT | more))


# new


@pytest.mark.slow
def test_new_writes_a_file_that_run_runs(folder: Path, capsys) -> None:
    assert run("new", "mine") == 0
    shorter = (folder / "mine.toml").read_text().replace('"6 s"', '"4 s"')
    (folder / "mine.toml").write_text(shorter)
    assert run("run", "mine.toml", "--out", "out") == 0
    assert "requirements are kept" in capsys.readouterr().out
    content = read(folder / "out" / "mine.json")
    assert content["kept"] is True
    assert content["complete"] is True
    assert {row["controller"] for row in content["runs"]} == {"lqr", "grosmc", "softer"}
    assert (folder / "out" / "mine.png").stat().st_size > 10_000
    assert (folder / "out" / "mine.svg").is_file()


def test_new_copies_a_shipped_case_that_stands_alone_with_its_comments(folder: Path) -> None:
    assert run("new", "mine", "--like", "arm/case1") == 0
    copy = read_case_file(folder / "mine.toml")
    theirs = read_case_file(find_file("arm/case1"))
    assert copy.model_copy(update={"name": "case1"}) == theirs
    text = (folder / "mine.toml").read_text()
    assert "extends" not in text
    assert "# d(t) acts against the torque, eq. (57)" in text


def test_new_never_overwrites(folder: Path, capsys: Screen) -> None:
    (folder / "mine.toml").write_text("mine")
    assert run("new", "mine") == cli.WRONG
    assert "is there already" in capsys.readouterr().err
    assert (folder / "mine.toml").read_text() == "mine"


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("new", "a b"), "must be a name of letters"),
        (("new", "mine", "--like", "arm/case1", "--python"), "give one of them"),
        (("run", "arm/base"), "unknown case 'arm/base'"),
        (("run", "nowhere.toml"), "there is no such file; grosmc-mj list names the cases"),
        (("run", "nowhere.toml"), "grosmc-mj new nowhere writes a new file"),
        (("run", "servo/case1.toml"), "no such file: did you mean 'servo/case1'? grosmc-mj list"),
    ],
)
def test_a_wrong_command_is_one_line(arguments, words, capsys: Screen) -> None:
    assert run(*arguments) == cli.WRONG
    assert words in capsys.readouterr().err


def test_a_pattern_that_no_file_fits_is_no_name_of_a_new_case(capsys: Screen) -> None:
    assert run("run", "nowhere/*worst*.toml") == cli.WRONG
    assert "grosmc-mj new" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("pendulun.toml", "did you mean 'pendulum.toml'?"),
        ("pendulum", "did you mean 'pendulum.toml'?"),
        ("x.toml", "x.toml: there is no such file: its folder has pendulum.toml; grosmc-mj list"),
    ],
)
def test_a_case_file_that_is_missing_is_told_which_ones_are_there(
    target: str, words: str, folder: Path, capsys: Screen
) -> None:
    (folder / "pendulum.toml").write_text("")
    assert run("compare", "log.csv", target) == cli.WRONG
    error = capsys.readouterr().err
    assert words in error
    assert_one_line(error)


# run


def test_a_requirement_that_is_not_kept_has_its_exit_code(folder: Path, capsys: Screen) -> None:
    path = asked(folder, {"stays_within": "1 urad"})
    assert run("run", path, "--no-figures") == cli.DIFFERS
    printed = capsys.readouterr().out
    assert "FAILED" in printed
    assert "1 of 1 requirement is not kept" in printed
    assert read(folder / "renders" / "mine.json")["kept"] is False


def test_a_run_that_cannot_be_judged_is_not_made(folder: Path, capsys: Screen) -> None:
    """The length that the line advises is enough."""
    settles = {"settles_within": "19 ms"}
    path = asked(folder, settles)
    assert run("run", path, "--no-figures", "--out", "out") == cli.WRONG
    line = capsys.readouterr().err
    assert "no requirement can be judged: settles within 0.019 s: there are 0.02 s" in line
    assert "require that at most, or make them 0.03 s at least" in line
    assert not (folder / "out").exists()
    advised = asked(folder, settles, duration="30 ms")
    assert run("run", advised, "--no-figures") == cli.DIFFERS


def test_a_run_that_ends_early_keeps_nothing(tmp_path: Path) -> None:
    law = {"law": "own:law", "a": -1e9, "b": 4}
    requirement = {"input_below": "1e12 N m"}
    result = pendulum(tmp_path, controller=law, requirement=requirement).run()
    (judgement,) = result.requirements
    assert not judgement.kept
    assert judgement.note.startswith("the run ended at")


def test_results_of_the_same_file_are_replaced_and_those_of_another_put_aside(
    folder: Path, capsys: Screen
) -> None:
    """The files have one name and other settings."""
    out = folder / "out"
    arguments = ("--no-figures", "--out", "out")
    for _ in range(2):
        run("run", cases.write(folder, "servo", **SHORT), *arguments)
    assert sorted(file.name for file in out.iterdir()) == ["curves", "mine.json"]
    first = (out / "mine.json").read_text(encoding="utf-8")
    capsys.readouterr()
    run("run", asked(folder, {"input_below": "1 A"}), *arguments)
    assert (out / "mine.previous.json").read_text(encoding="utf-8") == first
    assert "mine.json had results of another file or other settings" in capsys.readouterr().out


def test_numbers_of_the_base_that_are_written_out_change_no_run() -> None:
    numbers = {"k": 18, "epsilon": 6, "G": [[0, 1]], "Q": [[10, 2], [2, 1]], "R": 1}
    shipped = find_case("arm", "case2").changed(duration=0.1)
    explicit = case("arm/case2", controller={"law": "grosmc"} | numbers).changed(duration=0.1)
    for plant in ("corrected", "physics"):
        mine = explicit.run(plant, "grosmc")
        theirs = shipped.run(plant, "grosmc")
        np.testing.assert_array_equal(mine.trajectory.state, theirs.trajectory.state)
        assert mine.metrics == theirs.metrics


# A user's own Python


def test_an_edit_reaches_the_plant_and_not_a_users_law(tmp_path: Path) -> None:
    experiment = pendulum(tmp_path)
    assert experiment.plants["corrected"].parameters.m == 3.0
    assert experiment.laws["corrected", "law"].parameters.plant.m == 2.0


def test_a_users_law_runs_alike_in_both_engines(tmp_path: Path) -> None:
    """The law of the native run has been compiled by numba before.

    The index weighs v = -m sin(q) + u = -a q - b q' of this law, by its own equations.
    """
    python = pendulum(tmp_path).run().trajectory
    compiled = PYTHON.replace("def law", "import numba\n\n@numba.njit\ndef law")
    native = pendulum(tmp_path, compiled, run=NATIVE).run().trajectory
    np.testing.assert_allclose(python.state, native.state, rtol=0, atol=1e-12)
    expected = -4 * native.state[:-1, 0] - 4 * native.state[:-1, 1]
    np.testing.assert_allclose(native.weighed, expected, rtol=0, atol=1e-12)


def test_a_function_makes_a_controller_with_the_files_numbers(tmp_path: Path) -> None:
    law = {"law": "own:made", "epsilon": 7}
    made = pendulum(tmp_path, controller=law).law("corrected", "made")
    assert (made.parameters.epsilon, made.parameters.k) == (7.0, 5.0)


def test_a_reference_may_be_a_users_own(tmp_path: Path) -> None:
    task = OWN["task"] | {"reference": ["own:pair"]}
    comparison = pendulum(tmp_path, task=task).run("corrected").comparison
    np.testing.assert_allclose(comparison.reference[:, 0], np.sin(comparison.time), atol=1e-15)


# Robots


def leg(folder: Path, *laws: dict[str, Any], **run_table: Any) -> Experiment:
    """A robot with a load at its end, under laws of its own and of the package."""
    (folder / "leg.xml").write_text(LEG, encoding="utf-8")
    law = "def law(t, x, memory, p):\n    return (-p.k * x[0] - x[2], -p.k * (x[1] + 1) - x[3])\n"
    (folder / "own.py").write_text(law, encoding="utf-8")
    load = {"body": "shank", "added_mass": "0.5 kg", "at": ["0.4 m", "0 m", "0 m"]}
    return case(
        "leg.xml",
        folder=folder,
        run={"start": {"hip": "10 deg"}} | run_table,
        edit=[load, {"joint": "hip", "damping": 0.5}],
        task={"reference": ["0.3*sin(2*t)", "-1"], "Q": [100, 1, 100, 1], "R": 1},
        controller=list(laws),
    )


def test_a_users_law_on_a_robot_is_weighed_by_its_dynamics(tmp_path: Path) -> None:
    """Against the nominal model's M and bias by MuJoCo itself; its servo is noted."""
    experiment = leg(tmp_path, {"law": "own:law", "k": 50}, engine="python")
    result = experiment.run()
    law, trajectory = result.controller, result.trajectory
    row = len(trajectory.weighed) // 2
    time = float(trajectory.time[row])
    alpha, E = law.coordinates.dynamics(time, trajectory.state[row], law.parameters)
    virtual = alpha + E @ trajectory.input[row]
    # Both invert the same M; 1e-9 is far above the rounding of two joints' dynamics.
    np.testing.assert_allclose(trajectory.weighed[row], virtual, rtol=1e-9, atol=1e-9)
    assert any("actuator 'knee': the position servo" in line for line in notes_on(experiment, []))


@pytest.mark.slow
def test_a_sliding_mode_deviates_least_on_a_users_robot(tmp_path: Path) -> None:
    grosmc = {"law": "grosmc", "k": 5, "epsilon": 60, "switching": "implicit"}
    experiment = leg(tmp_path, {"law": "lqr"}, grosmc, duration="1 s")
    runs: dict[str, RunResult] = {run.controller.name: run for run in experiment.runs()}
    deviations = {name: run.metrics["deviation"].value or 0 for name, run in runs.items()}
    assert 0 < deviations["grosmc"] < 0.1 * deviations["lqr"]


def test_outputs_of_two_units_have_no_one_error(tmp_path: Path) -> None:
    (tmp_path / "tree.xml").write_text(TREE)
    task = {"Q": 1, "R": 1}
    with pytest.raises(ArgumentError, match="different units"):
        case("tree.xml", folder=tmp_path, task=task, requirement={"deviation_below": "1 mrad"})


# Further laws of the package


def test_a_law_with_weights_of_its_own_is_the_packages() -> None:
    law = case("cart_pendulum", law="cart-lqr").law("physics", "cart-lqr")
    shipped = nominal_controller("cart_pendulum", "cart-lqr", "corrected")
    np.testing.assert_array_equal(law.parameters.K, shipped.parameters.K)
    with pytest.raises(ArgumentError, match="cart-lqr has weights and numbers of its own"):
        case("cart_pendulum", controller={"law": "cart-lqr", "R": 5})


RIVALS = ("lqi", "fl-pid", "adrc", "adaptive")


@pytest.mark.parametrize(
    ("system", "law"),
    [
        *[("servo", law) for law in RIVALS],
        *[("arm", law) for law in RIVALS],
        *[("cart_pendulum", law) for law in RIVALS[:3]],
    ],
)
def test_rivals_have_their_numbers_in_the_systems_base(system: str, law: str) -> None:
    assert case(system, law=law).law("physics", law).name == law


@pytest.mark.parametrize(
    ("numbers", "bandwidth"),
    [({}, 200.0), ({"bandwidth": 50}, 50.0), ({"bandwidth": "10 Hz"}, 20 * math.pi)],
)
def test_a_number_of_the_file_replaces_that_of_the_base(numbers, bandwidth) -> None:
    law = case("arm", controller={"law": "adrc"} | numbers).law("physics", "adrc")
    assert law.designed.gains["bandwidth"] == pytest.approx(bandwidth)

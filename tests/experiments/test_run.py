"""The commands run and new: kinds of files, a user's own Python, exit codes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from campaign_cases import run
from case_texts import LEG, OWN, OWN_NATIVE, PYTHON, load, written
from shipped import find_case, nominal_controller, run_case

from grosmc_mj import cli
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.experiments.file.shipped import find_file
from grosmc_mj.experiments.file.text import complete_text
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.errors import ArgumentError

ARM = find_file("arm/case1")
# A user's own law, judged by a limit that follows.
JUDGED = OWN + "\n[[requirement]]\n"
OWN_FOR_LONGER = """
[plant]
plant = "own:pendulum"
[run]
start = { q = "10 deg" }
duration = "0.22 s"
engine = "python"
[[edit]]
parameter = "m"
scale = 1.5
[task]
Q = [1, 1]
R = 1
[[controller]]
law = "own:law"
a = 4
b = 4
[[requirement]]
settles_within = "0.19 s"
"""
UNSTABLE = """
[plant]
plant = "own:pendulum"
[run]
start = { q = "10 deg" }
duration = "5 s"
engine = "python"
[task]
Q = [1, 1]
R = 1
[[controller]]
law = "own:law"
a = -1e9
b = 4
[[requirement]]
input_below = "1e12 N m"
"""
FACTORY = """
[plant]
plant = "own:pendulum"
[run]
duration = "0.2 s"
engine = "python"
[task]
Q = [1, 1]
R = 1
[[controller]]
law = "own:made"
epsilon = 7
"""
FOLLOWING = """
[plant]
plant = "own:pendulum"
[run]
start = { q = "10 deg" }
duration = "0.2 s"
engine = "python"
[task]
reference = ["own:pair"]
Q = [1, 1]
R = 1
[[controller]]
law = "own:law"
a = 4
b = 4
"""
# A law on a system of the package, whose base file has the numbers of the law.
SHIPPED_LAW = """
[plant]
system = "{}"
compare = ["physics"]
[run]
duration = "20 ms"
engine = "python"
[[controller]]
law = "{}"
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def read(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


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
    assert content["configuration"]["file"]["run"]["duration"] == 4.0
    assert (folder / "out" / "mine.png").stat().st_size > 10_000
    assert (folder / "out" / "mine.svg").is_file()


def test_new_copies_a_shipped_case(folder: Path) -> None:
    assert run("new", "mine", "--like", "arm/case1") == 0
    copy = read_case_file(folder / "mine.toml")
    assert copy.model_copy(update={"name": "case1"}) == read_case_file(ARM)


def test_a_copy_stands_alone_with_its_comments(folder: Path) -> None:
    assert run("new", "mine", "--like", "arm/case1") == 0
    text = (folder / "mine.toml").read_text()
    assert "extends" not in text
    assert "# d(t) acts against the torque, eq. (57)" in text


def test_new_never_overwrites(folder: Path, capsys) -> None:
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
        (("run", "nowhere.toml"), "there is no such file; grosmc-mj new nowhere writes one"),
    ],
)
def test_a_wrong_command_is_one_line(arguments, words, capsys) -> None:
    assert run(*arguments) == cli.WRONG
    assert words in capsys.readouterr().err


def test_a_requirement_that_is_not_kept_has_its_exit_code(folder: Path, capsys) -> None:
    path = written(folder, JUDGED + 'deviation_below = "1 urad"\n')
    assert run("run", path, "--no-figures") == cli.DIFFERS
    printed = capsys.readouterr().out
    assert "FAILED" in printed
    assert "1 of 1 requirement is not kept" in printed
    assert read(folder / "renders" / "mine.json")["kept"] is False


def test_a_run_that_cannot_be_judged_is_not_made(folder: Path, capsys) -> None:
    path = written(folder, JUDGED + 'settles_within = "0.19 s"\n')
    assert run("run", path, "--no-figures", "--out", "out") == cli.WRONG
    line = capsys.readouterr().err
    assert "no requirement can be judged: settles within 0.19 s: there are 0.2 s before" in line
    assert "require that at most, or make them 0.22 s at least" in line
    assert not (folder / "out").exists()


def test_a_run_of_the_advised_length_is_judged(folder: Path) -> None:
    assert run("run", written(folder, OWN_FOR_LONGER), "--no-figures") == cli.DIFFERS


def test_a_run_that_ends_early_keeps_nothing(folder: Path, capsys) -> None:
    assert run("run", written(folder, UNSTABLE), "--no-figures") == cli.DIFFERS
    assert re.search(r"FAILED: the run ended at \d", capsys.readouterr().out)


def test_results_of_the_same_file_are_replaced(folder: Path) -> None:
    path = written(folder, OWN)
    for _ in range(2):
        run("run", path, "--no-figures", "--out", "out")
        assert sorted(file.name for file in Path("out").iterdir()) == ["curves", "mine.json"]


def test_results_of_another_file_are_put_aside(folder: Path, capsys) -> None:
    """The files have one name and other settings."""
    out = folder / "out"
    run("run", written(folder, OWN), "--no-figures", "--out", out)
    first = (out / "mine.json").read_text(encoding="utf-8")
    capsys.readouterr()
    run("run", written(folder, OWN_FOR_LONGER), "--no-figures", "--out", out)
    assert (out / "mine.previous.json").read_text(encoding="utf-8") == first
    assert "mine.json had results of another file or other settings" in capsys.readouterr().out


@pytest.fixture(scope="module")
def case2_with_defaults(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """The arm's case2 with the numbers of its base file written out."""
    path = tmp_path_factory.mktemp("explicit") / "case2.toml"
    numbers = "k = 18\nepsilon = 6\nG = [[0, 1]]\nQ = [[10, 2], [2, 1]]\nR = 1\n"
    controller = '[[controller]]\nlaw = "grosmc"\n'
    text = complete_text(find_file("arm/case2"))
    assert controller in text
    path.write_text(text.replace(controller, controller + numbers))
    return Experiment.load(path)


def test_a_file_runs_as_the_shipped_case(case2_with_defaults: Experiment) -> None:
    for result in case2_with_defaults.runs():
        law = result.controller.name
        shipped = run_case(find_case("arm", "case2"), result.plant, law, Settings())
        np.testing.assert_array_equal(result.trajectory.state, shipped.trajectory.state)
        if result.plant == "physics":
            assert result.metrics == shipped.metrics


# A user's own Python.


def test_an_edit_reaches_the_plant(tmp_path: Path) -> None:
    assert load(tmp_path, OWN).plants["corrected"].parameters.m == 3.0


def test_an_edit_does_not_reach_a_users_law(tmp_path: Path) -> None:
    assert load(tmp_path, OWN).laws["corrected", "law"].parameters.plant.m == 2.0


def test_a_users_law_runs_alike_in_both_engines(tmp_path: Path) -> None:
    """The law of the native run has been compiled by numba before."""
    python = load(tmp_path, OWN).run().trajectory
    compiled = PYTHON.replace("def law", "import numba\n\n@numba.njit\ndef law")
    (tmp_path / "own.py").write_text(compiled)
    native = load(tmp_path, OWN_NATIVE).run().trajectory
    np.testing.assert_allclose(python.state, native.state, rtol=0, atol=1e-12)


def test_a_users_law_is_weighed_by_the_index(tmp_path: Path) -> None:
    """v = -m sin(q) + u = -a q - b q' of this law, by its own equations."""
    run = load(tmp_path, OWN_NATIVE).run().trajectory
    expected = -4 * run.state[:-1, 0] - 4 * run.state[:-1, 1]
    np.testing.assert_allclose(run.weighed, expected, rtol=0, atol=1e-12)


def test_a_function_makes_a_controller_with_the_files_numbers(tmp_path: Path) -> None:
    law = load(tmp_path, FACTORY).law("corrected", "made")
    assert law.parameters.epsilon == 7.0


def test_a_reference_may_be_a_users_own(tmp_path: Path) -> None:
    comparison = load(tmp_path, FOLLOWING).run("corrected").comparison
    np.testing.assert_allclose(comparison.reference[:, 0], np.sin(comparison.time), atol=1e-15)


# Robots.


@pytest.mark.slow
def test_the_command_runs_a_users_robot(folder: Path, capsys) -> None:
    assert run("run", written(folder, LEG)) == 0
    assert "actuator 'knee': the position servo" in capsys.readouterr().out


@pytest.fixture(scope="module")
def leg_runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, RunResult]:
    """Runs of a user's robot by the names of its laws."""
    experiment = load(tmp_path_factory.mktemp("leg"), LEG)
    return {result.controller.name: result for result in experiment.runs()}


@pytest.mark.slow
def test_a_sliding_mode_deviates_least_on_a_users_robot(leg_runs: dict[str, RunResult]) -> None:
    grosmc = leg_runs["grosmc"].metrics["deviation"].value or 0
    lqr = leg_runs["lqr"].metrics["deviation"].value or 0
    assert 0 < grosmc < 0.1 * lqr


@pytest.mark.slow
def test_a_users_law_on_a_robot_is_weighed_by_its_dynamics(leg_runs: dict[str, RunResult]) -> None:
    """Against the nominal model's M and bias by MuJoCo itself."""
    law = leg_runs["law"].controller
    trajectory = leg_runs["law"].trajectory
    row = len(trajectory.weighed) // 2
    time = float(trajectory.time[row])
    alpha, E = law.coordinates.dynamics(time, trajectory.state[row], law.parameters)
    virtual = alpha + E @ trajectory.input[row]
    # Both invert the same M; 1e-9 is far above the rounding of two joints' dynamics.
    np.testing.assert_allclose(trajectory.weighed[row], virtual, rtol=1e-9, atol=1e-9)


SLIDE_MODEL = """
<mujoco model="leg">
  <option timestep="0.001" integrator="RK4"><flag contact="disable"/></option>
  <worldbody>
    <body name="thigh" pos="0 0 1">
      <joint name="hip" type="slide" axis="1 0 0" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
      <body name="shank" pos="0.4 0 0">
        <joint name="knee" axis="0 -1 0"/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="hip" joint="hip" gear="10"/>
    <motor name="knee" joint="knee"/>
  </actuator>
</mujoco>
"""
SLIDE = """
[plant]
model = "leg.xml"
[run]
start = { hip = "1 cm" }
duration = "1 s"
[task]
reference = ["0", "0"]
Q = [100, 1, 100, 1]
R = 1
[[controller]]
law = "lqr"
[[requirement]]
deviation_below = "10 mrad"
"""


def test_outputs_of_two_units_have_no_one_error(tmp_path: Path) -> None:
    (tmp_path / "leg.xml").write_text(SLIDE_MODEL)
    with pytest.raises(ArgumentError, match="different units"):
        load(tmp_path, SLIDE)


# Further laws of the package.


def test_a_law_with_weights_of_its_own_is_the_packages(tmp_path: Path) -> None:
    text = SHIPPED_LAW.format("cart_pendulum", "cart-lqr")
    law = load(tmp_path, text).law("physics", "cart-lqr")
    shipped = nominal_controller("cart_pendulum", "cart-lqr", "corrected")
    np.testing.assert_array_equal(law.parameters.K, shipped.parameters.K)


def test_a_law_with_weights_of_its_own_takes_none(tmp_path: Path) -> None:
    text = SHIPPED_LAW.format("cart_pendulum", "cart-lqr")
    with pytest.raises(ArgumentError, match="cart-lqr has weights and numbers of its own"):
        load(tmp_path, text + "R = 5")


@pytest.mark.parametrize(
    ("system", "law"),
    [
        ("servo", "lqi"),
        ("servo", "fl-pid"),
        ("servo", "adrc"),
        ("servo", "adaptive"),
        ("cart_pendulum", "lqi"),
        ("cart_pendulum", "fl-pid"),
        ("cart_pendulum", "adrc"),
        ("arm", "lqi"),
        ("arm", "fl-pid"),
        ("arm", "adrc"),
        ("arm", "adaptive"),
    ],
)
def test_rivals_have_their_numbers_in_the_systems_base(tmp_path, system, law) -> None:
    result = load(tmp_path, SHIPPED_LAW.format(system, law)).run()
    assert result.ended == ""
    assert result.controller.name == law


@pytest.mark.parametrize(
    ("number", "bandwidth"),
    [
        ("", 200.0),
        ("bandwidth = 50", 50.0),
        ('bandwidth = "10 Hz"', pytest.approx(62.83185307179586)),
    ],
)
def test_a_number_of_the_file_replaces_that_of_the_base(tmp_path, number, bandwidth) -> None:
    law = load(tmp_path, SHIPPED_LAW.format("arm", "adrc") + number).law("physics", "adrc")
    assert law.designed.gains["bandwidth"] == bandwidth

"""grosmc-mj run and new: files of each kind, Python of the user's own, exit codes."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from campaign_cases import run
from case_texts import LEG, LEG_MODEL, OWN, PYTHON, load, written
from shipped import find_case, nominal_controller, run_case

from grosmc_mj import cli
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.reading import read_case_file, resolved_text
from grosmc_mj.experiments.file.shipped import find_file
from grosmc_mj.experiments.runs import RunResult, Settings

ARM = find_file("arm/case1")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_new_writes_a_file_that_run_runs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("new", "mine") == 0
    shorter = (folder / "mine.toml").read_text().replace('"6 s"', '"4 s"')
    (folder / "mine.toml").write_text(shorter)
    assert run("run", "mine.toml", "--out", "out") == 0
    assert "requirements are kept" in capsys.readouterr().out
    content = json.loads((folder / "out" / "mine.json").read_text())
    assert (content["kept"], content["complete"]) == (True, True)
    assert {row["controller"] for row in content["runs"]} == {"lqr", "grosmc", "softer"}
    assert content["configuration"]["file"]["run"]["duration"] == 4.0
    assert (folder / "out" / "mine.png").stat().st_size > 10_000
    assert (folder / "out" / "mine.svg").is_file()


def test_new_copies_a_shipped_case_and_never_overwrites(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("new", "mine", "--like", "arm/case1") == 0
    text = (folder / "mine.toml").read_text()
    # With its comments and, beside nothing, the experiment of the package.
    assert "extends" not in text
    assert "# d(t) acts against the torque, eq. (57)" in text
    copied, theirs = (read_case_file(path) for path in (folder / "mine.toml", ARM))
    assert copied.model_copy(update={"name": "case1"}) == theirs
    assert run("new", "mine") == cli.WRONG
    assert "is there already" in capsys.readouterr().err
    assert (folder / "mine.toml").read_text() == text


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("new", "a b"), "must be a name of letters"),
        (("new", "mine", "--like", "leg/case1"), "unknown case 'leg/case1'"),
        (("new", "mine", "--like", "arm/case1", "--python"), "give one of them"),
        (("run", "nowhere.toml"), "there is no such file; grosmc-mj new nowhere writes one"),
        (("run", "arm/case7"), "unknown case 'arm/case7': did you mean 'arm/case"),
    ],
)
def test_wrong_use(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], words: str
) -> None:
    assert run(*arguments) == cli.WRONG
    line = capsys.readouterr().err
    assert words in line
    assert line.count("\n") == 1


def test_a_requirement_that_is_not_kept_or_not_judged_has_its_exit_code(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    strict = written(folder, OWN + '\n[[requirement]]\ndeviation_below = "1 urad"\n')
    assert run("run", strict, "--no-figures") == cli.DIFFERS
    shown = capsys.readouterr().out
    assert "FAILED" in shown
    assert "1 of 1 requirements are not kept" in shown
    assert json.loads((folder / "renders" / "mine.json").read_text())["kept"] is False
    settles = OWN + '\n[[requirement]]\nsettles_within = "0.19 s"\n'
    assert run("run", written(folder, settles), "--no-figures", "--out", "out") == cli.WRONG
    line = capsys.readouterr().err
    assert "no requirement can be judged: settles within 0.19 s: there are 0.2 s before" in line
    assert "require that at most, or make them 0.22 s at least" in line
    assert line.count("\n") == 1
    assert not (folder / "out").exists()
    longer = settles.replace('duration = "0.2 s"', 'duration = "0.22 s"')
    assert run("run", written(folder, longer), "--no-figures") == cli.DIFFERS
    wild = OWN.replace("a = 4", "a = -1e9").replace("0.2 s", "5 s")
    wild += '\n[[requirement]]\ninput_below = "1e12 N m"\n'
    capsys.readouterr()
    assert run("run", written(folder, wild), "--no-figures") == cli.DIFFERS
    assert re.search(r"FAILED: the run ended at \d", capsys.readouterr().out)


def test_results_of_another_file_are_put_aside(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the same name and other settings; not those of the same file run again."""
    out, path = folder / "out", written(folder, OWN)
    for _ in range(2):
        run("run", path, "--no-figures", "--out", out)
        assert sorted(file.name for file in out.iterdir()) == ["curves", "mine.json"]
    first = (out / "mine.json").read_text(encoding="utf-8")
    capsys.readouterr()
    written(folder, OWN.replace('duration = "', 'duration = "1', 1))
    run("run", path, "--no-figures", "--out", out)
    assert (out / "mine.previous.json").read_text(encoding="utf-8") == first
    assert "mine.json had results of another file or other settings" in capsys.readouterr().out


@pytest.mark.parametrize("case", ["arm/case2", pytest.param("arm/case1", marks=pytest.mark.slow)])
def test_a_file_runs_as_validate_does_and_with_its_defaults_written_out(
    case: str, tmp_path: Path
) -> None:
    system, name = case.split("/")
    explicit = resolved_text(find_file(case)).replace(
        '[[controller]]\nlaw = "grosmc"\n',
        '[[controller]]\nlaw = "grosmc"\nk = 18\nepsilon = 6\nG = [[0, 1]]\n'
        "Q = [[10, 2], [2, 1]]\nR = 1\n",
    )
    (tmp_path / f"{name}.toml").write_text(explicit)
    for result in Experiment.load(tmp_path / f"{name}.toml").runs():
        law = result.controller.name
        same = run_case(find_case(system, name), result.plant, law, Settings())
        np.testing.assert_array_equal(result.trajectory.state, same.trajectory.state)
        if result.plant == "physics":
            assert result.metrics == same.metrics


# Python of one's own.


def first_run(folder: Path, text: str) -> RunResult:
    return next(iter(load(folder, text).runs()))


def test_a_law_of_ones_own_is_weighed_by_the_index_in_both_engines(tmp_path: Path) -> None:
    python = first_run(tmp_path, OWN).trajectory
    native = first_run(tmp_path, OWN.replace('"python"', '"native"')).trajectory
    np.testing.assert_allclose(python.state, native.state, rtol=0, atol=1e-12)
    # v = -m sin(q) + u = -a q - b q' of this law, by its own equations.
    expected = -4 * native.state[:-1, 0] - 4 * native.state[:-1, 1]
    np.testing.assert_allclose(native.weighed, expected, rtol=0, atol=1e-12)


def test_an_edit_reaches_the_plant_and_not_the_law(tmp_path: Path) -> None:
    experiment = load(tmp_path, OWN)
    assert experiment.laws["corrected", "law"].parameters.plant.m == 2.0
    assert experiment.plants["corrected"].parameters.m == 3.0


def test_a_factory_and_a_reference_of_ones_own(tmp_path: Path) -> None:
    factory = OWN.replace('"own:law"\na = 4\nb = 4', '"own:made"\nepsilon = 7')
    assert load(tmp_path, factory).law("corrected", "made").parameters.epsilon == 7.0
    moving = first_run(tmp_path, OWN.replace("[task]", '[task]\nreference = ["own:pair"]'))
    comparison = moving.comparison
    np.testing.assert_allclose(comparison.reference[:, 0], np.sin(comparison.time), atol=1e-15)


def test_a_law_that_numba_has_compiled_stands_for_its_source(tmp_path: Path) -> None:
    path = written(tmp_path, OWN.replace('"python"', '"native"'))
    (tmp_path / "own.py").write_text(
        PYTHON.replace("def law", "import numba\n\n@numba.njit\ndef law")
    )
    assert not next(iter(Experiment.load(path).runs())).ended


@pytest.mark.slow
def test_python_of_ones_own_may_move_to_another_module(folder: Path) -> None:
    """Compiled laws are kept on disk, and must not need the module that they came from."""
    for name in ("before", "after"):
        assert run("new", name, "--python") == 0
        command = [sys.executable, "-m", "grosmc_mj.cli", "run", f"{name}.toml", "--no-figures"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        (folder / f"{name}.py").unlink()


# Robots.


def deviation(result: RunResult) -> float:
    """Largest distance from the law's own optimum."""
    value = result.metrics["deviation"].value
    assert value is not None
    return value


@pytest.mark.slow
def test_a_robot_of_ones_own(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(folder, LEG)
    assert run("run", path) == 0
    assert "actuator 'knee': the position servo" in capsys.readouterr().out
    results = {result.controller.name: result for result in Experiment.load(path).runs()}
    assert deviation(results["grosmc"]) < 0.1 * deviation(results["lqr"])
    # v of a law of one's own, against the nominal model's M and bias by MuJoCo itself.
    law, trajectory = results["law"].controller, results["law"].trajectory
    row = len(trajectory.weighed) // 2
    time, state = float(trajectory.time[row]), trajectory.state[row]
    alpha, E = law.coordinates.dynamics(time, state, law.parameters)
    # Both invert the same M; 1e-9 is far above the rounding of two joints' dynamics.
    virtual = alpha + E @ trajectory.input[row]
    np.testing.assert_allclose(trajectory.weighed[row], virtual, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_a_robot_of_one_joint_is_run_and_audited(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A law of one input returns a number, and a trajectory of one input has no axis for it."""
    lower = LEG_MODEL.index('<body name="shank"')
    one = LEG_MODEL[:lower] + LEG_MODEL[LEG_MODEL.index("</body>", lower) + len("</body>") :]
    (folder / "leg.xml").write_text(
        "\n".join(line for line in one.splitlines() if 'joint="knee"' not in line)
    )
    (folder / "leg_law.py").write_text(
        "def law(t, x, memory, p):\n    return -p.stiffness * x[0] - x[1]\n"
    )
    text = LEG.replace('["0.3*sin(2*t)", "-1"]', '["0.3*sin(2*t)"]').replace('"1 s"', '"0.1 s"')
    text = text.replace("[100, 1, 100, 1]", "[100, 1]").replace('"shank"', '"thigh"')
    assert run("run", written(folder, text), "--no-figures", "--verbose") in (0, 1)
    shown = capsys.readouterr()
    assert "torque headroom" in shown.out
    assert not shown.err


def test_a_model_with_a_slow_timestep_is_sampled_with_it(tmp_path: Path) -> None:
    slow = LEG_MODEL.replace('timestep="0.001" integrator="RK4"', 'timestep="0.002"')
    (tmp_path / "leg.xml").write_text(slow)
    settings = load(tmp_path, LEG).settings
    assert (settings.timestep, settings.control_period) == (0.002, 0.002)
    assert settings.integrator == "Euler"


# Further laws of the package.


def test_further_laws_are_the_packages_own_and_take_no_weights(tmp_path: Path) -> None:
    text = resolved_text(find_file("cart_pendulum/case1")).replace(
        'law = "fl-lqr"\n\n[[controller]]', 'law = "cart-lqr"\n\n[[controller]]'
    )
    # Without the law that takes seconds to design, and its requirements.
    text = text.replace('[[controller]]\nlaw = "grosmc"\n', "").partition("[[requirement]]")[0]
    law = load(tmp_path, text).law("physics", "cart-lqr")
    same = nominal_controller("cart_pendulum", "cart-lqr", "corrected")
    np.testing.assert_array_equal(law.parameters.K, same.parameters.K)
    with pytest.raises(ArgumentError, match="cart-lqr has weights and numbers of its own"):
        load(tmp_path, text.replace('"cart-lqr"', '"cart-lqr"\nR = 5'))


RIVAL = """
[plant]
system = "{}"
compare = ["physics"]
[run]
duration = "20 ms"
engine = "python"
[[controller]]
law = "{}"
"""


@pytest.mark.parametrize(
    ("system", "laws"),
    [
        ("servo", ("lqi", "pid", "adrc", "adaptive")),
        ("cart_pendulum", ("lqi", "pid", "adrc")),
        ("arm", ("lqi", "pid", "adrc", "adaptive")),
    ],
)
def test_rivals_have_their_numbers_in_the_systems_base(
    tmp_path: Path, system: str, laws: tuple[str, ...]
) -> None:
    for law in laws:
        result = load(tmp_path, RIVAL.format(system, law)).run()
        assert not result.ended
        assert result.controller.name == law


def test_a_number_of_the_file_counts_and_may_have_its_unit(tmp_path: Path) -> None:
    bandwidths = [
        load(tmp_path, RIVAL.format("arm", "adrc") + number).law("physics", "adrc").designed.gains
        for number in ("", "bandwidth = 50", 'bandwidth = "10 Hz"')
    ]
    own = [gains["bandwidth"] for gains in bandwidths]
    assert own == [200.0, 50.0, pytest.approx(62.83185307179586)]


@pytest.mark.parametrize(
    ("system", "law", "words"),
    [
        ("cart_pendulum", "adaptive", "has no torques Y theta"),
        pytest.param(
            "two_link_arm", "adaptive", "must be its joints, q1, q2", marks=pytest.mark.slow
        ),
        ("servo", "pd", "pd needs frequency"),
    ],
)
def test_laws_that_a_system_cannot_have(tmp_path: Path, system: str, law: str, words: str) -> None:
    numbers = "frequency = 1\nadaptation = 1" if law == "adaptive" else ""
    with pytest.raises(ArgumentError, match=words):
        load(tmp_path, RIVAL.format(system, law) + numbers)

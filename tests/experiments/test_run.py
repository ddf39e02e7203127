"""grosmc-mj run and new: files of each kind, Python of the user's own, exit codes."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from shipped import find_case, nominal_controller, run_case

from grosmc_mj import cli
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.reading import read_case_file, resolved_text
from grosmc_mj.experiments.file.shipped import find_file
from grosmc_mj.experiments.runs import RunResult, Settings

ARM = find_file("arm/case1")

PYTHON = """
import math
import numpy as np
import sympy as sp
import grosmc_mj as gm

q, w = sp.symbols("q w")
m = sp.Symbol("m")

def pendulum():
    return gm.affine_plant("pendulum", states={"q": "rad", "w": "rad/s"}, inputs={"u": "N m"},
        f=[w, -m * sp.sin(q)], g=[0, 1], h=[q], parameters={"m": 2.0})

def law(t, x, memory, p):
    return p.plant.m * math.sin(x[0]) - p.a * x[0] - p.b * x[1]

def made(plant, epsilon=5.0):
    error = gm.control.ErrorCoordinates(plant.system, gm.control.setpoints(2))
    task = gm.Task(plant, error, gm.control.Setpoint(0.0), Q=np.eye(2), R=1.0)
    return gm.tracking_grosmc(task, k=5.0, epsilon=epsilon)

def gust(t):
    return math.exp(-t)

pair = (gm.control.reference([sp.sin(gm.control.TIME)]), gm.control.Setpoint())
wrong = 3
"""

CASE = """
[plant]
plant = "own:pendulum"

[run]
start = { q = "10 deg" }
duration = "0.2 s"
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
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@cache
def shipped(case: str) -> tuple[Experiment, list[RunResult]]:
    """A shipped case file and all its runs, made once."""
    experiment = Experiment.load(case)
    return experiment, list(experiment.runs())


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as stop:
        cli.main(arguments)
    assert isinstance(stop.value.code, int)
    return stop.value.code


def own(folder: Path, case: str = CASE, python: str = PYTHON) -> str:
    """A case file beside its Python."""
    (folder / "own.py").write_text(python)
    (folder / "own.toml").write_text(case)
    return str(folder / "own.toml")


@pytest.mark.slow
def test_new_writes_what_run_runs(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert run("new", "mine") == 0
    shorter = (folder / "mine.toml").read_text().replace('"6 s"', '"4 s"')
    (folder / "mine.toml").write_text(shorter)
    assert run("run", "mine.toml", "--out", "out") == 0
    said = capsys.readouterr().out
    assert "requirements are kept" in said
    content = json.loads((folder / "out" / "mine.json").read_text())
    assert content["kept"] is True
    assert content["complete"] is True
    assert {each["controller"] for each in content["runs"]} == {"lqr", "grosmc", "softer"}
    assert content["configuration"]["file"]["run"]["duration"] == 4.0
    assert (folder / "out" / "mine.png").stat().st_size > 10_000
    assert (folder / "out" / "mine.svg").is_file()


def test_new_copies_a_shipped_case(folder: Path):
    assert run("new", "mine", "--like", "arm/case1") == 0
    text = (folder / "mine.toml").read_text()
    assert "extends" not in text
    # With its comments and, beside nothing, the experiment of the package.
    assert "# d(t) acts against the torque, eq. (57)" in text
    copied, theirs = (read_case_file(path) for path in (folder / "mine.toml", ARM))
    assert copied.model_copy(update={"name": "case1"}) == theirs


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("new", "a b"), "must be a name of letters"),
        (("new", "mine", "--like", "leg/case1"), "unknown case 'leg/case1'"),
        (("new", "mine", "--like", "arm/case1", "--python"), "give one of them"),
        (("run", "nowhere.toml"), "there is no such file; grosmc-mj new nowhere writes one"),
        (("run", "arm/case7"), "unknown case 'arm/case7': did you mean 'arm/case"),
    ],
)
def test_wrong_use(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], said: str
):
    assert run(*arguments) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_new_never_overwrites(folder: Path, capsys: pytest.CaptureFixture[str]):
    (folder / "mine.toml").write_text("precious")
    assert run("new", "mine") == 2
    assert "is there already" in capsys.readouterr().err
    assert (folder / "mine.toml").read_text() == "precious"


def test_failed_requirement_has_exit_code_1(folder: Path, capsys: pytest.CaptureFixture[str]):
    strict = CASE + '\n[[requirement]]\ndeviation_below = "1 urad"\n'
    assert run("run", own(folder, strict), "--no-figures") == 1
    said = capsys.readouterr().out
    assert "FAILED" in said
    assert "1 of 1 requirements are not kept" in said
    assert json.loads((folder / "renders" / "own.json").read_text())["kept"] is False


def test_a_file_of_which_nothing_can_be_judged_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
):
    unjudgeable = CASE + '\n[[requirement]]\nsettles_within = "0.19 s"\n'
    assert run("run", own(folder, unjudgeable), "--no-figures") == cli.WRONG
    said = capsys.readouterr().err
    assert "no requirement can be judged: settles within 0.19 s: there are 0.2 s before" in said
    assert "require that at most, or make them 0.22 s at least" in said
    assert said.count("\n") == 1
    assert not (folder / "renders").exists()
    enough = unjudgeable.replace('duration = "0.2 s"', 'duration = "0.22 s"')
    assert run("run", own(folder, enough), "--no-figures") == cli.DIFFERS


@pytest.mark.parametrize(
    "case",
    [
        "arm/case2",
        *(
            pytest.param(case, marks=pytest.mark.slow)
            for case in ("servo/case1", "cart_pendulum/case1")
        ),
    ],
)
def test_a_file_runs_as_validate_does(case: str):
    system, name = case.split("/")
    for result in shipped(case)[1]:
        if result.plant == "physics":
            same = run_case(find_case(system, name), "physics", result.controller.name, Settings())
            assert np.array_equal(result.trajectory.state, same.trajectory.state)
            assert result.metrics == same.metrics


def test_numbers_of_the_file_are_the_defaults_written_out(tmp_path: Path):
    text = resolved_text(ARM)
    explicit = text.replace(
        '[[controller]]\nlaw = "grosmc"\n',
        '[[controller]]\nlaw = "grosmc"\nk = 18\nepsilon = 6\nG = [[0, 1]]\n'
        "Q = [[10, 2], [2, 1]]\nR = 1\n",
    )
    (tmp_path / "mine.toml").write_text(explicit)
    found = {r.key: r for r in Experiment.load(tmp_path / "mine.toml").runs()}
    for result in shipped("arm/case1")[1]:
        mine = found[result.key.replace("/case1/", "/mine/")]
        assert np.array_equal(mine.trajectory.state, result.trajectory.state)


def test_law_of_ones_own_in_both_engines_is_weighed_by_the_index(folder: Path):
    path = Path(own(folder))
    python = next(iter(Experiment.load(path).runs()))
    path.write_text(CASE.replace('"python"', '"native"'))
    native = next(iter(Experiment.load(path).runs()))
    assert np.allclose(python.trajectory.state, native.trajectory.state, rtol=0, atol=1e-12)
    # v = -m sin(q) + u = -a q - b q' of this law, by its own equations.
    run, steps = native.trajectory, slice(0, -1)
    expected = -4 * run.state[steps, 0] - 4 * run.state[steps, 1]
    assert np.allclose(run.weighed, expected, rtol=0, atol=1e-12)


def test_edit_reaches_the_plant_and_not_the_law(folder: Path):
    experiment = Experiment.load(Path(own(folder)))
    law = experiment.laws["corrected", "law"]
    assert law.parameters.plant.m == 2.0
    assert experiment.plants["corrected"].parameters.m == 3.0


def test_factory_and_reference_of_ones_own(folder: Path):
    factory = CASE.replace('"own:law"\na = 4\nb = 4', '"own:made"\nepsilon = 7')
    result = next(iter(Experiment.load(Path(own(folder, factory))).runs()))
    assert result.controller.parameters.epsilon == 7.0
    moving = CASE.replace("[task]", '[task]\nreference = ["own:pair"]')
    result = next(iter(Experiment.load(Path(own(folder, moving))).runs()))
    assert np.allclose(
        result.comparison.reference[:, 0], np.sin(result.comparison.time), atol=1e-15
    )


def line_of(python: str, part: str) -> int:
    """The line that a part of the source is on."""
    return python[: python.index(part)].count("\n") + 1


@pytest.mark.parametrize(
    ("good", "bad", "said"),
    [
        ("p.a * x[0]", "p.a * x[9]", "IndexError"),
        ("p.a * x[0]", "p.aa * x[0]", "p has no 'aa'"),
        ("math.sin(x[0])", "math.sin(1 / 0)", "ZeroDivisionError"),
        ("return gm.affine_plant", "return gm.affine_plan", "AttributeError"),
        ("import sympy as sp", "import sympi as sp", "No module named 'sympi'"),
        ("q, w = sp", "q, w == sp", "NameError"),
        ("def law(t", "def law(t,,", "SyntaxError"),
        ("q, w = sp", "raise SystemExit\nq, w = sp", "SystemExit"),
        ("q, w = sp", "assert False\nq, w = sp", "AssertionError"),
    ],
)
def test_errors_in_the_users_python_point_to_its_line(
    folder: Path, capsys: pytest.CaptureFixture[str], good: str, bad: str, said: str
):
    python = PYTHON.replace(good, bad, 1)
    assert run("run", own(folder, CASE, python), "--no-figures") == 2
    error = capsys.readouterr().err
    assert f"own.py:{line_of(python, bad)}: " in error
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("returned", ["None", "'a'", "(1.0,)", "(1.0, 2.0)", "1j", "math.nan"])
def test_law_that_returns_something_else_is_told(
    folder: Path, capsys: pytest.CaptureFixture[str], returned: str
):
    python = PYTHON.replace("return p.plant.m * math.sin(x[0])", f"return {returned}\n    return 0")
    assert run("run", own(folder, CASE, python), "--no-figures") == 2
    error = capsys.readouterr().err
    assert "own.toml" in error
    assert "law returned" in error
    assert error.count("\n") == 1


def test_compiled_law_that_raises_later_points_to_its_line(
    folder: Path, capfd: pytest.CaptureFixture[str]
):
    later = "if t > 0.1:\n        raise ValueError('too late')\n    return p.plant"
    python = PYTHON.replace("return p.plant", later, 1)
    native = CASE.replace('"python"', '"native"')
    assert run("run", own(folder, native, python), "--no-figures") == 2
    error = capfd.readouterr().err
    line = line_of(python, "raise ValueError")
    assert f"own.py:{line}: ValueError: too late (law at t = 0.101 s)" in error
    assert error.count("\n") == 1


def test_law_that_numba_has_compiled_stands_for_its_source(folder: Path):
    python = PYTHON.replace("def law", "import numba\n\n@numba.njit\ndef law")
    native = CASE.replace('"python"', '"native"')
    assert run("run", own(folder, native, python), "--no-figures") == 0


@pytest.mark.slow
def test_python_of_ones_own_may_move_to_another_module(folder: Path):
    """What is compiled is kept on disk, and must not ask for the module that it came from."""
    for name in ("before", "after"):
        assert run("new", name, "--python") == 0
        command = [sys.executable, "-m", "grosmc_mj.cli", "run", f"{name}.toml", "--no-figures"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        (folder / f"{name}.py").unlink()


def test_law_that_numba_cannot_compile_points_to_its_line(
    folder: Path, capsys: pytest.CaptureFixture[str]
):
    python = PYTHON.replace("p.a * x[0]", "p.a * sum(x.tolist())")
    native = CASE.replace('"python"', '"native"')
    assert run("run", own(folder, native, python), "--no-figures") == 2
    error = capsys.readouterr().err
    assert f"own.py:{line_of(python, 'p.a * sum')}: numba cannot compile the law" in error
    assert 'engine = "python" runs it uncompiled' in error
    assert run("run", own(folder, CASE, python), "--no-figures") == 0


@pytest.mark.parametrize(
    ("good", "bad", "said"),
    [
        ("own:pendulum", "own:pendulm", "did you mean 'pendulum'?"),
        ("own:pendulum", "onw:pendulum", "there is no onw.py in"),
        ("own:pendulum", "own:", "'own:' must be module:name"),
        ("own:pendulum", "own:wrong", "own:wrong is a int, must be a plant"),
        ("own:law", "math:sin", "math is a module of Python itself"),
        ("a = 4", "plant = 4", "'plant' cannot be the name of a number"),
        ("a = 4", "class = 4", "'class' cannot be the name of a number"),
        ("a = 4", "a = inf", "a = inf must be finite"),
        ("own:law", "own:wrong", "own:wrong is a int, must be a law (t, x, memory, p, u)"),
        ("own:law", "own:pendulum", "own:pendulum cannot be called with ['a', 'b']"),
        ("own:law", "own:gust", "got an unexpected keyword argument 'a'"),
        ('parameter = "m"', 'parameter = "k"', "unknown parameter 'k': valid: m"),
        ('parameter = "m"\nscale = 1.5', 'body = "rod"\nmass_scale = 2', "edit a parameter"),
        ("Q = [1, 1]\n", "", "Q is missing"),
        ("a = 4", 'a = "four"', "a = 'four' must be a number"),
        ('"own:law"\na = 4\nb = 4', '"grosmc"', "grosmc needs k and epsilon"),
        ('"own:law"\na = 4\nb = 4', '"lqr"\nk = 4', "unknown key 'k'"),
        ('"own:law"\na = 4\nb = 4', '"lqr"\nswitching = "sign"', "it does not switch"),
        ("[task]", '[task]\nreference = ["own:wrong"]', "must be a pair"),
    ],
)
def test_wrong_files_of_ones_own(
    folder: Path, capsys: pytest.CaptureFixture[str], good: str, bad: str, said: str
):
    assert run("run", own(folder, CASE.replace(good, bad, 1)), "--no-figures") == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_diverged_run_keeps_nothing(folder: Path, capsys: pytest.CaptureFixture[str]):
    wild = CASE.replace("a = 4", "a = -1e9").replace("0.2 s", "5 s")
    wild += '\n[[requirement]]\ninput_below = "1e12 N m"\n'
    assert run("run", own(folder, wild), "--no-figures") == 1
    assert re.search(r"FAILED: the run ended at \d", capsys.readouterr().out)


ROBOT = """
<mujoco model="leg">
  <option timestep="0.001" integrator="RK4"><flag contact="disable"/></option>
  <worldbody>
    <body name="thigh" pos="0 0 1">
      <joint name="hip" axis="0 -1 0" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
      <body name="shank" pos="0.4 0 0">
        <joint name="knee" axis="0 -1 0"/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="hip" joint="hip" gear="10"/>
    <position name="knee" joint="knee" kp="50"/>
  </actuator>
</mujoco>
"""

ROBOT_CASE = """
[plant]
model = "leg.xml"

[run]
start = { hip = "10 deg" }
duration = "1 s"

[[edit]]
body = "shank"
added_mass = "0.5 kg"
at = ["0.4 m", "0 m", "0 m"]

[[edit]]
joint = "hip"
damping = 0.5

[task]
reference = ["0.3*sin(2*t)", "-1"]
Q = [100, 1, 100, 1]
R = 1

[[controller]]
law = "lqr"

[[controller]]
law = "grosmc"
k = 5
epsilon = 60
switching = "implicit"

[[controller]]
law = "own:law"
stiffness = 50

[[requirement]]
of = ["grosmc"]
deviation_below = "10 mrad"
"""

ROBOT_LAW = """
def law(t, x, memory, p):
    return (-p.stiffness * x[0] - x[2], -p.stiffness * (x[1] + 1) - x[3])
"""


def deviation(result: RunResult) -> float:
    """Largest distance from the law's own optimum."""
    value = result.metrics["deviation"].value
    assert value is not None
    return value


def robot(folder: Path, case: str = ROBOT_CASE, model: str = ROBOT) -> str:
    """A case file beside a robot and a law for it."""
    (folder / "leg.xml").write_text(model)
    (folder / "own.py").write_text(ROBOT_LAW)
    (folder / "leg.toml").write_text(case)
    return str(folder / "leg.toml")


@pytest.mark.slow
def test_robot_of_ones_own(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert run("run", robot(folder)) == 0
    said = capsys.readouterr().out
    assert "actuator 'knee': the position servo" in said
    results = {r.controller.name: r for r in Experiment.load(folder / "leg.toml").runs()}
    assert deviation(results["grosmc"]) < 0.1 * deviation(results["lqr"])
    # v of a law of one's own, against the nominal model's M and bias by MuJoCo itself.
    law, found = results["law"].controller, results["law"].trajectory
    row = len(found.weighed) // 2
    alpha, E = law.coordinates.dynamics(float(found.time[row]), found.state[row], law.parameters)
    # Both invert the same M; 1e-9 is far above the rounding of two joints' dynamics.
    assert np.allclose(found.weighed[row], alpha + E @ found.input[row], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("good", "bad", "said"),
    [
        ('model = "leg.xml"', 'model = "lag.xml"', "lag.xml"),
        ('model = "leg.xml"', 'model = "leg.xml"\njoints = ["hpi"]', "did you mean 'hip'"),
        ("Q = [100, 1, 100, 1]", "Q = [100, 1]", "must be a number, 4 numbers or a 4 x 4 matrix"),
        ('["0.3*sin(2*t)", "-1"]', '["0"]', "1 formulas, there are 2 outputs"),
        ('joint = "hip"', 'joint = "hpi"', "did you mean 'hip'"),
        ('added_mass = "0.5 kg"', 'added_mass = "-1 kg"', "-1"),
        ('law = "lqr"', 'law = "fl-lqr"', "unknown law 'fl-lqr'"),
        ('hip = "10 deg"', 'hop = "10 deg"', "did you mean 'hip'"),
    ],
)
def test_wrong_files_of_robots(
    folder: Path, capsys: pytest.CaptureFixture[str], good: str, bad: str, said: str
):
    assert good in ROBOT_CASE
    assert run("run", robot(folder, ROBOT_CASE.replace(good, bad, 1)), "--no-figures") == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_a_robot_of_one_joint_is_run_and_audited(folder: Path, capsys: pytest.CaptureFixture[str]):
    """A law of one input returns a number, and a trajectory of one input has no axis for it."""
    lower = ROBOT.index('<body name="shank"')
    one = ROBOT[:lower] + ROBOT[ROBOT.index("</body>", lower) + len("</body>") :]
    one = "\n".join(line for line in one.splitlines() if 'joint="knee"' not in line)
    case = ROBOT_CASE.replace('["0.3*sin(2*t)", "-1"]', '["0.3*sin(2*t)"]')
    case = case.replace("[100, 1, 100, 1]", "[100, 1]").replace('"shank"', '"thigh"')
    case = case.replace('"1 s"', '"0.1 s"')
    path = robot(folder, case, one)
    (folder / "own.py").write_text(
        "def law(t, x, memory, p):\n    return -p.stiffness * x[0] - x[1]\n"
    )
    assert run("run", path, "--no-figures", "--verbose") in (0, 1)
    said = capsys.readouterr()
    assert "torque headroom" in said.out
    assert not said.err


def test_further_laws_are_the_package_s_own_and_take_no_weights(folder: Path):
    text = resolved_text(find_file("cart_pendulum/case1")).replace(
        'law = "fl-lqr"\n\n[[controller]]', 'law = "cart-lqr"\n\n[[controller]]'
    )
    # Without the law that takes seconds to design, and what is required of it.
    text = text.replace('[[controller]]\nlaw = "grosmc"\n', "").partition("[[requirement]]")[0]
    (folder / "mine.toml").write_text(text)
    (law,) = (
        law
        for (plant, name), law in Experiment.load(folder / "mine.toml").laws.items()
        if (plant, name) == ("physics", "cart-lqr")
    )
    same = nominal_controller("cart_pendulum", "cart-lqr", "corrected")
    assert np.array_equal(law.parameters.K, same.parameters.K)
    (folder / "mine.toml").write_text(text.replace('"cart-lqr"', '"cart-lqr"\nR = 5'))
    with pytest.raises(ArgumentError, match="cart-lqr has weights and numbers of its own"):
        Experiment.load(folder / "mine.toml")


def test_a_model_with_a_slow_timestep_is_sampled_with_it(folder: Path):
    slow = ROBOT.replace('timestep="0.001" integrator="RK4"', 'timestep="0.002"')
    settings = Experiment.load(Path(robot(folder, model=slow))).settings
    assert (settings.timestep, settings.control_period) == (0.002, 0.002)
    assert settings.integrator == "Euler"


def test_outputs_of_different_units_have_no_one_error(folder: Path):
    mixed = ROBOT.replace(
        '<joint name="hip" axis="0 -1 0"', '<joint name="hip" type="slide" axis="1 0 0"'
    )
    case = ROBOT_CASE.replace('hip = "10 deg"', 'hip = "1 cm"')
    with pytest.raises(ArgumentError, match="different units"):
        Experiment.load(Path(robot(folder, case, mixed)))


def test_results_of_another_file_are_put_aside(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the same name, or of other settings; not those of the same file run again."""
    out = folder / "out"
    arguments = ("own.toml", "--no-figures", "--out", str(out))
    own(folder, CASE, PYTHON)
    for _ in range(2):
        run("run", *arguments)
        assert sorted(each.name for each in out.iterdir()) == ["curves", "own.json"]
    first = (out / "own.json").read_text(encoding="utf-8")
    own(folder, CASE.replace('duration = "', 'duration = "1', 1), PYTHON)
    capsys.readouterr()
    run("run", *arguments)
    assert (out / "own.previous.json").read_text(encoding="utf-8") == first
    assert "own.json had results of another file or other settings" in capsys.readouterr().out

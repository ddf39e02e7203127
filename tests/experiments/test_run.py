"""grosmc-mj run and new: files of each kind, Python of the user's own, exit codes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from campaign_cases import run
from case_texts import LEG, LEG_MODEL, OWN, PYTHON, RIVAL, load, written
from shipped import find_case, nominal_controller, run_case

from grosmc_mj import cli
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.reading import read_case_file, resolved_text
from grosmc_mj.experiments.file.shipped import find_file
from grosmc_mj.experiments.runs import Settings

ARM = find_file("arm/case1")


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
    assert (content["kept"], content["complete"]) == (True, True)
    assert {row["controller"] for row in content["runs"]} == {"lqr", "grosmc", "softer"}
    assert content["configuration"]["file"]["run"]["duration"] == 4.0
    assert (folder / "out" / "mine.png").stat().st_size > 10_000
    assert (folder / "out" / "mine.svg").is_file()


def test_new_copies_a_shipped_case_and_never_overwrites(folder: Path, capsys) -> None:
    assert run("new", "mine", "--like", "arm/case1") == 0
    text = (folder / "mine.toml").read_text()
    # With its comments and, beside nothing, the experiment of the package.
    assert "extends" not in text
    assert "# d(t) acts against the torque, eq. (57)" in text
    copied, theirs = (read_case_file(path) for path in (folder / "mine.toml", ARM))
    assert copied.model_copy(update={"name": "case1"}) == theirs
    for arguments, words in (
        (("new", "mine"), "is there already"),
        (("new", "a b"), "must be a name of letters"),
        (("new", "mine", "--like", "arm/case1", "--python"), "give one of them"),
        (("run", "arm/base"), "unknown case 'arm/base'"),
        (("run", "nowhere.toml"), "there is no such file; grosmc-mj new nowhere writes one"),
    ):
        assert run(*arguments) == cli.WRONG
        assert words in capsys.readouterr().err
    assert (folder / "mine.toml").read_text() == text


def test_a_requirement_that_is_not_kept_or_not_judged_has_its_exit_code(folder, capsys) -> None:
    strict = OWN + '\n[[requirement]]\ndeviation_below = "1 urad"\n'
    assert run("run", written(folder, strict), "--no-figures") == cli.DIFFERS
    assert "FAILED" in (shown := capsys.readouterr().out)
    assert "1 of 1 requirements are not kept" in shown
    assert read(folder / "renders" / "mine.json")["kept"] is False
    settles = OWN + '\n[[requirement]]\nsettles_within = "0.19 s"\n'
    assert run("run", written(folder, settles), "--no-figures", "--out", "out") == cli.WRONG
    line = capsys.readouterr().err
    assert "no requirement can be judged: settles within 0.19 s: there are 0.2 s before" in line
    assert "require that at most, or make them 0.22 s at least" in line
    assert not (folder / "out").exists()
    longer = settles.replace('duration = "0.2 s"', 'duration = "0.22 s"')
    assert run("run", written(folder, longer), "--no-figures") == cli.DIFFERS
    wild = OWN.replace("a = 4", "a = -1e9").replace("0.2 s", "5 s")
    wild += '\n[[requirement]]\ninput_below = "1e12 N m"\n'
    assert run("run", written(folder, wild), "--no-figures") == cli.DIFFERS
    assert re.search(r"FAILED: the run ended at \d", capsys.readouterr().out)


def test_results_of_another_file_are_put_aside(folder: Path, capsys) -> None:
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


def test_a_file_runs_as_validate_does_and_with_its_defaults_written_out(tmp_path: Path) -> None:
    explicit = resolved_text(find_file("arm/case2")).replace(
        '[[controller]]\nlaw = "grosmc"\n',
        '[[controller]]\nlaw = "grosmc"\nk = 18\nepsilon = 6\nG = [[0, 1]]\n'
        "Q = [[10, 2], [2, 1]]\nR = 1\n",
    )
    (tmp_path / "case2.toml").write_text(explicit)
    for result in Experiment.load(tmp_path / "case2.toml").runs():
        law = result.controller.name
        same = run_case(find_case("arm", "case2"), result.plant, law, Settings())
        np.testing.assert_array_equal(result.trajectory.state, same.trajectory.state)
        if result.plant == "physics":
            assert result.metrics == same.metrics


# Python of one's own.


def test_a_law_of_ones_own_is_weighed_by_the_index_in_both_engines(tmp_path: Path) -> None:
    """Compiled by numba before or not; an edit reaches the plant and not the law."""
    experiment = load(tmp_path, OWN)
    assert experiment.laws["corrected", "law"].parameters.plant.m == 2.0
    assert experiment.plants["corrected"].parameters.m == 3.0
    python = experiment.run().trajectory
    compiled = PYTHON.replace("def law", "import numba\n\n@numba.njit\ndef law")
    (tmp_path / "own.py").write_text(compiled)
    native = load(tmp_path, OWN.replace('"python"', '"native"')).run().trajectory
    np.testing.assert_allclose(python.state, native.state, rtol=0, atol=1e-12)
    # v = -m sin(q) + u = -a q - b q' of this law, by its own equations.
    expected = -4 * native.state[:-1, 0] - 4 * native.state[:-1, 1]
    np.testing.assert_allclose(native.weighed, expected, rtol=0, atol=1e-12)


def test_a_factory_and_a_reference_of_ones_own(tmp_path: Path) -> None:
    factory = OWN.replace('"own:law"\na = 4\nb = 4', '"own:made"\nepsilon = 7')
    assert load(tmp_path, factory).law("corrected", "made").parameters.epsilon == 7.0
    text = OWN.replace("[task]", '[task]\nreference = ["own:pair"]')
    comparison = load(tmp_path, text).run("corrected").comparison
    np.testing.assert_allclose(comparison.reference[:, 0], np.sin(comparison.time), atol=1e-15)


# Robots.


@pytest.mark.slow
def test_a_robot_of_ones_own(folder: Path, capsys) -> None:
    path = written(folder, LEG)
    assert run("run", path) == 0
    assert "actuator 'knee': the position servo" in capsys.readouterr().out
    results = {result.controller.name: result for result in Experiment.load(path).runs()}
    off = {name: result.metrics["deviation"].value or 0 for name, result in results.items()}
    assert 0 < off["grosmc"] < 0.1 * off["lqr"]
    # v of a law of one's own, against the nominal model's M and bias by MuJoCo itself.
    law, trajectory = results["law"].controller, results["law"].trajectory
    row = len(trajectory.weighed) // 2
    time, state = float(trajectory.time[row]), trajectory.state[row]
    alpha, E = law.coordinates.dynamics(time, state, law.parameters)
    # Both invert the same M; 1e-9 is far above the rounding of two joints' dynamics.
    virtual = alpha + E @ trajectory.input[row]
    np.testing.assert_allclose(trajectory.weighed[row], virtual, rtol=1e-9, atol=1e-9)
    # Outputs of two units have no one error.
    hip = '<joint name="hip" axis="0 -1 0"'
    slide = LEG_MODEL.replace(hip, '<joint name="hip" type="slide" axis="1 0 0"')
    (folder / "leg.xml").write_text(slide)
    with pytest.raises(ArgumentError, match="different units"):
        load(folder, LEG.replace('hip = "10 deg"', 'hip = "1 cm"'))


# Further laws of the package.


def test_a_law_with_weights_of_its_own_takes_none(tmp_path: Path) -> None:
    text = RIVAL.replace("arm", "cart_pendulum").replace("lqi", "cart-lqr")
    law = load(tmp_path, text).law("physics", "cart-lqr")
    same = nominal_controller("cart_pendulum", "cart-lqr", "corrected")
    np.testing.assert_array_equal(law.parameters.K, same.parameters.K)
    with pytest.raises(ArgumentError, match="cart-lqr has weights and numbers of its own"):
        load(tmp_path, text + "R = 5")


def test_rivals_have_their_numbers_in_the_systems_base_or_in_the_file(tmp_path: Path) -> None:
    for system, laws in (("servo", ("lqi", "pid", "adrc", "adaptive")),
                         ("cart_pendulum", ("lqi", "pid", "adrc")),
                         ("arm", ("lqi", "pid", "adrc", "adaptive"))):  # fmt: skip
        for law in laws:
            text = RIVAL.replace("arm", system).replace("lqi", law).replace("0.1 s", "20 ms")
            result = load(tmp_path, text).run()
            assert (result.ended, result.controller.name) == ("", law)
    numbers = ("", "bandwidth = 50", 'bandwidth = "10 Hz"')
    files = [load(tmp_path, RIVAL.replace("lqi", "adrc") + number) for number in numbers]
    own = [file.law("physics", "adrc").designed.gains["bandwidth"] for file in files]
    assert own == [200.0, 50.0, pytest.approx(62.83185307179586)]

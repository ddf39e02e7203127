"""The code of the guide runs, and what the guide says of it holds."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytestmark = pytest.mark.slow

DOCS = Path(__file__).parents[1] / "docs"


def left_behind(page: str) -> dict[str, Any]:
    """What a page's code leaves behind."""
    text = (DOCS / page).read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(compile("\n".join(blocks), page, "exec"), names)
    return names


@pytest.fixture(scope="module")
def scope() -> dict[str, Any]:
    """What the guide's code leaves behind."""
    return left_behind("guide.md")


def test_the_motor_s_angle_has_relative_degree_three(scope: dict[str, Any]) -> None:
    assert scope["chains"].relative_degree == (3,)
    assert scope["chains"].complete
    assert str(scope["chains"].singularity) == "c"


def test_the_robust_law_holds_what_is_matched_and_not_what_is_not(scope: dict[str, Any]) -> None:
    found = scope["found"]
    assert found["nominal"] < 1e-3
    assert found["warm winding, robust"] < 1e-3
    assert found["warm winding, optimal only"] > 1.0
    assert found["stronger magnet, robust"] > 0.1


def test_the_motor_follows_the_moving_reference(scope: dict[str, Any]) -> None:
    run = scope["run"]
    late = run.time > 3.0
    assert np.abs(run.state[late, 0] - 0.5 * np.sin(3.0 * run.time[late])).max() < 0.01


def test_the_guide_says_which_assumption_fails(
    scope: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    import grosmc_mj as gm

    with pytest.raises(gm.GrosmcError, match=r"output 1, R, has no relative degree.*first 3"):
        gm.feedback_linearization(scope["motor"].system.equations, h=[scope["R"]])


def test_the_page_on_your_own_runs_and_says_what_comes_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # where it saves a trajectory
    pytest.importorskip("dm_control")
    pytest.importorskip("gymnasium")
    names = left_behind("your_own.md")
    assert names["deviation"]["grosmc"] < 0.1 * names["deviation"]["lqr"]
    # The same steps with the same numbers, in dm_control and in Gymnasium.
    assert names["total"] == names["summed"]
    assert any("position servo" in sentence for sentence in names["robot"].notes)
    assert abs(names["swing"].state[-1, 0] - 1.0) < 0.02
    assert np.array_equal(names["again"].state, names["swing"].state)
    assert "out of the input's reach" in names["held"].designed.declared
    # What was learned earns as much as the law, and keeps no nominal trajectory.
    assert names["gained"](names["gains"], 2.0) > -3.0
    assert names["finding"].verdict.value == "refuted"


def test_the_case_file_on_the_page_on_your_own_is_kept(tmp_path: Path) -> None:
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.requirements import judge_all

    text = (DOCS / "your_own.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    whole = [block for block in blocks if "[[requirement]]" in block]
    assert len(whole) == 2
    for block, count in zip(whole, (3, 1), strict=True):
        if "gymnasium:" in block:
            pytest.importorskip("gymnasium")
        (tmp_path / "mine.toml").write_text(block, encoding="utf-8")
        experiment = Experiment.load(tmp_path / "mine.toml")
        judgements = judge_all(experiment.limits, list(experiment.runs()))
        assert len(judgements) == count
        assert all(each.kept for each in judgements), judgements


def test_the_law_on_the_page_on_your_own_remembers(tmp_path: Path) -> None:
    from grosmc_mj.experiments.experiment import Experiment

    text = (DOCS / "your_own.md").read_text(encoding="utf-8")
    (law,) = (b for b in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "def pi" in b)
    (table,) = (b for b in re.findall(r"```toml\n(.*?)```", text, re.DOTALL) if "mine:pi" in b)
    run = '[plant]\nsystem = "servo"\n[run]\nduration = "8 s"\ncontrol_period = "1 ms"\n'
    (tmp_path / "mine.py").write_text(law, encoding="utf-8")
    (tmp_path / "mine.toml").write_text(run + table, encoding="utf-8")
    found = Experiment.load(tmp_path / "mine.toml").run("physics").trajectory
    # Without friction worth the name the rotor swings about the target, within the limit.
    assert np.abs(found.input).max() <= 3.0
    cut = np.abs(found.input) == 3.0
    assert np.any(cut[:-1])
    still = np.diff(found.memory["integral"][: len(cut)])[cut[1 : len(cut)]]
    assert not np.any(still)
    assert np.any(np.diff(found.memory["integral"]))

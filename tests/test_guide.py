"""The code of the guide's pages runs, and what they say of it holds."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grosmc_mj as gm
from grosmc_mj.experiments.requirements import judge_all

pytestmark = pytest.mark.slow

DOCS = Path(__file__).parents[1] / "docs"


def blocks(page: str, language: str) -> list[str]:
    """The blocks of code of a page."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def names_of(page: str) -> dict[str, Any]:
    """The names that a page's code defines."""
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(compile("\n".join(blocks(page, "python")), page, "exec"), names)
    return names


def test_laws_and_robots_of_a_user_s_own_do_what_their_page_says() -> None:
    names = names_of("your_own.md")
    assert names["chains"].relative_degree == (3,)
    assert str(names["chains"].singularity) == "c"
    # The robust law holds what is matched and not what is not.
    distances = names["distances"]
    assert max(distances["nominal"], distances["warm winding, robust"]) < 1e-3
    assert distances["warm winding, optimal only"] > 1.0
    assert distances["stronger magnet, robust"] > 0.1
    run = names["followed"]
    late = run.time > 3.0
    assert np.abs(run.state[late, 0] - 0.5 * np.sin(3.0 * run.time[late])).max() < 0.01
    with pytest.raises(gm.GrosmcError, match=r"output 1, R, has no relative degree.*first 3"):
        gm.feedback_linearization(names["motor"].system.equations, h=[names["R"]])
    assert names["deviation"]["grosmc"] < 0.1 * names["deviation"]["lqr"]
    assert any("position servo" in sentence for sentence in names["robot"].notes)
    assert abs(names["swing"].state[-1, 0] - 1.0) < 0.02
    assert "out of the input's reach" in names["held"].designed.declared


def test_a_saved_trajectory_is_the_same_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = names_of("guide.md")
    assert np.array_equal(names["again"].state, names["run"].trajectory.state)
    assert names["unit"] == "rad"


def test_environments_give_the_same_steps_and_the_learned_policy_is_refuted() -> None:
    pytest.importorskip("dm_control")
    pytest.importorskip("gymnasium")
    names = names_of("environments.md")
    # The same steps with the same numbers, in dm_control and in Gymnasium.
    assert names["total"] == names["summed"]
    # The learned policy earns as much as the law, and does not follow the nominal trajectory.
    assert names["gained"](names["gains"], 2.0) > -3.0
    assert names["finding"].verdict.value == "refuted"


@pytest.mark.parametrize(("page", "count"), [("guide.md", 3), ("your_own.md", 1)])
def test_the_case_file_of_a_page_meets_its_requirements(
    page: str, count: int, tmp_path: Path
) -> None:
    (text,) = (block for block in blocks(page, "toml") if "[[requirement]]" in block)
    if "gymnasium:" in text:
        pytest.importorskip("gymnasium")
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    experiment = gm.Experiment.load(tmp_path / "mine.toml")
    judgements = judge_all(experiment.limits, list(experiment.runs()))
    assert len(judgements) == count
    assert all(judgement.kept for judgement in judgements), judgements


def test_the_law_of_the_page_remembers(tmp_path: Path) -> None:
    (law,) = (block for block in blocks("your_own.md", "python") if "def pi" in block)
    (table,) = (block for block in blocks("your_own.md", "toml") if "mine:pi" in block)
    run = '[plant]\nsystem = "servo"\n[run]\nduration = "8 s"\ncontrol_period = "1 ms"\n'
    (tmp_path / "mine.py").write_text(law, encoding="utf-8")
    (tmp_path / "mine.toml").write_text(run + table, encoding="utf-8")
    trajectory = gm.Experiment.load(tmp_path / "mine.toml").run("physics").trajectory
    # Without friction worth the name the rotor swings about the target, within the limit.
    assert np.abs(trajectory.input).max() <= 3.0
    cut = np.abs(trajectory.input) == 3.0
    assert np.any(cut[:-1])
    still = np.diff(trajectory.memory["integral"][: len(cut)])[cut[1 : len(cut)]]
    assert not np.any(still)
    assert np.any(np.diff(trajectory.memory["integral"]))

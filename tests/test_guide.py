"""The code of the guide's pages runs, and what they say of it holds."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

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


@pytest.fixture(scope="module")
def your_own() -> dict[str, Any]:
    return names_of("your_own.md")


def test_the_motor_s_angle_has_relative_degree_three(your_own: dict[str, Any]) -> None:
    assert your_own["chains"].relative_degree == (3,)
    assert your_own["chains"].complete
    assert str(your_own["chains"].singularity) == "c"


def test_the_robust_law_holds_what_is_matched_and_not_what_is_not(your_own: dict[str, Any]) -> None:
    distances = your_own["distances"]
    assert distances["nominal"] < 1e-3
    assert distances["warm winding, robust"] < 1e-3
    assert distances["warm winding, optimal only"] > 1.0
    assert distances["stronger magnet, robust"] > 0.1


def test_the_motor_follows_the_moving_reference(your_own: dict[str, Any]) -> None:
    run = your_own["followed"]
    late = run.time > 3.0
    assert np.abs(run.state[late, 0] - 0.5 * np.sin(3.0 * run.time[late])).max() < 0.01


def test_the_page_says_which_assumption_fails(your_own: dict[str, Any]) -> None:
    import grosmc_mj as gm

    with pytest.raises(gm.GrosmcError, match=r"output 1, R, has no relative degree.*first 3"):
        gm.feedback_linearization(your_own["motor"].system.equations, h=[your_own["R"]])


def test_laws_and_robots_of_the_page_do_what_it_says(your_own: dict[str, Any]) -> None:
    assert your_own["deviation"]["grosmc"] < 0.1 * your_own["deviation"]["lqr"]
    assert any("position servo" in sentence for sentence in your_own["robot"].notes)
    assert abs(your_own["swing"].state[-1, 0] - 1.0) < 0.02
    assert "out of the input's reach" in your_own["held"].designed.declared


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
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.requirements import judge_all

    (text,) = (block for block in blocks(page, "toml") if "[[requirement]]" in block)
    if "gymnasium:" in text:
        pytest.importorskip("gymnasium")
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    experiment = Experiment.load(tmp_path / "mine.toml")
    judgements = judge_all(experiment.limits, list(experiment.runs()))
    assert len(judgements) == count
    assert all(judgement.kept for judgement in judgements), judgements


def test_the_law_of_the_page_remembers(tmp_path: Path) -> None:
    from grosmc_mj.experiments.experiment import Experiment

    (law,) = (block for block in blocks("your_own.md", "python") if "def pi" in block)
    (table,) = (block for block in blocks("your_own.md", "toml") if "mine:pi" in block)
    run = '[plant]\nsystem = "servo"\n[run]\nduration = "8 s"\ncontrol_period = "1 ms"\n'
    (tmp_path / "mine.py").write_text(law, encoding="utf-8")
    (tmp_path / "mine.toml").write_text(run + table, encoding="utf-8")
    trajectory = Experiment.load(tmp_path / "mine.toml").run("physics").trajectory
    # Without friction worth the name the rotor swings about the target, within the limit.
    assert np.abs(trajectory.input).max() <= 3.0
    cut = np.abs(trajectory.input) == 3.0
    assert np.any(cut[:-1])
    still = np.diff(trajectory.memory["integral"][: len(cut)])[cut[1 : len(cut)]]
    assert not np.any(still)
    assert np.any(np.diff(trajectory.memory["integral"]))

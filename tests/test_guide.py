"""Code of the guide's pages: it runs, and its results are those that the pages state."""

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
    """Return the blocks of code of a page."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def names_of(page: str) -> dict[str, Any]:
    """Return the names that a page's code defines."""
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(compile("\n".join(blocks(page, "python")), page, "exec"), names)
    return names


@pytest.fixture(scope="module")
def your_own() -> dict[str, Any]:
    """Names that the code of the page on laws and robots of a user's own defines."""
    return names_of("your_own.md")


def test_a_law_is_designed_for_a_user_s_equations(your_own: dict[str, Any]) -> None:
    assert your_own["chains"].relative_degree == (3,)
    assert str(your_own["chains"].singularity) == "c"


@pytest.mark.parametrize("run", ["nominal", "warm winding, robust"])
def test_the_robust_law_holds_what_is_matched(run: str, your_own: dict[str, Any]) -> None:
    assert your_own["distances"][run] < 1e-3


def test_the_optimal_law_alone_does_not_hold_what_is_matched(your_own: dict[str, Any]) -> None:
    assert your_own["distances"]["warm winding, optimal only"] > 1.0


def test_the_robust_law_does_not_hold_what_is_unmatched(your_own: dict[str, Any]) -> None:
    assert your_own["distances"]["stronger magnet, robust"] > 0.1


def test_a_user_s_law_follows_its_reference(your_own: dict[str, Any]) -> None:
    run = your_own["followed"]
    late = run.time > 3.0
    reference = 0.5 * np.sin(3.0 * run.time[late])
    assert np.abs(run.state[late, 0] - reference).max() < 0.01


def test_an_output_without_relative_degree_is_refused(your_own: dict[str, Any]) -> None:
    equations = your_own["motor"].system.equations
    with pytest.raises(gm.GrosmcError, match=r"output 1, R, has no relative degree.*first 3"):
        gm.feedback_linearization(equations, h=[your_own["R"]])


def test_the_robust_law_deviates_less_on_a_user_s_robot(your_own: dict[str, Any]) -> None:
    assert your_own["deviation"]["grosmc"] < 0.1 * your_own["deviation"]["lqr"]


def test_a_user_s_robot_says_which_actuators_were_replaced(your_own: dict[str, Any]) -> None:
    assert any("position servo" in sentence for sentence in your_own["robot"].notes)


def test_a_user_s_robot_swings_to_its_target(your_own: dict[str, Any]) -> None:
    assert abs(your_own["swing"].state[-1, 0] - 1.0) < 0.02


def test_a_law_declares_what_is_out_of_the_input_s_reach(your_own: dict[str, Any]) -> None:
    assert "out of the input's reach" in your_own["held"].designed.declared


def test_a_saved_trajectory_is_the_same_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = names_of("guide.md")
    assert np.array_equal(names["again"].state, names["run"].trajectory.state)
    assert names["unit"] == "rad"


@pytest.fixture(scope="module")
def environments() -> dict[str, Any]:
    """Names that the code of the page on environments defines."""
    pytest.importorskip("dm_control")
    pytest.importorskip("gymnasium")
    return names_of("environments.md")


def test_both_environments_give_the_same_steps(environments: dict[str, Any]) -> None:
    assert environments["total"] == environments["summed"]


def test_the_learned_policy_earns_as_much_as_the_law(environments: dict[str, Any]) -> None:
    assert environments["gained"](environments["gains"], 2.0) > -3.0


def test_the_learned_policy_does_not_follow_the_nominal_trajectory(
    environments: dict[str, Any],
) -> None:
    assert environments["finding"].verdict.value == "refuted"


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


SERVO_RUN = """\
[plant]
system = "servo"
[run]
duration = "8 s"
control_period = "1 ms"
"""


@pytest.fixture(scope="module")
def integrating(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A run of the page's law with an integrator and a limit."""
    folder = tmp_path_factory.mktemp("law")
    (law,) = (block for block in blocks("your_own.md", "python") if "def pi" in block)
    (table,) = (block for block in blocks("your_own.md", "toml") if "mine:pi" in block)
    (folder / "mine.py").write_text(law, encoding="utf-8")
    (folder / "mine.toml").write_text(SERVO_RUN + table, encoding="utf-8")
    return gm.Experiment.load(folder / "mine.toml").run("physics").trajectory


def test_the_law_of_the_page_keeps_its_limit(integrating: Any) -> None:
    # Without friction worth the name the rotor swings about the target, within the limit.
    assert np.abs(integrating.input).max() <= 3.0


def test_the_law_of_the_page_integrates_unless_it_is_limited(integrating: Any) -> None:
    limited = np.abs(integrating.input) == 3.0
    assert np.any(limited[:-1])
    integral = integrating.memory["integral"]
    assert not np.any(np.diff(integral[: len(limited)])[limited[1 : len(limited)]])
    assert np.any(np.diff(integral))

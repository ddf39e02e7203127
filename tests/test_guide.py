"""The code of the guide's pages runs, and does what they say."""

from __future__ import annotations

import functools
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grosmc_mj as gm
from grosmc_mj.experiments.requirements.judging import judge_runs
from grosmc_mj.simulation.trajectory import Status

pytestmark = pytest.mark.slow

DOCS = Path(__file__).parents[1] / "docs"


def blocks(page: str, language: str) -> list[str]:
    """Return the blocks of code of a page in a language."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def block_with(page: str, language: str, words: str) -> str:
    """Return the one block of code of a page that has these words."""
    (block,) = [block for block in blocks(page, language) if words in block]
    return block


# The code of a page runs for some seconds, and several tests ask for its names.
@functools.cache
def names_of(page: str) -> dict[str, Any]:
    """Run the code of a page; return the names that it defines."""
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(compile("\n".join(blocks(page, "python")), page, "exec"), names)
    return names


# Laws and robots of a user's own.


def test_the_motor_of_the_page_has_relative_degree_3() -> None:
    names = names_of("your_own.md")
    assert names["chains"].relative_degree == (3,)
    assert str(names["chains"].singularity) == "c"


def test_the_resistance_has_no_relative_degree() -> None:
    names = names_of("your_own.md")
    with pytest.raises(gm.GrosmcError, match=r"output 1, R, has no relative degree.*first 3"):
        gm.feedback_linearization(names["motor"].system.symbolic_equations, h=[names["R"]])


def test_the_robust_law_holds_a_matched_change() -> None:
    distances = names_of("your_own.md")["distances"]
    assert distances["nominal"] < 1e-3
    assert distances["warm winding, robust"] < 1e-3


def test_the_optimal_law_alone_does_not_hold_a_matched_change() -> None:
    assert names_of("your_own.md")["distances"]["warm winding, optimal only"] > 1.0


def test_the_robust_law_does_not_hold_an_unmatched_change() -> None:
    assert names_of("your_own.md")["distances"]["stronger magnet, robust"] > 0.1


def test_the_motor_follows_its_reference() -> None:
    run = names_of("your_own.md")["followed"]
    late = run.time > 3.0
    reference = 0.5 * np.sin(3.0 * run.time[late])
    assert np.abs(run.state[late, 0] - reference).max() < 0.01


def test_the_robust_law_of_the_page_deviates_ten_times_less() -> None:
    deviation = names_of("your_own.md")["deviation"]
    assert deviation["grosmc"] < 0.1 * deviation["lqr"]


def test_the_robot_of_the_page_reaches_its_target() -> None:
    names = names_of("your_own.md")
    assert any("position servo" in sentence for sentence in names["robot"].notes)
    assert abs(names["swing"].state[-1, 0] - 1.0) < 0.02


def test_a_load_that_no_input_reaches_is_named() -> None:
    assert "out of the input's reach" in names_of("your_own.md")["held"].designed.declared


def test_the_law_of_the_page_stops_its_integral_at_the_limit(tmp_path: Path) -> None:
    law = block_with("your_own.md", "python", "def pi")
    table = block_with("your_own.md", "toml", "mine:pi")
    run = '[plant]\nsystem = "servo"\n[run]\nduration = "8 s"\ncontrol_period = "1 ms"\n'
    (tmp_path / "mine.py").write_text(law, encoding="utf-8")
    (tmp_path / "mine.toml").write_text(run + table, encoding="utf-8")
    trajectory = gm.Experiment.load(tmp_path / "mine.toml").run("physics").trajectory

    # With hardly any friction the rotor swings about the target, within the limit.
    size = np.abs(trajectory.input)
    assert size.max() <= 3.0
    at_limit = size == 3.0
    assert np.any(at_limit[:-1])

    steps = np.diff(trajectory.memory["integral"])
    assert np.any(steps)
    assert not np.any(steps[: len(at_limit) - 1][at_limit[1:]])


# Other pages.


def test_a_saved_trajectory_is_the_same_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = names_of("guide.md")
    assert np.array_equal(names["again"].state, names["run"].trajectory.state)
    assert names["unit"] == "rad"


def names_of_environments() -> dict[str, Any]:
    pytest.importorskip("dm_control")
    pytest.importorskip("gymnasium")
    return names_of("environments.md")


def test_dm_control_gives_the_steps_of_gymnasium() -> None:
    names = names_of_environments()
    assert names["total"] == names["summed"]


def test_a_learned_policy_earns_as_much_as_the_law_away_from_the_nominal_trajectory() -> None:
    """The case requires of GROSMC that it stays within 1 mrad of it."""
    names = names_of_environments()
    assert names["gained"](names["gains"], 2.0) > -3.0
    assert names["tested"].status is Status.COMPLETED
    assert names["deviation"] > 1e-2


@pytest.mark.parametrize(("page", "count"), [("guide.md", 3), ("your_own.md", 1)])
def test_the_case_file_of_a_page_meets_its_requirements(
    page: str, count: int, tmp_path: Path
) -> None:
    text = block_with(page, "toml", "[[requirement]]")
    if "gymnasium:" in text:
        pytest.importorskip("gymnasium")
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    experiment = gm.Experiment.load(tmp_path / "mine.toml")
    judgements = judge_runs(experiment.limits, list(experiment.runs()))
    assert len(judgements) == count
    assert all(judgement.kept for judgement in judgements), judgements

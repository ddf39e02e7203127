"""The code of the guide runs, and what the guide says of it holds."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

GUIDE = Path(__file__).parents[1] / "docs" / "guide.md"


@pytest.fixture(scope="module")
def scope() -> dict[str, Any]:
    """What the guide's code leaves behind."""
    blocks = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(compile("\n".join(blocks), str(GUIDE), "exec"), names)
    return names


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

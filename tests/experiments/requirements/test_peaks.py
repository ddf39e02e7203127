"""A limit that is missed says when, and by which of several outputs, it is missed most."""

from __future__ import annotations

import numpy as np
import pytest
from cases import case

from grosmc_mj.experiments.requirements.magnitudes import largest_at

TIME = np.array([0.0, 0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("rows", "names", "after", "words"),
    [
        ([[0, -3, 1, 2]], ["angle"], 0.0, "peak at 0.1 s"),
        ([[0, -3, 1, 2]], ["angle"], 0.2, "peak at 0.3 s"),
        ([[1, 2, 0, 0], [0, 0, -2.5, 0]], ["hip", "knee"], 0.0, "peak of knee at 0.2 s"),
    ],
)
def test_the_largest_magnitude_has_its_instant_and_its_signal(
    rows: list[list[float]], names: list[str], after: float, words: str
) -> None:
    assert largest_at(TIME, [np.array(row) for row in rows], names, after) == words


def test_a_judgement_says_it_of_a_limit_that_is_missed() -> None:
    """The servo's error is 1 rad at the start, and its speed grows during the short run."""
    limits = [
        {"stays_within": "0.5 rad"},
        {"stays_within": "2 rad"},
        {"stays_within": "1 mrad/s", "state": "rotor speed"},
    ]
    run = case("servo", requirement=limits).run("physics", "lqr")
    notes = [one.note for one in run.requirements]
    assert notes == ["peak at 0 s", "", "peak at 0.02 s"]

"""Angles of a log that jump by a turn: the sample after the first jump is named."""

from __future__ import annotations

import numpy as np

from grosmc_mj.experiments.logs.clean import turn_notes
from grosmc_mj.theory.plants import find_system


def test_the_first_jump_is_at_the_sample_after_it() -> None:
    time = np.arange(8.0)
    angle = np.array([3.0, 3.1, 3.1 - 2 * np.pi, -3.1, -3.0, -3.0 + 2 * np.pi, 3.2, 3.2])
    (note,) = turn_notes(time, {"rotor angle": angle}, find_system("servo").states)
    assert note.startswith("rotor angle jumps by a turn, 2 times, first at 2 s")

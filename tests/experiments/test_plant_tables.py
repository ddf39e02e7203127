"""Files of plants about an operating point, and of laws that believe in other equations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from case_texts import BALL, BEAM, FURUTA, MAGLEV, load

from grosmc_mj.physics.edits import AddedMass


def test_runs_start_and_outputs_are_held_at_the_operating_point(tmp_path: Path) -> None:
    experiment = load(tmp_path, MAGLEV.replace('"lqr"', '"fl-lqr"'))
    assert experiment.nominal.at is not None
    np.testing.assert_array_equal(experiment.case.x0, experiment.nominal.at.x)
    run = experiment.run().trajectory
    np.testing.assert_allclose(run.state - run.state[0], 0, atol=1e-9)
    np.testing.assert_allclose(run.input, experiment.nominal.at.u[0], rtol=1e-6)
    moved = load(tmp_path, MAGLEV.replace("[run]", '[run]\nstart = { gap = "12 mm" }'))
    assert moved.case.x0[0] == pytest.approx(0.012)
    assert moved.case.x0[2] == experiment.case.x0[2]


def test_a_law_believes_in_the_design_s_equations(tmp_path: Path) -> None:
    design = f'[design]\nplant = "{BALL}:approximation"\n[run]'
    experiment = load(tmp_path, BEAM.replace("[run]", design))
    law = experiment.law("corrected", "fl-lqr")
    assert law.coordinates.linearization.relative_degree == (4,)
    assert law.designed.error.system.name == "ball_beam_approximated"
    assert experiment.plant("corrected").system.name == "ball_beam"


def test_a_law_of_ones_own_is_weighed_about_the_operating_point(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "def held(t, x, memory, p):\n"
        "    return p.reference.u[0] - p.gain * (x[0] - p.reference.x[0])\n"
    )
    text = MAGLEV.replace('"lqr"', '"mine:held"\ngain = -300')
    result = load(tmp_path, text.replace("[run]", '[run]\nstart = { gap = "11 mm" }')).run()
    v = result.trajectory.memory["v"][:, 0]
    assert v[0] == pytest.approx(300 * 0.001)
    point = result.experiment.nominal.at
    assert point is not None
    assert result.trajectory.input[0] - v[0] == pytest.approx(point.u[0])


def test_a_load_is_where_the_file_says(tmp_path: Path) -> None:
    edit = '[[edit]]\nbody = "rod"\nadded_mass = "20 g"\nat = ["1 cm", "2 cm", "3 cm"]\n'
    (load_edit,) = load(tmp_path, FURUTA.replace("grosmc", "lqr") + edit).case.edits
    assert load_edit == AddedMass("rod", 0.02, (0.01, 0.02, 0.03))

"""Files of plants about an operating point, laws of other equations, implausible numbers."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from campaign_cases import run
from case_texts import BALL, BEAM, FURUTA, MAGLEV, OWN, STEP, load

from grosmc_mj.errors import ImplausibleWarning
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.physics.edits import AddedMass


def test_runs_start_are_held_and_weighed_at_the_operating_point(tmp_path) -> None:
    experiment = load(tmp_path, MAGLEV.replace('"lqr"', '"fl-lqr"'))
    point = experiment.nominal.at
    assert point is not None
    np.testing.assert_array_equal(experiment.case.x0, point.x)
    run = experiment.run().trajectory
    np.testing.assert_allclose(run.state - run.state[0], 0, atol=1e-9)
    np.testing.assert_allclose(run.input, point.u[0], rtol=1e-6)
    # A law of one's own, from another start.
    (tmp_path / "mine.py").write_text(
        "def held(t, x, memory, p):\n"
        "    return p.reference.u[0] - p.gain * (x[0] - p.reference.x[0])\n"
    )
    text = MAGLEV.replace("[run]", '[run]\nstart = { gap = "11 mm" }')
    moved = load(tmp_path, text.replace('"lqr"', '"mine:held"\ngain = -300'))
    assert (moved.case.x0[0], moved.case.x0[2]) == (pytest.approx(0.011), point.x[2])
    trajectory = moved.run().trajectory
    v = trajectory.memory["v"][:, 0]
    assert v[0] == pytest.approx(300 * 0.001)
    assert trajectory.input[0] - v[0] == pytest.approx(point.u[0])


def test_a_law_believes_in_the_design_s_equations(tmp_path) -> None:
    design = f'[design]\nplant = "{BALL}:approximation"\n[run]'
    experiment = load(tmp_path, BEAM.replace("[run]", design))
    law = experiment.law("corrected", "fl-lqr")
    assert law.coordinates.linearization.relative_degree == (4,)
    assert law.designed.error.system.name == "ball_beam_approximated"
    assert experiment.plant("corrected").system.name == "ball_beam"


def test_a_load_is_where_the_file_says(tmp_path) -> None:
    edit = '[[edit]]\nbody = "rod"\nadded_mass = "20 g"\nat = ["1 cm", "2 cm", "3 cm"]\n'
    edits = load(tmp_path, FURUTA.replace("grosmc", "lqr") + edit).case.edits
    assert edits == (AddedMass("rod", 0.02, (0.01, 0.02, 0.03)),)


def test_edits_of_one_parameter_multiply_one_after_the_other(tmp_path) -> None:
    edit = '[[edit]]\nparameter = "m"\nscale = 1.1\n'
    experiment = load(tmp_path, OWN + edit)
    nominal = experiment.nominal.plant.parameters.m
    assert experiment.plant("corrected").parameters.m == 1.1 * (1.5 * nominal)


def test_a_disturbance_of_zero_acts_on_nothing_but_ends_the_transient(tmp_path) -> None:
    zero = """[[disturbance]]
body = "rotor"
torque = ["0 N m", "0 N m", "0 N m"]
profile = "pulse"
start = "0.1 s"
stop = "0.2 s"
"""
    disturbed, free = load(tmp_path, CASE + zero), load(tmp_path, CASE)
    assert (disturbed.case.onset, free.case.onset) == (0.1, np.inf)
    with_zero, without = (one.run().trajectory.state for one in (disturbed, free))
    np.testing.assert_array_equal(with_zero, without)


CASE = STEP + 'stays_within = "1e9 rad"\n'


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (
            '[[edit]]\nbody = "rotor"\nmass_scale = 1733',
            "edit of 'rotor': mass_scale = 1733 is implausible; usual: 0.01 to 100",
        ),
        (
            '[[motor]]\ninput = "current"\nadded = false\nconstant = "7.68e-3 N m/A"\n'
            'resistance = "2.6 ohm"\nratio = 70\nvoltage = "24 kV"',
            "motor of 'current': voltage = 24000 V is implausible; usual: 0.001 to 1000 V",
        ),
        (
            '[run.start]\n"rotor angle" = "1e6 rad"',
            "start: rotor angle = 1e+06 rad is implausible; usual: 0 to 10000 rad",
        ),
    ],
)
def test_an_implausible_number_is_a_warning_and_a_line(tmp_path, capsys, more, line) -> None:
    with pytest.warns(ImplausibleWarning) as caught:
        load(tmp_path, CASE + more)
    assert [str(item.message) for item in caught] == [f"{tmp_path / 'mine.toml'}: {line}"]
    capsys.readouterr()
    run("list", tmp_path / "mine.toml")
    assert f"grosmc-mj: {tmp_path / 'mine.toml'}: {line}\n" in capsys.readouterr().err


@pytest.mark.slow
def test_every_shipped_case_can_be_prepared_and_is_plausible() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for path in shipped_files().values():
            assert Experiment.load(path).limits, f"{path} requires nothing"

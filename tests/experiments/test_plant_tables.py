"""What [plant] at, [plant] model, [design] and an uncertainty of states may say, and what not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grosmc_mj.errors import GrosmcError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.physics.edits import AddedMass

MAGLEV = """
[plant]
plant = "grosmc_mj.cases.maglev.maglev:plant"
{at}
[run]
duration = "0.01 s"
[task]
Q = [1e8, 1e5, 10]
R = 1e-3
[[controller]]
law = "{law}"
{numbers}
"""
BEAM = """
[plant]
plant = "grosmc_mj.cases.ball_beam.ball_beam:plant"
{at}
{design}
[run]
duration = "0.01 s"
[task]
Q = {Q}
R = 0.1
[[controller]]
law = "{law}"
"""
FURUTA = """
[plant]
model = "{model}"
{at}
[run]
duration = "0.01 s"
[task]
Q = [1, 5, 0.02, 0.02]
R = 100
{task}
[[controller]]
law = "{law}"
{numbers}
"""
SHIPPED = Path(Experiment.load("furuta/heavier").path).with_name("furuta.xml")
AT = 'at = { gap = "10 mm" }'
TRUE = "grosmc_mj.cases.ball_beam.ball_beam"


def maglev(at: str = AT, law: str = "lqr", numbers: str = "") -> str:
    return MAGLEV.format(at=at, law=law, numbers=numbers)


def beam(at: str = "", design: str = "", Q: str = "[10, 10, 1, 1]", law: str = "fl-lqr") -> str:
    return BEAM.format(at=at, design=design, Q=Q, law=law)


def furuta(model: str = "furuta.xml", at: str = "", task: str = "", law: str = "grosmc",
           numbers: str = "") -> str:  # fmt: skip
    return FURUTA.format(model=model, at=at, task=task, law=law, numbers=numbers)


def designed(believed: str) -> str:
    return f'[design]\nplant = "{believed}"'


def load(text: str, folder: Path) -> Experiment:
    (folder / "furuta.xml").write_text(SHIPPED.read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    return Experiment.load(folder / "mine.toml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (maglev(at='at = { gap = "10" }'), 'plant: at: gap: "10" has no unit'),
        (maglev(at='at = { gat = "10 mm" }'), "unknown state 'gat': did you mean 'gap'?"),
        (maglev(at='at = { current = "0 A", gap = "10 mm" }'), "plant: at: maglev rests nowhere"),
        (maglev(law="linear-grosmc", numbers="uncertainty = 1"), "must be a table with body"),
        (maglev(law="linear-grosmc", numbers='uncertainty = { mas = 2 }'), "did you mean 'mass'?"),
        (maglev(law="linear-grosmc", numbers='uncertainty = { mass = "2" }'), "must be finite"),
        (maglev(law="linear-grosmc", numbers='uncertainty = { mass = 2 }'), "scale a parameter"),
        (maglev(law="linear-grosmc", numbers='uncertainty = { scales = { R = 2 } }'), "[least, "),
        (maglev(law="linear-grosmc", numbers='uncertainty = { body = 2 }'), "must be a name"),
        (maglev(law="linear-grosmc", numbers="limit = -1"), "limit = -1 must be positive"),
        (beam(Q="[10, 10, 1]"), "of position, of relative degree (3,), is singular"),
        (beam(Q="[10, 10, 1]", law="lqr"), "feedback linearization is not possible about"),
        (beam(Q="[10, 10, 1]", law="grosmc"), "[plant] at"),
        (beam(at='at = { angle = "10 deg" }', law="lqr"), "rests nowhere near"),
        (beam(design=designed(f"{TRUE}:nothing")), "unknown name in"),
        (beam(design=designed("grosmc_mj.cases.maglev.maglev:plant")), "has the states"),
        (beam(design=designed(TRUE)), "must be module:name"),
        (furuta(law="pd"), "unknown law 'pd': valid: lqr, grosmc, module:name"),
        (furuta(task='reference = ["1", "2"]'), "all states are held at the operating point"),
        (maglev().replace("R = 1e-3", 'R = 1\nreference = ["1"]'), "under lqr all states are held"),
        (furuta(task=f"[design]\nplant = '{TRUE}:plant'"), "designed from MuJoCo's own dynamics"),
        (furuta(model="nowhere:furuta.xml"), "nowhere, which is not installed; run: pip install"),
        (furuta(model="numpy:furuta.xml"), "the installed numpy has no file 'furuta.xml'"),
        (furuta(model="../a:furuta.xml"), "must be a file, or package:path of one"),
        (furuta(at='at = { rod = "90 deg" }'), "furuta rests nowhere near"),
        (furuta(numbers='uncertainty = { body = "rot", mass = 2 }'), "did you mean 'rod'?"),
        (furuta(numbers='uncertainty = { body = "no", push = 2 }'), "has no body 'no'"),
        (furuta(numbers="G = [[1, 0, 0, 0]]"), "is singular"),
    ],
)  # fmt: skip
def test_one_line_says_what_is_wrong(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(GrosmcError) as refused:
        load(text, tmp_path)
    assert "mine.toml: " in str(refused.value)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_runs_start_and_outputs_are_held_at_the_operating_point(tmp_path: Path) -> None:
    experiment = load(maglev(law="fl-lqr"), tmp_path)
    assert experiment.nominal.at is not None
    np.testing.assert_array_equal(experiment.case.x0, experiment.nominal.at.x)
    run = experiment.run().trajectory
    np.testing.assert_allclose(run.state - run.state[0], 0, atol=1e-9)
    np.testing.assert_allclose(run.input, experiment.nominal.at.u[0], rtol=1e-6)
    moved = load(maglev().replace("[run]", '[run]\nstart = { gap = "12 mm" }'), tmp_path)
    assert moved.case.x0[0] == pytest.approx(0.012)
    assert moved.case.x0[2] == experiment.case.x0[2]


def test_a_law_believes_in_the_design_s_equations(tmp_path: Path) -> None:
    experiment = load(beam(design=designed(f"{TRUE}:approximation")), tmp_path)
    law = experiment.law("corrected", "fl-lqr")
    assert law.coordinates.linearization.relative_degree == (4,)
    assert law.designed.error.system.name == "ball_beam_approximated"
    assert experiment.plant("corrected").system.name == "ball_beam"


def test_a_law_of_ones_own_is_weighed_about_the_operating_point(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "def held(t, x, memory, p):\n"
        "    return p.reference.u[0] - p.gain * (x[0] - p.reference.x[0])\n"
    )
    text = maglev(law="mine:held", numbers="gain = -300")
    result = load(text.replace("[run]", '[run]\nstart = { gap = "11 mm" }'), tmp_path).run()
    v = result.trajectory.memory["v"][:, 0]
    assert v[0] == pytest.approx(300 * 0.001)
    point = result.experiment.nominal.at
    assert point is not None
    assert result.trajectory.input[0] - v[0] == pytest.approx(point.u[0])


def test_a_load_is_where_the_file_says(tmp_path: Path) -> None:
    edit = '[[edit]]\nbody = "rod"\nadded_mass = "20 g"\nat = ["1 cm", "2 cm", "3 cm"]\n'
    (load_edit,) = load(furuta(law="lqr") + edit, tmp_path).case.edits
    assert load_edit == AddedMass("rod", 0.02, (0.01, 0.02, 0.03))

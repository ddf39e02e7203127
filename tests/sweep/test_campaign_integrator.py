"""What steps a campaign's plants: the model's own integrator, and what another makes of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from campaign_cases import DEVIATION, LQR, servo
from numpy.typing import NDArray

from grosmc_mj import cli
from grosmc_mj.arrays import Array
from grosmc_mj.experiments.file.shipped import campaign_files
from grosmc_mj.physics.files import load_model
from grosmc_mj.sweep.campaign import Campaign, Specification, specification_of
from grosmc_mj.sweep.screening import evaluate

# Of 256 arms drawn with seed 7, those of which GROSMC keeps more under implicitfast at 1 ms.
NEAR_A_LIMIT = (2, 20, 75, 76, 131, 154, 165, 232)


@pytest.mark.parametrize("name", campaign_files())
def test_a_shipped_campaign_steps_as_its_model_says(name: str) -> None:
    asked = specification_of(name).file
    assert asked.plant.system is not None
    own = load_model(asked.plant.system).opt.integrator
    assert own == mujoco.mjtIntegrator.mjINT_RK4
    assert asked.run.integrator in (None, "RK4")


def test_a_campaign_says_that_it_steps_otherwise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "small.toml"
    path.write_text(servo(laws=LQR, limits=DEVIATION))
    said = {}
    for integrator in ("RK4", "implicitfast"):
        asked = ("campaign", str(path), "--runs", "2", "--integrator", integrator, "--no-figures")
        with pytest.raises(SystemExit) as stop:
            cli.main([*asked, "--out", str(tmp_path / integrator)])
        assert stop.value.code == cli.DONE
        said[integrator] = "instead of the model's own" in capsys.readouterr().err
    assert said == {"RK4": False, "implicitfast": True}


def margins(specification: Specification) -> tuple[NDArray[np.bool_], Array]:
    """Of the plants near a limit under GROSMC: what they keep, and the margin of the deviation.

    Returns:
        (plants, requirements), and (plants,) [rad].
    """
    asked = Campaign.of(specification)
    values = np.concatenate([asked.values(range(run, run + 1)) for run in NEAR_A_LIMIT])
    found = evaluate(asked, "grosmc", values)
    names = [name for name in found.columns if name.startswith("margin ")]
    kept = np.array([found[name] >= 0 for name in names]).T
    return kept, found["margin deviation_below"]


@pytest.mark.slow
def test_the_arm_is_judged_as_in_steps_a_tenth_as_long_by_rk4_and_more_kindly_by_implicitfast() -> (
    None
):
    """But for what is nearer to its limit than RK4's own error."""
    asked = specification_of("arm", runs=256, seed=7, controllers=("grosmc",))
    fine = replace(asked, text=asked.text.replace("[run]\n", '[run]\ntimestep = "0.1 ms"\n'))
    assert fine.file.run.timestep == 1e-4
    (expected, exact), (kept, own) = margins(fine), margins(asked)
    kinder, fast = margins(replace(asked, integrator="implicitfast"))
    assert np.abs(own - exact).max() < 0.5e-3
    assert (kept != expected).sum() <= 1
    assert np.all(fast - exact > np.abs(own - exact))
    assert np.all(kinder >= kept)
    assert (kinder != kept).sum(axis=1).tolist() == [1, 1, 1, 1, 1, 2, 1, 1]

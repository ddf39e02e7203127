"""A requirement means the same in a run, in a campaign and in a study."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cases
import pytest

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements.judging import Judgement
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.studies.campaign.batch import evaluate
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.tolerance.tolerance import tolerance_study
from grosmc_mj.studies.trials import Trial, Trials


def at_rest(folder: Path, **band: str) -> str:
    """A case file of a rotor that is pushed from where it shall be.

    Args:
        folder: Its folder.
        band: The band of its settling time: without it there is no error to be a share of.
    """
    push = {"body": "rotor", "torque": ["0 N m", "1 N m", "0 N m"], "label": "load"}
    path = cases.write(
        folder,
        run={"duration": "3 s", "control_period": "1 ms", "start": {"rotor angle": "1 rad"}},
        disturbance={**push, "profile": "pulse", "start": "0 s", "stop": "0.1 s"},
        uncertain={"number": "edit.rotor.mass_scale", "values": [1, 3]},
        computing={"delay": "2 ms"},
        requirement={"settles_within": "2 s", **band},
    )
    return str(path)


@pytest.mark.parametrize("load", [Experiment.load, Campaign.load, tolerance_study])
def test_a_settling_time_at_rest_needs_a_band(load: Callable[[str], Any], tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="2 % of the error at the start, and runs start wi"):
        load(at_rest(tmp_path))


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A case file that has the band of its settling time."""
    return at_rest(tmp_path_factory.mktemp("at_rest"), band="20 mrad")


@pytest.fixture(scope="module")
def judgement(file: str) -> Judgement:
    """The judgement of a run."""
    (judgement,) = Experiment.load(file).run(law="lqr").requirements
    return judgement


def test_a_run_settles_after_its_push(judgement: Judgement) -> None:
    assert judgement.margin is not None
    assert 0.1 < (judgement.measured or 0.0) < 2.5


def test_a_settling_time_of_a_campaign_is_that_of_a_run(file: str, judgement: Judgement) -> None:
    campaign = Campaign.load(file, runs=1)
    nominal = evaluate(campaign, "lqr", campaign.family.nominal[None])
    margin = nominal["margin settles_within"][0]
    assert margin == pytest.approx(judgement.margin, rel=1e-12)


def test_a_settling_time_of_a_study_is_that_of_a_run(file: str, judgement: Judgement) -> None:
    studied = tolerance_study(file, ["lqr"])
    (law,) = studied.laws
    loaded = studied.conditions[1]
    trials = Trials("physics", studied.limits, built=studied.bench)
    (verdict,) = trials.results([(Trial(law, loaded, studied.bench), 0)])
    assert verdict.share == pytest.approx(judgement.share, rel=1e-12)

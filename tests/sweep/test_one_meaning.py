"""A requirement means the same in a run, in a campaign and in a study."""

from pathlib import Path

import pytest
from campaign_cases import INERTIA, LQR, PUSH, case

from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.studies.tolerance import Trial, Trials, setting
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.screening import evaluate

# A push moves the rotor from where it shall be; without `band` there is no error to be a share of.
PULSE = 'profile = "pulse"\nstart = "0 s"\nstop = "0.1 s"\n'
SETTLES = '[computing]\ndelay = "2 ms"\n[[requirement]]\nsettles_within = "2 s"\n'
AT_REST = case(
    "servo", INERTIA, duration=3, start='{ "rotor angle" = "1 rad" }', laws=LQR,
    disturbances=PUSH + PULSE, limits=SETTLES,
)  # fmt: skip


def test_a_settling_time_is_one_in_run_campaign_and_tolerance(tmp_path: Path) -> None:
    file = tmp_path / "at_rest.toml"
    file.write_text(AT_REST, encoding="utf-8")
    for load in (Experiment.load, Campaign.load, setting):
        with pytest.raises(ArgumentError, match="2 % of the error at the start, and runs start wi"):
            load(str(file))
    file.write_text(f'{AT_REST}band = "20 mrad"\n', encoding="utf-8")
    (judgement,) = Experiment.load(file).run(law="lqr").requirements
    assert judgement.margin is not None
    assert 0.1 < (judgement.measured or 0.0) < 2.5
    campaign = Campaign.load(str(file), runs=1)
    nominal = evaluate(campaign, "lqr", campaign.family.nominal[None])
    studied = setting(str(file), ["lqr"])
    (law,), loaded = studied.laws, studied.conditions[1]
    trials = Trials(law, "physics", {loaded: studied.limits(law, loaded)}, studied.bench, 1)
    (trial,) = trials.results([(Trial(loaded, studied.bench), 0)])
    margins = [nominal["margin settles_within"][0], 2.0 * trial.margin]
    assert margins == pytest.approx([judgement.margin] * 2, rel=1e-12)

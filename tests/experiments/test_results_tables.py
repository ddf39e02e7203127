"""Tables of runs."""

from __future__ import annotations

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.tables import results_tables


def test_each_system_has_a_table_of_its_own_runs() -> None:
    runs = [
        Experiment.load(f"{system}/nominal").varied(duration=0.02).run("corrected", law)
        for system, law in (("servo", "lqr"), ("arm", "lqr"), ("arm", "grosmc"))
    ]
    servo, arm = results_tables(runs)
    assert str(servo.title).startswith(runs[0].trajectory.system.title)
    assert str(arm.title).startswith(runs[1].trajectory.system.title)
    assert (len(servo.rows), len(arm.rows)) == (1, 2)
    assert [row[2] for row in arm.rows] == ["lqr", "grosmc"]

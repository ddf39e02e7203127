"""TEMPORARY: a log as a run that requirements judge (replaced by that of branch log)."""

from __future__ import annotations

import numpy as np

from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.logs.log import Log
from grosmc_mj.requirements.optimum import compare_with_optimum
from grosmc_mj.requirements.run_metrics import measure
from grosmc_mj.simulation.trajectory import Status, Trajectory


def logged_run(experiment: Experiment, log: Log, law: str) -> RunResult:
    plant = experiment.nominal.truest
    controller = experiment.law(plant, law)
    system = experiment.nominal.system
    h = log.sampling
    time = np.arange(int(log.time[-1] / h + 1e-6) + 1) * h
    state = np.column_stack(
        [
            np.interp(time, log.time, log.states[s.name]) if s.name in log.states else 0 * time
            for s in system.states
        ]
    )
    rows = np.searchsorted(log.time, time + 1e-9, side="right") - 1
    u = log.inputs[rows[:-1]]
    if u.shape[1] == 1:
        u = u[:, 0]
    run = Trajectory(
        system=system,
        time=time,
        state=state,
        command=u,
        input=u,
        sliding=None,
        weighed=u,
        memory=np.zeros(len(u), np.dtype([("v", float)])),
        wrench=None,
        physics=None,
        status=Status.COMPLETED,  # pyright: ignore
        valid_until=np.float64(time[-1]),  # pyright: ignore
    )
    comparison = compare_with_optimum(run, controller)
    return RunResult(
        case=experiment,
        plant=plant,
        controller=controller,
        trajectory=run,
        comparison=comparison,
        metrics=measure(run, controller, comparison),
        true=experiment.plant(plant),
    )

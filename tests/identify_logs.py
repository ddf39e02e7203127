"""Shipped logs of identification, the machines behind them, and fits that no search has made."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import grosmc_mj as gm
from benchmarks import logs
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.experiments.logs.read import read_log
from grosmc_mj.identify.fit import Fit
from grosmc_mj.identify.replay import Predictor

LOGS = Path(gm.__file__).parent / "experiments/cases/logs"
# Mass scale, damping [N m s/rad] and delay [s] of the servo behind servo.csv, which is machine 0
# of benchmarks/coverage.py.
TRUE = np.array([1.78768, 0.0273276, 6.45e-3])
# Factor of the payload and damping [N m s/rad] of the arm behind arm.csv.
ARM_TRUE = [logs.PAYLOAD / 0.02, logs.DAMPING]


@cache
def to_identify() -> Experiment:
    """The case that the servo of the log is fitted to."""
    return Experiment.load("logs/servo")


@cache
def servo_log() -> Log:
    """Current and angle of a servo for 4 s, with a noise of 1 mrad."""
    return read_log(LOGS / "servo.csv", to_identify().nominal.system, None)


def short_arm_log(folder: Path) -> Path:
    """The first two seconds of the log of the arm."""
    path = folder / "arm.csv"
    lines = (LOGS / "arm.csv").read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(lines[:1001]) + "\n", encoding="utf-8")
    return path


def windows(log: Log) -> Predictor:
    """Predictions of 1 s each."""
    return Predictor.of(log, horizon=1.0, timestep=1e-3)


def fit_of(parameters: Any, values: Any, **others: Any) -> Fit:
    """A fit with these values, and others of its attributes."""
    count = len(values)
    attributes = {
        "fitted": np.ones(count, bool),
        "covariance": np.diag(np.full(count, 1e-4)),
        "half": np.full(count, 0.02),
        "unseen": [],
        "scales": {},
        "timesteps": (1e-3, 5e-4),
        "shift": np.zeros(count),
        "left": np.zeros(count),
        "converged": True,
        "finished": True,
    }
    return Fit(parameters=parameters, values=np.array(values, float), **(attributes | others))


def fit_of_arm(parameters: Any, *_: Any, **__: Any) -> Fit:
    """The fit of the arm, in place of a search."""
    return fit_of(parameters, ARM_TRUE, scales={"joint angle": logs.NOISE})

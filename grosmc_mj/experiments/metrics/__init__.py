"""Metrics: their folds, the recorded run beside its optimum, and all that is measured on it."""

from grosmc_mj.experiments.metrics.comparison import Comparison, compare_with_optimum
from grosmc_mj.experiments.metrics.folds import DWELL, SETTLING_BAND
from grosmc_mj.experiments.metrics.recorded import (
    METRICS,
    Metric,
    measure,
    overshoot,
    settling_time,
)

__all__ = [
    "DWELL",
    "METRICS",
    "SETTLING_BAND",
    "Comparison",
    "Metric",
    "compare_with_optimum",
    "measure",
    "overshoot",
    "settling_time",
]

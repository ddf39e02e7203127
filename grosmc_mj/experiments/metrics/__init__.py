"""Metrics: their folds, the recorded run beside its optimum, and all that is measured on it."""

from grosmc_mj.experiments.metrics.definitions import SETTLING_BAND
from grosmc_mj.experiments.metrics.recorded import (
    Comparison,
    Metric,
    compare_with_optimum,
    cost_shares,
    measure,
    overshoot,
    settling_time,
)

__all__ = [
    "SETTLING_BAND",
    "Comparison",
    "Metric",
    "compare_with_optimum",
    "cost_shares",
    "measure",
    "overshoot",
    "settling_time",
]

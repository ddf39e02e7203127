"""Columns of a log with another sign or unit than the case says: doubts after a fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.arrays import Array
from grosmc_mj.identify.model import LogModel
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.identify.starts import first_guess

# Slips of a column: the factor that would mend it, and the words for it.
_SLIPS = (
    (-1.0, "have the other sign"),
    (math.pi / 180, "be in degrees"),
    (1e-3, "be in thousandths of its unit"),
    (1e3, "be in thousands of its unit"),
)
# Inputs that leave this share of the error explain little.
_POOR = 0.9
# Without a slip they leave an error that is so many times less.
_BETTER = 1.2


def likely_slip(predictor: Predictor, model: LogModel, unexplained: float) -> str:
    """Return the sign or unit of a column that would explain a log far better than its fit does.

    Args:
        predictor: The log in windows.
        model: The case's plant.
        unexplained: Share of the motion that the fitted plant leaves, see ``unexplained_share``.

    Returns:
        A line on the first such column; empty where the fit explains the log.
    """
    if unexplained <= _POOR:
        return ""

    inputs = [signal.name for signal in model.plant.system.inputs]
    for name in (*predictor.log.states, *inputs):
        for factor, words in _SLIPS:
            mended = replace(predictor, log=_scaled(predictor.log, name, factor, inputs))
            if unexplained_share(mended, model) < unexplained / _BETTER:
                return (
                    f"{name} seems to {words}: the fit leaves {unexplained:.0%} of the motion "
                    "unexplained, and the case's plant far less then; if so, say it in the unit "
                    "of its header, or in the case file's [log]"
                )
    return ""


def _scaled(
    log: Log,
    name: str,
    factor: float,
    inputs: Sequence[str],
) -> Log:
    """A log with one of its measured states or inputs times a factor."""
    if name in log.states:
        return replace(log, states={**log.states, name: factor * log.states[name]})
    scale = np.where(np.array(inputs) == name, factor, 1.0)
    return replace(log, inputs=log.inputs * scale)


def unexplained_share(predictor: Predictor, model: LogModel) -> float:
    """Return the share of a log's motion that its inputs leave, of the state with the largest one.

    Args:
        predictor: The log in windows.
        model: The machine.
    """
    log = predictor.log
    without_inputs = replace(predictor, log=replace(log, inputs=0.0 * log.inputs))
    driven = _error_norms(predictor, model)
    still = _error_norms(without_inputs, model)
    shares = driven / np.maximum(still, 1e-12)
    return float(np.nan_to_num(np.max(shares), nan=np.inf))


def _error_norms(predictor: Predictor, model: LogModel) -> Array:
    """Norm of the prediction error of each measured state."""
    starts = first_guess(predictor.log, predictor.windows, model)
    errors = predictor.errors_from(model, starts)
    return np.array([np.linalg.norm(np.concatenate(parts)) for parts in errors.values()])

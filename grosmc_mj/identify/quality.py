"""How well a fit predicts a part of a log that was not fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.arrays import Array
from grosmc_mj.identify.fit import Fit
from grosmc_mj.identify.intervals import is_white
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.identify.residual import residual_of, searched
from grosmc_mj.theory.plants import Plant, System

# A state that deviates from its mean by fewer steps of its sensor stands still.
_STILL = 3.0
# A residual that is so many times larger than the state's deviation is that of a divergence.
_FAR = 30.0


class Quality(NamedTuple):
    """Accuracy of the prediction of one measured state.

    Attributes:
        state: Its name.
        unit: Its unit.
        rms: Of the residual.
        fit: 1 - |residual| / |deviation from the mean|.
        step: Step of the sensor or, without one, standard deviation of its noise.
        moves: Whether the measured state moves by more than some steps.
        diverges: Whether the residual is far larger than the state's motion.
        white: Whether the residual is no more correlated in time than noise (Ljung and Box); None
            if it is too short to tell.
    """

    state: str
    unit: str
    rms: float
    fit: float
    step: float
    moves: bool
    diverges: bool
    white: bool | None


def residuals(fit: Fit, predictor: Predictor, plant: Plant) -> dict[str, list[tuple[slice, Array]]]:
    """The samples and the residual of each measured state in each window, in its unit.

    The starts of the windows are fitted to the log, the parameters are not.

    Args:
        fit: The fit.
        predictor: The log in windows.
        plant: Before any change.
    """
    none_free = np.zeros(len(fit.values), bool)
    residual = residual_of(fit.parameters, none_free, predictor, plant, fit.scales, fit.values)
    x, _ = searched(residual, residual.point(fit.values))
    errors = residual.errors(x)
    samples = [window.samples for window in predictor.windows]
    return {name: list(zip(samples, parts, strict=True)) for name, parts in errors.items()}


def quality(
    parts: Mapping[str, Sequence[tuple[slice, Array]]],
    log: Log,
    system: System,
) -> list[Quality]:
    """Measure how well a fit predicts a log.

    Args:
        parts: Its ``residuals``.
        log: The log.
        system: Units of the states.
    """
    rows = []
    for state in system.states:
        name = state.name
        if name not in parts:
            continue
        samples, errors = zip(*parts[name], strict=True)
        values = log.states[name]
        measured = np.concatenate([values[window] for window in samples])
        rms = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
        spread = float(np.std(measured))
        # A sensor without steps is compared with its noise.
        step = max(log.resolution(name) or log.noise(name), 1e-12)
        rows.append(
            Quality(
                state=name,
                unit=state.unit,
                rms=rms,
                fit=1 - rms / max(spread, 1e-12),
                step=step,
                moves=spread > _STILL * step,
                diverges=not rms < _FAR * max(spread, step),
                white=is_white(errors),
            )
        )
    return rows

"""Least squares of a log: values with intervals, and the parameters that the log does not show.

The prediction begins anew in windows whose starts are fitted with the parameters: a plant that is
not stable, or is hit by something once, does not spoil the rest. ``mujoco.sysid`` does the fitting.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.identify.hidden import HiddenParameter, hidden_parameter
from grosmc_mj.identify.intervals import covariance, half_widths
from grosmc_mj.identify.model import LogModel
from grosmc_mj.identify.parameters import Parameters
from grosmc_mj.identify.refine import SMALL, Refined, refined
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.identify.residual import (
    MOST_STEPS,
    Residual,
    SearchInterrupted,
    rescaled,
    residual_of,
    searched,
)
from grosmc_mj.identify.slips import likely_slip, unexplained_share
from grosmc_mj.studies.sweep.quantities import Quantity
from grosmc_mj.theory.plants import Plant


@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters fitted to a log.

    Attributes:
        parameters: All of them.
        fitted: Which ones the log shows, (d,) of booleans.
        values: Of all; what is not fitted has the case's value, (d,).
        covariance: Of those that are fitted.
        half: Half width of the 95 % interval of each that is fitted.
        unseen: The parameters that the log does not show.
        scales: Standard deviation of each measured state's residual.
        timesteps: The case's timestep and the shorter one that the values hold at [s].
        shift: Change of those that are fitted from the first timestep to the second.
        left: Change of them by the last halving of it, about what is left of its error.
        converged: Whether the search ended before its limit of steps.
        finished: Whether the search was not interrupted.
    """

    parameters: Parameters
    fitted: NDArray[np.bool_]
    values: Array
    covariance: Array
    half: Array
    unseen: Sequence[HiddenParameter]
    scales: dict[str, float]
    timesteps: tuple[float, float]
    shift: Array
    left: Array
    converged: bool
    finished: bool

    @property
    def doubts(self) -> list[str]:
        """Doubts about the search and its timestep, a line each."""
        lines = []
        if not self.finished:
            lines.append("interrupted: values are the best so far, and no least squares")
        elif not self.converged:
            lines.append(
                f"the search ended after {MOST_STEPS} steps, perhaps beside the least squares: a "
                "shorter --horizon makes it easier"
            )
        if self.finished and self.timestep_words:
            lines.append(self.timestep_words)
        return lines

    @property
    def timestep_words(self) -> str:
        """Words on what the case's timestep alone would change; empty if that is little."""
        first, last = self.timesteps
        left = float(np.max(np.abs(self.left) / self.half))
        uncertain = (
            f"a shorter one may change {left:.2g} of an interval's half width, which it counts"
        )
        if last == first:
            # No step at half the timestep led nearer.
            return (
                f"fitted at a timestep of {1e3 * first:.3g} ms: {uncertain}" if left > SMALL else ""
            )
        if last == first / 2 and left <= SMALL:
            return ""

        shares = np.abs(self.shift) / self.half
        worst = int(np.argmax(shares))
        quantity = self.parameters.quantities[int(np.flatnonzero(self.fitted)[worst])]
        shift = f"{abs(self.shift[worst]):.2g}{unit_after(quantity.unit)}"
        direction = "lower" if self.shift[worst] > 0 else "higher"
        words = (
            f"fitted at a timestep of {1e3 * last:.3g} ms: at {1e3 * first:.3g} ms {quantity.name} "
            f"would be {shift} {direction}, {shares[worst]:.2g} of its interval's half width"
        )
        return f"{words}; {uncertain}" if left > SMALL else words

    def model(self, plant: Plant) -> LogModel:
        """Return the machine with the fitted values.

        Args:
            plant: Before any change.
        """
        return self.parameters.model(self.values, plant)

    @property
    def correlation(self) -> Array:
        """Correlation of the parameters that are fitted."""
        deviation = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(deviation, deviation)

    @property
    def estimates(self) -> list[tuple[Quantity, float, float | None]]:
        """Each parameter, its value and half the width of its interval; None where it is held."""
        values = self.values.tolist()
        halves = iter(self.half.tolist())
        rows: list[tuple[Quantity, float, float | None]] = []
        for quantity, value, fitted in zip(
            self.parameters.quantities, values, self.fitted, strict=True
        ):
            rows.append((quantity, value, next(halves) if fitted else None))
        return rows


def fit(
    parameters: Parameters,
    predictor: Predictor,
    plant: Plant,
    progress: Callable[[str], None] = lambda _: None,
) -> Fit:
    """Fit the parameters to a log.

    Args:
        parameters: The parameters.
        predictor: The log in windows.
        plant: Before any change.
        progress: Told what is going on.

    Raises:
        SetupError: If mujoco.sysid is not there.
        ArgumentError: If the log shows none of the parameters.
    """
    log = predictor.log
    # In the order of the states, as the residual has them.
    measured = [state.name for state in plant.system.states if state.name in log.states]
    scales = {name: log.deviation(name) for name in measured}
    values = parameters.first
    free = np.ones(len(parameters.names), bool)
    unseen: list[HiddenParameter] = []
    parameters.model(parameters.nominal, plant).require_speeds(log)
    while True:
        progress(f"fitting {int(free.sum())} parameters")
        residual = residual_of(parameters, free, predictor, plant, scales, parameters.nominal)
        finished = True
        try:
            residual, x, converged = _searched_twice(residual, values, progress)
        except SearchInterrupted as interrupted:
            residual = interrupted.residual
            x = interrupted.x
            finished = False
            converged = False
        scales = residual.scales
        values, _ = residual.parts(x)

        jacobian = residual.jacobian(x)
        if not finished:
            return _fit_at(residual, x, jacobian, unseen, converged, None)
        weak = hidden_parameter(parameters, free, jacobian, values)
        if weak is None:
            return _fit_at(residual, x, jacobian, unseen, converged, progress)

        unseen.append(weak)
        free = free & (np.array(parameters.names) != weak.held)
        if not free.any():
            raise ArgumentError(f"{log.name} shows none of the parameters: {weak.words}")


def _searched_twice(
    residual: Residual, values: Array, progress: Callable[[str], None]
) -> tuple[Residual, Array, bool]:
    """The residual with each state weighted by what a first search left, and its least squares.

    Returns:
        Whether they were found, too, before the limit of steps.
    """
    x, _ = searched(residual, residual.point(values), progress)
    residual = replace(residual, scales=rescaled(residual, x))
    x, converged = searched(residual, x, progress)
    return residual, x, converged


def _fit_at(
    residual: Residual,
    x: Array,
    jacobian: Array,
    unseen: Sequence[HiddenParameter],
    converged: bool,
    progress: Callable[[str], None] | None,
) -> Fit:
    """The fit near a point of least squares, in the units of the parameters.

    Without ``progress`` the search was interrupted: the point is taken as it is.
    """
    width = residual.width
    samples, unknowns = jacobian.shape
    freedom = samples - unknowns
    (errors,) = residual.of([x])
    scaled = covariance(jacobian, errors, len(width), residual.pieces)
    still = np.zeros(len(width))
    fine = Refined(residual, x, still, still)
    if progress is not None:
        fine = refined(residual, x, jacobian, half_widths(scaled, freedom), progress)

    (errors,) = fine.residual.of([fine.x])
    scaled = covariance(jacobian, errors, len(width), residual.pieces)
    # The timestep's error counts as a standard deviation of its own.
    scaled = scaled + np.outer(fine.left, fine.left)
    values, _ = residual.parts(fine.x)
    return Fit(
        parameters=residual.parameters,
        fitted=residual.free,
        values=values,
        covariance=scaled * np.outer(width, width),
        half=half_widths(scaled, freedom) * width,
        unseen=unseen,
        scales=residual.scales,
        timesteps=(residual.predictor.timestep, fine.residual.predictor.timestep),
        shift=fine.shift * width,
        left=fine.left * width,
        converged=converged,
        finished=progress is not None,
    )


def slip(fit: Fit, predictor: Predictor, plant: Plant) -> str:
    """Return the sign or unit of a column that would explain a log far better than its fit does.

    Args:
        fit: Parameters fitted to the log.
        predictor: The log in windows.
        plant: The case's plant.

    Returns:
        A line on that column; empty where the fit explains the log.
    """
    unexplained = unexplained_share(predictor, fit.model(plant))
    return likely_slip(predictor, LogModel(plant), unexplained)

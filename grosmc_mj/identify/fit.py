"""Least squares of a log: values with intervals, and the parameters that the log does not show.

The prediction begins anew in windows whose starts are fitted with the parameters: a plant that is
not stable, or is hit by something once, does not spoil the rest. ``mujoco.sysid`` does the fitting
and the intervals.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.identify.log import Log
from grosmc_mj.identify.parameters import Parameters
from grosmc_mj.identify.replay import Predictor, starts_of
from grosmc_mj.plants import Plant, System
from grosmc_mj.sweep.family import Quantity

# Differences for derivatives, as shares of a parameter's and a state's size.
_STEP = 1e-4
# A direction whose standard deviation is more than this share of the parameters is not visible; a
# parameter belongs to it from this component on.
_WEAK, _PART = 0.5, 0.3
# Lags of the residual's autocorrelation that are tested, at this level together.
_LAGS, _LEVEL = 20, 0.01


class Unseen(NamedTuple):
    """Parameters that the log does not show.

    Attributes:
        held: The one that is held at its value in the case.
        others: Those that it cannot be told apart from; empty if it has no effect of its own.
        words: What is visible of them, and what would show them.
    """

    held: str
    others: tuple[str, ...]
    words: str


class Quality(NamedTuple):
    """How well one measured state is predicted.

    Attributes:
        state: Its name.
        unit: Its unit.
        rms: Of the residual.
        fit: 1 - |residual| / |deviation from the mean|.
        steps: RMS in steps of the sensor or, without one, standard deviations of its noise.
        white: Whether the residual is no more correlated in time than noise (Ljung and Box).
    """

    state: str
    unit: str
    rms: float
    fit: float
    steps: float
    white: bool


@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters fitted to a log.

    Attributes:
        parameters: All of them.
        fitted: Which ones the log shows, (d,) of booleans.
        values: Of all; what is not fitted has the case's value, (d,).
        covariance: Of those that are fitted.
        half: Half width of the 95 % interval of each that is fitted.
        unseen: What the log does not show.
        scales: Standard deviation of each measured state's residual.
    """

    parameters: Parameters
    fitted: NDArray[np.bool_]
    values: Array
    covariance: Array
    half: Array
    unseen: Sequence[Unseen]
    scales: dict[str, float]

    @property
    def correlation(self) -> Array:
        """Of those that are fitted."""
        deviation = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(deviation, deviation)

    @property
    def estimates(self) -> list[tuple[Quantity, float, float | None]]:
        """Each parameter, its value and half the width of its interval; None where it is held."""
        widths = iter(self.half.tolist())
        half = [next(widths) if fitted else None for fitted in self.fitted]
        return list(zip(self.parameters.quantities, self.values.tolist(), half, strict=True))


@dataclass(frozen=True, eq=False)
class _Residual:
    """The weighted residual of a log, and its derivatives by parameters and starts.

    Attributes:
        parameters: The parameters.
        free: Which are fitted, (d,).
        predictor: The log's windows.
        plant: Before any change.
        scales: Of the measured states.
        fixed: Values of the parameters that are not fitted, (d,).
    """

    parameters: Parameters
    free: NDArray[np.bool_]
    predictor: Predictor
    plant: Plant
    scales: dict[str, float]
    fixed: Array

    @cached_property
    def starts(self) -> Array:
        """The first guess of the windows' starts, (windows, n)."""
        return starts_of(self.predictor.log, self.predictor.windows, self.plant.system)

    @cached_property
    def _sizes(self) -> Array:
        """A size of each state, (n,)."""
        outputs = self.predictor.log.outputs
        spread = {name: max(float(np.ptp(y)), 1e-9) for name, y in outputs.items()}
        largest = max(spread.values())
        return np.array([spread.get(state.name, largest) for state in self.plant.system.states])

    @property
    def width(self) -> Array:
        """Width of the range of each parameter that is fitted."""
        low, high = self.parameters.bounds
        return (high - low)[self.free]

    def point(self, values: Array) -> Array:
        """Values of all parameters, with the starts, as a point of the search."""
        inside = (values - self.parameters.bounds[0])[self.free] / self.width
        return np.concatenate([inside, (self.starts / self._sizes).ravel()])

    def parts(self, x: Array) -> tuple[Array, Array]:
        """Values of all parameters, and the starts, of a point."""
        values, count = self.fixed.copy(), int(self.free.sum())
        values[self.free] = self.parameters.bounds[0][self.free] + self.width * x[:count]
        return values, x[count:].reshape(self.starts.shape) * self._sizes

    def of(self, points: Sequence[Array]) -> list[Array]:
        """The residuals at several points, (r,) each: state by state, window by window."""
        values, starts = zip(*map(self.parts, points), strict=True)
        runs = self.predictor.states(
            [self.parameters.plant(vector, self.plant) for vector in values],
            starts,
            [self.parameters.input_delay(vector) for vector in values],
        )
        errors = [
            self.predictor.errors(
                states, self.plant.system, partial(self.parameters.sensor, values=row)
            )
            for row, states in zip(values, runs, strict=True)
        ]
        return [
            np.nan_to_num(
                np.concatenate([np.concatenate(error[name]) / self.scales[name] for name in error]),
                nan=1e6,
            )
            for error in errors
        ]

    @cached_property
    def _lengths(self) -> NDArray[np.intp]:
        """Samples of each window."""
        return np.array([w.samples.stop - w.samples.start for w in self.predictor.windows])

    def errors(self, x: Array) -> dict[str, list[Array]]:
        """The residual at a point in the units of the states, by state and window."""
        shares = np.split(self.of([x])[0], len(self.scales))
        return {
            name: np.split(share * scale, np.cumsum(self._lengths)[:-1])
            for (name, scale), share in zip(self.scales.items(), shares, strict=True)
        }

    def jacobian(self, x: Array) -> Array:
        """Its derivative by the point, (r, p): a start acts in its own window alone."""
        count, (windows, n) = int(self.free.sum()), self.starts.shape
        # The starts of all windows are moved at once.
        directions = np.zeros((count + n, len(x)))
        directions[:count, :count] = np.eye(count)
        directions[count:, count:] = np.tile(np.eye(n), windows)
        ends = [x + sign * _STEP * row for row in directions for sign in (1, -1)]
        for end in ends:  # parameters stay within their bounds
            end[:count] = end[:count].clip(0.0, 1.0)
        values, ends = (
            np.reshape(self.of(ends), (count + n, 2, -1)),
            np.reshape(ends, (-1, 2, len(x))),
        )
        widths = np.abs(ends[:, 0] - ends[:, 1]).max(axis=1)
        slopes = (values[:, 0] - values[:, 1]) / widths[:, None]
        rows = np.arange(slopes.shape[1])
        owners = np.tile(np.repeat(np.arange(windows), self._lengths), len(self.scales))
        result = np.zeros((len(rows), len(x)))
        result[:, :count] = slopes[:count].T
        for j in range(n):
            result[rows, count + owners * n + j] = slopes[count + j]
        return result


def fit(
    parameters: Parameters,
    log: Log,
    plant: Plant,
    *,
    horizon: float,
    timestep: float,
    progress: Callable[[str], None] = lambda _: None,
) -> Fit:
    """Fit the parameters to a log.

    Args:
        parameters: The parameters.
        log: The log.
        plant: Before any change.
        horizon: Length of a window [s].
        timestep: Of the prediction [s].
        progress: Told what is going on.

    Raises:
        SetupError: If mujoco.sysid is not there.
        ArgumentError: If the log shows none of the parameters.
    """
    predictor = Predictor.of(log, horizon, timestep)
    # In the order of the states, as the residual has them.
    measured = [state.name for state in plant.system.states if state.name in log.outputs]
    scales = {name: _first_scale(log, name) for name in measured}
    free, unseen = np.ones(len(parameters.names), bool), list[Unseen]()
    values = parameters.first
    while True:
        progress(f"fitting {int(free.sum())} parameters")
        residual = _Residual(parameters, free, predictor, plant, scales, parameters.nominal)
        x = _searched(residual, residual.point(values))
        scales = _rescaled(residual, x)
        residual = replace(residual, scales=scales)
        x = _searched(residual, x)
        jacobian, values = residual.jacobian(x), residual.parts(x)[0]
        weak = _weak(parameters, free, jacobian)
        if weak is None:
            break
        unseen.append(weak)
        free = free & (np.array(parameters.names) != weak.held)
        if not free.any():
            raise ArgumentError(f"{log.name} shows none of the parameters: {weak.words}")
    count, width = int(free.sum()), residual.width
    covariance, half = _sysid().calculate_intervals(residual.of([x]), jacobian)
    return Fit(
        parameters=parameters,
        fitted=free,
        values=values,
        covariance=covariance[:count, :count] * np.outer(width, width),
        half=half[:count] * width,
        unseen=unseen,
        scales=scales,
    )


def _sysid() -> Any:
    """mujoco.sysid, with what it needs.

    Raises:
        SetupError: If that is not installed.
    """
    import mujoco.sysid as sysid

    if not hasattr(sysid, "optimize"):
        raise SetupError("identify needs mujoco[sysid]: pip install 'grosmc_mj[identify]'")
    return sysid


def _searched(residual: _Residual, x: Array) -> Array:
    """The point of least squares, from a first one."""
    sysid, count = _sysid(), int(residual.free.sum())
    low, high = np.zeros(len(x)), np.ones(len(x))
    low[count:], high[count:] = x[count:] - 10.0, x[count:] + 10.0
    names = sysid.ParameterDict()
    names.add(sysid.Parameter("point", np.clip(x, low, high), low, high))
    _, result = sysid.optimize(
        names,
        lambda at, _: ([residual.of([np.asarray(at).ravel()])[0][:, None]], None, None),
        optimizer="mujoco",
        verbose=False,
        max_iters=50,
        xtol=1e-7,
        mu_factor=10.0,
        # Its progress is nobody's.
        output=io.StringIO(),
        jacobian=lambda at, _: residual.jacobian(np.asarray(at).ravel()),
    )
    return np.asarray(result.x, float).ravel()


def _first_scale(log: Log, state: str) -> float:
    """Standard deviation of a sensor's noise, at least that of its rounding."""
    rounding, span = log.resolution(state) / np.sqrt(12.0), float(np.ptp(log.outputs[state]))
    return max(log.noise(state), float(rounding), 1e-9 * span, 1e-12)


def _rescaled(residual: _Residual, x: Array) -> dict[str, float]:
    """The standard deviation of each state's residual."""
    errors, scales = residual.errors(x), {}
    for name, parts in errors.items():
        samples = sum(map(len, parts)) - residual.starts.size // len(errors)
        scales[name] = float(np.linalg.norm(np.concatenate(parts)) / np.sqrt(max(1, samples)))
    return scales


def _weak(parameters: Parameters, free: NDArray[np.bool_], jacobian: Array) -> Unseen | None:
    """The parameters that are the least visible, if that is not enough; None if all are."""
    count, sizes = int(free.sum()), parameters.scales[free]
    width = (parameters.bounds[1] - parameters.bounds[0])[free]
    own, starts = jacobian[:, :count] * (sizes / width), jacobian[:, count:]
    seen = starts[:, np.abs(starts).max(axis=0) > 0]
    own = own - seen @ np.linalg.lstsq(seen, own, rcond=None)[0]
    _, s, v = np.linalg.svd(own, full_matrices=False)
    if s[-1] * _WEAK >= 1.0:
        return None
    names = np.array(parameters.names)[free]
    direction = v[-1]
    members = np.flatnonzero(np.abs(direction) > _PART * np.abs(direction).max())
    held = members[np.abs(direction[members]).argmax()]
    others = tuple(str(names[i]) for i in members if i != held)
    name = str(names[held])
    if not others:
        words = f"{name} is not visible in this log: give it a run that moves it more, or faster"
        return Unseen(name, (), words)
    listed = " and ".join([name, *others])
    relation = "a combination of them"
    if len(others) == 1:
        same = np.prod(np.sign(direction[members])) > 0
        relation = "their ratio" if same else "their sum or product"
    words = (
        f"{listed}: only {relation} is visible in this log; {name} is held at its value in the "
        "case. A run with a known load, or a measurement of one of them, tells them apart"
    )
    return Unseen(name, others, words)


def residuals(
    fit: Fit, log: Log, plant: Plant, horizon: float, timestep: float
) -> dict[str, list[tuple[slice, Array]]]:
    """The samples and the residual of each measured state in each window, in its unit.

    The starts of the windows are fitted to the log, the parameters are not.
    """
    predictor = Predictor.of(log, horizon, timestep)
    none = np.zeros(len(fit.values), bool)
    residual = _Residual(fit.parameters, none, predictor, plant, fit.scales, fit.values)
    errors = residual.errors(_searched(residual, residual.point(fit.values)))
    samples = [window.samples for window in predictor.windows]
    return {name: list(zip(samples, parts, strict=True)) for name, parts in errors.items()}


def quality(
    parts: Mapping[str, Sequence[tuple[slice, Array]]], log: Log, system: System
) -> list[Quality]:
    """How well a fit predicts a log.

    Args:
        parts: Its ``residuals``.
        log: The log.
        system: Units of the states.
    """
    units, rows = {state.name: state.unit for state in system.states}, []
    for name, pieces in parts.items():
        values = log.outputs[name]
        measured = np.concatenate([values[samples] for samples, _ in pieces])
        error = np.concatenate([residual for _, residual in pieces])
        rms, spread = float(np.sqrt(np.mean(error**2))), float(np.std(measured))
        step = log.resolution(name) or log.noise(name)
        rows.append(
            Quality(
                state=name,
                unit=units[name],
                rms=rms,
                fit=1 - rms / max(spread, 1e-12),
                steps=rms / max(step, 1e-12),
                white=_white([residual for _, residual in pieces]),
            )
        )
    return rows


def _white(pieces: Sequence[Array]) -> bool:
    """Whether residuals are uncorrelated in time, by Ljung and Box over all windows."""
    long = [piece - piece.mean() for piece in pieces if len(piece) > 3 * _LAGS]
    if not long:
        return True
    power, count = sum(float(e @ e) for e in long), sum(map(len, long))
    correlations = [
        sum(float(e[lag:] @ e[:-lag]) for e in long) / max(power, 1e-300)
        for lag in range(1, _LAGS + 1)
    ]
    statistic = count * (count + 2) * sum(
        rho**2 / (count - lag) for lag, rho in enumerate(correlations, 1)
    )  # fmt: skip
    return bool(stats.chi2.sf(statistic, _LAGS) > _LEVEL)

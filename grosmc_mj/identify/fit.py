"""Least squares of a log: values with intervals, and the parameters that the log does not show.

The prediction begins anew in windows whose starts are fitted with the parameters: a plant that is
not stable, or is hit by something once, does not spoil the rest. ``mujoco.sysid`` does the fitting.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.identify.intervals import covariance, half_widths, is_white
from grosmc_mj.identify.model import LogModel
from grosmc_mj.identify.parameters import Parameters
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.identify.slips import likely_slip, unexplained_share
from grosmc_mj.identify.starts import first_guess, state_sizes
from grosmc_mj.logs.log import Log
from grosmc_mj.plants import Plant, System
from grosmc_mj.sweep.family import Quantity

# Step of the differences for derivatives, as a share of a parameter's range and a state's size.
_STEP = 1e-4
# Residual after a prediction diverged, in standard deviations.
_DIVERGED = 1e6
# A state that deviates from its mean by fewer steps of its sensor stands still.
_STILL = 3.0
# A residual that is so many times larger than the state's deviation is that of a divergence.
_FAR = 30.0
# Standard deviations beyond which Huber's loss grows as the size: efficiency of 95 % (Huber, 1964).
_HUBER = 1.345
# Standard deviation of a normal distribution over the median of its size.
_NORMAL_MEDIAN = 1.4826
# Starts of the windows are searched within so many sizes of a state about the first guess.
_START_RANGE = 10.0
# A direction whose standard deviation is more than this share of the parameters is not visible.
_WEAK = 0.5
# A parameter belongs to that direction if its component is above this share of the largest one.
_PART = 0.3


class HiddenParameter(NamedTuple):
    """Parameters that the log does not show.

    Attributes:
        held: The one that is held at its value in the case.
        others: Those that it cannot be told apart from; empty if it has no effect of its own.
        words: Which combination of them is visible, and which log would show them.
    """

    held: str
    others: tuple[str, ...]
    words: str


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
    """

    parameters: Parameters
    fitted: NDArray[np.bool_]
    values: Array
    covariance: Array
    half: Array
    unseen: Sequence[HiddenParameter]
    scales: dict[str, float]

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


@dataclass(frozen=True, eq=False)
class _Residual:
    """The weighted residual of a log, and its derivatives by parameters and starts.

    A point x of the search holds the parameters that are fitted, as shares of their ranges, and
    the starts of all windows in the sizes of the states.

    Attributes:
        parameters: The parameters.
        free: Which are fitted, (d,).
        predictor: The log's windows.
        plant: Before any change.
        scales: Standard deviations of the measured states.
        fixed: Values of the parameters that are not fitted, (d,).
        starts: The first guess of the windows' starts, (windows, n).
        sizes: A size of each state, (n,).
        huber: Whether large residuals count by their size, and not by its square.
    """

    parameters: Parameters
    free: NDArray[np.bool_]
    predictor: Predictor
    plant: Plant
    scales: dict[str, float]
    fixed: Array
    starts: Array
    sizes: Array
    huber: bool = False

    @property
    def width(self) -> Array:
        """Width of the range of each parameter that is fitted."""
        low, high = self.parameters.bounds
        return (high - low)[self.free]

    def point(self, values: Array) -> Array:
        """The point of the search with these values of all parameters, (d,), at the first guess."""
        low, _ = self.parameters.bounds
        shares = (values - low)[self.free] / self.width
        return np.concatenate([shares, (self.starts / self.sizes).ravel()])

    def parts(self, x: Array) -> tuple[Array, Array]:
        """Values of all parameters, (d,), and the starts, (windows, n), of a point."""
        count = int(self.free.sum())
        low, _ = self.parameters.bounds
        values = self.fixed.copy()
        values[self.free] = low[self.free] + self.width * x[:count]
        starts = x[count:].reshape(self.starts.shape) * self.sizes
        return values, starts

    def of(self, points: Sequence[Array]) -> list[Array]:
        """The residuals at several points, (r,) each, whose squares are what is least."""
        residuals = self.scaled(points)
        if self.huber:
            return [_huber(residual) for residual in residuals]
        return residuals

    def scaled(self, points: Sequence[Array]) -> list[Array]:
        """The scaled errors at several points, (r,) each: state by state, window by window."""
        values = []
        starts = []
        for x in points:
            x_values, x_starts = self.parts(x)
            values.append(x_values)
            starts.append(x_starts)

        # All points and windows are one batch of runs.
        models = [self.parameters.model(row, self.plant) for row in values]
        runs = self.predictor.states(models, starts)

        residuals = []
        for model, states in zip(models, runs, strict=True):
            errors = self.predictor.errors(states, model)
            scaled = [np.concatenate(errors[name]) / self.scales[name] for name in errors]
            residuals.append(np.nan_to_num(np.concatenate(scaled), nan=_DIVERGED))
        return residuals

    @property
    def _lengths(self) -> NDArray[np.intp]:
        """Samples of each window."""
        return np.array([window.length for window in self.predictor.windows])

    @property
    def pieces(self) -> list[slice]:
        """Entries of the residual that follow each other in time, of a state and a window each."""
        ends = np.cumsum(np.tile(self._lengths, len(self.scales))).tolist()
        return [slice(start, end) for start, end in zip([0, *ends], ends, strict=False)]

    def errors(self, x: Array) -> dict[str, list[Array]]:
        """The residual at a point in the units of the states, by state and window."""
        (residual,) = self.scaled([x])
        borders = np.cumsum(self._lengths)[:-1]
        errors = {}
        by_state = np.split(residual, len(self.scales))
        for (name, scale), scaled in zip(self.scales.items(), by_state, strict=True):
            errors[name] = np.split(scaled * scale, borders)
        return errors

    def jacobian(self, x: Array) -> Array:
        """Its derivative by the point, (r, p): a start acts in its own window alone."""
        count = int(self.free.sum())
        windows, n = self.starts.shape
        # A direction for each parameter, and for each state: the starts of all windows are moved
        # at once.
        directions = np.zeros((count + n, len(x)))
        directions[:count, :count] = np.eye(count)
        directions[count:, count:] = np.tile(np.eye(n), windows)

        ends = []
        for direction in directions:
            for sign in (1, -1):
                end = x + sign * _STEP * direction
                # Parameters stay within their bounds.
                end[:count] = end[:count].clip(0.0, 1.0)
                ends.append(end)
        values = np.reshape(self.of(ends), (count + n, 2, -1))
        pairs = np.reshape(ends, (count + n, 2, len(x)))
        steps = np.abs(pairs[:, 0] - pairs[:, 1]).max(axis=1)
        slopes = (values[:, 0] - values[:, 1]) / steps[:, None]

        # The window of each entry of the residual tells whose start moved it.
        owners = np.tile(np.repeat(np.arange(windows), self._lengths), len(self.scales))
        rows = np.arange(slopes.shape[1])
        jacobian = np.zeros((len(rows), len(x)))
        jacobian[:, :count] = slopes[:count].T
        for j in range(n):
            jacobian[rows, count + owners * n + j] = slopes[count + j]
        return jacobian


def _huber(residual: Array) -> Array:
    """Numbers whose squares are Huber's loss: sizes beyond a bound in place of squares."""
    size = np.abs(residual)
    beyond = np.sqrt(np.maximum(2 * _HUBER * size - _HUBER**2, 0.0))
    return np.where(size <= _HUBER, residual, np.sign(residual) * beyond)


def _residual_of(
    parameters: Parameters,
    free: NDArray[np.bool_],
    predictor: Predictor,
    plant: Plant,
    scales: dict[str, float],
    fixed: Array,
) -> _Residual:
    """The residual with the first guess of its starts, and sizes of the states."""
    log = predictor.log
    model = parameters.model(fixed, plant)
    return _Residual(
        parameters=parameters,
        free=free,
        predictor=predictor,
        plant=plant,
        scales=scales,
        fixed=fixed,
        starts=first_guess(log, predictor.windows, model),
        sizes=state_sizes(log, [state.name for state in plant.system.states]),
        huber=parameters.huber,
    )


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
    scales = {name: log.deviation(name) for name in measured}
    values = parameters.first
    free = np.ones(len(parameters.names), bool)
    unseen: list[HiddenParameter] = []
    parameters.model(parameters.nominal, plant).require_speeds(log)
    while True:
        progress(f"fitting {int(free.sum())} parameters")
        residual = _residual_of(parameters, free, predictor, plant, scales, parameters.nominal)
        x = _searched(residual, residual.point(values))

        # Again, with each state weighted by what the first search left of it.
        scales = _rescaled(residual, x)
        residual = replace(residual, scales=scales)
        x = _searched(residual, x)
        values, _ = residual.parts(x)

        jacobian = residual.jacobian(x)
        weak = _weak(parameters, free, jacobian)
        if weak is None:
            return _fit_at(residual, x, jacobian, unseen)

        unseen.append(weak)
        free = free & (np.array(parameters.names) != weak.held)
        if not free.any():
            raise ArgumentError(f"{log.name} shows none of the parameters: {weak.words}")


def _fit_at(
    residual: _Residual, x: Array, jacobian: Array, unseen: Sequence[HiddenParameter]
) -> Fit:
    """The fit at a point of least squares, in the units of the parameters."""
    values, _ = residual.parts(x)
    width = residual.width
    (errors,) = residual.of([x])
    scaled = covariance(jacobian, errors, len(width), residual.pieces)
    samples, unknowns = jacobian.shape
    return Fit(
        parameters=residual.parameters,
        fitted=residual.free,
        values=values,
        covariance=scaled * np.outer(width, width),
        half=half_widths(scaled, samples - unknowns) * width,
        unseen=unseen,
        scales=residual.scales,
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
    sysid = _sysid()
    count = int(residual.free.sum())
    low = np.zeros(len(x))
    high = np.ones(len(x))
    low[count:] = x[count:] - _START_RANGE
    high[count:] = x[count:] + _START_RANGE

    variables = sysid.ParameterDict()
    variables.add(sysid.Parameter("point", np.clip(x, low, high), low, high))
    _, result = sysid.optimize(
        variables,
        lambda at, _: ([residual.of([np.asarray(at).ravel()])[0][:, None]], None, None),
        optimizer="mujoco",
        verbose=False,
        max_iters=50,
        xtol=1e-7,
        mu_factor=10.0,
        # Nobody reads its progress.
        output=io.StringIO(),
        jacobian=lambda at, _: residual.jacobian(np.asarray(at).ravel()),
    )
    return np.asarray(result.x, float).ravel()


def _rescaled(residual: _Residual, x: Array) -> dict[str, float]:
    """The standard deviation of each state's residual."""
    errors = residual.errors(x)
    # The fitted starts take degrees of freedom, of each measured state as many.
    fitted_starts = residual.starts.size // len(errors)
    scales = {}
    for name, parts in errors.items():
        samples = sum(map(len, parts)) - fitted_starts
        norm = np.linalg.norm(np.concatenate(parts))
        scales[name] = float(norm / np.sqrt(max(1, samples)))
        if residual.huber:
            scales[name] = _NORMAL_MEDIAN * float(np.median(np.abs(np.concatenate(parts))))
    return scales


def _weak(
    parameters: Parameters, free: NDArray[np.bool_], jacobian: Array
) -> HiddenParameter | None:
    """The parameters that are the least visible, if that is not enough; None if all are."""
    count = int(free.sum())
    low, high = parameters.bounds
    by_size = jacobian[:, :count] * (parameters.scales[free] / (high - low)[free])

    # A residual that other starts of the windows could explain counts for no parameter.
    by_start = jacobian[:, count:]
    by_start = by_start[:, np.abs(by_start).max(axis=0) > 0]
    by_size = by_size - by_start @ np.linalg.lstsq(by_start, by_size, rcond=None)[0]

    # The least singular value is the inverse of the largest standard deviation of a direction.
    _, s, v = np.linalg.svd(by_size, full_matrices=False)
    if s[-1] * _WEAK >= 1.0:
        return None

    direction = v[-1]
    members = np.flatnonzero(np.abs(direction) > _PART * np.abs(direction).max())
    held = members[np.abs(direction[members]).argmax()]
    names = np.array(parameters.names)[free]
    name = str(names[held])
    alike = tuple(str(names[i]) for i in members if i != held)
    same_sign = bool(np.prod(np.sign(direction[members])) > 0)
    return HiddenParameter(name, alike, _unseen_words(name, alike, same_sign))


def _unseen_words(name: str, alike: Sequence[str], same_sign: bool) -> str:
    """Words on a held parameter and those that it cannot be told apart from.

    Args:
        name: Name of the held parameter.
        alike: Names of the other parameters.
        same_sign: Whether their changes that cancel each other have the same sign.
    """
    if not alike:
        return f"{name} is not visible in this log: give it a run that moves it more, or faster"

    relation = "a combination of them"
    if len(alike) == 1:
        relation = "their ratio" if same_sign else "their sum or product"
    listed = " and ".join([name, *alike])
    return (
        f"{listed}: only {relation} is visible in this log; {name} is held at its value in the "
        "case. A run with a known load, or a measurement of one of them, tells them apart"
    )


def slip(fit: Fit, log: Log, plant: Plant, horizon: float, timestep: float) -> str:
    """Return the sign or unit of a column that would explain a log far better than its fit does.

    Args:
        fit: Parameters fitted to the log.
        log: The log.
        plant: The case's plant.
        horizon: Length of a window [s].
        timestep: Of the prediction [s].

    Returns:
        A line on that column; empty where the fit explains the log.
    """
    predictor = Predictor.of(log, horizon, timestep)
    unexplained = unexplained_share(predictor, fit.model(plant))
    return likely_slip(predictor, LogModel(plant), unexplained)


def residuals(
    fit: Fit, log: Log, plant: Plant, horizon: float, timestep: float
) -> dict[str, list[tuple[slice, Array]]]:
    """The samples and the residual of each measured state in each window, in its unit.

    The starts of the windows are fitted to the log, the parameters are not.
    """
    predictor = Predictor.of(log, horizon, timestep)
    none_free = np.zeros(len(fit.values), bool)
    residual = _residual_of(fit.parameters, none_free, predictor, plant, fit.scales, fit.values)
    errors = residual.errors(_searched(residual, residual.point(fit.values)))
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
        values = log.outputs[name]
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

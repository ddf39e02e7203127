"""Least squares of a log: values with intervals, and the parameters that the log does not show.

The prediction begins anew in windows whose starts are fitted with the parameters: a plant that is
not stable, or is hit by something once, does not spoil the rest. ``mujoco.sysid`` does the fitting
and the intervals.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.identify.log import Log, noise_of, resolution_of
from grosmc_mj.identify.parameters import Parameters
from grosmc_mj.identify.replay import Predictor, starts_of
from grosmc_mj.plants import Plant

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


class _Residual:
    """The weighted residual of a log, and its derivatives by parameters and starts.

    Args:
        parameters: The parameters.
        free: Which are fitted, (d,).
        predictor: The log's windows.
        plant: Before any change.
        scales: Of the measured states.
    """

    def __init__(
        self,
        parameters: Parameters,
        free: NDArray[np.bool_],
        predictor: Predictor,
        plant: Plant,
        scales: dict[str, float],
    ) -> None:
        self.parameters, self.free, self.predictor = parameters, free, predictor
        self.plant, self.scales, self._system = plant, scales, plant.system
        self.starts = starts_of(predictor.log, predictor.windows, plant.system)
        outputs = predictor.log.outputs
        spread = {name: max(float(np.ptp(y)), 1e-9) for name, y in outputs.items()}
        largest = max(spread.values())
        self._sizes = np.array([spread.get(s.name, largest) for s in plant.system.states])
        self._low = parameters.bounds[0][free]
        self._width = (parameters.bounds[1] - parameters.bounds[0])[free]

    def point(self, values: Array) -> Array:
        """Values of all parameters, with the starts, as a point of the search."""
        inside = (values[self.free] - self._low) / self._width
        return np.concatenate([inside, (self.starts / self._sizes).ravel()])

    def parts(self, x: Array) -> tuple[Array, Array]:
        """Values of all parameters, and the starts, of a point."""
        values, count = self.parameters.nominal.copy(), len(self._width)
        values[self.free] = self._low + self._width * x[:count]
        return values, x[count:].reshape(self.starts.shape) * self._sizes

    def of(self, points: Sequence[Array]) -> list[Array]:
        """The residuals at several points, (r,) each."""
        log, predictor = self.predictor.log, self.predictor
        parts = [self.parts(x) for x in points]
        delays = [self.parameters.input_delay(values) for values, _ in parts]
        plants = [self.parameters.plant(values, self.plant) for values, _ in parts]
        names = [state.name for state in self._system.states]
        residuals = []
        for (values, _), runs in zip(
            parts, predictor.states(plants, [starts for _, starts in parts], delays), strict=True
        ):
            rows = []
            for w, states in enumerate(runs):
                for name, measured in log.outputs.items():
                    late = self.parameters.sensor(name, "delay", values)
                    bias = self.parameters.sensor(name, "bias", values)
                    predicted = predictor.at_samples(w, states[:, names.index(name)], late) + bias
                    error = measured[predictor.windows[w].samples] - predicted
                    rows.append(error / self.scales[name])
            residuals.append(np.nan_to_num(np.concatenate(rows), nan=1e6))
        return residuals

    def owners(self) -> NDArray[np.intp]:
        """The window of each entry of the residual, (r,)."""
        sizes = [w.samples.stop - w.samples.start for w in self.predictor.windows]
        outputs = len(self.predictor.log.outputs)
        return np.repeat(np.arange(len(sizes)), np.array(sizes) * outputs)

    def jacobian(self, x: Array) -> Array:
        """Its derivative by the point, (r, p): a start acts in its own window alone."""
        count, (windows, n) = len(self._width), self.starts.shape
        directions = [np.eye(len(x))[k] for k in range(count)]
        for j in range(n):
            direction = np.zeros((windows, n))
            direction[:, j] = 1.0
            directions.append(np.concatenate([np.zeros(count), direction.ravel()]))
        points = [x + sign * _STEP * each for each in directions for sign in (1, -1)]
        for point in points:  # parameters stay within their bounds
            point[:count] = point[:count].clip(0.0, 1.0)
        found, pairs = self.of(points), zip(points[::2], points[1::2], strict=True)
        widths = [float(np.abs(a - b).max()) for a, b in pairs]
        slopes = [
            (a - b) / width for a, b, width in zip(found[::2], found[1::2], widths, strict=True)
        ]
        result = np.zeros((len(slopes[0]), len(x)))
        result[:, :count] = np.column_stack(slopes[:count]) if count else 0.0
        owners = self.owners()
        for w in range(windows):
            own = owners == w
            for j in range(n):
                result[own, count + w * n + j] = slopes[count + j][own]
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
    scales = {name: _first_scale(values) for name, values in log.outputs.items()}
    free, unseen = np.ones(len(parameters.names), bool), list[Unseen]()
    values = parameters.first
    while True:
        progress(f"fitting {int(free.sum())} parameters")
        residual = _Residual(parameters, free, predictor, plant, scales)
        x = _searched(residual, residual.point(values))
        scales = _rescaled(residual, x)
        residual = replaced(residual, scales)
        x = _searched(residual, x)
        jacobian = residual.jacobian(x)
        weak = _weak(parameters, free, jacobian)
        if weak is None:
            break
        unseen.append(weak)
        free = free & (np.array(parameters.names) != weak.held)
        if not free.any():
            raise ArgumentError(f"{log.name} shows none of the parameters: {weak.words}")
        values = np.where(free, residual.parts(x)[0], parameters.nominal)
    count = int(free.sum())
    (r,) = residual.of([x])
    covariance, half = _sysid().calculate_intervals([r], jacobian)
    width = residual._width
    return Fit(
        parameters=parameters,
        fitted=free,
        values=residual.parts(x)[0],
        covariance=covariance[:count, :count] * np.outer(width, width),
        half=half[:count] * width,
        unseen=unseen,
        scales=scales,
    )


def replaced(residual: _Residual, scales: dict[str, float]) -> _Residual:
    """The same residual with other weights."""
    return _Residual(residual.parameters, residual.free, residual.predictor, residual.plant, scales)


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
    _, found = sysid.optimize(
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
    return np.asarray(found.x, float).ravel()


def _first_scale(values: Array) -> float:
    """Standard deviation of a sensor's noise, at least that of its rounding."""
    rounding = resolution_of(values) / np.sqrt(12.0)
    return max(noise_of(values), float(rounding), 1e-9 * float(np.ptp(values)), 1e-12)


def _rescaled(residual: _Residual, x: Array) -> dict[str, float]:
    """The standard deviation of each state's residual."""
    (r,) = residual.of([x])
    names, sums = list(residual.scales), dict.fromkeys(residual.scales, 0.0)
    place = 0
    for window in residual.predictor.windows:
        size = window.samples.stop - window.samples.start
        for name in names:
            sums[name] += float(r[place : place + size] @ r[place : place + size])
            place += size
    samples = max(1, place // len(names) - residual.starts.size // len(names))
    return {name: residual.scales[name] * float(np.sqrt(sums[name] / samples)) for name in names}


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


def quality(found: Fit, log: Log, plant: Plant, horizon: float, timestep: float) -> list[Quality]:
    """How well a fit predicts a log, with the starts of its windows fitted to it."""
    arrays = residuals(found, log, plant, horizon, timestep)
    rows = []
    for state in plant.system.states:
        if state.name not in log.outputs:
            continue
        measured = np.concatenate([log.outputs[state.name][w] for w, _ in arrays[state.name]])
        error = np.concatenate([e for _, e in arrays[state.name]])
        rms = float(np.sqrt(np.mean(error**2)))
        spread = float(np.linalg.norm(measured - measured.mean()))
        fine = resolution_of(log.outputs[state.name]) or noise_of(log.outputs[state.name])
        rows.append(
            Quality(
                state.name, state.unit, rms, 1 - float(np.linalg.norm(error)) / max(spread, 1e-12),
                rms / max(fine, 1e-12), _white([e for _, e in arrays[state.name]]),
            )
        )  # fmt: skip
    return rows


def residuals(
    found: Fit, log: Log, plant: Plant, horizon: float, timestep: float
) -> dict[str, list[tuple[slice, Array]]]:
    """The residual of each measured state in each window, in its unit."""
    none = np.zeros(len(found.parameters.names), bool)
    held = replace_nominal(found.parameters, found.values)
    predictor = Predictor.of(log, horizon, timestep)
    residual = _Residual(held, none, predictor, plant, found.scales)
    x = _searched(residual, residual.point(found.values))
    (r,) = residual.of([x])
    place, parts = 0, {name: list[tuple[slice, Array]]() for name in log.outputs}
    for window in predictor.windows:
        size = window.samples.stop - window.samples.start
        for name in log.outputs:
            parts[name].append((window.samples, r[place : place + size] * found.scales[name]))
            place += size
    return parts


def replace_nominal(parameters: Parameters, values: Array) -> Parameters:
    """The same parameters, with other values of the case."""
    quantities = [
        replace(q, nominal=float(v)) for q, v in zip(parameters.quantities, values, strict=True)
    ]
    return replace(parameters, quantities=quantities)


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

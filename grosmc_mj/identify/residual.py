"""Weighted residual of a log, its derivatives, and the point where its squares are least."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import SetupError
from grosmc_mj.ground.wording import counted
from grosmc_mj.identify.parameters import Parameters
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.identify.starts import first_guess, state_sizes
from grosmc_mj.theory.plants import Plant

# Step of the differences for derivatives, as a share of a parameter's range and a state's size.
_STEP = 1e-4
# Residual after a prediction diverged, in standard deviations.
_DIVERGED = 1e6
# Standard deviations beyond which Huber's loss grows as the size: efficiency of 95 % (Huber, 1964).
_HUBER = 1.345
# Standard deviation of a normal distribution over the median of its size.
_NORMAL_MEDIAN = 1.4826
# Timesteps that a batch of runs records: some hundred megabytes of a machine of many joints.
_MOST_ROWS = 100_000
# Steps of a search, at most.
MOST_STEPS = 50
# Starts of the windows are searched within so many sizes of a state about the first guess.
_START_RANGE = 10.0


@dataclass(frozen=True, eq=False)
class Residual:
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

        # All points and windows are one batch of runs, as far as memory has their states.
        rows = len(self.predictor.windows) * self.predictor.steps
        batch = max(1, _MOST_ROWS // rows)
        residuals = []
        for first in range(0, len(points), batch):
            part = slice(first, first + batch)
            models = [self.parameters.model(row, self.plant) for row in values[part]]
            runs = self.predictor.states(models, starts[part])
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


def residual_of(
    parameters: Parameters,
    free: NDArray[np.bool_],
    predictor: Predictor,
    plant: Plant,
    scales: dict[str, float],
    fixed: Array,
) -> Residual:
    """The residual with the first guess of its starts, and sizes of the states."""
    log = predictor.log
    model = parameters.model(fixed, plant)
    return Residual(
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


def _sysid() -> Any:
    """mujoco.sysid, with what it needs.

    Raises:
        SetupError: If that is not installed.
    """
    import mujoco.sysid as sysid

    if not hasattr(sysid, "optimize"):
        raise SetupError("identify needs mujoco[sysid]: pip install 'grosmc_mj[identify]'")
    return sysid


class SearchInterrupted(KeyboardInterrupt):
    """Ctrl-C in a search.

    Attributes:
        residual: The residual.
        x: Its best point so far.
    """

    def __init__(self, residual: Residual, x: Array) -> None:
        super().__init__()
        self.residual = residual
        self.x = x


class _Best:
    """The best point of a search so far, and how far it is."""

    def __init__(self, residual: Residual, x: Array, progress: Callable[[str], None]) -> None:
        self.x = x
        self._residual = residual
        self._least = np.inf
        self._progress = progress
        self.steps = 0

    def errors(self, x: Array) -> Array:
        """The residual at a point."""
        (errors,) = self._residual.of([x])
        cost = float(errors @ errors)
        if cost < self._least:
            self._least = cost
            self.x = x
        return errors

    def jacobian(self, x: Array) -> Array:
        """Its derivatives there: once a step of the search."""
        self.steps += 1
        self._progress(
            f"fitting {counted(int(self._residual.free.sum()), 'parameter')}: step {self.steps} of "
            f"{MOST_STEPS} at most, cost {self._least:.4g}"
        )
        return self._residual.jacobian(x)


def searched(
    residual: Residual, x: Array, progress: Callable[[str], None] = lambda _: None
) -> tuple[Array, bool]:
    """The point of least squares, from a first one, and whether the steps sufficed to find it.

    Args:
        residual: The residual.
        x: The first point.
        progress: Told each step.

    Raises:
        SearchInterrupted: With the best point so far, after Ctrl-C.
    """
    sysid = _sysid()
    best = _Best(residual, x, progress)
    count = int(residual.free.sum())
    low = np.zeros(len(x))
    high = np.ones(len(x))
    low[count:] = x[count:] - _START_RANGE
    high[count:] = x[count:] + _START_RANGE

    variables = sysid.ParameterDict()
    variables.add(sysid.Parameter("point", np.clip(x, low, high), low, high))
    try:
        _, result = sysid.optimize(
            variables,
            lambda at, _: ([best.errors(np.asarray(at).ravel())[:, None]], None, None),
            optimizer="mujoco",
            verbose=False,
            max_iters=MOST_STEPS,
            xtol=1e-7,
            mu_factor=10.0,
            # Nobody reads its progress.
            output=io.StringIO(),
            jacobian=lambda at, _: best.jacobian(np.asarray(at).ravel()),
        )
    except KeyboardInterrupt:
        raise SearchInterrupted(residual, best.x) from None
    return np.asarray(result.x, float).ravel(), best.steps < MOST_STEPS


def rescaled(residual: Residual, x: Array) -> dict[str, float]:
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

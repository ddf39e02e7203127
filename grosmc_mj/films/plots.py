"""The curves of a film's plots: outputs, sliding variables and inputs.

Of a robot with more of one kind than can be told apart, one curve for each run shows their size.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from grosmc_mj.arrays import Array
from grosmc_mj.films.film import Film, Take
from grosmc_mj.plants.system import Signal
from grosmc_mj.report.envelope import jumps
from grosmc_mj.report.palette import OPTIMUM, red_green_blue

# More signals than this of one kind are shown by their size.
FEW = 2
# How several coordinates or inputs of one run are told apart.
_STYLES, _SHARES = ("dark", "pale"), (1.0, 0.5)
# A sliding variable below this is shown in thousandths of its unit.
_SMALL = 0.1
_SPREAD, _ROOM = 0.06, 1.2


class Size(NamedTuple):
    """What stands for many signals.

    Attributes:
        title: Its name with its unit.
        curves: Its values of each take, (N,) each.
    """

    title: str
    curves: tuple[Array, ...]


def distances(film: Film) -> Size | None:
    """The norm of the controlled coordinates' distances from the ghost.

    Of a robot with hinges and slides, only those with the first one's unit count.

    Returns:
        None for few coordinates, or if a take has no ghost to be measured from.
    """
    system = film.takes[0].run.system
    signals = [system.states[index] for index in system.controlled]
    if len(signals) <= FEW or any(take.ghost is None for take in film.takes):
        return None
    unit, counted, which = _alike([signal.unit for signal in signals])
    columns = np.array(system.controlled)[counted]

    def distance(take: Take) -> Array:
        return np.linalg.norm(take.run.state[:, columns] - take.ghosts[:, counted], axis=1)

    title = f"distance of {which} |q − {film.ghost_symbol}| [{unit}]"
    return Size(title, tuple(map(distance, film.takes)))


def loads(film: Film) -> Size | None:
    """The largest input of all joints: as a share of its limit, if all of them have one.

    Without limits those with the first one's unit count.

    Returns:
        None for few inputs.
    """
    inputs, model = film.takes[0].run.system.inputs, film.model
    if len(inputs) <= FEW:
        return None
    applied = [take.run.input for take in film.takes]
    low, high = model.actuator_ctrlrange.T
    if np.all(model.actuator_ctrllimited) and np.all((low < 0) & (high > 0)):
        title = "largest input, of its limit [%]"
        shares = (100 * np.maximum(tau / low, tau / high) for tau in applied)
        return Size(title, tuple(share.max(axis=1) for share in shares))
    unit, counted, which = _alike([signal.unit for signal in inputs])
    title = f"largest input of {which} |τ| [{unit}]"
    return Size(title, tuple(np.abs(tau[:, counted]).max(axis=1) for tau in applied))


def _alike(units: list[str]) -> tuple[str, list[int], str]:
    """The first unit, which joints have it, and how many these are in words."""
    counted = [index for index, unit in enumerate(units) if unit == units[0]]
    every = len(counted) == len(units)
    return units[0], counted, "all joints" if every else f"{len(counted)} joints"


def _window(take: Take, times: tuple[float, float]) -> slice:
    """The rows of a run that the film shows."""
    first, last = np.searchsorted(take.run.time, (times[0] - 1e-9, times[1] + 1e-9))
    return slice(int(first), int(last))


def _limits(axes: Axes, curves: Sequence[Array]) -> None:
    """Fixed limits around all curves; a curve that is zero still gets an axis."""
    values = np.concatenate([*curves, [0.0]])
    least, most = float(values.min()), float(values.max())
    spread = (most - least) or 1.0
    axes.set_ylim(least - _SPREAD * spread, most + _SPREAD * spread)


def outputs(axes: Axes, film: Film, times: tuple[float, float]) -> list[Any]:
    """The controlled coordinate, and where it should have been; of many, how far that is."""
    if (size := distances(film)) is not None:
        return _sized(axes, film, times, size)
    run = film.takes[0].run
    controlled = list(run.system.controlled)
    ghosts = _distinct_ghosts(film)
    dashed = f"  (dashed: {film.ghost_symbol})" if ghosts else ""
    axes.set_title(f"{_names([run.system.states[index] for index in controlled])}{dashed}")
    lines, seen = [], []
    for take in film.takes:
        window = _window(take, times)
        for index, column in enumerate(controlled[: len(_STYLES)]):
            y = take.run.state[window, column]
            colour = _tint(take.colour, index)
            lines += axes.plot(take.run.time[window], y, color=colour, lw=2)
            seen.append(y)
    for ghost in ghosts:
        window = _window(film.longest, times)
        style: dict[str, Any] = {"color": OPTIMUM, "lw": 1.1, "ls": (0, (3, 2))}
        lines += axes.plot(film.longest.run.time[window], ghost[window], **style)
        seen.append(ghost[window].ravel())
    _limits(axes, seen)
    return lines


def _names(signals: Sequence[Signal]) -> str:
    """Names, symbols and units; of several, the first one's name and how each is drawn."""
    first = signals[0]
    if len(signals) == 1:
        return f"{first.name} {first.symbol} [{first.unit}]"
    drawn = ", ".join(
        f"{signal.symbol} {style}" for signal, style in zip(signals, _STYLES, strict=False)
    )
    return f"{drawn} [{first.unit}]"


def _distinct_ghosts(film: Film) -> list[Array]:
    """The ghosts' coordinates, each once; those of runs that ended early are left out."""
    ghosts: list[Array] = []
    for take in film.takes:
        if take.ghost is None or len(take.run.time) < len(film.longest.run.time):
            continue
        if not any(np.allclose(take.ghosts, other, atol=1e-9) for other in ghosts):
            ghosts.append(take.ghosts)
    return ghosts


def slidings(axes: Axes, film: Film, times: tuple[float, float]) -> list[Any]:
    """The sliding variable of the laws that have one, or a state in its place."""
    if film.beside is not None:
        return _state(axes, film, times, film.beside)
    signals = [(take, take.run.sliding) for take in film.takes if take.run.sliding is not None]
    peak = max((float(np.abs(s).max(initial=0.0)) for _, s in signals), default=0.0)
    scale, prefix = (1e3, "m") if peak < _SMALL else (1.0, "")
    units = sorted({prefix + take.sliding_unit for take, _ in signals})
    most = max((s.shape[1] for _, s in signals if s.ndim > 1), default=1)
    name = "s₁ dark, s₂ pale" if most > 1 else "sliding variable s"
    if most > FEW:
        name = "largest |s|" if _looped(film) else "largest sliding variable |s|"
        signals = [(take, np.abs(s).max(axis=1)) for take, s in signals]
    name += ", as the law sees it" if _looped(film) else ""
    axes.set_title(f"{name} [{', '.join(units)}]" if units else name)
    lines, seen = [], []
    for take, s in signals:
        for values, index in _columns(s):
            lines += _held(axes, take, scale * values, times, seen, index)
    without = [take.label for take in film.takes if take.run.sliding is None]
    if without:
        axes.text(
            0.98, 0.95, f"{', '.join(without)}: no surface", transform=axes.transAxes,
            ha="right", va="top", color="#555555", zorder=5,
            bbox={"facecolor": "white", "alpha": 0.8, "lw": 0, "pad": 1.5},
        )  # fmt: skip
        if most > FEW:
            # Sizes fill their axes from zero up: room for the words.
            seen += [_ROOM * values for values in seen]
    _limits(axes, seen)
    return lines


def _looped(film: Film) -> bool:
    """Whether something lies between laws and plant."""
    return any(take.run.seen is not None for take in film.takes)


def _state(axes: Axes, film: Film, times: tuple[float, float], index: int) -> list[Any]:
    """A state that the laws regulate beside the controlled ones."""
    axes.set_title(_names([film.takes[0].run.system.states[index]]))
    lines, seen = [], []
    for take in film.takes:
        window = _window(take, times)
        y = take.run.state[window, index]
        lines += axes.plot(take.run.time[window], y, color=take.colour, lw=2)
        seen.append(y)
    _limits(axes, seen)
    return lines


def inputs(axes: Axes, film: Film, times: tuple[float, float]) -> list[Any]:
    """The input that the actuator applied; of many, the largest."""
    if (size := loads(film)) is not None:
        return _sized(axes, film, times, size)
    title = _names(film.takes[0].run.system.inputs)
    axes.set_title(f"{title}, as it is given" if _looped(film) else title)
    lines, seen = [], []
    signals = [(take, *each) for take in film.takes for each in _columns(take.run.input)]
    for take, values, index in sorted(signals, key=_restless):
        lines += _held(axes, take, values, times, seen, index)
    _limits(axes, seen)
    return lines


def _sized(axes: Axes, film: Film, times: tuple[float, float], size: Size) -> list[Any]:
    """One curve for each take, of what stands for many signals; from zero up."""
    axes.set_title(size.title)
    lines, seen = [], []
    for take, values in sorted(zip(film.takes, size.curves, strict=True), key=_restless):
        lines += _held(axes, take, values, times, seen, 0)
    _limits(axes, seen)
    return lines


def _restless(drawn: tuple[Any, ...]) -> float:
    """Order of drawing: a law that switches fills its band, and the others are drawn on it."""
    return -float(np.abs(np.diff(drawn[1])).sum())


def _tint(colour: str, index: int) -> tuple[float, ...]:
    """The colour of a take's coordinate or input: its own, then paler."""
    share = _SHARES[index]
    return tuple(1 - share * (1 - part) for part in red_green_blue(colour))


def _columns(values: Array) -> list[tuple[Array, int]]:
    """Each signal of (N,) or (N, m) that is drawn, and its number."""
    rows = values[:, None] if values.ndim == 1 else values
    return [(row, i) for i, row in enumerate(rows.T[: len(_STYLES)])]


def _held(
    axes: Axes,
    take: Take,
    values: Array,
    times: tuple[float, float],
    seen: list[Array],
    index: int,
) -> list[Any]:
    """A signal of the intervals, thin where it jumps at every sample."""
    window = _window(take, times)
    y = values[window]
    seen.append(y)
    style: dict[str, Any] = {"lw": 0.35, "alpha": 0.75} if jumps(y) else {"lw": 1.8}
    colour = _tint(take.colour, index)
    return axes.plot(take.run.time[window][: len(y)], y, color=colour, **style)


# From left to right; each draws into its axes what a film shows between two instants.
PLOTS = (outputs, slidings, inputs)

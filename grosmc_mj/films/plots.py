"""The curves of a film's plots: outputs, sliding variables and inputs.

Of a robot with more of one kind than can be told apart, one curve for each run shows their size.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import to_rgb

from grosmc_mj.arrays import Array
from grosmc_mj.films.film import Film, Take
from grosmc_mj.plants.system import Signal
from grosmc_mj.results.palette import OPTIMUM

# More signals than this of one kind are shown by their size.
FEW = 2
# How several coordinates or inputs of one run are told apart.
_TINTS = (("dark", 1.0), ("pale", 0.5))
_GHOST: dict[str, Any] = {"color": OPTIMUM, "lw": 1.1, "ls": (0, (3, 2)), "zorder": 3}
# A sliding variable below this is shown in thousandths of its unit.
_SMALL = 0.1


class Curve(NamedTuple):
    """A signal over time [s], both (N,), and matplotlib's style of its line."""

    time: Array
    values: Array
    style: dict[str, Any]


class Panel(NamedTuple):
    """One plot: its title with the unit, its curves and a note."""

    title: str
    curves: list[Curve]
    note: str = ""


def outputs(film: Film) -> Panel:
    """The controlled coordinates and where they should have been; of many, how far that is.

    Of a robot with hinges and slides, only those with the first one's unit count.
    """
    system = film.takes[0].run.system
    columns = list(system.controlled)
    signals, takes = [system.states[column] for column in columns], film.takes
    if len(signals) > FEW and all(take.ghost is not None for take in takes):
        alike, kind = _alike(signals)
        errors = [(take.run.state[:, columns] - take.ghosts)[:, alike] for take in takes]
        title = f"distance of {kind} |q − {film.ghost_symbol}| [{signals[0].unit}]"
        return Panel(title, _curves(takes, [np.linalg.norm(error, axis=1) for error in errors]))
    curves = _curves(takes, [take.run.state[:, columns] for take in takes])
    # Of a run that ended early it would end early too.
    whole = [take for take in takes if len(take.run.time) == len(film.longest.run.time)]
    ghosts = [take for take in whole if take.ghost is not None]
    curves += [Curve(take.run.time, y, _GHOST) for take in ghosts for y in take.ghosts.T]
    dashed = f"  (dashed: {film.ghost_symbol})" if ghosts else ""
    return Panel(_title(signals) + dashed, curves)


def surfaces(film: Film) -> Panel:
    """The sliding variables of the laws that have some, or a state in their place."""
    takes = film.takes
    if film.beside is not None:
        states = [take.run.state[:, film.beside] for take in takes]
        return Panel(_title([takes[0].run.system.states[film.beside]]), _curves(takes, states))
    sliding = [take for take in takes if take.run.sliding is not None]
    values = [np.asarray(take.run.sliding) for take in sliding]
    peak = max((float(np.abs(s).max(initial=0.0)) for s in values), default=0.0)
    scale, prefix = (1e3, "m") if peak < _SMALL else (1.0, "")
    looped, most = _looped(film), max((s.shape[1] for s in values if s.ndim > 1), default=1)
    name = "sliding variable s" if most == 1 else "s₁ dark, s₂ pale"
    if most > FEW:
        name = "largest |s|" if looped else "largest sliding variable |s|"
        values = [np.abs(s).max(axis=1) for s in values]
    units = ", ".join(sorted({prefix + take.sliding_unit for take in sliding}))
    title = name + (", as the law sees it" if looped else "") + (f" [{units}]" if units else "")
    without = ", ".join(take.label for take in takes if take.run.sliding is None)
    note = f"{without}: no surface" if without else ""
    return Panel(title, _curves(sliding, [scale * s for s in values]), note)


def inputs(film: Film) -> Panel:
    """The inputs that the actuators applied; of many, the largest.

    That is a share of the limit, if all inputs have one, else of those with the first one's unit.
    """
    signals, model = film.takes[0].run.system.inputs, film.model
    values = [take.run.input for take in film.takes]
    if len(signals) <= FEW:
        title = _title(signals) + (", as it is given" if _looped(film) else "")
        return Panel(title, _curves(film.takes, values))
    low, high = model.actuator_ctrlrange.T
    if np.all(model.actuator_ctrllimited) and np.all((low < 0) & (high > 0)):
        shares = [100 * np.maximum(tau / low, tau / high).max(axis=1) for tau in values]
        return Panel("largest input, of its limit [%]", _curves(film.takes, shares))
    alike, kind = _alike(signals)
    largest = [np.abs(tau[:, alike]).max(axis=1) for tau in values]
    return Panel(f"largest input of {kind} |τ| [{signals[0].unit}]", _curves(film.takes, largest))


# From left to right.
PANELS = (outputs, surfaces, inputs)


def _curves(takes: Iterable[Take], values: Iterable[Array]) -> list[Curve]:
    """A curve for each of the first signals of each run, (N,) or (N, signals)."""
    curves = []
    for take, rows in zip(takes, values, strict=True):
        columns = rows[:, None] if rows.ndim == 1 else rows
        for column, (_, share) in zip(columns.T, _TINTS, strict=False):
            tint = tuple(1 - share * (1 - part) for part in to_rgb(take.colour))
            curves.append(Curve(take.run.time[: len(column)], column, {"color": tint}))
    return curves


def _title(signals: Sequence[Signal]) -> str:
    """Name, symbol and unit of a signal; of several, how each is drawn."""
    first = signals[0]
    if len(signals) == 1:
        return f"{first.name} {first.symbol} [{first.unit}]"
    drawn = (f"{signal.symbol} {tint}" for signal, (tint, _) in zip(signals, _TINTS, strict=False))
    return f"{', '.join(drawn)} [{first.unit}]"


def _alike(signals: Sequence[Signal]) -> tuple[list[int], str]:
    """Which signals have the first one's unit, and how many joints these are, in words."""
    alike = [i for i, signal in enumerate(signals) if signal.unit == signals[0].unit]
    return alike, "all joints" if len(alike) == len(signals) else f"{len(alike)} joints"


def _looped(film: Film) -> bool:
    """Whether something lies between laws and plant."""
    return any(take.run.seen is not None for take in film.takes)

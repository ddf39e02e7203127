"""A plant of the user's own, from a few lines of sympy."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import make_dataclass
from typing import Any

import sympy as sp

from grosmc_mj.errors import ModelError
from grosmc_mj.plants.equations import Equations
from grosmc_mj.plants.system import AnalyticPlant, Signal, System


def affine_plant(
    name: str,
    *,
    states: Mapping[str, str],
    inputs: Mapping[str, str],
    f: Sequence[Any],
    g: Sequence[Any],
    h: Sequence[Any],
    parameters: Mapping[str, float],
    region: Any = True,
    where: str = "",
) -> AnalyticPlant:
    """An analytic plant x' = f(x) + g(x) u, y = h(x), eq. (20), from sympy expressions.

    Args:
        name: Name of the system.
        states: Unit of each state, by the name of its symbol.
        inputs: Unit of each input, by its name.
        f: Drift, one expression for each state.
        g: Input matrix, one row for each state; for one input a row may be its one entry.
        h: Outputs, as many as inputs.
        parameters: Number of every other symbol, by its name.
        region: Condition on the states within which the laws are defined.
        where: The same in words.

    Returns:
        The plant with these numbers; ``with_parameters`` gives others of its family.

    Raises:
        ModelError: If rows are missing, a symbol has no number or a number no symbol, or a
            number is not finite.
    """
    for symbol, value in parameters.items():
        if not math.isfinite(value):
            raise ModelError(f"{name}: {symbol} = {value:g} must be finite")
    try:
        equations = Equations(
            x=tuple(sp.Symbol(state) for state in states), f=f, g=g, h=h, region=sp.sympify(region)
        )
    except ModelError as error:
        raise ModelError(f"{name}: {error}") from error
    needed, given = {str(symbol) for symbol in equations.parameters}, set(parameters)
    if needed != given:
        missing, idle = ", ".join(sorted(needed - given)), ", ".join(sorted(given - needed))
        raise ModelError(
            f"{name}: "
            + (f"no state and no number for {missing}; " if missing else "")
            + (f"no equation has {idle}; " if idle else "")
            + f"states: {', '.join(states)}; parameters: {', '.join(parameters)}"
        )
    system = System(
        name=name,
        title=name,
        states=tuple(Signal(state, state, unit) for state, unit in states.items()),
        inputs=tuple(Signal(each, each, unit) for each, unit in inputs.items()),
        equations=equations,
        region=where or str(region),
        controlled=_controlled(equations),
    )
    numbers = make_dataclass("Parameters", [(key, float) for key in parameters], frozen=True)
    return AnalyticPlant(system, numbers(**{key: float(v) for key, v in parameters.items()}))


def _controlled(equations: Equations) -> tuple[int, ...]:
    """The states that are outputs; the first one, if none is."""
    rows = tuple(i for i, state in enumerate(equations.x) if state in equations.h)
    return rows or (0,)

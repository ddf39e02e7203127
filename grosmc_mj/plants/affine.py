"""A plant of the user's own, from a few lines of sympy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import make_dataclass
from typing import Any

import numpy as np
import sympy as sp
from sympy.logic.boolalg import Boolean

from grosmc_mj.arguments import require_known
from grosmc_mj.errors import ModelError, one_line, shown
from grosmc_mj.fields import Finite, Name, checked_call
from grosmc_mj.plants.analytic import AnalyticPlant
from grosmc_mj.plants.equations import Equations, Expressions
from grosmc_mj.plants.system import Signal, System

_TRUTH = "g has truth values, must have expressions of sympy, or numbers"


@checked_call
def affine_plant(
    name: Name,
    *,
    states: Mapping[str, str],
    inputs: Mapping[str, str],
    f: Expressions,
    g: Any,
    h: Expressions,
    parameters: Mapping[str, Finite],
    region: Any = True,
    where: str = "",
    near: Mapping[str, Finite] | None = None,
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
        near: States next to which it is used, in their units; the others are zero. Equilibria are
            looked for from there.

    Returns:
        The plant with these numbers; ``with_parameters`` gives others of its family.

    Raises:
        ArgumentError: If an argument is of another kind.
        ModelError: If rows are missing, or a symbol has no number or a number no symbol.
    """
    try:
        symbols = tuple(sp.Symbol(state) for state in states)
        if any(isinstance(entry, bool) for row in g for entry in np.ravel(row).tolist()):
            raise TypeError(_TRUTH)  # noqa: TRY301
        if not isinstance(region, (bool, Boolean)):
            raise TypeError(f"region = {shown(region)} must be a condition of sympy")  # noqa: TRY301
        equations = Equations(x=symbols, f=f, g=g, h=h, region=region)
    except (sp.SympifyError, AttributeError, TypeError, ValueError) as error:
        raise ModelError(f"{name}: the equations cannot be read: {one_line(str(error))}") from error
    if not len(equations.h) == equations.inputs == len(inputs):
        raise ModelError(
            f"{name}: {len(inputs)} inputs are named, g has {equations.inputs} columns and h "
            f"{len(equations.h)} outputs: all three must be the same"
        )
    needed = {str(symbol) for symbol in equations.parameters}
    problems = (
        (needed & set(states), "another symbol than the state: make it without assumptions"),
        (needed & set(inputs), "an input outside of g: make it a state and its rate the input"),
        (needed - {*parameters, *states, *inputs}, f"no number, and none of {', '.join(states)}"),
        (set(parameters) - needed, "a number that is in no equation"),
    )
    if mistakes := [f"{', '.join(sorted(names))}: {text}" for names, text in problems if names]:
        raise ModelError(f"{name}: {'; '.join(mistakes)}")
    for state in near or {}:
        require_known("state", state, states, f"{name}: near: ", ModelError)
    # The first state stands for the outputs where none of them is a state.
    system = System(
        name=name,
        title=name,
        states=tuple(Signal(state, state, unit) for state, unit in states.items()),
        inputs=tuple(Signal(symbol, symbol, unit) for symbol, unit in inputs.items()),
        equations=equations,
        region=where or str(region),
        controlled=tuple(i for i, x in enumerate(equations.x) if x in equations.h) or (0,),
        near=tuple(near.get(state, 0.0) for state in states) if near else (),
    )
    numbers = make_dataclass("Parameters", [(key, float) for key in parameters], frozen=True)
    return AnalyticPlant(system, numbers(**{key: float(v) for key, v in parameters.items()}))

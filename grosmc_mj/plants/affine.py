"""A plant of the user's own, from a few lines of sympy."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import make_dataclass
from typing import Any

import sympy as sp
from sympy.logic.boolalg import Boolean

from grosmc_mj.arguments import real, require, require_known
from grosmc_mj.errors import ModelError, one_line, shown
from grosmc_mj.plants.analytic import AnalyticPlant
from grosmc_mj.plants.equations import Equations
from grosmc_mj.plants.system import Signal, System


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
    near: Mapping[str, float] | None = None,
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
        ModelError: If rows are missing, a symbol has no number or a number no symbol, or a
            number is not finite.
    """
    require(f"{name}: where", where, str, "a text", ModelError)
    require(f"{name}: parameters", parameters, Mapping, "numbers by their symbols", ModelError)
    for symbol, value in parameters.items():
        if not (math.isfinite(real(value))):
            raise ModelError(f"{name}: {symbol} = {shown(value)} must be a finite number")
    for noun, units in (("states", states), ("inputs", inputs)):
        if not (isinstance(units, Mapping) and all(isinstance(each, str) for each in units)):
            raise ModelError(
                f"{name}: {noun} = {shown(units)} must give a unit by the name of each"
            )
    try:
        within = sp.sympify(region)
        require(f"{name}: region", within, Boolean, "a condition on the states", ModelError)
        equations = Equations(
            x=tuple(sp.Symbol(state) for state in states), f=f, g=g, h=h, region=within
        )
    except (ModelError, sp.SympifyError, AttributeError, TypeError, ValueError) as error:
        reason = one_line(str(error))
        raise ModelError(f"{name}: the equations cannot be read: {reason}") from error
    if len(equations.h) != equations.inputs or equations.inputs != len(inputs):
        raise ModelError(
            f"{name}: {len(inputs)} inputs are named, g has {equations.inputs} columns and h "
            f"{len(equations.h)} outputs: all three must be the same"
        )
    needed, given = {str(symbol) for symbol in equations.parameters}, set(parameters)
    assumed = sorted(s.name for s in equations.parameters if s.name in states)
    if assumed:
        raise ModelError(
            f"{name}: {', '.join(assumed)} have assumptions, such as real=True, and so are other "
            "symbols than the states: make them without"
        )
    if needed != given:
        if driven := sorted((needed - given) & set(inputs)):
            raise ModelError(
                f"{name}: {', '.join(driven)}, an input, stands in the equations: they must be "
                "affine in it, x' = f(x) + g(x) u, with its factors in g; if they are not, make it "
                "a state and its rate the input"
            )
        missing, idle = ", ".join(sorted(needed - given)), ", ".join(sorted(given - needed))
        raise ModelError(
            f"{name}: "
            + (f"no state and no number for {missing}; " if missing else "")
            + (f"no equation has {idle}; " if idle else "")
            + f"states: {', '.join(states)}; parameters: {', '.join(parameters)}"
        )
    near = {} if near is None else near
    require("near", near, Mapping, "values by the states' names", ModelError)
    for state in near:
        require_known("state", state, states, f"{name}: near: ", ModelError)
    # The first state stands for the outputs where none of them is a state.
    system = System(
        name=name,
        title=name,
        states=tuple(Signal(state, state, unit) for state, unit in states.items()),
        inputs=tuple(Signal(each, each, unit) for each, unit in inputs.items()),
        equations=equations,
        region=where or str(region),
        controlled=tuple(i for i, x in enumerate(equations.x) if x in equations.h) or (0,),
        near=tuple(near.get(state, 0.0) for state in states) if near else (),
    )
    numbers = make_dataclass("Parameters", [(key, float) for key in parameters], frozen=True)
    return AnalyticPlant(system, numbers(**{key: float(v) for key, v in parameters.items()}))

"""A plant of the user's own, from a few lines of sympy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import make_dataclass
from typing import Any

import numpy as np
import sympy as sp
from sympy.logic.boolalg import Boolean

from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ModelError, one_line, value_text
from grosmc_mj.ground.fields import Finite, Name, checked_call
from grosmc_mj.theory.plants.equations import Equations, Expressions
from grosmc_mj.theory.plants.plant import AnalyticPlant
from grosmc_mj.theory.plants.system import Signal, System


@checked_call
def affine_plant(
    name: Name,
    *,
    states: Mapping[str, str | tuple[str, str]],
    inputs: Mapping[str, str],
    f: Expressions,
    g: Any,
    h: Expressions,
    parameters: Mapping[str, Finite],
    region: Any = True,
    where: str = "",
    near: Mapping[str, Finite] | None = None,
) -> AnalyticPlant:
    """Make an analytic plant x' = f(x) + g(x) u, y = h(x), eq. (20), from sympy expressions.

    Args:
        name: Name of the system.
        states: Unit of each state by its name, which is the name of its symbol, too; or unit and
            symbol, such as ``{"angle": ("rad", "q")}``.
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
        The plant with these numbers; ``changed`` gives others of its family.

    Raises:
        ArgumentError: If an argument is of another kind.
        ModelError: If rows are missing, or a symbol has no number or a number no symbol.
    """
    signals = _states(states)
    symbols = [signal.symbol for signal in signals]
    equations = _read_equations(name, tuple(symbols), f, g, h, region)
    if not len(equations.h) == equations.inputs == len(inputs):
        raise ModelError(
            f"{name}: {len(inputs)} inputs are named, g has {equations.inputs} columns and h "
            f"{len(equations.h)} outputs: all three must be the same"
        )

    _require_matching_symbols(name, equations, set(symbols), set(inputs), set(parameters))
    near = near or {}
    for state in near:
        require_known("state", state, states, f"{name}: near: ", ModelError)

    system = System(
        name=name,
        title=name,
        states=signals,
        inputs=tuple(Signal(symbol, symbol, unit) for symbol, unit in inputs.items()),
        equations=equations,
        region=where or str(region),
        controlled=_output_states(equations),
        near=tuple(near.get(state, 0.0) for state in states) if near else (),
    )
    fields = [(parameter, float) for parameter in parameters]
    parameter_class = make_dataclass("Parameters", fields, frozen=True)
    numbers = {parameter: float(number) for parameter, number in parameters.items()}
    return AnalyticPlant(system, parameter_class(**numbers))


def _read_equations(
    name: str,
    states: tuple[str, ...],
    f: Any,
    g: Any,
    h: Any,
    region: Any,
) -> Equations:
    """Equations of a system, whose mistakes carry its name.

    Raises:
        ModelError: If sympy cannot read them.
    """
    try:
        symbols = tuple(sp.Symbol(state) for state in states)
        entries = [entry for row in g for entry in np.ravel(row).tolist()]
        if any(isinstance(entry, bool) for entry in entries):
            raise TypeError(  # noqa: TRY301
                "g has truth values, must have expressions of sympy, or numbers"
            )
        if not isinstance(region, (bool, Boolean)):
            raise TypeError(f"region = {value_text(region)} must be a condition of sympy")  # noqa: TRY301
        return Equations(x=symbols, f=f, g=g, h=h, region=region)
    except (sp.SympifyError, AttributeError, TypeError, ValueError) as error:
        raise ModelError(f"{name}: the equations cannot be read: {one_line(str(error))}") from error


def _require_matching_symbols(
    name: str,
    equations: Equations,
    states: set[str],
    inputs: set[str],
    parameters: set[str],
) -> None:
    """Refuse symbols without a number and numbers without a symbol, all in one message.

    Raises:
        ModelError: If there are any.
    """
    needed = {str(symbol) for symbol in equations.parameters}
    without_number = needed - parameters - states - inputs
    problems = (
        (needed & states, "another symbol than the state: make it without assumptions"),
        (needed & inputs, "an input outside of g: make it a state and its rate the input"),
        (
            without_number,
            f"no number, and no state has that symbol: {', '.join(map(str, equations.x))}; of a "
            'state with another name give the symbol beside its unit: {"angle": ("rad", "q")}',
        ),
        (parameters - needed, "a number that is in no equation"),
    )
    mistakes = [f"{', '.join(sorted(names))}: {text}" for names, text in problems if names]
    if mistakes:
        raise ModelError(f"{name}: {'; '.join(mistakes)}")


def _states(units: Mapping[str, str | tuple[str, str]]) -> tuple[Signal, ...]:
    """States with their units, named by their symbols or with symbols of their own."""
    signals = []
    for name, unit in units.items():
        if isinstance(unit, str):
            signals.append(Signal(name, name, unit))
        else:
            signals.append(Signal(name, unit[1], unit[0]))
    return tuple(signals)


def _output_states(equations: Equations) -> tuple[int, ...]:
    """Indices of the states that are outputs; the first state where none of them is."""
    indices = tuple(i for i, state in enumerate(equations.x) if state in equations.h)
    return indices or (0,)

"""States by name in a case file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import Mistakes
from grosmc_mj.ground.units import number_in
from grosmc_mj.theory.plants import System


def state_of(
    values: Mapping[str, Any],
    system: System,
    where: str,
    rest: Sequence[float] | None = None,
) -> tuple[float, ...]:
    """Return a state from values of some states by name.

    Args:
        values: Values with their units.
        system: System with the states.
        where: Beginning of messages.
        rest: Values of the other states, (n,); zero by default.

    Raises:
        ArgumentError: If a state is unknown, or a unit does not fit.
    """
    x = [0.0] * len(system.states)
    if rest is not None:
        x = [float(number) for number in rest]
    for index, value in states_of(values, system, where).items():
        x[index] = value
    return tuple(x)


def states_of(values: Mapping[str, Any], system: System, where: str) -> dict[int, float]:
    """Return values of states by index from values by name; raises as ``state_of``."""
    names = [state.name for state in system.states]
    by_index = {}
    mistakes = Mistakes()
    for name, value in values.items():
        place = f"{where}: {name}: " if name in names else f"{where}: "
        with mistakes.gathered(place):
            require_known("state", name, names)
            index = names.index(name)
            by_index[index] = number_in(value, system.states[index].unit)
    mistakes.refuse()
    return by_index

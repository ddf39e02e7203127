"""Where a plant rests: an equilibrium and the input that holds it there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, PremiseError, shown
from grosmc_mj.fields import Finite, Is, Range, Reals, checked_call
from grosmc_mj.plants.plant import AT_REST, Plant


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """An equilibrium, 0 = x'(x, u).

    Attributes:
        x: State, (n,).
        u: Input that holds it there, (m,).
    """

    x: Array
    u: Array

    @classmethod
    def origin(cls, plant: Plant) -> OperatingPoint:
        """x = 0 and u = 0 of a plant."""
        return cls(np.zeros(len(plant.system.states)), np.zeros(len(plant.system.inputs)))


@checked_call
def equilibrium(
    plant: Annotated[Plant, Is(Plant, "a plant, such as MujocoPlant.load(...)")],
    held: Mapping[Annotated[int, Range(0, whole=True)], Finite] | None = None,
    near: Annotated[ArrayLike, Reals((None,))] | None = None,
) -> OperatingPoint:
    """Where a plant rests with some of its states held: the other states and the inputs.

    Of several that there are, it is one next to ``near``.

    Args:
        plant: In MuJoCo or as equations.
        held: Values of states, by their indices.
        near: State where the search begins, (n,); the system's own ``near`` by default. It begins
            without input.

    Raises:
        ArgumentError: If a state or a number is none.
        PremiseError: If it rests nowhere near with these states, or only beyond its input's limits.
    """
    system, held = plant.system, dict(held or {})
    n = len(system.states)
    start = np.array(system.near or np.zeros(n) if near is None else near, float)
    if start.shape != (n,) or max(held, default=0) >= n:
        raise ArgumentError(
            f"{system.name}: held = {shown(held)} must give values of states 0 to {n - 1}, and "
            f"near = {shown(near)} {n} numbers"
        )
    start[list(held)] = list(held.values())
    free = [i for i in range(n) if i not in held]

    def point(values: Array) -> OperatingPoint:
        x = start.copy()
        x[free] = values[: len(free)]
        return OperatingPoint(x, values[len(free) :])

    def rates(values: Array) -> Array:
        here = point(values)
        try:
            return np.nan_to_num(plant.derivative(here.x, here.u), nan=1e6)
        except (ArithmeticError, ValueError):  # outside a function's domain
            return np.full(n, 1e6)

    # Here, for it is a part of scipy that little needs.
    import scipy.optimize

    begin = np.concatenate([start[free], np.zeros(len(system.inputs))])
    solution = scipy.optimize.least_squares(rates, begin, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    resting, (low, high) = point(solution.x), plant.input_limits
    limited = np.any(resting.u < low) or np.any(resting.u > high)
    if limited or not np.abs(solution.fun).max() <= AT_REST:
        where = ", ".join(f"{system.states[i].name} = {value:g}" for i, value in held.items())
        raise PremiseError(
            f"{system.name} rests nowhere near x = {start.tolist()} with {where or 'any state'}: "
            f"the least x' is {solution.fun.tolist()}"
            + (f" under inputs cut to {low.tolist()} ... {high.tolist()}" if limited else "")
            + "; hold other states, or begin elsewhere"
        )
    return resting

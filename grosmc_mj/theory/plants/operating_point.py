"""Equilibria of a plant, and the inputs that hold it there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, PremiseError, array_text, value_text
from grosmc_mj.ground.fields import Finite, Is, Range, Reals, checked_call
from grosmc_mj.theory.plants.plant import AT_REST, Plant

# Rate in the place of one that is not defined, far above those of any equilibrium.
_NO_RATE = 1e6


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
        """Return x = 0 and u = 0 of a plant."""
        system = plant.system
        return cls(np.zeros(len(system.states)), np.zeros(len(system.inputs)))


@checked_call
def equilibrium(
    plant: Annotated[Plant, Is(Plant, "a plant, such as MujocoPlant.load(...)")],
    held: Mapping[Annotated[int, Range(0, whole=True)], Finite] | None = None,
    near: Annotated[ArrayLike, Reals((None,))] | None = None,
) -> OperatingPoint:
    """Find where a plant rests with some of its states held: the other states and the inputs.

    Of several equilibria it is one next to ``near``.

    Args:
        plant: In MuJoCo or as equations.
        held: Values of states, by their indices.
        near: State where the search begins, (n,); the system's own ``near`` by default. It begins
            without input.

    Raises:
        ArgumentError: If a state or a number is none.
        PremiseError: If it rests nowhere near with these states, or only beyond its input's limits.
    """
    system = plant.system
    held = dict(held or {})
    n = len(system.states)

    if near is None:
        near = system.near or np.zeros(n)
    start = np.array(near, float)
    if start.shape != (n,) or max(held, default=0) >= n:
        raise ArgumentError(
            f"{system.name}: held = {value_text(held)} must give values of states 0 to {n - 1}, "
            f"and near = {value_text(near)} {n} numbers"
        )
    start[list(held)] = list(held.values())

    search = _Search(plant, start, [i for i in range(n) if i not in held])
    point, rates = search.run()

    low, high = plant.input_limits
    limited = bool(np.any(point.u < low) or np.any(point.u > high))
    at_rest = np.abs(rates).max() <= AT_REST
    if limited or not at_rest:
        values = ", ".join(f"{system.states[i].name} = {value:g}" for i, value in held.items())
        limits = f" under inputs cut to {array_text(low)} ... {array_text(high)}" if limited else ""
        raise PremiseError(
            f"{system.name} rests nowhere near x = {array_text(start)} with "
            f"{values or 'any state'}: the least x' is {array_text(rates)}{limits}; hold "
            "other states, or begin elsewhere"
        )
    return point


@dataclass(frozen=True, eq=False)
class _Search:
    """Least squares for x'(x, u) = 0 over the free states and the inputs.

    Attributes:
        plant: In MuJoCo or as equations.
        start: State with the held values, where the search begins, (n,).
        free: Indices of the other states.
    """

    plant: Plant
    start: Array
    free: list[int]

    def run(self) -> tuple[OperatingPoint, Array]:
        """Find the point with the least rates, and these, (n,)."""
        no_input = np.zeros(len(self.plant.system.inputs))
        begin = np.concatenate([self.start[self.free], no_input])
        rates = self._rates(begin)
        if not rates.any():
            return self._point(begin), rates

        # Imported in the function, for few runs need this part of scipy.
        import scipy.optimize

        solution = scipy.optimize.least_squares(
            self._rates, begin, xtol=1e-15, ftol=1e-15, gtol=1e-15
        )
        return self._point(solution.x), solution.fun

    def _point(self, unknowns: Array) -> OperatingPoint:
        """State and input with these free states, followed by the inputs."""
        count = len(self.free)
        x = self.start.copy()
        x[self.free] = unknowns[:count]
        return OperatingPoint(x, unknowns[count:])

    def _rates(self, unknowns: Array) -> Array:
        """x' at that point, (n,); large where the plant has none."""
        point = self._point(unknowns)
        try:
            rates = self.plant.derivative(point.x, point.u)
        except (ArithmeticError, ValueError):  # outside a function's domain
            return np.full(len(point.x), _NO_RATE)
        return np.nan_to_num(rates, nan=_NO_RATE)

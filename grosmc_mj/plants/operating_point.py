"""Where a plant rests: an equilibrium and the input that holds it there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arguments import real, reals, require, whole
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, PremiseError, shown
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


def equilibrium(
    plant: Plant, held: Mapping[int, float] | None = None, near: ArrayLike | None = None
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
    require("plant", plant, Plant, "a plant, such as MujocoPlant.load(...)")
    require("held", {} if held is None else held, Mapping, "values by the states' indices")
    system, held = plant.system, dict(held or {})
    n = len(system.states)
    x = reals(system.near or np.zeros(n) if near is None else near).copy()
    known = all((k := whole(i)) is not None and 0 <= k < n for i in held)
    if x.shape != (n,) or not known or not np.all(np.isfinite([*x, *map(real, held.values())])):
        raise ArgumentError(
            f"{system.name}: held = {shown(held)} must give finite values of states 0 to {n - 1}, "
            f"and near = {shown(near)} {n} finite numbers"
        )
    x[list(held)] = list(held.values())
    free = [i for i in range(n) if i not in held]
    point = OperatingPoint(x, np.zeros(len(system.inputs)))

    def filled(values: Array) -> OperatingPoint:
        whole = x.copy()
        whole[free] = values[: len(free)]
        return OperatingPoint(whole, values[len(free) :])

    def rates(values: Array) -> Array:
        here = filled(values)
        try:
            found = plant.derivative(here.x, here.u)
        except (ArithmeticError, ValueError):  # outside a function's domain
            found = np.full(n, np.nan)
        return np.where(np.isfinite(found), found, 1e6)

    begun = np.concatenate([x[free], point.u])
    if np.abs(rates(begun)).max() > 0.0:
        # Here, for it is a part of scipy that little needs.
        import scipy.optimize

        found = scipy.optimize.least_squares(rates, begun, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        point = filled(found.x)
    left = rates(np.concatenate([point.x[free], point.u]))
    named = [(system.states[i], value) for i, value in held.items()]
    where = ", ".join(f"{state.name} = {value:g} {state.unit}" for state, value in named)
    low, high = plant.input_limits
    limited = np.any(point.u < low) or np.any(point.u > high)
    if limited or not np.abs(left).max() <= AT_REST:
        raise PremiseError(
            f"{system.name} rests nowhere near x = {x.tolist()}"
            + (f" with {where}" if where else "")
            + f": the least x' found is {left.tolist()}"
            + (f" under inputs cut to {low.tolist()} ... {high.tolist()}" if limited else "")
            + "; hold other states, or begin elsewhere"
        )
    return point

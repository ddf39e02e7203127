"""The timestep with which RK4 keeps a plant's own damped motions stable."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GrosmcError
from grosmc_mj.simulation.problem import Problem
from grosmc_mj.theory.plants import Plant

# A pole of zero to rounding, as a share of the fastest one, is no motion that dies away.
_ROUNDING = 1e-9


def remedy(problem: Problem) -> str:
    """Advice for a run whose state grew without bound.

    It names the timestep that the fastest damped pole of the plant needs at the start, if the run's
    is longer.
    """
    general = "the loop is unstable, or its control period or timestep is too long"
    plant = problem.plants[0]
    if plant.stepped_by != "RK4":
        return general
    fastest = fastest_damped_pole(plant, problem.x0[0])
    if fastest is None or _growth(fastest * problem.timestep) <= 1:
        return general

    longest = longest_timestep(fastest)
    works = written_timestep(longest, problem.control_period)
    return (
        f"{plant.system.name} has a pole at {fastest.real:.3g} 1/s, for which RK4 needs a timestep "
        f'of at most {longest:.2g} s: take timestep = "{works}" with control_period = '
        f'"{1e3 * problem.control_period:g} ms"'
    )


def fastest_damped_pole(plant: Plant, x: Array) -> complex | None:
    """Fastest pole of a plant that is damped, without input; None if it has none.

    Args:
        plant: The plant.
        x: State that it is linearized at, (n,).
    """
    try:
        A, _ = plant.jacobian(x, np.zeros(len(plant.system.inputs)))
    except (GrosmcError, ArithmeticError, ValueError):
        # Undefined there, or with hidden states.
        return None
    if not np.all(np.isfinite(A)):
        return None
    poles: list[complex] = np.linalg.eigvals(A).tolist()
    rounding = _ROUNDING * max(map(abs, poles))
    damped = [complex(pole) for pole in poles if complex(pole).real < -rounding]
    return max(damped, key=abs, default=None)


def longest_timestep(pole: complex) -> float:
    """Longest timestep with which RK4 does not make a damped pole [1/s] grow [s]."""
    # Beyond 3/|pole| none is stable; slowly damped ones are only below.
    shares = np.linspace(0, 3, 30_001)[1:]
    grown = np.flatnonzero(_growth(pole / abs(pole) * shares) > 1)
    last = grown[0] - 1 if len(grown) else len(shares) - 1
    return float(shares[max(last, 0)] / abs(pole))


def _growth(z: Any) -> Any:
    """Factor of a step of RK4 on x' = lambda x, with z = lambda h."""
    return np.abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4))))


def written_timestep(longest: float, control_period: float) -> str:
    """A timestep below the longest that divides a control period, with its unit.

    It is 1, 2 or 5 times a power of ten if such a number does that is a fifth of it at least.

    Args:
        longest: [s].
        control_period: [s].
    """
    power = math.floor(math.log10(longest))
    rounds = [m * 10.0**k for k in (power, power - 1) for m in (5, 2, 1)]
    fitting = [h for h in rounds if longest / 5 <= h <= longest and _divides(h, control_period)]
    steps = math.ceil(control_period / longest)
    timestep = fitting[0] if fitting else control_period / steps
    if timestep >= 1e-3:
        return f"{1e3 * timestep:.12g} ms"
    return f"{1e6 * timestep:.12g} us"


def _divides(timestep: float, period: float) -> bool:
    """Whether a control period is a multiple of a timestep."""
    steps = period / timestep
    return math.isclose(steps, round(steps), rel_tol=1e-9) and round(steps) > 0

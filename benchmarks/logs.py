"""The simulated logs in ``grosmc_mj/cases/logs``: python -m benchmarks.logs FOLDER.

Both machines move by integrators of this folder, which share nothing with the package.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from benchmarks import coverage
from grosmc_mj.arrays import Array

# Of eq. (57): inertia without the payload at q = 0, its change with sin q, arm and gravity.
INERTIA, CABLE, LENGTH, GRAVITY = 0.095, 0.06, 0.5, 9.8
# The numbers that the log hides: payload [kg] (0.02 in the chapter), viscous friction [N m s/rad].
PAYLOAD, DAMPING = 0.0634, 0.0217
NOISE, SAMPLING, FINE, SECONDS = 1e-3, 2e-3, 1e-4, 4.0


def rate_of(q: float, rate: float, torque: float) -> float:
    """Acceleration of the arm: eq. (57) with the velocity term that energy asks for."""
    inertia = INERTIA + CABLE * np.sin(q) + PAYLOAD * LENGTH**2
    load = 0.5 * CABLE * np.cos(q) * rate**2 + PAYLOAD * GRAVITY * LENGTH * np.cos(q)
    return float((torque - load - DAMPING * rate) / inertia)


def arm() -> tuple[Array, Array, Array]:
    """Time, torque and measured angle, (samples,) each, from the arm hanging at rest."""
    random = np.random.default_rng(11)
    time = np.arange(round(SECONDS / SAMPLING)) * SAMPLING
    torque = np.repeat(random.uniform(-0.25, 0.25, len(time) // 100 + 1), 100)[: len(time)]
    x, angles = np.array([-np.pi / 2, 0.0]), np.zeros(len(time))

    def slope(x: Array, u: float) -> Array:
        return np.array([x[1], rate_of(x[0], x[1], u)])

    for i, u in enumerate(torque):
        angles[i] = x[0]
        for _ in range(round(SAMPLING / FINE)):
            a = slope(x, u)
            b = slope(x + FINE / 2 * a, u)
            c = slope(x + FINE / 2 * b, u)
            x = x + FINE / 6 * (a + 2 * b + 2 * c + slope(x + FINE * c, u))
    return time, torque, angles + NOISE * random.standard_normal(len(time))


def write(path: Path, header: str, *columns: Array) -> None:
    """A log as CSV."""
    rows = np.column_stack(columns)
    np.savetxt(path, rows, ["%.3f", "%.4f", "%.5f"], ",", header=header, comments="")


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    _, log = coverage.machine(0)
    few = slice(0, round(SECONDS / coverage.SAMPLING))
    servo = (log.time[few], log.inputs[few, 0], log.states["rotor angle"][few])
    write(folder / "servo.csv", "time [s],current [A],rotor angle [rad]", *servo)
    write(folder / "arm.csv", "time [s],torque [N m],joint angle [rad]", *arm())

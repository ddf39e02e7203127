"""The simulated logs in ``grosmc_mj/experiments/cases/logs``: python -m benchmarks.logs FOLDER.

Both machines move by integrators of this folder, which share nothing with the package.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from benchmarks import coverage
from grosmc_mj.ground.arrays import Array

# Of eq. (57): inertia without the payload at q = 0, its change with sin q, arm and gravity.
INERTIA, CABLE, LENGTH, GRAVITY = 0.095, 0.06, 0.5, 9.8
# The numbers that the log hides: payload [kg] (0.02 in the chapter), viscous friction [N m s/rad].
PAYLOAD, DAMPING = 0.0634, 0.0217
NOISE, SAMPLING, FINE, SECONDS = 1e-3, 2e-3, 1e-4, 4.0
# Of the servo in closed loop: timestep [s], duration [s], frequency [rad/s] and damping ratio that
# the law is designed for, time constant of its rate [s].
FINEST, STEP_SECONDS, FREQUENCY, RATIO, RATE_FILTER = 5e-5, 3.2, 6.0, 0.7, 0.01
# Viscous friction of the shipped servo [N m s/rad].
NOMINAL_DAMPING = 0.0088


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


def servo_step() -> tuple[Array, Array, Array]:
    """Time, current and measured angle, (samples,) each, of a step of 1 rad under a PD law.

    The law is computed torque of the shipped servo; the servo is machine 0 of ``coverage``. The
    law has the measured angle, and its rate by a filtered difference.
    """
    (scale, damping, delay), _ = coverage.machine(0)
    inertia = scale * coverage.INERTIA
    fades = np.exp(-damping * FINEST / inertia)
    late = round(delay / FINEST)
    random = np.random.default_rng(12)

    time = np.arange(round(STEP_SECONDS / SAMPLING)) * SAMPLING
    currents = np.zeros(len(time))
    angles = np.zeros(len(time))
    queue = [0.0] * late
    angle = rate = seen_rate = 0.0
    for i in range(len(time)):
        angles[i] = angle + NOISE * random.standard_normal()
        if i > 0:
            difference = (angles[i] - angles[i - 1]) / SAMPLING
            seen_rate += SAMPLING / RATE_FILTER * (difference - seen_rate)
        wanted = FREQUENCY**2 * (1.0 - angles[i]) - 2 * RATIO * FREQUENCY * seen_rate
        torque = coverage.INERTIA * wanted + NOMINAL_DAMPING * seen_rate
        currents[i] = torque / coverage.TORQUE

        # Exact while the current is held.
        for _ in range(round(SAMPLING / FINEST)):
            queue.append(currents[i])
            final_rate = coverage.TORQUE * queue.pop(0) / damping
            angle += final_rate * FINEST + (rate - final_rate) * inertia / damping * (1 - fades)
            rate = final_rate + (rate - final_rate) * fades
    return time, currents, angles


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
    write(folder / "servo_step.csv", "time [s],current [A],rotor angle [rad]", *servo_step())
    write(folder / "arm.csv", "time [s],torque [N m],joint angle [rad]", *arm())

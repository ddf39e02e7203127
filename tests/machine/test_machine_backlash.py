"""Play in a loop: its limit cycle against the describing function, and against exact play."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.optimize import brentq

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.machine import Motor, Transmission
from grosmc_mj.physics.edits import BodyEdit, JointEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory

# The motor's inertia, the loop's frequency without damping and play, and the whole play.
J, OMEGA, PLAY = 0.05, 4.0, 0.1
GEAR = 0.667
# A load that weighs a ten-thousandth of the motor stays where it is within the play by a friction
# that is 4 times what throws it on, J_load A w^2, and a five-hundredth of what brakes the motor.
LOAD, FRICTION = 1e-4, 1e-4
# What the teeth's 4 ms and an implicit step need.
STEP = 5e-4


class Cycle(NamedTuple):
    """Amplitude of what goes into the play, over half of the play; frequency over OMEGA."""

    amplitude: float
    frequency: float


def of_play(amplitude: float) -> complex:
    """Describing function N(A) of play: A. Gelb and W. E. Vander Velde, "Multiple-input describing
    functions and nonlinear system design", McGraw-Hill, 1968.

    Args:
        amplitude: Of its input over half of the play, above 1.
    """
    r = 1 / amplitude
    real = 0.5 + (math.asin(1 - 2 * r) + 2 * (1 - 2 * r) * math.sqrt(r * (1 - r))) / math.pi
    return complex(real, -4 * r * (1 - r) / math.pi)


def balance(damping: float) -> list[Cycle]:
    """Solutions of 1 + N(A) G(jw) = 0 for G = 1/(s^2 + 2 damping s), smallest first.

    N = w^2 - 2 j damping w: the imaginary part tells w, the real one what is left of it.
    """

    def frequency(a: float) -> float:
        return -of_play(a).imag / (2 * damping)

    def left(a: float) -> float:
        return of_play(a).real - frequency(a) ** 2

    amplitudes = np.geomspace(1.0001, 100.0, 2000)
    signs = np.sign([left(a) for a in amplitudes])
    found: list[Cycle] = []
    for i in np.flatnonzero(np.diff(signs)):
        root: Any = brentq(left, amplitudes[i], amplitudes[i + 1])
        found.append(Cycle(float(root), frequency(float(root))))
    return found


@dataclass(frozen=True)
class Proportional:
    """Gain from the load's angle to the input."""

    k: float


def proportional(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.v = -p.k * x[0]
    return memory.v


def swung(damping: float, start: float, periods: int = 30) -> Trajectory:
    """The servo with its play under feedback of the load's angle; motor and load start together.

    Args:
        damping: Ratio, of a motor's back-EMF.
        start: Over half of the play.
        periods: How long.
    """
    B = 2 * damping * J * OMEGA
    plant = MujocoPlant.load(
        "servo",
        edits=(
            BodyEdit("rotor", mass_scale=LOAD),
            JointEdit("shaft", damping=0.0, friction=FRICTION),
            Transmission("shaft", inertia=J, backlash=PLAY),
            Motor("current", constant=0.1, resistance=1 / B, ratio=10.0),
        ),
        timestep=STEP,
        integrator="implicitfast",
    )
    law = Controller("proportional", proportional, Proportional(J * OMEGA**2 / GEAR))
    T = periods * 2 * math.pi / OMEGA
    return simulate(plant, law, [start * PLAY / 2, 0.0], duration=T)


def cycle_of(signal: Array, step: float) -> Cycle:
    """The cycle that the last third of a signal is in."""
    tail = signal[2 * len(signal) // 3 :]
    ups = np.flatnonzero((tail[:-1] < 0) & (tail[1:] >= 0))
    at = [i + tail[i] / (tail[i] - tail[i + 1]) for i in ups]
    frequency = 2 * math.pi * (len(at) - 1) / ((at[-1] - at[0]) * step)
    return Cycle(float(np.ptp(tail)) / PLAY, frequency / OMEGA)


def motor_of(run: Trajectory) -> Array:
    """The motor's angle, which is no state that laws see."""
    assert run.physics is not None
    return run.physics[:, 2]


def exact(damping: float, start: float, periods: int = 30) -> Array:
    """The motor's angle with an ideal play, a load that is nowhere else; by the midpoint rule."""
    h = STEP * OMEGA
    q, v, load = start, 0.0, start
    rows: list[float] = []
    for _ in range(round(periods * 2 * math.pi / h)):
        middle, speed = q + h / 2 * v, v + h / 2 * (-load - 2 * damping * v)
        carried = min(max(load, middle - 1), middle + 1)
        v += h * (-carried - 2 * damping * speed)
        q += h * speed
        load = min(max(load, q - 1), q + 1)
        rows.append(q * PLAY / 2)
    return np.array(rows)


DAMPINGS = [0.1, 0.2]


@pytest.mark.parametrize("damping", DAMPINGS)
def test_play_swings_as_an_ideal_one(damping: float) -> None:
    """What the describing function leaves out, higher harmonics, is no error of the machine's."""
    start = balance(damping)[-1].amplitude
    found = cycle_of(motor_of(swung(damping, start)), STEP)
    ideal = cycle_of(exact(damping, start), STEP)
    assert found.amplitude == pytest.approx(ideal.amplitude, rel=0.01)
    assert found.frequency == pytest.approx(ideal.frequency, rel=0.003)


def test_the_load_follows_by_the_describing_function() -> None:
    """Its fundamental against the motor's: magnitude and phase of N(A)."""
    (_, predicted), step = balance(0.15), STEP
    run = swung(0.15, predicted.amplitude)
    found = cycle_of(motor_of(run), step)
    third = 2 * len(run.time) // 3
    t = run.time[third:]
    # Whole periods, so that harmonics are orthogonal.
    period = 2 * math.pi / (found.frequency * OMEGA)
    keep = t - t[0] < math.floor((t[-1] - t[0]) / period) * period
    turned = np.exp(-1j * found.frequency * OMEGA * t[keep])
    through = np.sum(run.state[third:, 0][keep] * turned) / np.sum(
        motor_of(run)[third:][keep] * turned
    )
    expected = of_play(found.amplitude)
    assert abs(through) == pytest.approx(abs(expected), rel=0.02)
    assert cmath.phase(through) == pytest.approx(cmath.phase(expected), abs=0.02)


def test_a_loop_that_is_damped_enough_comes_to_rest_within_its_play() -> None:
    """Harmonic balance has no solution from a damping ratio between 0.27 and 0.28 on."""
    assert [len(balance(damping)) for damping in (0.27, 0.28, 0.35)] == [2, 0, 0]
    (_, predicted), kept = balance(0.25), swung(0.25, 8.0, periods=60)
    assert cycle_of(motor_of(kept), STEP).amplitude == pytest.approx(predicted.amplitude, rel=0.05)
    rested = motor_of(swung(0.35, 8.0, periods=60))
    assert np.ptp(rested[-len(rested) // 6 :]) < PLAY

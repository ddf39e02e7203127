"""What a law in its loop needs to know, and what it remembers."""

from __future__ import annotations

from dataclasses import dataclass

from grosmc_mj.arrays import Array

# How estimators of a rate are told apart in compiled code.
DIFFERENCE, FILTERED, LEVANT, HIGH_GAIN, ESO = 0.0, 1.0, 2.0, 3.0, 4.0


@dataclass(frozen=True, eq=False)
class LoopNumbers:
    """Numbers of a loop around a law of n states and m inputs; times in timesteps.

    Attributes:
        timestep: [s].
        period: Of the law [s].
        stride: Timesteps in it.
        seed: Of what is drawn.
        run: Number of the run.
        delay: Of the computer.
        jitter: Latest that a sample is.
        missed: Share of the samples without a new output.
        sensors: Resolution, noise, bias, drift [1/s], delay and period of each state, (n, 6).
        estimators: Kind, rate, position, number and whether it begins settled, of each estimator of
            a rate, (k, 5).
        gain: Of the Kalman filter, on the innovation of each state, (n, n).
        filtered: 1 for each state that it gives, (n,).
        settled: 1 if it begins settled.
        oldest: Age of what it goes by.
        actuators: Delay, resolution, limit, change in a timestep, time constant over the timestep,
            order, dead zone and what a lag keeps over a timestep, of each input, (m, 8).
        rest: Input before the first output arrives, (m,).
        dead: Dead time that the law knows of.
        age: Of what it sees, which is part of that; at the start it sees the start itself.
        ahead: From its sample to when its output arrives, as it knows [s].
        learning: Share of what the design model has missed in a period that is believed at once.
        known_limit: Largest |u| that it knows of, (m,).
        A: Of a design model that is linear about an operating point, (n, n).
        B: The same, (n, m).
        x_e: The operating point's state, (n,).
    """

    timestep: float
    period: float
    stride: float
    seed: float
    run: float
    delay: float
    jitter: float
    missed: float
    sensors: Array
    estimators: Array
    gain: Array
    filtered: Array
    settled: float
    oldest: float
    actuators: Array
    rest: Array
    dead: float
    age: float
    ahead: float
    learning: float
    known_limit: Array
    A: Array
    B: Array
    x_e: Array


@dataclass
class LoopMemory:
    """What a loop of n states and m inputs remembers.

    Attributes:
        step: Timesteps begun.
        sample: Samples taken.
        due: Timestep of the next one.
        seen: What sensors and estimators give, at the last sample, (n,).
        believed: The state that the law was told, (n,); to compute in before that.
        asked: What it asked for, (m,).
        output: The computer's output, (m,).
        given: What the actuators make of it, (m,).
        past: True states of the last timesteps, (room, n).
        queue: Outputs of the last timesteps, (room, m).
        rates: Of each estimator of a rate: whether it has begun, position, rate, disturbance, what
            was seen last and the instant of that in timesteps, (k, 6).
        observed: The Kalman filter's state, (n,).
        lags: Of each input: after the rate limit, the first lag and the second, (m, 3).
        mean: Input under which the design model moves, (m,).
        model: The design model's state, (n,).
        missed: What the design model misses of the state's rate, (n,).
        slope: To compute in, (n,).
        stage: To compute in, (n,).
        total: What the design model's states gain in a period, for the estimators, (n,).
        calm: No wrench, (6 * bodies,).
    """

    step: float
    sample: float
    due: float
    seen: Array
    believed: Array
    asked: Array
    output: Array
    given: Array
    past: Array
    queue: Array
    rates: Array
    observed: Array
    lags: Array
    mean: Array
    model: Array
    missed: Array
    slope: Array
    stage: Array
    total: Array
    calm: Array

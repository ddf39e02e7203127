"""Gains of a PID from the linearized plant: by pole placement, or by a search."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GainError
from grosmc_mj.ground.fields import Range, checked
from grosmc_mj.theory.control.coordinates.base import OutputCoordinates
from grosmc_mj.theory.control.task import Task

# The band of a settled error, as a share of its first value: the usual 2 %.
_BAND = 0.02
# Tuning aims at this share of the settling time that is asked for: sampling takes the rest.
_AIM = 0.8
# Largest peak of |S|, the sensitivity: above 2 a loop has a gain margin below 2 or a phase margin
# below 29 degrees.
_PEAK = 2.0
# A search tries gains within this factor of those of an integrator chain.
_WIDTH = 300.0
# A pole is negligible if it is this much faster than the bandwidth that is asked for.
_FAST = 100.0
# Poles without the negligible ones agree with the plant's own by this share.
_SAME = 0.05
# Step of the differences of the plant's drift, in the unit of the error state.
_STEP = 1e-5


@checked()
class Tuning:
    """Specification that the gains of a PID are computed for.

    Attributes:
        settles_within: Time in which each output's error shall be within 2 % [s].
    """

    settles_within: Annotated[float, Range(1e-6, 1e6, "s")]

    @property
    def aim(self) -> float:
        """Time in which the linearized loop shall settle [s]."""
        return _AIM * self.settles_within

    @property
    def bandwidth(self) -> float:
        """Bandwidth that this time asks for [rad/s]."""
        return 1 / self.aim


@dataclass(frozen=True, eq=False)
class PidGains:
    """Gains of each output's error, integral and rate, (m,) each."""

    kp: Array
    ki: Array
    kd: Array


@dataclass(frozen=True, eq=False)
class PidLoop:
    """A linearized plant z' = A z + B u, y = C z, under PID with a filtered rate.

    Attributes:
        A: State matrix, (n, n).
        B: Input matrix, (n, m).
        C: Output matrix, (m, n).
        filter_time: Time constant of the rate's filter [s]; 0 for none.
        chains: Entries of z that belong to each output, if the plant has one chain for each.
        neglected: Poles of the plant that are left out of the matrices [1/s], (p,).
    """

    A: Array
    B: Array
    C: Array
    filter_time: float
    chains: tuple[slice, ...] | None
    neglected: tuple[complex, ...] = ()

    def closed(self, gains: PidGains) -> Array:
        """State matrix of (z, xi, filtered y), with u = -(kp y + ki xi + kd d)."""
        n, m = self.B.shape
        kp = np.diag(gains.kp)
        ki = np.diag(gains.ki)
        kd = np.diag(gains.kd)
        T = self.filter_time
        if T > 0:
            # d = (y - f) / T, f' = d.
            from_state = np.hstack([(kp + kd / T) @ self.C, ki, -kd / T])
        else:
            # d = y' = C (A z + B u), which holds u itself for relative degree one.
            solve = np.linalg.inv(np.eye(m) + kd @ self.C @ self.B)
            feedback = np.hstack([kp @ self.C + kd @ self.C @ self.A, ki, np.zeros((m, m))])
            from_state = solve @ feedback
        closed = np.zeros((n + 2 * m, n + 2 * m))
        closed[:n, :n] = self.A
        closed[:n] -= self.B @ from_state
        closed[n : n + m, :n] = self.C
        if T > 0:
            closed[n + m :, :n] = self.C / T
            closed[n + m :, n + m :] = -np.eye(m) / T
        return closed

    def tail(self, gains: PidGains, after: float) -> float:
        """Largest error beyond a time [s] as a share of its first value, of each output alone."""
        n, m = self.B.shape
        count = 400
        step = scipy.linalg.expm(self.closed(gains) * (2 * after / count))
        # Each output begins one unit off and at rest, and so does its filter.
        start = np.linalg.pinv(self.C)
        state = np.vstack([start, np.zeros((m, m)), np.eye(m)])
        largest = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for i in range(count + 1):
                if i >= count // 2:
                    largest = max(largest, float(np.abs(self.C @ state[:n]).max()))
                state = step @ state
        return largest if math.isfinite(largest) else math.inf

    def sensitivity(self, gains: PidGains, frequencies: Array) -> float:
        """Largest singular value of S = (1 + P C)^-1 over frequencies [rad/s]."""
        n, m = self.B.shape
        s = 1j * frequencies[:, None, None]
        plant = self.C @ np.linalg.solve(
            s * np.eye(n) - self.A,
            np.broadcast_to(self.B.astype(complex), (len(frequencies), n, m)),
        )
        law = (
            np.diag(gains.kp)
            + np.diag(gains.ki) / s
            + np.diag(gains.kd) * s / (1 + self.filter_time * s)
        )
        difference = np.eye(m) + plant @ law
        return float(1 / np.linalg.svd(difference, compute_uv=False).min())


def pid_loop(task: Task, rows: list[int], filter_time: float) -> PidLoop:
    """Linearize a task's plant about zero error at t = 0, with the input that holds it there.

    Args:
        task: The task.
        rows: Entries of z that are controlled, (m,).
        filter_time: Time constant of the rate's filter [s].
    """
    error = task.error
    C = np.eye(error.size)[rows]
    if not isinstance(error, OutputCoordinates):
        A, B = error.linear_model(task.plant, task.feedback(np.zeros((0, 0))))
        chains = (slice(0, error.size),) if error.inputs == 1 else None
        return PidLoop(A, B, C, filter_time, chains)

    p = task.feedback(np.zeros((0, 0)))
    zero = np.zeros(error.size)
    alpha, E = error.dynamics(0.0, error.place(0.0, zero, p), p)
    held = -np.linalg.solve(E, alpha)

    def drift(z: Array) -> Array:
        alpha, E = error.dynamics(0.0, error.place(0.0, z, p), p)
        return alpha + E @ held

    linearization = error.linearization
    last_rows = list(linearization.last_rows)
    A = linearization.A
    for j in range(error.size):
        z = zero.copy()
        z[j] = _STEP
        A[last_rows, j] = (drift(z) - drift(-z)) / (2 * _STEP)
    B = np.zeros((error.size, error.inputs))
    # The law controls y - r, which is z up to the sign of the task.
    B[last_rows] = error.sign * E
    chains = None
    if list(linearization.first_rows) == rows:
        chains = tuple(slice(first, last + 1) for first, last in zip(rows, last_rows, strict=True))
    return PidLoop(A, B, C, filter_time, chains)


def without_fast_poles(loop: PidLoop, bandwidth: float) -> PidLoop:
    """Loop without the plant's damped poles that are much faster than a bandwidth [rad/s].

    Their states, such as the current of a winding, are at each instant where the others lead them:
    0 = z_f' = A_fs z_s + A_ff z_f + B_f u. The loop stays as it is unless the poles that remain
    are the plant's own.
    """
    fast = _FAST * bandwidth
    A, B = loop.A, loop.B
    led = (np.diag(A) < -fast) & ~np.any(loop.C != 0, axis=0)
    if not np.any(led) or np.all(led):
        return loop
    f = np.flatnonzero(led)
    s = np.flatnonzero(~led)
    # Those of the fast states are the last.
    poles = sorted(map(complex, np.linalg.eigvals(A).tolist()), key=abs)
    neglected = tuple(poles[len(s) :])
    if any(pole.real > -fast for pole in neglected):
        return loop

    at_once = np.linalg.solve(A[f][:, f], np.hstack([A[f][:, s], B[f]]))
    reduced = np.hstack([A[s][:, s], B[s]]) - A[s][:, f] @ at_once
    A_s = reduced[:, : len(s)]
    of_reduced = sorted(map(complex, np.linalg.eigvals(A_s).tolist()), key=abs)
    if not np.allclose(of_reduced, poles[: len(s)], rtol=_SAME, atol=_SAME * bandwidth):
        return loop

    chains = loop.chains
    if chains is not None:
        lengths = [int(np.count_nonzero(~led[part])) for part in chains]
        ends = np.cumsum(lengths).tolist()
        chains = tuple(slice(end - n, end) for end, n in zip(ends, lengths, strict=True))
    return PidLoop(
        A=A_s,
        B=reduced[:, len(s) :],
        C=loop.C[:, s],
        filter_time=loop.filter_time,
        chains=chains,
        neglected=neglected,
    )


def placed_gains(loop: PidLoop, frequency: float) -> PidGains | None:
    """Gains that place each output's poles at -w, with the other outputs held.

    An output with b/(s^2 + a1 s + a0) has (s + w)^3, one with b/(s + a0) has (s + w)^2 and no kd.

    Args:
        loop: The loop.
        frequency: w [rad/s].

    Returns:
        None if an output has another transfer function than these.
    """
    m = loop.B.shape[1]
    if loop.chains is None or any(loop.A[part, part].shape[0] > 2 for part in loop.chains):
        return None

    gains = np.zeros((3, m))
    # With the other outputs held, 1/b is the diagonal of the inertia.
    ends = [part.stop - 1 for part in loop.chains]
    of_several = 1 / np.diag(np.linalg.inv(loop.B[ends])) if m > 1 else None
    w = frequency
    for i, part in enumerate(loop.chains):
        A = loop.A[part, part]
        C = loop.C[i, part]
        B = loop.B[part, i]
        order = len(A)
        b = C @ B if order == 1 else C @ A @ B
        if of_several is not None:
            b = of_several[i]

        # Characteristic polynomial, highest power first.
        polynomial = np.poly(A)
        if order == 1:
            gains[:2, i] = (2 * w - polynomial[1]) / b, w**2 / b
            continue
        if abs(C @ B) > 1e-9 * abs(b):
            return None
        kp = (3 * w**2 - polynomial[2]) / b
        kd = (3 * w - polynomial[1]) / b
        gains[:, i] = kp, w**3 / b, kd
    return PidGains(*gains)


def tuned_gains(loop: PidLoop, tuning: Tuning) -> PidGains:
    """Gains with which each output's error settles in time, and |S| has no peak above 2.

    Where poles can be placed, they are the slowest placed ones that do. Else a search finds them:
    differential evolution over the three gains of each output, with a fixed seed. Gains are
    computed without negligible poles, and judged with them.

    Args:
        loop: The loop, with all poles.
        tuning: The settling time.

    Raises:
        GainError: If there are none.
    """
    aim = tuning.aim
    frequencies = np.geomspace(0.01, 1e4, 240) / aim

    def misses(gains: PidGains) -> float:
        """Distance of gains from the aim; 0 if they keep it."""
        tail = loop.tail(gains, aim)
        if not tail < 1e12:
            return 1e3
        peak = loop.sensitivity(gains, frequencies)
        return math.log(max(tail / _BAND, 1.0)) + max(peak / _PEAK - 1, 0.0)

    slow = without_fast_poles(loop, tuning.bandwidth)
    for frequency in np.geomspace(1, 100, 200) / aim:
        placed = placed_gains(slow, frequency)
        if placed is None:
            break
        if misses(placed) == 0:
            return placed

    best = _searched(slow, aim, misses)
    if misses(best) > 0:
        tail = loop.tail(best, tuning.settles_within)
        raise GainError(
            f"pid: tune found no gains with which the linearized loop settles within "
            f"{tuning.settles_within:g} s and |S| stays below {_PEAK:g}: the best leave "
            f"{min(100 * tail, 999):.3g} % of the error (2 % are settled)"
        )
    return best


def _searched(loop: PidLoop, aim: float, misses: Callable[[PidGains], float]) -> PidGains:
    """Gains that miss the aim least, or the first that keep it."""
    # Slow to import, and needed by few laws.
    import scipy.optimize

    m = loop.B.shape[1]
    centre = _gains_of_chain(loop, 6 / aim)

    def gains_at(exponents: Array) -> PidGains:
        return PidGains(*(centre * np.exp(exponents.reshape(3, m))))

    width = math.log(_WIDTH)
    search = scipy.optimize.differential_evolution(
        lambda exponents: misses(gains_at(exponents)),
        [(-width, width)] * centre.size,
        rng=1,
        popsize=10,
        maxiter=60,
        polish=False,
        init="sobol",
        callback=lambda intermediate_result: intermediate_result.fun == 0,
    )
    return gains_at(search.x)


def _gains_of_chain(loop: PidLoop, frequency: float) -> Array:
    """Gains (3, m) for a chain of integrators with the input gain of each output."""
    m = loop.B.shape[1]
    gains = np.zeros((3, m))
    for i in range(m):
        row = loop.C[i]
        order = 1
        # The first derivative of the output in which its input appears.
        while abs(row @ loop.B[:, i]) < 1e-9 and order < len(loop.A):
            row = row @ loop.A
            order += 1
        b = row @ loop.B[:, i]
        if b == 0:
            raise GainError(f"pid: input {i + 1} does not act on output {i + 1}")
        kp = frequency**order / b
        gains[:, i] = kp, kp * frequency / 3, kp / frequency
    return gains

"""The balance behind every reaching condition: what pushes s away against what pushes it back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.ground.arrays import Array, as_rows
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.coordinates.state import StateCoordinates
from grosmc_mj.theory.control.reaching import NominalLaw, gain_margin, matrix_vector, nominal_law
from grosmc_mj.theory.control.task import GrosmcParameters
from grosmc_mj.theory.plants import AnalyticPlant, Plant, System


class Balance(NamedTuple):
    """The balance at many states of one plant, or at one of them, without the first axis.

    With z_i^(r_i) = alpha + E u by the law's model, alpha* + E* u + d on the true plant and G_r
    the columns of G that meet the rows of the inputs,

        s' = G_r [(alpha* - alpha) + (E* - E) u_c + d] - rho R sgn(s),  R = (G_r E*) (G_r E)^-1.

    Attributes:
        t: Times [s], (N,).
        x: States, (N, n).
        R: As above, (N, m, m).
        gain_ratio: What is left of rho, (N,): r = E*/E for one input, else as ``gain_margin``.
        pushes: The first part of s', (N, m), in the unit of s per second.
        push: Its largest entry, (N,).
        required: push / r, the least rho that keeps |s| from growing, (N,).
        configured: rho of the law, (N,); 0 for a law that does not switch.
        determinant: det E of the law's model, (N,).
        unmatched: Largest entry of the uncertainty in the other rows of z', (N,).
        u_c: The continuous part of the input, (N, m).
    """

    t: Any
    x: Array
    R: Array
    gain_ratio: Any
    pushes: Array
    push: Any
    required: Any
    configured: Any
    determinant: Any
    unmatched: Any
    u_c: Array

    @property
    def margin(self) -> Any:
        """Configured less required rate, (N,)."""
        return self.configured - self.required

    @property
    def times(self) -> Any:
        """Required over configured rate, (N,); infinite where a law without gain needs one."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.required == 0, 0.0, np.divide(self.required, self.configured))

    def at(self, i: int) -> Balance:
        """The balance at the i-th state."""
        return Balance(*(values[i] for values in self))


class Loads(NamedTuple):
    """Disturbances of a plant at N states.

    Attributes:
        wrench: Wrenches on the bodies, (N, 6 * bodies).
        input: Added to the inputs, (N, m).
        rate: Added to the rates of the states, (N, n).
    """

    wrench: Array
    input: Array
    rate: Array

    @classmethod
    def of_wrench(cls, wrench: Array, system: System) -> Loads:
        """Wrenches, (6 * bodies,) or (N, 6 * bodies), without any other disturbance."""
        wrench = np.atleast_2d(wrench)
        count = len(wrench)
        inputs = np.zeros((count, len(system.inputs)))
        return cls(wrench, inputs, np.zeros((count, len(system.states))))

    @classmethod
    def none(cls, system: System, count: int) -> Loads:
        """No disturbance at so many states."""
        return cls.of_wrench(np.zeros((count, 6 * len(system.bodies))), system)

    @classmethod
    def of_run(cls, run: Trajectory, rows: Any) -> Loads:
        """Disturbances in some rows of a run; zero where none was given."""
        count = len(run.time[:-1][rows])
        loads = cls.none(run.system, count)
        if run.wrench is not None:
            loads.wrench[:] = run.wrench[rows]
        if run.input_disturbance is not None:
            loads.input[:] = as_rows(run.input_disturbance[rows])
        if run.rate_disturbance is not None:
            loads.rate[:] = run.rate_disturbance[rows]
        return loads


def disturbed_motion(
    law: Controller,
    t: Sequence[float],
    x: Array,
    plant: Plant,
    loads: Loads,
    u: Array | None = None,
) -> tuple[Array, Array]:
    """Drift (N, size) and gain (N, size, m) of z' = drift + gain v on a plant under loads.

    A disturbance of an input acts as the input itself does: it is matched.

    Args:
        law: A controller with error coordinates.
        t: Times [s], (N,).
        x: States, (N, n).
        plant: The plant.
        loads: Disturbances at these states.
        u: Inputs, see ``error_dynamics``.
    """
    error = law.designed.error
    p = law.parameters
    drift, gain = error.error_dynamics(t, x, p, plant, loads.wrench, u)
    if loads.input.any():
        drift = drift + matrix_vector(gain, loads.input)
    if loads.rate.any():
        drift = drift + error.from_rates(x, p, loads.rate)
    return drift, gain


def balance(
    law: Controller,
    true: Plant,
    t: float,
    x: Array,
    loads: Loads,
    u: Array | None = None,
) -> Balance:
    """The balance at one state of the true plant.

    Args:
        law: A controller with error coordinates.
        true: The plant that it meets; for a robot's law the one in MuJoCo. Of a machine it is the
            rigid one, since x does not tell what its parts do.
        t: Time [s]; the reference depends on it.
        x: State, (n,).
        loads: Disturbances there, with a first axis of length 1.
        u: Input to which a robot's friction, limits and contacts answer, (m,); none by default.
            Equations have no use for it.
    """
    # One state is many states with a first axis of length 1.
    x = np.asarray(x, float)[None]
    if u is not None:
        u = np.atleast_1d(u)[None]

    motion = disturbed_motion(law, [t], x, true.rigid, loads, u)
    z = law.designed.error.error_state(t, x[0], law.parameters)[None]
    return _balances(law, [t], x, z, motion).at(0)


def balances(
    law: Controller,
    true: AnalyticPlant,
    t: Sequence[float],
    x: Array,
    loads: Loads,
) -> Balance:
    """The balance at many states of a plant with equations, all at once.

    Args:
        law: A controller with error coordinates in symbols.
        true: The plant that it meets.
        t: Times [s], (N,).
        x: States, (N, n).
        loads: Disturbances at these states.
    """
    z = law.designed.error.along(t, x, law.parameters)
    return _balances(law, t, x, z, disturbed_motion(law, t, x, true, loads))


def balances_along(
    law: Controller,
    true: AnalyticPlant,
    run: Trajectory,
    every: int,
    *,
    pushed: bool = True,
) -> Balance:
    """The balance along a run.

    Args:
        law: As for ``balances``.
        true: The plant that it meets.
        run: The run.
        every: Of so many samples one is looked at.
        pushed: Whether its disturbances count.
    """
    rows = slice(0, len(run.time) - 1, every)
    t = run.time[rows].tolist()
    loads = Loads.of_run(run, rows) if pushed else Loads.none(true.system, len(t))
    return balances(law, true, t, run.state[rows], loads)


def _balances(
    law: Controller,
    t: Sequence[float],
    x: Array,
    z: Array,
    motion: tuple[Array, Array],
) -> Balance:
    """The balances at instants (N,), states (N, n) and errors (N, size) that move like that."""
    design = law.designed
    by_model = nominal_law(law, t, x, z)
    dz, pushes, R = by_model.reaching(motion)

    # A unit-vector law has one switch for the whole of s, any other law one for each entry.
    together = "unit-vector" in design.switching
    r = gain_margin(R, together=together)
    push = np.abs(pushes).max(axis=-1)
    if together:
        push = np.linalg.norm(pushes, axis=-1)
    required = np.divide(push, r, out=np.full_like(push, np.inf), where=r > 0)

    unmatched = _unmatched(law, by_model, z, dz)
    return Balance(
        t=np.array(t),
        x=x,
        R=R,
        gain_ratio=r,
        pushes=pushes,
        push=push,
        required=required,
        configured=switching_rate(law.parameters, by_model),
        determinant=np.linalg.det(by_model.E),
        unmatched=np.abs(unmatched).max(axis=-1, initial=0.0),
        u_c=by_model.u_c,
    )


def _unmatched(
    law: Controller,
    by_model: NominalLaw,
    z: Array,
    dz: Array,
) -> Array:
    """The part of z' that no input could have made, where the law's model differs from it."""
    design = law.designed
    if not isinstance(design.error, StateCoordinates):
        return design.error.unmatched(z, dz)
    A = design.lqr.A
    B = design.lqr.B
    mismatch = dz - matrix_vector(A, z) - matrix_vector(B, by_model.v_0)
    return mismatch - matrix_vector(B @ np.linalg.pinv(B), mismatch)


def switching_rate(p: Any, law: NominalLaw) -> Array:
    """Switching rate rho of a law at N states, eqs. (12), (37) and (55), its term in s'.

    Args:
        p: Its parameters.
        law: The law by its own model.

    Returns:
        One number for each state, (N,); 0 of a law that does not switch.
    """
    if not isinstance(p, GrosmcParameters):
        return np.zeros(len(law.z))
    bound = p.gamma0 + p.gamma1 * np.linalg.norm(law.z, axis=-1)
    size = np.linalg.norm(law.GE, axis=(-2, -1))
    return p.switching.gain * (p.epsilon + p.eta + bound * size)

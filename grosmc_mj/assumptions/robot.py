"""The premises of a robot's run: switching rate, input gain, torques and joint limits.

A robot has no declared operating region and no equations: everything is computed along the run,
by MuJoCo's dynamics of the true plant and of the nominal one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.audit import (
    ROUNDING,
    Audit,
    Point,
    Premise,
    Reading,
    audit,
    initial_surface,
    per_second,
    reading_of,
    signals,
)
from grosmc_mj.assumptions.balance import Balance, balance
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.reaching import gain_margin
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.physics.hooks import warnings_counted_only
from grosmc_mj.robots.coordinates import RobotCoordinates
from grosmc_mj.robots.dynamics import bias, inertia
from grosmc_mj.simulation.trajectory import Trajectory

# The balance is computed at so many instants of a run; torques and angles at all.
_INSTANTS = 400


def is_robots(result: RunResult) -> bool:
    """Whether a run is one that these premises are for: a robot's law on a robot in MuJoCo."""
    return result.true is not None and not result.trajectory.system.symbolic


def audit_of(lab: Laboratory, experiment: Experiment, controller: str) -> Audit:
    """The premises of a law in an experiment, of a robot or of a plant with equations.

    Raises:
        ArgumentError: If nothing is known of its law's premises.
    """
    if experiment.nominal.system.symbolic:
        return audit(lab, experiment, controller)
    return robot_audit(lab.run(experiment, "physics", controller))


def audits(results: Sequence[RunResult]) -> list[Audit]:
    """The premises of every sliding mode law among the runs of robots in MuJoCo."""
    return [
        robot_audit(result)
        for result in results
        if is_robots(result)
        and result.trajectory.sliding is not None
        and len(result.trajectory.input)
    ]


def robot_audit(result: RunResult) -> Audit:
    """The premises of a law along a run of a robot, at each instant that was looked at.

    A law that does not switch has those of torques and joints only.

    Args:
        result: A run in MuJoCo of a robot's law.

    Raises:
        ArgumentError: If it is another run, or has no interval.
    """
    run, law = result.trajectory, result.controller
    if not is_robots(result) or not len(run.input):
        raise ArgumentError(f"{result.key} is no run of a robot in MuJoCo: it has no such premises")
    # Of a law of one's own no feedback is known that pushes and switching could be set against.
    plant: Any = result.true
    points = _along(result, plant) if hasattr(law.parameters, "K") else None
    premises = []
    if run.sliding is not None and points is not None:
        premises = [
            _rate(result, plant, points),
            _authority(result, points),
            initial_surface(run.sliding),
        ]
    premises.append(_torque(result, plant))
    if points is not None and isinstance(law.designed.error, RobotCoordinates):
        premises.append(_headroom(law, plant, points))
    premises.append(_joints(result, plant))
    return Audit(result.case, law.name, tuple(premises), {} if points is None else signals(points))


def _along(result: RunResult, plant: Any) -> Balance:
    """The balance along the run, by the torques that were applied."""
    run = result.trajectory
    rows = np.unique(np.linspace(0, len(run.input) - 1, _INSTANTS).astype(int))
    w = np.zeros((len(run.input), 6 * len(run.system.bodies))) if run.wrench is None else run.wrench
    with warnings_counted_only():
        points = [
            balance(result.controller, plant, float(run.time[i]), run.state[i], w[i], run.input[i])
            for i in rows
        ]
    return Balance(*map(np.array, zip(*points, strict=True)))


def _rate(result: RunResult, plant: Any, points: Balance) -> Premise:
    """The switching rate covers what pushes s away, with the input gain's uncertainty counted."""
    law, most = result.controller, points.at(int(points.required.argmax()))
    joint = _driven(result)[int(np.abs(most.pushes).argmax())]
    unit = per_second(law.designed.sliding_unit)
    printed = "epsilon" in law.designed.gains
    machine = ", the parts of its machine" if plant.rigid is not plant else ""
    return Premise(
        "epsilon" if printed else "switching gain",
        "Theorem 3: ε >= (a_m + d_m) ‖GB‖" if printed else "Assumptions 4 and 6, eqs. (12), (37)",
        "the law's switching rate ρ at least push / r, what is required of it",
        unit,
        along=reading_of(points, points.margin),
        remedy=f"ρ = {most.required:.3g} {unit} instead of the configured one"
        if np.isfinite(most.required)
        else "no ρ, while r is not positive: see the input gain",
        note=f"required at most {most.required:.3g}, configured {most.configured:.3g} {unit} "
        f"(at t = {most.t:.3g} s: push {most.push:.3g} at {joint}, r = {most.gain_ratio:.3g})"
        f"; in the push are the edits, the wrenches, and friction, joint limits and "
        f"contacts as MuJoCo has them under the applied torque; not in it: that the law is "
        f"sampled{machine}, and torque that was cut off",
    )


def _driven(result: RunResult) -> tuple[str, ...]:
    """What the inputs drive: every joint, or those that have an actuator, by its name."""
    system = result.trajectory.system
    return system.joints if len(system.inputs) == len(system.joints) else system.actuators


def _authority(result: RunResult, points: Balance) -> Premise:
    """The true inertia leaves something of the switching rate."""
    ratios, driven = points.gain_ratio, _driven(result)
    # The joint whose row of R is least dominant, and the other one that takes most of it.
    R = points.R[ratios.argmin()]
    beside = np.abs(R) - np.diag(np.abs(np.diag(R)))
    row = int((np.diag(R) - beside.sum(axis=1)).argmin())
    taken = (
        f"; in the row of {driven[row]} {R[row, row]:.3g} is its own and {beside[row].sum():.3g} "
        f"the others', most of it {driven[int(beside[row].argmax())]}'s"
    )
    together = gain_margin(points.R, together=True).min()
    switch = together > 0 and "unit-vector" not in result.controller.designed.switching
    return Premise(
        "input gain",
        "implied by Assumptions 3 and 5",
        "r positive: what dominance leaves of ρ with R = G E* (G E)⁻¹, of all joints M*⁻¹ M",
        "1",
        along=reading_of(points, ratios - ROUNDING),
        remedy=f"a unit-vector switching law (r = {together:.3g} as one switch for all)"
        if switch
        else "another G, smaller edits, or a nominal model nearer to the true one",
        note=f"r from {ratios.min():.3g} to {ratios.max():.3g}; M has armature in it, which no "
        "payload changes" + (taken if ratios.min() < ROUNDING else ""),
    )


def _shares(torque: Array, limits: Array) -> Array:
    """Torques as parts of the limit on their side, like ``torque``: 1 at the limit."""
    low, high = limits
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(torque >= 0, torque / high, torque / low)
    # 0 within limits that begin at 0.
    return np.where(torque == 0, 0.0, share)


def _torque(result: RunResult, plant: Any) -> Premise:
    """The actuators give what the law asks for."""
    run = result.trajectory
    # A trajectory of one joint has no axis for its inputs.
    command, applied = (rows.reshape(len(rows), -1) for rows in (run.command, run.input))
    shares, cut = _shares(command, plant.input_limits), command != applied
    joints = [
        f"{joint} {100 * share:.0f} %" + (f" (cut {100 * part:.2g} % of the time)" if part else "")
        for joint, share, part in zip(
            _driven(result), shares.max(axis=0), cut.mean(axis=0), strict=True
        )
    ]
    return Premise(
        "torque limits",
        "the law has no bound on u",
        "no torque that the law asks for is cut: what is left of a joint's limit, as a part of it",
        "1",
        along=_least(run, 1 - shares.max(axis=1), cut.any(axis=1)),
        note=f"largest, of the joint's limit: {', '.join(joints)}",
    )


def _least(run: Trajectory, margins: Array, violated: Array) -> Reading:
    """The least of the margins at the samples of a run."""
    row = int(margins.argmin())
    point = Point(float(run.time[row]), tuple(run.state[row].tolist()), float(margins[row]))
    return Reading(point, point.value, float(violated.mean()))


def _headroom(law: Controller, plant: Any, points: Balance) -> Premise:
    """The nominal torque leaves what the switching term may need, whatever its signs."""
    error, limits = cast(RobotCoordinates, law.designed.error), plant.input_limits
    nominal, switching = [], []
    with np.errstate(over="ignore", invalid="ignore"):
        for t, rate in zip(points.t.tolist(), points.configured, strict=True):
            y_r, dy_r, ddy_r = np.reshape(error.reference(t, law.parameters.reference), (-1, 3)).T
            M = inertia(error.model, y_r)
            nominal.append(M @ ddy_r + bias(error.model, y_r, dy_r))
            switching.append(np.abs(M).sum(axis=1) * rate)
        torque, reserve = np.array(nominal), np.array(switching)
        # Of torques beyond all numbers nothing is left.
        alone, low, high = (
            np.nan_to_num(_shares(torque + side * reserve, limits), nan=np.inf, posinf=np.inf)
            for side in (0.0, -1.0, 1.0)
        )
    worst = np.maximum(low, high)
    joints = [
        f"{joint} {100 * a:.0f} %" + (f", {100 * b:.0f} %" if np.any(b > a) else "")
        for joint, a, b in zip(
            error.system.joints, alone.max(axis=0), worst.max(axis=0), strict=True
        )
    ]
    return Premise(
        "torque headroom",
        "eqs. (44), (55): u = M v + h",
        "along the reference, nominal inverse dynamics and |M| ρ of the switching term stay within "
        "the limits: what is left, as a part of the limit",
        "1",
        along=reading_of(points, 1 - worst.max(axis=1)),
        note="largest, of the joint's limit, "
        + ("alone and with switching: " if np.any(points.configured) else "alone: ")
        + "; ".join(joints),
    )


def _joints(result: RunResult, plant: Any) -> Premise:
    """No joint comes to its limit, where a torque acts that the law does not know."""
    run, limited = result.trajectory, np.flatnonzero(plant.model.jnt_limited)
    along, note = None, "no joint has a limit"
    if len(limited):
        (low, high), q = plant.model.jnt_range[limited].T, run.state[:, limited]
        left = np.minimum(q - low, high - q) / (high - low)
        row, column = divmod(int(left.argmin()), len(limited))
        note = f"nearest: {run.system.joints[limited[column]]} at t = {run.time[row]:.3g} s"
        along = _least(run, left.min(axis=1), left.min(axis=1) < 0)
    return Premise(
        "joint limits",
        "the law does not know them",
        "no joint touches its limit: what is left on the nearer side, as a part of its range",
        "1",
        along=along,
        note=note,
    )

"""The premises of a robot's run: switching rate, input gain, torques and joint limits.

A robot has no declared operating region and no equations: everything is computed along the run,
by MuJoCo's dynamics of the true plant and of the nominal one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

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
from grosmc_mj.physics.quiet import warnings_counted_only
from grosmc_mj.robots.coordinates import RobotCoordinates
from grosmc_mj.robots.dynamics import bias, inertia
from grosmc_mj.simulation.trajectory import Trajectory

# The balance is computed at so many instants of a run; torques and angles at all.
_INSTANTS = 400
# Instants at which smaller edits are tried, and how finely.
_WORST, _HALVINGS = 20, 7


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
    points = _along(result) if hasattr(law.parameters, "K") else None
    premises = []
    if run.sliding is not None and points is not None:
        premises = [_rate(result, points), _authority(result, points), initial_surface(run.sliding)]
    premises.append(_torque(result))
    if points is not None and isinstance(law.designed.error, RobotCoordinates):
        premises.append(_headroom(law, result.true, points))
    premises.append(_joints(result))
    return Audit(result.case, law.name, tuple(premises), {} if points is None else signals(points))


def _along(result: RunResult) -> Balance:
    """The balance along the run, by the torques that were applied."""
    run, true = result.trajectory, result.true
    rows = np.unique(np.linspace(0, len(run.input) - 1, _INSTANTS).astype(int))
    w = np.zeros((len(run.input), 6 * len(run.system.bodies))) if run.wrench is None else run.wrench
    assert true is not None
    with warnings_counted_only():
        points = [
            balance(result.controller, true, float(run.time[i]), run.state[i], w[i], run.input[i])
            for i in rows
        ]
    return Balance(*map(np.array, zip(*points, strict=True)))


def _rate(result: RunResult, points: Balance) -> Premise:
    """The switching rate covers what pushes s away, with the input gain's uncertainty counted."""
    law, true, most = result.controller, result.true, points.at(int(points.required.argmax()))
    joint = _driven(result)[int(np.abs(most.pushes).argmax())]
    alone = "" if "unit-vector" in law.designed.switching else _joint_by_joint(points)
    unit = per_second(law.designed.sliding_unit)
    printed = "epsilon" in law.designed.gains
    assert true is not None
    machine = ", the parts of its machine" if true.rigid is not true else ""
    needed = f"ρ = {most.required:.3g} {unit} instead of what is configured"
    possible = np.isfinite(most.required)
    premise = Premise(
        "epsilon" if printed else "switching gain",
        "Theorem 3: ε >= (a_m + d_m) ‖GB‖" if printed else "Assumptions 4 and 6, eqs. (12), (37)",
        "the law's switching rate ρ at least push / r, what is required of it",
        unit,
        along=reading_of(points, points.margin),
        restores=needed if possible else "no ρ, while r is not positive: see the input gain",
        note=f"required at most {most.required:.3g}, configured {most.configured:.3g} {unit} "
        f"(at t = {most.t:.3g} s: push {most.push:.3g} at {joint}, r = {most.gain_ratio:.3g})"
        f"{alone}; in the push are the edits, the wrenches, and friction, joint limits and "
        f"contacts as MuJoCo has them under the applied torque; not in it: that the law is "
        f"sampled{machine}, and torque that was cut off",
    )
    return replace(premise, restores="") if premise.holds else premise


def _driven(result: RunResult) -> tuple[str, ...]:
    """What the inputs drive: every joint, or those that have an actuator, by its name."""
    system = result.trajectory.system
    every = len(system.inputs) == len(system.joints)
    return system.joints if every else system.actuators


def _joint_by_joint(points: Balance) -> str:
    """The required rate if each joint's push is set against its own row of R."""
    left = 2 * np.diagonal(points.R, axis1=1, axis2=2) - np.abs(points.R).sum(axis=-1)
    if np.any(left <= 0):
        return ""
    required = (np.abs(points.pushes) / left).max()
    return f", or {required:.3g} with each joint's push against its own row of R"


def _authority(result: RunResult, points: Balance) -> Premise:
    """The true inertia leaves something of the switching rate."""
    ratios = points.gain_ratio
    premise = Premise(
        "input gain",
        "implied by Assumptions 3 and 5",
        "r positive: what dominance leaves of ρ with R = G E* (G E)⁻¹, of all joints M*⁻¹ M",
        "1",
        along=reading_of(points, ratios - ROUNDING),
        note=f"r from {ratios.min():.3g} to {ratios.max():.3g}; M has armature in it, which no "
        "payload changes",
    )
    if premise.holds:
        return premise
    taken = _taken_away(result, points.R[ratios.argmin()])
    restores = _dominance_again(result, points)
    return replace(premise, note=f"{premise.note}; {taken}", restores=restores)


def _taken_away(result: RunResult, R: Array) -> str:
    """Which joint's row of R has lost its dominance, and to which other."""
    driven, beside = _driven(result), np.abs(R) - np.diag(np.abs(np.diag(R)))
    row = int((np.diag(R) - beside.sum(axis=1)).argmin())
    other = int(beside[row].argmax())
    return (
        f"in the row of {driven[row]} {R[row, row]:.3g} is its own and {beside[row].sum():.3g} the "
        f"others', most of it {driven[other]}'s"
    )


def _dominance_again(result: RunResult, points: Balance) -> str:
    """What makes r positive: one switch for all joints, or a smaller part of the edits."""
    together, ways = gain_margin(points.R, together=True).min(), []
    if together > 0 and "unit-vector" not in result.controller.designed.switching:
        ways.append(f"a unit-vector switching law (r = {together:.3g} as one switch for all)")
    part = _bearable(result, points)
    if part is not None:
        ways.append(f"the edits at {100 * part:.0f} % of their size")
    return " or ".join(ways) or "another G, or a nominal model nearer to the true one"


def _bearable(result: RunResult, points: Balance) -> float | None:
    """The largest part of the case's edits, of masses and lengths, that leaves r positive."""
    nominal, edits = result.experiment.nominal.plant, result.case.edits
    worst = [points.at(i) for i in np.argsort(points.gain_ratio, kind="stable")[:_WORST]]

    def keeps(part: float) -> bool:
        plant = nominal.changed([edit.shrunk(part) for edit in edits])
        still = np.zeros(6 * len(plant.system.bodies))
        return all(balance(result.controller, plant, b.t, b.x, still).gain_ratio > 0 for b in worst)

    if not edits or not keeps(0.0):
        return None
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return low


def _shares(torque: Array, limits: Array) -> Array:
    """Torques as parts of the limit on their side, like ``torque``: 1 at the limit."""
    low, high = limits
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(torque >= 0, torque / high, torque / low)
    # 0 within limits that begin at 0.
    return np.where(torque == 0, 0.0, share)


def _torque(result: RunResult) -> Premise:
    """The actuators give what the law asks for."""
    run, plant = result.trajectory, result.true
    assert plant is not None
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
    error, limits = law.designed.error, plant.input_limits
    assert isinstance(error, RobotCoordinates)
    nominal, switching = [], []
    for t, rate in zip(points.t.tolist(), points.configured, strict=True):
        y_r, dy_r, ddy_r = np.reshape(error.reference(t, law.parameters.reference), (-1, 3)).T
        M = inertia(error.model, y_r)
        nominal.append(M @ ddy_r + bias(error.model, y_r, dy_r))
        switching.append(np.abs(M).sum(axis=1) * rate)
    torque, reserve = np.array(nominal), np.array(switching)
    alone = _shares(torque, limits)
    worst = np.maximum(_shares(torque - reserve, limits), _shares(torque + reserve, limits))
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


def _joints(result: RunResult) -> Premise:
    """No joint comes to its limit, where a torque acts that the law does not know."""
    run, plant = result.trajectory, result.true
    assert plant is not None
    limited = np.flatnonzero(plant.model.jnt_limited)
    premise = Premise(
        "joint limits",
        "the law does not know them",
        "no joint touches its limit: what is left on the nearer side, as a part of its range",
        "1",
        note="no joint has a limit",
    )
    if not len(limited):
        return premise
    low, high = plant.model.jnt_range[limited].T
    q = run.state[:, limited]
    left = np.minimum(q - low, high - q) / (high - low)
    row, column = divmod(int(left.argmin()), len(limited))
    near = f"nearest: {run.system.joints[limited[column]]} at t = {run.time[row]:.3g} s"
    margins = left.min(axis=1)
    return replace(premise, along=_least(run, margins, margins < 0), note=near)

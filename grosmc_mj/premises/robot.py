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
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.reaching import gain_margin
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.physics.quiet import warnings_counted_only
from grosmc_mj.premises.audit import (
    ROUNDING,
    Audit,
    Point,
    Premise,
    Reading,
    audit,
    initial_surface,
    per_second,
    reading_of,
)
from grosmc_mj.premises.balance import Points, balance
from grosmc_mj.robots.coordinates import RobotCoordinates
from grosmc_mj.robots.dynamics import bias, inertia

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
    points = _along(result) if hasattr(law.parameters, "K") else []
    premises = []
    if run.sliding is not None and points:
        premises = [_rate(result, points), _authority(result, points), initial_surface(run.sliding)]
    premises.append(_torque(result))
    if points and isinstance(law.designed.error, RobotCoordinates):
        premises.append(_headroom(law, result.true, points))
    premises.append(_joints(result))
    signals = {
        "time": np.array([t for t, _, _ in points]),
        "required": np.array([found.required for _, _, found in points]),
        "configured": np.array([found.configured for _, _, found in points]),
    }
    return Audit(result.case, law.name, tuple(premises), signals)


def _along(result: RunResult) -> Points:
    """The balance along the run, by the torques that were applied."""
    run, points = result.trajectory, []
    rows = np.unique(np.linspace(0, len(run.input) - 1, _INSTANTS).astype(int))
    nothing = np.zeros(6 * len(run.system.bodies))
    assert result.true is not None
    with warnings_counted_only():
        for row in rows:
            t, x = float(run.time[row]), run.state[row]
            w = nothing if run.wrench is None else run.wrench[row]
            found = balance(result.controller, result.true, t, x, w, run.input[row])
            points.append((t, x, found))
    return points


def _rate(result: RunResult, points: Points) -> Premise:
    """The switching rate covers what pushes s away, with the input gain's uncertainty counted."""
    law, driven = result.controller, _driven(result)
    t, _, most = max(points, key=lambda point: point[2].required)
    joint = driven[int(np.abs(most.pushes).argmax())]
    alone = "" if "unit-vector" in law.designed.switching else _joint_by_joint(points)
    unit = per_second(law.designed.sliding_unit)
    printed = "epsilon" in law.designed.gains
    assert result.true is not None
    machine = ", the parts of its machine" if result.true.rigid is not result.true else ""
    found = Premise(
        "epsilon" if printed else "switching gain",
        "Theorem 3: ε >= (a_m + d_m) ‖GB‖" if printed else "Assumptions 4 and 6, eqs. (12), (37)",
        "the law's switching rate ρ at least push / r, what is required of it",
        unit,
        None,
        reading_of(points, (each.configured - each.required for _, _, each in points)),
        note=f"required at most {most.required:.3g}, configured {most.configured:.3g} {unit} "
        f"(at t = {t:.3g} s: push {most.push:.3g} at {joint}, r = {most.gain_ratio:.3g})"
        f"{alone}; in the push are the edits, the wrenches, and friction, joint limits and "
        f"contacts as MuJoCo has them under the applied torque; not in it: that the law is "
        f"sampled{machine}, and torque that was cut off",
    )
    if found.holds:
        return found
    if not np.isfinite(most.required):
        return replace(found, restores="no ρ, while r is not positive: see the input gain")
    return replace(found, restores=f"ρ = {most.required:.3g} {unit} instead of what is configured")


def _driven(result: RunResult) -> tuple[str, ...]:
    """What the inputs drive: every joint, or those that have an actuator, by its name."""
    system = result.trajectory.system
    every = len(system.inputs) == len(system.joints)
    return system.joints if every else system.actuators


def _joint_by_joint(points: Points) -> str:
    """What is required if each joint's push is set against its own row of R."""
    required = 0.0
    for _, _, found in points:
        diagonal = np.diag(found.R)
        left = 2 * diagonal - np.abs(found.R).sum(axis=1)
        if np.any(left <= 0):
            return ""
        required = max(required, float((np.abs(found.pushes) / left).max()))
    return f", or {required:.3g} with each joint's push against its own row of R"


def _authority(result: RunResult, points: Points) -> Premise:
    """The true inertia leaves something of the switching rate."""
    ratios = [each.gain_ratio for _, _, each in points]
    found = Premise(
        "input gain",
        "implied by Assumptions 3 and 5",
        "r positive: what dominance leaves of ρ with R = G E* (G E)⁻¹, of all joints M*⁻¹ M",
        "1",
        None,
        reading_of(points, (ratio - ROUNDING for ratio in ratios)),
        note=f"r from {min(ratios):.3g} to {max(ratios):.3g}; M has armature in it, which no "
        "payload changes",
    )
    if found.holds:
        return found
    least = min(points, key=lambda point: point[2].gain_ratio)
    taken = _taken_away(result, least[2].R)
    return replace(found, note=f"{found.note}; {taken}", restores=_dominance_again(result, points))


def _taken_away(result: RunResult, R: Array) -> str:
    """Which joint's row of R has lost its dominance, and to which other."""
    driven, beside = _driven(result), np.abs(R) - np.diag(np.abs(np.diag(R)))
    row = int((np.diag(R) - beside.sum(axis=1)).argmin())
    other = int(beside[row].argmax())
    return (
        f"in the row of {driven[row]} {R[row, row]:.3g} is its own and {beside[row].sum():.3g} the "
        f"others', most of it {driven[other]}'s"
    )


def _dominance_again(result: RunResult, points: Points) -> str:
    """What makes r positive: one switch for all joints, or a smaller part of the edits."""
    together = min(gain_margin(found.R, together=True) for _, _, found in points)
    said = []
    if together > 0 and "unit-vector" not in result.controller.designed.switching:
        said.append(f"a unit-vector switching law (r = {together:.3g} as one switch for all)")
    part = _bearable(result, points)
    if part is not None:
        said.append(f"the edits at {100 * part:.0f} % of their size")
    return " or ".join(said) or "another G, or a nominal model nearer to the true one"


def _bearable(result: RunResult, points: Points) -> float | None:
    """The largest part of the case's edits, of masses and lengths, that leaves r positive."""
    nominal, edits = result.experiment.nominal.plant, result.case.edits
    worst = sorted(points, key=lambda point: point[2].gain_ratio)[:_WORST]

    def keeps(part: float) -> bool:
        plant = nominal.changed([edit.shrunk(part) for edit in edits])
        found = (
            balance(result.controller, plant, t, x, np.zeros(6 * len(plant.system.bodies)))
            for t, x, _ in worst
        )
        return all(each.gain_ratio > 0 for each in found)

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
    shares = _shares(command, plant.input_limits)
    cut = command != applied
    largest = shares.max(axis=1)
    row = int(largest.argmax())
    margin = 1 - float(largest[row])
    said = [
        f"{joint} {100 * share:.0f} %" + (f" (cut {100 * part:.2g} % of the time)" if part else "")
        for joint, share, part in zip(
            _driven(result), shares.max(axis=0), cut.mean(axis=0), strict=True
        )
    ]
    point = Point(float(run.time[row]), tuple(run.state[row].tolist()), margin)
    return Premise(
        "torque limits",
        "the law has no bound on u",
        "no torque that the law asks for is cut: what is left of a joint's limit, as a part of it",
        "1",
        None,
        Reading(point, margin, float(cut.any(axis=1).mean())),
        note=f"largest, of the joint's limit: {', '.join(said)}",
    )


def _headroom(law: Controller, plant: Any, points: Points) -> Premise:
    """The nominal torque leaves what the switching term may need, whatever its signs."""
    error, limits = law.designed.error, plant.input_limits
    assert isinstance(error, RobotCoordinates)
    margins, alone, switched = [], [], []
    for t, _, found in points:
        y_r, dy_r, ddy_r = np.reshape(error.reference(t, law.parameters.reference), (-1, 3)).T
        M = inertia(error.model, y_r)
        nominal = M @ ddy_r + bias(error.model, y_r, dy_r)
        switching = np.abs(M).sum(axis=1) * found.configured
        worst = np.maximum(*(_shares(nominal + side * switching, limits) for side in (-1.0, 1.0)))
        margins.append(1 - float(worst.max()))
        alone.append(_shares(nominal, limits))
        switched.append(worst)
    joints = error.system.joints
    said = [
        f"{joint} {100 * a:.0f} %" + (f", {100 * b:.0f} %" if np.any(b > a) else "")
        for joint, a, b in zip(joints, np.max(alone, axis=0), np.max(switched, axis=0), strict=True)
    ]
    switches = any(found.configured for _, _, found in points)
    return Premise(
        "torque headroom",
        "eqs. (44), (55): u = M v + h",
        "along the reference, nominal inverse dynamics and |M| ρ of the switching term stay within "
        "the limits: what is left, as a part of the limit",
        "1",
        None,
        reading_of(points, margins),
        note="largest, of the joint's limit, "
        + ("alone and with switching: " if switches else "alone: ")
        + "; ".join(said),
    )


def _joints(result: RunResult) -> Premise:
    """No joint comes to its limit, where a torque acts that the law does not know."""
    run, plant = result.trajectory, result.true
    assert plant is not None
    model = plant.model
    limited = np.flatnonzero(model.jnt_limited)
    found = Premise(
        "joint limits",
        "the law does not know them",
        "no joint touches its limit: what is left on the nearer side, as a part of its range",
        "1",
        None,
        None,
        note="no joint has a limit",
    )
    if not len(limited):
        return found
    low, high = model.jnt_range[limited].T
    q = run.state[:, limited]
    left = np.minimum(q - low, high - q) / (high - low)
    row, column = divmod(int(left.argmin()), len(limited))
    margin = float(left[row, column])
    point = Point(float(run.time[row]), tuple(run.state[row].tolist()), margin)
    touched = float((left.min(axis=1) < 0).mean())
    near = f"nearest: {run.system.joints[limited[column]]} at t = {run.time[row]:.3g} s"
    return replace(found, along=Reading(point, margin, touched), note=near)

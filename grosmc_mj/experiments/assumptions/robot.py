"""The premises of a robot's run: switching rate, input gain, inputs and joint limits.

A robot has no declared operating region and no equations: everything is computed along the run,
by MuJoCo's dynamics of the true plant and of the nominal one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from grosmc_mj.experiments.assumptions.audit import (
    ROUNDING,
    Audit,
    Premise,
    Reading,
    audit,
    initial_surface,
    reading_of,
    signals,
    switching_premise,
)
from grosmc_mj.experiments.assumptions.balance import Balance, Loads, balance
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.units import rate_unit
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.mechanics.physics.hooks import warnings_counted_only
from grosmc_mj.mechanics.robots.coordinates import RobotCoordinates
from grosmc_mj.mechanics.robots.nominal import bias, gears, inertia
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.reaching import gain_margin

# The balance is computed at so many instants of a run; inputs and angles at all of them.
_INSTANTS = 400


def is_robots(result: RunResult) -> bool:
    """Whether a run is one that these premises are for: a robot's law on a robot in MuJoCo."""
    return result.true is not None and not result.trajectory.system.symbolic


def audit_of(lab: RunCache, experiment: Experiment, controller: str) -> Audit:
    """The premises of a law in an experiment, of a robot or of a plant with equations.

    Raises:
        ArgumentError: If nothing is known of its law's premises.
    """
    if experiment.nominal.system.symbolic:
        return audit(lab, experiment, controller)
    return robot_audit(lab.run(experiment, "physics", controller))


def audits(results: Sequence[RunResult]) -> list[Audit]:
    """The premises of every sliding mode law among the runs of robots in MuJoCo."""
    return [robot_audit(result) for result in results if _slides_on_robot(result)]


def _slides_on_robot(result: RunResult) -> bool:
    """Whether a run is a sliding mode law's on a robot, of one interval at least."""
    run = result.trajectory
    return is_robots(result) and run.sliding is not None and len(run.input) > 0


def robot_audit(result: RunResult) -> Audit:
    """The premises of a law along a run of a robot, at each instant that was looked at.

    A law that does not switch has those of inputs and joints only.

    Args:
        result: A run in MuJoCo of a robot's law.

    Raises:
        ArgumentError: If it is another run, or has no interval.
    """
    run = result.trajectory
    law = result.controller
    if not is_robots(result) or not len(run.input):
        raise ArgumentError(f"{result.key} is no run of a robot in MuJoCo: it has no such premises")
    plant: Any = result.true

    # Of a law of one's own no feedback is known that pushes and switching could be set against.
    points = None
    if hasattr(law.parameters, "K"):
        points = _along(result, plant)

    premises = []
    if run.sliding is not None and points is not None:
        premises.append(_rate(result, plant, points))
        premises.append(_authority(result, points))
        premises.append(initial_surface(run.sliding))
    premises.append(_input(result))
    if points is not None and isinstance(law.designed.error, RobotCoordinates):
        premises.append(_headroom(law, plant, points))
    premises.append(_joints(result, plant))

    curves = {}
    if points is not None:
        curves = signals(points)
    return Audit(result.case, law.name, tuple(premises), curves)


def _along(result: RunResult, plant: Any) -> Balance:
    """The balance along the run, by the inputs that were applied."""
    run = result.trajectory
    rows = np.unique(np.linspace(0, len(run.input) - 1, _INSTANTS).astype(int))
    points = []
    with warnings_counted_only():
        for i in rows:
            t = float(run.time[i])
            loads = Loads.of_run(run, [i])
            points.append(balance(result.controller, plant, t, run.state[i], loads, run.input[i]))
    columns = map(np.array, zip(*points, strict=True))
    return Balance(*columns)


def _rate(result: RunResult, plant: Any, points: Balance) -> Premise:
    """The switching rate covers what pushes s away, with the input gain's uncertainty counted."""
    design = result.controller.designed
    unit = rate_unit(design.sliding_unit)
    worst = points.at(int(points.required.argmax()))
    joint = _driven(result)[int(np.abs(worst.pushes).argmax())]

    remedy = "no ρ, while r is not positive: see the input gain"
    if np.isfinite(worst.required):
        remedy = f"ρ = {worst.required:.3g}{unit_after(unit)} instead of the configured one"

    machine = ""
    if plant.rigid is not plant:
        machine = ", the parts of its machine"
    return replace(
        switching_premise(design, points),
        remedy=remedy,
        note=f"required at most {worst.required:.3g}, configured {worst.configured:.3g}"
        f"{unit_after(unit)} (at t = {worst.t:.3g} s: push {worst.push:.3g} at {joint}, "
        f"r = {worst.gain_ratio:.3g}); in the push are the edits, the wrenches, and "
        f"friction, joint limits and contacts as MuJoCo has them under the applied input; not in "
        f"it: that the law is sampled{machine}, and input that was cut off",
    )


def _driven(result: RunResult) -> tuple[str, ...]:
    """Names of the driven joints: of every joint, or of the actuators where they are fewer."""
    system = result.trajectory.system
    if len(system.inputs) == len(system.joints):
        return system.joints
    return system.actuators


def _authority(result: RunResult, points: Balance) -> Premise:
    """The true inertia leaves something of the switching rate."""
    ratios = points.gain_ratio
    least = ratios.min()
    note = (
        f"r from {least:.3g} to {ratios.max():.3g}; M has armature in it, which no payload changes"
    )
    if least < ROUNDING:
        note += _least_dominant_row(points.R[ratios.argmin()], _driven(result))

    remedy = "another G, smaller edits, or a nominal model nearer to the true one"
    one_switch = gain_margin(points.R, together=True).min()
    if one_switch > 0 and "unit-vector" not in result.controller.designed.switching:
        remedy = f"a unit-vector switching law (r = {one_switch:.3g} as one switch for all)"
    return Premise(
        "input gain",
        "implied by Assumptions 3 and 5",
        "r positive: what dominance leaves of ρ with R = G E* (G E)⁻¹, of all joints M*⁻¹ M",
        "1",
        along=reading_of(points, ratios - ROUNDING),
        remedy=remedy,
        note=note,
    )


def _least_dominant_row(R: Array, driven: Sequence[str]) -> str:
    """Words on the joint whose row of R is least dominant, and the joint that takes most of it."""
    diagonal = np.diag(R)
    beside = np.abs(R) - np.diag(np.abs(diagonal))
    row = int((diagonal - beside.sum(axis=1)).argmin())
    taker = int(beside[row].argmax())
    return (
        f"; in the row of {driven[row]} {R[row, row]:.3g} is its own and {beside[row].sum():.3g} "
        f"the others', most of it {driven[taker]}'s"
    )


def _shares(u: Array, limits: Array) -> Array:
    """Inputs as parts of the limit on their side, in the shape of ``u``: 1 at the limit."""
    low, high = limits
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(u >= 0, u / high, u / low)
    # 0 within limits that begin at 0.
    return np.where(u == 0, 0.0, share)


def _input(result: RunResult) -> Premise:
    """The actuators give what the law asks for."""
    run = result.trajectory
    shares = _shares(result.demanded, result.input_limits)
    cut = result.cut

    joints = []
    for i, joint in enumerate(_driven(result)):
        words = f"{joint} {100 * shares[:, i].max():.0f} %"
        time_cut = cut[:, i].mean()
        if time_cut:
            words += f" (cut {100 * time_cut:.2g} % of the time)"
        joints.append(words)
    return Premise(
        "input limits",
        "the law has no bound on u",
        "no input that the law asks for is cut: what is left of its limit, as a part of it",
        "1",
        along=_least(run, 1 - shares.max(axis=1), np.asarray(cut.any(axis=1), float)),
        note=f"largest, of its limit: {', '.join(joints)}",
    )


def _least(run: Trajectory, margins: Array, violated: Array) -> Reading:
    """The least of the margins at the samples of a run."""
    row = int(margins.argmin())
    x = tuple(run.state[row].tolist())
    return Reading(float(margins[row]), float(violated.mean()), float(run.time[row]), x)


def _headroom(law: Controller, plant: Any, points: Balance) -> Premise:
    """The nominal input leaves what the switching term may need, whatever its signs."""
    error = cast(RobotCoordinates, law.designed.error)
    limits = plant.input_limits
    with np.errstate(over="ignore", invalid="ignore"):
        u, reserve = _reference_inputs(law, points)
        alone = _headroom_shares(u, limits)
        low = _headroom_shares(u - reserve, limits)
        high = _headroom_shares(u + reserve, limits)
    worst = np.maximum(low, high)

    joints = []
    for i, joint in enumerate(error.system.joints):
        largest_alone = alone[:, i].max()
        largest = worst[:, i].max()
        words = f"{joint} {100 * largest_alone:.0f} %"
        if largest > largest_alone:
            words += f", {100 * largest:.0f} %"
        joints.append(words)

    quantities = "alone: "
    if np.any(points.configured):
        quantities = "alone and with switching: "
    return Premise(
        "input headroom",
        "eqs. (44), (55): u = M v + h",
        "along the reference, nominal inverse dynamics and |M| ρ of the switching term stay within "
        "the limits: what is left, as a part of the limit",
        "1",
        along=reading_of(points, 1 - worst.max(axis=1)),
        note=f"largest, of its limit, {quantities}{'; '.join(joints)}",
    )


def _reference_inputs(law: Controller, points: Balance) -> tuple[Array, Array]:
    """Inputs of nominal inverse dynamics along the reference, and of |M| rho, (N, m) each."""
    error = cast(RobotCoordinates, law.designed.error)
    gear = gears(error.model)
    u = []
    reserve = []
    for t, rate in zip(points.t.tolist(), points.configured, strict=True):
        reference = error.reference(t, law.parameters.reference)
        y_r, dy_r, ddy_r = np.reshape(reference, (-1, 3)).T
        M = inertia(error.model, y_r)
        u.append((M @ ddy_r + bias(error.model, y_r, dy_r)) / gear)
        reserve.append(np.abs(M).sum(axis=1) * rate / np.abs(gear))
    return np.array(u), np.array(reserve)


def _headroom_shares(u: Array, limits: Array) -> Array:
    """Inputs as parts of their limits; of inputs beyond all numbers nothing is left."""
    return np.nan_to_num(_shares(u, limits), nan=np.inf, posinf=np.inf)


def _joints(result: RunResult, plant: Any) -> Premise:
    """No joint comes to its limit, where a torque acts that the law does not know."""
    run = result.trajectory
    limited = np.flatnonzero(plant.model.jnt_limited)
    along = None
    note = "no joint has a limit"
    if len(limited):
        low, high = plant.model.jnt_range[limited].T
        q = run.state[:, limited]
        distances = np.minimum(q - low, high - q) / (high - low)
        along = _least(run, distances.min(axis=1), distances.min(axis=1) < 0)

        row, column = divmod(int(distances.argmin()), len(limited))
        note = f"nearest: {run.system.joints[limited[column]]} at t = {run.time[row]:.3g} s"
    return Premise(
        "joint limits",
        "the law does not know them",
        "no joint touches its limit: what is left on the nearer side, as a part of its range",
        "1",
        along=along,
        note=note,
    )

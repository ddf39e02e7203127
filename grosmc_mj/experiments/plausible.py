"""Numbers of a case that are allowed, and probably a mistake."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from grosmc_mj.experiments.file.parts import table_of
from grosmc_mj.experiments.requirements import Requirement
from grosmc_mj.ground.fields import Range, range_of
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.mechanics.machine.stops import Stop
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import Plant, System

# Instants of a run at which a reference is looked at.
_INSTANTS = 201
# Of a range: an end that is converted from degrees is rounded.
_ROUNDING = 1e-9
_DEGREES = '; angles of an MJCF are in degrees, unless it has <compiler angle="radian"/>'


def implausible(
    system: System, x0: Sequence[float], edits: Sequence[Edit], loop: Loop | None
) -> Iterator[str]:
    """Return a line for each number of a case that is far from those of any machine.

    The usual sizes stand beside its field, or are those of its unit.

    Args:
        system: System of the plant.
        x0: Start, (n,).
        edits: Edits and parts of the machine.
        loop: The loop, if there is one.
    """
    parts: list[tuple[str, Any]] = [(table_of(edit), edit) for edit in edits]
    if loop is not None:
        parts += loop.parts
    for label, value, bounds in [*_starts(system, x0), *_numbers(system, parts)]:
        if not isinstance(value, float):
            continue
        usual = bounds.unusual(value)
        if usual:
            unit = unit_after(str(bounds.unit))
            yield f"{label} = {value:g}{unit} is implausible; usual: {usual}{unit}"


def unusual_limits(limits: Iterable[Requirement]) -> list[str]:
    """Return a line for each requirement whose number is far beyond the usual, each once."""
    lines: dict[str, None] = {}
    for limit in limits:
        if limit.number > limit.usual:
            unit = "a share" if limit.quantity == "1" else limit.unit
            line = f"{limit.key} = {limit.number:g} is implausible; usual: up to {limit.usual:g}"
            lines[f"{line}, {unit}"] = None
    return list(lines)


def _starts(system: System, x0: Sequence[float]) -> Iterator[tuple[str, Any, Range]]:
    """Return label, value and range of each state at the start."""
    for state, value in zip(system.states, x0, strict=True):
        # A start at an operating point has rounding errors in the place of zeros.
        yield f"start: {state.name}", value, Range(unit=state.unit, usual=(0, 1e4))


def _numbers(system: System, parts: Iterable[tuple[str, Any]]) -> Iterator[tuple[str, Any, Range]]:
    """Return label, value and range of each number of edits, machine and loop."""
    for kind, part in parts:
        owner = getattr(part, "of", "")
        if not isinstance(owner, str):
            owner = owner[0]
        name = f"{kind} of {owner!r}" if owner else kind
        for item in fields(part):
            bounds = range_of(type(part), item.name)
            if bounds is None:
                continue
            bounds = replace(bounds, unit=bounds.unit_in(system, owner))
            yield f"{name}: {item.name}", getattr(part, item.name), bounds


def joint_ranges(plant: Plant, edits: Sequence[Edit]) -> Mapping[str, tuple[float, float]]:
    """Range of each limited joint of a system by its name, in rad or m.

    Args:
        plant: The nominal plant; only a model in MuJoCo has ranges.
        edits: Edits and parts of the machine, with its stops.
    """
    if not isinstance(plant, MujocoPlant):
        return {}
    ranges = {}
    for name in plant.system.joints:
        joint = plant.undrawn_model.joint(name)
        if joint.limited[0]:
            low, high = joint.range.tolist()
            ranges[name] = (low, high)
    for edit in edits:
        if isinstance(edit, Stop):
            low, high = ranges.get(edit.joint, (-math.inf, math.inf))
            ranges[edit.joint] = (max(low, edit.low), min(high, edit.high))
    return ranges


def beyond_ranges(
    ranges: Mapping[str, tuple[float, float]],
    system: System,
    x0: Sequence[float],
    laws: Iterable[Controller],
    duration: float,
) -> list[str]:
    """Return a line for each joint whose start or reference its range does not reach.

    Args:
        ranges: Range of joints, by their names.
        system: System of the plant.
        x0: Start, (n,).
        laws: Controllers, with the references.
        duration: Duration of a run [s].
    """
    laws = list(laws)
    lines = []
    for name, (low, high) in ranges.items():
        index = system.joints.index(name)
        position = system.positions[index]
        wanted = [("start", x0[index])]
        wanted += [("task: reference", value) for value in _ends(laws, position.name, duration)]

        rounding = _ROUNDING * max(abs(low), abs(high))
        for label, value in wanted:
            if low - rounding <= value <= high + rounding:
                continue
            line = (
                f"{label}: {position.name} = {value:.4g}{unit_after(position.unit)} is beyond "
                f"the joint's range of {low:.4g} to {high:.4g}{unit_after(position.unit)}"
            )
            if position.unit == "rad" and math.degrees(low) <= value <= math.degrees(high):
                line += _DEGREES
            lines.append(line)
    return list(dict.fromkeys(lines))


def _ends(laws: Iterable[Controller], state: str, duration: float) -> list[float]:
    """Least and largest value of a state's references, of each law that has one."""
    times = np.linspace(0.0, duration, _INSTANTS)
    ends = []
    for law in laws:
        if law.design is None or state not in law.design.error.names:
            continue
        row = law.design.error.names.index(state)
        # A run says where a reference is undefined.
        with contextlib.suppress(ArithmeticError, ValueError):
            values = law.coordinates.reference_along(times, law.parameters.reference)[:, row]
            values = values[np.isfinite(values)]
            if len(values):
                ends += [float(values.min()), float(values.max())]
    return ends

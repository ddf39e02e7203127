"""A machine without one of its properties, each in turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.mechanics.machine import MachinePart
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.edits import AddedMass, BodyEdit, JointEdit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.loop import Loop

# Fields of a part of the loop that are no property of the machine by themselves.
_NO_PROPERTIES = ("of", "exact", "order")
FITTED_MASSES = "fitted masses"


def without_each(experiment: Experiment) -> Mapping[str, Experiment]:
    """Return the experiment without each property of its machine, by the property's name.

    A number of the loop becomes ideal, damping and friction of a joint zero, masses those of the
    nominal model; a part of the machine is left out. Nothing else changes.

    Args:
        experiment: The experiment; disturbances stay.
    """
    lesser: dict[str, Experiment] = {}
    if experiment.loop is not None:
        for name, loop in _loops(experiment.loop).items():
            lesser[name] = experiment.changed(loop=loop)
    for name, edits in _machines(experiment).items():
        lesser[name] = experiment.changed(edits=edits)
    return lesser


def _loops(loop: Loop) -> Mapping[str, Loop]:
    """Return the loop without each number that is not ideal."""
    loops = {}
    for kind, part in loop.parts:
        if kind == "estimator":
            continue
        of = getattr(part, "of", "")
        for field in fields(part):
            is_ideal = getattr(part, field.name) == field.default
            if field.name in _NO_PROPERTIES or is_ideal:
                continue
            name = f"{of or kind} {field.name.replace('_', ' ')}"
            loops[name] = loop.changed(kind, of, **{field.name: field.default})
    return loops


def _machines(experiment: Experiment) -> Mapping[str, tuple[Edit, ...]]:
    """Return the edits of the plant without each property."""
    edits = experiment.edits
    machines: dict[str, tuple[Edit, ...]] = {}
    for joint, number in _numbers_of_joints(experiment):
        machines[f"{joint} {number}"] = _with_number(edits, joint, number, 0.0)

    masses = [edit for edit in edits if isinstance(edit, BodyEdit | AddedMass)]
    armatures = [edit for edit in edits if isinstance(edit, JointEdit) and edit.armature]
    if masses or armatures:
        nominal: tuple[Edit, ...] = tuple(edit for edit in edits if edit not in masses)
        for edit in armatures:
            nominal = _with_number(nominal, edit.joint, "armature", None)
        machines[FITTED_MASSES] = nominal

    for part in edits:
        if isinstance(part, MachinePart):
            name = f"{part.of} {part.kind}"
            machines[name] = tuple(edit for edit in edits if edit is not part)
    return machines


def _numbers_of_joints(experiment: Experiment) -> Sequence[tuple[str, str]]:
    """Return the joints that have damping or friction, with the name of that number."""
    plant = experiment.plant(experiment.nominal.truest)
    if not isinstance(plant, MujocoPlant):
        return []
    numbers = []
    for name in plant.system.joints:
        joint = plant.model.joint(name)
        if joint.damping.any():
            numbers.append((name, "damping"))
        if joint.frictionloss.any():
            numbers.append((name, "friction"))
    return numbers


def _with_number(
    edits: tuple[Edit, ...], joint: str, number: str, value: float | None
) -> tuple[Edit, ...]:
    """Return edits in which a joint has another damping, friction or armature; None: nominal."""
    changes: dict[str, Any] = {number: value}
    changed = []
    found = False
    for edit in edits:
        if isinstance(edit, JointEdit) and edit.joint == joint:
            changed.append(replace(edit, **changes))
            found = True
        else:
            changed.append(edit)
    if not found:
        changed.append(JointEdit(joint, **changes))
    return tuple(changed)

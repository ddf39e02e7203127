"""Models that runs compute with: nothing that is only drawn, and edits without a compiler.

The numbers that edits change are written into a compiled model. MuJoCo computes the rest from them,
as its compiler does, bit for bit. Compiling takes a hundred times as long.
"""

from __future__ import annotations

import copy
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from grosmc_mj.mechanics.physics.edit import Change, Edit

# All the fields that ``Edit.changes`` may name.
_FIELDS = ("body_mass", "body_inertia", "body_ipos", "body_pos", "site_pos", "actuator_gear")


@dataclass(frozen=True, eq=False)
class Template:
    """A compiled model whose edits can be written into it.

    Attributes:
        spec: What it was compiled from.
        model: Without edits.
    """

    spec: mujoco.MjSpec
    model: mujoco.MjModel

    def changes(self, edits: Sequence[Edit]) -> list[Change] | None:
        """Collect the changes of all edits; None if the edited model must be compiled."""
        targets = {(type(edit), edit.of) for edit in edits}
        if not self._writable or len(targets) < len(edits):
            return None

        changes: list[Change] = []
        for edit in edits:
            changes_of_edit = edit.changes(self.model, self.undrawn_bodies)
            if changes_of_edit is None:
                return None
            changes += changes_of_edit
        return changes

    def copy(self) -> mujoco.MjModel:
        """Copy the compiled model, to write changes into."""
        return copy.copy(self.model)

    def write(
        self,
        changes: Sequence[Change],
        model: mujoco.MjModel,
        data: mujoco.MjData,
    ) -> None:
        """Write changes into a copy of the model, whatever has been written into it before.

        Args:
            changes: Returned by ``changes``.
            model: Returned by ``copy``.
            data: Memory of that model, to compute in.
        """
        for field in _FIELDS:
            getattr(model, field)[:] = getattr(self.model, field)
        for field, rows, value in changes:
            getattr(model, field)[rows] = value

        # The numbers that MuJoCo derives; it leaves the springs of tendons as they were.
        mujoco.mj_setConst(model, data)
        at_rest = self._tendons_at_rest()
        model.tendon_lengthspring[at_rest] = model.tendon_length0[at_rest, None]

    def written(self, edits: Sequence[Edit]) -> mujoco.MjModel | None:
        """Edited model, valid until the next call in this thread; None where ``changes`` is."""
        changes = self.changes(edits)
        if changes is None:
            return None

        model, data = _workspace(self, threading.get_ident())
        self.write(changes, model, data)
        return model

    # Asked for each plant of a campaign.
    @cached_property
    def undrawn_bodies(self) -> frozenset[str]:
        """Bodies on which only sites and other bodies have a place."""
        return frozenset(body.name for body in self.spec.bodies if _is_undrawn(body))

    def _tendons_at_rest(self) -> NDArray[np.intp]:
        """Indices of the tendons that are at rest as the model is compiled."""
        at_rest = self.model.tendon_lengthspring == self.model.tendon_length0[:, None]
        return np.flatnonzero(at_rest.all(axis=1))

    @cached_property
    def _writable(self) -> bool:
        """True if the motion depends on nothing that only a compiler computes.

        Only it computes the mean inertia, which constraints are solved by, and corrects inertias.
        """
        model = self.model
        touchable = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
        constrained = (
            (touchable and model.ngeom)
            or _has_joint_or_tendon_constraint(model)
            or model.neq
            or model.nflex
            or model.nplugin
        )
        compiler = self.spec.compiler
        corrected = compiler.balanceinertia or compiler.boundmass or compiler.boundinertia
        return not constrained and not corrected


def _is_undrawn(body: mujoco.MjsBody) -> bool:
    """True if only sites and other bodies have a place on a body, in its own frame."""
    if body.geoms or body.cameras or body.lights:
        return False
    return not any(part.frame for part in (*body.sites, *body.bodies))


# Making both takes 0.7 ms, writing edits into them 0.1 ms.
@lru_cache(maxsize=8)
def _workspace(template: Template, _thread: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Model and data of a thread, for a template's edits."""
    model = template.copy()
    return model, mujoco.MjData(model)


def undrawn(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Copy a model without geoms, materials, textures, meshes, cameras and lights.

    Parts that the motion depends on stay: geoms that can touch or that a fluid pushes, and all that
    a sensor, a tendon or a contact pair names. A body whose inertia came from its geoms keeps every
    bit of it; a model that MuJoCo cannot part from its geoms, such as one with ``inertiafromgeom``,
    keeps them all.

    Args:
        spec: The model, which stays as it is.
    """
    bare: mujoco.MjSpec = spec.copy()
    if bare.option.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        for geom in bare.geoms:
            geom.contype = 0
            geom.conaffinity = 0
    try:
        bare.discard_visual()
    except ValueError:
        return spec.copy()

    sensed: set[str] = set()
    for sensor in bare.sensors:
        sensed |= {sensor.objname, sensor.refname}
    for item in (*bare.cameras, *bare.lights):
        if item.name not in sensed:
            bare.delete(item)
    return bare


def can_constrain(model: mujoco.MjModel) -> bool:
    """True if a constraint can ever act: contact, a limit, dry friction, an equality.

    Where none can, MuJoCo's accelerations are the smooth ones, and with ``mjDSBL_CONSTRAINT`` a
    step has the same bits in nine tenths of the time.
    """
    if model.neq or model.nflex or _has_joint_or_tendon_constraint(model):
        return True
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        return False
    return bool(model.npair or (model.geom_contype.any() and model.geom_conaffinity.any()))


def _has_joint_or_tendon_constraint(model: mujoco.MjModel) -> bool:
    """True if a joint or a tendon has a limit or dry friction."""
    limits = model.jnt_limited.any() or model.tendon_limited.any()
    friction = model.dof_frictionloss.any() or model.tendon_frictionloss.any()
    return bool(limits or friction)

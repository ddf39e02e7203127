"""Models that runs compute with: nothing that is only drawn, and edits without a compiler.

The numbers that edits change are written into a compiled model. MuJoCo computes the rest from them,
as its compiler does, bit for bit. Compiling takes a hundred times as long.
"""

from __future__ import annotations

import copy
import itertools
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from grosmc_mj.physics.edits import Change, Edit

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
        """The changes of all edits; None if the edited model must be compiled, or be refused."""
        if not self._writable or len({(type(edit), edit.of) for edit in edits}) < len(edits):
            return None
        changes = [edit.changes(self) for edit in edits]
        if any(change is None for change in changes):
            return None
        return list(itertools.chain.from_iterable(filter(None, changes)))

    def copy(self) -> mujoco.MjModel:
        """A compiled model to write changes into."""
        return copy.copy(self.model)

    def write(self, changes: Sequence[Change], model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Make a copy the edited model, whatever has been written into it before.

        Args:
            changes: By ``changes``.
            model: By ``copy``.
            data: Of that model, to compute in.
        """
        for field in _FIELDS:
            getattr(model, field)[:] = getattr(self.model, field)
        for field, rows, value in changes:
            getattr(model, field)[rows] = value
        mujoco.mj_setConst(model, data)
        model.tendon_lengthspring[self._springs] = model.tendon_length0[self._springs, None]

    def written(self, edits: Sequence[Edit]) -> mujoco.MjModel | None:
        """Edited model, valid until the next call in this thread; None where ``changes`` is."""
        changes = self.changes(edits)
        if changes is None:
            return None

        model, data = _workspace(self, threading.get_ident())
        self.write(changes, model, data)
        return model

    @cached_property
    def undrawn_bodies(self) -> frozenset[str]:
        """Bodies on which only sites and other bodies have a place."""
        return frozenset(
            body.name
            for body in self.spec.bodies
            if not (body.geoms or body.cameras or body.lights)
            and not any(part.frame for part in (*body.sites, *body.bodies))
        )

    @cached_property
    def _springs(self) -> NDArray[np.intp]:
        """Tendons that are at rest as the model is compiled."""
        at_rest = self.model.tendon_lengthspring == self.model.tendon_length0[:, None]
        return np.flatnonzero(at_rest.all(axis=1))

    @cached_property
    def _writable(self) -> bool:
        """Whether the motion depends on nothing that only a compiler computes.

        The mean inertia, which constraints are solved by, and a compiler's corrections of inertias
        are such.
        """
        model, compiler = self.model, self.spec.compiler
        untouched = model.ngeom == 0 or model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
        constraints = (
            model.neq, model.jnt_limited, model.tendon_limited, model.dof_frictionloss,
            model.tendon_frictionloss, model.nflex, model.nplugin,
        )  # fmt: skip
        corrected = compiler.balanceinertia, compiler.boundmass, compiler.boundinertia
        return bool(untouched) and not any(map(np.any, (*constraints, *corrected)))


# Making both takes 0.7 ms, writing edits into them 0.1 ms.
@lru_cache(maxsize=8)
def _workspace(template: Template, _thread: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Model and data of a thread, for a template's edits."""
    model = template.copy()
    return model, mujoco.MjData(model)


def undrawn(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """A copy of the model without geoms, materials, textures, meshes, cameras and lights.

    What has a part in the motion stays: geoms that can touch or that a fluid pushes, and what a
    sensor, a tendon or a contact pair names. A body whose inertia came from its geoms keeps every
    bit of it; a model that MuJoCo cannot part from its geoms, such as one with ``inertiafromgeom``,
    keeps them all.

    Args:
        spec: The model, which stays as it is.
    """
    bare: mujoco.MjSpec = spec.copy()
    if bare.option.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        for geom in bare.geoms:
            geom.contype = geom.conaffinity = 0
    try:
        bare.discard_visual()
    except ValueError:
        return spec.copy()
    sensed = {name for sensor in bare.sensors for name in (sensor.objname, sensor.refname)}
    for item in (*bare.cameras, *bare.lights):
        if item.name not in sensed:
            bare.delete(item)
    return bare


def can_constrain(model: mujoco.MjModel) -> bool:
    """Whether a constraint can ever act: contact, a limit, dry friction, an equality.

    Where none can, MuJoCo's accelerations are the smooth ones, and with ``mjDSBL_CONSTRAINT`` a
    step has the same bits in nine tenths of the time.
    """
    limits = model.jnt_limited.any() or model.tendon_limited.any()
    friction = model.dof_frictionloss.any() or model.tendon_frictionloss.any()
    if model.neq or model.nflex or limits or friction:
        return True
    touching = model.npair or (model.geom_contype.any() and model.geom_conaffinity.any())
    return bool(touching) and not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT

"""Parameter uncertainty as an edit of a body's mass and length."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError, unknown_name
from grosmc_mj.simulation.models import compile_spec

_SIZELESS = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF)


@dataclass(frozen=True)
class BodyEdit:
    """Scale a body's mass by a and every length of it by b.

    The body stays similar to itself: its inertia about its centre of mass scales by a b^2, the
    offset of that centre, its sites, its child bodies' places and its drawn geometry by b.

    Attributes:
        body: Name of the body.
        mass_scale: a.
        length_scale: b.
    """

    body: str
    mass_scale: float = 1.0
    length_scale: float = 1.0

    def __post_init__(self) -> None:
        for name in ("mass_scale", "length_scale"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ModelError(
                    f"edit of {self.body!r}: {name} = {value:g} must be finite and positive"
                )


def apply_edits(spec: mujoco.MjSpec, edits: Iterable[BodyEdit]) -> mujoco.MjSpec:
    """A fresh copy of ``spec`` with the edits applied; ``spec`` itself is not touched.

    Raises:
        ModelError: If a body is unknown, edited twice, massless under a mass edit, or drawn by a
            mesh under a length edit.
    """
    edits = tuple(edits)
    if not edits:
        return spec.copy()
    nominal, edited = compile_spec(spec), spec.copy()
    names = [edit.body for edit in edits]
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"body {name!r} is edited twice: give one edit with both scales")
    for edit in edits:
        valid = [nominal.body(i).name for i in range(1, nominal.nbody)]
        if edit.body not in valid:
            raise ModelError(unknown_name("body", edit.body, valid))
        _scale_inertia(edited.body(edit.body), nominal.body(edit.body), edit)
        _scale_geometry(edited.body(edit.body), edit.length_scale)
    return edited


def _scale_inertia(body: mujoco.MjsBody, nominal: object, edit: BodyEdit) -> None:
    """Write the scaled inertia of the compiled nominal body, explicit from now on."""
    mass = float(nominal.mass[0])  # pyright: ignore[reportAttributeAccessIssue]
    if mass == 0:
        if edit.mass_scale != 1:
            raise ModelError(f"body {edit.body!r} has no mass to scale: edit the body that has")
        return
    a, b = edit.mass_scale, edit.length_scale
    body.explicitinertial = True
    body.mass = a * mass
    body.inertia = a * (b * b) * nominal.inertia  # pyright: ignore[reportAttributeAccessIssue]
    body.ipos = b * nominal.ipos  # pyright: ignore[reportAttributeAccessIssue]
    body.iquat = nominal.iquat  # pyright: ignore[reportAttributeAccessIssue]
    body.fullinertia = np.full(6, np.nan)


def _scale_geometry(body: mujoco.MjsBody, b: float) -> None:
    """Scale what is drawn and what is attached, about the body's origin."""
    if b == 1:
        return
    for geom in body.geoms:
        if geom.type in _SIZELESS:
            raise ModelError(
                f"geom {geom.name!r} of body {body.name!r} is a mesh: length edits need "
                "primitive geoms"
            )
        geom.size, geom.fromto = b * geom.size, b * geom.fromto
    for part in (*body.geoms, *body.sites, *body.cameras, *body.lights, *body.bodies, *body.frames):
        part.pos = b * part.pos

"""Edited models without a compiler: the numbers that edits change, written into a compiled model.

MuJoCo computes the rest from them, as its compiler does, bit for bit. Compiling takes a hundred
times as long.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from grosmc_mj.physics.edits import BodyEdit, Edit, InputEdit

# A compiler refuses a body that moves and weighs less.
_LEAST = mujoco.mjMINVAL
# What follows from other fields only when a model is compiled, and from what.
_SPRINGS, _LENGTHS = "tendon_lengthspring", "tendon_length0"

# All the fields that edits which can be written may change.
_FIELDS = ("body_mass", "body_inertia", "body_ipos", "body_pos", "site_pos", "actuator_gear")

# A field of mjModel, which of its rows, and what is there.
Change = tuple[str, Any, Any]


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
        """What edits change; None if only a compiler can tell, or must refuse them.

        Masses and lengths of bodies and gears can be written; lengths of what nothing is fixed to
        but sites and other bodies.
        """
        if not self._writable:
            return None
        found: list[Change] = []
        edited: set[tuple[type, str]] = set()
        for edit in edits:
            if isinstance(edit, BodyEdit):
                what, new = (BodyEdit, edit.body), self._of_body(edit)
            elif isinstance(edit, InputEdit):
                what, new = (InputEdit, edit.input), self._of_input(edit)
            else:
                return None
            if new is None or what in edited:
                return None
            edited.add(what)
            found += new
        return found

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
        for name in _FIELDS:
            getattr(model, name)[:] = getattr(self.model, name)
        for name, row, value in changes:
            getattr(model, name)[row] = value
        mujoco.mj_setConst(model, data)
        model.tendon_lengthspring[self._springs] = model.tendon_length0[self._springs, None]

    def written(self, edits: Sequence[Edit]) -> mujoco.MjModel | None:
        """The edited model, the same object each time, to be read at once.

        None if only a compiler can tell, see ``changes``.
        """
        if not edits:
            return self.model
        changes = self.changes(edits)
        if changes is None:
            return None
        model, data = self._scratch
        self.write(changes, model, data)
        return model

    @cached_property
    def _scratch(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """What fields are written into."""
        model = self.copy()
        return model, mujoco.MjData(model)

    @cached_property
    def _springs(self) -> NDArray[np.intp]:
        """Tendons that are at rest as the model is compiled."""
        at_rest = getattr(self.model, _SPRINGS) == getattr(self.model, _LENGTHS)[:, None]
        return np.flatnonzero(at_rest.all(axis=1))

    @cached_property
    def _writable(self) -> bool:
        """Whether nothing that only a compiler computes has a part in the motion.

        The mean inertia, which constraints are solved by, and a compiler's corrections of inertias
        are such.
        """
        model, compiler = self.model, self.spec.compiler
        untouched = model.ngeom == 0 or model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
        constraints = (model.neq, model.jnt_limited, model.tendon_limited, model.dof_frictionloss)
        corrected = (compiler.balanceinertia, compiler.boundmass, compiler.boundinertia)
        bare = (model.nflex, model.nplugin, *map(np.any, (*constraints, model.tendon_frictionloss)))
        return bool(untouched) and not any(bare) and not any(corrected)

    def _of_body(self, edit: BodyEdit) -> list[Change] | None:
        """What an edit of a body changes."""
        model, a, b = self.model, edit.mass_scale, edit.length_scale
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, edit.body)
        if index < 1 or (b != 1 and edit.body not in self._scalable):
            return None
        mass, inertia, centre = self._bodies[index]
        heavier, wider = a * mass, [a * (b * b) * each for each in inertia]
        pairs = zip((heavier, *wider), (mass, *inertia), strict=True)
        if not mass or not all(
            math.isfinite(x) and (x >= _LEAST or was < _LEAST) for x, was in pairs
        ):
            return None
        found: list[Change] = [("body_mass", index, heavier), ("body_inertia", index, wider)]
        if b == 1:
            return found
        found.append(("body_ipos", index, [b * each for each in centre]))
        for name, of in (("body_pos", model.body_parentid), ("site_pos", model.site_bodyid)):
            rows = np.flatnonzero(of == index)
            if len(rows):
                found.append((name, rows, b * getattr(model, name)[rows]))
        return found

    @cached_property
    def _bodies(self) -> list[tuple[float, list[float], list[float]]]:
        """Mass, principal inertias and centre of mass of every body."""
        model = self.model
        columns = (model.body_mass, model.body_inertia, model.body_ipos)
        return list(zip(*(column.tolist() for column in columns), strict=True))

    def _of_input(self, edit: InputEdit) -> list[Change] | None:
        """What another gear changes."""
        index = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_ACTUATOR, edit.input)
        return None if index < 0 else [("actuator_gear", (index, 0), edit.gear)]

    @cached_property
    def _scalable(self) -> frozenset[str]:
        """Bodies of which sites and other bodies are all that has a place on them."""
        return frozenset(self._bodies_without_looks())

    def _bodies_without_looks(self) -> Iterator[str]:
        """Their names."""
        for body in self.spec.bodies:
            looks = (*body.geoms, *body.cameras, *body.lights)
            if not looks and not any(part.frame for part in (*body.sites, *body.bodies)):
                yield body.name

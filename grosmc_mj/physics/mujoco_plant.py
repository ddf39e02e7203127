"""A plant whose motion MuJoCo computes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, get_args
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arguments import real, require
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, ModelError, shown, unknown_name
from grosmc_mj.machine.parts import MachinePart, Stop
from grosmc_mj.machine.stability import refuse_unstable
from grosmc_mj.machine.unseen import UnseenState, unseen_states
from grosmc_mj.physics.checks import fingerprint, spec_fingerprint
from grosmc_mj.physics.edits import BodyEdit, Edit, apply_edits
from grosmc_mj.physics.files import compile_spec, load_spec, model_path
from grosmc_mj.physics.mjdata import scratch
from grosmc_mj.physics.template import Change, Template
from grosmc_mj.physics.unconstrained import can_constrain
from grosmc_mj.physics.undrawn import undrawn
from grosmc_mj.plants import AnalyticPlant, Plant, System, Variant, find_system
from grosmc_mj.plants.plant import Integrator, Kind

_INTEGRATORS: dict[int, Integrator] = {
    int(getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}")): name
    for name in get_args(Integrator)
}


# Specs without what is only drawn, and compiled nominal models, by the spec for as long as a plant
# has it.
_undrawn_specs: WeakKeyDictionary[mujoco.MjSpec, mujoco.MjSpec] = WeakKeyDictionary()
_nominal_models: WeakKeyDictionary[mujoco.MjSpec, mujoco.MjModel] = WeakKeyDictionary()
# What edits are written into, by spec and by timestep and integrator.
_templates: WeakKeyDictionary[mujoco.MjSpec, dict[tuple[Any, ...], Template]] = WeakKeyDictionary()

# What a spec was like when the first plant was made of it.
_as_made: WeakKeyDictionary[mujoco.MjSpec, str] = WeakKeyDictionary()


def _nominal_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The compiled nominal model, for thousands of edits of one spec compiled once."""
    if spec not in _nominal_models:
        _nominal_models[spec] = compile_spec(_undrawn_spec(spec))
    return _nominal_models[spec]


def _undrawn_spec(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """The nominal model without what is only drawn, made once."""
    if spec not in _undrawn_specs:
        _undrawn_specs[spec] = undrawn(spec)
    return _undrawn_specs[spec]


@cache
def _nominal_spec(name: str, path: Path, changed: int) -> mujoco.MjSpec:
    """The model of a system, read once as long as its file stays: nobody changes the spec.

    Args:
        name: Name of the system.
        path: Its file.
        changed: When a file beside it, which it may include, last changed [ns].
    """
    return load_spec(name)


@dataclass(frozen=True, eq=False)
class MujocoPlant(Plant):
    """A system's MJCF model, possibly with edited bodies, another timestep or integrator.

    Attributes:
        system: Names and equations of the system.
        spec: The nominal model; never changed.
        edits: Edits of the nominal model.
        timestep: Physics timestep [s]; None for the model's own.
        integrator: MuJoCo's integrator; None for the model's own.
    """

    system: System
    spec: mujoco.MjSpec
    edits: tuple[Edit, ...] = ()
    timestep: float | None = None
    integrator: Integrator | None = None

    @classmethod
    def load(
        cls,
        name: str,
        *,
        edits: tuple[Edit, ...] = (),
        timestep: float | None = None,
        integrator: Integrator | None = None,
    ) -> MujocoPlant:
        """The plant of a shipped model.

        Raises:
            ModelError: If the name or an edit is not valid.
        """
        system, path = find_system(name), model_path(name)
        changed = max(file.stat().st_mtime_ns for file in path.parent.glob("*.xml"))
        spec = _nominal_spec(system.name, path, changed)
        require("edits", edits, (list, tuple), "a tuple of edits", ModelError)
        return cls(system, spec, tuple(edits), timestep, integrator)

    def __post_init__(self) -> None:
        require("system", self.system, System, "a System", ModelError)
        require("spec", self.spec, mujoco.MjSpec, "an MjSpec", ModelError)
        require("edits", self.edits, tuple, "a tuple of edits", ModelError)
        for edit in self.edits:
            wanted = "an edit of a body, joint or input, a load or a part of a machine"
            require("edit", edit, get_args(Edit), wanted, ModelError)
        if self.timestep is not None and not 1e-9 <= real(self.timestep) < 1:
            raise ArgumentError(
                f"timestep {shown(self.timestep)} s must lie between 0 and 1 s, at least 1e-09 s"
            )
        require("integrator", self.integrator, (str, type(None)), "a name", ModelError)
        if self.integrator is not None and self.integrator not in get_args(Integrator):
            raise ModelError(unknown_name("integrator", self.integrator, get_args(Integrator)))
        if self.spec not in _as_made:
            _as_made[self.spec] = spec_fingerprint(self.spec)

    def edited(self, *edits: Edit) -> MujocoPlant:
        """The nominal model with these edits; earlier edits are replaced, never compounded."""
        return replace(self, edits=edits)

    def believed(self, *edits: Edit) -> MujocoPlant:
        """A nominal model that has these edits itself, so that laws designed for it know them.

        Raises:
            ModelError: If an edit is not valid.
        """
        nominal = apply_edits(self.spec, edits, _nominal_model(self.spec))
        return replace(self, spec=nominal)

    def changed(
        self, edits: Sequence[Edit] = (), scales: Mapping[str, float] | None = None
    ) -> MujocoPlant:
        """The nominal model with these edits, as ``edited``.

        Raises:
            ModelError: If a parameter is to be scaled, or an edit is not valid.
        """
        if scales:
            raise ModelError(
                f"{self.system.name} has a model in MuJoCo: edit a body or a joint instead of "
                f"{', '.join(scales)}"
            )
        return self.edited(*edits)

    @property
    def kind(self) -> Kind:
        """MuJoCo's physics."""
        return "physics"

    @cached_property
    def parts(self) -> tuple[MachinePart, ...]:
        """What makes it a machine as built."""
        return tuple(edit for edit in self.edits if isinstance(edit, MachinePart))

    @cached_property
    def rigid(self) -> MujocoPlant:
        """The same without the parts of a machine: what equations can say of it."""
        if not self.parts:
            return self
        return self.edited(*(edit for edit in self.edits if not isinstance(edit, MachinePart)))

    @cached_property
    def unseen(self) -> tuple[UnseenState, ...]:
        """Its states that no law sees."""
        return unseen_states(self._model_like, self.system, self.parts)

    def require_start(self, x0: Array) -> None:
        """Refuse a start beyond a stop, as ``Plant`` says."""
        for part in self.parts:
            if isinstance(part, Stop) and part.joint in self.system.joints:
                index = self.system.joints.index(part.joint)
                if not part.low <= x0[index] <= part.high:
                    unit = self.system.states[index].unit
                    raise ArgumentError(
                        f"{self.system.name}: {part.joint} starts at {x0[index]:.6g} {unit}, "
                        f"beyond its stops at {part.low:.6g} and {part.high:.6g} {unit}: move the "
                        "start or the stops"
                    )

    @cached_property
    def parameters(self) -> Any:
        """The numbers of its analytic twin; None where it has none."""
        return self.analytic().parameters if self.system.read_parameters else None

    @property
    def _model_like(self) -> mujoco.MjModel:
        """A compiled model with its states and drives: edits that are no parts change neither."""
        return self.undrawn_model if self.parts else _nominal_model(self.spec)

    @property
    def stepped_by(self) -> Integrator:
        """MuJoCo's integrator, by its name."""
        return self.integrator or _INTEGRATORS[int(self.spec.option.integrator)]

    @property
    def restepped(self) -> bool:
        """Whether another integrator is asked for than the model says."""
        return self.stepped_by != _INTEGRATORS[int(self.spec.option.integrator)]

    @property
    def input_limits(self) -> Array:
        """Range of each actuator's control, (2, m)."""
        model = self._model_like
        limited = model.actuator_ctrllimited.astype(bool)
        return np.where(limited, model.actuator_ctrlrange.T, [[-np.inf], [np.inf]])

    @property
    def digest(self) -> str:
        """SHA-256 of the compiled model."""
        buffer = np.zeros(mujoco.mj_sizeModel(self.model), np.uint8)
        mujoco.mj_saveModel(self.model, None, buffer)
        return hashlib.sha256(buffer.tobytes()).hexdigest()

    def derivative(
        self, x: ArrayLike, u: ArrayLike = 0.0, wrench: ArrayLike | None = None
    ) -> Array:
        """x' by MuJoCo's forward dynamics, (n,).

        Raises:
            ModelError: If it has states of its own, so that x does not tell.
        """
        self._refuse_unseen()
        x, u, w = self.checked(x, u, wrench)
        model, n = self.undrawn_model, self.system.degrees_of_freedom
        data = scratch(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = x[:n], x[n:], u
        bodies = [model.body(name).id for name in self.system.bodies]
        data.xfrc_applied[bodies] = w.reshape(-1, 6)
        mujoco.mj_forward(model, data)
        return np.concatenate([x[n:], data.qacc])

    def _refuse_unseen(self) -> None:
        """Refuse to say x' of a state that does not tell all."""
        if self.unseen:
            raise ModelError(
                f"{self.system.name} has states that x does not tell "
                f"({', '.join(each.name for each in self.unseen)}): ask its .rigid plant"
            )

    def scaled(self, body: str, mass: float, length: float) -> MujocoPlant:
        """The nominal model with the mass and all lengths of a body scaled.

        Raises:
            ModelError: If there is no such body.
        """
        return self.edited(BodyEdit(body or self.system.uncertain_body, mass, length))

    def jacobian(self, x: ArrayLike, u: ArrayLike) -> tuple[Array, Array]:
        """A and B by MuJoCo's own finite differences, see ``linearize``.

        Raises:
            ModelError: If it has states of its own.
        """
        self._refuse_unseen()
        # It imports the engine that compiles the laws, which loads slowly.
        from grosmc_mj.physics.linearization import differences

        state, inputs = self.operating_point(x, u)
        self.require_unchanged([self])
        return differences(self, state, inputs)

    @property
    def step_length(self) -> float:
        """Physics timestep [s], without compiling anything."""
        return float(self.spec.option.timestep if self.timestep is None else self.timestep)

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled model as it is drawn, to look at; ``simulate`` refuses one that was changed.

        Runs compute with one that has the same motion and nothing that is only drawn.
        """
        return self._handed_out[0]

    @cached_property
    def _handed_out(self) -> tuple[mujoco.MjModel, str]:
        """The compiled model, and what it was like then."""
        model = self._compiled(self._edited(self.spec))
        return model, fingerprint(model)

    @cached_property
    def undrawn_model(self) -> mujoco.MjModel:
        """What runs compute with.

        Raises:
            ModelError: If MuJoCo refuses the model or its joints are not the system's.
        """
        return self._running[1] if self.edits else self.template.model

    @property
    def _running(self) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
        """What runs compute with, and what that is compiled from."""
        spec = self._edited(_undrawn_spec(self.spec))
        model = self._compiled(spec)
        if not can_constrain(model):
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        return spec, model

    @property
    def template(self) -> Template:
        """What this plant's edits, or another one's of the same nominal model, are written into.

        Raises:
            ModelError: If MuJoCo refuses the model or its joints are not the system's.
        """
        same = _templates.setdefault(self.spec, {})
        key = (self.timestep, self.integrator)
        if key not in same:
            same[key] = Template(*self.edited()._running)
        return same[key]

    @cached_property
    def changes(self) -> list[Change] | None:
        """What is written into the template for a run; None if it has a model of its own.

        Raises:
            ModelError: As ``undrawn_model``.
        """
        found = self.template.changes(self.edits) if self.edits else None
        if found is None:
            self.undrawn_model  # noqa: B018  compiled here, and not by several threads
        return found

    def _edited(self, nominal: mujoco.MjSpec) -> mujoco.MjSpec:
        """The edited model, drawn or not."""
        numbers = _nominal_model(self.spec) if self.edits else None
        spec = apply_edits(nominal, self.edits, numbers, self.timestep)
        if self.integrator is not None:
            spec.option.integrator = getattr(
                mujoco.mjtIntegrator, f"mjINT_{self.integrator.upper()}"
            )
        return spec

    def _compiled(self, spec: mujoco.MjSpec) -> mujoco.MjModel:
        """Compile the edited model.

        Raises:
            ModelError: If MuJoCo refuses it, its joints are not the system's, or its parts need a
                shorter timestep.
        """
        model = compile_spec(spec, checked=bool(self.edits))
        # MuJoCo would silently start a diverged simulation again.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        joints = tuple(model.joint(i).name for i in range(model.njnt))
        inputs = tuple(model.actuator(i).name for i in range(model.nu))
        n = len(self.system.joints) if self.parts else len(joints)
        if joints[:n] != self.system.joints or inputs != self.system.actuators:
            raise ModelError(
                f"{self.system.name}: the model has joints {joints} and actuators {inputs}, must "
                f"have {self.system.joints} and {self.system.actuators}"
                + (", before those of the machine's parts" if self.parts else "")
            )
        if self.parts:
            refuse_unstable(model, self.system.name, self.parts)
        return model

    def analytic(self, variant: Variant = "corrected") -> AnalyticPlant:
        """The analytic twin, with the numbers of the compiled model as it is edited.

        What equations lack, the parts of a machine, is left out.
        """
        rigid = self.rigid
        compiled = "undrawn_model" in vars(rigid)
        model = None if compiled else rigid.template.written(rigid.edits)
        return AnalyticPlant.from_model(self.system, model or rigid.undrawn_model, variant)

    @classmethod
    def require_unchanged(cls, plants: Iterable[MujocoPlant]) -> None:
        """Refuse to simulate something else than what the plants' models now say.

        A model that nobody has been given is not looked at, and one spec once.

        Raises:
            ModelError: If a model or a spec was changed in place.
        """
        different = dict.fromkeys(plants)
        for plant in different:
            given = plant.__dict__.get("_handed_out")
            if given is not None and fingerprint(given[0]) != given[1]:
                raise ModelError(
                    f"{plant.system.name}: plant.model was changed after it was compiled, which no "
                    "run would notice: use plant.edited(...), or another MJCF"
                )
        for spec, plant in {plant.spec: plant for plant in different}.items():
            if spec_fingerprint(spec) != _as_made[spec]:
                raise ModelError(
                    f"{plant.system.name}: plant.spec was changed after the plant was made, which "
                    "its runs may not notice: use plant.edited(...), or make a plant of a changed "
                    "copy"
                )

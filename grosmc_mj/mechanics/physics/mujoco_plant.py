"""A plant whose motion MuJoCo computes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any, get_args
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from pydantic import InstanceOf

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.fields import Items, Known, Range, checked
from grosmc_mj.mechanics.physics.checks import LONGEST, SHORTEST, fingerprint, spec_fingerprint
from grosmc_mj.mechanics.physics.edit import Change, Edit, HiddenState
from grosmc_mj.mechanics.physics.edits import BodyEdit, apply_edits
from grosmc_mj.mechanics.physics.files import compile_spec, joint_names, load_spec, model_path
from grosmc_mj.mechanics.physics.hidden_states import hidden_states
from grosmc_mj.mechanics.physics.linearization import differences
from grosmc_mj.mechanics.physics.mjdata import forward
from grosmc_mj.mechanics.physics.template import Template, can_constrain, undrawn
from grosmc_mj.theory.plants import AnalyticPlant, Plant, System, Variant, find_system
from grosmc_mj.theory.plants.plant import Integrator, Kind

# MuJoCo's integrators by name, and their names.
_MUJOCO: dict[Integrator, mujoco.mjtIntegrator] = {
    name: getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}") for name in get_args(Integrator)
}
_INTEGRATORS: dict[int, Integrator] = {int(value): name for name, value in _MUJOCO.items()}


class _Nominal:
    """Data shared by all plants of one nominal model.

    Attributes:
        fingerprint: Hash of the model, when its first plant was created.
        undrawn: The model without parts that are only drawn, to compute with.
        templates: Models to write edits into, by timestep and integrator.
    """

    def __init__(self, spec: mujoco.MjSpec) -> None:
        self.fingerprint = spec_fingerprint(spec)
        self.undrawn = undrawn(spec)
        self.templates: dict[tuple[Any, ...], Template] = {}


# For as long as a plant has the model.
_nominals: WeakKeyDictionary[mujoco.MjSpec, _Nominal] = WeakKeyDictionary()


@cache
def _nominal_spec(name: str, path: Path, changed: int) -> mujoco.MjSpec:
    """Read the model of a system, once as long as its file stays: nobody changes the spec.

    Args:
        name: Name of the system.
        path: Its file.
        changed: When a file beside it, which it may include, last changed [ns].
    """
    return load_spec(name)


@checked(ModelError, eq=False)
class MujocoPlant(Plant):
    """A system's MJCF model, possibly with edits, another timestep or integrator.

    Attributes:
        system: Names and equations of the system.
        spec: The nominal model; never changed.
        edits: Edits of the nominal model.
        timestep: Physics timestep [s]; None for the model's own.
        integrator: MuJoCo's integrator; None for the model's own.
    """

    system: InstanceOf[System]
    spec: mujoco.MjSpec
    edits: Annotated[tuple[Edit, ...], Items(Edit, "a tuple of edits")] = ()
    timestep: Annotated[float, Range(SHORTEST, LONGEST, "s", below=True)] | None = None
    integrator: Annotated[Integrator, Known("integrator", get_args(Integrator))] | None = None

    @classmethod
    def load(
        cls,
        name: str,
        *,
        edits: tuple[Edit, ...] = (),
        timestep: float | None = None,
        integrator: Integrator | None = None,
    ) -> MujocoPlant:
        """Return the plant of a shipped model.

        Raises:
            ModelError: If the name or an edit is not valid.
        """
        system = find_system(name)
        path = model_path(name)
        changed = max(file.stat().st_mtime_ns for file in path.parent.glob("*.xml"))
        spec = _nominal_spec(system.name, path, changed)
        return cls(system, spec, edits, timestep, integrator)

    def __post_init__(self) -> None:
        if self.spec not in _nominals:
            _nominals[self.spec] = _Nominal(self.spec)

    def changed(
        self,
        *edits: Edit,
        scales: Mapping[str, float] | None = None,
        known: bool = False,
    ) -> MujocoPlant:
        """Copy of the nominal model with these edits; earlier edits are replaced.

        Args:
            edits: Changes of bodies, joints and inputs, and parts of a machine.
            scales: None: a model has no parameters to scale.
            known: Whether the nominal model itself gets them, so that laws designed for it know
                them; the copy then has the edits of this plant.

        Raises:
            ModelError: If a parameter is to be scaled, or a known edit is not valid.
        """
        if scales:
            raise ModelError(
                f"{self.system.name} has a model in MuJoCo: edit a body or a joint instead of "
                f"{', '.join(scales)}"
            )
        if known:
            return replace(self, spec=apply_edits(self.spec, edits, self._template.model))
        return replace(self, edits=edits)

    @property
    def kind(self) -> Kind:
        """MuJoCo's physics."""
        return "physics"

    @property
    def _nominal(self) -> _Nominal:
        return _nominals[self.spec]

    @property
    def parts(self) -> tuple[Edit, ...]:
        """Parts of the machine as built, which the rigid system does not have."""
        return tuple(edit for edit in self.edits if not edit.rigid)

    # Campaigns ask for it for each plant several times, and what it has compiled is kept with it.
    @cached_property
    def rigid(self) -> MujocoPlant:
        """Copy without the parts of a machine: the plant that equations describe."""
        if not self.parts:
            return self
        return self.changed(*(edit for edit in self.edits if edit.rigid))

    @cached_property
    def hidden_states(self) -> tuple[HiddenState, ...]:
        """States of the model that no law sees."""
        return hidden_states(self._model_like, self.system, self.parts)

    def require_start(self, x0: Array) -> None:
        """Refuse a start beyond a stop or too fast for the timestep, as ``Plant`` says."""
        for edit in self.edits:
            edit.require_start(self.system, x0)
        self.require_speeds(x0)

    def require_speeds(self, x: Array) -> None:
        """Refuse a state, (n,), whose speeds make a part of the machine unstable.

        Raises:
            ArgumentError: With the timestep that it needs.
        """
        for edit in self.edits:
            edit.require_speeds(self.system, x, self.step_length, self.stepped_by)

    @cached_property
    def parameters(self) -> Any:
        """Numbers of its analytic twin; None where it has none."""
        if self.system.read_parameters is None:
            return None
        return self.analytic().parameters

    @property
    def _model_like(self) -> mujoco.MjModel:
        """Compiled model with its states and drives, which rigid edits do not change."""
        if self.parts:
            return self.undrawn_model
        return self._template.model

    @property
    def stepped_by(self) -> Integrator:
        """MuJoCo's integrator, by its name."""
        return self.integrator or _INTEGRATORS[int(self.spec.option.integrator)]

    @property
    def restepped(self) -> bool:
        """True if it has another integrator than its model."""
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
            ModelError: If it has hidden states, on which x' depends, too, or a part whose numbers
                a timestep computes.
        """
        self._refuse_hidden()
        x, u, w = self.checked(x, u, wrench)
        system = self.system
        data = forward(self.undrawn_model, x, u, w, system.bodies)
        rates = x[system.degrees_of_freedom :]
        return np.concatenate([rates, data.qacc])

    def _refuse_hidden(self) -> None:
        """Refuse to compute x' from x alone where it depends on more."""
        if self.hidden_states:
            names = ", ".join(state.name for state in self.hidden_states)
            raise ModelError(
                f"{self.system.name} has states that x does not tell ({names}): ask its .rigid "
                "plant"
            )
        stepped = [str(edit) for edit in self.edits if edit.stepped]
        if stepped:
            raise ModelError(
                f"{self.system.name} has friction that is computed for a timestep, not for a state "
                f"({', '.join(stepped)}): ask its .rigid plant"
            )

    def scaled(self, body: str, mass: float, length: float) -> MujocoPlant:
        """Copy with the mass and all lengths of a body of the nominal model scaled.

        Raises:
            ModelError: If there is no such body.
        """
        return self.changed(BodyEdit(body or self.system.uncertain_body, mass, length))

    def jacobian(self, x: ArrayLike, u: ArrayLike) -> tuple[Array, Array]:
        """A and B by MuJoCo's own finite differences, see ``linearize``.

        Raises:
            ModelError: As ``derivative``.
        """
        self._refuse_hidden()
        state, inputs = self.operating_point(x, u)
        self.require_unchanged([self])
        return differences(self, state, inputs)

    @property
    def step_length(self) -> float:
        """Physics timestep [s], without compiling anything."""
        if self.timestep is None:
            return float(self.spec.option.timestep)
        return float(self.timestep)

    # A model takes some milliseconds to compile.
    @cached_property
    def model(self) -> mujoco.MjModel:
        """Compiled model with all that is drawn; ``simulate`` refuses one that was changed.

        Runs compute with ``undrawn_model``, which has the same motion.
        """
        _, model = self._compiled(self.spec)
        vars(self)["_fingerprint"] = fingerprint(model)
        return model

    @cached_property
    def undrawn_model(self) -> mujoco.MjModel:
        """Model that runs compute with.

        Raises:
            ModelError: If MuJoCo refuses the model or its joints are not the system's.
        """
        if not self.edits:
            return self._template.model
        _, model = self._compiled_undrawn()
        return model

    def _compiled_undrawn(self) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
        """Model that runs compute with, editable and compiled."""
        spec, model = self._compiled(self._nominal.undrawn)
        if not can_constrain(model):
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        return spec, model

    @property
    def _template(self) -> Template:
        """Model to write edits into, shared by the plants of one nominal model.

        Raises:
            ModelError: If MuJoCo refuses the model or its joints are not the system's.
        """
        templates = self._nominal.templates
        key = (self.timestep, self.integrator)
        if key not in templates:
            unedited = self.changed()
            templates[key] = Template(*unedited._compiled_undrawn())
        return templates[key]

    @cached_property
    def _changes(self) -> list[Change] | None:
        """Changes written into the template for a run; None if it has a model of its own.

        Raises:
            ModelError: As ``undrawn_model``.
        """
        changes = self._template.changes(self.edits) if self.edits else None
        if changes is None:
            self.undrawn_model  # noqa: B018  compiled here, and not by several threads
        return changes

    @property
    def shared(self) -> Template | mujoco.MjModel:
        """Object that the plants of one stepper share: the template, or a model of its own.

        Raises:
            ModelError: As ``undrawn_model``.
        """
        if self._changes is None:
            return self.undrawn_model
        return self._template

    def stepped_model(self) -> mujoco.MjModel:
        """Model for a stepper: a copy if ``write_edits`` writes into it."""
        if self._changes is None:
            return self.undrawn_model
        return self._template.copy()

    def write_edits(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Write the edits into the model of a stepper, if other plants share it."""
        if self._changes is not None:
            self._template.write(self._changes, model, data)

    def _compiled(self, nominal: mujoco.MjSpec) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
        """Edited model, editable and compiled, from the nominal one, drawn or not.

        Raises:
            ModelError: If MuJoCo refuses it, its joints are not the system's, or its parts need a
                shorter timestep.
        """
        compiled_nominal = self._template.model if self.edits else None
        spec = apply_edits(nominal, self.edits, compiled_nominal, self.timestep)
        if self.integrator is not None:
            spec.option.integrator = _MUJOCO[self.integrator]

        model = compile_spec(spec)
        # MuJoCo would silently start a diverged simulation again.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET

        self._require_names(model)
        for edit in self.edits:
            edit.require_timestep(model, self.system.name)
        return spec, model

    def _require_names(self, model: mujoco.MjModel) -> None:
        """Refuse a model whose joints or actuators are not the system's.

        Raises:
            ModelError: With all of their names.
        """
        system = self.system
        joints = joint_names(model)
        actuators = tuple(model.actuator(i).name for i in range(model.nu))

        # Parts of a machine have their joints after those of the system.
        rigid_joints = joints[: len(system.joints)] if self.parts else joints
        if rigid_joints == system.joints and actuators == system.actuators:
            return
        before_parts = ", before those of the machine's parts" if self.parts else ""
        raise ModelError(
            f"{system.name}: the model has joints {joints} and actuators {actuators}, must "
            f"have {system.joints} and {system.actuators}{before_parts}"
        )

    def analytic(self, variant: Variant = "corrected") -> AnalyticPlant:
        """Analytic twin, with the numbers of the compiled model as it is edited.

        The parts of a machine, which equations lack, are left out.
        """
        rigid = self.rigid
        model = rigid._template.written(rigid.edits) if rigid.edits else None
        if model is None:
            model = rigid.undrawn_model
        return AnalyticPlant.from_model(self.system, model, variant)

    @classmethod
    def require_unchanged(cls, plants: Sequence[MujocoPlant]) -> None:
        """Refuse plants whose models were changed since they were compiled, as ``Plant`` says.

        A model that nobody has read is not looked at, and each spec once.

        Raises:
            ModelError: If a model or a spec was changed in place.
        """
        for plant in dict.fromkeys(plants):
            attributes = vars(plant)
            if "model" in attributes and fingerprint(plant.model) != attributes["_fingerprint"]:
                raise ModelError(_changed_in_place(plant, "model"))

        plant_of_spec = {plant.spec: plant for plant in plants}
        for spec, plant in plant_of_spec.items():
            if spec_fingerprint(spec) != plant._nominal.fingerprint:
                raise ModelError(_changed_in_place(plant, "spec"))


def _changed_in_place(plant: MujocoPlant, name: str) -> str:
    """Message of a model or spec that was changed in place."""
    return (
        f"{plant.system.name}: plant.{name} was changed in place, which no run would notice: use "
        "plant.changed(...), or make a plant of a changed copy"
    )

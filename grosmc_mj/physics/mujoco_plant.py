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

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ModelError
from grosmc_mj.fields import Items, Known, Range, checked
from grosmc_mj.physics.checks import LONGEST, SHORTEST, fingerprint, spec_fingerprint
from grosmc_mj.physics.edits import BodyEdit, Change, Edit, apply_edits
from grosmc_mj.physics.files import compile_spec, joint_names, load_spec, model_path
from grosmc_mj.physics.hidden_states import HiddenState, hidden_states
from grosmc_mj.physics.linearization import differences
from grosmc_mj.physics.mjdata import forward
from grosmc_mj.physics.template import Template, can_constrain, undrawn
from grosmc_mj.plants import AnalyticPlant, Plant, System, Variant, find_system
from grosmc_mj.plants.plant import Integrator, Kind

# MuJoCo's integrators by name, and their names.
_MUJOCO: dict[Integrator, mujoco.mjtIntegrator] = {
    name: getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}") for name in get_args(Integrator)
}
_INTEGRATORS: dict[int, Integrator] = {int(value): name for name, value in _MUJOCO.items()}


class _Nominal:
    """Data shared by all plants of one nominal model.

    Attributes:
        fingerprint: Of the model, when its first plant was created.
        undrawn: The model without looks, to compute with.
        templates: To write edits into, by timestep and integrator.
    """

    def __init__(self, spec: mujoco.MjSpec) -> None:
        self.fingerprint, self.undrawn = spec_fingerprint(spec), undrawn(spec)
        self.templates: dict[tuple[Any, ...], Template] = {}


# For as long as a plant has the model.
_nominals: WeakKeyDictionary[mujoco.MjSpec, _Nominal] = WeakKeyDictionary()


@cache
def _nominal_spec(name: str, path: Path, changed: int) -> mujoco.MjSpec:
    """The model of a system, read once as long as its file stays: nobody changes the spec.

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
        """The plant of a shipped model.

        Raises:
            ModelError: If the name or an edit is not valid.
        """
        system, path = find_system(name), model_path(name)
        changed = max(file.stat().st_mtime_ns for file in path.parent.glob("*.xml"))
        spec = _nominal_spec(system.name, path, changed)
        return cls(system, spec, edits, timestep, integrator)

    def __post_init__(self) -> None:
        if self.spec not in _nominals:
            _nominals[self.spec] = _Nominal(self.spec)

    def edited(self, *edits: Edit) -> MujocoPlant:
        """The nominal model with these edits; earlier edits are replaced, never compounded."""
        return replace(self, edits=edits)

    def believed(self, *edits: Edit) -> MujocoPlant:
        """A nominal model that has these edits itself, so that laws designed for it know them.

        Raises:
            ModelError: If an edit is not valid.
        """
        return replace(self, spec=apply_edits(self.spec, edits, self.template.model))

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

    @property
    def _nominal(self) -> _Nominal:
        return _nominals[self.spec]

    @cached_property
    def parts(self) -> tuple[Edit, ...]:
        """The parts of the machine as built, which the rigid system does not have."""
        return tuple(edit for edit in self.edits if not edit.rigid)

    @cached_property
    def rigid(self) -> MujocoPlant:
        """The same without the parts of a machine: the plant that equations describe."""
        return self.edited(*(e for e in self.edits if e.rigid)) if self.parts else self

    @cached_property
    def hidden_states(self) -> tuple[HiddenState, ...]:
        """Its states that no law sees."""
        return hidden_states(self._model_like, self.system, self.parts)

    def require_start(self, x0: Array) -> None:
        """Refuse a start beyond a stop, as ``Plant`` says."""
        for edit in self.edits:
            edit.require_start(self.system, x0)

    @cached_property
    def parameters(self) -> Any:
        """The numbers of its analytic twin; None where it has none."""
        return self.analytic().parameters if self.system.read_parameters else None

    @property
    def _model_like(self) -> mujoco.MjModel:
        """A compiled model with its states and drives, which rigid edits do not change."""
        return self.undrawn_model if self.parts else self.template.model

    @property
    def stepped_by(self) -> Integrator:
        """MuJoCo's integrator, by its name."""
        return self.integrator or _INTEGRATORS[int(self.spec.option.integrator)]

    @property
    def restepped(self) -> bool:
        """Whether it has another integrator than its model."""
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
        self._refuse_hidden()
        x, u, w = self.checked(x, u, wrench)
        data = forward(self.undrawn_model, x, u, w, self.system.bodies)
        return np.concatenate([x[self.system.degrees_of_freedom :], data.qacc])

    def _refuse_hidden(self) -> None:
        """Refuse to compute x' from x alone where it depends on more."""
        if self.hidden_states:
            names = ", ".join(state.name for state in self.hidden_states)
            raise ModelError(
                f"{self.system.name} has states that x does not tell ({names}): ask its .rigid "
                "plant"
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
        self._refuse_hidden()
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
        _, model = self._compiled(self.spec)
        vars(self)["_fingerprint"] = fingerprint(model)
        return model

    @cached_property
    def undrawn_model(self) -> mujoco.MjModel:
        """Model that runs compute with.

        Raises:
            ModelError: If MuJoCo refuses the model or its joints are not the system's.
        """
        return self._running[1] if self.edits else self.template.model

    @property
    def _running(self) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
        """The model that runs compute with, editable and compiled."""
        spec, model = self._compiled(self._nominal.undrawn)
        if not can_constrain(model):
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        return spec, model

    @property
    def template(self) -> Template:
        """To write the edits of this plant into, or of another one of the same nominal model.

        Raises:
            ModelError: If MuJoCo refuses the model or its joints are not the system's.
        """
        templates, key = self._nominal.templates, (self.timestep, self.integrator)
        if key not in templates:
            templates[key] = Template(*self.edited()._running)
        return templates[key]

    @cached_property
    def changes(self) -> list[Change] | None:
        """Changes written into the template for a run; None if it has a model of its own.

        Raises:
            ModelError: As ``undrawn_model``.
        """
        changes = self.template.changes(self.edits) if self.edits else None
        if changes is None:
            self.undrawn_model  # noqa: B018  compiled here, and not by several threads
        return changes

    def _compiled(self, nominal: mujoco.MjSpec) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
        """The edited model, editable and compiled, from the nominal one, drawn or not.

        Raises:
            ModelError: If MuJoCo refuses it, its joints are not the system's, or its parts need a
                shorter timestep.
        """
        compiled = self.template.model if self.edits else None
        spec = apply_edits(nominal, self.edits, compiled, self.timestep)
        if self.integrator is not None:
            spec.option.integrator = _MUJOCO[self.integrator]
        model = compile_spec(spec, checked=bool(self.edits))
        # MuJoCo would silently start a diverged simulation again.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        joints = joint_names(model)
        inputs = tuple(model.actuator(i).name for i in range(model.nu))
        n = len(self.system.joints) if self.parts else len(joints)
        if joints[:n] != self.system.joints or inputs != self.system.actuators:
            raise ModelError(
                f"{self.system.name}: the model has joints {joints} and actuators {inputs}, must "
                f"have {self.system.joints} and {self.system.actuators}"
                + (", before those of the machine's parts" if self.parts else "")
            )
        for edit in self.edits:
            edit.require_timestep(model, self.system.name)
        return spec, model

    def analytic(self, variant: Variant = "corrected") -> AnalyticPlant:
        """The analytic twin, with the numbers of the compiled model as it is edited.

        The parts of a machine, which equations lack, are left out.
        """
        rigid = self.rigid
        written = rigid.template.written(rigid.edits) if rigid.edits else None
        return AnalyticPlant.from_model(self.system, written or rigid.undrawn_model, variant)

    @classmethod
    def require_unchanged(cls, plants: Sequence[MujocoPlant]) -> None:
        """Refuse plants whose models were changed since they were compiled, as ``Plant`` says.

        A model that nobody has read is not looked at, and each spec once.

        Raises:
            ModelError: If a model or a spec was changed in place.
        """
        specs = {plant.spec: plant for plant in plants}
        for plant in dict.fromkeys(plants):
            own = vars(plant)
            if "model" in own and fingerprint(plant.model) != own["_fingerprint"]:
                raise ModelError(_changed_in_place(plant, "model"))
        for spec, plant in specs.items():
            if spec_fingerprint(spec) != plant._nominal.fingerprint:
                raise ModelError(_changed_in_place(plant, "spec"))


def _changed_in_place(plant: MujocoPlant, name: str) -> str:
    return (
        f"{plant.system.name}: plant.{name} was changed in place, which no run would notice: use "
        "plant.edited(...), or make a plant of a changed copy"
    )

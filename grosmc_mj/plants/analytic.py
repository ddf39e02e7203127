"""A plant whose motion its own equations give."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import lru_cache
from typing import Annotated, Any, get_args

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from grosmc_mj.arguments import real, require_known
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ModelError, shown
from grosmc_mj.fields import Known, checked
from grosmc_mj.plants.plant import Integrator, Kind, Plant
from grosmc_mj.plants.system import MjModel, System, Variant, wrench_symbols


@checked(ModelError)
class AnalyticPlant(Plant):
    """A system with numbers: the equations of one variant and their frozen parameters.

    Attributes:
        system: Its equations and names.
        parameters: Its numbers, a frozen dataclass of the system's own file.
        variant: ``corrected`` (energy-true) or ``printed`` (as in the chapter).
    """

    system: System
    parameters: Any
    variant: Annotated[Variant, Known("variant", get_args(Variant))] = "corrected"

    @classmethod
    def from_model(
        cls, system: System, model: MjModel, variant: Variant = "corrected"
    ) -> AnalyticPlant:
        """The analytic twin of a compiled model, edited or not.

        Raises:
            ModelError: If the model is not of this system, or the system has no such variant.
        """
        if variant not in system.variants:
            raise ModelError(
                f"{system.name} has no variant {variant!r}: valid: {', '.join(system.variants)}"
            )
        if not system.symbolic or system.read_parameters is None:
            lacks = "model in MuJoCo" if system.symbolic else "equations in symbols"
            raise ModelError(f"{system.name} has no {lacks}, and so no analytic twin")
        try:
            parameters = system.read_parameters(model, variant)
        except KeyError as error:
            raise ModelError(f"not a model of {system.name}: {error.args[0]}") from error
        return cls(system, parameters, variant)

    @property
    def kind(self) -> Kind:
        """The variant of its equations."""
        return self.variant

    @property
    def step_length(self) -> None:
        """None: each run of it chooses its own timestep."""
        return

    @property
    def stepped_by(self) -> Integrator:
        """The classical Runge-Kutta method."""
        return "RK4"

    @property
    def input_limits(self) -> Array:
        """(2, m), all of them infinite."""
        return np.full((2, len(self.system.inputs)), [[-np.inf], [np.inf]])

    @property
    def digest(self) -> str:
        """SHA-256 of its parameters."""
        return hashlib.sha256(repr(self.parameters).encode()).hexdigest()

    def derivative(
        self, x: ArrayLike, u: ArrayLike = 0.0, wrench: ArrayLike | None = None
    ) -> Array:
        """x' = f(x) + g(x) u + d(x, w), (n,)."""
        x, u, w = self.checked(x, u, wrench)
        p, equations = self.parameters, self.system.equations
        g = np.reshape(equations.input_matrix(x, p), (len(x), len(u)))
        return np.array(equations.drift(x, p)) + g @ u + np.array(equations.disturbance(x, w, p))

    def analytic(self, variant: Variant = "corrected") -> AnalyticPlant:
        """Itself: it is one variant of its equations."""
        return self

    def changed(
        self, edits: Sequence[Any] = (), scales: Mapping[str, float] | None = None
    ) -> AnalyticPlant:
        """The same equations with some parameters times a factor.

        Raises:
            ModelError: If there is an edit of a model, or no such parameter.
        """
        if edits:
            raise ModelError(
                f"{self.system.name} as equations has no model in MuJoCo: scale a parameter instead"
            )
        numbers = {
            key: k * getattr(self.parameters, key, math.nan) for key, k in (scales or {}).items()
        }
        return self.with_parameters(**numbers) if numbers else self

    def with_parameters(self, **changes: float) -> AnalyticPlant:
        """The same equations with other numbers.

        Raises:
            ModelError: If a name is unknown or a number does not fit.
        """
        names = [field.name for field in fields(self.parameters)]
        for name, value in changes.items():
            require_known(f"parameter of {self.system.name}", name, names, error=ModelError)
            if not math.isfinite(real(value)):
                raise ModelError(f"{self.system.name}: {name} = {shown(value)} must be finite")
        return replace(self, parameters=replace(self.parameters, **changes))

    def pushed(self, names: tuple[str, ...]) -> AnalyticPlant:
        """The same equations, where disturbances act on some of ``system.pushes``.

        The first component of the wrench on a body of that name is added to the input or rate.
        """
        return replace(self, system=_pushed(self.system, names)) if names else self

    def scaled(self, body: str, mass: float, length: float) -> AnalyticPlant:
        """The plant with the mass and all lengths of its uncertain body scaled.

        Raises:
            ModelError: If its equations have no such body.
        """
        make = getattr(self.parameters, "scaled", None)
        if make is None or body not in ("", self.system.uncertain_body):
            raise ModelError(
                f"{self.system.name} as equations has no body {body!r}: scale a parameter instead"
            )
        return replace(self, parameters=make(mass, length))

    def jacobian(self, x: ArrayLike, u: ArrayLike) -> tuple[Array, Array]:
        """(A, B) = (d x'/d x, d x'/d u) at a state and an input, exact."""
        x, u, _ = self.checked(x, u, None)
        p, n = self.parameters, len(x)
        A = np.reshape(self.system.equations.jacobian(x, u, p), (n, n))
        return A, np.reshape(self.system.equations.input_matrix(x, p), (n, -1))


@lru_cache(maxsize=64)
def _pushed(system: System, names: tuple[str, ...]) -> System:
    """The system with a wrench on each of these names of its ``pushes``."""
    equations, w = system.equations, wrench_symbols(*names)
    columns = [*sp.Matrix(equations.g).T.tolist(), *sp.eye(len(system.states)).tolist()]
    pushes, d = dict(zip(system.pushes, columns, strict=True)), sp.Matrix(equations.d)
    for i, name in enumerate(names):
        d += w[6 * i] * sp.Matrix(pushes[name])
    equations = replace(equations, w=(*equations.w, *w), d=tuple(d))
    return replace(system, equations=equations, bodies=(*system.bodies, *names))

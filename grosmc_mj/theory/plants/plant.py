"""Plants: the interface of all, and those that their own equations move."""

from __future__ import annotations

import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import cached_property
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arguments import real, reals, require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, ModelError, array_text, value_text
from grosmc_mj.ground.fields import Known, checked
from grosmc_mj.theory.plants.system import Model, System, Variant

# Largest |x'| of an equilibrium, in units of the state per second: an input computed by hand or
# by a root finder passes, a state that is merely near one does not.
AT_REST = 1e-6

Kind = Literal["printed", "corrected", "physics"]
Integrator = Literal["Euler", "RK4", "implicit", "implicitfast"]


class Plant(ABC):
    """A system with numbers, which a run is simulated on.

    The plant of a robot is ``Robot.plant``.

    Attributes:
        system: Its signals and names.
        parameters: The numbers of its equations; None where it has none in symbols.
    """

    system: System
    parameters: Any

    @property
    @abstractmethod
    def kind(self) -> Kind:
        """The equations that it is, or ``physics`` for a model in MuJoCo."""

    @property
    @abstractmethod
    def step_length(self) -> float | None:
        """Physics timestep [s]; None where each run chooses its own."""

    @property
    @abstractmethod
    def stepped_by(self) -> Integrator:
        """Name of the integrator that steps it."""

    @property
    def restepped(self) -> bool:
        """True if another integrator steps it than its own model says."""
        return False

    @property
    @abstractmethod
    def input_limits(self) -> Array:
        """Least and largest of each input in the units of ``system.inputs``, (2, m).

        It is infinite for an input without limits.
        """

    @property
    @abstractmethod
    def digest(self) -> str:
        """SHA-256 of its numbers."""

    @abstractmethod
    def derivative(
        self, x: ArrayLike, u: ArrayLike = 0.0, wrench: ArrayLike | None = None
    ) -> Array:
        """x' under an input and a wrench.

        Args:
            x: State, (n,).
            u: Input in the units of ``system.inputs``, (m,), or one number for one input.
            wrench: [force, torque] in N and N m of each of ``system.bodies``, in world axes at
                the centre of mass, (6 * len(bodies),); None for no wrench.

        Returns:
            x', (n,).

        Raises:
            ArgumentError: If a shape is wrong.
        """

    def linearization(self, x: ArrayLike | None = None, u: ArrayLike = 0.0) -> tuple[Array, Array]:
        """A = dx'/dx, (n, n), and B = dx'/du, (n, m), about an equilibrium.

        Args:
            x: The equilibrium, (n,), in the units of ``system.states``; the origin by default.
            u: The input that holds it there, in the units of ``system.inputs``, (m,).

        Raises:
            ArgumentError: If x or u has a wrong shape or is not finite, or the plant does not
                rest there.
        """
        state, inputs = self.operating_point(x, u)
        rates = self.derivative(state, inputs)
        if np.abs(rates).max() > AT_REST:
            point = array_text(np.concatenate([state, inputs]))
            raise ArgumentError(
                f"{self.system.name}: [x, u] = {point} is no equilibrium: x' = "
                f"{array_text(rates)}, must be zero within {AT_REST:g}"
            )
        return self.jacobian(state, inputs)

    @abstractmethod
    def jacobian(self, x: ArrayLike, u: ArrayLike) -> tuple[Array, Array]:
        """(A, B) = (d x'/d x, d x'/d u) at a state and an input, whether it rests there or not.

        Args:
            x: State, (n,).
            u: Input, (m,).

        Returns:
            A (n, n) and B (n, m).

        Raises:
            ArgumentError: If a shape is wrong.
        """

    @abstractmethod
    def scaled(self, body: str, mass: float, length: float) -> Self:
        """The plant with the mass and all lengths of a body scaled.

        Raises:
            ModelError: If it has no such body.
        """

    @abstractmethod
    def analytic(self, variant: Variant = "corrected") -> AnalyticPlant:
        """Its equations with its numbers; of a model those of a variant.

        Raises:
            ModelError: If it has no such equations.
        """

    @abstractmethod
    def changed(self, *edits: Any, scales: Mapping[str, float] | None = None) -> Self:
        """Copy with these edits of the nominal model, or with factors on the parameters.

        Raises:
            ModelError: If it has no such bodies, joints or parameters.
        """

    # Cached, as are ``model`` and ``undrawn_model``, by plants that compile a model for it.
    @cached_property
    def rigid(self) -> Self:
        """Copy without the parts of a machine, of which there are no equations."""
        return self

    def require_start(self, x0: Array) -> None:  # noqa: B027  equations have no stops
        """Refuse a start where the plant cannot be: beyond a stop of a joint.

        Args:
            x0: Start, (n,).

        Raises:
            ArgumentError: If it is one.
        """

    @classmethod  # noqa: B027  nothing can change equations
    def require_unchanged(cls, plants: Sequence[Any]) -> None:
        """Refuse plants whose models were changed in place.

        Args:
            plants: Of this class.

        Raises:
            ModelError: If one was.
        """

    @cached_property
    def model(self) -> Any:
        """Its compiled model in MuJoCo, to look at.

        Raises:
            ModelError: If it has none.
        """
        return self.undrawn_model

    @cached_property
    def undrawn_model(self) -> Any:
        """The model that runs compute with: the same motion, without parts that are only drawn.

        Raises:
            ModelError: As ``model``.
        """
        raise ModelError(f"{self.system.name} as equations has no model in MuJoCo")

    def checked(
        self, x: ArrayLike, u: ArrayLike, wrench: ArrayLike | None
    ) -> tuple[Array, Array, Array]:
        """Arguments of ``derivative`` as arrays: (n,), (m,) and (6 * bodies,).

        Raises:
            ArgumentError: If a shape is wrong.
        """
        system = self.system
        n = len(system.states)
        m = len(system.inputs)
        nw = 6 * len(system.bodies)

        if wrench is None:
            wrench = np.zeros(nw)
        x = np.asarray(x, float)
        u = np.asarray(u, float)
        w = np.asarray(wrench, float).ravel()

        # A single number is the one input, or zero for all of them.
        scalar = u.shape == () and (m == 1 or not np.any(u))
        if x.shape != (n,) or w.shape != (nw,) or not (u.shape == (m,) or scalar):
            raise ArgumentError(
                f"{system.name}: x has shape {x.shape}, u {u.shape} and the wrench {w.shape}, "
                f"must be ({n},), ({m},) and ({nw},)"
            )
        return x, np.broadcast_to(u, (m,)), w

    def operating_point(self, x: ArrayLike | None, u: ArrayLike) -> tuple[Array, Array]:
        """Arguments of ``linearization`` as arrays: state (n,) and input (m,).

        Raises:
            ArgumentError: If one has a wrong shape or is not finite.
        """
        state = np.zeros(len(self.system.states)) if x is None else reals(x)
        state, inputs, _ = self.checked(state, reals(u), None)
        if not np.all(np.isfinite([*state, *inputs])):
            raise ArgumentError(
                f"{self.system.name}: x = {value_text(x)} and u = {value_text(u)} must be finite "
                "numbers"
            )
        return state, inputs


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
        cls, system: System, model: Model, variant: Variant = "corrected"
    ) -> AnalyticPlant:
        """Read the analytic twin of a compiled model, edited or not.

        Raises:
            ModelError: If the model is not of this system, or the system has no such variant.
        """
        if variant not in system.variants:
            raise ModelError(
                f"{system.name} has no variant {variant!r}: valid: {', '.join(system.variants)}"
            )
        if not system.symbolic:
            raise ModelError(f"{system.name} has no equations in symbols, and so no analytic twin")
        if system.read_parameters is None:
            raise ModelError(f"{system.name} has no model in MuJoCo, and so no analytic twin")

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
        """Infinite limits, (2, m)."""
        m = len(self.system.inputs)
        return np.full((2, m), [[-np.inf], [np.inf]])

    @property
    def digest(self) -> str:
        """SHA-256 of its parameters."""
        return hashlib.sha256(repr(self.parameters).encode()).hexdigest()

    def derivative(
        self, x: ArrayLike, u: ArrayLike = 0.0, wrench: ArrayLike | None = None
    ) -> Array:
        """x' = f(x) + g(x) u + d(x, w), (n,)."""
        x, u, w = self.checked(x, u, wrench)
        p = self.parameters
        equations = self.system.symbolic_equations

        f = np.array(equations.drift(x, p))
        g = np.reshape(equations.input_matrix(x, p), (len(x), len(u)))
        d = np.array(equations.disturbance(x, w, p))
        return f + g @ u + d

    def analytic(self, variant: Variant = "corrected") -> AnalyticPlant:
        """Return the plant itself: it is one variant of its equations."""
        return self

    def changed(
        self,
        *edits: Any,
        scales: Mapping[str, float] | None = None,
        **numbers: float,
    ) -> AnalyticPlant:
        """Copy with other parameters.

        Args:
            edits: Nothing: equations have no model to edit.
            scales: Factors on parameters, by their names.
            numbers: Parameters by their names.

        Raises:
            ModelError: If there is an edit of a model, a name is unknown or a number does not fit.
        """
        if edits:
            raise ModelError(
                f"{self.system.name} as equations has no model in MuJoCo: scale a parameter instead"
            )
        parameters = self.parameters
        for name, factor in (scales or {}).items():
            # The number of an unknown name is never read: the name is refused below.
            numbers[name] = factor * getattr(parameters, name, math.nan)
        if not numbers:
            return self

        names = [field.name for field in fields(parameters)]
        for name, value in numbers.items():
            require_known(f"parameter of {self.system.name}", name, names, error=ModelError)
            if not math.isfinite(real(value)):
                raise ModelError(f"{self.system.name}: {name} = {value_text(value)} must be finite")
        return replace(self, parameters=replace(parameters, **numbers))

    def scaled(self, body: str, mass: float, length: float) -> AnalyticPlant:
        """Copy with the mass and all lengths of its uncertain body scaled.

        Raises:
            ModelError: If its equations have no such body.
        """
        scale = getattr(self.parameters, "scaled", None)
        if scale is None or body not in ("", self.system.uncertain_body):
            raise ModelError(
                f"{self.system.name} as equations has no body {body!r}: scale a parameter instead"
            )
        return replace(self, parameters=scale(mass, length))

    def jacobian(self, x: ArrayLike, u: ArrayLike) -> tuple[Array, Array]:
        """(A, B) = (d x'/d x, d x'/d u) at a state and an input, exact."""
        x, u, _ = self.checked(x, u, None)
        p = self.parameters
        n = len(x)
        equations = self.system.symbolic_equations

        A = np.reshape(equations.jacobian(x, u, p), (n, n))
        B = np.reshape(equations.input_matrix(x, p), (n, -1))
        return A, B

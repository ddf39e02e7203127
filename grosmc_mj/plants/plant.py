"""What every plant answers, whether equations or MuJoCo move it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arguments import reals
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, ModelError, shown
from grosmc_mj.plants.system import System, Variant

if TYPE_CHECKING:
    import mujoco

    from grosmc_mj.plants.analytic import AnalyticPlant

# Largest |x'| of an equilibrium, in units of the state per second: an input computed by hand or
# by a root finder passes, a state that is merely near one does not.
AT_REST = 1e-6

Kind = Literal["printed", "corrected", "physics"]
Integrator = Literal["Euler", "RK4", "implicit", "implicitfast"]


class Plant(ABC):
    """A system with numbers, which a run is simulated on.

    A robot's is its ``Robot.plant``.

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
        """Whether another integrator steps it than its own model says."""
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
            point = np.concatenate([state, inputs]).tolist()
            raise ArgumentError(
                f"{self.system.name}: [x, u] = {point} is no equilibrium: x' = {rates.tolist()}, "
                f"must be zero within {AT_REST:g}"
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
        """Its equations with its numbers: of a model in MuJoCo those of a variant.

        Raises:
            ModelError: If it has no such equations.
        """

    @abstractmethod
    def changed(self, edits: Sequence[Any] = (), scales: Mapping[str, float] | None = None) -> Self:
        """The nominal plant with these edits of its model, or factors on its parameters.

        Raises:
            ModelError: If it has no such bodies, joints or parameters.
        """

    @cached_property
    def rigid(self) -> Self:
        """The same without the parts of a machine: what equations can say of it."""
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
    def model(self) -> mujoco.MjModel:
        """Its compiled model in MuJoCo, to look at.

        Raises:
            ModelError: If it has none.
        """
        return self.undrawn_model

    @cached_property
    def undrawn_model(self) -> mujoco.MjModel:
        """What runs in MuJoCo compute with: the same motion, without what is only drawn.

        Raises:
            ModelError: As ``model``.
        """
        raise ModelError(f"{self.system.name} as equations has no model in MuJoCo")

    def checked(
        self, x: ArrayLike, u: ArrayLike, wrench: ArrayLike | None
    ) -> tuple[Array, Array, Array]:
        """The arguments of ``derivative``: (n,), (m,) and (6 * bodies,).

        Raises:
            ArgumentError: If a shape is wrong.
        """
        system = self.system
        n, m, nw = len(system.states), len(system.inputs), 6 * len(system.bodies)
        x, u = np.asarray(x, float), np.asarray(u, float)
        w = np.zeros(nw) if wrench is None else np.asarray(wrench, float).ravel()
        one_for_all = u.shape == () and (m == 1 or not np.any(u))
        if x.shape != (n,) or w.shape != (nw,) or not (u.shape == (m,) or one_for_all):
            raise ArgumentError(
                f"{system.name}: x has shape {x.shape}, u {u.shape} and the wrench {w.shape}, "
                f"must be ({n},), ({m},) and ({nw},)"
            )
        return x, np.broadcast_to(u, (m,)), w

    def operating_point(self, x: ArrayLike | None, u: ArrayLike) -> tuple[Array, Array]:
        """State (n,) and input (m,) that ``linearization`` is given.

        Raises:
            ArgumentError: If one has a wrong shape or is not finite.
        """
        state = np.zeros(len(self.system.states)) if x is None else reals(x)
        state, inputs, _ = self.checked(state, reals(u), None)
        if not np.all(np.isfinite([*state, *inputs])):
            raise ArgumentError(
                f"{self.system.name}: x = {shown(x)} and u = {shown(u)} must be finite numbers"
            )
        return state, inputs

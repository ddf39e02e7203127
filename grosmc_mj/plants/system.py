"""What every plant of the package has: its signals, its equations and its names in the model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, ModelError

if TYPE_CHECKING:
    import mujoco

Variant = Literal["printed", "corrected"]
Column = tuple[float, ...]


@dataclass(frozen=True)
class Signal:
    """Name, symbol and unit of a state or an input."""

    name: str
    symbol: str
    unit: str


@dataclass(frozen=True)
class System:
    """One mechanical system: x = [positions, velocities], x' = f(x) + g(x) u + d(x, w).

    The functions are jitable and work on one simulation: x is (n,), w is the wrench
    [force, torque] of every body in ``bodies`` in world axes, flattened, and each returns an
    n-tuple.

    Attributes:
        name: Name on the command line, in JSON and of the MJCF file.
        title: Name for people.
        positions: Coordinates in the order of the model's joints; the velocities follow.
        velocities: Their rates.
        input: The control input.
        output: Index of the coordinate that is the output y = h(x).
        joints: Joint names, in order.
        actuator: Name of the actuator.
        bodies: Bodies that a disturbance can act on, in the order of w.
        variants: Sets of equations that the chapter leads to.
        read_parameters: Parameters from a compiled model and a variant.
        drift: f(x).
        input_matrix: g(x), the one column of it.
        disturbance: d(x, w), the accelerations that a wrench causes.
        singular: Whether the plant's own equations break down at x.
        singularity: Where that is, in words.
        linearizable: Whether the decoupling matrix E(x) is nonsingular, as eq. (23) needs.
        region: The region where it is, in words.
        uncertain_body: The body whose mass and length are uncertain.
        position_bound: Largest |position| at which the equations are compared with physics.
    """

    name: str
    title: str
    positions: tuple[Signal, ...]
    velocities: tuple[Signal, ...]
    input: Signal
    output: int
    joints: tuple[str, ...]
    actuator: str
    bodies: tuple[str, ...]
    variants: tuple[Variant, ...]
    read_parameters: Callable[[mujoco.MjModel, Variant], Any]
    drift: Callable[[Any, Any], Column]
    input_matrix: Callable[[Any, Any], Column]
    disturbance: Callable[[Any, Any, Any], Column]
    singular: Callable[[Any], bool]
    singularity: str
    linearizable: Callable[[Any], bool]
    region: str
    uncertain_body: str
    position_bound: float

    @property
    def states(self) -> tuple[Signal, ...]:
        """Signals of the state x, positions then velocities."""
        return self.positions + self.velocities

    @property
    def degrees_of_freedom(self) -> int:
        """Number of coordinates."""
        return len(self.positions)


@dataclass(frozen=True)
class AnalyticPlant:
    """A system with numbers: the equations of one variant and their frozen parameters.

    Attributes:
        system: Its equations and names.
        parameters: Its numbers, a frozen dataclass of the system's own file.
        variant: ``corrected`` (energy-true) or ``printed`` (as in the chapter).
    """

    system: System
    parameters: Any
    variant: Variant = "corrected"

    @classmethod
    def from_model(
        cls, system: System, model: mujoco.MjModel, variant: Variant = "corrected"
    ) -> AnalyticPlant:
        """The analytic twin of a compiled model, edited or not.

        Raises:
            ModelError: If the model is not of this system, or the system has no such variant.
        """
        if variant not in system.variants:
            raise ModelError(
                f"{system.name} has no variant {variant!r}: valid: {', '.join(system.variants)}"
            )
        try:
            parameters = system.read_parameters(model, variant)
        except KeyError as error:
            raise ModelError(f"not a model of {system.name}: {error.args[0]}") from error
        return cls(system, parameters, variant)

    def derivative(
        self, x: ArrayLike, u: ArrayLike = 0.0, wrench: ArrayLike | None = None
    ) -> Array:
        """x' = f(x) + g(x) u + d(x, w).

        Args:
            x: State, (n,).
            u: Input, one number in the unit of ``system.input``.
            wrench: [force, torque] in N and N m of each of ``system.bodies``, in world axes at
                the centre of mass, (6 * len(bodies),); None for no wrench.

        Returns:
            x', (n,).

        Raises:
            ArgumentError: If a shape is wrong.
        """
        n, nw = len(self.system.states), 6 * len(self.system.bodies)
        x, u = np.asarray(x, float), np.asarray(u, float)
        w = np.zeros(nw) if wrench is None else np.asarray(wrench, float).ravel()
        if x.shape != (n,) or w.shape != (nw,):
            raise ArgumentError(
                f"{self.system.name}: x has shape {x.shape} and the wrench {w.shape}, "
                f"must be ({n},) and ({nw},)"
            )
        if u.shape != ():
            raise ArgumentError(f"{self.system.name}: u has shape {u.shape}, must be one number")
        p = self.parameters
        return (
            np.array(self.system.drift(x, p))
            + np.array(self.system.input_matrix(x, p)) * u
            + np.array(self.system.disturbance(x, w, p))
        )

    def output(self, x: ArrayLike) -> Array:
        """y = h(x), the controlled coordinate; x is (..., n)."""
        return np.asarray(x, float)[..., self.system.output]


def require_positive(owner: str, **values: float) -> None:
    """Refuse physical numbers that are not finite and positive.

    Raises:
        ModelError: Naming the first such number.
    """
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0):
            raise ModelError(f"{owner}: {name} = {value:g} must be finite and positive")


def require_nonnegative(owner: str, **values: float) -> None:
    """Refuse physical numbers that are not finite or are negative.

    Raises:
        ModelError: Naming the first such number.
    """
    for name, value in values.items():
        if not (np.isfinite(value) and value >= 0):
            raise ModelError(f"{owner}: {name} = {value:g} must be finite and not negative")


def require_unmodelled_absent(
    owner: str, model: mujoco.MjModel, joints: tuple[str, ...], actuator: str | None = None
) -> None:
    """Refuse what the chapter's equations have no term for.

    That is sideways gravity, damping of the named joints and, if an actuator is named, a gear
    other than one.

    Raises:
        ModelError: Naming what was found.
    """
    if np.any(model.opt.gravity[:2]):
        raise ModelError(f"{owner}: gravity {model.opt.gravity} must point along -z")
    for name in joints:
        damping = float(model.dof_damping[model.joint(name).dofadr[0]])
        if damping:
            raise ModelError(f"{owner}: joint {name!r} has damping {damping:g}, must have none")
    if actuator is not None and float(model.actuator(actuator).gear[0]) != 1:
        gear = float(model.actuator(actuator).gear[0])
        raise ModelError(f"{owner}: actuator {actuator!r} has gear {gear:g}, must have 1")

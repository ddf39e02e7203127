"""A system: its signals, its equations and its names in the model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol

import numpy as np
import sympy as sp

from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ModelError, value_text
from grosmc_mj.ground.fields import Finite, Items, Name, Positive, checked
from grosmc_mj.ground.units import rate_unit
from grosmc_mj.theory.plants.equations import Equations
from grosmc_mj.theory.plants.parametrization import LinearParametrization

Variant = Literal["printed", "corrected"]


@jitable
def _nowhere(x: Any) -> bool:
    return False


@jitable
def _everywhere(x: Any) -> bool:
    return True


class Model(Protocol):
    """Parts of a ``mujoco.MjModel`` that a system reads: theory imports no MuJoCo."""

    opt: Any
    dof_armature: Any
    dof_damping: Any
    tendon_armature: Any

    def body(self, name: str, /) -> Any:
        """Mass, inertia and position of a body."""
        ...

    def joint(self, name: str, /) -> Any:
        """A joint, with the place of its velocity."""
        ...

    def site(self, name: str, /) -> Any:
        """A site, with its position."""
        ...

    def tendon(self, name: str, /) -> Any:
        """A tendon."""
        ...

    def actuator(self, name: str, /) -> Any:
        """An actuator, with its gear."""
        ...


@dataclass(frozen=True)
class Signal:
    """Name, symbol and unit of a state or an input."""

    name: str
    symbol: str
    unit: str

    @property
    def rate_unit(self) -> str:
        """Unit of its rate."""
        return rate_unit(self.unit)


Names = Annotated[tuple[str, ...], Items(str, "a tuple of names")]
Signals = Annotated[tuple[Signal, ...], Items(Signal, "a tuple of Signals")]


@checked(ModelError, eq=False)
class System:
    """An affine system by its equations, and where a model in MuJoCo has its parts.

    Attributes:
        name: Name on the command line, in JSON and of the MJCF file.
        title: Name for people.
        states: The state x; of a mechanical system all positions, then their rates.
        inputs: The control inputs u.
        equations: x' = f(x) + g(x) u + d(x, w) and the outputs. The wrench w is [force, torque]
            of every body in ``bodies`` in world axes, flattened. None for a system whose
            dynamics MuJoCo alone knows.
        region: Where feedback linearization is relied on, in words.
        singularity: Where the plant's own equations break down, in words.
        controlled: Indices of the states that the outputs stand for in figures and films.
        joints: Joint names of the model, in the order of the positions.
        actuators: Names of its actuators, in the order of the inputs.
        bodies: Bodies that a disturbance can act on, in the order of w.
        variants: Sets of equations that the chapter leads to.
        read_parameters: (model, variant) -> parameters of a compiled model.
        uncertain_body: The body whose mass and length are uncertain.
        position_bound: Largest |position| at which the equations are compared with physics.
        near: A state next to which the plant is used, in the order of the states; zero by default.
            Equilibria, and the states of an output, are looked for from there.
        parametrization: The inputs as what is linear in unknown parameters; None if there is none.
    """

    name: Name
    title: Name
    states: Signals
    inputs: Signals
    equations: Equations | None
    region: str = "everywhere"
    singularity: str = "nowhere"
    controlled: tuple[int, ...] = (0,)
    joints: Names = ()
    actuators: Names = ()
    bodies: Names = ()
    variants: tuple[Variant, ...] = ("corrected",)
    read_parameters: Callable[..., Any] | None = None
    uncertain_body: str = ""
    position_bound: Positive = math.pi
    near: tuple[Finite, ...] = ()
    parametrization: LinearParametrization | None = None

    def __post_init__(self) -> None:
        for noun, names in (("joints", self.joints), ("actuators", self.actuators)):
            if len(set(names)) < len(names):
                raise ModelError(f"{self.name}: {noun} = {value_text(names)} must differ")
        equations = self.equations
        if equations is None:
            return

        self._require_count("states", len(self.states), len(equations.x))
        self._require_count("inputs", len(self.inputs), equations.inputs)
        self._require_count("wrench components", 6 * len(self.bodies), len(equations.w))

    def _require_count(self, noun: str, named: int, written: int) -> None:
        """Refuse equations that have another number of a noun than the system names."""
        if named != written:
            raise ModelError(f"{self.name}: {named} {noun} are named, the equations have {written}")

    @property
    def symbolic(self) -> bool:
        """True if it has equations in symbols; else MuJoCo alone knows its dynamics."""
        return self.equations is not None

    @property
    def symbolic_equations(self) -> Equations:
        """The equations of a system that has them.

        Raises:
            ModelError: If it has none.
        """
        if self.equations is None:
            raise ModelError(
                f"{self.name} has no equations in symbols: MuJoCo computes its dynamics"
            )
        return self.equations

    @property
    def degrees_of_freedom(self) -> int:
        """Number of coordinates of the model."""
        return len(self.joints)

    @property
    def positions(self) -> tuple[Signal, ...]:
        """Coordinates of the model."""
        return self.states[: self.degrees_of_freedom]

    @property
    def internal_positions(self) -> tuple[Signal, ...]:
        """Coordinates that no output stands for: theory says nothing about how far they move."""
        controlled = [self.states[i] for i in self.controlled]
        return tuple(position for position in self.positions if position not in controlled)

    def joint_units(self, joint: str) -> dict[str, str]:
        """Units of a joint's damping, dry friction and armature: of a hinge or of a slide.

        Raises:
            ModelError: If there is no such joint.
        """
        require_known("joint", joint, self.joints, error=ModelError)
        if self.states[self.joints.index(joint)].unit == "m":
            return {"damping": "N s/m", "friction": "N", "armature": "kg"}
        return {"damping": "N m s/rad", "friction": "N m", "armature": "kg m^2"}

    @property
    def rate_positions(self) -> dict[int, int]:
        """Indices of the states that are the rate of another state, with that state's.

        They are the velocities of a mechanical system; of other equations the states that are the
        whole drift of another one.
        """
        n = self.degrees_of_freedom
        if n:
            return {i + n: i for i in range(n)}
        equations = self.equations
        if equations is None:
            return {}
        x = list(equations.x)
        return {x.index(f): i for i, f in enumerate(equations.f) if f in x}

    @property
    def output(self) -> int:
        """Index of the first controlled state."""
        return self.controlled[0]

    @property
    def input(self) -> Signal:
        """The first input."""
        return self.inputs[0]

    @property
    def singular(self) -> Callable[[Any], bool]:
        """Jitable x -> True if the plant's own equations break down."""
        return self.equations.singular if self.equations else _nowhere

    @property
    def linearizable(self) -> Callable[[Any], bool]:
        """Jitable x -> True if x is in the region where feedback linearization is relied on."""
        return self.equations.linearizable if self.equations else _everywhere


def wrench_symbols(*bodies: str) -> tuple[sp.Symbol, ...]:
    """Symbols of [force, torque] of each body, in world axes."""
    parts = ("fx", "fy", "fz", "tx", "ty", "tz")
    return tuple(sp.Symbol(f"{part}_{body}") for body in bodies for part in parts)


def require_unmodelled_absent(
    owner: str,
    model: Model,
    joints: tuple[str, ...],
    actuator: str | None = None,
) -> None:
    """Refuse a model with effects that the chapter's equations have no term for.

    These are sideways gravity, damping of the named joints and, if an actuator is named, a gear
    other than one.

    Raises:
        ModelError: With the first such effect.
    """
    if np.any(model.opt.gravity[:2]):
        raise ModelError(f"{owner}: gravity {model.opt.gravity} must point along -z")

    for name in joints:
        damping = float(model.dof_damping[model.joint(name).dofadr[0]])
        if damping:
            raise ModelError(f"{owner}: joint {name!r} has damping {damping:g}, must have none")

    if actuator is None:
        return
    gear = float(model.actuator(actuator).gear[0])
    if gear != 1:
        raise ModelError(f"{owner}: actuator {actuator!r} has gear {gear:g}, must have 1")

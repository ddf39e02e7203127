"""Section 2's sliding mode on a plant's linearization, for any plant that has one.

Where feedback linearization is not possible, or leaves motions out that matter, the whole state is
held at an operating point: of a pole on a cart, of a ball on a beam, of a model of MuJoCo with
fewer actuators than joints.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arguments import real, reals, require
from grosmc_mj.arrays import Array
from grosmc_mj.control import laws
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import sliding, surface_numbers
from grosmc_mj.control.gains import authority, authority_together
from grosmc_mj.control.lqr import LqrDesign
from grosmc_mj.control.task import LinearParameters, StateTask
from grosmc_mj.errors import GainError, shown
from grosmc_mj.plants import OperatingPoint, Plant, System

# Of the room that an actuator's limits leave, for the nominal input; the rest is the switching
# term's. With 0.8 dm_control's cart-pole falls from 30 degrees.
SHARE = 0.9


@dataclass(frozen=True)
class StateUncertainty:
    """What a law on the linearization is asked to withstand.

    Attributes:
        body: The body whose mass and lengths are uncertain; the system's own by default.
        mass: Largest mass of it over its nominal one.
        length: Largest length over the nominal one.
        scales: Range of the true value of a parameter over its nominal one, by its name, for
            plants as equations.
        force: Largest disturbance of the input, in its unit.
        reaching_rate: Rate at which the true plant shall keep |s| falling, in the unit of s per
            second.
        push: Largest force at the body's centre of mass, in any direction [N].
    """

    body: str = ""
    mass: float = 1.0
    length: float = 1.0
    scales: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    force: float = 0.0
    reaching_rate: float = 0.2
    push: float = 0.0

    def __post_init__(self) -> None:
        require("body", self.body, str, "the name of a body", GainError)
        if not all(1 <= real(each) < math.inf for each in (self.mass, self.length)):
            raise GainError(
                f"mass x{shown(self.mass)} and length x{shown(self.length)} must be 1 or more, "
                "and finite"
            )
        forces, rate = (real(self.force), real(self.push)), real(self.reaching_rate)
        if not (all(0 <= each < math.inf for each in forces) and 0 < rate < math.inf):
            raise GainError(
                f"force {shown(self.force)} and push {shown(self.push)} must not be negative, "
                f"reaching rate {shown(self.reaching_rate)} positive, and all finite"
            )
        require("scales", self.scales, Mapping, "a range by the name of each number", GainError)
        for name, ends in self.scales.items():
            bounds = reals(ends)
            if bounds.shape != (2,) or not 0 < bounds[0] <= bounds[1] < math.inf:
                raise GainError(f"uncertainty of {name}: the range {shown(ends)} must be positive")

    def members(self, plant: Plant) -> Iterator[tuple[str, Plant]]:
        """The corners of the family and their means, in words and as plants."""
        masses, lengths = ((1.0, math.sqrt(most), most) for most in (self.mass, self.length))
        ranges = [(low, math.sqrt(low * high), high) for low, high in self.scales.values()]
        body = self.body or plant.system.uncertain_body
        for mass, length, *factors in itertools.product(masses, lengths, *ranges):
            member, said = plant, []
            if self.mass > 1 or self.length > 1:
                member = member.scaled(body, mass, length)
                said.append(f"the {body}'s mass x{mass:g} and length x{length:g}")
            if factors:
                member = member.changed(scales=dict(zip(self.scales, factors, strict=True)))
                named = zip(self.scales, factors, strict=True)
                said += [f"{name} x{factor:g}" for name, factor in named]
            yield " and ".join(said) or "nothing changed", member

    def describe(self, system: System) -> str:
        """The declaration in words."""
        said = []
        if self.mass > 1 or self.length > 1:
            said.append(f"m up to x{self.mass:g}, L up to x{self.length:g}")
        said += [f"{name} x{low:g} to x{high:g}" for name, (low, high) in self.scales.items()]
        unit = "" if system.input.unit == "1" else f" {system.input.unit}"
        said.append(f"disturbances of the input up to {self.force:g}{unit}")
        if self.push:
            said.append(f"{self.push:g} N on the {self.body or system.uncertain_body}")
        return ", ".join(said)


class Spread(NamedTuple):
    """What a family asks of the gains of the law (12).

    Attributes:
        gain_ratio: Least r = G B_t (G B)^-1; for several inputs what dominance leaves of it, and
            its symmetric part, so that one switch an input and one for all are both covered.
        gamma0: Constant part of the bound, in the unit of the input.
        gamma1: Its slope over |z|.
        unmatched: Largest part of A_t - B_t K - (A - B K) that the input does not reach, over all
            of it.
        slowest: Largest real part of the sliding dynamics' poles [1/s].
    """

    gain_ratio: float
    gamma0: float
    gamma1: float
    unmatched: float
    slowest: float


def state_grosmc(
    task: StateTask,
    uncertainty: StateUncertainty = StateUncertainty(),
    G: ArrayLike | None = None,
    limit: float | None = None,
) -> Controller:
    """GROSMC of section 2 on all states: the surface (8) and the law (12).

    On the linear models of the family, with A_t, B_t and the rest r_t = x'(x_e, u_e) of a member,

        gamma0 = sup (|G r_t| + force |G B_t| + push |G D_t|) / |r G B|,
        eta    = reaching_rate / min r,
        gamma1 = sup |G (A_t - B_t K - A + B K)| / |r G B|,   r = G B_t (G B)^-1,

    where D_t is what 1 N along each axis does to x'.

    Args:
        task: What is designed for.
        uncertainty: What the law shall withstand.
        G: Projection of the surface, (m, n); B+ by default, which does not amplify what is
            unmatched.
        limit: Largest nominal input about the operating point; by default 0.9 of the room that
            the actuator's limits leave there.

    Raises:
        GainError: If a member of the family turns the input round or makes the sliding dynamics
            unstable, when no switching gain helps, or a number does not fit.
    """
    require("task", task, StateTask, "a StateTask(plant, Q, R)")
    require("uncertainty", uncertainty, StateUncertainty, "a StateUncertainty")
    plant, point, optimum = task.plant, task.point, task.linearization_optimum()
    most = _room(plant, point) if limit is None else real(limit)
    if not most > 0:
        raise GainError(
            f"limit {shown(limit) if limit is not None else f'{most:g}'} of the nominal input must "
            "be positive"
        )
    numbers = surface_numbers(optimum, G)
    found = spread(plant, point, optimum, numbers["G"], uncertainty)
    parameters = LinearParameters(
        **vars(task.feedback(optimum.K)),
        **numbers,
        GB_held=numbers["GB"],
        eta=uncertainty.reaching_rate / found.gain_ratio,
        gamma0=found.gamma0,
        gamma1=found.gamma1,
        limit=most,
    )
    declared = (
        f"{uncertainty.describe(plant.system)}; input gain down to {found.gain_ratio:.3g} of the "
        f"nominal one; {found.unmatched:.1%} of what the family changes is out of the input's reach"
        f", slowest sliding pole {found.slowest:.3g} 1/s"
    )
    return sliding(
        partial(laws.grosmc, task.error, laws.gains_of_linear_plant, False),
        task,
        parameters,
        optimum,
        f"eqs. (8)+(12) with all {task.error.size} states",
        declared,
        sliding_unit=_sliding_unit(plant.system, numbers["GB"]),
    )


def _room(plant: Plant, point: OperatingPoint) -> float:
    """What the nominal input may be about the operating point."""
    low, high = plant.input_limits
    return SHARE * float(np.min([high - point.u, point.u - low]))


def spread(
    plant: Plant,
    point: OperatingPoint,
    optimum: LqrDesign,
    G: Array,
    uncertainty: StateUncertainty,
) -> Spread:
    """What a family asks of the law about an operating point.

    Raises:
        GainError: If a member turns the input round or makes the sliding dynamics unstable.
    """
    GB = G @ optimum.B
    size = float(np.linalg.norm(GB))
    found = Spread(math.inf, 0.0, 0.0, 0.0, -math.inf)
    for said, member in uncertainty.members(plant):
        A_t, B_t = member.jacobian(point.x, point.u)
        share = G @ B_t @ np.linalg.inv(GB)
        r = min(authority(share), authority_together(share))
        where = f"{plant.system.name} with {said}"
        if not r > 0:
            raise GainError(f"{where}: G B is {r:g} of the nominal one: choose another G")
        pole = float(np.linalg.eigvals(sliding_dynamics(optimum, G, A_t, B_t)).real.max())
        if pole >= 0:
            raise GainError(
                f"{where}: the sliding dynamics have a pole at {pole:g} 1/s, and no switching gain "
                "helps: weigh the rates more, or choose another G"
            )
        difference, matched = mismatch(optimum, A_t, B_t)
        rest = member.derivative(point.x, point.u)
        constant = np.linalg.norm(G @ rest)
        # Each input may be disturbed by as much.
        spread_out = uncertainty.force * math.sqrt(B_t.shape[1])
        constant += spread_out * np.linalg.norm(G @ B_t, 2)
        if uncertainty.push:
            body = uncertainty.body or plant.system.uncertain_body
            constant += uncertainty.push * np.linalg.norm(G @ _pushed(member, point, body), 2)
        whole = float(np.linalg.norm(difference))
        found = Spread(
            min(found.gain_ratio, r),
            max(found.gamma0, float(constant) / (r * size)),
            max(found.gamma1, float(np.linalg.norm(G @ difference)) / (r * size)),
            max(
                found.unmatched,
                float(np.linalg.norm(difference - matched)) / whole if whole > 0 else 0.0,
            ),
            max(found.slowest, pole),
        )
    return found


def _pushed(plant: Plant, point: OperatingPoint, body: str) -> Array:
    """What 1 N along each axis at a body's centre of mass does to x', (n, 3).

    Raises:
        GainError: If nothing can push there.
    """
    bodies = plant.system.bodies
    if body not in bodies:
        raise GainError(
            f"{plant.system.name} has no body {body!r} that could be pushed: valid: "
            f"{', '.join(bodies) or 'none'}"
        )
    still, columns = plant.derivative(point.x, point.u), []
    for axis in range(3):
        wrench = np.zeros((len(bodies), 6))
        wrench[bodies.index(body), axis] = 1.0
        columns.append(plant.derivative(point.x, point.u, wrench.ravel()) - still)
    return np.column_stack(columns)


def _sliding_unit(system: System, GB: Array) -> str:
    """Unit of s: that of the input times time, if G B is 1."""
    if not np.allclose(GB, np.eye(len(GB)), rtol=1e-9, atol=1e-9):
        return "1"
    return "s" if system.input.unit == "1" else f"{system.input.unit} s"


def mismatch(optimum: LqrDesign, A_t: Array, B_t: Array) -> tuple[Array, Array]:
    """What a true linear plant adds to A - B K, and the part of it that is matched, (n, n) each.

    On x' = A_t x + B_t u with u = -K x it is dA - dB K; B B+ projects on what the input reaches.
    """
    added = A_t - B_t @ optimum.K - optimum.closed_loop
    return added, optimum.B @ np.linalg.pinv(optimum.B) @ added


def sliding_dynamics(optimum: LqrDesign, G: Array, A_t: Array, B_t: Array) -> Array:
    """The matrix of x' on s = 0 of a linear plant (A_t, B_t), (n, n).

    s' = G (x' - (A - B K) x) = 0 gives the equivalent input, and with X = B_t (G B_t)^-1 G

        x' = [(I - X) A_t + X (A - B K)] x.

    It is A - B K, eq. (11), where A_t - A and B_t - B are matched.
    """
    X = B_t @ np.linalg.solve(G @ B_t, G)
    return (np.eye(len(A_t)) - X) @ A_t + X @ optimum.closed_loop

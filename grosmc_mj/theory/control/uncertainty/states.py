"""Uncertainty that a law of the whole state must withstand, on linear models."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import field
from typing import Annotated

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GainError
from grosmc_mj.ground.fields import Name, NotNegative, Positive, Range, checked
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.lqr import LqrDesign
from grosmc_mj.theory.control.reaching import (
    NominalLaw,
    Reaching,
    mismatch,
    nominal_law,
    sliding_dynamics,
)
from grosmc_mj.theory.control.uncertainty.family import PlantFamily, Scales, SwitchingGains
from grosmc_mj.theory.plants import OperatingPoint, Plant

Scale = Annotated[float, Range(1)]


@checked(GainError)
class StateUncertainty(PlantFamily):
    """Uncertainty that a law of the whole state, on the linearization, must withstand.

    Attributes:
        body: The body whose mass and lengths are uncertain; the system's own by default.
        mass: Largest mass of it over its nominal one.
        length: Largest length over the nominal one.
        scales: Range of the true value of a parameter over its nominal one, by its name, for
            plants as equations.
        force: Largest disturbance of each input, in its unit.
        reaching_rate: Rate at which the true plant shall keep |s| falling, in the unit of s per
            second.
        push: Largest force at the body's centre of mass, in any direction [N].
    """

    body: Name = ""
    mass: Scale = 1.0
    length: Scale = 1.0
    scales: Scales = field(default_factory=dict)
    force: NotNegative = 0.0
    reaching_rate: Positive = 0.2
    push: NotNegative = 0.0

    def scales_within(self, low: float, high: float) -> Sequence[float]:
        """Ends of a range and their geometric mean; one scale if the ends are equal."""
        if low == high:
            return (low,)
        return low, math.sqrt(low * high), high

    def members(self, plant: Plant) -> Iterator[tuple[str, Plant]]:
        """Plants with each mass and length of the body and each scale, with words for each."""
        if not self._scales_body:
            yield from super().members(plant)
            return

        body = self._body_of(plant)
        masses = self.scales_within(1.0, self.mass)
        lengths = self.scales_within(1.0, self.length)
        for mass, length in itertools.product(masses, lengths):
            of_body = f"the {body}'s mass x{mass:g} and length x{length:g}"
            for of_parameters, member in super().members(plant.scaled(body, mass, length)):
                changes = f"{of_body} and {of_parameters}" if self.scales else of_body
                yield changes, member

    def gains(self, law: Controller, plant: Plant) -> tuple[SwitchingGains, str]:
        """Gains that hold on the linear models of all members, which must slide to rest.

        Raises:
            GainError: If a member reverses or loses an input or makes the sliding dynamics
                unstable.
            ModelError: If the plant has no such parameter or body.
        """
        gains, declared = super().gains(law, plant)

        optimum = law.designed.lqr
        p = law.parameters
        slowest_pole = -math.inf
        unmatched = 0.0
        for changes, member in self.members(plant):
            A_t, B_t = member.jacobian(p.reference.x, p.reference.u)
            poles = np.linalg.eigvals(sliding_dynamics(optimum, p.G, A_t, B_t))
            pole = float(poles.real.max())
            if pole >= 0:
                raise GainError(
                    f"{plant.system.name} with {changes}: the sliding dynamics have a pole at "
                    f"{pole:g} 1/s, and no switching gain helps: weigh the rates more, or "
                    "choose another G"
                )
            slowest_pole = max(slowest_pole, pole)
            unmatched = max(unmatched, _unmatched_share(optimum, A_t, B_t))

        return gains, (
            f"{declared}; {unmatched:.1%} of what the family changes is out of the input's reach, "
            f"slowest sliding pole {slowest_pole:.3g} 1/s"
        )

    def law_at_states(self, law: Controller) -> NominalLaw:
        """The law at z = 0 and at one step along each axis, which are enough for linear models."""
        n = law.designed.error.size
        z = np.vstack([np.zeros(n), np.eye(n)])
        return nominal_law(law, [0.0] * len(z), law.parameters.reference.x + z, z)

    def reaching(
        self, law: Controller, by_model: NominalLaw, member: Plant
    ) -> tuple[Reaching, Array]:
        """Reaching condition on z' = x'(x_e, u_e) + A_t z + B_t v, the member's linear model.

        Its push is G x'(x_e, u_e) + G (A_t - B_t K - A + B K) z and R = G B_t (G B)^-1.
        Disturbances add force |G B_t| + push |G D_t|, where D_t is the change of x' by 1 N along
        each axis.
        """
        point = law.parameters.reference
        A_t, B_t = member.jacobian(point.x, point.u)
        drift = member.derivative(point.x, point.u) + by_model.z @ A_t.T
        gain = np.broadcast_to(B_t, (len(by_model.z), *B_t.shape))

        disturbed = self.force * np.abs(by_model.G @ B_t).sum(axis=1)
        if self.push:
            D_t = _effect_of_push(member, point, self._body_of(member))
            disturbed = disturbed + self.push * np.linalg.norm(by_model.G @ D_t, axis=1)
        return by_model.reaching((drift, gain)), np.broadcast_to(disturbed, by_model.v_0.shape)

    def description(self, plant: Plant) -> str:
        """The declared family, in words."""
        terms = []
        if self._scales_body:
            terms.append(f"m up to x{self.mass:g}, L up to x{self.length:g}")
        terms += self._ranges()

        unit = plant.system.input.unit
        terms.append(f"disturbances of the input up to {self.force:g}{unit_after(unit)}")
        if self.push:
            terms.append(f"{self.push:g} N on the {self._body_of(plant)}")
        return ", ".join(terms)

    @property
    def _scales_body(self) -> bool:
        """True if the mass or the lengths of the body are uncertain."""
        return self.mass > 1 or self.length > 1

    def _body_of(self, plant: Plant) -> str:
        """Name of the uncertain body of a plant."""
        return self.body or plant.system.uncertain_body


def _unmatched_share(optimum: LqrDesign, A_t: Array, B_t: Array) -> float:
    """Share of a true plant's difference that is not matched; 0 without a difference."""
    difference, matched = mismatch(optimum, A_t, B_t)
    if not difference.any():
        return 0.0
    unmatched = np.linalg.norm(difference - matched)
    return float(unmatched / np.linalg.norm(difference))


def _effect_of_push(plant: Plant, point: OperatingPoint, body: str) -> Array:
    """Effect on x' of 1 N along each axis at a body's centre of mass, (n, 3).

    Raises:
        GainError: If nothing can push there.
    """
    bodies = plant.system.bodies
    if body not in bodies:
        raise GainError(
            f"{plant.system.name} has no body {body!r} that could be pushed: valid: "
            f"{', '.join(bodies) or 'none'}"
        )
    wrenches = np.zeros((3, len(bodies), 6))
    wrenches[:, bodies.index(body), :3] = np.eye(3)
    undisturbed = plant.derivative(point.x, point.u)
    return np.column_stack(
        [plant.derivative(point.x, point.u, w.ravel()) - undisturbed for w in wrenches]
    )

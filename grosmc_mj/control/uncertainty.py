"""Declared uncertainties, and the switching gains that withstand them, where the chapter has none.

Gains are suprema of the reaching condition, over the states and plants that are declared.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import field, fields, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import PlainValidator

from grosmc_mj.arguments import reals, require_known
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Design
from grosmc_mj.control.reaching import (
    Nominal,
    Reaching,
    gain_margin,
    mismatch,
    nominal,
    sliding_dynamics,
    times,
)
from grosmc_mj.errors import GainError, shown
from grosmc_mj.fields import Name, NotNegative, Positive, Range, Reals, checked, refused
from grosmc_mj.plants import AnalyticPlant, OperatingPoint, Plant

# Points of the grids over which the suprema are taken; both include every corner. The number of
# states is for all axes together.
_SCALES, _STATES = 5, 441
# A step from z = 0 at which the mismatch is linear: its square is below rounding of the gains.
_NEAR = 1e-4
# What rounding makes of a mismatch that is not there, over such a step, and of a lost input gain.
_ROUNDING = 1e-9


def _scales(value: Any) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise refused("a table with the range [least, largest] of each parameter, by its name")
    ranges = {str(name): tuple(np.ravel(reals(ends)).tolist()) for name, ends in value.items()}
    for name, ends in ranges.items():
        if len(ends) != 2 or not 0 < ends[0] <= ends[1] < math.inf:
            raise refused(f"ranges [least, largest] above 0, unlike {name} = {shown(value[name])}")
    return ranges


def _region(value: Any) -> tuple[float, ...]:
    bounds = reals(value)
    if bounds.ndim != 1 or not np.all((bounds > 0) & (bounds < math.inf)):
        raise refused("finite and positive bounds")
    return tuple(bounds.tolist())


Scales = Annotated[Mapping[str, tuple[float, float]], PlainValidator(_scales)]
Region = Annotated[tuple[float, ...], PlainValidator(_region)]
Wrench = Annotated[tuple[float, ...], PlainValidator(lambda w: tuple(Reals((None,))(w).tolist()))]
Scale = Annotated[float, Range(1)]


Family = Iterable[tuple[str, Reaching, Array]]


class SwitchingGains(NamedTuple):
    """Gains of eqs. (12) and (37), and the input-gain ratio that they had to allow for.

    Attributes:
        eta: Reaching gain, in the unit of s per second.
        gamma0: Constant part of the bound, in the unit of the input.
        gamma1: Its slope over the norm of the error state.
        gain_ratio: Smallest r = E_true/E_nominal in the family; for several inputs what is left
            of it, by ``gain_margin`` of either kind.
    """

    eta: float
    gamma0: float
    gamma1: float
    gain_ratio: float


def suprema(name: str, law: Nominal, rate: float, family: Family) -> SwitchingGains:
    """Gains that keep s_i' s_i <= -rate |s_i| for every plant of a family.

    The switching term meets the true input gain, not the nominal one, so the assumptions' bounds
    are met with the gain's own uncertainty counted, which breaks the circle of Assumption 4. Of
    rho = eta + (gamma0 + gamma1 |z|) |G E| a part r is left (``gain_margin``):

        eta    = rate / min r
        gamma0 = sup |push(0) + G d| / (r |G E|)
        gamma1 = sup |push(z) - push(0)| / (r |G E| |z|),

    in Euclidean norms, so that they hold for a term along s/|s| as well as for one in each entry.

    Args:
        name: Of the system.
        law: The law at z = 0, then at one step along each axis next to it, where the mismatch is
            linear, then anywhere else.
        rate: That the true plants shall keep.
        family: Of each plant its name, the reaching condition there and the largest part |G d|,
            (N, m), that disturbances add to the push.

    Raises:
        GainError: If a plant of the family reverses or loses an input, when no gain helps.
    """
    gamma0, gamma1, least, n = 0.0, 0.0, math.inf, law.z.shape[1]
    size, distance = np.linalg.norm(law.GE, axis=(-2, -1))[1:], np.linalg.norm(law.z[1:], axis=-1)
    for plant, (_, push, R), disturbed in family:
        r = np.minimum(gain_margin(R), gain_margin(R, together=True))[1:]
        if not np.all(r > _ROUNDING):
            worst = int(np.argmin(np.where(np.isnan(r), -np.inf, r)))
            raise GainError(
                f"{name}: the input gain of a declared plant, {plant}, is {r[worst]:g} of the "
                f"nominal one at z = {law.z[1 + worst]}; no switching gain can make up for that: "
                "choose another G"
            )
        constant = np.hypot.reduce(np.abs(push[0]) + disturbed[1:], axis=-1) / (r * size)
        slope = (push[1:] - push[0]) / (r * size * distance)[:, None]
        # The largest slope of a linear mismatch is the norm of its matrix.
        near, far = np.linalg.norm(slope[:n], 2), np.linalg.norm(slope, axis=-1).max()
        gamma0, gamma1 = max(gamma0, float(constant.max())), max(gamma1, float(near), float(far))
        least = min(least, float(r.min()))
    # Rounding is no mismatch.
    gamma0, gamma1 = (value if value > _ROUNDING else 0.0 for value in (gamma0, gamma1))
    return SwitchingGains(rate / least, gamma0, gamma1, least)


@checked()
class Uncertainty:
    """Uncertainty that a switching law of outputs must withstand.

    Attributes:
        scales: Range of the true value of a parameter over its nominal one, by its name.
        wrench: Largest magnitude of each disturbance component, [force, torque] in N and N m
            of each body of the system.
        region: Largest |z1|, |z2| ... of the error state.
        reaching_rate: The eta of eqs. (14) and (39) that the true plant shall keep: the rate of
            |s|, in the unit of s per second.
    """

    scales: Scales
    wrench: Wrench
    region: Region
    reaching_rate: Positive

    def gains(self, design: Design, p: Any, _: Plant | None = None) -> tuple[SwitchingGains, str]:
        """Gains that hold over the operating region and for all declared plants.

        The suprema are over a grid of the declared scales and the region with all their corners,
        and over all directions next to z = 0.

        Args:
            design: What the law was designed for, with error coordinates in symbols.
            p: Its parameters, of which gains are not read.

        Returns:
            The gains, and what they come from in one line.

        Raises:
            GainError: If a plant of the family reverses or loses an input, when no gain helps; or
                if the reference moves, for which the formula has no room.
        """
        error: Any = design.error
        self._require_fitting(error, p.plant)
        # At rest, a step along each axis next to it, and the grid.
        points = round(_STATES ** (1 / error.size)) // 2 * 2 + 1  # odd, so that it has the axes
        axes = [np.linspace(-bound, bound, points) for bound in self.region]
        grid = [state for state in itertools.product(*axes) if any(state)]
        z = np.array([np.zeros(error.size), *(_NEAR * np.eye(error.size)), *grid])
        t, x = [0.0] * len(z), np.array([error.place(0.0, state, p) for state in z])
        law = nominal(design, p, t, x, z)
        wrenches = [np.tile(w, (len(z), 1)) for w in np.diag(self.wrench) if w.any()]

        def family() -> Iterator[tuple[str, Reaching, Array]]:
            axes = [np.linspace(*ends, _SCALES).tolist() for ends in self.scales.values()]
            for factors in itertools.product(*axes):
                scales = dict(zip(self.scales, factors, strict=True))
                changes = {name: getattr(p.plant, name) * k for name, k in scales.items()}
                plant = AnalyticPlant(error.system, replace(p.plant, **changes))
                disturbed = np.zeros_like(law.v_0)
                for w in wrenches:
                    disturbed += np.abs(times(law.G, error.disturbances(x, p, plant, w)))
                motion = error.error_dynamics(t, x, p, plant)
                yield _scaled(scales), law.reaching(motion), disturbed

        gains = suprema(error.system.name, law, self.reaching_rate, family())
        pushes = [f"{size:.3g}" for size in self.wrench if size]
        bounds = [f"|z{i + 1}| <= {bound:.3g}" for i, bound in enumerate(self.region)]
        return gains, (
            f"{', '.join(_ranges(self.scales)) or 'no variation'}; wrench up to "
            f"{', '.join(pushes) or '0'} N or N m; {', '.join(bounds)}; reaching rate "
            f"{self.reaching_rate:g}; input gain down to {gains.gain_ratio:.3g} of the nominal one"
        )

    def _require_fitting(self, error: Any, plant: Any) -> None:
        """Refuse an uncertainty of another system, and a reference that moves."""
        name = error.system.name
        for noun, count, size in (
            ("bounds of the operating region", len(self.region), error.size),
            ("wrench components", len(self.wrench), len(error.system.equations.w)),
        ):
            if count != size:
                raise GainError(f"{name}: the uncertainty has {count} {noun}, must have {size}")
        for scaled in self.scales:
            known = [field.name for field in fields(plant)]
            require_known(f"parameter of {name}", scaled, known, error=GainError)
        if getattr(error.reference, "moves", False):
            raise GainError(
                f"{name}: the reference moves: a bound in |z| cannot cover that; give k and "
                "epsilon instead"
            )


@checked(GainError)
class StateUncertainty:
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

    def members(self, plant: Plant) -> Iterator[tuple[str, Plant]]:
        """The corners of the family and their means, in words and as plants."""
        masses, lengths = ((1.0, math.sqrt(most), most) for most in (self.mass, self.length))
        ranges = [(low, math.sqrt(low * high), high) for low, high in self.scales.values()]
        body = self.body or plant.system.uncertain_body
        for mass, length, *factors in itertools.product(masses, lengths, *ranges):
            member, changes = plant, []
            if self.mass > 1 or self.length > 1:
                member = member.scaled(body, mass, length)
                changes.append(f"the {body}'s mass x{mass:g} and length x{length:g}")
            if factors:
                scales = dict(zip(self.scales, factors, strict=True))
                member = member.changed(scales=scales)
                changes.append(_scaled(scales))
            yield " and ".join(changes) or "nothing changed", member

    def gains(self, design: Design, p: Any, plant: Plant) -> tuple[SwitchingGains, str]:
        """Gains that hold on the linear models of all declared plants.

        With A_t, B_t and the rest r_t = x'(x_e, u_e) of a member, push(z) = G r_t + G (A_t - B_t K
        - A + B K) z and R = G B_t (G B)^-1; disturbances add force |G B_t| + push |G D_t|, where
        D_t is what 1 N along each axis does to x'.

        Args:
            design: What the law was designed for.
            p: Its parameters, of which gains are not read.
            plant: The nominal plant.

        Returns:
            The gains, and what they come from in one line.

        Raises:
            GainError: If a member turns the input round or makes the sliding dynamics unstable.
        """
        optimum, point, n = design.lqr, p.reference, len(design.lqr.A)
        z = np.vstack([np.zeros(n), np.eye(n)])
        law = nominal(design, p, [0.0] * len(z), z, z)
        body, unmatched, poles = self.body or plant.system.uncertain_body, [0.0], []

        def family() -> Iterator[tuple[str, Reaching, Array]]:
            for changes, member in self.members(plant):
                A_t, B_t = member.jacobian(point.x, point.u)
                drift = member.derivative(point.x, point.u) + z @ A_t.T
                reaching = law.reaching((drift, np.broadcast_to(B_t, (n + 1, *B_t.shape))))
                disturbed = self.force * np.abs(law.G @ B_t).sum(axis=1)
                if self.push:
                    D_t = _pushed(member, point, body)
                    disturbed = disturbed + self.push * np.linalg.norm(law.G @ D_t, axis=1)
                yield changes, reaching, np.broadcast_to(disturbed, law.v_0.shape)
                sliding = sliding_dynamics(optimum, law.G, A_t, B_t)
                poles.append(float(np.linalg.eigvals(sliding).real.max()))
                if poles[-1] >= 0:
                    raise GainError(
                        f"{plant.system.name} with {changes}: the sliding dynamics have a pole at "
                        f"{poles[-1]:g} 1/s, and no switching gain helps: weigh the rates more, or "
                        "choose another G"
                    )
                added, matched = mismatch(optimum, A_t, B_t)
                if added.any():
                    share = np.linalg.norm(added - matched) / np.linalg.norm(added)
                    unmatched.append(float(share))

        gains, terms = suprema(plant.system.name, law, self.reaching_rate, family()), []
        if self.mass > 1 or self.length > 1:
            terms.append(f"m up to x{self.mass:g}, L up to x{self.length:g}")
        unit = plant.system.input.unit
        terms += _ranges(self.scales)
        force = f"{self.force:g}" if unit == "1" else f"{self.force:g} {unit}"
        terms.append(f"disturbances of the input up to {force}")
        if self.push:
            terms.append(f"{self.push:g} N on the {body}")
        return gains, (
            f"{', '.join(terms)}; input gain down to {gains.gain_ratio:.3g} of the nominal one; "
            f"{max(unmatched):.1%} of what the family changes is out of the input's reach, slowest "
            f"sliding pole {max(poles):.3g} 1/s"
        )


def _ranges(scales: Mapping[str, tuple[float, float]]) -> list[str]:
    return [f"{name} x{low:g} to x{high:g}" for name, (low, high) in scales.items()]


def _scaled(scales: Mapping[str, float]) -> str:
    return " and ".join(f"{name} x{factor:g}" for name, factor in scales.items()) or "as it is"


def _pushed(plant: Plant, point: OperatingPoint, body: str) -> Array:
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
    still = plant.derivative(point.x, point.u)
    return np.column_stack(
        [plant.derivative(point.x, point.u, w.ravel()) - still for w in wrenches]
    )

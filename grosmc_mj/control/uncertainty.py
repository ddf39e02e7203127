"""Declared uncertainties, and switching gains that withstand them, which the chapter leaves open.

Gains are suprema of the reaching condition, over the states and plants that are declared.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, fields, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import PlainValidator

from grosmc_mj.arguments import reals, require_known
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Design
from grosmc_mj.control.lqr import LqrDesign
from grosmc_mj.control.reaching import (
    NominalLaw,
    Reaching,
    gain_margin,
    matrix_vector,
    mismatch,
    nominal_law,
    sliding_dynamics,
)
from grosmc_mj.errors import GainError, value_text
from grosmc_mj.fields import Name, NotNegative, Positive, Range, Reals, checked
from grosmc_mj.plants import AnalyticPlant, OperatingPoint, Plant
from grosmc_mj.refusals import refusal

# Points of the grids over which the suprema are taken; both include every corner. The number of
# states is for all axes together.
_SCALES = 5
_STATES = 441
# A step from z = 0 at which the mismatch is linear: its square is below rounding of the gains.
_NEAR = 1e-4
# Rounding of a mismatch of zero over such a step, and of an input gain of zero.
_ROUNDING = 1e-9


def _scales(value: Any) -> dict[str, Any]:
    """Ranges of scales by the names of parameters."""
    if not isinstance(value, Mapping):
        raise refusal("a table with the range [least, largest] of each parameter, by its name")

    ranges: dict[str, Any] = {}
    for name, ends in value.items():
        numbers = tuple(np.ravel(reals(ends)).tolist())
        if len(numbers) != 2 or not 0 < numbers[0] <= numbers[1] < math.inf:
            raise refusal(f"ranges [least, largest] above 0, unlike {name} = {value_text(ends)}")
        ranges[str(name)] = numbers
    return ranges


def _region(value: Any) -> tuple[float, ...]:
    """Bounds of the error state."""
    bounds = reals(value)
    if bounds.ndim != 1 or not np.all((bounds > 0) & (bounds < math.inf)):
        raise refusal("finite and positive bounds")
    return tuple(bounds.tolist())


def _wrench(value: Any) -> tuple[float, ...]:
    """Magnitudes of disturbance components."""
    magnitudes = Reals((None,))(value)
    return tuple(magnitudes.tolist())


Scales = Annotated[Mapping[str, tuple[float, float]], PlainValidator(_scales)]
Region = Annotated[tuple[float, ...], PlainValidator(_region)]
Wrench = Annotated[tuple[float, ...], PlainValidator(_wrench)]
Scale = Annotated[float, Range(1)]


class SwitchingGains(NamedTuple):
    """Gains of eqs. (12) and (37), and the input-gain ratio that they had to allow for.

    Attributes:
        eta: Reaching gain, in the unit of s per second.
        gamma0: Constant part of the bound, in the unit of the input.
        gamma1: Its slope over the norm of the error state.
        gain_ratio: Smallest r = E_true/E_nominal in the family; for several inputs the smaller of
            both kinds of ``gain_margin``.
    """

    eta: float
    gamma0: float
    gamma1: float
    gain_ratio: float


class GainSuprema:
    """Suprema over a family of plants, from which gains with s_i' s_i <= -rate |s_i| follow.

    The switching term meets the true input gain, not the nominal one, so the assumptions' bounds
    are met with the gain's own uncertainty counted, which breaks the circle of Assumption 4. Of
    rho = eta + (gamma0 + gamma1 |z|) |G E| a share r is effective (``gain_margin``):

        eta    = rate / min r
        gamma0 = sup |push(0) + G d| / (r |G E|)
        gamma1 = sup |push(z) - push(0)| / (r |G E| |z|),

    in Euclidean norms, so that they hold for a term along s/|s| as well as for one in each entry.
    """

    def __init__(self, name: str, law: NominalLaw) -> None:
        """Begin with no plant.

        Args:
            name: Name of the system.
            law: The law at z = 0, then at one step along each axis next to it, where the mismatch
                is linear, then anywhere else.
        """
        self._name = name
        self._z = law.z[1:]
        sizes = np.linalg.norm(law.GE, axis=(-2, -1))
        self._size = sizes[1:]
        self._distance = np.linalg.norm(self._z, axis=-1)
        self._gamma0 = 0.0
        self._gamma1 = 0.0
        self._gain_ratio = math.inf

    def add(self, plant: str, reaching: Reaching, disturbed: Array) -> None:
        """Include a plant of the family.

        Args:
            plant: Its name.
            reaching: Its reaching condition at the states of the law.
            disturbed: Largest part |G d| that disturbances add to the push there, (N, m).

        Raises:
            GainError: If the plant reverses or loses an input, when no gain helps.
        """
        push = reaching.push
        r = self._effective_share(plant, reaching.R)
        self._gain_ratio = min(self._gain_ratio, float(r.min()))

        switched = r * self._size
        largest = np.abs(push[0]) + disturbed[1:]
        constant = np.hypot.reduce(largest, axis=-1) / switched
        self._gamma0 = max(self._gamma0, float(constant.max()))

        slope = (push[1:] - push[0]) / (switched * self._distance)[:, None]
        # The largest slope of a linear mismatch is the norm of its matrix.
        n = self._z.shape[1]
        near = float(np.linalg.norm(slope[:n], 2))
        far = np.linalg.norm(slope, axis=-1)
        self._gamma1 = max(self._gamma1, near, float(far.max()))

    def _effective_share(self, plant: str, R: Array) -> Array:
        """r of a plant at every state but z = 0."""
        in_each_entry = gain_margin(R)
        along_s = gain_margin(R, together=True)
        r = np.minimum(in_each_entry, along_s)[1:]
        if not np.all(r > _ROUNDING):
            comparable = np.where(np.isnan(r), -np.inf, r)
            worst = int(np.argmin(comparable))
            raise GainError(
                f"{self._name}: the input gain of a declared plant, {plant}, is {r[worst]:g} of "
                f"the nominal one at z = {self._z[worst]}; no switching gain can make up for that: "
                "choose another G"
            )
        return r

    def gains(self, rate: float) -> SwitchingGains:
        """Gains with which every plant of the family keeps |s| falling at this rate."""
        eta = rate / self._gain_ratio
        # Rounding is no mismatch.
        gamma0 = self._gamma0 if self._gamma0 > _ROUNDING else 0.0
        gamma1 = self._gamma1 if self._gamma1 > _ROUNDING else 0.0
        return SwitchingGains(eta, gamma0, gamma1, self._gain_ratio)


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

    def gains(
        self,
        design: Design,
        p: Any,
        _: Plant | None = None,
    ) -> tuple[SwitchingGains, str]:
        """Gains that hold over the operating region and for all declared plants.

        The suprema are over a grid of the declared scales and the region with all their corners,
        and over all directions next to z = 0.

        Args:
            design: Design of the law, with error coordinates in symbols.
            p: Its parameters, of which gains are not read.

        Returns:
            The gains, and the family that they hold for in one line.

        Raises:
            GainError: If a plant of the family reverses or loses an input, when no gain helps; or
                if the reference moves, for which the formula has no room.
        """
        error: Any = design.error
        self._require_fitting(error, p.plant)

        z = self._error_states(error.size)
        x = np.array([error.place(0.0, state, p) for state in z])
        t = [0.0] * len(z)
        law = nominal_law(design, p, t, x, z)

        suprema = GainSuprema(error.system.name, law)
        for scales in self._grid_of_scales():
            plant = AnalyticPlant(error.system, _scaled_parameters(p.plant, scales))
            disturbed = self._disturbed(error, law, x, p, plant)
            reaching = law.reaching(error.error_dynamics(t, x, p, plant))
            suprema.add(_scaled(scales), reaching, disturbed)

        gains = suprema.gains(self.reaching_rate)
        return gains, self._description(gains)

    def _error_states(self, size: int) -> Array:
        """z = 0, a step along each axis next to it, and the grid of the region, (N, size)."""
        # An odd number of points, so that the axes are in the grid.
        points = round(_STATES ** (1 / size)) // 2 * 2 + 1
        axes = [np.linspace(-bound, bound, points) for bound in self.region]
        grid = [state for state in itertools.product(*axes) if any(state)]
        steps = _NEAR * np.eye(size)
        return np.array([np.zeros(size), *steps, *grid])

    def _grid_of_scales(self) -> Iterator[dict[str, float]]:
        """Scales of the parameters, by name, for each plant of the family."""
        axes = [np.linspace(low, high, _SCALES) for low, high in self.scales.values()]
        for factors in itertools.product(*axes):
            # As Python's floats, which equations are evaluated in.
            yield dict(zip(self.scales, map(float, factors), strict=True))

    def _disturbed(
        self,
        error: Any,
        law: NominalLaw,
        x: Array,
        p: Any,
        plant: Plant,
    ) -> Array:
        """Largest part |G d| that the declared wrench adds to the push on a plant, (N, m)."""
        disturbed = np.zeros_like(law.v_0)
        for component in np.diag(self.wrench):
            if component.any():
                w = np.tile(component, (len(x), 1))
                dz = error.disturbances(x, p, plant, w)
                disturbed += np.abs(matrix_vector(law.G, dz))
        return disturbed

    def _description(self, gains: SwitchingGains) -> str:
        """The family that gains hold for, in one line."""
        ranges = ", ".join(_ranges(self.scales)) or "no variation"
        magnitudes = ", ".join(f"{size:.3g}" for size in self.wrench if size) or "0"
        bounds = ", ".join(f"|z{i}| <= {bound:.3g}" for i, bound in enumerate(self.region, 1))
        return (
            f"{ranges}; wrench up to {magnitudes} N or N m; {bounds}; "
            f"reaching rate {self.reaching_rate:g}; "
            f"input gain down to {gains.gain_ratio:.3g} of the nominal one"
        )

    def _require_fitting(self, error: Any, plant: Any) -> None:
        """Refuse an uncertainty of another system, and a reference that moves."""
        name = error.system.name
        _require_count(name, "bounds of the operating region", self.region, error.size)
        _require_count(
            name, "wrench components", self.wrench, len(error.system.symbolic_equations.w)
        )

        parameters = [field.name for field in fields(plant)]
        for scaled in self.scales:
            require_known(f"parameter of {name}", scaled, parameters, error=GainError)

        if getattr(error.reference, "moves", False):
            raise GainError(
                f"{name}: the reference moves: a bound in |z| cannot cover that; give k and "
                "epsilon instead"
            )


def _scaled_parameters(nominal_parameters: Any, scales: Mapping[str, float]) -> Any:
    """Parameters of a plant with some of them scaled."""
    changes: dict[str, Any] = {}
    for name, factor in scales.items():
        changes[name] = getattr(nominal_parameters, name) * factor
    return replace(nominal_parameters, **changes)


def _require_count(
    name: str,
    noun: str,
    values: Sequence[float],
    count: int,
) -> None:
    """Refuse values of which there must be another number."""
    if len(values) != count:
        raise GainError(f"{name}: the uncertainty has {len(values)} {noun}, must have {count}")


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
        masses = _ends_and_mean(1.0, self.mass)
        lengths = _ends_and_mean(1.0, self.length)
        ranges = [_ends_and_mean(low, high) for low, high in self.scales.values()]
        body = self.body or plant.system.uncertain_body

        for mass, length, *factors in itertools.product(masses, lengths, *ranges):
            member = plant
            changes = []
            if self.mass > 1 or self.length > 1:
                member = member.scaled(body, mass, length)
                changes.append(f"the {body}'s mass x{mass:g} and length x{length:g}")
            if factors:
                scales = dict(zip(self.scales, factors, strict=True))
                member = member.changed(scales=scales)
                changes.append(_scaled(scales))
            yield " and ".join(changes) or "nothing changed", member

    def gains(
        self,
        design: Design,
        p: Any,
        plant: Plant,
    ) -> tuple[SwitchingGains, str]:
        """Gains that hold on the linear models of all declared plants.

        With A_t, B_t and the rest r_t = x'(x_e, u_e) of a member, push(z) = G r_t + G (A_t - B_t K
        - A + B K) z and R = G B_t (G B)^-1; disturbances add force |G B_t| + push |G D_t|, where
        D_t is the change of x' by 1 N along each axis.

        Args:
            design: Design of the law.
            p: Its parameters, of which gains are not read.
            plant: The nominal plant.

        Returns:
            The gains, and the family that they hold for in one line.

        Raises:
            GainError: If a member turns the input round or makes the sliding dynamics unstable.
        """
        optimum = design.lqr
        point = p.reference
        # Zero error, and one step along each axis: the models are linear.
        n = len(optimum.A)
        z = np.vstack([np.zeros(n), np.eye(n)])
        t = [0.0] * len(z)
        law = nominal_law(design, p, t, z, z)

        suprema = GainSuprema(plant.system.name, law)
        slowest_pole = -math.inf
        unmatched = 0.0
        for changes, member in self.members(plant):
            A_t, B_t = member.jacobian(point.x, point.u)
            drift = member.derivative(point.x, point.u) + z @ A_t.T
            gain = np.broadcast_to(B_t, (n + 1, *B_t.shape))
            disturbed = self._disturbed(law.G, B_t, member, point)
            disturbed = np.broadcast_to(disturbed, law.v_0.shape)
            suprema.add(changes, law.reaching((drift, gain)), disturbed)

            sliding = sliding_dynamics(optimum, law.G, A_t, B_t)
            pole = float(np.linalg.eigvals(sliding).real.max())
            if pole >= 0:
                raise GainError(
                    f"{plant.system.name} with {changes}: the sliding dynamics have a pole at "
                    f"{pole:g} 1/s, and no switching gain helps: weigh the rates more, or "
                    "choose another G"
                )
            slowest_pole = max(slowest_pole, pole)
            unmatched = max(unmatched, _unmatched_share(optimum, A_t, B_t))

        gains = suprema.gains(self.reaching_rate)
        return gains, (
            f"{self._description(plant)}; input gain down to {gains.gain_ratio:.3g} of the nominal "
            f"one; {unmatched:.1%} of what the family changes is out of the input's reach, slowest "
            f"sliding pole {slowest_pole:.3g} 1/s"
        )

    def _disturbed(
        self,
        G: Array,
        B_t: Array,
        member: Plant,
        point: OperatingPoint,
    ) -> Array:
        """Largest part of the push by disturbances on a member, (m,)."""
        by_force = self.force * np.abs(G @ B_t).sum(axis=1)
        if not self.push:
            return by_force

        body = self.body or member.system.uncertain_body
        D_t = _pushed(member, point, body)
        by_push = self.push * np.linalg.norm(G @ D_t, axis=1)
        return by_force + by_push

    def _description(self, plant: Plant) -> str:
        """The declared family, in words."""
        terms = []
        if self.mass > 1 or self.length > 1:
            terms.append(f"m up to x{self.mass:g}, L up to x{self.length:g}")
        terms += _ranges(self.scales)

        unit = plant.system.input.unit
        force = f"{self.force:g}" if unit == "1" else f"{self.force:g} {unit}"
        terms.append(f"disturbances of the input up to {force}")
        if self.push:
            body = self.body or plant.system.uncertain_body
            terms.append(f"{self.push:g} N on the {body}")
        return ", ".join(terms)


def _ends_and_mean(low: float, high: float) -> tuple[float, float, float]:
    """Least, geometric mean and largest scale of a range."""
    return low, math.sqrt(low * high), high


def _unmatched_share(optimum: LqrDesign, A_t: Array, B_t: Array) -> float:
    """Share of a true plant's difference that is not matched; 0 without a difference."""
    difference, matched = mismatch(optimum, A_t, B_t)
    if not difference.any():
        return 0.0
    unmatched = np.linalg.norm(difference - matched)
    return float(unmatched / np.linalg.norm(difference))


def _ranges(scales: Mapping[str, tuple[float, float]]) -> list[str]:
    """Ranges of scales, in words."""
    return [f"{name} x{low:g} to x{high:g}" for name, (low, high) in scales.items()]


def _scaled(scales: Mapping[str, float]) -> str:
    """Scales of a plant, in words."""
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
    undisturbed = plant.derivative(point.x, point.u)
    return np.column_stack(
        [plant.derivative(point.x, point.u, w.ravel()) - undisturbed for w in wrenches]
    )

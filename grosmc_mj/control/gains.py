"""Switching gains from a declared uncertainty, where the chapter prints none."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arguments import real, reals, require, require_known
from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.errors import ArgumentError, GainError, shown

# Points of the grids over which the suprema are taken; both include every corner. The number of
# states is for all axes together.
_SCALES, _STATES = 5, 441
# A step from z = 0 at which the mismatch is linear: its square is below rounding of the gains.
_NEAR = 1e-4
# What rounding makes of a mismatch that is not there, over such a step.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Uncertainty:
    """What a switching law is asked to withstand.

    Attributes:
        scales: Range of the true value of a parameter over its nominal one, by its name.
        wrench: Largest magnitude of each disturbance component, [force, torque] in N and N m
            of each body of the system.
        region: Largest |z1|, |z2| ... of the error state.
        reaching_rate: The eta of eqs. (14) and (39) that the true plant shall keep: the rate of
            |s|, in the unit of s per second.
    """

    scales: Mapping[str, tuple[float, float]]
    wrench: tuple[float, ...]
    region: tuple[float, ...]
    reaching_rate: float

    def __post_init__(self) -> None:
        require("uncertainty: scales", self.scales, Mapping, "a range by the name of each number")
        for name, given in self.scales.items():
            ends = reals(given)
            if ends.shape != (2,) or not 0 < ends[0] <= ends[1] < math.inf:
                between = " to ".join(f"{end:g}" for end in ends) if ends.ndim else shown(given)
                raise ArgumentError(f"uncertainty of {name}: the range {between} must be positive")
        wrench, region = reals(self.wrench), reals(self.region)
        if wrench.ndim != 1 or not np.all(np.isfinite(wrench)):
            raise ArgumentError(f"uncertainty: the wrench {shown(self.wrench)} must be finite")
        if not 0 < real(self.reaching_rate) < math.inf:
            raise ArgumentError(
                f"reaching rate {shown(self.reaching_rate)} must be positive and finite"
            )
        if region.ndim != 1 or not np.all((region > 0) & (region < math.inf)):
            raise ArgumentError(
                f"operating region {shown(self.region)} must be finite and positive"
            )

    def describe(self, ratio: float) -> str:
        """The declaration in one line, with the input-gain ratio that it leads to."""
        scales = [f"{name} x{low:g} to x{high:g}" for name, (low, high) in self.scales.items()]
        pushes = [f"{size:.3g}" for size in self.wrench if size]
        bounds = [f"|z{i + 1}| <= {bound:.3g}" for i, bound in enumerate(self.region)]
        return (
            f"{', '.join(scales) or 'no variation'}; "
            f"wrench up to {', '.join(pushes) or '0'} N or N m; {', '.join(bounds)}; reaching rate "
            f"{self.reaching_rate:g}; input gain down to {ratio:.3g} of the nominal one"
        )


class SwitchingGains(NamedTuple):
    """Gains of eqs. (12) and (37), and the input-gain ratio that they had to allow for.

    Attributes:
        eta: Reaching gain, in the unit of s per second.
        gamma0: Constant part of the bound, in the unit of the input.
        gamma1: Its slope over the norm of the error state.
        gain_ratio: Smallest r = E_true/E_nominal in the family; for several inputs what is left
            of it on the diagonal of R, see ``authority``.
    """

    eta: float
    gamma0: float
    gamma1: float
    gain_ratio: float


def surface_rate(
    motion: tuple[Array, Array], z: Array, G: Array, S: Array, u: Array
) -> tuple[Array, Array]:
    """(push, steered) of s' = push + steered (u' - u) on a true plant, for any input u'.

    s' = G z' - S z with S = G (A - B K) and z' as the true plant makes it: what of the uncertainty
    reaches s through the rows without an input counts too, if G looks at them.

    Args:
        motion: (drift, gain) of z' = drift + gain u, as ``ErrorCoordinates.moved`` gives it, of
            one state or of many: (..., size) and (..., size, m).
        z: Error state, (..., size).
        G: Projection of the surface, (m, size).
        S: G (A - B K), (m, size).
        u: The continuous law's input, (..., m).

    Returns:
        push (..., m) and steered (..., m, m).
    """
    drift, gain = motion
    return times(G, drift + times(gain, u)) - times(S, z), G @ gain


def times(matrix: Array, vector: Array) -> Array:
    """The product of a matrix (..., i, j) and a vector (..., j), of one or of many."""
    return np.einsum("...ij,...j->...i", matrix, vector)


def solved(matrix: Array, vector: Array) -> Array:
    """matrix^-1 vector, (..., i), of one or of many.

    Raises:
        numpy.linalg.LinAlgError: If one is singular.
    """
    return np.linalg.solve(matrix, vector[..., None])[..., 0]


def switching_gains(
    error: ErrorCoordinates,
    nominal: Any,
    K: Array,
    uncertainty: Uncertainty,
    *,
    linearizing: bool,
    G: Array,
) -> SwitchingGains:
    """Gains that keep s_i' s_i <= -eta |s_i| for every plant of the declared family.

    With z_i^(r_i) = alpha + E u by the model that the law is designed for (the nominal plant or,
    for a linear law, its linearization), alpha* + E* u + d on the true plant, the continuous law
    u_0, u = u_0 + u_d and G_r the columns of G that meet the inputs' rows,

        s' = push(z) + G d - rho R sgn(s),  R = (G E*) (G E)^-1,

    with push = G z' - S z of the true plant under u_0 (``surface_rate``); for matched uncertainty
    it is G_r [(alpha* - alpha) + (E* - E) u_0].

    The switching term meets the true input gain, not the nominal one, so the assumptions' bounds
    are met with the gain's own uncertainty counted, which breaks the circle of Assumption 4. Of
    rho = eta + (gamma0 + gamma1 |z|) |G E| a part r is left (``authority``):

        eta    = reaching_rate / min r
        gamma0 = sup |push(0) + G d| / (r |G E|)
        gamma1 = sup |push(z) - push(0)| / (r |G E| |z|),

    in Euclidean norms, so that they hold for a term along s/|s| as well as for one in each entry.

    The suprema are over a grid of the declared scales and the operating region with all their
    corners, and over all directions next to z = 0.

    Args:
        error: Error coordinates of the law.
        nominal: The law's parameters, with ``plant`` and ``reference``.
        K: Its feedback gain, (m, n).
        uncertainty: The declared family.
        linearizing: Whether u_0 is E^-1 (-K z - alpha), as in eq. (37), or -K z, as in eq. (12).
        G: Projection of the surface, (m, n).

    Raises:
        GainError: If a plant of the family reverses or loses an input, when no gain helps; or if
            the reference moves, for which the formula has no room.
    """
    _refuse_unknown(error, nominal, uncertainty)
    chains = error.linearization
    A, B = (chains.A, chains.B) if linearizing else error.jacobian(nominal)
    G_r, S = G[:, list(chains.last_rows)], G @ (A - B @ K)
    gamma0, gamma1, least = 0.0, 0.0, math.inf

    # At rest, a step along each axis next to it, and the grid.
    z = np.array([np.zeros(error.size), *_states(uncertainty.region)])
    x = np.array([error.place(0.0, each, nominal) for each in z])
    # What the law's model says there: the continuous law's input, and G_r E.
    u_0, believed = -times(K, z), np.broadcast_to(G @ B, (len(z), *(G @ B).shape))
    if linearizing:
        alpha, E = error.dynamics_along([0.0] * len(x), x, nominal)
        believed, u_0 = G_r @ E, solved(E, u_0 - alpha)
    inverse, size = np.linalg.inv(believed), np.linalg.norm(believed, axis=(-2, -1))[1:]
    distance = np.linalg.norm(z[1:], axis=-1)
    equations, still = error.system.equations, error.raised_along([0.0] * len(x), nominal)
    slopes = error.slopes(x, nominal)
    units = np.diag(uncertainty.wrench)[np.array(uncertainty.wrench) != 0]
    for plant in _family(nominal.plant, uncertainty.scales):
        motion = error.moved_by(equations, x, plant, slopes, still)
        (held, *rest), steered = surface_rate(motion, z, G, S, u_0)
        R = (steered @ inverse)[1:]
        r = np.minimum(authority(R), authority_together(R))
        if not np.all(r > 1e-9):
            worst = int(np.argmin(np.where(np.isnan(r), -np.inf, r)))
            raise GainError(
                f"{error.system.name}: the input gain of a declared plant is {r[worst]:g} of the "
                f"nominal one at z = {z[1 + worst]}; no switching gain can make up for that"
            )
        reach = r * size
        shares = (np.array(rest) - held) / (reach * distance)[:, None]
        pushed = np.abs(held) + np.zeros_like(shares)
        for w in units:
            everywhere = np.tile(w, (len(x), 1))
            away = error.pushed_by(equations, x, plant, everywhere, slopes)
            pushed += np.abs(times(G, away))[1:]
        gamma0 = max(gamma0, float((np.linalg.norm(pushed, axis=-1) / reach).max()))
        # Near z = 0 the mismatch is linear in z: its largest share is the norm of its slope.
        near = float(np.linalg.norm(shares[: error.size], 2))
        gamma1 = max(gamma1, near, float(np.linalg.norm(shares, axis=-1).max()))
        least = min(least, float(r.min()))
    # Rounding is no mismatch.
    gamma0, gamma1 = (value if value > _ROUNDING else 0.0 for value in (gamma0, gamma1))
    return SwitchingGains(uncertainty.reaching_rate / least, gamma0, gamma1, least)


def authority(R: Array) -> Any:
    """What a true input gain leaves of a switching term: the least row of R, by dominance.

    With s' = push - rho R sgn(s), each entry of s is driven back by
    rho (R_ii - sum_j |R_ij|) at least. For one input it is r = E*/E.

    Args:
        R: (G_r E*) (G_r E)^-1, of the true plant and of the law's model, (..., m, m).

    Returns:
        One number for each matrix, (...).
    """
    diagonal = np.diagonal(R, axis1=-2, axis2=-1)
    return (diagonal - (np.abs(R).sum(axis=-1) - np.abs(diagonal))).min(axis=-1)


def authority_together(R: Array) -> Any:
    """The same of a term along s/|s| instead of one for each entry: s' R s >= r |s|^2.

    Args:
        R: As above, (..., m, m).

    Returns:
        One number for each matrix, (...).
    """
    return np.linalg.eigvalsh((R + np.swapaxes(R, -2, -1)) / 2).min(axis=-1)


def _refuse_unknown(error: ErrorCoordinates, nominal: Any, uncertainty: Uncertainty) -> None:
    """Refuse an uncertainty that is not of this system, and a reference that moves.

    Raises:
        GainError: If so.
    """
    name = error.system.name
    counts = {
        "bounds of the operating region": (len(uncertainty.region), error.size),
        "wrench components": (len(uncertainty.wrench), len(error.system.equations.w)),
    }
    for what, (given, needed) in counts.items():
        if given != needed:
            raise GainError(f"{name}: the uncertainty has {given} {what}, must have {needed}")
    known = [each.name for each in fields(nominal.plant)]
    for scaled in uncertainty.scales:
        require_known(f"parameter of {name}", scaled, known, error=GainError)
    if getattr(error.reference, "moves", False):
        raise GainError(
            f"{name}: the reference moves: a bound in |z| cannot cover that; give k and epsilon "
            "instead"
        )


def _family(nominal: Any, scales: Mapping[str, tuple[float, float]]) -> list[Any]:
    """Parameters of the grid of declared plants."""
    axes = [np.linspace(low, high, _SCALES).tolist() for low, high in scales.values()]
    return [
        replace(nominal, **{n: getattr(nominal, n) * k for n, k in zip(scales, point, strict=True)})
        for point in itertools.product(*axes)
    ]


def _states(region: tuple[float, ...]) -> list[Array]:
    """A step along each axis next to the origin, then the grid of error states without it."""
    points = round(_STATES ** (1 / len(region))) // 2 * 2 + 1  # odd, so that it has the axes
    axes = [np.linspace(-bound, bound, points) for bound in region]
    grid = [np.array(z) for z in itertools.product(*axes) if any(z)]
    return [*(_NEAR * np.eye(len(region))), *grid]

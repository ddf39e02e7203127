"""Switching laws: what drives s to zero and holds it there, sampled every h.

Each makes a desired rate phi of s, for s' = phi + w, from s, the proportional gain k and the
switching gain rho of its sample. The chapter's is ``Sign``; the others do without its chatter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache, partial
from typing import Any, ClassVar

import numpy as np

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.control.memory import SurfaceMemory
from grosmc_mj.errors import GainError
from grosmc_mj.jitable import jitable
from grosmc_mj.vectors import Vector, each, norm

# Jitable (s, k, rho, memory, q) -> phi: memory has been brought up to this sample by the
# surface, and q is the switching law itself, with its numbers.
Reach = Callable[[Any, float, float, Any, Any], Vector]


@jitable
def sgn(s: float) -> float:
    """The sign function as printed: -1, 0 or 1."""
    if s > 0.0:
        return 1.0
    return -1.0 if s < 0.0 else 0.0


@jitable
def sat(s: float) -> float:
    """s, kept between -1 and 1."""
    return min(1.0, max(-1.0, s))


@dataclass(frozen=True)
class Switching:
    """A switching law with its numbers.

    Attributes:
        gain: Factor on the law's switching gain rho.
    """

    gain: float = 1.0

    # Name on the command line, the memory it needs, and what makes it for m inputs.
    name: ClassVar[str] = ""
    memory: ClassVar[type[SurfaceMemory]] = SurfaceMemory

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (math.isfinite(value) and (value > 0 or (item.name == "gain" and value == 0))):
                raise GainError(f"{self.name}: {item.name} = {value:g} must be finite and positive")

    def reach(self, m: int) -> Reach:
        """The law for m inputs."""
        raise NotImplementedError

    def new_memory(self, m: int, n: int) -> Callable[[], SurfaceMemory]:
        """Makes the memory of a new run, for m inputs and n entries of z."""
        return partial(_new_memory, self, m, n)


def _new_memory(law: Switching, m: int, n: int) -> SurfaceMemory:
    """Memory with room for m inputs and n entries of z."""
    memory = law.memory(z0=np.zeros(n))
    for name in ("v", "s", "integral", "rate", *_own_rows(law.memory)):
        setattr(memory, name, np.zeros(m))
    if isinstance(law, Adaptive) and isinstance(memory, AdaptiveMemory):
        memory.adapted[:] = law.least
    return memory


def _own_rows(kind: type[SurfaceMemory]) -> list[str]:
    """Fields that a switching law adds to the surface's memory; all are (m,)."""
    known = {item.name for item in fields(SurfaceMemory)}
    return [item.name for item in fields(kind) if item.name not in known]


@dataclass(frozen=True)
class Sign(Switching):
    """phi = -(k s + rho sgn s), the chapter's; |s| stays in a band of the order h, chattering."""

    name: ClassVar[str] = "sign"

    def reach(self, m: int) -> Reach:
        """Each entry of s on its own, as printed."""
        return _relay(m)


@cache
def _relay(m: int) -> Reach:
    entry = each(m, lambda i, s, k, rho: -(k * s[i] + rho * sgn(s[i])))

    @jitable
    def reach(s: Any, k: float, rho: float, memory: Any, q: Any) -> Vector:
        return entry(s, k, q.gain * rho)

    return reach


@dataclass(frozen=True)
class UnitVector(Switching):
    """phi = -(k s + rho s/|s|): one switch for all inputs, the sign law's for one."""

    name: ClassVar[str] = "unit-vector"

    def reach(self, m: int) -> Reach:
        """All entries of s together."""
        return _unit_vector(m)


@cache
def _unit_vector(m: int) -> Reach:
    entry = each(m, lambda i, s, scale: -scale * s[i])

    @jitable
    def reach(s: Any, k: float, rho: float, memory: Any, q: Any) -> Vector:
        size = norm(s)
        return entry(s, k + q.gain * rho / size if size > 0.0 else k)

    return reach


@dataclass(frozen=True)
class BoundaryLayer(Switching):
    """phi = -(k s + rho sat(s/layer)): |s| <= layer W/rho under |w| <= W.

    Attributes:
        width: The layer's thickness over h gain rho, what the law moves s by in a sample; above
            0.5, or it chatters like sgn.
    """

    width: float = 2.0
    name: ClassVar[str] = "boundary-layer"

    def reach(self, m: int) -> Reach:
        """Each entry of s on its own."""
        return _boundary_layer(m)


@cache
def _boundary_layer(m: int) -> Reach:
    entry = each(m, lambda i, s, k, rho, layer: -(k * s[i] + rho * sat(s[i] / layer)))

    @jitable
    def reach(s: Any, k: float, rho: float, memory: Any, q: Any) -> Vector:
        # At the first sample s is zero, whatever the layer.
        layer = q.width * memory.elapsed * q.gain * rho
        return entry(s, k, q.gain * rho, layer if layer > 0.0 else 1.0)

    return reach


@jitable
def _implicit(s: float, k: float, rho: float, h: float) -> float:
    """phi of the implicit Euler step s+ = s + h (-k s+ - rho sgn(s+)), in closed form."""
    if h == 0.0:
        return 0.0
    after = sgn(s) * max(abs(s) - h * rho, 0.0) / (1.0 + h * k)
    return (after - s) / h


@dataclass(frozen=True)
class Implicit(Switching):
    """The sign law by implicit Euler (Acary, Brogliato): no chatter but the disturbance's own.

    |s| <= h W under |w| <= W < rho.
    """

    name: ClassVar[str] = "implicit"

    def reach(self, m: int) -> Reach:
        """Each entry of s on its own."""
        return _implicit_euler(m)


@cache
def _implicit_euler(m: int) -> Reach:
    entry = each(m, lambda i, s, k, rho, h: _implicit(s[i], k, rho, h))

    @jitable
    def reach(s: Any, k: float, rho: float, memory: Any, q: Any) -> Vector:
        return entry(s, k, q.gain * rho, memory.elapsed)

    return reach


@dataclass(frozen=True)
class ImplicitUnitVector(Switching):
    """The unit-vector law by implicit Euler: s+ = s max(1 - h rho/|s|, 0) / (1 + h k)."""

    name: ClassVar[str] = "implicit-unit-vector"

    def reach(self, m: int) -> Reach:
        """All entries of s together."""
        return _implicit_unit_vector(m)


@cache
def _implicit_unit_vector(m: int) -> Reach:
    entry = each(m, lambda i, s, scale: scale * s[i])

    @jitable
    def reach(s: Any, k: float, rho: float, memory: Any, q: Any) -> Vector:
        size, h = norm(s), memory.elapsed
        if h == 0.0 or size == 0.0:
            return entry(s, 0.0)
        kept = max(1.0 - h * q.gain * rho / size, 0.0) / (1.0 + h * k)
        return entry(s, (kept - 1.0) / h)

    return reach


def _row() -> Array:
    return np.zeros(1)


@dataclass
class EstimateMemory(SurfaceMemory):
    """What the estimate of w needs of the sample before.

    Attributes:
        before: s then, (m,).
        phi: What was asked for then, (m,).
    """

    before: Array = field(default_factory=_row)
    phi: Array = field(default_factory=_row)


@dataclass(frozen=True)
class ImplicitEstimate(Switching):
    """The implicit law less an estimate of w from the last sample: |s| <= h^2 L, |w'| <= L.

    With an input gain r times the believed one its linear zone is z^2 - 2 (1 - r) z + (1 - r),
    stable for 0 < r < 4/3 only, a third of what the plain implicit law stands beyond 1; from
    r = 2 on the estimate itself diverges.
    """

    name: ClassVar[str] = "implicit-estimate"
    memory: ClassVar[type[SurfaceMemory]] = EstimateMemory

    def reach(self, m: int) -> Reach:
        """Each entry of s on its own."""
        return _implicit_estimate(m)


@cache
def _implicit_estimate(m: int) -> Reach:
    def entry(i: int, s: Any, k: float, rho: float, memory: Any) -> float:
        h = memory.elapsed
        if h == 0.0:
            return 0.0
        w = (s[i] - memory.before[i]) / h - memory.phi[i]
        return _implicit(s[i], k, rho, h) - w

    desired = each(m, entry)

    @jitable
    def reach(s: Any, k: float, rho: float, memory: Any, q: Any) -> Vector:
        phi = desired(s, k, q.gain * rho, memory)
        for i in range(m):
            memory.before[i] = s[i]
            memory.phi[i] = phi[i]
        return phi

    return reach


@dataclass
class TwistingMemory(SurfaceMemory):
    """Memory of the super-twisting law.

    Attributes:
        twist: Its integral, (m,).
    """

    twist: Array = field(default_factory=_row)


@dataclass(frozen=True)
class SuperTwisting(Switching):
    """phi = -(k s + k1 sqrt|s| sgn s) + z, z' = -k2 sgn s; k1 = 1.5 sqrt L, k2 = 1.1 L.

    Continuous, and |s| is of the order h^2 under |w'| <= L. Its gain is L, not rho.

    Attributes:
        slope: L, the bound of |w'|, in the unit of s per second squared. What a law without
            reaching phase meets at once, a load or a wrong inertia at t = 0, is made up for the
            sooner the larger L is; the law's own ripple is 1.1 L h.
    """

    slope: float = 100.0
    name: ClassVar[str] = "super-twisting"
    memory: ClassVar[type[SurfaceMemory]] = TwistingMemory

    def reach(self, m: int) -> Reach:
        """Each entry of s on its own."""
        return _super_twisting(m)


@cache
def _super_twisting(m: int) -> Reach:
    entry = each(
        m,
        lambda i, s, k, k1, memory: (
            memory.twist[i] - k * s[i] - k1 * math.sqrt(abs(s[i])) * sgn(s[i])
        ),
    )

    @jitable
    def reach(s: Any, k: float, rho: float, memory: Any, q: Any) -> Vector:
        phi = entry(s, k, 1.5 * math.sqrt(q.gain * q.slope), memory)
        for i in range(m):
            memory.twist[i] -= memory.elapsed * 1.1 * q.gain * q.slope * sgn(s[i])
        return phi

    return reach


@dataclass
class AdaptiveMemory(SurfaceMemory):
    """Memory of the adaptive law.

    Attributes:
        adapted: Its gain, in the unit of s per second, (m,).
    """

    adapted: Array = field(default_factory=_row)


@dataclass(frozen=True)
class Adaptive(Switching):
    """phi = -(k s + epsilon(t) sgn s), epsilon' = c |s| sgn(|s| - mu), mu = 4 epsilon h.

    After Plestan: the gain grows until it holds s and falls while s is inside mu, so it hunts
    about what is needed instead of being told. It never falls below ``least``.

    Attributes:
        share: c h^2. Within mu the gain then changes by up to four times this part of it in a
            sample: slower, it lags behind w; faster, it rings.
        least: Smallest gain, in the unit of s per second.
    """

    share: float = 0.02
    least: float = 1e-2
    name: ClassVar[str] = "adaptive"
    memory: ClassVar[type[SurfaceMemory]] = AdaptiveMemory

    def reach(self, m: int) -> Reach:
        """Each entry of s on its own."""
        return _adaptive(m)


@cache
def _adaptive(m: int) -> Reach:
    entry = each(
        m, lambda i, s, k, gain, memory: -(k * s[i] + gain * memory.adapted[i] * sgn(s[i]))
    )

    @jitable
    def reach(s: Any, k: float, rho: float, memory: Any, q: Any) -> Vector:
        h = memory.elapsed
        if h > 0.0:
            for i in range(m):
                band = 4.0 * q.gain * memory.adapted[i] * h
                grown = memory.adapted[i] + q.share * abs(s[i]) / h * sgn(abs(s[i]) - band)
                memory.adapted[i] = max(grown, q.least)
        return entry(s, k, q.gain, memory)

    return reach


SWITCHINGS: Mapping[str, type[Switching]] = {
    kind.name: kind
    for kind in (
        Sign,
        BoundaryLayer,
        Implicit,
        ImplicitEstimate,
        SuperTwisting,
        Adaptive,
        UnitVector,
        ImplicitUnitVector,
    )
}


def find_switching(name: str) -> Switching:
    """The switching law of that name, with its default numbers.

    Raises:
        GainError: If there is none.
    """
    require_known("switching law", name, SWITCHINGS, error=GainError)
    return SWITCHINGS[name]()

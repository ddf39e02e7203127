"""Switching laws, which drive s to zero and hold it there, sampled every h.

Each is a function ``(s, k, rho, memory, q, phi)`` that writes phi (m,), the rate asked of s in
s' = phi + w, where w is the disturbance of s:

- s (m,): sliding variable;
- k, rho: proportional and switching gain of this sample;
- memory: a ``SurfaceMemory`` that the surface has brought up to this sample (h is
  ``memory.elapsed``), with further fields of the switching law;
- q: its ``SwitchingNumbers``.

The chapter's law is ``sign``; the others do without its chatter. A new law is a function here and
a ``SwitchingKind`` in ``SWITCHINGS``, which says what it reads and remembers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Any, NamedTuple

import numpy as np

from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import GainError
from grosmc_mj.ground.fields import checked, range_of
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.matrices import norm
from grosmc_mj.theory.control.memory import SurfaceMemory, memory_of, vector

# (s, k, rho, memory, q, phi), see above.
SwitchingTerm = Callable[[Any, float, float, Any, Any, Any], None]


@checked(GainError)
class SwitchingNumbers:
    """Numbers of the switching laws; each law reads its own.

    Attributes:
        gain: Factor on the law's switching gain rho.
        width: Thickness of the boundary layer over h gain rho, the most that the law moves s by
            in a sample; above 0.5, or it chatters like sgn.
        slope: L of the super-twisting law, the bound of |w'|, in the unit of s per second squared.
            A load or a wrong inertia is there at t = 0, without a reaching phase: the larger L,
            the sooner it is made up for. The law's own ripple is 1.1 L h.
        share: c h^2 of the adaptive law. Within mu the gain changes by up to four times this share
            of itself in a sample: with less it lags behind w, with more it rings.
        least: Smallest gain of the adaptive law, in the unit of s per second.
    """

    gain: Annotated[
        float,
        LawNumber(low=0, meaning="factor on the law's switching gain rho", search=(0.1, 10)),
    ] = 1.0
    width: Annotated[
        float,
        LawNumber(
            low=0,
            above=True,
            meaning="thickness of the boundary layer over h gain rho, the most that the law moves "
            "s by in a sample",
            search=(0.6, 50),
        ),
    ] = 2.0
    slope: Annotated[
        float,
        LawNumber(
            low=0,
            above=True,
            meaning="L, the bound of |w'|, in the unit of s per second squared",
            search=(1, 1e5),
        ),
    ] = 100.0
    share: Annotated[
        float,
        LawNumber(
            low=0,
            above=True,
            meaning="c h^2, the growth of the gain over |s| in a sample",
            search=(1e-3, 0.2),
        ),
    ] = 0.02
    least: Annotated[
        float,
        LawNumber(
            low=0,
            above=True,
            meaning="smallest gain, in the unit of s per second",
            search=(1e-4, 1),
        ),
    ] = 1e-2


@dataclass
class EstimateMemory(SurfaceMemory):
    """Memory of the implicit law with an estimate of w, see ``implicit_estimate``.

    Attributes:
        before: Sliding variable at the last sample, in the law's unit of s, (m,).
    """

    before: Array = vector("m")


@dataclass
class TwistMemory(SurfaceMemory):
    """Memory of the super-twisting law.

    Attributes:
        twist: Integral of the law, in the unit of s per second, (m,).
    """

    twist: Array = vector("m")


@dataclass
class AdaptedMemory(SurfaceMemory):
    """Memory of the adaptive law.

    Attributes:
        adapted: Switching gain of each sliding variable, in the unit of s per second, (m,).
    """

    adapted: Array = vector("m")


@dataclass(frozen=True)
class SwitchingKind:
    """A kind of switching law.

    Attributes:
        reach: Function that writes phi.
        reads: The fields of ``SwitchingNumbers`` that it reads.
        memory: Class of its memory, if it has more of it than the surface.
    """

    reach: SwitchingTerm
    reads: tuple[str, ...] = ("gain",)
    memory: type[SurfaceMemory] = SurfaceMemory

    @property
    def numbers(self) -> Mapping[str, LawNumber]:
        """Its numbers by their keys."""
        return {name: number for name, number in _declared().items() if name in self.reads}


# Reading types is slow, and each number of a law is asked for often.
@cache
def _declared() -> Mapping[str, LawNumber]:
    """Return the numbers of all switching laws by their keys."""
    numbers = {}
    for item in fields(SwitchingNumbers):
        number = range_of(SwitchingNumbers, item.name)
        assert isinstance(number, LawNumber)
        numbers[item.name] = number
    return numbers


class Switching(NamedTuple):
    """A switching law with its numbers, by ``find_switching``.

    Attributes:
        name: Its name in ``SWITCHINGS``.
        numbers: Its numbers.
    """

    name: str
    numbers: SwitchingNumbers

    @property
    def reach(self) -> SwitchingTerm:
        """Function that writes phi."""
        return SWITCHINGS[self.name].reach

    def new_memory(self, m: int, n: int) -> Callable[[], Any]:
        """Return the function that makes the memory of a new run.

        Args:
            m: Number of inputs.
            n: Number of entries of z.
        """
        kind = SWITCHINGS[self.name].memory
        initial = {}
        if kind is AdaptedMemory:
            initial["adapted"] = np.full(m, self.numbers.least)
        return memory_of(kind, initial, m=m, n=n)


@jitable
def sgn(s: float) -> float:
    """The sign function as printed: -1, 0 or 1."""
    if s > 0.0:
        return 1.0
    return -1.0 if s < 0.0 else 0.0


@jitable
def _implicit(
    s: float,
    k: float,
    rho: float,
    h: float,
) -> float:
    """phi of the implicit Euler step s+ = s + h (-k s+ - rho sgn(s+)), in closed form."""
    if h == 0.0:
        return 0.0
    size = max(abs(s) - h * rho, 0.0)
    next_s = sgn(s) * size / (1.0 + h * k)
    return (next_s - s) / h


def sign(
    s: Any,
    k: float,
    rho: float,
    memory: Any,
    q: Any,
    phi: Any,
) -> None:
    """phi = -(k s + rho sgn s), as printed: it chatters, with |s| in a band of the order h."""
    for i in range(len(s)):
        switched = q.gain * rho * sgn(s[i])
        phi[i] = -(k * s[i] + switched)


def boundary_layer(
    s: Any,
    k: float,
    rho: float,
    memory: Any,
    q: Any,
    phi: Any,
) -> None:
    """phi = -(k s + rho sat(s/layer)): |s| <= layer W/rho under |w| <= W."""
    layer = q.width * memory.elapsed * q.gain * rho
    # At the first sample no time has passed; s is zero, so any layer will do.
    if not layer > 0.0:
        layer = 1.0
    for i in range(len(s)):
        switched = q.gain * rho * min(1.0, max(-1.0, s[i] / layer))
        phi[i] = -(k * s[i] + switched)


def implicit(
    s: Any,
    k: float,
    rho: float,
    memory: Any,
    q: Any,
    phi: Any,
) -> None:
    """Sign law by implicit Euler (Acary, Brogliato): phi moves only as the disturbance does.

    s+ = sgn(s) max(|s| - h rho, 0)/(1 + h k), phi = (s+ - s)/h; |s| <= h W under |w| <= W < rho.
    """
    for i in range(len(s)):
        phi[i] = _implicit(s[i], k, q.gain * rho, memory.elapsed)


def implicit_estimate(
    s: Any,
    k: float,
    rho: float,
    memory: Any,
    q: Any,
    phi: Any,
) -> None:
    """Implicit law less an estimate of w from the last sample: |s| <= h^2 L under |w'| <= L.

    With an input gain of r times the nominal one, the characteristic polynomial of its linear zone
    is z^2 - 2 (1 - r) z + (1 - r), stable for 0 < r < 4/3 only; the plain implicit law is stable up
    to r = 2. From r = 2 on the estimate itself diverges.
    """
    h = memory.elapsed
    for i in range(len(s)):
        w = 0.0
        if h > 0.0:
            w = (s[i] - memory.before[i]) / h - memory.phi[i]
        memory.before[i] = s[i]
        phi[i] = _implicit(s[i], k, q.gain * rho, h) - w


def super_twisting(
    s: Any,
    k: float,
    rho: float,
    memory: Any,
    q: Any,
    phi: Any,
) -> None:
    """phi = -(k s + k1 sqrt|s| sgn s) + z, z' = -k2 sgn s; k1 = 1.5 sqrt L, k2 = 1.1 L.

    Continuous, and |s| is of the order h^2 under |w'| <= L. Its gain is L, not rho.
    """
    k1 = 1.5 * math.sqrt(q.gain * q.slope)
    twist = memory.twist
    for i in range(len(s)):
        side = sgn(s[i])
        root = math.sqrt(abs(s[i]))
        phi[i] = twist[i] - k * s[i] - k1 * root * side
        twist[i] -= memory.elapsed * 1.1 * q.gain * q.slope * side


def adaptive(
    s: Any,
    k: float,
    rho: float,
    memory: Any,
    q: Any,
    phi: Any,
) -> None:
    """phi = -(k s + epsilon(t) sgn s), epsilon' = c |s| sgn(|s| - mu), mu = 4 epsilon h.

    After Plestan: the gain grows until it holds s and falls while |s| is below mu, so that it
    hunts about the gain that is needed. It never falls below ``least``.
    """
    h = memory.elapsed
    epsilon = memory.adapted
    for i in range(len(s)):
        if h > 0.0:
            band = 4.0 * q.gain * epsilon[i] * h
            direction = sgn(abs(s[i]) - band)
            changed = epsilon[i] + q.share * abs(s[i]) / h * direction
            epsilon[i] = max(changed, q.least)
        switched = q.gain * epsilon[i] * sgn(s[i])
        phi[i] = -(k * s[i] + switched)


def unit_vector(
    s: Any,
    k: float,
    rho: float,
    memory: Any,
    q: Any,
    phi: Any,
) -> None:
    """phi = -(k s + rho s/|s|): one switch for all inputs; for one input it is the sign law."""
    size = norm(s)
    scale = k
    if size > 0.0:
        scale = k + q.gain * rho / size
    for i in range(len(s)):
        phi[i] = -scale * s[i]


def implicit_unit_vector(
    s: Any,
    k: float,
    rho: float,
    memory: Any,
    q: Any,
    phi: Any,
) -> None:
    """Unit-vector law by implicit Euler: s+ = s max(1 - h rho/|s|, 0) / (1 + h k)."""
    h = memory.elapsed
    size = norm(s)
    scale = 0.0
    if h > 0.0 and size > 0.0:
        share = max(1.0 - h * q.gain * rho / size, 0.0)
        remaining = share / (1.0 + h * k)
        scale = (remaining - 1.0) / h
    for i in range(len(s)):
        phi[i] = scale * s[i]


SWITCHINGS: Mapping[str, SwitchingKind] = {
    "sign": SwitchingKind(sign),
    "boundary-layer": SwitchingKind(boundary_layer, ("gain", "width")),
    "implicit": SwitchingKind(implicit),
    "implicit-estimate": SwitchingKind(implicit_estimate, memory=EstimateMemory),
    "super-twisting": SwitchingKind(super_twisting, ("gain", "slope"), TwistMemory),
    "adaptive": SwitchingKind(adaptive, ("gain", "share", "least"), AdaptedMemory),
    "unit-vector": SwitchingKind(unit_vector),
    "implicit-unit-vector": SwitchingKind(implicit_unit_vector),
}


def find_switching(name: str, **numbers: float) -> Switching:
    """Switching law by its name.

    Args:
        name: A key of ``SWITCHINGS``.
        numbers: Fields of ``SwitchingNumbers``; all other fields keep their defaults.

    Raises:
        GainError: If there is none, or a number does not fit.
    """
    require_known("switching law", name, SWITCHINGS, error=GainError)
    return Switching(name, SwitchingNumbers(**numbers))

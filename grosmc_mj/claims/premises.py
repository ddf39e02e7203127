"""The premises of the chapter's theorems, over the declared operating region and along each run."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.claims.balance import Balance, balance
from grosmc_mj.claims.laboratory import Laboratory
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.references import Sine
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.trajectory import Status, Trajectory
from grosmc_mj.validation.cases import Case
from grosmc_mj.validation.designs import PENDULUM_REGION, SERVO_UNCERTAINTY

# Where the premises are computed, |z1| and |z2|: what the gains were declared for and, for the
# arm, whose gains are printed, what its own start and reference span.
REGIONS: Mapping[str, tuple[float, float]] = {
    "servo": SERVO_UNCERTAINTY.region,
    "cart_pendulum": PENDULUM_REGION,
    "arm": (0.5, 1.5),
}
_GRID, _PHASES, _EVERY = 13, 16, 5
# s(0), the rank of numbers and the like hold to rounding.
_ROUNDING = 1e-9


class Point(NamedTuple):
    """Where something was found: time [s], state and value."""

    t: float
    x: tuple[float, ...]
    value: float


@dataclass(frozen=True)
class Reading:
    """A premise at many points.

    Attributes:
        worst: The point of the least margin.
        margin: Positive where it holds, in the premise's unit.
        violated: Part of the points, or of the time, at which it does not hold.
    """

    worst: Point
    margin: float
    violated: float


@dataclass(frozen=True)
class Premise:
    """One premise of one law in one case.

    Attributes:
        name: Short name.
        source: Assumption or theorem.
        requirement: In words.
        unit: Of the margins.
        region: Over the operating region; None if it has no meaning there.
        along: Along the run; None if it has no meaning there.
        restores: The smallest gain that restores it, in words; empty if it holds.
        note: What to know.
    """

    name: str
    source: str
    requirement: str
    unit: str
    region: Reading | None
    along: Reading | None
    restores: str = ""
    note: str = ""

    @property
    def holds(self) -> bool:
        """Whether it holds in the region and along the run."""
        readings = [each for each in (self.region, self.along) if each is not None]
        return all(reading.margin >= 0 for reading in readings)


@dataclass(frozen=True)
class Audit:
    """All premises of a law in a case.

    Attributes:
        case: The case.
        controller: Name of the controller.
        premises: In the order of the theory.
        signals: Along the run, for figures: time, required and configured |u_d|.
    """

    case: Case
    controller: str
    premises: tuple[Premise, ...]
    signals: Mapping[str, Array] = field(default_factory=dict)

    def failed(self) -> list[Premise]:
        """Those that do not hold."""
        return [premise for premise in self.premises if not premise.holds]


def audit(lab: Laboratory, case: Case, controller: str = "grosmc") -> Audit:
    """Compute the premises of a law for a case, on physics."""
    return lab.once(("audit", case, controller), lambda: _audit(lab, case, controller))


def _audit(lab: Laboratory, case: Case, name: str) -> Audit:
    """The premises, one by one."""
    law = lab.controller(case, "physics", name)
    run = lab.run(case, "physics", name).trajectory
    true = lab.equations(case, "physics")
    amplitude = _largest_wrench(lab, case)
    here = list(_region(law, true, case, amplitude))
    rows = range(0, len(run.time) - 1, _EVERY)
    there = []
    for row in rows:
        t, x = float(run.time[row]), run.state[row]
        w = np.zeros(6 * len(true.system.bodies)) if run.wrench is None else run.wrench[row]
        there.append((t, x, balance(law, true, t, x, w)))
    premises = [
        *_linear(law),
        _decoupling(law, here, there),
        _matched(here, there),
        _sign(here, there),
    ]
    if name == "grosmc":
        premises += [_gain(law, here, there), _start(run.sliding)]
    premises.append(_met(run, law))
    signals = {
        "time": np.array([t for t, _, _ in there]),
        "required": np.array([found.required for _, _, found in there]),
        "configured": np.array([found.configured for _, _, found in there]),
    }
    return Audit(case, name, tuple(premises), signals)


_Points = list[tuple[float, Array, Balance]]


def _region(
    law: Controller, true: AnalyticPlant, case: Case, amplitude: Array
) -> Iterator[tuple[float, Array, Balance]]:
    """The balance over the operating region, with the case's wrench at either bound."""
    error, system = law.error, true.system
    assert error is not None
    bound = REGIONS[case.system]
    axes = [np.linspace(-size, size, _GRID) for size in bound]
    moving = isinstance(law.parameters.reference, Sine)
    times = np.linspace(0, 2, _PHASES, endpoint=False) if moving else np.array([0.0])
    signs = (-1.0, 1.0) if amplitude.any() else (0.0,)
    for t, z1, z2, sign in itertools.product(times.tolist(), *axes, signs):
        y_r, dy_r, _ = error.reference(t, law.parameters.reference)
        x = np.zeros(len(system.states))
        x[system.output] = y_r + error.sign * z1
        x[system.output + system.degrees_of_freedom] = dy_r + error.sign * z2
        if abs(x[system.output]) > system.position_bound or not system.linearizable(x):
            continue
        yield t, x, balance(law, true, t, x, sign * amplitude)


def _largest_wrench(lab: Laboratory, case: Case) -> Array:
    """The largest value of each component of the case's wrenches, with its sign."""
    run = lab.run(case, "physics", "grosmc").trajectory
    if run.wrench is None:
        return np.zeros(6 * len(run.system.bodies))
    rows = np.abs(run.wrench).argmax(axis=0)
    return run.wrench[rows, range(run.wrench.shape[1])]


def _reading(points: _Points, margins: Iterable[float]) -> Reading:
    """The least margin of many points."""
    values = np.array(list(margins))
    worst = int(values.argmin())
    t, x, _ = points[worst]
    return Reading(
        Point(t, tuple(np.asarray(x, float).tolist()), float(values[worst])),
        float(values[worst]),
        float(np.mean(values < 0)),
    )


def _single(margin: float) -> Reading:
    """A margin that has no place and no time."""
    return Reading(Point(math.nan, (), margin), margin, float(margin < 0))


def _linear(law: Controller) -> list[Premise]:
    """Assumption 1 and G B, of the law's linear model."""
    assert law.lqr is not None
    A, B = law.lqr.A, law.lqr.B
    reach = np.hstack([B, A @ B])
    values = np.linalg.svd(reach, compute_uv=False)
    found = [
        Premise(
            "controllability",
            "Assumption 1",
            "rank [B, AB] = 2: smallest over largest singular value above rounding",
            "1",
            _single(float(values[-1] / values[0]) - _ROUNDING),
            None,
            note=f"rank {np.linalg.matrix_rank(reach)} of 2",
        )
    ]
    p: Any = law.parameters
    if hasattr(p, "GB"):
        share = abs(p.GB) / float(np.linalg.norm(p.G) * np.linalg.norm(B))
        found.append(
            Premise(
                "G B nonsingular",
                "eqs. (8), (31), (51)",
                "|GB| / (|G| |B|) above rounding",
                "1",
                _single(share - _ROUNDING),
                None,
                note=f"G B = {p.GB:.4g}",
            )
        )
    return found


def _decoupling(law: Controller, here: _Points, there: _Points) -> Premise:
    """Relative degree two: E(x) of eq. (21) keeps away from zero."""
    assert law.error is not None
    x0 = np.zeros(len(law.error.system.states))
    scale = abs(law.error.dynamics(0.0, x0, law.parameters)[1])
    return Premise(
        "relative degree 2",
        "eqs. (21)-(23), Assumption 7",
        "decoupling matrix |E(x)| / |E(0)| above rounding",
        "1",
        _reading(here, (abs(each.decoupling) / scale - _ROUNDING for _, _, each in here)),
        _reading(there, (abs(each.decoupling) / scale - _ROUNDING for _, _, each in there)),
    )


def _matched(here: _Points, there: _Points) -> Premise:
    """The uncertainty enters where the input does."""
    matched = max(abs(each.push) for _, _, each in [*here, *there])
    return Premise(
        "matching",
        "Assumptions 3, 5 and 9",
        "no uncertainty in z1' (it is z2 by kinematics)",
        "rad/s",
        _reading(here, (_ROUNDING - each.unmatched for _, _, each in here)),
        _reading(there, (_ROUNDING - each.unmatched for _, _, each in there)),
        note=f"the matched part of z1'' reaches {matched:.3g} rad/s²; in mechanics this holds by "
        "kinematics for the output, not for coordinates that the law does not see, such as a cart",
    )


def _sign(here: _Points, there: _Points) -> Premise:
    """The input pushes the way that the law believes."""
    ratios = [each.gain_ratio for _, _, each in [*here, *there]]
    return Premise(
        "input gain",
        "implied by Assumptions 3 and 5",
        "r = E_true/E_nominal positive",
        "1",
        _reading(here, (each.gain_ratio - _ROUNDING for _, _, each in here)),
        _reading(there, (each.gain_ratio - _ROUNDING for _, _, each in there)),
        note=f"r from {min(ratios):.3g} to {max(ratios):.3g}",
    )


def _gain(law: Controller, here: _Points, there: _Points) -> Premise:
    """The switching gain covers what pushes s away, with the input gain's uncertainty counted."""
    everywhere = [*here, *there]
    p: Any = law.parameters
    unit = law.error.system.input.unit if law.error else ""
    if hasattr(p, "epsilon"):
        region, along = (
            max(each.required * abs(p.GB * each.decoupling) for _, _, each in points)
            for points in (here, there)
        )
        name, source = "epsilon", "Theorem 3: ε >= (a_m + d_m) ‖GB‖"
        restores = (
            f"ε = {along:.3g} along the run and {region:.3g} over the region, "
            f"instead of {p.epsilon:.3g}"
        )
    else:
        needed = max(_times(each) for _, _, each in everywhere)
        name, source = "switching gain", "Assumptions 4 and 6, eqs. (12), (37)"
        restores = f"η, γ0 and γ1 {needed:.3g} times as large"
        if math.isinf(needed):
            eta = max(each.required * abs(_steered(law, each)) for _, _, each in everywhere)
            restores = f"η = {eta:.3g}; there is no gain to multiply"
    found = Premise(
        name,
        source,
        "configured |u_d| at least the required |push / E_true|",
        unit,
        _reading(here, (each.configured - each.required for _, _, each in here)),
        _reading(there, (each.configured - each.required for _, _, each in there)),
        note=f"required at most {max(each.required for _, _, each in everywhere):.3g} {unit}",
    )
    if found.holds:
        return found
    return replace(found, restores=restores)


def _steered(law: Controller, found: Balance) -> float:
    """What eta is divided by in the laws (12) and (37)."""
    p: Any = law.parameters
    return p.GB * found.decoupling if law.linearizing else p.GB


def _times(found: Balance) -> float:
    """How many times the configured gain is required; none is enough of no gain at all."""
    if found.configured == 0:
        return math.inf if found.required else 0.0
    return found.required / found.configured


def _start(sliding: Array | None) -> Premise:
    """There is no reaching phase: s(0) = 0."""
    start = math.nan if sliding is None or not len(sliding) else abs(float(sliding[0]))
    return Premise(
        "s(0) = 0", "eqs. (8), (31), (51)", "|s(0)| zero to rounding", "1", None,
        _single(_ROUNDING - start),
    )  # fmt: skip


def _met(run: Trajectory, law: Controller) -> Premise:
    """No singular state was met and the actuator gave what it was asked for."""
    assert law.error is not None
    linearizable = law.error.system.linearizable
    left = float(np.mean([not linearizable(x) for x in run.state[::_EVERY]]))
    ended = run.status is not Status.COMPLETED
    saturated = float(np.mean(run.command != run.input)) if len(run.input) else 0.0
    margin = -1.0 if ended or left or saturated else 1.0
    return Premise(
        "region kept",
        "section 3.2: X_0",
        f"the run stays in {law.error.system.region}, and the actuator gives what is asked for",
        "1",
        None,
        Reading(Point(math.nan, (), margin), margin, max(left, saturated, float(ended))),
    )

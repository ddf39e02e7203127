"""The premises of the chapter's theorems, over the declared operating region and along each run."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.balance import Balance, balances, balances_along
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import design_variant
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.trajectory import Status, Trajectory

# The grid's points are for all axes together.
_GRID, _EVERY = 169, 5
# Phases of a moving reference, by the number of axes.
_PHASES = {2: 16, 4: 8}
# The same for families of plants.
_COARSE_GRID, _COARSE_PHASES = 25, 8
# s(0), the rank of numbers and the like hold to rounding.
ROUNDING = 1e-9


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
        remedy: The smallest gain that restores it, in words.
        note: What to know.
    """

    name: str
    source: str
    requirement: str
    unit: str
    region: Reading | None = None
    along: Reading | None = None
    remedy: str = ""
    note: str = ""

    @property
    def holds(self) -> bool:
        """Whether it holds in the region and along the run."""
        return all(reading.margin >= 0 for reading in (self.region, self.along) if reading)

    @property
    def restores(self) -> str:
        """The remedy; empty if it holds."""
        return "" if self.holds else self.remedy


@dataclass(frozen=True)
class Audit:
    """All premises of a law in a case.

    Attributes:
        case: The case.
        controller: Name of the controller.
        premises: In the order of the theory.
        signals: Along the run, for figures: time, required and configured rho.
    """

    case: Case
    controller: str
    premises: tuple[Premise, ...]
    signals: Mapping[str, Array] = field(default_factory=dict)

    def failed(self) -> list[Premise]:
        """Those that do not hold."""
        return [premise for premise in self.premises if not premise.holds]


def audit(lab: Laboratory, experiment: Experiment, controller: str = "grosmc") -> Audit:
    """Compute the premises of a law in an experiment on physics or, where there is none, equations.

    Raises:
        ArgumentError: If the law has no equations in symbols.
    """
    key, plant = ("audit", *experiment.key, controller), experiment.nominal.truest
    return lab.once(key, lambda: run_audit(lab.run(experiment, plant, controller)))


def run_audit(result: RunResult) -> Audit:
    """The premises of the law of a run, one by one.

    Raises:
        ArgumentError: If the law has no equations in symbols, or the true plant none at all; if
            the run ended at its start, or the laws are defined nowhere in the operating region.
    """
    law, run = result.controller, result.trajectory
    if not len(run.input):
        raise ArgumentError(f"{result.key} has no premises: it ended at its start: {result.ended}")
    if not isinstance(law.designed.error, ErrorCoordinates) or result.true is None:
        raise ArgumentError(
            f"{result.key}: premises are told of laws with outputs and equations in symbols, and "
            "of all laws of a model in MuJoCo that has none"
        )
    true, bound = result.true.analytic(design_variant(result.plant)), _bound(result)
    phases = _PHASES.get(len(bound), _COARSE_PHASES)
    here = _region(law, true, bound, _largest_wrench(run), _GRID, phases)
    there = balances_along(law, true, run, _EVERY)
    premises = [
        *_linear(law), _decoupling(law, here, there), _matched(here, there), _sign(here, there)
    ]  # fmt: skip
    if run.sliding is not None:
        premises += [_gain(law, here, there), initial_surface(run.sliding)]
    premises.append(_met(run, law))
    return Audit(result.case, law.name, tuple(premises), signals(there))


def signals(along: Balance) -> dict[str, Array]:
    """Time, required and configured rho along a run, for figures."""
    return {"time": along.t, "required": along.required, "configured": along.configured}


def _bound(result: RunResult) -> tuple[float, ...]:
    """The declared operating region, |z1|, |z2| ..., or what the run spans."""
    law, run = result.controller, result.trajectory
    spanned = np.abs(law.coordinates.along(run.time, run.state, law.parameters)).max(axis=0)
    bound = result.experiment.region or tuple(spanned.tolist())
    if len(bound) != len(spanned):
        raise ArgumentError(
            f"task: region = {list(bound)} must have {len(spanned)} bounds, one for each error"
        )
    return bound


def least_margin(
    law: Controller, true: AnalyticPlant, bound: Sequence[float], amplitude: Array
) -> float:
    """Configured less required switching rate on a true plant, the least of an operating region.

    Under a reference that moves it is looked for on a coarser grid than the audit's, with all
    corners of the region: a family has many plants.

    Args:
        law: A law with a switching rate.
        true: The plant that it meets.
        bound: Of the region, |z1|, |z2| ...
        amplitude: Largest magnitude of each component of the wrenches, (6 * bodies,).
    """
    grid = _COARSE_GRID if getattr(law.coordinates.reference, "moves", True) else _GRID
    return float(_region(law, true, bound, amplitude, grid, _COARSE_PHASES).margin.min())


def largest_rate(law: Controller, true: AnalyticPlant, bound: Sequence[float]) -> float:
    """The largest switching rate that a law has on a plant in an operating region.

    Args:
        law: A law with a switching rate.
        true: The plant that it meets.
        bound: Of the region, |z1|, |z2| ...
    """
    still = np.zeros(6 * len(true.system.bodies))
    points = _region(law, true, bound, still, _COARSE_GRID, _COARSE_PHASES)
    return float(points.configured.max())


def _region(
    law: Controller,
    true: AnalyticPlant,
    bound: Sequence[float],
    amplitude: Array,
    grid: int,
    phases: int,
) -> Balance:
    """The balance over the operating region, with the case's wrench at either bound.

    Raises:
        ArgumentError: If the laws are defined at none of its points.
    """
    error, system = law.coordinates, true.system
    count = int((grid ** (1 / len(bound)) - 1) / 2) * 2 + 1
    axes = [np.linspace(-size, size, count) for size in bound]
    moves = getattr(error.reference, "moves", True)
    times = np.linspace(0, 2, phases if moves else 1, endpoint=False)
    # Every sign of each component that acts: two pushes need not point the same way.
    signs = [(-size, size) if size else (0.0,) for size in amplitude.tolist()]
    wrenches = [np.array(w) for w in itertools.product(*signs)]
    points: list[tuple[float, Array, Array]] = []
    for t, *z in itertools.product(times.tolist(), *axes):
        x = error.place(t, z, law.parameters)
        controlled = np.abs(x[list(system.controlled)])
        if controlled.max() <= system.position_bound and system.linearizable(x):
            points += [(t, x, w) for w in wrenches]
    if not points:
        unit = system.states[system.controlled[0]].unit
        sizes = ", ".join(f"|z{i + 1}| <= {size:g}" for i, size in enumerate(bound))
        raise ArgumentError(
            f"{law.name}: the laws are defined nowhere in the operating region {sizes}: they need "
            f"{system.region} and positions within {system.position_bound:g} {unit}; choose "
            "another reference or operating region"
        )
    t, x, w = zip(*points, strict=True)
    return balances(law, true, t, np.array(x), np.array(w))


def _largest_wrench(run: Trajectory) -> Array:
    """The largest value of each component of a run's wrenches, with its sign."""
    w = np.zeros((1, 6 * len(run.system.bodies))) if run.wrench is None else run.wrench
    return w[np.abs(w).argmax(axis=0), range(w.shape[1])]


def reading_of(points: Balance, margins: Array) -> Reading:
    """The least margin of many points, at the first of those that share it but for rounding."""
    least = float(margins.min())
    worst = int(np.isclose(margins, least, rtol=ROUNDING, atol=0, equal_nan=True).argmax())
    place = Point(float(points.t[worst]), tuple(points.x[worst].tolist()), least)
    return Reading(place, least, float(np.mean(margins < 0)))


def single_reading(margin: float) -> Reading:
    """A margin that has no place and no time."""
    return Reading(Point(math.nan, (), margin), margin, float(margin < 0))


def _linear(law: Controller) -> list[Premise]:
    """Assumption 1 and G B, of the law's linear model."""
    A, B, p = law.designed.lqr.A, law.designed.lqr.B, law.parameters
    controllability = np.hstack([np.linalg.matrix_power(A, k) @ B for k in range(len(A))])
    values = np.linalg.svd(controllability, compute_uv=False)
    rank = Premise(
        "controllability",
        "Assumption 1",
        "rank [B, AB ...] = n: smallest over largest singular value above rounding",
        "1",
        single_reading(float(values[-1] / values[0]) - ROUNDING),
        note=f"rank {np.linalg.matrix_rank(controllability)} of {len(A)}",
    )
    if not hasattr(p, "GB"):
        return [rank]
    share = np.linalg.norm(p.GB, -2) / (np.linalg.norm(p.G) * np.linalg.norm(B))
    steered = Premise(
        "G B nonsingular",
        "eqs. (8), (31), (51)",
        "least singular value of GB, over |G| |B|, above rounding",
        "1",
        single_reading(float(share) - ROUNDING),
        note="G B = " + "; ".join("  ".join(f"{entry:.4g}" for entry in row) for row in p.GB),
    )
    return [rank, steered]


def _decoupling(law: Controller, here: Balance, there: Balance) -> Premise:
    """The vector relative degree: E(x) of eq. (21) keeps away from singular."""
    error, p = law.coordinates, law.parameters
    E = error.dynamics(0.0, error.place(0.0, np.zeros(error.size), p), p)[1]
    scale = abs(float(np.linalg.det(E)))
    return Premise(
        f"relative degree {', '.join(map(str, error.linearization.relative_degree))}",
        "eqs. (21)-(23), Assumption 7",
        "decoupling matrix: |det E(x)| over the one at zero error, above rounding",
        "1",
        reading_of(here, np.abs(here.determinant) / scale - ROUNDING),
        reading_of(there, np.abs(there.determinant) / scale - ROUNDING),
    )


def _matched(here: Balance, there: Balance) -> Premise:
    """The uncertainty enters where the input does."""
    matched = max(np.abs(b.push).max() for b in (here, there))
    return Premise(
        "matching",
        "Assumptions 3, 5 and 9",
        "no uncertainty in the rows of z' without an input",
        "1/s",
        reading_of(here, ROUNDING - here.unmatched),
        reading_of(there, ROUNDING - there.unmatched),
        note=f"the matched part moves s by up to {matched:.3g} a second; in mechanics this holds "
        "by kinematics for the output, not for coordinates that the law does not see, such as a "
        "cart",
    )


def _sign(here: Balance, there: Balance) -> Premise:
    """The input pushes the way that the law's model says."""
    ratios = np.concatenate([here.gain_ratio, there.gain_ratio])
    return Premise(
        "input gain",
        "implied by Assumptions 3 and 5",
        "r = E_true/E_nominal positive (several inputs: what dominance leaves of it)",
        "1",
        reading_of(here, here.gain_ratio - ROUNDING),
        reading_of(there, there.gain_ratio - ROUNDING),
        note=f"r from {ratios.min():.3g} to {ratios.max():.3g}",
    )


def _gain(law: Controller, here: Balance, there: Balance) -> Premise:
    """The switching gain covers what pushes s away, with the input gain's uncertainty counted."""
    p, unit = law.parameters, per_second(law.designed.sliding_unit)
    region, along = here.required.max(), there.required.max()
    required, factor = max(region, along), max(here.times.max(), there.times.max())
    name, source = "switching gain", "Assumptions 4 and 6, eqs. (12), (37)"
    restores = f"η, γ0 and γ1 {factor:.3g} times as large"
    if math.isinf(factor):
        restores = f"η = {required:.3g}; there is no gain to multiply"
    if "epsilon" in law.designed.gains:
        name, source = "epsilon", "Theorem 3: ε >= (a_m + d_m) ‖GB‖"
        restores = (
            f"ε = {along:.3g} along this run, which leaves its surface, and {region:.3g} over the "
            f"region, instead of {p.epsilon:.3g}"
        )
    return Premise(
        name,
        source,
        "the law's switching rate ρ at least push / r, what is required of it",
        unit,
        reading_of(here, here.margin),
        reading_of(there, there.margin),
        restores,
        f"required at most {required:.3g} {unit}",
    )


def per_second(unit: str) -> str:
    """The unit of a rate of change."""
    return f"{unit.removesuffix('/s')}/s²" if unit.endswith("/s") else f"{unit}/s"


def initial_surface(sliding: Array | None) -> Premise:
    """There is no reaching phase: s(0) = 0."""
    start = math.nan if sliding is None or not len(sliding) else float(np.abs(sliding[0]).max())
    return Premise(
        "s(0) = 0", "eqs. (8), (31), (51)", "|s(0)| zero to rounding", "1", None,
        single_reading(ROUNDING - start),
    )  # fmt: skip


def _met(run: Trajectory, law: Controller) -> Premise:
    """No singular state was met and the actuator gave what it was asked for."""
    system = law.designed.error.system
    left = float(np.mean([not system.linearizable(x) for x in run.state[::_EVERY]]))
    saturated = float(np.mean(run.command != run.input))
    violated = max(left, saturated, float(run.status is not Status.COMPLETED))
    margin = -1.0 if violated else 1.0
    return Premise(
        "region kept",
        "section 3.2: X_0",
        f"the run stays in {system.region}, and the actuator gives what is asked for",
        "1",
        None,
        Reading(Point(math.nan, (), margin), margin, violated),
    )

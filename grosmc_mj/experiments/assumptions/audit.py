"""The premises of the chapter's theorems, over the declared operating region and along each run."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from grosmc_mj.experiments.assumptions.balance import Balance, Loads, balances, balances_along
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.plants import design_variant
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.units import rate_unit
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.theory.control.controller import Controller, Design
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.theory.plants import AnalyticPlant

# Points of the grid over the operating region, for all axes together.
_GRID = 169
# Phases of a moving reference at each point of the grid, by the number of axes.
_PHASES = {2: 16, 4: 8}
# The same for other numbers of axes.
_COARSE_PHASES = 8
# Every so many samples of a run are looked at.
_EVERY = 5
# s(0), the rank of numbers and the like hold to rounding.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Reading:
    """A premise at many points.

    Attributes:
        margin: The least of all points: positive where it holds, in the premise's unit.
        violated: Part of the points, or of the time, at which it does not hold.
        t: Time of the point with this margin [s]; NaN for a margin without a place.
        x: State there; empty for a margin without a place.
    """

    margin: float
    violated: float
    t: float = math.nan
    x: tuple[float, ...] = ()


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
        readings = (self.region, self.along)
        return all(reading.margin >= 0 for reading in readings if reading is not None)

    @property
    def restores(self) -> str:
        """The remedy; empty if it holds."""
        if self.holds:
            return ""
        return self.remedy


@dataclass(frozen=True)
class Audit:
    """All premises of a law in a case.

    Attributes:
        case: The case.
        controller: Name of the controller.
        premises: In the order of the theory.
        signals: Along the run, for figures: time, required and configured rho.
    """

    case: Experiment
    controller: str
    premises: tuple[Premise, ...]
    signals: Mapping[str, Array] = field(default_factory=dict)

    def failed(self) -> list[Premise]:
        """Return the premises that do not hold."""
        return [premise for premise in self.premises if not premise.holds]


def audit(lab: RunCache, experiment: Experiment, controller: str = "grosmc") -> Audit:
    """Compute the premises of a law in an experiment on physics or, where there is none, equations.

    Args:
        lab: Runs that have been made.
        experiment: The experiment.
        controller: Name of the law.

    Raises:
        ArgumentError: If the law has no equations in symbols.
    """
    plant = experiment.nominal.truest
    key = ("audit", *experiment.key, controller)
    return lab.once(key, lambda: run_audit(lab.run(experiment, plant, controller)))


def run_audit(result: RunResult) -> Audit:
    """Compute the premises of the law of a run, one by one.

    Args:
        result: The run.

    Raises:
        ArgumentError: If the law has no equations in symbols or no gain K, or the true plant no
            equations at all; if the run ended at its start, or the laws are defined nowhere in
            the operating region.
    """
    law = result.controller
    run = result.trajectory
    if not len(run.input):
        raise ArgumentError(f"{result.key} has no premises: it ended at its start: {result.ended}")
    if not isinstance(law.designed.error, ErrorCoordinates) or result.true is None:
        raise ArgumentError(
            f"{result.key}: premises are told of laws with outputs and equations in symbols, and "
            "of all laws of a model in MuJoCo that has none"
        )
    if not hasattr(law.parameters, "K"):
        raise ArgumentError(
            f"{result.key}: premises are told of laws v = -K z, with a switching term or without"
        )

    true = result.true.analytic(design_variant(result.plant))
    bound = _operating_region(result)
    phases = _PHASES.get(len(bound), _COARSE_PHASES)
    loads = Loads(*map(_largest, Loads.of_run(run, slice(None))))
    region = _region_balance(law, true, bound, loads, _GRID, phases)
    along = balances_along(law, true, run, _EVERY)

    premises = [
        *_linear(law),
        _decoupling(law, region, along),
        _matched(region, along),
        _sign(region, along),
    ]
    if run.sliding is not None:
        premises.append(_gain(law, region, along))
        premises.append(initial_surface(run.sliding))
    premises.append(_region_kept(result))
    return Audit(result.case, law.name, tuple(premises), signals(along))


def signals(along: Balance) -> dict[str, Array]:
    """Time, required and configured rho along a run, for figures."""
    return {"time": along.t, "required": along.required, "configured": along.configured}


def _operating_region(result: RunResult) -> tuple[float, ...]:
    """Bounds |z1|, |z2| ... that are declared, or else spanned by the run."""
    law = result.controller
    run = result.trajectory
    z = law.coordinates.along(run.time, run.state, law.parameters)
    spanned = np.abs(z).max(axis=0)

    bound = result.case.region
    if not bound:
        return tuple(spanned.tolist())
    if len(bound) != len(spanned):
        raise ArgumentError(
            f"task: region = {list(bound)} must have {len(spanned)} bounds, one for each error"
        )
    return bound


def _reference_moves(law: Controller) -> bool:
    """Whether the reference depends on time; True if it does not say."""
    return getattr(law.coordinates.reference, "moves", True)


def _region_balance(
    law: Controller,
    true: AnalyticPlant,
    bound: Sequence[float],
    largest: Loads,
    grid: int,
    phases: int,
) -> Balance:
    """The balance over the operating region, with the case's disturbances at either bound.

    Raises:
        ArgumentError: If the laws are defined at none of its points.
    """
    if not _reference_moves(law):
        phases = 1
    states = _region_states(law, true, bound, grid, phases)
    if not states:
        raise ArgumentError(_undefined_region(law, true, bound))

    # Every sign of each component that acts: two forces need not point the same way.
    sizes = np.concatenate(largest, axis=1)[0]
    signs = [(-size, size) if size else (0.0,) for size in sizes.tolist()]
    corners = list(itertools.product(*signs))

    t = np.repeat([t for t, _ in states], len(corners))
    x = np.repeat([x for _, x in states], len(corners), axis=0)
    components = np.tile(corners, (len(states), 1))
    ends = np.cumsum([rows.shape[1] for rows in largest])
    loads = Loads(*np.split(components, ends[:-1], axis=1))
    return balances(law, true, t.tolist(), x, loads)


def _region_states(
    law: Controller,
    true: AnalyticPlant,
    bound: Sequence[float],
    grid: int,
    phases: int,
) -> list[tuple[float, Array]]:
    """Times and states of a grid over the operating region, where the laws are defined."""
    system = true.system
    controlled = list(system.controlled)
    # An odd number of points on each axis, so that the origin is one of them.
    count = int((grid ** (1 / len(bound)) - 1) / 2) * 2 + 1
    axes = [np.linspace(-size, size, count) for size in bound]
    times = np.linspace(0, 2, phases, endpoint=False).tolist()

    states = []
    for t, *z in itertools.product(times, *axes):
        x = law.coordinates.place(t, z, law.parameters)
        within = np.abs(x[controlled]).max() <= system.position_bound
        if within and system.linearizable(x):
            states.append((t, x))
    return states


def _undefined_region(law: Controller, true: AnalyticPlant, bound: Sequence[float]) -> str:
    """Message about an operating region in which the laws are defined nowhere."""
    system = true.system
    unit = system.states[system.controlled[0]].unit
    sizes = ", ".join(f"|z{i}| <= {size:g}" for i, size in enumerate(bound, 1))
    return (
        f"{law.name}: the laws are defined nowhere in the operating region {sizes}: they need "
        f"{system.region} and positions within {system.position_bound:g}{unit_after(unit)}; choose "
        "another reference or operating region"
    )


def _largest(rows: Array) -> Array:
    """Entry of the largest magnitude of each column, with its sign, in a single row."""
    return rows[np.abs(rows).argmax(axis=0), range(rows.shape[1])][None]


def reading_of(points: Balance, margins: Array) -> Reading:
    """The least margin of many points, at the first of those that share it but for rounding."""
    least = float(margins.min())
    shared = np.isclose(margins, least, rtol=ROUNDING, atol=0, equal_nan=True)
    row = int(shared.argmax())
    violated = float(np.mean(margins < 0))
    return Reading(least, violated, float(points.t[row]), tuple(points.x[row].tolist()))


def single_reading(margin: float) -> Reading:
    """A margin that has no place and no time."""
    return Reading(margin, float(margin < 0))


def _linear(law: Controller) -> list[Premise]:
    """Assumption 1 and G B, of the law's linear model."""
    A = law.designed.lqr.A
    B = law.designed.lqr.B
    p = law.parameters

    controllability = np.hstack([np.linalg.matrix_power(A, k) @ B for k in range(len(A))])
    values = np.linalg.svd(controllability, compute_uv=False)
    controllable = Premise(
        "controllability",
        "Assumption 1",
        "rank [B, AB ...] = n: smallest over largest singular value above rounding",
        "1",
        region=single_reading(float(values[-1] / values[0]) - ROUNDING),
        note=f"rank {np.linalg.matrix_rank(controllability)} of {len(A)}",
    )
    if not hasattr(p, "GB"):
        return [controllable]

    share = np.linalg.norm(p.GB, -2) / (np.linalg.norm(p.G) * np.linalg.norm(B))
    rows = ["  ".join(f"{entry:.4g}" for entry in row) for row in p.GB]
    nonsingular = Premise(
        "G B nonsingular",
        "eqs. (8), (31), (51)",
        "least singular value of GB, over |G| |B|, above rounding",
        "1",
        region=single_reading(float(share) - ROUNDING),
        note=f"G B = {'; '.join(rows)}",
    )
    return [controllable, nonsingular]


def _decoupling(law: Controller, region: Balance, along: Balance) -> Premise:
    """The vector relative degree: E(x) of eq. (21) keeps away from singular."""
    error = law.coordinates
    p = law.parameters
    E = error.dynamics(0.0, error.place(0.0, np.zeros(error.size), p), p)[1]
    scale = abs(float(np.linalg.det(E)))
    degrees = ", ".join(map(str, error.linearization.relative_degree))
    return Premise(
        f"relative degree {degrees}",
        "eqs. (21)-(23), Assumption 7",
        "decoupling matrix: |det E(x)| over the one at zero error, above rounding",
        "1",
        region=reading_of(region, np.abs(region.determinant) / scale - ROUNDING),
        along=reading_of(along, np.abs(along.determinant) / scale - ROUNDING),
    )


def _matched(region: Balance, along: Balance) -> Premise:
    """The uncertainty enters where the input does."""
    matched = max(np.abs(region.push).max(), np.abs(along.push).max())
    return Premise(
        "matching",
        "Assumptions 3, 5 and 9",
        "no uncertainty in the rows of z' without an input",
        "1/s",
        region=reading_of(region, ROUNDING - region.unmatched),
        along=reading_of(along, ROUNDING - along.unmatched),
        note=f"the matched part moves s by up to {matched:.3g} a second; in mechanics this holds "
        "by kinematics for the output, not for coordinates that the law does not see, such as a "
        "cart",
    )


def _sign(region: Balance, along: Balance) -> Premise:
    """The input pushes the way that the law's model says."""
    ratios = np.concatenate([region.gain_ratio, along.gain_ratio])
    return Premise(
        "input gain",
        "implied by Assumptions 3 and 5",
        "r = E_true/E_nominal positive (several inputs: what dominance leaves of it)",
        "1",
        region=reading_of(region, region.gain_ratio - ROUNDING),
        along=reading_of(along, along.gain_ratio - ROUNDING),
        note=f"r from {ratios.min():.3g} to {ratios.max():.3g}",
    )


def _gain(law: Controller, region: Balance, along: Balance) -> Premise:
    """The switching gain covers what pushes s away, with the input gain's uncertainty counted."""
    design = law.designed
    in_region = region.required.max()
    along_run = along.required.max()
    required = max(in_region, along_run)

    if "epsilon" in design.gains:
        remedy = (
            f"ε = {along_run:.3g} along this run, which leaves its surface, and {in_region:.3g} "
            f"over the region, instead of {law.parameters.epsilon:.3g}"
        )
    else:
        factor = max(region.times.max(), along.times.max())
        remedy = f"η, γ0 and γ1 {factor:.3g} times as large"
        if math.isinf(factor):
            remedy = f"η = {required:.3g}; there is no gain to multiply"
    return replace(
        switching_premise(design, along),
        region=reading_of(region, region.margin),
        remedy=remedy,
        note=f"required at most {required:.3g} {rate_unit(design.sliding_unit)}",
    )


def switching_premise(design: Design, along: Balance) -> Premise:
    """The switching gain covers what pushes s away along a run."""
    name = "switching gain"
    source = "Assumptions 4 and 6, eqs. (12), (37)"
    if "epsilon" in design.gains:
        name = "epsilon"
        source = "Theorem 3: ε >= (a_m + d_m) ‖GB‖"
    return Premise(
        name,
        source,
        "the law's switching rate ρ at least push / r, what is required of it",
        rate_unit(design.sliding_unit),
        along=reading_of(along, along.margin),
    )


def initial_surface(sliding: Array | None) -> Premise:
    """There is no reaching phase: s(0) = 0."""
    start = math.nan
    if sliding is not None and len(sliding):
        start = float(np.abs(sliding[0]).max())
    return Premise(
        "s(0) = 0",
        "eqs. (8), (31), (51)",
        "|s(0)| zero to rounding",
        "1",
        along=single_reading(ROUNDING - start),
    )


def _region_kept(result: RunResult) -> Premise:
    """No singular state was met and the actuator gave what it was asked for."""
    run = result.trajectory
    system = result.controller.designed.error.system
    singular = float(np.mean([not system.linearizable(x) for x in run.state[::_EVERY]]))
    saturated = float(np.mean(result.cut))
    ended_early = float(run.status is not Status.COMPLETED)

    violated = max(singular, saturated, ended_early)
    margin = -1.0 if violated else 1.0
    return Premise(
        "region kept",
        "section 3.2: X_0",
        f"the run stays in {system.region}, and the actuator gives what is asked for",
        "1",
        along=Reading(margin, violated),
    )

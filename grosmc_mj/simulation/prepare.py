"""Checking the arguments of a simulation and laying out its problem."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import is_dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.problem import Plant, Problem
from grosmc_mj.simulation.records import record_dtype

Item = TypeVar("Item")
Disturbances = Sequence[Disturbance] | Sequence[Sequence[Disturbance]]

ANALYTIC_TIMESTEP = 1e-3
# Of a run, every one of which may be kept: some GB.
_MOST_STEPS = 10**8


def prepare(
    plant: Plant | Sequence[Plant],
    controller: Controller | Sequence[Controller],
    x0: ArrayLike,
    *,
    duration: float,
    control_period: float | None = None,
    timestep: float | None = None,
    disturbances: Disturbances = (),
    record: bool = True,
    threads: int = 0,
) -> tuple[Problem, bool]:
    """The problem that the arguments of ``simulate`` describe, and whether it is a single run.

    Raises:
        ArgumentError: If an argument does not fit.
    """
    plants, controllers = _sequence(plant), _sequence(controller)
    lists = _disturbance_lists(disturbances)
    starts = np.atleast_2d(np.asarray(x0, float))
    counts = {len(plants), len(controllers), len(lists), len(starts)} - {1}
    single = not counts and np.ndim(x0) == 1 and plants[0] is plant and controllers[0] is controller
    if len(counts) > 1 or 0 in counts:
        raise ArgumentError(
            f"{len(plants)} plants, {len(controllers)} controllers, {len(lists)} disturbance "
            f"lists and {len(starts)} starts: each must be 1 or the number of simulations"
        )
    nsim = max(counts, default=1)
    system, kind = plants[0].system, type(plants[0])
    if any(p.system is not system or type(p) is not kind for p in plants):
        raise ArgumentError("all plants of a batch must be of one system and of one kind")
    if any(c.law is not controllers[0].law for c in controllers):
        raise ArgumentError("all controllers of a batch must have the same law")
    if len({record_dtype(c.parameters) for c in controllers if is_dataclass(c.parameters)}) > 1:
        raise ArgumentError("all controllers of a batch must have the same kinds of numbers")
    designed = controllers[0].error.system if controllers[0].error else system
    if designed is not system:
        raise ArgumentError(
            f"{controllers[0].name} is designed for {designed.name}, the plant is {system.name}"
        )
    n = len(system.states)
    if starts.ndim != 2 or starts.shape[1] != n or not np.all(np.isfinite(starts)):
        names = ", ".join(f"{state.symbol} [{state.unit}]" for state in system.states)
        raise ArgumentError(
            f"x0 = {np.asarray(x0).tolist()} must be {n} finite numbers for {system.name}: {names}"
        )
    h = _timestep(plants, timestep)
    period = h if control_period is None else float(control_period)
    stride = round(period / h) if math.isfinite(period) else 0
    if stride < 1 or not math.isclose(stride * h, period, rel_tol=1e-9):
        raise ArgumentError(
            f"control period {period:g} s is no multiple of the timestep {h:g} s: take "
            f"{max(1, stride) * h:g} s, or another timestep"
        )
    for each in controllers:
        wanted = each.control_period
        if wanted is not None and not math.isclose(wanted, period, rel_tol=1e-9):
            raise ArgumentError(
                f"{each.name} is designed for a control period of {wanted:g} s, not {period:g} s"
            )
    if not (math.isfinite(duration) and duration > 0):
        raise ArgumentError(f"duration {duration:g} s must be finite and positive")
    if threads < 0:
        raise ArgumentError(f"threads = {threads} must be 0 (all cores) or more")
    if duration / h > _MOST_STEPS:
        raise ArgumentError(
            f"duration {duration:g} s is {duration / h:.3g} timesteps of {h:g} s: at most "
            f"{_MOST_STEPS:.0e} are made"
        )
    steps = math.ceil(duration / h * (1 - 1e-12))
    problem = Problem(
        plants=_repeat(plants, nsim),
        controllers=_repeat(controllers, nsim),
        x0=np.ascontiguousarray(np.broadcast_to(starts, (nsim, n))),
        steps=steps,
        stride=stride,
        timestep=h,
        control_period=period,
        disturbances=tuple(map(tuple, lists)),
        record=record,
        threads=threads,
    )
    _check_disturbances(problem)
    return problem, single


def _check_disturbances(problem: Problem) -> None:
    """Refuse unknown bodies and profiles without finite values, before anything runs."""
    if problem.profiles_known:
        # A known profile that is finite at both ends is so between them.
        problem.wrenches_at(np.array([0, problem.steps - 1]))
    else:
        # Asks a user's own profile once for each timestep, as it may not answer twice alike.
        problem.wrenches  # noqa: B018


def _sequence(items: Item | Sequence[Item]) -> tuple[Item, ...]:
    """A tuple of what may be one item or several."""
    return tuple(items) if isinstance(items, Sequence) else (items,)


def _repeat(items: tuple[Item, ...], count: int) -> tuple[Item, ...]:
    """One item for each simulation."""
    return items * count if len(items) == 1 else items


def _disturbance_lists(disturbances: Disturbances) -> list[list[Disturbance]]:
    """One list of disturbances for all simulations, or one for each."""
    if not isinstance(disturbances, Sequence):
        raise ArgumentError(f"disturbances = {disturbances!r} must be a list of Disturbance")
    if disturbances and isinstance(disturbances[0], (list, tuple)):
        lists = [list(item) if isinstance(item, Sequence) else [item] for item in disturbances]
        if not all(isinstance(item, (list, tuple)) for item in disturbances):
            raise ArgumentError("give single Disturbances or one list for each run, not both")
    else:
        lists = [list(disturbances)]
    for item in (item for items in lists for item in items):
        if not isinstance(item, Disturbance):
            raise ArgumentError(f"{item!r} is no Disturbance")
    return lists  # pyright: ignore[reportReturnType]


def _timestep(plants: tuple[Plant, ...], timestep: float | None) -> float:
    """The one physics timestep of all plants."""
    if isinstance(plants[0], AnalyticPlant):
        h = ANALYTIC_TIMESTEP if timestep is None else float(timestep)
        if not (math.isfinite(h) and h > 0):
            raise ArgumentError(f"timestep {h:g} s must be finite and positive")
        return h
    steps = {p.step_length for p in plants if isinstance(p, MujocoPlant)}
    if len(steps) > 1:
        raise ArgumentError(f"the plants have different timesteps: {sorted(steps)} s")
    h = steps.pop()
    if timestep is not None and not math.isclose(timestep, h, rel_tol=1e-12):
        raise ArgumentError(
            f"timestep {timestep:g} s is not the model's {h:g} s: load the plant with it"
        )
    return h

"""Checking the arguments of a simulation and laying out its problem."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arguments import real, reals, require, require_whole
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, Sampled
from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.loop.timing import LONGEST, SHORTEST, stride_of
from grosmc_mj.plants import Plant, System
from grosmc_mj.records import pack, record_dtype
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.problem import Meters, Problem

Item = TypeVar("Item")
Disturbances = Sequence[Disturbance] | Sequence[Sequence[Disturbance]]

ANALYTIC_TIMESTEP = 1e-3
# Of a run, every one of which may be kept: some GB.
_MOST_STEPS = 10**8
_MOST_THREADS = 1024
_THREADS = f"0 (all cores) or more, a whole number up to {_MOST_THREADS}"
_BOUNDS = f"from {SHORTEST:g} to {LONGEST:g} s"


def prepare(
    plant: Plant | Sequence[Plant],
    controller: Controller | Sequence[Controller],
    x0: ArrayLike,
    *,
    duration: float,
    control_period: float | None = None,
    timestep: float | None = None,
    disturbances: Disturbances = (),
    meters: Meters | Sequence[Meters] | None = None,
    record: bool = True,
    threads: int = 0,
) -> tuple[Problem, bool]:
    """The problem that the arguments of ``simulate`` describe, and whether it is a single run.

    Raises:
        ArgumentError: If an argument does not fit.
    """
    plants, controllers = _plants(plant), _controllers(controller)
    lists, starts = _disturbance_lists(disturbances), _starts(x0, plants[0].system)
    measured = _sequence(meters)
    counts = {len(plants), len(controllers), len(lists), len(starts), len(measured)} - {1}
    single = not counts and np.ndim(x0) == 1 and plants[0] is plant and controllers[0] is controller
    if len(counts) > 1 or 0 in counts:
        raise ArgumentError(
            f"{len(plants)} plants, {len(controllers)} controllers, {len(lists)} disturbance "
            f"lists and {len(starts)} starts: each must be 1 or the number of simulations"
        )
    nsim = max(counts, default=1)
    _require_alike(plants, controllers)
    if len({each.kind for each in dict.fromkeys(measured) if each}) > 1:
        raise ArgumentError("all meters of a batch must be of one kind")
    plants[0].require_unchanged(plants)
    _require_designed_for(plants[0].system, controllers[0])
    h = _timestep(plants, timestep)
    stride, period = _stride(control_period, h, controllers)
    require("record", record, (bool, np.bool_), "True or False")
    problem = Problem(
        plants=_repeat(plants, nsim),
        controllers=_repeat(_sampled(controllers, period), nsim),
        meters=_repeat(measured, nsim),
        x0=np.ascontiguousarray(np.broadcast_to(starts, (nsim, starts.shape[1]))),
        steps=_steps(duration, h),
        stride=stride,
        timestep=h,
        control_period=period,
        disturbances=tuple(map(tuple, lists)),
        record=bool(record),
        threads=require_whole("threads", threads, 0, _MOST_THREADS, _THREADS),
    )
    for each, start in zip(problem.plants, problem.x0, strict=True):
        each.require_start(start)
    problem.pushes  # noqa: B018  refuses unknown bodies and profiles before anything runs
    return problem, single


def _plants(plant: Plant | Sequence[Plant]) -> tuple[Plant, ...]:
    """The plants, one or several; a robot's is among its parts."""
    plants = _sequence(plant)
    for each in plants:
        if isinstance(getattr(each, "plant", None), Plant):
            raise ArgumentError(f"a {type(each).__name__} is no plant: give its .plant")
        require(
            "plant",
            each,
            Plant,
            "a plant or a list of them: what MujocoPlant.load(...), .analytic() or "
            "affine_plant(...) makes",
        )
    if not plants:
        raise ArgumentError("0 plants: give one, or one for each simulation")
    return plants


def _controllers(controller: Controller | Sequence[Controller]) -> tuple[Controller, ...]:
    """The controllers, one or several, whose numbers are numbers."""
    controllers = _sequence(controller)
    for each in controllers:
        if callable(each):
            raise ArgumentError(
                f"controller = {shown(each)} must be a Controller: make one of a law with "
                "custom_controller(name, law, like=...)"
            )
        require("controller", each, Controller, "a Controller or a list of them")
    if not controllers:
        raise ArgumentError("0 controllers: give one, or one for each simulation")
    for each in dict.fromkeys(controllers):
        _require_numbers(each)
    return controllers


def _require_numbers(controller: Controller) -> None:
    """Refuse a NaN among a law's numbers, by its name; an infinity may be a missing limit."""
    p = controller.parameters
    for item in fields(p) if is_dataclass(p) else ():
        value = getattr(p, item.name)
        if item.name == "period" and isinstance(p, Sampled):  # it has none before its run
            continue
        entries = pack(value) if is_dataclass(value) else value
        if isinstance(entries, (float, np.ndarray)) and np.any(np.isnan(entries)):
            raise ArgumentError(
                f"{controller.name}: its number {item.name} = {shown(value)} must not be NaN"
            )


def _sampled(controllers: tuple[Controller, ...], period: float) -> tuple[Controller, ...]:
    """The controllers with their control period, each of them once."""
    told = {each: each.sampled(period) for each in dict.fromkeys(controllers)}
    return tuple(told[each] for each in controllers)


def _starts(x0: ArrayLike, system: System) -> Array:
    """The starts, (nsim, n)."""
    given, n = reals(x0), len(system.states)
    if given.ndim not in (1, 2) or given.shape[-1] != n or not np.all(np.isfinite(given)):
        names = ", ".join(f"{state.symbol} [{state.unit}]" for state in system.states)
        raise ArgumentError(
            f"x0 = {shown(x0)} must be {n} finite numbers for {system.name}: {names}"
        )
    return np.atleast_2d(given)


def _require_alike(plants: tuple[Plant, ...], controllers: tuple[Controller, ...]) -> None:
    """Refuse a batch that one compiled loop cannot run."""
    system, kind, first = plants[0].system, type(plants[0]), controllers[0]
    if any(p.system is not system or type(p) is not kind for p in plants):
        raise ArgumentError("all plants of a batch must be of one system and of one kind")
    if any(c.law is not first.law for c in controllers):
        raise ArgumentError("all controllers of a batch must have the same law")
    if len({c.loop is None for c in controllers}) > 1:
        raise ArgumentError("all controllers of a batch must be in a loop, or none")
    several = dict.fromkeys(controllers)
    if len(several) == 1:
        return
    if len({record_dtype(c.parameters) for c in several if is_dataclass(c.parameters)}) > 1:
        raise ArgumentError("all controllers of a batch must have the same kinds of numbers")
    if len({record_dtype(memory()) for memory in dict.fromkeys(c.memory for c in several)}) > 1:
        raise ArgumentError("all controllers of a batch must have the same kind of memory")


def _require_designed_for(system: System, controller: Controller) -> None:
    """Refuse a controller of another system."""
    designed = controller.design.error.system if controller.design else system
    # Another model of the same plant may be what a law believes in.
    if (designed.states, designed.inputs) != (system.states, system.inputs):
        raise ArgumentError(
            f"{controller.name} is designed for {designed.name}, the plant is {system.name}"
        )


def _stride(
    control_period: float | None, h: float, controllers: tuple[Controller, ...]
) -> tuple[int, float]:
    """Timesteps between two calls of the laws, and that time [s]."""
    stride, period = stride_of(control_period, h)
    for each in controllers:
        if own := each.loop:
            for what, made_for, given in (
                ("timestep", own.timestep, h),
                ("control period", own.period, period),
            ):
                if not math.isclose(made_for, given, rel_tol=1e-9):
                    raise ArgumentError(
                        f"{each.name} is in a loop for a {what} of {made_for:g} s, not {given:g} s"
                    )
        wanted = each.design.control_period if each.design else None
        if wanted is not None and not math.isclose(wanted, period, rel_tol=1e-9):
            raise ArgumentError(
                f"{each.name} is designed for a control period of {wanted:g} s, not {period:g} s"
            )
    return stride, period


def _steps(duration: float, h: float) -> int:
    """Timesteps of a run, rounded up."""
    seconds = real(duration)
    if not SHORTEST <= seconds <= LONGEST:
        raise ArgumentError(f"duration {shown(duration)} s must be finite and positive, {_BOUNDS}")
    if seconds / h > _MOST_STEPS:
        raise ArgumentError(
            f"duration {seconds:g} s is {seconds / h:.3g} timesteps of {h:g} s: at most "
            f"{_MOST_STEPS:.0e} are made"
        )
    return math.ceil(seconds / h * (1 - 1e-12))


def _sequence(items: Item | Sequence[Item]) -> tuple[Item, ...]:
    """A tuple of what may be one item or several; a text is one, and a wrong one."""
    if isinstance(items, Sequence) and not isinstance(items, (str, bytes)):
        return tuple(items)
    return (items,)  # pyright: ignore[reportReturnType]


def _repeat(items: tuple[Item, ...], count: int) -> tuple[Item, ...]:
    """One item for each simulation."""
    return items * count if len(items) == 1 else items


def _disturbance_lists(disturbances: Disturbances) -> list[list[Disturbance]]:
    """One list of disturbances for all simulations, or one for each."""
    if not isinstance(disturbances, Sequence):
        raise ArgumentError(f"disturbances = {shown(disturbances)} must be a list of Disturbance")
    if disturbances and isinstance(disturbances[0], (list, tuple)):
        lists = [list(item) if isinstance(item, Sequence) else [item] for item in disturbances]
        if not all(isinstance(item, (list, tuple)) for item in disturbances):
            raise ArgumentError("give single Disturbances or one list for each run, not both")
    else:
        lists = [list(disturbances)]
    for item in (item for items in lists for item in items):
        if not isinstance(item, Disturbance):
            raise ArgumentError(f"{shown(item)} is no Disturbance")
    return lists  # pyright: ignore[reportReturnType]


def _timestep(plants: tuple[Plant, ...], timestep: float | None) -> float:
    """The one physics timestep of all plants."""
    steps = {h for plant in plants if (h := plant.step_length) is not None}
    if not steps:
        h = ANALYTIC_TIMESTEP if timestep is None else real(timestep)
        if not SHORTEST <= h <= LONGEST:
            raise ArgumentError(
                f"timestep {shown(timestep)} s must be finite and positive, {_BOUNDS}"
            )
        return h
    if len(steps) > 1:
        raise ArgumentError(f"the plants have different timesteps: {sorted(steps)} s")
    own = steps.pop()
    if timestep is not None and not math.isclose(real(timestep), own, rel_tol=1e-12):
        raise ArgumentError(
            f"timestep {shown(timestep)} s is not the model's {own:g} s: load the plant with it"
        )
    return own

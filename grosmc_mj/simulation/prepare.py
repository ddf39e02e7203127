"""Checking the arguments of a simulation and laying out its problem."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, is_dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arguments import reals
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, Sampled
from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.fields import Check, Flag, Is, Items, Range, checked_call, refused
from grosmc_mj.loop.timing import LONGEST, SHORTEST, ControlPeriod, stride_of
from grosmc_mj.plants import Plant, System
from grosmc_mj.records import pack, record_dtype
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.problem import Meters, Problem

ANALYTIC_TIMESTEP = 1e-3
# Of a run, every one of which may be kept: some GB.
_MOST_STEPS = 10**8


@dataclass(frozen=True)
class OneOrMore(Is):
    """One value of a class as it is, or several of them as a tuple."""

    def __call__(self, value: Any) -> Any:
        """The value or the values, if all are such."""
        several = isinstance(value, (list, tuple))
        if not all(isinstance(item, self.kinds) for item in (value if several else [value])):
            raise refused(self.wanted)
        return tuple(value) if several else value


class _Lists(Check):
    """One list of disturbances for all simulations, or one for each: a tuple of such."""

    def __call__(self, value: Any) -> tuple[tuple[Disturbance, ...], ...]:
        several = isinstance(value, (list, tuple))
        single = not several or all(isinstance(item, Disturbance) for item in value)
        items = Items(Disturbance, "a list of Disturbances, or one such list for each simulation")
        return tuple(map(items, [value] if single else value))


Plants = Annotated[
    Any,
    OneOrMore(
        Plant,
        "a plant or a list of them: what MujocoPlant.load(...), .analytic() or affine_plant(...) "
        "makes, or a robot's .plant",
    ),
]
Controllers = Annotated[
    Any,
    OneOrMore(
        Controller,
        "a Controller or a list of them: make one of a law with custom_controller(name, law, "
        "like=...)",
    ),
]


@checked_call
def prepare(
    plant: Plants,
    controller: Controllers,
    x0: Any,
    *,
    duration: Annotated[float, Range(SHORTEST, LONGEST, unit="s")],
    control_period: ControlPeriod = None,
    timestep: Annotated[float, Range(SHORTEST, LONGEST, unit="s")] | None = None,
    disturbances: Annotated[Any, _Lists()] = ((),),
    meters: Annotated[Any, OneOrMore((Meters, type(None)), "Meters or a list of them")] = None,
    record: Flag = True,
    threads: Annotated[int, Range(0, 1024, whole=True)] = 0,
) -> tuple[Problem, bool]:
    """The problem that the arguments of ``simulate`` describe, and whether it is a single run.

    Raises:
        ArgumentError: If an argument does not fit.
    """
    plants, controllers, accumulated = map(_several, (plant, controller, meters))
    given, lists = reals(x0), disturbances
    starts = np.atleast_2d(given)
    counts = {len(items) for items in (plants, controllers, lists, accumulated, starts)} - {1}
    if len(counts) > 1 or 0 in counts:
        raise ArgumentError(
            f"{len(plants)} plants, {len(controllers)} controllers, {len(lists)} disturbance "
            f"lists and {len(starts)} starts: each must be 1 or the number of simulations"
        )
    single = not counts and given.ndim == 1 and plants[0] is plant and controllers[0] is controller
    nsim, system = max(counts, default=1), plants[0].system
    _require_starts(starts, x0, system)
    _require_alike(plants, controllers, accumulated)
    plants[0].require_unchanged(plants)
    for each in dict.fromkeys(controllers):
        _require_numbers(each)
    h = _timestep(plants, timestep)
    stride, period = stride_of(control_period, h)
    _require_designed_for(system, controllers, h, period)
    if duration / h > _MOST_STEPS:
        raise ArgumentError(
            f"duration {duration:g} s is {duration / h:.3g} timesteps of {h:g} s: at most "
            f"{_MOST_STEPS:.0e} are made"
        )
    sampled = {each: each.sampled(period) for each in dict.fromkeys(controllers)}
    problem = Problem(
        plants=_repeat(plants, nsim),
        controllers=_repeat(tuple(sampled[each] for each in controllers), nsim),
        meters=_repeat(accumulated, nsim),
        x0=np.ascontiguousarray(np.broadcast_to(starts, (nsim, starts.shape[1]))),
        # Rounded up.
        steps=math.ceil(duration / h * (1 - 1e-12)),
        stride=stride,
        timestep=h,
        control_period=period,
        disturbances=lists,
        record=record,
        threads=threads,
    )
    for each, start in zip(problem.plants, problem.x0, strict=True):
        each.require_start(start)
    problem.pushes  # noqa: B018  refuses unknown bodies and profiles before anything runs
    return problem, single


def _several(items: Any) -> tuple[Any, ...]:
    return items if isinstance(items, tuple) else (items,)


def _repeat(items: tuple[Any, ...], count: int) -> tuple[Any, ...]:
    return items * count if len(items) == 1 else items


def _require_starts(starts: Array, x0: ArrayLike, system: System) -> None:
    """Refuse starts that are not (nsim, n) finite numbers."""
    n = len(system.states)
    if starts.ndim != 2 or starts.shape[1] != n or not np.all(np.isfinite(starts)):
        names = ", ".join(f"{state.symbol} [{state.unit}]" for state in system.states)
        raise ArgumentError(
            f"x0 = {shown(x0)} must be {n} finite numbers for {system.name}: {names}"
        )


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


def _require_alike(
    plants: tuple[Plant, ...],
    controllers: tuple[Controller, ...],
    meters: tuple[Meters | None, ...],
) -> None:
    """Refuse a batch that one compiled loop cannot run."""
    system, kind = plants[0].system, type(plants[0])
    if any(plant.system is not system or type(plant) is not kind for plant in plants):
        raise ArgumentError("all plants of a batch must be of one system and of one kind")
    several = dict.fromkeys(controllers)
    memories = dict.fromkeys(c.memory for c in several)
    # One that runs in Python only, as a policy, may have numbers of any kind.
    numbers = {record_dtype(c.parameters) for c in several} if len(several) > 1 else set()
    for what, kinds in (
        ("have the same law", {c.law for c in several}),
        ("be in a loop, or none", {c.loop is None for c in several}),
        ("have the same kinds of numbers", numbers),
        ("have the same kind of memory", {record_dtype(memory()) for memory in memories}),
        ("have the same kind of meters", {m and m.kind for m in dict.fromkeys(meters)}),
    ):
        if len(kinds) > 1:
            raise ArgumentError(f"all controllers of a batch must {what}")


def _require_designed_for(
    system: System, controllers: tuple[Controller, ...], h: float, period: float
) -> None:
    """Refuse controllers of another system, timestep or control period."""
    for each in dict.fromkeys(controllers):
        designed = each.design.error.system if each.design else system
        # Another model of the same plant may be what a law believes in.
        if (designed.states, designed.inputs) != (system.states, system.inputs):
            raise ArgumentError(
                f"{each.name} is designed for {designed.name}, the plant is {system.name}"
            )
        looped, own = each.loop, each.design.control_period if each.design else None
        for what, needed, used in (
            ("is in a loop for a timestep", looped.timestep if looped else None, h),
            ("is in a loop for a control period", looped.period if looped else None, period),
            ("is designed for a control period", own, period),
        ):
            if needed is not None and not math.isclose(needed, used, rel_tol=1e-9):
                raise ArgumentError(f"{each.name} {what} of {needed:g} s, not {used:g} s")


def _timestep(plants: tuple[Plant, ...], timestep: float | None) -> float:
    """The one physics timestep of all plants."""
    steps = {h for plant in plants if (h := plant.step_length) is not None}
    if not steps:
        return ANALYTIC_TIMESTEP if timestep is None else timestep
    if len(steps) > 1:
        raise ArgumentError(f"the plants have different timesteps: {sorted(steps)} s")
    own = steps.pop()
    if timestep is not None and not math.isclose(timestep, own, rel_tol=1e-12):
        raise ArgumentError(
            f"timestep {timestep:g} s is not the model's {own:g} s: load the plant with it"
        )
    return own

"""Checking the arguments of a simulation and laying out its problem."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from grosmc_mj.arguments import reals
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.fields import Check, Flag, Is, Items, Range, checked_call, refused
from grosmc_mj.loop.timing import LONGEST, SHORTEST, ControlPeriod, stride_of
from grosmc_mj.plants import Plant, System
from grosmc_mj.records import record_dtype
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
    plants, controllers, accumulated = (
        items if isinstance(items, tuple) else (items,) for items in (plant, controller, meters)
    )
    states, lists = reals(x0), disturbances
    starts, system = np.atleast_2d(states), plants[0].system if plants else None
    counts = {len(items) for items in (plants, controllers, lists, accumulated, starts)} - {1}
    if len(counts) > 1 or 0 in counts or system is None:
        raise ArgumentError(
            f"{len(plants)} plants, {len(controllers)} controllers, {len(lists)} disturbance "
            f"lists and {len(starts)} starts: each must be 1 or the number of simulations"
        )
    nsim, n = max(counts, default=1), len(system.states)
    if starts.shape[1:] != (n,) or not np.all(np.isfinite(starts)):
        names = ", ".join(f"{state.symbol} [{state.unit}]" for state in system.states)
        raise ArgumentError(
            f"x0 = {shown(x0)} must be {n} finite numbers for {system.name}: {names}"
        )
    _require_alike(plants, controllers, accumulated)
    plants[0].require_unchanged(plants)
    h = _timestep(plants[0], timestep)
    stride, period = stride_of(control_period, h)
    for item in dict.fromkeys(controllers):
        _require_designed_for(system, item, h, period)
    if duration / h > _MOST_STEPS:
        raise ArgumentError(
            f"duration {duration:g} s is {duration / h:.3g} timesteps of {h:g} s: at most "
            f"{_MOST_STEPS:.0e} are made"
        )
    sampled = {item: item.sampled(period) for item in dict.fromkeys(controllers)}
    problem = Problem(
        plants=plants * (nsim // len(plants)),
        controllers=tuple(map(sampled.__getitem__, controllers)) * (nsim // len(controllers)),
        meters=accumulated * (nsim // len(accumulated)),
        x0=np.ascontiguousarray(np.broadcast_to(starts, (nsim, n))),
        # Rounded up.
        steps=math.ceil(duration / h * (1 - 1e-12)),
        stride=stride,
        timestep=h,
        control_period=period,
        disturbances=lists,
        record=record,
        threads=threads,
    )
    for item, start in zip(problem.plants, problem.x0, strict=True):
        item.require_start(start)
    problem.pushes  # noqa: B018  refuses unknown bodies and profiles before anything runs
    single = not counts and states.ndim == 1 and plants[0] is plant and controllers[0] is controller
    return problem, single


def _timestep(plant: Plant, asked: float | None) -> float:
    """Timestep of a run [s]: of a model in MuJoCo its own.

    Raises:
        ArgumentError: If another one is asked for.
    """
    model_timestep = plant.step_length
    if model_timestep is None:
        return asked or ANALYTIC_TIMESTEP
    if asked is not None and not math.isclose(asked, model_timestep, rel_tol=1e-12):
        raise ArgumentError(
            f"timestep {asked:g} s is not the model's {model_timestep:g} s: load the plant with it"
        )
    return model_timestep


def _require_alike(
    plants: tuple[Plant, ...],
    controllers: tuple[Controller, ...],
    meters: tuple[Meters | None, ...],
) -> None:
    """Refuse a batch that one compiled loop cannot run."""
    several = dict.fromkeys(controllers)
    # One that runs in Python only, as a policy, may have numbers of any kind.
    numbers = {record_dtype(c.parameters) for c in several} if len(several) > 1 else set()
    memories = dict.fromkeys(c.memory for c in several)
    for rule, kinds in (
        ("plants of a batch must be of one system and of one kind",
         {(plant.system, type(plant)) for plant in plants}),
        ("plants of a batch must have one timestep", {plant.step_length for plant in plants}),
        ("controllers of a batch must have the same law", {c.law for c in several}),
        ("controllers of a batch must be in a loop, or none", {c.loop is None for c in several}),
        ("controllers of a batch must have the same kinds of numbers", numbers),
        ("controllers of a batch must have the same kind of memory",
         {record_dtype(memory()) for memory in memories}),
        ("runs of a batch must have the same kind of meters",
         {m and m.kind for m in dict.fromkeys(meters)}),
    ):  # fmt: skip
        if len(kinds) > 1:
            raise ArgumentError(f"all {rule}")


def _require_designed_for(system: System, law: Controller, h: float, period: float) -> None:
    """Refuse a controller of another system, timestep or control period."""
    designed, own = (
        (law.design.error.system, law.design.control_period) if law.design else (system, None)
    )
    # Another model of the same plant may be what a law believes in.
    if (designed.states, designed.inputs) != (system.states, system.inputs):
        raise ArgumentError(
            f"{law.name} is designed for {designed.name}, the plant is {system.name}"
        )
    for quantity, needed, used in (
        ("is in a loop for a timestep", law.loop and law.loop.timestep, h),
        ("is in a loop for a control period", law.loop and law.loop.period, period),
        ("is designed for a control period", own, period),
    ):
        if needed is not None and not math.isclose(needed, used, rel_tol=1e-9):
            raise ArgumentError(f"{law.name} {quantity} of {needed:g} s, not {used:g} s")

"""Checking the arguments of a simulation and laying out its problem."""

from __future__ import annotations

import math
from collections.abc import Set
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from grosmc_mj.ground.arguments import reals
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.records import record_dtype
from grosmc_mj.ground.errors import ArgumentError, value_text
from grosmc_mj.ground.fields import Check, Flag, Is, Items, Range, checked_call
from grosmc_mj.ground.refusals import refusal
from grosmc_mj.ground.wording import counted, titled
from grosmc_mj.simulation.disturbances import AnyDisturbance, RateDisturbance
from grosmc_mj.simulation.loop.applied import AppliedLoop, apply_loop
from grosmc_mj.simulation.loop.loop import Loop
from grosmc_mj.simulation.loop.timing import LONGEST, SHORTEST, ControlPeriod, stride_of
from grosmc_mj.simulation.problem import Accumulator, Problem, require_memory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import Plant, System

ANALYTIC_TIMESTEP = 1e-3
# Timesteps of a run: if every one is kept, it takes some GB.
_MOST_STEPS = 10**8


@dataclass(frozen=True)
class OneOrMore(Is):
    """A value of a class as it is, or several of them as a tuple."""

    def __call__(self, value: Any) -> Any:
        """Return the value or the values, if all are of the class."""
        several = isinstance(value, (list, tuple))
        if not all(isinstance(item, self.kinds) for item in (value if several else [value])):
            raise refusal(self.wanted)
        return tuple(value) if several else value


class _Lists(Check):
    """A list of disturbances for all simulations, or a list for each: a tuple of such lists."""

    def __call__(self, value: Any) -> tuple[tuple[AnyDisturbance, ...], ...]:
        several = isinstance(value, (list, tuple))
        single = not several or all(isinstance(item, AnyDisturbance) for item in value)
        wanted = "a list of Disturbances, or one such list for each simulation"
        items = Items(AnyDisturbance, wanted)
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


Loops = Annotated[
    Any,
    OneOrMore((Loop, AppliedLoop, type(None)), "a Loop, an AppliedLoop or a list of them"),
]


@checked_call
def prepare(
    plant: Plants,
    controller: Controllers,
    x0: Any,
    *,
    loop: Loops = None,
    duration: Annotated[float, Range(SHORTEST, LONGEST, unit="s")],
    control_period: ControlPeriod = None,
    timestep: Annotated[float, Range(SHORTEST, LONGEST, unit="s")] | None = None,
    disturbances: Annotated[Any, _Lists()] = ((),),
    accumulator: Annotated[
        Any, OneOrMore((Accumulator, type(None)), "an Accumulator or a list of them")
    ] = None,
    record: Flag = True,
    threads: Annotated[int, Range(0, 1024, whole=True)] = 0,
) -> tuple[Problem, bool]:
    """Lay out the problem of the arguments of ``simulate``.

    Returns:
        The problem, and whether it is a single run.

    Raises:
        ArgumentError: If an argument does not fit.
    """
    plants = _several(plant)
    controllers = _several(controller)
    loops = _several(loop)
    accumulators = _several(accumulator)
    states = reals(x0)
    starts = np.atleast_2d(states)

    nsim = _number_of_simulations(plants, controllers, loops, disturbances, accumulators, starts)
    system = plants[0].system
    _require_starts(x0, starts, system)
    _require_alike(plants, controllers, loops, accumulators)
    plants[0].require_unchanged(plants)

    h = _timestep(plants[0], timestep)
    stride, period = stride_of(control_period, h)
    for item in dict.fromkeys(controllers):
        _require_designed_for(system, item, h, period)

    sampled = {item: item.sampled(period) for item in dict.fromkeys(controllers)}
    controllers = tuple(sampled[item] for item in controllers) * (nsim // len(controllers))
    problem = Problem(
        plants=plants * (nsim // len(plants)),
        controllers=controllers,
        loops=_applied(loops * (nsim // len(loops)), controllers, system, h, period),
        accumulators=accumulators * (nsim // len(accumulators)),
        x0=np.ascontiguousarray(np.broadcast_to(starts, (nsim, starts.shape[1]))),
        steps=number_of_steps(duration, h),
        stride=stride,
        timestep=h,
        control_period=period,
        disturbances=disturbances,
        record=record,
        threads=threads,
    )
    require_memory(problem.record_size, nsim, problem.steps)
    for item, start in zip(problem.plants, problem.x0, strict=True):
        item.require_start(start)
    _refuse_rates_in_physics(problem)
    problem.packed_disturbances  # noqa: B018  refuses unknown names and profiles before the run
    several = isinstance(plant, tuple) or isinstance(controller, tuple) or isinstance(loop, tuple)
    single = nsim == 1 and states.ndim == 1 and not several
    return problem, single


def _refuse_rates_in_physics(problem: Problem) -> None:
    """Refuse a disturbance of a state's rate on a plant in MuJoCo."""
    if problem.plants[0].kind == "physics" and problem.disturbed[RateDisturbance.part]:
        raise ArgumentError(
            f"{problem.system.name} runs in MuJoCo, where no rate is disturbed: name a body or an "
            "input"
        )


def _number_of_simulations(
    plants: tuple[Plant, ...],
    controllers: tuple[Controller, ...],
    loops: tuple[Any, ...],
    disturbances: tuple[Any, ...],
    accumulators: tuple[Any, ...],
    starts: Array,
) -> int:
    """Length of the arguments that are several; a single one serves every simulation."""
    arguments = (plants, controllers, loops, disturbances, accumulators, starts)
    lengths = {len(items) for items in arguments}
    several = lengths - {1}
    if len(several) > 1 or 0 in several:
        raise ArgumentError(
            f"{counted(len(plants), 'plant')}, {counted(len(controllers), 'controller')}, "
            f"{counted(len(loops), 'loop')}, {counted(len(disturbances), 'disturbance list')} and "
            f"{counted(len(starts), 'start')}: each must be 1 or "
            "the number of simulations"
        )
    return max(lengths)


def _require_starts(x0: Any, starts: Array, system: System) -> None:
    """Refuse starts, (nsim, n), that are not n finite numbers each."""
    n = len(system.states)
    if starts.shape[1:] != (n,) or not np.all(np.isfinite(starts)):
        names = ", ".join(titled(state.symbol, state.unit) for state in system.states)
        raise ArgumentError(
            f"x0 = {value_text(x0)} must be {n} finite numbers for {system.name}: {names}"
        )


def number_of_steps(duration: float, h: float) -> int:
    """Return the number of timesteps of h [s] in a duration [s], rounded up.

    Raises:
        ArgumentError: If they are too many.
    """
    if duration / h > _MOST_STEPS:
        raise ArgumentError(
            f"duration {duration:g} s is {duration / h:.3g} timesteps of {h:g} s: at most "
            f"{_MOST_STEPS:.0e} are made"
        )
    return math.ceil(duration / h * (1 - 1e-12))


def _several(items: Any) -> tuple[Any, ...]:
    """Several values as they are, one as a tuple."""
    return items if isinstance(items, tuple) else (items,)


def _timestep(plant: Plant, timestep: float | None) -> float:
    """Timestep of a run [s]: of a model in MuJoCo its own.

    Raises:
        ArgumentError: If another one is asked for.
    """
    model_timestep = plant.step_length
    if model_timestep is None:
        return timestep or ANALYTIC_TIMESTEP
    if timestep is not None and not math.isclose(timestep, model_timestep, rel_tol=1e-12):
        raise ArgumentError(
            f"timestep {timestep:g} s is not the model's {model_timestep:g} s: "
            "load the plant with it"
        )
    return model_timestep


def _require_alike(
    plants: tuple[Plant, ...],
    controllers: tuple[Controller, ...],
    loops: tuple[Loop | AppliedLoop | None, ...],
    accumulators: tuple[Accumulator | None, ...],
) -> None:
    """Refuse a batch that one compiled loop cannot run."""
    kinds = {(plant.system, type(plant)) for plant in plants}
    _require_one("plants of a batch must be of one system and of one kind", kinds)
    timesteps = {plant.step_length for plant in plants}
    _require_one("plants of a batch must have one timestep", timesteps)

    several = dict.fromkeys(controllers)
    laws = {item.law for item in several}
    _require_one("controllers of a batch must have the same law", laws)
    ideal = {item is None for item in loops}
    _require_one("runs of a batch must have a loop, or none", ideal)

    # A single controller that runs in Python only, as a policy, may have numbers of any kind.
    if len(several) > 1:
        numbers = {record_dtype(item.parameters) for item in several}
        _require_one("controllers of a batch must have the same kinds of numbers", numbers)
    memories = dict.fromkeys(item.memory for item in several)
    remembered = {record_dtype(memory()) for memory in memories}
    _require_one("controllers of a batch must have the same kind of memory", remembered)
    metrics = {item and item.kind for item in dict.fromkeys(accumulators)}
    _require_one("runs of a batch must have the same kind of accumulator", metrics)


def _require_one(rule: str, kinds: Set[Any]) -> None:
    """Refuse a batch with several kinds of what must be one kind."""
    if len(kinds) > 1:
        raise ArgumentError(f"all {rule}")


def _require_designed_for(
    system: System,
    law: Controller,
    h: float,
    period: float,
) -> None:
    """Refuse a controller of another system, timestep or control period."""
    if law.design is not None:
        designed = law.design.error.system
        # The law may know another model of the same plant.
        if (designed.states, designed.inputs) != (system.states, system.inputs):
            raise ArgumentError(
                f"{law.name} is designed for {designed.name}, the plant is {system.name}"
            )
    if law.design is not None and law.design.control_period is not None:
        designed_period = law.design.control_period
        _require_equal(f"{law.name} is designed for a control period", designed_period, period)


def _applied(
    loops: tuple[Loop | AppliedLoop | None, ...],
    controllers: tuple[Controller, ...],
    system: System,
    h: float,
    period: float,
) -> tuple[AppliedLoop | None, ...]:
    """Loop around the controller of each simulation.

    Raises:
        ArgumentError: If a loop does not fit, or was applied to another controller or other times.
    """
    pairs = list(zip(loops, controllers, strict=True))
    applied: dict[Any, AppliedLoop | None] = {}
    for loop, controller in dict.fromkeys(pairs):
        if isinstance(loop, AppliedLoop):
            _require_applied_to(controller, loop, h, period)
            applied[loop, controller] = loop
        elif loop is None:
            applied[loop, controller] = None
        else:
            applied[loop, controller] = apply_loop(
                loop, controller, system, control_period=period, timestep=h
            )
    return tuple(applied[pair] for pair in pairs)


def _require_applied_to(controller: Controller, loop: AppliedLoop, h: float, period: float) -> None:
    """Refuse a loop around another controller, or for other times."""
    if loop.controller.design is not controller.design:
        raise ArgumentError(
            f"the loop is around {loop.controller.name}, not around {controller.name}"
        )
    _require_equal("the loop is for a timestep", loop.timestep, h)
    _require_equal("the loop is for a control period", loop.period, period)


def _require_equal(statement: str, needed: float, used: float) -> None:
    """Refuse another time [s] than a controller needs."""
    if not math.isclose(needed, used, rel_tol=1e-9):
        raise ArgumentError(f"{statement} of {needed:g} s, not {used:g} s")

"""A loop around a law: its parts for one controller, system, timestep and control period.

``AppliedLoop`` is what is to be run, ``LoopRun`` its memory in one run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, NamedTuple

from pydantic import InstanceOf

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import Flag, Range, checked_call
from grosmc_mj.simulation.loop.design_model import design_model
from grosmc_mj.simulation.loop.loop import LARGEST_SEED, Loop
from grosmc_mj.simulation.loop.software import (
    Software,
    ideal_software,
    settle,
    software_at_start,
)
from grosmc_mj.simulation.loop.task import LoopTask
from grosmc_mj.simulation.loop.timing import LONGEST, SHORTEST, ControlPeriod, steps_in, stride_of
from grosmc_mj.simulation.loop.world import (
    Measured,
    World,
    ideal_world,
    measured_states,
    world_at_start,
)
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import System

# Arrays that a run changes, of each half.
_OF_WORLD = ("computer", "sensors", "actuators", "past", "queue")
_OF_SOFTWARE = (
    "setup",
    "states",
    "inputs",
    "estimators",
    "gain",
    "sent",
    "sent_at",
    "x",
    "mean",
)


class LoopRun(NamedTuple):
    """A loop in a run: its two halves, and what is measured between them.

    Attributes:
        world: Sensors, actuators and the times of the computer.
        measured: What reaches the software at a sample.
        software: Estimators, filter and prediction.
    """

    world: World
    measured: Measured
    software: Software


def ideal_loop(n: int, m: int) -> LoopRun:
    """Ideal loop of n states and m inputs, which the kernel leaves out."""
    return LoopRun(ideal_world(n, m), measured_states(0), ideal_software(n, m))


@dataclass(frozen=True, eq=False)
class AppliedLoop(LoopTask):
    """A loop around the law of a controller, of which runs begin."""

    # Every run begins with a copy of it.
    @cached_property
    def start(self) -> LoopRun:
        """Loop as a run begins, before it is told the start of the plant.

        Raises:
            ArgumentError: If an estimator does not fit.
            GainError: If there is no Kalman filter.
        """
        n = len(self.system.states)
        return LoopRun(world_at_start(self), measured_states(n), software_at_start(self))

    def begin(
        self,
        x0: Array,
        seen: Array,
        predicted: Array,
        **of_engine: Any,
    ) -> LoopRun:
        """Loop of a new run.

        Args:
            x0: True state at the start, (n,).
            seen: Array for the state by sensors and estimators, (n,).
            predicted: Array for the state that the law gets, (n,).
            of_engine: ``advance``, ``memory``, ``p`` and ``own`` of ``Software``.
        """
        start = self.start
        software = _copied(start.software, _OF_SOFTWARE)
        loop = LoopRun(
            world=_copied(start.world, _OF_WORLD),
            measured=_copied(start.measured, start.measured._fields),
            software=software._replace(seen=seen, predicted=predicted, **of_engine),
        )
        settle(loop.software, x0)
        return loop

    def restart(self, loop: LoopRun, x0: Array) -> None:
        """Bring a loop with arrays of the same ``sizes`` to the start of a run from x0, (n,)."""
        for name in _OF_WORLD:
            getattr(loop.world, name)[...] = getattr(self.start.world, name)
        for name in _OF_SOFTWARE:
            getattr(loop.software, name)[...] = getattr(self.start.software, name)
        if self.model is not None:
            loop.software.own[:] = self.model.own
        settle(loop.software, x0)

    # The native engine asks for it in each run.
    @cached_property
    def sizes(self) -> tuple[Any, ...]:
        """Shapes of the arrays that a run changes."""
        world = [getattr(self.start.world, name).shape for name in _OF_WORLD]
        software = [getattr(self.start.software, name).shape for name in _OF_SOFTWARE]
        return (*world, *software)

    def begin_uncompiled(
        self,
        x0: Array,
        memory: Any,
        seen: Array,
        predicted: Array,
    ) -> LoopRun:
        """Loop of a new run for plain Python.

        Args:
            x0: True state at the start, (n,).
            memory: Memory of the law.
            seen: Array for the state by sensors and estimators, (n,).
            predicted: Array for the state that the law gets, (n,).
        """
        model: Any = self.model
        p = self.controller.parameters

        def advance(t: float, x: Any, u: Any, h: float, _address: Any) -> None:
            model.advance(t, x, u, h, memory, p, model.own)

        loop = self.begin(x0, seen, predicted, advance=advance)
        return loop._replace(
            world=loop.world.uncompiled(),
            software=loop.software.uncompiled(),
        )

    def of_run(self, run: int) -> AppliedLoop:
        """Copy for the run of another number, which has noise of its own."""
        return apply_loop(
            self.loop,
            self.controller,
            self.system,
            control_period=self.period,
            timestep=self.timestep,
            predict=self.predicts,
            run=run,
            known=self.known,
        )


def _copied(record: Any, names: Sequence[str]) -> Any:
    """Copy of a named tuple with copies of some of its arrays."""
    return record._replace(**{name: getattr(record, name).copy() for name in names})


@checked_call
def apply_loop(
    loop: Loop,
    controller: InstanceOf[Controller],
    system: InstanceOf[System],
    *,
    control_period: ControlPeriod = 1e-3,
    timestep: Annotated[float, Range(SHORTEST, LONGEST, unit="s")] = 1e-3,
    predict: Flag = False,
    run: Annotated[int, Range(0, LARGEST_SEED, below=True, whole=True)] = 0,
    known: Loop | None = None,
) -> AppliedLoop:
    """Put a loop around a controller's law, for runs of this control period and timestep.

    The law gets the state by sensors and estimators; its output reaches the plant through computer
    and actuators. With ``predict`` it gets the state at the instant when its output arrives: the
    design model runs ahead over the dead time of sensors, computer and actuators, a lag counting
    as a delay of its time constants, under the outputs that are on their way. The model's recent
    error in the state's rate, a load say, goes on in the prediction.

    Args:
        loop: Parts of the loop.
        controller: Controller; observers and predictions need one with a design model.
        system: System of the plant, whose states are measured.
        control_period: Control period of the law [s]; a multiple of the timestep.
        timestep: Timestep of the physics [s].
        predict: Whether the law knows its loop.
        run: Number of the run: every run has noise of its own.
        known: Loop that the law knows, if it is another than the real one.

    Returns:
        The loop, for ``simulate(plant, controller, ..., loop=...)``.

    Raises:
        ArgumentError: If a part does not fit the system or the timestep.
        GainError: If no filter exists.
    """
    loop = loop.completed(system)
    known = loop if known is None else known.completed(system)
    stride, period = stride_of(control_period, timestep)
    steps_in("control_period", period, timestep)

    observers = sorted({part.law for part in loop.estimators} & {"eso", "kalman"})
    predictor = ["predict"] if predict else []
    if known != loop:
        known.require_fits(system, timestep, period)
        _require_one_age(known, system, predictor)
    loop.require_fits(system, timestep, period)
    _require_one_age(loop, system, [*observers, *predictor])

    sampled = controller.sampled(period)
    model = None
    users = observers or predictor
    if users:
        model = design_model(sampled, " and ".join(users))
    applied = AppliedLoop(
        controller=sampled,
        loop=loop,
        known=known,
        system=system,
        model=model,
        timestep=timestep,
        period=period,
        stride=stride,
        run=run,
        predicts=predict,
    )
    applied.start  # noqa: B018  refuses estimators before a run
    return applied


def _require_one_age(loop: Loop, system: System, users: list[str]) -> None:
    """Refuse states of different ages where one model is to run ahead of all of them.

    Args:
        loop: Parts of the loop.
        system: System of the plant.
        users: Observers and the prediction that run the model.
    """
    if not users:
        return
    if "predict" in users and len({part.delay for part in loop.actuators}) > 1:
        raise ArgumentError(
            "predict: the actuators have different delays, and the state is told at one instant: "
            "give them the same, the longest one's"
        )

    # An estimate is as old as its measurement.
    delays = {sensor.of: sensor.delay for sensor in loop.sensors}
    estimated = set()
    for part in loop.estimators:
        estimated.update(part.of)
    names = [state.name for state in system.states]
    ages = {name: delays.get(name, 0.0) for name in names if name not in estimated - set(delays)}
    if len(set(ages.values())) > 1:
        listed = ", ".join(f"{name} {delay:g} s" for name, delay in ages.items())
        raise ArgumentError(
            f"{' and '.join(users)}: the measurements have different ages, {listed}: give "
            "each of these states a [[sensor]] with the delay of the oldest one"
        )

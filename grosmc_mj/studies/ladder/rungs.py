"""The rungs from printed equations to the machine as built, one thing added at a time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.simulation.machine import (
    LuGre,
    MachinePart,
    Motor,
    SlidingLoad,
    Stop,
    SwingingLoad,
    Transmission,
    Wall,
)


@dataclass(frozen=True)
class Rung:
    """What a law stands on.

    Attributes:
        name: For people.
        plant: ``printed``, ``corrected`` or ``physics``.
        sampled: Whether the law has its own control period; else it is asked at every timestep.
        loop: What of the loop as built there is.
        parts: What of the machine as built there is.
    """

    name: str
    plant: PlantName
    sampled: bool = True
    loop: Loop = field(default_factory=Loop)
    parts: tuple[MachinePart, ...] = ()

    @property
    def looped(self) -> bool:
        """Whether there is anything of the loop."""
        return self.loop != Loop(seed=self.loop.seed)


def rungs_of(machine: Experiment) -> tuple[list[Rung], list[Rung]]:
    """The rungs of a machine: one on top of the other, and each thing alone.

    What the machine does not have makes no rung.

    Args:
        machine: A case with its loop and the parts of its machine.
    """
    names = machine.nominal.names
    ideal = [Rung(name, name, sampled=False) for name in names]
    top: PlantName = names[-1]
    climbing = [*ideal, Rung("sampled", top)]
    alone: list[Rung] = []
    last = climbing[-1]
    for name, loop, parts in _additions(machine):
        last = replace(
            last,
            name=name,
            loop=last.loop if loop is None else _merged(last.loop, loop),
            parts=_with(last.parts, parts),
        )
        climbing.append(last)
        alone.append(Rung(name, top, loop=loop or Loop(), parts=parts))
    return climbing, alone


def _additions(machine: Experiment) -> Iterator[tuple[str, Loop | None, tuple[MachinePart, ...]]]:
    """What is added, in the order of the ladder: a name, and what of loop or machine."""
    if loop := machine.case.loop:
        seed = loop.seed
        if loop.sensors or loop.estimators:
            seen = Loop(sensors=loop.sensors, estimators=loop.estimators, seed=seed)
            yield "sensors", seen, ()
        if loop.computing != Loop().computing:
            yield "delay", Loop(loop.computing, seed=seed), ()
        if loop.actuators:
            yield "actuator", Loop(actuators=loop.actuators, seed=seed), ()
    parts = machine.case.parts
    transmissions = [part for part in parts if isinstance(part, Transmission)]
    loose = [replace(each, stiffness=math.inf) for each in transmissions if each.backlash]
    flexible = [each for each in transmissions if math.isfinite(each.stiffness)]
    for name, found in (
        ("motor", [part for part in parts if isinstance(part, Motor)]),
        ("friction", [part for part in parts if isinstance(part, LuGre)]),
        ("backlash", loose),
        ("flexibility", flexible),
        ("loads", [part for part in parts if isinstance(part, (SwingingLoad, SlidingLoad))]),
        ("stops", [part for part in parts if isinstance(part, (Stop, Wall))]),
    ):
        if found:
            yield name, None, tuple(found)


def _merged(below: Loop, added: Loop) -> Loop:
    """Two loops that have different kinds of parts, as one."""
    return Loop(
        below.computing if below.computing != Loop().computing else added.computing,
        below.sensors or added.sensors,
        below.estimators or added.estimators,
        below.actuators or added.actuators,
        added.seed,
    )


def _with(
    below: tuple[MachinePart, ...], added: tuple[MachinePart, ...]
) -> tuple[MachinePart, ...]:
    """The parts, where one of the same kind and joint takes another's place."""
    new = {(type(part), part.of) for part in added}
    return (*(part for part in below if (type(part), part.of) not in new), *added)

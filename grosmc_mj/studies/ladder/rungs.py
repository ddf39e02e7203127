"""The rungs from printed equations to the machine as built, one thing added at a time."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.loop import Computing, Loop
from grosmc_mj.machine import (
    LuGre,
    MachinePart,
    Motor,
    SlidingLoad,
    Stop,
    SwingingLoad,
    Transmission,
    Wall,
)

_COMPUTING = {"delay": "delay", "jitter": "jitter", "missed": "missed samples"}
# What a rung's numbers are: tables of a case file, and which of their keys; None for all of them.
_TABLES: Mapping[str, tuple[Sequence[str], Collection[str] | None]] = {
    "sensors": (("sensor", "estimator"), None),
    **{name: (("computing",), (key,)) for key, name in _COMPUTING.items()},
    "actuator": (("actuator",), None),
    "motor": (("motor",), None),
    "friction": (("lugre",), None),
    "backlash": (("transmission",), ("backlash", "friction")),
    "flexibility": (("transmission",), ("stiffness", "damping", "inertia")),
    "loads": (("swinging_load", "sliding_load"), None),
    "stops": (("stop", "wall"), None),
}
_OWNERS = ("of", "joint", "input", "body")


@dataclass(frozen=True)
class Rung:
    """What a law stands on.

    Attributes:
        name: For people.
        plant: ``printed``, ``corrected`` or ``physics``.
        sampled: Whether the law has its own control period; else it is asked at every timestep.
        loop: What of the loop as built there is.
        parts: What of the machine as built there is.
        assumed: Which numbers of what this rung adds nobody has published, in words.
    """

    name: str
    plant: PlantName
    sampled: bool = True
    loop: Loop = field(default_factory=Loop)
    parts: tuple[MachinePart, ...] = ()
    assumed: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """The name, with a mark where it rests on numbers that nobody has published."""
        return f"{self.name}*" if self.assumed else self.name

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
        assumed = tuple(_assumed(machine, name))
        last = replace(
            last,
            name=name,
            loop=last.loop if loop is None else _merged(last.loop, loop),
            parts=_with(last.parts, parts),
            assumed=assumed,
        )
        climbing.append(last)
        alone.append(Rung(name, top, loop=loop or Loop(), parts=parts, assumed=assumed))
    return climbing, alone


def _assumed(machine: Experiment, rung: str) -> Iterator[str]:
    """The numbers that a rung adds and nobody has published, by what they are of."""
    kinds, numbers = _TABLES[rung]
    for kind in kinds:
        tables = getattr(machine.file, kind)
        for table in tables if isinstance(tables, list) else [tables]:
            own = [name for name in table.assumed if numbers is None or name in numbers]
            if own:
                of = next((getattr(table, key) for key in _OWNERS if hasattr(table, key)), kind)
                yield f"{' and '.join([of] if isinstance(of, str) else of)}: {', '.join(own)}"


def _additions(machine: Experiment) -> Iterator[tuple[str, Loop | None, tuple[MachinePart, ...]]]:
    """What is added, in the order of the ladder: a name, and what of loop or machine."""
    if loop := machine.case.loop:
        seed = loop.seed
        if loop.sensors or loop.estimators:
            seen = Loop(sensors=loop.sensors, estimators=loop.estimators, seed=seed)
            yield "sensors", seen, ()
        for name in ("delay", "jitter", "missed"):
            if amount := getattr(loop.computing, name):
                yield _COMPUTING[name], Loop(Computing(**{name: amount}), seed=seed), ()
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
    late = {name: value for name, value in vars(added.computing).items() if value}
    return Loop(
        replace(below.computing, **late),
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

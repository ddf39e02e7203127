"""Rungs of a machine: its equations, MuJoCo, its loop and its parts, one more on each."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.parts import table_of
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.mechanics.machine import PARTS, MachinePart, Transmission
from grosmc_mj.simulation.loop import Computing, Loop
from grosmc_mj.studies.ladder.assumed import (
    AssumedNumber,
    assumed_numbers,
    in_words,
    require_timestep,
    with_other_numbers,
)

_COMPUTING = {"delay": "delay", "jitter": "jitter", "missed": "missed samples"}
# Rungs of a machine in the order of the ladder; those of other effects come after them.
_MACHINE = ("motor", "friction", "backlash", "flexibility", "stops")
# The numbers of rungs that are more or less than tables of one effect: tables of a case file, and
# the keys in them; None for all keys.
_NUMBERS: Mapping[str, tuple[Sequence[str], Collection[str] | None]] = {
    "sensors": (("sensor", "estimator"), None),
    **{name: (("computing",), (key,)) for key, name in _COMPUTING.items()},
    "actuator": (("actuator",), None),
    "backlash": (("transmission",), ("backlash", "friction", "restitution", "duration")),
    "flexibility": (("transmission",), ("stiffness", "damping", "inertia")),
}


@dataclass(frozen=True)
class Rung:
    """A plant with a part of the loop and of the machine.

    Attributes:
        name: Name for people.
        plant: ``printed``, ``corrected`` or ``physics``.
        sampled: Whether the law has its own control period; else it runs at every timestep.
        loop: Part of the loop as built.
        parts: Parts of the machine as built.
        assumed: Numbers that this rung adds and that nobody has published, in words.
    """

    name: str
    plant: PlantName
    sampled: bool = True
    loop: Loop = field(default_factory=Loop)
    parts: tuple[MachinePart, ...] = ()
    assumed: tuple[str, ...] = ()

    @property
    def looped(self) -> bool:
        """Whether any part of the loop is not ideal."""
        return self.loop != Loop(seed=self.loop.seed)

    @property
    def title(self) -> str:
        """The name, with a mark where it rests on numbers that nobody has published."""
        return f"{self.name}*" if self.assumed else self.name

    def equals(self, other: Rung) -> bool:
        """Whether both have the same loop and the same parts."""
        return (self.loop, self.parts) == (other.loop, other.parts)

    def built(self, machine: Experiment) -> Experiment:
        """Return a machine with the parts of the rung alone.

        Args:
            machine: The machine; its own parts are taken off.
        """
        edits = [edit for edit in machine.edits if edit not in machine.parts]
        return machine.changed(edits=(*edits, *self.parts))

    def document(self) -> dict[str, Any]:
        """Return it as plain values."""
        loop = asdict(self.loop) if self.looped else None
        parts = [{"kind": part.kind, **asdict(part)} for part in self.parts]
        return {**vars(self), "loop": loop, "parts": parts}


def rungs_of(machine: Experiment) -> tuple[list[Rung], list[Rung]]:
    """Return the rungs of a machine: one on top of the other, and each part alone.

    Args:
        machine: A case with its loop and the parts of its machine; a missing part makes no rung.
    """
    plants = machine.nominal.names
    climbing = [Rung(plant, plant, sampled=False) for plant in plants]
    climbing.append(Rung("sampled", plants[-1]))

    numbers = list(assumed_numbers(machine))
    alone: list[Rung] = []
    for name, loop, parts in _additions(machine):
        rung = Rung(
            name,
            plants[-1],
            loop=loop or Loop(),
            parts=parts,
            assumed=tuple(_assumed(numbers, name)),
        )
        alone.append(rung)

        # On top, a part replaces the part of its type on the same joint or input.
        below = climbing[-1]
        replaced = {(type(part), part.of) for part in parts}
        kept = [part for part in below.parts if (type(part), part.of) not in replaced]
        all_of_loop = below.loop
        if loop is not None:
            all_of_loop = _merged(below.loop, loop)
        climbing.append(replace(rung, loop=all_of_loop, parts=(*kept, *parts)))
    return climbing, alone


def _assumed(numbers: Sequence[AssumedNumber], rung: str) -> Iterator[str]:
    """Yield the assumed numbers that a rung adds, by the part that has them."""
    tables = [table_of(part) for part in PARTS if _rung_of(part) == rung]
    kinds, keys = _NUMBERS.get(rung, (tables, None))
    added = [
        number
        for number in numbers
        if number.kind in kinds and (keys is None or number.name in keys)
    ]
    for _, words in in_words(added):
        yield words


def varied_rungs(machine: Experiment) -> dict[str, dict[str, Rung]]:
    """Return what becomes of each rung of the ladder by each assumed number, alone.

    Args:
        machine: As for ``rungs_of``.

    Returns:
        By the name of a rung: the rungs that differ from it, by the number and its change.
    """
    climbing, _ = rungs_of(machine)
    varied: dict[str, dict[str, Rung]] = {rung.name: {} for rung in climbing}
    for change, other in with_other_numbers(machine):
        rungs = {rung.name: rung for rung in rungs_of(other)[0]}
        for rung in climbing:
            changed = rungs.get(rung.name)
            if changed is None or changed.equals(rung):
                continue
            # Teeth that bounce for half the time may need a shorter timestep.
            with suppress(ModelError):
                require_timestep(changed.built(machine))
                varied[rung.name][change] = changed
    return varied


def _additions(machine: Experiment) -> Iterator[tuple[str, Loop | None, tuple[MachinePart, ...]]]:
    """Yield the additions in the order of the ladder: a name, and a part of loop or machine."""
    loop = machine.loop
    if loop:
        for name, part in _loop_additions(loop):
            yield name, part, ()
    for name, parts in _machine_additions(machine.parts):
        if parts:
            yield name, None, tuple(parts)


def _loop_additions(loop: Loop) -> Iterator[tuple[str, Loop]]:
    """Yield the parts of a loop that are not ideal, each as a loop."""
    seed = loop.seed
    if loop.sensors or loop.estimators:
        yield "sensors", Loop(sensors=loop.sensors, estimators=loop.estimators, seed=seed)
    for key, name in _COMPUTING.items():
        amount = getattr(loop.computing, key)
        if amount:
            yield name, Loop(Computing(**{key: amount}), seed=seed)
    if loop.actuators:
        yield "actuator", Loop(actuators=loop.actuators, seed=seed)


def _machine_additions(parts: Sequence[MachinePart]) -> Iterator[tuple[str, list[MachinePart]]]:
    """Yield the parts of a machine by rung; a transmission is rigid on the rung of its backlash."""
    rungs: dict[str, list[MachinePart]] = {name: [] for name in _MACHINE}
    for part in parts:
        if not isinstance(part, Transmission):
            rungs.setdefault(_rung_of(part), []).append(part)
            continue
        if part.backlash:
            rungs["backlash"].append(replace(part, stiffness=math.inf))
        if math.isfinite(part.stiffness):
            rungs["flexibility"].append(part)
    yield from rungs.items()


def _rung_of(part: MachinePart | type[MachinePart]) -> str:
    """Return the name of the rung of a part other than a transmission, which has two."""
    return part.effect or part.kind


def _merged(below: Loop, added: Loop) -> Loop:
    """Two loops that have different kinds of parts, as one."""
    computing = {name: value for name, value in vars(added.computing).items() if value}
    return Loop(
        replace(below.computing, **computing),
        below.sensors or added.sensors,
        below.estimators or added.estimators,
        below.actuators or added.actuators,
        added.seed,
    )

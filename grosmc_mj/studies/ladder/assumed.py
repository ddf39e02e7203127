"""Numbers of a machine that nobody has published: each is tried at half and at twice its value."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.parts import machine_of_file, table_of
from grosmc_mj.ground.errors import GrosmcError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

# A part may refuse half or twice of a number: then it is tried nearer to its value.
_POWERS = (1.0, 0.5, 0.25, 0.125)


class AssumedNumber(NamedTuple):
    """A number of a part that nobody has published.

    Attributes:
        kind: Name of the part's table, such as ``lugre``.
        path: Path in the case file.
        owner: State, joint, input or body that the part is of; else its kind.
        name: Name of the number.
        value: Its value, in the unit of the system.
    """

    kind: str
    path: str
    owner: str
    name: str
    value: float

    def __str__(self) -> str:
        """Name for people."""
        return f"{self.kind}.{self.owner}.{self.name}"


def assumed_numbers(machine: Experiment) -> Iterator[AssumedNumber]:
    """Yield the numbers of a case's loop and machine that its file lists as assumed."""
    parts: dict[str, list[Any]] = {}
    for part in machine_of_file(machine.file, machine.nominal.system):
        parts.setdefault(table_of(part), []).append(part)
    if machine.loop is not None:
        for kind, part in machine.loop.parts:
            parts.setdefault(kind, []).append(part)

    for kind, parts_of_kind in parts.items():
        tables = getattr(machine.file, kind)
        if not isinstance(tables, list):
            # The loop of a file without [computing] has an ideal computer.
            tables = [] if tables is None else [tables]
        for index, table in enumerate(tables):
            for name in table.assumed:
                path = f"{kind}.{name}"
                if kind != "computing":
                    path = f"{kind}[{index + 1}].{name}"
                value = getattr(parts_of_kind[index], name)
                owner = " and ".join(table.of) or kind
                yield AssumedNumber(kind, path, owner, name, value)


def in_words(numbers: Iterable[AssumedNumber]) -> Iterator[tuple[str, str]]:
    """Yield the kind of each part, and its owner with the names of its numbers."""
    names: dict[tuple[str, str, str], list[str]] = {}
    for number in numbers:
        # One owner may have two parts.
        part = number.path.rpartition(".")[0]
        names.setdefault((part, number.kind, number.owner), []).append(number.name)
    for (_, kind, owner), of_part in names.items():
        yield kind, f"{owner}: {', '.join(of_part)}"


def with_other_numbers(machine: Experiment) -> Iterator[tuple[str, Experiment]]:
    """Yield the machine with each assumed number at half and at twice its value, after its name."""
    for number in assumed_numbers(machine):
        for factor in (0.5, 2.0):
            for power in _POWERS:
                scale = factor**power
                try:
                    changed = machine.changed({number.path: scale * number.value})
                    require_timestep(changed)
                except GrosmcError:
                    continue
                yield f"{number} times {scale:.2g}", changed
                break


def require_timestep(machine: Experiment) -> None:
    """Refuse a machine with a part that needs a shorter timestep.

    Raises:
        ModelError: With the part.
    """
    plant = machine.plant(machine.nominal.truest)
    if isinstance(plant, MujocoPlant):
        plant.undrawn_model  # noqa: B018  compiling checks it

"""Numbers of a machine that nobody has published: each is tried at half and at twice its value."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.parts import LOOP_PARTS, MACHINE_PARTS
from grosmc_mj.experiments.file.paths import place_of
from grosmc_mj.experiments.number import Number, find_number
from grosmc_mj.ground.errors import GrosmcError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

# A part may refuse half or twice of a number: then it is tried nearer to its value.
_POWERS = (1.0, 0.5, 0.25, 0.125)


class AssumedNumber(NamedTuple):
    """A number of a part that nobody has published.

    Attributes:
        number: The number.
        owner: State, joint, input or body that the part is of; else the kind of the part.
    """

    number: Number
    owner: str

    @property
    def kind(self) -> str:
        """Name of the part's table, such as ``lugre``."""
        return self.number.place.owner

    @property
    def name(self) -> str:
        """Name of the number in its table."""
        return self.number.place.field

    def __str__(self) -> str:
        """Name for people."""
        return f"{self.kind}.{self.owner}.{self.name}"


def assumed_numbers(machine: Experiment) -> Iterator[AssumedNumber]:
    """Yield the numbers of a case's machine and loop that its file lists as assumed."""
    for kind in (*MACHINE_PARTS, *LOOP_PARTS):
        tables = getattr(machine.file, kind)
        if not isinstance(tables, list):
            # The computer.
            tables = [] if tables is None else [tables]
        for index, table in enumerate(tables):
            for name in table.assumed:
                path = f"{kind}.{name}"
                if kind != "computing":
                    path = f"{kind}[{index + 1}].{name}"
                number = find_number(machine, path, place_of(machine.file.content, path))
                # A part that was taken away has none.
                if number is not None:
                    yield AssumedNumber(number, " and ".join(table.of) or kind)


def in_words(numbers: Iterable[AssumedNumber]) -> Iterator[tuple[str, str]]:
    """Yield the kind of each part, and its owner with the names of its numbers."""
    names: dict[tuple[str, str, str], list[str]] = {}
    for number in numbers:
        # One owner may have two parts.
        part = number.number.path.rpartition(".")[0]
        names.setdefault((part, number.kind, number.owner), []).append(number.name)
    for (_, kind, owner), of_part in names.items():
        yield kind, f"{owner}: {', '.join(of_part)}"


def with_other_numbers(machine: Experiment) -> Iterator[tuple[str, Experiment]]:
    """Yield the machine with each assumed number at half and at twice its value, after its name."""
    for assumed in assumed_numbers(machine):
        path = assumed.number.path
        value = assumed.number.get(machine)
        for factor in (0.5, 2.0):
            for power in _POWERS:
                scale = factor**power
                try:
                    changed = machine.changed({path: scale * value})
                    require_timestep(changed)
                except GrosmcError:
                    continue
                yield f"{assumed} times {scale:.2g}", changed
                break


def require_timestep(machine: Experiment) -> None:
    """Refuse a machine with a part that needs a shorter timestep.

    Raises:
        ModelError: With the part.
    """
    plant = machine.plant(machine.nominal.truest)
    if isinstance(plant, MujocoPlant):
        plant.undrawn_model  # noqa: B018  compiling checks it

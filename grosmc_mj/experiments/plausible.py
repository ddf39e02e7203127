"""Numbers of a case that are allowed, and probably a mistake."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from typing import Any

from grosmc_mj.experiments.file.parts import TABLES, table_of, unit_of
from grosmc_mj.fields import Range, range_of
from grosmc_mj.loop import Loop
from grosmc_mj.physics.edit import Edit
from grosmc_mj.plants import System


def implausible(
    system: System, x0: Sequence[float], edits: Sequence[Edit], loop: Loop | None
) -> Iterator[str]:
    """Return a line for each number of a case that is far from those of any machine.

    The usual sizes stand beside its field, or are those of its unit.

    Args:
        system: System of the plant.
        x0: Start, (n,).
        edits: Edits and parts of the machine.
        loop: The loop, if there is one.
    """
    parts: list[tuple[str, Any]] = [(table_of(edit), edit) for edit in edits]
    if loop is not None:
        parts += loop.parts
    for label, value, bounds in [*_starts(system, x0), *_numbers(system, parts)]:
        if not isinstance(value, float):
            continue
        usual = bounds.unusual(value)
        if usual:
            line = f"{label} = {value:g} {bounds.unit} is implausible; usual: {usual} {bounds.unit}"
            # A number without a unit leaves two blanks.
            yield " ".join(line.split())


def _starts(system: System, x0: Sequence[float]) -> Iterator[tuple[str, Any, Range]]:
    """Return label, value and range of each state at the start."""
    for state, value in zip(system.states, x0, strict=True):
        # A start at an operating point has rounding errors in the place of zeros.
        yield f"start: {state.name}", value, Range(unit=state.unit, usual=(0, 1e4))


def _numbers(system: System, parts: Iterable[tuple[str, Any]]) -> Iterator[tuple[str, Any, Range]]:
    """Return label, value and range of each number of edits, machine and loop."""
    for kind, part in parts:
        owner = getattr(part, "of", "")
        if not isinstance(owner, str):
            owner = owner[0]
        name = f"{kind} of {owner!r}" if owner else kind
        for item in fields(part):
            bounds = range_of(type(part), item.name)
            if bounds is None:
                continue
            if kind in TABLES and not bounds.whole:
                bounds = replace(bounds, unit=unit_of(kind, owner, item.name, system))
            yield f"{name}: {item.name}", getattr(part, item.name), bounds
